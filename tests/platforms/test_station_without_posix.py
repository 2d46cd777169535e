# SPDX-License-Identifier: GPL-3.0-or-later

"""A station works without what only POSIX has: no import on its path needs Linux or macOS.

It shows what Python on Windows lacks, and no more: consoles, rights of files and ports differ there in other ways too.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PARTS = ("keys", "station", "check", "init", "logs", "help", "module loaded", "commands", "panel", "module unloaded")
BLOCKED = "tests.platforms.without_posix"

pytestmark = pytest.mark.process


def run(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, *words], cwd=ROOT, capture_output=True, text=True, timeout=120, check=False)


@pytest.mark.parametrize("words", [("-m", BLOCKED), ()], ids=["without POSIX", "as it is"])
def test_commands_module_and_panel(words: tuple[str, ...]) -> None:
    ended = run(*words, "tests/platforms/station_alone.py")
    assert [line.split(": ")[1] for line in ended.stdout.splitlines()] == list(PARTS), ended.stderr
    assert ended.returncode == 0, ended.stderr


PLANTED = ("import fcntl", "import os; os.fork()", "import select; select.poll()", "import signal; signal.SIGHUP")
TRIES = """
import sys
sys.path.insert(0, {folder!r})
import gcs_module.panel.page, gcs_module.watch.page, gcs_module.window_watchdog
import gcs_module_planted
for use in gcs_module_planted.USES:
    try:
        use()
    except (ModuleNotFoundError, AttributeError) as error:
        print(type(error).__name__)
"""


def test_pages_and_windows_import_and_what_is_taken_away_is_missed(tmp_path: Path) -> None:
    """A planted use in one of our modules fails."""
    uses = "".join(f"def use_{number}():\n    {code}\n" for number, code in enumerate(PLANTED))
    listed = ", ".join(f"use_{number}" for number in range(len(PLANTED)))
    (tmp_path / "gcs_module_planted.py").write_text(f"{uses}USES = [{listed}]\n")
    program = tmp_path / "program.py"
    program.write_text(TRIES.format(folder=str(tmp_path)))
    ended = run("-m", BLOCKED, str(program))
    assert ended.stdout.splitlines() == ["ModuleNotFoundError", *["AttributeError"] * 3], ended.stderr
