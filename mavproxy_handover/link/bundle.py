# SPDX-License-Identifier: GPL-3.0-or-later

"""Several links of one station, used as one. Pure except for the devices it is given: time is an argument.

**Up: the first copy wins.** A station (or a router, or two radios of one station) may send a frame over several links.
A frame is a copy if the same bytes came by *another* link at most COPY_WINDOW_S ago. A command that was sent again must
never count as a copy. It differs in its sequence number. If it does not, these rules apply:

* equal bytes on the same link are no copy, because some programs never count their sequence numbers;
* each link delivers one copy of a frame; a second one is a new frame;
* sequence numbers repeat after 256 frames. So equal bytes are a new frame if more than COPY_FRAMES frames of that
  sender have come since, however fast the sender is. This does not apply if frames are signed, because the stamp rises.

Only frames that the caller found genuine (`accept`) are remembered. So an unknown sender can neither fill the memory
nor make a station's frame count as a copy of its own frame. Copies are removed before signatures are checked, because
the second copy of a signed frame looks like a replay. Against a copy that comes later than the window only the
signature helps.

**Down: the best link, or all of them.** Transfer messages and heartbeats go out on all links (`write_all`); programs
judge a link by its heartbeats. The rest goes out on the best link that is known to work:

* If there are several links, each is probed (`timesync`) 10 times a second. Heartbeats, once a second, could not show
  within a second that a link is gone. Probe and answer have 41 bytes each, signed. With two links each answer comes
  back on both. So each link carries 0.4 kB/s down and 0.8 kB/s up, a tenth of the telemetry. A single link is probed
  twice a second, for its round trip and the loss of its downlink.
* A link works if its last proof is younger than FRESH_S. That is 6 probes. With 20 % loss each way, 5 probes in a row
  stay unanswered once in half a minute; then the downlink only changes to another link that works. A link that is cut
  is left a bit after FRESH_S, well within a second. If only the way down is cut, that is half a round trip later.
* Of the links that work, the one with the lowest cost is used: round trip and jitter in seconds, plus a second times
  the share of lost frames. Another link replaces it if it is better by a quarter and 20 ms for DWELL_S, so that equal
  links do not alternate.
* While no link is known to work, everything goes out on all links. That is so before any frame has come, and for a
  station that answers no probes, between its heartbeats. Doubled telemetry does no harm, lost telemetry does.

So a station whose program answers no probes always has the downlink, at the price of double traffic between its
heartbeats.

**Only genuine frames count for the quality of a link.** They are signed with the station's key or, without a key, sent
by the peer that the link answers. Frames that other senders send in the station's name to the same port do not count.
"""

from __future__ import annotations

from collections import Counter, OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from mavproxy_handover.link.base import Device
from mavproxy_handover.link.link_sequencer import LinkSequencer, Seal
from mavproxy_handover.link.monitor import LinkMonitor
from mavproxy_handover.link.quality import LinkEvent, LinkEventKind, LinkLimits, LinkQuality
from mavproxy_handover.link.timesync import TIMESYNC, answered_stamp
from mavproxy_handover.wire.frames import MAGIC_V2, Frame

__all__ = ["COPY_FRAMES", "COPY_WINDOW_S", "DWELL_S", "FRESH_S", "LinkBundle"]

COPY_WINDOW_S: Final = 2.0
COPY_FRAMES: Final = 192
FRESH_S: Final = 0.6
DWELL_S: Final = 3.0

_PROBE_SEVERAL_S: Final = 0.1
_PROBE_SINGLE_S: Final = 0.5
_CHECK_S: Final = 0.2
#: frames remembered for each link: two seconds at 250 a second
_REMEMBERED: Final = 512
_SENDERS: Final = 64
#: most frames that wait for a tick to be counted
_UNCOUNTED: Final = 512
_BETTER_SHARE: Final = 0.75
_BETTER_S: Final = 0.02
#: round trip that is assumed while it is not known
_UNKNOWN_ROUND_TRIP_S: Final = 0.5
_LOSS_COST_S: Final = 1.0


@dataclass(slots=True)
class _Remembered:
    """A genuine frame that came in: its time, its links, and the number of frames of its sender until then."""

    at: float
    count: int
    links: int


class _Link:
    """A device with its sequencer and its monitor."""

    def __init__(self, device: Device, sequencer: LinkSequencer, monitor: LinkMonitor) -> None:
        self.device = device
        self.sequencer = sequencer
        self.monitor = monitor
        self.remembered: OrderedDict[bytes, _Remembered] = OrderedDict()  #: frames that came by this link first
        self.uncounted: list[tuple[Frame, float]] = []  #: genuine frames with their times of arrival
        self._bytes_in = self._bytes_out = self._bad_crc = self._overflowed = 0

    def count(self, now: float) -> None:
        """Give the monitor the frames since the last call, and the counters of the device."""
        self.count_frames(now)
        seen = self.device.counters
        self.monitor.on_traffic(
            now, seen.bytes_in - self._bytes_in, seen.bytes_out - self._bytes_out, seen.bad_crc - self._bad_crc
        )
        self._bytes_in, self._bytes_out, self._bad_crc = seen.bytes_in, seen.bytes_out, seen.bad_crc

    def count_frames(self, now: float) -> None:
        """Give the monitor the waiting frames.

        Many frames at once take a third of the time that they take one by one, and no frame waits for it.
        """
        overflowed = self.device.counters.overflowed
        if overflowed != self._overflowed:  # before the frames, because the overflow makes gaps in their numbers
            self.monitor.on_traffic(now, overflowed=overflowed - self._overflowed)
            self._overflowed = overflowed
        waiting, self.uncounted = self.uncounted, []
        for frame, at in waiting:
            self.monitor.on_frame(frame, at)

    def works(self, now: float) -> bool:
        """True if there is recent proof that frames arrive at the station."""
        proof_ago_s = self.monitor.down_ago_s(now)
        return self.device.open and proof_ago_s is not None and proof_ago_s <= FRESH_S

    def cost_s(self, now: float) -> float:
        """Cost (s) of sending a frame on this link."""
        quality = self.monitor.quality(now)
        trip_s = _UNKNOWN_ROUND_TRIP_S if quality.round_trip_s is None else quality.round_trip_s
        # a probe may be lost on either way, so each way loses about half of them
        losses = (quality.loss, None if quality.probes_lost is None else quality.probes_lost / 2)
        worst = max((loss for loss in losses if loss is not None), default=0.0)
        return trip_s + (quality.jitter_s or 0.0) + _LOSS_COST_S * worst


