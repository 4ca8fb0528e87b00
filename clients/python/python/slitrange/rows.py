"""Runs the sensor's own core on rows in numpy arrays: the code of the firmware, with the same bits."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from slitrange import _core
from slitrange.errors import WrongUse

ESTIMATORS: tuple[str, ...] = tuple(_core.ESTIMATORS)
"""The names of the estimators."""

FAULTS: tuple[str, ...] = tuple(_core.FAULTS)
"""The names of the faults."""


@dataclass(frozen=True, kw_only=True)
class Geometry:
    """The layout and the meaning of the words of a row.

    Attributes:
        words: Words in a row.
        light: The words of the pixels that see light, 32 to 4096. Pixel 0 of a centre is the first of them.
        shielded: The words of the pixels under metal. Empty if there are none.
        falling: Whether words fall with light, from full scale down.
        bits: Bits of the converter, 1 to 12.
        electrons_per_count: The gain: electrons that make a count, 1 or more. The uncertainty needs the gain
            for the light's shot noise. `math.inf` ignores shot noise. The core measures the read noise on
            each row itself.
        saturation: The count from which a pixel is saturated, light positive, black level included. If the
            sensor's well is full below full scale, state that level less four standard deviations of the read
            noise. A count above full scale means full scale.
    """

    words: int
    light: range
    shielded: range = range(0)
    falling: bool = False
    bits: int = 12
    electrons_per_count: float = 10.0
    saturation: int = _core.LARGEST_COUNT

    def __post_init__(self) -> None:
        """Checks the values."""
        for name, pixels in (("light", self.light), ("shielded", self.shielded)):
            if pixels.step != 1 or not 0 <= pixels.start <= pixels.stop <= self.words:
                raise WrongUse(
                    f"{name} is {pixels}, but must be a range of step 1 within the "
                    f"{self.words} words of a row"
                )
            if len(pixels) > _core.MAX_PIXELS:
                raise WrongUse(
                    f"{name} has {len(pixels)} pixels, but the core takes at most {_core.MAX_PIXELS}: "
                    "measure a part of the row"
                )
        if len(self.light) < _core.MIN_PIXELS:
            raise WrongUse(
                f"light has {len(self.light)} pixels, but the core takes at least {_core.MIN_PIXELS}: take "
                "more of the row"
            )
        if not 1 <= self.bits <= 12:
            raise WrongUse(
                f"bits is {self.bits}, but the core takes 1 to 12 bits: shift the words of a finer "
                "converter, as in rows >> 4 for 16 bits, and state the gain for the shifted counts"
            )
        if not self.electrons_per_count >= 1:
            raise WrongUse(
                f"electrons_per_count is {self.electrons_per_count}, but must be 1 or more: shift the words, "
                "as in rows >> 1, and state the gain for the shifted counts"
            )
        if not 0 < self.saturation <= 0xFFFF:
            raise WrongUse(f"saturation is {self.saturation}, but must be 1 to 65535 counts")

    @classmethod
    def of_pixels(
        cls,
        pixels: int,
        *,
        electrons_per_count: float = 10.0,
        saturation: int = _core.LARGEST_COUNT,
    ) -> "Geometry":
        """Rows of pixels that all see light, with words that rise with light up to 4095."""
        return cls(
            words=pixels,
            light=range(pixels),
            electrons_per_count=electrons_per_count,
            saturation=saturation,
        )

    @property
    def full_scale(self) -> int:
        """The largest word of the converter."""
        return (1 << self.bits) - 1


def _tcd1304dg() -> Geometry:
    words, light, shielded, falling, bits, electrons, saturation = _core.tcd1304dg()
    return Geometry(
        words=words,
        light=range(*light),
        shielded=range(*shielded),
        falling=falling,
        bits=bits,
        electrons_per_count=electrons,
        saturation=saturation,
    )


TCD1304DG = _tcd1304dg()
"""The rows of the TCD1304DG, as the firmware's driver reads them."""


@dataclass(frozen=True)
class Centres:
    """The centres of frames, one element of each array for each frame.

    Attributes:
        centre_px: The spot's centre in pixels: pixel i covers i - 0.5 to i + 0.5. NaN with a fault.
        u_px: The standard uncertainty of the centre in pixels: its parts `r_px` and `shape_px`. What the
            pixels differ by is not in it, because that is your sensor's. NaN with a fault.
        r_px: The part by the noise of the rows. A sensor's `Centre` has only this one in a line, as `u_px`.
        shape_px: The part by the spot's shape: how far a flaw that made it lopsided may have moved it.
        height: The spot's height in counts, above the background. `centroid` counts from the black level.
            NaN with a fault.
        width_px: The spot's width: sigma of the gaussian, in pixels. NaN with a fault.
        asymmetry_px: How lopsided the spot is: frames x 5 shifts in pixels. NaN also if the row shows too
            little of the spot for that.
        rows_used: The rows in the mean.
        misfits: Of these, the rows that do not look like a spot. Their centre may be off by more than u.
        fault: The name of the fault, or "" for a centre. FAULTS lists the names.
    """

    centre_px: npt.NDArray[np.float64]
    u_px: npt.NDArray[np.float64]
    r_px: npt.NDArray[np.float64]
    shape_px: npt.NDArray[np.float64]
    height: npt.NDArray[np.float64]
    width_px: npt.NDArray[np.float64]
    asymmetry_px: npt.NDArray[np.float64]
    rows_used: npt.NDArray[np.uint16]
    misfits: npt.NDArray[np.uint16]
    fault: npt.NDArray[np.str_]

    def __len__(self) -> int:
        """The number of frames."""
        return len(self.centre_px)


