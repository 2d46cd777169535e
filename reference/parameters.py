# SPDX-License-Identifier: GPL-3.0-or-later

"""`parameters.md`: the guard's parameters, those that are recommended, and those that are read."""

from __future__ import annotations

import re
from collections.abc import Iterator

from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import GuardState
from mavproxy_handover.mission.items import MissionItem
from mavproxy_handover.monitors.preflight.own_failsafes import PlanFacts
from mavproxy_handover.monitors.preflight.rules import Found, judge
from mavproxy_handover.vehicle.profiles import COPTER, PLANE, QUADPLANE, Profile
from reference import ROOT
from reference.markdown import cell, code, page, table

__all__ = ["parameters"]

_LUA = ROOT / "ardupilot_lua"
_BLOCK = re.compile(r"--\[\[\n\s*// @Param: (\w+)\n(.*?)--\]\]\n.*?bind_add_param\(\"\w+\", \d+, (\S+)\)", re.DOTALL)
_TAG = re.compile(r"// @(\w+): (.+)")
_SET = re.compile(r"(?P<why>(?:#.*\n)+)(?P<name>[A-Z]\w*) (?P<value>\S+)\n")


#: columns of what is recommended
_COLUMNS = ("parameter", "value", "why")


def parameters() -> str:
    """The page."""
    guard = list(_guard())
    copter, wings = list(_recommended(COPTER)), list(_recommended(PLANE))
    assert min(len(guard), len(copter), len(wings)) > 0, "no parameters found: have the files another form?"
    return page(
        "Parameters of the autopilot",
        "## The guard's own",
        "They exist once `handover_guard.lua` has run; the defaults are the recommended values.",
        table(
            ("parameter", "default", "allowed", "meaning"),
            ((code(name), code(default), cell(allowed), cell(says)) for name, default, allowed, says in guard),
        ),
        "## Recommended for the others: a copter",
        "`ardupilot_lua/handover.parm` sets them (`handover guard` copies it to the card), for ArduCopter 4.5 to 4.7. "
        "It says as well what it leaves for you to decide.",
        table(_COLUMNS, ((code(name), code(value), cell(why)) for name, value, why in copter)),
        "## Recommended for the others: an aircraft with wings",
        "`ardupilot_lua/handover_plane.parm` sets them (`handover guard --vehicle plane` copies it), for ArduPlane, "
        "with rotors or without. It says as well what it leaves for you to decide.",
        table(_COLUMNS, ((code(name), code(value), cell(why)) for name, value, why in wings)),
        "## What the companion reads before a flight",
        "On the ground; it says what does not fit, at the companion (`handover status`), and so does `handover "
        "doctor`. Of two names of one thing a firmware has one. These are the companion's own words for "
        "values that do not fit, tried one after another; what has none is read for the sake of the others. "
        "Of an aircraft that flies by several `batteries` ([energy]) what is read of `BATT_` is read of `BATT2_` and "
        "so on as well, and the same is said of it.",
        table(("parameter", "what is said of it"), ((code(name), cell(_said(name))) for name in COPTER.reads)),
        "## What it reads of a plane besides",
        "Of ArduPlane, hovering or not. What is said of both in the same words stands above.",
        table(
            ("parameter", "what is said of it"),
            ((code(name), cell(said)) for name, said in _of_wings_alone()),
        ),
    )


def _of_wings_alone() -> Iterator[tuple[str, str]]:
    for name in PLANE.reads:
        said = _said(name, QUADPLANE)
        if name not in COPTER.reads or said not in ("", _said(name)):
            yield name, said


def _guard() -> Iterator[tuple[str, str, str, str]]:
    for name, body, default in _BLOCK.findall((_LUA / "handover_guard.lua").read_text(encoding="utf-8")):
        tags = dict(_TAG.findall(body))
        low, _, high = tags.get("Range", "").partition(" ")
        allowed = f"{low} to {high} {tags.get('Units', '')}".strip() if high else tags["Values"].replace(",", ", ")
        yield name, default, allowed, tags["Description"]


def _recommended(profile: Profile) -> Iterator[tuple[str, str, str]]:
    for found in _SET.finditer((_LUA / profile.parameter_file).read_text(encoding="utf-8")):
        yield found["name"], found["value"], found["why"].replace("#", " ")


#: values that are tried on each parameter, and a plan that asks something of the fence
_TRIED = (0, 0.3, 1, 2, 3, 4, 5, 6, 7, 16, 150, 20_000, -1)
_ITEM = MissionItem(5, 16, 10, 0.0, 0.0, 0.0, 0.0, 52.0, 5.0, 30.0)
_PLAN = PlanFacts(
    fence=True, inclusions=1, farthest_m=800.0, highest_m=60.0, above_terrain=(_ITEM,), ground=True, circle_deg_s=11.5
)


def _said(name: str, profile: Profile = COPTER) -> str:
    """What preflight says of it, one sentence of each kind, where all others are as recommended."""
    fits = {each: float(default) for each, default, *_rest in _guard()}
    fits |= {each: float(value) for each, value, _why in _recommended(profile)}
    fits |= {"HNDO_ALONE_MAX": 120.0, "BATT_MONITOR": 4.0, "BATT_LOW_VOLT": 10.5, "BATT_LOW_MAH": 0.0}
    fits |= {"FENCE_ENABLE": 1.0, "FENCE_TYPE": 7.0, "FENCE_RADIUS": 2000.0, "FENCE_ALT_MAX": 100.0}
    found: dict[str, str] = {}
    for guard in (GuardState.LIVE, GuardState.SILENT):
        for value in _TRIED:
            state = Found(fits | {name: float(value)}, guard, plan=_PLAN, gap_s=120.0, profile=profile)
            for finding in judge(state, Limits()):
                if finding.parameter == name:
                    found.setdefault(re.sub(r"[\d.-]+", "", finding.text), finding.text)
    return "; ".join(found.values())
