# SPDX-License-Identifier: GPL-3.0-or-later

"""The generated pages: not out of date, with nothing left out and no word missing, and every link in them leads on."""

from __future__ import annotations

import re
from pathlib import Path
from unittest.mock import MagicMock
from xml.etree import ElementTree

import pytest

from gcs_module.commands import StationCommands
from gcs_module.fleet import our_settings
from mavproxy_handover import cli
from mavproxy_handover.companion.commands import VehicleCommands
from mavproxy_handover.config import meanings
from mavproxy_handover.config.toml import ConfigError
from mavproxy_handover.config.vehicle import load_vehicle
from mavproxy_handover.mission import gaps, package
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.vehicle.profiles import COPTER
from tests.structure.imports import ROOT
from tests.structure.reference.configuration import Key, keys_of_missions, keys_of_stations, keys_of_vehicles
from tests.structure.reference.files import REFERENCE, generated
from tests.structure.reference.parsers import commands
from tests.structure.reference.requirements import PARTS, names_in, read

GENERATED = generated()
ANEW = "is out of date: `make reference` writes it anew"


@pytest.mark.parametrize("path", [pytest.param(path, id=path.name) for path in GENERATED])
def test_a_generated_file_is_as_its_generator_makes_it(path: Path) -> None:
    assert path.exists(), f"{path} {ANEW}"
    assert path.read_text(encoding="utf-8") == GENERATED[path], f"{path} {ANEW}"


def test_no_page_lies_there_that_nobody_makes() -> None:
    assert set(REFERENCE.iterdir()) == {path for path in GENERATED if path.parent == REFERENCE}


@pytest.mark.parametrize("path", sorted(REFERENCE.glob("*.md")), ids=lambda path: path.name)
def test_every_link_of_a_page_leads_to_a_file_or_to_a_heading_of_it(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    headings = {line.lstrip("# ").lower().replace(" ", "-") for line in text.splitlines() if line.startswith("#")}
    files, places = [], []
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        (places if target.startswith("#") else files).append(target)
    assert [name for name in files if "://" not in name and not (path.parent / name).exists()] == []
    assert [place for place in places if place[1:] not in headings] == []


def test_no_row_of_a_page_lacks_or_has_a_cell_too_many() -> None:
    for path in REFERENCE.glob("*.md"):
        width = 0
        for line in path.read_text(encoding="utf-8").splitlines():
            if not line.startswith("|"):
                width = 0
                continue
            cells = len(re.findall(r"(?<!\\)\|", line)) - 1
            assert cells == (width or cells), f"{path.name}: {line}"
            width = cells


def test_every_command_is_told_and_every_option_has_a_meaning() -> None:
    found = commands()
    assert [each.words for each in found if " " not in each.words] == list(cli.COMMANDS)
    text = (REFERENCE / "commands.md").read_text(encoding="utf-8")
    for command in found:
        assert f"# handover {command.words}\n" in text
        assert command.description
        assert [option.typed for option in command.options if not option.help] == []


def test_every_message_is_told_with_all_its_fields() -> None:
    text = (REFERENCE / "messages.md").read_text(encoding="utf-8")
    told = 0
    for name in ("handover.xml", "operator_control.xml"):
        root = ElementTree.parse(ROOT / "mavproxy_handover" / "wire" / name).getroot()
        for message in root.iter("message"):
            section = text.partition(f"\n#### {message.get('name')}\n")[2].partition("\n#")[0]
            assert f"Id {message.get('id')}. " in section
            for field in message.iter("field"):
                assert re.search(rf"\| `{field.get('name')}`[^|]*\| `{re.escape(str(field.get('type')))}` \|", section)
                told += 1
    assert told > 150


def test_every_parameter_of_guard_and_preflight_is_told() -> None:
    text = (REFERENCE / "parameters.md").read_text(encoding="utf-8")
    lua = (ROOT / "ardupilot_lua" / "handover_guard.lua").read_text(encoding="utf-8")
    own = {f"HNDO_{name}" for name in re.findall(r'bind_add_param\("(\w+)", \d', lua)}
    assert len(own) == 8
    assert {name for name in own | set(COPTER.reads) if f"\n| `{name}` |" not in text} == set()


@pytest.mark.parametrize("file", ["handover.parm", "handover_plane.parm"])
def test_every_value_of_a_file_of_parameters_is_told_beside_its_name(file: str) -> None:
    text = (REFERENCE / "parameters.md").read_text(encoding="utf-8")
    section = text.partition(f"`ardupilot_lua/{file}` sets them")[2].partition("\n## ")[0]
    parm = (ROOT / "ardupilot_lua" / file).read_text(encoding="utf-8")
    values = re.findall(r"^([A-Z]\w+) (\S+)$", parm, re.MULTILINE)
    assert len(values) > 10
    assert [name for name, value in values if f"\n| `{name}` | `{value}` |" not in section] == []


def test_each_command_of_the_consoles_that_is_told_is_one_that_help_shows() -> None:
    text = (REFERENCE / "commands.md").read_text(encoding="utf-8")
    shown: list[str] = []
    host = MagicMock()
    host.view.show = shown.append
    StationCommands(host, our_settings()).run(["help"])
    VehicleCommands(MagicMock(), shown.append).run(["help"])
    helped = {line.split()[0] for line in shown if line.startswith("  ")}
    told = {words.split()[0] for words in re.findall(r"\n\| `handover ([^`]+)`", text)}
    assert len(told) > 15
    assert helped == told | {"set"}


# ---- configuration ------------------------------------------------------------------------------------------------

VEHICLE = """
[vehicle]
name = "drone-1"
parent = "GCSA"
allow_unsigned = true
[[station]]
name = "GCSA"
sysid = 251
links = ["udpout:127.0.0.1:14551"]
"""


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        pytest.param(keys_of_vehicles(), meanings.VEHICLE, id="vehicle"),
        pytest.param(keys_of_stations(), meanings.STATION, id="station"),
        pytest.param(keys_of_missions(), meanings.MISSION, id="mission"),
    ],
)
def test_every_key_that_a_reader_takes_has_a_meaning_and_no_other(
    keys: dict[str, dict[str, Key]], said: dict[str, dict[str, str]]
) -> None:
    assert {where: set(table) for where, table in keys.items()} == {where: set(table) for where, table in said.items()}
    assert [key for table in keys.values() for key in table.values() if not key.kind] == []


