# SPDX-License-Identifier: GPL-3.0-or-later

"""The benchmark's own parts: arithmetic, results, traffic, fake ends. What it measures is not tested here."""

from __future__ import annotations

import json
import os
import socket
import sys
import time
from collections import Counter
from dataclasses import replace
from itertools import islice
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import shapely
from pymavlink import mavutil
from pymavlink.dialects.v20 import handover as mavlink

from gcs_module.core import FromPeer
from mavproxy_handover.core.common.messages import OnHandover, TransferKey
from mavproxy_handover.core.common.model import AuthorityView, Consent, Phase, Reason, Station
from mavproxy_handover.gate.judge import Fate, StationIdentity, judge
from mavproxy_handover.wire.frames import parse_one
from mavproxy_handover.wire.ids import COMPANION_COMPID
from sitl.bench import fleet, rules, transfers
from sitl.bench import rig as rig_module
from sitl.bench.__main__ import BENCHES, main
from sitl.bench.autopilot import DOWNLINK, SHUTTLE, FakeAutopilot, Place, Tour, downlink_message
from sitl.bench.fleet import Handovers, Load, growth, growth_of, handovers_of, results
from sitl.bench.reads import GREED, finished, mavsdk, slowest
from sitl.bench.results import (
    Committed,
    Measurement,
    Pair,
    Results,
    compare,
    from_comparison,
    in_turns,
    quantile,
    read_journal,
    settled,
    table,
)
from sitl.bench.results import transfers as committed_of
from sitl.bench.rig import BenchError, Loop, cpu_s, frame_key, split
from sitl.bench.stations import UPLINK_MIX, FakeStation, TalkingStation, uplink_message
from sitl.run.log_server import log_bytes
from sitl.run.processes import Processes
from sitl.vehicles.ports import PortPicker

PLACE = Place(52.68, 5.92)
KEY = bytes(range(32))

# ---- arithmetic ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("part", "value"), [(0.0, 1.0), (0.25, 2.0), (0.5, 3.0), (0.99, 4.96), (1.0, 5.0)])
def test_quantiles_are_interpolated_between_neighbours(part: float, value: float) -> None:
    assert quantile([5, 1, 4, 2, 3], part) == pytest.approx(value)


def test_the_quantile_of_nothing_is_an_error() -> None:
    with pytest.raises(ValueError):
        quantile([], 0.5)


def test_a_comparison_is_the_median_of_the_ratios_and_not_the_ratio_of_the_medians() -> None:
    result = compare([Pair(1.0, 2.0), Pair(30.0, 40.0), Pair(9.0, 9.0)])
    assert (result.ours, result.baseline, result.ratio) == (9.0, 9.0, 0.75)
    assert (result.low, result.high, result.pairs) == (0.625, 0.875, 3)


def test_a_baseline_lost_in_the_noise_gives_no_ratio_and_is_counted() -> None:
    result = compare([Pair(1.0, 2.0), Pair(1.0, 0.0), Pair(1.0, -3.0)])
    assert (result.ratio, result.pairs, result.unusable) == (0.5, 1, 2)
    with pytest.raises(ValueError):
        compare([Pair(1.0, 0.0)])


def test_it_is_settled_when_there_are_enough_pairs_that_agree() -> None:
    agreeing = [Pair(1.0, 2.0), Pair(1.01, 2.0), Pair(0.99, 2.0)]
    assert settled(agreeing, least=3, uncertainty=0.01)
    assert not settled(agreeing, least=4, uncertainty=0.01)
    assert not settled([Pair(1.0, 2.0), Pair(2.0, 2.0), Pair(0.2, 2.0)], least=3, uncertainty=0.1)
    assert not settled([Pair(1.0, 0.0)] * 5, least=1, uncertainty=1.0)


def test_ours_and_the_baseline_take_turns_at_being_first() -> None:
    made: list[bool] = []

    def measured(ours: bool) -> str:
        made.append(ours)
        return "ours" if ours else "baseline"

    pairs = list(islice(in_turns(measured), 2))
    assert made == [True, False, False, True]
    assert pairs == [("ours", "baseline")] * 2


