# SPDX-License-Identifier: GPL-3.0-or-later

"""Errors of files and commands, the doctor's findings and a station's other lines are on the page about messages.

Their texts are read from the sources. So a new one is on the page by itself; a new file needs a family.
"""

from __future__ import annotations

import re
from collections import Counter
from functools import cache
from pathlib import Path

import pytest

from reference.doctor import findings
from reference.messages import messages
from reference.sentences.errors import FAMILIES, OTHER_FILES, SHOWN, Family, texts_of
from reference.sources import literals

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = tuple(
    f"mavproxy_handover/{name}"
    for name in ("config", "link", "store", "supervision", "mission", "cli", "tools", "wire")
)
#: files of these folders that have a table of their own
OWN = {"gcs_module/notices.py": "it is the table of a station's notices"}


@cache
def page() -> str:
    return messages()


def files(*folders: str) -> list[str]:
    """The files with texts."""
    paths = [path for folder in folders for path in sorted((ROOT / folder).rglob("*.py"))]
    return [path.relative_to(ROOT).as_posix() for path in paths if [*literals(path.read_text(encoding="utf-8"))]]


def test_every_file_with_texts_is_in_a_family_or_says_why_not() -> None:
    named = [file for family in (*FAMILIES, *SHOWN) for file in family.files]
    assert [file for file, count in Counter(named).items() if count > 1] == []
    assert [
        file for file in files(*FOLDERS, "gcs_module", "sitl/report") if file not in (*named, *OTHER_FILES, *OWN)
    ] == []
    assert [file for file in (*named, *OTHER_FILES, *OWN) if not (ROOT / file).exists()] == []
    assert all(OTHER_FILES.values())


@pytest.mark.parametrize("family", [*FAMILIES, *SHOWN], ids=lambda family: family.title)
def test_a_family_has_texts_meaning_and_action(family: Family) -> None:
    for text in (family.meaning, family.action):
        assert re.fullmatch(r"['A-Z].*\.", text), text
    texts = texts_of(family)
    assert texts
    section = page().partition(f"\n### {family.title}\n")[2].partition("\n##")[0]
    assert len(re.findall(r"\n\| (?:`|<code>)", section)) == len(texts)


def test_an_error_is_read_with_its_values_by_name() -> None:
    source = '''"""A module that has a docstring of words."""
X = {"a": "a value of a table of the module"}
Y = "a constant of the module, raised elsewhere"

def read(path, error):
    """A docstring of a function with words."""
    raise ValueError(f"{path}: not TOML: {error.strerror or error}")

class A:
    def f(self):
        found = f"{self._where.name} is {len(self.items)} (allowed: {', '.join(words)})"
        return "short"
'''
    constant = "a constant of the module, raised elsewhere"
    assert [*literals(source)] == [constant, "{path}: not TOML: {strerror}"]
    assert [*literals(source.replace("(allowed", "too long (allowed"))] == [
        constant,
        "{path}: not TOML: {strerror}",
        "{name} is {items} too long (allowed: {words})",
    ]


def test_every_finding_of_the_doctor_says_what_to_do() -> None:
    found = [*findings()]
    assert len(found) > 140
    assert [each for each in found if (each.level == "ok") == bool(each.do)] == []
    section = page().partition("\n## Of the doctor\n")[2].partition("\n## ")[0]
    assert section.count("\n| error |") + section.count("\n| warning |") == sum(bool(each.do) for each in found)


def test_a_finding_has_the_text_that_its_name_got_last() -> None:
    texts = {(each.found, each.do) for each in findings()}
    assert ("{host}: is no serial line", "Name the line that the other end is plugged into.") in texts
    assert (
        "no heartbeat of system {sysid}, but frames of system {names}",
        "Set [vehicle] sysid to that of the autopilot (MAV_SYSID, older SYSID_THISMAV), or name its line.",
    ) in texts
