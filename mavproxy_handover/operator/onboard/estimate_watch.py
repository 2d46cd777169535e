# SPDX-License-Identifier: GPL-3.0-or-later

"""Compares the autopilot's position estimate with its GPS receiver, while onboard programs may move the estimate.

A program whose odometry or vision drifts leads every mode astray, a return too. Rules:

1. While the vehicle is armed, a difference of more than `FAR_M` and a second's way, for `HOLDS_S`, is a disagreement.
2. If one of the EKF's source sets takes its position from the GPS (EK3_SRCn_POSXY 3), the companion orders that set. It
   stops the position messages of all programs until the vehicle is disarmed.
3. Without such a set nothing is stopped: it is not known which source is right, and an estimate without a source is
   worse. The stations are told, once a minute.
4. With GPS_INPUT as the only receiver both come from the program, and agree.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.mission.geodesy import distance_m
from mavproxy_handover.operator.base.context import Reports
from mavproxy_handover.vehicle.state import VehicleState
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID, COMPANION_COMPID

__all__ = ["FAR_M", "HOLDS_S", "EstimateWatch"]

FAR_M: Final = 25.0
HOLDS_S: Final = 3.0
_REMIND_S: Final = 60.0
#: the order is sent so often in a disagreement, a second apart
_ORDERS: Final = 3
#: positions of estimate and receiver that are older than this (s) are not compared
_FRESH_S: Final = 2.0
_SETS: Final = (1, 2, 3)
_GPS: Final = 3
_SET_SOURCE: Final = mavlink.MAV_CMD_SET_EKF_SOURCE_SET


class EstimateWatch:
    """Of vehicle `vehicle` (system id). Times are monotonic seconds."""

    def __init__(
        self, vehicle: int, used: bool, aircraft: VehicleState, reports: Reports, to_autopilot: Callable[[bytes], None]
    ) -> None:
        """`used`: whether an onboard program may move the estimate. `to_autopilot` takes whole frames."""
        self._vehicle = vehicle
        self._used = used
        self._aircraft = aircraft
        self._reports = reports
        self._to_autopilot = to_autopilot
        self._own = mavlink.MAVLink(None, srcSystem=vehicle, srcComponent=COMPANION_COMPID)
        #: the position messages of programs do not pass
        self.stopped = False
        self._since: float | None = None
        self._orders = 0
        self._told_at = -math.inf

    def each_second(self, now: float) -> None:
        """Time has passed."""
        if not self._used or not self._aircraft.armed:
            self.stopped, self._since, self._orders, self._told_at = False, None, 0, -math.inf
            return
        away_m = self._away_m(now)
        if away_m is None:
            return
        if away_m <= FAR_M + self._aircraft.own_speed_mps:
            self._agree()
            return
        self._since = now if self._since is None else self._since
        if now - self._since >= HOLDS_S:
            self._disagree(away_m, now)

    def _away_m(self, now: float) -> float | None:
        """How far the estimate is from the receiver; None: not known now."""
        estimate, receiver = self._aircraft.telemetry.own_position, self._aircraft.telemetry.receiver
        if estimate.value is None or receiver.value is None or now - min(estimate.at, receiver.at) > _FRESH_S:
            return None
        return distance_m(estimate.value.lat / 1e7, estimate.value.lon / 1e7, *receiver.value)

    def _agree(self) -> None:
        if self._since is not None and self._told_at > -math.inf:
            self._tell("Position estimate and GPS receiver agree again.", mavlink.MAV_SEVERITY_NOTICE)
            self._told_at = -math.inf
        self._since, self._orders = None, 0

    def _disagree(self, away_m: float, now: float) -> None:
        gps_set = next((n for n in _SETS if self._parameter(f"EK3_SRC{n}_POSXY") == _GPS), None)
        if gps_set is not None:
            self.stopped = True
        if gps_set is not None and self._orders < _ORDERS:
            self._orders += 1
            values = (_SET_SOURCE, 0, gps_set, *[0.0] * 6)
            order = mavlink.MAVLink_command_long_message(self._vehicle, AUTOPILOT_COMPID, *values)
            self._to_autopilot(bytes(order.pack(self._own)))
        if now - self._told_at < _REMIND_S:
            return
        self._told_at = now
        what = f"Position estimate is {away_m:.0f} m from the GPS receiver."
        if gps_set is None:
            self._tell(f"{what} No EKF source set has GPS. Land, or fly by hand.")
        else:
            self._tell(f"{what} EKF source set {gps_set} (GPS) ordered, programs' positions stopped.")

    def _parameter(self, name: str) -> float | None:
        parameter = self._aircraft.parameters.get(name)
        return None if parameter is None else parameter.value

    def _tell(self, text: str, severity: int = mavlink.MAV_SEVERITY_WARNING) -> None:
        self._reports.event_log.onboard("estimate", text)
        self._reports.message_sender.say_to_all(text, severity)
