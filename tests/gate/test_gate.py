# SPDX-License-Identifier: GPL-3.0-or-later

"""The door itself: what comes before what when a frame goes through, and what a change of authority does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import AuthorityView, LeaseState, Phase
from mavproxy_handover.gate.flush import FlushTracker
from mavproxy_handover.gate.gate import UNNOTED
from mavproxy_handover.gate.judge import Fate, GateReason, Verdict
from mavproxy_handover.gate.policy.access import Access
from mavproxy_handover.vehicle.profiles import COPTER, PLANE, Modes
from mavproxy_handover.wire.frames import Frame, parse_one
from mavproxy_handover.wire.ids import GUARD_STATUS_TUNNEL
from tests.gate.door import Door
from tests.gate.frames import IDS, ftp_request
from tests.gate.ledger import GCSA, GCSB, GCSC, TRACKER_OF_A, VEHICLE, A, B, C

Make = Callable[..., Frame]
OF_A = AuthorityView(Phase.ON_MISSION, GCSA, None, 1, LeaseState.HELD, armed=False)
OF_B = replace(OF_A, commander=GCSB, epoch=2)
OF_NOBODY = replace(OF_A, commander=None, lease=LeaseState.LOST)


@pytest.fixture
def door() -> Door:
    """Station A commands."""
    door = Door()
    door.change(OF_A)
    return door


def decoded(raw: bytes) -> Any:
    return mavlink.MAVLink(None).decode(bytearray(raw))


def names(frames: list[bytes]) -> list[str]:
    return [decoded(raw).get_type() for raw in frames]


def test_until_authority_is_told_the_vehicle_counts_as_armed_and_nobody_commands() -> None:
    view = Door().gate.view
    assert (view.armed, view.commander) == (True, None)


# ---- up: what comes before what --------------------------------------------------------------------------------------


def test_a_frame_is_on_its_way_before_anything_is_noted(make: Make) -> None:
    noted: list[int] = []
    door = Door(to_autopilot=lambda _raw: noted.append(door.gate.counts[GCSA][GateReason.ALLOWED]))
    door.change(OF_A)
    door.up(A, make("COMMAND_LONG", command=183))
    assert noted == [0]
    assert door.gate.counts[GCSA][GateReason.ALLOWED] == 1


@pytest.mark.parametrize(
    ("name", "fields", "at_once"),
    [
        ("RC_CHANNELS_OVERRIDE", {}, False),
        ("PARAM_REQUEST_LIST", {}, False),
        ("COMMAND_LONG", {"command": 183}, True),
        ("PARAM_SET", {"param_id": b"FS_OPTIONS"}, True),
        ("SET_HOME_POSITION", {}, True),
        ("HEARTBEAT", {}, True),
    ],
)
def test_only_what_the_commander_sends_often_waits_to_be_noted(
    door: Door, make: Make, name: str, fields: dict[str, Any], at_once: bool
) -> None:
    frame = make(name, **fields)
    assert door.up(A, frame).passed == [frame.raw]
    assert len(door.frames.unnoted) == (0 if at_once else 1)
    assert door.gate.counts[GCSA][GateReason.ALLOWED] == (1 if at_once else 0)
    door.gate.tick(door.now)
    assert (len(door.frames.unnoted), door.gate.counts[GCSA][GateReason.ALLOWED]) == (0, 1)


def test_the_commanders_mission_file_is_thrown_away_on_request(door: Door, make: Make) -> None:
    door.change(replace(OF_A, phase=Phase.ON_LOAD))
    door.up(A, make("FILE_TRANSFER_PROTOCOL", payload=ftp_request(6, b"@MISSION/mission.dat")))
    door.passed.clear()
    assert door.frames.list_open
    ((station, closing),) = door.frames.close_mission_files()
    assert (station, closing.what) == (GCSA, "file '@MISSION/mission.dat' closed, contents thrown away")
    assert door.passed == list(closing.frames)
    assert (door.frames.close_mission_files(), door.frames.list_open) == ([], False)


def test_a_station_that_cannot_be_written_to_is_reported_and_costs_no_other(
    door: Door, make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    def breaks(_data: bytes) -> None:
        raise OSError("planted")

    monkeypatch.setattr(door.ports[GCSA], "write", breaks)
    assert door.down(make("HEARTBEAT", sysid=VEHICLE, compid=1)) == {GCSB, GCSC}
    (fault,) = door.faults
    assert (fault.splitlines()[0], fault.splitlines()[-1]) == (
        "sending to GCSA: Traceback (most recent call last):",
        "OSError: planted",
    )


def test_what_the_companion_releases_goes_the_way_of_what_passes(door: Door, make: Make) -> None:
    """A command that begins a flight is the companion's matter first: that is not to change what becomes of it then."""
    door.change(replace(OF_A, phase=Phase.ON_LOAD))
    frame = make("COMMAND_LONG", command=400, param1=1.0)
    came = door.up(A, frame)
    assert (came.verdict.fate, came.passed, came.answers) == (Fate.CONSUME, [], [])
    port, counts = door.ports[GCSA], door.gate.counts[GCSA]
    verdict = door.gate.release(port, frame, came.verdict, door.now)
    assert (verdict.fate, verdict.reason, verdict.access) == (Fate.FORWARD, GateReason.ALLOWED, came.verdict.access)
    assert verdict.what == came.verdict.what
    assert door.passed == [frame.raw]
    assert (len(door.frames.unnoted), counts[GateReason.ALLOWED], counts[GateReason.COMPANION]) == (0, 1, 1)
    with pytest.raises(AssertionError):
        door.gate.release(door.ports[GCSB], frame, came.verdict, door.now)
    assert door.passed == [frame.raw]


