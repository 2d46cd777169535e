# SPDX-License-Identifier: GPL-3.0-or-later

"""Measures one link. Pure: time is an argument, random bits are passed in, nothing is sent here.

Input: genuine frames (the caller checks identity and signature, so that no other sender can spoil a measurement), the
device's counts of bytes and CRC errors, and wrong signatures. It measures:

* **Loss, duplicates, order** from sequence numbers, for each stream (system, component) of the station. A number up to
  127 ahead of the expected one is a gap. A number before it is late (if it was missing) or a duplicate. A sender that
  starts again looks like one gap, or like late frames. After some late frames that follow each other, the sender counts
  as restarted. A program must count what it sends on a link in one sequence, or loss is seen that did not happen;
  MAVProxy does so. Frames that are missing after a silence are no loss.
* **Loss of the downlink** from the probes without an answer. A question or its answer may be lost: the share `(1 -
  downlink loss) (1 - uplink loss)` is answered. The uplink loss is known from the sequence numbers and is removed, so
  that it does not count twice. If the uplink loss is not known, neither is the loss of the downlink. Ten seconds hold
  only 20 probes of a single link. So a link is over the limit when its loss is above it by 2.5 standard deviations. It
  is good again when the estimate itself is well below the limit. Probes during a silence of the uplink do not count. A
  station that answers no probes (a program of the standard without our module) has no measure of its downlink.
* **Round trip and jitter** from TIMESYNC probes. A stamp is valid for one answer, so a forged answer spoils at most one
  sample, and medians do not follow one sample.
* **Overflow**: datagrams that our own system dropped because its buffer was full. A flood by others causes it, or a
  stall of this program. The missing frames were lost here. So for OVERFLOW_S after the last drop only silence is
  judged: no loss, no probe, no round trip. By then the content of the full buffer has been read.
* **Silence**: time since the last genuine frame, and time since the newest answered probe. Only the latter proves that
  the way down works too.

Counts are kept in buckets of a second for the last ten seconds, so memory does not grow and old faults are forgotten.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass, fields
from math import sqrt
from operator import attrgetter
from statistics import median
from typing import Final

from mavproxy_handover.link.quality import LimitWatch, LinkEvent, LinkLimits, LinkQuality, Measure
from mavproxy_handover.link.timesync import draw_stamp
from mavproxy_handover.wire.frames import Frame

__all__ = ["OVERFLOW_S", "WINDOW_S", "LinkMonitor", "SequenceTracker"]

WINDOW_S: Final = 10
OVERFLOW_S: Final = 2.0
#: frames that must have been due before a share of lost ones is meaningful
_ENOUGH_FRAMES: Final = 8
_ENOUGH_PROBES: Final = 4
#: standard deviations by which a loss from few probes must be above its limit
_CERTAIN: Final = 2.5
#: a probe without an answer for this time (s) is lost; a later answer is ignored
_PROBE_LOST_S: Final = 3.0
_STREAMS: Final = 16
_SAMPLES: Final = 15
#: number of late frames in a row after which their sender counts as restarted
_RESTART_RUN: Final = 4


@dataclass(slots=True)
class _Bucket:
    """Counts of one second."""

    frames: int = 0
    due: int = 0  #: frames that were sent, by the sequence numbers
    lost: int = 0
    duplicates: int = 0
    reordered: int = 0
    bad_crc: int = 0
    bad_signatures: int = 0
    bytes_in: int = 0
    bytes_out: int = 0
    probes: int = 0  #: answered or lost
    probes_lost: int = 0
    overflowed: int = 0


_counts: Final = attrgetter(*(entry.name for entry in fields(_Bucket)))


class _Window:
    """The buckets of the last WINDOW_S seconds."""

    def __init__(self) -> None:
        self._buckets: deque[tuple[int, _Bucket]] = deque()

    def at(self, now: float) -> _Bucket:
        """The current bucket."""
        second = int(now // 1)
        if not self._buckets or self._buckets[-1][0] != second:
            self._buckets.append((second, _Bucket()))
        while self._buckets[0][0] <= second - WINDOW_S:
            self._buckets.popleft()
        return self._buckets[-1][1]

    def forget_probes(self) -> None:
        """Forget the results of probes, because they are not valid for the downlink any more."""
        for _second, bucket in self._buckets:
            bucket.probes = bucket.probes_lost = 0

    def sum(self, now: float) -> _Bucket:
        """The sum of all buckets."""
        self.at(now)
        return _Bucket(*map(sum, zip(*(_counts(bucket) for _second, bucket in self._buckets), strict=True)))


class SequenceTracker:
    """The sequence numbers of one stream. Each new number tells which ones before it are missing."""

    def __init__(self, first: int) -> None:
        self._begin(first)

    def _begin(self, first: int) -> None:
        self._next = (first + 1) & 0xFF
        #: bit n: number `next - 1 - n` has come. Numbers before the first one are not missing
        self._seen = (1 << 128) - 1
        self._late_run = 0
        self._late_next = -1

    def count(self, seq: int) -> tuple[int, int, int, int]:
        """Take a number; return what to add to (due, lost, duplicates, reordered).

        `lost` is -1 when a lost frame came late.
        """
        ahead = (seq - self._next) & 0xFF
        if ahead < 128:
            self._next = (seq + 1) & 0xFF
            self._seen = (self._seen << (ahead + 1) | 1) & ((1 << 128) - 1)
            self._late_run = 0
            return ahead + 1, ahead, 0, 0
        self._late_run = self._late_run + 1 if seq == self._late_next else 1
        self._late_next = (seq + 1) & 0xFF
        if self._late_run >= _RESTART_RUN:
            self._begin(seq)
            return 1, 0, 0, 0
        bit = 1 << (255 - ahead)
        if self._seen & bit:
            return 0, 0, 1, 0
        self._seen |= bit
        return 0, -1, 0, 1


class LinkMonitor:
    """Measurements of one link. `draw` gives random bits for the stamps of probes (`secrets.randbits`)."""

    def __init__(self, device: str, probe_interval_s: float, draw: Callable[[int], int], limits: LinkLimits) -> None:
        self.device = device
        self._interval_s = probe_interval_s
        self._draw = draw
        self._window = _Window()
        self._streams: OrderedDict[tuple[int, int], tuple[SequenceTracker, float]] = OrderedDict()
        self._heard_at: float | None = None
        self._probe_at = float("-inf")
        self._waiting: OrderedDict[int, float] = OrderedDict()  #: stamp -> sent at
        #: stamps that are answered already, to recognise a second answer
        self._answered: OrderedDict[int, float] = OrderedDict()
        self._samples: deque[tuple[float, float]] = deque(maxlen=_SAMPLES)
        self._answered_sent_at: float | None = None
        self._round_trip_s = 0.0
        #: until then only silence is judged
        self._overflows_until = float("-inf")
        self._limits = limits
        self._watches = {
            Measure.SILENCE: LimitWatch(device, Measure.SILENCE, limits.silence_s, 0.0),
            Measure.LOSS: LimitWatch(device, Measure.LOSS, limits.loss, limits.hold_s),
            Measure.DOWNLINK_LOSS: LimitWatch(device, Measure.DOWNLINK_LOSS, limits.loss, limits.hold_s),
            Measure.ROUND_TRIP: LimitWatch(device, Measure.ROUND_TRIP, limits.round_trip_s, limits.hold_s),
            Measure.BAD_SIGNATURES: LimitWatch(device, Measure.BAD_SIGNATURES, limits.bad_signatures, 0.0),
            Measure.OVERFLOW: LimitWatch(device, Measure.OVERFLOW, 0.0, 0.0),
        }

    # ---- what happened --------------------------------------------------------------------------------------------

    def on_frame(self, frame: Frame, now: float) -> None:
        """Count a genuine frame of the station on this link. It may be a copy of a frame of another link."""
        if self._heard_at is not None and now - self._heard_at > self._limits.silence_s:
            self._streams.clear()  # already reported as silence, and the numbers may have wrapped meanwhile
            self._window.forget_probes()
            self._waiting.clear()
        self._heard_at = now
        bucket = self._window.at(now)
        bucket.frames += 1
        if now < self._overflows_until:
            return
        stream = (frame.sysid, frame.compid)
        tracker, heard_at = self._streams.pop(stream, (None, now))
        # silence of one component: its numbers may have wrapped meanwhile
        if tracker is None or now - heard_at > WINDOW_S:
            tracker = SequenceTracker(frame.seq)
            bucket.due += 1
            if len(self._streams) >= _STREAMS:
                self._streams.popitem(last=False)
        else:
            due, lost, duplicates, reordered = tracker.count(frame.seq)
            bucket.due += due
            bucket.lost += lost
            bucket.duplicates += duplicates
            bucket.reordered += reordered
        self._streams[stream] = tracker, now

    def on_traffic(
        self, now: float, bytes_in: int = 0, bytes_out: int = 0, bad_crc: int = 0, overflowed: int = 0
    ) -> None:
        """Add what the device counted since the last call."""
        bucket = self._window.at(now)
        if overflowed:
            bucket.overflowed += overflowed
            self._overflows_until = now + OVERFLOW_S
            self._streams.clear()
        bucket.bytes_in += bytes_in
        bucket.bytes_out += bytes_out
        bucket.bad_crc += bad_crc

    def on_bad_signature(self, now: float) -> None:
        """Count a frame with an invalid signature."""
        self._window.at(now).bad_signatures += 1

    # ---- probes ---------------------------------------------------------------------------------------------------

    def probe(self, now: float) -> int | None:
        """Stamp of the probe that is due; None if none is due."""
        while self._waiting:
            stamp, sent_at = next(iter(self._waiting.items()))
            if now - sent_at <= _PROBE_LOST_S:
                break
            del self._waiting[stamp]
            if sent_at > self._overflows_until:
                bucket = self._window.at(now)
                bucket.probes += 1
                bucket.probes_lost += 1
        while self._answered and now - next(iter(self._answered.values())) > 2 * _PROBE_LOST_S:
            self._answered.popitem(last=False)
        if now < self._probe_at:
            return None
        # counted from due time to due time, so that the steps of a main loop do not lower the rate
        self._probe_at += self._interval_s
        if self._probe_at <= now:
            self._probe_at = now + self._interval_s
        stamp = draw_stamp(now, self._draw)
        self._waiting[stamp] = now
        return stamp

    def asked(self, stamp: int) -> bool:
        """True if a probe of this link has or had the stamp."""
        return stamp in self._waiting or stamp in self._answered

    def on_answer(self, stamp: int, now: float) -> None:
        """Record an answer on this link. Only the first answer to a waiting stamp counts."""
        sent_at = self._waiting.pop(stamp, None)
        if sent_at is None:
            return
        self._answered[stamp] = now
        if now >= self._overflows_until:
            self._window.at(now).probes += 1
            self._samples.append((now, now - sent_at))
            self._round_trip_s = median(sample for _at, sample in self._samples)
        if self._answered_sent_at is None or sent_at > self._answered_sent_at:
            self._answered_sent_at = sent_at

    # ---- what is known --------------------------------------------------------------------------------------------

    def heard_ago_s(self, now: float) -> float | None:
        """Time since the last genuine frame; None before the first."""
        return None if self._heard_at is None else now - self._heard_at

    def down_ago_s(self, now: float) -> float | None:
        """Age of the last proof that the way down works; None if there never was one.

        An answered probe is a proof for the time at which it was sent. The usual round trip is subtracted, because no
        newer proof is possible. If the station answers no probes, its frames are the only proof.
        """
        if self._answered_sent_at is not None:
            return max(0.0, now - self._answered_sent_at - self._round_trip_s)
        return self.heard_ago_s(now)

    def quality(self, now: float) -> LinkQuality:
        """The current measurements."""
        counts = self._window.sum(now)
        recent = [sample for at, sample in self._samples if now - at <= WINDOW_S]
        middle = median(recent) if recent else None
        loss = max(0, counts.lost) / counts.due if counts.due >= _ENOUGH_FRAMES else None
        downlink_loss, downlink_loss_least = self._downlink_loss(counts, loss)
        return LinkQuality(
            window_s=WINDOW_S,
            heard_ago_s=self.heard_ago_s(now),
            answered_ago_s=None if self._answered_sent_at is None else self.down_ago_s(now),
            loss=loss,
            probes_lost=self._probes_lost(counts),
            downlink_loss=downlink_loss,
            downlink_loss_least=downlink_loss_least,
            round_trip_s=middle,
            jitter_s=None if middle is None else median(abs(sample - middle) for sample in recent),
            frames=counts.frames,
            duplicates=counts.duplicates,
            reordered=counts.reordered,
            bad_crc=counts.bad_crc,
            bad_signatures=counts.bad_signatures,
            bytes_in_per_s=counts.bytes_in / WINDOW_S,
            bytes_out_per_s=counts.bytes_out / WINDOW_S,
            overflowed=counts.overflowed,
        )

    def _probes_lost(self, counts: _Bucket) -> float | None:
        """Share of unanswered probes; None if the station has never answered one."""
        if self._answered_sent_at is None or counts.probes < _ENOUGH_PROBES:
            return None
        return counts.probes_lost / counts.probes

    def _downlink_loss(self, counts: _Bucket, uplink_loss: float | None) -> tuple[float | None, float | None]:
        """Estimated share of the downlink that is lost, and its certain part; None: not known."""
        lost = self._probes_lost(counts)
        if lost is None or uplink_loss is None or uplink_loss >= 1.0:
            return None, None
        arrives = 1.0 - uplink_loss
        loss = min(1.0, max(0.0, 1.0 - (1.0 - lost) / arrives))
        # with two lost and two answered ones added (Agresti and Coull), so that it is not 0 at the ends
        counted = counts.probes + 4
        share = (counts.probes_lost + 2) / counted
        return loss, max(0.0, loss - _CERTAIN * sqrt(share * (1.0 - share) / counted) / arrives)

    def check(self, now: float) -> list[LinkEvent]:
        """Events for the limits that were passed in either direction since the last call."""
        quality = self.quality(now)
        values = {
            Measure.SILENCE: quality.heard_ago_s,
            Measure.LOSS: quality.loss,
            Measure.DOWNLINK_LOSS: (
                quality.downlink_loss if Measure.DOWNLINK_LOSS in self.degraded else quality.downlink_loss_least
            ),
            Measure.ROUND_TRIP: quality.round_trip_s,
            Measure.BAD_SIGNATURES: float(quality.bad_signatures),
            Measure.OVERFLOW: float(quality.overflowed),
        }
        if now < self._overflows_until:
            values |= dict.fromkeys((Measure.LOSS, Measure.DOWNLINK_LOSS, Measure.ROUND_TRIP))
        events = (self._watches[measure].update(value, now) for measure, value in values.items())
        return [event for event in events if event is not None]

    @property
    def degraded(self) -> frozenset[Measure]:
        """Measures that are over their limits."""
        return frozenset(measure for measure, watch in self._watches.items() if watch.degraded)
