"""The client with a sensor that is played by a test: noise, restarts, and nobody there."""

import os
import threading
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import pytest

import slitrange
from slitrange import Reading, line

READING = "d 800.1234 mm u 0.4372 r 0.0035 x 1770.1234 a 1011 n 16/16"
BANNER = "slitrange 0.1.0 NUCLEO-F429ZI TCD1304DG, started by watchdog"

COLUMNS = "distance u r centre height rows exposure flags"
END = b"the test is over"
SETTINGS = {"stream": "on", "plain": "off", "echo": "off", "output": COLUMNS, "rows": "16"}

LINE = {"format": "text", "bits": "8n1", "baud": "115200"}


@dataclass
class Played:
    """A sensor that knows a few settings. It sends readings only as answers, one for each `stream on`."""

    settings: dict[str, str] = field(default_factory=lambda: SETTINGS.copy())
    heard: list[str] = field(default_factory=list)
    special: Callable[[str], list[str] | None] = lambda _: None

    def answer(self, command: str) -> list[str]:
        """The lines that answer a command."""
        self.heard.append(command)
        special = self.special(command)
        if special is not None:
            return special
        name, _, value = command.partition(" ")
        if not command.isprintable():
            return ["E5 not ASCII text"]
        if name not in self.settings:
            return ["E1 unknown command, try help"]
        if value:
            self.settings[name] = value
        lines = [f"{name} {self.settings[name]}"]
        if self.settings.get("format") == "binary" and self.settings["plain"] == "off":
            lines = ["\0\xf0\x05\xffpacket" + lines[0]]
        return [*lines, READING] if command == "stream on" else lines


@contextmanager
def played(sensor: Played) -> Iterator[str]:
    """The port of a played sensor."""
    board, program = os.openpty()
    tty.setraw(program)

    def play() -> None:
        received = b""
        while END not in received:
            received += os.read(board, 100)
            *commands, received = received.split(b"\r")
            for command in commands:
                for text in sensor.answer(command.decode("latin-1")) if command else []:
                    os.write(board, text.encode("latin-1") + b"\r\n")

    thread = threading.Thread(target=play)
    thread.start()
    try:
        yield os.ttyname(program)
    finally:
        os.write(program, END)
        thread.join()
        os.close(board)
        os.close(program)


