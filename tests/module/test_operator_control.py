# SPDX-License-Identifier: GPL-3.0-or-later

"""Operator control through the real module: what a stock ground station program sends and hears."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.events import OperatorControlShown
from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.operator.requests.operator_control import OperatorControl
from tests.module.conftest import Bench
from tests.module.test_handover import IN_A, IN_B, IN_BOTH
from tests.module.vehicle import AUTO, Station
from tests.packages import ROUND

CONTROL = mavlink.MAV_CMD_REQUEST_OPERATOR_CONTROL
START, LAND = mavlink.MAV_CMD_MISSION_START, mavlink.MAV_CMD_NAV_LAND
ACCEPTED, DENIED, FAILED = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_DENIED, mavlink.MAV_RESULT_FAILED
UNSUPPORTED, TEMPORARILY_REJECTED = mavlink.MAV_RESULT_UNSUPPORTED, mavlink.MAV_RESULT_TEMPORARILY_REJECTED
NOT_IN_CONTROL = 10
MANAGER, TAKEOVER = 1, 2
#: messages of ours that a station of the standard is told like everybody; the others are not for it
BROADCAST = {"AUTHORITY_STATUS", "HANDOVER_TELEMETRY"}


def request(
    station: Station, *, takeover: int = 0, timeout_s: float = 10, sysid: float | None = None, component: int = 191
) -> None:
    station.command(CONTROL, 1, takeover, timeout_s, station.sysid if sysid is None else sysid, component=component)


def release(station: Station) -> None:
    station.command(CONTROL, 0, 0, 0, station.sysid, component=191)


def answers(station: Station) -> list[int]:
    return station.acks(CONTROL)


def questions(station: Station) -> list[Any]:
    return [m for m in station.got("COMMAND_LONG") if m.command == CONTROL]


def control(station: Station) -> tuple[int, int]:
    """Flags and commander of the last CONTROL_STATUS."""
    status = station.got("CONTROL_STATUS")[-1]
    return status.flags, status.gcs_main


def acknowledge(station: Station, result: int = ACCEPTED) -> None:
    station.send(mavlink.MAVLink_command_ack_message(CONTROL, result, 0, 0, 1, 191))


@pytest.fixture
def ground(bench: Bench) -> Bench:
    """On the ground, both stations with our module, GCSA in command."""
    bench.connect()
    return bench


@pytest.fixture
def standard(bench: Bench) -> Bench:
    """In flight inside both zones, both stations of the standard, GCSA in command; the mission was on board."""
    bench.configure(more=f'mission = "{ROUND}"')
    text = bench.config.read_text()
    text = text.replace('name = "GCS', 'module = false\n            name = "GCS')
    bench.config.write_text(text)
    assert bench.load() is not None, bench.mpstate.console.lines
    bench.until(lambda: bench.companion.view.commander == 251)
    bench.until(lambda: bench.companion.arbiter.mission_digest)
    bench.run(1.0)
    for sysid in (251, 252):  # both programs have shown that they know operator control
        bench.companion.handle(OperatorControlShown(sysid), bench.clock.now)
    bench.a.command(START)
    bench.until(lambda: bench.companion.view.phase is Phase.ON_MISSION)
    bench.run(0.5)
    for end in (bench.autopilot, bench.a, bench.b):
        end.received.clear()
    return bench


class TestAnswer:
    @pytest.mark.parametrize(("asked", "answers_from"), [(191, 191), (1, 1), (0, 191), (190, 191)])
    @pytest.mark.parametrize("form", ["COMMAND_LONG", "COMMAND_INT"])
    def test_comes_from_the_component_that_was_asked_to_the_program_that_asked(
        self, ground: Bench, form: str, asked: int, answers_from: int
    ) -> None:
        program = mavlink.MAVLink(None, srcSystem=251, srcComponent=230)
        if form == "COMMAND_LONG":
            message = mavlink.MAVLink_command_long_message(1, asked, CONTROL, 0, 1, 1, 10, 251, 0, 0, 0)
        else:
            message = mavlink.MAVLink_command_int_message(1, asked, 0, CONTROL, 0, 0, 1, 1, 10, 251, 0, 0, 0)
        ground.a.send_bytes(message.pack(program))
        ground.run(0.2)
        (ack,) = [m for m in ground.a.got("COMMAND_ACK") if m.command == CONTROL]
        assert (ack.get_srcSystem(), ack.get_srcComponent()) == (1, answers_from)
        assert (ack.target_system, ack.target_component, ack.result) == (251, 230, ACCEPTED)
        assert ground.companion.view.takeover_allowed

    def test_nothing_of_it_reaches_the_autopilot(self, ground: Bench) -> None:
        ground.autopilot.received.clear()
        for station in (ground.a, ground.b):
            request(station, component=1)
            request(station, component=0)
            acknowledge(station)
        ground.run(1.0)
        assert CONTROL not in ground.autopilot.commands()
        assert ground.autopilot.got("COMMAND_ACK") == []
        assert ground.autopilot.got("COMMAND_INT") == []

    def test_a_request_for_another_vehicle_is_not_ours(self, ground: Bench) -> None:
        ground.b.send(mavlink.MAVLink_command_long_message(2, 191, CONTROL, 0, 1, 0, 10, 252, 0, 0, 0))
        ground.run(0.2)
        assert answers(ground.b) == []

    def test_pending_is_failed_as_the_standard_has_it(self, ground: Bench) -> None:
        request(ground.b)
        ground.run(0.2)
        assert answers(ground.b) == [FAILED]
        assert ground.companion.view.partner == 252
        assert control(ground.b) == (MANAGER, 251)

    def test_each_of_two_programs_gets_its_own_answer(self, ground: Bench) -> None:
        request(ground.a, takeover=1)
        release(ground.b)
        request(ground.b)
        ground.run(0.2)
        assert answers(ground.a) == [ACCEPTED]
        assert answers(ground.b) == [DENIED, ACCEPTED]
        assert ground.b.texts() == "Control denied: only the commander can release"

    def test_a_station_that_pretends_to_be_another_is_dropped(self, ground: Bench) -> None:
        ground.b.send(mavlink.MAVLink_command_long_message(1, 191, CONTROL, 0, 0, 0, 0, 251, 0, 0, 0), sysid=251)
        ground.run(0.2)
        assert ground.companion.view.commander == 251
        assert answers(ground.b) == answers(ground.a) == []

    @pytest.mark.parametrize(
        ("parameters", "text"),
        [
            ((0, 1, 0, 10), "Control denied: release with takeover: the request of an old ground station?"),
            ((0, 1, 1, 60), "Control denied: release with takeover: the request of an old ground station?"),
            ((251, 1, 0, 10), "Control denied: action and takeover must be 0 or 1"),
            ((1, 0, float("nan"), 251), "Control denied: parameters must be numbers"),
            ((1, 0, 10, 300), "Control denied: system id must be 0 to 255"),
        ],
    )
    def test_what_makes_no_sense_is_denied_in_words_and_changes_nothing(
        self, ground: Bench, parameters: tuple[float, ...], text: str
    ) -> None:
        before = ground.companion.view
        ground.a.command(CONTROL, *parameters, component=191)
        ground.run(0.2)
        assert answers(ground.a) == [DENIED]
        assert ground.a.texts() == text
        assert ground.companion.view == before
        assert ground.journal("control")[-1]["station"] == "GCSA"
        assert ground.companion.faults == {}


class TestBehindAStation:
    """A second program that shares GCSA's link, with a system id of its own: 241."""

    def ask(self, bench: Bench, *parameters: float, component: int = 191) -> None:
        values = (*parameters, *([0.0] * (7 - len(parameters))))
        bench.a.send(mavlink.MAVLink_command_long_message(1, component, CONTROL, 0, *values), sysid=241)
        bench.run(0.2)

    def acks(self, bench: Bench) -> list[tuple[int, int, int]]:
        found = [m for m in bench.a.got("COMMAND_ACK") if m.command == CONTROL]
        return [(m.target_system, m.target_component, m.result) for m in found]

    @pytest.mark.parametrize("named", [0, 241, 251])
    def test_it_asks_for_its_station_and_gets_the_answer(self, ground: Bench, named: int) -> None:
        self.ask(ground, 1, 1, 10, named)
        assert self.acks(ground) == [(241, 190, ACCEPTED)]
        assert ground.companion.view.takeover_allowed
        assert control(ground.b) == (MANAGER | TAKEOVER, 251)
        assert ground.journal("control")[-1]["station"] == "GCSA"

    def test_it_releases_in_its_stations_name_as_it_may_disarm_in_it(self, ground: Bench) -> None:
        self.ask(ground, 0, 0, 0, 241)
        assert self.acks(ground) == [(241, 190, ACCEPTED)]
        assert ground.companion.view.commander is None
        self.ask(ground, 1, 0, 10, 241)
        assert ground.companion.view.commander == 251

    def test_what_makes_no_sense_is_denied_to_it(self, ground: Bench) -> None:
        self.ask(ground, 0, 1, 0, 10)
        assert self.acks(ground) == [(241, 190, DENIED)]
        assert ground.companion.view.commander == 251

    def test_nobody_asks_for_what_is_behind_another_station(self, ground: Bench) -> None:
        ground.b.command(CONTROL, 1, 0, 10, 241, component=191)
        ground.run(0.2)
        assert answers(ground.b) == [DENIED]

    def test_it_does_not_vouch_for_a_station_that_is_gone(self, ground: Bench) -> None:
        release(ground.a)
        ground.a.alive = False
        ground.wait(8.0)
        self.ask(ground, 1, 0, 10, 241)
        assert self.acks(ground)[-1][2] != ACCEPTED
        assert ground.companion.view.commander is None

    def test_its_link_to_the_other_station_lends_it_nothing(self, ground: Bench) -> None:
        ground.b.send(mavlink.MAVLink_command_long_message(1, 191, CONTROL, 0, 1, 1, 10, 241, 0, 0, 0), sysid=241)
        ground.run(0.2)
        assert answers(ground.b) == answers(ground.a) == []
        assert not ground.companion.view.takeover_allowed

    def test_the_messages_of_a_transfer_are_the_stations_own(self, ground: Bench) -> None:
        connected = len(ground.journal("message"))
        ground.a.send(mavlink.MAVLink_disconnect_handover_message(1, 191, 1, 251, 252, 1, 1), sysid=241)
        ground.run(0.2)
        assert len(ground.journal("message")) == connected


