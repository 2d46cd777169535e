# SPDX-License-Identifier: GPL-3.0-or-later

"""Where the aircraft is: by the autopilot's word, or by the position box's, and whether that word counts.

Rules:

1. One source counts, the one that is configured (`[position]`). There is no falling back to the other one: when two
   disagree nobody knows which is right, and when one falls silent people have to know.
2. A position that does not count is not used at all: no zone, route, gap or border is judged by it, no station is told
   it. The position grows old by that, and what is done about that is the cause `position_stale`'s matter, as ever.
3. The box counts while its records come, in time, with a position, and agree with the autopilot's own
   (`cross_check.py`); for `unchecked_s` without anything to compare, once they have agreed, and only where the aircraft
   can have come since. A position of the autopilot without a fix is nothing to compare: it is a guess.
4. Where the autopilot is the source and there is a box, a disagreement takes the autopilot's word away as well. A box
   that is silent does not: nothing says that anything is wrong. What a silent box said last is forgotten on the ground.
5. The box counts only in the layout that is configured (`box_layout_watch.py`). On the ground that has to be recognised
   first; where the box is the source START is refused until then. Records of another layout are not used, START is
   refused, and in flight they are counted. They take nothing away from the autopilot, and what was compared before
   they were recognised is forgotten.
6. `check = "armed"`: a box is believed without the autopilot as long as the autopilot says that it is disarmed, for an
   aircraft that is carried, or stands under a roof.
7. A box without height above sea level leaves that to the autopilot; while the autopilot has no position, its last
   height goes on by the change of the box's (`box_heights.py`).
8. What keeps the autopilot's own motion (does it do what was ordered, what does it draw) goes by its own word.
9. Everybody is told when a source stops counting, and when it counts again.
"""

from __future__ import annotations

import math
from enum import Enum
from typing import Any, Final, Protocol

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.autopilot.box_heights import BoxHeights, slack_m
from mavproxy_handover.autopilot.box_layout_watch import LayoutWatch, Verdict
from mavproxy_handover.autopilot.cross_check import UNKNOWN_HEADING, CrossCheck, Difference, Place
from mavproxy_handover.autopilot.ties import Ties
from mavproxy_handover.config.position import ARMED, BOX, PositionSettings
from mavproxy_handover.core.never import assert_never
from mavproxy_handover.link.box_line import Fix
from mavproxy_handover.vehicle.state import VehicleState
from mavproxy_handover.wire.box_layout import BoxRecord

__all__ = ["Box", "PositionWatch", "Standing"]

#: positions of the autopilot come 20 times a second; one older than this is no match for a record that has just come
_FRESH_S: Final = 0.5
#: as `autopilot.py`: what an older heartbeat has said of arming does not count
_HEARTBEAT_S: Final = 2.5
#: without a record for so long a box is silent
_SILENT_S: Final = 1.0
#: what has changed is told so long after the last word at the earliest; and so long a box is waited for at first
_PAUSE_S: Final = 5.0
#: what bytes said of the layout counts for so long: a box whose records break the rules is connected to anew for each
_LAYOUT_S: Final = 5.0


class Box(Protocol):
    """The line to the box, as far as it is needed here (`link/box_line.py`)."""

    trouble: str

    def read(self) -> Fix | None:
        """The newest record since the last call."""

    def raw(self) -> bytes:
        """The bytes of the newest record since the last call, believed or not."""


class Standing(Enum):
    """How it stands with the box; in the words of the journal."""

    WAITED_FOR = "waited_for"
    SILENT = "silent"
    NO_POSITION = "no_position"
    LATE = "late"
    OTHER_LAYOUT = "other_layout"
    UNRECOGNISED = "unrecognised"
    UNCHECKED = "unchecked"
    #: the last pair was too far apart, and not for long enough yet to be a disagreement
    BEYOND = "beyond"
    APART = "apart"
    SOUND = "sound"


