# SPDX-License-Identifier: GPL-3.0-or-later

"""Several links of one station, used as one. Pure but for the devices it is given: time is an argument.

**Up: the first copy wins.** A station (or a router, or two radios of one) may send a frame over several links. A frame
is a copy if the same bytes came by *another* link at most COPY_WINDOW_S ago. What must never be mistaken for a copy is
a command that was sent again; it differs in its sequence number, and where it does not, it is told apart thus:

* equal bytes on the same link are no copy: some programs never count their sequence numbers;
* each link delivers one copy of a frame; a second time is a new frame;
* sequence numbers go round after 256 frames, so when more than COPY_FRAMES of that sender's frames have come since,
  equal bytes are a new frame, however fast the sender is; but not where a signature is among them, whose stamp rises.

Only frames that the caller found genuine (`accept`) are remembered, so a stranger can neither fill the memory nor
have a station's frame taken for a copy of his own. Copies are taken out before signatures are looked at, because the
second copy of a signed frame looks like a replay. Of a copy that comes later than the window, signing is what remains.

**Down: the best link, or all of them.** Transfer messages go out on all links (`write_all`), heartbeats too, because
programs judge a link by them. The rest goes out on the best link that is known to work:

* A link of several is probed (`timesync`) 10 times a second. Once a second, as heartbeats come, could not show within a
  second that a link is gone. Probe and answer have 41 bytes each, signed; with two links, and each answer coming back
  on both, a link carries 0.4 kB/s down and 0.8 kB/s up for it, a tenth of the telemetry that it looks after. A single
  link is probed twice a second, for its round trip and the loss of its downlink.
* A link works if the proof that it does is younger than FRESH_S. That is 6 probes: with 20 % loss each way, 5 in a row
  go unanswered once in half a minute, and all that happens then is a change to another link that works. A link that is
  cut is left after FRESH_S and a bit, so well within a second; if only the way down is cut, half a round trip later.
* Of those that work, the one with the lowest cost: round trip and jitter in seconds, and a second for a frame that is
  lost. Another one must be better by a quarter and 20 ms for DWELL_S to take over, so that equals do not alternate.
* While no link is known to work (nobody spoke yet, or the station answers no probes and its heartbeats are all there
  is), everything goes out on all links: doubled telemetry does no harm, lost telemetry does.

So stations whose programs answer no probes are never without the downlink either; they pay with double traffic
between their heartbeats.

**What counts for the quality of a link** is proven to be the station's: signed with its key or, where there is no key,
sent by the peer that the link answers. What others send in its name to the same port counts for nothing.
"""

from __future__ import annotations

from collections import Counter, OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Protocol

from mavproxy_handover.link.base import LinkCounters
from mavproxy_handover.link.link_sequencer import Outlet, Seal
from mavproxy_handover.link.monitor import LinkMonitor
from mavproxy_handover.link.quality import LinkEvent, LinkEventKind, LinkLimits, LinkQuality
from mavproxy_handover.link.timesync import TIMESYNC, answered_stamp
from mavproxy_handover.wire.frames import MAGIC_V2, Frame

__all__ = ["COPY_FRAMES", "COPY_WINDOW_S", "DWELL_S", "FRESH_S", "LinkBundle", "LinkDevice"]

COPY_WINDOW_S: Final = 2.0
COPY_FRAMES: Final = 192
FRESH_S: Final = 0.6
DWELL_S: Final = 3.0

_PROBE_SEVERAL_S: Final = 0.1
_PROBE_SINGLE_S: Final = 0.5
_CHECK_S: Final = 0.2
#: frames remembered for each link: two seconds of 250 a second
_REMEMBERED: Final = 512
_SENDERS: Final = 64
#: frames that wait for a tick to be counted, at most
_UNCOUNTED: Final = 512
_BETTER_SHARE: Final = 0.75
_BETTER_S: Final = 0.02
#: a link whose round trip is not known is worth as much as one with this
_UNKNOWN_ROUND_TRIP_S: Final = 0.5
_LOSS_COST_S: Final = 1.0


