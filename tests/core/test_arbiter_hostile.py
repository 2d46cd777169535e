# SPDX-License-Identifier: GPL-3.0-or-later

"""Stations that say anything at any time: the arbiter neither raises nor gives authority away.

The invariants are those of `watch.py`; the bench checks them after every event.
"""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mavproxy_handover.core.authority.transfer import Step
from mavproxy_handover.core.common.events import (
    AutopilotState,
    Cancel,
    ControlRequested,
    Event,
    GuardSeen,
    LinkJudged,
    MissionLoaded,
    PositionSeen,
    Send,
    StartFinished,
    StartRequested,
    StationHeard,
    StationMessage,
    Tick,
)
from mavproxy_handover.core.common.messages import Message
from mavproxy_handover.core.common.model import GuardState, ZoneFact
from tests.core.bench import (
    DIGEST,
    KEY,
    A,
    B,
    Bench,
    C,
    Connect,
    ConnectAck,
    ConnectHandover,
    Consent,
    D,
    DisconnectHandover,
    DroneConnected,
    HandoverRequest,
    HandoverResult,
    OkHandover,
    OnHandover,
    Outcome,
    Phase,
    Reason,
    TransferKey,
)

sysids = st.sampled_from([A, B, C, D, 0, 1, 99, 255])
epochs = st.sampled_from([0, 1, 1, 1, 2, 2, 3, 0xFFFFFFFE, 0xFFFFFFFF])
keys = st.one_of(
    st.sampled_from([KEY, KEY, KEY, TransferKey(B, A, 2, 2), TransferKey(B, C, 2, 2)]),
    st.builds(TransferKey, sysids, sysids, st.sampled_from([0, 1, 1, 2, 3, 65535]), epochs),
)
consents = st.sampled_from(Consent)
reasons = st.sampled_from(Reason)
commanders = st.one_of(st.none(), sysids)
digests = st.sampled_from([b"", bytes(32), DIGEST])
nonces = st.one_of(st.sampled_from([0, 1, 0xFFFFFFFF]), st.integers(995, 1030))
versions = st.sampled_from([0, 1, 1, 1, 2, 255])
names = st.sampled_from(["", "GCSA", "x" * 20])
messages: st.SearchStrategy[Message] = st.one_of(
    st.builds(OnHandover, keys, consents, reasons, st.booleans(), st.booleans()),
    st.builds(OkHandover, keys, consents, reasons),
    st.builds(DroneConnected, keys, st.booleans(), st.booleans()),
    st.builds(DisconnectHandover, keys),
    st.builds(HandoverRequest, keys, reasons),
    st.builds(ConnectHandover, keys),
    st.builds(HandoverResult, keys, commanders, st.sampled_from(Outcome), reasons),
    st.builds(Connect, sysids, versions, nonces, epochs, commanders, names, digests),
    st.builds(ConnectAck, sysids, versions, nonces, epochs, commanders, names, digests, st.booleans()),
)
margins = st.sampled_from([-1e9, -5.0, 0.0, 5.0, 300.0, float("inf"), float("-inf"), float("nan")])
exits = st.sampled_from([None, 0.0, 3.0, 8.0, 100.0, float("inf"), float("nan")])
facts = st.builds(ZoneFact, sysids, margins, exits)
seconds = st.sampled_from([0.0, 10.0, 61.0, -1.0, float("inf"), float("nan")])
events: st.SearchStrategy[Event] = st.one_of(
    st.builds(ControlRequested, sysids, st.booleans(), st.booleans(), seconds, sysids),
    st.builds(LinkJudged, sysids, st.booleans(), st.booleans(), st.just("")),
    st.builds(StationMessage, sysids, messages),
    st.builds(StationMessage, sysids, messages),
    st.builds(StationHeard, sysids),
    st.builds(Cancel, sysids),
    st.builds(StartRequested, sysids),
    st.builds(StartFinished, st.booleans(), st.just("")),
    st.builds(AutopilotState, st.booleans(), st.booleans()),
    st.builds(GuardSeen, st.sampled_from(GuardState), st.booleans()),
    st.builds(MissionLoaded, digests, st.lists(sysids, max_size=4).map(tuple)),
    st.builds(PositionSeen, st.lists(facts, max_size=5).map(tuple)),
    st.just(Tick()),
)
waits = st.sampled_from([0.0, 0.0, 0.0, 0.1, 0.6, 2.1, 5.1])


#: instead of an event: the companion is started anew
RESTART = "restart"


@pytest.mark.slow
@settings(max_examples=100, deadline=None)
@given(
    st.lists(st.tuples(waits, st.one_of(events, st.just(RESTART))), max_size=40),
    st.sets(st.sampled_from([A, B, C])),
)
def test_anything_from_the_start(story: list[tuple[float, Event | str]], standard: set[int]) -> None:
    bench = Bench(standard=standard)
    bench.alive = set()
    for wait_s, event in story:
        if isinstance(event, str):
            bench.restart(wait_s)
        else:
            bench.now += wait_s
            bench.give(event)


@pytest.mark.slow
@settings(max_examples=80, deadline=None)
@given(
    st.sampled_from([step.name for step in Step]),
    st.lists(st.tuples(waits, st.one_of(events, st.just(RESTART))), max_size=25),
    st.booleans(),
)
def test_anything_in_a_transfer(step: str, story: list[tuple[float, Event | str]], lively: bool) -> None:
    bench = Bench().up_to(step)
    for wait_s, event in story:
        if isinstance(event, str):
            bench.restart(wait_s)
            continue
        if lively:
            bench.run(wait_s)
        else:
            bench.now += wait_s  # no ticks, no heartbeats: a companion that was held up
        bench.give(event)


