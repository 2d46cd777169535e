# SPDX-License-Identifier: GPL-3.0-or-later

"""What the documents say can be typed and put into a configuration: commands exist, samples load."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from mavproxy_handover.cli import main
from mavproxy_handover.config.files import load_vehicle
from sitl.script.scenario import known_scenarios

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
#: of stations with programs of others
PROGRAMS = [ROOT / "docs" / name for name in ("qgroundcontrol.md", "mission-planner.md", "mavsdk.md")]

VEHICLE = """
[vehicle]
name = "drone-1"
parent = "GCSB"
journal = "x.jsonl"
{more}
"""


def named(paths: list[Path]) -> list[Any]:
    return [pytest.param(path, id=path.name) for path in paths]


@pytest.mark.parametrize("document", named(DOCUMENTS))
def test_a_document_that_leads_to_the_reference_says_how_it_is_made(document: Path) -> None:
    """The reference is not committed: without these words the link leads nowhere for a reader of the sources."""
    text = document.read_text(encoding="utf-8")
    assert "](reference/" not in text or re.search(r"`make\sreference`\swrites", text)


def test_the_folders_that_the_architecture_names_are_there() -> None:
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8").partition("## Where things are")[2]
    folders = re.findall(r"(\S+)/(?=\s)", text.partition("```text")[2].partition("```")[0])
    assert len(folders) > 10
    assert [name for name in folders if not (ROOT / name).is_dir()] == []


def test_the_readme_leads_to_every_document() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert [path.name for path in DOCUMENTS[1:] if f"(docs/{path.name})" not in text] == []


@pytest.mark.parametrize("document", named(PROGRAMS))
def test_the_configuration_of_such_a_station_loads(document: Path, tmp_path: Path) -> None:
    blocks = re.findall(r"```toml\n(.*?)```", document.read_text(encoding="utf-8"), re.DOTALL)
    assert len(blocks) == 1
    head, station = blocks[0].replace("\n   ", "\n").split("[[station]]")
    config = tmp_path / "handover.toml"
    config.write_text(VEHICLE.format(more=head) + "[[station]]" + station, encoding="utf-8")
    (entry,) = load_vehicle(config).stations
    assert (entry.station.name, entry.station.sysid, entry.station.standard) == ("GCSB", 252, True)
    unsigned = document.name == "mavsdk.md"
    assert (entry.key is None) is unsigned
    assert entry.not_in_control == ("never" if unsigned else "auto")


@pytest.mark.parametrize("document", named(PROGRAMS))
def test_what_is_typed_in_a_shell_exists(document: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = document.read_text(encoding="utf-8")
    for command, more in re.findall(r"`handover (keys|init|sim|station)\b([^`]*)`", text):
        assert main([command, "--help"]) == 0
        shown = capsys.readouterr().out
        assert all(option in shown for option in re.findall(r"--[a-z-]+", more)), f"{command}{more}"
    assert set(re.findall(r"--scenario ([\w-]+)", text)) <= set(known_scenarios())
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert all(f"\n{target}: " in makefile for target in re.findall(r"`make (\w+)`", text))


@pytest.mark.parametrize("document", named([*PROGRAMS, ROOT / "docs" / "thesis.md"]))
def test_files_of_ours_that_are_named_are_there(document: Path) -> None:
    paths = re.findall(
        r"`((?:tests|mavproxy_handover|docs|sitl|missions)/[\w./-]+)`", document.read_text(encoding="utf-8")
    )
    assert [path for path in paths if not (ROOT / path).exists()] == []
