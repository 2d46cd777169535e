# SPDX-License-Identifier: GPL-3.0-or-later

"""Which place a return goes to, and that the choice stays where it is until something has changed."""

from __future__ import annotations

import itertools
import random
import re
from collections.abc import Iterable
from dataclasses import replace
from math import inf

import pytest

from mavproxy_handover.core.safety.return_site import (
    Choice,
    Coverage,
    PlaceFact,
    Reach,
    ReturnSiteChooser,
    Standing,
    best,
    standing,
)
from tests.depth import first

A, B, C = 251, 252, 253
ALL = frozenset({A, B})
NAMES = {A: "GCSA", B: "GCSB", C: "GCSC"}


def sets(*stations: Iterable[int]) -> frozenset[frozenset[int]]:
    return frozenset(frozenset(part) for part in stations)


HOME = PlaceFact("home", 600.0, 100.0, 20.0, 50.0, 0.2, 0.6, True, True, frozenset({A}), sets({A, B}, {A}))
NEAR = PlaceFact("rally 1", 200.0, 60.0, 30.0, 60.0, 0.1, 0.6, True, True, frozenset({B}), sets({B}))
FAR = PlaceFact("rally 2", 900.0, 140.0, 10.0, 40.0, 0.3, 0.6, True, True, frozenset({A}), sets({A}))


def chosen(*places: PlaceFact, usable: Iterable[int] = ALL) -> str:
    found = best(places, frozenset(usable))
    assert found is not None
    return found.name


# ---- the facts of one moment --------------------------------------------------------------------------------------


def test_of_places_that_are_alike_the_soonest_is_the_best() -> None:
    assert chosen(HOME, NEAR, FAR) == "rally 1"


def test_the_nearest_that_nobody_covers_is_passed_over() -> None:
    assert chosen(HOME, NEAR, FAR, usable={A}) == "home"


def test_a_way_that_nobody_covers_counts_as_much_as_a_place() -> None:
    gap = replace(NEAR, way=sets({B}, ()))
    assert chosen(HOME, gap) == "home"
    other = replace(NEAR, way=sets({B}, {C}))
    assert chosen(HOME, other) == "home"
    assert chosen(HOME, other, usable={A, B, C}) == "rally 1"


def test_who_is_out_of_coverage_goes_where_it_is_covered_again() -> None:
    """The fault: a station was dead, and the way out of its zone counted as much as to come down in it."""
    assert chosen(replace(HOME, way=sets({B}, {A, B}, {A})), NEAR, usable={A}) == "home"


def test_coverage_may_pass_from_one_station_to_another_on_the_way() -> None:
    assert standing(replace(HOME, way=sets({B}, {A, B}, {A})), ALL).coverage is Coverage.ALL


@pytest.mark.parametrize(
    ("changes", "reach"),
    [
        ({"margin_wh": 0.1}, Reach.YES),
        ({"margin_wh": 0.0}, Reach.RESERVE),
        ({"margin_wh": -5.0, "spare_wh": 0.0}, Reach.RESERVE),
        ({"margin_wh": -5.0, "spare_wh": -0.1}, Reach.NO),
        ({"margin_wh": -5.0, "spare_wh": None}, Reach.NO),
        ({"margin_wh": None, "spare_wh": None}, Reach.YES),
        ({"margin_wh": None, "spare_wh": None, "time_s": inf}, Reach.NO),
        ({"margin_wh": 5.0, "time_s": inf}, Reach.NO),
    ],
)
def test_reach(changes: dict[str, float | None], reach: Reach) -> None:
    assert replace(HOME, **changes).reach is reach  # type: ignore[arg-type]


def test_where_nobody_covers_anything_the_soonest_that_can_be_reached_is_left() -> None:
    assert chosen(replace(HOME, spare_wh=-1.0, margin_wh=-9.0), FAR, usable=()) == "rally 2"


def test_a_place_outside_the_fence_is_behind_everything_for_the_autopilot_does_not_fly_there() -> None:
    unreachable = replace(HOME, margin_wh=-9.0, spare_wh=-1.0)
    assert chosen(replace(NEAR, inside=False), unreachable) == "home"


def test_a_way_through_the_fence_is_worse_than_no_coverage_and_better_than_no_energy() -> None:
    assert chosen(replace(NEAR, way_inside=False), replace(HOME, there=frozenset())) == "home"
    assert chosen(replace(NEAR, way_inside=False), replace(HOME, margin_wh=-1.0)) == "rally 1"
    assert chosen(replace(NEAR, way_clear=False), replace(HOME, there=frozenset())) == "home"
    assert chosen(replace(NEAR, way_clear=False), replace(HOME, margin_wh=-1.0)) == "rally 1"