class PositionWatch:
    """Of one vehicle; `box` None: there is none. Times are monotonic seconds."""

    def __init__(self, settings: PositionSettings, aircraft: VehicleState, box: Box | None, ties: Ties) -> None:
        self._settings = settings
        self._aircraft = aircraft
        self._box = box
        self._ties = ties
        self._check = CrossCheck(settings)
        self._layout = LayoutWatch(settings.layout)
        self._heights = BoxHeights()
        #: the box is the source
        self.by_box = settings.source == BOX
        self._standing = self._told = Standing.WAITED_FOR
        self._told_at = -math.inf
        #: it is waited for until then, if it is not heard before
        self._waits_until = math.inf
        self._heard_at = -math.inf
        #: the same of a record that need not have been believed
        self._raw_at = -math.inf
        self._late_s = 0.0
        #: when the two agreed last, and where the box had it then
        self._agreed_at = -math.inf
        self._agreed: Place | None = None
        #: the autopilot's height above sea level when it was known last, and the box's then
        self._height_then: tuple[float, float] | None = None
        #: home, in metres above sea level, by the autopilot
        self._home_alt_m: float | None = None
        aircraft.trust_own(not self.by_box)

    # ---- what comes -------------------------------------------------------------------------------------------------

    def look(self, now: float) -> bool:
        """Read the box; whether there is a new position of the aircraft by it. To be called often."""
        if self._box is None:
            return False
        fix, raw = self._box.read(), self._box.raw()
        if raw:
            self._look_at_layout(raw, now)
        if fix is None:
            self._forget(now)
            return False
        self._heard_at, self._late_s = now, fix.late_s
        self._standing = self._judge(fix, now)
        self._aircraft.trust_own(not self.by_box and self._check.sound)
        if not self.by_box or not self._counts(now):
            return False
        self._aircraft.placed(self._position(fix.record), now)
        return True

    def _look_at_layout(self, raw: bytes, now: float) -> None:
        armed = self._aircraft.armed
        if now - self._raw_at > _LAYOUT_S and not armed:  # on the ground it may be another box by now
            self._layout = LayoutWatch(self._settings.layout)
        self._raw_at = now
        before = self._layout.verdict
        self._layout.look(raw, self._own(now), armed=armed)
        if self._layout.verdict is Verdict.OTHER and before is not Verdict.OTHER:
            self._check = CrossCheck(self._settings)
            self._aircraft.trust_own(not self.by_box)

    def _judge(self, fix: Fix, now: float) -> Standing:
        armed = self._aircraft.armed
        if self._layout.verdict is Verdict.OTHER:
            return Standing.OTHER_LAYOUT
        if not self._settings.layout.locates(fix.record):
            return Standing.NO_POSITION
        if not self._layout.known and not armed:
            return Standing.UNRECOGNISED
        if fix.late_s > self._settings.box_age_s:
            return Standing.LATE
        own, record = self._own(now), fix.record
        if own is not None:
            self._heights.look(record, own.alt_m, armed=armed)
        alt_m = self._heights.above_sea_m(record)
        theirs = Place(record.lat_deg, record.lon_deg, alt_m, record.north_mps, record.east_mps)
        if own is not None:
            self._height_then = own.alt_m, alt_m
            slack = slack_m(record, own.alt_m - (self._home_alt_m or 0.0))
            self._check.look(Difference.between(theirs, own, slack), now)
            if self._check.sound:
                self._agreed_at, self._agreed = now, theirs
        if not self._check.sound:
            return Standing.APART if self._check.apart else Standing.BEYOND
        believed = now - self._agreed_at <= self._settings.unchecked_s and self._can_have_come(theirs, now)
        return Standing.SOUND if believed else Standing.UNCHECKED

    def _can_have_come(self, there: Place, now: float) -> bool:
        """Whether the aircraft can be there, after where the two agreed last: as fast as it was then, or faster by
        twice the limit for its speed."""
        before, settings = self._agreed, self._settings
        if before is None:
            return False
        for_s, faster_mps = now - self._agreed_at, 2.0 * settings.apart_mps
        gone = Difference.between(there, before)
        speed_mps = math.hypot(before.north_mps, before.east_mps) + faster_mps
        near = gone.over_ground_m <= settings.apart_m + speed_mps * for_s
        return near and gone.height_m <= settings.apart_height_m + faster_mps * for_s

    def _counts(self, now: float) -> bool:
        """Whether the box's last record is where the aircraft is."""
        if self._standing in (Standing.UNCHECKED, Standing.BEYOND, Standing.APART):
            return self._lenient(now)
        return self._standing is Standing.SOUND

    def _own(self, now: float) -> Place | None:
        """The autopilot's word, where it is one to go by."""
        aircraft, position = self._aircraft, self._aircraft.telemetry.own_position.value
        if position is None or now - aircraft.telemetry.own_position.at > _FRESH_S or aircraft.dead_reckoning:
            return None
        self._home_alt_m = (position.alt - position.relative_alt) / 1000.0
        return Place.by_autopilot(position)

    def _lenient(self, now: float) -> bool:
        """Whether the box is believed whatever the autopilot says of the position."""
        aircraft = self._aircraft
        known = now - aircraft.telemetry.heartbeat.at < _HEARTBEAT_S
        return self._settings.check == ARMED and known and not aircraft.armed

    def _forget(self, now: float) -> None:
        """Rule 4: a box that only checks, and is silent, on the ground."""
        if self.by_box or self._check.sound or now - self._heard_at < _SILENT_S or self._aircraft.armed:
            return
        self._check = CrossCheck(self._settings)
        self._aircraft.trust_own(True)

    def _position(self, record: BoxRecord) -> Any:
        """The record in the form of the autopilot's own message, with the autopilot's home and time."""
        own, alt_m = self._aircraft.telemetry.own_position.value, self._height_m(record)
        if self._home_alt_m is None:  # the first that is known: it stands on the ground
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

    def _height_m(self, record: BoxRecord) -> float:
        """Above sea level: rule 7. Before the autopilot has told one it is 0."""
        if not math.isnan(record.alt_m):
            return record.alt_m
        if self._height_then is None:
            own = self._aircraft.telemetry.own_position.value
            return 0.0 if own is None else own.alt / 1000.0
        own_m, box_m = self._height_then
        climbed_m = self._heights.above_sea_m(record) - box_m
        return own_m if math.isnan(climbed_m) else own_m + climbed_m

    # ---- what is told -----------------------------------------------------------------------------------------------

    def standing(self, now: float) -> Standing:
        """How it stands with the box now."""
        if self._layout.verdict is Verdict.OTHER and now - self._raw_at <= _LAYOUT_S:
            return Standing.OTHER_LAYOUT
        if now - self._heard_at <= _SILENT_S:
            return self._standing
        return Standing.WAITED_FOR if self._heard_at == -math.inf and now < self._waits_until else Standing.SILENT

    def each_second(self, now: float) -> None:
        """Tell everybody what has changed."""
        if self._box is None:
            return
        if self._waits_until == math.inf:
            self._waits_until = now + _PAUSE_S
        standing, before = self.standing(now), self._told
        if standing in (before, Standing.BEYOND) or now - self._told_at < _PAUSE_S:
            return
        if standing is Standing.UNRECOGNISED and not self._layout.enough:
            return
        self._told, self._told_at = standing, now
        text = self.words(now)
        self._ties.narrator.position_source(text, self._settings.source, standing.value)
        if before is Standing.WAITED_FOR and standing is Standing.SOUND:  # as it should be: nobody has to be told
            return
        severity = mavlink.MAV_SEVERITY_NOTICE if standing is Standing.SOUND else mavlink.MAV_SEVERITY_WARNING
        self._ties.voice.say_to_all(text, severity)

    def lacks(self, now: float) -> str:
        """Why START is refused for the box's layout, in words; "" if it is not."""
        standing = self.standing(now)
        refused = standing is Standing.OTHER_LAYOUT or (standing is Standing.UNRECOGNISED and self.by_box)
        return f"position box {self._layout.words}" if refused and self._layout.words else ""

    def words(self, now: float) -> str:
        """How it stands with the box, for people; "" without one."""
        if self._box is None:
            return ""
        standing = self.standing(now)
        why = f" ({self._box.trouble})" if self._box.trouble else ""
        match standing:
            case Standing.WAITED_FOR:
                text = f"not heard yet{why}"
            case Standing.SILENT:
                text = f"silent{why}"
            case Standing.NO_POSITION:
                text = "has no position"
            case Standing.LATE:
                text = f"{self._late_s:.1f} s late (limit {self._settings.box_age_s:g} s)"
            case Standing.OTHER_LAYOUT | Standing.UNRECOGNISED:
                text = f"{self._layout.words}{self._layout.count_words}"
            case Standing.UNCHECKED:
                text = "cannot be checked by the autopilot's position"
            case Standing.BEYOND | Standing.APART:
                text = f"and autopilot {self._check.words}"
            case Standing.SOUND:
                last = self._check.last
                near = "" if last is None else f", {last.over_ground_m:.1f} m from the autopilot's position"
                text = f"in order{near}"
            case _:
                assert_never(standing)
        return f"position box {text}{self._consequence(standing, now)}"

    def _consequence(self, standing: Standing, now: float) -> str:
        if self.by_box:
            silent = standing in (Standing.WAITED_FOR, Standing.SILENT)
            return ": no position counts" if silent or not self._counts(now) else ""
        return "" if self._check.sound else ": no position counts"
