# SPDX-License-Identifier: GPL-3.0-or-later

"""Whether the autopilot follows, by itself: every limit on both of its sides, and what comes when nothing shows."""

from __future__ import annotations

import pytest

from mavproxy_handover.core.common.events import ModeSeen, MotionSeen
from mavproxy_handover.core.common.handling import CIRCLES
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import FlightAction, ModeClass, ModeSource
from mavproxy_handover.core.safety.command_verification import CommandVerification, Seen
from mavproxy_handover.core.safety.mode_source import ModeTracker
from mavproxy_handover.core.safety.strategy import Fact

HOLD, CONTINUE, RETURN, LAND = FlightAction.HOLD, FlightAction.CONTINUE, FlightAction.RETURN, FlightAction.LAND
ALOFT = frozenset({Fact.FLYING, Fact.AUTOPILOT})
OBEYED, AGAIN, UNABLE = Seen.OBEYED, Seen.AGAIN, Seen.UNABLE
FAR_M = 1000.0


class Watched:
    """A supervision with its helm, looked at when the test says; times count from the order."""

    def __init__(
        self, flown: ModeClass | None = ModeClass.MISSION, speed_mps: float = 8.0, *, motion: bool = True
    ) -> None:
        self.supervision = CommandVerification(Limits(obey_s=6.0, stuck_s=30.0))
        self.helm = ModeTracker()
        self.now = 500.0
        self.facts = ALOFT
        self.breached = False
        if flown is not None:
            self.flies(flown)
        if motion:
            self.moves(speed_mps)

    def flies(self, flown: ModeClass, *, landing: bool = False) -> None:
        self.helm.flown, self.helm.landing = flown, landing

    def moves(self, speed_mps: float, climb_mps: float = 0.0, left_m: float | None = FAR_M) -> None:
        self.supervision.moved(MotionSeen(speed_mps, climb_mps, left_m), self.now)

    def order(self, action: FlightAction) -> Watched:
        self.supervision.ordered(action, self.now)
        return self

    def look(self, after_s: float = 0.0) -> Seen | None:
        self.now += after_s
        return self.supervision.verify(self.helm, self.facts, self.breached, self.now)


def returning(left_m: float | None = FAR_M, climb_mps: float = 0.0) -> Watched:
    """In RTL, as ordered; seen just now."""
    watched = Watched(ModeClass.RETURN).order(RETURN)
    watched.moves(8.0, climb_mps, left_m)
    assert watched.look() is OBEYED
    return watched


# ---- nothing to see -----------------------------------------------------------------------------------------------


def test_without_an_order_nothing_is_seen() -> None:
    assert Watched().look(100.0) is None


# ---- to go on -----------------------------------------------------------------------------------------------------


def going_on(speed_mps: float = 0.0) -> Watched:
    """It stood still, and has just been commanded to go on."""
    watched = Watched().order(HOLD)
    watched.moves(speed_mps)
    watched.supervision.go_on(watched.now)
    assert watched.supervision.order is CONTINUE
    return watched


def test_what_was_not_held_has_nothing_to_show_when_it_goes_on() -> None:
    for before in (Watched(), Watched().order(RETURN), returning()):
        before.supervision.go_on(before.now)
        assert (before.supervision.order, before.look(100.0)) == (None, None)


def test_what_moves_goes_on() -> None:
    for speed_mps, climb_mps in ((1.0, 0.0), (0.0, 0.31), (0.0, -0.31)):
        watched = going_on()
        watched.moves(speed_mps, climb_mps)
        assert watched.look(5.9) is None
        assert watched.supervision.due_at == watched.now + 0.1
        assert watched.supervision.stands
        assert watched.look(0.1) is OBEYED
        assert (watched.supervision.order, watched.supervision.stands) == (None, False)
        assert watched.look(100.0) is None


def test_what_stands_still_is_told_to_go_on_again_for_ever() -> None:
    """The fault: one command that was lost on its way left it standing there until its battery was empty."""
    for speed_mps, climb_mps in ((0.99, 0.0), (0.0, 0.3), (0.0, -0.3)):
        watched = going_on()
        watched.moves(speed_mps, climb_mps)
        assert [watched.look(6.0) for _ in range(20)] == [AGAIN] * 20
        assert watched.supervision.unable == frozenset()