@pytest.fixture(autouse=True)
def _impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Shortens the wait of a test in which no answer comes."""
    monkeypatch.setattr(line, "ANSWER_S", 0.3)
    monkeypatch.setattr(line, "STATION_S", 0.002)


@pytest.mark.parametrize("sent", ["binary", "csv"])
def test_another_format_and_missing_columns_are_put_back(sent: str) -> None:
    sensor = Played({**SETTINGS, "format": sent, "output": "time u"})
    before = dict(sensor.settings)
    saved = []

    def special(command: str) -> list[str] | None:
        if command != "save":
            return None
        saved.append(dict(sensor.settings))
        return ["save"]

    sensor.special = special
    with played(sensor) as port, slitrange.open(port) as opened:
        assert (sensor.settings["format"], sensor.settings["plain"]) == (sent, "on")
        columns = "time u distance r centre height rows exposure flags"
        assert sensor.settings["output"] == columns
        assert isinstance(next(iter(opened)), Reading)
        with pytest.raises(slitrange.WrongUse, match="output must also have r centre"):
            opened.set("output", "distance u height rows exposure flags")
        opened.save()
        assert [it["output"] for it in saved] == ["time u"]
        assert sensor.settings["output"] == columns
        opened.set("output", f"{columns} width")
    assert sensor.settings == before
    with played(sensor) as port, slitrange.open(port) as opened:
        opened.set("output", f"{columns} width")
        opened.save()
        assert saved[1]["output"] == f"{columns} width"
    assert sensor.settings["output"] == f"{columns} width"


def test_a_sensor_that_misses_plain_on_is_asked_again() -> None:
    # A byte of the command is lost on its way. Until the sensor hears all of it, its answers come in packets.
    sensor = Played({**SETTINGS, "format": "binary"})

    def special(command: str) -> list[str] | None:
        is_missed = command == "plain on" and sensor.heard.count(command) == 1
        return ["\0\xf0\x05\xffpacketE1 unknown command, try help"] if is_missed else None

    sensor.special = special
    with played(sensor) as port, slitrange.open(port):
        assert sensor.settings["plain"] == "on"


def test_a_sensor_at_another_rate_is_found() -> None:
    sensor = Played(SETTINGS.copy())
    # It hears nothing before its own rate is tried.
    sensor.special = lambda _: [] if sensor.heard.count("plain on") < 5 else None
    with played(sensor) as port, slitrange.open(port) as opened:
        assert sensor.settings["plain"] == "on"
        assert isinstance(next(iter(opened)), Reading)
    assert sensor.settings == SETTINGS


@pytest.mark.parametrize("streamed", ["on", "off"])
@pytest.mark.parametrize("echoed", ["on", "off"])
def test_the_sensor_is_left_as_it_was_found(streamed: str, echoed: str) -> None:
    sensor = Played({**SETTINGS, "stream": streamed, "echo": echoed})
    before = dict(sensor.settings)
    with played(sensor) as port, slitrange.open(port) as opened:
        assert sensor.settings == {**SETTINGS, "stream": "off", "plain": "on"}
        assert isinstance(next(iter(opened)), Reading)
        opened.set("rows", 3)
        opened.set("rows", 4)
        assert sensor.settings["rows"] == "4"
    assert sensor.settings == before


def test_the_sensor_is_left_as_it_was_found_after_an_error() -> None:
    sensor = Played()
    before = dict(sensor.settings)

    def fail(port: str) -> None:
        with slitrange.open(port) as opened:
            opened.set("rows", 4)
            for _ in opened:
                raise ZeroDivisionError

    with played(sensor) as port, pytest.raises(ZeroDivisionError):
        fail(port)
    assert sensor.settings == before


def test_saved_settings_stay() -> None:
    sensor = Played(special=lambda it: ["save pauses the stream", "save"] if it == "save" else None)
    with played(sensor) as port, slitrange.open(port) as opened:
        opened.set("rows", 4)
        opened.save()
        opened.set("rows", 8)
    assert sensor.settings == {**SETTINGS, "rows": "4"}


def test_commands_are_sent_again_until_the_answer_is_readable() -> None:
    spoilt = iter([["rows"], ["E1 unknown command, try rows or help"], ["\xff\xfe", "rows 16"]])

    def special(command: str) -> list[str] | None:
        return next(spoilt, None) if command == "rows" else None

    with played(Played(special=special)) as port, slitrange.open(port) as opened:
        assert opened.get("rows") == "16"
    assert next(spoilt, None) is None


def test_spoilt_readings_are_counted() -> None:
    stream = ["d 800.1z34 mm", READING, "\xff\xff", READING[:30]]
    sensor = Played(special=lambda it: ["stream on", *stream, READING] if it == "stream on" else None)
    with played(sensor) as port, slitrange.open(port) as opened:
        readings = opened.readings()
        assert [str(next(readings)), str(next(readings))] == [READING, READING]
        assert opened.spoilt == 2
        sensor.special = lambda _: None


def test_a_restart_is_an_error_and_nothing_is_put_back() -> None:
    sensor = Played()

    def read(port: str) -> None:
        with slitrange.open(port) as opened:
            opened.set("rows", 4)
            sensor.special = lambda it: [BANNER] if it == "stream on" else None
            for _ in opened:
                pass

    with (
        played(sensor) as port,
        pytest.raises(slitrange.Restarted, match=r"started by watchdog.* open it again"),
    ):
        read(port)
    assert sensor.heard[-1] == "stream on"


def test_a_sensor_may_start_with_the_port() -> None:
    banner = iter([[BANNER]])
    with played(Played(special=lambda _: next(banner, None))) as port, slitrange.open(port) as opened:
        assert opened.get("rows") == "16"


def test_a_sensor_that_says_nothing_is_an_error() -> None:
    with (
        played(Played(special=lambda _: [])) as port,
        pytest.raises(
            slitrange.NoAnswer, match=r"nobody answers `plain` at .* check that this is the sensor's"
        ),
    ):
        slitrange.open(port)


@pytest.mark.parametrize("address", ["1", "5", "247"])
def test_a_sensor_with_an_address_is_found(address: str) -> None:
    def special(command: str) -> list[str]:
        return [f"@{address} address {address}"] if command == f"@{address} address" else []

    message = f"the address {address} answers at .* send it the line `@{address} address 0` .* open it again"
    with played(Played(special=special)) as port, pytest.raises(slitrange.NoAnswer, match=message):
        slitrange.open(port)


@pytest.mark.parametrize("station", [1, 17, 246])
def test_a_sensor_that_speaks_modbus_is_found(station: int) -> None:
    def special(command: str) -> list[str]:
        if command[:6].encode("latin-1") != bytes([station, 3, 0, 5, 0, 1]):
            return []
        answer = bytes([station, 3, 2, 0, station])
        return [(answer + line.modbus_crc(answer)).decode("latin-1")]

    message = f"speaks Modbus at .* as station {station}: .* write 0 to its holding register 4"
    with played(Played(special=special)) as port, pytest.raises(slitrange.NoAnswer, match=message):
        slitrange.open(port)


def test_a_frame_is_started_by_measure() -> None:
    sensor = Played({**SETTINGS, "trigger": "serial", "pixels": "none", **LINE})
    sensor.special = lambda it: [READING] if it == "measure" else None
    with played(sensor) as port, slitrange.open(port) as opened:
        assert str(opened.measure()) == READING
        sensor.special = lambda it: ["stream on"] if it == "stream on" else None
        for results in (opened.readings(timeout_s=0.1), opened.packets(timeout_s=0.1)):
            with pytest.raises(
                slitrange.NoAnswer, match=r"is serial, so no frame .*: start each by measure\(\)"
            ):
                next(results)
        sensor.special = lambda it: ["E24 frames start by themselves"] if it == "measure" else None
        with pytest.raises(
            slitrange.Refused, match=r"E24 .*: use read\(\), or set\(\"trigger\", \"serial\"\)"
        ):
            opened.measure()


def test_a_stream_that_ends_is_an_error() -> None:
    with played(Played()) as port, slitrange.open(port) as opened:
        readings = opened.readings(timeout_s=0.1)
        assert isinstance(next(readings), Reading)
        with pytest.raises(slitrange.NoAnswer, match=r"no reading came at .* for 0\.1 s"):
            next(readings)


def test_errors_of_a_port_say_what_to_do(tmp_path: os.PathLike[str]) -> None:
    with pytest.raises(slitrange.PortError, match=f"there is no serial port {tmp_path}/no"):
        slitrange.open(f"{tmp_path}/no")
    with pytest.raises(slitrange.PortError, match="cannot be opened as a serial port"):
        slitrange.open(os.fspath(tmp_path))


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("save", "x", "`save` is no setting but a command"),
        ("Calibration", "off", "`calibration` is no setting but a command"),
        ("", 1, "is no setting"),
        ("stream", True, "`stream` is set by this package"),
        ("plain", "on", "`plain` is set by this package"),
        ("Address", 5, "address 5 is not set here: this package talks to a sensor that is alone on its line"),
        ("address", "247", "address 247 is not set here"),
        ("format", "MODBUS", "format modbus is not set here"),
        ("rows", "", "there is no value for rows"),
        ("rows", "4\rsave", "is no text of ASCII in one line"),
        ("r\u00f6ws", 4, "is no text of ASCII"),
    ],
)
def test_what_is_no_setting_is_not_sent(name: str, value: str | int, message: str) -> None:
    sensor = Played()
    with played(sensor) as port, slitrange.open(port) as opened:
        heard = len(sensor.heard)
        with pytest.raises(slitrange.WrongUse, match=message):
            opened.set(name, value)
        if name in ("save", "stream"):
            with pytest.raises(slitrange.WrongUse, match=message):
                opened.get(name)
        assert len(sensor.heard) == heard


def test_a_closed_sensor_says_so() -> None:
    with played(Played()) as port:
        opened = slitrange.open(port)
        opened.close()
        opened.close()
        with pytest.raises(slitrange.WrongUse, match="the sensor is closed: open it again"):
            opened.get("rows")
        with pytest.raises(slitrange.WrongUse, match="the sensor is closed"):
            next(iter(opened))


def test_wrong_parts_of_a_row_are_refused() -> None:
    with played(Played()) as port, slitrange.open(port) as opened:
        with pytest.raises(slitrange.WrongUse, match="give both first and last"):
            opened.row(5)
        with pytest.raises(slitrange.WrongUse, match="first is 9 and last is 5"):
            opened.row(9, 5)
        with pytest.raises(slitrange.WrongUse, match="but not both"):
            opened.row(5, 9, window=True)
