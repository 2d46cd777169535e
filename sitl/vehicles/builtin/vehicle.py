# SPDX-License-Identifier: GPL-3.0-or-later

"""The whole vehicle without sockets and without a clock: bytes and time steps in, bytes out.

`receive` takes what arrived on a channel, `step` advances simulated time, `take` gives what is to be written.
The same object runs in the process (`__main__`) and in unit tests. Received frames go the autopilot's way:
routing, then scripts, then the sysid filter, then the protocol handlers; a handler never raises on what it is
sent.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from pymavlink.dialects.v20 import all as dialect

from sitl.vehicles.builtin.arming import Arming
from sitl.vehicles.builtin.autopilot import Autopilot
from sitl.vehicles.builtin.commands import Commands
from sitl.vehicles.builtin.copter import Copter
from sitl.vehicles.builtin.failsafe import Failsafes
from sitl.vehicles.builtin.frame import Location
from sitl.vehicles.builtin.framing import decode, message_id
from sitl.vehicles.builtin.geofence import Geofence
from sitl.vehicles.builtin.guided_input import handle_position_target
from sitl.vehicles.builtin.link import Link
from sitl.vehicles.builtin.mission_protocol import MissionProtocol
from sitl.vehicles.builtin.param_protocol import ParameterProtocol
from sitl.vehicles.builtin.params import ParameterTable
from sitl.vehicles.builtin.radio import Radio
from sitl.vehicles.builtin.remote_id import RemoteId
from sitl.vehicles.builtin.routing import Router
from sitl.vehicles.builtin.script_host import ScriptHost
from sitl.vehicles.builtin.sticks import Sticks
from sitl.vehicles.builtin.telemetry import BUILDERS, STREAM_IDS, STREAMS, gps_global_origin, home_position, send
from sitl.vehicles.builtin.terrain import TerrainProtocol

if TYPE_CHECKING:
    from sitl.vehicles.lua_bindings import LuaScripting

__all__ = ["STEP_S", "Vehicle", "VehicleConfig"]

STEP_S = 0.01
_TIMESYNC_PERIOD_S = 10.0
_RUNTIME_SAVED_EVERY_S = 30.0
_ENFORCE_SYSID = 1
_TEXT_LENGTH = 50
_MAX_STREAM_HZ = 50
_UNSUPPORTED = 3


@dataclass(frozen=True, slots=True)
class VehicleConfig:
    """The configuration of a vehicle: place, identity, parameter files, scripts and channels."""

    home: tuple[float, float, float, float]
    """Latitude, longitude (degrees), altitude (m), heading (degrees)."""
    sysid: int = 1
    defaults: tuple[Path, ...] = ()
    overrides: Mapping[str, float] = field(default_factory=dict)
    """Single parameters, applied after the files."""
    scripts: tuple[Path, ...] = ()
    channels: tuple[int, ...] = (1, 2)
    speedup: float = 1.0
    unix_start_us: int = 1_700_000_000_000_000
    """The receiver's time at the start, microseconds since 1970."""
    record: Callable[[str], None] = field(default=lambda line: None)
    """Gets texts and the scripts' log records, one line each."""


