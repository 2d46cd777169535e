# SPDX-License-Identifier: GPL-3.0-or-later

"""What was decided becomes true, or something graver does, or it is left to whoever has taken the aircraft."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import pytest

from mavproxy_handover.core.common.causes import Cause
from mavproxy_handover.core.common.events import (
    Action,
    Announce,
    ConditionsSeen,
    Event,
    Fly,
    LinkJudged,
    ModeSeen,
    ModeSourceSeen,
    MotionSeen,
    OrderRefused,
    PlaceJudged,
)
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import FlightAction, ModeClass, ModeSource, Reason
from tests.core.bench import (
    A,
    B,
    Bench,
    DisconnectHandover,
    DroneConnected,
    OkHandover,
    OnHandover,
    TransferKey,
    inside,
    outside,
)
from tests.core.safety.test_conditions import GO_ON, ends, mission

LOST = Reason.COMMANDER_LOST
HOME, DOWN = Fly(FlightAction.RETURN, LOST), Fly(FlightAction.LAND, LOST)
HOLD, BACK = Fly(FlightAction.HOLD, Reason.COVERAGE_ENDS), Fly(FlightAction.RETURN, Reason.COVERAGE_ENDS)
AUTO, RTL = ModeSeen(ModeClass.MISSION, "AUTO"), ModeSeen(ModeClass.RETURN, "RTL")
LAND, LOITER = ModeSeen(ModeClass.LAND, "LAND", landing=True), ModeSeen(ModeClass.HANDS, "LOITER")
BRAKE = ModeSeen(ModeClass.STOP, "BRAKE")
#: on the way back at 8 m/s
HOMEWARD = MotionSeen(8.0, 0.0, 600.0)


def with_radio(mode: ModeSeen) -> ModeSeen:
    return ModeSeen(mode.flown, mode.name, mode.landing, radio=True)


def aloft(limits: Limits | None = None, mode: ModeSeen = AUTO) -> Bench:
    """On its mission, in AUTO, at 8 m/s."""
    bench = mission(limits)
    bench.mode, bench.motion = mode, MotionSeen(8.0, 0.0, 300.0)
    bench.run(1.0)
    bench.log.clear()
    return bench


def lost(bench: Bench, mode: ModeSeen | None = RTL) -> Bench:
    """The commander is lost: it is to come home. The autopilot flies `mode` then, None: it does nothing."""
    bench.alive = set()
    while not bench.flights():
        bench.run(0.1)
    if mode is not None:
        bench.mode, bench.motion = mode, HOMEWARD
    return bench


def nearer(bench: Bench, seconds: float, by_mps: float, climb_mps: float = 0.0) -> None:
    """It flies on towards its place, so fast; away from it with less than 0."""
    for _ in range(round(seconds * 2)):
        motion = bench.motion
        assert motion is not None
        assert motion.left_m is not None
        bench.motion = MotionSeen(abs(by_mps), climb_mps, motion.left_m - by_mps / 2)
        bench.run(0.5)


def said(bench: Bench) -> list[str]:
    return [action.text for _at, action in bench.log if isinstance(action, Announce)]


def times(bench: Bench) -> list[tuple[float, FlightAction]]:
    """The commands, and how long after the first each came."""
    found = [(at, action.action) for at, action in bench.log if isinstance(action, Fly)]
    return [(round(at - found[0][0], 1), action) for at, action in found]


def looked_at(bench: Bench, place: Event) -> Bench:
    """The edge looks at the place of a return once more when that is ordered, and finds this; or this comes then."""
    give = bench.give

    def handed(event: Event) -> list[Action]:
        actions = give(event)
        if any(isinstance(action, Fly) and action.action is FlightAction.RETURN for action in actions):
            give(place)
        return actions

    bench.give = handed  # type: ignore[method-assign]
    return bench


class TestItsPlace:
    """The place of a return is another one where its station was just lost."""

    NEAR, HOME = PlaceJudged("rally 2", True, "210 m, covered by GCSB all the way"), PlaceJudged("home", True, "400 m")

    def test_a_return_is_told_with_the_place_that_it_goes_to(self) -> None:
        bench = aloft()
        bench.give(self.NEAR)
        lost(looked_at(bench, self.HOME))
        bench.run(1.0)
        assert [text for text in said(bench) if "RETURN" in text] == ["RETURN to home. GCSA silent for 5 s. 400 m"]

    def test_where_nothing_new_is_seen_it_is_told_at_once_all_the_same(self) -> None:
        bench = aloft()
        bench.give(self.NEAR)
        bench = lost(bench)
        (ordered,) = [at for at, action in bench.log if isinstance(action, Fly)]
        bench.run(0.0)
        (told,) = [at for at, action in bench.log if isinstance(action, Announce) and "RETURN" in action.text]
        assert told == ordered

    def test_whoever_was_told_another_place_is_told_that_it_goes_elsewhere(self) -> None:
        bench = lost(aloft())
        bench.run(0.1)
        for place in (self.HOME, self.NEAR, replace(self.NEAR, words="200 m")):
            bench.give(place)
        texts = [text for text in said(bench) if text.startswith("RETURN to ")]
        assert [text.split(".")[0] for text in texts] == ["RETURN to home", "RETURN to rally 2"]

    def test_what_lands_after_all_is_not_told_to_return(self) -> None:
        bench = aloft()
        bench.give(self.NEAR)
        lost(looked_at(bench, PlaceJudged("home", False)))
        bench.run(1.0)
        assert [text.split(".")[0] for text in said(bench)][:1] == ["LAND"]


class TestReturn:
    def test_what_is_done_is_commanded_once(self) -> None:
        bench = lost(aloft())
        nearer(bench, 60.0, 8.0)
        assert bench.flights() == [HOME]
        assert [record.text for record in bench.records("order")] == ["RETURN: the autopilot follows, RTL"]

    def test_a_mode_that_does_not_show_is_commanded_again_and_then_it_lands(self) -> None:
        bench = lost(aloft(), None)
        bench.run(30.0)
        assert [action for _at, action in times(bench)][:3] == [
            FlightAction.RETURN,
            FlightAction.RETURN,
            FlightAction.LAND,
        ]
        waits = [at for at, _action in times(bench)][:3]
        assert 6.0 <= waits[1] <= 6.6
        assert 12.0 <= waits[2] <= 13.2
        assert said(bench)[1:4] == [
            "RETURN is ordered again. The aircraft has not begun it, in AUTO (commander lost)",
            "RETURN: the autopilot does not follow. The autopilot is in AUTO (commander lost)",
            "LAND. GCSA silent for 17 s",
        ]

    def test_a_landing_that_does_not_come_is_commanded_as_long_as_it_takes(self) -> None:
        bench = lost(aloft(Limits(policies={Cause.COMMANDER_LOST: "land"})), None)
        bench.run(40.0)
        commanded = [at for at, _action in times(bench)]
        assert len(commanded) > 5
        assert all(6.0 <= later - earlier <= 6.6 for earlier, later in pairwise(commanded))
        bench.mode = LAND
        bench.run(20.0)
        assert bench.flights() == [DOWN] * len(commanded)

    def test_what_is_commanded_again_and_again_is_told_every_ten_seconds(self) -> None:
        policies = {Cause.OFF_ROUTE: "land"}
        bench = aloft(Limits(policies=policies, obey_s=5.0))
        bench.give(ConditionsSeen(off_route=True))
        first = bench.now
        bench.run(36.0)
        again = [at for at, action in bench.log if isinstance(action, Announce) and " again" in action.text]
        assert len(bench.flights()) == 8
        assert [round(at - first) for at in again] == [5, 15, 25, 35]

    def test_the_wait_for_the_mode_is_configured(self) -> None:
        bench = lost(aloft(Limits(obey_s=3.0)), None)
        bench.run(3.6)
        assert bench.flights() == [HOME, HOME]

    def test_blown_backwards_for_long_it_lands(self) -> None:
        """Flown: a wind of 11 m/s blew RTL backwards for good, in mode RTL."""
        bench = lost(aloft())
        nearer(bench, 29.0, -1.0)
        assert bench.flights() == [HOME]
        nearer(bench, 3.0, -1.0)
        assert bench.flights() == [HOME, DOWN]
        assert "RETURN: the autopilot does not follow. The autopilot is in RTL (commander lost)" in said(bench)

    def test_against_the_wind_it_comes_home_slowly(self) -> None:
        bench = lost(aloft())
        nearer(bench, 250.0, 2.0)
        assert bench.flights() == [HOME]

    def test_a_gust_is_no_wind_that_cannot_be_flown_against(self) -> None:
        bench = lost(aloft())
        for _ in range(5):
            nearer(bench, 20.0, -0.5)
            nearer(bench, 8.0, 4.0)
        assert bench.flights() == [HOME]

    def test_first_it_climbs_over_where_it_is_and_then_its_place_is_far_away(self) -> None:
        bench = lost(aloft())
        bench.motion = MotionSeen(0.5, 2.5, 1.0)
        bench.run(60.0)
        bench.motion = MotionSeen(0.5, 0.0, 2.0)
        bench.run(5.0)
        bench.motion = MotionSeen(1.0, 0.0, 640.0)
        bench.run(1.0)
        nearer(bench, 60.0, 8.0)
        assert bench.flights() == [HOME]

    def test_at_its_place_it_may_wait(self) -> None:
        bench = lost(aloft())
        bench.motion = MotionSeen(0.0, 0.0, 3.0)
        bench.run(120.0)
        assert bench.flights() == [HOME]

    def test_where_it_is_not_known_how_far_it_is_nothing_is_concluded(self) -> None:
        bench = lost(aloft())
        bench.motion = MotionSeen(0.0, 0.0)
        bench.run(120.0)
        assert bench.flights() == [HOME]

    def test_a_landing_instead_will_do(self) -> None:
        bench = lost(aloft(), LAND)
        bench.run(60.0)
        assert bench.flights() == [HOME]

    def test_beside_a_warning_it_is_over_with_its_cause(self) -> None:
        bench = aloft()
        bench.give(ConditionsSeen(off_route=True))
        bench.run(1.0)
        lost(bench, None).alive = {A}
        bench.run(30.0)
        assert bench.flights() == [HOME]
        assert said(bench)[-1].startswith("WARNING. Off route")

    def test_after_the_flight_the_next_one_is_trusted_again(self) -> None:
        bench = lost(aloft(), None)
        bench.run(13.0)
        assert bench.flights()[-1] == DOWN
        bench.autopilot_says(armed=False, flying=False)
        bench.run(2.0)
        bench.alive = {A}
        bench.run(2.0)
        bench.autopilot_says(armed=True, flying=True)
        bench.run(2.0)
        bench.log.clear()
        assert lost(bench).flights() == [HOME]


class TestHold:
    def held(self, limits: Limits | None = None) -> Bench:
        bench = aloft(limits)
        bench.position(ends(4.0), outside(A + 1))
        assert bench.flights() == [HOLD]
        return bench

    def test_who_stops_it_by_another_mode_meanwhile_is_a_pilot(self) -> None:
        """A copter is held within its mode: the companion has asked for none."""
        bench = aloft(mode=with_radio(AUTO))
        bench.position(ends(4.0), outside(B))
        bench.motion = MotionSeen(0.0, 0.0)
        bench.run(2.0)
        bench.mode = with_radio(BRAKE)
        bench.run(3.0)
        assert "PILOT: a pilot has taken over, BRAKE; HOLD is not commanded any more (coverage ends ahead)" in said(
            bench
        )

    def test_what_is_over_before_it_is_known_that_a_pilot_stopped_it_was_not_taken_from_anybody(self) -> None:
        bench = aloft(Limits(policies={Cause.LINKS_WEAK: "hold"}, clear_s={Cause.LINKS_WEAK: 0.0}), with_radio(AUTO))
        bench.give(LinkJudged(A, weak=True, attacked=False, text="a third is lost"))
        bench.run(10.0)
        bench.motion = MotionSeen(0.0, 0.0)
        bench.run(2.0)
        bench.mode = with_radio(BRAKE)
        bench.run(0.5)
        bench.give(LinkJudged(A, weak=False, attacked=False, text=""))
        bench.position(inside(A), outside(B))
        assert said(bench)[-1].startswith("ALL CLEAR")
        bench.run(3.0)
        assert said(bench)[-1] == "PILOT: a pilot has taken over, BRAKE"
        assert [fly.action for fly in bench.flights()] == [FlightAction.HOLD]

    def test_what_stands_is_held(self) -> None:
        bench = self.held()
        bench.motion = MotionSeen(0.4, 0.0)
        bench.run(30.0)
        assert bench.flights() == [HOLD]
        assert [record.text for record in bench.records("order")] == ["HOLD: the autopilot follows, AUTO"]

    def test_what_does_not_stop_comes_home(self) -> None:
        """At 8 m/s a stop takes 6.4 s, and 2 s until it begins."""
        bench = self.held()
        bench.run(8.3)
        assert bench.flights() == [HOLD]
        bench.run(0.7)
        assert bench.flights() == [HOLD, BACK]
        (given_up,) = [at for at, action in bench.log if isinstance(action, Announce) and "does not" in action.text]
        (ordered,) = [at for at, action in bench.log if action == BACK]
        assert ordered == given_up  # in the same moment
        bench.mode = RTL
        bench.run(2.0)
        assert bench.flights() == [HOLD, BACK]
        assert "HOLD: the autopilot does not follow. The autopilot is in AUTO (coverage ends ahead)" in said(bench)

    def test_what_flies_on_before_it_stood_is_not_expected_to_stand(self) -> None:
        bench = self.held()
        bench.alive = {A, B}
        bench.run(2.0)
        bench.position(ends(3.0, A, B), inside(B))
        view = bench.arbiter.view
        key = TransferKey(A, B, view.handover_id, view.epoch)
        for station, word in ((B, OnHandover(key)), (A, OkHandover(key)), (B, DroneConnected(key))):
            bench.say(station, word)
        bench.say(A, DisconnectHandover(key))
        bench.run(20.0)
        assert bench.flights() == [HOLD, Fly(FlightAction.CONTINUE, Reason.NONE)]
        assert not any("does not follow" in text for text in said(bench))

    def test_what_is_blown_about_once_it_stood_is_left_alone(self) -> None:
        bench = self.held()
        bench.motion = MotionSeen(0.5, 0.0)
        bench.run(2.0)
        bench.motion = MotionSeen(3.0, 0.0)
        bench.run(20.0)
        assert bench.flights() == [HOLD]

    def test_if_the_commander_has_it_fly_on_that_is_the_commanders_word(self) -> None:
        bench = self.held()
        bench.run(2.0)
        bench.give(ModeSourceSeen(ModeSource.COMMANDER, ModeClass.MISSION))
        bench.run(20.0)
        assert bench.flights() == [HOLD]

    @pytest.mark.parametrize("hand", [ModeSource.GUARD, ModeSource.FAILSAFE, ModeSource.COMPANION])
    def test_what_others_may_have_chosen_is_no_word_to_fly_on(self, hand: ModeSource) -> None:
        bench = self.held()
        bench.run(2.0)
        bench.give(ModeSourceSeen(hand))
        bench.run(10.0)
        assert bench.flights() == [HOLD, BACK]

    def test_a_pilot_ends_it_and_nothing_is_told_to_go_on(self) -> None:
        """The fault: what was held, and taken over, was commanded to go on."""
        bench = self.held()
        bench.motion = MotionSeen(0.0, 0.0)
        bench.mode = with_radio(LOITER)
        bench.run(3.0)
        assert bench.flights() == [HOLD]
        bench.mode = with_radio(AUTO)
        bench.run(3.0)
        assert bench.flights() == [HOLD, HOLD]

    def test_whatever_time_it_had_to_stand_is_over_where_a_pilot_has_flown_it(self) -> None:
        bench = self.held(Limits(hold_s=20.0))
        bench.motion = MotionSeen(0.0, 0.0)
        bench.run(5.0)
        bench.mode = with_radio(LOITER)
        bench.run(40.0)
        bench.mode = with_radio(AUTO)
        bench.run(19.0)
        assert bench.flights() == [HOLD, HOLD]
        bench.run(5.0)
        assert bench.flights() == [HOLD, HOLD, BACK]

    def test_whoever_ends_a_return_that_held_it_back_has_not_overruled_it(self) -> None:
        bench = aloft()
        bench.give(ModeSourceSeen(ModeSource.GUARD))
        bench.mode = RTL
        bench.run(3.0)
        bench.position(ends(4.0), outside(A + 1))
        bench.run(2.0)
        assert bench.flights() == []
        bench.give(ModeSourceSeen(ModeSource.COMMANDER, ModeClass.MISSION))
        bench.mode = AUTO
        bench.run(2.0)
        assert bench.flights() == [HOLD]

    def test_an_autopilot_that_is_not_heard_is_not_told_to_go_on(self) -> None:
        bench = self.held()
        bench.motion = MotionSeen(0.0, 0.0)
        bench.run(1.0)
        bench.autopilot = False
        bench.run(5.0)
        assert bench.flights() == [HOLD]
        bench.autopilot = True
        bench.run(2.0)
        assert bench.flights() == [HOLD, HOLD]


class TestRefused:
    """The autopilot answers that it does not do it: nothing is waited for."""

    def held(self) -> Bench:
        bench = aloft()
        bench.position(ends(4.0), outside(A + 1))
        assert bench.flights() == [HOLD]
        return bench

    def test_a_hold_that_is_refused_is_a_return_in_the_same_moment(self) -> None:
        bench = self.held()
        bench.give(OrderRefused(FlightAction.HOLD))
        assert bench.flights() == [HOLD, BACK]
        assert said(bench)[1] == "HOLD: the autopilot refuses it. The autopilot is in AUTO (coverage ends ahead)"

    def test_what_stands_all_the_same_is_held(self) -> None:
        """In LOITER ArduCopter refuses the pause, and stands."""
        bench = aloft(mode=LOITER)
        bench.motion = MotionSeen(0.4, 0.0)
        bench.run(1.0)
        bench.position(ends(4.0), outside(A + 1))
        bench.give(OrderRefused(FlightAction.HOLD))
        bench.run(20.0)
        assert bench.flights() == [HOLD]

    def test_a_second_answer_to_the_same_order_counts_for_nothing(self) -> None:
        """The order was sent twice, and each copy was answered."""
        bench = self.held()
        bench.give(OrderRefused(FlightAction.HOLD))
        bench.give(OrderRefused(FlightAction.HOLD))
        bench.mode, bench.motion = RTL, HOMEWARD
        nearer(bench, 20.0, 8.0)
        assert bench.flights() == [HOLD, BACK]

    def test_an_answer_to_another_order_than_the_one_in_force_counts_for_nothing(self) -> None:
        bench = self.held()
        bench.give(OrderRefused(FlightAction.RETURN))
        bench.give(OrderRefused(FlightAction.LAND))
        bench.give(OrderRefused(FlightAction.CONTINUE))
        assert bench.flights() == [HOLD]

    def test_a_return_that_is_refused_is_a_landing_in_the_same_moment(self) -> None:
        bench = lost(aloft(), None)
        bench.give(OrderRefused(FlightAction.RETURN))
        assert bench.flights() == [HOME, DOWN]
        assert "RETURN: the autopilot refuses it. The autopilot is in AUTO (commander lost)" in said(bench)

    def test_a_return_that_has_shown_by_then_goes_on(self) -> None:
        """The landing that was tried behind it has been taken, and its answer was lost."""
        bench = lost(aloft(), LAND)
        bench.run(1.0)
        bench.give(OrderRefused(FlightAction.RETURN))
        assert bench.flights() == [HOME]

    def test_a_landing_that_is_refused_is_commanded_again_after_a_second(self) -> None:
        bench = lost(aloft(Limits(policies={Cause.COMMANDER_LOST: "land"})), None)
        for _ in range(5):
            bench.give(OrderRefused(FlightAction.LAND))
            bench.run(1.1)
        assert [action for _at, action in times(bench)] == [FlightAction.LAND] * 6
        assert all(0.9 <= later - earlier <= 1.3 for (earlier, _), (later, _) in pairwise(times(bench)))

    def test_under_a_pilot_nothing_is_concluded(self) -> None:
        bench = aloft(mode=with_radio(AUTO))
        bench.position(ends(4.0), outside(B))
        bench.mode = with_radio(LOITER)
        bench.run(3.0)
        bench.give(OrderRefused(FlightAction.HOLD))
        bench.run(5.0)
        assert bench.flights() == [HOLD]


class TestPilot:
    def test_he_is_not_fought_whatever_else_goes_wrong_until_he_gives_it_back(self) -> None:
        bench = lost(aloft(mode=with_radio(AUTO)), with_radio(RTL))
        bench.run(10.0)
        bench.mode = with_radio(LOITER)
        bench.run(2.0)
        bench.give(ConditionsSeen(energy=True))
        bench.run(60.0)
        assert bench.flights() == [HOME]
        assert said(bench)[1] == (
            "PILOT: a pilot has taken over, LOITER; RETURN is not commanded any more (commander lost)"
        )
        bench.mode = with_radio(AUTO)
        bench.run(1.0)
        assert bench.flights() == [HOME]  # it is in doubt yet
        bench.run(1.0)
        assert bench.flights() == [HOME, Fly(FlightAction.RETURN, Reason.ENERGY)]
        assert said(bench)[-2:] == [
            "PILOT: the pilot has given it back, AUTO (commander lost)",
            "RETURN. Energy only for the way back",
        ]

    def test_what_begins_while_he_flies_is_told_and_done_when_he_gives_it_back(self) -> None:
        bench = aloft(mode=with_radio(AUTO))
        bench.mode = with_radio(LOITER)
        bench.run(3.0)
        bench.give(ConditionsSeen(energy=True, energy_words="3.1 of 12.0 Wh"))
        bench.run(10.0)
        assert bench.flights() == []
        assert said(bench)[-1] == "WARNING. 3.1 of 12.0 Wh. A pilot has the aircraft"
        bench.mode = with_radio(AUTO)
        bench.run(2.0)
        assert bench.flights() == [Fly(FlightAction.RETURN, Reason.ENERGY)]

    def test_what_he_interrupted_is_commanded_again(self) -> None:
        bench = lost(aloft(mode=with_radio(AUTO)), with_radio(RTL))
        bench.run(2.0)
        bench.mode = with_radio(LOITER)
        bench.run(20.0)
        bench.mode = with_radio(AUTO)
        bench.run(3.0)
        assert bench.flights() == [HOME, HOME]
        assert said(bench)[-1] == "RETURN is ordered again. The aircraft has not begun it, in AUTO (commander lost)"

    def test_when_his_radio_is_gone_the_aircraft_is_nobodys(self) -> None:
        bench = lost(aloft(mode=with_radio(AUTO)), with_radio(LOITER))
        bench.run(20.0)
        assert bench.flights() == [HOME]
        bench.mode = LOITER
        bench.run(1.0)
        assert bench.flights() == [HOME, HOME]

    def test_what_was_wrong_and_is_not_any_more_is_not_commanded_when_he_gives_it_back(self) -> None:
        bench = lost(aloft(mode=with_radio(AUTO)), with_radio(RTL))
        bench.run(2.0)
        bench.mode = with_radio(LOITER)
        bench.run(2.0)
        bench.alive = {A}
        bench.run(2.0)
        bench.mode = with_radio(AUTO)
        bench.run(5.0)
        assert bench.flights() == [HOME]


class TestOtherHands:
    def test_what_a_failsafe_took_over_is_commanded_again_when_a_pilot_gives_it_back(self) -> None:
        """The fault: what a failsafe had taken was nobody's any more, and flew on with the cause there. Found by a
        campaign."""
        bench = lost(aloft(mode=with_radio(AUTO)), with_radio(RTL))
        nearer(bench, 5.0, 8.0)
        bench.give(ModeSourceSeen(ModeSource.FAILSAFE))
        bench.mode = with_radio(LAND)
        bench.run(10.0)
        bench.mode = with_radio(LOITER)
        bench.run(10.0)
        assert bench.flights() == [HOME]
        bench.mode = with_radio(AUTO)
        bench.run(3.0)
        assert bench.flights() == [HOME, HOME]

    def test_and_when_a_stranger_ends_that(self) -> None:
        bench = lost(aloft())
        nearer(bench, 5.0, 8.0)
        bench.give(ModeSourceSeen(ModeSource.FAILSAFE))
        bench.mode = LAND
        bench.run(10.0)
        bench.mode = ModeSeen(ModeClass.GUIDED, "GUIDED")
        bench.run(3.0)
        assert bench.flights() == [HOME, HOME]

    def test_the_commanders_word_stands_until_something_new_is_decided(self) -> None:
        bench = aloft()
        bench.give(ConditionsSeen(energy=True))
        bench.run(3.0)
        bench.mode = RTL
        bench.run(2.0)
        bench.give(ModeSourceSeen(ModeSource.COMMANDER, ModeClass.MISSION))
        bench.mode = AUTO
        bench.run(60.0)
        assert bench.flights() == [Fly(FlightAction.RETURN, Reason.ENERGY)]
        assert "AUTO: chosen by GCSA; RETURN is not commanded any more (energy only for the way back)" in said(bench)
        bench.motion = HOMEWARD
        bench.alive = set()
        bench.run(8.0)
        assert bench.flights()[1] == HOME

    def test_a_mode_of_somebody_unknown_is_commanded_away(self) -> None:
        bench = lost(aloft())
        nearer(bench, 5.0, 8.0)
        bench.mode = ModeSeen(ModeClass.GUIDED, "GUIDED")
        bench.run(2.5)
        assert bench.flights() == [HOME, HOME]
        assert [record.text for record in bench.records("helm")] == ["GUIDED: the source of the mode is not known"]

    @pytest.mark.parametrize("hand", [ModeSource.GUARD, ModeSource.FAILSAFE])
    def test_a_return_that_is_under_way_already_is_not_commanded_again(self, hand: ModeSource) -> None:
        bench = aloft()
        bench.give(ModeSourceSeen(hand))
        bench.mode, bench.motion = RTL, HOMEWARD
        bench.run(2.0)
        bench.alive = set()
        bench.run(10.0)
        assert bench.flights() == []
        assert bench.records("emergency" if hand is ModeSource.GUARD else "warning") != []

    def test_one_that_the_guard_has_begun_is_watched_like_one_of_our_own(self) -> None:
        bench = aloft()
        bench.give(ModeSourceSeen(ModeSource.GUARD))
        bench.mode, bench.motion = RTL, HOMEWARD
        bench.run(2.0)
        bench.alive = set()
        bench.run(6.0)
        nearer(bench, 33.0, -1.0)
        assert bench.flights() == [DOWN]

    def test_a_failsafe_that_lands_instead_is_left_alone(self) -> None:
        bench = lost(aloft())
        nearer(bench, 5.0, 8.0)
        bench.give(ModeSourceSeen(ModeSource.FAILSAFE))
        bench.mode = LAND
        bench.run(60.0)
        assert bench.flights() == [HOME]
        assert "LAND: a failsafe of the autopilot acts; RETURN is not commanded any more (commander lost)" in said(
            bench
        )


class TestLink:
    @pytest.mark.parametrize("mode", [AUTO, with_radio(AUTO)], ids=["no radio", "radio"])
    def test_a_return_that_the_guard_began_unheard_is_landed_when_no_place_is_in_reach_any_more(
        self, mode: ModeSeen
    ) -> None:
        """The fault: it was taken for a pilot's, or a failsafe's, and flown on until the battery was empty. Found by a
        campaign."""
        bench = aloft(mode=mode)
        bench.autopilot = False
        bench.run(10.0)
        bench.autopilot = True
        bench.mode, bench.motion = ModeSeen(ModeClass.RETURN, "RTL", radio=mode.radio), HOMEWARD
        bench.run(3.0)
        assert [record.text for record in bench.records("helm")] == ["RTL: chosen while the autopilot was not heard"]
        assert bench.flights() == []
        bench.give(PlaceJudged("home", False))
        bench.give(ConditionsSeen(energy=True))
        bench.run(3.0)
        assert bench.flights() == [Fly(FlightAction.LAND, Reason.ENERGY)]

    def test_what_did_not_arrive_is_commanded_when_the_autopilot_is_heard_again(self) -> None:
        bench = aloft()
        bench.alive = set()
        bench.run(4.6)
        while not bench.flights():
            bench.run(0.1)
        bench.autopilot = False  # the command went into a link that was cut
        bench.run(20.0)
        assert bench.flights() == [HOME]
        bench.autopilot = True
        bench.run(0.6)
        assert bench.flights() == [HOME, HOME]
        assert times(bench)[1][0] <= 20.6

    def test_what_had_arrived_is_not(self) -> None:
        bench = lost(aloft())
        nearer(bench, 5.0, 8.0)
        bench.autopilot = False
        bench.run(20.0)
        bench.autopilot = True
        nearer(bench, 5.0, 8.0)
        assert bench.flights() == [HOME]


class TestFence:
    def breached(self, policy: str) -> Bench:
        bench = aloft(Limits(policies={Cause.FENCE: policy}))
        bench.give(ConditionsSeen(fence=True, fence_words="outside the fence (its border)"))
        return bench

    def test_what_the_autopilots_fence_brings_home_is_left_to_it(self) -> None:
        bench = self.breached("return")
        bench.give(ModeSourceSeen(ModeSource.FAILSAFE))
        bench.mode, bench.motion = RTL, MotionSeen(0.0, 0.0, 600.0)
        bench.run(120.0)
        assert bench.flights() == []
        assert said(bench) == [
            "WARNING. Outside the fence (its border). A failsafe of the autopilot acts",
        ]

    def test_a_fence_that_only_reports_can_have_the_companion_return(self) -> None:
        bench = self.breached("return")
        bench.run(2.0)
        assert bench.flights() == [Fly(FlightAction.RETURN, Reason.FENCE)]

    def test_outside_it_nothing_is_commanded_anew_to_what_comes_home(self) -> None:
        """A change of the mode would give the fence ten seconds in which it does nothing."""
        bench = lost(aloft())
        nearer(bench, 2.0, 8.0)
        bench.give(ConditionsSeen(fence=True))
        nearer(bench, 60.0, -1.0)
        assert bench.flights() == [HOME]
        bench.give(ConditionsSeen())
        nearer(bench, 33.0, -1.0)
        assert bench.flights() == [HOME, DOWN]


class TestSentences:
    @pytest.mark.parametrize(
        ("event", "text"),
        [
            (ConditionsSeen(off_route=True, off_route_words="42 m beside the route"), "WARNING. 42 m beside the route"),
            (
                ConditionsSeen(fence=True, fence_words="outside the fence (its border)"),
                "WARNING. Outside the fence (its border)",
            ),
            (
                LinkJudged(A, weak=False, attacked=True, text="bad"),
                "WARNING. A sender without the key of GCSA speaks in its name",
            ),
        ],
        ids=["route", "fence", "attack"],
    )
    def test_each_has_its_figures(self, event: ConditionsSeen | LinkJudged, text: str) -> None:
        bench = aloft()
        bench.give(event)
        bench.run(2.0)
        assert said(bench) == [text]

    def test_of_what_is_not_heard_it_is_for_how_long(self) -> None:
        for attribute, text in (
            ("autopilot", "WARNING. Autopilot silent for 3 s"),
            ("guard", "WARNING. Guard silent for 5 s"),
            ("facts", "WARNING. No fresh position for 3 s"),
        ):
            bench = aloft()
            setattr(bench, attribute, False if attribute == "autopilot" else None)
            bench.run(10.0)
            assert said(bench)[0] == text

    def test_on_the_ground_it_says_so(self) -> None:
        bench = Bench().on_ground()
        bench.log.clear()
        bench.alive = set()
        bench.run(8.0)
        assert said(bench) == ["WARNING. GCSA silent for 5 s. The aircraft is on the ground"]

    def test_and_when_it_is_over(self) -> None:
        bench = lost(aloft())
        bench.alive = {A}
        bench.run(1.0)
        assert said(bench)[-1] == "ALL CLEAR. Over: commander lost"


# ---- what stands still goes on ------------------------------------------------------------------------------------


def standing(bench: Bench) -> Bench:
    """GCSA's zone ends ahead, nobody could take the aircraft: it is held, and stands."""
    bench.position(ends(4.0, A, B), outside(B))
    assert bench.flights() == [HOLD]
    bench.motion = MotionSeen(0.0, 0.0, 300.0)
    bench.facts = (inside(A), inside(B))
    bench.run(3.0)
    return bench


