# SPDX-License-Identifier: GPL-3.0-or-later

"""A station's socket that shows states one after the other, to look at the panel with.

`python -m tests.gcs.panel_publisher STATE [--seconds 60] [--aircraft 1]` publishes a state of `SHOWN`; the panel is
`handover panel` in another terminal.
"""

from __future__ import annotations

import argparse
import time
from base64 import b64encode
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from gcs_module.panel.endpoint import open_endpoint
from gcs_module.panel.orders import Order, Reply
from gcs_module.panel.publisher import Publisher
from gcs_module.panel.snapshot import (
    AircraftSeen,
    AlarmSeen,
    LineSeen,
    LinkSeen,
    PeerSeen,
    ReturnSite,
    Stamped,
    StationSeen,
)
from mavproxy_handover.mission.package import MissionPackage, load
from tests.gcs.panel_states import BORDER, LOST, NOW, RETURNS, TAKE, craft, station
from tests.packages import ROUND

BRIEFING = (
    ("leg", "to waypoint 3; 52.67900 5.92600, 30 m above home, 5.0 m/s"),
    ("battery", "94% left; the way on needs 63% with the reserve; return to rally 2: 538 m, needs 11 % of 94 %"),
    ("wind", "4 m/s from 230 degrees"),
    ("links", "GCSA 0% lost, 3 ms; GCSB 0% lost, 12 ms"),
    ("alerts", "none"),
    ("next", "GCSB to GCSA in 40 s"),
)
LINES = (
    LineSeen(1, NOW - 62.0, 0, "START accepted."),
    LineSeen(2, NOW - 60.0, 0, "It is on mission."),
)
ASKED_LINES = (
    *LINES,
    LineSeen(3, NOW - 1.0, 2, "Handover GCSB -> GCSA of drone-1 in 40 s. Type 'handover accept' or 'handover deny'."),
)
WAITS = AlarmSeen(
    "question",
    2,
    "Handover GCSB -> GCSA of drone-1 in 40 s.",
    "The aircraft is about to reach your zone. You are asked whether you take it.",
    "Read the briefing. Accept or deny.",
    False,
    NOW - 1.0,
)
ASKED = {
    "commander": "GCSB",
    "own": False,
    "question": replace(TAKE, border_at=NOW + 38.4, until=NOW + 38.4),
    "lines": ASKED_LINES,
    "briefing": BRIEFING,
    "briefing_at": NOW - 1.0,
    "alarms": (WAITS,),
    "zone": "GCSB",
    "position": Stamped((52.67896, 5.93036), NOW - 0.2),
}
LOST_CRAFT = {
    "commander": "",
    "own": False,
    "phase": "emergency",
    "action": "return",
    "decision": "RETURN to rally 2. GCSB silent for 5 s. 145 m away, needs 6 % of the battery (94 % left).",
    "lines": (
        LineSeen(1, NOW - 90.0, 0, "GCSB is the commander of drone-1 now."),
        LineSeen(2, NOW - 2.0, 3, "RETURN to rally 2. GCSB silent for 5 s."),
    ),
    "alarms": (LOST, replace(RETURNS, acknowledged=True)),
    "mode": Stamped("RTL", NOW - 0.5),
    "return_site": ReturnSite("rally 2", 52.67918, 5.931984),
    "zone": "GCSB",
    "position": Stamped((52.67869, 5.93), NOW - 0.2),
    "battery_left_s": Stamped(1260.0, NOW - 0.6),
}
DENIED = AlarmSeen(
    "route",
    1,
    "GCSB has denied the handover GCSA -> GCSB.",
    "The operator of the next station has denied the handover at the border ahead.",
    "Talk to that operator. Stop the aircraft, or change the route.",
    True,
    NOW - 9.0,
)
ON_GROUND = {
    "phase": "on_load",
    "armed": Stamped(False, NOW - 0.5),
    "height_m": Stamped(0.0, NOW - 0.2),
    "speed_mps": Stamped(0.0, NOW - 0.2),
    "battery_percent": Stamped(100.0, NOW - 0.6),
    "position": Stamped((52.679, 5.924), NOW - 0.2),
    "lines": (LineSeen(1, NOW - 20.0, 0, "The vehicle has the mission 'round'."),),
}
#: word -> the changes to the aircraft of a normal flight
SHOWN: dict[str, dict[str, Any]] = {
    "normal": {"border": BORDER},
    "lost far": LOST_CRAFT,
    "lost here": {**LOST_CRAFT, "zone": "GCSA", "position": Stamped((52.67812, 5.92627), NOW - 0.2)},
    "observer": {
        "commander": "GCSB",
        "own": False,
        "zone": "GCSB",
        "position": Stamped((52.67808, 5.92882), NOW - 0.2),
        "zone_ends_at": None,
        "lines": (LineSeen(1, NOW - 30.0, 0, "GCSB is the commander of drone-1 now."),),
    },
    "handover": {
        "partner": "GCSB",
        "phase": "on_handover",
        "answer_until": NOW + 29.6,
        "position": Stamped((52.67812, 5.92627), NOW - 0.2),
        "lines": (LineSeen(1, NOW - 2.0, 0, "Handover GCSA to GCSB of drone-1 has begun."),),
    },
    "denied": {
        "border": replace(BORDER, at=NOW + 27.2, other="denied"),
        "alarms": (DENIED,),
        "position": Stamped((52.67836, 5.92478), NOW - 0.2),
        "lines": (LineSeen(1, NOW - 9.0, 1, DENIED.text),),
    },
    "override": {
        "border": BORDER,
        "overrides": (("energy", NOW + 47.6),),
        "battery_percent": Stamped(41.0, NOW - 0.6),
        "lines": (LineSeen(1, NOW - 12.4, 0, "OVERRIDE energy accepted."),),
    },
    "ground": ON_GROUND,
    "question": ASKED,
    "emergency": LOST_CRAFT,
    "old": {"heard_at": NOW - 5.0, "height_m": Stamped(30.0, NOW - 5.0), "speed_mps": Stamped(5.0, NOW - 14.0)},
}


