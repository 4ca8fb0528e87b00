"""What the sensor's lines say: readings, faults, centres and rows.

A line has words: a letter and what belongs to it. Later firmware may send letters that are not known here;
`unknown` has them.
"""

import binascii
import re
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

LONGEST_EXPOSURE_US = 5600
"""The exposure of a line that does not say one."""

DECIMAL = re.compile(r"-?\d+\.\d+")
LONG = re.compile(r"\d{5,}")
"""An uncertainty of 10 mm or more, in micrometres, which has no decimals."""
WHOLE = re.compile(r"-?\d+")
FAULT_NAME = re.compile(r"[a-z]+( [a-z]+)*")


@dataclass(frozen=True)
class UncertaintyParts:
    """The parts of u. docs/uncertainty.md explains them. u is the root of the sum of their squares."""

    noise_mm: float
    shape_mm: float
    pixels_mm: float
    calibration_mm: float
    surface_mm: float
    geometry_mm: float
    motion_mm: float


@dataclass(frozen=True, kw_only=True)
class Reading:
    """A distance with its uncertainty and how it came about.

    Attributes:
        distance_mm: The distance; of a moving target in the middle of the frame.
        u_mm: Its combined standard uncertainty (one sigma).
        r_mm: Its repeatability: the part of u that is the noise of the rows.
        centre_px: The spot's centre on the row in pixels.
        height: The spot's height in counts.
        rows_used: The rows in the mean.
        rows: The rows in the frame.
        exposure_us: The mean exposure of the rows used.
        slits: The slits used: 1 without a comb.
        is_relative: The distance is relative to `zero`.
        misfits: The rows used that do not look like a spot. The centre may be off by more than u says.
        independent_rows: If neighbouring rows have similar errors, how few independent rows they are worth.
        is_nominal: The sensor was never calibrated, so u holds the tolerances of its parts.
        has_other_settings: Estimator, black level or slits are not those of the calibration.
        held: With `hold`, after a fault: how many results ago this reading was measured. Otherwise 0.
        width_px: The spot's width (sigma), if the line has it.
        counter: The number of the reading, if the line has it.
        time_us: When the reading was made by the sensor's clock, if the line has it.
        parts: The parts of u, in a packet only.
        black_level: The counts of an unlit pixel, in a packet only.
        estimator: The name of the estimator, in a packet only.
        unknown: The words of the line that this package does not know.
        line: The line. Empty in a packet.
    """

    distance_mm: float
    u_mm: float
    r_mm: float
    centre_px: float
    height: int
    rows_used: int
    rows: int
    exposure_us: int = LONGEST_EXPOSURE_US
    slits: int = 1
    is_relative: bool = False
    misfits: int = 0
    independent_rows: int | None = None
    is_nominal: bool = False
    has_other_settings: bool = False
    held: int = 0
    width_px: float | None = None
    counter: int | None = None
    time_us: int | None = None
    parts: UncertaintyParts | None = None
    black_level: float | None = None
    estimator: str | None = None
    unknown: str = ""
    line: str = ""

    @property
    def flags(self) -> str:
        """The letters of the flags, which are reasons to doubt the reading. Empty without a flag."""
        flags = {
            "m": self.misfits > 0,
            "c": self.independent_rows is not None,
            "h": self.held > 0,
            "g": self.is_nominal,
            "s": self.has_other_settings,
        }
        return "".join(letter for letter, is_set in flags.items() if is_set)

    def __str__(self) -> str:
        """The line."""
        return self.line


@dataclass(frozen=True, kw_only=True)
class Fault:
    """Why a frame gave no distance.

    Attributes:
        name: What is wrong, as in `too dim`.
        detail: The figures, as in `35.2 counts, needs 60.1`. Empty without figures.
        advice: What to do about it. Empty if the sensor did not say it: lines of the stream do not.
        counter: The number of the frame, if the line has it.
        time_us: When the frame was made by the sensor's clock, if the line has it.
        line: The line.
    """

    name: str
    detail: str = ""
    advice: str = ""
    counter: int | None = None
    time_us: int | None = None
    line: str = ""

    def __str__(self) -> str:
        """The line, with the advice if there is one."""
        return f"{self.line} ({self.advice})" if self.advice else self.line


