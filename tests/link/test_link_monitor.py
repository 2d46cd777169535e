# SPDX-License-Identifier: GPL-3.0-or-later

"""What is measured on a link: loss, order, duplicates, round trip, silence; and when a limit is passed. No socket."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.link.monitor import LinkMonitor
from mavproxy_handover.link.quality import LimitWatch, LinkEvent, LinkEventKind, LinkLimits, Measure
from mavproxy_handover.link.timesync import answered_stamp, draw_stamp, probe_answer, probe_message
from tests.link.frames import Draw, answer, frame_of, heartbeat


@pytest.fixture
def monitor() -> LinkMonitor:
    return LinkMonitor("wifi", 0.5, Draw(), LinkLimits())


def receive(monitor: LinkMonitor, numbers: list[int], now: float = 0.0, every_s: float = 0.0) -> None:
    for place, number in enumerate(numbers):
        monitor.on_frame(heartbeat(number & 0xFF), now + place * every_s)


# ---- loss, order, duplicates --------------------------------------------------------------------------------------


def test_a_link_that_loses_nothing_has_no_loss(monitor: LinkMonitor) -> None:
    receive(monitor, list(range(600)))  # the numbers go round twice
    quality = monitor.quality(0.0)
    assert (quality.loss, quality.frames, quality.duplicates, quality.reordered) == (0.0, 600, 0, 0)


def test_gaps_in_the_numbers_are_lost_frames(monitor: LinkMonitor) -> None:
    receive(monitor, [250, 251, 254, 255, 0, 1, 5, 6])  # 252, 253, 2, 3, 4 are missing
    quality = monitor.quality(0.0)
    assert quality.loss == pytest.approx(5 / 13)
    assert quality.frames == 8


def test_loss_is_not_known_from_a_few_frames(monitor: LinkMonitor) -> None:
    receive(monitor, [0, 3, 4])
    assert monitor.quality(0.0).loss is None


def test_a_late_frame_is_not_lost_but_out_of_order(monitor: LinkMonitor) -> None:
    receive(monitor, [0, 1, 2, 4, 3, 5, 6, 7, 8, 9])
    quality = monitor.quality(0.0)
    assert (quality.loss, quality.reordered, quality.duplicates) == (0.0, 1, 0)


def test_a_frame_that_comes_twice_is_a_duplicate(monitor: LinkMonitor) -> None:
    receive(monitor, [0, 1, 2, 2, 3, 1, 4, 5, 6, 7, 8])
    quality = monitor.quality(0.0)
    assert (quality.loss, quality.duplicates, quality.reordered) == (0.0, 2, 0)


def test_a_station_that_starts_anew_is_believed_after_four_frames(monitor: LinkMonitor) -> None:
    receive(monitor, [*range(10, 110), *range(100)])
    quality = monitor.quality(0.0)
    assert quality.loss == 0.0
    assert quality.duplicates == 3


def test_every_component_of_a_station_has_numbers_of_its_own(monitor: LinkMonitor) -> None:
    for number in range(20):
        monitor.on_frame(heartbeat(number, compid=190), 0.0)
        monitor.on_frame(heartbeat(200 + number, compid=191), 0.0)
    assert monitor.quality(0.0).loss == 0.0


def test_what_is_missing_after_a_silence_is_silence_and_not_loss(monitor: LinkMonitor) -> None:
    receive(monitor, list(range(10)), now=0.0)
    receive(monitor, list(range(12, 22)), now=2.9)
    assert monitor.quality(2.9).loss == pytest.approx(2 / 22)
    receive(monitor, list(range(100, 110)), now=6.0)
    assert monitor.quality(6.0).loss == pytest.approx(2 / 32)


def test_a_component_that_was_quiet_for_long_has_lost_nothing(monitor: LinkMonitor) -> None:
    for second in range(15):
        monitor.on_frame(heartbeat(second), float(second))
        if second in (0, 12):
            monitor.on_frame(heartbeat(second * 10, compid=7), float(second))
    assert monitor.quality(14.0).loss == 0.0


def test_loss_is_forgiven_after_ten_seconds(monitor: LinkMonitor) -> None:
    receive(monitor, [*range(0, 20, 2)], now=0.0)
    assert monitor.quality(0.0).loss == pytest.approx(9 / 19)
    receive(monitor, list(range(19, 40)), now=9.0)
    assert monitor.quality(9.9).loss == pytest.approx(9 / 40)
    assert monitor.quality(10.0).loss == 0.0


@given(st.lists(st.tuples(st.integers(0, 255), st.integers(1, 255)), max_size=400), st.randoms())
def test_any_series_of_frames_gives_shares_and_counts_that_can_be(
    frames: list[tuple[int, int]], luck: random.Random
) -> None:
    monitor = LinkMonitor("wifi", 0.5, Draw(), LinkLimits())
    now = 0.0
    for seq, compid in frames:
        now += luck.random()
        monitor.on_frame(heartbeat(seq, compid=compid), now)
    quality = monitor.quality(now)
    assert quality.loss is None or 0.0 <= quality.loss < 1.0
    assert 0 <= quality.duplicates + quality.reordered <= quality.frames <= len(frames)
    assert len(monitor._streams) <= 16
    assert len(monitor._window._buckets) <= 10


def test_the_measured_loss_is_the_loss_there_was() -> None:
    monitor = LinkMonitor("wifi", 0.5, Draw(), LinkLimits())
    luck = random.Random(3)
    for number in range(1000):
        if luck.random() >= 0.2:
            monitor.on_frame(heartbeat(number & 0xFF), number / 100)
    assert monitor.quality(9.99).loss == pytest.approx(0.2, abs=0.03)


# ---- probes -------------------------------------------------------------------------------------------------------


def probe(monitor: LinkMonitor, now: float) -> int:
    stamp = monitor.probe(now)
    assert stamp is not None
    return stamp


def test_probes_are_due_at_their_interval(monitor: LinkMonitor) -> None:
    due = [tenth / 10 for tenth in range(21) if monitor.probe(tenth / 10) is not None]
    assert due == [0.0, 0.5, 1.0, 1.5, 2.0]


def test_round_trip_and_jitter_come_from_answers(monitor: LinkMonitor) -> None:
    for now, trip_s in ((0.0, 0.10), (1.0, 0.14), (2.0, 0.11), (3.0, 0.12), (4.0, 0.13)):
        monitor.on_answer(probe(monitor, now), now + trip_s)
    quality = monitor.quality(4.2)
    assert quality.round_trip_s == pytest.approx(0.12)
    assert quality.jitter_s == pytest.approx(0.01)
    assert quality.probes_lost == 0.0


def test_a_forged_answer_spoils_one_sample_and_the_median_does_not_follow_it(monitor: LinkMonitor) -> None:
    for second in range(6):
        stamp = probe(monitor, float(second))
        if second == 3:
            for _ in range(50):
                monitor.on_answer(stamp, second + 0.0001)
        monitor.on_answer(stamp, second + 0.2)
    quality = monitor.quality(5.3)
    assert [round(trip_s, 4) for _at, trip_s in monitor._samples] == [0.2, 0.2, 0.2, 0.0001, 0.2, 0.2]
    assert quality.round_trip_s == pytest.approx(0.2)
    assert quality.jitter_s == pytest.approx(0.0)


def test_an_answer_to_nothing_that_was_asked_counts_for_nothing(monitor: LinkMonitor) -> None:
    stamp = probe(monitor, 0.0)
    monitor.on_answer(stamp + 1, 0.1)
    assert not monitor.asked(stamp + 1)
    assert monitor.quality(0.2).round_trip_s is None


def test_an_answer_that_comes_too_late_is_a_lost_probe(monitor: LinkMonitor) -> None:
    stamps = []
    for second in range(7):
        stamps.append(probe(monitor, float(second)))
        if second != 2:
            monitor.on_answer(stamps[second], second + 0.1)
    assert not monitor.asked(stamps[2])  # given up at 6 s
    monitor.on_answer(stamps[2], 6.5)
    quality = monitor.quality(6.5)
    assert quality.probes_lost == pytest.approx(1 / 7)
    assert quality.round_trip_s == pytest.approx(0.1)


def test_a_station_that_never_answers_loses_no_probes(monitor: LinkMonitor) -> None:
    for half in range(40):
        monitor.probe(half / 2)
    assert monitor.quality(20.0).probes_lost is None


def test_the_proof_of_the_way_down_is_as_old_as_the_newest_probe_that_was_answered(monitor: LinkMonitor) -> None:
    assert monitor.down_ago_s(0.0) is None
    monitor.on_frame(heartbeat(), 1.0)
    assert monitor.down_ago_s(1.5) == pytest.approx(0.5)  # what is heard is all the proof there is
    for now in (2.0, 2.5, 3.0):
        monitor.on_answer(probe(monitor, now), now + 0.3)
    monitor.on_frame(heartbeat(), 4.0)
    assert monitor.heard_ago_s(4.0) == 0.0
    assert monitor.down_ago_s(4.0) == pytest.approx(0.7)  # asked at 3.0, and a round trip is 0.3 s


def test_waiting_and_answered_stamps_are_forgotten(monitor: LinkMonitor) -> None:
    for half in range(400):
        stamp = monitor.probe(half / 2)
        if stamp is not None and half % 2:
            monitor.on_answer(stamp, half / 2)
    assert len(monitor._waiting) <= 7
    assert len(monitor._answered) <= 13


def test_a_stamp_holds_the_time_and_bits_that_cannot_be_guessed() -> None:
    stamp = draw_stamp(1234.5, lambda bits: (1 << bits) - 1)
    assert abs(stamp - 1_234_500_000_000) < 1 << 20
    assert stamp & 0xFFFFF == 0xFFFFF


def test_request_and_answer_fit_each_other() -> None:
    request = frame_of(probe_message(987_654_321), sysid=1, compid=240)
    assert answered_stamp(request) is None
    reply = probe_answer(request, 55)
    assert (reply.ts1, reply.tc1) == (987_654_321, 55)
    answered = frame_of(reply)
    assert answered_stamp(answered) == 987_654_321
    assert probe_answer(answered, 66) is None


def test_other_messages_are_neither_request_nor_answer() -> None:
    assert answered_stamp(heartbeat()) is None
    assert probe_answer(heartbeat(), 1) is None
    short = frame_of(mavlink.MAVLink_timesync_message(0, 0))  # MAVLink 2 leaves its zeros out
    assert len(short.raw) < 28
    assert answered_stamp(short) is None
    assert probe_answer(short, 1).ts1 == 0


# ---- what a device counts -----------------------------------------------------------------------------------------


def test_bytes_and_damage_are_those_of_the_last_ten_seconds(monitor: LinkMonitor) -> None:
    monitor.on_traffic(0.0, bytes_in=5000, bytes_out=1000, bad_crc=3)
    monitor.on_traffic(5.0, bytes_in=2000, bytes_out=500, bad_crc=1)
    quality = monitor.quality(9.0)
    assert (quality.bytes_in_per_s, quality.bytes_out_per_s, quality.bad_crc) == (700.0, 150.0, 4)
    quality = monitor.quality(10.0)
    assert (quality.bytes_in_per_s, quality.bytes_out_per_s, quality.bad_crc) == (200.0, 50.0, 1)


# ---- limits -------------------------------------------------------------------------------------------------------


def kinds(events: list[LinkEvent]) -> list[tuple[LinkEventKind, Measure | None]]:
    return [(event.kind, event.measure) for event in events]


DEGRADED, RESTORED = LinkEventKind.DEGRADED, LinkEventKind.RESTORED


def test_silence_is_told_once_and_its_end_once(monitor: LinkMonitor) -> None:
    monitor.on_frame(heartbeat(0), 0.0)
    told = []
    for tenth in range(60):
        now = tenth / 10
        if now == 5.0:
            monitor.on_frame(heartbeat(5), now)
        told += [(now, *kind) for kind in kinds(monitor.check(now))]
    assert told == [(3.1, DEGRADED, Measure.SILENCE), (5.0, RESTORED, Measure.SILENCE)]


def test_a_station_that_was_never_heard_is_not_called_silent(monitor: LinkMonitor) -> None:
    assert [monitor.check(float(second)) for second in range(20)] == [[]] * 20


def test_loss_is_told_after_it_lasted_and_named_in_words(monitor: LinkMonitor) -> None:
    numbers = iter(range(0, 4000, 2))
    events = []
    for tenth in range(30):
        for _ in range(10):
            monitor.on_frame(heartbeat(next(numbers) & 0xFF), tenth / 10)
        events += monitor.check(tenth / 10)
    (event,) = events
    assert (event.kind, event.measure, event.device, event.limit) == (DEGRADED, Measure.LOSS, "wifi", 0.25)
    assert event.text == "link wifi degraded: loss 50%, limit 25%"
    assert monitor.degraded == {Measure.LOSS}


def test_a_slow_link_is_told(monitor: LinkMonitor) -> None:
    events = []
    for half in range(20):
        now = half / 2
        stamp = probe(monitor, now)
        events += monitor.check(now)
        monitor.on_answer(stamp, now + 1.2)
        monitor.on_frame(answer(stamp, half), now + 1.2)
    assert kinds(events) == [(DEGRADED, Measure.ROUND_TRIP)]
    assert events[0].text == "link wifi degraded: round trip 1.20 s, limit 1.00 s"


def test_repeated_bad_signatures_are_told(monitor: LinkMonitor) -> None:
    events = []
    for tenth in range(11):
        monitor.on_bad_signature(tenth / 10)
        events += monitor.check(tenth / 10)
    assert kinds(events) == [(DEGRADED, Measure.BAD_SIGNATURES)]
    assert events[0].text == "link wifi degraded: bad signatures 11, limit 10"
    assert kinds(monitor.check(20.0)) == [(RESTORED, Measure.BAD_SIGNATURES)]


def test_a_value_at_its_limit_makes_one_event_and_not_many() -> None:
    watch = LimitWatch("wifi", Measure.LOSS, 0.2, 1.0)
    luck = random.Random(1)
    events = [watch.update(0.2 + luck.uniform(-0.04, 0.04), tenth / 10) for tenth in range(600)]
    assert [event.kind for event in events if event is not None] in ([], [DEGRADED])


def test_a_short_excess_is_no_event() -> None:
    watch = LimitWatch("wifi", Measure.LOSS, 0.2, 1.0)
    values = [0.1, 0.5, 0.5, 0.5, 0.1, 0.5, 0.5, None, 0.5, 0.5]
    assert [watch.update(value, place * 0.4) for place, value in enumerate(values)] == [None] * 10


def test_it_is_restored_only_well_below_the_limit_and_after_a_while() -> None:
    watch = LimitWatch("wifi", Measure.LOSS, 0.2, 1.0)
    assert watch.update(0.3, 0.0) is None
    degraded = watch.update(0.3, 1.0)
    assert degraded is not None
    assert degraded.kind is DEGRADED
    assert watch.update(0.18, 2.0) is None
    assert watch.update(0.18, 9.0) is None  # below the limit, not well below it
    assert watch.update(0.15, 10.0) is None
    restored = watch.update(0.15, 11.0)
    assert restored is not None
    assert restored.kind is RESTORED


@pytest.mark.parametrize("name", ["silence_s", "loss", "round_trip_s", "bad_signatures", "hold_s"])
def test_a_limit_of_nothing_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match=f"^{name} = 0: must be above 0$"):
        LinkLimits(**{name: 0})


# ---- the way down -------------------------------------------------------------------------------------------------


def fly(
    monitor: LinkMonitor, seconds: int, down: float, up: float, seed: int = 1, begin_s: float = 0.0
) -> list[LinkEvent]:
    """A link that loses these parts of what goes down and up; the station sends ten frames a second and answers."""
    luck, events = random.Random(seed), []
    for tenth in range(seconds * 10):
        now = begin_s + tenth / 10
        stamp = monitor.probe(now)
        if luck.random() >= up:
            monitor.on_frame(heartbeat(round(now * 10) & 0xFF), now)
        if stamp is not None and luck.random() >= down and luck.random() >= up:
            monitor.on_answer(stamp, now + 0.05)
        if tenth % 2 == 0:
            events += monitor.check(now + 0.06)
    return events


def answered_before(monitor: LinkMonitor) -> LinkMonitor:
    assert fly(monitor, 20, 0.0, 0.0) == []
    return monitor


def test_a_link_that_loses_most_of_the_downlink_is_over_its_limit(monitor: LinkMonitor) -> None:
    """Attack 5: stations heard 4 % of the vehicle, and no link was called bad."""
    events = fly(answered_before(monitor), 30, 0.96, 0.0, begin_s=20.0)
    assert kinds(events) == [(DEGRADED, Measure.DOWNLINK_LOSS)]
    assert events[0].limit == 0.25
    assert events[0].text.startswith("link wifi degraded: downlink loss ")
    assert monitor.quality(50.0).downlink_loss == pytest.approx(0.96, abs=0.08)


def test_what_the_uplink_loses_is_no_loss_of_the_downlink(monitor: LinkMonitor) -> None:
    events = fly(answered_before(monitor), 300, 0.0, 0.5, begin_s=20.0)
    assert (DEGRADED, Measure.DOWNLINK_LOSS) not in kinds(events)
    assert (DEGRADED, Measure.LOSS) in kinds(events)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_a_fifth_lost_each_way_is_no_loss_of_the_downlink_that_counts(monitor: LinkMonitor, seed: int) -> None:
    events = fly(answered_before(monitor), 600, 0.2, 0.2, seed, begin_s=20.0)
    assert sum(event.measure is Measure.DOWNLINK_LOSS and event.kind is DEGRADED for event in events) <= 1


def test_it_is_good_again_when_it_is_clearly_better(monitor: LinkMonitor) -> None:
    fly(answered_before(monitor), 30, 0.9, 0.0, begin_s=20.0)
    assert fly(monitor, 20, 0.5, 0.0, begin_s=50.0) == []
    events = fly(monitor, 30, 0.0, 0.0, begin_s=70.0)
    assert kinds(events) == [(RESTORED, Measure.DOWNLINK_LOSS)]


def test_probes_in_a_silence_of_the_uplink_say_nothing_of_the_downlink(monitor: LinkMonitor) -> None:
    answered_before(monitor)
    for half in range(12):  # nothing comes up for six seconds
        monitor.probe(20.0 + half / 2)
        monitor.check(20.2 + half / 2)
    events = fly(monitor, 20, 0.0, 0.0, begin_s=26.0)
    assert (DEGRADED, Measure.DOWNLINK_LOSS) not in kinds(events)


def test_of_a_station_that_answers_no_probes_nothing_is_known(monitor: LinkMonitor) -> None:
    for tenth in range(300):
        monitor.probe(tenth / 10)
        monitor.on_frame(heartbeat(tenth & 0xFF), tenth / 10)
    assert monitor.quality(30.0).downlink_loss is None
    assert kinds(monitor.check(30.0)) == []


# ---- an overrun receive buffer ------------------------------------------------------------------------------------


def overrun(monitor: LinkMonitor, at: float, seconds: float) -> list[LinkEvent]:
    """A station's frames and probes for 10 s; from `at` on most of its frames are dropped by our own full buffer."""
    events = []
    for step in range(200):
        now = step * 0.05
        full = at <= now < at + seconds
        if full:
            monitor.on_traffic(now, overflowed=40)
        if not full or step % 10 == 0:
            monitor.on_frame(heartbeat(step), now)
        stamp = monitor.probe(now)
        if stamp is not None and not full:
            monitor.on_answer(stamp, now + 0.01)
        events += monitor.check(now)
    return events


