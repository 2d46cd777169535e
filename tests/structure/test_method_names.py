# SPDX-License-Identifier: GPL-3.0-or-later

"""A method or function is named after what it does.

Each name in `VAGUE` stood for many different acts, so a reader had to open the body to learn which one.
"""

from __future__ import annotations

import re

import pytest

from tests.structure.imports import files

#: name without leading underscores -> names that say what is done
VAGUE = {
    "take": "accept_offer, add_report, add_sample, forward, handle_message, install",
    "look": "check, evaluate, poll, update, verify",
    "adopt": "apply_settings, restore, set_policy, set_route",
    "heard": "accept_answer, handle_signals, note_heard, note_reply, record_heartbeat",
    "settle": "resolve_doubt, wait_until_written",
}


def vague(source: str) -> list[str]:
    """The functions and methods of a source that have such a name."""
    return [name for name in re.findall(r"\bdef (\w+)", source) if name.lstrip("_") in VAGUE]


@pytest.mark.parametrize("module", sorted(name for name in files() if not name.startswith("sitl")))
def test_a_function_is_named_after_what_it_does(module: str) -> None:
    assert vague(files()[module].read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("class Watch:\n    def look(self): ...", ["look"]),
        ("class Link:\n    async def _heard(self): ...", ["_heard"]),
        ("def settle(): ...", ["settle"]),
        ("class Watch:\n    def take_off(self): ...\n    def heard_ago_s(self): ...", []),
    ],
)
def test_a_vague_name_is_found(source: str, found: list[str]) -> None:
    assert vague(source) == found
