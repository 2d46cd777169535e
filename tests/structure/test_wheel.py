# SPDX-License-Identifier: GPL-3.0-or-later

"""The wheel: everything a user needs is in it, and nothing lands outside our packages but what has to."""

from __future__ import annotations

import configparser
import csv
import importlib.util
import re
import shutil
import subprocess
import sys
import zipfile
from importlib import metadata
from pathlib import Path

import pytest

from mavproxy_handover.cli import COMMANDS

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("mavproxy_handover/", "gcs_module/")
#: written out: what is not in a package of ours has to be here, and must be small
TOP_LEVEL = {"handover.py", "handover_gcs.py", "handover_dialect.py", "handover_dialect.pth"}
DIALECT = "mavproxy_handover/data/dialect/handover.py"
NOT_COPIED = shutil.ignore_patterns(".git", ".venv", "runs", "build", "*.egg-info", ".*_cache", ".hypothesis", "tests")

pytestmark = [
    pytest.mark.process,
    pytest.mark.skipif(importlib.util.find_spec("setuptools") is None, reason="needs setuptools to build a wheel"),
]


@pytest.fixture(scope="module")
def wheels(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of both wheels. Built from a copy, so that nothing is left behind in the source."""
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    shutil.copytree(ROOT, source, ignore=NOT_COPIED)
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "-w", str(folder)]
    both = (str(source), str(source / "sitl"))
    done = subprocess.run([*command, *both], capture_output=True, text=True, check=False, timeout=200)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(scope="module")
def wheel(wheels: Path) -> zipfile.ZipFile:
    """Of the aircraft and the stations."""
    (path,) = wheels.glob("mavproxy_handover-*.whl")
    return zipfile.ZipFile(path)


@pytest.fixture(scope="module")
def sim_wheel(wheels: Path) -> zipfile.ZipFile:
    """Of the simulation."""
    (path,) = wheels.glob("mavproxy_handover_sim-*.whl")
    return zipfile.ZipFile(path)


@pytest.fixture(scope="module")
def names(wheel: zipfile.ZipFile) -> set[str]:
    return {name for name in wheel.namelist() if ".dist-info/" not in name}


def test_the_index_page_leads_somewhere(wheel: zipfile.ZipFile) -> None:
    (name,) = [name for name in wheel.namelist() if name.endswith(".dist-info/METADATA")]
    metadata, _blank, page = wheel.read(name).decode().partition("\n\n")
    assert "Description-Content-Type: text/markdown" in metadata
    links = re.findall(r"\]\(([^)\s]+)\)", page)
    assert len(links) > 20
    assert [link for link in links if not link.startswith("https://")] == []
    assert any(link.endswith("/raw/main/missions/delivery/map.png") for link in links)
    for link in links:
        if "/main/" in link:
            assert (ROOT / link.partition("/main/")[2].partition("#")[0]).exists(), link


def test_outside_our_packages_there_are_four_small_files(wheel: zipfile.ZipFile, names: set[str]) -> None:
    """Nothing lies in a folder of pymavlink or MAVProxy."""
    assert {name for name in names if not name.startswith(PACKAGES) and ".data/" not in name} == TOP_LEVEL
    assert all(wheel.getinfo(name).file_size < 2000 for name in TOP_LEVEL)


def test_the_installed_package_has_no_file_in_another_package() -> None:
    """What pip removes is what RECORD names."""
    record = metadata.distribution("mavproxy-handover").read_text("RECORD")
    assert record is not None
    files = {row[0] for row in csv.reader(record.splitlines())}
    assert len(files) > 300
    assert TOP_LEVEL | {DIALECT} <= files
    assert [name for name in files if name.startswith(("pymavlink", "MAVProxy"))] == []


def test_manual_pages_and_completion_go_where_man_and_shells_look(names: set[str]) -> None:
    pages = {f"share/man/man1/{name}.1" for name in ("handover", *(f"handover-{word}" for word in COMMANDS))}
    scripts = {
        "share/bash-completion/completions/handover",
        "share/zsh/site-functions/_handover",
        "share/fish/vendor_completions.d/handover.fish",
    }
    assert {name.partition(".data/data/")[2] for name in names if ".data/" in name} == pages | scripts
    assert {f"mavproxy_handover/data/completion/{Path(script).name}" for script in scripts} <= names


def test_a_module_for_mavproxy_only_names_the_real_one(wheel: zipfile.ZipFile) -> None:
    for name, module in (("handover", "mavproxy_handover.companion.module"), ("handover_gcs", "gcs_module.module")):
        lines = wheel.read(f"{name}.py").decode().splitlines()
        assert lines[-1] == f'init = starter("{name}", "{module}")'
        assert [line for line in lines if "import" in line] == [
            "from mavproxy_handover.supervision.must_load import starter"
        ]


def test_python_starts_with_one_line_of_ours(wheel: zipfile.ZipFile) -> None:
    assert wheel.read("handover_dialect.pth").decode() == "import handover_dialect\n"


def test_the_dialect_in_the_wheel_knows_our_messages(wheel: zipfile.ZipFile) -> None:
    text = wheel.read(DIALECT).decode()
    for line in ("MAVLINK_MSG_ID_CONNECT = 47100", "MAVLINK_MSG_ID_AUTHORITY_STATUS = 47113"):
        assert f"\n{line}\n" in text
    assert "\nMAVLINK_MSG_ID_CONTROL_STATUS = 512\n" in text
    assert "\nMAVLINK_MSG_ID_HEARTBEAT = 0\n" in text


def test_every_module_of_ours_is_in_it(names: set[str]) -> None:
    for package in ("mavproxy_handover", "gcs_module"):
        sources = {str(path.relative_to(ROOT)) for path in (ROOT / package).rglob("*.py")}
        assert len(sources) > 4
        assert sources <= names


def test_missions_guard_parameters_definitions_and_samples_are_in_it(names: set[str]) -> None:
    data = "mavproxy_handover/data/"
    wanted = {
        data + "missions/delivery/mission.toml",
        data + "missions/delivery/delivery.plan",
        data + "missions/delivery/zones.geojson",
        data + "missions/linear/mission.toml",
        data + "missions/corridor/mission.toml",
        data + "ardupilot_lua/handover_guard.lua",
        data + "ardupilot_lua/handover_guard.md",
        data + "ardupilot_lua/handover_guard_install.md",
        data + "ardupilot_lua/handover.parm",
        data + "ardupilot_lua/handover_plane.parm",
        "mavproxy_handover/wire/handover.xml",
        "mavproxy_handover/wire/operator_control.xml",
        "mavproxy_handover/deploy/install/companion.service",
        "mavproxy_handover/deploy/demo/handover.toml",
        "mavproxy_handover/deploy/top_level/handover.py",
    }
    assert wanted - names == set()


def test_the_simulation_is_a_wheel_of_its_own_and_not_on_an_aircraft(
    names: set[str], sim_wheel: zipfile.ZipFile
) -> None:
    assert [name for name in names if name.startswith("sitl")] == []
    packed = {name for name in sim_wheel.namelist() if ".dist-info/" not in name}
    wanted = {
        str(path.relative_to(ROOT))
        for pattern in ("*.py", "scenarios/*.toml", "run/*.c", "*.lua", "*.js", "*.css")
        for path in (ROOT / "sitl").rglob(pattern)
        if path != ROOT / "sitl" / "setup.py"
    }
    assert len(wanted) > 200
    assert packed == wanted


def test_the_simulation_needs_the_main_package_of_its_own_version(sim_wheel: zipfile.ZipFile) -> None:
    from mavproxy_handover.tools.version import VERSION

    (path,) = [name for name in sim_wheel.namelist() if name.endswith(".dist-info/METADATA")]
    lines = sim_wheel.read(path).decode().splitlines()
    assert f"Version: {VERSION}" in lines
    assert f"Requires-Dist: mavproxy-handover=={VERSION}" in lines


def test_a_command_of_the_simulation_names_its_package_where_it_is_missing() -> None:
    run = "import sys; sys.modules['sitl'] = None; from mavproxy_handover import cli; sys.exit(cli.main(['sim']))"
    done = subprocess.run([sys.executable, "-c", run], capture_output=True, text=True, check=False, timeout=60)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "handover sim: needs sitl: pip install 'mavproxy-handover-sim'\n"


def test_the_guard_in_the_wheel_is_the_guard_of_the_source(wheel: zipfile.ZipFile) -> None:
    packed = wheel.read("mavproxy_handover/data/ardupilot_lua/handover_guard.lua")
    assert packed == (ROOT / "ardupilot_lua" / "handover_guard.lua").read_bytes()


def test_no_caches_keys_tests_or_journals_are_in_it(names: set[str]) -> None:
    for name in names:
        assert "__pycache__" not in name
        assert not name.endswith((".pyc", ".jsonl", ".tlog", ".key", ".keys", ".bin"))
        assert "test" not in name.split("/")[0]


def test_the_command_handover_is_installed(wheel: zipfile.ZipFile) -> None:
    (path,) = [name for name in wheel.namelist() if name.endswith(".dist-info/entry_points.txt")]
    parser = configparser.ConfigParser()
    parser.read_string(wheel.read(path).decode())
    assert parser["console_scripts"]["handover"] == "mavproxy_handover.cli:main"


def test_the_metadata_names_licence_version_and_what_the_vehicle_needs(wheel: zipfile.ZipFile) -> None:
    from mavproxy_handover.tools.version import VERSION

    (path,) = [name for name in wheel.namelist() if name.endswith(".dist-info/METADATA")]
    lines = wheel.read(path).decode().splitlines()
    assert f"Version: {VERSION}" in lines
    assert "License-Expression: GPL-3.0-or-later" in lines
    assert "Requires-Python: >=3.10" in lines
    needs = {
        re.split(r"[<>]", line.split(": ")[1])[0]
        for line in lines
        if line.startswith("Requires-Dist") and "extra" not in line and "sys_platform" not in line  # vehicles run Linux
    }
    assert needs == {"MAVProxy", "future", "numpy", "pymavlink", "pyserial", "shapely", "tomli"}
