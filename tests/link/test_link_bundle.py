# SPDX-License-Identifier: GPL-3.0-or-later

"""Several links of one station: copies out, no command lost, the best way down. No socket, no real time."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.link.bundle import LinkBundle
from mavproxy_handover.link.quality import LinkEventKind
from mavproxy_handover.link.timesync import answered_stamp
from mavproxy_handover.wire.frames import Frame, parse_one
from tests.link.frames import Draw, FakeDevice, answer, command, frame_of, heartbeat

TELEMETRY = b"telemetry"


def probe(stamp: int) -> bytes:
    """A probe that a test can read the stamp of."""
    return b"probe" + stamp.to_bytes(8, "little")


class Bench:
    """A bundle of fake devices, and the caller's part: every frame is genuine."""

    def __init__(self, *names: str) -> None:
        self.devices = [FakeDevice(name) for name in names]
        self.bundle = LinkBundle(self.devices, probe, Draw())
        self.now = 100.0
        self.pending: list[tuple[float, FakeDevice, int]] = []  #: answers on their way: when, where, to what
        self.seq = dict.fromkeys(names, 0)

    def arrive(self, device: FakeDevice, *frames: Frame) -> list[Frame]:
        """Frames arrive; those that are passed on."""
        device.inbox += frames
        return [frame for frame in self.bundle.read(device, self.now) if self.bundle.accept(device, frame, self.now)]

    def probes(self, device: FakeDevice) -> list[int]:
        """Stamps of the probes that went out on a device; they are taken away."""
        stamps = [int.from_bytes(data[5:], "little") for data in device.sent if data.startswith(b"probe")]
        device.sent = [data for data in device.sent if not data.startswith(b"probe")]
        return stamps

    def run(self, seconds: float, trips_s: dict[str, float | None]) -> list[str]:
        """Time goes on; a device answers its probes after its trip time, or not at all (None). Texts of events."""
        texts: list[str] = []
        for _ in range(round(seconds / 0.025)):
            self.now += 0.025
            for entry in [entry for entry in self.pending if entry[0] <= self.now]:
                self.pending.remove(entry)
                _at, device, stamp = entry
                assert self.arrive(device, answer(stamp, self.seq[device.device])) == []
                self.seq[device.device] = (self.seq[device.device] + 1) & 0xFF
            texts += [event.text for event in self.bundle.tick(self.now)]
            for device in self.devices:
                for stamp in self.probes(device):
                    trip_s = trips_s[device.device]
                    if trip_s is not None:
                        self.pending.append((self.now + trip_s, device, stamp))
        return texts

    def took(self) -> list[str]:
        """The devices that the telemetry sent now goes out on."""
        for device in self.devices:
            device.sent.clear()
        assert self.bundle.write(TELEMETRY)
        return [device.device for device in self.devices if TELEMETRY in device.sent]


@pytest.fixture
def bench() -> Bench:
    return Bench("wifi", "lte")


# ---- up: copies ---------------------------------------------------------------------------------------------------


def test_of_a_frame_that_comes_by_two_links_the_first_copy_is_passed_on(bench: Bench) -> None:
    wifi, lte = bench.devices
    assert bench.arrive(wifi, command(1)) == [command(1)]
    bench.now += 0.3
    assert bench.arrive(lte, command(1)) == []
    assert bench.arrive(lte, command(2)) == [command(2)]
    assert bench.arrive(wifi, command(2)) == []
    assert bench.bundle.copies == 2


def test_a_command_sent_again_with_another_number_is_passed_on(bench: Bench) -> None:
    wifi, lte = bench.devices
    assert bench.arrive(wifi, command(1)) == [command(1)]
    assert bench.arrive(lte, command(2)) == [command(2)]


def test_equal_bytes_on_the_same_link_are_passed_on(bench: Bench) -> None:
    """Some programs never count their sequence numbers: each of their heartbeats looks like the one before."""
    wifi, lte = bench.devices
    for _ in range(10):
        bench.now += 1.0
        assert bench.arrive(wifi, heartbeat(0)) == [heartbeat(0)]
        assert bench.arrive(lte, heartbeat(0)) == []


def test_when_the_first_link_dies_the_other_is_not_mistaken_for_copies(bench: Bench) -> None:
    wifi, lte = bench.devices
    assert bench.arrive(wifi, heartbeat(0)) == [heartbeat(0)]
    assert bench.arrive(lte, heartbeat(0)) == []
    for _ in range(5):
        bench.now += 1.0
        assert bench.arrive(lte, heartbeat(0)) == [heartbeat(0)]


