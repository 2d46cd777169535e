# SPDX-License-Identifier: GPL-3.0-or-later

"""What the arbiter tells the rest of the companion: zones, answers that are awaited, and how well stations hear."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mavproxy_handover.core.common.snapshot import Snapshot
from tests.core.bench import DIGEST, A, B, Bench, C, Phase, far, inside

LEFT = Snapshot(A, 4, 7, Phase.ON_MISSION, 2, DIGEST, (A, B, A))


class TestZones:
    def test_no_zone_is_zero_and_one_zone_leaves_the_second_at_zero(self) -> None:
        bench = Bench().on_mission()
        bench.position(*far(A, B, C))
        assert bench.arbiter.zones() == (0, 0)
        bench.position(inside(A), *far(B, C))
        assert bench.arbiter.zones() == (A, 0)

    def test_in_an_overlap_the_commander_is_the_first(self) -> None:
        bench = Bench().commit()
        bench.position(inside(A), inside(B))
        assert bench.arbiter.zones() == (B, A)
        assert bench.arbiter.zone() == B


class TestAwaitsTheCommander:
    def test_without_a_transfer_no_answer_is_awaited(self) -> None:
        assert not Bench().on_mission().arbiter.awaits_commander

    def test_until_the_commander_has_agreed(self) -> None:
        bench = Bench().up_to("CONSENT")
        assert bench.arbiter.awaits_commander

    def test_a_commander_that_gives_the_aircraft_away_has_agreed(self) -> None:
        bench = Bench().up_to("CONSENT")
        bench.give(bench.request(A, give_to=B))
        assert bench.arbiter.view.partner == B
        assert not bench.arbiter.awaits_commander

    def test_a_standard_commander_has_no_message_for_an_answer(self) -> None:
        bench = Bench(standard={A}).in_transfer()
        assert bench.arbiter.view.partner == B
        assert not bench.arbiter.awaits_commander


class TestHowWellStationsHear:
    """A station that is heard and answers a part of its questions may count otherwise after the next one."""

    def test_stations_that_answer_everything_do_not_waver_and_are_settled_after_a_while(self) -> None:
        bench = Bench().on_mission()
        bench.run(20.0)
        assert not bench.arbiter.wavers(bench.now)
        assert bench.arbiter.settled(bench.now)

    def test_one_that_begins_to_miss_questions_wavers(self) -> None:
        bench = Bench().on_mission()
        bench.run(20.0)
        bench.deaf = {B}
        bench.run(4.0)
        assert bench.arbiter.wavers(bench.now)
        assert not bench.arbiter.settled(bench.now)

    def test_one_that_is_not_heard_plays_no_part(self) -> None:
        bench = Bench().on_mission()
        bench.run(20.0)
        bench.deaf = {B}
        bench.run(4.0)
        bench.alive = {A}
        bench.run(6.0)
        assert not bench.arbiter.wavers(bench.now)
        assert bench.arbiter.settled(bench.now)


class TestRestored:
    @pytest.mark.parametrize(("phase", "rehearses"), [(Phase.ON_MISSION, True), (Phase.ON_LOAD, False)])
    def test_a_rehearsal_goes_on_after_a_restart_unless_it_had_ended(self, phase: Phase, rehearses: bool) -> None:
        bench = Bench()
        bench.restart(0.0, replace(LEFT, phase=phase, rehearsal=True))
        assert bench.arbiter.view.rehearsal is rehearses


def test_zones_of_the_first_position_were_not_entered_in_this_flight() -> None:
    """A pilot takes off before there is a position: an overlap that the aircraft stood in calls for no handover."""
    bench = Bench()
    bench.facts = None
    bench.on_ground().autopilot_says(armed=True, flying=True)
    assert bench.arbiter.view.phase is Phase.ON_MISSION
    bench.position(inside(A), inside(B))
    bench.run(10.0)
    assert (bench.arbiter.view.commander, bench.arbiter.view.handover_id) == (A, 0)