def centres(
    rows: npt.NDArray[np.uint16],
    estimator: str = "adaptive",
    geometry: Geometry | None = None,
    *,
    black_level: float | str | None = None,
    frame: int = 1,
) -> Centres:
    """Finds the centre of the spot in each row.

    Args:
        rows: The words of the rows, uint16: an array of rows x words, or of the words of one row.
        estimator: One of ESTIMATORS.
        geometry: What the words mean. Without it, that of `Geometry.of_pixels`.
        black_level: The counts of an unlit pixel, "shielded" for the mean of the shielded pixels, or "frame"
            for the mean of the pixels away from the spot. Without it "shielded", or "frame" if the geometry
            has no shielded pixels. Only `centroid` needs the black level.
        frame: Rows in a frame. 1 measures each row by itself. With more, the rows that follow each other are
            a frame, and the result is the mean of their centres, as the firmware computes it.

    Returns:
        The centres, one for each frame.

    Raises:
        WrongUse: An argument cannot be used. The message says why.
    """
    rows = _checked(rows)
    words = rows.shape[1]
    if geometry is None:
        geometry = Geometry.of_pixels(words)
    if words != geometry.words:
        raise WrongUse(f"the rows have {words} words, but the geometry has {geometry.words}")
    largest = int(rows.max(initial=0))
    if largest > geometry.full_scale:
        raise WrongUse(
            f"the rows have the word {largest}, but a converter of {geometry.bits} bits makes at most "
            f"{geometry.full_scale}: shift the words of a finer converter, as in rows >> 4 for 16 bits, and "
            "state the gain for the shifted counts"
        )
    if estimator not in ESTIMATORS:
        raise WrongUse(f"there is no estimator {estimator!r}: take one of {', '.join(ESTIMATORS)}")
    if not 1 <= frame <= _core.MAX_ROWS:
        raise WrongUse(f"frame is {frame}, but a frame has 1 to {_core.MAX_ROWS} rows")
    if len(rows) % frame:
        raise WrongUse(f"{len(rows)} rows are no whole number of frames of {frame} rows: leave some out")
    (centre, noise, shape, height, width, *asymmetry), (rows_used, misfits), codes = _core.centres(
        rows,
        estimator,
        (
            geometry.words,
            (geometry.light.start, geometry.light.stop),
            (geometry.shielded.start, geometry.shielded.stop),
            geometry.falling,
            geometry.bits,
            geometry.electrons_per_count,
            geometry.saturation,
        ),
        _black_level(black_level, geometry),
        frame,
    )
    return Centres(
        centre_px=centre,
        u_px=np.hypot(noise, shape),
        r_px=noise,
        shape_px=shape,
        height=height,
        width_px=width,
        asymmetry_px=np.stack(asymmetry, axis=1),
        rows_used=rows_used,
        misfits=misfits,
        # The code of a centre is -1: the last name.
        fault=np.array([*FAULTS, ""])[codes],
    )


def _checked(rows: Any) -> npt.NDArray[np.uint16]:
    """The rows as an array of rows x words."""
    if not isinstance(rows, np.ndarray):
        raise WrongUse(
            f"rows is a {type(rows).__name__}, but must be a numpy array: np.asarray(rows, dtype=np.uint16)"
        )
    if rows.dtype.newbyteorder("=") != np.uint16:
        raise WrongUse(
            f"rows has the dtype {rows.dtype}, but must have uint16: if all values are whole numbers from 0 "
            f"to {_core.LARGEST_COUNT}, convert it by rows.astype(np.uint16)"
        )
    if rows.ndim == 1:
        rows = rows[np.newaxis]
    if rows.ndim != 2 or rows.shape[1] == 0:
        raise WrongUse(f"rows has the shape {rows.shape}, but must be rows x words, or the words of one row")
    checked: npt.NDArray[np.uint16] = rows.astype(np.uint16, copy=False)
    return checked


def _black_level(black_level: float | str | None, geometry: Geometry) -> str:
    """The black level as the core's wrapper reads it."""
    if black_level is None:
        return "shielded" if geometry.shielded else "frame"
    if isinstance(black_level, str):
        if black_level not in ("shielded", "frame"):
            raise WrongUse(
                f"black_level is {black_level!r}, but must be 'shielded', 'frame' or a number of counts"
            )
        if black_level == "shielded" and not geometry.shielded:
            raise WrongUse("black_level is 'shielded', but the geometry has no shielded pixels: take 'frame'")
        return black_level
    if not (math.isfinite(black_level) and 0 <= black_level <= geometry.full_scale):
        raise WrongUse(f"black_level is {black_level}, but must be 0 to {geometry.full_scale} counts")
    return repr(float(black_level))
