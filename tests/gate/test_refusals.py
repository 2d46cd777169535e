# SPDX-License-Identifier: GPL-3.0-or-later

"""Refusals as the asker's own parser reads them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import AuthorityView, LeaseState, Phase
from mavproxy_handover.gate import refusals
from mavproxy_handover.gate.client_capabilities import ClientCapabilities
from mavproxy_handover.gate.judge import Fate, GateReason, StationIdentity, Verdict, judge
from mavproxy_handover.gate.policy.access import Access
from mavproxy_handover.gate.refusals import SILENT, OncePerCause, RefusalLimiter, asked_component, has_words, refusal
from mavproxy_handover.wire.frames import Frame, parse_one
from tests.gate.frames import ftp_request

VEHICLE = 1
OBSERVER = StationIdentity(252)
COMMANDER = StationIdentity(251)
VIEW = AuthorityView(Phase.ON_MISSION, 251, None, 1, LeaseState.HELD)
ARMED = AuthorityView(Phase.ON_MISSION, 251, None, 1, LeaseState.HELD, armed=True)

Make = Callable[..., Frame]


@pytest.fixture
def own() -> mavlink.MAVLink:
    return mavlink.MAVLink(None, srcSystem=VEHICLE, srcComponent=191)


def _program(knows: bool) -> Callable[[int], int]:
    return partial(ClientCapabilities("always" if knows else "never").result, (252, 190))


def answers_to(
    frame: Frame,
    own: mavlink.MAVLink,
    station: StationIdentity = OBSERVER,
    view: AuthorityView = VIEW,
    knows: bool = True,
) -> list[Any]:
    """What the station reads when the gate has refused `frame`."""
    verdict = judge(frame, station, view, VEHICLE)
    assert verdict.fate is Fate.REFUSE
    return [mavlink.MAVLink(None).decode(bytearray(packed)) for packed in refusal(frame, verdict, own, _program(knows))]


def is_told(frame: Frame, station: StationIdentity = OBSERVER, view: AuthorityView = VIEW) -> bool:
    """Whether a text says why."""
    return has_words(frame, judge(frame, station, view, VEHICLE))


def answer(frame: Frame, own: mavlink.MAVLink, station: StationIdentity = OBSERVER) -> Any:
    """The first of them; None if it hears nothing."""
    messages = answers_to(frame, own, station)
    return messages[0] if messages else None


def origin(message: Any) -> tuple[int, int]:
    return message.get_srcSystem(), message.get_srcComponent()


@pytest.mark.parametrize("name", ["COMMAND_LONG", "COMMAND_INT"])
@pytest.mark.parametrize(("aimed_at", "answers"), [(1, 1), (0, 1), (154, 154)])
def test_a_command_is_answered_by_the_component_it_was_addressed_to(
    make: Make, own: mavlink.MAVLink, name: str, aimed_at: int, answers: int
) -> None:
    frame = make(name, sysid=252, compid=190, command=21, target_component=aimed_at)
    message = answer(frame, own)
    assert message.get_type() == "COMMAND_ACK"
    assert origin(message) == (VEHICLE, answers)
    assert (message.command, message.result) == (21, 10)
    assert (message.target_system, message.target_component) == (252, 190)


def test_the_result_says_why(make: Make, own: mavlink.MAVLink) -> None:
    def result(command: int, station: StationIdentity, component: int = 1) -> int:
        frame = make("COMMAND_LONG", sysid=station.sysid, command=command, target_component=component)
        return int(answer(frame, own, station).result)

    not_in_control, denied, unsupported = 10, 2, 3
    assert result(400, OBSERVER) == not_in_control
    assert result(42700, OBSERVER) == denied
    assert result(42700, COMMANDER) == denied
    assert result(40001, COMMANDER) == unsupported
    assert result(512, COMMANDER, 191) == unsupported


@pytest.mark.parametrize(
    ("name", "fields", "mission_type"),
    [
        ("MISSION_COUNT", {"mission_type": 1}, 1),
        ("MISSION_ITEM", {"mission_type": 2}, 2),
        ("MISSION_ITEM_INT", {"mission_type": 0}, 0),
        ("MISSION_WRITE_PARTIAL_LIST", {"mission_type": 1}, 1),
        ("MISSION_CLEAR_ALL", {"mission_type": 255}, 255),
        ("MISSION_SET_CURRENT", {"seq": 3}, 0),
    ],
)
def test_mission_writes_are_denied_with_their_mission_type(
    make: Make, own: mavlink.MAVLink, name: str, fields: dict[str, int], mission_type: int
) -> None:
    message = answer(make(name, sysid=252, compid=5, **fields), own)
    assert message.get_type() == "MISSION_ACK"
    assert origin(message) == (VEHICLE, 1)
    assert (message.target_system, message.target_component) == (252, 5)
    assert (message.type, message.mission_type) == (14, mission_type)


HAS_PARAM_ERROR = hasattr(mavlink, "MAVLink_param_error_message")


@pytest.mark.skipif(not HAS_PARAM_ERROR, reason="this pymavlink has no PARAM_ERROR")
@pytest.mark.parametrize("param_id", [b"FS_GCS_ENABLE", b"SIXTEEN_LETTERS_"])
def test_setting_a_parameter_is_denied_by_its_name(make: Make, own: mavlink.MAVLink, param_id: bytes) -> None:
    frame = make("PARAM_SET", sysid=252, param_id=param_id, param_value=0.0, param_type=9)
    message = answer(frame, own)
    assert message.get_type() == "PARAM_ERROR"
    assert origin(message) == (VEHICLE, 1)
    assert (message.target_system, message.target_component) == (252, 190)
    assert (message.param_id, message.param_index, message.error) == (param_id.decode(), -1, 3)


def test_who_does_not_know_the_result_of_the_standard_is_denied(make: Make, own: mavlink.MAVLink) -> None:
    def results(command: int, station: StationIdentity, view: AuthorityView) -> list[int]:
        frame = make("COMMAND_LONG", sysid=station.sysid, command=command)
        return [answers_to(frame, own, station, view, knows)[0].result for knows in (True, False)]

    denied = 2
    assert results(400, OBSERVER, VIEW) == [10, denied]
    assert results(42428, OBSERVER, ARMED) == [10, denied], "only the commander's in flight"
    assert results(245, COMMANDER, ARMED) == [denied, denied]
    assert results(40001, COMMANDER, ARMED) == [3, 3]


def test_of_what_was_aimed_at_the_companion_a_text_stands_in_only_for_a_protocol_without_an_answer(make: Make) -> None:
    def told(name: str) -> bool:
        return is_told(make(name, sysid=251, target_component=191), COMMANDER)

    for name in ("PARAM_REQUEST_LIST", "AUTOPILOT_VERSION_REQUEST", "PARAM_EXT_REQUEST_LIST", "PARAM_SET"):
        assert not told(name), name
    assert told("LOG_ERASE")


@pytest.mark.parametrize("opcode", [4, 6, 11, 14])
@pytest.mark.parametrize("station", [OBSERVER, COMMANDER])
def test_the_rally_list_is_no_file(make: Make, own: mavlink.MAVLink, opcode: int, station: StationIdentity) -> None:
    """FileNotFound: only after this error Mission Planner goes on by the mission protocol at once."""
    path = b"@MISSION/rally.dat"
    request = make("FILE_TRANSFER_PROTOCOL", sysid=station.sysid, payload=ftp_request(opcode, path, session=3))
    nak = answer(request, own, station)
    assert (nak.target_system, origin(nak)) == (station.sysid, (VEHICLE, 1))
    assert nak.payload[2:6] + nak.payload[12:14] == [3, 129, 1, opcode, 10, 0]
    assert is_told(request, station) is (opcode in (6, 11))


def test_what_is_locked_while_armed_is_denied(make: Make, own: mavlink.MAVLink) -> None:
    (ack,) = answers_to(make("COMMAND_LONG", command=245), own, COMMANDER, ARMED)
    assert (ack.get_type(), ack.result) == ("COMMAND_ACK", 2)
    request = make("FILE_TRANSFER_PROTOCOL", payload=ftp_request(6, b"@PARAM/param.pck", session=3, sequence=8))
    (nak,) = answers_to(request, own, COMMANDER, ARMED)
    assert nak.payload[:13] == [9, 0, 3, 129, 1, 6, 0, 0, 0, 0, 0, 0, 9]


def test_a_mission_type_that_does_not_exist_is_unsupported(make: Make, own: mavlink.MAVLink) -> None:
    message = answer(make("MISSION_COUNT", mission_type=77), own, COMMANDER)
    assert (message.get_type(), message.type, message.mission_type) == ("MISSION_ACK", 3, 77)


def test_setting_a_parameter_is_refused_in_words_where_there_is_no_param_error(
    make: Make, own: mavlink.MAVLink, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(mavlink, "MAVLink_param_error_message", raising=False)
    monkeypatch.setattr(refusals, "_BUILDERS", refusals._builders())
    frame = make("PARAM_SET", sysid=252, param_id=b"RTL_ALT")
    assert answers_to(frame, own) == []
    assert is_told(frame)


def test_setting_an_extended_parameter_fails_by_its_name(make: Make, own: mavlink.MAVLink) -> None:
    frame = make(
        "PARAM_EXT_SET",
        sysid=252,
        target_component=100,
        param_id=b"CAM_MODE",
        param_value=b"\x07",
        param_type=1,
    )
    message = answer(frame, own)
    assert message.get_type() == "PARAM_EXT_ACK"
    assert origin(message) == (VEHICLE, 100)
    assert (message.param_id, message.param_value) == ("CAM_MODE", "\x07")
    assert (message.param_type, message.param_result) == (1, 2)


@pytest.mark.parametrize(("sequence", "next_sequence"), [(513, 514), (65535, 0)])
def test_a_file_write_gets_a_nak_with_the_sequence_and_session_of_the_request(
    make: Make, own: mavlink.MAVLink, sequence: int, next_sequence: int
) -> None:
    #            seq                                 session  op  size req burst pad offset
    request = [*sequence.to_bytes(2, "little"), 7, 11, 5, 0, 0, 0, 1, 2, 3, 4, *b"@PARM", *[0] * 234]
    message = answer(make("FILE_TRANSFER_PROTOCOL", sysid=252, payload=request), own)
    assert message.get_type() == "FILE_TRANSFER_PROTOCOL"
    assert origin(message) == (VEHICLE, 1)
    assert (message.target_network, message.target_system, message.target_component) == (0, 252, 190)
    head = [*next_sequence.to_bytes(2, "little"), 7, 129, 1, 11, 0, 0, 1, 2, 3, 4]
    assert message.payload == [*head, 9, *[0] * 238]


def test_an_unknown_file_transfer_opcode_gets_the_nak_for_unknown_commands(make: Make, own: mavlink.MAVLink) -> None:
    request = [0, 0, 0, 77, *[0] * 247]
    message = answer(make("FILE_TRANSFER_PROTOCOL", payload=request), own, COMMANDER)
    assert message.payload[12] == 7


def test_a_file_request_gets_the_nak_for_no_session_while_the_commander_uses_file_transfer(
    make: Make, own: mavlink.MAVLink
) -> None:
    verdict = Verdict(Fate.REFUSE, Access.BULK, GateReason.FILE_BUSY, "FILE_TRANSFER_PROTOCOL")
    (packed,) = refusal(make("FILE_TRANSFER_PROTOCOL", sysid=252, payload=[0] * 251), verdict, own, _program(True))
    assert mavlink.MAVLink(None).decode(bytearray(packed)).payload[12] == 5


@pytest.mark.skipif(not HAS_PARAM_ERROR, reason="this pymavlink has no PARAM_ERROR")
def test_the_parameter_list_is_refused_in_flight_with_an_error_without_a_name(make: Make, own: mavlink.MAVLink) -> None:
    (message,) = answers_to(make("PARAM_REQUEST_LIST", sysid=252), own, OBSERVER, ARMED)
    assert (message.get_type(), message.param_id, message.error) == ("PARAM_ERROR", "", 3)


def test_the_autopilot_answers_a_frame_without_an_address(make: Make) -> None:
    assert asked_component(make("HEARTBEAT", sysid=252)) == 1


def test_no_text_says_why_the_situation_forbids_a_command(make: Make) -> None:
    """The filter that refuses it tells the reason."""
    frame = make("COMMAND_LONG", sysid=251, command=16)
    verdict = judge(frame, OBSERVER, VIEW, VEHICLE)._replace(fate=Fate.REFUSE)
    assert has_words(frame, verdict)
    assert not has_words(frame, verdict._replace(reason=GateReason.SITUATION))


def test_what_programs_repeat_on_their_own_is_refused_in_silence(make: Make, own: mavlink.MAVLink) -> None:
    assert answer(make("REQUEST_DATA_STREAM", target_component=191), own, COMMANDER) is None
    assert answer(make("PARAM_REQUEST_LIST", sysid=252, target_component=191), own) is None
    assert not is_told(make("REQUEST_DATA_STREAM", target_component=191), COMMANDER)
    assert not is_told(make("COMMAND_ACK", target_component=191), COMMANDER)


def test_silent_names_are_names_of_the_dialect() -> None:
    assert {cls.msgname for cls in mavlink.mavlink_map.values()} >= set(SILENT)


def test_every_refusal_of_the_dialect_has_an_answer_or_is_silent_on_purpose(make: Make, own: mavlink.MAVLink) -> None:
    answered = set()
    for cls in mavlink.mavlink_map.values():
        frame = make(cls.msgname, sysid=252)
        verdict = judge(frame, OBSERVER, VIEW, VEHICLE)
        packed = refusal(frame, verdict, own, _program(knows=False))
        silent = verdict.fate is not Fate.REFUSE or cls.msgname in SILENT
        assert has_words(frame, verdict) != silent, cls.msgname
        assert not packed or not silent, cls.msgname
        for raw in packed:
            parsed = parse_one(raw)
            assert parsed is not None
            answered.add(mavlink.mavlink_map[parsed.msgid].msgname)
    young = {"PARAM_ERROR"} if HAS_PARAM_ERROR else set()
    assert answered == {"COMMAND_ACK", "MISSION_ACK", "PARAM_EXT_ACK"} | young


def test_only_refusals_are_answered(make: Make, own: mavlink.MAVLink) -> None:
    frame = make("COMMAND_LONG", command=400)
    verdict = judge(frame, COMMANDER, VIEW, VEHICLE)
    assert verdict.reason is GateReason.ALLOWED
    assert refusal(frame, verdict, own, _program(knows=True)) == []
    assert not has_words(frame, verdict)


def test_the_packer_is_left_as_it_was_but_for_its_sequence_number(make: Make, own: mavlink.MAVLink) -> None:
    own.seq = 255
    first = answer(make("COMMAND_LONG", sysid=252, command=21), own)
    second = answer(make("COMMAND_LONG", sysid=252, command=21), own)
    assert (first.get_seq(), second.get_seq(), own.seq) == (255, 0, 1)
    assert (own.srcSystem, own.srcComponent) == (1, 191)


def test_at_most_n_answers_of_a_kind_go_to_a_station_in_any_second() -> None:
    limiter = RefusalLimiter(2)
    times = [0.0, 0.6, 0.9, 1.0, 1.1, 1.6, 1.7]
    assert [limiter.allow(252, 76, t) for t in times] == [True, True, False, True, False, True, False]
    assert limiter.kept_back == 3


def test_five_answers_a_second_are_enough_for_a_person() -> None:
    limiter = RefusalLimiter()
    assert [limiter.allow(252, 76, 0.1) for _ in range(7)] == [True] * 5 + [False] * 2


def test_stations_and_kinds_are_limited_apart() -> None:
    limiter = RefusalLimiter(1)
    assert limiter.allow(252, 76, 5.0)
    assert limiter.allow(253, 76, 5.0)
    assert limiter.allow(252, 23, 5.0)
    assert not limiter.allow(252, 76, 5.0)
    with pytest.raises(ValueError, match="most = 0"):
        RefusalLimiter(0)


# ---- how often a text says why --------------------------------------------------------------------------------------


def test_a_cause_is_told_once_in_ten_seconds_and_others_beside_it() -> None:
    causes = OncePerCause()
    assert causes.allow(252, "arm", 0.0)
    assert not causes.allow(252, "arm", 9.5)
    assert causes.allow(252, "LAND", 9.5)
    assert causes.allow(253, "arm", 9.5), "another station"
    assert causes.allow(252, "arm", 10.0)
    assert not causes.allow(252, "LAND", 19.25)
    assert causes.allow(252, "LAND", 19.5)


def test_who_sends_another_cause_each_time_is_told_ten_in_ten_seconds_and_remembered_no_more() -> None:
    causes = OncePerCause()
    told = [n for n in range(5000) if causes.allow(252, n, n / 128)]
    assert told == [*range(10), *range(1280, 1290), *range(2560, 2570), *range(3840, 3850)]
    assert len(causes._told[252]) == 10
    assert causes.allow(253, 0, 50.0), "nobody else is kept out"