def test_processor_time_of_a_process_is_that_of_all_its_work() -> None:
    before, own = cpu_s(os.getpid()), time.process_time()
    while time.process_time() - own < 0.02:
        pass
    spent = time.process_time() - own
    assert cpu_s(os.getpid()) - before >= spent - 0.001


def test_processor_time_of_no_process_is_an_error() -> None:
    with pytest.raises(BenchError):
        cpu_s(2**22 + 1)  # above the highest process id there can be


# ---- results ------------------------------------------------------------------------------------------------------


def test_a_target_is_on_the_ratio_or_on_our_own_number() -> None:
    ratio = Measurement("p", "w", "us", {}, ours=9.0, baseline=10.0, ratio=0.9, limit=1.0)
    assert ratio.met is True
    own = Measurement("p", "w", "ms", {}, ours=12.0, limit=10.0, judged="ours")
    assert own.met is False
    least = [Measurement("p", "w", "Hz", {}, ratio=ratio, limit=0.9, at_least=True) for ratio in (0.89, 0.9, 1.2)]
    assert [measurement.met for measurement in least] == [False, True, True]
    assert least[0].as_json()["target_is"] == "at least"
    assert "ratio >= 0.9  MISSED" in table(least[:1])
    assert Measurement("p", "w", "ms", {}, ours=12.0).met is None
    assert Measurement("p", "w", "ms", {}, limit=1.0).met is None


def test_a_line_of_the_file_has_everything_that_was_measured(tmp_path: Path) -> None:
    results = Results(tmp_path / "deep" / "bench.jsonl")
    comparison = compare([Pair(1.0, 4.0), Pair(2.0, 4.0), Pair(1.0, -1.0)])
    results.add(
        from_comparison("uplink", "CPU", "us", {"rate": 200}, comparison, limit=0.3, details={"more": [1.23456789]})
    )
    first, second = (json.loads(line) for line in results.path.read_text().splitlines())
    assert first["part"] == "machine"
    assert first["processors"] == os.cpu_count()
    assert second == {
        "part": "uplink", "what": "CPU", "unit": "us", "rate": 200, "ours": 1.5, "baseline": 4.0, "ratio": 0.375,
        "ratio_quartiles": [0.3125, 0.4375], "pairs": 2, "target": 0.3, "target_of": "ratio", "met": False,
        "quiet_ratio": 0.3, "more": [1.2346], "pairs_lost_in_noise": 1,
    }  # fmt: skip
    assert [entry.what for entry in results.missed] == ["CPU"]


def test_the_table_says_which_targets_are_missed_and_gives_each_note_once() -> None:
    lines = table(
        [
            Measurement("p", "one", "ms", {"n": 1}, ours=12.0, limit=10.0, judged="ours", note="mind the gap"),
            Measurement("p", "two", "ms", {}, ours=2.0, baseline=4.0, ratio=0.5, limit=0.5, note="mind the gap"),
        ]
    ).splitlines()
    assert "MISSED" in lines[2]
    assert "held" in lines[3]
    assert [line for line in lines if "mind the gap" in line] == ["[1] mind the gap"]


def test_every_part_has_a_plan_for_a_full_run_and_for_a_smoke_test() -> None:
    assert list(BENCHES) == [
        "uplink", "downlink", "zones", "energy", "transfers", "stalls", "restart", "starve", "download", "floods",
        "fleet",
        "panel",
    ]  # fmt: skip
    for bench in BENCHES.values():
        assert type(bench.full) is type(bench.quick)
        assert bench.full != bench.quick


@pytest.mark.parametrize("argv", [["nonsense"], ["--out"]])
def test_bad_usage_is_exit_code_2(argv: list[str]) -> None:
    assert main(argv) == 2


def test_a_folder_with_something_in_it_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "bench.jsonl").write_text("")
    assert main(["--out", str(tmp_path), "zones"]) == 2
    assert "is not empty" in capsys.readouterr().err


# ---- traffic ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("total", [50, 200])
def test_a_stream_has_as_many_frames_a_second_as_it_says(total: int) -> None:
    assert sum(DOWNLINK[total].values()) == total
    assert DOWNLINK[total]["GLOBAL_POSITION_INT"] == 20  # the zone check's rate


