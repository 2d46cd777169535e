# SPDX-License-Identifier: GPL-3.0-or-later

"""The policy of onboard programs: which messages each right contains, and how often each may come.

A program has no right by default, except the reads of `READS`. Arming, modes, parameters, authority, missions and file
transfer are in no right. `gate/onboard.py` judges by these tables.

Sources: ArduPilot's `GCS_Common.cpp` (which messages it takes), and the parameter lists of AP_GPS, AP_VisualOdom,
AP_OpticalFlow, AP_Proximity, AP_RangeFinder, AC_PrecLand and AP_NavEKF_Source (which it uses).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Final

from mavproxy_handover.gate.policy.access import names

__all__ = ["GUIDED", "HEARTBEAT_HZ", "READS", "READ_HZ", "SENSORS", "Moves", "Right", "Sensor"]


class Right(Enum):
    """Rights of an onboard program, by their names in the configuration."""

    SENSORS = "sensors"
    PAYLOAD = "payload"
    GUIDED = "guided"
    MANAGER = "manager"


class Moves(Enum):
    """Kinds of sensor messages, by the part of the flight that they can change."""

    ESTIMATE = "the position estimate"
    LANDING = "the place of the landing"
    AVOIDANCE = "avoidance, which can block a return"


@dataclass(frozen=True, slots=True)
class Sensor:
    """A sensor message. `most_hz`: messages a second that pass."""

    name: str
    moves: Moves
    most_hz: float


#: The sensor messages that a configuration may name. ArduPilot takes each from any component of its own system.
SENSORS: Final[Mapping[str, Sensor]] = {
    sensor.name: sensor
    for sensor in (
        Sensor("LANDING_TARGET", Moves.LANDING, 50.0),
        Sensor("OBSTACLE_DISTANCE", Moves.AVOIDANCE, 30.0),
        Sensor("OBSTACLE_DISTANCE_3D", Moves.AVOIDANCE, 100.0),
        Sensor("DISTANCE_SENSOR", Moves.AVOIDANCE, 100.0),
        Sensor("ODOMETRY", Moves.ESTIMATE, 60.0),
        Sensor("VISION_POSITION_ESTIMATE", Moves.ESTIMATE, 60.0),
        Sensor("VISION_SPEED_ESTIMATE", Moves.ESTIMATE, 60.0),
        Sensor("VISION_POSITION_DELTA", Moves.ESTIMATE, 60.0),
        Sensor("GLOBAL_VISION_POSITION_ESTIMATE", Moves.ESTIMATE, 60.0),
        Sensor("VICON_POSITION_ESTIMATE", Moves.ESTIMATE, 100.0),
        Sensor("ATT_POS_MOCAP", Moves.ESTIMATE, 100.0),
        Sensor("OPTICAL_FLOW", Moves.ESTIMATE, 50.0),
        Sensor("GPS_INPUT", Moves.ESTIMATE, 20.0),
    )
}

#: Guided targets of the right `guided`. The situation judges a place, but not an attitude or an output: such targets
#: are in no right.
GUIDED: Final = names("SET_POSITION_TARGET_LOCAL_NED SET_POSITION_TARGET_GLOBAL_INT")

#: Messages that every program may send: they change nothing. Commands of the class READ pass as well.
READS: Final = names("PING TIMESYNC PARAM_REQUEST_READ AUTOPILOT_VERSION_REQUEST")

#: the most reads of one kind, heartbeats, and guided targets a second
READ_HZ: Final = 20.0
HEARTBEAT_HZ: Final = 2.0