class LinkBundle:
    """The links of one station.

    `probe` makes the probe with the given stamp, a whole frame. `draw` gives random bits. `seal` signs what goes out;
    None: nothing is signed. The caller must call `accept` for each frame of `read` whose identity and signature are
    valid.
    """

    def __init__(
        self,
        devices: Sequence[Device],
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
                LinkSequencer(device.write, seal, device.write_more),
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
        #: number of copies removed so far
        self.copies = 0

    # ---- up -------------------------------------------------------------------------------------------------------

    def read(self, device: Device, now: float, once: bool = False) -> list[Frame]:
        """Read the frames of one of the devices, without copies of frames that came by another.

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

    def accept(self, device: Device, frame: Frame, now: float) -> bool:
        """Record that a frame of `read` is genuine.

        Its sender gets the answers, it is counted, and later copies of it are recognised. Returns False if it only
        answers a probe, so that no other part needs it.
        """
        link = self._single
        if link is None:
            number = self._index[id(device)]
            self._remember(number, frame, now)
            link = self._links[number]
        return not self._credit(link, frame, now)

    def bad_signature(self, device: Device, now: float) -> None:
        """Count a frame on `device` whose signature is invalid or missing."""
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
        """Have a genuine frame counted for its link. Returns True if it answers a probe."""
        if link.device.accept_sender(frame) or self._seal is not None:
            link.uncounted.append((frame, now))
            if len(link.uncounted) >= _UNCOUNTED:
                link.count_frames(now)
        stamp = answered_stamp(frame) if frame.msgid == TIMESYNC else None
        if stamp is None or not any(other.monitor.asked(stamp) for other in self._links):
            return False
        # the station answers on all its links; only the answer on the asked link measures that link
        if link.monitor.asked(stamp):
            link.monitor.on_answer(stamp, now)
        return True

    # ---- down -----------------------------------------------------------------------------------------------------

    def write(self, data: bytes) -> bool:
        """Send a frame on the best link; False if no link took it."""
        stamp = 0 if self._seal is None else self._seal.stamp()
        if self._single is not None:
            return self._single.sequencer.send(data, stamp)
        if not self._working or _is_heartbeat(data):
            return self._send_all(data, stamp)
        if self._links[self._best].sequencer.send(data, stamp):
            return True
        # the buffer of the best link is full, or the link was just lost
        return any(self._links[number].sequencer.send(data, stamp) for number in self._working if number != self._best)

    def write_more(self, data: bytes) -> bool:
        """Send a frame of a download on the best link; False if no link takes it now (`base`, rule 5)."""
        stamp = 0 if self._seal is None else self._seal.stamp()
        ways = self._links if not self._working else [self._links[self._best]]
        return sum([link.sequencer.send(data, stamp, more=True) for link in ways if link.device.open]) > 0

    def flush(self) -> None:
        """Send the frames that `write_more` kept."""
        for link in self._links:
            link.device.flush()

    @property
    def flow_controlled(self) -> bool:
        """True if `write_more` refuses frames that the station cannot take yet. Otherwise they are lost on the way."""
        return self._links[self._best].device.flow_controlled

    def write_all(self, data: bytes) -> bool:
        """Send a frame on every link that is open; False if none took it."""
        return self._send_all(data, 0 if self._seal is None else self._seal.stamp())

    def _send_all(self, data: bytes, stamp: int) -> bool:
        return sum([link.sequencer.send(data, stamp) for link in self._links if link.device.open]) > 0

    # ---- time -----------------------------------------------------------------------------------------------------

    def tick(self, now: float) -> list[LinkEvent]:
        """Send the probes that are due, check the links, and return the events.

        Call it 20 times a second for several links, twice a second for one link.
        """
        for link in self._links:
            link.count_frames(now)
            drawn = link.monitor.probe(now) if link.device.open else None
            if drawn is not None:
                link.sequencer.send(self._probe(drawn), 0 if self._seal is None else self._seal.stamp())
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
        """Choose another best link if it does not work and one does. Returns the link that was left, if any."""
        self._working = tuple(number for number, link in enumerate(self._links) if link.works(now))
        if not self._working or self._best in self._working:
            return None
        before = self._best
        self._best = min(self._working, key=lambda number: self._links[number].cost_s(now))
        self._challenger = None
        return before

    def _leave_worse(self, now: float) -> int | None:
        """Leave the best link if another has been better for long enough. Returns the link that was left, if any."""
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
    def best(self) -> Device:
        """The link of the downlink, if one is known to work."""
        return self._links[self._best].device

    def carries(self, device: Device) -> bool:
        """True if the downlink goes out on this link."""
        return not self._working or self._index[id(device)] == self._best

    def quality(self, device: Device, now: float) -> LinkQuality:
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