def taken_by_b(bench: Bench) -> None:
    """GCSB appears, here, and takes the aircraft."""
    bench.alive = {A, B}
    while bench.arbiter.view.partner is None:
        bench.run(0.1)
    view = bench.arbiter.view
    key = TransferKey(A, B, view.handover_id, view.epoch)
    for station, word in ((B, OnHandover(key)), (A, OkHandover(key)), (B, DroneConnected(key))):
        bench.say(station, word)
    bench.say(A, DisconnectHandover(key))
    assert bench.arbiter.view.commander == B


def test_an_order_to_go_on_that_was_lost_is_given_again_until_it_moves() -> None:
    """The fault: the autopilot did not hear it, and the aircraft stood there under a commander who knew nothing."""
    bench = standing(aloft())
    taken_by_b(bench)
    assert bench.flights() == [HOLD, GO_ON]
    bench.run(12.5)
    assert bench.flights() == [HOLD, GO_ON, GO_ON, GO_ON]
    assert [text for text in said(bench) if "again" in text] == [
        "CONTINUE is ordered again. The aircraft has not begun it, in AUTO"
    ]
    bench.motion = MotionSeen(8.0, 0.0, 300.0)
    bench.run(60.0)
    assert bench.flights() == [HOLD, GO_ON, GO_ON, GO_ON]
    assert bench.records("order")[-1].text == "CONTINUE: the autopilot follows, AUTO"


