# SPDX-License-Identifier: GPL-3.0-or-later

"""When looking at the places of a return breaks in flight: the battery is watched on, by what is left now."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.core.safety.return_site import ReturnSiteChooser
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.mission.return_paths import PlaceFinder
from mavproxy_handover.monitors.return_site import views
from mavproxy_handover.monitors.return_site.views import Views
from mavproxy_handover.operator.return_site.return_questions import ReturnQuestions
from mavproxy_handover.operator.return_site.return_site import ReturnSite
from tests.module.conftest import Bench
from tests.module.vehicle import AUTO, LAND, RTL

START = mavlink.MAV_CMD_MISSION_START
#: of the delivery mission, with home in the list
AWAY = (52.6790, 5.9270)


def broken(*_arguments: Any, **_values: Any) -> Any:
    raise RuntimeError("planted")


@pytest.fixture
def ready(bench: Bench, delivery: MissionPackage) -> Bench:
    bench.config.write_text(bench.config.read_text() + '[policy]\nno_station = "off"\ncoverage_ends = "off"\n')
    bench.connect()
    bench.share(delivery, at_once=True)
    bench.wait(6.0)
    return bench


def start(bench: Bench) -> None:
    bench.a.command(START)
    bench.until(lambda: bench.companion.view.phase is Phase.ON_MISSION)
    bench.wait(2.0)


@pytest.fixture
def flying(ready: Bench) -> Bench:
    """In flight with a third of the battery, of which 35.2 Wh have to be left at the last."""
    start(ready)
    ready.autopilot.battery = 0.34
    ready.wait(10.0)
    assert ready.autopilot.mode == AUTO
    return ready


def watch(bench: Bench) -> Any:
    return bench.companion.autopilot.return_site


PLANTS: dict[str, Callable[[pytest.MonkeyPatch], None]] = {
    "the map": lambda patch: patch.setattr(PlaceFinder, "evaluate", broken),
    "the way back": lambda patch: patch.setattr(views, "way_back", broken),
    "what is asked": lambda patch: patch.setattr(ReturnQuestions, "ask", broken),
    "a look": lambda patch: patch.setattr(ReturnSite, "_judge_candidates", broken),
    "the choice": lambda patch: patch.setattr(ReturnSiteChooser, "choose", broken),
}


@pytest.mark.parametrize("part", list(PLANTS))
def test_a_battery_that_empties_brings_it_home_although_looking_breaks(
    flying: Bench, part: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The fault: the margins of a full battery went on, and it flew on in AUTO, with leases."""
    with monkeypatch.context() as patch:
        PLANTS[part](patch)
        flying.autopilot.battery = 0.05
        flying.until(lambda: flying.autopilot.mode == RTL, 20.0)
        flying.run(1.0)
        said = flying.a.texts()
    assert "RETURN to home. " in said
    assert " Wh left, the way back needs 35.2 Wh with the reserve. " in said
    assert said.count("internal fault of the companion: ") == 1
    assert not flying.companion.failed


def test_what_is_asked_and_what_is_looked_at_do_not_stop_each_other(
    flying: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = watch(flying).choice.place
    with monkeypatch.context() as patch:
        patch.setattr(ReturnQuestions, "ask", broken)
        flying.autopilot.position = AWAY
        flying.wait(3.0)
    assert watch(flying).choice.place.distance_m > before.distance_m + 100.0


def test_a_place_that_cannot_be_looked_at_leaves_the_others(flying: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    see = Views._evaluate

    def odd(self: Any, place: Any, *way: Any) -> Any:
        return broken() if place.name == "rally 1" else see(self, place, *way)

    with monkeypatch.context() as patch:
        patch.setattr(Views, "_evaluate", odd)
        flying.autopilot.position = AWAY
        flying.wait(3.0)
        facts = {name: seen.fact for name, seen in watch(flying).views.seen.items()}
    assert facts["home"].distance_m == pytest.approx(202.0, abs=5.0)
    assert facts["rally 2"].distance_m == pytest.approx(330.0, abs=20.0)
    assert facts["rally 1"].distance_m < 150.0, "as it was seen last"


def test_the_place_is_chosen_by_what_is_left_now(flying: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(PlaceFinder, "evaluate", broken)
        flying.autopilot.battery = 0.001
        flying.until(lambda: flying.autopilot.mode == LAND, 30.0)
        words = watch(flying).words()
    assert "(0 % left)" in words
    assert "OUT OF REACH" in words


def test_what_was_never_looked_at_is_out_of_reach_when_only_the_reserve_is_left(
    ready: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As behind a restart in flight, where looking breaks from the beginning."""
    start(ready)
    with monkeypatch.context() as patch:
        patch.setattr(PlaceFinder, "evaluate", broken)
        watch(ready).views.seen.clear()
        ready.wait(5.0)
        assert not watch(ready).short
        ready.autopilot.battery = 0.2
        ready.until(lambda: ready.autopilot.mode == RTL, 20.0)


def test_flying_on_unseen_makes_the_way_back_longer(ready: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody knows how far it has gone meanwhile: as far as a return flies in that time."""
    start(ready)
    ready.autopilot.battery = 0.34
    ready.run(10.0)
    with monkeypatch.context() as patch:
        patch.setattr(PlaceFinder, "evaluate", broken)
        known = watch(ready).margin_wh
        ready.run(8.0)
        assert watch(ready).margin_wh == known, "a moment is no matter"
        ready.run(12.0)
        # 20 s away at 10 m/s and 20 s back, with the reserve factor
        assert 1.5 <= known - watch(ready).margin_wh <= 4.5
        assert watch(ready).choice.place.margin_wh == pytest.approx(known, abs=0.1), (
            "it lands for what is, not for what may be"
        )
        ready.until(lambda: ready.autopilot.mode == RTL, 120.0)
        known = watch(ready).margin_wh
        ready.run(30.0)
        assert ready.autopilot.mode == RTL
        assert watch(ready).margin_wh == known, "on its way back it gets nearer"
    ready.run(2.0)
    assert watch(ready).margin_wh > known


def test_while_looking_works_the_margin_is_the_one_that_was_seen(flying: Bench) -> None:
    for battery in (0.34, 0.33, 0.32):
        flying.autopilot.battery = battery
        flying.wait(3.0)
        facts = [seen.fact for seen in watch(flying).views.seen.values()]
        assert watch(flying).margin_wh == max(fact.margin_wh for fact in facts)
        energy, margin = flying.companion.autopilot.energy.fact, watch(flying)._margin
        assert [margin.by_now(seen, energy) for seen in watch(flying).views.seen.values()] == facts
