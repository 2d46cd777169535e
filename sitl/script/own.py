# SPDX-License-Identifier: GPL-3.0-or-later

"""A scenario made of a mission package: it is flown as its check says, or with random faults.

The expectations come from the check's walk along the route: the order of commanders, the latest time of each handover,
the place of the landing. With faults (`seed`) the order is not predicted: each kind of fault has its own expectations.

The result is the text of a scenario, as `scenarios/` has them, so it can be read and kept.
"""

from __future__ import annotations

import json
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from mavproxy_handover.mission.items import COMMANDS, LANDINGS, RETURN_TO_LAUNCH
from mavproxy_handover.mission.package import MissionPackage
from sitl.script.places import SetupError
from sitl.script.tables import ScenarioError

__all__ = ["KINDS", "own_scenario", "scenario_text"]

#: a step may take this factor longer than the walk, and this time (s) more: climbs, turns, wind
_LONGER: Final = 1.5
_BESIDES_S: Final = 120.0
#: the longest that a step of a scenario can be waited for (s)
_MOST_S: Final = 7200.0
_WITHIN_M: Final = 5.0
_HOME_AGAIN: Final = ["home", "rally", "last_item"]


@dataclass(frozen=True, slots=True)
class _Fault:
    """A fault, in words and as steps, and the expectations that replace those of the check.

    `keys`: of the scenario.
    """

    words: str
    steps: Sequence[dict[str, Any]]
    expect: Sequence[dict[str, Any]]
    keys: dict[str, Any] = field(default_factory=dict)


def own_scenario(package: MissionPackage, folder: Path, seed: int | None = None) -> str:
    """The text of it. `seed`: of the faults, None: none. Raises SetupError: the mission cannot be flown to an end."""
    last = package.route.items[-1].command
    if last not in (*LANDINGS, RETURN_TO_LAUNCH):
        raise SetupError(
            f"{folder}: the mission ends in the air: its last item must be a landing or a return, or it never ends"
        )
    names = {station.sysid: station.name for station in package.stations}
    walk = package.simulate()
    commanders = [names[sysid] for sysid in walk.commanders]
    head: dict[str, Any] = {"name": package.name, "mission": str(folder.resolve()), "begin": "start", "signed": True}
    start: list[dict[str, Any]] = []
    if package.gaps:  # the guard has to allow them before START
        head |= {"begin": "loaded"}
        start = [
            {"world": {"name": "HNDO_ALONE_MAX", "value": max(gap.limit_s for gap in package.gaps)}},
            {"pause_s": 3},
            {"type": {"station": package.parent.name, "line": "handover start"}},
            {"wait": {"who": "drone-1", "event": "started"}},
        ]
    longest_s = _time_s(walk.duration_s)
    landed = {"wait_landed": True, "timeout_s": longest_s}
    if seed is None:
        head["description"] = "as its check says: " + " ".join(commanders)
        steps = [
            {"wait": {"who": "drone-1", "event": "transfer_committed", "station": name}, "timeout_s": longest_s}
            for name in commanders[1:]
        ]
        near = ["last_item"] if last in LANDINGS else ["home", "rally"]
        expect: list[dict[str, Any]] = [
            {"commanders": commanders},
            {"handovers": {"committed": len(commanders) - 1}},
            {"items_reached": "all"},
            {"landed": {"within_m": _WITHIN_M, "near": near}},
        ]
        if not package.gaps:
            expect.append({"emergencies": []})
        return scenario_text(head, [*start, *steps, landed], expect)
    luck = random.Random(seed)
    kind = luck.choice(sorted(KINDS))
    fault = KINDS[kind](package, commanders, luck)
    head |= {"description": f"faults {seed}: {fault.words}", **fault.keys}
    return scenario_text(head, [*start, *fault.steps, landed], fault.expect)


def _time_s(seconds: float) -> float:
    limit_s = _LONGER * seconds + _BESIDES_S
    if limit_s > _MOST_S:
        raise SetupError(f"the mission takes {seconds:.0f} s: longer than a simulation waits ({_MOST_S:g} s)")
    return round(limit_s, 1)