def test_what_another_station_sends_is_noted_at_once_and_what_came_before_it_too(door: Door, make: Make) -> None:
    door.up(A, make("RC_CHANNELS_OVERRIDE"))
    door.up(B, make("PARAM_REQUEST_READ", sysid=GCSB))
    assert len(door.frames.unnoted) == 0
    assert door.down(make("PARAM_VALUE", sysid=VEHICLE, compid=1)) == {GCSA, GCSB}, "the answer may come at once"
    assert door.down(make("PARAM_VALUE", sysid=VEHICLE, compid=1)) == {GCSA, GCSB}


def test_the_commanders_answers_are_no_window_for_others(door: Door, make: Make) -> None:
    door.up(A, make("PARAM_REQUEST_LIST"))
    assert door.down(make("PARAM_VALUE", sysid=VEHICLE, compid=1)) == {GCSA}


def test_another_station_finds_noted_that_the_commander_uses_file_transfer(door: Door, make: Make) -> None:
    listing = ftp_request(3, b"/")
    assert door.up(A, make("FILE_TRANSFER_PROTOCOL", payload=listing)).verdict.fate is Fate.FORWARD
    came = door.up(B, make("FILE_TRANSFER_PROTOCOL", sysid=GCSB, payload=listing))
    assert (came.verdict.fate, came.verdict.reason) == (Fate.REFUSE, GateReason.FILE_BUSY)
    assert names(came.answers) == ["FILE_TRANSFER_PROTOCOL"]
    assert door.gate.counts[GCSB] == {GateReason.FILE_BUSY: 1}


def test_what_an_observer_asked_of_files_keeps_nobody_waiting(door: Door, make: Make) -> None:
    listing = ftp_request(3, b"/")
    door.up(B, make("FILE_TRANSFER_PROTOCOL", sysid=GCSB, payload=listing))
    assert door.up(C, make("FILE_TRANSFER_PROTOCOL", sysid=GCSC, payload=listing)).verdict.fate is Fate.FORWARD


