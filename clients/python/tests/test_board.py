"""The client with the firmware on the virtual board, whose target is 0.8 m away."""

import os
import select
import time
import tty
from collections.abc import Iterator
from decimal import ROUND_HALF_UP, Decimal

import pytest

import slitrange
from slitrange import Centre, Fault, Geometry, Reading, Sensor, packets
from slitrange.line import modbus_crc

FLAGS = ("g", "cg")
"""The flags of a good frame: `g`, because the head was never calibrated, and by chance `c`. Of frames whose
rows are independent, 0.2 % have `c`."""


@pytest.fixture
def sensor(virtual_board: str) -> Iterator[Sensor]:
    """The virtual board's sensor."""
    with slitrange.open(virtual_board) as sensor:
        yield sensor


def raw_answer(port: str, command: bytes, until: bytes) -> bytes:
    """Sends a command without the client, and returns what comes up to some text."""
    line = os.open(port, os.O_RDWR | os.O_NOCTTY)
    try:
        tty.setraw(line)
        os.write(line, command)
        came = b""
        end = time.monotonic() + 30
        while until not in came and time.monotonic() < end:
            if select.select([line], [], [], 0.1)[0]:
                came += os.read(line, 1024)
        return came
    finally:
        os.close(line)


def five_decimals(number: float) -> float:
    """Rounds as the firmware's lines do: a half goes up, and 1/64 is written as 0.01563."""
    return float(Decimal(float(number)).quantize(Decimal("0.00001"), ROUND_HALF_UP))


def test_the_first_reading_is_that_of_the_target(virtual_board: str) -> None:
    with slitrange.open(virtual_board) as sensor:
        for reading in sensor:
            print(reading)
            assert isinstance(reading, Reading)
            # r is 1.6 um; nothing else is wrong with the distance in the simulation.
            assert reading.distance_mm == pytest.approx(800, abs=0.02)
            assert reading.rows == reading.rows_used == 16
            assert reading.flags in FLAGS
            assert reading.unknown == ""
            break


def test_readings_come_one_for_each_frame(sensor: Sensor) -> None:
    distances = []
    for reading in sensor:
        assert isinstance(reading, Reading)
        distances.append(reading.distance_mm)
        if len(distances) == 20:
            break
    # Frames have noise of their own.
    assert len(set(distances)) > 10
    assert sensor.spoilt == 0


def test_a_setting_is_set_and_put_back(virtual_board: str) -> None:
    with slitrange.open(virtual_board) as sensor:
        assert sensor.set("rows", 4) == "4"
        assert sensor.get("rows") == "4"
        reading = sensor.read()
        assert isinstance(reading, Reading)
        assert reading.rows == 4
        assert sensor.set("exposure limit", 1234) == "1234"
        assert sensor.get("exposure") == "auto"
    with slitrange.open(virtual_board) as sensor:
        assert (sensor.get("rows"), sensor.get("exposure limit")) == ("16", "5600")
        sensor.set("rows", 8, keep=True)
    with slitrange.open(virtual_board) as sensor:
        assert sensor.get("rows") == "8"
        sensor.set("rows", 16, keep=True)


def test_a_setting_can_be_set_between_readings(sensor: Sensor) -> None:
    rows = []
    for reading in sensor:
        assert isinstance(reading, Reading)
        rows.append(reading.rows)
        if len(rows) == 2:
            sensor.set("rows", 4)
        if reading.rows == 4:
            break
        assert len(rows) < 10
    assert rows[:2] == [16, 16]


def test_a_wrong_value_is_an_error_with_the_sensors_sentence(sensor: Sensor) -> None:
    with pytest.raises(slitrange.Refused) as refused:
        sensor.set("rows", 65)
    assert refused.value.number == 3
    assert refused.value.sentence == "E3 out of range, expected rows 1..64"
    assert str(refused.value) == f"the sensor answers `rows 65` with `{refused.value.sentence}`"
    with pytest.raises(slitrange.Refused, match="E1 unknown command"):
        sensor.get("colour")
    assert sensor.get("rows") == "16"