@pytest.mark.parametrize("name", sorted({name for table in DOWNLINK.values() for name in table}))
def test_every_message_of_a_stream_is_what_its_name_says(name: str) -> None:
    raw = bytes(downlink_message(name, PLACE, 123456, True, True).pack(mavlink.MAVLink(None, 1, 1)))
    message = mavlink.MAVLink(None).decode(bytearray(raw))
    assert message.get_type() == name


def test_the_mix_has_its_shares_in_every_period() -> None:
    names = [uplink_message(number).get_type() for number in range(40, 60)]
    assert {name: names.count(name) for name in UPLINK_MIX} == UPLINK_MIX


def test_the_gate_passes_every_frame_of_the_mix_from_the_commander() -> None:
    own = mavlink.MAVLink(None, 251, 190)
    view = AuthorityView(phase=Phase.ON_MISSION, commander=251, epoch=1)
    for number in range(20):
        frame = parse_one(bytes(uplink_message(number).pack(own)))
        assert frame is not None
        assert judge(frame, StationIdentity(251), view, 1).fate is Fate.FORWARD, number


def test_no_two_frames_of_thousands_have_the_same_key() -> None:
    own = mavlink.MAVLink(None, 251, 190)
    keys = set()
    for number in range(5000):
        own.seq = number % 256
        keys.add(frame_key(bytes(uplink_message(number).pack(own))))
    assert len(keys) == 5000


def test_a_frame_has_the_same_key_signed_and_unsigned() -> None:
    plain, signing = mavlink.MAVLink(None, 251, 190), mavlink.MAVLink(None, 251, 190)
    signing.signing.secret_key, signing.signing.sign_outgoing = KEY, True
    one, other = bytes(uplink_message(3).pack(plain)), bytes(uplink_message(3).pack(signing))
    assert one != other
    assert frame_key(one) == frame_key(other)


def test_frames_are_found_however_the_stream_is_cut() -> None:
    own = mavlink.MAVLink(None, 1, 1)
    whole = [bytes(downlink_message(name, PLACE, 1, True, True).pack(own)) for name in DOWNLINK[50]]
    stream = b"".join(whole)
    for cut in range(len(stream)):
        first, rest = split(stream[:cut])
        second, rest = split(rest + stream[cut:])
        assert first + second == whole
        assert rest == b""


# ---- the fake ends ------------------------------------------------------------------------------------------------


class Wire:
    """A fake autopilot with its wire in the hand, and the companion's voice."""

    def __init__(self) -> None:
        self.out: list[Any] = []
        self.autopilot = FakeAutopilot(Loop(), self._sent, PLACE)
        self._own = mavlink.MAVLink(None, 1, 191)

    def _sent(self, raw: bytes) -> None:
        self.out.append(mavlink.MAVLink(None).decode(bytearray(raw)))

    def say(self, message: Any) -> Any:
        """Say it as the companion; returns the answer."""
        self.out.clear()
        self.autopilot.receive(bytes(message.pack(self._own)))
        return self.out[-1] if self.out else None

    def lease(self, state: int, commander: int) -> None:
        payload = [2, state, commander] + [0] * 125
        self.say(mavlink.MAVLink_tunnel_message(1, 1, 47116, 24, payload))


def item(seq: int) -> Any:
    return mavlink.MAVLink_mission_item_int_message(
        1, 1, seq, 3, 16, 0, 1, 0, 0, 0, 0, 520000000 + seq, 59000000, 30, 0
    )


def test_the_autopilot_takes_a_mission_and_gives_it_back() -> None:
    wire = Wire()
    asked = wire.say(mavlink.MAVLink_mission_count_message(1, 1, 2, 0))
    assert (asked.get_type(), asked.seq, asked.target_component) == ("MISSION_REQUEST_INT", 0, 191)
    assert wire.say(item(0)).seq == 1
    assert wire.say(item(1)).get_type() == "MISSION_ACK"
    assert wire.say(mavlink.MAVLink_mission_request_list_message(1, 1, 0)).count == 2
    assert wire.say(mavlink.MAVLink_mission_request_int_message(1, 1, 1, 0)).x == 520000001
    wire.say(mavlink.MAVLink_mission_clear_all_message(1, 1, 0))
    assert wire.say(mavlink.MAVLink_mission_request_list_message(1, 1, 0)).count == 0


