# SPDX-License-Identifier: GPL-3.0-or-later

"""`scenarios.md`: the steps and expectations of a scenario file, key by key."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Iterator, Mapping

from reference.markdown import cell, code, page, table
from sitl.script import scenario
from sitl.script.expect import EXPECTATIONS
from sitl.script.fault_steps import FAULT_STEPS
from sitl.script.steps import STEPS

__all__ = ["scenarios"]

_TYPES = {
    "str": "text",
    "int": "whole number",
    "float": "number",
    "bool": "true or false",
    "tuple[str, ...]": "list of texts",
    "Match": "table of values of the entry",
}


def scenarios() -> str:
    """The page."""
    head = inspect.cleandoc(scenario.__doc__ or "")
    return page(
        "Scenarios",
        "A scenario is a file of steps and expectations that `handover sim --scenario FILE.toml` flies and judges. "
        "`name` is the name of the file without `.toml`, `mission` a mission that ships, or a folder beside the file. "
        "See [Simulation](../simulation.md).",
        "## The file",
        head.partition("\n\n")[2],
        "## Steps: what is done and waited for",
        _table(STEPS),
        "## Steps: what is broken",
        _table(FAULT_STEPS),
        "## Expectations",
        _table(EXPECTATIONS),
    )


def _table(words: Mapping[str, type]) -> str:
    rows = ((code(word), cell(_meaning(kind)), ", ".join(_keys(kind))) for word, kind in words.items())
    return table(("word", "meaning", "value"), rows)


def _meaning(kind: type) -> str:
    return inspect.cleandoc(kind.__doc__ or "").partition("\n\n")[0]


def _keys(kind: type) -> Iterator[str]:
    fields = dataclasses.fields(kind)
    for each in fields:
        written = str(each.type)
        optional = written.endswith(" | None") or each.default is not dataclasses.MISSING
        words = _TYPES[written.removesuffix(" | None")]
        alone = len(fields) == 1 and each.name == "value"
        yield words if alone else f"{code(each.name)} ({words}{', optional' if optional else ''})"