class LinkDevice(Protocol):
    """What a bundle needs of a device; see `base.Device`."""

    @property
    def device(self) -> str: ...
    @property
    def counters(self) -> LinkCounters: ...
    @property
    def open(self) -> bool: ...
    def read(self, once: bool = False) -> list[Frame]: ...
    def write(self, data: bytes) -> bool: ...
    def write_more(self, data: bytes) -> bool: ...
    def flush(self) -> None: ...
    @property
    def flow_controlled(self) -> bool: ...
    def accept_sender(self, frame: Frame) -> bool: ...
    def close(self) -> None: ...


@dataclass(slots=True)
class _Remembered:
    """A genuine frame that came in: when, by which links, and how many of its sender's had come by then."""

    at: float
    count: int
    links: int


class _Link:
    """A device with its way out and its monitor."""

    def __init__(self, device: LinkDevice, outlet: Outlet, monitor: LinkMonitor) -> None:
        self.device = device
        self.outlet = outlet
        self.monitor = monitor
        self.remembered: OrderedDict[bytes, _Remembered] = OrderedDict()  #: frames that came first by this link
        self.uncounted: list[tuple[Frame, float]] = []  #: genuine frames, with the time they came at
        self._bytes_in = self._bytes_out = self._bad_crc = self._overflowed = 0

    def count(self, now: float) -> None:
        """Tell the monitor what came in since the last time, and what the device counted."""
        self.count_frames(now)
        seen = self.device.counters
        self.monitor.on_traffic(
            now, seen.bytes_in - self._bytes_in, seen.bytes_out - self._bytes_out, seen.bad_crc - self._bad_crc
        )
        self._bytes_in, self._bytes_out, self._bad_crc = seen.bytes_in, seen.bytes_out, seen.bad_crc

    def count_frames(self, now: float) -> None:
        """Many at once take a third of the time that they would take one by one, and none of them waits for it."""
        overflowed = self.device.counters.overflowed
        if overflowed != self._overflowed:  # before the frames, whose numbers have gaps by it
            self.monitor.on_traffic(now, overflowed=overflowed - self._overflowed)
            self._overflowed = overflowed
        waiting, self.uncounted = self.uncounted, []
        for frame, at in waiting:
            self.monitor.on_frame(frame, at)

    def works(self, now: float) -> bool:
        """Whether there is young proof that frames arrive at the station."""
        proof_ago_s = self.monitor.down_ago_s(now)
        return self.device.open and proof_ago_s is not None and proof_ago_s <= FRESH_S

    def cost_s(self, now: float) -> float:
        """What it costs to send a frame on this link."""
        quality = self.monitor.quality(now)
        trip_s = _UNKNOWN_ROUND_TRIP_S if quality.round_trip_s is None else quality.round_trip_s
        # a probe is lost on either way, so each way loses about half as many
        losses = (quality.loss, None if quality.probes_lost is None else quality.probes_lost / 2)
        worst = max((loss for loss in losses if loss is not None), default=0.0)
        return trip_s + (quality.jitter_s or 0.0) + _LOSS_COST_S * worst