@dataclass(frozen=True, kw_only=True)
class Centre:
    """The centre of a frame, without a distance.

    Attributes:
        centre_px: The spot's centre in pixels. With a comb, that of a slit on the optical axis.
        u_px: Its repeatability: the noise of the rows.
        height: The spot's height in counts.
        rows_used: The rows in the mean.
        rows: The rows in the frame.
        black_level: The counts of an unlit pixel.
        estimator: The letter of the estimator.
        width_px: The spot's width (sigma). None if the sensor could not measure it.
        asymmetry_px: How lopsided the spot is, as five shifts in pixels. None if it could not be measured.
        exposure_us: The mean exposure of the rows used.
        slits: The slits used: 1 without a comb.
        misfits: The rows used that do not look like a spot.
        independent_rows: If neighbouring rows have similar errors, how few independent rows they are worth.
        shape_px: The part of the uncertainty by the spot's shape, in a packet only.
        images: With a comb, the centre in pixels and the height in counts of each slit's image, in the order
            of the slits. None for a slit without an image.
        unknown: The words of the line that this package does not know.
        line: The line.
    """

    centre_px: float
    u_px: float
    height: int
    rows_used: int
    rows: int
    black_level: int
    estimator: str
    width_px: float | None = None
    asymmetry_px: tuple[float, ...] | None = None
    exposure_us: int = LONGEST_EXPOSURE_US
    slits: int = 1
    misfits: int = 0
    independent_rows: int | None = None
    shape_px: float | None = None
    images: tuple[tuple[float, int] | None, ...] = ()
    unknown: str = ""
    line: str = ""


@dataclass(frozen=True, kw_only=True)
class Row:
    """A row as the sensor sees it.

    Attributes:
        pixels: The pixels of the whole row.
        first: The place of the first pixel that was sent.
        counts: The counts of the pixels from there on; more light makes more counts.
        exposure_us: For how long the laser was on; 0 if it was off, None if no row came.
        black_level: The mean of the shielded pixels in counts. None if there are none.
        saturation: The count from which a pixel is saturated.
        centre: What the sensor found on the row.
    """

    pixels: int
    first: int
    counts: npt.NDArray[np.uint16]
    exposure_us: int | None
    black_level: float | None
    saturation: int
    centre: Centre | Fault


class Words:
    """The words of a line: each letter with what belongs to it."""

    def __init__(self, text: str) -> None:
        """Parts a text. Words that begin with a letter are keys, but for the one that follows `e`."""
        self._values: dict[str, list[str]] = {}
        key = ""
        for word in text.split(" "):
            if word[:1].isalpha() and key != "e":
                key = word
                self._values[key] = []
            else:
                self._values.setdefault(key, []).append(word)
                key = "" if key == "e" else key

    def take(self, key: str) -> str | None:
        """The value of a key, which is then known. None if it is missing. Fails unless it is one word."""
        values = self._values.pop(key, None)
        if values is None:
            return None
        (value,) = values
        return value

    def has(self, key: str) -> bool:
        """Whether there is a key, which is then known."""
        return self._values.pop(key, None) is not None

    def take_all(self, key: str) -> list[str]:
        """The values of a key, which is then known."""
        return self._values.pop(key, [])

    def decimal(self, key: str) -> float:
        """A number with decimals. Fails if it is missing or is none."""
        return decimal(self.take(key) or "")

    def whole(self, key: str, default: int | None = None) -> int:
        """A whole number. Fails if it is none, or if it is missing without a default."""
        value = self.take(key)
        return default if value is None and default is not None else whole(value or "")

    def optional_decimal(self, key: str) -> float | None:
        """A number with decimals, or None."""
        value = self.take(key)
        return None if value is None else decimal(value)

    def optional_whole(self, key: str) -> int | None:
        """A whole number, or None."""
        value = self.take(key)
        return None if value is None else whole(value)

    def rest(self) -> str:
        """All that is not known so far."""
        return " ".join(" ".join([key, *values]).strip() for key, values in self._values.items())


