# SPDX-License-Identifier: GPL-3.0-or-later

"""The values that a station has heard from one vehicle: mode, arming, zone, return site, rehearsal. Pure.

`StationCore` keeps which station commands the vehicle. Times are monotonic seconds.
"""

from __future__ import annotations

from math import inf
from typing import Any

from pymavlink import mavutil
from pymavlink.dialects.v20 import handover as mavlink

from gcs_module.banner import OLD_S, Situation
from gcs_module.core import AuthorityHeard, Role, StationCore
from gcs_module.decisions import Who
from gcs_module.map_layer import place_of
from gcs_module.vehicle_addresses import SILENT_S
from mavproxy_handover.core.common.model import FlightAction, LeaseState, Phase, Reason
from mavproxy_handover.wire.ids import PAYLOAD_COMPIDS

__all__ = ["VehicleState"]


class VehicleState:
    """The last values that one vehicle has sent."""

    def __init__(self, core: StationCore) -> None:
        self._core = core
        #: the autopilot's last heartbeat says that it is disarmed
        self.disarmed = False
        #: the flight mode in the autopilot's last heartbeat, and when that heartbeat arrived
        self._mode, self._mode_at = "", -inf
        #: the station whose zone holds the aircraft, by the vehicle's status; None: the zone of no station
        self.zone: int | None = None
        #: name, latitude and longitude (degrees) of the return site, by the vehicle's last status
        self.return_site: tuple[str, float, float] | None = None
        #: time (s) that a return takes until the aircraft is on the ground, and the part of the battery that it needs,
        #: by the vehicle's last status; None: not known
        self.return_takes_s: float | None = None
        self.return_needs: float | None = None
        #: when the vehicle last said who commands it, and when its commander's zone ends; inf: no end is in sight
        self.authority_at, self.zone_ends_at = -inf, inf
        #: the vehicle flies another mission than that of its package
        self.rerouted = False
        #: a rehearsal on the ground is under way: the aircraft is carried
        self.rehearsal = False
        #: by kind of payload: the station that has it, None: no station; and when the vehicle last said it
        self._payload: dict[str, tuple[int | None, float]] = {}

    @property
    def mode(self) -> tuple[str, float]:
        """The mode in the autopilot's last heartbeat, and when that heartbeat arrived; -inf: never."""
        return self._mode, self._mode_at

    def on_heartbeat(self, m: Any, now: float) -> None:
        """A heartbeat of the autopilot."""
        self.disarmed = not m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        self._mode, self._mode_at = mavutil.mode_string_v10(m), now

    def on_payload(self, component: int, station: int | None, now: float) -> None:
        """A CONTROL_STATUS of a component of the payload; of any other component it is ignored."""
        kind = next((name for name, number in PAYLOAD_COMPIDS.items() if number == component), None)
        if kind is not None:
            self._payload[kind] = station, now

    @property
    def payload(self) -> tuple[tuple[str, str, float], ...]:
        """Each kind of payload, the station that has it, and when the vehicle last said it. Empty: it says nothing of
        it, so the payload is the commander's."""
        return tuple(
            (kind, self._core.name(station) if station else "no station", at)
            for kind, (station, at) in self._payload.items()
        )

    def on_authority(self, m: Any, now: float) -> AuthorityHeard:
        """An AUTHORITY_STATUS: keeps its zone and its return site, and returns the event for the rules."""
        self.zone, self.authority_at = m.zone or None, now
        self.zone_ends_at = now + m.zone_ends - 1.0 if m.zone_ends else inf
        self.return_site = place_of(m)
        self.return_takes_s = m.place_in - 1.0 if m.place_in else None
        self.return_needs = (m.place_needs - 1) / 100.0 if m.place_needs else None
        return AuthorityHeard(
            phase=Phase(m.phase) if m.phase in list(Phase) else Phase.EMERGENCY,
            commander=m.commander or None,
            partner=m.partner or None,
            epoch=m.epoch,
            handover_id=m.handover_id,
            recovering=m.lease == LeaseState.RECOVERING,
            why=Reason(m.transfer_reason) if m.transfer_reason in list(Reason) else Reason.NONE,
            zone=self.zone,
            zone_ends_s=m.zone_ends - 1.0 if m.zone_ends else inf,
            alone=m.lease == LeaseState.ALONE,
            answer_left_s=m.answer_left - 1.0 if m.answer_left else inf,
            crossing=m.crossing,
        )

    def armed(self, now: float) -> bool:
        """Whether the vehicle was heard within SILENT_S and its autopilot's last heartbeat does not say that it is
        disarmed.

        Autopilot or companion must have been heard; without any heartbeat of the autopilot the answer is no.
        """
        silent_s = min(now - self._mode_at, self._core.vehicle_silent_s(now))
        return self._mode_at > -inf and not self.disarmed and silent_s < SILENT_S

    @property
    def flown_from_here(self) -> bool:
        """Whether the aircraft is in flight and this station commands it."""
        return self._core.role is Role.COMMANDER and self._core.phase is not Phase.ON_LOAD

    @property
    def commanded_by(self) -> Who:
        """Whether this station, another one or no station commands."""
        if self._core.commander is None:
            return Who.NOBODY
        return Who.THIS if self._core.role is Role.COMMANDER else Who.OTHER

    def situation(self, now: float, action: FlightAction | None, of: str) -> Situation:
        """What the station knows of the vehicle now. `action`: what the vehicle does about what is wrong; `of`: the
        vehicle's name if the station has several, else ""."""
        core = self._core
        fresh = now - self._mode_at <= OLD_S and not self.disarmed
        ahead = core.ahead if core.partner is None else None
        return Situation(
            vehicle=core.vehicle_name,
            phase=core.phase,
            commander=core.name(core.commander) if core.commander else "",
            own=core.role is Role.COMMANDER,
            partner=core.name(core.partner) if core.partner else "",
            mode=self._mode if fresh else "",
            heard_s=core.vehicle_silent_s(now),
            action=action,
            left_s=core.answer_left_s(now),
            alone=core.alone,
            ahead=core.name(ahead.key.to_station) if ahead is not None else "",
            ahead_s=ahead.at - now if ahead is not None else inf,
            asked=core.asked_ahead is not None,
            of=of,
            rehearsal=self.rehearsal,
        )