def test_whose_return_was_never_flown_goes_on_when_that_is_over() -> None:
    """The fault: held, then ordered home while the autopilot heard nothing; when another station took it that was over,
    and it stood there until its battery was empty. Found by a campaign."""
    bench = standing(aloft(Limits(hold_s=4.0)))
    bench.run(3.0)
    assert bench.flights() == [HOLD, BACK]
    taken_by_b(bench)
    bench.run(bench.limits.obey_s)  # until then the autopilot may have got it
    assert bench.flights()[-1] == GO_ON
    bench.motion = MotionSeen(8.0, 0.0, 300.0)
    bench.run(60.0)
    assert bench.flights()[-1] == GO_ON


def test_whose_return_was_never_flown_stands_until_the_station_that_takes_it_from_a_lost_commander_has_it() -> None:
    """The fault, found by exploration: it was told to go on while nobody commanded."""
    bench = standing(aloft(Limits(hold_s=4.0)))
    bench.run(3.0)
    assert bench.flights() == [HOLD, BACK]
    bench.alive = {B}
    bench.facts = (inside(A), inside(B))
    while bench.arbiter.view.commander is not None:
        bench.run(0.1)
    assert bench.arbiter.view.partner == B
    ordered = bench.flights()
    assert GO_ON not in ordered
    view = bench.arbiter.view
    key = TransferKey(A, B, view.handover_id, view.epoch)
    bench.say(B, OnHandover(key))
    bench.say(B, DroneConnected(key))
    assert bench.arbiter.view.commander == B
    assert bench.flights() == ordered
    bench.run(bench.limits.obey_s)
    assert bench.flights() == [*ordered, GO_ON]


