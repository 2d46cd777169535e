# SPDX-License-Identifier: GPL-3.0-or-later

"""Remote ID through the whole companion: what the autopilot gets of the operator, and from which sender."""

from __future__ import annotations

from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.remote_id import RemoteIdRule
from mavproxy_handover.mission.package import MissionPackage
from tests.module.conftest import Bench
from tests.module.test_faults import broken, leases_in
from tests.module.vehicle import Station

PLACES = {251: (52.1, 4.2, 31.0), 252: (52.5, 4.6, 32.0)}


def system(station: Station, lat: float, lon: float) -> None:
    at = (round(lat * 1e7), round(lon * 1e7))
    station.send(mavlink.MAVLink_open_drone_id_system_message(0, 0, bytes(20), 1, 0, *at, 1, 0, 0, 0, 0, 0, 8.0, 7))


def places_of(bench: Bench, sysid: int, compid: int) -> list[tuple[float, float]]:
    kinds = ("OPEN_DRONE_ID_SYSTEM", "OPEN_DRONE_ID_SYSTEM_UPDATE")
    return [
        (m.operator_latitude / 1e7, m.operator_longitude / 1e7)
        for m in bench.autopilot.received
        if m.get_type() in kinds and (m.get_srcSystem(), m.get_srcComponent()) == (sysid, compid)
    ]


def has_places(bench: Bench, package: MissionPackage) -> None:
    stations = tuple(replace(each, place=PLACES.get(each.sysid)) for each in package.stations)
    bench.companion.autopilot.mission.flown.package = replace(package, stations=stations)


@pytest.fixture
def located(bench: Bench, delivery: MissionPackage) -> Bench:
    bench.configure(more="")
    text = bench.config.read_text().replace('name = "GCSA"', 'name = "GCSA"\noperator_id = "NLD-A"')
    bench.config.write_text(text)
    bench.connect()
    has_places(bench, delivery)
    bench.autopilot.received.clear()
    return bench


def test_the_companion_sends_place_and_id_of_the_commander(located: Bench) -> None:
    located.run(6.5)
    found = places_of(located, 1, 191)
    assert set(found) == {PLACES[251][:2]}
    assert 6 <= len(found) <= 7
    (first, *_) = located.autopilot.got("OPEN_DRONE_ID_SYSTEM")
    assert (first.operator_altitude_geo, first.operator_location_type, first.target_system) == (31.0, 2, 1)
    assert first.timestamp > 200_000_000
    ids = {m.operator_id for m in located.autopilot.got("OPEN_DRONE_ID_OPERATOR_ID")}
    assert ids == {"NLD-A"}
    assert [(entry["station"], entry["operator_id"]) for entry in located.journal("remote_id")] == [("GCSA", "NLD-A")]


def test_after_a_handover_the_place_is_the_new_commanders_at_once(located: Bench) -> None:
    located.run(2.0)
    located.autopilot.received.clear()
    view = located.companion.gate.view
    located.companion.gate.change(replace(view, commander=252, epoch=view.epoch + 1), located.clock.now)
    located.run(0.15)
    assert places_of(located, 1, 191) == [PLACES[252][:2]]


def test_the_commanders_own_program_stays_in_charge(located: Bench) -> None:
    located.run(0.5)
    system(located.a, 51.0, 3.0)
    located.run(0.3)
    located.autopilot.received.clear()
    for _second in range(5):
        system(located.a, 51.0, 3.0)
        located.run(1.0)
    assert places_of(located, 251, 190) == [(51.0, 3.0)] * 5
    assert places_of(located, 1, 191) == []
    located.run(4.0)
    assert set(places_of(located, 1, 191)) == {(51.0, 3.0)}, "it has fallen silent"


def test_an_observers_program_does_not_reach_the_autopilot(located: Bench) -> None:
    system(located.b, 51.0, 3.0)
    located.run(2.0)
    assert places_of(located, 252, 190) == []
    assert set(places_of(located, 1, 191)) == {PLACES[251][:2]}


def test_where_stations_send_the_companion_does_not(bench: Bench, delivery: MissionPackage) -> None:
    with bench.config.open("a") as file:
        file.write('\n[remote_id]\nsends = "station"\n')
    bench.connect()
    has_places(bench, delivery)
    bench.run(3.0)
    assert places_of(bench, 1, 191) == []


def test_a_missing_place_is_told_where_the_aircraft_has_remote_id(bench: Bench) -> None:
    bench.connect()
    bench.run(10.0)
    assert "Remote ID" not in bench.a.texts()
    enabled = mavlink.MAVLink_param_value_message(b"DID_ENABLE", 1.0, 2, 1, 0)
    bench.companion.autopilot.aircraft.parameters.on_value(enabled, bench.clock.now)
    bench.run(70.0)
    text = "Remote ID: the place of GCSA is not known ('place' in [[stations]] of the mission)."
    for station in (bench.a, bench.b):
        assert 1 <= station.texts().count(text) <= 2


def test_a_fault_of_remote_id_costs_remote_id_alone(located: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    before = leases_in(located, 2.0)
    monkeypatch.setattr(RemoteIdRule, "due", broken)
    assert leases_in(located, 2.0) >= before - 1
    assert located.companion.view.commander == 251