def test_what_may_not_have_come_to_rest_yet_is_no_proof() -> None:
    """It still moved when it was told to go on: for the time that a stop takes, moving says nothing."""
    watched = going_on(10.0)
    assert watched.look(9.9) is None
    watched.moves(0.0)
    assert watched.look(0.1) is AGAIN
    assert watched.look(5.9) is None
    assert watched.look(0.1) is AGAIN


def test_without_a_motion_nothing_is_known_of_going_on_either() -> None:
    watched = Watched(motion=False).order(HOLD)
    watched.supervision.go_on(watched.now)
    assert watched.look(6.0) is OBEYED


def test_what_comes_home_does_not_go_on() -> None:
    for fact in (Fact.RETURNING, Fact.LANDING):
        watched = going_on()
        watched.facts = ALOFT | {fact}
        assert watched.look(6.0) is None
        assert (watched.supervision.order, watched.supervision.stands) == (None, False)


def test_a_return_that_was_never_flown_has_not_ended_the_hold() -> None:
    watched = Watched().order(HOLD)
    watched.moves(0.0)
    watched.order(RETURN)
    assert watched.look(1.0) is None
    assert watched.supervision.stands
    watched.flies(ModeClass.RETURN)
    assert watched.look(1.0) is OBEYED
    assert not watched.supervision.stands


def test_whoever_takes_it_ends_the_hold_and_its_end() -> None:
    for hand in (ModeSource.PILOT, ModeSource.COMMANDER, ModeSource.FAILSAFE):
        watched = going_on()
        assert watched.supervision.taken(hand) is CONTINUE
        assert not watched.supervision.stands
        assert watched.look(100.0) is None


def test_by_the_commanders_word_it_stands_or_moves() -> None:
    for watched in (going_on(), Watched().order(HOLD)):
        watched.supervision.commanded()
        assert (watched.supervision.order, watched.supervision.stands) == (None, False)
    watched = Watched().order(HOLD).order(RETURN)
    watched.supervision.commanded()
    assert (watched.supervision.order, watched.supervision.stands) == (RETURN, False)


def test_when_it_is_over_nothing_stands() -> None:
    watched = going_on()
    watched.supervision.over()
    assert (watched.supervision.order, watched.supervision.stands) == (None, False)


def test_on_the_ground_without_a_mode_or_under_another_hand_nothing_is_counted() -> None:
    for facts in (ALOFT - {Fact.FLYING}, ALOFT | {Fact.PILOT}, ALOFT | {Fact.FAILSAFE}, ALOFT - {Fact.AUTOPILOT}):
        watched = Watched().order(RETURN)
        watched.facts = facts
        assert watched.look(100.0) is None, facts
    assert Watched(None).order(RETURN).look(100.0) is None


# ---- by the mode --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("order", "flown", "landing", "follows"),
    [
        (RETURN, ModeClass.RETURN, False, True),
        (RETURN, ModeClass.LAND, True, True),
        (RETURN, ModeClass.MISSION, False, False),
        (RETURN, ModeClass.MISSION, True, False),  # a mission that lands is no return
        (RETURN, ModeClass.GUIDED, False, False),
        (LAND, ModeClass.LAND, True, True),
        (LAND, ModeClass.RETURN, False, False),
        (LAND, ModeClass.RETURN, True, True),  # the end of a return
        (LAND, ModeClass.MISSION, True, True),
        (LAND, ModeClass.STOP, False, False),
    ],
)
def test_which_mode_is_which_order(order: FlightAction, flown: ModeClass, landing: bool, follows: bool) -> None:
    watched = Watched().order(order)
    watched.flies(flown, landing=landing)
    assert watched.look() is (OBEYED if follows else None)
    assert watched.supervision.order is order


def test_what_does_not_show_is_commanded_once_more_and_given_up() -> None:
    watched = Watched().order(RETURN)
    assert [watched.look(s) for s in (5.9, 0.1, 5.9, 0.1)] == [None, AGAIN, None, UNABLE]
    assert watched.supervision.unable == {RETURN}
    assert watched.supervision.order is None
    assert watched.look(60.0) is None


