"""Packets: the documented example, packets that are written here, and noise."""

import random
import re
import zlib
from pathlib import Path

import numpy as np
import pytest

from slitrange import FAULTS, Centre, Fault, Reading, packets
from slitrange.packets import Decoder, Message, Result, RowHead, Text, Window, Words

PAGE = Path(__file__).parents[3] / "docs" / "serial-line.md"


def documented() -> list[bytes]:
    """The bytes of the two packets on the page of the serial line, which the core's test writes."""
    example = PAGE.read_text().split("An example: the packet", 1)[1].split("`core/", 1)[0]
    blocks = re.findall(r"(?:^    (?:[0-9a-f]{2} ?)+\n)+", example, re.MULTILINE)
    return [bytes.fromhex(block) for block in blocks]


def stuffed(body: bytes) -> bytes:
    """A body by COBS."""
    written = b""
    for group in body.split(b"\0"):
        while len(group) >= 254:
            written += b"\xff" + group[:254]
            group = group[254:]
        written += bytes([len(group) + 1]) + group
    return written


def packet(sequence: int, message: bytes) -> bytes:
    """A packet with a message."""
    body = number(sequence) + message
    return b"\0" + stuffed(body + zlib.crc32(body).to_bytes(4, "little")) + b"\0"


def number(value: int) -> bytes:
    """An unsigned number by postcard."""
    low, rest = value & 0x7F, value >> 7
    return bytes([low | 0x80]) + number(rest) if rest else bytes([low])


def signed(value: int) -> bytes:
    """An i32 by postcard."""
    return number(2 * value if value >= 0 else -2 * value - 1)


def read(data: bytes) -> list[Message]:
    """The messages of bytes without noise."""
    decoder = Decoder()
    messages = list(decoder.feed(data))
    assert (decoder.damaged, decoder.lost, decoder.unknown) == (0, 0, 0)
    return messages


def test_the_documented_packets_are_read() -> None:
    text, result = read(b"".join(documented()))
    assert text == Text(b"rows 16\r\n")
    assert isinstance(result, Result)
    assert (result.counter, result.time_us) == (1234, 7_033_800)
    reading = result.result
    assert isinstance(reading, Reading)
    # In steps of 2^-8 um. The test of the core makes the distance from a number of 24 bits: 800123.375 um.
    assert reading.distance_mm == pytest.approx(800.123375, abs=1e-9)
    assert reading.u_mm == pytest.approx(0.4372, abs=2e-6)
    assert reading.r_mm == pytest.approx(0.0035, abs=2e-6)
    assert reading.parts is not None
    assert reading.parts.surface_mm == pytest.approx(0.437186, abs=2e-6)
    assert reading.parts.geometry_mm == 0
    assert (reading.centre_px, reading.width_px) == (1770.125, 9.0)
    assert (reading.height, reading.black_level, reading.exposure_us) == (1011, 300, 187)
    assert (reading.rows_used, reading.rows, reading.slits) == (16, 16, 1)
    assert (reading.estimator, reading.flags, reading.is_relative) == ("adaptive", "", False)
    assert (reading.counter, reading.time_us) == (1234, 7_033_800)


def test_packets_may_come_in_any_pieces() -> None:
    data = b"".join(documented())
    whole = read(data)
    for size in (1, 2, 7, 50):
        decoder = Decoder()
        pieces = [data[place : place + size] for place in range(0, len(data), size)]
        assert [message for piece in pieces for message in decoder.feed(piece)] == whole


@pytest.mark.parametrize("name", FAULTS)
def test_faults_have_the_words_of_their_lines(name: str) -> None:
    kinds, _ = packets.FIGURES.get(name, ("", ""))
    # 35.25 counts, 1770.5 px, 1234 um and 12 in turn.
    figures = {
        "c": signed(35 * 256 + 64),
        "x": signed(1770 * 65536 + 32768),
        "d": signed(1234 * 256),
        "n": number(12),
    }
    fault = bytes([FAULTS.index(name)]) + b"".join(figures[kind[0]] for kind in kinds.split())
    (result,) = read(packet(7, b"\x01" + number(5) + number(6) + b"\0\1" + fault))
    assert isinstance(result, Result)
    assert isinstance(result.result, Fault)
    assert result.result.name == name
    # The page of the serial line has an example of each fault.
    lines = re.findall(rf"^\| `(f {name}(?:: [^`]*)?)` \|", PAGE.read_text(), re.MULTILINE)
    shapes = [re.sub(r"\d+(\.\d+)?", "0", line) for line in (*lines, result.result.line)]
    assert shapes == [shapes[0]] * 2


def test_numbers_are_signed_and_of_any_length() -> None:
    for value in (0, 1, -1, 63, -64, 64, 2**31 - 1, -(2**31)):
        place = signed(value)
        fault = bytes([FAULTS.index("spot at the edge")]) + place
        (result,) = read(packet(0, b"\x01" + number(2**32 - 1) + number(2**64 - 1) + b"\0\1" + fault))
        assert isinstance(result, Result)
        assert isinstance(result.result, Fault)
        assert result.result.detail == f"x {packets.rounded(value / 65536, 1)}"
        assert (result.counter, result.time_us) == (2**32 - 1, 2**64 - 1)


