"""What the firmware's own code writes is read: lines of text, comma-separated values and packets.

host-tests/tests/packets.rs writes the file: numbers, and the lines and packets of results with these numbers.
`INSTA_UPDATE=always cargo test packets::python` writes it anew.
"""

import csv
import json
from dataclasses import replace
from decimal import ROUND_HALF_UP, Decimal
from pathlib import Path

import pytest

from slitrange import ESTIMATORS, FAULTS, Centre, Fault, Reading, Row, packets, readings

FILE = Path(__file__).parents[3] / "host-tests/tests/snapshots/main__packets__python.snap"
HEADERS, *TEXTS = FILE.read_text().split("---\n", 2)[2].strip().split("\n[")
SHORT_HEADER, LONG_HEADER = (header.split(",") for header in HEADERS.split("\n"))
UNITS = {"mm": 1.0, "um": 1e-3}


def rounded(number: float | Decimal, decimals: int) -> float:
    """Rounds as the firmware does: a half goes away from zero."""
    return float(Decimal(number).quantize(Decimal(1).scaleb(-decimals), ROUND_HALF_UP))


class Block:
    """Numbers and what is written of them."""

    def __init__(self, block: str) -> None:
        first, *lines = block.split("\n")
        numbers: list[int] = json.loads(f"[{first}")
        self.number, self.counter, self.time_us, self.exposure_us = numbers[:4]
        self.bits, self.counts = numbers[4:21], numbers[21:]
        self.is_odd = self.number % 2 > 0
        place = next(place for place, line in enumerate(lines) if line.startswith("row "))
        self.row = lines[place:]
        # Each result has two units, each as text and as comma-separated values, and a packet.
        self.results = [lines[at : at + 5] for at in range(0, place, 5)]

    def px(self, place: int, decimals: int) -> float:
        """A number in pixels."""
        return rounded(self.bits[place] / 65536, decimals)

    def mm(self, place: int, unit: str) -> float:
        """A distance, or an uncertainty from 9.99995 mm on: as in a line."""
        is_cut = place > 0 and self.bits[place] >= 2_559_987
        if unit == "um":
            return UNITS[unit] * rounded(self.bits[place] / 256, 0 if is_cut else 1)
        return rounded(Decimal(self.bits[place]) / 256_000, 2 if is_cut else 4)

    def reading(self, line: str, unit: str) -> Reading:
        """What the line of the reading says."""
        is_long = line.startswith("#")
        return Reading(
            distance_mm=self.mm(0, unit),
            u_mm=self.mm(1, unit),
            r_mm=self.mm(2, unit),
            centre_px=self.px(9, 4),
            height=int(rounded(self.bits[11] / 256, 0)),
            rows_used=self.counts[0],
            rows=self.counts[1],
            exposure_us=self.exposure_us or 5600,
            slits=self.number + 1,
            is_relative=self.is_odd,
            misfits=self.counts[2],
            independent_rows=self.counts[3] if self.is_odd else None,
            is_nominal=self.is_odd,
            has_other_settings=self.number % 4 > 1,
            held=self.counts[4],
            width_px=self.px(12, 5) if is_long else None,
            counter=self.counter if is_long else None,
            time_us=self.time_us if is_long else None,
            line=line,
        )

    def in_packet(self) -> Reading:
        """What the packet of the reading says, with all digits."""
        mm = [bits / 256 * 1e-3 for bits in self.bits]
        return replace(
            self.reading("", "mm"),
            distance_mm=mm[0],
            u_mm=mm[1],
            r_mm=mm[2],
            centre_px=self.bits[9] / 65536,
            held=0,
            width_px=self.bits[12] / 65536,
            counter=self.counter,
            time_us=self.time_us,
            parts=readings.UncertaintyParts(*mm[2:9]),
            black_level=self.bits[13] / 256,
            estimator=ESTIMATORS[self.number % 5],
        )

    def centre(self, line: str) -> Centre:
        """What the line of the row's centre says."""
        has_shape = self.px(10, 5) > 0
        image = (self.px(15, 5), self.counts[4])
        return Centre(
            centre_px=self.px(0, 5),
            u_px=self.px(1, 5),
            height=int(rounded(self.bits[2] / 256, 0)),
            rows_used=self.counts[0],
            rows=self.counts[1],
            black_level=int(rounded(self.bits[14] / 256, 0)),
            estimator="f",
            width_px=self.px(10, 5) if has_shape else None,
            asymmetry_px=tuple(self.px(place, 5) for place in range(4, 9)) if has_shape else None,
            slits=16 if self.is_odd else 1,
            misfits=self.counts[2],
            independent_rows=self.counts[3],
            images=(image,) * 16 if self.is_odd else (),
            line=line,
        )