@pytest.mark.parametrize("lost", [0, 50])
def test_numbers_that_have_gone_round_make_no_copies_however_fast_the_station_is(bench: Bench, lost: int) -> None:
    wifi, lte = bench.devices
    assert bench.arrive(wifi, command(0)) == [command(0)]
    for number in range(1, 256 - lost):
        bench.now += 0.001
        assert bench.arrive(wifi, heartbeat(number)) == [heartbeat(number)]
    # a quarter of a second later the same command has the same number again, and wifi loses it
    assert bench.arrive(lte, command(0)) == [command(0)]


def test_a_copy_is_a_copy_for_two_seconds(bench: Bench) -> None:
    wifi, lte = bench.devices
    bench.arrive(wifi, command(1), command(2))
    bench.now += 2.0
    assert bench.arrive(lte, command(1)) == []
    bench.now += 0.1
    assert bench.arrive(lte, command(2)) == [command(2)]


def test_three_links_give_one_frame() -> None:
    bench = Bench("wifi", "lte", "radio")
    wifi, lte, radio = bench.devices
    assert bench.arrive(lte, command(1)) == [command(1)]
    assert bench.arrive(radio, command(1)) == []
    assert bench.arrive(wifi, command(1)) == []
    bench.now += 0.1
    assert bench.arrive(radio, command(1)) == [command(1)]  # sent again, without a new number
    assert bench.arrive(lte, command(1)) == []


def test_a_frame_that_was_not_genuine_makes_no_copies(bench: Bench) -> None:
    wifi, lte = bench.devices
    lte.inbox = [command(1)]
    assert bench.bundle.read(lte, bench.now) == [command(1)]  # and the caller does not accept it
    assert bench.arrive(wifi, command(1)) == [command(1)]


def test_a_copy_keeps_its_link_alive_and_its_sender_known(bench: Bench) -> None:
    wifi, lte = bench.devices
    bench.arrive(wifi, heartbeat(1))
    assert bench.arrive(lte, heartbeat(1)) == []
    assert lte.accepted == [heartbeat(1)]
    assert bench.bundle.quality(lte, bench.now).frames == 1


def test_a_copy_of_what_was_not_genuine_does_nothing_for_its_link(bench: Bench) -> None:
    wifi, lte = bench.devices
    for device in (wifi, lte):
        device.inbox = [heartbeat(1)]
        assert bench.bundle.read(device, bench.now) == [heartbeat(1)]
    assert lte.accepted == []
    assert bench.bundle.quality(lte, bench.now).heard_ago_s is None


@pytest.mark.slow
def test_memory_of_frames_is_bounded(bench: Bench) -> None:
    for number in range(20000):
        bench.arrive(bench.devices[number & 1], frame_of_number(number))
    assert sum(len(link.remembered) for link in bench.bundle._links) <= 1024
    assert len(bench.bundle._counts) <= 64


def frame_of_number(number: int) -> Frame:
    return heartbeat(number & 0xFF, compid=1 + (number >> 8) % 255)


def test_a_single_link_passes_everything_on() -> None:
    bench = Bench("wifi")
    assert bench.arrive(bench.devices[0], command(1), command(1)) == [command(1), command(1)]


# ---- probes -------------------------------------------------------------------------------------------------------


def test_answers_to_probes_are_taken_out_and_nothing_else_is(bench: Bench) -> None:
    wifi, _lte = bench.devices
    bench.bundle.tick(bench.now)
    (stamp,) = bench.probes(wifi)
    somebody_elses = answer(stamp ^ 0xFF0000000000, 5)
    assert bench.arrive(wifi, heartbeat(1), answer(stamp, 2), answer(stamp, 3), somebody_elses) == [
        heartbeat(1),
        somebody_elses,
    ]


def test_an_answer_that_comes_back_by_another_link_measures_nothing(bench: Bench) -> None:
    wifi, lte = bench.devices
    bench.bundle.tick(bench.now)
    (stamp,) = bench.probes(wifi)
    bench.now += 0.05
    assert bench.arrive(lte, answer(stamp, 1)) == []
    assert bench.bundle.quality(lte, bench.now).round_trip_s is None
    # the same bytes, on the link that asked, are a copy and yet the measurement
    bench.now += 0.05
    assert bench.arrive(wifi, answer(stamp, 1)) == []
    assert bench.bundle.quality(wifi, bench.now).round_trip_s == pytest.approx(0.1)


