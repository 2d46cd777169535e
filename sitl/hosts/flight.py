# SPDX-License-Identifier: GPL-3.0-or-later

"""The flight of the bench: a mission as its check says.

One path is cut in flight, and joined again after a handover. It is cut while the first commander flies the aircraft,
and stays cut until the next station commands. In between the commander stops the aircraft and continues the mission,
which only the other path can carry. A mission without a handover is refused, because the bench has to show one.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, Final

from mavproxy_handover.mission.package import MissionPackage
from sitl.hosts.plan import LINK_INTERFACES, PATHS
from sitl.script.own import own_scenario, scenario_text
from sitl.script.places import SetupError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

__all__ = ["CUT", "HEALED", "flight"]

#: labels of the moments
CUT, HEALED = "cut", "healed"
#: the path that has the downlink while both work: a cut of the other one moves no downlink
_BEST: Final = "wired"
#: keys of a scenario that are lists of tables
_TABLES: Final = ("step", "expect")
_ANSWER_WALL_S: Final = 10
#: a command of the commander, by the path that is left
_COMMANDS: Final = (("handover stop", "STOP", {"below_mps": 0.5}), ("handover continue", "CONTINUE", {"above_mps": 2}))


def flight(package: MissionPackage, folder: Path, cut: str) -> str:
    """The text of the scenario. `cut`: the path that is cut, "none" for neither. Raises SetupError."""
    data = tomllib.loads(own_scenario(package, folder))
    if "links" in data or data["begin"] != "start":
        raise SetupError(f"{folder}: the bench flies missions without gaps")
    steps, expect = list(data["step"]), list(data["expect"])
    parent, partner = package.parent.name, _next(steps, folder)
    names = [station.name for station in package.stations]
    head = {key: value for key, value in data.items() if key not in _TABLES}
    head["name"] = f"{package.name}-on-hosts"
    head["description"] = f"{package.name} on hosts of their own, " + (
        "no path is cut" if cut == "none" else f"the {cut} path is cut in flight"
    )
    head["links"] = {name: list(PATHS) for name in names}
    if cut != "none":
        steps = [*_while_cut(parent, cut), steps[0], _healing(cut, partner), *steps[1:]]
        link = {"who": "drone-1", "event": "link"}
        for name in names:
            cut_links = [f"*@{interface}" for interface in LINK_INTERFACES[cut]]
            degraded = {"change": "degraded", "station": name, "link": cut_links, "at_least": 1}
            expect.append({"count": {**link, **degraded}})
            if cut == _BEST:
                expect.append({"count": {**link, "change": "switched", "station": name, "at_least": 1}})
    expect += [
        {"count": {"event": "authority_lost", "count": 0}},
        {"count": {"who": parent, "event": "command", "result": "no answer", "count": 0}},
    ]
    return scenario_text(head, steps, expect)


def _next(steps: list[dict[str, Any]], folder: Path) -> str:
    """The station that the first handover is for. Raises SetupError."""
    wait = steps[0].get("wait", {})
    if wait.get("event") != "transfer_committed":
        raise SetupError(f"{folder}: its check foretells no handover, and the bench is there to show one")
    return str(wait["station"])


def _while_cut(parent: str, cut: str) -> list[dict[str, Any]]:
    steps: list[dict[str, Any]] = [
        {"wait_speed": {"above_mps": 3}, "timeout_s": 60},
        {"say": f"The {cut} path is cut, for all stations.", "impair": f"cut {cut}", "label": CUT},
        {"pause_s": 3},
    ]
    for line, what, speed in _COMMANDS:
        wait = {"who": parent, "event": "command", "what": what, "result": "accepted"}
        steps += [
            {"type": {"station": parent, "line": line}},
            {"wait": wait, "timeout_wall_s": _ANSWER_WALL_S},
            {"wait_speed": speed, "timeout_s": 60},
        ]
    return steps


def _healing(cut: str, partner: str) -> dict[str, Any]:
    return {"say": f"The {cut} path is joined again: {partner} commands.", "impair": f"heal {cut}", "label": HEALED}