def test_a_fault_says_what_to_do(sensor: Sensor) -> None:
    sensor.set("laser", False)
    fault = sensor.read()
    assert isinstance(fault, Fault)
    assert (fault.name, fault.detail, fault.advice) == ("laser off", "", "send `laser on`")
    assert fault.name in slitrange.FAULTS
    for result in sensor:
        assert isinstance(result, Fault)
        assert result.name == "laser off"
        break
    centre = sensor.centre()
    assert isinstance(centre, Fault)


def test_a_centre_has_its_shape(sensor: Sensor) -> None:
    centre = sensor.centre()
    assert isinstance(centre, Centre)
    reading = sensor.read()
    assert isinstance(reading, Reading)
    # Two frames of the same target.
    assert centre.centre_px == pytest.approx(reading.centre_px, abs=6 * centre.u_px)
    assert centre.width_px == pytest.approx(8.6, abs=0.1)
    assert centre.estimator == "a"


@pytest.mark.parametrize("estimator", slitrange.ESTIMATORS)
def test_the_core_here_gives_the_bits_of_the_firmware(sensor: Sensor, estimator: str) -> None:
    sensor.set("estimator", estimator)
    row = sensor.row()
    assert len(row.counts) == row.pixels == 3648
    assert isinstance(row.centre, Centre)
    assert row.black_level is not None
    geometry = Geometry.of_pixels(row.pixels, saturation=row.saturation)
    found = slitrange.centres(row.counts, estimator, geometry, black_level=row.black_level)
    print(f"{estimator}: sensor {row.centre.centre_px} px, here {found.centre_px[0]:.5f} px")
    # The line has five decimals.
    assert row.centre.centre_px == five_decimals(found.centre_px[0])
    assert row.centre.u_px == five_decimals(found.r_px[0])
    assert row.centre.asymmetry_px == tuple(map(five_decimals, found.asymmetry_px[0]))


def test_a_row_can_be_a_part(sensor: Sensor) -> None:
    part = sensor.row(1700, 1839)
    assert (part.first, len(part.counts)) == (1700, 140)
    window = sensor.row(window=True)
    assert isinstance(window.centre, Centre)
    assert window.centre.width_px is not None
    # Six widths to both sides.
    assert len(window.counts) == pytest.approx(12 * window.centre.width_px, abs=2)


def test_info_says_what_the_sensor_is(sensor: Sensor) -> None:
    info = sensor.info()
    print("\n".join(info))
    assert "sensor head TCD1304DG" in info
    status = sensor.lines("status")
    assert "status rows lost 0" in status
    assert all(line.startswith("status ") for line in status)
    with pytest.raises(slitrange.Refused, match="E1 unknown command"):
        sensor.lines("frobnicate")


def test_the_sensor_is_left_as_it_was_found(virtual_board: str) -> None:
    assert b"stream off" in raw_answer(virtual_board, b"\x15\rstream off\r", b"stream off\r\n")
    with slitrange.open(virtual_board) as sensor:
        assert isinstance(next(iter(sensor)), Reading)
    assert b"stream off" in raw_answer(virtual_board, b"\x15\rstream\r", b"stream o")
    # With the echo on, and readings that stream.
    raw_answer(virtual_board, b"stream on\recho on\r", b"echo on\r\n")
    with slitrange.open(virtual_board) as sensor:
        assert sensor.get("rows") == "16"
        assert isinstance(sensor.read(), Reading)
    came = raw_answer(virtual_board, b"\x15\recho\r", b"\necho o")
    assert b"\necho on" in came + raw_answer(virtual_board, b"", b"n")
    raw_answer(virtual_board, b"echo off\r", b"echo off\r\n")
    assert b"stream on" in raw_answer(virtual_board, b"\x15\rstream\r", b"stream on\r\n")


def test_the_port_is_held_for_one_program(sensor: Sensor, virtual_board: str) -> None:
    with pytest.raises(slitrange.PortError, match="is in use: end the program that has it open"):
        slitrange.open(virtual_board)


