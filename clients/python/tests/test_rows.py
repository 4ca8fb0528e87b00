"""`centres` on synthetic rows whose centres are known."""

import math

import numpy as np
import numpy.typing as npt
import pytest

import slitrange
from slitrange import TCD1304DG, Geometry

PIXELS = 1024
WIDTH_PX = 7.7
HEIGHT = 2000.0
BLACK = 300.0
GAIN = 10.0
READ_NOISE = 5.0


def gaussian_rows(
    count: int, seed: int, height: float = HEIGHT
) -> tuple[npt.NDArray[np.uint16], npt.NDArray[np.float64]]:
    """Rows of a gaussian spot with shot noise, read noise and rounding; and their true centres."""
    random = np.random.default_rng(seed)
    truth = 500 + 20 * random.random(count)
    pixels = np.arange(PIXELS)
    light = height * np.exp(-0.5 * ((pixels - truth[:, np.newaxis]) / WIDTH_PX) ** 2)
    counts = random.poisson(light * GAIN) / GAIN + BLACK + random.normal(0, READ_NOISE, light.shape)
    return np.clip(np.rint(counts), 0, 4095).astype(np.uint16), truth


@pytest.mark.parametrize("estimator", slitrange.ESTIMATORS)
def test_errors_are_as_large_as_the_claimed_r(estimator: str) -> None:
    rows, truth = gaussian_rows(2000, seed=1)
    found = slitrange.centres(rows, estimator)
    assert set(found.fault) == {""}
    # Noise makes some spots look lopsided, and then u is larger.
    assert 1 < np.mean(found.u_px / found.r_px) < 1.1
    errors = (found.centre_px - truth) / found.r_px
    chi = math.sqrt(np.mean(errors**2))
    print(f"{estimator}: chi {chi:.3f}, largest error {np.abs(errors).max():.2f} u")
    # The standard deviation of chi is 1/sqrt(2 * 2000) = 0.016.
    assert 0.93 < chi < 1.07
    assert np.abs(errors).max() < 5
    assert np.mean(found.width_px) == pytest.approx(WIDTH_PX, rel=0.1)
    # The curve of `fraunhofer` has a flatter top than a gaussian.
    assert np.mean(found.height) == pytest.approx(HEIGHT, rel=0.05)


def test_a_lopsided_spot_is_within_u() -> None:
    # A second reflection, 12 px beside the spot.
    rows, truth = gaussian_rows(32, seed=12)
    for share, most in ((0.03, 1.5), (0.06, 2), (0.1, 3)):
        light = (
            HEIGHT * share * np.exp(-0.5 * ((np.arange(PIXELS) - truth[:, np.newaxis] + 12) / WIDTH_PX) ** 2)
        )
        found = slitrange.centres(rows + np.rint(light).astype(np.uint16))
        errors = np.abs(found.centre_px - truth)
        print(f"{share}: errors {errors.mean():.3f} px, u {found.u_px.mean():.3f}, r {found.r_px.mean():.3f}")
        assert (errors < 2 * found.u_px).all()
        assert (errors > 2 * found.r_px).all()
        assert found.u_px.max() < most
        assert (found.u_px == np.hypot(found.r_px, found.shape_px)).all()
        assert found.asymmetry_px.shape == (32, 5)
        assert (np.abs(found.asymmetry_px).max(axis=1) > 3 * found.r_px).all()


@pytest.mark.parametrize("pixels", [32, 36, 48, 64, 128])
def test_short_rows_have_a_centre(pixels: int) -> None:
    random = np.random.default_rng(pixels)
    truth = pixels / 2 - 1 + random.random(200)
    for width in (1.5, 2, 3, 4):
        light = 1500 * np.exp(-0.5 * ((np.arange(pixels) - truth[:, np.newaxis]) / width) ** 2)
        counts = random.poisson(light * GAIN) / GAIN + BLACK + random.normal(0, READ_NOISE, light.shape)
        found = slitrange.centres(np.rint(counts).astype(np.uint16))
        assert set(found.fault) == {""}
        assert (np.abs(found.centre_px - truth) < 5 * found.u_px).all()
        # README says so.
        if pixels >= 24 * width:
            assert np.median(found.shape_px) == 0