def test_the_autopilot_refuses_an_item_that_it_has_not() -> None:
    answer = Wire().say(mavlink.MAVLink_mission_request_int_message(1, 1, 0, 0))
    assert (answer.get_type(), answer.type) == ("MISSION_ACK", mavlink.MAV_MISSION_INVALID_SEQUENCE)


def test_the_autopilot_takes_the_speed_of_a_mission() -> None:
    wire = Wire()
    assert wire.say(mavlink.MAVLink_param_request_read_message(1, 1, b"WPNAV_SPEED", -1)).param_value == 1000.0
    assert wire.say(mavlink.MAVLink_param_set_message(1, 1, b"WPNAV_SPEED", 650.0, 9)).param_value == 650.0
    assert wire.say(mavlink.MAVLink_param_request_read_message(1, 1, b"WPNAV_SPEED", -1)).param_value == 650.0
    assert wire.say(mavlink.MAVLink_param_request_read_message(1, 1, b"WP_SPD", -1)) is None


def test_what_a_station_says_is_measured_and_not_answered() -> None:
    wire = Wire()
    arrived: list[bytes] = []
    wire.autopilot.on_frame = arrived.append
    raw = bytes(mavlink.MAVLink_mission_request_list_message(1, 1, 0).pack(mavlink.MAVLink(None, 251, 190)))
    wire.autopilot.receive(raw)
    assert arrived == [raw]
    assert wire.out == []


def test_the_shuttle_waits_for_the_lease_and_goes_on_to_the_other_side() -> None:
    wire = Wire()
    shuttle = Tour(wire.autopilot, SHUTTLE, 0.0, 1)
    west, region, east = (place for place, _station in SHUTTLE)
    wire.lease(1, 251)
    seen = []
    for now, lease in enumerate([None, (2, 251), (1, 252), None, (1, 251)], 1):
        if lease is not None:
            wire.lease(*lease)
        shuttle.step(float(now))
        seen.append(wire.autopilot.place)
    assert seen == [region, region, east, region, west]
    assert (shuttle.commits, shuttle.given_up) == (2, 0)


def toured(pause_s: float = 1.0) -> tuple[Wire, Tour, list[Place]]:
    """In the air over the first of three zones, with two regions between them."""
    wire = Wire()
    places = [Place(52.68, 5.92 + 0.01 * number) for number in range(5)]
    stops = list(zip(places, (251, None, 252, None, 253), strict=True))
    tour = Tour(wire.autopilot, stops, pause_s, 1)
    tour.begin(0.0)
    return wire, tour, places


def test_a_tour_waits_for_the_lease_in_each_region_and_turns_at_its_end() -> None:
    wire, tour, places = toured()
    seen, now = [], 0.0
    for commander in (252, 253, 252, 251, 252):
        now += 2.0
        tour.step(now)
        seen.append(places.index(wire.autopilot.place))
        wire.lease(2, commander)
        tour.step(now)
        assert places.index(wire.autopilot.place) == seen[-1], "the transfer is under way"
        wire.lease(1, commander)
        tour.step(now)
        seen.append(places.index(wire.autopilot.place))
    assert seen == [1, 2, 3, 4, 3, 2, 1, 0, 1, 2]
    assert (tour.commits, tour.given_up) == (5, 0)


def test_a_tour_gives_a_region_up_where_nothing_comes_of_it() -> None:
    wire, tour, places = toured()
    wire.lease(1, 251)
    tour.step(2.0)
    tour.step(61.9)
    assert (wire.autopilot.place, tour.given_up) == (places[1], 0)
    tour.step(62.1)
    assert (wire.autopilot.place, tour.given_up, tour.commits) == (places[0], 1, 0)


def test_a_tour_tells_who_was_to_hand_over_to_whom() -> None:
    wire, tour, _places = toured()
    now = 0.0
    for commander in (252, 253, 252):
        now += 2.0
        tour.step(now)
        wire.lease(1, commander)
        tour.step(now)
    assert tour.asked == [(251, 252), (252, 253), (253, 252)]


