"""Packets: what the sensor sends with `format binary`.

A packet is a sequence number and a message by postcard, and their CRC-32, written by COBS between two zeros.
docs/serial-line.md has the layout. `Decoder` reads packets from bytes, from any point of the stream on.
"""

import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from decimal import ROUND_HALF_UP, Decimal
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from slitrange.readings import LONGEST_EXPOSURE_US, Centre, Fault, Reading, UncertaintyParts
from slitrange.rows import ESTIMATORS, FAULTS

LONGEST = 450
"""More bytes than in any packet before the zero that ends it."""

SLITS = 16
"""The slits of a comb."""

COMPONENTS = 5
"""The shifts that describe how lopsided a spot is."""

UM = 2.0**-8
"""The unit of distances and of u in micrometres."""

PIXEL = 2.0**-16
"""The unit of centres and widths in pixels."""

COUNT = 2.0**-8
"""The unit of heights in counts."""


@dataclass(frozen=True)
class Text:
    """A part of the text of an answer: a line with its CR LF, or a part of a long one."""

    data: bytes


@dataclass(frozen=True)
class Result:
    """The result of a frame. The counter and the time are also in `result`."""

    counter: int
    time_us: int
    result: Reading | Fault


@dataclass(frozen=True)
class Window:
    """The pixels around the spot in a frame's last row.

    Attributes:
        counter: That of the frame's result.
        first: The place of the first pixel on the row.
        counts: The counts; more light makes more counts.
    """

    counter: int
    first: int
    counts: npt.NDArray[np.uint16]


@dataclass(frozen=True)
class RowHead:
    """A row, whose words follow in further messages.

    Attributes:
        number: Counts the rows that the sensor read since its start.
        skipped: Rows that it read since the row before in this stream, and did not send.
        time_us: When the row was in memory, since the sensor's start.
        exposure_us: For how long the laser was on. None if it was off, or if no row came.
        words: How many words follow.
        centre: What the sensor makes of this row alone.
    """

    number: int
    skipped: int
    time_us: int
    exposure_us: int | None
    words: int
    centre: Centre | Fault


@dataclass(frozen=True)
class Words:
    """Words of a row, as the converter gave them: `slitrange.TCD1304DG` says what they mean.

    Attributes:
        number: That of the row.
        first: The place of the first word in the read-out.
        words: The words.
    """

    number: int
    first: int
    words: npt.NDArray[np.uint16]


Message: TypeAlias = Text | Result | Window | RowHead | Words


class Decoder:
    """Reads packets from bytes, as they come.

    Attributes:
        damaged: Packets that were cut or had a wrong checksum.
        lost: Packets that are missing in the sequence, damaged ones among them.
        unknown: Packets with a right checksum that this package does not know: those of later firmware.
    """

    def __init__(self) -> None:
        """A decoder that has seen no byte."""
        self.damaged = 0
        self.lost = 0
        self.unknown = 0
        self._received = b""
        self._sequence: int | None = None

    def feed(self, data: bytes) -> Iterator[Message]:
        """Takes bytes, and yields the messages that they complete."""
        *packets, self._received = (self._received + data).split(b"\0")
        # Noise without an end is no packet. Its last bytes are enough to count it as damaged.
        self._received = self._received[-LONGEST:]
        for packet in filter(None, packets):
            body = _unstuffed(packet)
            if body is None or zlib.crc32(body[:-4]) != int.from_bytes(body[-4:], "little"):
                self.damaged += 1
                continue
            fields = _Fields(body[:-4])
            try:
                self._note(fields.unsigned())
                message = _message(fields)
            except (IndexError, ValueError):
                message = None
            if message is None:
                self.unknown += 1
            else:
                yield message

    def _note(self, sequence: int) -> None:
        """Counts the packets that are missing before the one with this number."""
        if self._sequence is not None:
            self.lost += (sequence - self._sequence - 1) % 2**16
        self._sequence = sequence


def _unstuffed(packet: bytes) -> bytes | None:
    """What COBS wrote as these bytes, which hold no zero. None if they are cut, or too few or many."""
    if len(packet) > LONGEST:
        return None
    body = bytearray()
    place = 0
    while place < len(packet):
        end = place + packet[place]
        if end > len(packet):
            return None
        body += packet[place + 1 : end]
        # A group of 254 bytes has no zero behind it, and neither has the last group.
        if packet[place] < 255 and end < len(packet):
            body.append(0)
        place = end
    return bytes(body) if len(body) > 4 else None