def decimal(word: str) -> float:
    """Reads a number with decimals. Fails on any other word."""
    if DECIMAL.fullmatch(word) is None:
        raise ValueError(f"{word!r} is no number with decimals")
    return float(word)


def whole(word: str) -> int:
    """Reads a whole number. Fails on any other word."""
    if WHOLE.fullmatch(word) is None:
        raise ValueError(f"{word!r} is no whole number")
    return int(word)


def result(line: str) -> Reading | Fault | None:
    """The reading or the fault of a line. None for any other line, and for one that noise has spoilt."""
    try:
        words = line.split(" ")
        stamp: dict[str, int | None] = {"#": None, "@": None}
        while words[0] in stamp and len(words) > 2:
            stamp[words[0]] = whole(words[1])
            words = words[2:]
        text = " ".join(words)
        counter, time_us = stamp["#"], stamp["@"]
        if text.startswith("f "):
            name, _, detail = text[2:].partition(": ")
            # Later firmware may have other faults.
            if FAULT_NAME.fullmatch(name) is None:
                return None
            return Fault(name=name, detail=detail, counter=counter, time_us=time_us, line=line)
        if text[:2] in ("d ", "z "):
            return _reading(text, counter, time_us, line)
    except ValueError:
        pass
    return None


def _reading(text: str, counter: int | None, time_us: int | None, line: str) -> Reading:
    """Reads the line of a reading, without its stamp. Fails on any other line."""
    letter, distance, unit, rest = text.split(" ", 3)
    scale = {"mm": 1.0, "um": 1e-3}.get(unit)
    if scale is None:
        raise ValueError(f"{unit!r} is no unit")
    words = Words(rest)
    used, rows = (words.take("n") or "").split("/")
    return Reading(
        distance_mm=scale * decimal(distance),
        u_mm=scale * _uncertainty(words.take("u") or "", unit),
        r_mm=scale * _uncertainty(words.take("r") or "", unit),
        centre_px=words.decimal("x"),
        height=words.whole("a"),
        rows_used=whole(used),
        rows=whole(rows),
        exposure_us=words.whole("t", LONGEST_EXPOSURE_US),
        slits=words.whole("k", 1),
        is_relative=letter == "z",
        misfits=words.whole("m", 0),
        independent_rows=words.optional_whole("c"),
        is_nominal=words.has("g"),
        has_other_settings=words.has("s"),
        held=words.whole("h", 0),
        width_px=words.optional_decimal("w"),
        counter=counter,
        time_us=time_us,
        unknown=words.rest(),
        line=line,
    )


def _uncertainty(word: str, unit: str) -> float:
    """Reads an uncertainty. Fails on any other word."""
    return float(word) if unit == "um" and LONG.fullmatch(word) else decimal(word)


def advised(lines: list[str]) -> Fault | None:
    """The fault of lines whose last one is the advice, in brackets."""
    advice = re.fullmatch(r"\((.*)\)", lines[-1])
    if advice is None or len(lines) < 2:
        return None
    fault = result(lines[-2])
    if not isinstance(fault, Fault):
        return None
    return Fault(
        name=fault.name,
        detail=fault.detail,
        advice=advice[1],
        counter=fault.counter,
        time_us=fault.time_us,
        line=fault.line,
    )


def frame_result(lines: list[str]) -> Reading | Fault | None:
    """What the lines that came since a reading was asked for say, once they say it."""
    found = result(lines[-1])
    return found if isinstance(found, Reading) else advised(lines)


def centre(lines: list[str]) -> Centre | Fault | None:
    """What the lines that came since `centre` was asked say, once they say it."""
    last = lines[-1]
    try:
        if last.startswith("x "):
            found = _centre(last, ())
            # The line with the slits of a comb follows.
            return None if " k " in last else found
        if last.startswith("slits ") and len(lines) > 1 and lines[-2].startswith("x "):
            return _centre(lines[-2], tuple(_image(word) for word in last.split(" ")[1:]))
    except ValueError:
        return None
    return advised(lines)