def test_a_frame_that_cannot_be_noted_costs_no_other(door: Door, make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    saw, seen = FlushTracker.saw, []

    def breaks_once(self: FlushTracker, *arguments: Any) -> None:
        seen.append(arguments)
        if len(seen) == 1:
            raise RuntimeError("planted")
        saw(self, *arguments)

    monkeypatch.setattr(FlushTracker, "saw", breaks_once)
    frame = make("RC_CHANNELS_OVERRIDE")
    assert door.up(A, frame).passed + door.up(A, frame).passed == [frame.raw] * 2
    door.frames.note()
    assert [text.splitlines()[-1] for text in door.faults] == ["RuntimeError: planted"]
    assert [closing.what for _station, closing in door.change(OF_NOBODY)] == ["RC override released"]


def test_so_many_frames_wait_to_be_noted_at_most(door: Door, make: Make) -> None:
    frame = make("RC_CHANNELS_OVERRIDE")
    for _ in range(UNNOTED - 1):
        door.up(A, frame)
    assert len(door.frames.unnoted) == UNNOTED - 1
    door.up(A, frame)
    assert (len(door.frames.unnoted), door.gate.counts[GCSA][GateReason.ALLOWED]) == (0, UNNOTED)
    assert UNNOTED == 512


def test_a_camera_of_the_commanders_number_does_not_command(door: Door, make: Make) -> None:
    door.change(replace(OF_A, phase=Phase.ON_LOAD))
    passed = door.up(A, make("PARAM_REQUEST_READ", compid=100))
    assert (passed.verdict.fate, len(door.frames.unnoted)) == (Fate.FORWARD, 0), "noted at once, as any other's"
    came = door.up(A, make("COMMAND_LONG", compid=100, command=20))
    assert (came.verdict.fate, came.verdict.reason) == (Fate.REFUSE, GateReason.COMPONENT)


# ---- up: answers -----------------------------------------------------------------------------------------------------


def test_every_refusal_is_counted_and_five_a_second_of_a_kind_are_answered(door: Door, make: Make) -> None:
    frames = [make("COMMAND_LONG", sysid=GCSB, command=command) for command in (20, 21, 176, 178, 193, 400)]
    came = [door.up(B, frame) for frame in frames]
    assert {one.verdict.fate for one in came} == {Fate.REFUSE}
    assert [names(one.answers) for one in came] == [["COMMAND_ACK"]] * 5 + [[]]
    assert door.gate.counts[GCSB] == {GateReason.NOT_IN_CONTROL: 6}
    assert names(door.up(B, make("MISSION_COUNT", sysid=GCSB)).answers) == ["MISSION_ACK"], "another kind"
    answer = decoded(came[0].answers[0])
    assert (answer.get_srcSystem(), answer.get_srcComponent(), answer.command) == (VEHICLE, 1, 20)
    numbers = [decoded(one.answers[0]).get_seq() for one in came[:5]]
    assert numbers == [0, 1, 2, 3, 4]


def test_what_is_dropped_is_counted_and_gets_no_answer(door: Door, make: Make) -> None:
    came = door.up(B, make("GPS_RTCM_DATA", sysid=GCSB))
    assert (came.verdict.fate, came.passed, came.answers) == (Fate.DROP, [], [])
    assert door.gate.counts == {GCSA: {}, GCSB: {GateReason.NOT_IN_CONTROL: 1}, GCSC: {}}


def test_who_asks_again_and_again_for_parameters_in_flight_reads_of_it_every_ten_seconds(make: Make) -> None:
    door = Door(step_s=1.0)
    door.change(replace(OF_A, armed=True))
    error = ["PARAM_ERROR"] if "PARAM_ERROR" in IDS else []
    said = (GCSB, "parameter list refused: in flight GCSA alone may ask")
    for times in (*[1] * 10, 2, 2):
        assert names(door.up(B, make("PARAM_REQUEST_LIST", sysid=GCSB)).answers) == error
        assert door.said == [said] * times
    door.up(C, make("PARAM_REQUEST_LIST", sysid=GCSC))
    assert door.said[-1] == (GCSC, said[1])


def test_an_observers_wish_for_rates_is_granted_by_the_companion(door: Door, make: Make) -> None:
    wish = make("COMMAND_LONG", sysid=GCSB, command=511, param1=30.0, param2=1e6)
    came = door.up(B, wish)
    assert (came.verdict.fate, came.passed) == (Fate.CONSUME, [])
    (answer,) = map(decoded, came.answers)
    assert (answer.get_type(), answer.result, answer.get_srcComponent()) == ("COMMAND_ACK", 0, 1)
    assert door.down(make("ATTITUDE", sysid=VEHICLE, compid=1)) == {GCSA, GCSB}


@pytest.mark.parametrize(("asked", "answers"), [(0, 1), (1, 1), (191, 191)])
def test_a_wish_for_rates_is_answered_by_the_component_that_was_asked(
    door: Door, make: Make, asked: int, answers: int
) -> None:
    """The fault: the autopilot's component answered for every other one. A program waits for the one it asked."""
    wish = make("COMMAND_LONG", sysid=GCSB, target_component=asked, command=510, param1=30.0)
    answered = [decoded(each) for each in door.up(B, wish).answers]
    assert [(each.get_type(), each.get_srcComponent()) for each in answered] == [
        ("COMMAND_ACK", answers),
        ("MESSAGE_INTERVAL", answers),
    ]


def test_wishes_are_answered_twenty_times_a_second_at_most(make: Make) -> None:
    door = Door(step_s=0.001)
    door.change(OF_A)
    wish = make("COMMAND_LONG", sysid=GCSB, command=511, param1=30.0, param2=1e6)
    answered = [bool(door.up(B, wish).answers) for _ in range(25)]
    assert answered == [True] * 20 + [False] * 5
    assert len(door.up(C, make("COMMAND_LONG", sysid=GCSC, command=511, param1=30.0, param2=1e6)).answers) == 1


def test_a_wish_without_an_answer_does_not_count_as_answered(make: Make) -> None:
    door = Door(step_s=0.0)
    door.change(OF_A)
    for _ in range(30):
        assert door.up(B, make("REQUEST_DATA_STREAM", sysid=GCSB)).answers == []
    wish = make("COMMAND_LONG", sysid=GCSB, command=511, param1=30.0, param2=1e6)
    assert names(door.up(B, wish).answers) == ["COMMAND_ACK"]


def test_the_commanders_wish_for_rates_is_the_autopilots_to_answer(door: Door, make: Make) -> None:
    wish = make("COMMAND_LONG", command=511, param1=30.0, param2=1e6)
    came = door.up(A, wish)
    assert (came.passed, came.answers) == ([wish.raw], [])


def test_what_is_the_companions_own_is_neither_passed_on_nor_answered_here(door: Door, make: Make) -> None:
    for name, fields in (("CONNECT", {}), ("COMMAND_LONG", {"command": 32100})):
        came = door.up(A, make(name, **fields))
        assert (came.verdict.fate, came.passed, came.answers) == (Fate.CONSUME, [], [])
    assert door.gate.counts[GCSA] == {GateReason.COMPANION: 2}


def test_whatever_an_observer_says_keeps_its_wishes_alive_and_silence_ends_them(make: Make) -> None:
    door = Door(step_s=1.0)
    door.change(OF_A)
    wish = make("COMMAND_LONG", sysid=GCSB, command=511, param1=30.0, param2=1e6)
    attitude = make("ATTITUDE", sysid=VEHICLE, compid=1)
    door.up(B, wish)
    for _ in range(60):
        door.up(B, make("HEARTBEAT", sysid=GCSB))
    assert door.down(attitude) == {GCSA, GCSB}
    door.now += 3600.0
    assert door.down(attitude) == {GCSA}


# ---- heartbeats ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "sysid", "known", "is_one"),
    [
        ("HEARTBEAT", GCSA, True, True),
        ("HEARTBEAT", GCSA, False, False),
        ("HEARTBEAT", TRACKER_OF_A, True, False),
        ("HEARTBEAT", GCSB, True, False),
        ("HEARTBEAT", VEHICLE, True, False),
        ("PING", GCSA, True, False),
    ],
)
def test_only_the_stations_own_heartbeat_is_its_sign_of_life(
    door: Door, make: Make, name: str, sysid: int, known: bool, is_one: bool
) -> None:
    frame = make(name, sysid=sysid)._replace(known=known)
    assert door.gate.sign_of_life(door.ports[GCSA], frame) is is_one


