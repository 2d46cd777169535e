# SPDX-License-Identifier: GPL-3.0-or-later

"""What was measured on a station's links: quality below its limits moves authority on while a better station is there;
an attack is told and changes nothing."""

from __future__ import annotations

from dataclasses import replace

from mavproxy_handover.core.common.events import LinkJudged
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import Phase, Reason
from tests.core.bench import A, B, Bench, inside, outside

WEAK = "loss 40%, limit 25%"


def settled() -> Bench:
    """GCSB has just taken over inside both zones, and the dwell time is over: no zone calls."""
    bench = Bench().commit()
    bench.run(8.0)
    assert (bench.arbiter.view.commander, bench.arbiter.view.partner) == (B, None)
    return bench


def judged(bench: Bench, station: int, *, weak: bool = False, attacked: bool = False) -> None:
    bench.give(LinkJudged(station, weak, attacked, WEAK))


def test_weak_links_of_the_commander_call_a_station_with_good_ones() -> None:
    bench = settled()
    judged(bench, B, weak=True)
    bench.run(2.5)
    assert bench.arbiter.view.phase is Phase.ON_MISSION
    bench.run(1.0)
    assert (bench.arbiter.view.phase, bench.arbiter.view.partner) == (Phase.ON_HANDOVER, A)
    begun = bench.records("transfer_begun")[-1]
    assert begun.reason is Reason.LINK_QUALITY
    assert bench.records("link_quality")[-1].text == f"links of GCSB are weak: {WEAK}"


def test_without_a_time_to_wait_it_is_called_at_once() -> None:
    bench = Bench(replace(Limits(), link_weak_s=0.0, link_steady_s=0.0)).commit()
    bench.run(8.0)
    judged(bench, B, weak=True)
    assert (bench.arbiter.view.phase, bench.arbiter.view.partner) == (Phase.ON_HANDOVER, A)


def test_nobody_is_called_whose_links_are_weak_too() -> None:
    bench = settled()
    judged(bench, A, weak=True)
    judged(bench, B, weak=True)
    bench.run(10.0)
    assert bench.arbiter.view.partner is None
    assert len(bench.records("link_quality")) == 2


def test_a_station_that_was_weak_just_now_is_not_called() -> None:
    bench = settled()
    judged(bench, A, weak=True)
    judged(bench, A)
    judged(bench, B, weak=True)
    bench.run(29.5)
    assert bench.arbiter.view.partner is None
    bench.run(1.0)
    assert bench.arbiter.view.partner == A


def test_outside_every_other_zone_a_weak_commander_stays() -> None:
    bench = Bench().on_mission()
    bench.position(inside(A), outside(B))
    judged(bench, A, weak=True)
    bench.run(10.0)
    assert (bench.arbiter.view.commander, bench.arbiter.view.partner) == (A, None)


def test_the_same_measurement_is_told_once() -> None:
    bench = settled()
    for _ in range(3):
        judged(bench, A, weak=True)
    judged(bench, A)
    assert [record.text.split(":")[0] for record in bench.records("link_quality")] == [
        "links of GCSA are weak",
        "links of GCSA are good again",
    ]


def test_an_attack_is_told_and_changes_nothing() -> None:
    bench = settled()
    view = bench.arbiter.view
    judged(bench, view.commander or 0, attacked=True)
    assert bench.arbiter.view == view
    assert bench.records("attack")[-1].reason is Reason.AUTHENTICATION


def test_the_zone_of_a_station_with_weak_links_does_not_call_while_the_commanders_are_good() -> None:
    """It would be called back for its links a moment later, and so on (campaign, seed 1101778)."""
    bench = Bench().on_mission()
    bench.position(inside(A), outside(B))
    judged(bench, B, weak=True)
    bench.position(inside(A), inside(B))
    bench.run(10.0)
    assert (bench.arbiter.view.commander, bench.arbiter.view.partner) == (A, None)
    judged(bench, B)
    bench.position(inside(A), inside(B))
    assert bench.arbiter.view.partner == B, "now it does: the zone was entered, and nothing has moved since"
    assert bench.records("transfer_begun")[-1].reason is Reason.ZONE


def test_where_both_are_weak_the_zone_calls_as_ever() -> None:
    bench = Bench().on_mission()
    bench.position(inside(A), outside(B))
    judged(bench, A, weak=True)
    judged(bench, B, weak=True)
    bench.position(inside(A), inside(B))
    assert bench.arbiter.view.partner == B


def test_weak_links_are_better_than_the_end_of_a_zone() -> None:
    bench = Bench().on_mission()
    judged(bench, B, weak=True)
    bench.position(inside(A, exit_s=6.0), inside(B))
    assert bench.arbiter.view.partner == B
    assert bench.records("transfer_begun")[-1].reason is Reason.ZONE_ENDS
