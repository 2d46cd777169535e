# SPDX-License-Identifier: GPL-3.0-or-later

"""The base of all links: frames in, frames out, counters. No link blocks or raises.

Rules that live here:

1. After its construction a device raises nothing. Network errors are counted (`LinkCounters`) and named (`trouble`).
   Construction raises LinkError for faults of this machine: a port in use, an unknown host, no right to a serial line.
   A missing peer is no fault.
2. One `read` does a limited amount of work, so that a flooded link cannot keep the others waiting.
3. `write` takes a whole frame or nothing. A frame that cannot be sent now is refused and never kept, because old
   telemetry is useless, and the protocols above repeat what matters.
4. While a frame is incomplete (`unfinished`), the caller must `read` every `schedule.TICK_S`, even if nothing arrives.
   So a frame that never ends is dropped in time (`wire.frames`, rule 5).
5. Frames of a download go by `write_more`. They may wait for the next one, until the next `write` or `flush` at the
   latest. They are refused first, so that they do not take the room of other frames.
6. The descriptor of `fileno` stays open until the next `read`; ask again after each `read`, except for a `settled`
   device. It is -1 while there is nothing to wait for.
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

#: Time (s) for which the last heard sender keeps the link, even if another sender sends genuine frames. It is a bit
#: longer than the interval of heartbeats. So two programs of one station do not take the downlink from each other in
#: turns. It also keeps a replayer of the station's frames from getting the downlink while the station sends.
PEER_HOLD_S: Final = 1.5

#: Most unsent bytes of a stream (TCP, serial): 0.2 s of a 57600 baud line and a few frames of a fast link.
OUT_BUFFER_BYTES: Final = 4096


@dataclass(slots=True)
class LinkCounters:
    """Counters of a device since it was made."""

    bytes_in: int = 0
    frames_in: int = 0  #: complete and with a valid checksum, from any sender
    bad_crc: int = 0
    unknown_id: int = 0
    garbage_bytes: int = 0
    bytes_out: int = 0
    frames_out: int = 0
    refused_out: int = 0  #: frames that could not be sent
    strangers: int = 0  #: datagrams or connections of other senders that were rejected unread
    overflowed: int = 0  #: datagrams that the system dropped because its buffer was full
    oversize: int = 0  #: datagrams longer than any station sends
    errors: int = 0  #: errors of the system: no route, connection lost, device gone
    connects: int = 0  #: connections made, or openings of the serial line


def reason(error: Exception) -> str:
    """Text of a system error, without its number."""
    text = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return " ".join(str(text).splitlines())


class Backoff:
    """Times for retries: at once, then after `first_s`, then after twice the last interval, at most `most_s`."""

    def __init__(self, first_s: float = 0.5, most_s: float = 10.0) -> None:
        self._first_s = first_s
        self._most_s = most_s
        self._wait_s = 0.0
        self._at = float("-inf")

    def due(self, now: float) -> bool:
        """True if the next attempt may be made."""
        return now >= self._at

    def tried(self, now: float) -> None:
        """Record an attempt. The interval to the next one grows each time."""
        self._wait_s = min(max(self._first_s, 2 * self._wait_s), self._most_s)
        self._at = now + self._wait_s

    def succeeded(self) -> None:
        """Record a success: after the next loss the first attempt comes soon again."""
        self._wait_s = 0.0


class OutBuffer:
    """Unsent bytes of a stream. It takes only whole frames, at most `limit` bytes."""

    def __init__(self, limit: int = OUT_BUFFER_BYTES) -> None:
        self._limit = limit
        self._data = bytearray()

    def __len__(self) -> int:
        return len(self._data)

    def add(self, frame: bytes, more: bool = False, spare: int = 0) -> bool:
        """Add a frame; False if there is no room for all of it. Downloads (`more`) may use half of the room. `spare`:
        bytes that stay free for other frames."""
        if len(self._data) + len(frame) + spare > (self._limit // 2 if more else self._limit):
            return False
        self._data += frame
        return True

    def drain(self, send: Callable[[bytes], int]) -> int:
        """Send as much as `send` takes now, and return the number of bytes. Passes on OSError of `send`, except "not
        now".
        """
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
        """Drop the unsent bytes, so that they do not go to the next peer."""
        self._data.clear()


class Device(ABC):
    """A link. See the module's rules."""

    #: True if `fileno` does not change until `close`
    settled = False

    def __init__(self, device: str, clock: Clock = time.monotonic) -> None:
        self.device = device
        self.counters = LinkCounters()
        #: text of the last error, "" while there is none
        self.trouble = ""
        self._clock = clock
        self._closed = False

    @abstractmethod
    def read(self, once: bool = False) -> list[Frame]:
        """Read the complete, valid frames that have arrived from any sender, and maintain the connection. Call it
        often.

        `once`: make as few system calls as possible. Data that is left over makes `fileno` readable again.
        """

    @abstractmethod
    def write(self, data: bytes) -> bool:
        """Send one frame. Returns False, and counts it, if it cannot be sent now."""

    def write_more(self, data: bytes) -> bool:
        """Send one frame of a download that more frames follow.

        Returns False if it cannot be sent now; that is not counted.
        """
        return self.write(data)

    def flush(self) -> None:  # noqa: B027 (most devices keep nothing)
        """Send the frames that `write_more` kept."""

    @property
    def flow_controlled(self) -> bool:
        """True if frames that the other end cannot take yet are refused here and not lost on the way."""
        return True

    @abstractmethod
    def fileno(self) -> int:
        """Descriptor to wait for until the next `read`; -1 if there is none."""

    def descriptors(self) -> list[int]:
        """All open descriptors. A child process must not keep them open. They may change in `read`."""
        fileno = self.fileno()
        return [fileno] if fileno >= 0 else []

    @property
    @abstractmethod
    def open(self) -> bool:
        """True if a frame written now would leave this machine."""

    @property
    def unfinished(self) -> bool:
        """True if a frame is incomplete. See the module's rules."""
        return False

    @abstractmethod
    def _shut(self) -> None:
        """Close all descriptors."""

    def accept_sender(self, _frame: Frame) -> bool:
        """Tell the device that a frame of the last `read` is genuine, so that its sender gets the answers.

        Returns True if its sender is the peer now.
        """
        return True  # most devices have but one

    def reply(self, _frame: Frame, data: bytes) -> None:
        """Send `data` once to the sender of a frame of the last read, even if it is not the peer."""
        self.write(data)  # most devices have but one

    def close(self) -> None:
        """Close the link. It cannot be used again. May be called twice."""
        if not self._closed:
            self._closed = True
            self._shut()

    def _split(self, splitter: FrameSplitter, data: bytes, now: float | None = None) -> list[Frame]:
        """Feed a splitter and count its results. `now`: see `FrameSplitter.feed`."""
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
