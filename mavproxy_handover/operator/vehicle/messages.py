# SPDX-License-Identifier: GPL-3.0-or-later

"""The autopilot's messages: each one updates the state, then goes to the parts that need it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.events import AutopilotState
from mavproxy_handover.monitors.energy import EnergyMonitor
from mavproxy_handover.monitors.mode_and_motion import ModeAndMotionMonitor
from mavproxy_handover.monitors.reboots import RebootMonitor
from mavproxy_handover.monitors.waypoints import WaypointMonitor
from mavproxy_handover.operator.base.context import Context
from mavproxy_handover.operator.base.output_dispatcher import OutputDispatcher
from mavproxy_handover.operator.checks.command_check import CommandCheck
from mavproxy_handover.operator.checks.preflight import Preflight
from mavproxy_handover.operator.orders import Orders
from mavproxy_handover.operator.return_site.return_site import ReturnSite
from mavproxy_handover.operator.uploads.mission_on_board import MissionOnBoard
from mavproxy_handover.operator.vehicle.guard import Guard
from mavproxy_handover.operator.vehicle.speed_restorer import SpeedRestorer
from mavproxy_handover.operator.vehicle.streams import Streams
from mavproxy_handover.tools.schedule import attempt
from mavproxy_handover.wire.frames import Frame
from mavproxy_handover.wire.ids import COMPANION_COMPID, EVERYBODY

__all__ = ["AutopilotMessages", "MessageMonitors", "MessageUsers"]

#: after this time (s) without a heartbeat, arming and mode are not known
_HEARTBEAT_S: Final = 2.5
#: for operators; a STATUSTEXT has 50 bytes
_RESTARTED: Final = "Autopilot restarted in flight. Check the aircraft."


@dataclass(frozen=True, slots=True)
class MessageMonitors:
    """The monitors that read single messages."""

    mode_and_motion: ModeAndMotionMonitor
    energy: EnergyMonitor
    waypoints: WaypointMonitor
    reboots: RebootMonitor


@dataclass(frozen=True, slots=True)
class MessageUsers:
    """The other parts that need single messages, or changes of mode and waypoint."""

    guard: Guard
    preflight: Preflight
    streams: Streams
    orders: Orders
    return_site: ReturnSite
    command_check: CommandCheck
    speeds: SpeedRestorer


class AutopilotMessages:
    """Handles the messages of one vehicle's autopilot. Times are monotonic seconds."""

    def __init__(
        self,
        sysid: int,
        context: Context,
        dispatcher: OutputDispatcher,
        monitors: MessageMonitors,
        users: MessageUsers,
        mission: MissionOnBoard,
    ) -> None:
        self._sysid = sysid
        self._context = context
        self._state = context.state
        self._reports = context.reports
        self._dispatcher = dispatcher
        self._monitors = monitors
        self._users = users
        self._mission = mission
        self._second_manager_told = False
        self._uses: dict[str, Callable[[Any, float], None]] = {
            "HEARTBEAT": self._on_state,
            "EXTENDED_SYS_STATE": self._on_state,
            "GLOBAL_POSITION_INT": self._on_position,
            "TUNNEL": self._on_tunnel,
            "STATUSTEXT": self._on_text,
            "PARAM_VALUE": users.return_site.on_message,
            "HOME_POSITION": users.return_site.on_message,
            "BATTERY_STATUS": self._on_energy,
            "WIND": self._on_energy,
            "MISSION_ITEM_REACHED": self._on_reached,
        }

    def on_message(self, message: Any, now: float) -> None:
        """A message of the autopilot itself."""
        state, event_log, users = self._state, self._reports.event_log, self._users
        if self._monitors.reboots.seen(message, state.flying, now):
            self._tell_restart(now)
        waypoint, mode, known = state.waypoint, state.custom_mode, state.telemetry.heartbeat.at > -math.inf
        on_mission = state.flies_mission
        state.on_message(message, now)
        conversations = self._context.conversations
        if conversations and _for_companion(message, self._sysid):
            conversations.on_message(message, now)
            attempt(self._reports.fault, "mission read back", self._mission.check_read_back, now)
        if state.custom_mode != mode:
            event_log.mode(state.profile.mode_name(state.custom_mode))
            if known:
                users.orders.mode_changed()
                users.command_check.mode_changed()
        if known and state.flies_mission is not on_mission:
            users.speeds.mission_flown(now)
        if known and state.custom_mode != mode:
            users.speeds.mode_changed(now)
        if state.waypoint != waypoint:
            event_log.waypoint(state.waypoint)
            self._monitors.waypoints.flies_on()
        use = self._uses.get(message.get_type())
        if use is not None:
            use(message, now)

    def second_manager(self, frame: Frame) -> None:
        """CONTROL_STATUS of another component of the vehicle. The journal says so once; the gate keeps it from the
        stations."""
        manager = bool(frame.payload[0] & mavlink.GCS_CONTROL_STATUS_FLAGS_SYSTEM_MANAGER)
        if manager and not self._second_manager_told:
            self._second_manager_told = True
            self._reports.event_log.second_manager(frame.compid)

    def _tell_restart(self, now: float) -> None:
        """The autopilot has restarted. In flight, operators must know it: the autopilot may say that it is disarmed."""
        self._users.return_site.autopilot_restarted(now)
        if self._monitors.reboots.in_flight(now):
            self._reports.event_log.autopilot_restarted(_RESTARTED)
            self._reports.message_sender.say_to_all(_RESTARTED, mavlink.MAV_SEVERITY_CRITICAL)
        else:
            self._reports.event_log.autopilot_restarted("the autopilot has started again")

    def _on_state(self, message: Any, now: float) -> None:
        attempt(self._reports.fault, "return sites", self._users.return_site.on_message, message, now)
        # without a recent heartbeat, arming and mode may have changed
        if now - self._state.telemetry.heartbeat.at < _HEARTBEAT_S:
            # the mode comes first: what is flown already is not ordered again
            attempt(self._reports.fault, "motion", self._tell_mode_and_motion, now)
            self._context.authority.handle(self.autopilot_state(), now)

    def _tell_mode_and_motion(self, now: float) -> None:
        self._dispatcher.dispatch(self._monitors.mode_and_motion.on_state(self._state, now), now)

    def autopilot_state(self) -> AutopilotState:
        """The event for the rules: armed, flying, the kind of aircraft, and the room that it needs to hold."""
        state = self._state
        is_one = state.armed, state.flying, state.foreign
        room = (state.circles_s, state.circle_m) if state.flying else (0.0, 0.0)
        return AutopilotState(*is_one, state.profile.handling, *room)

    def _on_text(self, message: Any, now: float) -> None:
        self._users.preflight.text(message.text)
        self._dispatcher.dispatch(self._monitors.mode_and_motion.text(self._state, message.text), now)

    def _on_position(self, _message: Any, now: float) -> None:
        if self._state.telemetry.own_position.at == now:  # else the message held no position
            self._users.streams.position_seen()

    def _on_tunnel(self, message: Any, now: float) -> None:
        found, status = self._users.guard.on_tunnel(message, now)
        self._dispatcher.dispatch(found, now)
        if status is not None:
            self._dispatcher.dispatch(self._monitors.mode_and_motion.guard(status), now)

    def _on_energy(self, message: Any, now: float) -> None:
        state = self._state  # before the first heartbeat, arming is not known
        on_ground = not state.armed and state.telemetry.heartbeat.at > -math.inf
        self._monitors.energy.on_message(message, now, on_ground=on_ground)

    def _on_reached(self, message: Any, _now: float) -> None:
        owner = self._monitors.waypoints.reached(self._state, message.seq)
        delivery = self._mission.flown.delivery.reached(message.seq)
        self._reports.event_log.reached(message.seq, owner, delivery)
        if delivery is not None:
            text = f"delivery point reached, waypoint {delivery}"
            self._reports.message_sender.say_to_all(text, mavlink.MAV_SEVERITY_NOTICE)


def _for_companion(message: Any, sysid: int) -> bool:
    """Whether a message is addressed to the companion, alone or with others."""
    system, component = getattr(message, "target_system", EVERYBODY), getattr(message, "target_component", EVERYBODY)
    return system in (EVERYBODY, sysid) and component in (EVERYBODY, COMPANION_COMPID)
