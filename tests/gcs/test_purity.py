# SPDX-License-Identifier: GPL-3.0-or-later

"""The station's rules know no clock, no network and no chance: the part that lies beside `core.py`.

`tests/core/test_purity.py` looks at `core.py` and `events.py` themselves.
"""

from __future__ import annotations

import ast
from pathlib import Path

import gcs_module
from gcs_module import core, events

FOLDER = Path(gcs_module.__file__).parent


def imported(path: Path) -> set[str]:
    """Modules that a file imports."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add("." * node.level + (node.module or ""))
    return found


def test_of_what_lies_beside_it_core_imports_what_is_as_pure_alone() -> None:
    beside = {name for name in imported(FOLDER / "core.py") if name.startswith((".", "gcs_module"))}
    assert beside == {
        "gcs_module.ahead",
        "gcs_module.events",
        "gcs_module.notices",
        "gcs_module.standard_control",
    }
    assert imported(FOLDER / "standard_control.py") == {
        "__future__",
        "collections.abc",
        "dataclasses",
        "gcs_module.events",
        "gcs_module.notices",
        "math",
        "typing",
    }
    assert imported(FOLDER / "notices.py") == {
        "__future__",
        "collections.abc",
        "dataclasses",
        "gcs_module.alarms",
        "gcs_module.events",
        "typing",
    }


def test_what_is_said_beforehand_is_judged_by_the_rules_words_alone() -> None:
    assert imported(FOLDER / "ahead.py") == {
        "__future__",
        "dataclasses",
        "math",
        "mavproxy_handover.core.authority.foresight",
        "mavproxy_handover.core.common.messages",
        "mavproxy_handover.core.common.model",
        "typing",
    }


def test_events_and_actions_are_made_of_the_rules_words_alone() -> None:
    names = imported(FOLDER / "events.py")
    assert names == {
        "__future__",
        "dataclasses",
        "gcs_module.alarms",
        "math",
        "mavproxy_handover.core.common.messages",
        "mavproxy_handover.core.common.model",
    }


def test_whoever_uses_the_rules_finds_their_words_there() -> None:
    assert set(events.__all__) <= set(core.__all__)
    assert all(getattr(core, name) is getattr(events, name) for name in events.__all__)


def test_how_grave_a_line_is_knows_nothing_but_the_rules_words() -> None:
    names = imported(FOLDER / "alarms.py")
    assert names == {
        "__future__",
        "collections.abc",
        "dataclasses",
        "math",
        "mavproxy_handover.core.common.levels",
        "mavproxy_handover.core.common.model",
        "typing",
    }