def test_without_places_there_is_no_choice() -> None:
    assert best((), ALL) is None
    assert ReturnSiteChooser().choose((), ALL, 0.0) is None


def every_place(name: str) -> list[PlaceFact]:
    """A place in every standing that there is, and at two distances."""
    energies = ((5.0, 9.0), (-1.0, 3.0), (-9.0, -5.0), (None, None))
    covers = ((frozenset({A}), sets({A})), (frozenset({C}), sets({C})), (frozenset({A}), sets({A}, {C})))
    return [
        PlaceFact(name, 10.0 * time_s, time_s, margin, spare, None, None, inside, way_inside, there, way)
        for inside, way_inside in ((True, True), (True, False), (False, False))
        for margin, spare in energies
        for there, way in covers
        for time_s in (30.0, 90.0)
    ]


def test_what_is_reachable_fenced_and_covered_is_never_passed_over_for_what_is_not() -> None:
    good = {
        place
        for place in (*every_place("home"), *every_place("rally 1"))
        if place.inside
        and place.way_inside
        and (place.margin_wh is None or place.margin_wh > 0)
        and place.way == sets({A})
    }
    assert len(good) == 8
    pairs = 0
    for one, other in itertools.product(every_place("home"), every_place("rally 1")):
        found = best((one, other), frozenset({A, B}))
        if one in good or other in good:
            pairs += 1
            assert found in good, (one, other)
    assert pairs == 2 * 4 * 72 - 4 * 4


# ---- words --------------------------------------------------------------------------------------------------------


def words(place: PlaceFact, usable: Iterable[int] = ALL) -> str:
    choice = ReturnSiteChooser().choose((place,), frozenset(usable), 0.0)
    assert choice is not None
    return choice.words(NAMES.__getitem__)


@pytest.mark.parametrize(
    ("place", "text"),
    [
        (
            replace(FAR, distance_m=1940.0, needs=0.21, left=0.38),
            "rally 2: 1.9 km away, needs 21 % of the battery (38 % left), covered by GCSA all the way",
        ),
        (replace(HOME, needs=None, left=None), "home: 600 m away, covered by GCSA all the way"),
        (
            replace(HOME, there=frozenset({C})),
            "home: 600 m away, needs 20 % of the battery (60 % left), covered by no station",
        ),
        (
            replace(HOME, way=sets({C})),
            "home: 600 m away, needs 20 % of the battery (60 % left), covered by GCSA at its end only",
        ),
        (
            replace(HOME, time_s=inf),
            "home: 600 m away, the wind does not let it be flown, OUT OF REACH, covered by GCSA all the way",
        ),
        (
            replace(HOME, margin_wh=-9.0, spare_wh=-1.0),
            "home: 600 m away, needs 20 % of the battery (60 % left), OUT OF REACH, covered by GCSA all the way",
        ),
        (
            replace(HOME, inside=False),
            "home: 600 m away, needs 20 % of the battery (60 % left), outside the fence, covered by GCSA all the way",
        ),
        (
            replace(HOME, way_inside=False),
            "home: 600 m away, needs 20 % of the battery (60 % left), the way leaves the fence, "
            "covered by GCSA all the way",
        ),
        (
            replace(HOME, way_clear=False),
            "home: 600 m away, needs 20 % of the battery (60 % left), the way is too near to the ground, "
            "covered by GCSA all the way",
        ),
    ],
)
def test_words(place: PlaceFact, text: str) -> None:
    assert words(place) == text


# ---- the choice over time -----------------------------------------------------------------------------------------


class Flight:
    """A chooser, asked each second."""

    def __init__(self, usable: Iterable[int] = ALL) -> None:
        self.chooser = ReturnSiteChooser()
        self.usable = frozenset(usable)
        self.now = 100.0
        self.names: list[str] = []

    def look(self, *places: PlaceFact, seconds: int = 1, returning: bool = False, fixed: bool = False) -> Choice:
        for _ in range(seconds):
            self.now += 1.0
            choice = self.chooser.choose(places, self.usable, self.now, returning=returning, fixed=fixed)
            assert choice is not None
            self.names.append(choice.place.name)
        return choice

    @property
    def changes(self) -> int:
        return sum(one != other for one, other in itertools.pairwise(self.names))


