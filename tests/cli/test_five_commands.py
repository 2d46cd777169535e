# SPDX-License-Identifier: GPL-3.0-or-later

"""The five commands of docs/missions.md, as they stand there, on a small plan and a KML."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "missions.md"
FILES = ("survey.plan", "stations.kml")


def commands() -> list[str]:
    text = PAGE.read_text(encoding="utf-8").partition("<!-- five:begin -->")[2].partition("<!-- five:end -->")[0]
    return re.sub(r"```", "", text).strip().splitlines()


def typed(lines: list[str], folder: Path, seconds: float) -> str:
    """What a shell shows in which these commands are typed, one after the other."""
    for name in FILES:
        shutil.copy(ROOT / "tests" / "data" / "init" / name, folder)
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    script = "\n".join(["set -e", *lines, "pwd"])
    done = subprocess.run(
        ["sh", "-c", script],
        cwd=folder,
        env=os.environ | {"PATH": path},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=seconds,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_the_page_has_five_commands_and_the_files_of_the_repository() -> None:
    assert len(commands()) == 5
    text = PAGE.read_text(encoding="utf-8")
    assert all(f"](../tests/data/init/{name})" in text for name in FILES)
    assert "survey.plan" in commands()[0]


@pytest.mark.process
def test_the_commands_before_the_flight_pass_without_a_question(tmp_path: Path) -> None:
    shown = typed(commands()[:4], tmp_path, 120)
    assert shown.count("check passed: 0 errors, 0 warnings") == 2
    folder = tmp_path / "survey"
    assert shown.splitlines()[-1] == str(folder)
    assert (folder / "map.png").read_bytes().startswith(b"\x89PNG")
    assert sorted(path.name for path in (folder / "keys").iterdir()) == ["Dike-house.key", "Farm.key", "ground.key"]


@pytest.mark.process
@pytest.mark.slow
def test_all_five_end_with_a_flight_as_the_check_says(tmp_path: Path) -> None:
    shown = typed(commands(), tmp_path, 600)
    assert "holds  commanders Farm → Dike-house → Farm: Farm → Dike-house → Farm" in shown
    assert "every expectation held" in shown
    (report,) = (tmp_path / "survey" / "runs").glob("*/report.html")
    assert report.stat().st_size > 10_000
