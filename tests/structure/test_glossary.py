# SPDX-License-Identifier: GPL-3.0-or-later

"""The words of the glossary are those of the code. Every page links it before it uses one of them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import pytest

from gcs_module.core import Role
from mavproxy_handover.companion.companion import Companion
from mavproxy_handover.core.authority.authority import Authority
from mavproxy_handover.core.common.causes import Cause
from mavproxy_handover.core.common.events import ConditionsSeen
from mavproxy_handover.core.common.messages import HandoverRequest
from mavproxy_handover.core.common.model import (
    QUESTIONS,
    AuthorityView,
    Consent,
    FlightAction,
    GuardState,
    LeaseState,
    Reason,
    Station,
)
from mavproxy_handover.core.safety.strategy import Decision
from mavproxy_handover.gate.gate import Gate
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.mission.zones import Zone
from mavproxy_handover.operator.return_site.return_site import ReturnSite

ROOT = Path(__file__).resolve().parents[2]
GLOSSARY = ROOT / "docs" / "glossary.md"
#: types that have a word of the glossary in their name
NAMED = {
    "companion": Companion,
    "guard": GuardState,
    "gate": Gate,
    "station": Station,
    "authority": Authority,
    "lease": LeaseState,
    "handover": HandoverRequest,
    "consent": Consent,
    "zone": Zone,
    "return site": ReturnSite,
    "mission package": MissionPackage,
    "condition": ConditionsSeen,
    "cause": Cause,
    "decision": Decision,
}
#: words for what has no type of its own, each with the reason
UNNAMED = {
    "commander": "a role, see test_the_roles_of_a_station",
    "partner": "a role, see test_the_roles_of_a_station",
    "observer": "a role, see test_the_roles_of_a_station",
    "epoch": "a field of AuthorityView, see test_the_epoch_is_a_field",
    "forced handover": "a handover for one reason, see test_a_forced_handover_is_one_reason",
    "overlap": "two zones",
    "feed": "the gate has the class STREAM for it",
    "onboard program": "the gate does not judge it",
}
#: what is no prose: code, headings, tables, links, tags, titles in quotes
NO_PROSE = re.compile(
    r"^(```|~~~).*?^\1|<!--.*?-->|^ {4,}.*?$|^#.*?$|^ *\|.*?$|^ *<.*?$|`[^`]*`|!?\[[^\]]*\]\([^)]*\)"
    r'|"[^"]{1,120}"',
    re.MULTILINE | re.DOTALL,
)
#: without the changelog, which tells of each release in its own words
PAGES = sorted(
    path
    for pattern in ("README.md", "docs/*.md", "missions/*.md", "ardupilot_lua/*.md")
    for path in ROOT.glob(pattern)
    if path != GLOSSARY
)


class Use(NamedTuple):
    """A word of the glossary in the prose of a page. `section`: the heading of its table, as a link names it."""

    start: int
    end: int
    section: str


def words() -> dict[str, str]:
    """Word -> section."""
    found = {}
    section = ""
    for line in GLOSSARY.read_text(encoding="utf-8").splitlines():
        if line.startswith("## "):
            section = line[3:].lower()
        elif line.startswith("| ") and not line.startswith("| word |"):
            found[line.split(" | ")[0][2:]] = section
    return found


def first_use(text: str) -> Use | None:
    """The first word of the glossary in the prose of a page; what is no prose is blanked out."""
    prose = NO_PROSE.sub(lambda part: re.sub(r"\S", " ", part[0]), text)
    known = words()
    longest_first = "|".join(map(re.escape, sorted(known, key=len, reverse=True)))
    hit = re.search(rf"(?<![\w/.-])({longest_first})s?(?![\w/-]|\.\w)", prose, re.IGNORECASE)
    return None if hit is None else Use(hit.start(), hit.end(), known[hit[1].lower()])


def links(text: str) -> list[tuple[int, str]]:
    """Where a page links the glossary, and to which section."""
    return [(m.start(), m[1]) for m in re.finditer(r"\]\((?:\.\./|docs/)*glossary\.md#?([\w-]*)\)", text)]


def test_each_word_is_explained_in_one_sentence_and_has_a_cell_for_every_source() -> None:
    rows = [line for line in GLOSSARY.read_text(encoding="utf-8").splitlines() if line.startswith("| ")]
    cells = [line.strip("| ").split(" | ") for line in rows if not line.startswith("| word |")]
    assert len(cells) > 20
    assert [row[0] for row in cells if len(row) != 5 or not all(row)] == []
    assert [row[0] for row in cells if not re.fullmatch(r"[A-Z][^.]*\.", row[1])] == []


def test_every_word_is_one_of_the_code_or_says_why_it_is_not() -> None:
    assert set(words()) == {*NAMED, *UNNAMED}
    assert {word for word, named in NAMED.items() if word.replace(" ", "") not in named.__name__.lower()} == set()


def test_the_roles_of_a_station() -> None:
    assert {role.value for role in Role} == {"commander", "partner", "observer"}


def test_the_epoch_is_a_field() -> None:
    assert "epoch" in AuthorityView.__dataclass_fields__


def test_a_forced_handover_is_one_reason() -> None:
    assert [reason for reason, word in QUESTIONS.items() if word == "forced"] == [Reason.COMMANDER_LOST]


def test_the_actions_of_a_decision_are_those_of_the_code() -> None:
    (row,) = [line for line in GLOSSARY.read_text(encoding="utf-8").splitlines() if line.startswith("| decision |")]
    said = re.findall(r"\w+", row.split(":")[1].split(".")[0].replace(" or ", " "))
    assert said == [action.name.lower() for action in FlightAction]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_a_page_links_the_glossary_where_it_first_uses_a_word_of_it(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    linked, use = links(text), first_use(text)
    assert linked, "no link to docs/glossary.md"
    assert {section for _start, section in linked} <= {"", *words().values()}
    assert use is None or linked[0][0] < use.start, f"a word comes before the link: {text[use.start - 30 : use.end]!r}"


def test_a_word_before_the_link_is_noticed_and_code_is_no_word() -> None:
    text = "# The gate\n\n`lease`\n\n| zone |\n\n    commander\n\nThe observers see it. [zone](glossary.md#places)\n"
    use = first_use(text)
    assert use is not None
    assert text[use.start : use.end] == "observers"
    assert use.section == "authority"
    assert use.start < links(text)[0][0]
