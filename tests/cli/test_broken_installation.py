# SPDX-License-Identifier: GPL-3.0-or-later

"""A package that is missing or broken ends a command with one sentence: what is wrong, and what to run.

A folder in front of all others shadows the package, as a broken installation would.
"""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest

from mavproxy_handover.supervision import must_load
from mavproxy_handover.tools.resources import shipped

pytestmark = pytest.mark.process

MISSING = 'raise ModuleNotFoundError("No module named {name!r}", name={name!r})\n'
#: as numpy says it: a page, of which the first line counts
BROKEN = 'raise ImportError("\\n\\nIMPORTANT: the C extensions of {name} failed.\\n\\nPlease read this page:\\n")\n'
NOT_AN_IMPORT_ERROR = 'raise OSError("lib{name}.so: cannot open shared object file")\n'
COMMANDS = {
    "companion": ["companion", "--config={folder}/vehicle.toml", "--master=udpin:127.0.0.1:17951"],
    "station": ["station", "--config={folder}/station.toml", "--master=udpin:127.0.0.1:17951"],
    "doctor": ["doctor", "companion", "--config={folder}/vehicle.toml", "--no-links"],
    "check": ["check", "{mission}"],
    "report": ["report", "{folder}"],
}
VEHICLE = """
[vehicle]
name = "drone-1"
sysid = 1
parent = "GCSA"
allow_unsigned = true
journal = "drone-1.jsonl"

[[station]]
name = "GCSA"
sysid = 251
links = ["udpin:127.0.0.1:17951"]

"""
STATION = '[station]\nname = "GCSA"\nsysid = 251\nvehicle = 1\n'


def run(folder: Path, words: list[str]) -> subprocess.CompletedProcess[str]:
    (folder / "vehicle.toml").write_text(VEHICLE)
    (folder / "station.toml").write_text(STATION)
    filled = [word.format(folder=folder, mission=shipped("missions") / "delivery") for word in words]
    return subprocess.run(
        [sys.executable, "-m", "mavproxy_handover.cli", *filled],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": f"{folder / 'shadows'}:{os.environ.get('PYTHONPATH', '')}"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def shadow(folder: Path, name: str, source: str) -> None:
    package = folder / "shadows" / name
    package.mkdir(parents=True)
    (package / "__init__.py").write_text(source.format(name=name))


@pytest.mark.parametrize("command", list(COMMANDS))
@pytest.mark.parametrize(
    ("name", "source", "says"),
    [
        ("shapely", MISSING, "shapely is not installed. Run: {pip} mavproxy-handover"),
        ("numpy", MISSING, "numpy is not installed. Run: {pip} mavproxy-handover"),
        ("pymavlink", MISSING, "pymavlink is not installed. Run: {pip} mavproxy-handover"),
        (
            "numpy",
            BROKEN,
            "numpy is broken (ImportError: IMPORTANT: the C extensions of numpy failed.). "
            "Run: {pip} --force-reinstall --no-cache-dir numpy",
        ),
        (
            "shapely",
            NOT_AN_IMPORT_ERROR,
            "shapely is broken (OSError: libshapely.so: cannot open shared object file). "
            "Run: {pip} --force-reinstall --no-cache-dir shapely",
        ),
    ],
    ids=["no shapely", "no numpy", "no pymavlink", "numpy broken", "shapely broken"],
)
def test_a_command_says_what_is_wrong_in_one_sentence(
    command: str, name: str, source: str, says: str, tmp_path: Path
) -> None:
    shadow(tmp_path, name, source)
    ended = run(tmp_path, COMMANDS[command])
    assert ended.returncode == 2, ended.stdout[-2000:] + ended.stderr[-2000:]
    lines = [line for line in ended.stderr.splitlines() if line.startswith(f"handover {command}: ")]
    expected = says.format(pip=f"{sys.executable} -m pip install")
    assert [line.removeprefix(f"handover {command}: ") for line in lines] == [expected] or lines == [
        f"handover {command}: module handover_gcs is not loaded: {expected}"
    ]
    assert "Traceback" not in ended.stderr + ended.stdout


@pytest.mark.parametrize(("command", "name"), [("companion", "handover"), ("station", "handover_gcs")])
def test_without_the_file_that_mavproxy_loads_it_ends_with_one_sentence(
    command: str, name: str, tmp_path: Path
) -> None:
    shadow(tmp_path, name, MISSING)
    ended = run(tmp_path, COMMANDS[command])
    assert ended.returncode == 2, ended.stdout[-2000:] + ended.stderr[-2000:]
    assert ended.stderr == (
        f"handover {command}: {name}.py, which MAVProxy loads, is not installed. Run: {sys.executable} -m pip install "
        "--force-reinstall --no-deps mavproxy-handover\n"
    )


@pytest.mark.parametrize(("command", "name"), [("companion", "handover"), ("station", "handover_gcs")])
def test_where_another_package_has_the_name_of_our_module_it_ends_with_one_sentence(
    command: str, name: str, tmp_path: Path
) -> None:
    shadow(tmp_path, name, "")
    ended = run(tmp_path, COMMANDS[command])
    assert ended.returncode == 2, ended.stdout[-2000:] + ended.stderr[-2000:]
    where = tmp_path / "shadows" / name / "__init__.py"
    assert ended.stderr == (
        f"handover {command}: {where} has the name of our module {name}, and MAVProxy would load it. Remove or rename "
        "it\n"
    )


def test_what_numpy_explains_is_told_and_not_its_page(monkeypatch: pytest.MonkeyPatch) -> None:
    cause = ImportError("libopenblas.so: cannot open shared object file")
    page = ImportError("\n\nIMPORTANT: PLEASE READ THIS FOR ADVICE\n")
    page.__cause__ = cause
    monkeypatch.setattr(must_load, "_numpys_own", lambda error: error)
    assert "(ImportError: libopenblas.so: cannot open shared object file)" in must_load.import_fault(page)


def test_a_station_without_wx_says_what_its_windows_need(tmp_path: Path) -> None:
    """It runs on, without them."""
    if importlib.util.find_spec("wx") is not None:
        pytest.skip("wxPython is installed here: a station without it was NOT tried")
    ended = run(tmp_path, [*COMMANDS["station"], "--", "--console", "--map"])
    assert "handover station: --console and --map: wxPython is not installed: the station runs without" in ended.stderr
    assert "Loaded module handover_gcs" in ended.stdout
    assert "Traceback" not in ended.stderr + ended.stdout


@pytest.mark.parametrize("name", ["shapely", "numpy", "pymavlink", "MAVProxy", "serial", "matplotlib"])
def test_help_needs_no_package(name: str, tmp_path: Path) -> None:
    shadow(tmp_path, name, MISSING)
    ended = run(tmp_path, ["--help"])
    assert (ended.returncode, ended.stderr) == (0, "")
    assert ended.stdout.startswith("usage: handover COMMAND")