def committed(t: float, station: str, duration_s: float = 0.01) -> dict[str, Any]:
    return {
        "t": t, "event": "transfer_committed", "station": station, "handover_id": 1, "duration_s": duration_s,
        "reason": "zone",
    }  # fmt: skip


def seen(*events: str) -> list[dict[str, Any]]:
    """The station's journal."""
    return [{"event": event} for event in events]


def test_handovers_are_missed_where_vehicle_or_station_has_them_otherwise_than_asked() -> None:
    crossings = [(251, 252), (252, 253), (253, 254)]
    made = [committed(1.0, "GCSB"), committed(2.0, "GCSC"), committed(3.0, "GCSD")]
    both = seen("control_gained", "control_lost")
    told = handovers_of(252, both, [(crossings, made)])
    assert (told.asked, told.made, told.own, told.seen, told.missed) == (3, 3, 2, 2, 0)
    assert handovers_of(252, both, [(crossings, made[:2])]).missed == 1
    # one too few and one too many are not none
    assert handovers_of(252, both, [(crossings, made[:2]), ([], made[2:])]).missed == 2
    assert handovers_of(252, seen("control_gained"), [(crossings, made)]).missed == 1
    aborted = [*made, {"t": 4.0, "event": "transfer_aborted", "station": "GCSD", "handover_id": 2}]
    assert handovers_of(252, both, [(crossings, aborted)]).missed == 1
    late = [*made[:2], committed(9.0, "GCSD", 3.1)]
    found = handovers_of(252, both, [(crossings, late)])
    assert (found.missed, found.slowest_s) == (1, 3.1)


def test_growth_compares_what_one_more_costs_among_many_and_among_few() -> None:
    straight = growth({1: 10.0, 2: 15.0, 5: 30.0, 10: 55.0})
    assert (straight.many_by_few, straight.most_by_least) == (pytest.approx(1.0), pytest.approx(1.0))
    assert (straight.base, straight.each, straight.off) == (
        pytest.approx(5.0), pytest.approx(5.0), pytest.approx(0.0, abs=1e-9),
    )  # fmt: skip
    bent = growth({10: 105.0, 1: 10.0, 2: 15.0, 5: 30.0})
    assert (bent.many_by_few, bent.most_by_least) == (pytest.approx(3.0), pytest.approx(3.0))
    with pytest.raises(ValueError, match="three numbers"):
        growth({1: 1.0, 2: 2.0, 10: 2.0})
    with pytest.raises(ValueError, match="nothing more"):
        growth({2: 1.0, 5: 1.0, 10: 2.0})


def test_what_a_second_vehicle_costs_once_does_not_hide_that_many_cost_more() -> None:
    assert growth({1: 56.5, 2: 82.2, 5: 113.5, 10: 182.8}).many_by_few == pytest.approx(1.33, abs=0.005)


NONE_MISSED = Handovers(90, 90, 60, 60, 0, 0, 0, 0.1, (60, 60))


def load(vehicles: int = 10, busy: float = 0.3, missed: int = 0) -> Load:
    handovers = replace(NONE_MISSED, late=missed)
    return Load(vehicles, 300.0, 15.0 * vehicles, (80.0, 81.0), busy, handovers)


def test_what_was_measured_on_a_busy_machine_is_told_and_void() -> None:
    missed = [list(results(load(busy=busy, missed=2)))[-1] for busy in (0.8, 0.81)]
    assert [one.ours for one in missed] == [2.0, 2.0]
    assert [one.met for one in missed] == [False, None]
    assert "VOID" in missed[1].note


@pytest.mark.parametrize(("busy", "met"), [(0.3, True), (0.81, None)])
def test_growth_is_void_where_one_of_its_numbers_is(busy: float, met: bool | None) -> None:
    (found,) = growth_of([load(2), load(5, busy), load(10)])
    assert (found.ours, found.met) == (pytest.approx(1.0), met)
    assert ("VOID" in found.note) is (met is None)
    assert list(growth_of([load(1), load(2), load(5)])) == []