# ---- what may go wrong ----------------------------------------------------------------------------------------------


def _somewhere(package: MissionPackage, luck: random.Random) -> dict[str, Any]:
    """A waypoint on the way, not the first and not the last."""
    flown = [item.seq for item in package.route.items if COMMANDS[item.command].flown and item.has_place]
    inner = flown[1:-1] or flown[:1]
    return {"wait_reached": luck.choice(inner), "timeout_s": _time_s(package.simulate().duration_s)}


#: the aircraft is down where it may be, and its motors stand
_DOWN: Final[list[dict[str, Any]]] = [{"landed": {"within_m": _WITHIN_M, "near": _HOME_AGAIN}}]


def _companion_gone(package: MissionPackage, _commanders: Sequence[str], luck: random.Random) -> _Fault:
    steps = [_somewhere(package, luck), {"kill": "companion", "label": "gone"}]
    expect: list[dict[str, Any]] = [
        {"mode_within": {"mode": "RTL", "after": "gone", "within_s": 4.5}},
        {"said": "*lease lost*RTL*"},
        *_DOWN,
    ]
    return _Fault("the companion is killed and stays dead: the guard brings the aircraft home", steps, expect)


def _companion_crashes(package: MissionPackage, commanders: Sequence[str], luck: random.Random) -> _Fault:
    steps = [_somewhere(package, luck), {"crash": "companion"}]
    expect = [{"handovers": {"committed": len(commanders) - 1}}, *_DOWN]
    return _Fault("the companion's MAVProxy is killed, and is back in time: the mission goes on", steps, expect)


def _station_gone(package: MissionPackage, commanders: Sequence[str], luck: random.Random) -> _Fault:
    name = luck.choice(sorted(set(commanders)))
    steps = [_somewhere(package, luck), {"kill": name}]
    return _Fault(f"{name} is killed and stays dead: the aircraft crosses its zone without a commander", steps, _DOWN)


def _station_restarts(package: MissionPackage, commanders: Sequence[str], luck: random.Random) -> _Fault:
    name = luck.choice(sorted(set(commanders)))
    steps = [_somewhere(package, luck), {"kill": name}, {"pause_s": luck.choice([1, 2, 3])}, {"restart": name}]
    return _Fault(f"{name} is killed, and started again after a moment", steps, _DOWN)


def _bad_weather(_package: MissionPackage, commanders: Sequence[str], luck: random.Random) -> _Fault:
    loss = luck.choice([0.05, 0.1, 0.2])
    keys = {"impair": {"links": ["air", "ground"], "seed": luck.randrange(1000), "loss": loss}}
    expect: list[dict[str, Any]] = [
        {"handovers": {"committed": len(commanders) - 1}},
        {"emergencies": []},
        *_DOWN,
    ]
    return _Fault(f"every link loses {loss:.0%}: the mission is flown as its check says", [], expect, keys)


#: name -> what makes it
KINDS: Final[dict[str, Callable[[MissionPackage, Sequence[str], random.Random], _Fault]]] = {
    "bad weather": _bad_weather,
    "companion crashes": _companion_crashes,
    "companion gone": _companion_gone,
    "station gone": _station_gone,
    "station restarts": _station_restarts,
}


# ---- as text --------------------------------------------------------------------------------------------------------


def scenario_text(head: dict[str, Any], steps: Sequence[dict[str, Any]], expect: Sequence[dict[str, Any]]) -> str:
    """The text of a scenario file. `head`: the keys before the first step. Raises ScenarioError."""
    lines = [f"{key} = {_value(value)}" for key, value in head.items()]
    for name, tables in (("step", steps), ("expect", expect)):
        for table in tables:
            lines += ["", f"[[{name}]]", *(f"{key} = {_value(value)}" for key, value in table.items())]
    return "\n".join(lines) + "\n"


def _value(value: Any) -> str:
    """JSON's values are TOML's as well, but for tables."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {_value(each)}" for key, each in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_value, value)) + "]"
    try:
        return json.dumps(value, ensure_ascii=False)
    except TypeError as error:
        raise ScenarioError(f"{value!r}: {error}") from None