def test_several_links_are_probed_ten_times_a_second_and_a_single_one_twice() -> None:
    for names, expected in ((("wifi", "lte"), 100), (("wifi",), 20)):
        bench = Bench(*names)
        for tick in range(800):
            bench.bundle.tick(tick * 0.0125)
        for device in bench.devices:
            assert len(bench.probes(device)) == expected


def test_each_link_has_probes_of_its_own(bench: Bench) -> None:
    wifi, lte = bench.devices
    bench.bundle.tick(bench.now)
    (first,), (second,) = bench.probes(wifi), bench.probes(lte)
    assert first != second


def test_a_link_that_is_not_open_is_not_probed(bench: Bench) -> None:
    wifi, lte = bench.devices
    lte.open = False
    bench.bundle.tick(bench.now)
    assert (len(bench.probes(wifi)), lte.sent, lte.counters.refused_out) == (1, [], 0)


# ---- down ---------------------------------------------------------------------------------------------------------


def test_before_anybody_was_heard_everything_goes_out_on_all_links(bench: Bench) -> None:
    bench.bundle.tick(bench.now)
    assert bench.took() == ["wifi", "lte"]


def test_telemetry_takes_the_link_with_the_shorter_round_trip(bench: Bench) -> None:
    texts = bench.run(5.0, {"wifi": 0.3, "lte": 0.05})
    assert bench.took() == ["lte"]
    assert texts == ["downlink on lte now: wifi does not answer"]  # lte's answers came first
    bench = Bench("wifi", "lte")
    bench.run(5.0, {"wifi": 0.025, "lte": 0.1})
    assert bench.took() == ["wifi"]


def test_transfer_messages_and_heartbeats_go_out_on_all_links(bench: Bench) -> None:
    bench.run(5.0, {"wifi": 0.025, "lte": 0.1})
    wifi, lte = bench.devices
    beat = heartbeat(0, sysid=1, compid=191).raw
    bench.bundle.write(beat)
    bench.bundle.write_all(b"transfer")
    assert wifi.sent[-2:] == lte.sent[-2:] == [beat, b"transfer"]


def test_the_downlink_leaves_a_silent_link_within_a_second(bench: Bench) -> None:
    bench.run(5.0, {"wifi": 0.025, "lte": 0.1})
    cut_at = bench.now
    while bench.took() == ["wifi"]:
        assert bench.now - cut_at < 1.0
        texts = bench.run(0.05, {"wifi": None, "lte": 0.0})
    assert bench.took() == ["lte"]
    assert texts == ["downlink on lte now: wifi does not answer"]


def test_it_does_not_return_at_once_and_then_stays(bench: Bench) -> None:
    bench.run(5.0, {"wifi": 0.025, "lte": 0.2})
    bench.run(2.0, {"wifi": None, "lte": 0.2})
    assert bench.took() == ["lte"]
    bench.run(1.0, {"wifi": 0.025, "lte": 0.2})
    assert bench.took() == ["lte"]
    texts = bench.run(16.0, {"wifi": 0.025, "lte": 0.2})
    assert bench.took() == ["wifi"]
    assert texts == ["downlink on wifi now: lte is worse"]


def test_equal_links_do_not_alternate(bench: Bench) -> None:
    texts = []
    for second in range(40):
        slow, quick = 0.1, 0.125
        trips = {"wifi": quick, "lte": slow} if second % 2 else {"wifi": slow, "lte": quick}
        texts += bench.run(1.0, trips)
    assert texts == []


def test_loss_makes_a_fast_link_the_worse_one(bench: Bench) -> None:
    bench.run(5.0, {"wifi": 0.025, "lte": 0.1})
    assert bench.took() == ["wifi"]
    wifi, _lte = bench.devices
    for second in range(12):
        bench.run(1.0, {"wifi": 0.025, "lte": 0.1})
        for number in range(0, 60, 2):  # half of what the station sends by wifi is lost
            bench.arrive(wifi, heartbeat(number + second * 60 & 0xFF, compid=7))
    assert bench.took() == ["lte"]


