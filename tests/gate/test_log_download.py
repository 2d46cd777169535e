# SPDX-License-Identifier: GPL-3.0-or-later

"""Log download of the commanding station: order, pace, pieces, and what must not reach the station."""

from __future__ import annotations

from itertools import pairwise

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import AuthorityView
from mavproxy_handover.gate.judge import Fate
from mavproxy_handover.gate.log_download import (
    BURST_BYTES,
    LEAST_PACE_BYTES_PER_S,
    LOW_BYTES,
    MOST_BYTES,
    MOST_PACE_BYTES_PER_S,
    MOST_REQUESTS,
    PACE_BYTES_PER_S,
    PIECE_BYTES,
    LogDownload,
)
from mavproxy_handover.wire.frames import Frame, parse_one
from tests.gate.door import Door
from tests.gate.ledger import GCSA, GCSB, VEHICLE, A, B

ALL = 0xFFFFFFFF
WHOLE = 90
#: bytes and frames of the log in one request of the companion
PIECE = 368_640
PIECE_FRAMES = 4096
#: bytes of a whole LOG_DATA frame: header 10, payload 97, checksum 2
FRAME = 109


def packed(message: mavlink.MAVLink_message, sysid: int = GCSA, compid: int = 190) -> Frame:
    frame = parse_one(bytes(message.pack(mavlink.MAVLink(None, srcSystem=sysid, srcComponent=compid))))
    assert frame is not None
    return frame


def request(begin: int, count: int = ALL, log: int = 7) -> Frame:
    return packed(mavlink.MAVLink_log_request_data_message(VEHICLE, 1, log, begin, count))


def data(begin: int, count: int = WHOLE, log: int = 7) -> Frame:
    return packed(mavlink.MAVLink_log_data_message(log, begin, count, [1] * WHOLE), VEHICLE, 1)


class Station:
    def __init__(self, flow_controlled: bool = False) -> None:
        self.flow_controlled = flow_controlled
        self.room = 1 << 30
        self.got: list[int] = []

    def write_more(self, raw: bytes) -> bool:
        if self.room <= 0:
            return False
        self.room -= 1
        frame = parse_one(raw)
        assert frame is not None
        self.got.append(int.from_bytes(frame.payload[:4], "little"))
        return True


class Bench:
    """A download with a station and an autopilot that keeps what it is asked."""

    def __init__(self, flow_controlled: bool = False) -> None:
        self.to_autopilot: list[bytes] = []
        self.station = Station(flow_controlled)
        self.download = LogDownload(self.to_autopilot.append)
        self.now = 50.0

    def ask(self, begin: int, count: int = ALL) -> None:
        self.download.asked(self.station, request(begin, count), self.now)

    def come(self, begin: int, count: int = WHOLE) -> bool:
        frame = data(begin, count)
        return self.download.keeps(self.station, frame, frame.raw, self.now)

    def row(self, frames: int, begin: int = 0) -> None:
        """So many whole frames at once."""
        for number in range(frames):
            assert self.come(begin + number * WHOLE)

    def asked(self) -> list[tuple[str, int, int]]:
        """What the autopilot was asked since the last call: kind, offset, count."""
        found = []
        for raw in self.to_autopilot:
            message = mavlink.MAVLink(None).decode(bytearray(raw))
            assert (message.get_srcSystem(), message.get_srcComponent()) == (GCSA, 190)
            assert message.target_system == VEHICLE
            values = (message.ofs, message.count) if message.get_type() == "LOG_REQUEST_DATA" else (0, 0)
            found.append((message.get_type(), *values))
        self.to_autopilot.clear()
        return found

    def run(self, seconds: float, step_s: float = 0.02) -> None:
        for _ in range(round(seconds / step_s)):
            self.now += step_s
            self.download.send(self.now)


def test_a_short_request_passes_as_it_is_and_its_data_arrives_in_order() -> None:
    bench = Bench()
    bench.ask(0, PIECE)
    assert bench.to_autopilot == [request(0, PIECE).raw]
    bench.row(3)
    bench.come(270, 12)
    bench.run(0.1)
    assert bench.station.got == [0, 90, 180, 270]
    assert bench.download.send(bench.now) is False


