# SPDX-License-Identifier: GPL-3.0-or-later

"""The position monitor: which source of the position counts (autopilot or position box), and whether it counts now.

Rules:

1. Only the configured source counts (`[position]`). There is no fallback to the other one: if two sources disagree, it
   is not known which is right, and if one falls silent, people must know.
2. A position that does not count is not used: not for zones, route, gaps and borders, and no station gets it. So the
   position grows old, and the cause `position_stale` handles it: by default with a warning, never with a return.
3. The box counts while its records come in time, hold a position, and agree with the autopilot's position
   (`cross_check.py`). Once they have agreed, the box counts for `unchecked_s` without a comparison, if the aircraft can
   have reached the place since. A position of the autopilot without a fix is an estimate, and is not compared.
4. If the autopilot is the source and there is a box, the autopilot's position does not count during a disagreement
   either. A silent box is no disagreement. On the ground the last record of a silent box is forgotten.
5. The box counts only in the configured layout (`box_layout_watch.py`). On the ground the layout must be recognised
   first; if the box is the source, START is refused until then. Records of another layout are not used, and START is
   refused; in flight they are counted. They do not affect the autopilot's position. Comparisons made before the other
   layout was recognised are forgotten.
6. `check = "armed"`: the box is believed without a comparison while the autopilot reports that it is disarmed. This is
   for an aircraft that is carried or stands under a roof.
7. A box without height above sea level uses the autopilot's height. While the autopilot has no position, its last
   height follows the change of the box's height (`box_heights.py`).
8. Checks of the autopilot's own motion (orders carried out, power draw) use the autopilot's own position.
9. Every station is told when a source stops counting, and when it counts again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import Any, Final, Protocol

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.config.position import ARMED, BOX, PositionSettings
from mavproxy_handover.core.common.events import BoxJudged, Event
from mavproxy_handover.core.common.never import assert_never
from mavproxy_handover.link.box_line import Fix
from mavproxy_handover.monitors.position.box_heights import BoxHeights, slack_m
from mavproxy_handover.monitors.position.box_layout_watch import LayoutWatch, Verdict
from mavproxy_handover.monitors.position.cross_check import UNKNOWN_HEADING, CrossCheck, Difference, Place
from mavproxy_handover.vehicle.state import VehicleState
from mavproxy_handover.wire.box_layout import BoxRecord

__all__ = ["Box", "BoxNews", "BoxState", "PositionMonitor"]

#: positions of the autopilot come 20 times a second; one older than this is no match for a record that has just come
_FRESH_S: Final = 0.5
#: arming by a heartbeat older than this (s) does not count, as in `operator/vehicle/messages.py`
_HEARTBEAT_S: Final = 2.5
#: without a record for this time (s) a box is silent
_SILENT_S: Final = 1.0
#: least interval (s) of the messages; and the time (s) to wait for a box at first
_PAUSE_S: Final = 5.0
#: a judgement of the layout counts for this time (s): the line to a box with invalid records is reopened each time
_LAYOUT_S: Final = 5.0


class Box(Protocol):
    """The part of the line to the box that is needed here (`link/box_line.py`)."""

    trouble: str

    def read(self) -> Fix | None:
        """The newest record since the last call."""

    def raw(self) -> bytes:
        """The bytes of the newest record since the last call, believed or not."""


class BoxState(Enum):
    """The state of the box, in the words of the journal."""

    WAITED_FOR = "waited_for"
    SILENT = "silent"
    NO_POSITION = "no_position"
    LATE = "late"
    OTHER_LAYOUT = "other_layout"
    UNRECOGNISED = "unrecognised"
    UNCHECKED = "unchecked"
    #: the last pair was too far apart, but not yet long enough for a disagreement
    BEYOND = "beyond"
    APART = "apart"
    SOUND = "sound"


@dataclass(frozen=True, slots=True)
class BoxNews:
    """The state of the box has changed. `source`: the source that counts; `severity`: of the text to the stations,
    None: they are not told."""

    text: str
    source: str
    standing: str
    severity: int | None


class _Agreement:
    """The position of the box when both sources last agreed, with its time."""

    def __init__(self, settings: PositionSettings) -> None:
        self._settings = settings
        self._at = -math.inf
        self._place: Place | None = None

    def note(self, place: Place, now: float) -> None:
        """Note that both sources agree."""
        self._at, self._place = now, place

    def covers(self, there: Place, now: float) -> bool:
        """Whether the last agreement is at most `unchecked_s` old, and the aircraft can have reached this place.

        It may have flown at its speed of then, plus twice the limit for the speed.
        """
        before, settings = self._place, self._settings
        for_s, faster_mps = now - self._at, 2.0 * settings.apart_mps
        if before is None or for_s > settings.unchecked_s:
            return False
        gone = Difference.between(there, before)
        speed_mps = math.hypot(before.north_mps, before.east_mps) + faster_mps
        near = gone.over_ground_m <= settings.apart_m + speed_mps * for_s
        return near and gone.height_m <= settings.apart_height_m + faster_mps * for_s


class _Told:
    """The state of the box that people and the rules were told last."""

    def __init__(self) -> None:
        self.box_state = BoxState.WAITED_FOR
        self.at = -math.inf
        #: why START is refused for it
        self.lacks = ""


class PositionMonitor:
    """The position monitor of one vehicle. `box` None: there is no box. Times are monotonic seconds."""

    def __init__(self, settings: PositionSettings, state: VehicleState, box: Box | None) -> None:
        self._settings = settings
        self._box = box
        self._check = CrossCheck(settings)
        self._layout = LayoutWatch(settings.layout)
        self._heights = BoxHeights()
        self._agreement = _Agreement(settings)
        self._told = _Told()
        #: the box is the source
        self.by_box = settings.source == BOX
        self._box_state = BoxState.WAITED_FOR
        #: until then a box that was never heard is waited for
        self._waits_until = math.inf
        self._heard_at = -math.inf
        #: time of the last record, valid or not
        self._raw_at = -math.inf
        self._late_s = 0.0
        #: home, in metres above sea level, by the autopilot
        self._home_alt_m: float | None = None
        state.trust_own(not self.by_box)

    # ---- records ----------------------------------------------------------------------------------------------------

    def read(self, state: VehicleState, now: float) -> list[Event]:
        """Read the box, and set the position of the state if the box counts; to be called often.

        Returns what START lacks for the box, when that changes.
        """
        if self._box is None:
            return []
        self._read(self._box, state, now)
        lacks = self.lacks(now)
        if lacks == self._told.lacks:
            return []
        self._told.lacks = lacks
        return [BoxJudged(lacks)]

    def _read(self, box: Box, state: VehicleState, now: float) -> None:
        fix, raw = box.read(), box.raw()
        if raw:
            self._judge_layout(raw, state, now)
        if fix is None:
            self._forget(state, now)
            return
        self._heard_at, self._late_s = now, fix.late_s
        self._box_state = self._judge(fix, state, now)
        state.trust_own(not self.by_box and self._check.sound)
        if self.by_box and self._counts(state, now):
            state.placed(self._position(fix.record, state), now)

    def _judge_layout(self, raw: bytes, state: VehicleState, now: float) -> None:
        armed = state.armed
        if now - self._raw_at > _LAYOUT_S and not armed:  # on the ground the box may have been replaced
            self._layout = LayoutWatch(self._settings.layout)
        self._raw_at = now
        before = self._layout.verdict
        self._layout.judge(raw, self._own(state, now), armed=armed)
        if self._layout.verdict is Verdict.OTHER and before is not Verdict.OTHER:
            self._check = CrossCheck(self._settings)
            state.trust_own(not self.by_box)

    def _judge(self, fix: Fix, state: VehicleState, now: float) -> BoxState:
        armed = state.armed
        if self._layout.verdict is Verdict.OTHER:
            return BoxState.OTHER_LAYOUT
        if not self._settings.layout.locates(fix.record):
            return BoxState.NO_POSITION
        if not self._layout.known and not armed:
            return BoxState.UNRECOGNISED
        if fix.late_s > self._settings.box_age_s:
            return BoxState.LATE
        own, record = self._own(state, now), fix.record
        if own is not None:
            self._heights.level(record, own.alt_m, armed=armed)
        alt_m = self._heights.above_sea_m(record)
        theirs = Place(record.lat_deg, record.lon_deg, alt_m, record.north_mps, record.east_mps)
        if own is not None:
            slack = slack_m(record, own.alt_m - (self._home_alt_m or 0.0))
            self._check.compare(Difference.between(theirs, own, slack), now)
            if self._check.sound:
                self._agreement.note(theirs, now)
        if not self._check.sound:
            return BoxState.APART if self._check.apart else BoxState.BEYOND
        return BoxState.SOUND if self._agreement.covers(theirs, now) else BoxState.UNCHECKED

    def _counts(self, state: VehicleState, now: float) -> bool:
        """Whether the box's last record counts."""
        if self._box_state in (BoxState.UNCHECKED, BoxState.BEYOND, BoxState.APART):
            return self._lenient(state, now)
        return self._box_state is BoxState.SOUND

    def _own(self, state: VehicleState, now: float) -> Place | None:
        """The autopilot's position, if it can be compared; else None."""
        position = state.telemetry.own_position.value
        if position is None or now - state.telemetry.own_position.at > _FRESH_S or state.dead_reckoning:
            return None
        self._home_alt_m = (position.alt - position.relative_alt) / 1000.0
        return Place.by_autopilot(position)

    def _lenient(self, state: VehicleState, now: float) -> bool:
        """Whether the box is believed without a comparison."""
        known = now - state.telemetry.heartbeat.at < _HEARTBEAT_S
        return self._settings.check == ARMED and known and not state.armed

    def _forget(self, state: VehicleState, now: float) -> None:
        """Forget the comparisons with a silent box that is not the source, on the ground (rule 4)."""
        if self.by_box or self._check.sound or now - self._heard_at < _SILENT_S or state.armed:
            return
        self._check = CrossCheck(self._settings)
        state.trust_own(True)

    def _position(self, record: BoxRecord, state: VehicleState) -> Any:
        """The record in the form of the autopilot's own message, with the autopilot's home and time."""
        own = state.telemetry.own_position.value
        # before the autopilot has sent a height, 0 is used
        alt_m = self._heights.followed_m(record, 0.0 if own is None else own.alt / 1000.0)
        if self._home_alt_m is None:  # the first known height: the aircraft stands on the ground
            self._home_alt_m = alt_m
        heading, down_mps = record.heading_deg, record.down_mps
        if math.isnan(down_mps):
            down_mps = 0.0 if own is None else own.vz / 100.0
        return mavlink.MAVLink_global_position_int_message(
            0 if own is None else own.time_boot_ms,
            round(record.lat_deg * 1e7),
            round(record.lon_deg * 1e7),
            round(alt_m * 1000.0),
            round((alt_m - self._home_alt_m) * 1000.0),
            round(record.north_mps * 100.0),
            round(record.east_mps * 100.0),
            round(down_mps * 100.0),
            UNKNOWN_HEADING if math.isnan(heading) else round(heading * 100.0) % 36_000,
        )

    # ---- messages ---------------------------------------------------------------------------------------------------

    def box_state(self, now: float) -> BoxState:
        """The state of the box now."""
        if self._layout.verdict is Verdict.OTHER and now - self._raw_at <= _LAYOUT_S:
            return BoxState.OTHER_LAYOUT
        if now - self._heard_at <= _SILENT_S:
            return self._box_state
        return BoxState.WAITED_FOR if self._heard_at == -math.inf and now < self._waits_until else BoxState.SILENT

    def update(self, state: VehicleState, now: float) -> list[BoxNews]:
        """Returns news when the state of the box has changed; to be called each second."""
        if self._box is None:
            return []
        if self._waits_until == math.inf:
            self._waits_until = now + _PAUSE_S
        box_state, before = self.box_state(now), self._told.box_state
        if box_state in (before, BoxState.BEYOND) or now - self._told.at < _PAUSE_S:
            return []
        if box_state is BoxState.UNRECOGNISED and not self._layout.enough:
            return []
        self._told.box_state, self._told.at = box_state, now
        severity: int | None = mavlink.MAV_SEVERITY_WARNING
        if box_state is BoxState.SOUND:  # normal: not told the first time
            severity = None if before is BoxState.WAITED_FOR else mavlink.MAV_SEVERITY_NOTICE
        return [BoxNews(self.words(state, now), self._settings.source, box_state.value, severity)]

    def lacks(self, now: float) -> str:
        """Why START is refused for the box's layout, in words; "" if it is not."""
        box_state = self.box_state(now)
        refused = box_state is BoxState.OTHER_LAYOUT or (box_state is BoxState.UNRECOGNISED and self.by_box)
        return f"position box {self._layout.words}" if refused and self._layout.words else ""

    def words(self, state: VehicleState, now: float) -> str:
        """The state of the box, for people; "" without a box."""
        if self._box is None:
            return ""
        box_state = self.box_state(now)
        why = f" ({self._box.trouble})" if self._box.trouble else ""
        match box_state:
            case BoxState.WAITED_FOR:
                text = f"not heard yet{why}"
            case BoxState.SILENT:
                text = f"silent{why}"
            case BoxState.NO_POSITION:
                text = "has no position"
            case BoxState.LATE:
                text = f"{self._late_s:.1f} s late (limit {self._settings.box_age_s:g} s)"
            case BoxState.OTHER_LAYOUT | BoxState.UNRECOGNISED:
                text = f"{self._layout.words}{self._layout.count_words}"
            case BoxState.UNCHECKED:
                text = "cannot be checked by the autopilot's position"
            case BoxState.BEYOND | BoxState.APART:
                text = f"and autopilot {self._check.words}"
            case BoxState.SOUND:
                last = self._check.last
                near = "" if last is None else f", {last.over_ground_m:.1f} m from the autopilot's position"
                text = f"in order{near}"
            case _:
                assert_never(box_state)
        return f"position box {text}{self._consequence(box_state, state, now)}"

    def _consequence(self, box_state: BoxState, state: VehicleState, now: float) -> str:
        if self.by_box:
            silent = box_state in (BoxState.WAITED_FOR, BoxState.SILENT)
            return ": no position is used" if silent or not self._counts(state, now) else ""
        return "" if self._check.sound else ": no position is used"
