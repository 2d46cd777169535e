# SPDX-License-Identifier: GPL-3.0-or-later

"""The message rates that the companion asks of the autopilot. They are restored when authority moves."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

__all__ = ["OWN_RATES"]

#: message id -> interval (s); position at 20 Hz is the zone check's rate
OWN_RATES: Final[Mapping[int, float]] = {
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 0.05,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 0.25,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: 0.25,
    mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT: 0.5,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 0.5,
    mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: 0.5,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 0.5,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_WIND: 1.0,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 0.5,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
    mavlink.MAVLINK_MSG_ID_FENCE_STATUS: 1.0,
}
