# SPDX-License-Identifier: GPL-3.0-or-later

"""The companion keeps the vehicle's addresses that come with a mission, for a station that gets the mission back."""

from __future__ import annotations

from dataclasses import replace

from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.wire.vehicle_address import VehicleAddress
from tests.module.conftest import Bench

WIFI = VehicleAddress("10.0.0.2", 14552)
LTE = VehicleAddress("100.64.3.7", 5762)


def held(bench: Bench) -> dict[int, tuple[VehicleAddress, ...]]:
    package = bench.companion.autopilot.mission.flown.package
    assert package is not None
    return dict(package.addresses)


def test_those_of_the_missions_stations_are_kept_and_the_digest_stays(bench: Bench, delivery: MissionPackage) -> None:
    bench.connect()
    bench.share(replace(delivery, addresses={252: (WIFI,), 99: (LTE,)}))
    assert held(bench) == {252: (WIFI,)}
    assert bench.companion.autopilot.mission.flown.package.digest == delivery.digest


def test_a_mission_that_is_shared_again_with_others_brings_the_others(bench: Bench, delivery: MissionPackage) -> None:
    bench.connect()
    bench.share(replace(delivery, addresses={252: (WIFI,)}))
    bench.wait(10.0)
    bench.share(replace(delivery, addresses={252: (LTE,)}))
    assert held(bench) == {252: (LTE,)}


def test_a_mission_of_an_older_station_has_none(bench: Bench, delivery: MissionPackage) -> None:
    bench.connect()
    bench.share(delivery)
    assert held(bench) == {}