def test_causes_that_take_turns_give_an_order_no_more_time() -> None:
    """Flight 1005508: lost and back again, out of coverage all the while, it stood still for 66 s in one return."""
    watched = Watched().order(RETURN)
    assert watched.look(5.9) is None
    watched.order(RETURN)
    assert watched.look(0.1) is AGAIN
    watched = returning()
    for seconds in (10.0, 10.0, 9.9):
        assert watched.look(seconds) is None
        watched.order(RETURN)
    assert watched.look(0.1) is UNABLE
    assert watched.order(RETURN).supervision.order is RETURN, "what was given up may be ordered once more"
    watched = Watched().order(HOLD)
    assert watched.look(8.3) is None
    assert watched.order(HOLD).look(0.1) is UNABLE


def test_a_landing_is_commanded_again_for_ever() -> None:
    watched = Watched().order(LAND)
    assert [watched.look(s) for s in (5.9, 0.1, 5.9, 0.1, 6.0, 6.0)] == [None, AGAIN, None, AGAIN, AGAIN, AGAIN]
    assert watched.supervision.unable == frozenset()


def test_what_was_seen_and_is_left_is_commanded_at_once_and_has_both_tries_again() -> None:
    watched = returning()
    watched.flies(ModeClass.GUIDED)
    assert watched.look(0.1) is AGAIN
    assert [watched.look(s) for s in (5.9, 0.1, 5.9, 0.1)] == [None, AGAIN, None, UNABLE]


def test_what_was_seen_again_is_watched_again() -> None:
    watched = returning()
    watched.flies(ModeClass.GUIDED)
    watched.look(0.1)
    watched.flies(ModeClass.RETURN)
    assert watched.look(1.0) is OBEYED
    assert [watched.look(s) for s in (0.1, 29.8)] == [None, None], "the first look finds it nearer than ever"
    assert watched.look(0.2) is UNABLE


def test_an_autopilot_that_was_not_heard_is_commanded_when_it_is() -> None:
    watched = Watched().order(RETURN)
    watched.facts = ALOFT - {Fact.AUTOPILOT}
    assert watched.look(30.0) is None
    watched.facts = ALOFT
    assert watched.look(0.1) is AGAIN
    assert [watched.look(s) for s in (0.1, 5.8, 0.1, 5.9, 0.1)] == [None, None, AGAIN, None, UNABLE]


def test_outside_the_fence_what_comes_home_already_is_not_commanded_again() -> None:
    for coming, seen in ((Fact.RETURNING, None), (Fact.LANDING, None), (None, AGAIN)):
        watched = Watched(ModeClass.OTHER).order(LAND)
        watched.breached = True
        watched.facts = ALOFT | ({coming} if coming else set())
        assert watched.look(6.0) is seen
        watched.breached = False
        assert watched.look(0.1) is (AGAIN if seen is None else None)


# ---- a hold, by rest ----------------------------------------------------------------------------------------------


def test_rest_is_below_one_metre_a_second() -> None:
    for speed_mps, seen in ((1.0, None), (0.99, OBEYED)):
        watched = Watched().order(HOLD)
        watched.moves(speed_mps)
        assert watched.look(1.0) is seen
        assert watched.look(1.0) is None


def test_what_stood_once_is_held() -> None:
    watched = Watched().order(HOLD)
    watched.moves(0.0)
    assert watched.look(1.0) is OBEYED
    watched.moves(5.0)
    assert watched.look(100.0) is None


def test_a_stop_takes_as_long_as_the_speed_needs() -> None:
    """10 m/s at 1.25 m/s2 are 8 s, and 2 s until the command has arrived."""
    watched = Watched(speed_mps=10.0).order(HOLD)
    assert [watched.look(s) for s in (9.9, 0.1)] == [None, UNABLE]
    assert watched.supervision.unable == {HOLD}
    assert watched.supervision.order is None


