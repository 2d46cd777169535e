# SPDX-License-Identifier: GPL-3.0-or-later

"""The wire form of operator control: MAV_CMD_REQUEST_OPERATOR_CONTROL in its layout of 2026, and its traps.

The layout of 2024 had other parameters: p1 system id (0 from a ground station), p2 action, p3 takeover, p4 time-out.
Read by the present layout, a request of then (p1 0, p2 1) is a release. A release that comes with p2 set is therefore
refused with a word about it: a misread one would take authority away in flight.
"""

from __future__ import annotations

import math
from typing import Any

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.events import ControlRequested

__all__ = ["notification", "read_request"]

_COMMAND = mavlink.MAV_CMD_REQUEST_OPERATOR_CONTROL


def read_request(message: Any, station: int) -> ControlRequested | str:
    """The request in a COMMAND_LONG or COMMAND_INT of `station`, or why it cannot be one."""
    action, takeover, timeout_s, requester = message.param1, message.param2, message.param3, message.param4
    if not all(math.isfinite(value) for value in (action, takeover, timeout_s, requester)):
        return "parameters must be numbers"
    if action not in (0, 1) or takeover not in (0, 1):
        return "action and takeover must be 0 or 1"
    if action == 0 and takeover == 1:
        return "release with takeover: the request of an old ground station?"
    if requester != int(requester) or not 0 <= requester <= 255:
        return "system id must be 0 to 255"
    return ControlRequested(
        station=station,
        request=action == 1,
        takeover=takeover == 1,
        timeout_s=timeout_s,
        for_station=int(requester) if action == 1 and requester else station,
    )


def notification(owner: tuple[int, int], requester: int, timeout_s: float) -> Any:
    """The command by which the manager tells the owner that `requester` asks for control."""
    return mavlink.MAVLink_command_long_message(*owner, _COMMAND, 0, 1, 0, timeout_s, requester, 0, 0, 0)
