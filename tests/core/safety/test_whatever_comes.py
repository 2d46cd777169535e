# SPDX-License-Identifier: GPL-3.0-or-later

"""What holds of decisions whatever comes, of the whole arbiter over time: noise changes none, the loss of every station
never leaves the aircraft to itself, nothing mild ends what is grave, and the place is the best that there is.

The aircraft of these tests does what it is commanded, at once.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mavproxy_handover.core.common.causes import CAUSES, Cause
from mavproxy_handover.core.common.events import (
    Action,
    Announce,
    ConditionsSeen,
    Fly,
    GuardSeen,
    LinkJudged,
    ModeSeen,
    ModeSourceSeen,
    MotionSeen,
    OrderRefused,
    PlaceJudged,
)
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.messages import TransferKey
from mavproxy_handover.core.common.model import (
    Consent,
    FlightAction,
    GapFact,
    GuardState,
    ModeClass,
    ModeSource,
    Reason,
    ZoneFact,
)
from mavproxy_handover.core.safety.return_site import Choice, PlaceFact, ReturnSiteChooser
from tests.core.bench import A, B, Bench, C, OkHandover, OnHandover, far, inside, outside
from tests.core.safety.ledger import EXPECTED
from tests.depth import first

AUTO, RTL, LAND = (
    ModeSeen(ModeClass.MISSION, "AUTO"),
    ModeSeen(ModeClass.RETURN, "RTL"),
    ModeSeen(ModeClass.LAND, "LAND", True),
)
TICK_S = 0.5


class Obedient(Bench):
    """A bench whose aircraft does what it is commanded."""

    speed_mps = 8.0

    def give(self, event: object) -> list[Action]:
        actions = super().give(event)  # type: ignore[arg-type]
        for action in actions:
            if isinstance(action, Fly):
                self.obey(action.action)
        return actions

    def obey(self, action: FlightAction) -> None:
        if action is FlightAction.RETURN:
            self.mode = RTL
        elif action is FlightAction.LAND:
            self.mode = LAND
        self.speed_mps = 0.0 if action is FlightAction.HOLD else 8.0

    def moves(self) -> None:
        """As it flies now: nearer to its place all the time, or down."""
        coming_down = self.mode is LAND
        left_m = 1e6 - 8.0 * self.now
        self.motion = MotionSeen(0.0 if coming_down else self.speed_mps, -1.0 if coming_down else 0.0, left_m)

    def brought_down(self) -> bool:
        """It is on its way home, or landing."""
        return self.mode in (RTL, LAND)

    def decided(self) -> list[FlightAction | None]:
        """Every decision that was told, None for the end of one; what is only said again is none."""
        found = [action for _at, action in self.log if isinstance(action, Announce)]
        return [action.action for action in found if not action.text.startswith("PILOT")]


def aloft(limits: Limits | None = None, *alive: int) -> Obedient:
    """On its mission under GCSA, in its zone."""
    bench = Obedient(limits)
    bench.alive = {A, *alive}
    bench.mode = AUTO
    bench.moves()
    bench.on_mission()
    bench.log.clear()
    return bench


# ---- noise ----------------------------------------------------------------------------------------------------------

#: what is held is held for the whole test
PATIENT = Limits(hold_s=3600.0)


@dataclass(frozen=True)
class Truth:
    """What is so all the time, seen through noise: `noise` puts the next look of it on the bench. `most`: so many
    decisions are right, the end of one counted."""

    noise: Callable[[Obedient, random.Random], None]
    most: int
    limits: Limits = PATIENT
    alive: tuple[int, ...] = (B,)


def _margin(bench: Obedient, chance: random.Random, about_m: float) -> None:
    """A GNSS that is 4 m out, at the border of the commander's zone, with nobody else's beyond."""
    bench.facts = (replace(outside(A), margin_m=about_m + chance.uniform(-4.0, 4.0)), *far(B, C))


def _ahead(bench: Obedient, chance: random.Random) -> None:
    """Speed and track that tremble, where the border is as far ahead as it takes to stop."""
    left_s = chance.uniform(4.0, 6.0) if bench.speed_mps > 0.0 else None
    bench.facts = (ZoneFact(A, 40.0, left_s, left_s, frozenset()), *far(B, C))


def _beyond(bench: Obedient, chance: random.Random) -> None:
    """The same, and whether a station behind the border could take the aircraft changes with every look."""
    left_s = chance.uniform(4.0, 6.0) if bench.speed_mps > 0.0 else None
    bench.facts = (ZoneFact(A, 40.0, left_s, left_s, frozenset({A, B})), *far(B, C))
    bench.digests[B] = bench.digests[A] if chance.random() < 0.5 else b""


def _energy(bench: Obedient, chance: random.Random) -> None:
    """What is left is what the best place needs, to a watt-hour."""
    bench.give(ConditionsSeen(energy=chance.gauss(0.0, 1.0) < 0.0))


def _links(bench: Obedient, chance: random.Random) -> None:
    """Links at their limit: weak in four looks of five."""
    bench.give(LinkJudged(A, weak=chance.random() < 0.8, attacked=False, text="loss"))


def _attack(bench: Obedient, chance: random.Random) -> None:
    """Bad signatures at the limit."""
    bench.give(LinkJudged(A, weak=False, attacked=chance.random() < 0.5, text="bad signatures"))


def _heartbeats(bench: Obedient, chance: random.Random) -> None:
    """Every sixth heartbeat is lost, of stations, autopilot, guard and position alike."""
    bench.alive = {station for station in (A, B) if chance.random() < 0.83}
    bench.autopilot = chance.random() < 0.83
    bench.guard = GuardSeen(GuardState.LIVE, ours=True) if chance.random() < 0.83 else None
    bench.facts = (inside(A), *far(B, C)) if chance.random() < 0.83 else None


def _off_station(bench: Obedient, chance: random.Random) -> None:
    """In a zone whose station is there, and is asked, and does not answer."""
    bench.facts = (outside(A), inside(B, margin_m=60.0 + chance.uniform(-4.0, 4.0)), outside(C))


def _radio(bench: Obedient, chance: random.Random) -> None:
    """A receiver at the end of its range, with nobody at the sticks."""
    assert bench.mode is not None
    bench.mode = replace(bench.mode, radio=chance.random() < 0.5)


TRUTHS = {
    # over the border it is to stop; outside of the zone it is to come home, first since nobody stops there, then since
    # it is out of coverage
    "at the border": Truth(lambda bench, chance: _margin(bench, chance, 0.0), 1),
    "where a zone is left": Truth(lambda bench, chance: _margin(bench, chance, -5.0), 3),
    "where a zone is entered": Truth(lambda bench, chance: _margin(bench, chance, 5.0), 0),
    "as far from the border as a stop takes": Truth(_ahead, 1),
    "a station behind the border": Truth(_beyond, 1),
    "no more energy than is needed": Truth(_energy, 1),
    # ten seconds without a break are no noise; they clear it
    "links at their limit": Truth(_links, 1),
    "bad signatures at their limit": Truth(_attack, 1),
    "every sixth heartbeat is lost": Truth(_heartbeats, 0),
    "a station that does not answer": Truth(_off_station, 1),
    "a radio that comes and goes": Truth(_radio, 0),
}


@pytest.mark.slow
@pytest.mark.parametrize("seed", first(1, range(2)))
@pytest.mark.parametrize("name", TRUTHS)
def test_noise_about_what_is_so_changes_no_decision(name: str, seed: int) -> None:
    """Four minutes of looks at the same truth, of which about half say one thing and half the other."""
    truth, chance = TRUTHS[name], random.Random(f"{name} {seed}")
    bench = aloft(truth.limits, *truth.alive)
    for _ in range(480):
        bench.moves()
        truth.noise(bench, chance)
        bench.run(TICK_S)
    assert len(bench.decided()) <= truth.most, bench.decided()
    # each but a warning is commanded, and once
    assert len(bench.flights()) <= truth.most


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_noise_on_everything_at_once_leads_to_one_return(seed: int) -> None:
    """All of it, with the energy that is just enough among it: that one is never more than it was."""
    chance = random.Random(f"all {seed}")
    bench = aloft(Limits(), B)
    noises = [_energy, _links, _heartbeats, _radio]
    for _ in range(480):
        bench.moves()
        for noise in noises:
            noise(bench, chance)
        bench.run(TICK_S)
    commanded = [fly.action for fly in bench.flights()]
    assert commanded == [FlightAction.RETURN], commanded


# ---- the place, through to the command ------------------------------------------------------------------------------


class Placed(Obedient):
    """The same with places: chosen each second as the edge does it, and once more when a return is ordered."""

    def __init__(self, limits: Limits | None = None) -> None:
        super().__init__(limits)
        self.chooser = ReturnSiteChooser()
        self.places: tuple[PlaceFact, ...] = ()
        self.choice: Choice | None = None
        self.chosen_for: list[tuple[FlightAction, Choice, frozenset[int]]] = []
        self._judged: PlaceJudged | None = None

    def choose(self) -> None:
        returning = self.mode is RTL
        self.choice = self.chooser.choose(
            self.places, self.arbiter.usable(self.now), self.now, returning=returning, fixed=returning
        )
        assert self.choice is not None
        judged = PlaceJudged(self.choice.place.name, self.choice.reachable)
        if judged != self._judged:
            self._judged = judged
            self.give(judged)

    def obey(self, action: FlightAction) -> None:
        if action is FlightAction.RETURN:
            self.choose()
        assert self.choice is not None
        self.chosen_for.append((action, self.choice, self.arbiter.usable(self.now)))
        super().obey(action)

    def pass_time(self, seconds: int) -> None:
        for _ in range(seconds):
            self.choose()
            self.moves()
            self.run(1.0)


STATION_SETS = st.frozensets(st.sampled_from((A, B, C)), max_size=3)
ENERGIES = st.sampled_from(((9.0, 20.0), (-3.0, 8.0), (-20.0, -9.0), (None, None)))


@st.composite
def a_place(draw: st.DrawFn, name: str) -> PlaceFact:
    margin, spare = draw(ENERGIES)
    inside_it = draw(st.booleans())
    there = draw(STATION_SETS)
    way = draw(st.frozensets(STATION_SETS, min_size=1, max_size=3)) | {there}
    return PlaceFact(
        name,
        draw(st.sampled_from((200.0, 900.0))),
        draw(st.sampled_from((40.0, 45.0, 120.0))),
        margin,
        spare,
        None,
        None,
        inside_it,
        inside_it and draw(st.booleans()),
        there,
        way,
    )


PLACES = st.tuples(a_place("home"), a_place("rally 1"), a_place("rally 2"))


def good(place: PlaceFact, usable: Iterable[int]) -> bool:
    """In reach with the reserve, inside the fence and covered all the way. Written out: no call of the rule."""
    stations = set(usable)
    energy = place.margin_wh is None or place.margin_wh > 0.0
    return energy and place.inside and place.way_inside and all(part & stations for part in {place.there, *place.way})


def in_reach(place: PlaceFact) -> bool:
    return place.inside and (place.margin_wh is None or (place.spare_wh is not None and place.spare_wh >= 0.0))


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(before=PLACES, after=PLACES, alive=st.frozensets(st.sampled_from((B, C))), dies_s=st.sampled_from((0, 40)))
def test_a_good_place_is_never_passed_over_from_the_facts_to_the_command(
    before: tuple[PlaceFact, ...], after: tuple[PlaceFact, ...], alive: frozenset[int], dies_s: int
) -> None:
    """The places become others, half a minute later the commander is lost; `alive` are the stations that are left, or
    that have died some time before."""
    bench = Placed()
    bench.alive = {A, B, C} if dies_s else {A, *alive}
    bench.places, bench.mode = before, AUTO
    bench.choose()
    bench.on_mission()
    bench.log.clear()
    bench.pass_time(3)
    bench.places = after
    bench.alive = {A, *alive}
    bench.pass_time(30 + dies_s)
    assert bench.flights() == []
    bench.alive = set(alive)
    bench.pass_time(8)
    (first, choice, usable), *_more = bench.chosen_for
    assert usable == alive
    if any(good(place, usable) for place in after):
        assert first is FlightAction.RETURN
        assert good(choice.place, usable), choice
    elif any(in_reach(place) for place in after):
        assert first is FlightAction.RETURN
        assert in_reach(choice.place), choice
    else:
        assert first is FlightAction.LAND


# ---- never nothing --------------------------------------------------------------------------------------------------

MILD = (
    ConditionsSeen(off_route=True),
    ConditionsSeen(fence=True),
    ConditionsSeen(),
    LinkJudged(A, weak=True, attacked=False, text="loss"),
    LinkJudged(A, weak=False, attacked=True, text="bad signatures"),
    LinkJudged(A, weak=False, attacked=False, text=""),
    PlaceJudged("home", True),
    PlaceJudged("home", False),
    ModeSourceSeen(ModeSource.COMMANDER, ModeClass.MISSION),
    OrderRefused(FlightAction.HOLD),
    OrderRefused(FlightAction.RETURN),
    OrderRefused(FlightAction.LAND),
)
#: where the aircraft may be, besides far outside of everything
WHERE: tuple[tuple[ZoneFact, ...], ...] = (
    (inside(A), outside(B), outside(C)),
    (inside(A), inside(B), outside(C)),
    (ZoneFact(A, 40.0, 3.0, 3.0, frozenset({A, B})), outside(B), outside(C)),
    (ZoneFact(A, 40.0, 3.0, 3.0, frozenset()), outside(B), outside(C)),
    (outside(A), inside(B), outside(C)),
    (outside(A), inside(B), inside(C)),
    far(A, B, C),
)
WORDS = (None, "ready", "asks", "consent")


def speak(bench: Obedient, word: str | None) -> None:
    """A word of the transfer under way, if there is one."""
    view = bench.arbiter.view
    if word is None or view.partner is None:
        return
    key = TransferKey(A, view.partner, view.handover_id, view.epoch)
    if word == "consent":
        bench.say(A, OkHandover(key))
    else:
        bench.say(view.partner, OnHandover(key, Consent.GRANTED if word == "ready" else Consent.WAITING))


MOMENTS = st.lists(
    st.tuples(
        st.sampled_from(MILD), st.sampled_from(WHERE), st.sampled_from(WORDS), st.sampled_from((0.5, 1.5, 4.0, 12.0))
    ),
    max_size=6,
)


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(moments=MOMENTS, last=st.sampled_from(WHERE), gap=st.booleans())
def test_when_every_station_is_lost_outside_a_gap_it_comes_home_or_down(
    moments: list[
        tuple[ConditionsSeen | LinkJudged | PlaceJudged | ModeSourceSeen, tuple[ZoneFact, ...], str | None, float]
    ],
    last: tuple[ZoneFact, ...],
    gap: bool,
) -> None:
    """Whatever happened before. With `gap`, the mission declares one there, and its time runs out."""
    bench = aloft(None, B, C)
    for event, where, word, seconds in moments:
        bench.moves()
        bench.position(*where)
        speak(bench, word)
        bench.give(event)
        bench.run(seconds)
    bench.facts = last
    bench.gap = GapFact(20.0, "GCSA -> GCSB") if gap else None
    bench.alive = set()
    # silence, a forced transfer, a landing where a return does not show
    for _ in range(80 if gap else 36):
        bench.moves()
        bench.run(TICK_S)
    assert bench.brought_down(), bench.decided()


# ---- grave and mild -------------------------------------------------------------------------------------------------


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(
    grave=st.sampled_from(("commander lost", "energy", "guard lost, land")),
    moments=st.lists(
        st.tuples(st.sampled_from(MILD[:-1]), st.sampled_from(WHERE), st.sampled_from((0.5, 3.0, 20.0))), max_size=8
    ),
)
def test_nothing_mild_ends_what_is_grave(
    grave: str, moments: list[tuple[ConditionsSeen | LinkJudged | PlaceJudged, tuple[ZoneFact, ...], float]]
) -> None:
    """While its cause lasts a return is followed by nothing but a landing, and a landing by nothing."""
    bench = aloft(Limits(policies={Cause.GUARD_LOST: "land"}) if grave.startswith("guard") else None)
    if grave == "commander lost":
        bench.alive = set()
    elif grave == "energy":
        bench.give(ConditionsSeen(energy=True))
    else:
        bench.guard = None
    for _ in range(14):
        bench.moves()
        bench.run(TICK_S)
    assert bench.brought_down()
    already = len(bench.flights())
    for event, where, seconds in moments:
        bench.moves()
        bench.facts = where
        bench.give(replace(event, energy=grave == "energy") if isinstance(event, ConditionsSeen) else event)
        for _ in range(round(seconds / TICK_S)):
            bench.moves()
            bench.run(TICK_S)
    commanded = [fly.action for fly in bench.flights()]
    assert all(action >= commanded[already - 1] for action in commanded[already:]), commanded
    assert commanded == sorted(commanded)
    assert bench.brought_down()


def test_every_cause_with_a_policy_to_return_is_among_those_that_noise_or_loss_is_tried_on() -> None:
    """The ledger says which of these makes the noise of a cause."""
    made_by = {word: row.noise for word, row in EXPECTED.items()}
    assert set(made_by) == {cause.value for cause in CAUSES}
    assert [name for name in made_by.values() if name and not callable(globals().get(name))] == []
    assert Reason.NONE not in {row.reason for row in CAUSES.values()}
