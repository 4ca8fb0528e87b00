"""The serial line as lines: a command goes out, and its answer is told from the sensor's other lines.

Answers come in the order of the commands; lines of the stream may come in between. Noise can make a line
unreadable or lose it, so a command without an answer is sent again. Each command that `ask` sends may come
twice without harm.
"""

import re
import time
from collections.abc import Callable
from typing import TypeVar

import serial
from serial.tools import list_ports

from slitrange.errors import NoAnswer, PortError, Refused, Restarted

T = TypeVar("T")
Lines = list[str]

BAUD = 115200
BAUDS = (9600, 19200, 115200, 230400, 460800, 921600)
BITS = ("8n1", "8e1", "8n2")

TRIES = 4
"""How often a command is sent before nobody answers."""

LONGEST = 800
"""The longest line that is kept, in bytes: three times as long as any that a sensor sends."""

ANSWER_S = 2.0
"""How long to wait for the answer to a command: many times what a board takes."""

STATION_S = 0.02
"""How long a sensor with an address takes to answer at most."""

POLL_S = 0.05
"""How long a read waits for the first byte. Bytes that come end the wait at once."""

ERROR = re.compile(r"E\d+ ")
NOT_TEXT = "E5 "
STREAM = ("stream on", "stream off")

NOT_UNDERSTOOD = 7
"""Errors up to this number are about the words of a line, which noise may have changed."""