def test_a_few_vehicles_go_through_a_real_station(tmp_path: Path) -> None:
    found = {one.what: one for one in fleet.measure(fleet.Plan({2: 6.0}, 1.0), tmp_path, lambda text: None)}
    missed = next(one for what, one in found.items() if what.startswith("handovers missed"))
    assert missed.ours == 0.0
    assert missed.details["own"] > 0, "there were some of the station's"
    heard, spoken = missed.details["by_ground"]
    assert min(heard, spoken) > 0, "the stations spoke over the ground link"


def test_lanes_fly_transfers_over_bad_links(tmp_path: Path) -> None:
    lanes = transfers.LanePlan(1, 20.0, 1)
    found = list(transfers.fly_lanes(tmp_path, transfers.LOSSY[:1], lanes, lambda text: None))
    assert [one.what for one in found] == [f"duration, {part}" for part in ("median", "95 %", "99 %", "max")]
    assert found[0].details["transfers"] >= 1
    assert found[0].case["links"] == "5% loss each way"


@pytest.mark.parametrize("seconds", ["0", "-5", "nan", "1e9"])
def test_a_measurement_lasts_no_absurd_time(seconds: str, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["fleet", "--out", str(tmp_path), f"--seconds={seconds}"]) == 2
    assert "must be 1 to 86400" in capsys.readouterr().err


def test_a_plan_lasts_as_long_as_it_is_told() -> None:
    assert fleet.Plan({2: 30.0, 5: 60.0}, 4.0).lasting(9.0) == fleet.Plan({2: 9.0, 5: 9.0}, 4.0)


def test_a_station_answers_connect_with_its_nonce_and_digest() -> None:
    loop = Loop()
    station = FakeStation(loop, "GCSA", 251)
    station.digest = b"d" * 32
    vehicle = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    vehicle.bind(("127.0.0.1", 0))
    vehicle.setblocking(False)
    answers: list[Any] = []

    def read() -> None:
        message = mavlink.MAVLink(None).decode(bytearray(vehicle.recv(1024)))
        answers.extend([message] if message.get_type() == "CONNECT_ACK" else [])

    loop.add_reader(vehicle.fileno(), read)
    question = mavlink.MAVLink_connect_message(251, 190, 1, 251, 1, 77, 3, 251, b"drone-1", [0] * 32)
    vehicle.sendto(question.pack(mavlink.MAVLink(None, 1, 191)), ("127.0.0.1", station.port))
    loop.run_until(lambda: bool(answers), 5.0, "the answer comes")
    station.close()
    vehicle.close()
    assert (answers[0].nonce, bytes(answers[0].mission_digest)) == (77, b"d" * 32)