def test_the_heartbeat_of_a_camera_of_the_same_number_is_not_the_stations(door: Door, make: Make) -> None:
    assert not door.gate.sign_of_life(door.ports[GCSA], make("HEARTBEAT", compid=100))


def test_a_station_that_is_said_to_have_the_vehicles_id_gives_no_sign_of_life(make: Make) -> None:
    door = Door(stations=[replace(A, sysid=VEHICLE)])
    assert not door.gate.sign_of_life(door.ports[VEHICLE], make("HEARTBEAT", sysid=VEHICLE))


@pytest.mark.parametrize(("age_s", "passed_on"), [(0.0, True), (1.8, True), (2.0, False), (60.0, False)])
def test_the_successors_heartbeat_is_passed_on_if_it_is_fresh(
    door: Door, make: Make, age_s: float, passed_on: bool
) -> None:
    beat = make("HEARTBEAT", sysid=GCSB).raw
    door.ports[GCSB].heartbeat, door.ports[GCSB].heartbeat_at = beat, door.now + 0.05 - age_s
    door.change(OF_B)
    assert door.passed == ([beat] if passed_on else [])
    door.change(replace(OF_B, epoch=3))
    assert door.passed == ([beat] if passed_on else []), "nobody has changed"


# ---- a change of authority -------------------------------------------------------------------------------------------