def test_a_station_that_falls_away_counts_at_once_and_has_to_stay_to_count_again() -> None:
    flight = Flight()
    assert flight.look(HOME, NEAR).place.name == "rally 1"
    flight.usable = frozenset({A})
    choice = flight.look(HOME, NEAR)
    assert (choice.place.name, choice.covered_by) == ("home", (A,))
    flight.usable = ALL
    assert flight.look(HOME, NEAR, seconds=20).place.name == "home"
    assert flight.look(HOME, NEAR, seconds=1).place.name == "rally 1"


def test_until_when_a_choice_stays_if_the_facts_do() -> None:
    chooser, places = ReturnSiteChooser(), [HOME, NEAR]
    chooser.choose(places, {A, B}, 0.0)
    assert chooser.stays_until(0.0) == inf
    chooser.choose(places, {A}, 1.0)
    assert chooser.stays_until(1.0) == inf  # who falls away counts at once
    assert chooser.usable == {A}
    chooser.choose(places, {A, B}, 2.0)
    assert chooser.stays_until(2.0) == 22.0
    chooser.choose(places, {A, B}, 21.9)
    assert chooser.usable == {A}
    chooser.choose(places, {A, B}, 22.0)
    assert chooser.stays_until(22.0) == inf
    assert chooser.usable == {A, B}
    worse = [HOME, replace(NEAR, margin_wh=-1.0)]
    for now, until in ((23.0, 23.0), (24.0, 24.0), (26.0, inf)):
        chooser.choose(worse, {A, B}, now)
        assert chooser.stays_until(now) == until


def test_of_two_stations_that_come_back_the_choice_stays_until_the_first_counts() -> None:
    chooser, places = ReturnSiteChooser(), [HOME, NEAR]
    for now, usable in ((0.0, {A, B}), (1.0, set()), (2.0, {A}), (5.0, {A, B})):
        chooser.choose(places, usable, now)
    assert chooser.stays_until(6.0) == 22.0
    assert chooser.stays_until(22.0) == 25.0


def test_a_station_that_comes_for_the_first_time_counts_at_once() -> None:
    flight = Flight({A})
    assert flight.look(HOME, NEAR).place.name == "home"
    flight.usable = ALL
    assert flight.look(HOME, NEAR).place.name == "rally 1"


@pytest.mark.parametrize(
    "worse",
    [
        {"margin_wh": -1.0},
        {"way_inside": False},
        {"way_clear": False},
        {"inside": False},
        {"way": sets({B}, ())},
        {"there": frozenset()},
    ],
)
def test_a_place_that_has_become_worse_is_left_and_needs_longer_to_come_back(worse: dict[str, object]) -> None:
    flight = Flight()
    bad = replace(NEAR, **worse)  # type: ignore[arg-type]
    assert flight.look(HOME, NEAR).place.name == "rally 1"
    assert flight.look(HOME, bad, seconds=2).place.name == "rally 1"
    assert flight.look(HOME, bad).place.name == "home"
    assert flight.look(HOME, NEAR, seconds=19).place.name == "home"
    assert flight.look(HOME, NEAR).place.name == "rally 1"


@pytest.mark.parametrize(
    "worse",
    [
        {"margin_wh": -6.0, "spare_wh": -1.0},
        {"way_inside": False},
        {"way_clear": False},
        {"inside": False},
    ],
)
def test_nothing_goes_over_to_a_place_for_what_it_was_a_moment_ago(worse: dict[str, object]) -> None:
    """Its home's station falls away in the second in which the other place gets as bad: a return would not arrive."""
    flight = Flight()
    other = replace(NEAR, time_s=150.0)
    assert flight.look(HOME, other).place.name == "home"
    flight.usable = frozenset({B})
    bad = replace(other, **worse)  # type: ignore[arg-type]
    names = {flight.look(HOME, bad).place.name for _ in range(10)}
    assert names == {"home"}


def test_one_odd_second_changes_nothing() -> None:
    flight = Flight()
    flight.look(HOME, NEAR, seconds=20)
    for _ in range(20):
        flight.look(HOME, replace(NEAR, way_inside=False, way=sets(()), margin_wh=-1.0))
        flight.look(HOME, NEAR, seconds=9)
    assert set(flight.names) == {"rally 1"}


def test_a_place_of_which_nothing_is_known_keeps_to_the_fence() -> None:
    assert standing(PlaceFact("home", 100.0, 10.0), ALL)[:3] == (True, Reach.YES, True)


