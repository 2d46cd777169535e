# SPDX-License-Identifier: GPL-3.0-or-later

"""What is done about what is wrong. Every expectation is written out: one letter for each combination of facts."""

from __future__ import annotations

from itertools import combinations, product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mavproxy_handover.core.common.causes import CAUSES, Cause
from mavproxy_handover.core.common.model import FlightAction
from mavproxy_handover.core.safety.strategy import Decision, Fact, Strategy, decide
from tests.core.safety.ledger import EXPECTED

W, T, H, C, R, L = FlightAction
LETTERS = {"w": W, "H": H, "T": T, "C": C, "R": R, "L": L}

#: in the air, with an autopilot, and nobody else's hand on it
ALOFT = frozenset({Fact.FLYING, Fact.AUTOPILOT})
#: The four that the ladders ask for, in the order of the bits below.
BITS = (Fact.SUCCESSOR, Fact.GAP, Fact.MAY_HOLD, Fact.PLACE)

#: cause, policy -> what it asks for in the air
TABLE = {(cause, policy): letters for cause, row in EXPECTED.items() for policy, letters in row.asks.items()}

#: the same, of an aircraft that is on its way to a place, or landing
RETURNING = {"w": W, "H": W, "T": T, "C": W, "R": R, "L": L}
LANDING = {"w": W, "H": W, "T": T, "C": W, "R": W, "L": L}

DEFAULTS = {cause: row.policies[0] for cause, row in CAUSES.items()}


def bits(number: int) -> frozenset[Fact]:
    return frozenset(fact for place, fact in enumerate(BITS) if number & (8 >> place))


def asked(cause: str, policy: str, facts: frozenset[Fact]) -> FlightAction:
    found = decide({Cause(cause)}, facts, {**DEFAULTS, Cause(cause): policy})
    assert found is not None
    assert found.cause is Cause(cause)
    return found.action


def test_the_table_has_every_cause_with_every_policy_but_off() -> None:
    assert set(TABLE) == {(c.value, word) for c, row in CAUSES.items() for word in row.policies if word != "off"}
    assert {len(row) for row in TABLE.values()} == {16}


@pytest.mark.parametrize(("cause", "policy"), TABLE, ids="-".join)
def test_each_cause_alone(cause: str, policy: str) -> None:
    row = TABLE[cause, policy]
    assert [asked(cause, policy, ALOFT | bits(n)) for n in range(16)] == [LETTERS[letter] for letter in row]


def test_what_a_hand_holds_back_is_known_beside_a_warning_that_is_none_of_its_business() -> None:
    """It may have to be done yet, when the hand is gone."""
    policies = {**DEFAULTS, Cause.ENERGY: "warn", Cause.FENCE: "return"}
    piloted = ALOFT | {Fact.PLACE, Fact.PILOT}
    found = {}
    for causes in ({Cause.ENERGY, Cause.FENCE}, {Cause.FENCE}, {Cause.ENERGY}):
        decision = decide(causes, piloted, policies)
        assert decision is not None
        assert decision.action is W
        found[frozenset(causes)] = (decision.cause, decision.withheld, decision.held_back)
    assert found == {
        frozenset({Cause.ENERGY, Cause.FENCE}): (Cause.ENERGY, None, Fact.PILOT),
        frozenset({Cause.FENCE}): (Cause.FENCE, Fact.PILOT, Fact.PILOT),
        frozenset({Cause.ENERGY}): (Cause.ENERGY, None, None),
    }


@pytest.mark.parametrize(("cause", "policy"), TABLE, ids="-".join)
def test_what_returns_is_not_stopped_and_what_lands_is_not_sent_anywhere(cause: str, policy: str) -> None:
    row = TABLE[cause, policy]
    for n, letter in enumerate(row):
        assert asked(cause, policy, ALOFT | bits(n) | {Fact.RETURNING}) is RETURNING[letter]
        assert asked(cause, policy, ALOFT | bits(n) | {Fact.LANDING}) is LANDING[letter]
        assert asked(cause, policy, ALOFT | bits(n) | {Fact.LANDING, Fact.RETURNING}) is LANDING[letter]