def test_a_talking_station_consents_at_once_to_what_it_hears_over_the_ground_link(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Why the vehicle asks stands in AUTHORITY_STATUS: without it the station would wait for an operator."""
    station = TalkingStation(Loop(), "GCSA", 251, peers=(Station(252, "GCSB"),))
    sent: list[Any] = []
    monkeypatch.setattr(station, "send", sent.append)
    vehicle = mavlink.MAVLink(None, srcSystem=1, srcComponent=COMPANION_COMPID)
    status = mavlink.MAVLink_authority_status_message(
        Phase.ON_HANDOVER, 251, 252, 251, 4, 7, 1, 2, 0, transfer_reason=Reason.ZONE
    )
    station._take(bytes(status.pack(vehicle)))
    station.hear(FromPeer(252, OnHandover(TransferKey(251, 252, 7, 4))))
    station.close()
    (ok,) = [message for message in sent if message.get_type() == "OK_HANDOVER"]
    assert ok.consent == Consent.GRANTED


def test_waiting_for_what_never_comes_says_what_it_was() -> None:
    with pytest.raises(BenchError, match="the moon: not within 0 s"):
        Loop().run_until(lambda: False, 0.0, "the moon")


def test_a_loop_that_cannot_keep_up_ends_when_its_time_is_over(monkeypatch: pytest.MonkeyPatch) -> None:
    now, calls = [50.0], []

    def job() -> None:
        calls.append(now[0])
        now[0] += 0.002
        assert len(calls) < 1000, "it never ends"

    monkeypatch.setattr(rig_module, "time", SimpleNamespace(monotonic=lambda: now[0]))
    loop = Loop()
    loop.every(0.001, job)
    loop.run(0.1)
    assert 50 <= len(calls) <= 51
    loop.run(0.1)
    assert 100 <= len(calls) <= 102, "what was left over is done in the next run"


# ---- energy -------------------------------------------------------------------------------------------------------


def test_the_energy_that_is_measured_is_that_of_a_flight_that_has_learned() -> None:
    pilot = rules.Pilot()
    for _ in range(60):
        pilot.second(5.92)
    fact = pilot.monitor.fact
    assert pilot.faults == []
    assert (fact.wind_source, fact.learned, fact.power_w) == ("autopilot", True, pytest.approx(360.0))
    assert fact.left_wh is not None
    assert 60.0 < fact.left_wh < 126.0


def test_energy_is_measured_beside_a_zone_check(tmp_path: Path) -> None:
    found = list(rules.energy(rules.Calls(0.002, 1, 1), tmp_path, lambda _text: None))
    assert [(m.judged, m.limit) for m in found] == [*[("ours", 100.0)] * 4, ("ours", None)]
    assert all(m.ours is not None and m.baseline is not None and m.ours > 0.0 < m.baseline for m in found)


# ---- zones --------------------------------------------------------------------------------------------------------


def test_the_check_and_its_baseline_agree_on_the_zones_that_hold_a_place() -> None:
    row = rules.Row(4, 50)
    held = []
    for place in row.places[::9]:
        inside = {1 + n for n, polygon in enumerate(row.polygons) if shapely.contains_xy(polygon, place, 52.68)}
        assert row.finder.holding(52.68, place) == inside
        held.append(len(inside))
    assert set(held) == {1, 2}  # zones overlap, and none is passed over


# ---- journals -----------------------------------------------------------------------------------------------------


def begun(t: float, number: int) -> dict[str, Any]:
    return {"t": t, "event": "transfer_begun", "station": "GCSB", "handover_id": number}


def said(t: float, number: int, name: str = "HANDOVER_REQUEST", direction: str = "out") -> dict[str, Any]:
    return {"t": t, "event": "message", "direction": direction, "name": name, "handover_id": number}


def test_a_transfer_is_read_from_the_journals() -> None:
    companion = [
        {"t": 10.0, "event": "zone_entered", "station": "GCSB"},
        begun(10.0001, 1),
        said(10.0002, 1),
        said(10.0007, 1, "ON_HANDOVER", "in"),
        {
            "t": 10.009, "event": "transfer_committed", "station": "GCSB", "handover_id": 1, "duration_s": 0.0088,
            "reason": "zone",
        },
        said(10.01, 1, "HANDOVER_RESULT"),
    ]  # fmt: skip
    stations = [[said(10.0005, 1, "ON_HANDOVER"), said(10.02, 1, "ON_HANDOVER")], [said(10.001, 1, "OK_HANDOVER")]]
    assert committed_of(companion, stations) == [Committed(0.0088, 0.0088, 3, 0, False)]


def test_a_failed_attempt_counts_into_the_time_since_the_entry() -> None:
    companion = [
        {"t": 5.0, "event": "zone_entered", "station": "GCSB"},
        begun(5.0, 1),
        {"t": 9.0, "event": "transfer_aborted", "station": "GCSB", "handover_id": 1, "reason": "partner_silent"},
        begun(11.0, 2),
        {
            "t": 13.5, "event": "transfer_committed", "station": "GCSB", "handover_id": 2, "duration_s": 2.5,
            "reason": "release_timeout",
        },
    ]  # fmt: skip
    (one,) = committed_of(companion, [])
    assert one.since_entry_s == pytest.approx(8.5)
    assert (one.duration_s, one.failed_attempts, one.by_timeout) == (2.5, 1, True)


def test_a_cut_line_of_a_journal_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "j.jsonl"
    path.write_text('{"event": "loaded"}\n{"event": "unl')
    assert read_journal(path) == [{"event": "loaded"}]


# ---- starve -------------------------------------------------------------------------------------------------------


def test_the_message_that_has_lost_most_is_the_result() -> None:
    position, attitude, slow, list_of_parameters, text = 33, 30, 1, 22, 253
    calm = Counter({position: 200, attitude: 40, slow: 8, list_of_parameters: 500, text: 50, 60000: 50})
    greedy = Counter({position: 100, attitude: 10, slow: 0, text: 900})
    lost = slowest(greedy, calm, 10.0)
    assert (lost.name, lost.greedy_hz, lost.calm_hz, lost.ratio) == ("ATTITUDE", 1.0, 4.0, 0.25)
    assert slowest(calm, calm, 10.0).ratio == 1.0
    with pytest.raises(BenchError, match="no telemetry"):
        slowest(greedy, Counter({text: 50}), 10.0)


def test_a_greedy_observer_asks_for_what_the_attack_asked_for() -> None:
    messages = {what: (per_second, make()) for what, (per_second, make) in GREED.items()}
    for what in ("parameter list", "directory", "banner", "terrain", "mission list"):
        assert messages[what][0] == 2.0
    kinds = {message.get_type() for _, message in messages.values()}
    assert kinds >= {"PARAM_REQUEST_LIST", "FILE_TRANSFER_PROTOCOL", "TERRAIN_CHECK", "PARAM_REQUEST_READ"}
    for _, message in messages.values():  # all of them can be sent
        assert message.pack(mavlink.MAVLink(None, srcSystem=252, srcComponent=190))


# ---- download -----------------------------------------------------------------------------------------------------


def test_rate_and_retries_of_a_download_are_what_mavproxy_tells_last() -> None:
    console = [
        "Finished downloading got.bin (1200 bytes 1.0 seconds, 1.2 kbyte/sec 9 retries)",
        "STABILIZE> Finished downloading got.bin (3000000 bytes 52.3 seconds, 57.3 kbyte/sec 651 retries)",
        "Flight battery 100 percent",
    ]
    assert finished(console) == (3_000_000, 57.3, 651)
    assert finished(["Finished downloading log (90 bytes 0.1 seconds, 0.9 kbyte/sec unknown retries)"]) == (
        90,
        0.9,
        None,
    )
    assert finished(["Downloading got.bin - 400/400 bytes 100.0% 33.3 kbyte/s (1113 retries 2477 missing)"]) is None


def test_a_python_without_mavsdk_is_no_station() -> None:
    assert mavsdk("/bin/false") is None
    assert mavsdk("/nowhere/python") is None


@pytest.mark.process
@pytest.mark.parametrize("way", ["tcp", "udp"])
def test_the_log_server_serves_one_log_by_each_link(way: str, tmp_path: Path) -> None:
    size, ports = 1000, PortPicker()
    port = ports.tcp() if way == "tcp" else ports.udp()
    with Processes() as processes:
        words = ["-m", "sitl.run.log_server", "--size", str(size), f"--{way}", str(port)]
        station = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}") if way == "udp" else None
        server = processes.start("server", [sys.executable, *words], tmp_path)
        until = time.monotonic() + 30.0
        while "ready" not in server.console():
            assert server.alive(), server.console()
            assert time.monotonic() < until
            time.sleep(0.05)
        link = station or mavutil.mavlink_connection(f"tcp:127.0.0.1:{port}")
        assert link.recv_match(type="HEARTBEAT", blocking=True, timeout=10.0) is not None
        link.mav.log_request_data_send(1, 1, 1, 90, 0xFFFFFFFF)
        pieces = {}
        while not pieces or max(pieces) + 90 < size:
            piece = link.recv_match(type="LOG_DATA", blocking=True, timeout=10.0)
            assert piece is not None, pieces.keys()
            pieces[piece.ofs] = bytes(piece.data[: piece.count])
        link.close()
    assert b"".join(pieces[place] for place in sorted(pieces)) == log_bytes(size)[90:]


def test_the_log_server_serves_the_same_log_each_time() -> None:
    assert len(log_bytes(1000)) == 1000
    assert log_bytes(1000) == log_bytes(2000)[:1000]