def _image(word: str) -> tuple[float, int] | None:
    """The image of a slit: `912.12345/1830`, or `-` for none."""
    if word == "-":
        return None
    place, height = word.split("/")
    return decimal(place), whole(height)


def _centre(line: str, images: tuple[tuple[float, int] | None, ...]) -> Centre:
    """Reads the line of a centre. Fails on any other line."""
    words = Words(line)
    used, rows = (words.take("n") or "").split("/")
    # A width of zero: the sensor could not measure the shape.
    width = words.optional_decimal("w") or 0
    asymmetry = tuple(decimal(word) for word in words.take_all("o"))
    return Centre(
        centre_px=words.decimal("x"),
        u_px=words.decimal("u"),
        height=words.whole("a"),
        rows_used=whole(used),
        rows=whole(rows),
        black_level=words.whole("b"),
        estimator=words.take("e") or "",
        width_px=width if width > 0 else None,
        asymmetry_px=asymmetry if width > 0 else None,
        exposure_us=words.whole("t", LONGEST_EXPOSURE_US),
        slits=words.whole("k", 1),
        misfits=words.whole("m", 0),
        independent_rows=words.optional_whole("c"),
        images=images,
        unknown=words.rest(),
        line=line,
    )


SPOILT = "a checksum is wrong, or a line is missing"
"""What `row` says of an answer that came to its end and is not as it was sent."""

ROW_HEAD = re.compile(
    r"row pixels (\d+) first (\d+) count (\d+) exposure (\d+|-) black (\d+\.\d+|-) saturated (\d+).*"
)
ROW_CHECK = re.compile(r"row check ([0-9a-f]{4})")
ROW_PIXELS = re.compile(r"(row (\d+) ([0-9a-f]+)) ([0-9a-f]{4})")


def row(lines: list[str]) -> Row | str | None:
    """What the lines that came since `row` was asked say, once they are complete; or SPOILT.

    The answer is complete with its last pixel. `row end` may be the end of an answer before.
    """
    if lines[-1] == "row end" and any(line.startswith("row ") for line in lines[:-1]):
        return _row(lines[:-1]) or SPOILT
    return _row(lines)


def _row(lines: list[str]) -> Row | None:
    """Reads the answer to `row` without its last line. None if it is not whole, or a checksum is wrong."""
    heads = [at for at, line in enumerate(lines) if line.startswith("row pixels ")]
    checks = [at for at, line in enumerate(lines) if ROW_CHECK.fullmatch(line)]
    if not heads or not checks or checks[0] < heads[0]:
        return None
    head_lines = lines[heads[0] : checks[0]]
    head = ROW_HEAD.fullmatch(head_lines[0])
    check = ROW_CHECK.fullmatch(lines[checks[0]])
    if head is None or check is None or crc16("\n".join(head_lines)) != int(check[1], 16):
        return None
    pixels, first, count = int(head[1]), int(head[2]), int(head[3])
    counts: list[int] = []
    for line in lines[checks[0] + 1 :]:
        part = ROW_PIXELS.fullmatch(line)
        if part is None or crc16(part[1]) != int(part[4], 16) or int(part[2]) != first + len(counts):
            return None
        counts.extend(int(part[3][at : at + 3], 16) for at in range(0, len(part[3]), 3))
    found = centre(head_lines[1:])
    if len(counts) != count or found is None:
        return None
    return Row(
        pixels=pixels,
        first=first,
        counts=np.array(counts, dtype=np.uint16),
        exposure_us=None if head[4] == "-" else int(head[4]),
        black_level=None if head[5] == "-" else float(head[5]),
        saturation=int(head[6]),
        centre=found,
    )


def crc16(text: str) -> int:
    """The CRC-16 (IBM-3740) of a text."""
    return binascii.crc_hqx(text.encode("ascii", errors="replace"), 0xFFFF)
