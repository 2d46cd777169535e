# SPDX-License-Identifier: GPL-3.0-or-later

"""Probes of a link: MAVLink's TIMESYNC, asked by the companion and answered by the station.

A request carries a time stamp and `tc1` 0; the answer carries the stamp back and the answerer's own time
(https://mavlink.io/en/services/timesync.html). Only the stamp coming back counts here: clocks are not compared.

TIMESYNC and not PING: it is the one of the two that the standard still recommends, and a station that does not answer
it (MAVProxy and QGroundControl by themselves do not) loses nothing but the measurement. The station's module answers
it with `probe_answer`.

The stamp is the time of sending in nanoseconds with its low bits drawn at random, about a millisecond's worth: who does
not hear the downlink cannot answer in advance.

Probes come from a component of their own, PROBE_COMPID: a station's program that lists what it hears shows what they
are, and its module knows them by that.
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
    """The request with this stamp, to be packed by whoever sends it."""
    return mavlink.MAVLink_timesync_message(0, stamp)


def answered_stamp(frame: Frame) -> int | None:
    """The stamp that a TIMESYNC answer brings back; None for requests and for everything else."""
    if frame.msgid != TIMESYNC or len(frame.payload) < max(_TC1, _TS1) + _INT64.size:
        return None
    if _INT64.unpack_from(frame.payload, _TC1)[0] == 0:
        return None
    stamp: int = _INT64.unpack_from(frame.payload, _TS1)[0]
    return stamp


def probe_answer(frame: Frame, now_ns: int) -> Any | None:
    """The answer to a TIMESYNC request, to be packed and sent on every link to the vehicle; None if it is no request.

    On every link, because MAVProxy does not tell a module on which one a message came in; the companion takes the one
    that comes back on the link it asked on. `now_ns`: the answerer's clock, not 0.
    """
    if frame.msgid != TIMESYNC or len(frame.payload) < max(_TC1, _TS1) + _INT64.size:
        return None
    if _INT64.unpack_from(frame.payload, _TC1)[0] != 0:
        return None
    return mavlink.MAVLink_timesync_message(now_ns, _INT64.unpack_from(frame.payload, _TS1)[0])