def test_whose_return_is_flown_flies_it() -> None:
    bench = standing(aloft(Limits(hold_s=4.0)))
    bench.run(3.0)
    bench.mode, bench.motion = RTL, HOMEWARD
    bench.run(1.0)
    taken_by_b(bench)
    nearer(bench, 20.0, 8.0)
    assert bench.flights() == [HOLD, BACK]


class TestACommandBeforeTheOrder:
    """Flight 2000005551 of the campaign: AUTO out of RTL was obeyed, half a second later its commander was lost. The
    last heartbeat still said RTL; the next one said AUTO, which ended the return as if GCSA had chosen it since."""

    @staticmethod
    def loses_its_commander(mode: ModeSeen) -> Bench:
        """In `mode`, of the commander's own choice; then its links fall silent."""
        bench = aloft()
        bench.give(ModeSourceSeen(ModeSource.COMMANDER, mode.flown))
        bench.mode, bench.motion = mode, HOMEWARD
        bench.run(30.0)
        bench.alive = set()
        bench.run(4.5)
        assert bench.flights() == []
        return bench

    def test_ends_no_return(self) -> None:
        bench = self.loses_its_commander(RTL)
        bench.give(ModeSourceSeen(ModeSource.COMMANDER, ModeClass.MISSION))
        bench.run(0.5)  # the return is decided, and RTL is flown as far as is known
        assert any("RETURN" in text for text in said(bench))
        bench.mode = AUTO
        bench.run(1.0)
        assert HOME in bench.flights()
        assert not any("not commanded any more" in text for text in said(bench))
        bench.mode = RTL
        bench.run(30.0)
        assert bench.flights() == [HOME]

    def test_ends_no_return_that_was_sent(self) -> None:
        """The heartbeat between the command and the order comes after both."""
        bench = self.loses_its_commander(LOITER)
        bench.give(ModeSourceSeen(ModeSource.COMMANDER, ModeClass.MISSION))
        bench.run(0.5)
        assert bench.flights() == [HOME]
        bench.give(AUTO)
        bench.run(0.1)
        assert bench.arbiter._safety.verification.order is FlightAction.RETURN
        assert not any("not commanded any more" in text for text in said(bench))

    def test_ends_no_hold(self) -> None:
        bench = aloft()
        bench.give(ModeSourceSeen(ModeSource.COMMANDER, ModeClass.GUIDED))
        standing(bench)
        bench.mode = ModeSeen(ModeClass.GUIDED, "GUIDED")
        bench.run(2.0)
        assert bench.flights() == [HOLD]
        assert bench.arbiter._safety.verification.order is FlightAction.HOLD
        assert not any("not commanded any more" in text for text in said(bench))

    def test_a_command_after_the_order_ends_it(self) -> None:
        """As before: it is the word of a commander who knows of the order."""
        bench = aloft()
        bench.give(ConditionsSeen(energy=True))
        bench.run(3.0)
        bench.mode, bench.motion = RTL, HOMEWARD
        bench.run(5.0)
        assert [fly.action for fly in bench.flights()] == [FlightAction.RETURN]
        bench.give(ModeSourceSeen(ModeSource.COMMANDER, ModeClass.MISSION))
        bench.mode = AUTO
        bench.run(10.0)
        assert [fly.action for fly in bench.flights()] == [FlightAction.RETURN]


