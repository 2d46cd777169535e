# SPDX-License-Identifier: GPL-3.0-or-later

"""The pages of the reference: nothing is left out, no word is missing, and every link in them leads on."""

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
from mavproxy_handover.vehicle.profiles import COPTER
from reference.blocks import blocks
from reference.pages import FOLDER, PAGES
from reference.parsers import commands
from reference.requirements import PARTS, names_in, read
from tests.structure.imports import ROOT

#: the pages, as they are written now
TEXTS = {name: written() for name, written in PAGES.items()}


def test_the_parts_of_files_that_are_made_from_tables_are_not_out_of_date() -> None:
    for path, text in blocks().items():
        assert path.read_text(encoding="utf-8") == text, f"{path} is out of date: `make reference` writes it"


@pytest.mark.parametrize("name", TEXTS)
def test_every_link_of_a_page_leads_to_a_file_or_to_a_heading_of_it(name: str) -> None:
    text = TEXTS[name]
    headings = {line.lstrip("# ").lower().replace(" ", "-") for line in text.splitlines() if line.startswith("#")}
    files, places = [], []
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        (places if target.startswith("#") else files).append(target)
    assert [file for file in files if "://" not in file and not (FOLDER / file).resolve().exists()] == []
    assert [place for place in places if place[1:] not in headings] == []


def test_no_row_of_a_page_lacks_or_has_a_cell_too_many() -> None:
    for name, text in TEXTS.items():
        width = 0
        for line in text.splitlines():
            if not line.startswith("|"):
                width = 0
                continue
            cells = len(re.findall(r"(?<!\\)\|", line)) - 1
            assert cells == (width or cells), f"{name}: {line}"
            width = cells


def test_no_backslash_is_shown_before_a_bar_in_code() -> None:
    """The fault: the site shows `a\\|b` as it stands there."""
    lines = [line for text in TEXTS.values() for line in text.splitlines()]
    assert [line for line in lines if re.search(r"`[^`|]*\\\|[^`]*`", line)] == []


def test_every_command_is_told_and_every_option_has_a_meaning() -> None:
    found = commands()
    assert [each.words for each in found if " " not in each.words] == list(cli.COMMANDS)
    text = TEXTS["commands.md"]
    for command in found:
        assert f"# handover {command.words}\n" in text
        assert command.description
        assert [option.typed for option in command.options if not option.help] == []


def test_every_message_is_told_with_all_its_fields() -> None:
    text = TEXTS["exchange.md"]
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
    text = TEXTS["parameters.md"]
    lua = (ROOT / "ardupilot_lua" / "handover_guard.lua").read_text(encoding="utf-8")
    own = {f"HNDO_{name}" for name in re.findall(r'bind_add_param\("(\w+)", \d', lua)}
    assert len(own) == 8
    assert {name for name in own | set(COPTER.reads) if f"\n| `{name}` |" not in text} == set()


@pytest.mark.parametrize("file", ["handover.parm", "handover_plane.parm"])
def test_every_value_of_a_file_of_parameters_is_told_beside_its_name(file: str) -> None:
    text = TEXTS["parameters.md"]
    section = text.partition(f"`ardupilot_lua/{file}` sets them")[2].partition("\n## ")[0]
    parm = (ROOT / "ardupilot_lua" / file).read_text(encoding="utf-8")
    values = re.findall(r"^([A-Z]\w+) (\S+)$", parm, re.MULTILINE)
    assert len(values) > 10
    assert [name for name, value in values if f"\n| `{name}` | `{value}` |" not in section] == []


def test_each_command_of_the_consoles_that_is_told_is_one_that_help_shows() -> None:
    text = TEXTS["commands.md"]
    shown: list[str] = []
    host = MagicMock()
    host.view.show = shown.append
    StationCommands(host, our_settings()).run(["help"])
    VehicleCommands(MagicMock(), shown.append).run(["help"])
    helped = {line.split()[0] for line in shown if line.startswith("  ")}
    told = {words.split()[0] for words in re.findall(r"\n\| (?:`|<code>)handover ([^`<]+)", text)}
    assert len(told) > 15
    assert helped == told | {"set"}


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