def test_what_our_own_full_buffer_lost_is_no_loss_of_the_link(monitor: LinkMonitor) -> None:
    events = overrun(monitor, at=3.0, seconds=4.0)
    assert [(event.kind, event.measure) for event in events] == [(LinkEventKind.DEGRADED, Measure.OVERFLOW)]
    assert events[0].text == "link wifi degraded: receive overflow 40 datagrams, limit 0 datagrams"
    assert monitor.degraded == {Measure.OVERFLOW}
    quality = monitor.quality(9.95)
    assert (quality.loss, quality.downlink_loss, quality.overflowed) == (0.0, 0.0, 3200)


def test_an_overflow_is_over_when_ten_seconds_were_without_one(monitor: LinkMonitor) -> None:
    overrun(monitor, at=3.0, seconds=1.0)
    receive(monitor, list(range(200, 260)), 10.0, 0.1)
    assert [(event.kind, event.measure) for event in monitor.check(16.0)] == [
        (LinkEventKind.RESTORED, Measure.OVERFLOW)
    ]


def test_after_an_overflow_the_loss_of_the_link_is_judged_again(monitor: LinkMonitor) -> None:
    overrun(monitor, at=0.0, seconds=1.0)
    for place in range(100):  # every second frame is lost on the link
        monitor.on_frame(heartbeat((200 + 2 * place) & 0xFF), 10.0 + place * 0.1)
        events = monitor.check(10.0 + place * 0.1)
        if any(event.measure is Measure.LOSS for event in events):
            break
    assert monitor.degraded == {Measure.LOSS}


def test_an_overflow_does_not_hide_a_silence(monitor: LinkMonitor) -> None:
    monitor.on_frame(heartbeat(0), 0.0)
    events = []
    for step in range(100):
        monitor.on_traffic(step * 0.05, overflowed=40)
        events += monitor.check(step * 0.05)
    assert [event.measure for event in events] == [Measure.OVERFLOW, Measure.SILENCE]
