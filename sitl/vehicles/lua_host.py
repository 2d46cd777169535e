# SPDX-License-Identifier: GPL-3.0-or-later

"""The vehicle as ArduPilot Lua scripts see it: the protocol that a simulated vehicle implements."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

__all__ = ["Sensed", "VehicleHost"]


@dataclass(frozen=True, slots=True)
class Sensed:
    """The present readings of the sensors, noise included."""

    gyro_radps: tuple[float, float, float] = (0.0, 0.0, 0.0)
    accel_mps2: tuple[float, float, float] = (0.0, 0.0, -9.81)
    pressure_pa: float = 101325.0
    battery_v: float = 12.6
    gps_week_ms: int = 0


class VehicleHost(Protocol):
    """The vehicle that the bindings act on. All times are the autopilot's own milliseconds since boot."""

    def millis(self) -> int:
        """Milliseconds since boot; wraps at 2^32 like the autopilot's."""

    def is_armed(self) -> bool:
        """Whether the motors are armed."""

    def arm(self) -> bool:
        """Arm with all checks (`arming:arm`); the host itself asks `LuaScripting.arming_refusal`."""

    def disarm(self) -> bool:
        """Stop the motors now. In ArduCopter a script's disarm works in the air as well: so must this."""

    def get_mode(self) -> int:
        """Number of the flight mode (RTL 6, LAND 9, AUTO 3, GUIDED 4, SMART_RTL 21, AUTO_RTL 27, ...)."""

    def set_mode(self, mode: int, reason: int) -> bool:
        """Change the mode. False when refused. Already there: true, and the reason is overwritten."""

    def get_control_mode_reason(self) -> int:
        """`ModeReason` of the last mode change: RC 1, GCS 2, battery 4, GCS failsafe 5, EKF 6, script 32."""

    def likely_flying(self) -> bool:
        """ArduCopter: not landed. False in the first moments of a take-off."""

    def is_landing(self) -> bool:
        """ArduCopter: in LAND, in the last part of RTL and SMART_RTL, and in AUTO while a landing item goes down."""

    def is_taking_off(self) -> bool:
        """ArduCopter: on the way up in a take-off of GUIDED or AUTO. ArduPlane: from the roll to the height of it."""

    def in_vtol_mode(self) -> bool:
        """ArduPlane: a QuadPlane whose lift motors carry it. Scripts of other vehicles cannot ask."""

    def mission_item(self) -> int:
        """Number of the mission's item that is flown to, 0 if there is none."""

    def has_ekf_failsafed(self) -> bool:
        """Whether the EKF failsafe is on: the position is not to be trusted."""

    def time_flying_ms(self) -> int:
        """Milliseconds since the vehicle began to fly; 0 on the ground."""

    def rc_valid(self) -> bool:
        """Whether a radio control receiver delivers valid input."""

    def run_aux_function(self, function: int, position: int) -> bool:
        """Do what a switch of the transmitter does with that function (RCn_OPTION), low 0, middle 1 or high 2."""

    def param_get(self, name: str) -> float | None:
        """Value of a parameter, None if there is no such parameter."""

    def param_set(self, name: str, value: float, save: bool) -> bool:
        """Set a parameter; `save` also stores it and sends PARAM_VALUE. False: no such parameter."""

    def param_define(self, name: str, default: float) -> bool:
        """A script adds a parameter: keep a stored or preset value, else take the default.

        False: the name belongs to a parameter of the firmware.
        """

    def send_text(self, severity: int, text: str) -> None:
        """STATUSTEXT on all channels."""

    def send_message(self, channel: int, msgid: int, payload: bytes) -> bool:
        """Send a message of the autopilot (its system id, component 1) on one channel.

        The payload has the message's full length. False when there is no room or no such channel.
        """

    def has_port(self, channel: int) -> bool:
        """Whether a port belongs to the MAVLink channel."""

    def sensed(self) -> Sensed:
        """The readings of the sensors."""

    def gcs_last_seen_ms(self) -> int:
        """When the last heartbeat of the GCS id arrived; not reset when the id changes. 0: never."""

    def log_write(self, name: str, labels: str, fmt: str, values: tuple[object, ...]) -> None:
        """One record for the dataflash log."""

    def script_removed(self, path: str, error: str) -> None:
        """A script was removed for an error; the autopilot goes on without it."""

    def firmware(self) -> tuple[int, int, int]:
        """Firmware version: major, minor, patch."""

    def firmware_type(self) -> int:
        """The kind of vehicle that the firmware was built for: Rover 1, Copter 2, Plane 3, Heli 13, ..."""
