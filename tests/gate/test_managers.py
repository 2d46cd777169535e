# SPDX-License-Identifier: GPL-3.0-or-later

"""Payload managers on board: what reaches them. Nothing to them, and nothing of theirs, reaches a flight function."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import AuthorityView, LeaseState, Phase
from mavproxy_handover.gate.judge import Fate, GateReason, StationIdentity, judge
from mavproxy_handover.gate.onboard import OnboardFilters, OnboardRights, judge_onboard
from mavproxy_handover.gate.policy.managers import MANAGER_SAYS
from mavproxy_handover.gate.policy.onboard import Right
from mavproxy_handover.wire.frames import Frame
from tests.gate.door import Came, Door
from tests.gate.ledger import CASES, GCSA, GCSB, GCSC, MAINTENANCE, TRACKER_OF_B, VEHICLE, A, B, C
from tests.gate.test_onboard import (
    COMMAND_NAMES,
    COMMANDS,
    NEVER,
    PAYLOAD,
    PAYLOAD_COMMANDS,
    READ_COMMANDS,
    SAYS,
    Matters,
)

CAMERA, GIMBAL, WINCH = 100, 154, 169
MANAGERS = (CAMERA, GIMBAL, WINCH)
ON_GROUND = AuthorityView(Phase.ON_LOAD, GCSA, None, 3, LeaseState.HELD)
FLYING = AuthorityView(Phase.ON_MISSION, GCSA, None, 3, LeaseState.HELD, armed=True)

#: the second book-keeping, written out: what a manager takes from the station that has the payload, beside PAYLOAD
MANAGER_COMMANDS = {
    "DO_SET_ROI_LOCATION", "DO_SET_ROI_NONE", "DO_SET_ROI_SYSID", "CAMERA_TRACK_POINT", "CAMERA_TRACK_RECTANGLE",
    "CAMERA_STOP_TRACKING",
}  # fmt: skip
MANAGER_PAYLOAD = PAYLOAD | {"PARAM_EXT_SET"}
#: from stations that may read; PARAM_EXT_REQUEST_LIST in flight from the commander and from the payload's station
MANAGER_READS = {"PING", "PARAM_EXT_REQUEST_READ", "PARAM_EXT_REQUEST_LIST"}
RATES = {"SET_MESSAGE_INTERVAL", "GET_MESSAGE_INTERVAL"}
FIELDS = {cls.msgname: cls.fieldnames for cls in mavlink.mavlink_map.values()}


def door(holder: int | None = None, view: AuthorityView = FLYING) -> Door:
    found = Door(step_s=30.0, managers=MANAGERS)
    found.change(view)
    found.payload = holder
    return found


def sent(gate: Door, station: StationIdentity, frame: Frame) -> tuple[Came, list[bytes]]:
    """What came of a frame, and what went to a manager."""
    before = len(gate.to_managers)
    came = gate.up(station, frame)
    return came, gate.to_managers[before:]


def reaches(word: str, station: StationIdentity, holder: int) -> bool:
    """Whether a manager gets this command of a station in flight, where `holder` has the payload."""
    if word in READ_COMMANDS or (word in RATES and station is A):
        return True
    return word in PAYLOAD_COMMANDS | MANAGER_COMMANDS and station.sysid == holder


#: other components of each sort: all, the autopilot, the neighbours of managers, programs, the companion
OTHERS = (0, 1, 99, 101, 153, 155, 168, 170, 171, 190, 191, 255)
SENDERS = [
    pytest.param(station, holder, view, id=f"{name} {place}, {station.sysid} with the payload of {holder}")
    for name, station in (("commander", A), ("payload", B), ("observer", C))
    for holder in (GCSA, GCSB)
    for place, view in (("in flight", FLYING), ("on the ground", ON_GROUND))
]


@pytest.mark.parametrize(("station", "holder", "view"), SENDERS)
def test_every_command_to_every_component_and_none_for_a_manager_reaches_the_autopilot(
    make: Callable[..., Frame], station: StationIdentity, holder: int, view: AuthorityView
) -> None:
    """To managers only what is written out above; to other components what passes without managers, too."""
    gate, plain, compared = door(holder, view), Door(step_s=30.0), 0
    plain.change(view)
    plain.payload = holder
    for command, word in COMMAND_NAMES.items():
        for component in (*MANAGERS, *OTHERS):
            frame = make("COMMAND_LONG", sysid=station.sysid, command=command, target_component=component)
            came, managers = sent(gate, station, frame)
            if component in MANAGERS:
                assert came.passed == [], (word, component)
                passes = reaches(word, station, holder)
                assert managers == ([frame.raw] if passes else []), (word, component, came.verdict)
                assert not (passes and word in NEVER - {"DO_SET_ROI_LOCATION"}), word
                if word != "REQUEST_OPERATOR_CONTROL":
                    refused = came.verdict.fate is not Fate.CONSUME or word in RATES
                    assert refused, (word, component, came.verdict)
            else:
                there = plain.up(station, frame)
                assert (came.verdict, came.passed) == (there.verdict, there.passed), (word, component)
                assert managers == [], (word, component)
            compared += 1
    assert compared > 2500


@pytest.mark.slow
def test_every_command_to_every_component_of_a_station_with_the_payload(make: Callable[..., Frame]) -> None:
    """All 256 components. The autopilot gets nothing that is addressed to a manager."""
    gate, compared = door(GCSB), 0
    for command, word in COMMAND_NAMES.items():
        for component in range(256):
            frame = make("COMMAND_LONG", sysid=GCSB, command=command, target_component=component)
            came, managers = sent(gate, B, frame)
            passes = component in MANAGERS and reaches(word, B, GCSB)
            assert managers == ([frame.raw] if passes else []), (word, component)
            assert not (came.passed and component in MANAGERS), (word, component)
            compared += 1
    assert compared > 40_000


@pytest.mark.parametrize(("station", "holder", "view"), SENDERS)
def test_every_message_to_a_manager_and_none_reaches_the_autopilot(
    make: Callable[..., Frame], station: StationIdentity, holder: int, view: AuthorityView
) -> None:
    compared, reached, gate = 0, set(), door(holder, view)
    for case in CASES:
        if "target_component" not in FIELDS[case.name]:
            continue
        for component in MANAGERS:
            frame = make(case.name, sysid=station.sysid, **{**dict(case.fields), "target_component": component})
            came, managers = sent(gate, station, frame)
            assert came.passed == [], (case, component, came.verdict)
            command = COMMAND_NAMES.get(dict(case.fields).get("command", 0), "")
            if case.name in COMMANDS:
                passes = reaches(command, station, holder)
            elif case.name == "PARAM_EXT_REQUEST_LIST":
                passes = view is ON_GROUND or station.sysid in (GCSA, holder)
            else:
                may = case.name in MANAGER_PAYLOAD and station.sysid == holder and case.kind != MAINTENANCE
                passes = case.name in MANAGER_READS or may
            assert managers == ([frame.raw] if passes else []), (case, component, came.verdict)
            compared += 1
            reached |= {case.name} if passes else set()
    assert compared > 1500
    assert reached >= MANAGER_READS - {"PARAM_EXT_REQUEST_LIST"}
    assert (reached >= {"PARAM_EXT_SET", "GIMBAL_MANAGER_SET_PITCHYAW"}) is (station.sysid == holder)


@pytest.mark.parametrize("name", [*sorted(SAYS), "HEARTBEAT"])
def test_a_station_cannot_speak_as_the_manager(make: Callable[..., Frame], name: str) -> None:
    gate = door(GCSB)
    for sysid, compid in ((VEHICLE, CAMERA), (GCSB, CAMERA), (77, 190), (TRACKER_OF_B, CAMERA)):
        frame = make(name, sysid=sysid, compid=compid)
        came, managers = sent(gate, B, frame)
        assert (came.passed, managers) == ([], []), (sysid, compid)


def test_another_component_of_the_payloads_station_commands_no_manager(make: Callable[..., Frame]) -> None:
    frame = make("COMMAND_LONG", sysid=GCSB, compid=100, command=2000, target_component=CAMERA)
    came, managers = sent(door(GCSB), B, frame)
    assert (came.verdict.reason, managers) == (GateReason.COMPONENT, [])
    stranger = make("COMMAND_LONG", sysid=77, command=2000, target_component=CAMERA)
    came, managers = sent(door(GCSB), B, stranger)
    assert (came.verdict.fate, managers) == (Fate.DROP, [])


@pytest.mark.parametrize("command", ["COMPONENT_ARM_DISARM", "MISSION_START", "NAV_TAKEOFF", "DO_SET_MODE", "NAV_LAND"])
def test_a_flight_command_to_the_camera_is_refused_in_words(make: Callable[..., Frame], command: str) -> None:
    """ArduPilot carries out a command to a component that it does not know; START on the ground is the companion's."""
    for view in (ON_GROUND, FLYING):
        gate = door(view=view)
        number = getattr(mavlink, f"MAV_CMD_{command}")
        frame = make("COMMAND_LONG", sysid=GCSA, command=number, target_component=CAMERA, param1=1.0)
        came, managers = sent(gate, A, frame)
        assert (came.verdict.fate, came.verdict.reason) == (Fate.REFUSE, GateReason.MANAGER_TARGET)
        assert (managers, gate.asked, gate.commanded) == ([], [], [])
        ack = mavlink.MAVLink(None).decode(bytearray(came.answers[0]))
        assert (ack.get_type(), ack.get_srcComponent(), ack.result) == ("COMMAND_ACK", CAMERA, 3)
        assert gate.said[-1][1].endswith("refused: no command of a camera, gimbal or winch. Send it to the autopilot")