def test_without_a_motion_nothing_is_known_of_rest() -> None:
    watched = Watched(motion=False).order(HOLD)
    assert watched.look(1.9) is None
    watched.moves(3.0)
    assert [watched.look(), watched.look(0.1)] == [None, UNABLE], "what it flew when it was ordered counts as nothing"


# ---- a return, by getting nearer ----------------------------------------------------------------------------------


def stuck(watched: Watched, *motions: tuple[float, float | None]) -> list[Seen | None]:
    """Climb (m/s) and distance (m) each 15 s later."""
    seen = []
    for climb_mps, left_m in motions:
        watched.now += 15.0
        watched.moves(2.0, climb_mps, left_m)
        seen.append(watched.look())
    return seen


def test_nearer_is_five_metres_at_least() -> None:
    assert stuck(returning(), (0.0, FAR_M), (0.0, FAR_M - 4.9)) == [None, UNABLE]
    assert stuck(returning(), (0.0, FAR_M), (0.0, FAR_M - 5.0), (0.0, FAR_M - 5.0)) == [None, None, None]


def test_nearer_counts_from_the_nearest_that_it_was() -> None:
    watched = returning()
    assert stuck(watched, (0.0, 900.0), (0.0, 930.0), (0.0, 910.0)) == [None, None, UNABLE]


def test_another_place_is_one_that_is_suddenly_far_away() -> None:
    for jump_m, seen in ((50.0, UNABLE), (50.1, None)):
        assert stuck(returning(), (0.0, 900.0), (0.0, 900.0), (0.0, 900.0 + jump_m))[-1] is seen


def test_a_climb_is_more_than_30_centimetres_a_second() -> None:
    assert stuck(returning(), (0.3, FAR_M), (0.3, FAR_M)) == [None, UNABLE]
    assert stuck(returning(), (0.0, FAR_M), (0.31, FAR_M), (0.0, FAR_M)) == [None, None, None]


def test_at_the_place_nothing_more_is_expected_from_15_m_on() -> None:
    assert stuck(returning(16.0), *[(0.0, 15.0)] * 6) == [None] * 6
    assert stuck(returning(15.1), *[(0.0, 15.1)] * 2) == [None, UNABLE]


def test_where_the_place_is_not_known_nothing_is_concluded() -> None:
    assert stuck(returning(), *[(0.0, None)] * 6) == [None] * 6


def test_a_place_that_becomes_known_later_is_got_nearer_to_from_then_on() -> None:
    watched = returning(None)
    assert stuck(watched, (0.0, None), (0.0, 900.0), (0.0, 899.0), (0.0, 898.0)) == [None, None, None, UNABLE]


def test_stuck_is_so_for_thirty_seconds() -> None:
    watched = returning()
    watched.moves(2.0)
    assert [watched.look(s) for s in (29.9, 0.1)] == [None, UNABLE]
    assert watched.supervision.unable == {RETURN}


def test_how_often_it_is_looked_at_makes_no_difference() -> None:
    for pauses in ((30.0,), (10.0, 20.0), (0.05,) * 599 + (0.05 + 1e-9,)):
        watched = returning()
        watched.moves(8.0, left_m=FAR_M - 200.0)
        assert [watched.look(s) for s in pauses] == [None] * (len(pauses) - 1) + [UNABLE]


def test_nearer_counts_from_its_report() -> None:
    watched = returning()
    watched.now += 20.0
    watched.moves(8.0, left_m=FAR_M - 100.0)
    assert [watched.look(s) for s in (10.0, 19.9, 0.1)] == [None, None, UNABLE]


def test_a_climb_keeps_its_time_from_running() -> None:
    watched = returning(climb_mps=2.0)
    assert watched.look(60.0) is None
    watched.moves(0.0)
    assert [watched.look(s) for s in (1.0, 29.9, 0.1)] == [None, None, UNABLE]


def test_nothing_gets_nearer_before_the_order_shows() -> None:
    watched = Watched().order(RETURN)
    watched.look(5.0)
    watched.moves(8.0, left_m=FAR_M - 100.0)
    assert watched.look(1.0) is AGAIN


