# SPDX-License-Identifier: GPL-3.0-or-later

"""MAV_CMD by COMMAND_LONG and COMMAND_INT.

COMMAND_LONG is turned into COMMAND_INT first, as ArduPilot does: places in degrees become 1e-7 degrees, and
commands that carry a place get the frame that goes with them, or are not supported that way. Every command is
acknowledged on the channel it came from, to whom it came from; one that a script has taken over is neither
executed nor acknowledged.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

from pymavlink.dialects.v20 import all as dialect

from sitl.vehicles.builtin.autopilot import Autopilot
from sitl.vehicles.builtin.copter import ModeReason
from sitl.vehicles.builtin.frame import Location, altitude_frame
from sitl.vehicles.builtin.link import Link
from sitl.vehicles.builtin.mission import MissionState
from sitl.vehicles.builtin.telemetry import BUILDERS, STREAMS, gps_global_origin, home_position, send, send_banner

__all__ = ["Command", "Commands", "Outcome"]

_RELATIVE = 3
#: Commands whose x and y are a place, with the frame COMMAND_LONG implies (None: COMMAND_INT only).
_PLACES: dict[int, int | None] = {179: 0, 192: None, 195: _RELATIVE, 201: _RELATIVE}
_MAX_ALT_M = 83_000.0
_FORCE, _FORCE_ARM_ONLY = 21196.0, 2989.0
_CHANGE_MODE = 1
_SPEED_KINDS = {0: "speed", 1: "speed", 2: "up", 3: "down"}
_SPEED_TYPE_END = 4


class Outcome(IntEnum):
    """MAV_RESULT values used."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4


@dataclass(frozen=True, slots=True)
class Command:
    """A command in COMMAND_INT form."""

    command: int
    frame: int
    param1: float
    param2: float
    param3: float
    param4: float
    x: int
    y: int
    z: float