def test_what_the_former_commander_left_open_is_closed_in_its_name_before_the_successor_is_heard(
    door: Door, make: Make
) -> None:
    door.change(replace(OF_A, phase=Phase.ON_LOAD))  # in flight no upload goes further than the companion
    door.up(A, make("RC_CHANNELS_OVERRIDE"))  # not noted yet
    door.up(A, make("MISSION_COUNT", count=9, mission_type=1))
    beat = make("HEARTBEAT", sysid=GCSB).raw
    door.ports[GCSB].heartbeat, door.ports[GCSB].heartbeat_at = beat, door.now
    door.passed.clear()
    closed = door.change(OF_B)
    assert [(station, closing.what) for station, closing in closed] == [
        (GCSA, "RC override released"),
        (GCSA, "unfinished fence upload ended"),
    ]
    assert names(door.passed) == ["RC_CHANNELS_OVERRIDE", "MISSION_COUNT", "HEARTBEAT"]
    assert [decoded(raw).get_srcSystem() for raw in door.passed] == [GCSA, GCSA, GCSB]


def test_the_frames_after_a_change_are_judged_by_the_new_view(door: Door, make: Make) -> None:
    command = make("COMMAND_LONG", command=183)
    assert door.up(A, command).verdict.fate is Fate.FORWARD
    door.change(OF_B)
    assert door.gate.view is OF_B
    assert door.up(A, command).verdict.reason is GateReason.NOT_IN_CONTROL
    assert door.up(B, make("COMMAND_LONG", sysid=GCSB, command=183)).verdict.fate is Fate.FORWARD


def test_when_nobody_commands_any_more_it_is_closed_too_and_nobodys_heartbeat_follows(door: Door, make: Make) -> None:
    door.up(A, make("RC_CHANNELS_OVERRIDE"))
    door.passed.clear()
    assert len(door.change(OF_NOBODY)) == 1
    assert names(door.passed) == ["RC_CHANNELS_OVERRIDE"]
    assert door.change(OF_B) == []
    assert names(door.passed) == ["RC_CHANNELS_OVERRIDE"]


def test_a_new_view_of_the_same_commander_closes_nothing(door: Door, make: Make) -> None:
    door.up(A, make("RC_CHANNELS_OVERRIDE"))
    door.passed.clear()
    assert door.change(replace(OF_A, partner=GCSB, lease=LeaseState.TRANSFER)) == []
    assert door.passed == []
    assert len(door.change(OF_B)) == 1, "it was open all the time"


def test_parameter_files_are_thrown_away_at_arming_whoever_commands_on(door: Door, make: Make) -> None:
    door.up(A, make("FILE_TRANSFER_PROTOCOL", payload=ftp_request(6, b"@PARAM/param.pck")))
    door.passed.clear()
    assert door.change(replace(OF_A, partner=GCSB)) == [], "on the ground the commander goes on writing it"
    ((station, closing),) = door.change(replace(OF_A, armed=True))
    assert (station, closing.what) == (GCSA, "file '@PARAM/param.pck' closed, contents thrown away")
    assert door.passed == list(closing.frames)
    assert door.change(replace(OF_A, armed=True, epoch=5)) == []