class Line:
    """A sensor's serial line, held for this program alone."""

    def __init__(self, port: str, baud: int) -> None:
        """Opens a port, unless another program has it open."""
        self.port = port
        # Whether the sensor is gone, or has forgotten what was set.
        self.is_lost = False
        self._received = b""
        try:
            self._serial = serial.Serial(port, baud, timeout=POLL_S, write_timeout=ANSWER_S, exclusive=True)
        except (serial.SerialException, ValueError, OSError) as error:
            raise PortError(_cannot_open(port, error)) from error

    def close(self) -> None:
        """Gives the port back."""
        self._serial.close()

    def ask(self, command: str, answer: Callable[[Lines], T | None], wait_s: float = ANSWER_S) -> T:
        """Sends a command until `answer` makes something of the lines that came since."""
        refused: Refused | None = None
        for attempt in range(TRIES):
            if attempt:
                self.synchronise()
            try:
                return self.ask_once(command, answer, wait_s)
            except NoAnswer:
                if attempt == TRIES - 1:
                    raise
            except Refused as error:
                # The same sentence twice is not by noise.
                is_repeated = refused is not None and refused.sentence == error.sentence
                if error.number > NOT_UNDERSTOOD or is_repeated or attempt == TRIES - 1:
                    raise
                refused = error
        raise AssertionError("the last attempt returns or raises")

    def ask_once(self, command: str, answer: Callable[[Lines], T | None], wait_s: float = ANSWER_S) -> T:
        """As `ask`, sent once: for what must not be done twice."""
        self.send(f"{command}\r".encode("ascii"))
        until = time.monotonic() + wait_s
        lines: Lines = []
        while (line := self.line(until)) is not None:
            # The answer to what `synchronise` sends. No command of this package is other than ASCII.
            if line.startswith(NOT_TEXT):
                continue
            if ERROR.match(line):
                raise Refused(command, line)
            lines.append(line)
            if (answered := answer(lines)) is not None:
                return answered
        raise self._no_answer(command, lines)

    def ask_at_once(self, command: str) -> Lines:
        """Sends a command that is answered at once. Returns all lines that came up to the end of its answer.

        Answers come in the order of the commands: the answer to a second one is the end of the first one's.
        """
        lines: Lines = []
        for attempt in range(TRIES):
            if attempt:
                self.synchronise()
            self.send(f"{command}\rstream\r".encode("ascii"))
            until = time.monotonic() + ANSWER_S
            lines = []
            while (line := self.line(until)) is not None and line not in STREAM:
                if not line.startswith(NOT_TEXT):
                    lines.append(line)
            if line is not None:
                for error in filter(ERROR.match, lines):
                    raise Refused(command, error)
                return lines
        raise self._no_answer(command, lines)

    def synchronise(self) -> bool:
        """Leaves behind whatever was sent before. Returns whether readings stream."""
        return self._question("stream", lambda line: (line == "stream on") if line in STREAM else None)

    def use_plain(self) -> bool:
        """Makes the sensor send lines of text at 115200 baud. Returns whether it did so before."""

        def is_plain(line: str) -> bool | None:
            # A packet holds the answer as text, with other bytes before it.
            found = re.search(r"plain (on|off)$", line)
            return None if found is None else found[1] == "on"

        try:
            before = self._question("plain", is_plain, 2)
            if not before:
                # Not by `ask`: after a lost byte it would wait for answers in text, and they come in packets.
                self._question("plain on", lambda line: True if line.endswith("plain on") else None)
        except NoAnswer:
            before = False
            # The slowest first: what a sensor still has to send at its own rate takes up to 0.9 s.
            for baud in BAUDS:
                for bits in BITS:
                    self.set_line(baud, bits)
                    self.send(b"\x15\rplain on\r")
                    time.sleep(POLL_S)
        self.set_line(BAUD)
        self._question("plain", lambda line: is_plain(line) or None)
        return before

    def _question(self, command: str, answer: Callable[[str], T | None], tries: int = TRIES) -> T:
        """Asks a question, whatever was sent before."""
        heard = None
        for _ in range(tries):
            # Ctrl-U is not text: a line that somebody left half typed, or that lost its end, is an error and
            # no command.
            self.send(f"\x15\r{command}\r".encode("ascii"))
            until = time.monotonic() + ANSWER_S
            while (line := self.line(until)) is not None:
                if (answered := answer(line)) is not None:
                    return answered
                heard = line
        last = "" if heard is None else f", where {heard!r} came last"
        raise NoAnswer(
            f"nobody answers `{command}` at {self.port}{last}: check that this is the sensor's port and "
            "that the sensor has power"
        )

    def station(self) -> str | None:
        """Looks for a sensor that shares its line, by an address or Modbus. Says how to talk to it.

        Only the end follows: reads wait less from here on.
        """
        heard = b""
        try:
            self._serial.timeout = STATION_S
            for number in range(1, 248):
                # Of Modbus: read the holding register 5, the address.
                request = bytes([number, 3, 0, 5, 0, 1])
                # The CR ends what a sensor without Modbus took for the start of a line.
                for question in (request + modbus_crc(request), f"\r@{number} address\r".encode("ascii")):
                    self.send(question)
                    heard += self._serial.read(LONGEST)
                # An adapter may keep bytes for a while, so this may be the answer to an earlier question.
                # The number in the answer tells whose it is.
                if found := re.search(rb"@(\d+) address \1\b", heard):
                    address = found[1].decode("ascii")
                    return (
                        f"a sensor with the address {address} answers at {self.port}, and this package talks "
                        f"to a sensor that is alone on its line: send it the line `@{address} address 0` "
                        "from a terminal, then open it again"
                    )
                for at in re.finditer(rb"(?=([\x01-\xf7]\x03\x02..)(..))", heard, re.DOTALL):
                    if modbus_crc(at[1]) == at[2]:
                        return (
                            f"a sensor speaks Modbus at {self.port} as station {at[1][0]}: read it by a "
                            "Modbus master, or let one write 0 to its holding register 4, for text, and open "
                            "it again"
                        )
        except (serial.SerialException, OSError) as error:
            raise self._gone(error) from error
        return None

    def send(self, data: bytes) -> None:
        """Sends bytes."""
        try:
            self._serial.write(data)
        except (serial.SerialException, OSError) as error:
            raise self._gone(error) from error

    def set_line(self, baud: int, bits: str = "8n1") -> None:
        """Changes the rate and the characters of the port."""
        try:
            self._serial.flush()
            self._serial.baudrate = baud
            self._serial.stopbits = int(bits[2])
            try:
                self._serial.parity = bits[1].upper()
            except Exception:
                # A pseudo-terminal has no parity: on Unix, that is termios.error.
                self._serial.parity = "N"
        except (serial.SerialException, OSError) as error:
            raise self._gone(error) from error

    def read(self) -> bytes:
        """The bytes that came, as they are. Waits a moment for the first one."""
        received, self._received = self._received, b""
        try:
            return received or self._serial.read(self._serial.in_waiting or 1)
        except (serial.SerialException, OSError) as error:
            raise self._gone(error) from error

    def line(self, until: float) -> str | None:
        """The next line that is not empty. None if none comes before `until`, by the monotonic clock.

        What has come is given even if the time is up.
        """
        while True:
            while (end := re.search(rb"[\r\n]", self._received)) is not None:
                line, self._received = self._received[: end.start()], self._received[end.end() :]
                if not line:
                    continue
                text = line.decode("ascii", errors="replace")
                if text.startswith("slitrange ") and ", started by " in text:
                    self.is_lost = True
                    raise Restarted(
                        f"the sensor started anew (`{text}`) and has only the settings that its flash holds: "
                        "open it again"
                    )
                return text
            if len(self._received) > LONGEST:
                self._received = b""
            try:
                came = self._serial.read(self._serial.in_waiting or 1)
            except (serial.SerialException, OSError) as error:
                raise self._gone(error) from error
            self._received += came
            if not came and time.monotonic() >= until:
                return None

    def _no_answer(self, command: str, lines: Lines) -> NoAnswer:
        if not lines:
            return NoAnswer(
                f"nobody answers `{command}` at {self.port}: check that this is the sensor's port and that "
                "the sensor has power"
            )
        return NoAnswer(
            f"`{command}` has no answer at {self.port}, where {lines[-1]!r} came last: check that this is "
            "the sensor's port, and that its firmware knows that command (`info`, `help`)"
        )

    def _gone(self, error: Exception) -> PortError:
        self.is_lost = True
        return PortError(f"{self.port} stopped working ({error}): check the cable")


def _cannot_open(port: str, error: Exception) -> str:
    """Why a port cannot be opened, and what to do."""
    number = getattr(error, "errno", None)
    if number == 11 or "exclusively lock" in str(error):
        return f"{port} is in use: end the program that has it open"
    if number == 2:
        ports = " ".join(sorted(it.device for it in list_ports.comports()))
        others = f"; there is {ports}" if ports else ", nor any other: check the cable"
        return f"there is no serial port {port}{others}"
    if number == 13:
        return (
            f"{port} may not be opened: on Linux, become a member of the group that owns it "
            f"(`ls -l {port}`), often dialout"
        )
    return f"{port} cannot be opened as a serial port: {error}"


def modbus_crc(data: bytes) -> bytes:
    """The CRC-16 of a Modbus request, as it is sent."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ 0xA001 * (crc & 1)
    return crc.to_bytes(2, "little")