def test_refused_questions_do_not_use_up_the_answers_to_commands(make: Callable[..., Frame]) -> None:
    """MAVSDK asks every component for its camera, again and again; its refused command is answered all the same."""
    gate = Door(step_s=0.01, managers=MANAGERS)
    gate.change(FLYING)
    question = make("COMMAND_LONG", sysid=GCSB, command=512, param1=259.0, target_component=191)
    for _ in range(20):
        gate.up(B, question)
    photo = make("COMMAND_LONG", sysid=GCSB, command=mavlink.MAV_CMD_IMAGE_START_CAPTURE, target_component=CAMERA)
    answers = [mavlink.MAVLink(None).decode(bytearray(raw)) for raw in gate.up(B, photo).answers]
    assert mavlink.MAV_CMD_IMAGE_START_CAPTURE in [m.command for m in answers if m.get_type() == "COMMAND_ACK"]


def test_what_the_commander_sends_to_a_manager_ends_no_delegation(make: Callable[..., Frame]) -> None:
    gate = door()
    frame = make("COMMAND_LONG", sysid=GCSA, command=mavlink.MAV_CMD_DO_SET_ROI_NONE, target_component=GIMBAL)
    _, managers = sent(gate, A, frame)
    assert managers == [frame.raw]
    assert gate.commanded == []


