# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover explain`: the table of safety decisions as it is configured, and what would be decided in a given state."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from mavproxy_handover.config.toml import ConfigError
from mavproxy_handover.config.vehicle import load_vehicle
from mavproxy_handover.core.common.causes import CAUSES, Cause
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.safety.explain import (
    HEAD,
    assumed,
    carried_out_table,
    facts_table,
    story,
    table,
)
from mavproxy_handover.core.safety.strategy import Fact
from mavproxy_handover.gate.explain import columns, markdown_table
from mavproxy_handover.tools.command_line import CommandParser
from mavproxy_handover.vehicle.profiles import PROFILES

__all__ = ["main", "markdown"]

_YES, _NO = ("yes", "true", "1", "on"), ("no", "false", "0", "off")
_CAUSES: Final[Mapping[str, Cause]] = {cause.value: cause for cause in Cause}
#: how each kind of aircraft carries out what is decided
_WORDS: Final = {profile.name: profile.carried_out for profile in PROFILES}
_FACTS: Final[Mapping[str, Fact]] = {fact.name.lower(): fact for fact in Fact}


#: the columns of the table of causes, for programs
_KEYS: Final = ("cause", "wrong", "counts_after", "ends", "policy", "done")


class _BadState(Exception):
    """A --state that says nothing. One line."""


@dataclass(frozen=True, slots=True)
class _State:
    causes: frozenset[Cause]
    facts: frozenset[Fact]


def _state(words: Sequence[str], limits: Limits) -> tuple[_State, Limits]:
    """Raises _BadState."""
    causes: set[Cause] = set()
    said: dict[Fact, bool] = {}
    for word in words:
        key, equals, value = word.partition("=")
        if key.startswith("policy."):
            limits = _with_policy(limits, key.removeprefix("policy."), value)
            continue
        if key not in _CAUSES and key not in _FACTS:
            raise _BadState(f"{word}: {key!r} must be a cause ({', '.join(_CAUSES)}) or a fact ({', '.join(_FACTS)})")
        if value not in (*_YES, *_NO) and equals:
            raise _BadState(f"{word}: {value!r} must be yes or no")
        on = value in _YES or not equals
        if key in _FACTS:
            said[_FACTS[key]] = on
        elif on:
            causes.add(_CAUSES[key])
        else:
            causes.discard(_CAUSES[key])
    facts = {fact for fact in Fact if said.get(fact, fact in assumed(causes))}
    return _State(frozenset(causes), frozenset(facts)), limits


def _with_policy(limits: Limits, key: str, value: str) -> Limits:
    if key not in _CAUSES:
        raise _BadState(f"policy.{key}: {key!r} must be one of {', '.join(_CAUSES)}")
    cause = _CAUSES[key]
    allowed = CAUSES[cause].policies
    if value not in allowed:
        raise _BadState(f"policy.{key}: {value!r} must be one of {', '.join(allowed)}")
    return replace(limits, policies={**limits.policies, cause: value})


def markdown() -> str:
    """The tables for the documentation, of the defaults."""
    causes = markdown_table([HEAD, *table(Limits())])
    facts = markdown_table([("fact", "it holds when", "what it does"), *facts_table()])
    return f"{causes}\n\n{facts}\n\n{markdown_table(carried_out_table(_WORDS))}"


def _as_json(limits: Limits, state: _State | None) -> dict[str, Any]:
    """The tables, or what is decided in a state: the sentences, with the causes and facts that it has."""
    if state is not None:
        return {
            "causes": sorted(cause.value for cause in state.causes),
            "facts": sorted(fact.name.lower() for fact in state.facts),
            "decision": story(state.causes, state.facts, limits),
        }
    rows = [dict(zip(_KEYS, row, strict=True)) for row in table(limits)]
    facts = [dict(zip(("fact", "holds_when", "does"), row, strict=True)) for row in facts_table()]
    return {"causes": rows, "facts": facts}


def main(argv: Sequence[str]) -> int:
    """Print the table, or what is decided in a state. 2: a bad file or a bad state."""
    parser = CommandParser(
        prog="handover explain",
        examples=(
            ("handover explain", "what is done about each cause, by the defaults"),
            (
                "handover explain --config handover.toml --state commander_lost --state place=no",
                "what this vehicle does when the commander is lost and no return site is in reach",
            ),
        ),
        codes={0: "printed", 2: "wrong usage, or a configuration that cannot be read"},
        description="What the aircraft does about what is wrong: each cause, how long its sign has to stay, and what "
        "is done, by the configuration. With --state: what would be decided then, and why.",
        epilog="A state names causes and facts: --state commander_lost --state place=no --state policy.fence=return. "
        "In the air, the autopilot heard, a place in reach and room to hold are taken for granted; the autopilot not "
        "beside autopilot_lost, room to hold not beside commander_lost, out_of_coverage, no_station and "
        "position_stale. A mission's own policy (on_out_of_coverage) goes before: --state "
        "policy.out_of_coverage=land.",
    )
    parser.add_argument("--config", type=Path, help="the vehicle's configuration; without it the defaults")
    parser.add_argument(
        "--state", nargs="+", action="extend", metavar="KEY=VALUE", help="a cause or a fact, =no: not so"
    )
    parser.add_argument("--json", action="store_true", help="for programs: the same as one object")
    try:
        arguments = parser.parse_args(argv)
    except SystemExit as stop:
        return int(stop.code or 0)
    try:
        limits = Limits() if arguments.config is None else load_vehicle(arguments.config).limits
        state, limits = _state(arguments.state or (), limits)
    except (ConfigError, _BadState) as error:
        print(f"handover explain: {error}", file=sys.stderr)
        return 2
    if arguments.json:
        print(json.dumps(_as_json(limits, None if arguments.state is None else state), indent=1))
        return 0
    if arguments.state is not None:
        print("\n".join(story(state.causes, state.facts, limits)))
        return 0
    print(columns([HEAD, *table(limits)]))
    print()
    print(columns([("fact", "it holds when", "what it does"), *facts_table()]))
    print()
    print(columns(carried_out_table(_WORDS)))
    return 0
