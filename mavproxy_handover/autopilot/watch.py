# SPDX-License-Identifier: GPL-3.0-or-later

"""What the autopilot says, taken in: the state of the aircraft, and events for the arbiter made of it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.autopilot.aircraft import Aircraft
from mavproxy_handover.autopilot.copter import COPTER_MODES
from mavproxy_handover.autopilot.loading import MissionLoader
from mavproxy_handover.autopilot.preflight import Preflight
from mavproxy_handover.autopilot.streams import Streams
from mavproxy_handover.core import events
from mavproxy_handover.core.model import ZoneFact
from mavproxy_handover.narrator import Narrator
from mavproxy_handover.wire.conversation import Conversations
from mavproxy_handover.wire.frames import Frame
from mavproxy_handover.wire.ids import COMPANION_COMPID, GUARD_STATUS_TUNNEL
from mavproxy_handover.wire.lease import GuardStatus, unpack_guard_status

__all__ = ["AutopilotWatch"]

#: the autopilot is asked for 20 positions a second; they come unevenly, so less than 50 ms is no reason to skip one
_ZONE_CHECK_S = 0.03
#: a position that has waited for longer, because the main loop stood still, does not count: another is on its way
_OLD_S = 0.2


class AutopilotWatch:
    """Listens to the autopilot of vehicle `sysid`. `nonce`: of our leases; `handle` gives an event to the arbiter."""

    def __init__(
        self,
        sysid: int,
        nonce: int,
        aircraft: Aircraft,
        loader: MissionLoader,
        conversations: Conversations,
        preflight: Preflight,
        streams: Streams,
        narrator: Narrator,
        handle: Callable[[events.Event, float], None],
    ) -> None:
        self._sysid = sysid
        self._nonce = nonce
        self._aircraft = aircraft
        self._loader = loader
        self._conversations = conversations
        self._preflight = preflight
        self._streams = streams
        self._narrator = narrator
        self._handle = handle
        self._heed: dict[str, Callable[[Any, float], None]] = {
            "HEARTBEAT": self._on_state,
            "EXTENDED_SYS_STATE": self._on_state,
            "GLOBAL_POSITION_INT": self._on_position,
            "TUNNEL": self._on_tunnel,
            "STATUSTEXT": lambda m, _now: preflight.text(m.text),
            "MISSION_ITEM_REACHED": lambda m, _now: self._on_reached(m.seq),
        }
        #: what the guard said last of itself
        self.guard_status: GuardStatus | None = None
        self._second_manager_told = False
        self._zones_at = 0.0
        #: a position came that no zone was compared to yet
        self.position_waits = False

    def take(self, message: Any, now: float) -> None:
        """A message of the autopilot itself."""
        aircraft = self._aircraft
        waypoint, mode = aircraft.waypoint, aircraft.custom_mode
        aircraft.take(message, now)
        if self._conversations and _for_companion(message, self._sysid):
            self._conversations.on_message(message, now)
        if aircraft.custom_mode != mode:
            name = COPTER_MODES.get(aircraft.custom_mode, f"mode {aircraft.custom_mode}")
            self._narrator.journal.write("mode", f"mode {name}", mode=name)
        if aircraft.waypoint != waypoint:
            text = f"flying to waypoint {aircraft.waypoint}"
            self._narrator.journal.write("waypoint", text, number=aircraft.waypoint)
        heed = self._heed.get(message.get_type())
        if heed is not None:
            heed(message, now)

    def second_manager(self, frame: Frame) -> None:
        """CONTROL_STATUS of somebody else on board. The stations must hear one voice: it goes no further."""
        manager = bool(frame.payload[0] & mavlink.GCS_CONTROL_STATUS_FLAGS_SYSTEM_MANAGER)
        if manager and not self._second_manager_told:
            self._second_manager_told = True
            text = f"component {frame.compid} claims to be the system manager too: switch its operator control off"
            self._narrator.journal.write("second_manager", text)
            self._narrator.tell(text[:1].upper() + text[1:] + ".")

    def zone_facts(self) -> tuple[ZoneFact, ...]:
        """Facts about every zone at the last position; none before there are mission and position."""
        finder, position = self._loader.finder, self._aircraft.position
        if finder is None or position is None:
            return ()
        where = position.lat / 1e7, position.lon / 1e7
        return finder.facts(*where, *self._aircraft.track, position.relative_alt / 1000.0)

    def check_zones(self, now: float) -> None:
        """Tell the arbiter where the last position is with respect to every zone."""
        self.position_waits = False
        if now - self._aircraft.position_at > _OLD_S:
            return
        self._streams.position_seen()
        self._handle(events.PositionSeen(self.zone_facts()), now)

    def _on_state(self, _message: Any, now: float) -> None:
        aircraft = self._aircraft
        if aircraft.heartbeat_at > -math.inf:  # before that nothing is known of arming: in flight it would read as no
            self._handle(events.AutopilotState(aircraft.armed, aircraft.flying), now)

    def _on_position(self, _message: Any, now: float) -> None:
        # the second: that message held no position
        if now - self._zones_at >= _ZONE_CHECK_S and self._aircraft.position_at == now:
            self._zones_at, self.position_waits = now, True

    def _on_tunnel(self, message: Any, now: float) -> None:
        if message.payload_type != GUARD_STATUS_TUNNEL:
            return
        status = unpack_guard_status(bytes(message.payload)[: message.payload_length])
        if status is None:
            return
        self.guard_status = status
        self._handle(events.GuardSeen(status.state, status.nonce == self._nonce), now)

    def _on_reached(self, number: int) -> None:
        journal = self._narrator.journal
        journal.write("reached", f"waypoint {number} reached", number=number)
        if number == self._loader.delivery:
            journal.write("delivery", f"delivery point (waypoint {number}) reached", number=number)
            self._narrator.tell(f"Delivery point reached, waypoint {number}.")


def _for_companion(message: Any, sysid: int) -> bool:
    """Whether a message is for the companion, among others at least."""
    system, component = getattr(message, "target_system", 0), getattr(message, "target_component", 0)
    return system in (0, sysid) and component in (0, COMPANION_COMPID)