def test_a_long_request_is_made_piece_by_piece() -> None:
    assert PIECE_BYTES == PIECE == PIECE_FRAMES * WHOLE
    bench = Bench(flow_controlled=True)
    bench.ask(0, PIECE + 540)
    assert bench.asked() == [("LOG_REQUEST_DATA", 0, PIECE)]
    bench.row(PIECE_FRAMES)
    assert bench.asked() == []  # the station has nothing of it yet
    bench.run(0.02)
    assert bench.asked() == [("LOG_REQUEST_DATA", PIECE, 540)]
    bench.row(6, PIECE)
    bench.run(0.02)
    assert bench.asked() == []
    assert bench.station.got == [number * WHOLE for number in range(PIECE_FRAMES + 6)]


def test_an_autopilot_on_a_network_link_sends_nothing_twice() -> None:
    """It has sent all that it was asked for before anything that is said to it arrives.

    An earlier version asked for all and told the autopilot to stop. A megabyte was on its way then: of four frames that
    came by TCP three were dropped, and asked for again.
    """
    bench = Bench(flow_controlled=True)
    bench.station.room = 0
    bench.ask(0)
    frames, came = 21_000, 0
    for _ in range(10_000):
        for kind, begin, count in bench.asked():
            assert kind == "LOG_REQUEST_DATA"
            last = min(frames, (begin + count) // WHOLE)
            for place in range(begin // WHOLE, last):
                bench.come(place * WHOLE)
                came += 1
        bench.station.room = 30
        bench.run(0.01, 0.01)
    assert bench.station.got == [number * WHOLE for number in range(frames)]
    assert came == frames


def test_data_goes_to_a_udp_link_at_the_pace_and_not_faster() -> None:
    bench = Bench()
    bench.ask(0)
    bench.row(550)  # 59,950 bytes: the autopilot is not stopped yet
    bench.download.send(bench.now)
    assert len(bench.station.got) == 151  # a burst of 16,384 bytes
    bench.run(0.1)
    assert len(bench.station.got) == 151 + 330  # 36,000 bytes
    bench.run(0.1)
    assert len(bench.station.got) == 550


def test_to_a_link_with_flow_control_data_goes_as_fast_as_it_takes_it() -> None:
    bench = Bench(flow_controlled=True)
    bench.station.room = 200
    bench.ask(0)
    bench.row(500)
    assert bench.download.send(bench.now) is True
    assert len(bench.station.got) == 200
    bench.station.room = 1000
    assert bench.download.send(bench.now) is False
    assert bench.station.got == [number * WHOLE for number in range(500)]


def test_the_next_piece_is_asked_for_before_the_station_has_all_of_the_last_one() -> None:
    bench = Bench(flow_controlled=True)
    bench.station.room = 3472
    bench.ask(0)
    bench.row(PIECE_FRAMES)
    bench.asked()
    bench.download.send(bench.now)
    assert bench.download.queued_bytes == 624 * FRAME == 68_016
    assert bench.asked() == []
    bench.station.room = 24
    bench.download.send(bench.now)
    assert bench.asked() == [("LOG_REQUEST_DATA", PIECE, PIECE)]


def test_memory_is_bounded_though_an_autopilot_sends_more_than_it_was_asked_for() -> None:
    bench = Bench()
    bench.ask(0)
    bench.row(9000)
    assert bench.download.queued_bytes <= MOST_BYTES
    kept = MOST_BYTES // FRAME
    bench.run(2.0)
    assert len(bench.station.got) == kept == 4809
    assert bench.asked()[-1] == ("LOG_REQUEST_DATA", 4809 * WHOLE, PIECE)


def test_a_frame_does_not_come_twice() -> None:
    bench = Bench()
    bench.ask(0)
    bench.row(100)
    bench.row(50, 50 * WHOLE)
    bench.row(10, 100 * WHOLE)
    bench.run(1.0)
    assert bench.station.got == [number * WHOLE for number in range(110)]


def test_data_of_a_request_before_does_not_end_the_one_that_is_served() -> None:
    bench = Bench()
    bench.ask(900, 180)
    bench.ask(4500, 90)
    bench.asked()
    assert not bench.come(90_000)  # left to the gate, which sends it on
    assert bench.asked() == []
    bench.come(900)
    bench.come(990)
    assert bench.asked() == [("LOG_REQUEST_DATA", 4500, 90)]


def test_a_paced_download_of_many_megabytes_loses_nothing_and_keeps_the_pace() -> None:
    bench = Bench()
    bench.ask(0)
    frames, place, last = 11_000, 0, 0
    begun = bench.now
    while len(bench.station.got) < frames and bench.now < begun + 60.0:
        for kind, begin, count in bench.asked():
            assert kind == "LOG_REQUEST_DATA"
            place, last = begin // WHOLE, min(frames, (begin + count) // WHOLE)
        for _ in range(80):  # 8,000 frames a second
            if place < last:
                bench.come(place * WHOLE)
                place += 1
        bench.run(0.01, 0.01)
    assert bench.station.got == [number * WHOLE for number in range(frames)]
    assert 0.97 <= frames * FRAME / (bench.now - begun) / PACE_BYTES_PER_S <= 1.03


def test_requests_for_gaps_are_served_one_after_the_other() -> None:
    bench = Bench()
    bench.ask(900, 90)
    bench.ask(1800, 180)
    bench.ask(1800, 180)  # the same again
    bench.ask(4500, 90)
    assert bench.asked() == [("LOG_REQUEST_DATA", 900, 90)]
    bench.come(900)
    assert bench.asked() == [("LOG_REQUEST_DATA", 1800, 180)]
    bench.come(1800)
    assert bench.asked() == []
    bench.come(1890)
    assert bench.asked() == [("LOG_REQUEST_DATA", 4500, 90)]
    bench.come(4500)
    bench.run(0.1)
    assert bench.station.got == [900, 1800, 1890, 4500]
    assert bench.asked() == []


def test_only_so_many_requests_wait() -> None:
    bench = Bench()
    for number in range(200):
        bench.ask(number * 900, 90)
    served = 0
    while asked := bench.asked():
        assert len(asked) == 1
        served += 1
        bench.come(asked[0][1])
    assert served == 1 + MOST_REQUESTS == 33


def test_an_end_of_log_that_the_station_did_not_ask_for_is_not_passed_on() -> None:
    """A program closes its file at LOG_DATA without data, though it may have gaps."""
    bench = Bench()
    bench.ask(0)
    bench.row(PIECE_FRAMES)  # that was all of the log
    bench.run(2.0)
    assert bench.asked()[-1][:2] == ("LOG_REQUEST_DATA", PIECE)
    assert bench.come(PIECE, 0)
    bench.run(1.0)
    assert bench.station.got == [number * WHOLE for number in range(PIECE_FRAMES)]


def test_an_end_of_log_that_the_station_asked_for_is_passed_on() -> None:
    bench = Bench()
    bench.ask(54_180)
    assert bench.come(54_180, 0)
    bench.run(0.1)
    assert bench.station.got == [54_180]


def test_a_station_that_asks_again_for_what_it_was_sent_gets_it_slower() -> None:
    bench = Bench()
    bench.ask(0, 100 * WHOLE)
    bench.row(100)
    bench.run(1.0)
    for begin in (900, 1800, 2700):  # gaps of one round: one halving
        bench.ask(begin, 90)
        bench.come(begin)
    bench.run(1.0)
    bench.ask(9090, 54_000)
    bench.row(550, 9090)
    bench.station.got.clear()
    bench.download.send(bench.now)
    burst = len(bench.station.got)
    bench.run(0.2)
    # half of 360,000 bytes a second
    assert len(bench.station.got) - burst == 330


def test_a_link_with_flow_control_leaves_no_debt_to_the_udp_link_after_it() -> None:
    """A station's best link changes in flight. After 600 frames by TCP nothing went by UDP for a fifth of a second."""
    bench = Bench(flow_controlled=True)
    bench.ask(0, 1200 * WHOLE)
    bench.row(600)
    bench.run(0.02)
    assert len(bench.station.got) == 600
    bench.station.flow_controlled = False
    bench.row(300, 600 * WHOLE)
    bench.run(0.02)
    assert len(bench.station.got) > 700


def test_a_program_that_asks_for_part_after_part_gets_each_faster_until_one_is_lost() -> None:
    """MAVSDK asks for the next 512 frames when it has those before. At one pace it got a tenth of a direct line."""
    bench, frames = Bench(), 512

    def part(number: int) -> float:
        begin = number * frames * WHOLE
        bench.ask(begin, frames * WHOLE)
        bench.row(frames, begin)
        begun = bench.now
        while bench.download.queued_bytes:
            bench.run(0.002, step_s=0.002)
        return bench.now - begun

    waits_s = [part(number) for number in range(6)]
    first_s = frames * FRAME / PACE_BYTES_PER_S
    assert 0.6 * first_s < waits_s[0] <= first_s + 0.01
    assert all(later <= before for before, later in pairwise(waits_s))
    assert waits_s[5] < first_s / 10.0
    bench.now += 2.0
    bench.ask(5 * frames * WHOLE, WHOLE)  # it lacks one frame of the last part
    bench.row(1, 5 * frames * WHOLE)
    bench.run(0.1)
    after_s = [part(number) for number in range(6, 12)]
    assert after_s[0] > waits_s[5]
    assert after_s[-1] <= waits_s[5]
    assert bench.download._pace == MOST_PACE_BYTES_PER_S


def test_the_pace_has_a_floor_and_a_new_download_has_the_full_one() -> None:
    bench = Bench()
    bench.ask(0, 600 * WHOLE)
    bench.row(600)
    bench.run(2.0)
    for _ in range(12):
        bench.now += 1.5
        bench.ask(0 + WHOLE, 90)
        bench.come(WHOLE)
        bench.run(0.1)
    assert LEAST_PACE_BYTES_PER_S == 45_000.0

    def sent_in_200_ms() -> int:
        bench.download.send(bench.now)
        before = len(bench.station.got)
        bench.run(0.2)
        return len(bench.station.got) - before

    bench.ask(601 * WHOLE, 500 * WHOLE)
    bench.row(500, 601 * WHOLE)
    assert sent_in_200_ms() in (82, 83)  # 9,000 bytes
    bench.run(2.0)
    bench.ask(0, 550 * WHOLE)
    bench.row(550)
    assert sent_in_200_ms() == 399  # 550 less the burst: 72,000 bytes would go


def test_after_a_silence_of_the_autopilot_the_next_request_counts_alone() -> None:
    bench = Bench()
    bench.ask(0)
    bench.ask(900, 90)
    bench.row(2)
    bench.run(0.6)
    bench.asked()
    bench.ask(180)
    assert bench.asked() == [("LOG_REQUEST_DATA", 180, PIECE)]
    bench.come(180, 5)
    assert bench.asked() == []  # the gap from before is not asked for


def test_data_that_the_station_did_not_ask_for_is_left_alone() -> None:
    bench = Bench()
    assert not bench.come(0)
    bench.ask(0)
    other = data(0, log=8)
    assert not bench.download.keeps(bench.station, other, other.raw, bench.now)
    assert not bench.download.keeps(Station(), data(0), data(0).raw, bench.now)


def test_an_ended_download_sends_nothing_more() -> None:
    bench = Bench()
    bench.ask(0)
    bench.row(500)
    end = packed(mavlink.MAVLink_log_request_end_message(VEHICLE, 1))
    bench.download.asked(bench.station, end, bench.now)
    assert bench.to_autopilot[-1] == end.raw
    bench.run(1.0)
    assert bench.station.got == []
    assert bench.download.queued_bytes == 0


# ---- the limits, one by one ----------------------------------------------------------------------------------------


def asks(begin: int, count: int) -> tuple[str, int, int]:
    return "LOG_REQUEST_DATA", begin, count


def test_the_sizes_and_paces() -> None:
    assert (LEAST_PACE_BYTES_PER_S, PACE_BYTES_PER_S, MOST_PACE_BYTES_PER_S) == (45_000.0, 360_000.0, 5_760_000.0)
    assert (BURST_BYTES, LOW_BYTES, MOST_BYTES, PIECE_BYTES) == (16_384.0, 65_536, 524_288, PIECE)


def test_without_a_download_there_is_nothing_to_do() -> None:
    bench = Bench()
    bench.download.tick(bench.now)
    assert (bench.download.queued_bytes, bench.download.send(bench.now), bench.asked()) == (0, False, [])


def test_a_request_ends_with_the_last_byte_that_a_log_can_have() -> None:
    bench = Bench()
    bench.ask(ALL - 50)
    assert bench.asked() == [asks(ALL - 50, 50)]


def test_a_silence_with_frames_that_wait_here_ends_no_download() -> None:
    bench = Bench(flow_controlled=True)
    bench.station.room = 0
    bench.ask(0, 1800)
    bench.row(10)
    bench.now += 0.6
    bench.ask(5000, 90)
    assert bench.download.queued_bytes == 10 * FRAME


def test_half_a_second_of_silence_is_none_yet() -> None:
    bench = Bench()
    bench.ask(0)
    bench.now += 0.5
    bench.ask(900, 90)
    assert bench.asked() == [asks(0, PIECE)]


def test_the_request_of_another_station_begins_a_download_of_its_own() -> None:
    bench, other = Bench(), Station()
    bench.ask(0)
    bench.download.asked(other, request(0), bench.now)
    assert bench.asked() == [asks(0, PIECE)] * 2
    assert bench.download.keeps(other, data(0), data(0).raw, bench.now)


def test_a_request_that_is_repeated_is_served_once() -> None:
    bench = Bench()
    bench.ask(180, 90)
    bench.ask(180, 90)
    bench.come(180)
    assert bench.asked() == [asks(180, 90)]
    assert not bench.come(270), "nothing is served any more"


def test_what_is_no_rest_of_the_request_that_is_served_waits_for_its_turn() -> None:
    for again in (request(180, log=8), request(180, 90), request(900)):
        bench = Bench()
        bench.ask(0)
        bench.row(10)
        bench.asked()
        bench.download.asked(bench.station, again, bench.now)
        assert bench.asked() == []


def pace_after(*begins: int, sent: bool = True, log: int = 7) -> float:
    """The pace after ten frames and these requests, which are a second apart."""
    bench = Bench()
    bench.ask(0, 900)
    bench.row(10)
    if sent:
        bench.download.send(bench.now)
    for begin in begins:
        bench.download.asked(bench.station, request(begin, 900, log), bench.now)
        bench.now += 1.0
    return bench.download._pace


def test_the_pace_of_the_next_request() -> None:
    full = PACE_BYTES_PER_S
    assert pace_after(900) == 2 * full, "the next part"
    assert pace_after(900, sent=False) == full, "the next part, though the one before was not sent"
    assert pace_after(1800) == full, "another part"
    assert pace_after(90) == full / 2, "a part that was lost"
    assert pace_after(90, 180) == full / 4, "another one a second later"
    assert pace_after(450, log=8) == full, "of another log nothing was lost"
    bench = Bench()
    bench.ask(0)
    bench.ask(1, 90)
    assert bench.download._pace == full


def test_an_end_of_log_at_a_place_that_was_asked_for_again_is_not_passed_on() -> None:
    bench = Bench()
    bench.ask(0, 1800)
    bench.row(9)
    bench.run(0.4)
    bench.asked()
    bench.download.tick(bench.now)
    assert bench.asked() == [asks(810, 990)]
    assert bench.come(810, 0)
    bench.run(0.1)
    assert bench.station.got == [number * WHOLE for number in range(9)]


def test_an_end_of_log_at_the_place_that_the_station_asked_for_is_passed_on_though_it_was_asked_for_again() -> None:
    bench = Bench()
    bench.ask(180, 900)
    bench.now += 0.4
    bench.download.tick(bench.now)
    assert bench.come(180, 0)
    bench.run(0.1)
    assert bench.station.got == [180]


def test_the_autopilot_is_asked_again_three_tenths_after_it_was_heard() -> None:
    bench = Bench(flow_controlled=True)
    bench.now = 0.0
    bench.ask(0, 900)
    bench.asked()
    bench.download.tick(0.29)
    assert bench.asked() == []
    bench.download.tick(0.3)
    assert bench.asked() == [asks(0, 900)]
    bench.now = 0.5
    bench.come(0)
    bench.download.send(bench.now)
    bench.download.tick(0.7)
    assert bench.asked() == []


def test_after_a_short_frame_and_after_the_end_of_the_log_the_next_request_is_served() -> None:
    bench = Bench()
    bench.ask(0)
    bench.ask(9000, 90)
    bench.asked()
    bench.come(0, 12)
    assert bench.asked() == [asks(9000, 90)]
    bench = Bench(flow_controlled=True)
    bench.ask(0)
    bench.row(PIECE_FRAMES)
    bench.ask(PIECE + 9000, 90)
    bench.download.send(bench.now)
    bench.asked()
    assert bench.come(PIECE, 0)
    assert bench.asked() == [asks(PIECE + 9000, 90)]


def test_the_queue_takes_as_many_bytes_as_it_may_hold() -> None:
    bench = Bench()
    bench.ask(0)
    bench.download.keeps(bench.station, data(0), bytes(MOST_BYTES), bench.now)
    assert bench.download.queued_bytes == MOST_BYTES


def test_a_link_is_gone_when_it_took_nothing_for_more_than_ten_seconds() -> None:
    bench = Bench(flow_controlled=True)
    bench.station.room = 0
    bench.ask(0)
    bench.row(3)
    assert bench.download.send(bench.now)
    assert bench.download.send(bench.now + 10.0)
    bench.now += 10.0
    bench.come(270)  # that is no sign of the link
    bench.station.room = 1
    assert bench.download.send(bench.now)
    assert bench.download.send(bench.now + 9.0), "it took one"
    assert not bench.download.send(bench.now + 10.1)
    assert bench.download.queued_bytes == 0


def test_frames_that_come_do_not_show_that_the_link_takes_any() -> None:
    bench = Bench(flow_controlled=True)
    bench.station.room = 0
    bench.ask(0)
    bench.row(1)
    bench.now += 9.0
    bench.come(90)
    bench.now += 2.0
    assert not bench.download.send(bench.now)


def test_a_link_with_flow_control_waits_for_no_pace() -> None:
    bench = Bench()
    bench.ask(0)
    bench.row(600)
    bench.download.send(bench.now)
    assert len(bench.station.got) < 600
    bench.station.flow_controlled = True
    bench.download.send(bench.now)
    assert len(bench.station.got) == 600


@pytest.mark.parametrize(("size", "sent"), [(16_384, 1), (16_383, 2)])
def test_a_burst_ends_when_its_bytes_are_spent(size: int, sent: int) -> None:
    class Takes(Station):
        def write_more(self, raw: bytes) -> bool:
            self.got.append(len(raw))
            return True

    station, download = Takes(), LogDownload([].append)
    download.asked(station, request(0), 0.0)
    for number in range(2):
        download.keeps(station, data(number * WHOLE), bytes(size), 0.0)
    download.send(0.0)
    assert len(station.got) == sent


@pytest.mark.parametrize(("waiting", "asked"), [(LOW_BYTES, 1), (LOW_BYTES + 1, 0)])
def test_the_next_piece_is_asked_for_when_few_bytes_wait(waiting: int, asked: int) -> None:
    bench = Bench(flow_controlled=True)
    bench.station.room = 0
    bench.ask(0)
    bench.asked()
    for number in range(PIECE_FRAMES):
        raw = bytes(waiting if number == PIECE_FRAMES - 1 else 0)
        bench.download.keeps(bench.station, data(number * WHOLE), raw, bench.now)
    bench.download.send(bench.now)
    assert bench.asked() == [asks(PIECE, PIECE)] * asked


# ---- through the whole gate -----------------------------------------------------------------------------------------


RTL_ALT = packed(mavlink.MAVLink_param_value_message(b"RTL_ALT", 30.0, 9, 900, 4), VEHICLE, 1)


def fails(_raw: bytes) -> bool:
    raise RuntimeError("broken")


def on_the_ground(door: Door, commander: int | None = GCSA) -> None:
    door.change(AuthorityView(commander=commander, armed=False))


def test_the_gate_paces_the_commanders_download_and_everything_else_goes_before_it() -> None:
    door = Door(step_s=0.0)
    on_the_ground(door)
    came = door.up(A, request(0, PIECE))
    assert came.passed == [request(0, PIECE).raw]
    for number in range(500):
        door.gate.down(data(number * WHOLE), door.now)
    heartbeat = packed(mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3), VEHICLE, 1)
    door.gate.down(heartbeat, door.now)
    port = door.ports[GCSA]
    assert port.heard == [heartbeat.raw]
    assert door.gate.downloads.wait
    for _ in range(20):
        door.now += 0.02
        door.gate.downloads.send(door.now)
    assert port.heard[1:] == [data(number * WHOLE).raw for number in range(500)]
    assert not door.gate.downloads.wait
    assert door.faults == []


def test_what_else_stations_send_leaves_a_download_alone() -> None:
    door = Door(step_s=0.0)
    on_the_ground(door)
    door.up(A, request(0))
    door.gate.down(data(0), door.now)
    door.up(A, packed(mavlink.MAVLink_param_request_list_message(VEHICLE, 1)))
    logs = [
        mavlink.MAVLink_log_request_data_message(VEHICLE, 1, 7, 0, 90),
        mavlink.MAVLink_log_request_list_message(VEHICLE, 1, 0, 9),
        mavlink.MAVLink_log_request_end_message(VEHICLE, 1),
    ]
    assert {door.up(B, packed(message, GCSB)).verdict.fate for message in logs} == {Fate.REFUSE}
    assert door.gate.downloads._log.queued_bytes == FRAME


def test_when_authority_moves_the_rest_of_a_download_is_thrown_away() -> None:
    door = Door(step_s=0.0)
    on_the_ground(door)
    door.up(A, request(0))
    for number in range(500):
        door.gate.down(data(number * WHOLE), door.now)
    on_the_ground(door, None)
    door.gate.downloads.send(door.now + 1.0)
    assert door.ports[GCSA].heard == []


def test_a_parameter_that_a_link_does_not_take_as_download_is_sent_like_any_other_frame() -> None:
    door = Door()
    on_the_ground(door)
    port = door.ports[GCSA]
    port.takes_more = False
    assert door.down(RTL_ALT) == {GCSA}


def test_a_parameter_is_offered_to_the_link_as_part_of_a_download() -> None:
    door = Door()
    on_the_ground(door)
    assert not door.gate.downloads.wait
    door.ports[GCSA].write = fails  # type: ignore[method-assign]
    assert door.down(RTL_ALT) == {GCSA}
    assert door.gate.downloads.wait


def test_a_parameter_that_comes_during_a_download_of_logs_is_none_of_it() -> None:
    door = Door()
    on_the_ground(door)
    door.up(A, request(0))
    assert door.down(RTL_ALT) == {GCSA}
    assert door.faults == []


def test_a_link_that_fails_is_reported_and_costs_that_frame_alone() -> None:
    door = Door()
    on_the_ground(door)
    port, others = door.ports[GCSA], [port for port in door.ports.values() if port.sysid != GCSA]
    port.write_more = fails  # type: ignore[method-assign]
    assert door.down(RTL_ALT) == set()
    assert [fault.split(":")[0] for fault in door.faults] == ["sending to GCSA"]
    assert door.faults[0].endswith("RuntimeError: broken\n")
    flushed: list[int] = []
    port.flush = lambda: fails(b"")  # type: ignore[method-assign]
    for other in others:
        other.flush = lambda other=other: flushed.append(other.sysid)  # type: ignore[misc]
    door.gate.downloads.send(door.now)
    assert [fault.split(":")[0] for fault in door.faults] == ["sending to GCSA"] * 2
    assert flushed == [other.sysid for other in others], "and the other links send what waits"


def test_the_gate_asks_again_for_what_the_autopilot_does_not_send() -> None:
    door = Door(step_s=0.0)
    on_the_ground(door)
    door.up(A, request(0, 900))
    door.gate.tick(door.now + 0.2)
    assert len(door.passed) == 1
    door.gate.tick(door.now + 0.4)
    assert [mavlink.MAVLink(None).decode(bytearray(raw)).get_type() for raw in door.passed] == ["LOG_REQUEST_DATA"] * 2


def test_a_fault_of_the_download_is_told_and_ends_it() -> None:
    door = Door(step_s=0.0)
    on_the_ground(door)
    door.up(A, request(0))
    door.gate.down(data(0), door.now)

    door.ports[GCSA].write_more = fails  # type: ignore[method-assign]
    door.gate.downloads.send(door.now)
    assert [fault.split(":")[0] for fault in door.faults] == ["log download"]
    assert not door.gate.downloads.wait
    door.gate.downloads.send(door.now)
    assert len(door.faults) == 1


def test_a_request_for_nothing_is_made_once_and_its_answer_reaches_the_station() -> None:
    """The fault: it was made again in every round of the main loop, and the answer was taken for the companion's."""
    bench = Bench()
    bench.ask(180, 0)
    bench.run(0.1)
    assert bench.asked() == [("LOG_REQUEST_DATA", 180, 0)]
    bench.come(180, 0)
    bench.run(0.1)
    assert bench.station.got == [180]


def test_where_the_last_frame_of_a_piece_is_lost_the_rest_is_asked_for_again() -> None:
    """The fault: nothing was asked until the station's own time-out, 0.7 s in MAVProxy."""
    bench = Bench()
    bench.ask(0, 900)
    bench.row(9)
    bench.download.send(bench.now)
    bench.asked()
    bench.now += 0.2
    bench.download.tick(bench.now)
    assert bench.asked() == []
    bench.now += 0.2
    bench.download.tick(bench.now)
    assert bench.asked() == [("LOG_REQUEST_DATA", 810, 90)]
    bench.row(1, 810)
    bench.now += 5.0
    bench.download.tick(bench.now)
    assert bench.asked() == []


def test_an_autopilot_that_answers_nothing_is_asked_three_times_more() -> None:
    bench = Bench()
    bench.ask(0, 900)
    bench.asked()
    for _ in range(100):
        bench.now += 0.1
        bench.download.tick(bench.now)
    assert bench.asked() == [("LOG_REQUEST_DATA", 0, 900)] * 3


def test_while_the_station_has_not_taken_what_came_the_autopilot_is_asked_for_nothing() -> None:
    bench = Bench(flow_controlled=True)
    bench.station.room = 0
    bench.ask(0)
    bench.row(PIECE_FRAMES)
    bench.asked()
    bench.now += 1.0
    bench.download.tick(bench.now)
    assert bench.asked() == []


def test_a_station_whose_link_is_gone_costs_the_main_loop_nothing_after_some_seconds() -> None:
    """The fault: what waited for it was offered to its link 500 times a second until authority moved."""
    bench = Bench(flow_controlled=True)
    bench.ask(0)
    bench.row(20)
    bench.station.room = 5
    assert bench.download.send(bench.now)
    bench.now += 9.0
    assert bench.download.send(bench.now)
    bench.now += 2.0
    assert not bench.download.send(bench.now)
    assert bench.download.queued_bytes == 0
    bench.station.room = 1 << 30
    bench.ask(450, 90)
    bench.row(1, 450)
    bench.download.send(bench.now)
    assert bench.station.got == [0, 90, 180, 270, 360, 450]


def test_a_request_that_holds_all_that_is_left_of_the_one_before_takes_its_place() -> None:
    """The fault: a program that asks for the rest of the log after a gap got the rest twice, at the lowest pace."""
    bench = Bench()
    bench.ask(0)
    bench.row(PIECE_FRAMES)
    bench.asked()
    bench.ask(180)
    assert bench.asked() == [("LOG_REQUEST_DATA", 180, PIECE)]
    assert bench.come(180)
    bench.download.send(bench.now)
    assert bench.station.got == [180]


def test_a_request_that_is_only_repeated_does_not_begin_anew() -> None:
    """The fault: a program on a busy computer asked again each half second, and got the same place each time."""
    bench = Bench()
    bench.ask(180)
    bench.row(100, 180)
    bench.asked()
    for _ in range(5):
        bench.now += 0.5
        bench.ask(180)
        assert bench.asked() == []
        assert bench.come(180 + bench.download.queued_bytes // FRAME * WHOLE)
    assert bench.download.queued_bytes == 105 * FRAME
