# SPDX-License-Identifier: GPL-3.0-or-later

"""Each decision as a sentence, word by word."""

from __future__ import annotations

from math import inf

import pytest

from mavproxy_handover.core.authority.coverage import Coverage
from mavproxy_handover.core.common.causes import CAUSES, Cause
from mavproxy_handover.core.common.events import Announce, ConditionsSeen, PlaceJudged
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import FlightAction, GuardState, Reason
from mavproxy_handover.core.safety.sentence import Figures, over, sentence
from mavproxy_handover.core.safety.strategy import Decision, Fact

WARN, HOLD, CONTINUE = FlightAction.WARN, FlightAction.HOLD, FlightAction.CONTINUE
RETURN, LAND = FlightAction.RETURN, FlightAction.LAND
RALLY = PlaceJudged("rally 2", True, "1.9 km away, needs 21 % of the battery (38 % left), covered by GCSA all the way")


def test_a_return_says_where_to_and_what_is_known_of_the_place() -> None:
    told = sentence(Decision(RETURN, Cause.COMMANDER_LOST), "GCSB silent for 5 s", RALLY)
    text = f"RETURN to rally 2. GCSB silent for 5 s. {RALLY.words}"
    assert told == Announce(text, RETURN, Reason.COMMANDER_LOST, "GCSB silent for 5 s", "rally 2")


def test_of_a_place_of_which_nothing_is_known_only_the_name_is_said() -> None:
    told = sentence(Decision(RETURN, Cause.ENERGY), "short by 3 Wh", PlaceJudged("home", True, ""))
    assert told == Announce("RETURN to home. Short by 3 Wh", RETURN, Reason.ENERGY, "short by 3 Wh", "home")


def test_a_return_without_a_place_names_none() -> None:
    told = sentence(Decision(RETURN, Cause.OUT_OF_COVERAGE), "out of coverage", None)
    assert told == Announce("RETURN. Out of coverage", RETURN, Reason.OUT_OF_COVERAGE, "out of coverage")


@pytest.mark.parametrize("action", [WARN, HOLD, CONTINUE, LAND])
def test_what_is_no_return_goes_to_no_place(action: FlightAction) -> None:
    told = sentence(Decision(action, Cause.COVERAGE_ENDS), "coverage ends ahead", RALLY)
    word = "WARNING" if action is WARN else action.name
    assert told == Announce(f"{word}. Coverage ends ahead", action, Reason.COVERAGE_ENDS, "coverage ends ahead")


@pytest.mark.parametrize(
    ("fact", "words"),
    [
        (Fact.FLYING, "The aircraft is on the ground"),
        (Fact.AUTOPILOT, "The autopilot is not heard"),
        (Fact.PILOT, "A pilot has the aircraft"),
        (Fact.FAILSAFE, "A failsafe of the autopilot acts"),
        (Fact.RETURNING, "The aircraft returns already"),
        (Fact.LANDING, "The aircraft lands already"),
    ],
)
def test_a_warning_says_why_no_more_is_done(fact: Fact, words: str) -> None:
    told = sentence(Decision(WARN, Cause.GUARD_LOST, withheld=fact), "guard silent for 4 s", RALLY)
    assert told == Announce(f"WARNING. Guard silent for 4 s. {words}", WARN, Reason.GUARD_LOST, "guard silent for 4 s")


def test_the_end_of_it_says_what_is_over() -> None:
    assert over(Decision(RETURN, Cause.ENERGY)) == Announce(
        "ALL CLEAR. Over: energy only for the way back", None, Reason.ENERGY
    )
    assert over(None) == Announce("ALL CLEAR. Over: the emergency before the restart", None, Reason.NONE)


# ---- figures --------------------------------------------------------------------------------------------------------


class Known:
    """What the rules know, as far as the figures ask for it."""

    def __init__(self) -> None:
        self.owner: int | None = 251
        self.deaf = ""
        self.silent = self.ends = self.position = self.autopilot = self.guard_silent = inf
        self.guard_state = GuardState.LIVE
        self.near: tuple[int, float] | None = None
        self.holding: tuple[int, ...] = ()
        self.zones = self

    def name(self, station: int | None) -> str:
        return {251: "GCSA", 252: "GCSB", None: "nobody"}[station]

    def silent_s(self, station: int, _now: float) -> float:
        assert station == self.owner
        return self.silent

    def deaf_words(self, station: int, _now: float) -> str:
        assert station == self.owner
        return self.deaf

    def nearest(self) -> tuple[int, float] | None:
        return self.near

    def inside(self) -> tuple[int, ...]:
        return self.holding

    def ends_s(self, station: int) -> float:
        assert station == self.owner
        return self.ends

    def guard(self, _now: float) -> GuardState:
        return self.guard_state

    def guard_silent_s(self, _now: float) -> float:
        return self.guard_silent

    def position_silent_s(self, _now: float) -> float:
        return self.position

    def autopilot_silent_s(self, _now: float) -> float:
        return self.autopilot


