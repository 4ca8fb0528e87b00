"""A sensor at a serial port, which is left as it was found."""

import re
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import TracebackType
from typing import Literal, TypeVar, cast

from slitrange import packets, readings
from slitrange.errors import NoAnswer, Refused, Restarted, SlitrangeError, WrongUse
from slitrange.line import ANSWER_S, TRIES, Line, Lines
from slitrange.readings import Centre, Fault, Reading, Row

T = TypeVar("T")

CONTINUOUS = 24
"""The error of `measure` if frames start by themselves."""

FRAME_S = 5.0
"""How long to wait for a frame. One of 64 rows takes 0.4 s; an emulated board can be slower than a clock."""

AGAIN_S = 1.0
"""After so long without a packet, the command for packets is sent again."""

SAVE_S = 20.0
"""How long to wait for the flash to be written. A sector takes 1 s to erase."""

ROW_S = 20.0
"""How long to wait for a row, whose lines take 1.1 s."""

COMMANDS = {
    *("calibration", "centre", "defaults", "distance", "errors", "flat", "help", "info"),
    *("master", "measure", "reset", "row", "save", "selftest", "status", "uncertainty"),
    *("uptime", "zero"),
}
"""First words of commands. They are no settings, and some of them change the sensor."""


OWN_SETTINGS = ("stream", "echo", "plain")
"""Settings that this package needs for itself."""

COLUMNS = ("distance", "u", "r", "centre", "height", "rows", "exposure", "flags")
"""The columns of a line that a `Reading` needs."""


def open(port: str, baud: int = 115200) -> "Sensor":
    """Opens the sensor at a serial port, such as /dev/ttyACM0 or COM3.

    Args:
        port: The name of the port.
        baud: The rate of the line that is tried first. A sensor at another rate is found in some seconds.

    Raises:
        SlitrangeError: The port cannot be opened, or what answers there is no sensor.
    """
    return Sensor(port, baud)


