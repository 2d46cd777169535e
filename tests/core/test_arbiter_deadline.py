# SPDX-License-Identifier: GPL-3.0-or-later

"""`next_deadline` is never later than the next thing that happens.

The same story is told to two arbiters. One gets its ticks at `next_deadline()` alone, the other as well every few
milliseconds: both must do the same things at the same times. A deadline that comes too late, or that is missing,
makes the second one earlier.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from math import inf, nextafter

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from mavproxy_handover.core.arbiter import Arbiter, Identity
from mavproxy_handover.core.common.causes import Cause
from mavproxy_handover.core.common.events import (
    Action,
    AutopilotState,
    Cancel,
    ControlRequested,
    Event,
    Fly,
    LinkJudged,
    MissionLoaded,
    ModeSeen,
    ModeSourceSeen,
    MotionSeen,
    OrderRefused,
    PositionSeen,
    Record,
    Send,
    StationHeard,
    StationMessage,
    Tick,
)
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import FlightAction, ModeClass, ModeSource, Phase
from mavproxy_handover.core.common.snapshot import Snapshot
from tests.core.bench import (
    DIGEST,
    STATIONS,
    A,
    B,
    Bench,
    C,
    Connect,
    ConnectAck,
    Consent,
    DisconnectHandover,
    DroneConnected,
    OkHandover,
    OnHandover,
    TransferKey,
    inside,
    outside,
)

#: numbers that no binary fraction hits, so that every rounding shows
LIMITS = Limits(
    heartbeat_lost_s=1.7,
    connect_interval_s=2.3,
    connect_lost_s=4.9,
    step_timeout_s=1.3,
    operator_timeout_s=3.1,
    release_timeout_s=1.1,
    forced_timeout_s=0.9,
    retry_pause_s=0.7,
    result_timeout_s=2.9,
    dwell_s=0.9,
    hold_off_s={Cause.OUT_OF_COVERAGE: 0.7},
    position_stale_s=1.9,
    policies={Cause.COMMANDER_LOST: "warn", Cause.OUT_OF_COVERAGE: "land"},
)


@dataclass(frozen=True)
class Word:
    """A station's word about the transfer that is under way then, whatever its number."""

    station: int
    kind: type
    consent: Consent = Consent.GRANTED


def told(
    story: list[tuple[float, Event | Word]],
    limits: Limits,
    every_s: float | None,
    *,
    standard: Collection[int] = (),
    restored: Snapshot | None = None,
) -> list[tuple[float, Action]]:
    """What an arbiter makes of a story (waiting time, event); stations answer CONNECT while they are heard."""
    stations = tuple(replace(station, standard=station.sysid in standard) for station in STATIONS)
    arbiter = Arbiter(Identity("drone", stations, A), limits, restored)
    log: list[tuple[float, Action]] = []

    def give(event: Event, now: float) -> None:
        for action in arbiter.handle(event, now):
            log.append((now, action))
            if isinstance(action, Send) and isinstance(action.message, Connect):
                heard = arbiter.heard_ago_s(action.station, now)
                if heard is not None and heard < 0.5:
                    question = action.message
                    answer = ConnectAck(action.station, 1, question.nonce, question.epoch, None, "", DIGEST)
                    give(StationMessage(action.station, answer), now)

    def pass_time(now: float, until: float) -> None:
        fine = inf if every_s is None else now
        rounds = 0
        while True:
            deadline = arbiter.next_deadline()
            assert deadline is not None
            due = min(deadline, fine)
            if due > until:
                return
            now = max(now, due)
            give(Tick(), now)
            if now >= fine:
                fine = now + (every_s or inf)
            if arbiter.next_deadline() == now:  # a return is told with the event behind it
                give(Tick(), now)
            after = arbiter.next_deadline()
            assert after is not None
            # a deadline that stays where it is would be a loop without an end
            assert after > now
            rounds += 1
            assert rounds < 100_000

    now = 0.1
    give(AutopilotState(False, False), now)
    for wait_s, event in story:
        pass_time(now, now + wait_s)
        now += wait_s
        if isinstance(event, Word):
            view = arbiter.view
            key = TransferKey(view.commander or 0, view.partner or 0, view.handover_id, view.epoch)
            message = event.kind(key, event.consent) if event.kind in (OnHandover, OkHandover) else event.kind(key)
            give(StationMessage(event.station, message), now)
        else:
            give(event, now)
    pass_time(now, now + 12.0)
    return log


