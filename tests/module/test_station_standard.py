# SPDX-License-Identifier: GPL-3.0-or-later

"""Two stations at a vehicle whose manager of control is not our companion: only the standard's messages are used."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as stock
from pymavlink.dialects.v20 import handover as mavlink

from gcs_module import commands as station_commands
from gcs_module import module as gcs_module
from mavproxy_handover.wire.ids import OUR_MESSAGES
from tests.module.conftest import Clock
from tests.module.standard_manager import NOT_IN_CONTROL, REQUEST, Manager
from tests.module.test_station_module import StationBench

A, B = 251, 252
_STEP_S = 0.05


class Station(StationBench):
    """A station with name and system id of its own; its peer is the other one's name only."""

    def __init__(self, folder: Path, clock: Clock, sysid: int, consent: str) -> None:
        self.sysid, self.name = sysid, {A: "GCSA", B: "GCSB"}[sysid]
        folder.mkdir()
        self._consent = consent
        super().__init__(folder, clock)

    def configure(self, mission: Path | None = None, consent: str = "") -> None:
        other = A + B - self.sysid
        self.config.write_text(
            f"""
            [station]
            name = "{self.name}"
            sysid = {self.sysid}
            vehicle = 1
            consent = {self._consent}
            journal = "GCSA.jsonl"
            [ground]
            listen = "udpin:127.0.0.1:{self.listens}"
            allow_unsigned = true
            [[peer]]
            name = "GCS{"AB"[other - A]}"
            sysid = {other}
            link = "udpout:127.0.0.1:{self.peer.port}"
            """
        )

    def hear_from(self, sysid: int, component: int, message: Any) -> None:
        raw = message.pack(mavlink.MAVLink(None, srcSystem=sysid, srcComponent=component))
        self.mpstate.deliver(stock.MAVLink(None).decode(bytearray(raw)))

    def shown(self, words: str) -> bool:
        return self.mpstate.console.said(words)

    def type(self, line: str) -> list[str]:
        return self.mpstate.type(f"handover {line}")


class Field:
    """A vehicle with its managers, and two stations that hear it."""

    def __init__(self, folder: Path, clock: Clock, consent: str) -> None:
        self.clock = clock
        self.a = Station(folder / "a", clock, A, consent)
        self.b = Station(folder / "b", clock, B, consent)
        self.managers = [Manager()]
        self.armed = False
        self.heartbeat_at = 0.0
        #: what the stations have sent to the vehicle
        self.uplink: list[tuple[int, Any]] = []
        for station in self.stations:
            assert station.load() is not None, station.mpstate.console.lines

    @property
    def stations(self) -> tuple[Station, Station]:
        return self.a, self.b

    @property
    def manager(self) -> Manager:
        return self.managers[0]

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / _STEP_S)):
            self.clock.now += _STEP_S
            for station in self.stations:
                station.mpstate.loop()
            self.exchange()

    def exchange(self) -> None:
        now = self.clock.now
        for station in self.stations:
            for message in station.sent():
                self.uplink.append((station.sysid, message))
                for manager in self.managers:
                    manager.receive(station.sysid, message, now)
        if now >= self.heartbeat_at:
            self.heartbeat_at = now + 1.0
            mode = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (128 if self.armed else 0)
            beat = mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_QUADROTOR, 3, mode, 3, 4, 3)
            for station in self.stations:
                station.hear_from(1, 1, beat)
        for manager in self.managers:
            manager.tick(now)
            out, manager.out = manager.out, []
            for sysid, component, message in out:
                for station in self.stations:
                    station.hear_from(sysid, component, message)

    def requests(self, sysid: int) -> list[tuple[float, float, float, float]]:
        """The standard's commands of a station so far: p1 to p4."""
        return [
            (m.param1, m.param2, m.param3, m.param4)
            for sender, m in self.uplink
            if sender == sysid and m.get_type() == "COMMAND_LONG" and m.command == REQUEST
        ]

    def close(self) -> None:
        for station in self.stations:
            station.close()
            assert station.mpstate.escaped == []


@pytest.fixture
def consent() -> str:
    return '"operator"'


