"""The examples run, and README shows them as they are."""

import re
import subprocess
import sys
from pathlib import Path

import slitrange

PACKAGE = Path(__file__).parents[1]


def run(example: str, *arguments: str) -> str:
    """What an example prints."""
    command = [sys.executable, str(PACKAGE / "examples" / example), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def blocks() -> list[str]:
    """The blocks of code and of output in README."""
    text = (PACKAGE / "README.md").read_text()
    return re.findall(r"```\w*\n(.*?)```", text, re.DOTALL)


def test_readme_shows_the_examples_and_what_they_print() -> None:
    for example in ("first_reading.py", "centres.py"):
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