class Sensor:
    """A sensor at a serial port, from `open`. Iterate over it for its readings.

    While it is open, the sensor sends readings only if the program takes them. At the end, `close` or `with`
    puts back what was found: the stream, the echo, and the settings that `set` changed.

    Attributes:
        spoilt: How many lines of the stream could not be read, by noise on the line.
    """

    def __init__(self, port: str, baud: int = 115200) -> None:
        """Opens the port and finds out whether a sensor answers there."""
        self.spoilt = 0
        self._line = Line(port, baud)
        self._waiting: deque[Reading | Fault] = deque()
        self._before: dict[str, str] = {}
        self._is_streaming = False
        self._trigger = "continuous"
        self._is_open = True
        # The settings before packets came, as long as they come.
        self._before_packets: dict[str, str] | None = None
        # What is put back at the end.
        self._streamed = False
        self._echoed = False
        self._was_plain = True
        self._output: str | None = None
        try:
            try:
                self._begin()
            except Restarted:
                # The sensor may have got its power with the port.
                self._line.is_lost = False
                self._begin()
        except BaseException:
            self._is_open = False
            self._line.close()
            raise

    def _begin(self) -> None:
        try:
            self._was_plain = self._line.use_plain()
        except NoAnswer as nobody:
            if found := self._line.station():
                raise NoAnswer(found) from nobody
            raise
        self._streamed = self._line.synchronise()
        self._echoed = self._value("echo") == "on"
        if self._echoed:
            # The echo of this line may be taken for its answer, which then still comes.
            self._ask_setting("echo", "off")
            self._line.synchronise()
        self._stream(False)
        output = self._value("output")
        if _missing(output):
            self._output = output
            self._add_columns()
        # Readings from before are not those of this program.
        self._waiting.clear()

    def _add_columns(self) -> None:
        """Adds the columns that a `Reading` needs to those that were found."""
        if self._output is not None:
            self._ask_setting("output", " ".join([self._output, *_missing(self._output)]))

    def _remove_columns(self) -> None:
        """Puts the columns back that were found."""
        if self._output is not None:
            self._ask_setting("output", self._output)

    def __enter__(self) -> "Sensor":
        """Returns the sensor."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Closes the sensor."""
        self.close()

    def close(self) -> None:
        """Puts back what was found, and gives the port back. Closing again does nothing."""
        if not self._is_open:
            return
        try:
            # A sensor that is gone or started anew has forgotten what was set.
            if not self._line.is_lost:
                self._put_back()
        finally:
            self._is_open = False
            self._line.close()

    def _put_back(self) -> None:
        self._end_packets()
        self._line.synchronise()
        self._stream(False)
        for name, value in reversed(self._before.items()):
            self._ask_setting(name, value)
        self._remove_columns()
        if self._streamed:
            self._stream(True)
        if self._echoed:
            self._ask_setting("echo", "on")
        if not self._was_plain:
            # The answer may be in a packet.
            self._line.ask("plain off", lambda lines: lines[-1].endswith("plain off") or None)

    def __iter__(self) -> Iterator[Reading | Fault]:
        """The readings and faults, one for each frame, as the sensor measures them."""
        return self.readings()

    def readings(self, timeout_s: float | None = FRAME_S) -> Iterator[Reading | Fault]:
        """The readings and faults, one for each frame, as the sensor measures them.

        While the sensor answers another command, it sends no readings.

        Args:
            timeout_s: How long to wait for a reading or fault, in seconds. None waits for ever.

        Raises:
            NoAnswer: Nothing came in this time.
            Restarted: The sensor started anew.
            PortError: The port stopped working.
        """
        try:
            while True:
                yield self._next_result(timeout_s)
        finally:
            self._waiting.clear()
            if self._is_open and not self._line.is_lost and self._is_streaming:
                # `close` tries again, and says if it fails.
                with suppress(SlitrangeError):
                    self._stream(False)

    def packets(
        self,
        pixels: Literal["none", "window", "rows"] = "none",
        baud: int = 115200,
        timeout_s: float = FRAME_S,
    ) -> Iterator[packets.Message]:
        """The messages of binary packets, as the sensor sends them: results, windows and whole rows.

        Packets hold more than lines do, in fewer bytes, and have checksums. Call no other method of the
        sensor meanwhile. At the end the sensor sends lines again, at the rate that it had. `spoilt` counts
        the damaged packets.

        Args:
            pixels: What is sent beside the results: `window`, the pixels around the spot of each frame's last
                row, or `rows`, whole rows in place of the results. See `slitrange.packets.rows`.
            baud: The rate of the line meanwhile: 115200, 230400, 460800 or 921600.
            timeout_s: How long to wait for a packet.

        Raises:
            NoAnswer: No packet came in this time.
            Refused: The sensor does not know this value of `pixels` or `baud`.
            PortError: The port stopped working.
        """
        self._check_open()
        self._stream(False)
        self._waiting.clear()
        # Answers come in packets later.
        self._trigger = self._value("trigger")
        # Text at first, because the answer to `plain off` is one.
        own = {"pixels": _text(pixels), "format": "text", "bits": "8n1", "baud": str(baud)}
        self._before_packets = {name: self._value(name) for name in own}
        decoder = packets.Decoder()
        try:
            for name, value in own.items():
                self._ask_setting(name, value)
            self._stream(True)
            self._ask_setting("plain", "off")
            self._line.set_line(baud)
            heard = asked = time.monotonic()
            self._ask_for_packets()
            has_come = False
            while True:
                for message in decoder.feed(self._line.read()):
                    has_come = True
                    heard = time.monotonic()
                    yield message
                now = time.monotonic()
                if now > heard + timeout_s:
                    raise self._silence("packet", timeout_s, "take a lower rate")
                if not has_come and now > asked + AGAIN_S:
                    asked = now
                    self._ask_for_packets()
        finally:
            self.spoilt += decoder.damaged
            if self._is_open and not self._line.is_lost:
                self._end_packets()

    def _ask_for_packets(self) -> None:
        # Above 115200 baud the sensor may lose a byte. Ctrl-U and the CR end a line that lost one.
        self._line.send(b"\x15\rformat binary\r")

    def _end_packets(self) -> None:
        """Makes the sensor send lines again."""
        if self._before_packets is None:
            return
        before, self._before_packets = self._before_packets, None
        self._line.use_plain()
        self._stream(False)
        self._waiting.clear()
        for name, value in before.items():
            self._ask_setting(name, value)

    def _next_result(self, timeout_s: float | None) -> Reading | Fault:
        """The next reading or fault of the stream."""
        self._check_open()
        if not self._is_streaming and not self._waiting:
            self._stream(True)
        until = None if timeout_s is None else time.monotonic() + timeout_s
        while not self._waiting:
            line = self._line.line(time.monotonic() + 1 if until is None else until)
            if line is not None:
                self._take(line)
            elif until is not None:
                with suppress(NoAnswer, Refused):
                    answer = self._line.ask_once("trigger", lambda lines: _value_of("trigger", lines[-1]))
                    self._trigger = answer
                raise self._silence("reading", timeout_s or 0, "wait longer by readings(timeout_s=...)")
        return self._waiting.popleft()

    def _silence(self, what: str, timeout_s: float, advice: str) -> NoAnswer:
        """Why no result came."""
        if self._trigger != "continuous":
            advice = (
                f"`trigger` is {self._trigger}, so no frame starts by itself: start each by measure(), or "
                'set("trigger", "continuous")'
            )
        else:
            advice = f"check the cable, or {advice}"
        return NoAnswer(f"no {what} came at {self._line.port} for {timeout_s} s: {advice}")

    def _take(self, line: str) -> None:
        """Takes a line, if it is one of the stream."""
        found = readings.result(line)
        if found is not None:
            self._waiting.append(found)
        elif re.match(r"[dzf#] ", line):
            self.spoilt += 1

    def _stream(self, on: bool) -> None:
        """Switches the stream on or off. Readings that come before the answer wait for their turn."""
        answer = f"stream {_word(on)}"

        def is_answered(lines: Lines) -> bool | None:
            if lines[-1] == answer:
                return True
            self._take(lines[-1])
            return None

        self._line.ask(answer, is_answered)
        self._is_streaming = on

    @contextmanager
    def _paused(self) -> Iterator[None]:
        """Pauses the stream, so that its lines are not taken for an answer."""
        self._check_open()
        was_streaming = self._is_streaming
        if was_streaming:
            self._stream(False)
        yield
        if was_streaming:
            self._stream(True)

    def _check_open(self) -> None:
        if not self._is_open:
            raise WrongUse("the sensor is closed: open it again")

    def _ask(self, command: str, answer: Callable[[Lines], T | None], wait_s: float = ANSWER_S) -> T:
        with self._paused():
            return self._line.ask(command, answer, wait_s)

    def get(self, name: str) -> str:
        """The value of a setting, as in `get("rows")`. docs/serial-line.md lists the settings.

        Raises:
            Refused: There is no such setting.
            NoAnswer: No answer came.
        """
        name = _setting(name)
        with self._paused():
            return self._value(name)

    def set(self, name: str, value: str | int | bool, *, keep: bool = False) -> str:
        """Sets a setting, as in `set("rows", 64)`. Returns the value that the sensor names.

        The sensor's memory loses the value with the power: see `save`.

        Args:
            name: The setting. docs/serial-line.md lists the settings and their values.
            value: The value. True is `on` and False is `off`.
            keep: Whether the sensor keeps the value when it is closed. Otherwise `close` puts the old one
                back.

        Raises:
            Refused: There is no such setting, or the value is wrong. Its sentence says what the sensor takes.
            NoAnswer: No answer came.
        """
        text = _text(_word(value) if isinstance(value, bool) else str(value))
        _check_alone(_text(name), text)
        name = _setting(name)
        if not text:
            raise WrongUse(f"there is no value for {name}: give one, or read it by get")
        if name == "output" and (missing := _missing(text)):
            raise WrongUse(f"output must also have {' '.join(missing)}: a Reading needs these columns")
        with self._paused():
            is_first = not keep and name not in self._before
            if is_first:
                before = self._output if name == "output" else None
                self._before[name] = before or self._value(name)
            try:
                found = self._ask_setting(name, text)
            except Refused:
                if is_first:
                    del self._before[name]
                raise
            if keep:
                self._before.pop(name, None)
            if name == "output":
                self._output = None
            return found

    def _value(self, name: str) -> str:
        return self._line.ask(name, lambda lines: _value_of(name, lines[-1]))

    def _ask_setting(self, name: str, value: str) -> str:
        return self._line.ask(f"{name} {value}", lambda lines: _value_of(name, lines[-1]))

    def read(self) -> Reading | Fault:
        """The reading of the next frame, or its fault with what to do about it.

        Raises:
            NoAnswer: No answer came.
        """
        # mypy takes the union for an object.
        return cast("Reading | Fault", self._ask("distance", readings.frame_result, FRAME_S))

    def measure(self) -> Reading | Fault:
        """Starts a frame, if `trigger` is `serial` or `pin`, and gives its result as the stream has it.

        Raises:
            Refused: `trigger` is `continuous`: frames start by themselves.
            NoAnswer: No result came.
        """
        with self._paused():
            try:
                return cast(
                    "Reading | Fault",
                    # Sent twice, it would start two frames.
                    self._line.ask_once("measure", lambda lines: readings.result(lines[-1]), FRAME_S),
                )
            except Refused as error:
                if error.number != CONTINUOUS:
                    raise
                advice = 'use read(), or set("trigger", "serial") before measure()'
                raise Refused("measure", error.sentence, advice) from None

    def centre(self) -> Centre | Fault:
        """The centre of the next frame and the spot's shape, without a distance; or a fault.

        Raises:
            NoAnswer: No answer came.
        """
        return cast("Centre | Fault", self._ask("centre", readings.centre, FRAME_S))

    def row(self, first: int | None = None, last: int | None = None, *, window: bool = False) -> Row:
        """One row as the sensor sees it: its pixels, and what the sensor makes of them.

        All lines of the answer have checksums. If one of them is wrong, the row is asked for again.

        Args:
            first: The first pixel to send. Without it, all pixels are sent.
            last: The last pixel to send.
            window: Send only the pixels around the spot. None if the row has a fault.

        Raises:
            NoAnswer: No answer came, or none with the right checksums.
        """
        command = "row"
        if window:
            if first is not None or last is not None:
                raise WrongUse("give first and last, or window, but not both")
            command = "row window"
        elif first is not None and last is not None:
            if not 0 <= first <= last <= 0xFFFF:
                raise WrongUse(f"first is {first} and last is {last}, but 0 <= first <= last <= 65535")
            command = f"row {first} {last}"
        elif first is not None or last is not None:
            raise WrongUse("give both first and last, or none of them")
        with self._paused():
            for _ in range(TRIES):
                found = self._line.ask(command, readings.row, ROW_S)
                if isinstance(found, Row):
                    return found
        raise NoAnswer(
            f"`{command}` had a wrong checksum {TRIES} times at {self._line.port}: check the cable"
        )

    def info(self) -> Lines:
        """The lines of the answer to `info`, without that word: what this sensor is."""
        return [line.removeprefix("info ") for line in self.lines("info") if line.startswith("info ")]

    def lines(self, command: str) -> Lines:
        """The lines of the answer to any command that is answered at once: `status`, `calibration`, `help`.

        Not for commands that wait for a frame or write to flash.

        Raises:
            Refused: The sensor answers with an error.
            NoAnswer: No answer came.
        """
        with self._paused():
            return self._line.ask_at_once(_text(command))

    def save(self) -> None:
        """Writes the settings in use and the calibration to flash. From then on, they are the sensor's own.

        `close` then puts none of the settings back that were set before.

        Raises:
            Refused: They could not be saved. The sentence says why.
            NoAnswer: No answer came.
        """
        with self._paused():
            # The columns that this package added are not the owner's.
            self._remove_columns()
            self._line.ask_once("save", lambda lines: True if lines[-1] == "save" else None, SAVE_S)
            self._before.clear()
            self._add_columns()