def test_u_is_near_the_bound() -> None:
    rows, _ = gaussian_rows(200, seed=2)
    pixels = np.arange(PIXELS) - 512.0
    light = HEIGHT * np.exp(-0.5 * (pixels / WIDTH_PX) ** 2)
    variance = light / GAIN + READ_NOISE**2 + 1 / 12
    # The Cramér-Rao bound of the centre alone: by symmetry, height, width and level do not enter.
    bound = 1 / math.sqrt(np.sum((light * pixels / WIDTH_PX**2) ** 2 / variance))
    u = float(np.mean(slitrange.centres(rows).r_px))
    print(f"u {u:.5f} px, bound {bound:.5f} px")
    assert 0.98 < u / bound < 1.05


def test_a_frame_is_the_mean_of_its_rows() -> None:
    rows, _ = gaussian_rows(1, seed=3)
    frame = np.repeat(rows, 16, axis=0)
    alone = slitrange.centres(rows)
    mean = slitrange.centres(frame, frame=16)
    assert len(alone) == len(mean) == 1
    assert mean.centre_px[0] == pytest.approx(alone.centre_px[0], abs=2**-12)
    assert mean.rows_used[0] == 16
    # Sixteen rows have a quarter of the uncertainty of one.
    assert mean.r_px[0] == pytest.approx(alone.r_px[0] / 4, rel=0.02)


def test_each_row_is_measured_by_itself() -> None:
    rows, _ = gaussian_rows(20, seed=4)
    together = slitrange.centres(rows)
    alone = [slitrange.centres(row).centre_px[0] for row in rows]
    assert list(together.centre_px) == alone


def test_a_row_with_a_fault_gives_nan_and_its_name() -> None:
    rows, truth = gaussian_rows(4, seed=5)
    rows[1] = gaussian_rows(1, seed=5, height=0)[0][0]
    rows[2] = np.clip(rows[2].astype(np.int64) * 3, 0, 4095)
    found = slitrange.centres(rows)
    assert list(found.fault) == ["", "no spot", "saturated", ""]
    for quantity in (
        *(found.centre_px, found.u_px, found.r_px, found.shape_px, found.height, found.width_px),
        found.asymmetry_px[:, 0],
    ):
        assert list(np.isnan(quantity)) == [False, True, True, False]
    assert list(found.rows_used) == [1, 0, 0, 1]
    assert abs(found.centre_px[3] - truth[3]) < 5 * found.u_px[3]
    assert set(found.fault) - {""} <= set(slitrange.FAULTS)


def test_words_of_the_sensor_head() -> None:
    rows, truth = gaussian_rows(8, seed=6)
    dark = np.random.default_rng(7).normal(BLACK, READ_NOISE, (8, TCD1304DG.words))
    words = 4095 - np.rint(dark).astype(np.uint16)
    begin = TCD1304DG.light.start
    words[:, begin : begin + PIXELS] = 4095 - rows
    found = slitrange.centres(words, geometry=TCD1304DG)
    assert np.abs((found.centre_px - truth) / found.u_px).max() < 5
    assert TCD1304DG.falling
    assert TCD1304DG.electrons_per_count == pytest.approx(10, rel=1e-3)


def test_the_gain_sets_the_shot_noise_of_u() -> None:
    rows, _ = gaussian_rows(50, seed=7)

    def u(gain: float) -> float:
        geometry = Geometry.of_pixels(PIXELS, electrons_per_count=gain)
        return float(np.mean(slitrange.centres(rows, geometry=geometry).r_px))

    print(f"u {u(10):.5f} px with shot noise, {u(math.inf):.5f} px without")
    pixels = np.arange(PIXELS) - 512.0
    light = np.exp(-0.5 * (pixels / WIDTH_PX) ** 2)
    read_noise = math.sqrt(READ_NOISE**2 + 1 / 12)
    slopes = math.sqrt(np.sum((HEIGHT * light * pixels / WIDTH_PX**2) ** 2))
    # Without shot noise, u is the bound for read noise alone.
    assert u(math.inf) == pytest.approx(read_noise / slopes, rel=0.05)
    assert u(10) > 2 * u(math.inf)