stations = st.sampled_from([A, B, C])
positions = st.builds(
    lambda a, b, c: PositionSeen((a, b, c)),
    st.sampled_from([inside(A), inside(A, exit_s=3.0), outside(A)]),
    st.sampled_from([inside(B), inside(B, exit_s=40.0), outside(B)]),
    st.sampled_from([inside(C), outside(C)]),
)
events = st.one_of(
    st.builds(StationHeard, stations),
    positions,
    st.sampled_from([AutopilotState(True, True), AutopilotState(True, False), AutopilotState(False, False)]),
    st.just(MissionLoaded(DIGEST, (A, B, A))),
    st.builds(Cancel, stations),
    st.builds(LinkJudged, stations, st.booleans(), st.just(False), st.just("")),
    st.builds(ControlRequested, stations, st.booleans(), st.booleans(), st.sampled_from([3.0, 3.7]), stations),
    st.builds(
        Word,
        stations,
        st.sampled_from([OnHandover, OkHandover, DroneConnected, DisconnectHandover]),
        st.sampled_from(Consent),
    ),
)
#: what the autopilot makes of orders
deeds = st.one_of(
    events,
    st.sampled_from(
        [
            ModeSeen(flown, flown.name)
            for flown in (ModeClass.MISSION, ModeClass.RETURN, ModeClass.LAND, ModeClass.HANDS)
        ]
    ),
    st.builds(
        MotionSeen,
        st.sampled_from([0.0, 7.3]),
        st.sampled_from([-1.1, 0.0, 2.0]),
        st.sampled_from([None, 3.0, 400.0, 420.0, 900.0]),
    ),
    st.builds(ModeSourceSeen, st.sampled_from([ModeSource.PILOT, ModeSource.COMMANDER, ModeSource.FAILSAFE])),
    st.builds(OrderRefused, st.sampled_from(FlightAction)),
)
waits = st.sampled_from([0.0, 0.0, 0.01, 0.13, 0.37, 0.71, 1.09, 2.03])
stories = st.lists(st.tuples(waits, events), max_size=25)

#: everybody there, on mission, inside A and B: a transfer is under way
IN_TRANSFER: list[tuple[float, Event | Word]] = [
    (0.0, StationHeard(A)),
    (0.0, StationHeard(B)),
    (0.0, MissionLoaded(DIGEST, (A, B, A))),
    (0.0, PositionSeen((inside(A), outside(B)))),
    (0.0, AutopilotState(True, True)),
    (1.1, StationHeard(A)),
    (0.0, StationHeard(B)),
    (0.0, PositionSeen((inside(A), inside(B)))),
]
#: the partner is lost before the commander, before its time is up, and between two questions
PARTNER_LOST: list[tuple[float, Event | Word]] = [*IN_TRANSFER[:-1], (0.9, StationHeard(A)), IN_TRANSFER[-1]]
TO_RELEASE: list[tuple[float, Event | Word]] = [
    *IN_TRANSFER,
    (0.1, Word(B, OnHandover)),
    (0.1, Word(A, OkHandover)),
    (0.1, Word(B, DroneConnected)),
]


#: in flight, with a mode, and the commander falls silent: it is brought home by the table
COMES_HOME: list[tuple[float, Event | Word]] = [
    *IN_TRANSFER[:-3],
    (0.0, ModeSeen(ModeClass.MISSION, "AUTO")),
    (0.0, MotionSeen(7.3, 0.0, 400.0)),
    (1.8, AutopilotState(True, True)),
]
#: the commander is back, and the aircraft lands before the return that was ordered has to show
OVER_ON_THE_GROUND: list[tuple[float, Event | Word]] = [
    (0.37, StationHeard(A)),
    (0.37, StationHeard(A)),
    (0.0, AutopilotState(True, False)),
]
SUPERVISED = replace(LIMITS, policies={}, obey_s=2.3, stuck_s=3.7, hold_s=4.1, autopilot_lost_s=20.0)


def test_the_stories_begin_where_they_say() -> None:
    def words(story: list[tuple[float, Event | Word]]) -> list[str]:
        return [a.event for _at, a in told(story, LIMITS, None) if isinstance(a, Record) and a.event != "connected"]

    assert "transfer_begun" in words(IN_TRANSFER)
    assert "transfer_committed" in words(TO_RELEASE)
    assert "result_unacknowledged" in words([*TO_RELEASE, (0.1, Word(A, DisconnectHandover))])
    assert "position_stale" in words(IN_TRANSFER)
    lost = [at for at, a in told(PARTNER_LOST, LIMITS, None) if isinstance(a, Record) and a.event == "transfer_aborted"]
    assert lost == [pytest.approx(0.1 + 1.1 + 1.7)]


@pytest.mark.slow
@settings(max_examples=80, deadline=None)
@given(stories, st.sampled_from([0.05, 0.0937]))
@example(PARTNER_LOST, 0.05)
@example([*IN_TRANSFER, (0.4, StationHeard(A)), (1.0, StationHeard(A))], 0.05)
@example([*TO_RELEASE, (0.1, Word(A, DisconnectHandover))], 0.05)  # result repeated and given up
@example([*IN_TRANSFER, (0.1, PositionSeen((outside(A), outside(B))))], 0.05)  # out, then lost, policies differ
def test_ticks_between_the_deadlines_change_nothing(story: list[tuple[float, Event | Word]], every_s: float) -> None:
    assert told(story, LIMITS, every_s) == told(story, LIMITS, None)


