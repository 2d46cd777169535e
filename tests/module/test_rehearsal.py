# SPDX-License-Identifier: GPL-3.0-or-later

"""A rehearsal on the ground through the real module: carried from zone to zone, nothing arms, nothing is commanded."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from gcs_module.core import MissionHeld, StationCore
from mavproxy_handover.core.common.events import Fly
from mavproxy_handover.core.common.model import AUTOMATIC, FlightAction, LeaseState, Phase, Reason, Station
from mavproxy_handover.mission.package import MissionPackage
from tests.module import vehicle
from tests.module.conftest import Bench
from tests.module.test_handover import IN_A, IN_B, IN_BOTH, OUTSIDE, give_rules

REPORT, BEGIN, END = (
    mavlink.HANDOVER_REHEARSAL_WISH_REPORT,
    mavlink.HANDOVER_REHEARSAL_WISH_BEGIN,
    mavlink.HANDOVER_REHEARSAL_WISH_END,
)
START, ARM, MODE = mavlink.MAV_CMD_MISSION_START, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, mavlink.MAV_CMD_DO_SET_MODE
TAKE_OFF, MOTORS = mavlink.MAV_CMD_NAV_TAKEOFF, mavlink.MAV_CMD_DO_MOTOR_TEST
REJECTED = mavlink.MAV_RESULT_TEMPORARILY_REJECTED


def ask(bench: Bench, station: vehicle.Station, wish: int, nonce: int = 7, aircraft: int = 1) -> list[Any]:
    """HANDOVER_REHEARSE of a station; its answers."""
    before = len(station.got("HANDOVER_REHEARSAL"))
    station.send(mavlink.MAVLink_handover_rehearse_message(1, 191, aircraft, wish, nonce))
    bench.run(0.3)
    return station.got("HANDOVER_REHEARSAL")[before:]


def begin(bench: Bench, station: vehicle.Station | None = None, nonce: int = 1) -> bool:
    (answer,) = ask(bench, station or bench.a, BEGIN, nonce)
    assert (answer.vehicle, answer.wish, answer.nonce, answer.line, answer.lines) == (1, BEGIN, nonce, 0, 0)
    return bool(answer.accepted)


def report(bench: Bench, station: vehicle.Station) -> list[str]:
    lines = ask(bench, station, REPORT)
    assert [(m.line, m.lines) for m in lines] == [(number, len(lines)) for number in range(1, len(lines) + 1)]
    return [m.text for m in lines]


@pytest.fixture
def ready(bench: Bench, delivery: MissionPackage) -> Bench:
    """On the ground in zone A; GCSA commands, the mission is loaded, both stations answer by their rules."""
    bench.connect()
    bench.share(delivery, at_once=True)
    for station, other in ((bench.a, bench.b), (bench.b, bench.a)):
        others = (Station(other.sysid, other.name),)
        core = StationCore(Station(station.sysid, station.name), "drone-1", others, automatic=AUTOMATIC)
        core.handle(MissionHeld(delivery.digest), bench.clock.now)
        give_rules(station, core, bench)
    bench.autopilot.position = IN_A
    bench.wait(1.5)
    return bench


@pytest.fixture
def carried(ready: Bench) -> Bench:
    assert begin(ready)
    ready.run(1.0)
    return ready


def orders(bench: Bench) -> list[int]:
    """What would move the aircraft, or could."""
    return [command for command in bench.autopilot.commands() if command in (START, ARM, MODE, TAKE_OFF, MOTORS)]


class TestBeginning:
    def test_everybody_is_told(self, ready: Bench) -> None:
        assert begin(ready)
        for station in (ready.a, ready.b):
            assert "REHEARSAL: begun by GCSA, nothing arms" in station.texts()
            assert station.got("AUTHORITY_STATUS")[-1].rehearsal == 1
        assert ready.companion.view.phase is Phase.ON_MISSION
        (entry,) = ready.journal("rehearsal")
        assert (entry["on"], entry["reason"]) == (True, "operator")

    def test_no_lease_permits_arming_from_then_on(self, ready: Bench) -> None:
        assert begin(ready)
        before = len(ready.autopilot.leases())
        ready.run(2.0)
        leases = ready.autopilot.leases()[before:]
        assert len(leases) > 5
        assert {(lease[1], lease[2]) for lease in leases} == {(LeaseState.RECOVERING, 251)}

    def test_of_who_does_not_command_it_is_refused(self, ready: Bench) -> None:
        assert not begin(ready, ready.b)
        assert "REHEARSE refused: GCSB does not command" in ready.b.texts()
        assert not ready.companion.view.rehearsal

    def test_without_a_mission_it_is_refused(self, bench: Bench) -> None:
        bench.connect()
        assert not begin(bench)
        assert bench.a.texts() == "REHEARSE refused: no mission loaded; outside the zone of GCSA"

    def test_armed_it_is_refused(self, ready: Bench) -> None:
        ready.autopilot.armed = True
        ready.run(1.5)
        assert not begin(ready)
        assert not ready.companion.view.rehearsal

    def test_a_copy_is_answered_again_and_begins_none_anew(self, carried: Bench) -> None:
        assert ask(carried, carried.a, END, 2)[0].accepted
        assert begin(carried, nonce=1), "what was answered to it before"
        assert not carried.companion.view.rehearsal

    def test_the_same_wish_twice_is_one(self, carried: Bench) -> None:
        assert begin(carried, nonce=1)
        assert len(carried.journal("rehearsal")) == 1

    def test_what_makes_no_sense_begins_nothing(self, ready: Bench) -> None:
        (answer,) = ask(ready, ready.a, 77)
        assert not answer.accepted
        assert ask(ready, ready.a, BEGIN, aircraft=2) == []
        assert not ready.companion.view.rehearsal


class TestNothingArms:
    @pytest.mark.parametrize("who", ["a", "b"])
    @pytest.mark.parametrize(
        ("command", "parameters", "word"),
        [
            (START, (), "START"),
            (ARM, (1.0,), "arm"),
            (ARM, (1.0, 21196.0), "arm"),
            (TAKE_OFF, (), "take-off"),
            (MOTORS, (1.0,), "motor test"),
        ],
    )
    def test_every_station_is_refused_with_the_reason(
        self, carried: Bench, who: str, command: int, parameters: tuple[float, ...], word: str
    ) -> None:
        station = getattr(carried, who)
        station.command(command, *parameters)
        carried.run(0.5)
        assert station.acks(command) == [REJECTED]
        assert f"{word} refused: a rehearsal is under way: nothing arms" in station.texts()
        assert orders(carried) == []

    def test_sticks_do_not_pass(self, carried: Bench) -> None:
        carried.wait(5.0)
        before = len(carried.autopilot.got("RC_CHANNELS_OVERRIDE"))
        carried.a.send(mavlink.MAVLink_rc_channels_override_message(1, 1, 1500, 1500, 1000, 2000, 0, 0, 0, 0))
        carried.run(0.5)
        assert len(carried.autopilot.got("RC_CHANNELS_OVERRIDE")) == before

    def test_an_order_that_came_all_the_same_is_not_flown(self, carried: Bench) -> None:
        carried.companion._parts.actions.perform(Fly(FlightAction.RETURN, Reason.FENCE), carried.clock.now)
        carried.run(1.0)
        assert orders(carried) == []
        assert carried.companion.faults.pop("order in a rehearsal") == 1

    def test_what_would_be_done_is_told(self, carried: Bench) -> None:
        carried.autopilot.position = OUTSIDE
        carried.wait(8.0)
        assert orders(carried) == []
        assert "REHEARSAL: would RETURN" in carried.a.texts()
        assert carried.companion.view.phase is Phase.EMERGENCY
        (entry, *_more) = carried.journal("would")
        assert entry["text"] == "out of coverage: would return"
        assert any("would RETURN" in line for line in report(carried, carried.a))


class TestHandovers:
    def test_zones_bring_them_about(self, carried: Bench) -> None:
        carried.autopilot.position = IN_BOTH
        carried.until(lambda: carried.companion.view.commander == 252)
        carried.autopilot.position = IN_B
        carried.wait(6.0)
        carried.autopilot.position = IN_BOTH
        carried.until(lambda: carried.companion.view.commander == 251)
        assert orders(carried) == []
        lines = report(carried, carried.b)
        assert lines[1] == "handovers 2, 2 of 4 that the check has"
        assert lines[2].startswith("  1: GCSA -> GCSB at ")

    def test_the_next_commander_ends_it(self, carried: Bench) -> None:
        carried.autopilot.position = IN_BOTH
        carried.until(lambda: carried.companion.view.commander == 252)
        carried.run(0.5)
        (answer,) = ask(carried, carried.a, END, 3)
        assert not answer.accepted
        assert "REHEARSE END refused: GCSA does not command" in carried.a.texts()
        (answer,) = ask(carried, carried.b, END, 3)
        assert answer.accepted
        assert not carried.companion.view.rehearsal


class TestTheEnd:
    def test_by_the_commander(self, carried: Bench) -> None:
        carried.b.command(mavlink.MAV_CMD_NAV_LAND)
        carried.run(2.0)
        (answer,) = ask(carried, carried.a, END, 3)
        assert answer.accepted
        assert "REHEARSAL OVER: ended by GCSA" in carried.b.texts()
        assert carried.a.got("AUTHORITY_STATUS")[-1].rehearsal == 0
        (entry,) = carried.journal("rehearsal_report")
        assert entry["over"]
        assert ["GCSB", "COMMAND_LONG/MAV_CMD_NAV_LAND", "not in control", 1] in entry["refused"]
        assert {(link["station"], link["place"]) for link in entry["links"]} == {("GCSA", "GCSA"), ("GCSB", "GCSA")}
        assert all(link["silent_s"] < 2.0 for link in entry["links"])
        lines = report(carried, carried.b)
        assert lines[0].startswith("rehearsal ended by GCSA, ")

    def test_then_the_lease_permits_arming_and_start_flies(self, carried: Bench) -> None:
        ask(carried, carried.a, END, 3)
        carried.run(1.0)
        assert carried.autopilot.leases()[-1][1:3] == (LeaseState.HELD, 251)
        carried.a.command(START)
        carried.until(lambda: carried.companion.view.phase is Phase.ON_MISSION)
        assert carried.autopilot.armed

    def test_armed_all_the_same_it_is_over_loudly(self, carried: Bench) -> None:
        carried.autopilot.armed = True
        carried.run(1.5)
        assert not carried.companion.view.rehearsal
        for station in (carried.a, carried.b):
            severity = [s for s, text in station.told() if text.startswith("REHEARSAL OVER")]
            assert severity == [mavlink.MAV_SEVERITY_CRITICAL]
        assert carried.autopilot.leases()[-1][1:3] == (LeaseState.HELD, 251)
        assert orders(carried) == []

    def test_the_report_of_none(self, ready: Bench) -> None:
        assert report(ready, ready.b) == ["no rehearsal since the companion was started"]

    def test_reports_come_no_oftener_than_twice_a_second(self, carried: Bench) -> None:
        before = len(carried.a.got("HANDOVER_REHEARSAL"))
        for nonce in range(20):
            carried.a.send(mavlink.MAVLink_handover_rehearse_message(1, 191, 1, REPORT, nonce))
        carried.run(0.3)
        answered = {m.nonce for m in carried.a.got("HANDOVER_REHEARSAL")[before:]}
        assert len(answered) == 2

    def test_at_the_vehicles_console(self, carried: Bench) -> None:
        assert carried.mpstate.type("handover rehearsal")[0].startswith("rehearsal under way, ")
        assert any(line.startswith("rehearsal ") for line in carried.mpstate.type("handover status"))


def test_a_restart_of_the_companion_goes_on_with_it(ready: Bench) -> None:
    """It knows what it has seen since; the report of before is in the journal, each minute."""
    ready.run(0.5)
    assert begin(ready)
    ready.wait(62.0)
    assert len([entry for entry in ready.journal("rehearsal_report") if not entry["over"]]) == 1