def test_who_is_told_to_stand_by_the_commander_is_not_told_to_go_on_again() -> None:
    bench = standing(aloft())
    taken_by_b(bench)
    bench.give(ModeSourceSeen(ModeSource.COMMANDER, ModeClass.STOP))
    bench.run(60.0)
    assert bench.flights() == [HOLD, GO_ON]


def test_whom_the_commander_sends_on_goes_on_though_his_command_changes_nothing() -> None:
    """AUTO within AUTO ends no pause of ArduCopter: nobody held it any more, and it stood for ever."""
    bench = standing(aloft())
    bench.run(3.0)
    bench.give(ModeSourceSeen(ModeSource.COMMANDER, ModeClass.MISSION))
    bench.run(5.5)
    assert bench.flights() == [HOLD]
    assert bench.arbiter.snapshot().stands  # so the next run would have it go on as well
    bench.run(1.0)
    assert [fly.action for fly in bench.flights()] == [FlightAction.HOLD, FlightAction.CONTINUE]
    bench.motion = MotionSeen(8.0, 0.0, 300.0)
    bench.run(120.0)
    assert [fly.action for fly in bench.flights()] == [FlightAction.HOLD, FlightAction.CONTINUE]


def test_a_hold_that_the_commander_overruled_is_not_followed_by_a_return() -> None:
    """It came when the time of that hold was over, when the border was crossed, and when no position came for 2 s."""
    bench = standing(aloft(Limits(hold_s=20.0)))
    bench.run(5.0)
    bench.give(ModeSourceSeen(ModeSource.COMMANDER, ModeClass.MISSION))
    bench.motion = MotionSeen(8.0, 0.0, 300.0)
    bench.run(60.0)
    assert bench.flights() == [HOLD]
    facts, bench.facts = bench.facts, None
    bench.run(2.6)
    bench.facts = facts
    bench.run(3.0)
    assert bench.flights() == [HOLD]