@pytest.mark.parametrize("policies", ["return", "land"])
@pytest.mark.parametrize(
    "facts",
    [
        frozenset({Fact.AUTOPILOT}),
        frozenset({Fact.FLYING}),
        ALOFT | {Fact.PILOT},
        ALOFT | {Fact.FAILSAFE},
        ALOFT | {Fact.PILOT, Fact.FAILSAFE},
    ],
    ids=["on the ground", "no autopilot", "a pilot steers", "a failsafe acts", "both"],
)
def test_where_nothing_is_to_be_commanded_everything_is_a_warning(facts: frozenset[Fact], policies: str) -> None:
    chosen = {cause: policies if policies in row.policies else row.policies[0] for cause, row in CAUSES.items()}
    for n, flown in product(range(8), ((), (Fact.RETURNING,), (Fact.LANDING,))):
        for pair in combinations(Cause, 2):
            found = decide(set(pair), facts | bits(n) | set(flown), chosen)
            assert found is not None
            assert (found.action, found.cause) == (W, min(pair, key=list(Cause).index))
            assert (found.held_back is None) is all(chosen[cause] == "warn" for cause in pair)


def test_to_wait_for_a_station_commands_nothing_so_it_goes_on() -> None:
    for facts in (frozenset[Fact](), ALOFT | {Fact.PILOT}, frozenset({Fact.FLYING})):
        assert decide({LOST}, facts | {Fact.SUCCESSOR}, DEFAULTS) == Decision(T, LOST)


def test_without_a_cause_there_is_no_decision() -> None:
    for n in range(16):
        assert decide(set(), ALOFT | bits(n), DEFAULTS) is None


@pytest.mark.parametrize("pair", list(combinations(Cause, 2)), ids=lambda pair: "-".join(c.value for c in pair))
def test_of_two_causes_the_graver_action_is_done_whichever_came_first(pair: tuple[Cause, Cause]) -> None:
    first, second = pair
    words = [[word for word in CAUSES[cause].policies if word != "off"] for cause in pair]
    for one, other in product(*words):
        policies = {**DEFAULTS, first: one, second: other}
        for n in range(16):
            actions = LETTERS[TABLE[first.value, one][n]], LETTERS[TABLE[second.value, other][n]]
            expected = Decision(actions[0], first) if actions[0] >= actions[1] else Decision(actions[1], second)
            assert decide({first, second}, ALOFT | bits(n), policies) == expected
            assert decide({second, first}, ALOFT | bits(n), policies) == expected


# ---- what is remembered ----------------------------------------------------------------------------------------------


PLACE = ALOFT | {Fact.PLACE}
LOST, OUT, ENDS, ENERGY, WEAK = (
    Cause.COMMANDER_LOST,
    Cause.OUT_OF_COVERAGE,
    Cause.COVERAGE_ENDS,
    Cause.ENERGY,
    Cause.LINKS_WEAK,
)


def test_a_return_lasts_as_long_as_its_cause() -> None:
    strategy = Strategy({})
    assert strategy.judge({LOST}, PLACE) == Decision(R, LOST)
    # a station begins to take it: that ends nothing, the commit does
    assert strategy.judge({LOST}, PLACE | {Fact.SUCCESSOR, Fact.RETURNING}) == Decision(R, LOST)
    # and a milder cause neither
    assert strategy.judge({LOST, ENDS}, PLACE | {Fact.MAY_HOLD, Fact.RETURNING}) == Decision(R, LOST)
    assert strategy.judge({ENDS}, PLACE | {Fact.MAY_HOLD, Fact.RETURNING}) == Decision(W, ENDS)
    assert strategy.judge(set(), PLACE) is None


def test_a_landing_is_not_turned_into_a_return_when_a_place_comes_into_reach() -> None:
    strategy = Strategy({})
    assert strategy.judge({ENERGY}, ALOFT) == Decision(L, ENERGY)
    assert strategy.judge({ENERGY}, PLACE | {Fact.LANDING}) == Decision(L, ENERGY)
    assert strategy.judge({ENERGY, LOST}, PLACE | {Fact.LANDING}) == Decision(L, ENERGY)


def test_what_gets_worse_gets_a_graver_action() -> None:
    strategy = Strategy({})
    assert strategy.judge({ENDS}, PLACE | {Fact.MAY_HOLD}) == Decision(H, ENDS)
    assert strategy.judge({ENDS}, PLACE) == Decision(R, ENDS)  # the time to hold is over
    assert strategy.judge({ENDS, ENERGY}, PLACE | {Fact.RETURNING}) == Decision(R, ENERGY)
    assert strategy.judge({ENDS, ENERGY}, ALOFT | {Fact.RETURNING}) == Decision(L, ENERGY)


def test_a_return_that_began_for_the_end_of_coverage_is_not_held_on_the_way() -> None:
    strategy = Strategy({})
    assert strategy.judge({ENDS}, PLACE) == Decision(R, ENDS)
    assert strategy.judge({ENDS}, PLACE | {Fact.MAY_HOLD}) == Decision(R, ENDS)


