# SPDX-License-Identifier: GPL-3.0-or-later

"""Judges LANDING_TARGET of onboard programs: it corrects a landing, and neither leads it away nor keeps it from ending.

ArduCopter (4.7-dev) follows a target that is always 2 m ahead while it comes down: it landed 67 m away. On the ground
it leans towards that target. Its land detector takes a lean of more than 15 degrees for flight, so it stayed armed. A
target farther away than PLND_XY_DIST_MAX stops the descent. So while the aircraft lands, in any mode:

1. A target more than `TARGETS` times the limit from the aircraft does not pass.
2. No target passes while the aircraft is farther from where the landing began than the limit (`landing_m`).
3. No target passes after the aircraft has stood for `STANDS_S`: it is on the ground, or the target holds it in the air.
   Targets pass again when it moves.

Without targets ArduCopter goes straight down after 2 s, except with PLND_STRICT 2. While the aircraft does not land,
targets pass: the autopilot does not follow them then.
"""

from __future__ import annotations

import math
from typing import Final

from mavproxy_handover.gate.judge import GateReason
from mavproxy_handover.mission.geodesy import distance_m
from mavproxy_handover.vehicle.state import VehicleState
from mavproxy_handover.wire.frames import Frame, field_float, field_int

__all__ = ["STANDS_S", "TARGETS", "LandingTargets"]

TARGETS: Final = 2.0
STANDS_S: Final = 5.0
#: slower than this (m/s) is standing: with a target in sight ArduCopter comes down at 0.1 m/s and more
_STANDS_MPS: Final = 0.07
#: a camera sees no target farther from its axis than this (rad)
_MOST_RAD: Final = math.radians(80.0)


class LandingTargets:
    """Of one vehicle. Times are monotonic seconds."""

    def __init__(self, aircraft: VehicleState) -> None:
        self._aircraft = aircraft
        #: latitude and longitude (degrees) of where the landing began; None: it does not land
        self._began: tuple[float, float] | None = None
        #: when it moved last
        self._moved_at = -math.inf

    def judge(self, frame: Frame, within_m: float, now: float) -> GateReason:
        """Whether a LANDING_TARGET passes. `within_m`: how far it may lead a landing."""
        aircraft, where = self._aircraft, self._aircraft.where
        if not aircraft.armed or not aircraft.lands:
            self._began = None
            return GateReason.ALLOWED
        if where is None:
            return GateReason.LANDING_AWAY
        if self._began is None:
            self._began, self._moved_at = where[:2], now
        if self._moves():
            self._moved_at = now
        if now - self._moved_at > STANDS_S:
            return GateReason.LANDING_HELD
        away_m = distance_m(*self._began, *where[:2])
        if away_m > within_m or not _offset_m(frame, where[2]) <= TARGETS * within_m:
            return GateReason.LANDING_AWAY
        return GateReason.ALLOWED

    def _moves(self) -> bool:
        position = self._aircraft.telemetry.own_position.value
        climb_mps = 0.0 if position is None else position.vz / 100.0
        return math.hypot(self._aircraft.own_speed_mps, climb_mps) > _STANDS_MPS


def _offset_m(frame: Frame, height_m: float) -> float:
    """How far from the aircraft a target is (m), over ground; may be infinite or no number."""
    if field_int(frame, "position_valid"):
        return math.hypot(field_float(frame, "x"), field_float(frame, "y"))
    angles = field_float(frame, "angle_x"), field_float(frame, "angle_y")
    if not all(abs(angle) <= _MOST_RAD for angle in angles):
        return math.inf
    slope = math.hypot(*map(math.tan, angles))
    distance = field_float(frame, "distance")
    return distance * slope / math.hypot(1.0, slope) if distance > 0.0 else abs(height_m) * slope
