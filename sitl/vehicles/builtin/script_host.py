# SPDX-License-Identifier: GPL-3.0-or-later

"""The vehicle as its Lua scripts see it: implements `sitl.vehicles.lua_host.VehicleHost`."""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping

from pymavlink.dialects.v20 import all as dialect

from sitl.vehicles.builtin.autopilot import Autopilot
from sitl.vehicles.builtin.link import Link
from sitl.vehicles.builtin.param_protocol import ParameterProtocol
from sitl.vehicles.builtin.telemetry import FIRMWARE
from sitl.vehicles.lua_host import Sensed

__all__ = ["ScriptHost"]

_WRAP = 1 << 32
#: `FWVersion:type()` of ArduCopter
_COPTER = 2


class ScriptHost:
    """Answers the scripts' bindings from the vehicle."""

    def __init__(
        self,
        autopilot: Autopilot,
        links: Mapping[int, Link],
        parameter_protocol: ParameterProtocol,
        record: Callable[[str], None],
    ) -> None:
        """`record` gets the scripts' log records and their ends, a line each."""
        self._autopilot = autopilot
        self._copter = autopilot.copter
        self._links = links
        self._parameter_protocol = parameter_protocol
        self._record = record

    def millis(self) -> int:
        return self._autopilot.millis() % _WRAP

    def is_armed(self) -> bool:
        return self._copter.armed

    def arm(self) -> bool:
        return self._autopilot.arming.arm()

    def disarm(self) -> bool:
        was_armed = self._copter.armed
        self._copter.disarm()
        return was_armed

    def get_mode(self) -> int:
        return self._copter.mode.number

    def set_mode(self, mode: int, reason: int) -> bool:
        return self._copter.set_mode(mode, reason)

    def get_control_mode_reason(self) -> int:
        return int(self._copter.reason)

    def likely_flying(self) -> bool:
        return not self._copter.land_complete

    def is_landing(self) -> bool:
        return self._copter.mode.landing

    def is_taking_off(self) -> bool:
        return self._copter.mode.taking_off

    def in_vtol_mode(self) -> bool:
        return False

    def mission_item(self) -> int:
        return self._copter.mission.current

    def has_ekf_failsafed(self) -> bool:
        return self._autopilot.copter.ekf_failed

    def time_flying_ms(self) -> int:
        since_s = self._copter.flying_since_s
        return 0 if since_s is None else round((self._copter.time_s - since_s) * 1000)

    def rc_valid(self) -> bool:
        radio = self._autopilot.radio
        return radio.ever and not radio.failed

    def run_aux_function(self, function: int, position: int) -> bool:
        return False

    def param_get(self, name: str) -> float | None:
        row = self._copter.parameters.find(name)
        return None if row is None else row.value

    def param_set(self, name: str, value: float, save: bool) -> bool:
        if not self._parameter_protocol.set(name, value):
            return False
        if save:
            self._parameter_protocol.announce(name)
        return True

    def param_define(self, name: str, default: float) -> bool:
        return self._copter.parameters.define(name, default)

    def send_text(self, severity: int, text: str) -> None:
        self._copter.say(severity, text)

    def send_message(self, channel: int, msgid: int, payload: bytes) -> bool:
        link = self._links.get(channel)
        if link is None or msgid not in dialect.mavlink_map:
            return False
        return link.send(_RawMessage(msgid, payload))

    def has_port(self, channel: int) -> bool:
        return channel in self._links

    def sensed(self) -> Sensed:
        noise = [random.gauss(0.0, 0.003) for _ in range(6)]
        return Sensed((noise[0], noise[1], noise[2]), (noise[3], noise[4], noise[5] - 9.81))

    def gcs_last_seen_ms(self) -> int:
        seen_s = self._autopilot.failsafes.gcs_seen_at_s
        return 0 if seen_s is None else round(seen_s * 1000)

    def log_write(self, name: str, labels: str, fmt: str, values: tuple[object, ...]) -> None:
        fields = " ".join(f"{label}={value}" for label, value in zip(labels.split(","), values, strict=False))
        self._record(f"{self._copter.time_s:.2f} log {name} {fields}")

    def script_removed(self, path: str, error: str) -> None:
        self._record(f"{self._copter.time_s:.2f} script removed {path}: {error}")

    def firmware(self) -> tuple[int, int, int]:
        return FIRMWARE

    def firmware_type(self) -> int:
        return _COPTER


class _RawMessage(dialect.MAVLink_message):  # type: ignore[misc]
    """A message whose payload a script has packed itself."""

    def __init__(self, msgid: int, payload: bytes) -> None:
        kind = dialect.mavlink_map[msgid]
        super().__init__(msgid, kind.msgname)
        self._crc_extra = kind.crc_extra
        self._bytes = payload

    def pack(self, mav: dialect.MAVLink, force_mavlink1: bool = False) -> bytes:
        packed: bytes = self._pack(mav, self._crc_extra, self._bytes, force_mavlink1=force_mavlink1)
        return packed
