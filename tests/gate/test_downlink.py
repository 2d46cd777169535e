# SPDX-License-Identifier: GPL-3.0-or-later

"""What each station hears of the vehicle."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import AuthorityView, LeaseState, Phase
from mavproxy_handover.gate.downlink import ANSWERS, COMMAND_ANSWERS, FOR_EVERYBODY, DownlinkPolicy
from mavproxy_handover.gate.judge import Fate, StationIdentity, judge
from mavproxy_handover.gate.observers import ObserverRates
from mavproxy_handover.gate.policy.tables import COMMAND_RULES, FTP_RULES, MESSAGE_RULES, Access
from mavproxy_handover.wire.frames import Frame
from mavproxy_handover.wire.ids import RATES_COMPID
from tests.gate.frames import IDS
from tests.gate.ledger import UNBORN_MESSAGES, YOUNG_MESSAGES

GCSA, GCSB, GCSC, TRACKER_OF_C = 251, 252, 253, 241
STATIONS = [
    StationIdentity(GCSA),
    StationIdentity(GCSB),
    StationIdentity(GCSC, frozenset({TRACKER_OF_C})),
]
MISSION = AuthorityView(Phase.ON_MISSION, GCSA, None, 1, LeaseState.HELD)
TRANSFER = AuthorityView(Phase.ON_HANDOVER, GCSA, GCSB, 1, LeaseState.TRANSFER)
LOST = AuthorityView(Phase.EMERGENCY, None, None, 1, LeaseState.LOST)

Make = Callable[..., Frame]


@pytest.fixture
def policy() -> DownlinkPolicy:
    return DownlinkPolicy(STATIONS)


@pytest.fixture
def say(make: Make) -> Make:
    """A frame of the autopilot, addressed to nobody."""

    def said(name: str, compid: int = 1, **fields: object) -> Frame:
        ids = {"target_system": 0, "target_component": 0}
        cls = next(c for c in mavlink.mavlink_map.values() if c.msgname == name)
        blank = {field: value for field, value in ids.items() if field in cls.fieldnames}
        return make(name, sysid=1, compid=compid, **{**blank, **fields})

    return said


def hearers(policy: DownlinkPolicy, frame: Frame, view: AuthorityView, now: float = 0.0) -> list[int]:
    return policy.receivers(frame, (GCSA, GCSB, GCSC), view, now)


def test_the_commander_hears_everything_and_an_observer_what_concerns_everybody(
    policy: DownlinkPolicy, say: Make
) -> None:
    everybody = {
        "HEARTBEAT",
        "AUTHORITY_STATUS",
        "ADSB_VEHICLE",
        "COLLISION",
        "OPEN_DRONE_ID_ARM_STATUS",
        "CONTROL_STATUS",
        "GLOBAL_POSITION_INT",
        "SYS_STATUS",
        "BATTERY_STATUS",
        "STATUSTEXT",
    }
    # how often they hear it: test_observers.py
    assert set(FOR_EVERYBODY) == everybody
    for cls in mavlink.mavlink_map.values():
        if cls.msgname == "MANUAL_CONTROL":
            continue
        expected = [GCSA, GCSB, GCSC] if cls.msgname in everybody else [GCSA]
        assert hearers(policy, say(cls.msgname), MISSION) == expected, cls.msgname


def test_the_partner_hears_everything_while_the_transfer_lasts(policy: DownlinkPolicy, say: Make) -> None:
    assert hearers(policy, say("ATTITUDE"), TRANSFER) == [GCSA, GCSB]
    assert hearers(policy, say("ATTITUDE"), MISSION) == [GCSA]


def test_an_observer_hears_what_it_asked_the_companion_for_until_it_commands(
    policy: DownlinkPolicy, say: Make, make: Make
) -> None:
    wish = make("COMMAND_LONG", sysid=GCSB, command=511, param1=30.0, param2=1e6)
    verdict = judge(wish, STATIONS[1], MISSION, 1)
    assert (verdict.fate, verdict.access) == (Fate.CONSUME, Access.ANSWERED)
    policy.rates.asked(wish, GCSB, 0.0)
    attitude = say("ATTITUDE")
    assert [hearers(policy, attitude, MISSION, t) for t in (0.0, 0.5, 1.0)] == [[GCSA, GCSB], [GCSA], [GCSA, GCSB]]
    commanded_by_b = AuthorityView(Phase.ON_MISSION, GCSB, None, 2, LeaseState.HELD)
    assert [hearers(policy, attitude, commanded_by_b, t) for t in (2.0, 2.1)] == [[GCSB], [GCSB]]
    assert hearers(policy, attitude, MISSION, 4.0) == [GCSA]


def test_asking_for_telemetry_never_takes_an_answer_from_the_asker(
    policy: DownlinkPolicy, say: Make, make: Make
) -> None:
    """Home comes as an answer now and as telemetry every minute: the wish must not hold the answer back."""
    policy.rates.asked(make("COMMAND_LONG", sysid=GCSB, command=511, param1=242.0, param2=60e6), GCSB, 0.0)
    home = say("HOME_POSITION")
    assert hearers(policy, home, MISSION, 0.0) == [GCSA, GCSB]
    policy.asked(make("COMMAND_LONG", sysid=GCSB, command=410), GCSB, 1.0)
    assert hearers(policy, home, MISSION, 1.1) == [GCSA, GCSB]


def test_without_a_commander_everybody_is_an_observer(policy: DownlinkPolicy, say: Make) -> None:
    assert hearers(policy, say("ATTITUDE"), LOST) == []
    assert hearers(policy, say("HEARTBEAT"), LOST) == [GCSA, GCSB, GCSC]


def test_what_is_addressed_to_a_station_goes_to_it_alone(policy: DownlinkPolicy, say: Make) -> None:
    for view in (MISSION, TRANSFER, LOST):
        for name in ("COMMAND_ACK", "MISSION_COUNT", "HANDOVER_REQUEST", "CONNECT", "FILE_TRANSFER_PROTOCOL"):
            for station in (GCSA, GCSB, GCSC):
                assert hearers(policy, say(name, target_system=station), view) == [station]


def test_an_id_behind_a_station_is_reached_through_that_station(policy: DownlinkPolicy, say: Make) -> None:
    assert hearers(policy, say("COMMAND_ACK", target_system=TRACKER_OF_C), MISSION) == [GCSC]


@pytest.mark.parametrize("payload_type", [47116, 47117])
@pytest.mark.parametrize("target_system", [0, 1, GCSA])
def test_lease_and_guard_status_never_leave_the_vehicle(
    policy: DownlinkPolicy, say: Make, payload_type: int, target_system: int
) -> None:
    frame = say("TUNNEL", payload_type=payload_type, target_system=target_system)
    assert hearers(policy, frame, TRANSFER) == []


@pytest.mark.parametrize("payload_type", [47116, 47117])
def test_lease_and_guard_status_stay_aboard_though_their_end_is_missing(
    policy: DownlinkPolicy, say: Make, payload_type: int
) -> None:
    frame = say("TUNNEL", payload_type=payload_type)
    for length in (2, 4, 20, len(frame.payload) - 1):
        assert hearers(policy, frame._replace(payload=frame.payload[:length]), MISSION) == []


def test_other_tunnels_are_the_commanders(policy: DownlinkPolicy, say: Make) -> None:
    assert hearers(policy, say("TUNNEL", payload_type=200), MISSION) == [GCSA]


def test_the_commander_hears_another_tunnel_though_its_end_is_missing(policy: DownlinkPolicy, say: Make) -> None:
    frame = say("TUNNEL", payload_type=200)
    assert hearers(policy, frame._replace(payload=frame.payload[:20]), MISSION) == [GCSA]


def test_what_the_autopilot_says_to_the_companion_stays_aboard(policy: DownlinkPolicy, say: Make) -> None:
    for component in (191, RATES_COMPID):
        frame = say("MISSION_REQUEST_INT", target_system=1, target_component=component)
        assert hearers(policy, frame, TRANSFER) == []
    frame = say("MISSION_REQUEST_INT", target_system=GCSB, target_component=191)
    assert hearers(policy, frame, MISSION) == [GCSB], "a station's component of the same number"
    frame = say("GIMBAL_DEVICE_SET_ATTITUDE", target_system=1, target_component=154)
    assert hearers(policy, frame, MISSION) == [GCSA]


def test_frames_we_cannot_read_are_the_commanders(policy: DownlinkPolicy) -> None:
    frame = Frame(b"", 2, 47199, 1, 1, 0, False, b"", False)
    assert hearers(policy, frame, MISSION) == [GCSA]


def test_a_question_opens_a_window_for_its_answer_to_its_asker(policy: DownlinkPolicy, say: Make, make: Make) -> None:
    value = say("PARAM_VALUE")
    assert hearers(policy, value, MISSION) == [GCSA]
    policy.asked(make("PARAM_REQUEST_READ", sysid=GCSC), GCSC, 100.0)
    assert hearers(policy, value, MISSION, 105.0) == [GCSA, GCSC]
    assert hearers(policy, say("ATTITUDE"), MISSION, 105.0) == [GCSA]
    assert hearers(policy, value, MISSION, 105.1) == [GCSA]


def test_each_of_many_answers_extends_the_window_but_not_for_ever(
    policy: DownlinkPolicy, say: Make, make: Make
) -> None:
    policy.asked(make("PARAM_REQUEST_LIST", sysid=GCSB), GCSB, 0.0)
    value = say("PARAM_VALUE")
    heard = [t for t in range(0, 600, 4) if policy.receivers(value, [GCSB], MISSION, float(t)) == [GCSB]]
    assert heard == list(range(0, 301, 4))


def test_no_answer_extends_the_window_past_five_minutes_after_the_question(
    policy: DownlinkPolicy, say: Make, make: Make
) -> None:
    policy.asked(make("PARAM_REQUEST_LIST", sysid=GCSB), GCSB, 0.0)
    value = say("PARAM_VALUE")
    for t in range(0, 300, 4):
        assert policy.receivers(value, [GCSB], MISSION, float(t)) == [GCSB]
    assert [policy.receivers(value, [GCSB], MISSION, t) for t in (299.0, 300.0, 300.1)] == [[GCSB], [GCSB], []]


def test_a_list_asked_for_after_a_single_question_is_heard_whole(policy: DownlinkPolicy, say: Make, make: Make) -> None:
    value = say("PARAM_VALUE")
    policy.asked(make("PARAM_REQUEST_READ", sysid=GCSB), GCSB, 0.0)
    policy.asked(make("PARAM_REQUEST_LIST", sysid=GCSB), GCSB, 1.0)
    assert [policy.receivers(value, [GCSB], MISSION, 1.0) for _ in range(20)] == [[GCSB]] * 20


def test_an_observer_hears_four_acknowledgements_after_a_command(policy: DownlinkPolicy, say: Make, make: Make) -> None:
    policy.asked(make("COMMAND_LONG", sysid=GCSB, command=410), GCSB, 0.0)
    assert sum(len(policy.receivers(say("COMMAND_ACK"), [GCSB], MISSION, 0.0)) for _ in range(20)) == 4


def test_one_request_for_the_flight_modes_is_answered_by_every_mode(
    policy: DownlinkPolicy, say: Make, make: Make
) -> None:
    policy.asked(make("COMMAND_LONG", sysid=GCSB, command=512, param1=435.0), GCSB, 0.0)
    mode = Frame(b"", 2, 435, 1, 1, 0, False, b"", "AVAILABLE_MODES" in IDS)
    assert [policy.receivers(mode, [GCSB], MISSION, 1.0) for _ in range(20)] == [[GCSB]] * 20


def test_a_message_that_is_no_question_opens_no_window(policy: DownlinkPolicy, say: Make, make: Make) -> None:
    policy.asked(make("HEARTBEAT", sysid=GCSB), GCSB, 0.0)
    policy.asked(make("PARAM_SET", sysid=GCSB), GCSB, 0.0)
    assert hearers(policy, say("COMMAND_ACK"), MISSION) == [GCSA]
    assert hearers(policy, say("PARAM_VALUE"), MISSION) == [GCSA]


def test_the_rates_that_are_given_are_used() -> None:
    rates = ObserverRates()
    assert DownlinkPolicy(STATIONS, rates).rates is rates


def test_a_list_ends_when_it_pauses_too_long(policy: DownlinkPolicy, say: Make, make: Make) -> None:
    policy.asked(make("PARAM_REQUEST_LIST", sysid=GCSB), GCSB, 0.0)
    value = say("PARAM_VALUE")
    assert [policy.receivers(value, [GCSB], MISSION, t) == [GCSB] for t in (4.0, 9.0, 14.1, 14.2)] == [
        True,
        True,
        False,
        False,
    ]


def test_a_single_question_during_a_list_does_not_shorten_the_list(
    policy: DownlinkPolicy, say: Make, make: Make
) -> None:
    value = say("PARAM_VALUE")
    policy.asked(make("PARAM_REQUEST_LIST", sysid=GCSB), GCSB, 0.0)
    policy.asked(make("PARAM_REQUEST_READ", sysid=GCSB), GCSB, 5.0)  # at its very end
    assert [policy.receivers(value, [GCSB], MISSION, t) == [GCSB] for t in (9.0, 13.0, 17.0)] == [True, True, True]


def test_a_single_question_after_a_list_is_single_again(policy: DownlinkPolicy, say: Make, make: Make) -> None:
    value = say("PARAM_VALUE")
    policy.asked(make("PARAM_REQUEST_LIST", sysid=GCSB), GCSB, 0.0)
    policy.asked(make("PARAM_REQUEST_READ", sysid=GCSB), GCSB, 20.0)
    assert [policy.receivers(value, [GCSB], MISSION, t) == [GCSB] for t in (24.0, 26.0)] == [True, False]


def test_a_stream_asked_for_once_is_not_a_stream(policy: DownlinkPolicy, say: Make, make: Make) -> None:
    """REQUEST_MESSAGE of something that streams anyway must not subscribe the observer to it."""
    request = make("COMMAND_LONG", sysid=GCSB, command=512, param1=30.0)
    policy.asked(request, GCSB, 0.0)
    heard = [policy.receivers(say("ATTITUDE"), [GCSB], MISSION, t) == [GCSB] for t in (1.0, 4.0, 6.0)]
    assert heard == [True, True, False]


def test_asking_again_and_again_for_a_stream_does_not_make_it_one(
    policy: DownlinkPolicy, say: Make, make: Make
) -> None:
    request = make("COMMAND_LONG", sysid=GCSB, command=512, param1=30.0)
    heard = []
    for second in range(0, 60, 4):
        policy.asked(request, GCSB, float(second))
        for tenth in range(40):
            at = second + tenth / 10
            heard += [at] * len(policy.receivers(say("ATTITUDE"), [GCSB], MISSION, at))
    assert len(heard) == 15 * 4
    assert heard[:5] == [0.0, 0.1, 0.2, 0.3, 4.0]


def test_every_one_of_many_questions_is_answered(policy: DownlinkPolicy, say: Make, make: Make) -> None:
    """The parameters that a list left out, asked for one by one before the first answer is there."""
    for _ in range(200):
        policy.asked(make("PARAM_REQUEST_READ", sysid=GCSB), GCSB, 0.0)
    value = say("PARAM_VALUE")
    assert sum(len(policy.receivers(value, [GCSB], MISSION, 1.0)) for _ in range(200)) == 200


@pytest.mark.parametrize(("again", "answers"), [(5.0, 8), (5.1, 4)])
def test_a_question_counts_until_its_window_closes(
    policy: DownlinkPolicy, say: Make, make: Make, again: float, answers: int
) -> None:
    for at in (0.0, again):
        policy.asked(make("PARAM_REQUEST_READ", sysid=GCSB), GCSB, at)
    value = say("PARAM_VALUE")
    assert sum(len(policy.receivers(value, [GCSB], MISSION, again)) for _ in range(20)) == answers


def test_what_one_asks_at_once_has_an_end(policy: DownlinkPolicy, say: Make, make: Make) -> None:
    for _ in range(2000):
        policy.asked(make("PARAM_REQUEST_READ", sysid=GCSB), GCSB, 0.0)
    value = say("PARAM_VALUE")
    assert sum(len(policy.receivers(value, [GCSB], MISSION, 1.0)) for _ in range(2000)) == 1000
    policy.asked(make("PARAM_REQUEST_READ", sysid=GCSB), GCSB, 0.0)
    policy.asked(make("PARAM_REQUEST_READ", sysid=GCSB), GCSB, 9.0)  # what was left of before is not
    assert sum(len(policy.receivers(value, [GCSB], MISSION, 9.0)) for _ in range(20)) == 4


@pytest.mark.parametrize("name", ["COMMAND_LONG", "COMMAND_INT"])
def test_a_command_is_answered_by_its_ack_and_the_message_it_asks_for(
    policy: DownlinkPolicy, say: Make, make: Make, name: str
) -> None:
    policy.asked(make(name, sysid=GCSB, command=512, param1=148.0), GCSB, 0.0)
    assert hearers(policy, say("COMMAND_ACK"), MISSION) == [GCSA, GCSB]
    assert hearers(policy, say("AUTOPILOT_VERSION"), MISSION) == [GCSA, GCSB]
    policy.asked(make(name, sysid=GCSC, command=410), GCSC, 0.0)
    assert hearers(policy, say("HOME_POSITION"), MISSION) == [GCSA, GCSC]


@pytest.mark.parametrize("wish", [float("nan"), float("inf"), -float("inf"), -1.0, 1e30, 47131.0])
def test_wishes_for_messages_that_do_not_exist_are_ignored(
    policy: DownlinkPolicy, say: Make, make: Make, wish: float
) -> None:
    policy.asked(make("COMMAND_LONG", sysid=GCSB, command=512, param1=wish), GCSB, 0.0)
    assert hearers(policy, say("COMMAND_ACK"), MISSION) == [GCSA, GCSB]
    assert hearers(policy, say("ATTITUDE"), MISSION) == [GCSA]
    assert hearers(policy, Frame(b"", 2, 47131, 1, 1, 0, False, b"", False), MISSION) == [GCSA]


def test_asking_never_opens_the_lease(policy: DownlinkPolicy, say: Make, make: Make) -> None:
    policy.asked(make("COMMAND_LONG", sysid=GCSB, command=512, param1=385.0), GCSB, 0.0)
    assert hearers(policy, say("TUNNEL", payload_type=47117), MISSION) == []


def test_unreadable_frames_ask_for_nothing(policy: DownlinkPolicy, say: Make) -> None:
    policy.asked(Frame(b"", 2, 76, GCSB, 190, 0, False, b"", False), GCSB, 0.0)
    assert hearers(policy, say("COMMAND_ACK"), MISSION) == [GCSA]


def test_only_what_any_station_may_ask_has_answers() -> None:
    """A row for something that an observer may not send would be a row that nobody ever uses."""
    reads = (Access.READ, Access.BULK)
    open_messages = {name for rule in MESSAGE_RULES if rule.access in reads for name in rule.names}
    open_commands = {name for rule in COMMAND_RULES if rule.access in reads for name in rule.names}
    assert any(rule.access in reads for rule in FTP_RULES)
    by_part = {"FILE_TRANSFER_PROTOCOL", "MISSION_REQUEST_LIST", "MISSION_REQUEST", "MISSION_REQUEST_INT"}
    assert set(ANSWERS) - open_messages == by_part
    assert set(COMMAND_ANSWERS) <= open_commands
    unanswered = {"LOGGING_ACK", "UAVIONIX_ADSB_GET"}
    assert open_messages - set(ANSWERS) == unanswered
    assert open_commands - set(COMMAND_ANSWERS) == {
        "REQUEST_MESSAGE",  # the message it names
        "DO_SEND_BANNER",  # STATUSTEXT, which everybody hears
    }


def test_a_question_with_many_answers_is_the_commanders_alone_in_flight() -> None:
    """Each of them is one message more that the commander waits for."""
    bulk = {name for rule in (*MESSAGE_RULES, *COMMAND_RULES) if rule.access is Access.BULK for name in rule.names}
    many = {name for name, answers in {**ANSWERS, **COMMAND_ANSWERS}.items() if answers.many}
    assert many - bulk == {"FILE_TRANSFER_PROTOCOL"}, "by opcode: in bulk, all that read"
    assert {rule.access for rule in FTP_RULES} == {Access.BULK, Access.COMMAND, Access.NEVER}
    assert bulk - many == {
        "TERRAIN_CHECK",  # one answer, for which heights are read from the card
        "DO_SEND_BANNER",  # lines of text, which everybody hears
    }


def test_answers_are_messages_of_the_dialect() -> None:
    dialect = {cls.msgname for cls in mavlink.mavlink_map.values()}
    for answers in (*ANSWERS.values(), *COMMAND_ANSWERS.values()):
        assert set(answers.names) - dialect <= {*YOUNG_MESSAGES, *UNBORN_MESSAGES}


def test_an_observer_gets_the_answer_to_what_the_gate_let_it_ask(policy: DownlinkPolicy, say: Make, make: Make) -> None:
    question = make("MISSION_REQUEST_LIST", sysid=GCSB)
    assert judge(question, STATIONS[1], MISSION, 1).fate is Fate.FORWARD
    policy.asked(question, GCSB, 0.0)
    assert hearers(policy, say("MISSION_COUNT", target_system=GCSB, target_component=190), MISSION) == [GCSB]
    assert hearers(policy, say("MISSION_COUNT"), MISSION) == [GCSA, GCSB]
