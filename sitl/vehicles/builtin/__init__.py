# SPDX-License-Identifier: GPL-3.0-or-later

"""The built-in vehicle: a small copter model that speaks what ArduCopter speaks in this system.

For machines without ArduPilot's SITL program. It answers MAVLink 2 like ArduCopter 4.7 (missions, rally points,
parameters, commands, modes, arming, failsafes, telemetry) and runs the real guard script; the facts come from
ArduPilot's source and from comparing it, message by message, with the SITL program
(`tests/sitl/test_builtin_parity.py`).

What it does not model is in `NOT_MODELLED`, and in `python -m sitl.vehicles.builtin --help`. A result that
depends on any of it has to be flown with `arducopter`.

Layers, each in modules of its own: geometry and airframe (`frame`, `physics`, `navigator`, `battery`), flight
(`aircraft`, `fence`, `modes`, `auto`, `returning`, `mission`, `copter`, `arming`, `failsafe`, together `autopilot`),
MAVLink (`framing`, `link`, `routing`, `telemetry`, `commands`, the two protocols, `guided_input`), scripts
(`script_host`), the whole (`vehicle`) and the process (`__main__`).
"""

from __future__ import annotations

__all__ = ["NOT_MODELLED"]

NOT_MODELLED = (
    "air: drag, gusts, ground effect; of the wind only that it slows the aircraft and carries it away",
    "attitude dynamics: lean angles are reported, not flown; no motor, vibration or thrust loss",
    "sensors and estimator: no noise, no drift; a receiver without a fix is an EKF failsafe after eight seconds, and "
    "the position stays right; ready ten seconds after the start",
    "terrain: the ground to land on is flat at the height of the start. Items above terrain count from there; with "
    "TERRAIN_ENABLE given and 1, from heights that were sent",
    "radio control: of a transmitter the mode switch and its failsafe only; sticks and overrides are not flown; "
    "STABILIZE is refused in flight",
    "modes other than STABILIZE, AUTO, GUIDED, LOITER, RTL, LAND, BRAKE and SMART_RTL",
    "geofence: no fence above home, no margin, no manual recovery after a change of the mode",
    "mission items beyond take-off, waypoint, loiter (timed, unlimited), delay, land, RTL, speed, home, jump and the "
    "conditions delay and distance: splines are flown straight, payload items count as done, the rest is skipped",
    "GUIDED by attitude, acceleration or local coordinates; place and velocity together",
    "file transfer, logs on board, calibration, cameras, gimbals, ADS-B; such commands are UNSUPPORTED",
    "MAVLink 1 output, signing (signed frames are taken without a check), serial rates (the link is as fast as TCP)",
    "parameters that none of the above needs: they do not exist; stored parameters do not outlive the process",
    "battery: constant voltage (SIM_BATT_VOLTAGE), current by hover and climb only",
    "32-bit numbers of the autopilot's Lua, its memory limits, and a slow script delaying another",
)