class _Fields:
    """The fields of a message, as postcard writes them. Each method fails if too few bytes are left."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._place = 0

    def byte(self) -> int:
        """A u8."""
        self._place += 1
        return self._data[self._place - 1]

    def flag(self) -> bool:
        """A bool."""
        return self.byte() != 0

    def unsigned(self) -> int:
        """A u16, u32 or u64."""
        value = 0
        for shift in range(0, 70, 7):
            byte = self.byte()
            value |= (byte & 0x7F) << shift
            if byte < 0x80:
                return value
        raise ValueError("a number is longer than any")

    def signed(self) -> int:
        """An i32."""
        value = self.unsigned()
        return value >> 1 if value % 2 == 0 else -(value >> 1) - 1

    def um(self) -> float:
        """A distance, in millimetres."""
        return self.signed() * UM * 1e-3

    def pixels(self) -> float:
        """A place or a width on the row."""
        return self.signed() * PIXEL

    def counts(self) -> float:
        """A height."""
        return self.signed() * COUNT

    def option(self) -> int | None:
        """An option of an unsigned number."""
        return self.unsigned() if self.flag() else None

    def packed(self) -> npt.NDArray[np.uint16]:
        """Bytes with packed numbers of twelve bits."""
        return unpacked(self.text())

    def text(self) -> bytes:
        """Bytes."""
        size = self.unsigned()
        data = self._data[self._place : self._place + size]
        if len(data) < size:
            raise IndexError("the bytes are cut")
        self._place += size
        return data

    def skip(self) -> None:
        """Leaves out what follows."""
        self._place = len(self._data)

    def is_at_the_end(self) -> bool:
        """Whether no byte is left."""
        return self._place == len(self._data)


def unpacked(data: bytes) -> npt.NDArray[np.uint16]:
    """The numbers of twelve bits that are packed in these bytes, two in three bytes."""
    # An odd number at the end has two bytes.
    missing = -len(data) % 3
    low, middle, high = np.frombuffer(data + bytes(missing), np.uint8).reshape(-1, 3).T.astype(np.uint16)
    pairs = np.stack((low | (middle & 0xF) << 8, middle >> 4 | high << 4), axis=1)
    numbers: npt.NDArray[np.uint16] = pairs.reshape(-1)
    return numbers[: len(numbers) - 1] if missing else numbers


def _message(fields: _Fields) -> Message | None:
    """Reads a message. None if it is one of later firmware."""
    readers: dict[int, Callable[[_Fields], Message]] = {
        0: lambda fields: Text(fields.text()),
        1: _result,
        2: lambda fields: Window(fields.unsigned(), fields.unsigned(), fields.packed()),
        3: _row_head,
        4: lambda fields: Words(fields.unsigned(), fields.unsigned(), fields.packed()),
    }
    reader = readers.get(fields.byte())
    message = None if reader is None else reader(fields)
    return message if fields.is_at_the_end() else None


def _result(fields: _Fields) -> Result:
    counter, time_us = fields.unsigned(), fields.unsigned()
    is_relative = fields.flag()
    if fields.byte() == 0:
        return Result(counter, time_us, _reading(fields, counter, time_us, is_relative))
    return Result(counter, time_us, _fault(fields, counter, time_us))


def _reading(fields: _Fields, counter: int, time_us: int, is_relative: bool) -> Reading:
    distance_mm, u_mm = fields.um(), fields.um()
    parts = UncertaintyParts(*(fields.um() for _ in range(7)))
    # The repeatability of the centre is not in a line either: r is the same in millimetres.
    centre_px, _ = fields.pixels(), fields.pixels()
    height, exposure_us, width_px = fields.counts(), fields.option(), fields.pixels()
    rows_used, rows, slits = fields.unsigned(), fields.unsigned(), fields.byte()
    black_level, estimator = fields.counts(), _estimator(fields.byte())
    misfits, independent_rows = fields.unsigned(), fields.option()
    is_nominal, has_other_settings = fields.flag(), fields.flag()
    return Reading(
        distance_mm=distance_mm,
        u_mm=u_mm,
        r_mm=parts.noise_mm,
        centre_px=centre_px,
        height=int(rounded(height)),
        rows_used=rows_used,
        rows=rows,
        exposure_us=LONGEST_EXPOSURE_US if exposure_us is None else exposure_us,
        slits=slits,
        is_relative=is_relative,
        misfits=misfits,
        independent_rows=independent_rows,
        is_nominal=is_nominal,
        has_other_settings=has_other_settings,
        width_px=width_px,
        counter=counter,
        time_us=time_us,
        parts=parts,
        black_level=black_level,
        estimator=estimator,
    )


def _estimator(number: int) -> str:
    """The name of an estimator. Later firmware may have more of them."""
    return ESTIMATORS[number] if number < len(ESTIMATORS) else f"estimator {number}"


FIGURES: dict[str, tuple[str, str]] = {
    "no spot": ("c1", "{} counts at most"),
    "too dim": ("c1 c1", "{} counts, needs {}"),
    "saturated": ("n", "{} pixels"),
    "spot at the edge": ("x1", "x {}"),
    "two spots": ("x1 x1", "x {} and {}"),
    "unsteady": ("x2", "rows scatter by {} px"),
    "out of range": ("x5", "x {}"),
    "not calibrated": ("x5 x5", "x {} u {}"),
    "too few slits": ("n n", "{}, needs {}"),
    "slits unclear": ("n n", "{} images fit one place, {} another"),
    "too dim at the longest exposure": ("c1 n", "{} counts in {} us"),
    "saturated at the shortest exposure": ("n n", "{} pixels in {} us"),
    "spike": ("d4", "{} mm from the last good reading"),
}
"""What follows the number of a fault (c: counts, x: pixels, d: millimetres, each with its decimals in a line;
n: a number), and the words of its line."""


def rounded(number: float | Decimal, decimals: int = 0) -> Decimal:
    """Rounds as the sensor does for a line: a half goes away from zero, and zero has no sign."""
    # Adding 0 takes the sign.
    return Decimal(number).quantize(Decimal(1).scaleb(-decimals), ROUND_HALF_UP) + 0


def _fault(fields: _Fields, counter: int | None, time_us: int) -> Fault:
    number = fields.byte()
    # Later firmware may have other faults, whose figures are not known.
    name = FAULTS[number] if number < len(FAULTS) else f"fault {number}"
    kinds, words = FIGURES.get(name, ("", ""))
    read: dict[str, Callable[[], float | Decimal]] = {
        "c": fields.counts,
        "x": fields.pixels,
        # Exact, because the sensor rounds a half away from zero.
        "d": lambda: Decimal(fields.signed()) / 256_000,
        "n": fields.unsigned,
    }
    detail = words.format(*(rounded(read[kind[0]](), int(kind[1:] or 0)) for kind in kinds.split()))
    if name not in FAULTS:
        fields.skip()
    line = f"f {name}: {detail}" if detail else f"f {name}"
    return Fault(name=name, detail=detail, counter=counter, time_us=time_us, line=line)


def _row_head(fields: _Fields) -> RowHead:
    number, skipped, time_us = fields.unsigned(), fields.unsigned(), fields.unsigned()
    exposure_us, words = fields.option(), fields.unsigned()
    found = _centre(fields) if fields.byte() == 0 else _fault(fields, None, time_us)
    return RowHead(number, skipped, time_us, exposure_us, words, found)


def _centre(fields: _Fields) -> Centre:
    """A centre has the fields of `Measured` in core/src/reading/mod.rs, in their order."""
    centre_px, u_px, height = fields.pixels(), fields.pixels(), fields.counts()
    exposure_us, _ = fields.option(), fields.pixels()
    rows_used, rows, misfits = fields.unsigned(), fields.unsigned(), fields.unsigned()
    asymmetry_px = tuple(fields.pixels() for _ in range(COMPONENTS))
    _, width_px, _ = fields.pixels(), fields.pixels(), fields.pixels()
    independent_rows, _, _ = fields.option(), fields.pixels(), fields.pixels()
    black_level, _, estimator = fields.counts(), fields.counts(), fields.byte()
    # How far the pixels differ is not in a line.
    shape_px, _, _ = fields.pixels(), fields.unsigned(), fields.counts()
    slits: int = 1
    images: list[tuple[float, int] | None] = []
    if fields.flag():
        # The shift is in the centre.
        _, _, slits = fields.pixels(), fields.pixels(), fields.byte()
        for _ in range(SLITS):
            images.append((fields.pixels(), fields.unsigned()) if fields.flag() else None)
            if images[-1] is not None:
                fields.unsigned()
    # A spot whose shape the sensor could not measure has the width 0.
    has_shape = width_px > 0
    return Centre(
        centre_px=centre_px,
        u_px=u_px,
        height=int(rounded(height)),
        rows_used=rows_used,
        rows=rows,
        black_level=int(rounded(black_level)),
        estimator=_estimator(estimator)[0],
        width_px=width_px if has_shape else None,
        asymmetry_px=asymmetry_px if has_shape else None,
        exposure_us=LONGEST_EXPOSURE_US if exposure_us is None else exposure_us,
        slits=slits,
        misfits=misfits,
        independent_rows=independent_rows,
        shape_px=shape_px,
        images=tuple(images),
    )


def rows(messages: Iterable[Message]) -> Iterator[tuple[RowHead, npt.NDArray[np.uint16]]]:
    """Puts rows together: each head with all its words. A row of which a packet is missing is left out."""
    head: RowHead | None = None
    words: list[npt.NDArray[np.uint16]] = []
    count = 0
    for message in messages:
        if isinstance(message, RowHead):
            head, words, count = message, [], 0
        elif isinstance(message, Words) and head is not None:
            if message.number != head.number or message.first != count:
                head = None
                continue
            words.append(message.words)
            count += len(message.words)
        else:
            continue
        if head is not None and count == head.words > 0:
            yield head, np.concatenate(words)
            head = None