def test_without_a_commander_or_in_flight_nothing_is_thrown_away(door: Door, make: Make) -> None:
    """No station can open such a file then: this is what the gate does if one is open all the same."""
    frame = make("FILE_TRANSFER_PROTOCOL", payload=ftp_request(6, b"@PARAM/param.pck"))
    forwarded = Verdict(Fate.FORWARD, Access.MAINTENANCE, GateReason.ALLOWED, "")
    in_flight = replace(OF_A, armed=True)
    door.change(in_flight)
    door.frames.flusher.saw(frame, forwarded, GCSA)
    assert door.change(replace(in_flight, epoch=5)) == []
    door.change(OF_NOBODY)
    door.frames.flusher.saw(frame, forwarded, GCSA)
    assert door.change(replace(OF_NOBODY, armed=True)) == []


def test_a_view_is_in_force_even_if_what_follows_from_it_breaks(
    door: Door, make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_arguments: Any, **_more: Any) -> Any:
        raise RuntimeError("planted")

    monkeypatch.setattr(FlushTracker, "flush", broken)
    with pytest.raises(RuntimeError):
        door.change(OF_NOBODY)
    assert door.up(A, make("COMMAND_LONG", command=178)).verdict.reason is GateReason.NOT_IN_CONTROL


# ---- down ------------------------------------------------------------------------------------------------------------


def test_an_upload_that_the_autopilot_has_ended_is_not_closed_again(door: Door, make: Make) -> None:
    on_ground = replace(OF_A, phase=Phase.ON_LOAD)

    def begin_upload() -> None:
        door.change(on_ground)
        door.up(A, make("MISSION_COUNT", count=9, mission_type=1))

    aim = {"target_system": GCSA, "target_component": 190, "mission_type": 1}
    ack = make("MISSION_ACK", sysid=VEHICLE, compid=1, type=0, **aim)
    begin_upload()
    door.down(ack)
    assert door.change(OF_B) == []
    for unproven in (ack._replace(compid=191), ack._replace(sysid=99), ack._replace(known=False)):
        begin_upload()
        door.down(unproven)
        assert len(door.change(OF_B)) == 1, "only the autopilot's own word counts"


def test_of_operator_control_the_stations_hear_the_companion_alone(door: Door, make: Make) -> None:
    status = make("CONTROL_STATUS", sysid=VEHICLE, compid=1)
    assert door.down(status) == set()
    assert door.down(status._replace(compid=42)) == set()
    assert door.down(make("CONTROL_STATUS", sysid=9)) == {GCSA, GCSB, GCSC}, "another vehicle's"


def test_the_caller_is_told_of_frames_in_the_companions_name_alone(door: Door, make: Make) -> None:
    def told(frame: Frame) -> bool:
        return not door.gate.down(frame, door.now)

    assert told(make("HEARTBEAT", sysid=VEHICLE, compid=191))
    assert not told(make("HEARTBEAT", sysid=VEHICLE, compid=1))
    assert not told(make("CONTROL_STATUS", sysid=VEHICLE, compid=1))
    asks = make("PARAM_REQUEST_READ", sysid=VEHICLE, compid=191, param_id=b"FS_OPTIONS")
    door.frames.companion_sent(asks.raw, door.now)
    value = make("PARAM_VALUE", sysid=VEHICLE, compid=1, param_id=b"FS_OPTIONS", param_index=65535)
    heard = len(door.ports[GCSA].heard)
    assert not told(value)
    assert len(door.ports[GCSA].heard) == heard, "it answered the companion"


def test_what_guard_and_companion_tell_each_other_stays_aboard(door: Door, make: Make) -> None:
    assert door.down(make("TUNNEL", sysid=VEHICLE, compid=1, payload_type=GUARD_STATUS_TUNNEL)) == set()
    assert door.down(make("HEARTBEAT", sysid=VEHICLE, compid=1)) == {GCSA, GCSB, GCSC}


#: what a station would believe if the companion had said it
BELIEVED = ["HEARTBEAT", "STATUSTEXT", "COMMAND_ACK", "TIMESYNC", "CONTROL_STATUS", "MISSION_ACK"]
OURS = sorted(cls.msgname for msgid, cls in mavlink.mavlink_map.items() if 47100 <= msgid <= 47131)