def test_a_station_that_answers_no_probes_is_never_without_the_downlink(bench: Bench) -> None:
    """Stock programs: their heartbeats, once a second on either link, are all the proof there is."""
    wifi, lte = bench.devices
    for second in range(10):
        wifi_lives = second < 5
        if wifi_lives:
            bench.arrive(wifi, heartbeat(second))
        bench.arrive(lte, heartbeat(second, compid=9))
        for _ in range(20):
            bench.now += 0.05
            bench.bundle.tick(bench.now)
            took = bench.took()
            assert "lte" in took or (wifi_lives and took == ["wifi"])
    assert bench.took() == ["wifi", "lte"]


def test_only_the_way_down_is_cut_and_the_downlink_leaves_all_the_same(bench: Bench) -> None:
    wifi, _lte = bench.devices
    bench.run(5.0, {"wifi": 0.025, "lte": 0.1})
    for step in range(40):
        bench.arrive(wifi, heartbeat(step, compid=7))  # the station goes on sending by wifi
        bench.run(0.025, {"wifi": None, "lte": 0.0})
    assert bench.took() == ["lte"]


def test_a_full_link_leaves_the_frame_to_the_next(bench: Bench) -> None:
    bench.run(5.0, {"wifi": 0.025, "lte": 0.1})
    wifi, _lte = bench.devices
    wifi.full = True
    assert bench.took() == ["lte"]


def test_a_frame_that_no_link_takes_is_told(bench: Bench) -> None:
    for device in bench.devices:
        device.full = True
    assert not bench.bundle.write(TELEMETRY)
    assert not bench.bundle.write_all(TELEMETRY)


def numbers(device: FakeDevice, compid: int) -> list[int]:
    """The numbers of one sender's frames that went out on a device."""
    found = [frame for frame in map(parse_one, device.sent) if frame is not None]
    return [frame.seq for frame in found if frame.compid == compid]


def test_each_link_counts_what_goes_out_on_it_whichever_is_the_best(bench: Bench) -> None:
    """A receiver takes every hole for a frame that its link has lost."""
    wifi, lte = bench.devices
    for wifi_s, lte_s in ((0.02, 0.2), (None, 0.2), (0.02, 0.2)):
        bench.run(5.0, {"wifi": wifi_s, "lte": lte_s})
        for number in range(7):
            bench.bundle.write(
                frame_of(mavlink.MAVLink_attitude_message(number, 0, 0, 0, 0, 0, 0), 3 * number, 1, 1).raw
            )
            bench.bundle.write(heartbeat(number, sysid=1, compid=1).raw)
            bench.bundle.write_all(command(200).raw)
    assert len(wifi.sent) != len(lte.sent)
    for device in (wifi, lte):
        count = len(numbers(device, 1))
        assert count > 7
        assert numbers(device, 1) == list(range(count))
        assert numbers(device, 190) == list(range(21))


def test_what_a_full_link_left_to_the_next_has_a_number_on_that_one_only(bench: Bench) -> None:
    bench.run(5.0, {"wifi": 0.025, "lte": 0.1})
    wifi, lte = bench.devices
    beat = command(9).raw
    for full in (False, True, True, False):
        wifi.full = full
        assert bench.bundle.write(beat)
    assert (numbers(wifi, 190), numbers(lte, 190)) == ([0, 1], [0, 1])


def test_limits_that_are_passed_are_told_with_the_name_of_the_link(bench: Bench) -> None:
    wifi, _lte = bench.devices
    bench.arrive(wifi, heartbeat(1))
    events = []
    for _ in range(100):
        bench.now += 0.05
        events += bench.bundle.tick(bench.now)
    degraded = [event for event in events if event.kind is LinkEventKind.DEGRADED]
    assert [event.text for event in degraded] == ["link wifi degraded: silence 3.05 s, limit 3.00 s"]


def test_bad_signatures_are_counted_for_their_link(bench: Bench) -> None:
    wifi, lte = bench.devices
    bench.bundle.bad_signature(lte, bench.now)
    assert bench.bundle.quality(lte, bench.now).bad_signatures == 1
    assert bench.bundle.quality(wifi, bench.now).bad_signatures == 0


def test_closing_closes_every_link(bench: Bench) -> None:
    bench.bundle.close()
    assert [device.closed for device in bench.devices] == [True, True]


def test_a_bundle_of_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one link"):
        LinkBundle([], probe, Draw())


def test_the_helpers_frames_are_what_they_say() -> None:
    assert answered_stamp(answer(12)) == 12
    assert parse_one(frame_of_number(300).raw) == frame_of_number(300)
    assert frame_of_number(300) != frame_of_number(44)