def test_a_landing_that_is_carried_nearer_does_not_come_down() -> None:
    watched = Watched(ModeClass.LAND).order(LAND)
    watched.facts = ALOFT | {Fact.LANDING}
    assert watched.look() is OBEYED
    assert stuck(watched, (0.0, 900.0), (0.0, 800.0)) == [None, UNABLE]


def test_while_the_autopilot_is_not_heard_nothing_is_counted() -> None:
    """The first look behind a silence of its line rests on what it said before."""
    for order, flown in ((RETURN, ModeClass.RETURN), (LAND, ModeClass.LAND), (HOLD, ModeClass.MISSION)):
        watched = Watched(flown).order(order)
        watched.look()
        watched.facts = ALOFT - {Fact.AUTOPILOT}
        assert watched.look(60.0) is None
        watched.facts = ALOFT
        assert watched.look(0.1) is None, order
        assert watched.look(30.0) is UNABLE, order


# ---- when it is due -----------------------------------------------------------------------------------------------


def due_s(watched: Watched) -> float | None:
    """How soon a look is due."""
    at = watched.supervision.due_at
    return None if at is None else at - watched.now


def test_a_look_is_due_when_a_time_is_over() -> None:
    watched = Watched().order(RETURN)
    assert due_s(watched) is None, "whoever orders looks behind it"
    watched.look()
    assert due_s(watched) == 6.0
    watched.look(2.0)
    assert due_s(watched) == 4.0
    assert watched.look(4.0) is AGAIN
    assert due_s(watched) == 6.0
    watched.flies(ModeClass.RETURN)
    assert watched.look(1.0) is OBEYED
    assert due_s(watched) == 30.0
    watched.look(10.0)
    assert due_s(watched) == 20.0
    assert watched.look(20.0) is UNABLE
    assert due_s(watched) is None


def test_a_look_is_due_when_a_stop_has_had_its_time() -> None:
    watched = Watched(speed_mps=10.0).order(HOLD)
    watched.look(1.0)
    assert due_s(watched) == 9.0
    assert watched.look(9.0) is UNABLE
    assert due_s(watched) is None
    watched = Watched(speed_mps=10.0).order(HOLD)
    watched.moves(0.0)
    assert watched.look(1.0) is OBEYED
    assert due_s(watched) is None


def test_no_look_is_due_where_nothing_is_counted() -> None:
    for facts in (ALOFT - {Fact.FLYING}, ALOFT | {Fact.PILOT}, ALOFT - {Fact.AUTOPILOT}):
        watched = Watched().order(RETURN)
        watched.look()
        watched.facts = facts
        watched.look(60.0)
        assert due_s(watched) is None, facts
    watched = returning(climb_mps=2.0)
    watched.look(1.0)
    assert due_s(watched) is None
    watched = Watched(ModeClass.LAND).order(LAND)
    watched.facts = ALOFT | {Fact.LANDING}
    watched.look()
    assert stuck(watched, (0.0, 3.0), (0.0, 3.0), (0.0, 3.0)) == [None, UNABLE, None]
    assert due_s(watched) is None, "told once, and under it there is nothing"


def test_outside_the_fence_nothing_is_given_up() -> None:
    watched = returning()
    watched.moves(2.0)
    watched.look(1.0)
    watched.breached = True
    assert watched.look(60.0) is None
    watched.breached = False
    assert [watched.look(s) for s in (0.1, 29.9, 0.1)] == [None, None, UNABLE], "its time begins anew"


def test_that_it_lands_is_enough_for_a_return_and_a_landing_has_to_come_down() -> None:
    watched = returning()
    watched.facts = ALOFT | {Fact.LANDING}
    assert stuck(watched, *[(0.0, FAR_M)] * 4) == [None] * 4
    for climb_mps, last in ((-0.3, UNABLE), (-0.31, None), (0.5, UNABLE)):
        watched = Watched(ModeClass.LAND).order(LAND)
        watched.facts = ALOFT | {Fact.LANDING}
        assert watched.look() is OBEYED
        assert stuck(watched, *[(climb_mps, 3.0)] * 2)[-1] is last
        assert watched.supervision.order is LAND, "under it there is nothing"


