# SPDX-License-Identifier: GPL-3.0-or-later

"""Measures one link. Pure: time is an argument, randomness is handed in, nothing is sent from here.

What is told to it: genuine frames (identity and signature checked by the caller: strangers must not be able to spoil a
measurement), the device's byte and CRC counts, signatures that were wrong. What it measures:

* **Loss, duplicates, order** from sequence numbers, for each stream (system, component) of the station. A number up to
  127 ahead of the next one expected is a gap; one behind it is late (if it was missing) or a duplicate. A sender that
  starts anew looks like one gap, or like late frames; after some in a row that follow each other it is believed. What
  a program sends on a link must be counted in one sequence, or loss is seen where there is none; MAVProxy does so.
  What is missing after a silence is no loss: it was silence.
* **Loss of the downlink** from the probes that stay without an answer. A question or its answer may be lost: the share
  `(1 - downlink loss) (1 - uplink loss)` is answered. The uplink loss is known from the sequence numbers, and is taken
  out, so that it does not count twice. Where the uplink loss is not known, neither is this. Ten seconds hold 20 probes
  of a single link, which is few. So a link counts as over the limit when the loss is above it by 2.5 standard
  deviations, and as good again when the estimate itself is well below. Probes of a time in which the uplink was silent
  say nothing. A station that answers no probes (a program of the standard by itself) has no measure of its downlink.
* **Round trip and jitter** from TIMESYNC probes. A stamp is good for one answer, so a forged answer spoils at most one
  sample, and medians do not follow one sample.
* **Overflow**: datagrams that our own system dropped because they came faster than they were read. Others cause it by
  a flood, or this program by a stall. What is missing then was lost here. So for OVERFLOW_S after the last drop nothing
  but silence is judged: no loss, no probe, no round trip. By then what waited in the full buffer has been read.
* **Silence**: time since the last genuine frame; and since the newest probe that was answered, which alone proves that
  the way down works as well.

Counts are kept in buckets of a second for the last ten: memory does not grow, and a link that was bad is forgiven.
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
#: frames that must have been due before a share of lost ones means anything
_ENOUGH_FRAMES: Final = 8
_ENOUGH_PROBES: Final = 4
#: standard deviations by which a loss that few probes show has to be above its limit
_CERTAIN: Final = 2.5
#: a probe without an answer for so long is lost; an answer later than that is not taken any more
_PROBE_LOST_S: Final = 3.0
_STREAMS: Final = 16
_SAMPLES: Final = 15
#: late frames that follow each other, after which their sender is believed to have started anew
_RESTART_RUN: Final = 4


@dataclass(slots=True)
class _Bucket:
    """Counts of one second."""

    frames: int = 0
    due: int = 0  #: frames that the sequence numbers say were sent
    lost: int = 0
    duplicates: int = 0
    reordered: int = 0
    bad_crc: int = 0
    bad_signatures: int = 0
    bytes_in: int = 0
    bytes_out: int = 0
    probes: int = 0  #: answered or given up
    probes_lost: int = 0
    overflowed: int = 0


_counts: Final = attrgetter(*(entry.name for entry in fields(_Bucket)))


class _Window:
    """The buckets of the last WINDOW_S seconds."""

    def __init__(self) -> None:
        self._buckets: deque[tuple[int, _Bucket]] = deque()

    def at(self, now: float) -> _Bucket:
        """The present bucket."""
        second = int(now // 1)
        if not self._buckets or self._buckets[-1][0] != second:
            self._buckets.append((second, _Bucket()))
        while self._buckets[0][0] <= second - WINDOW_S:
            self._buckets.popleft()
        return self._buckets[-1][1]

    def forget_probes(self) -> None:
        """What became of probes so far says nothing of the downlink."""
        for _second, bucket in self._buckets:
            bucket.probes = bucket.probes_lost = 0

    def sum(self, now: float) -> _Bucket:
        """All of them together."""
        self.at(now)
        return _Bucket(*map(sum, zip(*(_counts(bucket) for _second, bucket in self._buckets), strict=True)))


class SequenceTracker:
    """One stream's sequence numbers: what each new one says of those before it."""

    def __init__(self, first: int) -> None:
        self._begin(first)

    def _begin(self, first: int) -> None:
        self._next = (first + 1) & 0xFF
        #: bit n: number `next - 1 - n` has come. Before the first one nothing is missing
        self._seen = (1 << 128) - 1
        self._late_run = 0
        self._late_next = -1

    def take(self, seq: int) -> tuple[int, int, int, int]:
        """(due, lost, duplicates, reordered) to be added to the counts; `lost` is -1 when a lost one came late."""
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
        self._answered: OrderedDict[int, float] = OrderedDict()  #: stamps whose answer has come, to know a second one
        self._samples: deque[tuple[float, float]] = deque(maxlen=_SAMPLES)
        self._answered_sent_at: float | None = None
        self._round_trip_s = 0.0
        #: until then nothing but silence is judged
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
        """A genuine frame of the station came in on this link, be it a copy of one that came by another."""
        if self._heard_at is not None and now - self._heard_at > self._limits.silence_s:
            self._streams.clear()  # told as silence already, and the numbers may have gone round in between
            self._window.forget_probes()
            self._waiting.clear()
        self._heard_at = now
        bucket = self._window.at(now)
        bucket.frames += 1
        if now < self._overflows_until:
            return
        stream = (frame.sysid, frame.compid)
        tracker, heard_at = self._streams.pop(stream, (None, now))
        if tracker is None or now - heard_at > WINDOW_S:  # as above, for one component
            tracker = SequenceTracker(frame.seq)
            bucket.due += 1
            if len(self._streams) >= _STREAMS:
                self._streams.popitem(last=False)
        else:
            due, lost, duplicates, reordered = tracker.take(frame.seq)
            bucket.due += due
            bucket.lost += lost
            bucket.duplicates += duplicates
            bucket.reordered += reordered
        self._streams[stream] = tracker, now

    def on_traffic(
        self, now: float, bytes_in: int = 0, bytes_out: int = 0, bad_crc: int = 0, overflowed: int = 0
    ) -> None:
        """What the device counted since the last call."""
        bucket = self._window.at(now)
        if overflowed:
            bucket.overflowed += overflowed
            self._overflows_until = now + OVERFLOW_S
            self._streams.clear()
        bucket.bytes_in += bytes_in
        bucket.bytes_out += bytes_out
        bucket.bad_crc += bad_crc

    def on_bad_signature(self, now: float) -> None:
        """A frame whose signature did not hold."""
        self._window.at(now).bad_signatures += 1

    # ---- probes ---------------------------------------------------------------------------------------------------

    def probe(self, now: float) -> int | None:
        """The stamp of the probe that is due; None when none is."""
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
        # from due time to due time, so that the steps of a main loop do not make them rarer
        self._probe_at += self._interval_s
        if self._probe_at <= now:
            self._probe_at = now + self._interval_s
        stamp = draw_stamp(now, self._draw)
        self._waiting[stamp] = now
        return stamp

    def asked(self, stamp: int) -> bool:
        """Whether a probe of this link carries or carried the stamp."""
        return stamp in self._waiting or stamp in self._answered

    def on_answer(self, stamp: int, now: float) -> None:
        """An answer came in on this link. Only the first one to a stamp that is waited for counts."""
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
        """Since the last genuine frame; None before the first."""
        return None if self._heard_at is None else now - self._heard_at

    def down_ago_s(self, now: float) -> float | None:
        """How old the proof is that the way down works; None if there never was one.

        An answered probe proves it for the moment it was sent. The usual round trip is taken off, for nothing younger
        can be known. From a station that answers no probes, what it sends is all the proof there is.
        """
        if self._answered_sent_at is not None:
            return max(0.0, now - self._answered_sent_at - self._round_trip_s)
        return self.heard_ago_s(now)

    def quality(self, now: float) -> LinkQuality:
        """The link as it is now."""
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
        """Of a station that has never answered one, unanswered probes say nothing."""
        if self._answered_sent_at is None or counts.probes < _ENOUGH_PROBES:
            return None
        return counts.probes_lost / counts.probes

    def _downlink_loss(self, counts: _Bucket, uplink_loss: float | None) -> tuple[float | None, float | None]:
        """Share of the downlink that is lost, and what of it is certain; None: not known."""
        lost = self._probes_lost(counts)
        if lost is None or uplink_loss is None or uplink_loss >= 1.0:
            return None, None
        arrives = 1.0 - uplink_loss
        loss = min(1.0, max(0.0, 1.0 - (1.0 - lost) / arrives))
        # of the count plus two lost and two answered ones (Agresti and Coull), so that it is not 0 at the ends
        counted = counts.probes + 4
        share = (counts.probes_lost + 2) / counted
        return loss, max(0.0, loss - _CERTAIN * sqrt(share * (1.0 - share) / counted) / arrives)

    def check(self, now: float) -> list[LinkEvent]:
        """The limits that were passed, either way, since the last call."""
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
        """The measures that are over their limits."""
        return frozenset(measure for measure, watch in self._watches.items() if watch.degraded)
