# SPDX-License-Identifier: GPL-3.0-or-later

"""Probes of a link: MAVLink's TIMESYNC, requested by the companion and answered by the station.

A request carries a time stamp and `tc1` 0. The answer returns the stamp and the answerer's own time
(https://mavlink.io/en/services/timesync.html). Only the returned stamp counts here: clocks are not compared.

TIMESYNC is used and not PING, because the standard still recommends only TIMESYNC. A station that does not answer it
loses only the measurement. MAVProxy and QGroundControl by themselves do not answer it. The station's module answers
with `probe_answer`.

The stamp is the time of sending in nanoseconds, with about a millisecond's worth of its low bits random. So a sender
that does not hear the downlink cannot answer in advance.

Probes come from a component of their own, PROBE_COMPID. So a station's program that lists what it hears shows their
purpose, and its module recognises them.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.wire.frames import Frame, field_offset

__all__ = ["TIMESYNC", "answered_stamp", "draw_stamp", "probe_answer", "probe_message"]

TIMESYNC: Final[int] = mavlink.MAVLINK_MSG_ID_TIMESYNC
_TC1: Final = field_offset(TIMESYNC, "tc1")
_TS1: Final = field_offset(TIMESYNC, "ts1")
_INT64: Final = struct.Struct("<q")
_DRAWN_BITS: Final = 20


def draw_stamp(now: float, draw: Callable[[int], int]) -> int:
    """A stamp for a request sent at `now` (s). `draw(n)` gives n random bits (`secrets.randbits`)."""
    return (int(now * 1e9) >> _DRAWN_BITS << _DRAWN_BITS) | draw(_DRAWN_BITS)


def probe_message(stamp: int) -> Any:
    """The request with this stamp. The caller packs it."""
    return mavlink.MAVLink_timesync_message(0, stamp)


def answered_stamp(frame: Frame) -> int | None:
    """The stamp in a TIMESYNC answer; None for requests and other frames."""
    if frame.msgid != TIMESYNC or len(frame.payload) < max(_TC1, _TS1) + _INT64.size:
        return None
    if _INT64.unpack_from(frame.payload, _TC1)[0] == 0:
        return None
    stamp: int = _INT64.unpack_from(frame.payload, _TS1)[0]
    return stamp


def probe_answer(frame: Frame, now_ns: int) -> Any | None:
    """The answer to a TIMESYNC request; None if the frame is no request.

    The caller packs it and sends it on every link to the vehicle. MAVProxy does not tell a module on which link
    a message came in. The companion counts the one that comes back on the link of the request. `now_ns`: the answerer's
    clock, not 0.
    """
    if frame.msgid != TIMESYNC or len(frame.payload) < max(_TC1, _TS1) + _INT64.size:
        return None
    if _INT64.unpack_from(frame.payload, _TC1)[0] != 0:
        return None
    return mavlink.MAVLink_timesync_message(now_ns, _INT64.unpack_from(frame.payload, _TS1)[0])