def test_what_a_station_with_the_payload_alone_sends_to_a_manager_has_a_limit(make: Callable[..., Frame]) -> None:
    gate = Door(step_s=0.001, managers=MANAGERS)
    gate.change(FLYING)
    gate.payload = GCSB
    command = make("COMMAND_LONG", sysid=GCSB, command=2000, target_component=CAMERA)
    came = [gate.up(B, command) for _ in range(1000)]
    assert sum(len(raw) for raw in gate.to_managers) <= 3000 * 2
    assert came[-1].verdict.reason is GateReason.TOO_OFTEN
    question = make("PARAM_EXT_REQUEST_READ", sysid=GCSC, target_component=CAMERA)
    asked = [gate.up(C, question).verdict.reason for _ in range(1000)]
    assert GateReason.TOO_MANY in asked


# ---- what a manager says ------------------------------------------------------------------------------------------


def camera() -> OnboardRights:
    return OnboardRights("cam", CAMERA, frozenset((Right.MANAGER,)))


def test_a_manager_sends_what_it_says_and_reads_and_nothing_else(make: Callable[..., Frame]) -> None:
    """Every message and command: beside its words to stations a manager has no right at all."""
    passed = set()
    for case in CASES:
        frame = make(case.name, sysid=VEHICLE, compid=CAMERA, **dict(case.fields))
        if judge_onboard(frame, camera(), VEHICLE).fate is Fate.FORWARD:
            passed.add(case.name)
    reads = {"PING", "TIMESYNC", "PARAM_REQUEST_READ", "AUTOPILOT_VERSION_REQUEST"}
    assert passed == SAYS | reads | {"HEARTBEAT", "COMMAND_LONG", "COMMAND_INT"}
    assert set(MANAGER_SAYS) == SAYS
    for word in NEVER:
        frame = make("COMMAND_LONG", sysid=VEHICLE, compid=CAMERA, command=getattr(mavlink, f"MAV_CMD_{word}"))
        assert judge_onboard(frame, camera(), VEHICLE).fate is not Fate.FORWARD, word