@pytest.fixture
def field(monkeypatch: pytest.MonkeyPatch, clock: Clock, tmp_path: Path, consent: str) -> Iterator[Field]:
    """Both stations have heard the manager long enough."""
    monkeypatch.setattr(gcs_module, "time", clock)
    monkeypatch.setattr(station_commands, "time", clock)
    field = Field(tmp_path, clock, consent)
    field.run(5.0)
    yield field
    field.close()


@pytest.fixture
def flown(field: Field) -> Field:
    """GCSA has taken control, and the aircraft flies."""
    field.armed = True
    field.a.type("request")
    field.run(2.0)
    assert field.manager.owner == A
    field.uplink.clear()
    return field


class TestFinding:
    def test_the_manager_is_found_and_named(self, field: Field) -> None:
        assert field.a.shown("Component 1 manages control, by the MAVLink standard.")
        assert field.a.type("status")[2] == "control   component 1 manages it, by the MAVLink standard"

    def test_any_component_can_be_it(self, field: Field) -> None:
        other = Manager(component=158)
        field.managers = [other]
        field.run(8.0)
        assert field.a.shown("Component 158 manages control of vehicle 1 now, in place of 1.")
        field.a.type("request")
        field.run(1.0)
        assert other.owner == A

    def test_a_component_that_does_not_claim_to_be_it_is_not_believed(self, field: Field) -> None:
        field.managers.append(Manager(component=25))
        field.managers[1].manages = False
        field.managers[1].owner = B
        field.run(3.0)
        assert not field.a.shown("both claim")
        assert field.a.type("status")[1].startswith("commander no station")

    def test_another_system_that_claims_it_is_not_believed(self, field: Field) -> None:
        forged = Manager(sysid=9, component=1)
        forged.owner = B
        field.managers.append(forged)
        field.run(8.0)
        assert field.a.type("status")[1].startswith("commander no station")
        assert not field.a.shown("both claim")

    def test_a_request_that_another_system_passes_on_is_not_answered(self, flown: Field) -> None:
        ask = mavlink.MAVLink_command_long_message(A, 0, REQUEST, 0, 1, 0, 30, B, 0, 0, 0)
        flown.a.hear_from(9, 1, ask)
        flown.a.hear_from(1, 77, ask)
        flown.run(1.0)
        assert not any(m.get_type() == "COMMAND_ACK" for _sender, m in flown.uplink)
        assert not flown.a.shown("asks for control")


