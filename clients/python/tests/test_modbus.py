"""The device's Modbus registers with stock masters, pymodbus and minimalmodbus, on a pseudo-terminal.

The other side is device/examples/modbus_server.rs on this PC, or the firmware on the virtual board.
"""

import os
import select
import subprocess
import tty
from collections.abc import Iterator
from pathlib import Path

import minimalmodbus  # type: ignore[import-untyped]
import pytest
from pymodbus.client import ModbusSerialClient

from slitrange import FAULTS, Reading, Sensor, readings

STATION = 17


class Server:
    """The example, with a pseudo-terminal as its serial line."""

    def __init__(self, program: Path) -> None:
        sensor, self.master = os.openpty()
        tty.setraw(self.master)
        self.port = os.ttyname(self.master)
        self.process = subprocess.Popen(
            [program], stdin=sensor, stdout=sensor, stderr=subprocess.PIPE, text=True
        )
        os.close(sensor)

    def line(self) -> str:
        """The next line of a result."""
        assert self.process.stderr is not None
        return self.process.stderr.readline().rstrip()

    def close(self) -> None:
        self.process.terminate()
        self.process.communicate()
        os.close(self.master)


@pytest.fixture
def server(cargo_target: Path) -> Iterator[Server]:
    program = cargo_target / "debug" / "examples" / "modbus_server"
    if not program.exists():
        pytest.skip(
            f"the Modbus server is not built: run `cargo test`, which builds it ({program} is missing)"
        )
    server = Server(program)
    yield server
    server.close()


@pytest.fixture
def master(server: Server) -> Iterator[ModbusSerialClient]:
    master = ModbusSerialClient(server.port, baudrate=115200, timeout=2)
    assert master.connect()
    yield master
    master.close()  # type: ignore[no-untyped-call]


def number(master: ModbusSerialClient, address: int, station: int = STATION) -> int:
    """The signed number in two input registers."""
    answer = master.read_input_registers(address, count=2, device_id=station)
    assert not answer.isError()
    value = master.convert_from_registers(answer.registers, master.DATATYPE.INT32)
    assert isinstance(value, int)
    return value


def test_a_reading_is_read(server: Server, master: ModbusSerialClient) -> None:
    line = server.line()
    reading = readings.result(line)
    print(line)
    assert isinstance(reading, Reading)
    answer = master.read_input_registers(0, count=16, device_id=STATION)
    print(answer.registers)
    assert len(answer.registers) == 16
    assert answer.registers[0] == 0
    # The flag `g`.
    assert answer.registers[1] == 0b0100
    assert number(master, 4) == round(reading.distance_mm * 1e4)
    # The line has only two decimals of a u from 10 mm on.
    assert number(master, 6) / 1e4 == pytest.approx(reading.u_mm, abs=0.006)
    assert number(master, 8) == round(reading.r_mm * 1e4)
    assert number(master, 10) == round(reading.centre_px * 1e4)
    assert answer.registers[12:] == [reading.height, reading.rows_used, reading.rows, 0]
    # One request for all registers, and four for pairs of them.
    assert number(master, 2) == 6
    # By function 3 too, as a float in mm.
    floats = master.read_holding_registers(1016, count=2, device_id=STATION).registers
    distance_mm = master.convert_from_registers(floats, master.DATATYPE.FLOAT32)
    assert distance_mm == pytest.approx(reading.distance_mm, abs=1e-4)


def test_minimalmodbus_reads_and_writes_too(server: Server) -> None:
    reading = readings.result(server.line())
    assert isinstance(reading, Reading)
    sensor = minimalmodbus.Instrument(server.port, STATION)
    assert sensor.serial is not None
    sensor.serial.baudrate = 115200
    sensor.serial.timeout = 2
    try:
        for offset, function in ((16, 4), (1016, 4), (1016, 3)):
            distance_mm = sensor.read_float(offset, functioncode=function)
            assert distance_mm == pytest.approx(reading.distance_mm, abs=1e-4)
        tenths = sensor.read_long(1004, functioncode=3, signed=True)
        assert tenths == round(reading.distance_mm * 1e4)
        # `average median 8` and `trigger pin`, `limits -1000 790000 500`.
        for offset, value in ((7, 208), (9, 2)):
            sensor.write_register(offset, value, functioncode=6)
            assert sensor.read_register(offset) == value
        limits = [1, 0xFFFF, 0xFC18, 0x000C, 0x0DF0, 0, 500]
        sensor.write_registers(11, limits)
        assert sensor.read_registers(11, 7) == limits
        with pytest.raises(minimalmodbus.IllegalRequestError):
            sensor.write_register(0, 65, functioncode=6)
    finally:
        sensor.serial.close()