def test_what_the_autopilot_did_not_follow_counts_no_more_behind_the_commanders_word() -> None:
    """The next cause landed it where it was, though it was elsewhere and could return."""
    bench = aloft()
    supervision = bench.arbiter._safety.verification
    supervision.ordered(FlightAction.RETURN, bench.now)
    supervision.unable = frozenset({FlightAction.RETURN})
    bench.give(ModeSourceSeen(ModeSource.COMMANDER, ModeClass.GUIDED))
    bench.give(ModeSeen(ModeClass.GUIDED, "GUIDED", False, False))
    assert supervision.unable == frozenset()


def test_what_a_pilot_held_back_the_commander_can_overrule_at_once() -> None:
    """He was obeyed at the second time of asking: the return that a failsafe held back came at his first word."""
    bench = aloft()
    bench.mode = RTL
    bench.give(ModeSourceSeen(ModeSource.FAILSAFE))
    bench.run(2.0)
    bench.give(ConditionsSeen(energy=True))
    bench.run(10.0)
    assert bench.flights() == []
    bench.give(ModeSourceSeen(ModeSource.COMMANDER, ModeClass.MISSION))
    bench.mode = AUTO
    bench.run(10.0)
    assert bench.flights() == []


def test_a_return_out_of_a_hold_that_is_given_up_is_followed_by_a_landing() -> None:
    """Flight 1175909 of the campaign: with the end of the hold its time began anew, so that it could be held again as
    soon as the return was given up: milder than that, so it counted for nothing, and nothing more was ordered."""
    bench = standing(aloft(Limits(hold_s=4.0)))
    bench.run(3.0)
    assert bench.flights() == [HOLD, BACK]
    bench.run(14.0)
    assert bench.flights() == [HOLD, BACK, BACK, Fly(FlightAction.LAND, Reason.COVERAGE_ENDS)]


def test_a_return_out_of_a_hold_that_hangs_is_followed_by_a_landing() -> None:
    """The same where it flies RTL, and gets no nearer: who returns is not held, and that it could be is no reason."""
    bench = standing(aloft(Limits(hold_s=4.0)))
    bench.run(3.0)
    bench.mode, bench.motion = RTL, HOMEWARD
    bench.run(33.0)
    assert bench.flights() == [HOLD, BACK, Fly(FlightAction.LAND, Reason.COVERAGE_ENDS)]