@pytest.mark.parametrize("name", [*BELIEVED, *OURS])
@pytest.mark.parametrize("component", [191, 198, 240])
def test_what_comes_from_the_vehicles_side_in_the_companions_name_stays_aboard(
    door: Door, make: Make, component: int, name: str
) -> None:
    frame = make(name, sysid=VEHICLE, compid=component)
    assert door.down(frame) == set()
    assert door.down(frame._replace(known=False, msgid=60000)) == set(), "nor what nobody can read"
    assert door.gate.in_our_name == {(VEHICLE, component): 2}
    assert door.passed == []


@pytest.mark.parametrize("sender", [(VEHICLE, 1), (VEHICLE, 42), (9, 191), (GCSB, 190), (0, 0)])
@pytest.mark.parametrize("name", OURS)
def test_nobody_on_the_vehicles_side_speaks_the_companions_language(
    door: Door, make: Make, name: str, sender: tuple[int, int]
) -> None:
    aimed = {"target_system": GCSA} if "target_system" in mavlink.mavlink_map[IDS[name]].fieldnames else {}
    assert door.down(make(name, sysid=sender[0], compid=sender[1], **aimed)) == set()
    assert door.gate.in_our_name == {sender: 1}


@pytest.mark.parametrize("msgid", [47099, 47100, 47131, 47132])
def test_that_goes_for_every_id_that_is_ours_whether_it_has_a_message_or_not(
    door: Door, make: Make, msgid: int
) -> None:
    door.down(make("HEARTBEAT", sysid=VEHICLE, compid=1)._replace(known=False, msgid=msgid))
    assert len(door.gate.in_our_name) == (1 if 47100 <= msgid <= 47131 else 0)
    assert bool(door.ports[GCSA].heard) is not bool(door.gate.in_our_name), "the commander hears the rest"


@pytest.mark.parametrize("sender", [(VEHICLE, 1), (VEHICLE, 154), (VEHICLE, 192), (9, 191), (9, 198), (9, 240)])
def test_other_components_and_other_vehicles_are_heard_as_before(
    door: Door, make: Make, sender: tuple[int, int]
) -> None:
    assert door.down(make("HEARTBEAT", sysid=sender[0], compid=sender[1])) == {GCSA, GCSB, GCSC}
    assert door.gate.in_our_name == {}


def test_no_frame_comes_out_of_the_door_changed(door: Door) -> None:
    raw = bytes(mavlink.MAVLink_statustext_message(4, b"hello").pack(mavlink.MAVLink(None, VEHICLE, 1)))
    frame = parse_one(raw)
    assert frame is not None
    assert door.down(frame) == {GCSA, GCSB, GCSC}
    assert door.ports[GCSB].heard == [raw]


@pytest.mark.parametrize(
    ("stream", "fields"),
    [
        ("SET_ATTITUDE_TARGET", {}),
        ("SET_POSITION_TARGET_GLOBAL_INT", {"type_mask": 0b110111000111, "coordinate_frame": 6, "alt": 120.0}),
    ],
)
@pytest.mark.parametrize(("modes", "sent"), [(COPTER.gate, 1), (PLANE.gate, 0)])
def test_wings_are_sent_no_zero_velocity_by_a_handover(
    door: Door, make: Make, stream: str, fields: dict[str, Any], modes: Modes, sent: int
) -> None:
    """The fault: ArduPlane up to 4.6 looks at no velocity, but flies to the height in such a frame, whatever its mask
    leaves out: in GUIDED a handover sent the plane down to 0 m above home."""
    door.modes = modes
    door.change(replace(OF_A, armed=True))
    door.up(A, make(stream, **fields))
    before = len(door.passed)
    closed = door.change(replace(OF_B, armed=True))
    targets = [decoded(raw) for raw in door.passed[before:]]
    assert [m.get_type() for m in targets] == ["SET_POSITION_TARGET_GLOBAL_INT"] * sent
    assert [closing.what for _station, closing in closed] == ["guided stream stopped"] * sent


def test_wings_get_back_their_sticks_by_a_handover(door: Door, make: Make) -> None:
    door.modes = PLANE.gate
    door.change(replace(OF_A, armed=True))
    door.up(A, make("RC_CHANNELS_OVERRIDE", chan1_raw=1500))
    closed = door.change(replace(OF_B, armed=True))
    assert [closing.what for _station, closing in closed] == ["RC override released"]