def _write(folder: Path, where: str, line: str) -> Path:
    """A vehicle's configuration with one table more."""
    path = folder / "handover.toml"
    path.write_text(f"{VEHICLE}[{where}]\n{line}\n", encoding="utf-8")
    return path


NUMBERS = [
    pytest.param(where, key, id=f"{where}.{key.name}")
    for where, table in keys_of_vehicles().items()
    for key in table.values()
    if re.fullmatch(r"[\d.]+ to [\d.]+", key.allowed) and where not in ("vehicle", "station")
]


@pytest.mark.parametrize(("where", "key"), NUMBERS)
def test_a_range_that_is_told_is_the_one_that_is_kept(where: str, key: Key, tmp_path: Path) -> None:
    low, high = map(float, key.allowed.split(" to "))
    more = {"payload_kg": "mass_kg = 1000\n", "connect_interval_s": "deaf_lost_s = 120\n"}.get(key.name, "")
    form = "{:.0f}" if key.kind == "whole number" else "{:.9f}"
    for value in (low, high):
        load_vehicle(_write(tmp_path, where, more + f"{key.name} = {form.format(value)}"))
    beyond = 1 if key.kind == "whole number" else 1e-6
    for value in (low - beyond, high + beyond):
        with pytest.raises(ConfigError, match=key.name):
            load_vehicle(_write(tmp_path, where, more + f"{key.name} = {form.format(value)}"))


def test_the_keys_of_a_mission_are_those_that_its_reader_takes() -> None:
    keys = keys_of_missions()
    assert set(keys[""]) == set(package._KEYS)
    assert set(keys["gap"]) == set(gaps._KEYS)
    assert set(keys["policy"]) == set(package._POLICIES)


def _mission(name: str, was: str, now: str) -> package.MissionPackage:
    """A mission that ships, with something in its mission.toml changed."""
    folder = ROOT / "missions" / name
    texts = {path.name: path.read_text(encoding="utf-8") for path in folder.iterdir() if path.suffix != ".png"}
    changed = re.sub(was, now, texts["mission.toml"], count=1, flags=re.MULTILINE)
    assert changed != texts["mission.toml"]
    return package.from_texts(texts | {"mission.toml": changed}, name)


@pytest.mark.parametrize(
    ("name", "key", "where", "good", "bad"),
    [
        ("delivery", "expected_handovers", "", ("0", "1000"), ("-1", "1001")),
        ("delivery", "cruise_speed_mps", "", ("0.1", "100"), ("0.09", "100.1")),
        ("corridor", "corridor_m", "", ("5", "10000"), ("4.9", "10001")),
        ("ridge", "limit_s", "gap", ("1", "600"), ("0.9", "601")),
        ("delivery", "sysid", "stations", ("1", "255"), ("0", "256")),
    ],
)
def test_a_range_of_a_mission_is_the_one_that_is_kept(
    name: str, key: str, where: str, good: tuple[str, str], bad: tuple[str, str]
) -> None:
    assert keys_of_missions()[where][key].allowed == " to ".join(good)
    for value in good:
        _mission(name, rf"^{key} = .*$", f"{key} = {value}")
    for value in bad:
        with pytest.raises(MissionError, match=key):
            _mission(name, rf"^{key} = .*$", f"{key} = {value}")


# ---- requirements -------------------------------------------------------------------------------------------------


def test_every_requirement_has_a_test_that_exists_or_says_why_it_has_none() -> None:
    rows = read()
    assert [row.id for row in rows if bool(row.tests) == bool(row.none)] == []
    assert {row.part for row in rows} == set(PARTS)
    assert len(rows) > 170
    assert [row.id for row in rows if row.part == "thesis" and not row.source[:1].isdigit()] == []
    missing = []
    for row in rows:
        for name in row.tests:
            path, _, test = name.partition("::")
            if not (ROOT / path).exists() or test not in names_in(ROOT / path):
                missing.append(f"{row.id}: {name}")
    assert missing == []


def test_no_requirement_is_there_twice() -> None:
    rows = read()
    assert len({row.id for row in rows}) == len({row.text for row in rows}) == len(rows)
    assert [row.id for row in rows if len(set(row.tests)) < len(row.tests)] == []


def test_the_names_in_a_file_are_read_with_their_classes_and_nothing_else_is_one() -> None:
    own = names_in(Path(__file__))
    assert "test_no_requirement_is_there_twice" in own
    assert not {"_write", "NUMBERS", "test_"} & own
    assert any(name.startswith("Test") and "::test_" in name for name in names_in(ROOT / "tests/core/test_control.py"))
