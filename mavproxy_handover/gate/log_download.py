# SPDX-License-Identifier: GPL-3.0-or-later

"""Paces a log download: no faster than the station and its link can take it.

LOG_DATA is a stream without acknowledgement. A USB or network autopilot sends it many times faster than a UDP program
reads it. What the program's socket cannot hold is lost, and the program notices only after its own time-out. Stock
MAVProxy waits 0.7 s and then asks for 20 gaps at once, of which ArduPilot serves one and ignores the others. So, rules:

1. LOG_DATA waits here in a bounded queue. A link that refuses what it cannot send (TCP, serial) gets it as fast as the
   link takes it. A UDP link gets it at `PACE_BYTES_PER_S`.
2. The autopilot is asked for `PIECE_BYTES` of the log at a time, and for the next piece when at most `LOW_BYTES` wait
   here. So the queue neither runs empty nor fills up, and the autopilot is never told to stop: on a network link a
   megabyte would still be on its way then. A frame that comes while the queue is full is lost.
3. Requests that come while one is served wait for their turn, `MOST_REQUESTS` of them. A request that contains the rest
   of the request that is served, and begins at another place, replaces it: the autopilot itself would begin again.
4. A station that asks again for data that it was sent has lost them: the pace is halved, down to
   `LEAST_PACE_BYTES_PER_S`. A program that asks for the next part when it has the one before (MAVSDK) shows that it has
   read all: the pace is doubled, up to `MOST_PACE_BYTES_PER_S`, unless some of it was lost. A download from offset 0
   begins with `PACE_BYTES_PER_S`.
5. A LOG_DATA without data says "end of log" and makes MAVProxy close its file. It is passed on only if the station
   itself asked for that place, not if the companion asked for the next piece.
6. If the autopilot sends nothing for `AGAIN_S`, and nothing waits here, it is asked again for the rest of the piece, up
   to `TRIES` times: the last frame of a piece may be lost, and the autopilot does not know. After `STALL_S` only the
   next request of the station counts. The station asks again by its own rules.
7. If the station's link takes nothing for `STUCK_S`, the link is gone: all of the download is forgotten.

Time is an argument (monotonic seconds).
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Protocol

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.wire.frames import Frame, field_int

__all__ = [
    "AGAIN_S",
    "LEAST_PACE_BYTES_PER_S",
    "LOW_BYTES",
    "MOST_BYTES",
    "MOST_PACE_BYTES_PER_S",
    "MOST_REQUESTS",
    "PACE_BYTES_PER_S",
    "PIECE_BYTES",
    "STALL_S",
    "STUCK_S",
    "TRIES",
    "LogDownload",
    "Receiver",
]

#: Bytes of frames a second to a UDP link: about 3,300 frames, 300 kB of log. Stock MAVProxy reads up to 5,000 frames a
#: second, four to a datagram, on an office computer of 2020.
PACE_BYTES_PER_S: Final = 360_000.0
LEAST_PACE_BYTES_PER_S: Final = 45_000.0
MOST_PACE_BYTES_PER_S: Final = 5_760_000.0
#: most that is sent at once after a pause: a fifth of a usual receive buffer (208 KiB, small datagrams count twice)
BURST_BYTES: Final = 16_384.0
_DATA_BYTES: Final = 90  #: of a whole LOG_DATA
#: on a fast link a request and its first frame take some milliseconds, in which nothing comes
PIECE_BYTES: Final = 4096 * _DATA_BYTES
LOW_BYTES: Final = 65_536
#: more than a piece and `LOW_BYTES`
MOST_BYTES: Final = 524_288
MOST_REQUESTS: Final = 32
#: shorter than the 0.7 s after which MAVProxy asks again
STALL_S: Final = 0.5
#: an autopilot on a serial line of 57,600 baud sends a frame in 19 ms
AGAIN_S: Final = 0.3
TRIES: Final = 3
STUCK_S: Final = 10.0
#: a program asks for its gaps one after the other: they halve the pace only once in this time
_SLOWER_EACH_S: Final = 1.0

_REQUEST: Final[int] = mavlink.MAVLINK_MSG_ID_LOG_REQUEST_DATA


class Receiver(Protocol):
    """A station as far as a download needs it."""

    @property
    def flow_controlled(self) -> bool:
        """Whether its link refuses what it cannot send now."""

    def write_more(self, data: bytes) -> bool:
        """Send a frame of many; False: not now."""


@dataclass(frozen=True, slots=True)
class _Range:
    """A request of a station: bytes `begin` to `end` of a log. `sender`, `target`: system and component ids."""

    log: int
    begin: int
    end: int
    sender: tuple[int, int]
    target: tuple[int, int]

    def asks(self, begin: int) -> bytes:
        """The station's request for the piece of it that begins there."""
        count = min(PIECE_BYTES, self.end - begin)
        message = mavlink.MAVLink_log_request_data_message(*self.target, self.log, begin, count)
        return bytes(message.pack(mavlink.MAVLink(None, srcSystem=self.sender[0], srcComponent=self.sender[1])))


