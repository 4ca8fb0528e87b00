"""What the sensor's lines say. The lines are those of docs/serial-line.md."""

import random
from dataclasses import replace

import pytest

from slitrange import Centre, Fault, Reading, readings

LINE = "d 800.1234 mm u 0.4372 r 0.0035 x 1770.1234 a 1011 n 16/16"
READING = Reading(
    distance_mm=800.1234,
    u_mm=0.4372,
    r_mm=0.0035,
    centre_px=1770.1234,
    height=1011,
    rows_used=16,
    rows=16,
    line=LINE,
)


def test_a_reading_has_all_that_its_line_says() -> None:
    assert readings.result(LINE) == READING
    assert str(READING) == LINE
    line = LINE.replace("16/16", "15/16") + " t 187 k 16 m 3 c 4 h 2 g s"
    flagged = replace(
        READING,
        rows_used=15,
        exposure_us=187,
        slits=16,
        misfits=3,
        independent_rows=4,
        is_nominal=True,
        has_other_settings=True,
        held=2,
        line=line,
    )
    assert readings.result(line) == flagged
    assert (READING.flags, flagged.flags) == ("", "mchgs")


def test_a_difference_may_be_negative() -> None:
    line = "z -1.2340 mm u 0.4370 r 0.0350 x 1823.1250 a 1830 n 16/16"
    found = readings.result(line)
    assert isinstance(found, Reading)
    assert (found.distance_mm, found.is_relative) == (-1.234, True)


def test_later_firmware_may_say_more() -> None:
    line = f"# 1234 @ 12345678 {LINE} w 8.5988 q 17 -3.5 j 9 y"
    stamped = replace(
        READING, counter=1234, time_us=12345678, width_px=8.5988, unknown="q 17 -3.5 j 9 y", line=line
    )
    assert readings.result(line) == stamped
    for start, counter, time_us in (("# 5 ", 5, None), ("@ 6 ", None, 6)):
        line = start + LINE
        assert readings.result(line) == replace(READING, counter=counter, time_us=time_us, line=line)
    line = "d 800123.4 um u 437.2 r 3.5 x 1770.1234 a 1011 n 16/16"
    found = readings.result(line)
    assert isinstance(found, Reading)
    assert (found.distance_mm, found.u_mm, found.r_mm) == pytest.approx((800.1234, 0.4372, 0.0035))


def test_faults_have_a_name_and_figures() -> None:
    line = "f too dim: 35.2 counts, needs 60.1"
    fault = Fault(name="too dim", detail="35.2 counts, needs 60.1", line=line)
    assert readings.result(line) == fault
    assert readings.result("f laser off") == Fault(name="laser off", line="f laser off")
    stamped = f"# 7 @ 8 {line}"
    assert readings.result(stamped) == replace(fault, counter=7, time_us=8, line=stamped)
    assert readings.frame_result([line]) is None
    advised = replace(fault, advice="more laser power")
    assert readings.frame_result([line, "(more laser power)"]) == advised
    assert str(advised) == f"{line} (more laser power)"


@pytest.mark.parametrize(
    "line",
    [
        "",
        "stream on",
        "E3 out of range, expected rows 1..64",
        "flat none",
        "d",
        "d 800.1234",
        "d 800.1234 mm",
        LINE.replace("800.1234", "800"),
        LINE.replace("800.1234", "8.00.1234"),
        LINE.replace("800.1234", "nan"),
        LINE.replace("mm", "m"),
        LINE.replace("u 0.4372 ", ""),
        LINE.replace(" 0.4372", ""),
        LINE.replace("16/16", "16"),
        LINE.replace("1011", "10.11"),
        f"# {LINE}",
        f"# x @ 5 {LINE}",
        "# 5 @ 6",
        f"{LINE} t",
        f"{LINE} t 1 2",
        f"{LINE} m x",
        "f",
        "f ",
        "f 35.2",
        "f TOO DIM: 35.2",
        "\N{REPLACEMENT CHARACTER}",
    ],
)
def test_other_and_spoilt_lines_are_no_result(line: str) -> None:
    assert readings.result(line) is None


CENTRE = (
    "x 1770.98771 u 0.00195 a 1993 n 15/16 b 300 e t w 7.62131 o 0.00012 -0.00310 0.01203 0.00010 -0.00020"
)


def test_a_centre_has_all_that_its_line_says() -> None:
    centre = Centre(
        centre_px=1770.98771,
        u_px=0.00195,
        height=1993,
        rows_used=15,
        rows=16,
        black_level=300,
        estimator="t",
        width_px=7.62131,
        asymmetry_px=(0.00012, -0.0031, 0.01203, 0.0001, -0.0002),
        line=CENTRE,
    )
    assert readings.centre([CENTRE]) == centre
    line = f"{CENTRE} t 187 m 3 c 2"
    flagged = replace(centre, exposure_us=187, misfits=3, independent_rows=2, line=line)
    assert readings.centre([line]) == flagged
    line = CENTRE.replace("7.62131", "0.00000")
    assert readings.centre([line]) == replace(centre, width_px=None, asymmetry_px=None, line=line)
    assert readings.centre([LINE]) is None
    assert readings.centre([CENTRE.replace("300", "3x0")]) is None