class TestTakingOver:
    def test_a_free_vehicle_is_had_for_the_asking(self, field: Field) -> None:
        field.a.type("request")
        field.run(1.0)
        assert field.manager.owner == A
        assert field.requests(A) == [(1.0, 0.0, 30.0, 251.0)]
        assert field.a.shown("I have vehicle 1: GCSA is in control now.")
        assert field.b.shown("GCSA is in control of")

    def test_accepted_alone_is_not_control(self, field: Field) -> None:
        field.a.type("request")
        ack = mavlink.MAVLink_command_ack_message(REQUEST, 0, 0, 0, A, 190)
        field.a.hear_from(1, 1, ack)
        assert field.a.type("status")[1].endswith("this station is partner")

    def test_with_takeover_allowed_nobody_is_asked(self, flown: Field) -> None:
        flown.manager.takeover = True
        flown.run(1.5)
        flown.b.type("request")
        flown.run(1.0)
        assert flown.manager.owner == B
        assert not flown.a.shown("asks for control")
        assert flown.a.shown("GCSB is in control now.")

    def test_the_owner_is_asked_acknowledges_and_accepts(self, flown: Field) -> None:
        flown.b.type("request")
        flown.run(1.0)
        assert flown.b.shown("REQUEST: the commander is being asked.")
        assert flown.manager.acknowledged == [A]
        assert flown.a.shown("GCSB asks for control of")
        assert flown.a.shown("Type 'handover accept' or 'handover deny'.")
        assert flown.manager.owner == A
        flown.a.type("accept")
        flown.run(2.5)
        assert flown.requests(A) == [(1.0, 1.0, 10.0, 251.0)]
        assert flown.requests(B) == [(1.0, 0.0, 30.0, 252.0)] * 2  # once more, when it was allowed
        assert flown.manager.owner == B
        assert not flown.manager.takeover
        assert flown.b.shown("GCSB is in control now.")
        flown.run(12.0)
        assert len(flown.requests(A)) == 1  # who has lost control forbids nothing

    def test_a_denial_changes_nothing(self, flown: Field) -> None:
        flown.b.type("request")
        flown.run(1.0)
        flown.a.type("deny")
        flown.run(31.0)
        assert flown.manager.owner == A
        assert flown.requests(A) == []
        assert flown.requests(B) == [(1.0, 0.0, 30.0, 252.0)]
        assert flown.b.shown("The request was not granted within 30 s. In control of")
        assert flown.a.shown("Handover Denied.")

    def test_no_answer_ends_with_the_time_out(self, flown: Field) -> None:
        flown.b.type("set request_timeout 12")
        flown.b.type("request")
        flown.run(13.5)
        assert flown.a.shown("10 s left to answer GCSB.")
        assert flown.a.shown("No answer to the request of GCSB. GCSA keeps")
        assert flown.b.shown("The request was not granted within 12 s.")
        assert flown.a.type("accept")[-1].endswith("There is no question to answer.")
        assert flown.manager.owner == A

    def test_what_is_not_taken_in_ten_seconds_is_forbidden_again(self, flown: Field) -> None:
        flown.b.type("request")
        flown.run(1.0)
        flown.b.type("release")  # takes the request back
        flown.run(0.5)
        flown.a.type("accept")
        flown.run(12.0)
        assert flown.requests(A) == [(1.0, 1.0, 10.0, 251.0), (1.0, 0.0, 10.0, 251.0)]
        assert (flown.manager.owner, flown.manager.takeover) == (A, False)
        assert flown.a.shown("GCSB has not taken")

    def test_who_may_not_is_told_so(self, flown: Field) -> None:
        flown.manager.permitted = (A,)
        flown.b.type("request")
        flown.run(2.0)
        assert flown.b.shown("REQUEST refused: denied.")
        assert flown.b.type("status")[1].endswith("this station is observer")

    def test_a_copy_of_an_answered_request_asks_nobody_again(self, flown: Field) -> None:
        flown.b.type("request")
        flown.run(1.0)
        flown.a.type("deny")
        flown.a.hear_from(1, 1, mavlink.MAVLink_command_long_message(A, 0, REQUEST, 1, 1, 0, 30, B, 0, 0, 0))
        flown.run(0.2)
        assert sum("asks for control" in line for line in flown.a.mpstate.console.lines) == 1
        assert flown.a.module.aircraft[0].core.open_question is None


@pytest.mark.parametrize("consent", ['["request"]'])
def test_a_station_that_agrees_by_itself_asks_nobody(flown: Field) -> None:
    flown.b.type("request")
    flown.run(3.0)
    assert flown.manager.owner == B
    assert flown.a.shown("This station agrees, as configured.")
    assert not any("handover accept" in line for line in flown.a.mpstate.console.lines)


class TestRelease:
    def test_on_the_ground_at_once(self, field: Field) -> None:
        field.a.type("request")
        field.run(1.5)
        field.a.type("release")
        field.run(1.5)
        assert field.manager.owner == 0
        assert field.b.shown("No station is in control of")

    def test_in_flight_it_is_typed_twice(self, flown: Field) -> None:
        assert "type 'handover release' again" in flown.a.type("release")[0]
        flown.run(1.0)
        assert flown.manager.owner == A
        flown.a.type("release")
        flown.run(1.5)
        assert flown.manager.owner == 0
        assert flown.requests(A) == [(0.0, 0.0, 0.0, 251.0)]
        assert flown.b.shown("No station is in control of vehicle 1. Type 'handover request' to take over.")

    def test_of_another_station_is_refused_by_the_manager(self, flown: Field) -> None:
        flown.b.type("release")
        flown.run(2.0)
        assert flown.manager.owner == A
        assert flown.b.shown("RELEASE refused: denied.")


class TestSilence:
    def test_a_silent_manager_is_told_and_its_word_is_old(self, flown: Field) -> None:
        flown.manager.silent = True
        flown.run(7.0)
        assert flown.a.shown("The manager of control of")
        assert flown.a.shown("is not heard any more. Which station commands is not known.")
        assert flown.a.module.aircraft[0].situation().old
        flown.manager.silent = False
        flown.run(2.0)
        assert flown.a.shown("is heard again.")
        assert not flown.a.module.aircraft[0].situation().old

    def test_a_request_that_is_not_answered_is_told(self, field: Field) -> None:
        field.manager.deaf = True
        field.a.type("request")
        field.run(6.0)
        assert field.a.shown("REQUEST: no answer of the vehicle.")
        assert field.a.type("status")[1].endswith("this station is observer")
        assert len(field.requests(A)) == 3


