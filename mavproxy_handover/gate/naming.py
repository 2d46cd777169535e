# SPDX-License-Identifier: GPL-3.0-or-later

"""Puts a station's name in place of its number into the guard's text about the commander.

The guard knows stations by system id, and operators know them by name. This is the only text of the vehicle that is
changed on its way. A text without a known number is passed on unchanged.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.wire.frames import Frame, field_bytes, field_int
from mavproxy_handover.wire.texts import TEXT_BYTES

__all__ = ["named"]

_TEXT: Final[int] = mavlink.MAVLINK_MSG_ID_STATUSTEXT
_SAYS: Final = re.compile(rb"(HNDO: lease live, )(\d{1,3})( commands)\0*")


def named(frame: Frame, names: Mapping[int, str]) -> bytes:
    """The whole frame to send. `names`: of the stations by system id."""
    if frame.msgid != _TEXT or not frame.known:
        return frame.raw
    says = _SAYS.fullmatch(field_bytes(frame, "text"))
    name = None if says is None else names.get(int(says[2]))
    if says is None or name is None:
        return frame.raw
    text = says[1] + name.encode() + says[3]
    if len(text) > TEXT_BYTES:
        return frame.raw
    packer = mavlink.MAVLink(None, srcSystem=frame.sysid, srcComponent=frame.compid)
    packer.seq = frame.seq
    message = mavlink.MAVLink_statustext_message(field_int(frame, "severity"), text)
    packed: bytes = message.pack(packer, force_mavlink1=frame.version == 1)
    return packed