class TestStatus:
    def test_every_station_hears_it_once_a_second(self, ground: Bench) -> None:
        for station in (ground.a, ground.b):
            station.received.clear()
        ground.wait(5.0)
        for station in (ground.a, ground.b):
            statuses = station.got("CONTROL_STATUS")
            assert 5 <= len(statuses) <= 6
            assert {(m.get_srcSystem(), m.get_srcComponent()) for m in statuses} == {(1, 191)}
            assert {(m.flags, m.gcs_main, tuple(m.gcs_secondary)) for m in statuses} == {(MANAGER, 251, (0,) * 10)}

    def test_a_change_is_told_at_once(self, ground: Bench) -> None:
        ground.run(0.3)
        ground.b.received.clear()
        request(ground.a, takeover=1)
        ground.run(0.1)
        assert [(m.flags, m.gcs_main) for m in ground.b.got("CONTROL_STATUS")] == [(MANAGER | TAKEOVER, 251)]
        request(ground.a)
        ground.run(0.1)
        assert control(ground.b) == (MANAGER, 251)

    def test_released_it_names_nobody(self, ground: Bench) -> None:
        release(ground.a)
        ground.run(0.2)
        assert answers(ground.a) == [ACCEPTED]
        assert control(ground.a) == control(ground.b) == (MANAGER, 0)
        ground.a.command(LAND)
        ground.run(0.2)
        assert ground.a.acks(LAND) == [NOT_IN_CONTROL]
        request(ground.b)
        ground.run(0.2)
        assert answers(ground.b) == [ACCEPTED]
        assert control(ground.a) == (MANAGER, 252)
        ground.b.command(LAND)
        ground.run(0.2)
        assert [m.get_srcSystem() for m in ground.autopilot.got("COMMAND_LONG") if m.command == LAND] == [252]

    def test_lost_it_names_nobody(self, ground: Bench) -> None:
        ground.a.alive = False
        ground.until(lambda: ground.companion.view.commander is None)
        ground.run(0.1)
        assert control(ground.b) == (MANAGER, 0)