each_block = pytest.mark.parametrize("block", [Block(text) for text in TEXTS], ids=lambda it: it.number)


def message(packet: str) -> packets.Message:
    """The message of a packet in hexadecimal."""
    (found,) = packets.Decoder().feed(bytes.fromhex(packet))
    return found


def cells(line: str, values: str) -> dict[str, str]:
    """The comma-separated values of the result of a line, by their names."""
    header = LONG_HEADER if line.startswith("#") else SHORT_HEADER
    return dict(zip(header, next(csv.reader([values])), strict=True))


@each_block
def test_readings_are_read(block: Block) -> None:
    *lines, packet = block.results[0]
    found = message(packet)
    assert isinstance(found, packets.Result)
    assert found.result == block.in_packet()
    for unit, line, values in zip(UNITS, lines[::2], lines[1::2], strict=True):
        read = readings.result(line)
        assert read == block.reading(line, unit)
        assert isinstance(read, Reading)
        cell = cells(line, values)
        for name, mm in (("distance", read.distance_mm), ("u", read.u_mm), ("r", read.r_mm)):
            assert UNITS[unit] * float(cell[name]) == mm
        assert float(cell["centre"]) == read.centre_px
        whole = {"height": read.height, "used": read.rows_used, "rows": read.rows, "slits": read.slits}
        whole |= {"m": read.misfits, "g": read.is_nominal, "z": read.is_relative, "h": read.held}
        assert {name: int(cell[name]) for name in whole} == whole


@each_block
def test_faults_are_read(block: Block) -> None:
    assert len(block.results[1:]) in (0, len(FAULTS))
    for name, (*lines, packet) in zip(FAULTS, block.results[1:], strict=False):
        found = message(packet)
        assert isinstance(found, packets.Result)
        for line, values in zip(lines[::2], lines[1::2], strict=True):
            read = readings.result(line)
            assert isinstance(read, Fault)
            assert read.name == cells(line, values)["fault"] == name
            stamp = (block.counter, block.time_us) if line.startswith("#") else (None, None)
            assert (read.counter, read.time_us) == stamp
            # The same length in the other unit.
            if name == "spike" and " um " in line:
                continue
            fault = replace(read, counter=block.counter, time_us=block.time_us)
            assert found.result == replace(fault, line=line[line.index("f ") :])


@each_block
def test_centres_are_read(block: Block) -> None:
    *lines, packet = block.row
    row = readings.row(lines)
    assert isinstance(row, Row)
    assert row.centre == block.centre(lines[1])
    assert (row.black_level, row.exposure_us) == (307, block.exposure_us or None)
    head = message(packet)
    assert isinstance(head, packets.RowHead)
    assert (head.number, head.time_us, head.exposure_us) == (block.counter, block.time_us, row.exposure_us)
    assert isinstance(head.centre, Centre)
    assert head.centre.shape_px == block.bits[16] / 65536
    digits = replace(
        head.centre,
        centre_px=rounded(head.centre.centre_px, 5),
        u_px=rounded(head.centre.u_px, 5),
        # A width that a line rounds to zero is none there.
        width_px=rounded(head.centre.width_px or 0, 5) or None,
        asymmetry_px=None,
        images=tuple(image and (rounded(image[0], 5), image[1]) for image in head.centre.images),
        shape_px=None,
        line=lines[1],
    )
    assert digits == replace(row.centre, asymmetry_px=None)