def test_the_centre_of_a_comb_has_a_second_line() -> None:
    line = f"{CENTRE} k 3"
    slits = "slits - 912.12345/1830 2912.00001/7"
    assert readings.centre([line]) is None
    found = readings.centre([line, slits])
    assert isinstance(found, Centre)
    assert found.slits == 3
    assert found.images == (None, (912.12345, 1830), (2912.00001, 7))
    assert readings.centre([slits]) is None
    assert readings.centre([line, slits.replace("/7", "")]) is None


ROW = [
    "row pixels 3648 first 1780 count 3 exposure 187 black 300.00 saturated 4095",
    "x 1800.25046 u 0.01379 a 2046 n 1/1 b 300 e a w 8.00641 o -0.00005 -0.00272 -0.00031 0.00012 0.00001",
]


def row_lines(head: list[str], pixels: list[str]) -> list[str]:
    """The lines of the answer to `row`, with their checksums."""
    check = f"row check {readings.crc16(chr(10).join(head)):04x}"
    return [*head, check, *(f"{line} {readings.crc16(line):04x}" for line in pixels)]


def test_the_checksum_is_that_of_the_catalogue() -> None:
    # https://reveng.sourceforge.io/crc-catalogue/16.htm#crc.cat.crc-16-ibm-3740
    assert readings.crc16("123456789") == 0x29B1
    # A line of docs/serial-line.md.
    line = "row 1812 3d635b2f429a24f2091d71ae18817015f15214213d139130130130"
    assert readings.crc16(line) == 0x5C3B


def test_a_row_is_complete_with_its_last_pixel() -> None:
    lines = row_lines(ROW, ["row 1780 12c", "row 1781 12d12e"])
    for count in range(1, len(lines)):
        assert readings.row(lines[:count]) is None
    # The end of another answer, and a line of that answer, change nothing.
    found = readings.row(["row end", *lines])
    assert isinstance(found, readings.Row)
    assert list(found.counts) == [300, 301, 302]
    assert (found.pixels, found.first, found.exposure_us, found.saturation) == (3648, 1780, 187, 4095)
    assert found.black_level == 300
    assert found.centre == readings.centre([ROW[1]])


def test_a_row_without_a_spot_has_a_fault() -> None:
    head = [
        "row pixels 3648 first 0 count 0 exposure 0 black - saturated 4095",
        "f no spot: 9.5 counts at most",
        "(check that the laser is on)",
    ]
    found = readings.row(row_lines(head, []))
    assert isinstance(found, readings.Row)
    assert len(found.counts) == 0
    assert (found.black_level, found.exposure_us) == (None, 0)
    assert isinstance(found.centre, Fault)
    assert found.centre.advice == "check that the laser is on"


def test_no_spoilt_row_is_taken() -> None:
    lines = row_lines(ROW, ["row 1780 12c", "row 1781 12d12e"])
    text = "\n".join([*lines, "row end"])
    spoilt = [text[:at] + text[at + 1 :] for at in range(len(text) - len("row end"))]
    spoilt += [
        text[:at] + "7" + text[at + 1 :] for at in range(len(text) - len("row end")) if text[at] != "7"
    ]
    missing = ["\n".join([*lines[:at], *lines[at + 1 :], "row end"]) for at in range(len(lines))]
    for answer in spoilt + missing:
        assert readings.row(answer.split("\n")) in (None, readings.SPOILT), answer


def test_no_noise_on_the_line_raises() -> None:
    source = random.Random(1)
    lines = [
        LINE + " t 187 k 16 m 3 c 4 h 2 g s",
        f"# 1234 @ 12345678 {LINE}",
        "f too dim: 35.2 counts, needs 60.1",
        "(more laser power)",
        CENTRE + " k 3",
        "slits - 912.12345/1830 2912.00001/7",
        *row_lines(ROW, ["row 1780 12c", "row 1781 12d12e"]),
        "row end",
    ]
    results = 0
    for _ in range(20_000):
        before, spoilt = source.choices(lines, k=2)
        for _ in range(source.randint(1, 3)):
            at = source.randrange(len(spoilt) + 1)
            cut = source.randint(0, 2)
            spoilt = spoilt[:at] + source.choice(["", " ", "-", ".", "/", "7", "x", ":"]) + spoilt[at + cut :]
        results += readings.result(spoilt) is not None
        readings.frame_result([before, spoilt])
        readings.centre([before, spoilt])
        readings.row([*lines[6:], before, spoilt])
    # Some lines are readable all the same, and most are not.
    assert 500 < results < 10_000