@pytest.mark.slow
@settings(max_examples=80, deadline=None)
@given(st.lists(st.tuples(st.sampled_from([C, D]), messages), max_size=40), st.sampled_from([s.name for s in Step]))
def test_third_stations_cannot_touch_a_transfer(words: list[tuple[int, Message]], step: str) -> None:
    bench = Bench().up_to(step)
    before, deadline_words = bench.arbiter.view, bench.arbiter._authority.transfer
    for station, word in words:
        bench.say(station, word)
    assert bench.arbiter.view == before
    assert bench.arbiter._authority.transfer is deadline_words
    assert bench.arbiter._authority.transfer is not None
    assert bench.arbiter._authority.transfer.step.name == step
    assert {station for _at, station, _m, _attempt in bench.sent()} <= {A, B}


@pytest.mark.slow
@settings(max_examples=80, deadline=None)
@given(st.lists(st.tuples(st.sampled_from([B, C, D]), messages), max_size=40), st.sampled_from([s.name for s in Step]))
def test_the_partner_cannot_take_what_the_commander_has_not_consented_to(
    words: list[tuple[int, Message]], step: str
) -> None:
    if step not in ("REQUEST", "CONSENT"):
        return
    bench = Bench().up_to(step)
    for station, word in words:
        bench.say(station, word)
        assert bench.arbiter.view.commander == A
        assert bench.arbiter.view.epoch == 1


@pytest.mark.slow
@settings(max_examples=80, deadline=None)
@given(st.lists(st.tuples(st.sampled_from([A, C, D]), messages), max_size=40), st.sampled_from([s.name for s in Step]))
def test_the_commander_cannot_press_authority_on_a_partner_that_has_not_confirmed(
    words: list[tuple[int, Message]], step: str
) -> None:
    if step == "RELEASE":
        return
    bench = Bench().up_to(step)
    for station, word in words:
        bench.say(station, word)
        assert bench.arbiter.view.commander == A
        assert bench.arbiter.view.epoch == 1


class TestByName:
    """The tricks one would try first."""

    def test_consent_from_the_partner(self) -> None:
        bench = Bench().up_to("CONSENT")
        bench.say(B, OkHandover(KEY))
        bench.say(B, DroneConnected(KEY))
        bench.say(B, DisconnectHandover(KEY))
        assert bench.arbiter.view.commander == A
        assert bench.dropped() == {"not the sender's to say": 2}

    def test_disconnect_before_anything(self) -> None:
        bench = Bench().on_ground()
        for station in (A, B, C):
            bench.say(station, DisconnectHandover(KEY))
            bench.say(station, DisconnectHandover(TransferKey(A, station, 0, 1)))
        assert bench.arbiter.view.commander == A
        assert bench.arbiter.view.phase is Phase.ON_LOAD

    def test_connect_ack_with_a_huge_epoch(self) -> None:
        bench = Bench().up_to("CONNECT")
        for station in (A, B, C):
            bench.say(station, ConnectAck(station, 1, 0, 0xFFFFFFFF, station, "x", DIGEST))
        bench.run(1.0)
        asked = [a.message for _at, a in bench.log if isinstance(a, Send) and isinstance(a.message, Connect)]
        assert {question.epoch for question in asked} == {1}

    def test_an_honest_nonce_with_a_lie_about_who_commands(self) -> None:
        bench = Bench().on_mission()
        bench.alive.discard(B)
        bench.run(3.0)
        question = next(
            a.message
            for _at, a in reversed(bench.log)
            if isinstance(a, Send) and isinstance(a.message, Connect) and a.station == B
        )
        bench.say(B, replace(bench.ack(B, question), commander=B, epoch=99))
        assert bench.arbiter.view.commander == A
        assert bench.arbiter.view.epoch == 1

    def test_acknowledging_a_result_beforehand(self) -> None:
        # the result is repeated to a station until it shows the epoch after the commit, whatever it has shown before
        bench = Bench().up_to("RELEASE")
        bench.say(B, ConnectAck(B, 1, 0, 0xFFFFFFFF, B, "GCSB", DIGEST))
        bench.say(A, DisconnectHandover(KEY))
        bench.log.clear()
        bench.run(0.25)
        assert [station for _at, station, _m, _attempt in bench.sent()] == [A, B]

    def test_a_flood_of_answers_does_not_keep_a_dead_way_alive(self) -> None:
        # B hears nothing of the vehicle and repeats an old answer for ever
        bench = Bench().on_mission()
        old = bench.arbiter._presence[B].answer
        assert old is not None
        bench.deaf = {B}
        for _ in range(30):
            bench.run(0.25)
            bench.say(B, old)
        assert not bench.arbiter.connected(B, bench.now)

    @pytest.mark.parametrize("step", [step.name for step in Step])
    def test_a_commander_that_stops_talking_but_lives_keeps_nothing_up_for_ever(self, step: str) -> None:
        bench = Bench().up_to(step)
        bench.run(4.5)
        assert bench.arbiter.view.partner is None
        assert bench.arbiter.view.commander == (B if step == "RELEASE" else A)

    def test_a_partner_that_always_asks_for_more_time(self) -> None:
        bench = Bench().up_to("REQUEST")
        ended = False
        for _ in range(400):
            bench.run(0.1)
            bench.say(B, OnHandover(KEY, Consent.WAITING))
            ended = ended or bench.arbiter.view.partner is None
        assert ended