class TestSecondManager:
    """An autopilot, or anything else on board, that says itself who is in control."""

    def say(self, bench: Bench, flags: int, component: int = 1, main: int = 252) -> None:
        own = mavlink.MAVLink(None, srcSystem=1, srcComponent=component)
        raw = mavlink.MAVLink_control_status_message(flags, main, [0] * 10).pack(own)
        bench.mpstate.deliver(_Raw(raw))

    @pytest.mark.parametrize("component", [1, 154, 240])
    def test_is_noticed_and_reported_once_and_not_passed_on(self, ground: Bench, component: int) -> None:
        for station in (ground.a, ground.b):
            station.received.clear()
        for _ in range(5):
            self.say(ground, MANAGER, component)
            ground.run(1.0)
        (entry,) = ground.journal("second_manager")
        text = f"component {component} also claims to be the system manager: switch its operator control off"
        assert entry["text"] == text
        assert ground.mpstate.console.said(text[1:])
        for station in (ground.a, ground.b):
            assert {(m.get_srcComponent(), m.gcs_main) for m in station.got("CONTROL_STATUS")} == {(191, 251)}

    def test_a_component_that_speaks_for_itself_alone_is_not_passed_on_either(self, ground: Bench) -> None:
        self.say(ground, TAKEOVER, 154)
        ground.run(0.5)
        assert ground.journal("second_manager") == []
        assert {m.get_srcComponent() for m in ground.b.got("CONTROL_STATUS")} == {191}

    @pytest.mark.parametrize("length", [0, 1, 2, 12])
    def test_however_short(self, ground: Bench, length: int) -> None:
        own = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        raw = bytearray(mavlink.MAVLink_control_status_message(1, 252, [9] * 10).pack(own))
        raw[1] = length
        short = raw[: 10 + length]
        crc = mavlink.x25crc(bytes(short[1:]) + bytes([mavlink.MAVLink_control_status_message.crc_extra])).crc
        ground.mpstate.deliver(_Raw(bytes(short) + crc.to_bytes(2, "little")))
        ground.run(0.2)
        assert ground.companion.faults == {}
        assert {m.get_srcComponent() for m in ground.b.got("CONTROL_STATUS")} == {191}

    def test_in_the_layout_of_2024_it_is_not_passed_on(self, ground: Bench) -> None:
        # two bytes, the system id first; our own reading of them would be another message
        own = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        head = bytearray(mavlink.MAVLink_control_status_message(1, 252, [0] * 10).pack(own)[:10])
        head[1] = 2
        old = bytes(head) + bytes([252, 1])
        crc = mavlink.x25crc(old[1:] + bytes([211])).crc
        ground.mpstate.deliver(_Raw(old + crc.to_bytes(2, "little")))
        ground.run(0.2)
        assert ground.companion.faults == {}
        assert {m.get_srcComponent() for m in ground.b.got("CONTROL_STATUS")} == {191}

    def test_in_the_companions_own_name_it_stays_aboard_too(self, ground: Bench) -> None:
        ground.b.received.clear()
        self.say(ground, MANAGER, 191)
        ground.run(1.5)
        assert {m.gcs_main for m in ground.b.got("CONTROL_STATUS")} == {251}
        assert len(ground.journal("in_our_name")) == 1

    def test_of_another_vehicle_is_none_of_ours(self, ground: Bench) -> None:
        own = mavlink.MAVLink(None, srcSystem=9, srcComponent=1)
        ground.mpstate.deliver(_Raw(mavlink.MAVLink_control_status_message(MANAGER, 252, [0] * 10).pack(own)))
        assert ground.journal("second_manager") == []