class LogDownload:
    """The download of one vehicle; ArduPilot has one at a time. `to_autopilot` takes whole frames."""

    def __init__(self, to_autopilot: Callable[[bytes], None]) -> None:
        self._to_autopilot = to_autopilot
        self._receiver: Receiver | None = None
        #: the request that the autopilot serves now, and those that wait
        self._served: _Range | None = None
        self._waiting: deque[_Range] = deque()
        #: the offset that comes next, where the piece that was asked for ends, and where the companion itself began one
        self._next = self._piece_end = 0
        self._own_piece_at = -1
        self._heard_at = -math.inf
        #: how many more times the autopilot may be asked for the piece
        self._tries = TRIES
        self._queue: deque[bytes] = deque()
        #: bytes that wait for the station
        self.queued_bytes = 0
        #: the log that is downloaded, and how far it was sent
        self._log, self._sent_to = 0, 0
        self._pace = PACE_BYTES_PER_S
        self._slowed_at = -math.inf
        #: some of the part that was asked for last was lost
        self._lossy = False
        self._credit_bytes, self._credit_at = BURST_BYTES, -math.inf
        #: when the station's link last took a frame, or the queue began to fill
        self._took_at = -math.inf

    def asked(self, receiver: Receiver, frame: Frame, now: float) -> None:
        """Pass on a request about logs that passed the gate (LOG_REQUEST_*, LOG_ERASE), now or later."""
        if frame.msgid != _REQUEST:
            self.forget()
            self._to_autopilot(frame.raw)
            return
        begin = field_int(frame, "ofs")
        asked = _Range(
            field_int(frame, "id"),
            begin,
            min(begin + field_int(frame, "count"), 0xFFFFFFFF),
            (frame.sysid, frame.compid),
            (field_int(frame, "target_system"), field_int(frame, "target_component")),
        )
        self._judge_pace(asked, now)
        stalled = not self._queue and now - self._heard_at > STALL_S
        if receiver is not self._receiver or stalled:
            self.forget()
        self._receiver = receiver
        served = self._served
        if served is not None and self._replaces(asked, served):
            self._clear_queue()
            self._serve(asked, now)
        elif served is None:
            self._serve(asked, now)
        elif len(self._waiting) < MOST_REQUESTS and asked != served and asked not in self._waiting:
            self._waiting.append(asked)

    def _replaces(self, asked: _Range, served: _Range) -> bool:
        """Whether a request replaces the one that is served (rule 3). A repeated request does not: a program that hears
        nothing for half a second would begin the same place again and again."""
        left = asked.log == served.log and asked.begin < self._next and asked.end >= served.end
        return left and asked.begin != served.begin

    def _judge_pace(self, asked: _Range, now: float) -> None:
        if asked.begin == 0 or asked.log != self._log:
            self._log, self._sent_to, self._pace = asked.log, 0, PACE_BYTES_PER_S
        elif asked.begin < self._sent_to and now - self._slowed_at >= _SLOWER_EACH_S:
            self._slowed_at, self._lossy = now, True
            self._pace = max(LEAST_PACE_BYTES_PER_S, self._pace / 2)
        elif asked.begin == self._sent_to and not self._queue:
            if not self._lossy:
                self._pace = min(MOST_PACE_BYTES_PER_S, self._pace * 2)
            self._lossy = False

    def _serve(self, asked: _Range, now: float) -> None:
        self._served, self._next, self._own_piece_at = asked, asked.begin, -1
        self._ask(asked, now)

    def tick(self, now: float) -> None:
        """Ask the autopilot again for data that did not come (rule 6). To be called often."""
        served = self._served
        if served is None or self._queue or not self._tries or now - self._heard_at < AGAIN_S:
            return
        tries = self._tries - 1
        # if nothing of the station's own request has come, the answer belongs to that request
        self._own_piece_at = -1 if self._next == served.begin else self._next
        self._ask(served, now)
        self._tries = tries

    def _ask(self, served: _Range, now: float) -> None:
        """Ask for the next piece."""
        self._piece_end = min(self._next + PIECE_BYTES, served.end)
        self._heard_at, self._tries = now, TRIES
        self._to_autopilot(served.asks(self._next))

    def keeps(self, receiver: Receiver, frame: Frame, raw: bytes, now: float) -> bool:
        """Whether this LOG_DATA for a station is kept here, to be sent later or not at all."""
        served = self._served
        if served is None or receiver is not self._receiver or field_int(frame, "id") != served.log:
            return False
        begin, count = field_int(frame, "ofs"), field_int(frame, "count")
        if not served.begin <= begin <= served.end:  # it answers an earlier request
            return False
        self._heard_at, self._tries = now, TRIES
        if count == 0 and begin == self._own_piece_at:
            self._over(now)
            return True
        if begin < self._next or self.queued_bytes + len(raw) > MOST_BYTES:
            return True
        if not self._queue:
            self._took_at = now
        self._queue.append(raw)
        self.queued_bytes += len(raw)
        self._next = begin + count
        self._sent_to = max(self._sent_to, self._next)
        if count < _DATA_BYTES or self._next >= served.end:
            self._over(now)
        return True

    def _over(self, now: float) -> None:
        """All of the range has come."""
        self._served = None
        if self._waiting:
            self._serve(self._waiting.popleft(), now)

    def send(self, now: float) -> bool:
        """Send what may go now. Returns whether there is more to do. To be called in every round of the main loop."""
        receiver, queue = self._receiver, self._queue
        if receiver is None:
            return False
        paced = not receiver.flow_controlled
        self._credit_bytes = min(BURST_BYTES, self._credit_bytes + self._pace * (now - self._credit_at))
        self._credit_at = now
        while queue and (not paced or self._credit_bytes > 0.0):
            if not receiver.write_more(queue[0]):
                break
            self._took_at = now
            size = len(queue.popleft())
            self.queued_bytes -= size
            if paced:
                self._credit_bytes -= size
        served = self._served
        if served is not None and self._piece_end <= self._next < served.end and self.queued_bytes <= LOW_BYTES:
            self._own_piece_at = self._next
            self._ask(served, now)
        if queue and now - self._took_at > STUCK_S:
            self.forget()
        return bool(queue)

    def forget(self) -> None:
        """End the download: authority moves, or the station ends it, or asks for something else."""
        self._receiver = self._served = None
        self._waiting.clear()
        self._clear_queue()

    def _clear_queue(self) -> None:
        self._queue.clear()
        self.queued_bytes = 0