def test_a_motion_that_is_not_seen_any_more_is_none() -> None:
    """The fault: positions stopped, the time ran on, and a return that got on well was given up and landed."""
    watched = returning()
    watched.supervision.unseen()
    assert watched.look(100.0) is None
    watched.moves(8.0, left_m=FAR_M)
    assert watched.look() is None, "its time begins with the first look behind it"
    assert watched.look(29.9) is None
    assert watched.look(0.1) is UNABLE


def test_without_a_motion_nothing_is_concluded_of_a_return() -> None:
    watched = Watched(ModeClass.RETURN, motion=False).order(RETURN)
    assert watched.look() is OBEYED
    assert watched.look(100.0) is None


def test_the_second_order_knows_nothing_of_the_nearest_of_the_first() -> None:
    watched = returning()
    stuck(watched, (0.0, 900.0), (0.0, 940.0))
    watched.supervision.over()
    watched.order(RETURN)
    assert watched.look() is OBEYED
    assert stuck(watched, (0.0, 930.0), (0.0, 920.0), (0.0, 910.0)) == [None] * 3


def test_what_cannot_be_done_is_told_once() -> None:
    watched = Watched(ModeClass.LAND).order(LAND)
    watched.facts = ALOFT | {Fact.LANDING}
    watched.look()
    assert stuck(watched, *[(0.0, 3.0)] * 6).count(UNABLE) == 1


# ---- other hands --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("hand", "order", "again"),
    [
        (ModeSource.PILOT, RETURN, True),
        (ModeSource.PILOT, LAND, True),
        (ModeSource.PILOT, HOLD, False),  # a decision of its own
        (ModeSource.COMMANDER, RETURN, False),
        (ModeSource.FAILSAFE, RETURN, True),
        (ModeSource.FAILSAFE, LAND, True),
        (ModeSource.FAILSAFE, HOLD, False),
    ],
)
def test_what_a_pilot_or_a_failsafe_has_interrupted_is_commanded_again_when_neither_has_it(
    hand: ModeSource, order: FlightAction, again: bool
) -> None:
    watched = Watched().order(order)
    assert watched.supervision.taken(hand) is order
    assert watched.supervision.order is None
    watched.facts = ALOFT | {Fact.PILOT}
    assert watched.look(60.0) is None
    watched.facts = ALOFT
    assert watched.look(1.0) is (AGAIN if again else None)
    assert watched.supervision.order is (order if again else None)


def test_a_pilot_who_takes_it_twice_has_interrupted_the_same() -> None:
    watched = Watched().order(RETURN)
    watched.supervision.taken(ModeSource.PILOT)
    assert watched.supervision.taken(ModeSource.PILOT) is None
    assert watched.look(1.0) is AGAIN
    assert watched.supervision.due_at == watched.now + 6.0
    assert watched.look(1.0) is None


def test_a_commander_who_takes_it_from_a_pilot_ends_what_he_had_interrupted() -> None:
    watched = Watched().order(RETURN)
    watched.supervision.taken(ModeSource.PILOT)
    assert watched.supervision.taken(ModeSource.COMMANDER) is RETURN
    assert watched.look(60.0) is None


@pytest.mark.parametrize("flown", [ModeClass.RETURN, ModeClass.LAND])
def test_what_is_done_already_when_it_is_given_back_is_not_commanded_again(flown: ModeClass) -> None:
    """The fault: a landing that had been begun meanwhile became a return again. Found by a campaign."""
    watched = Watched().order(RETURN)
    watched.supervision.taken(ModeSource.PILOT)
    watched.flies(flown)
    assert watched.look(1.0) is OBEYED
    assert watched.supervision.order is RETURN


def test_what_was_commanded_again_for_him_has_one_try_less() -> None:
    watched = Watched().order(RETURN)
    watched.supervision.taken(ModeSource.PILOT)
    watched.look(1.0)
    assert [watched.look(s) for s in (5.9, 0.1)] == [None, UNABLE]


def test_a_new_order_is_not_followed_by_the_interrupted_one() -> None:
    watched = Watched().order(RETURN)
    watched.supervision.taken(ModeSource.PILOT)
    watched.order(LAND)
    watched.flies(ModeClass.LAND)
    assert watched.look(0.1) is OBEYED
    assert watched.supervision.order is LAND


