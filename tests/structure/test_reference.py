# SPDX-License-Identifier: GPL-3.0-or-later

"""The pages of docs/reference are what the generator makes of the present state."""

from __future__ import annotations

import pytest

from mavproxy_handover import cli
from tests.structure import reference


@pytest.mark.parametrize("name", reference.PAGES)
def test_the_page_is_of_the_present_state(name: str) -> None:
    path = reference.ROOT / "docs" / "reference" / name
    made = getattr(reference, reference.PAGES[name])()
    assert path.read_text(encoding="utf-8") == made, "make it anew: make reference"


def test_every_command_is_told_with_its_options() -> None:
    page = reference.commands()
    for word in cli._COMMANDS:
        assert f"\n## handover {word}\n" in page
        for action in reference.parser_of(word)._actions:
            if action.help != "==SUPPRESS==" and action.dest != "help":
                assert all(f"`{option}" in page for option in action.option_strings)


def test_every_message_has_its_fields() -> None:
    page = reference.messages()
    for line in ("| 47100 | [`CONNECT`](#connect)", "## HANDOVER_REQUEST", "## HANDOVER_REASON"):
        assert line in page
