# SPDX-License-Identifier: GPL-3.0-or-later

"""What all links have in common: frames in, frames out, counters, and the promise never to block and never to raise.

Rules that live here:

1. After its construction a device raises nothing: what the network does is counted (`LinkCounters`) and named
   (`trouble`). Construction raises LinkError for faults of this machine: a port in use, an unknown host, no right to a
   serial line. A peer that is not there is no fault.
2. One `read` does a bounded amount of work, so that one flooded link cannot keep the others waiting.
3. `write` takes a whole frame or nothing of it. What cannot be sent now is refused, never kept for later: old
   telemetry is worth nothing, and the protocols above repeat what matters.
4. While a frame that has begun waits for the rest of it (`unfinished`), somebody must `read` every `schedule.TICK_S`,
   though nothing arrives: so a frame that never ends is given up in time (`wire.frames`, rule 5).
5. Frames of a download go by `write_more`. They may wait for the next one, never longer than until the next `write` or
   `flush`; they are the first to be refused, so that they take no other frame's place.
6. What `fileno` names stays open until the next `read`; ask again after each, but for a device that is `settled`. It is
   -1 while there is nothing to wait for.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from mavproxy_handover.wire.frames import Frame, FrameSplitter

__all__ = ["PEER_HOLD_S", "Backoff", "Clock", "Device", "LinkCounters", "OutBuffer", "reason"]

Clock = Callable[[], float]

#: A sender that was heard as lately as this keeps the link, though another one proved genuine. A bit more than the
#: interval of heartbeats: two programs of one station must not take the downlink from each other in turns, and
#: somebody who repeats the station's frames must not get it while the station speaks.
PEER_HOLD_S: Final = 1.5

#: Unsent bytes that wait for a stream (TCP, serial): 0.2 s of a 57600 baud line and a few frames of a fast link.
OUT_BUFFER_BYTES: Final = 4096


@dataclass(slots=True)
class LinkCounters:
    """What went through a device since it was made."""

    bytes_in: int = 0
    frames_in: int = 0  #: whole and checked, whoever sent them
    bad_crc: int = 0
    unknown_id: int = 0
    garbage_bytes: int = 0
    bytes_out: int = 0
    frames_out: int = 0
    refused_out: int = 0  #: frames that could not be sent
    strangers: int = 0  #: datagrams or connections of others that were turned away unread
    overflowed: int = 0  #: datagrams that the system dropped because they came faster than they were read
    oversize: int = 0  #: datagrams longer than any station sends
    errors: int = 0  #: what the system reported: no route, connection lost, device gone
    connects: int = 0  #: connections made, or the serial line opened


def reason(error: Exception) -> str:
    """An error of the system in words, without its number."""
    text = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return " ".join(str(text).splitlines())


class Backoff:
    """When to try again: at once, then after `first_s`, then twice as long each time, up to `most_s`."""

    def __init__(self, first_s: float = 0.5, most_s: float = 10.0) -> None:
        self._first_s = first_s
        self._most_s = most_s
        self._wait_s = 0.0
        self._at = float("-inf")

    def due(self, now: float) -> bool:
        """Whether the next attempt may be made."""
        return now >= self._at

    def tried(self, now: float) -> None:
        """An attempt begins now; the next one is due later each time."""
        self._wait_s = min(max(self._first_s, 2 * self._wait_s), self._most_s)
        self._at = now + self._wait_s

    def succeeded(self) -> None:
        """It works: after the next loss the first attempt is soon again."""
        self._wait_s = 0.0


class OutBuffer:
    """Bytes that wait to leave on a stream; takes whole frames only, and no more than `limit` bytes."""

    def __init__(self, limit: int = OUT_BUFFER_BYTES) -> None:
        self._limit = limit
        self._data = bytearray()

    def __len__(self) -> int:
        return len(self._data)

    def add(self, frame: bytes, more: bool = False) -> bool:
        """Take a frame; False if there is no room for all of it. Downloads (`more`) get half of the room."""
        if len(self._data) + len(frame) > (self._limit // 2 if more else self._limit):
            return False
        self._data += frame
        return True

    def drain(self, send: Callable[[bytes], int]) -> int:
        """Hand over what `send` takes now; bytes that left. OSError of `send` passes, but for "not now"."""
        sent = 0
        while self._data:
            try:
                count = send(bytes(self._data))
            except (BlockingIOError, InterruptedError):
                break
            del self._data[:count]
            sent += count
            if count == 0:
                break
        return sent

    def clear(self) -> None:
        """What waits is not sent to whoever comes next."""
        self._data.clear()


class Device(ABC):
    """One link. See the module's rules."""

    #: `fileno` stays what it is until `close`
    settled = False

    def __init__(self, device: str, clock: Clock = time.monotonic) -> None:
        self.device = device
        self.counters = LinkCounters()
        #: the last thing that went wrong, in words; empty while all is well
        self.trouble = ""
        self._clock = clock
        self._closed = False

    @abstractmethod
    def read(self, once: bool = False) -> list[Frame]:
        """Whole, checked frames that have arrived, from any sender; also looks after the connection. Call it often.

        `once`: as few system calls as there can be; what is left waits, and makes `fileno` readable again.
        """

    @abstractmethod
    def write(self, data: bytes) -> bool:
        """Send one frame; False, and counted, if that cannot be done now."""

    def write_more(self, data: bytes) -> bool:
        """Send one frame of a download, of which more follow at once; False, not counted, if it cannot be sent now."""
        return self.write(data)

    def flush(self) -> None:  # noqa: B027 (most devices keep nothing)
        """Send what `write_more` kept."""

    @property
    def flow_controlled(self) -> bool:
        """Whether what the other end cannot take yet is refused here, and not lost on the way."""
        return True

    @abstractmethod
    def fileno(self) -> int:
        """To wait for until the next `read`; -1 if there is nothing."""

    def descriptors(self) -> list[int]:
        """All descriptors that are open now; a child process must not keep them open. May change in `read`."""
        fileno = self.fileno()
        return [fileno] if fileno >= 0 else []

    @property
    @abstractmethod
    def open(self) -> bool:
        """Whether a frame written now would leave this machine."""

    @property
    def unfinished(self) -> bool:
        """Whether a frame has begun and not ended. See the module's rules."""
        return False

    @abstractmethod
    def _shut(self) -> None:
        """Give everything back."""

    def accept_sender(self, _frame: Frame) -> bool:
        """The frame, out of the last `read`, was genuine: its sender is the one to answer, where there is a choice.

        Returns whether its sender is the peer now.
        """
        return True  # most devices have but one

    def reply(self, _frame: Frame, data: bytes) -> None:
        """Send `data` once to the sender of a frame of the last read, even if that sender is not the peer."""
        self.write(data)  # most devices have but one

    def close(self) -> None:
        """Close for good; may be called twice."""
        if not self._closed:
            self._closed = True
            self._shut()

    def _split(self, splitter: FrameSplitter, data: bytes, now: float | None = None) -> list[Frame]:
        """Feed a splitter and count what it found. `now`: see `FrameSplitter.feed`."""
        seen = splitter.counters
        bad_crc, unknown, garbage = seen.bad_crc, seen.unknown_id, seen.garbage_bytes
        frames = splitter.feed(data, now)
        counters = self.counters
        counters.bytes_in += len(data)
        counters.frames_in += len(frames)
        counters.bad_crc += seen.bad_crc - bad_crc
        counters.unknown_id += seen.unknown_id - unknown
        counters.garbage_bytes += seen.garbage_bytes - garbage
        return frames

    def _sent(self, data: bytes, frames: int = 1) -> bool:
        self.counters.frames_out += frames
        self.counters.bytes_out += len(data)
        return True

    def _refused(self, frames: int = 1) -> bool:
        self.counters.refused_out += frames
        return False

    def _failed(self, error: Exception) -> None:
        self.counters.errors += 1
        self.trouble = reason(error)