def test_when_it_is_over_everything_can_be_tried_again_and_nothing_is_awaited() -> None:
    watched = Watched().order(RETURN)
    watched.look(6.0)
    watched.look(6.0)
    assert watched.supervision.unable == {RETURN}
    watched.supervision.taken(ModeSource.PILOT)
    watched.order(LAND)
    watched.supervision.taken(ModeSource.PILOT)
    watched.supervision.over()
    assert (watched.supervision.unable, watched.supervision.order) == (frozenset(), None)
    assert watched.look(60.0) is None


def test_the_helm_of_these_tests_is_what_the_autopilot_says() -> None:
    helm = ModeTracker()
    helm.seen(ModeSeen(ModeClass.RETURN, "RTL", landing=True), True, 1.0)
    assert (helm.flown, helm.landing) == (ModeClass.RETURN, True)


def test_the_same_order_given_again_has_its_time_to_show_again() -> None:
    watched = Watched().order(RETURN)
    assert watched.supervision.unshown(watched.helm, 505.9) is RETURN
    assert watched.supervision.unshown(watched.helm, 506.0) is None
    watched.now = 505.0
    watched.order(RETURN)
    assert watched.supervision.unshown(watched.helm, 510.9) is RETURN
    assert watched.supervision.shows_by == 511.0
    assert watched.supervision.unshown(watched.helm, 511.0) is None


def test_on_the_ground_it_stands_by_no_order() -> None:
    watched = Watched().order(HOLD)
    assert watched.supervision.stands
    watched.supervision.grounded()
    assert not watched.supervision.stands


@pytest.mark.parametrize(("circles", "seen"), [(True, OBEYED), (False, None)])
def test_an_aircraft_that_circles_shows_a_hold_by_its_mode(circles: bool, seen: Seen | None) -> None:
    watched = Watched(ModeClass.STOP, motion=False)
    if circles:
        watched.supervision.watch(CIRCLES)
    assert watched.order(HOLD).look() is seen


def test_a_refusal_after_the_order_has_shown_is_of_another_command() -> None:
    watched = returning()
    watched.supervision.refused(RETURN)
    watched.flies(ModeClass.MISSION)
    assert watched.look(1.0) is AGAIN


def test_a_held_aircraft_that_its_commander_sends_on_stands_until_it_moves() -> None:
    watched = Watched().order(HOLD)
    watched.supervision.commanded()
    assert not watched.supervision.stands
    watched.supervision.sent_on(watched.now)
    assert (watched.supervision.stands, watched.supervision.order) == (True, CONTINUE)


@pytest.mark.parametrize(
    ("flown", "order", "unshown"),
    [
        (ModeClass.MISSION, RETURN, RETURN),
        (ModeClass.RETURN, RETURN, None),
        (ModeClass.RETURN, LAND, LAND),
        (ModeClass.LAND, RETURN, None),
        (None, RETURN, None),
        (ModeClass.MISSION, HOLD, None),
    ],
)
def test_an_order_home_or_down_need_not_show_at_once(
    flown: ModeClass | None, order: FlightAction, unshown: FlightAction | None
) -> None:
    watched = Watched(flown).order(order)
    assert watched.supervision.unshown(watched.helm, watched.now) is unshown


@pytest.mark.parametrize(
    ("order", "speed_mps", "seen"),
    [(HOLD, 0.9, OBEYED), (HOLD, 1.0, Seen.REFUSED), (RETURN, 0.5, Seen.REFUSED)],
)
def test_a_refused_order_counts_as_refused_unless_it_shows(order: FlightAction, speed_mps: float, seen: Seen) -> None:
    watched = Watched(speed_mps=speed_mps).order(order)
    watched.supervision.refused(order)
    assert watched.look() is seen


def test_a_refused_landing_is_due_again_after_a_second() -> None:
    watched = Watched().order(LAND)
    watched.supervision.refused(LAND)
    assert watched.look() is None
    assert watched.supervision.due_at == watched.now + 1.0
