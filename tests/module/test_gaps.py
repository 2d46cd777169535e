# SPDX-License-Identifier: GPL-3.0-or-later

"""A mission with a gap in the companion: START, the lease while it is crossed, a restart there, another mission."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import LeaseState, Phase
from mavproxy_handover.mission import package as mission_package
from mavproxy_handover.mission.package import MissionPackage
from tests.module.conftest import Bench
from tests.module.test_flight_uploads import Program, waypoint
from tests.module.test_restart import lose_power, restart
from tests.module.vehicle import AUTO, RTL
from tests.packages import MISSIONS

START = mavlink.MAV_CMD_MISSION_START
REJECTED = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
#: in the zone of GCSA, 50 m behind its border, and in the zone of GCSB
HOME, OUT, FAR = (52.684, 5.91), (52.684, 5.912961), (52.684, 5.9163)
ALONE = 5
LOITER, SET_MODE = 5, mavlink.MAV_CMD_DO_SET_MODE


@pytest.fixture(scope="session")
def ridge() -> MissionPackage:
    return mission_package.load(MISSIONS / "ridge")


@pytest.fixture
def loaded(bench: Bench, ridge: MissionPackage) -> Bench:
    """The parent commands, the mission is loaded, the guard allows a minute; what is checked before flight was read."""
    bench.autopilot.position = HOME
    bench.autopilot.parameters.update({"HNDO_ALONE_MAX": 60.0, "HNDO_SYSID_SW": 1.0})
    bench.connect()
    bench.share(ridge, at_once=True)
    bench.until(lambda: bench.needs() == (), 30.0)
    return bench


@pytest.fixture
def flying(loaded: Bench) -> Bench:
    """In AUTO, on the way to item 2."""
    loaded.a.command(START)
    loaded.until(lambda: loaded.companion.view.phase is Phase.ON_MISSION)
    loaded.autopilot.waypoint = 2
    loaded.wait(1.5)
    return loaded


def last_lease(bench: Bench) -> tuple[int, int, int]:
    """State, commander, seconds that are left."""
    lease = bench.autopilot.leases()[-1]
    return lease[1], lease[2], lease[8]


def into_the_gap(bench: Bench) -> None:
    bench.autopilot.position = OUT
    bench.a.alive = bench.b.alive = False
    bench.until(lambda: bench.companion.view.lease is LeaseState.ALONE, 10.0)


def test_start_is_refused_while_the_guard_allows_less_than_a_gap_may_take(loaded: Bench) -> None:
    text = "gaps: HNDO_ALONE_MAX is 0 s, GCSA -> GCSB may take 60 s"
    loaded.a.send(mavlink.MAVLink_param_set_message(1, 1, b"HNDO_ALONE_MAX", 0.0, 9))
    loaded.until(lambda: loaded.needs() == (text,), 3.0)
    loaded.a.command(START)
    loaded.run(0.5)
    assert loaded.a.acks(START) == [REJECTED]
    assert loaded.a.texts() == f"START refused: {text}"
    assert loaded.autopilot.commands() == []


def test_what_is_set_while_the_parameters_are_read_counts(loaded: Bench) -> None:
    """The old value was read before it, and the reading ends behind it."""

    def read() -> int:
        asked = loaded.autopilot.got("PARAM_REQUEST_READ")
        return sum(m.param_id == "HNDO_ALONE_MAX" for m in asked)

    loaded.wait(6.0)
    loaded.a.send(mavlink.MAVLink_param_set_message(1, 1, b"HNDO_ALONE_MAX", 0.0, 9))
    loaded.until(lambda: loaded.needs() != (), 3.0)
    before = read()
    preflight = loaded.companion.autopilot.preflight
    preflight.planned(preflight._plan, 60.0)  # it is looked at again
    loaded.until(lambda: read() > before, 40.0)
    loaded.run(1.0)
    loaded.a.send(mavlink.MAVLink_param_set_message(1, 1, b"HNDO_ALONE_MAX", 60.0, 9))
    loaded.wait(8.0)
    assert loaded.needs() == ()


def test_a_guard_of_before_knows_no_gaps(bench: Bench, ridge: MissionPackage) -> None:
    bench.autopilot.position = HOME
    bench.connect()
    bench.share(ridge)
    assert "gaps: the guard's parameters are not read yet" in bench.needs()
    bench.until(lambda: bench.needs() == ("gaps: the guard has no HNDO_ALONE_MAX: it knows no gaps",), 30.0)


def test_another_mission_needs_none(loaded: Bench, delivery: MissionPackage) -> None:
    loaded.autopilot.parameters["HNDO_ALONE_MAX"] = 0.0
    loaded.autopilot.position = (52.679, 5.924)
    loaded.share(delivery)
    loaded.run(2.0)
    assert loaded.needs() == ()


def test_in_the_gap_the_lease_says_alone_and_how_long(flying: Bench) -> None:
    assert last_lease(flying) == (LeaseState.HELD, 251, 0)
    into_the_gap(flying)
    state, commander, left_s = last_lease(flying)
    assert (state, commander) == (ALONE, 0)
    assert 53 <= left_s <= 56
    flying.wait(20.0)
    assert last_lease(flying) == (ALONE, 0, left_s - 20)
    assert flying.autopilot.mode == AUTO
    assert flying.journal("emergency") == []
    assert [entry["text"] for entry in flying.journal("gap")][-1].startswith(
        "commander lost: It crosses the mission's gap GCSA -> GCSB, 5"
    )


def test_at_the_limits_end_it_comes_home(flying: Bench) -> None:
    into_the_gap(flying)
    flying.until(lambda: flying.autopilot.mode == RTL, 61.0)
    assert last_lease(flying)[0] == LeaseState.LOST
    (entry,) = flying.journal("emergency")
    assert entry["text"] == "commander lost: return"


def test_out_of_auto_it_comes_home_at_once(flying: Bench) -> None:
    into_the_gap(flying)
    flying.autopilot.mode = 5
    flying.until(lambda: flying.autopilot.mode == RTL, 3.0)


def test_a_mission_of_its_commander_takes_the_gaps_away(flying: Bench) -> None:
    lat, lon = (round(degrees * 1e7) for degrees in HOME)
    items = waypoint(0, lat, lon, 0.0), waypoint(1, lat + 2000, lon), waypoint(2, lat, lon, 0.0, command=21)
    assert Program(flying, items).send() == mavlink.MAV_MISSION_ACCEPTED
    flying.autopilot.position = OUT
    flying.until(lambda: flying.autopilot.mode == RTL, 5.0)


def test_its_commander_may_have_it_fly_the_mission_on_though_a_gap_lies_ahead(flying: Bench) -> None:
    flying.autopilot.mode = LOITER
    flying.run(1.5)
    flying.a.received.clear()
    flying.a.command(SET_MODE, 1, AUTO)
    flying.run(0.5)
    assert flying.a.acks(SET_MODE) == [mavlink.MAV_RESULT_ACCEPTED]
    assert flying.autopilot.mode == AUTO


def test_a_companion_that_restarts_in_the_gap_goes_on_with_the_same_clock(flying: Bench) -> None:
    into_the_gap(flying)
    flying.wait(10.0)
    left_s = last_lease(flying)[2]
    restart(flying, away_s=1.5)
    flying.run(1.0)
    assert last_lease(flying)[0] == LeaseState.RECOVERING
    flying.until(lambda: flying.companion.view.lease is LeaseState.ALONE, 4.0)
    # away 1.5 s, and the recovery takes 2.5
    assert left_s - 6 <= last_lease(flying)[2] <= left_s - 4
    assert flying.autopilot.mode == AUTO
    flying.until(lambda: flying.autopilot.mode == RTL, left_s + 1.0)


def test_after_a_loss_of_power_there_is_no_time_left(flying: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    into_the_gap(flying)
    flying.run(2.0)
    lose_power(flying, monkeypatch)
    flying.load()
    flying.until(lambda: flying.autopilot.mode == RTL, 6.0)
    assert last_lease(flying)[0] != ALONE