@pytest.mark.parametrize("inside", [True, False])
@pytest.mark.parametrize("reach", Reach)
def test_a_return_gets_there_if_it_would_be_flown_to_and_the_energy_lasts(inside: bool, reach: Reach) -> None:
    counts = Standing(inside, reach, False, Coverage.NO)
    assert counts.reachable is (inside and reach in (Reach.RESERVE, Reach.YES))
    assert Choice(HOME, counts, ()).reachable is counts.reachable


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"distance_m": 999.4}, "999 m away, needs 20 % of the battery (60 % left), covered by GCSA all the way"),
        ({"distance_m": 1000.0}, "1.0 km away, needs 20 % of the battery (60 % left), covered by GCSA all the way"),
        ({"distance_m": 60_000.0}, "60.0 km away, needs 20 % of the battery (60 % left), covered by GCSA all the way"),
        ({"needs": None}, "600 m away, covered by GCSA all the way"),
        ({"left": None}, "600 m away, covered by GCSA all the way"),
    ],
)
def test_figures(changes: dict[str, float | None], text: str) -> None:
    place = replace(HOME, **changes)  # type: ignore[arg-type]
    choice = Choice(place, standing(place, ALL), (A,))
    assert choice.figures(NAMES.__getitem__) == text
    assert choice.figures(NAMES.__getitem__, brief=True) == re.sub(r" of the battery \(.* left\)", "", text)


def test_covered_is_what_counts_as_covered_and_has_somebody_who_covers_it() -> None:
    for coverage, stations in ((Coverage.NO, (A,)), (Coverage.ALL, ()), (Coverage.THERE, ())):
        choice = Choice(HOME, Standing(True, Reach.YES, True, coverage), stations)
        assert choice.figures(NAMES.__getitem__).endswith(", covered by no station")


def test_what_is_seen_twice_in_the_same_moment_has_not_lasted() -> None:
    flight = Flight()
    flight.look(HOME, NEAR)
    for _ in range(20):
        choice = flight.chooser.choose((HOME, replace(NEAR, way_inside=False)), ALL, flight.now)
        assert choice is not None
        assert choice.place.name == "rally 1"


def test_a_place_that_comes_in_the_same_moment_has_to_be_good_as_long_as_any() -> None:
    flight = Flight()
    flight.look(HOME)
    bad = replace(NEAR, way_inside=False)
    flight.chooser.choose((HOME, bad), ALL, flight.now)
    assert flight.look(HOME, NEAR, seconds=19).place.name == "home"
    assert flight.look(HOME, NEAR).place.name == "rally 1"


def test_a_place_that_was_gone_is_another_one_when_it_is_back() -> None:
    flight = Flight()
    flight.look(HOME, NEAR, seconds=20)
    flight.look(HOME)
    assert flight.look(HOME, replace(NEAR, way_inside=False)).place.name == "home"
    flight.look(HOME, replace(NEAR, way_inside=False), seconds=5)
    flight.look(HOME)
    assert flight.look(HOME, NEAR).place.name == "rally 1"


def test_without_places_the_choice_is_forgotten() -> None:
    flight = Flight()
    assert flight.look(HOME, NEAR).place.name == "rally 1"
    assert flight.chooser.choose((), ALL, flight.now) is None
    assert flight.look(replace(HOME, time_s=55.0), NEAR).place.name == "home"


def test_unless_it_is_said_nothing_returns_and_nothing_is_fixed() -> None:
    chooser = ReturnSiteChooser()
    for place, name in ((replace(NEAR, time_s=500.0), "home"), (NEAR, "rally 1")):
        choice = chooser.choose((HOME, place), ALL, 100.0)
        assert choice is not None
        assert choice.place.name == name


def test_near_its_end_is_nearer_than_a_hundred_metres_and_only_for_what_returns() -> None:
    for distance_m, returning, name in ((99.9, True, "home"), (100.0, True, "rally 1"), (50.0, False, "rally 1")):
        flight = Flight({A})
        flight.look(HOME, NEAR)
        flight.usable = frozenset({B})
        close = replace(HOME, distance_m=distance_m)
        assert flight.look(close, NEAR, returning=returning).place.name == name


def test_a_place_has_to_be_clearly_sooner() -> None:
    flight = Flight()
    other = replace(HOME, time_s=60.0)
    assert flight.look(replace(NEAR, time_s=60.0), replace(other, time_s=61.0)).place.name == "rally 1"
    assert flight.look(replace(NEAR, time_s=60.0), replace(other, time_s=44.0), seconds=30).place.name == "rally 1"
    assert flight.look(replace(NEAR, time_s=60.0), replace(other, time_s=43.0)).place.name == "rally 1"
    assert flight.look(replace(NEAR, time_s=60.0), replace(other, time_s=42.0)).place.name == "home"
    assert flight.look(replace(NEAR, time_s=42.0), replace(other, time_s=60.0)).place.name == "rally 1"