def test_it_answers_stations_and_no_other_program_answers_another_system(make: Callable[..., Frame]) -> None:
    ack = make("COMMAND_ACK", sysid=VEHICLE, compid=CAMERA, target_system=GCSB, target_component=190)
    assert judge_onboard(ack, camera(), VEHICLE).fate is Fate.FORWARD
    plain = OnboardRights("cam", CAMERA, frozenset((Right.PAYLOAD,)))
    assert judge_onboard(ack, plain, VEHICLE).fate is not Fate.FORWARD
    other = make("COMMAND_LONG", sysid=VEHICLE, compid=CAMERA, command=512, target_system=GCSB)
    assert judge_onboard(other, camera(), VEHICLE).reason is GateReason.OTHER_TARGET


def test_what_a_manager_says_comes_no_more_often_than_its_limit(make: Callable[..., Frame]) -> None:
    filters = OnboardFilters(camera(), Matters().matters())
    frame = make("GIMBAL_DEVICE_ATTITUDE_STATUS", sysid=VEHICLE, compid=CAMERA)
    fates = [filters.limit(frame, judge_onboard(frame, camera(), VEHICLE), 100.0 + n * 0.002).fate for n in range(5000)]
    assert 200 <= fates.count(Fate.FORWARD) <= 220, "20 a second for 10 s, and 20 at once"


def from_manager(gate: Door, frame: Frame) -> set[int]:
    before = {sysid: len(port.heard) for sysid, port in gate.ports.items()}
    gate.gate.from_manager(frame, gate.now)
    return {sysid for sysid, port in gate.ports.items() if port.heard[before[sysid] :] == [frame.raw]}


def test_stations_hear_a_manager_by_their_roles(make: Callable[..., Frame]) -> None:
    gate = door(GCSB)
    status = make("CAMERA_CAPTURE_STATUS", sysid=VEHICLE, compid=CAMERA)
    assert from_manager(gate, status) == {GCSA, GCSB}, "commander, and the station with the payload"
    assert from_manager(gate, make("HEARTBEAT", sysid=VEHICLE, compid=CAMERA)) == {GCSA, GCSB, GCSC}
    ack = make("COMMAND_ACK", sysid=VEHICLE, compid=CAMERA, target_system=GCSC, target_component=190)
    assert from_manager(gate, ack) == {GCSC}
    stray = make("COMMAND_ACK", sysid=VEHICLE, compid=CAMERA, target_system=99, target_component=190)
    assert from_manager(gate, stray) == set(), "it is addressed to no station"


def test_an_observer_hears_the_answer_to_its_question(make: Callable[..., Frame]) -> None:
    gate = door()
    frame = make("COMMAND_LONG", sysid=GCSC, command=512, param1=259.0, target_component=CAMERA)
    gate.up(C, frame)
    assert gate.to_managers == [frame.raw]
    information = make("CAMERA_INFORMATION", sysid=VEHICLE, compid=CAMERA)
    assert from_manager(gate, information) == {GCSA, GCSC}
    assert from_manager(gate, make("CAMERA_SETTINGS", sysid=VEHICLE, compid=CAMERA)) == {GCSA}


def test_the_judge_alone_knows_no_managers(make: Callable[..., Frame]) -> None:
    """The rules of managers are a filter: without one configured nothing changes."""
    frame = make("COMMAND_LONG", sysid=GCSA, command=mavlink.MAV_CMD_NAV_LAND, target_component=CAMERA)
    assert judge(frame, A, FLYING, VEHICLE).fate is Fate.FORWARD
    plain = Door(step_s=30.0)
    plain.change(FLYING)
    assert plain.up(A, frame).passed == [frame.raw]