def test_to_hold_to_wait_and_to_go_on_end_when_something_milder_will_do() -> None:
    strategy = Strategy({})
    assert strategy.judge({LOST}, PLACE | {Fact.SUCCESSOR}) == Decision(T, LOST)
    assert strategy.judge({OUT}, PLACE | {Fact.GAP}) == Decision(C, OUT)
    assert strategy.judge({ENDS}, PLACE | {Fact.MAY_HOLD}) == Decision(H, ENDS)
    assert strategy.judge({WEAK}, PLACE | {Fact.MAY_HOLD}) == Decision(W, WEAK)


def test_who_holds_waits_for_a_station_no_longer_than_for_one_that_is_about_to_take_it() -> None:
    strategy = Strategy({Cause.NO_STATION: "hold"})
    assert strategy.judge({Cause.NO_STATION}, PLACE | {Fact.MAY_HOLD}) == Decision(H, Cause.NO_STATION)
    assert strategy.judge({Cause.NO_STATION}, PLACE | {Fact.MAY_HOLD, Fact.SUCCESSOR}) == Decision(T, Cause.NO_STATION)


def test_a_pilot_ends_a_return_and_gives_it_back() -> None:
    strategy = Strategy({})
    strategy.judge({LOST}, PLACE)
    assert strategy.judge({LOST}, PLACE | {Fact.PILOT}) == Decision(W, LOST)
    assert strategy.judge({LOST}, PLACE) == Decision(R, LOST)


@pytest.mark.parametrize(
    "away",
    [ALOFT - {Fact.AUTOPILOT}, ALOFT | {Fact.PILOT}, ALOFT | {Fact.FAILSAFE}],
    ids=["not heard", "a pilot", "a failsafe"],
)
def test_a_return_that_is_held_back_for_a_time_is_not_forgotten(away: frozenset[Fact]) -> None:
    """The fault: an autopilot that was not heard for a time made it a hold again, which was milder than what had been
    told, so nobody ordered it; and when the return was given up, nobody ordered to land. Found by a campaign."""
    strategy = Strategy({})
    assert strategy.judge({ENDS}, PLACE) == Decision(R, ENDS)
    assert strategy.judge({ENDS}, away | {Fact.PLACE, Fact.MAY_HOLD}) == Decision(W, ENDS)
    assert strategy.judge({ENDS}, PLACE | {Fact.MAY_HOLD}) == Decision(R, ENDS)
    assert strategy.judge({ENDS}, ALOFT | {Fact.MAY_HOLD}) == Decision(L, ENDS)
    assert strategy.judge({ENDS}, away | {Fact.PLACE, Fact.MAY_HOLD}) == Decision(W, ENDS)
    assert strategy.judge({ENDS}, PLACE | {Fact.MAY_HOLD}) == Decision(L, ENDS)


def test_but_when_its_cause_is_over_meanwhile_it_is() -> None:
    strategy = Strategy({})
    assert strategy.judge({ENDS}, PLACE) == Decision(R, ENDS)
    assert strategy.judge(set(), PLACE | {Fact.PILOT}) is None
    assert strategy.judge({ENDS}, PLACE | {Fact.MAY_HOLD}) == Decision(H, ENDS)


def test_the_next_flight_knows_nothing_of_the_last_one() -> None:
    strategy = Strategy({})
    strategy.judge({ENERGY}, ALOFT)
    strategy.landed()
    assert strategy.decision is None
    assert strategy.judge({ENERGY}, PLACE) == Decision(R, ENERGY)


def test_nor_what_the_commander_would_not_have_in_it() -> None:
    strategy = Strategy({})
    strategy.judge({ENERGY}, PLACE)
    strategy.overrule({ENERGY}, PLACE)
    assert strategy.judge({ENERGY}, PLACE) == Decision(FlightAction.WARN, ENERGY)
    strategy.landed()
    assert strategy.judge({ENERGY}, PLACE) == Decision(R, ENERGY)


def test_policies_are_those_of_the_configuration_and_of_the_table_for_the_rest() -> None:
    strategy = Strategy({LOST: "land"})
    assert strategy.judge({LOST}, PLACE) == Decision(L, LOST)
    assert Strategy({LOST: "land"}).judge({OUT}, PLACE) == Decision(R, OUT)


# ---- whatever comes --------------------------------------------------------------------------------------------------

