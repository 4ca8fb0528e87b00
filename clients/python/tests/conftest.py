"""The virtual board, for the tests that talk to a sensor."""

import os
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[3]


@pytest.fixture(scope="session")
def cargo_target() -> Path:
    """Where cargo puts what it builds."""
    return Path(os.environ.get("CARGO_TARGET_DIR", REPOSITORY / "target"))


@pytest.fixture(scope="session")
def virtual_board(cargo_target: Path) -> Iterator[str]:
    """The port of a virtual board with a target at 0.8 m. It runs for all tests of a session."""
    demo = cargo_target / "debug" / "demo"
    if not demo.exists():
        pytest.skip(
            f"the virtual board is not built: run `cargo run --bin demo -- --help` ({demo} is missing)"
        )
    command = [str(demo), "--pty", "--distance", "800"]
    with subprocess.Popen(command, cwd=REPOSITORY, stdout=subprocess.PIPE, text=True) as board:
        try:
            assert board.stdout is not None
            # The board builds its firmware first.
            line = board.stdout.readline()
            found = re.fullmatch(r"serial line: (.*)\n", line)
            assert found is not None, f"the virtual board says {line!r}"
            yield found[1]
        finally:
            board.terminate()