def test_a_saturation_below_full_scale_is_a_fault() -> None:
    rows, _ = gaussian_rows(1, seed=8)
    geometry = Geometry.of_pixels(PIXELS, saturation=2000)
    assert list(slitrange.centres(rows, geometry=geometry).fault) == ["saturated"]


def test_the_black_level_counts_for_the_centroid() -> None:
    rows, _ = gaussian_rows(20, seed=9)
    from_frame = slitrange.centres(rows, "centroid").height.mean()
    fixed = slitrange.centres(rows, "centroid", black_level=100).height.mean()
    # A black level 200 counts lower makes the spot 200 counts higher.
    assert fixed - from_frame == pytest.approx(200, abs=1)


def test_other_layouts_of_memory_give_the_same() -> None:
    rows, _ = gaussian_rows(10, seed=10)
    expected = list(slitrange.centres(rows).centre_px)
    assert list(slitrange.centres(np.asfortranarray(rows)).centre_px) == expected
    assert list(slitrange.centres(rows.astype(">u2")).centre_px) == expected
    assert list(slitrange.centres(np.repeat(rows, 2, axis=0)[::2]).centre_px) == expected
    rows.flags.writeable = False
    assert list(slitrange.centres(rows).centre_px) == expected


def test_no_rows_give_no_centres() -> None:
    assert len(slitrange.centres(np.zeros((0, PIXELS), dtype=np.uint16))) == 0


ROWS = np.full((4, 64), 300, dtype=np.uint16)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (ROWS.tolist(), "rows is a list, but must be a numpy array"),
        (ROWS.astype(np.float64), "rows has the dtype float64, but must have uint16"),
        (ROWS.astype(np.int16), "rows has the dtype int16, but must have uint16"),
    ],
)
def test_wrong_types_are_refused(rows: object, message: str) -> None:
    with pytest.raises(slitrange.WrongUse, match=message):
        slitrange.centres(rows)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rows": ROWS[np.newaxis]}, r"rows has the shape \(1, 4, 64\)"),
        ({"rows": ROWS[:, :0]}, r"rows has the shape \(4, 0\)"),
        ({"rows": ROWS * 20}, "the rows have the word 6000, but a converter of 12 bits makes at most 4095"),
        ({"rows": np.zeros((1, 4097), dtype=np.uint16)}, "light has 4097 pixels, .* at most 4096"),
        ({"estimator": "median"}, "there is no estimator 'median': take one of centroid, "),
        ({"geometry": TCD1304DG}, "the rows have 64 words, but the geometry has 3694"),
        ({"black_level": "dark"}, "black_level is 'dark'"),
        ({"black_level": "shielded"}, "the geometry has no shielded pixels"),
        ({"black_level": math.nan}, "black_level is nan, but must be 0 to 4095 counts"),
        ({"black_level": 4096}, "black_level is 4096"),
        ({"frame": 0}, "frame is 0, but a frame has 1 to 64 rows"),
        ({"frame": 65}, "frame is 65"),
        ({"frame": 3}, "4 rows are no whole number of frames of 3 rows"),
    ],
)
def test_wrong_arguments_are_refused(change: dict[str, object], message: str) -> None:
    arguments: dict[str, object] = {"rows": ROWS, **change}
    with pytest.raises(slitrange.WrongUse, match=message):
        slitrange.centres(**arguments)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"light": range(65)}, r"light is range\(0, 65\), but must be a range of step 1 within the 64 words"),
        ({"light": range(0, 64, 2)}, "must be a range of step 1"),
        ({"light": range(0)}, "light has 0 pixels, but the core takes at least 32"),
        ({"light": range(31)}, "light has 31 pixels"),
        ({"shielded": range(-1, 4)}, "shielded is range"),
        ({"bits": 16}, "bits is 16, but the core takes 1 to 12 bits: .* rows >> 4"),
        ({"electrons_per_count": 0.5}, "electrons_per_count is 0.5, but must be 1 or more"),
        ({"electrons_per_count": math.nan}, "electrons_per_count is nan"),
        ({"saturation": 0}, "saturation is 0"),
    ],
)
def test_wrong_geometries_are_refused(change: dict[str, object], message: str) -> None:
    arguments: dict[str, object] = {"words": 64, "light": range(64), **change}
    with pytest.raises(slitrange.WrongUse, match=message):
        Geometry(**arguments)  # type: ignore[arg-type]
