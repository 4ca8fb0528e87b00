"""The examples run, and README shows them as they are."""

import importlib.util
import math
import re
import signal
import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

import slitrange
from slitrange import readings

PACKAGE = Path(__file__).parents[1]


def run(example: str, *arguments: str) -> str:
    """What an example prints."""
    command = [sys.executable, str(PACKAGE / "examples" / example), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def some_lines(example: str, port: str, count: int) -> list[str]:
    """The first lines of an example that goes on."""
    command = [sys.executable, str(PACKAGE / "examples" / example), port]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        lines = [process.stdout.readline().rstrip("\n") for _ in range(count)]
        process.send_signal(signal.SIGINT)
    return lines


def module(example: str) -> Any:
    """An example, to call what it has."""
    spec = importlib.util.spec_from_file_location("example", PACKAGE / "examples" / example)
    assert spec is not None
    assert spec.loader is not None
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


def blocks() -> list[str]:
    """The blocks of code and of output in README."""
    text = (PACKAGE / "README.md").read_text()
    return re.findall(r"```\w*\n(.*?)```", text, re.DOTALL)


def test_readme_shows_the_examples_and_what_they_print() -> None:
    for example in ("first_reading.py", "centres.py", "influx_lines.py"):
        code = (PACKAGE / "examples" / example).read_text().split('"""\n\n', 1)[1]
        assert code in blocks(), f"README does not show examples/{example} as it is"
    printed = run("centres.py")
    assert printed in blocks(), f"README does not show what examples/centres.py prints:\n{printed}"


def test_readme_names_all_that_the_package_has() -> None:
    text = (PACKAGE / "README.md").read_text()
    assert [name for name in slitrange.__all__ if f"`{name}" not in text] == []


def test_the_first_readings_are_printed(virtual_board: str) -> None:
    lines = run("first_reading.py", virtual_board).splitlines()
    print("\n".join(lines))
    assert len(lines) == 5
    # A head that was never calibrated has u of 17 mm, and the flag g. Flag c comes by chance, seldom.
    assert all(re.fullmatch(r"(799\.9|800\.0)\d+ mm, u 17\.\d+ mm, flags c?g", line) for line in lines)


READING = readings.result("d 800.1234 mm u 0.4372 r 0.0035 x 1770.1234 a 1011 n 16/16 m 3 g")
FAULT = readings.result("f too dim: 35.2 counts, needs 60.1")


def test_influx_gets_readings_and_faults(virtual_board: str) -> None:
    influx_line = module("influx_lines.py").influx_line
    assert influx_line(READING, 17) == 'slitrange distance_mm=800.1234,u_mm=0.4372,flags="mg" 17'
    assert influx_line(FAULT, 17) == 'slitrange fault="too dim" 17'
    lines = some_lines("influx_lines.py", virtual_board, 3)
    print("\n".join(lines))
    fields = r'distance_mm=(799\.9|800\.0)\d*,u_mm=17\.\d+,flags="c?g"'
    assert all(re.fullmatch(rf"slitrange {fields} \d{{19}}", line) for line in lines)


class Ros:
    """A stand-in for what the example uses of ROS 2. Somebody presses Ctrl-C after five messages."""

    def __init__(self) -> None:
        self.published: list[Any] = []
        self.topic: tuple[Any, ...] = ()

    def create_publisher(self, *topic: Any) -> Any:
        self.topic = topic
        return self

    def get_clock(self) -> Any:
        return SimpleNamespace(now=lambda: SimpleNamespace(to_msg=lambda: len(self.published)))

    def publish(self, message: Any) -> None:
        self.published.append(message)
        if len(self.published) == 5:
            raise KeyboardInterrupt


class Range:
    """As sensor_msgs/Range of ROS 2 Iron."""

    INFRARED = 1

    def __init__(self) -> None:
        self.header = SimpleNamespace(frame_id="", stamp=None)
        self.variance = 0.0


def test_ros_gets_readings_and_faults(virtual_board: str, monkeypatch: pytest.MonkeyPatch) -> None:
    ros = Ros()
    modules: dict[str, dict[str, Any]] = {
        "rclpy": {"init": lambda: None, "create_node": lambda name: ros},
        "sensor_msgs": {},
        "sensor_msgs.msg": {"Range": Range},
    }
    for name, parts in modules.items():
        stand_in = ModuleType(name)
        stand_in.__dict__.update(parts)
        monkeypatch.setitem(sys.modules, name, stand_in)
    example = module("ros_range.py")
    message = example.range_of(READING)
    assert message.range == pytest.approx(0.8001234)
    assert message.variance == pytest.approx(0.4372e-3**2)
    assert (message.min_range, message.max_range, message.radiation_type) == (0.60, 1.02, 1)
    fault = example.range_of(FAULT)
    assert math.isnan(fault.range)
    assert fault.variance == 0
    example.main(virtual_board)
    assert ros.topic == (Range, "range", 10)
    assert [message.header.stamp for message in ros.published] == [0, 1, 2, 3, 4]
    assert all(abs(message.range - 0.8) < 1e-4 for message in ros.published)