class LinkBundle:
    """The links of one station.

    `probe` makes the probe with the given stamp, a whole frame. `draw` gives random bits. `seal` signs what goes out;
    None: nothing is signed. For a frame out of `read` the caller calls `accept` if identity and signature hold.
    """

    def __init__(
        self,
        devices: Sequence[LinkDevice],
        probe: Callable[[int], bytes],
        draw: Callable[[int], int],
        limits: LinkLimits | None = None,
        seal: Seal | None = None,
    ) -> None:
        if not devices:
            raise ValueError("a bundle needs at least one link")
        interval_s = _PROBE_SINGLE_S if len(devices) == 1 else _PROBE_SEVERAL_S
        limits = limits or LinkLimits()
        self._probe = probe
        self._seal = seal
        self._links = [
            _Link(
                device,
                Outlet(device.write, seal, device.write_more),
                LinkMonitor(device.device, interval_s, draw, limits),
            )
            for device in devices
        ]
        self._single = self._links[0] if len(devices) == 1 else None
        self._index = {id(device): number for number, device in enumerate(devices)}
        self._counts: Counter[tuple[int, int]] = Counter()
        self._best = 0
        self._working: tuple[int, ...] = ()
        self._challenger: tuple[int, float] | None = None
        self._check_at = float("-inf")
        #: copies taken out so far
        self.copies = 0

    # ---- up -------------------------------------------------------------------------------------------------------

    def read(self, device: LinkDevice, now: float, once: bool = False) -> list[Frame]:
        """Frames that have arrived on one of the devices, without the copies of those that came by another.

        `once`: see `base.Device.read`.
        """
        frames = device.read(once)
        if self._single is not None or not frames:
            return frames
        number = self._index[id(device)]
        fresh = []
        for frame in frames:
            if self._is_copy(number, frame, now):
                self.copies += 1
                self._credit(self._links[number], frame, now)
            else:
                fresh.append(frame)
        return fresh

    def accept(self, device: LinkDevice, frame: Frame, now: float) -> bool:
        """A frame out of `read` is the station's own: its sender is answered, it is counted, copies of it are known.

        False: it answered a probe and is of no interest to anybody else.
        """
        link = self._single
        if link is None:
            number = self._index[id(device)]
            self._remember(number, frame, now)
            link = self._links[number]
        return not self._credit(link, frame, now)

    def bad_signature(self, device: LinkDevice, now: float) -> None:
        """The signature of a frame that came in on `device` does not hold, or is missing."""
        self._links[self._index[id(device)]].monitor.on_bad_signature(now)

    def _is_copy(self, number: int, frame: Frame, now: float) -> bool:
        for other, link in enumerate(self._links):
            if other == number:
                continue
            entry = link.remembered.get(frame.raw)
            if entry is None:
                continue
            passed = self._counts[frame.sysid, frame.compid] - entry.count
            may_be_new = not frame.signed and not 0 <= passed <= COPY_FRAMES
            if now - entry.at > COPY_WINDOW_S or may_be_new or entry.links >> number & 1:
                continue
            entry.links |= 1 << number
            return True
        return False

    def _remember(self, number: int, frame: Frame, now: float) -> None:
        sender = (frame.sysid, frame.compid)
        if sender not in self._counts and len(self._counts) >= _SENDERS:
            del self._counts[next(iter(self._counts))]
        self._counts[sender] += 1
        for link in self._links:
            link.remembered.pop(frame.raw, None)
        remembered = self._links[number].remembered
        remembered[frame.raw] = _Remembered(now, self._counts[sender], 1 << number)
        if len(remembered) > _REMEMBERED:
            remembered.popitem(last=False)

    def _credit(self, link: _Link, frame: Frame, now: float) -> bool:
        """A genuine frame will be counted for its link; True if it answers a probe."""
        if link.device.accept_sender(frame) or self._seal is not None:
            link.uncounted.append((frame, now))
            if len(link.uncounted) >= _UNCOUNTED:
                link.count_frames(now)
        stamp = answered_stamp(frame) if frame.msgid == TIMESYNC else None
        if stamp is None or not any(other.monitor.asked(stamp) for other in self._links):
            return False
        # the station answers on all its links; only what comes back the way it was asked measures that way
        if link.monitor.asked(stamp):
            link.monitor.on_answer(stamp, now)
        return True

    # ---- down -----------------------------------------------------------------------------------------------------

    def write(self, data: bytes) -> bool:
        """Send a frame the best way there is; False if no link took it."""
        stamp = 0 if self._seal is None else self._seal.stamp()
        if self._single is not None:
            return self._single.outlet.send(data, stamp)
        if not self._working or _is_heartbeat(data):
            return self._send_all(data, stamp)
        if self._links[self._best].outlet.send(data, stamp):
            return True
        # its buffer is full, or it was lost just now
        return any(self._links[number].outlet.send(data, stamp) for number in self._working if number != self._best)

    def write_more(self, data: bytes) -> bool:
        """Send a frame of a download the same way; False if no link takes it now (`base`, rule 5)."""
        stamp = 0 if self._seal is None else self._seal.stamp()
        ways = self._links if not self._working else [self._links[self._best]]
        return sum([link.outlet.send(data, stamp, more=True) for link in ways if link.device.open]) > 0

    def flush(self) -> None:
        """Send what `write_more` kept."""
        for link in self._links:
            link.device.flush()

    @property
    def flow_controlled(self) -> bool:
        """Whether `write_more` refuses what the station cannot take yet; otherwise it is lost on the way."""
        return self._links[self._best].device.flow_controlled

    def write_all(self, data: bytes) -> bool:
        """Send a frame on every link that is open; False if none took it."""
        return self._send_all(data, 0 if self._seal is None else self._seal.stamp())

    def _send_all(self, data: bytes, stamp: int) -> bool:
        return sum([link.outlet.send(data, stamp) for link in self._links if link.device.open]) > 0

    # ---- time -----------------------------------------------------------------------------------------------------

    def tick(self, now: float) -> list[LinkEvent]:
        """Send the probes that are due and look at the links; what happened.

        To be called 20 times a second where there are several links, twice where there is one.
        """
        for link in self._links:
            link.count_frames(now)
            drawn = link.monitor.probe(now) if link.device.open else None
            if drawn is not None:
                link.outlet.send(self._probe(drawn), 0 if self._seal is None else self._seal.stamp())
        events: list[LinkEvent] = []
        left = self._leave_silent(now)
        if left is not None:
            events.append(self._switched(left, "does not answer"))
        if now - self._check_at < _CHECK_S:
            return events
        self._check_at = now
        for link in self._links:
            link.count(now)
            events += link.monitor.check(now)
        left = self._leave_worse(now)
        if left is not None:
            events.append(self._switched(left, "is worse"))
        return events

    def _leave_silent(self, now: float) -> int | None:
        """See to it that the best link works, if any does; the link that the downlink left, if it left one."""
        self._working = tuple(number for number, link in enumerate(self._links) if link.works(now))
        if not self._working or self._best in self._working:
            return None
        before = self._best
        self._best = min(self._working, key=lambda number: self._links[number].cost_s(now))
        self._challenger = None
        return before

    def _leave_worse(self, now: float) -> int | None:
        """Leave the best link if another has been better for long enough; the link that was left, if one was."""
        if self._best not in self._working:
            return None
        costs = {number: self._links[number].cost_s(now) for number in self._working}
        cheapest = min(costs, key=lambda number: costs[number])
        if costs[cheapest] > _BETTER_SHARE * costs[self._best] - _BETTER_S:
            self._challenger = None
            return None
        if self._challenger is None or self._challenger[0] != cheapest:
            self._challenger = (cheapest, now)
        if now - self._challenger[1] < DWELL_S:
            return None
        before, self._best, self._challenger = self._best, cheapest, None
        return before

    def _switched(self, left: int, why: str) -> LinkEvent:
        device, before = self._links[self._best].device.device, self._links[left].device.device
        return LinkEvent(LinkEventKind.SWITCHED, device, f"downlink on {device} now: {before} {why}")

    # ---- what is known --------------------------------------------------------------------------------------------

    @property
    def best(self) -> LinkDevice:
        """The link that the downlink takes, as far as one is known to work."""
        return self._links[self._best].device

    def carries(self, device: LinkDevice) -> bool:
        """Whether the downlink goes out on this link."""
        return not self._working or self._index[id(device)] == self._best

    def quality(self, device: LinkDevice, now: float) -> LinkQuality:
        """The measurements of one link."""
        link = self._links[self._index[id(device)]]
        link.count(now)
        return link.monitor.quality(now)

    def close(self) -> None:
        """Close all devices."""
        for link in self._links:
            link.device.close()


def _is_heartbeat(data: bytes) -> bool:
    if data[:1] == bytes([MAGIC_V2]):
        return data[7:10] == bytes(3)
    return data[5:6] == bytes(1)