class Commands:
    """Executes commands."""

    def __init__(self, autopilot: Autopilot, to_scripts: Callable[[float], int]) -> None:
        """`to_scripts` takes the first parameter of MAV_CMD_SCRIPTING and returns the MAV_RESULT."""
        self._autopilot = autopilot
        self._copter = autopilot.copter
        self._to_scripts = to_scripts
        self._handlers: dict[int, Callable[[Link, Command], Outcome]] = {
            17: lambda _, c: self._mode(5),
            20: lambda _, c: self._mode(6),
            21: lambda _, c: self._mode(9),
            22: self._takeoff,
            176: self._set_mode,
            178: self._change_speed,
            179: self._set_home,
            192: self._reposition,
            193: self._pause_continue,
            224: self._set_mission_current,
            300: self._mission_start,
            400: self._arm_disarm,
            401: self._run_checks,
            410: self._get_home,
            510: self._get_interval,
            511: self._set_interval,
            512: self._request_message,
            520: self._capabilities,
            42428: self._banner,
            42701: self._scripting,
        }

    def handle(self, link: Link, message: dialect.MAVLink_message) -> None:
        """Execute and acknowledge COMMAND_LONG or COMMAND_INT."""
        command = _from_long(message) if message.get_type() == "COMMAND_LONG" else _from_int(message)
        outcome = Outcome.UNSUPPORTED if command is None else self.execute(link, command)
        source = (message.get_srcSystem(), message.get_srcComponent())
        link.send(dialect.MAVLink_command_ack_message(message.command, int(outcome), 0, 0, *source))

    def execute(self, link: Link, command: Command) -> Outcome:
        handler = self._handlers.get(command.command)
        return Outcome.UNSUPPORTED if handler is None else handler(link, command)

    # -- modes and arming -----------------------------------------------------------------------------------------

    def _mode(self, number: int) -> Outcome:
        done = self._copter.set_mode(number, ModeReason.GCS_COMMAND)
        return Outcome.ACCEPTED if done else Outcome.FAILED

    def _set_mode(self, link: Link, c: Command) -> Outcome:
        return self.set_mode_common(_whole(c.param1) & 0xFF, _whole(c.param2))

    def set_mode_common(self, base_mode: int, custom_mode: int) -> Outcome:
        """DO_SET_MODE and the older SET_MODE: only ArduPilot's own mode numbers are understood."""
        if not base_mode & dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            return Outcome.DENIED
        return self._mode(custom_mode)

    def _arm_disarm(self, link: Link, c: Command) -> Outcome:
        if c.param1 == 1:
            done = self._autopilot.arming.arm(force=c.param2 in (_FORCE, _FORCE_ARM_ONLY))
        elif c.param1 == 0:
            done = self._autopilot.arming.disarm(force=c.param2 == _FORCE)
        else:
            return Outcome.UNSUPPORTED
        return Outcome.ACCEPTED if done else Outcome.FAILED

    def _run_checks(self, link: Link, c: Command) -> Outcome:
        if self._copter.armed:
            return Outcome.TEMPORARILY_REJECTED
        self._autopilot.arming.show()
        return Outcome.ACCEPTED

    def _mission_start(self, link: Link, c: Command) -> Outcome:
        if c.param1 != 0 or c.param2 != 0:
            return Outcome.DENIED
        copter = self._copter
        if self._mode(3) is not Outcome.ACCEPTED:
            return Outcome.FAILED
        copter.auto_armed = copter.armed
        if copter.mission.state is not MissionState.RUNNING:
            copter.mission.start_or_resume()
        return Outcome.ACCEPTED

    # -- flying ---------------------------------------------------------------------------------------------------

    def _takeoff(self, link: Link, c: Command) -> Outcome:
        if c.frame != _RELATIVE:
            return Outcome.DENIED
        return Outcome.ACCEPTED if self._copter.mode.take_off(c.z) else Outcome.FAILED

    def _pause_continue(self, link: Link, c: Command) -> Outcome:
        mode, wanted = self._copter.mode, _whole(c.param1)
        if wanted == 0:
            done, word = mode.pause(), "pause"
        elif wanted == 1:
            done, word = mode.resume(), "resume"
        else:
            return Outcome.DENIED
        if not done:
            self._copter.say(6, f"Failed to {word}")
        return Outcome.ACCEPTED if done else Outcome.FAILED

    def _change_speed(self, link: Link, c: Command) -> Outcome:
        kind = _whole(c.param1)
        if not c.param2 > 0 or kind == _SPEED_TYPE_END:
            return Outcome.DENIED
        known = kind in _SPEED_KINDS
        done = known and self._copter.mode.change_speed(_SPEED_KINDS[kind], min(c.param2, 100.0))
        return Outcome.ACCEPTED if done else Outcome.FAILED

    def _reposition(self, link: Link, c: Command) -> Outcome:
        copter = self._copter
        if copter.mode is not copter.guided and not _whole(c.param2) & _CHANGE_MODE:
            return Outcome.DENIED
        place = _place(c)
        if place is None or (c.x == 0 and c.y == 0):
            return Outcome.DENIED
        if self._mode(4) is not Outcome.ACCEPTED:
            return Outcome.FAILED
        copter.guided.go_to(place)
        return Outcome.ACCEPTED

    def _set_home(self, link: Link, c: Command) -> Outcome:
        copter = self._copter
        if c.param1 == 1 or (c.x == 0 and c.y == 0):
            if not copter.position_ok:
                return Outcome.FAILED
            copter.set_home(copter.location(), lock=True)
            return Outcome.ACCEPTED
        if c.param1 != 0 or copter.origin is None:
            return Outcome.FAILED
        place = _place(c)
        if place is None:
            return Outcome.DENIED
        height = copter.start.alt_m + copter.local(place)[2]
        copter.set_home(Location(place.lat_e7, place.lon_e7, height), lock=True)
        return Outcome.ACCEPTED

    def _set_mission_current(self, link: Link, c: Command) -> Outcome:
        mission, index = self._copter.mission, _whole(c.param1)
        if not 0 <= index < len(mission):
            return Outcome.DENIED
        if c.param2 == 1:
            mission.reset()
        if not mission.set_current(index):
            return Outcome.FAILED
        if c.param2 == 1:
            mission.resume()
        send(self._autopilot, link, dialect.MAVLINK_MSG_ID_MISSION_CURRENT)
        return Outcome.ACCEPTED

    # -- messages -------------------------------------------------------------------------------------------------

    def _get_home(self, link: Link, c: Command) -> Outcome:
        if self._copter.home is None:
            return Outcome.FAILED
        for message in (home_position(self._autopilot), gps_global_origin(self._autopilot)):
            if message is not None:
                link.send(message)
        return Outcome.ACCEPTED

    def _capabilities(self, link: Link, c: Command) -> Outcome:
        if c.param1 != 1:
            return Outcome.FAILED
        send(self._autopilot, link, dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
        return Outcome.ACCEPTED

    def _request_message(self, link: Link, c: Command) -> Outcome:
        wanted = _whole(c.param1)
        if wanted == dialect.MAVLINK_MSG_ID_MESSAGE_INTERVAL:
            return self._tell_interval(link, _whole(c.param2))
        if wanted not in BUILDERS:
            return Outcome.FAILED
        send(self._autopilot, link, wanted)
        return Outcome.ACCEPTED

    def _get_interval(self, link: Link, c: Command) -> Outcome:
        return self._tell_interval(link, _whole(c.param1))

    def _tell_interval(self, link: Link, wanted: int) -> Outcome:
        if wanted not in BUILDERS:
            link.send(dialect.MAVLink_message_interval_message(wanted & 0xFFFF, 0))
            return Outcome.FAILED
        entry = link.schedule.get(wanted)
        period_us = -1 if entry is None else round(entry.period_s * 1e6)
        link.send(dialect.MAVLink_message_interval_message(wanted, period_us))
        return Outcome.ACCEPTED

    def _set_interval(self, link: Link, c: Command) -> Outcome:
        wanted, period_us = _whole(c.param1), _whole(c.param2)
        if wanted not in BUILDERS or c.param3 != 0:
            self._copter.say(6, f"No ap_message for mavlink id ({wanted})")
            return Outcome.DENIED
        if period_us < -1:
            return Outcome.DENIED
        if period_us == 0:
            stream = next((name for name, ids in STREAMS.items() if wanted in ids), None)
            rate = self._copter.parameters[f"MAV{link.channel + 1}_{stream}"] if stream else 0.0
            period_s = 1 / rate if rate > 0 else 0.0
        else:
            period_s = 0.0 if period_us == -1 else min(max(period_us, 20_000), 60_000_000) / 1e6
        link.set_interval(wanted, period_s, self._copter.time_s)
        return Outcome.ACCEPTED

    def _banner(self, link: Link, c: Command) -> Outcome:
        send_banner(link)
        return Outcome.ACCEPTED

    def _scripting(self, link: Link, c: Command) -> Outcome:
        return Outcome(self._to_scripts(c.param1))


def _whole(value: float) -> int:
    """A float parameter as an integer; what is no number counts as zero."""
    return int(value) if math.isfinite(value) else 0


def _place(c: Command) -> Location | None:
    frame = altitude_frame(c.frame)
    if frame is None or not abs(c.z) <= _MAX_ALT_M or abs(c.x) > 900_000_000 or abs(c.y) > 1_800_000_000:
        return None
    return Location(c.x, c.y, c.z, frame)


def _from_int(m: dialect.MAVLink_message) -> Command:
    return Command(m.command, m.frame, m.param1, m.param2, m.param3, m.param4, m.x, m.y, m.z)


def _from_long(m: dialect.MAVLink_message) -> Command | None:
    frame = _PLACES.get(m.command, _RELATIVE)
    if frame is None:
        return None
    scale = 1e7 if m.command in _PLACES else 1.0
    x, y = (max(-(2**31), min(2**31 - 1, _whole(value * scale))) for value in (m.param5, m.param6))
    return Command(m.command, frame, m.param1, m.param2, m.param3, m.param4, x, y, m.param7)
