# SPDX-License-Identifier: GPL-3.0-or-later

"""What a mission lacks for feeds, in its check."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mavproxy_handover.mission.check import Severity, check
from mavproxy_handover.mission.check_feeds import ground_lacks, places_lack
from mavproxy_handover.mission.package import MissionPackage, load
from mavproxy_handover.mission.terrain import Terrain
from mavproxy_handover.tools.resources import shipped


def mission(name: str) -> MissionPackage:
    return load(shipped("missions") / name)


def test_a_grid_that_ends_near_home_is_told() -> None:
    hills = mission("hills")
    (found,) = [finding for finding in check(hills).findings if "[feeds] terrain" in finding.text]
    assert (found.severity, found.rule) == (Severity.INFO, "heights")
    assert found.text.startswith(
        "the heights of the ground do not reach 4.7 km north and south, 5.4 km east and west of"
    )


def test_a_large_grid_and_a_route_above_home_lack_nothing() -> None:
    hills, home = mission("hills"), mission("hills").route.home
    large = Terrain(home.lat_deg - 0.1, home.lon_deg - 0.1, 0.01, np.full((21, 21), 60.0))
    assert ground_lacks(replace(hills, terrain=large)) == ""
    assert ground_lacks(replace(mission("delivery"), terrain=hills.terrain)) == ""
    assert ground_lacks(mission("delivery")) == ""


def with_places(*places: tuple[float, float, float] | None) -> MissionPackage:
    delivery = mission("delivery")
    stations = [replace(station, place=place) for station, place in zip(delivery.stations, places, strict=True)]
    return replace(delivery, stations=tuple(stations))


def test_a_station_without_a_place_beside_one_with_is_told() -> None:
    here = (52.0, 5.0, 3.0)
    text = "no 'place' in [[stations]] of GCSB: Remote ID has the operator's place only from its program"
    assert places_lack(with_places(here, None)) == text
    assert places_lack(with_places(here, here)) == places_lack(with_places(None, None)) == ""
    (found,) = [finding for finding in check(with_places(here, None)).findings if finding.rule == "remote-id"]
    assert (found.severity, found.text) == (Severity.WARNING, text)
