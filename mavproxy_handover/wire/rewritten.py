# SPDX-License-Identifier: GPL-3.0-or-later

"""Frames with other values in some bytes of their payload: a program has another system id than its station."""

from __future__ import annotations

from binascii import crc_hqx
from collections.abc import Mapping

from mavproxy_handover.wire.frames import MAGIC_V2, REVERSED, Frame, crc_extra

__all__ = ["rewritten"]


def rewritten(frame: Frame, changed: Mapping[int, int]) -> bytes:
    """The frame as MAVLink 2, without a signature, with these bytes in its payload (offset -> value).

    `frame` must be known to the dialect. Sender, sequence number and message id stay.
    """
    payload = bytearray(frame.payload)
    for offset, value in changed.items():
        payload[offset] = value
    shortened = bytes(payload).rstrip(b"\0") or b"\0"
    head = bytes((len(shortened), 0, 0, frame.seq, frame.sysid, frame.compid)) + frame.msgid.to_bytes(3, "little")
    checked = head + shortened + crc_extra(frame.msgid)
    crc = crc_hqx(checked.translate(REVERSED), 0xFFFF)
    return bytes((MAGIC_V2,)) + head + shortened + crc.to_bytes(2, "big").translate(REVERSED)