def test_save_writes_the_settings(sensor: Sensor) -> None:
    sensor.save()
    assert sensor.get("rows") == "16"


def test_packets_hold_what_lines_hold(virtual_board: str) -> None:
    with slitrange.open(virtual_board) as sensor:
        line = sensor.read()
        assert isinstance(line, Reading)
        results, windows = [], []
        for message in sensor.packets("window", baud=921600):
            if isinstance(message, packets.Result):
                results.append(message)
            elif isinstance(message, packets.Window):
                windows.append(message)
            if len(windows) == 5:
                break
        for result, window in zip(results, windows, strict=True):
            assert result.counter == window.counter
            # Six widths of 8.6 px to both sides.
            assert len(window.counts) == pytest.approx(104, abs=4)
            reading = result.result
            assert isinstance(reading, Reading)
            assert reading.distance_mm == pytest.approx(line.distance_mm, abs=0.02)
            assert reading.u_mm == pytest.approx(line.u_mm, rel=0.01)
            assert (reading.rows, reading.estimator) == (16, "adaptive")
            assert reading.flags in FLAGS
            assert window.first < reading.centre_px < window.first + len(window.counts)
        # Readings come as lines again.
        assert isinstance(next(iter(sensor)), Reading)
    came = raw_answer(virtual_board, b"\x15\rplain\rpixels\rbaud\rstream\r", b"stream o")
    for found in (b"plain off\r\n", b"pixels none\r\n", b"baud 115200\r\n", b"stream on"):
        assert found in came


def test_whole_rows_have_the_centre_that_the_sensor_found(sensor: Sensor) -> None:
    found = []
    for head, words in packets.rows(sensor.packets("rows", baud=921600)):
        found.append((head, words))
        if len(found) == 3:
            break
    for head, words in found:
        assert len(words) == head.words == 3694
        assert isinstance(head.centre, Centre)
        here = slitrange.centres(words, geometry=slitrange.TCD1304DG)
        assert here.centre_px[0] == head.centre.centre_px
        assert (here.r_px[0], here.shape_px[0]) == (head.centre.u_px, head.centre.shape_px)


def test_measure_starts_a_frame(sensor: Sensor) -> None:
    with pytest.raises(slitrange.Refused, match=r"E24 frames start by themselves.*: use read\(\), or set"):
        sensor.measure()
    sensor.set("trigger", "serial")
    for _ in range(3):
        reading = sensor.measure()
        assert isinstance(reading, Reading)
        assert reading.distance_mm == pytest.approx(800, abs=0.02)
    with pytest.raises(slitrange.NoAnswer, match=r"`trigger` is serial, .* measure\(\), or set"):
        next(sensor.readings(timeout_s=0.5))


def test_um_are_read(sensor: Sensor) -> None:
    sensor.set("units", "um")
    reading = sensor.read()
    assert isinstance(reading, Reading)
    assert (reading.distance_mm, reading.u_mm) == pytest.approx((800, 17.13), abs=0.02)
    assert sensor.set("limits", "790 810.5 mm") == sensor.get("limits") == "790000 810500 um"


def test_a_sensor_that_is_not_alone_is_found(virtual_board: str) -> None:
    raw_answer(virtual_board, b"\x15\raddress 5\r", b"address 5\r\n")
    with pytest.raises(slitrange.NoAnswer, match=r"the address 5 answers .* the line `@5 address 0`"):
        slitrange.open(virtual_board)
    raw_answer(virtual_board, b"@5 format modbus\r", b"format modbus\r\n")
    with pytest.raises(slitrange.NoAnswer, match=r"speaks Modbus at .* as station 5: "):
        slitrange.open(virtual_board)
    # 0 to the holding register 4: text.
    request = bytes([5, 6, 0, 4, 0, 0])
    raw_answer(virtual_board, request + modbus_crc(request), request)
    assert b"@5 address 0" in raw_answer(virtual_board, b"\r@5 address 0\r", b"address 0\r\n")
    with slitrange.open(virtual_board) as sensor:
        assert isinstance(sensor.read(), Reading)