def packed(numbers: list[int]) -> bytes:
    """Numbers of twelve bits, two in three bytes."""
    bits = sum(value << 12 * place for place, value in enumerate(numbers))
    data = bits.to_bytes((12 * len(numbers) + 7) // 8, "little")
    return number(len(data)) + data


@pytest.mark.parametrize("count", [0, 1, 2, 3, 255, 256])
def test_pixels_are_unpacked(count: int) -> None:
    numbers = [random.Random(count).randrange(4096) for _ in range(count)]
    (window,) = read(packet(0, b"\x02" + number(9) + number(1780) + packed(numbers)))
    assert isinstance(window, Window)
    assert (window.counter, window.first, window.counts.tolist()) == (9, 1780, numbers)
    assert window.counts.dtype == np.uint16


def row_head(row: int, words: int) -> bytes:
    """A row without a spot."""
    return b"\x03" + number(row) + number(4) + number(7) + b"\1" + number(5600) + number(words) + b"\1\0"


def test_rows_are_put_together_and_a_row_with_a_gap_is_left_out() -> None:
    words = [random.Random(1).randrange(4096) for _ in range(600)]
    parts = [
        b"\x04" + number(3) + number(first) + packed(words[first : first + 256]) for first in (0, 256, 512)
    ]
    messages = read(b"".join(packet(place, part) for place, part in enumerate([row_head(3, 600), *parts])))
    ((head, whole),) = packets.rows(messages)
    assert isinstance(head, RowHead)
    assert (head.number, head.skipped, head.exposure_us, head.words) == (3, 4, 5600, 600)
    assert isinstance(head.centre, Fault)
    assert whole.tolist() == words
    for lost in range(4):
        left = messages[:lost] + messages[lost + 1 :]
        assert list(packets.rows(left)) == []
        assert len(list(packets.rows(left + messages))) == 1
    assert isinstance(messages[3], Words)


def test_a_centre_of_a_comb_has_its_images() -> None:
    px = 65536
    frame = signed(1770 * px) + signed(131) + signed(2046 * 256) + b"\0" + signed(8 * px)
    frame += number(1) * 2 + number(0) + signed(13) * 5 + signed(1) + signed(8 * px) + signed(0)
    frame += b"\0" + signed(0) * 2
    rest = signed(300 * 256) + signed(0) + b"\2" + signed(0) + number(34) + signed(66)
    images = (b"\1" + signed(900 * px) + number(1830) + number(1)) + b"\0" * 15
    comb = b"\1" + signed(px // 2) + signed(0) + b"\1" + images
    head = b"\x03" + number(3) + number(0) + number(7) + b"\0" + number(0) + b"\0"
    (row,) = read(packet(0, head + frame + rest + comb))
    assert isinstance(row, RowHead)
    assert isinstance(row.centre, Centre)
    assert row.exposure_us is None
    centre = row.centre
    assert (centre.centre_px, centre.height, centre.black_level) == (1770.0, 2046, 300)
    assert (centre.width_px, centre.estimator, centre.slits) == (8.0, "a", 1)
    assert centre.images == ((900.0, 1830), *[None] * 15)


def test_damaged_packets_cost_no_other_packet() -> None:
    texts = [packet(place, b"\0" + bytes([5]) + b"line" + bytes([48 + place])) for place in range(3)]
    generator = random.Random(1)
    for _ in range(2000):
        data = bytearray(texts[1])
        place = generator.randrange(1, len(data) - 1)
        kind = generator.randrange(3)
        if kind == 0:
            data[place] ^= 1 << generator.randrange(8)
        elif kind == 1:
            del data[place]
        else:
            data.insert(place, generator.randrange(256))
        decoder = Decoder()
        messages = list(decoder.feed(texts[0] + bytes(data) + texts[2]))
        assert messages == [Text(b"line0"), Text(b"line2")]
        assert decoder.damaged in (1, 2)
        assert decoder.lost == 1


def test_messages_of_later_firmware_are_left_out() -> None:
    decoder = Decoder()
    known = b"\0\1x"
    data = packet(65535, known) + packet(0, b"\x05what") + packet(1, known + b"more") + packet(2, known)
    assert list(decoder.feed(data)) == [Text(b"x")] * 2
    assert (decoder.unknown, decoder.lost, decoder.damaged) == (2, 0, 0)
    # A fault that is not known has no figures.
    fault = b"\x01" + number(5) + number(6) + b"\0\1" + bytes([99]) + b"figures"
    (result,) = decoder.feed(packet(3, fault))
    assert isinstance(result, Result)
    assert isinstance(result.result, Fault)
    assert (result.result.name, result.result.detail) == ("fault 99", "")


def test_noise_without_an_end_takes_no_memory() -> None:
    decoder = Decoder()
    for _ in range(100):
        assert list(decoder.feed(b"\x55" * 1000)) == []
    assert list(decoder.feed(packet(0, b"\0\1x"))) == [Text(b"x")]
    assert decoder.damaged == 1