def test_settings_are_written_and_read(server: Server, master: ModbusSerialClient) -> None:
    assert master.read_holding_registers(0, count=4, device_id=STATION).registers == [16, 0, 5600, 1]
    assert not master.write_register(0, 4, device_id=STATION).isError()
    assert not master.write_registers(1, [187, 1000], device_id=STATION).isError()
    assert master.read_holding_registers(0, count=4, device_id=STATION).registers == [4, 187, 1000, 1]
    assert master.read_input_registers(14, count=1, device_id=STATION).registers == [4]


def test_a_fault_has_no_distance(server: Server, master: ModbusSerialClient) -> None:
    assert not master.write_register(3, 0, device_id=STATION).isError()
    status = master.read_input_registers(0, count=1, device_id=STATION).registers[0]
    assert FAULTS[status - 1] == "laser off"
    assert number(master, 4) == -(2**31)


def test_what_cannot_be_done_is_an_exception(server: Server, master: ModbusSerialClient) -> None:
    exceptions = [
        master.write_register(0, 65, device_id=STATION),
        master.write_registers(0, [8, 9], device_id=STATION),
        master.write_register(18, 1, device_id=STATION),
        master.read_input_registers(0, count=25, device_id=STATION),
        master.read_coils(0, count=1, device_id=STATION),
    ]
    assert [it.exception_code for it in exceptions] == [3, 3, 2, 2, 1]
    assert master.read_holding_registers(0, count=4, device_id=STATION).registers == [16, 0, 5600, 1]


def test_garbage_changes_nothing(server: Server, master: ModbusSerialClient) -> None:
    for garbage in (b"\x11\x06\x00\x00\x00\x04\xff\xff", b"rows 4\r\n", bytes(range(256)), b"\x11"):
        assert master.send(garbage) == len(garbage)
        # The silence that ends a request, five times.
        server.process.poll()
        with pytest.raises(subprocess.TimeoutExpired):
            server.process.wait(0.1)
    assert master.read_holding_registers(0, count=4, device_id=STATION).registers == [16, 0, 5600, 1]


def test_the_firmware_speaks_modbus(virtual_board: str) -> None:
    with Sensor(virtual_board) as sensor:
        reading = sensor.read()
    assert isinstance(reading, Reading)
    line = os.open(virtual_board, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(line)
    os.write(line, b"stream off\rformat modbus\r")
    # Nothing comes after the answer.
    came = b""
    while b"format modbus\r\n" not in came:
        assert select.select([line], [], [], 30)[0], came
        came += os.read(line, 1024)
    # Without an address, the sensor is station 1.
    master = ModbusSerialClient(virtual_board, baudrate=115200, timeout=5)
    assert master.connect()
    try:
        answer = master.read_input_registers(0, count=16, device_id=1)
        print(answer.registers)
        assert answer.registers[:2] == [0, 0b0100]
        assert number(master, 4, 1) / 1e4 == pytest.approx(reading.distance_mm, abs=0.05)
        assert number(master, 6, 1) / 1e4 == pytest.approx(reading.u_mm, abs=0.02)
        assert not master.write_register(0, 4, device_id=1).isError()
        assert not master.write_registers(1, [0, 1000], device_id=1).isError()
        holdings = master.read_holding_registers(0, count=18, device_id=1).registers
        assert holdings == [4, 0, 1000, 1, 2, *[0] * 13]
        assert master.write_register(0, 65, device_id=1).exception_code == 3
        assert not master.write_registers(0, [16, 0, 5600], device_id=1).isError()
    finally:
        # The way back to text.
        assert not master.write_register(4, 0, device_id=1).isError()
        master.close()  # type: ignore[no-untyped-call]
        os.close(line)
    with Sensor(virtual_board) as sensor:
        again = sensor.read()
    assert isinstance(again, Reading)
    assert again.distance_mm == pytest.approx(reading.distance_mm, abs=0.05)
