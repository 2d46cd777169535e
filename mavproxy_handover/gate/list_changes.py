# SPDX-License-Identifier: GPL-3.0-or-later

"""Finds frames that change the mission or the geofence in the autopilot.

After such a frame has reached the autopilot, a mission package that was loaded does not count any more. The list counts
as changed when the change begins: with the first message of an upload, or when a file is opened for writing.

Rally points are not here: the companion keeps that list (`operator/return_site/rally_list.py`).

Sources: ArduPilot's MissionItemProtocol, AP_Filesystem_Mission (files), RC_Channel (auxiliary functions), AP_Mission,
AC_Fence (MIS_TOTAL and FENCE_TOTAL are the numbers of items).
"""

from __future__ import annotations

from math import isfinite
from typing import Final, NamedTuple

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.gate.policy.files import written_lists
from mavproxy_handover.gate.policy.parameters import parameter_name
from mavproxy_handover.gate.policy.switches import SWITCH_NUMBERS
from mavproxy_handover.wire.frames import Frame, field_bytes, field_float, field_int
from mavproxy_handover.wire.message_ids import COMMAND_MESSAGES

__all__ = ["GEOFENCE", "MISSION", "ListChange", "list_change"]

MISSION: Final = "mission"
GEOFENCE: Final = "geofence"

_BY_TYPE: Final = {mavlink.MAV_MISSION_TYPE_MISSION: MISSION, mavlink.MAV_MISSION_TYPE_FENCE: GEOFENCE}
_COUNT: Final = mavlink.MAVLINK_MSG_ID_MISSION_COUNT
_CLEAR: Final = mavlink.MAVLINK_MSG_ID_MISSION_CLEAR_ALL
_UPLOADS: Final = frozenset((_COUNT, _CLEAR, mavlink.MAVLINK_MSG_ID_MISSION_WRITE_PARTIAL_LIST))
_FTP: Final = mavlink.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL
_FENCE_POINT: Final = mavlink.MAVLINK_MSG_ID_FENCE_POINT
_PARAM_SET: Final = mavlink.MAVLINK_MSG_ID_PARAM_SET
_SWITCHES: Final = frozenset(SWITCH_NUMBERS[name] for name in ("SAVE_WP", "CLEAR_WP", "RELOCATE_MISSION"))
_PARAMETERS: Final = {"MIS_TOTAL": MISSION, "FENCE_TOTAL": GEOFENCE}


class ListChange(NamedTuple):
    """`what` is changed: the mission or the geofence. `clears`: it is empty afterwards."""

    what: str
    clears: bool = False


def list_change(frame: Frame) -> ListChange | None:
    """The change that a frame makes at the autopilot; None: it changes neither mission nor geofence."""
    msgid = frame.msgid
    if msgid in _UPLOADS:
        what = _BY_TYPE.get(field_int(frame, "mission_type"))
        clears = msgid == _CLEAR or (msgid == _COUNT and not field_int(frame, "count"))
        return None if what is None else ListChange(what, clears)
    if msgid == _FTP:
        files = written_lists(field_bytes(frame, "payload"))
        return None if not files else ListChange(GEOFENCE if files == {GEOFENCE} else MISSION)
    if msgid == _FENCE_POINT:
        return ListChange(GEOFENCE)
    if msgid == _PARAM_SET:
        what = _PARAMETERS.get(parameter_name(field_bytes(frame, "param_id")))
        return None if what is None else ListChange(what)
    if msgid in COMMAND_MESSAGES and field_int(frame, "command") == mavlink.MAV_CMD_DO_AUX_FUNCTION:
        which = field_float(frame, "param1")  # the autopilot keeps 16 bits; a NaN may be any number
        return ListChange(MISSION) if not isfinite(which) or int(which) & 0xFFFF in _SWITCHES else None
    return None