class _Raw:
    """A message as MAVProxy hands it over."""

    def __init__(self, raw: bytes) -> None:
        self._raw = bytes(raw)

    def get_msgbuf(self) -> bytes:
        return self._raw

    def get_type(self) -> str:
        return "UNKNOWN_512"


class TestStandard:
    """Both stations know nothing of us: a whole handover by the standard alone."""

    def test_the_owner_is_asked_by_the_standards_command(self, standard: Bench) -> None:
        standard.autopilot.position = IN_BOTH
        standard.until(lambda: questions(standard.a))
        question = questions(standard.a)[0]
        assert (question.get_srcSystem(), question.get_srcComponent()) == (1, 191)
        assert (question.target_system, question.target_component) == (251, 190)
        assert (question.param1, question.param2, question.param4) == (1.0, 0.0, 252.0)
        assert 3.0 <= question.param3 <= 60.0
        assert questions(standard.b) == []
        (entry,) = standard.journal("notified")
        assert entry["text"] == "GCSA is asked: may GCSB have control?"

    def test_until_it_has_acknowledged_the_question(self, standard: Bench) -> None:
        standard.autopilot.position = IN_BOTH
        standard.until(lambda: questions(standard.a))
        standard.run(2.0)
        assert len(questions(standard.a)) >= 4
        acknowledge(standard.a)
        standard.run(0.1)
        before = len(questions(standard.a))
        standard.wait(5.0)
        assert len(questions(standard.a)) == before
        assert standard.companion.view.partner == 252, "to have heard the question is not to have answered it"
        assert standard.companion.view.commander == 251

    def test_anothers_acknowledgement_stops_nothing(self, standard: Bench) -> None:
        standard.autopilot.position = IN_BOTH
        standard.until(lambda: questions(standard.a))
        acknowledge(standard.b)
        before = len(questions(standard.a))
        standard.wait(3.0)
        assert len(questions(standard.a)) > before

    def test_an_acknowledgement_of_the_question_before_does_not_answer_the_next(self, standard: Bench) -> None:
        standard.autopilot.position = IN_BOTH
        standard.until(lambda: questions(standard.a))
        request(standard.a)  # denied
        standard.until(lambda: standard.companion.view.partner is None)
        acknowledge(standard.a)
        standard.a.received.clear()
        standard.until(lambda: standard.companion.view.partner == 252)
        standard.run(2.0)
        assert len(questions(standard.a)) >= 4

    @pytest.mark.parametrize("how", ["takeover", "release", "give"])
    def test_its_yes_moves_authority(self, standard: Bench, how: str) -> None:
        standard.autopilot.position = IN_BOTH
        standard.until(lambda: questions(standard.a))
        acknowledge(standard.a)
        if how == "takeover":
            request(standard.a, takeover=1)
        elif how == "release":
            release(standard.a)
        else:
            request(standard.a, sysid=252)
        standard.run(0.2)
        assert answers(standard.a) == [ACCEPTED]
        assert control(standard.a) == control(standard.b) == (MANAGER, 252)
        assert standard.companion.view.epoch == 2
        assert standard.autopilot.leases()[-1][1:3] == (1, 252)
        standard.a.command(LAND)
        standard.b.command(LAND, 1.0)
        standard.run(0.3)
        assert standard.a.acks(LAND) == [NOT_IN_CONTROL]
        assert [m.get_srcSystem() for m in standard.autopilot.got("COMMAND_LONG") if m.command == LAND] == [252]

    def test_its_no_keeps_it(self, standard: Bench) -> None:
        standard.autopilot.position = IN_BOTH
        standard.until(lambda: questions(standard.a))
        acknowledge(standard.a)
        request(standard.a)
        standard.run(0.2)
        assert control(standard.b) == (MANAGER, 251)
        assert standard.journal("transfer_aborted")[-1]["reason"] == "commander_denied"
        standard.a.received.clear()
        standard.wait(9.0)
        assert questions(standard.a) == [], "not asked again at once"

    def test_what_is_behind_the_owner_cannot_say_that_the_owner_has_heard(self, standard: Bench) -> None:
        standard.autopilot.position = IN_BOTH
        standard.until(lambda: questions(standard.a))
        standard.a.send(mavlink.MAVLink_command_ack_message(CONTROL, ACCEPTED, 0, 0, 1, 191), sysid=241)
        standard.a.received.clear()
        standard.wait(3.0)
        assert questions(standard.a), "it is asked on"

    @pytest.mark.parametrize("result", [DENIED, UNSUPPORTED, FAILED, TEMPORARILY_REJECTED])
    def test_a_program_that_refuses_the_question_has_asked_nobody(self, standard: Bench, result: int) -> None:
        # what it does not know a program of MAVSDK answers as unsupported
        standard.autopilot.position = IN_BOTH
        standard.until(lambda: questions(standard.a))
        acknowledge(standard.a, result)
        standard.a.received.clear()
        standard.wait(3.0)
        assert questions(standard.a), "it is asked on"

    def test_but_it_can_consent_in_its_name(self, standard: Bench) -> None:
        standard.autopilot.position = IN_BOTH
        standard.until(lambda: questions(standard.a))
        consent = mavlink.MAVLink_command_long_message(1, 191, CONTROL, 0, 1, 1, 10, 241, 0, 0, 0)
        standard.a.send(consent, sysid=241)
        standard.until(lambda: standard.companion.view.commander == 252)

    def test_its_silence_keeps_it_too(self, standard: Bench) -> None:
        standard.autopilot.position = IN_BOTH
        standard.until(lambda: questions(standard.a))
        acknowledge(standard.a)
        standard.until(lambda: standard.companion.view.partner is None, limit_s=35.0)
        assert standard.companion.view.commander == 251
        assert standard.journal("transfer_aborted")[-1]["reason"] == "commander_unanswered"

    def test_asked_for_by_the_other(self, standard: Bench) -> None:
        standard.autopilot.position = IN_BOTH
        standard.until(lambda: questions(standard.a))
        standard.b.received.clear()
        request(standard.b, timeout_s=20)
        standard.run(0.1)
        assert answers(standard.b) == [FAILED]
        request(standard.a, takeover=1)
        standard.run(0.2)
        assert control(standard.b) == (MANAGER, 252)

    def test_asked_for_just_after_the_owner_has_said_no(self, standard: Bench) -> None:
        standard.autopilot.position = IN_BOTH
        standard.until(lambda: questions(standard.a))
        request(standard.a)
        standard.run(0.2)
        standard.b.received.clear()
        request(standard.b, timeout_s=20)
        standard.run(1.5)
        assert answers(standard.b) == [mavlink.MAV_RESULT_DENIED]
        assert control(standard.b) == (MANAGER, 251)

    def test_taken_over_where_that_is_allowed(self, standard: Bench) -> None:
        request(standard.a, takeover=1)
        standard.run(0.2)
        assert control(standard.b) == (MANAGER | TAKEOVER, 251)
        standard.autopilot.position = IN_BOTH
        standard.until(lambda: standard.companion.view.commander == 252)
        assert questions(standard.a) == []
        standard.run(0.1)
        assert control(standard.b) == (MANAGER, 252), "the next owner has allowed nothing"

    def test_lost_in_the_region_the_other_commands(self, standard: Bench) -> None:
        standard.autopilot.position = IN_BOTH
        standard.until(lambda: questions(standard.a))
        standard.a.alive = False
        standard.until(lambda: standard.companion.view.commander == 252)
        assert standard.autopilot.mode == AUTO
        assert standard.journal("transfer_committed")[0]["reason"] == "commander_lost"

    def test_there_and_back(self, standard: Bench) -> None:
        for number, (here, both, old, new) in enumerate(
            ((IN_A, IN_BOTH, standard.a, standard.b), (IN_B, IN_BOTH, standard.b, standard.a)), start=2
        ):
            standard.autopilot.position = here
            standard.wait(6.0)
            standard.autopilot.position = both
            standard.until(lambda old=old: questions(old))
            acknowledge(old)
            request(old, takeover=1)
            standard.until(lambda new=new: standard.companion.view.commander == new.sysid)
            assert standard.companion.view.epoch == number

    def test_none_of_our_questions_is_sent_to_it(self, standard: Bench) -> None:
        standard.autopilot.position = IN_BOTH
        standard.until(lambda: questions(standard.a))
        request(standard.a, takeover=1)
        standard.wait(15.0)
        for station in (standard.a, standard.b):
            ours = {m.get_type() for m in station.received if 47100 <= m.get_msgId() <= 47131}
            assert ours <= BROADCAST

    def test_of_a_killed_question_nothing_is_left(self, standard: Bench) -> None:
        standard.autopilot.position = IN_BOTH
        standard.until(lambda: questions(standard.a))
        standard.autopilot.position = IN_A
        standard.until(lambda: standard.companion.view.partner is None)
        standard.a.received.clear()
        standard.wait(10.0)
        assert questions(standard.a) == []


