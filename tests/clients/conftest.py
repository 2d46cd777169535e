# SPDX-License-Identifier: GPL-3.0-or-later

"""Where the programs are installed (`--clients FOLDER`, made by `install.py`), and the tables at the end of the run."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

_TABLES = pytest.StashKey[list[str]]()


def pytest_configure(config: pytest.Config) -> None:
    config.stash[_TABLES] = []


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    for line in config.stash.get(_TABLES, []):
        terminalreporter.write_line(line)


@pytest.fixture
def environments(request: pytest.FixtureRequest) -> Path:
    """The folder of the environments."""
    given = request.config.getoption("--clients")
    if given is None:
        pytest.skip("the programs are not installed: `make clients` installs each apart, and runs this")
    return Path(given).absolute()


@pytest.fixture
def tell(request: pytest.FixtureRequest) -> Callable[[list[str]], None]:
    """Shows lines at the end of the run."""
    return lambda lines: request.config.stash[_TABLES].extend(["", *lines])