class TestTwoManagers:
    def test_it_is_an_alarm_and_the_first_is_believed(self, flown: Field) -> None:
        second = Manager(component=158)
        second.owner = B
        flown.managers.append(second)
        flown.run(3.0)
        assert flown.a.shown("Components 1 and 158 of")
        assert flown.a.type("status")[1].endswith("this station is commander")
        assert [alarm.name for alarm in flown.a.module.aircraft[0].event_log.alarms.standing] == ["manager"]
        flown.managers.pop()
        flown.run(7.0)
        assert flown.a.shown("Only component 1 manages control of")
        assert flown.a.module.aircraft[0].event_log.alarms.standing == ()

    def test_an_acknowledgement_of_the_other_one_counts_for_nothing(self, field: Field) -> None:
        field.manager.deaf = True
        field.a.type("request")
        field.run(0.2)
        field.a.hear_from(1, 158, mavlink.MAVLink_command_ack_message(REQUEST, 0, 0, 0, A, 190))
        field.run(0.5)
        assert not field.a.shown("REQUEST accepted.")


class TestCommands:
    def test_the_owners_pass_and_an_others_are_not_in_control(self, flown: Field) -> None:
        flown.a.type("start")
        flown.b.type("stop")
        flown.run(2.0)
        assert flown.manager.granted == ["MAV_CMD_MISSION_START"]
        assert flown.b.shown("STOP refused: not in control.")
        assert NOT_IN_CONTROL == 10

    @pytest.mark.parametrize(
        "line", ["give GCSB", "override energy", "rehearse", "rehearse end", "share", "telemetry", "briefing"]
    )
    def test_what_has_no_counterpart_says_so(self, flown: Field, line: str) -> None:
        said = flown.a.type(line)
        assert said[0].startswith(
            f"handover {line.split(maxsplit=1)[0]}: the MAVLink standard has no such command, and component 1"
        )
        flown.run(0.5)
        assert [m for _sender, m in flown.uplink if m.get_type() != "HEARTBEAT"] == []


def test_nothing_of_ours_goes_to_such_a_vehicle(flown: Field) -> None:
    flown.b.type("request")
    flown.run(1.0)
    flown.a.type("accept")
    flown.run(5.0)
    assert [m.get_type() for _sender, m in flown.uplink if m.get_msgId() in OUR_MESSAGES] == []


class TestWithOurCompanion:
    """Our own messages stay in use: nothing is asked or shown twice."""

    def ours(self, field: Field, commander: int, epoch: int) -> None:
        for station in field.stations:
            station.hear(mavlink.MAVLink_authority_status_message(1, commander, 0, 251, epoch, 0, 1, 2, 0))

    def test_its_status_is_not_used_beside_ours(
        self, monkeypatch: pytest.MonkeyPatch, clock: Clock, tmp_path: Path
    ) -> None:
        monkeypatch.setattr(gcs_module, "time", clock)
        monkeypatch.setattr(station_commands, "time", clock)
        field = Field(tmp_path, clock, '"operator"')
        companion = field.managers[0] = Manager(component=191)
        companion.owner = A
        for _ in range(8):
            self.ours(field, A, 1)
            field.run(1.0)
        assert not field.a.shown("MAVLink standard")
        assert sum("is the commander now" in line for line in field.a.mpstate.console.lines) == 1
        field.a.hear_from(1, 191, mavlink.MAVLink_command_long_message(A, 0, REQUEST, 0, 1, 0, 30, B, 0, 0, 0))
        field.uplink.clear()
        field.run(1.0)
        assert not any(m.get_type() == "COMMAND_ACK" for _sender, m in field.uplink)
        assert not field.a.shown("asks for control")
        field.close()

    def test_it_takes_over_from_the_standard(self, flown: Field) -> None:
        self.ours(flown, B, 3)
        flown.manager.owner = A
        flown.run(2.0)
        assert flown.a.type("status")[1] == "commander GCSB, epoch 3; this station is observer"