class Oc:
    """What MAVProxy's coming module `operator_control` does at a station (ArduPilot/MAVProxy pull request 1692).

    `oc request`, `release`, `grant`, `deny`: the command in its layout of 2026, ten seconds to answer; a grant is a
    request of the owner's own that allows takeover, a denial is one that does not. It acknowledges what it is asked,
    always, repeats nothing, and believes CONTROL_STATUS.
    """

    def __init__(self, station: Station, component: int) -> None:
        self.station = station
        self._component = component
        self._seen = len(station.received)
        #: who has asked for control here
        self.askers: list[int] = []

    def look(self) -> None:
        """Take in what has come since the last time."""
        new, self._seen = self.station.received[self._seen :], len(self.station.received)
        for message in new:
            if message.get_type() == "COMMAND_LONG" and message.command == CONTROL:
                acknowledge(self.station)
                self.askers.append(int(message.param4))

    def type(self, word: str) -> None:
        action, takeover = {"request": (1, 0), "grant": (1, 1), "deny": (1, 0), "release": (0, 0)}[word]
        parameters = (action, takeover, 10.0 if action else 0.0, self.station.sysid)
        self.station.command(CONTROL, *parameters, component=self._component)


@pytest.mark.parametrize("component", [0, 1, 191])
class TestMavproxysOc:
    """Its four commands, whatever component it names: the manager, the autopilot, or nobody."""

    @pytest.fixture
    def flight(self, standard: Bench, component: int) -> Bench:
        self.a, self.b = Oc(standard.a, component), Oc(standard.b, component)

        def look() -> None:
            self.a.look()
            self.b.look()

        standard.each_round = look
        return standard

    def until_asked(self, flight: Bench) -> None:
        """The aircraft enters the zone of GCSB, and GCSA's operator is asked."""
        flight.autopilot.position = IN_BOTH
        flight.until(lambda: self.a.askers)
        assert set(self.a.askers) == {252}

    def test_the_owner_is_asked_until_its_program_has_acknowledged_and_grants(self, flight: Bench) -> None:
        self.until_asked(flight)
        flight.wait(3.0)
        assert len(questions(flight.a)) <= 2, "it has acknowledged the first"
        assert flight.companion.view.commander == 251, "to acknowledge is no consent"
        self.a.type("grant")
        flight.run(0.3)
        assert answers(flight.a) == [ACCEPTED]
        assert control(flight.a) == control(flight.b) == (MANAGER, 252)

    def test_a_request_of_the_other_is_put_to_the_owner(self, flight: Bench) -> None:
        self.until_asked(flight)
        flight.b.received.clear()
        self.b.type("request")
        flight.run(0.2)
        assert answers(flight.b) == [FAILED], "the standard's word for: the owner is asked"
        self.a.type("grant")
        flight.run(0.3)
        assert control(flight.b) == (MANAGER, 252)

    def test_what_is_denied_stays(self, flight: Bench) -> None:
        self.until_asked(flight)
        self.a.type("deny")
        flight.wait(3.0)
        assert control(flight.b) == (MANAGER, 251)
        assert flight.journal("transfer_aborted")[0]["reason"] == "commander_denied"

    def test_who_grants_before_anybody_asks_is_not_asked(self, flight: Bench) -> None:
        self.a.type("grant")
        flight.run(0.3)
        assert control(flight.b) == (MANAGER | TAKEOVER, 251)
        flight.autopilot.position = IN_BOTH
        flight.until(lambda: flight.companion.view.commander == 252)
        assert self.a.askers == []

    def test_a_grant_before_is_taken_back_by_a_denial(self, flight: Bench) -> None:
        self.a.type("grant")
        flight.run(0.3)
        self.a.type("deny")
        flight.run(0.3)
        assert control(flight.b) == (MANAGER, 251)
        self.until_asked(flight)

    def test_a_release_in_flight_waits_for_who_can_take_the_aircraft(self, flight: Bench) -> None:
        self.a.type("release")
        flight.run(0.3)
        assert control(flight.b) == (MANAGER | TAKEOVER, 251), "the aircraft is never left without a commander"
        flight.autopilot.position = IN_BOTH
        flight.until(lambda: flight.companion.view.commander == 252)
        assert self.a.askers == []

    def test_a_release_of_who_does_not_command_changes_nothing(self, flight: Bench) -> None:
        self.b.type("release")
        flight.run(0.5)
        assert control(flight.b) == (MANAGER, 251)

    def test_a_question_that_nobody_answers_ends_by_itself(self, flight: Bench) -> None:
        self.until_asked(flight)
        flight.until(lambda: flight.companion.view.partner is None, limit_s=35.0)
        assert control(flight.b) == (MANAGER, 251)

    def test_it_is_told_not_in_control_once_it_has_asked(self, flight: Bench) -> None:
        flight.b.command(LAND)
        flight.run(0.2)
        self.b.type("request")
        flight.run(0.2)
        flight.b.command(LAND)
        flight.run(0.2)
        assert flight.b.acks(LAND) == [DENIED, NOT_IN_CONTROL], "it prints UNKNOWN(10), and lives"