def figures_of(rules: Known) -> Figures:
    """The figures of a vehicle of which this is known."""
    coverage = Coverage(rules, rules, rules, Limits())  # type: ignore[arg-type]
    return Figures(coverage, rules)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("cause", "known", "words"),
    [
        (Cause.COMMANDER_LOST, {"silent": 5.2}, "GCSA silent for 5 s"),
        (Cause.COMMANDER_LOST, {"silent": 0.4, "deaf": "hears nothing for 10 s"}, "GCSA hears nothing for 10 s"),
        (Cause.COMMANDER_LOST, {}, "commander lost"),
        (Cause.COMMANDER_LOST, {"owner": None}, "commander lost"),
        (Cause.OUT_OF_COVERAGE, {"near": (252, -41.6)}, "out of coverage, 42 m outside the zone of GCSB"),
        (Cause.OUT_OF_COVERAGE, {}, "out of coverage"),
        (Cause.NO_STATION, {"holding": (252, 251)}, "no station whose zone holds the aircraft can take it: GCSB, GCSA"),
        (Cause.NO_STATION, {}, "no station here could take the aircraft"),
        (Cause.COVERAGE_ENDS, {"ends": 4.6}, "the zone of GCSA ends in 5 s, and no station is ready beyond it"),
        (Cause.COVERAGE_ENDS, {}, "coverage ends ahead"),
        (Cause.COVERAGE_ENDS, {"owner": None}, "coverage ends ahead"),
        (Cause.AUTHENTICATION, {}, "a sender without the key of GCSA speaks in its name"),
        (Cause.LINKS_WEAK, {}, "the links of GCSA are weak, and no station has better ones"),
        (Cause.GUARD_LOST, {"guard_state": GuardState.DISABLED, "guard_silent": 1.0}, "guard switched off"),
        (Cause.GUARD_LOST, {"guard_state": GuardState.SILENT, "guard_silent": 4.4}, "guard silent for 4 s"),
        (Cause.GUARD_LOST, {"guard_state": GuardState.SILENT}, "guard lost"),
        (Cause.POSITION_STALE, {"position": 3.3}, "no fresh position for 3 s"),
        (Cause.POSITION_STALE, {}, "no fresh position"),
        (Cause.AUTOPILOT_LOST, {"autopilot": 3.3}, "autopilot silent for 3 s"),
        (Cause.AUTOPILOT_LOST, {}, "autopilot not heard"),
        (Cause.ENERGY, {}, "short by 3 Wh"),
        (Cause.FENCE, {}, "12 m outside"),
        (Cause.OFF_ROUTE, {}, "41 m left"),
    ],
)
def test_what_is_wrong_has_its_figures_and_its_name_where_there_are_none(
    cause: Cause, known: dict[str, object], words: str
) -> None:
    rules = Known()
    for name, value in known.items():
        setattr(rules, name, value)
    told = ConditionsSeen(energy_words="short by 3 Wh", fence_words="12 m outside", off_route_words="41 m left")
    figures = figures_of(rules)
    assert figures.of(cause, told, 100.0) == words


@pytest.mark.parametrize("cause", [Cause.ENERGY, Cause.FENCE, Cause.OFF_ROUTE])
def test_where_the_edge_says_nothing_the_name_has_to_do(cause: Cause) -> None:
    rules = Known()
    assert figures_of(rules).of(cause, ConditionsSeen(), 100.0) == CAUSES[cause].words


@pytest.mark.parametrize("cause", Cause)
def test_authority_without_figures_for_a_cause_says_nothing(cause: Cause) -> None:
    rules = Known()
    rules.owner = None
    coverage = Coverage(rules, rules, rules, Limits())  # type: ignore[arg-type]
    assert isinstance(coverage.words(cause, 100.0), str)