CAUSE_SETS = st.sets(st.sampled_from(Cause))
FACT_SETS = st.sets(st.sampled_from(Fact)).map(frozenset)
POLICIES = st.fixed_dictionaries(
    {cause: st.sampled_from([word for word in row.policies if word != "off"]) for cause, row in CAUSES.items()}
)


@given(CAUSE_SETS, CAUSE_SETS, FACT_SETS, POLICIES)
def test_another_cause_never_makes_it_milder(
    some: set[Cause], more: set[Cause], facts: frozenset[Fact], policies: dict[Cause, str]
) -> None:
    before, after = decide(some, facts, policies), decide(some | more, facts, policies)
    if before is not None:
        assert after is not None
        assert after.action >= before.action


@pytest.mark.slow
@given(st.lists(st.tuples(CAUSE_SETS, FACT_SETS), max_size=30), POLICIES)
def test_nothing_milder_than_what_is_asked_for_and_the_same_twice_is_the_same(
    moments: list[tuple[set[Cause], frozenset[Fact]]], policies: dict[Cause, str]
) -> None:
    strategy = Strategy(policies)
    for causes, facts in moments:
        least = decide(causes, facts, policies)
        found = strategy.judge(causes, facts)
        assert (found is None) == (not causes)
        if found is not None and least is not None:
            assert found.cause in causes
            assert found.action >= least.action
        assert strategy.judge(causes, facts) == found


@given(FACT_SETS, POLICIES)
def test_when_every_station_is_lost_outside_a_gap_it_comes_down_somewhere(
    facts: frozenset[Fact], policies: dict[Cause, str]
) -> None:
    facts = (facts | ALOFT) - {Fact.PILOT, Fact.FAILSAFE, Fact.GAP, Fact.SUCCESSOR, Fact.LANDING}
    policies = {**policies, LOST: "return" if policies[LOST] == "warn" else policies[LOST]}
    found = decide({LOST}, facts, policies)
    assert found is not None
    assert found.action in (R, L)


@pytest.mark.parametrize("cause", [cause for cause in Cause if "hold" in CAUSES[cause].policies])
def test_who_can_return_no_more_lands_and_is_not_held_again(cause: Cause) -> None:
    strategy = Strategy({cause: "hold"})
    assert strategy.judge({cause}, ALOFT | {Fact.PLACE}) == Decision(FlightAction.RETURN, cause)
    assert strategy.judge({cause}, ALOFT | {Fact.PLACE, Fact.MAY_HOLD}) == Decision(FlightAction.RETURN, cause)
    assert strategy.judge({cause}, ALOFT | {Fact.MAY_HOLD}) == Decision(FlightAction.LAND, cause)
    assert strategy.judge({cause}, ALOFT | {Fact.PLACE, Fact.MAY_HOLD}) == Decision(FlightAction.LAND, cause)


@pytest.mark.parametrize(("fact", "cause"), [(Fact.SUCCESSOR, Cause.COMMANDER_LOST), (Fact.GAP, Cause.OUT_OF_COVERAGE)])
def test_what_lets_it_go_on_is_waited_for_before_it_lands(fact: Fact, cause: Cause) -> None:
    strategy = Strategy({})
    assert strategy.judge({cause}, ALOFT | {Fact.PLACE}) == Decision(FlightAction.RETURN, cause)
    assert strategy.judge({cause}, ALOFT | {fact}) == Decision(FlightAction.RETURN, cause)
    assert strategy.judge({cause}, ALOFT) == Decision(FlightAction.LAND, cause)


@pytest.mark.parametrize(("fact", "action"), [(Fact.GAP, C), (Fact.SUCCESSOR, T)])
def test_what_lets_the_aircraft_go_on_is_no_order_that_can_be_overruled(fact: Fact, action: FlightAction) -> None:
    found = decide({Cause.COMMANDER_LOST}, ALOFT | {fact}, DEFAULTS, {Cause.COMMANDER_LOST: R})
    assert found == Decision(action, Cause.COMMANDER_LOST)


def test_a_cause_that_was_overruled_and_went_away_gives_an_order_when_it_is_back() -> None:
    strategy, facts = Strategy({}), ALOFT | {Fact.PLACE}
    lost = {Cause.COMMANDER_LOST}
    assert strategy.judge(lost, facts) == Decision(R, Cause.COMMANDER_LOST)
    strategy.overrule(lost, facts)
    assert strategy.judge(lost, facts) == Decision(W, Cause.COMMANDER_LOST)
    assert strategy.judge(set(), facts) is None
    assert strategy.judge(lost, facts) == Decision(R, Cause.COMMANDER_LOST)