def shifted(given: Any, by: float, name: str = "") -> Any:
    """A snapshot with all its times moved."""
    times = ("at", "since", "until", "asked_at")
    if isinstance(given, float) and (name in times or name.endswith(("_at", "_until"))):
        return given + by
    if name == "overrides":
        return tuple((limit, until + by) for limit, until in given)
    if isinstance(given, tuple):
        return tuple(shifted(each, by) for each in given)
    if hasattr(given, "__dataclass_fields__"):
        return replace(given, **{key: shifted(getattr(given, key), by, key) for key in given.__dataclass_fields__})
    return given


def fleet(state: str, count: int, digest: str) -> tuple[AircraftSeen, ...]:
    """So many aircraft: the first in this state, the others in states of all kinds."""
    links = (
        LinkSeen("udpin:0.0.0.0:14550", True, True, NOW - 0.1),
        LinkSeen("/dev/ttyUSB0", False, False, NOW - 20.0),
    )
    common = {"mission": digest, "links": links}
    kinds = [state, "normal", "observer", "normal", "ground", "observer", "old"]
    made = []
    for number in range(count):
        changes: dict[str, Any] = {**common, "lines": LINES, **SHOWN[kinds[number % len(kinds)] if number else state]}
        named: dict[str, Any] = {"sysid": number + 1, "name": f"drone-{number + 1}"}
        if number or "position" not in changes:
            named["position"] = Stamped((52.67865 + number * 2e-4, 5.9247 + number * 3e-4), NOW - 0.2)
        made.append(craft(**{**changes, **named}))
    return tuple(made)


class Fake:
    """A publisher of one state. `still`: the aircraft goes on being heard, so that only what should get old does."""

    def __init__(self, state: str, aircraft: int = 1, package: MissionPackage | None = None) -> None:
        held = load(ROUND) if package is None else package
        self.orders: list[Order] = []
        self._packages = {held.digest.hex(): b64encode(held.to_bytes()).decode()}
        peers = (PeerSeen("GCSB", True, NOW - 0.4, Stamped("Bakker", NOW - 0.4)),)
        self.snapshot = station(*fleet(state, aircraft, held.digest.hex()), peers=peers)
        #: places that are told first, one in each snapshot: the track of the first aircraft
        self.trail: list[tuple[float, float]] = []
        self._began = time.monotonic()
        self.publisher = Publisher(open_endpoint("GCSA"), self._seen, lambda: self._packages, self._carry_out)

    def _seen(self, now: float) -> StationSeen:
        """Aircraft go on being heard; questions and borders come nearer."""
        moved: StationSeen = shifted(self.snapshot, now - NOW)
        run = now - self._began
        aircraft = [replace(each, **_approach(each, -run)) for each in moved.aircraft]
        if self.trail and aircraft:
            aircraft[0] = replace(aircraft[0], position=Stamped(self.trail.pop(0), now))
        return replace(moved, aircraft=tuple(aircraft), at=now)

    def _carry_out(self, order: Order) -> Reply:
        self.orders.append(order)
        return Reply(order.number, True, f"{order.do.capitalize()} {order.argument}".strip() + ".")

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        """Publish for so long."""
        end = time.monotonic() + seconds
        while time.monotonic() < end and not until():
            self.publisher.tick(time.monotonic())
            time.sleep(0.02)


def _approach(each: AircraftSeen, by: float) -> dict[str, Any]:
    found: dict[str, Any] = {}
    if each.question is not None:
        found["question"] = shifted(each.question, by)
    if each.border is not None:
        found["border"] = shifted(each.border, by)
    if each.answer_until is not None:
        found["answer_until"] = each.answer_until + by
    if each.overrides:
        found["overrides"] = tuple((limit, until + by) for limit, until in each.overrides)
    return found


def main() -> None:
    """Publish a state until the time is over."""
    parser = argparse.ArgumentParser()
    parser.add_argument("state", choices=SHOWN)
    parser.add_argument("--aircraft", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=3600.0)
    arguments = parser.parse_args()
    fake = Fake(arguments.state, arguments.aircraft)
    try:
        fake.run(arguments.seconds)
    finally:
        fake.publisher.close()


if __name__ == "__main__":
    main()