def test_what_returns_goes_over_only_to_a_place_that_stands_higher_and_not_near_the_end() -> None:
    flight = Flight()
    flight.look(HOME, replace(NEAR, time_s=500.0))
    assert flight.look(HOME, NEAR, returning=True, seconds=30).place.name == "home"
    flight.usable = frozenset({B})
    assert flight.look(replace(HOME, distance_m=99.0), NEAR, returning=True).place.name == "home"
    assert flight.look(HOME, NEAR, returning=True).place.name == "rally 1"


def test_what_is_fixed_stays_whatever_becomes_of_it() -> None:
    flight = Flight()
    flight.look(HOME, NEAR)
    flight.usable = frozenset({A})
    choice = flight.look(HOME, NEAR, seconds=30, fixed=True)
    assert (choice.place.name, choice.standing.coverage) == ("rally 1", Coverage.NO)


def test_a_place_that_is_gone_is_left_at_once_even_then() -> None:
    flight = Flight()
    flight.look(HOME, NEAR)
    assert flight.look(HOME, returning=True, fixed=True).place.name == "home"


def test_the_place_that_was_found_in_force_stays_like_one_that_was_chosen() -> None:
    flight = Flight()
    flight.chooser.restore("home")
    near = replace(NEAR, time_s=80.0)
    assert flight.look(HOME, near).place.name == "home"


def test_a_long_pause_decides_nothing() -> None:
    flight = Flight()
    flight.look(HOME, NEAR, seconds=20)
    flight.now += 3600.0
    assert flight.look(HOME, replace(NEAR, way_inside=False)).place.name == "rally 1"


NOISE = ("time", "energy", "fence", "coverage", "stations", "everything")


@pytest.mark.slow
@pytest.mark.parametrize("kind", NOISE)
@pytest.mark.parametrize("seed", first(1, range(8)))
def test_noise_on_every_input_makes_no_choice_flap(kind: str, seed: int) -> None:
    """An hour, and places that stand on the edge of everything: half of all looks say yes, half of them no."""
    chance = random.Random(f"{kind} {seed}")

    def noisy(place: PlaceFact) -> PlaceFact:
        changes: dict[str, object] = {}
        if kind in ("time", "everything"):
            changes["time_s"] = 90.0 * chance.uniform(0.9, 1.1)
        if kind in ("energy", "everything"):
            margin = chance.gauss(0.0, 2.0)
            changes |= {"margin_wh": margin, "spare_wh": 20.0 + margin}
        if kind in ("fence", "everything"):
            changes |= {"way_inside": chance.random() < 0.5, "inside": chance.random() < 0.5}
        if kind in ("coverage", "everything"):
            way = sets({A}) if chance.random() < 0.5 else sets({A}, ())
            changes |= {"way": way, "there": frozenset({A}) if chance.random() < 0.5 else frozenset()}
        return replace(place, **changes)  # type: ignore[arg-type]

    flight = Flight()
    for _ in range(3600):
        if kind in ("stations", "everything"):
            flight.usable = frozenset(station for station in (A, B) if chance.random() < 0.5)
        flight.look(*(noisy(replace(place, time_s=90.0)) for place in (HOME, NEAR, FAR)))
    # what is one way from the beginning may turn out to be the other; then it stays
    assert flight.changes <= 3, flight.names


def test_where_the_mission_is_about_to_return_the_soonest_of_equals_is_enough() -> None:
    """As it was reckoned before the flight; what stands lower is not gone over to for that, nor is a return sent on."""
    chooser, there = ReturnSiteChooser(), replace(NEAR, time_s=30.0)
    for sooner, name in ((29.0, "home"), (30.0, "rally 1"), (31.0, "rally 1")):
        chooser.restore("rally 1")
        here = replace(HOME, time_s=sooner)
        for second in range(40):
            choice = chooser.choose((here, there), frozenset(ALL), second, ends=second == 39)
            assert choice is not None
            assert choice.place.name == (name if second == 39 else "rally 1")
    chooser.restore("rally 1")
    lower = replace(HOME, time_s=5.0, there=frozenset())
    choice = chooser.choose((lower, there), frozenset(ALL), 100.0, ends=True)
    assert choice is not None
    assert choice.place.name == "rally 1"