class TestMixed:
    def test_a_commander_of_the_standard_and_a_partner_of_ours(self, bench: Bench, delivery: MissionPackage) -> None:
        bench.configure(more=f'mission = "{ROUND}"')
        text = bench.config.read_text()
        bench.config.write_text(
            text.replace('name = "GCSA"\n            sysid', 'module = false\nname = "GCSA"\nsysid')
        )
        bench.b.digest = delivery.digest
        assert bench.load() is not None, bench.mpstate.console.lines
        bench.until(lambda: bench.companion.view.commander == 251 and bench.companion.arbiter.mission_digest)
        bench.run(1.5)
        request(bench.b)
        bench.run(0.2)
        assert answers(bench.b) == [FAILED]
        assert questions(bench.a) == [], "the partner is asked first"
        (ours,) = bench.b.got("HANDOVER_REQUEST")[:1]
        key = (1, 191, 1, 251, 252, ours.handover_id, ours.epoch)
        bench.b.send(mavlink.MAVLink_on_handover_message(*key, 0, 0, 1))
        bench.run(0.1)
        assert len(questions(bench.a)) == 1
        request(bench.a, takeover=1)
        bench.run(0.1)
        assert bench.b.got("CONNECT_HANDOVER")
        assert control(bench.b) == (MANAGER, 251), "accepted is not in control"
        bench.b.send(mavlink.MAVLink_drone_connected_message(*key, 1))
        bench.run(0.1)
        assert control(bench.b) == (MANAGER, 252)


def test_a_fault_while_answering_costs_that_answer(ground: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_arguments: Any) -> Any:
        raise RuntimeError("a bug")

    with monkeypatch.context() as patch:
        patch.setattr(OperatorControl, "answer", broken)
        request(ground.b)
        ground.run(0.5)
    assert ground.companion.faults == {"action ControlAnswer": 1}
    assert ground.companion.view.partner == 252, "what was decided is decided"