class Vehicle:
    """The simulated copter with its radios."""

    def __init__(self, config: VehicleConfig) -> None:
        self.config = config
        self.parameters = ParameterTable()
        self.unknown_parameters = sum(self.parameters.load(path) for path in config.defaults)
        for name, value in config.overrides.items():
            self.parameters.preset(name, value)
        self.parameters.set("MAV_SYSID", config.sysid)
        self.parameters.set("SIM_SPEEDUP", config.speedup)
        latitude, longitude, altitude, heading = config.home
        start = Location(round(latitude * 1e7), round(longitude * 1e7), altitude)
        self.links = {channel: Link(channel, config.sysid) for channel in sorted(config.channels)}
        self.terrain = TerrainProtocol(self.parameters, self.links)
        self.copter = Copter(self.parameters, start, heading, self, self.terrain.rise_m)
        self.radio, self.fence = Radio(self.copter), Geofence(self.copter)
        self.arming = Arming(self.copter, self._script_refusal, lambda: self.radio.ever and not self.radio.failed)
        self.failsafes = Failsafes(self.copter)
        self.autopilot = Autopilot(
            self.copter,
            self.arming,
            self.failsafes,
            Sticks(self.parameters),
            self.radio,
            self.fence,
            config.unix_start_us,
        )
        self.parameter_protocol = ParameterProtocol(self.parameters, self.links)
        self.mission_protocol = MissionProtocol(self.autopilot)
        self.commands = Commands(self.autopilot, self._script_command)
        self._router = Router(self.links, self.parameters)
        self._remote_id = RemoteId(self.parameters, self.links)
        self._text_id = 0
        self._reached: int | None = None
        self._heartbeat_due_s = 0.0
        self._runtime_due_s = _RUNTIME_SAVED_EVERY_S
        self.bad_frames = 0
        for link in self.links.values():
            for stream in STREAMS:
                self._set_stream(link, stream)
        self._scripting = self._start_scripting()

    # -- time and bytes -------------------------------------------------------------------------------------------

    def receive(self, channel: int, data: bytes) -> None:
        """Bytes arrived on a channel."""
        link = self.links[channel]
        for frame in link.splitter.push(data):
            self._frame(link, frame)

    def step(self, dt: float = STEP_S) -> None:
        """Advance simulated time: aircraft, failsafes, scripts, then everything that is due to be sent."""
        self.copter.step(dt)
        self.failsafes.update()
        self.radio.update()
        self.fence.update()
        self.arming.update()
        self.mission_protocol.update()
        if self._scripting is not None and self.copter.initialised:
            self._scripting.run_due(self.autopilot.millis())
        self._send_due()

    def take(self, channel: int) -> bytes:
        """The bytes for a channel's client."""
        return self.links[channel].take()

    # -- what the aircraft tells ----------------------------------------------------------------------------------

    def text(self, severity: int, text: str) -> None:
        """STATUSTEXT on every channel, in chunks of fifty characters."""
        self.config.record(f"{self.copter.time_s:.2f} text {severity} {text}")
        data = text.encode("ascii", "replace")
        chunks = [data[i : i + _TEXT_LENGTH] for i in range(0, len(data), _TEXT_LENGTH)] or [b""]
        identity = 0
        if len(data) > _TEXT_LENGTH:
            self._text_id = identity = self._text_id % 65535 + 1
            if len(chunks[-1]) == _TEXT_LENGTH:
                chunks.append(b"")
        for sequence, chunk in enumerate(chunks):
            message = dialect.MAVLink_statustext_message(severity, chunk, identity, sequence)
            for link in self.links.values():
                link.send(message)

    def item_reached(self, index: int) -> None:
        """Remembered until the end of the step: of several in one step only the last is told, as in ArduPilot."""
        self._reached = index

    def mode_changed(self) -> None:
        for link in self.links.values():
            send(self.autopilot, link, dialect.MAVLINK_MSG_ID_HEARTBEAT)

    def home_changed(self) -> None:
        for message in (gps_global_origin(self.autopilot), home_position(self.autopilot)):
            for link in self.links.values():
                if message is not None:
                    link.send(message)

    def stored(self, name: str) -> None:
        """A counter of the autopilot's own was saved: set it and send it to all channels."""
        copter = self.copter
        counts = {"MIS_TOTAL": len(copter.mission), "RALLY_TOTAL": len(copter.rally), "FENCE_TOTAL": len(copter.fence)}
        self.parameters.set(name, counts[name])
        self.parameter_protocol.announce(name)

    # -- inside ---------------------------------------------------------------------------------------------------

    def _start_scripting(self) -> LuaScripting | None:
        if self.parameters["SCR_ENABLE"] == 0:
            return None
        if not self.config.scripts:
            return None
        from sitl.vehicles.lua_bindings import LuaScripting

        scripting = LuaScripting(ScriptHost(self.autopilot, self.links, self.parameter_protocol, self.config.record))
        for path in self.config.scripts:
            scripting.load(path)
        return scripting

    def _script_refusal(self) -> str | None:
        return self._scripting.arming_refusal() if self._scripting is not None else None

    def _script_blocks(self, command: int) -> bool:
        return self._scripting is not None and self._scripting.command_blocked(command)

    def _script_command(self, param1: float) -> int:
        """MAV_CMD_SCRIPTING that no script has taken over."""
        return self._scripting.scripting_command(param1) if self._scripting is not None else _UNSUPPORTED

    def _frame(self, link: Link, frame: bytes) -> None:
        message = decode(frame)
        if message is None:
            if message_id(frame) in dialect.mavlink_map:
                self.bad_frames += 1
            if self._scripting is not None:
                self._scripting.deliver(frame, link.channel)
            return
        link.heard = True
        if not self._router.accept(link, message, frame):
            return
        if self._scripting is not None:
            self._scripting.deliver(frame, link.channel)
        if self._accepted(message):
            self._handle(link, message)

    def _accepted(self, message: dialect.MAVLink_message) -> bool:
        """MAV_OPTIONS bit 0: only the vehicle's own components and the station it obeys."""
        if not int(self.parameters["MAV_OPTIONS"]) & _ENFORCE_SYSID:
            return True
        known = (self.parameters["MAV_SYSID"], self.parameters["MAV_GCS_SYSID"])
        return message.get_srcSystem() in known or message.get_type() in ("RADIO", "RADIO_STATUS")

    def _handle(self, link: Link, message: dialect.MAVLink_message) -> None:
        kind = message.get_type()
        if kind == "HEARTBEAT":
            if message.get_srcSystem() == self.parameters["MAV_GCS_SYSID"]:
                self.failsafes.gcs_seen()
        elif kind == "SET_MODE":
            self.commands.set_mode_common(message.base_mode, message.custom_mode)
        elif kind == "TIMESYNC":
            if message.tc1 == 0:
                link.send(dialect.MAVLink_timesync_message(self.autopilot.micros() * 1000, message.ts1))
        elif kind == "REQUEST_DATA_STREAM":
            self._request_stream(link, message)
        elif kind == "AUTOPILOT_VERSION_REQUEST":
            send(self.autopilot, link, dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
        elif kind == "RC_CHANNELS_OVERRIDE":
            self.autopilot.sticks.take(message, self.copter.time_s)
        elif kind in ("SET_POSITION_TARGET_GLOBAL_INT", "SET_POSITION_TARGET_LOCAL_NED"):
            handle_position_target(self.copter, message)
        elif kind == "LANDING_TARGET":
            self.copter.precision.take(message, self.copter.body, self.copter.time_s)
        elif kind in ("COMMAND_LONG", "COMMAND_INT"):
            if not self._script_blocks(message.command):
                self.commands.handle(link, message)
        elif self._remote_id.handle(message) or self.terrain.handle(message):
            pass
        elif not self.mission_protocol.handle(link, message):
            self.parameter_protocol.handle(link, message)

    def _request_stream(self, link: Link, message: dialect.MAVLink_message) -> None:
        row = self.parameters.find(f"MAV{link.channel + 1}_OPTIONS")
        if message.start_stop > 1 or (row is not None and int(row.value) & 4):
            return
        rate = message.req_message_rate if message.start_stop else 0
        wanted = STREAM_IDS.values() if message.req_stream_id == 0 else [STREAM_IDS.get(message.req_stream_id)]
        for stream in wanted:
            if stream is not None:
                self.parameters.set(f"MAV{link.channel + 1}_{stream}", rate)
                self._set_stream(link, stream)

    def _set_stream(self, link: Link, stream: str) -> None:
        row = self.parameters.find(f"MAV{link.channel + 1}_{stream}")
        rate = row.value if row is not None else 0.0
        for message in STREAMS.get(stream, ()):
            link.set_interval(message, 1 / min(rate, _MAX_STREAM_HZ) if rate > 0 else 0.0, self.copter.time_s)

    def _send_due(self) -> None:
        now_s = self.copter.time_s
        if now_s >= self._heartbeat_due_s:
            self._heartbeat_due_s = now_s + 1.0
            self.mode_changed()
        if now_s >= self._runtime_due_s:
            self._runtime_due_s += _RUNTIME_SAVED_EVERY_S
            self.parameters.set("STAT_RUNTIME", int(now_s))
            self.parameter_protocol.announce("STAT_RUNTIME")
        if self._reached is not None:
            for link in self.links.values():
                link.send(dialect.MAVLink_mission_item_reached_message(self._reached))
            self._reached = None
        self._remote_id.update(now_s)
        if self.copter.position_ok:
            mission = self.copter.mission
            items = [item for n in range(len(mission)) if (item := mission.read(n)) is not None]
            self.terrain.update(self.copter.location(), self.copter.home, items, now_s)
        built: dict[int, dialect.MAVLink_message | None] = {}
        for link in self.links.values():
            if not link.connected:
                continue
            self.parameter_protocol.update(link)
            if now_s >= link.timesync_due_s:
                link.timesync_due_s = now_s + _TIMESYNC_PERIOD_S
                stamp = self.autopilot.micros() * 1000 + self.config.sysid
                link.send(dialect.MAVLink_timesync_message(0, stamp))
            for message, entry in link.schedule.items():
                if now_s < entry.due_s:
                    continue
                entry.due_s = max(entry.due_s + entry.period_s, now_s)
                if message not in built:
                    built[message] = BUILDERS[message](self.autopilot)
                ready = built[message]
                if ready is not None:
                    link.send(ready)