def _word(on: bool) -> str:
    return "on" if on else "off"


def _missing(output: str) -> Lines:
    """The columns that `output` lacks."""
    return [column for column in COLUMNS if column not in output.split(" ")]


def _text(text: str) -> str:
    """The words of a command, in lower case."""
    if not (text.isascii() and text.isprintable()):
        raise WrongUse(f"{text!r} is no text of ASCII in one line, so the sensor does not take it")
    return " ".join(text.lower().split())


def _setting(name: str) -> str:
    """The name of a setting that a program may see or change."""
    name = _text(name)
    first = name.split(" ")[0]
    if first in COMMANDS or not first:
        raise WrongUse(f"`{name}` is no setting but a command: use the method for it, or lines({name!r})")
    if first in OWN_SETTINGS:
        raise WrongUse(f"`{name}` is set by this package, and put back at the end")
    return name


def _check_alone(name: str, value: str) -> None:
    """Refuses a value with which the sensor would no longer answer this package."""
    has_address = name == "address" and value.strip("0") != ""
    if has_address or (name, value) == ("format", "modbus"):
        raise WrongUse(
            f"{name} {value} is not set here: this package talks to a sensor that is alone on its line: "
            "`address 0`, and not `format modbus`"
        )


def _value_of(name: str, line: str) -> str | None:
    """The value in the line that answers for a setting."""
    return line.removeprefix(f"{name} ") if line.startswith(f"{name} ") else None