@pytest.mark.slow
@settings(max_examples=80, deadline=None)
@given(st.lists(st.tuples(waits, deeds), max_size=25), st.sampled_from([0.05, 0.0937]))
@example([(0.0, AutopilotState(True, True))], 0.05)  # it does not follow, is told again, and is given up
@example([(0.1, ModeSeen(ModeClass.RETURN, "RTL"))], 0.05)  # it follows, and gets nowhere
@example([(0.1, ModeSeen(ModeClass.RETURN, "RTL")), (1.0, MotionSeen(0.0, 2.0, 400.0))], 0.05)
@example([(0.0, ModeSeen(ModeClass.LAND, "LAND")), (0.01, ModeSeen(ModeClass.RETURN, "RTL"))], 0.05)
@example([(0.0, ModeSeen(ModeClass.HANDS, "LOITER")), (0.0, AutopilotState(True, False))], 0.05)  # lands in doubt
@example(OVER_ON_THE_GROUND, 0.05)
def test_the_same_while_an_order_is_watched(story: list[tuple[float, Event | Word]], every_s: float) -> None:
    told_before = COMES_HOME + story
    assert told(told_before, SUPERVISED, every_s) == told(told_before, SUPERVISED, None)


def test_an_order_that_is_not_followed_is_given_up_by_the_deadlines_alone() -> None:
    def orders(*story: tuple[float, Event | Word]) -> list[tuple[float, FlightAction]]:
        log = told([*COMES_HOME, *story], SUPERVISED, None)
        return [(at, action.action) for at, action in log if isinstance(action, Fly)]

    lost_at = 0.3 + 1.7  # it has missed a question, is asked again soon, and answers
    assert orders() == [
        (pytest.approx(lost_at), FlightAction.RETURN),
        (pytest.approx(lost_at + 2.3), FlightAction.RETURN),
        (pytest.approx(lost_at + 4.6), FlightAction.LAND),
        (pytest.approx(lost_at + 6.9), FlightAction.LAND),
        (pytest.approx(lost_at + 9.2), FlightAction.LAND),
        (pytest.approx(lost_at + 11.5), FlightAction.LAND),
    ]
    stuck = orders((0.1, ModeSeen(ModeClass.RETURN, "RTL")))
    seen_at = 0.1 + 1.8 + 0.1
    assert stuck[1] == (pytest.approx(seen_at + 3.7), FlightAction.LAND)


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(stories, st.sampled_from([0.05, 0.0937]))
def test_the_same_from_the_middle_of_a_transfer(story: list[tuple[float, Event | Word]], every_s: float) -> None:
    assert told(IN_TRANSFER + story, LIMITS, every_s) == told(IN_TRANSFER + story, LIMITS, None)


#: in flight, just restarted: GCSA is awaited, or nobody is
RESTORED = Snapshot(A, 4, 7, Phase.ON_MISSION, 0, DIGEST, (A, B, A))


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(
    stories,
    st.sets(stations),
    st.sampled_from([RESTORED, replace(RESTORED, owner=None), replace(RESTORED, phase=Phase.EMERGENCY, owner=B)]),
)
def test_the_same_after_a_restart(story: list[tuple[float, Event | Word]], standard: set[int], left: Snapshot) -> None:
    fine = told(story, LIMITS, 0.05, standard=standard, restored=left)
    assert fine == told(story, LIMITS, None, standard=standard, restored=left)


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(stories, st.sets(stations))
def test_the_same_with_standard_stations(story: list[tuple[float, Event | Word]], standard: set[int]) -> None:
    told_before = IN_TRANSFER + story
    fine = told(told_before, LIMITS, 0.05, standard=standard)
    assert fine == told(told_before, LIMITS, None, standard=standard)


def test_at_first_everybody_is_to_be_asked_at_once() -> None:
    assert Arbiter(Identity("drone", STATIONS, A)).next_deadline() == -inf


@pytest.mark.parametrize(
    ("prepare", "event", "after_s"),
    [
        # a deadline for each thing that time brings about; CONNECT is out of the way
        (lambda b: b.up_to("REQUEST"), "transfer_aborted", 4.0),
        (lambda b: b.up_to("RELEASE"), "transfer_committed", 2.0),
        (lambda b: b.on_mission().position(outside(A), outside(B)), "emergency", 1.0),
    ],
)
def test_time_brings_it_about_to_the_very_tick(prepare: object, event: str, after_s: float) -> None:
    limits = replace(Limits(), heartbeat_lost_s=60.0, connect_interval_s=10.0, connect_lost_s=60.0, deaf_lost_s=60.0)
    bench = Bench(limits)
    prepare(bench)  # type: ignore[operator]
    due = bench.now + after_s
    bench.now = nextafter(due, 0.0)
    assert not [a for a in bench.give(Tick()) if isinstance(a, Record) and a.event == event]
    deadline = bench.arbiter.next_deadline()
    assert deadline is not None
    assert deadline <= due
    bench.now = due
    assert [a for a in bench.give(Tick()) if isinstance(a, Record) and a.event == event]
