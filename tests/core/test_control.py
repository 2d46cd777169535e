# SPDX-License-Identifier: GPL-3.0-or-later

"""Requests of operator control: the table of `judge_control`, what the arbiter makes of it, and the known traps."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from itertools import product

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.authority.control import ControlDecision, ControlFacts, Echo, Effect, judge_control
from mavproxy_handover.core.common.events import (
    Action,
    ControlAnswer,
    ControlRequested,
    ControlResult,
    NotifyOwner,
    Record,
    Send,
    ViewChanged,
)
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import AuthorityView, LeaseState, ZoneFact
from mavproxy_handover.gate.judge import StationIdentity
from mavproxy_handover.operator.requests.operator_control import read_request
from mavproxy_handover.wire.status import control_status
from tests.core.bench import (
    A,
    B,
    Bench,
    C,
    Connect,
    ConnectHandover,
    Consent,
    D,
    DisconnectHandover,
    DroneConnected,
    HandoverRequest,
    OkHandover,
    OnHandover,
    Phase,
    Reason,
    TransferKey,
    inside,
    outside,
)

ACCEPTED, DENIED, PENDING = ControlResult.ACCEPTED, ControlResult.DENIED, ControlResult.PENDING
NOBODY_WAITS = "nobody waits"


def asks(
    station: int, *, takeover: bool = False, give_to: int | None = None, timeout_s: float = 10.0
) -> ControlRequested:
    return ControlRequested(station, True, takeover, timeout_s, give_to or station)


def releases(station: int, *, takeover: bool = False) -> ControlRequested:
    return ControlRequested(station, False, takeover, 0.0, station)


#: In flight, A commands, nothing is under way, whoever is to have control could have it.
FLYING = ControlFacts(
    commander=A,
    lost=False,
    recovering=False,
    grounded=False,
    waiting_for=None,
    takeover_allowed=False,
    known=True,
    unfit=None,
    in_zone=True,
    name="GCSB",
)
GROUND = replace(FLYING, grounded=True, in_zone=False)
LOST = replace(FLYING, commander=None, lost=True)
RESTARTED = replace(LOST, recovering=True)
NEVER_HAD = replace(FLYING, commander=None)
NOBODY_ON_GROUND = replace(GROUND, commander=None)


NOT_HEARD = "GCSB does not answer. Check its program and its link"
ANOTHER_MISSION = "GCSB has another mission. Send it with 'handover share'"
ANOTHER_VERSION = "GCSB has another version of the handover module. Install the vehicle's version"


def no(text: str) -> ControlDecision:
    return ControlDecision(DENIED, Effect.NOTHING, text)


def yes(effect: Effect) -> ControlDecision:
    return ControlDecision(ACCEPTED, effect)


SECOND_WAITER = no("another handover is under way")
NOT_ITS = no("only the commander can release")
THIRD = no("only the commander can ask for another station")
IS_OVER = no("the transfer that was asked about is over")
AWAITED = no("the commander may come back after the restart")

#: what is asked, what holds, and the answer
TABLE: list[tuple[str, ControlRequested, ControlFacts, ControlDecision]] = [
    # the commander, for itself
    ("allows takeover", asks(A, takeover=True), FLYING, yes(Effect.SET_TAKEOVER)),
    ("disallows takeover", asks(A), replace(FLYING, takeover_allowed=True), yes(Effect.SET_TAKEOVER)),
    ("disallows it again", asks(A), FLYING, yes(Effect.SET_TAKEOVER)),
    ("allows it on the ground", asks(A, takeover=True), GROUND, yes(Effect.SET_TAKEOVER)),
    ("consents", asks(A, takeover=True), replace(FLYING, waiting_for=B), yes(Effect.CONSENT)),
    ("consents on the ground", asks(A, takeover=True), replace(GROUND, waiting_for=B), yes(Effect.CONSENT)),
    ("denies", asks(A), replace(FLYING, waiting_for=B), yes(Effect.DENY)),
    ("denies on the ground", asks(A), replace(GROUND, waiting_for=B), yes(Effect.DENY)),
    ("consents to what it has not read", asks(A, takeover=True), replace(FLYING, waiting_for=B, just_changed=True),
     IS_OVER),
    ("denies what it has not read", asks(A), replace(FLYING, waiting_for=B, just_changed=True), IS_OVER),
    ("consents to what is over", asks(A, takeover=True), replace(FLYING, just_changed=True), IS_OVER),
    ("denies what is over", asks(A), replace(FLYING, just_changed=True), yes(Effect.SET_TAKEOVER)),
    ("gives to who waits, by name", asks(A, give_to=B), replace(FLYING, waiting_for=B, just_changed=True),
     yes(Effect.CONSENT)),
    # the commander, for another
    ("gives", asks(A, give_to=B), FLYING, yes(Effect.GIVE)),
    ("gives with takeover set", asks(A, give_to=B, takeover=True), FLYING, yes(Effect.GIVE)),
    ("gives on the ground", asks(A, give_to=B), GROUND, yes(Effect.GIVE)),
    ("gives to who waits", asks(A, give_to=B), replace(FLYING, waiting_for=B), yes(Effect.CONSENT)),
    ("gives to who waits, out of zone", asks(A, give_to=B), replace(FLYING, waiting_for=B, in_zone=False),
     yes(Effect.CONSENT)),
    ("gives while another waits", asks(A, give_to=B), replace(FLYING, waiting_for=C), SECOND_WAITER),
    ("gives while another asks", asks(A, give_to=B), replace(FLYING, waiting_for=C, yields=True), yes(Effect.GIVE)),
    ("gives just after it came to nothing", asks(A, give_to=B), replace(FLYING, paused_s=7.2), yes(Effect.GIVE)),
    ("gives to a stranger", asks(A, give_to=99), replace(FLYING, known=False), no("unknown station")),
    ("gives to a silent one", asks(A, give_to=B), replace(FLYING, unfit=Reason.PARTNER_SILENT), no(NOT_HEARD)),
    ("gives to another mission", asks(A, give_to=B), replace(FLYING, unfit=Reason.MISSION_DIFFERS),
     no(ANOTHER_MISSION)),
    ("gives to another mission on the ground", asks(A, give_to=B), replace(GROUND, unfit=Reason.MISSION_DIFFERS),
     yes(Effect.GIVE)),
    ("gives to another version", asks(A, give_to=B), replace(GROUND, unfit=Reason.VERSION_DIFFERS),
     no(ANOTHER_VERSION)),
    ("gives out of its zone", asks(A, give_to=B), replace(FLYING, in_zone=False),
     no("the aircraft is outside the zone of GCSB")),
    # the commander lets go
    ("releases on the ground", releases(A), GROUND, yes(Effect.RELEASE)),
    ("releases in flight", releases(A), FLYING, yes(Effect.OFFER)),
    ("releases in flight to who waits", releases(A), replace(FLYING, waiting_for=B), yes(Effect.OFFER)),
    ("releases on the ground to who waits", releases(A), replace(GROUND, waiting_for=B), yes(Effect.OFFER)),
    ("releases in flight, none in zone", releases(A), replace(FLYING, in_zone=False), yes(Effect.OFFER)),
    # another station, while somebody commands
    ("asks", asks(B), FLYING, ControlDecision(PENDING, Effect.TRANSFER)),
    ("asks on the ground", asks(B), GROUND, ControlDecision(PENDING, Effect.TRANSFER)),
    ("asks, takeover its own", asks(B, takeover=True), FLYING, ControlDecision(PENDING, Effect.TRANSFER)),
    ("asks where takeover is allowed", asks(B), replace(FLYING, takeover_allowed=True),
     yes(Effect.TRANSFER_CONSENTED)),
    ("asks again", asks(B), replace(FLYING, waiting_for=B), ControlDecision(PENDING)),
    ("asks again, allowed meanwhile", asks(B), replace(FLYING, waiting_for=B, takeover_allowed=True),
     yes(Effect.CONSENT)),
    ("asks while another waits", asks(B), replace(FLYING, waiting_for=C), SECOND_WAITER),
    ("asks while another waits, takeover allowed", asks(B), replace(FLYING, waiting_for=C, takeover_allowed=True),
     SECOND_WAITER),
    ("asks while the commander gives", asks(B), replace(FLYING, waiting_for=C, yields=True), SECOND_WAITER),
    ("asks just after it came to nothing", asks(B), replace(FLYING, paused_s=7.2), no("too soon: again in 8 s")),
    ("the same, takeover allowed", asks(B), replace(FLYING, paused_s=0.1, takeover_allowed=True),
     no("too soon: again in 1 s")),
    ("the same, no station commands", asks(B), replace(LOST, paused_s=7.2), ControlDecision(PENDING, Effect.FORCE)),
    ("the same, on the ground", asks(B), replace(NOBODY_ON_GROUND, paused_s=7.2), yes(Effect.GRANT)),
    ("asks, position not known", asks(B), replace(FLYING, position_known=False), no("no position of the aircraft")),
    ("the same, on the ground", asks(B), replace(GROUND, position_known=False),
     ControlDecision(PENDING, Effect.TRANSFER)),
    ("asks after the loss, position not known", asks(B), replace(LOST, position_known=False),
     no("no position of the aircraft")),
    ("asks, unfit", asks(B), replace(FLYING, unfit=Reason.MISSION_DIFFERS), no(ANOTHER_MISSION)),
    ("asks, unfit, takeover allowed", asks(B), replace(FLYING, unfit=Reason.PARTNER_SILENT, takeover_allowed=True),
     no(NOT_HEARD)),
    ("asks out of its zone", asks(B), replace(FLYING, in_zone=False), no("the aircraft is outside the zone of GCSB")),
    ("asks out of its zone, takeover allowed", asks(B), replace(FLYING, in_zone=False, takeover_allowed=True),
     no("the aircraft is outside the zone of GCSB")),
    ("asks for a third", asks(B, give_to=C), FLYING, THIRD),
    ("asks for a third, takeover allowed", asks(B, give_to=C), replace(FLYING, takeover_allowed=True), THIRD),
    ("asks for the commander", asks(B, give_to=A), FLYING, THIRD),
    ("asks for a third who waits", asks(B, give_to=C), replace(FLYING, waiting_for=C), THIRD),
    ("releases what it has not", releases(B), FLYING, NOT_ITS),
    ("releases what it waits for", releases(B), replace(FLYING, waiting_for=B), NOT_ITS),
    ("releases on the ground what it has not", releases(B), GROUND, NOT_ITS),
    # no station commands
    ("asks on the ground, nobody there", asks(B), NOBODY_ON_GROUND, yes(Effect.GRANT)),
    ("the same after a loss", asks(B), replace(NOBODY_ON_GROUND, lost=True), yes(Effect.GRANT)),
    ("the same just after a restart", asks(B), replace(NOBODY_ON_GROUND, lost=True, recovering=True), AWAITED),
    ("asks on the ground, unfit", asks(B), replace(NOBODY_ON_GROUND, unfit=Reason.VERSION_DIFFERS),
     no(ANOTHER_VERSION)),
    ("asks on the ground, with another mission", asks(B), replace(NOBODY_ON_GROUND, unfit=Reason.MISSION_DIFFERS),
     yes(Effect.GRANT)),
    ("asks after the loss, with another mission", asks(B), replace(LOST, unfit=Reason.MISSION_DIFFERS),
     no(ANOTHER_MISSION)),
    ("asks after the loss", asks(B), LOST, ControlDecision(PENDING, Effect.FORCE)),
    ("asks after the loss, takeover was allowed", asks(B), replace(LOST, takeover_allowed=True),
     ControlDecision(PENDING, Effect.FORCE)),
    ("asks after the loss, out of its zone", asks(B), replace(LOST, in_zone=False),
     no("the aircraft is outside the zone of GCSB")),
    ("asks after the loss, another is at it", asks(B), replace(LOST, waiting_for=C), SECOND_WAITER),
    ("asks after the loss, is at it", asks(B), replace(LOST, waiting_for=B), ControlDecision(PENDING)),
    ("asks just after a restart", asks(B), RESTARTED, AWAITED),
    ("the same, takeover was allowed", asks(B), replace(RESTARTED, takeover_allowed=True), AWAITED),
    ("asks in flight, nobody ever commanded", asks(B), NEVER_HAD, no("there is no commander to follow")),
    ("releases what nobody has", releases(B), NOBODY_ON_GROUND, NOT_ITS),
    ("releases what was lost", releases(B), LOST, NOT_ITS),
    ("asks for another, nobody there", asks(B, give_to=C), NOBODY_ON_GROUND, THIRD),
]  # fmt: skip


class TestTable:
    @pytest.mark.parametrize(
        ("request_", "facts", "decision"), [row[1:] for row in TABLE], ids=[row[0] for row in TABLE]
    )
    def test_row(self, request_: ControlRequested, facts: ControlFacts, decision: ControlDecision) -> None:
        assert judge_control(request_, facts) == decision

    def test_every_effect_is_in_the_table(self) -> None:
        assert {row[3].effect for row in TABLE} == set(Effect)

    def test_it_is_total_and_gives_nothing_away(self) -> None:
        """Every combination: what must never come out of any."""
        flags = (False, True)
        counted = 0
        for station, request, takeover, give_to in product((A, B, C), flags, flags, (A, B, C)):
            asked = ControlRequested(station, request, takeover, 10.0, give_to if request else station)
            for commander, lost, recovering, grounded, allowed, known, in_zone in product((None, A), *[flags] * 6):
                unfits = (None, Reason.PARTNER_SILENT, Reason.MISSION_DIFFERS)
                for waiting_for, unfit in product((None, A, B, C), unfits):
                    facts = ControlFacts(
                        commander, lost, recovering, grounded, waiting_for, allowed, known, unfit, in_zone
                    )
                    decision = judge_control(asked, facts)
                    counted += 1
                    self._check(asked, facts, decision)
        assert counted == 3 * 2 * 2 * 3 * 2**7 * 12

    @staticmethod
    def _check(asked: ControlRequested, facts: ControlFacts, decision: ControlDecision) -> None:
        of_commander = asked.station == facts.commander
        effect = decision.effect
        assert (decision.result is DENIED) is (decision.text != "")
        if decision.result is DENIED:
            assert effect is Effect.NOTHING
        if not of_commander:
            assert effect not in (Effect.RELEASE, Effect.OFFER, Effect.SET_TAKEOVER, Effect.DENY)
            assert asked.request or decision.result is DENIED
            assert asked.for_station == asked.station or decision.result is DENIED
            # without the commander's word, given beforehand, nothing counts as its consent
            if effect in (Effect.CONSENT, Effect.TRANSFER_CONSENTED):
                assert facts.takeover_allowed
        if effect in (Effect.GRANT, Effect.FORCE):
            assert facts.commander is None
            assert not facts.recovering
            assert facts.unfit is None or (facts.grounded and facts.unfit is Reason.MISSION_DIFFERS)
            assert facts.known
        if effect is Effect.GRANT:
            assert facts.grounded
        if effect is Effect.FORCE:
            assert facts.lost
            assert facts.in_zone
        if effect is Effect.RELEASE:
            assert facts.grounded
        if effect in (Effect.TRANSFER, Effect.TRANSFER_CONSENTED, Effect.GRANT, Effect.FORCE):
            assert facts.waiting_for is None, "one transfer at a time"
        if effect in (Effect.CONSENT, Effect.DENY):
            assert facts.waiting_for is not None


# ---- the arbiter --------------------------------------------------------------------------------------------------


def answers(actions: list[Action]) -> list[ControlAnswer]:
    return [action for action in actions if isinstance(action, ControlAnswer)]


def questions(bench: Bench) -> list[tuple[float, NotifyOwner]]:
    return [(at, action) for at, action in bench.log if isinstance(action, NotifyOwner)]


def flight(
    *,
    standard: Collection[int] = (),
    facts: tuple[ZoneFact, ...] = (inside(A), inside(B), outside(C), outside(D)),
) -> Bench:
    """On mission under GCSA, inside these zones, and nothing under way: they were entered on the ground."""
    bench = Bench(standard=standard)
    bench.alive = {A, B, C}
    bench.on_ground()
    bench.position(*facts)
    bench.autopilot_says(armed=True, flying=True)
    bench.run(10.0)
    assert bench.arbiter.view == AuthorityView(Phase.ON_MISSION, A, None, 1, LeaseState.HELD, True, 0)
    bench.log.clear()
    return bench


def key(bench: Bench, owner: int = A) -> TransferKey:
    view = bench.arbiter.view
    assert view.partner is not None
    return TransferKey(owner, view.partner, view.handover_id, view.epoch)


class TestRequest:
    def test_a_request_starts_the_same_transfer_as_a_zone(self) -> None:
        bench = flight()
        actions = bench.give(asks(B))
        assert answers(actions) == [ControlAnswer(B, PENDING)]
        first = TransferKey(A, B, 1, 1)
        assert [message for _at, _station, message, _attempt in bench.sent()] == [
            HandoverRequest(first, Reason.REQUESTED)
        ]
        bench.say(B, OnHandover(first))
        bench.say(A, OkHandover(first))
        bench.say(B, DroneConnected(first))
        bench.say(A, DisconnectHandover(first))
        assert bench.arbiter.view == AuthorityView(Phase.ON_MISSION, B, None, 2, LeaseState.HELD, True, 1)
        assert bench.records("transfer_committed")[0].reason is Reason.REQUESTED

    def test_what_was_asked_and_answered_is_journalled(self) -> None:
        bench = flight()
        bench.give(asks(B))
        bench.give(asks(C))
        bench.give(releases(C))
        assert bench.records("control") == [
            Record("control", "GCSB requests control: pending", Reason.OPERATOR, B),
            Record("control", "GCSC requests control: denied (another handover is under way)", Reason.OPERATOR, C),
            Record("control", "GCSC releases control: denied (only the commander can release)", Reason.OPERATOR, C),
        ]

    def test_without_consent_nothing_moves(self) -> None:
        bench = flight()
        bench.give(asks(B))
        bench.say(B, OnHandover(key(bench)))
        bench.run(30.0)
        assert bench.arbiter.view.commander == A
        assert bench.arbiter.view.epoch == 1

    def test_without_zones_an_operator_may_move_it_all_the_same(self) -> None:
        bench = Bench()
        bench.on_ground()
        bench.position()
        bench.autopilot_says(armed=True, flying=True)
        bench.run(3.0)
        bench.give(asks(B))
        assert bench.arbiter.view.partner == B

    def test_but_not_without_a_position(self) -> None:
        # whose zone holds the aircraft is not known; nor is it just after a restart
        bench = flight()
        bench.facts = None
        bench.run(3.0)
        assert answers(bench.give(asks(B))) == [ControlAnswer(B, DENIED, "no position of the aircraft")]

    def test_a_stranger_is_counted_and_gets_no_answer(self) -> None:
        bench = flight()
        assert bench.give(asks(99)) == []
        assert bench.dropped() == {"unknown station": 1}

    def test_a_heartbeat_alone_makes_nobody_a_partner(self) -> None:
        bench = flight()
        bench.deaf = {B}
        bench.run(6.0)
        assert answers(bench.give(asks(B))) == [ControlAnswer(B, DENIED, NOT_HEARD)]

    def test_on_the_ground_too(self) -> None:
        bench = Bench().on_ground()
        assert answers(bench.give(asks(B))) == [ControlAnswer(B, PENDING)]
        first = key(bench)
        for station, word in (
            (B, OnHandover(first)),
            (A, OkHandover(first)),
            (B, DroneConnected(first)),
            (A, DisconnectHandover(first)),
        ):
            bench.say(station, word)
        assert bench.arbiter.view == AuthorityView(Phase.ON_LOAD, B, None, 2, LeaseState.HELD, False, 1)

    def test_start_waits_for_the_end_of_a_transfer_on_the_ground(self) -> None:
        # or the aircraft would go to a station whose zone it never was in
        bench = Bench().on_ground()
        bench.give(asks(A, give_to=B))
        assert bench.arbiter.start_needs(A, bench.now) == ("a handover is under way",)

    def test_a_transfer_that_takes_off_is_a_phase(self) -> None:
        bench = Bench().on_ground()
        bench.position(inside(A), inside(B))
        bench.give(asks(B))
        bench.autopilot_says(armed=True, flying=True)
        assert bench.arbiter.view == AuthorityView(
            Phase.ON_HANDOVER, A, B, 1, LeaseState.TRANSFER, True, 1, why=Reason.REQUESTED
        )

    def test_moves_on_the_ground_do_not_advance_the_route(self) -> None:
        # A, then C, then B: given to B and back before take-off, the next one is C all the same
        bench = Bench(route=(A, C, B))
        bench.alive = {A, B, C}
        bench.on_ground()
        for old, new in ((A, B), (B, A)):
            bench.give(asks(old, give_to=new))
            there = key(bench, old)
            bench.say(new, OnHandover(there))
            bench.say(new, DroneConnected(there))
            assert bench.arbiter.view.commander == new
        bench.autopilot_says(armed=True, flying=True)
        bench.run(10.0)
        bench.position(inside(A), inside(B, exit_s=500.0), inside(C, exit_s=30.0))
        assert bench.arbiter.view.partner == C


class TestGive:
    def test_the_commander_gives_and_is_not_asked(self) -> None:
        bench = flight()
        assert answers(bench.give(asks(A, give_to=B))) == [ControlAnswer(A, ACCEPTED)]
        bench.say(B, OnHandover(key(bench)))
        assert [(station, type(m)) for _at, station, m, _n in bench.sent()] == [
            (B, HandoverRequest),
            (B, ConnectHandover),
        ]
        bench.say(B, DroneConnected(key(bench)))
        assert bench.arbiter.view.commander == B
        (record,) = bench.records("transfer_committed")
        assert (record.reason, record.duration_s) == (Reason.GIVEN, 0.0)

    def test_given_twice_because_the_answer_was_lost(self) -> None:
        bench = flight()
        bench.give(asks(A, give_to=B))
        bench.say(B, OnHandover(key(bench)))
        assert answers(bench.give(asks(A, give_to=B))) == [ControlAnswer(A, ACCEPTED)]
        bench.say(B, DroneConnected(key(bench)))
        before = bench.arbiter.view
        assert before.commander == B
        assert answers(bench.give(asks(A, give_to=B))) == [ControlAnswer(A, ACCEPTED)]
        assert bench.arbiter.view == before

    def test_what_is_given_and_not_taken_stays(self) -> None:
        bench = flight()
        bench.give(asks(A, give_to=B))
        bench.say(B, OnHandover(key(bench), Consent.DENIED))
        assert bench.arbiter.view.commander == A
        bench.run(60.0)
        assert bench.arbiter.view.commander == A

    def test_consent_to_one_transfer_is_none_to_the_next(self) -> None:
        bench = flight()
        bench.give(asks(A, give_to=B))
        bench.say(B, OnHandover(key(bench), Consent.DENIED))
        bench.run(10.0)
        bench.give(asks(B))
        bench.say(B, OnHandover(key(bench)))
        bench.say(B, DroneConnected(key(bench)))
        bench.run(1.0)
        assert bench.arbiter.view.commander == A
        assert bench.arbiter.view.partner == B

    def test_a_change_of_mind_before_the_partner_has_answered(self) -> None:
        bench = flight()
        bench.give(asks(A, give_to=B))
        bench.give(asks(A))
        assert bench.arbiter.view.partner is None
        assert bench.records("transfer_aborted")[0].reason is Reason.COMMANDER_DENIED

    def test_a_change_of_mind_counts_until_the_commit(self) -> None:
        bench = flight()
        bench.give(asks(A, give_to=B))
        first = key(bench)
        bench.say(B, OnHandover(first))
        bench.give(asks(A))
        assert bench.arbiter.view.partner is None
        assert bench.records("transfer_aborted")[0].reason is Reason.CANCELLED
        bench.say(B, DroneConnected(first))
        assert bench.arbiter.view.commander == A

    def test_given_over_a_transfer_that_waits(self) -> None:
        # the zone asked, the operator says yes by giving
        bench = flight()
        bench.give(asks(B))
        bench.say(B, OnHandover(key(bench)))
        bench.give(asks(A, give_to=B))
        assert bench.sent()[-1][1:3] == (B, ConnectHandover(key(bench)))

    def test_a_release_by_message_and_one_beforehand_are_one(self) -> None:
        bench = flight()
        bench.give(asks(A, give_to=B))
        first = key(bench)
        bench.say(B, OnHandover(first))
        bench.say(A, OkHandover(first))
        bench.say(A, DisconnectHandover(first))
        assert bench.arbiter.view.commander == A
        bench.say(B, DroneConnected(first))
        assert bench.arbiter.view.commander == B
        assert bench.arbiter.view.epoch == 2


class TestRelease:
    def test_on_the_ground_nobody_commands_and_nobody_gets_it_unasked(self) -> None:
        bench = Bench().on_ground()
        assert answers(bench.give(releases(A))) == [ControlAnswer(A, ACCEPTED)]
        nobody = AuthorityView(Phase.ON_LOAD, None, None, 2, LeaseState.LOST, False, 0)
        assert bench.arbiter.view == nobody
        bench.run(60.0)  # the parent is there all the time
        assert bench.arbiter.view == nobody
        assert answers(bench.give(asks(B))) == [ControlAnswer(B, ACCEPTED)]
        assert bench.arbiter.view == AuthorityView(Phase.ON_LOAD, B, None, 3, LeaseState.HELD, False, 0)

    def test_the_parent_asks_for_it_like_any_other(self) -> None:
        bench = Bench().on_ground()
        bench.give(releases(A))
        bench.give(asks(A))
        assert bench.arbiter.view.commander == A
        assert bench.arbiter.view.epoch == 3

    def test_before_a_mission_is_loaded_it_can_be_taken_up_again(self) -> None:
        # every station holds the mission package, the vehicle none yet: whoever commands brings it
        bench = Bench()
        bench.run(1.0)
        bench.give(releases(A))
        assert bench.arbiter.mission_digest == b""
        assert answers(bench.give(asks(A))) == [ControlAnswer(A, ACCEPTED)]
        assert bench.arbiter.view.commander == A

    def test_in_flight_it_is_offered_to_a_station_whose_zone_holds_the_aircraft(self) -> None:
        bench = flight()
        assert answers(bench.give(releases(A))) == [ControlAnswer(A, ACCEPTED)]
        view = bench.arbiter.view
        assert (view.commander, view.partner, view.takeover_allowed) == (A, B, True)
        bench.say(B, OnHandover(key(bench)))
        bench.say(B, DroneConnected(key(bench)))
        assert bench.arbiter.view == AuthorityView(Phase.ON_MISSION, B, None, 2, LeaseState.HELD, True, 1)

    def test_who_thinks_again_before_it_is_taken_offers_it_to_nobody_any_more(self) -> None:
        bench = flight()
        bench.give(releases(A))
        assert (bench.arbiter.view.partner, bench.arbiter.view.takeover_allowed) == (B, True)
        bench.give(asks(A))
        assert (bench.arbiter.view.partner, bench.arbiter.view.takeover_allowed) == (None, False)
        bench.run(11.0)
        assert answers(bench.give(asks(B))) == [ControlAnswer(B, PENDING)]

    def test_on_the_ground_it_is_journalled(self) -> None:
        bench = Bench().on_ground()
        bench.give(releases(A))
        told = bench.records("authority")[-1]
        assert (told.text, told.station) == ("control released: no station commands", A)

    def test_in_flight_with_nobody_to_take_it_the_commander_stays(self) -> None:
        bench = flight()
        bench.alive = {A}
        bench.run(6.0)
        bench.give(releases(A))
        view = bench.arbiter.view
        assert (view.commander, view.partner, view.takeover_allowed, view.epoch) == (A, None, True, 1)
        bench.run(60.0)
        assert bench.arbiter.view.commander == A
        assert bench.flights() == []

    def test_whoever_comes_then_need_not_wait_for_consent(self) -> None:
        bench = flight()
        bench.alive = {A}
        bench.run(6.0)
        bench.give(releases(A))
        bench.alive = {A, B}
        bench.run(2.0)
        assert answers(bench.give(asks(B))) == [ControlAnswer(B, ACCEPTED)]
        bench.say(B, OnHandover(key(bench)))
        bench.say(B, DroneConnected(key(bench)))
        assert bench.arbiter.view.commander == B

    def test_while_a_station_waits_it_is_the_consent(self) -> None:
        bench = flight()
        bench.give(asks(B))
        bench.say(B, OnHandover(key(bench)))
        bench.give(releases(A))
        bench.say(B, DroneConnected(key(bench)))
        assert bench.arbiter.view.commander == B

    def test_on_the_ground_while_a_station_waits_it_goes_to_that_one(self) -> None:
        # and not to nobody, with a transfer under way from somebody who has nothing
        bench = Bench().on_ground()
        bench.give(asks(B))
        bench.give(releases(A))
        assert bench.arbiter.view.commander == A
        bench.say(B, OnHandover(key(bench)))
        bench.say(B, DroneConnected(key(bench)))
        assert bench.arbiter.view == AuthorityView(Phase.ON_LOAD, B, None, 2, LeaseState.HELD, False, 1)

    def test_a_pilot_who_takes_off_after_it_is_brought_home(self) -> None:
        bench = Bench().on_ground()
        bench.give(releases(A))
        bench.autopilot_says(armed=True, flying=True)
        assert [fly.reason for fly in bench.flights()] == [Reason.COMMANDER_LOST]
        assert answers(bench.give(asks(B))) == [ControlAnswer(B, DENIED, "the aircraft is outside the zone of GCSB")]
        bench.position(inside(A), inside(B))
        assert answers(bench.give(asks(B))) == [ControlAnswer(B, DENIED, "there is no commander to follow")]


class TestEcho:
    """What moves authority by a consent may come again."""

    CONSENTS = (Effect.CONSENT, Effect.TRANSFER_CONSENTED, Effect.GIVE, Effect.OFFER, Effect.RELEASE)

    @pytest.mark.parametrize("effect", Effect)
    def test_it_is_a_repetition_for_ten_seconds_after_it_took_effect(self, effect: Effect) -> None:
        echo = Echo()
        echo.note(asks(B), effect, 90.0)
        assert echo.repeats(asks(B), 90.0) is (effect is Effect.RELEASE)
        echo.took_effect(100.0)
        assert echo.repeats(asks(B), 109.9) is (effect in self.CONSENTS)
        assert not echo.repeats(asks(B), 110.0)
        assert not echo.repeats(asks(B, takeover=True), 109.9)
        echo.forget()
        assert not echo.repeats(asks(B), 100.0)


class TestParent:
    """On the ground the parent takes up its vehicle again where another one had it and is lost."""

    @staticmethod
    def of_another() -> Bench:
        bench = Bench()
        bench.alive = {A, B, C}
        bench.on_ground()
        bench.give(releases(A))
        bench.give(asks(B))
        assert bench.arbiter.view.commander == B
        return bench

    def test_from_another_that_is_lost(self) -> None:
        bench = self.of_another()
        bench.alive = {A}
        bench.run(6.0)
        assert bench.arbiter.view == AuthorityView(Phase.ON_LOAD, A, None, 4, LeaseState.HELD, False, 0)

    def test_not_from_another_that_lives(self) -> None:
        bench = self.of_another()
        bench.run(60.0)
        assert bench.arbiter.view.commander == B

    def test_not_in_flight(self) -> None:
        bench = self.of_another()
        bench.position(outside(A), inside(B), outside(C))
        bench.autopilot_says(armed=True, flying=True)
        bench.alive = {A}
        bench.run(30.0)
        assert bench.arbiter.view.commander is None

    def test_not_while_the_aircraft_is_on_its_way_to_a_third(self) -> None:
        # C was asked, then B is lost: what C has been promised is not given to A and then taken from it
        bench = self.of_another()
        bench.give(asks(C))
        there = key(bench, B)
        bench.say(C, OnHandover(there, Consent.WAITING))
        bench.alive = {A, C}
        bench.run(5.5)
        assert bench.arbiter.view == AuthorityView(
            Phase.ON_LOAD, None, C, 3, LeaseState.LOST, False, 1, why=Reason.COMMANDER_LOST
        )
        bench.say(C, OnHandover(there))
        bench.say(C, DroneConnected(there))
        assert bench.arbiter.view == AuthorityView(Phase.ON_LOAD, C, None, 4, LeaseState.HELD, False, 1)

    def test_but_when_that_has_come_to_nothing(self) -> None:
        bench = self.of_another()
        bench.give(asks(C))
        bench.say(C, OnHandover(key(bench, B), Consent.WAITING))
        bench.alive = {A, C}
        bench.run(9.0)
        assert bench.arbiter.view.commander == A


class TestTraps:
    """What other implementations got wrong, one by one."""

    def test_an_old_layout_request_is_not_read_as_a_release(self) -> None:
        # 2024: p1 system id (0 from a ground station), p2 1 = request, p3 takeover, p4 time-out
        for takeover, timeout_s in ((0, 10), (1, 60), (0, 3)):
            old = mavlink.MAVLink_command_long_message(1, 191, 32100, 0, 0, 1, takeover, timeout_s, 0, 0, 0)
            why = "release with takeover: the request of an old ground station?"
            assert read_request(old, StationIdentity(A)) == why

    @pytest.mark.parametrize("who", [B, C, D])
    @pytest.mark.parametrize("ground", [False, True])
    def test_a_release_by_one_who_does_not_command(self, who: int, ground: bool) -> None:
        bench = Bench().on_ground() if ground else flight()
        before = bench.arbiter.view
        assert answers(bench.give(releases(who))) == [ControlAnswer(who, DENIED, "only the commander can release")]
        assert bench.arbiter.view == before

    def test_a_release_by_the_partner_of_a_transfer(self) -> None:
        bench = flight()
        bench.give(asks(B))
        before = bench.arbiter.view
        assert answers(bench.give(releases(B)))[0].result is DENIED
        assert bench.arbiter.view == before

    def test_a_late_release_by_the_former_commander(self) -> None:
        bench = flight()
        bench.give(asks(A, give_to=B))
        bench.say(B, OnHandover(key(bench)))
        bench.say(B, DroneConnected(key(bench)))
        assert answers(bench.give(releases(A)))[0].result is DENIED
        assert bench.arbiter.view.commander == B

    @pytest.mark.parametrize("takeover", [False, True])
    def test_a_secondary_in_range_is_not_granted_by_itself(self, takeover: bool) -> None:
        # the takeover that counts is what the commander allows, not what the one who asks would allow
        bench = flight()
        assert answers(bench.give(asks(B, takeover=takeover))) == [ControlAnswer(B, PENDING)]
        first = key(bench)
        bench.say(B, OnHandover(first))
        bench.say(B, DroneConnected(first))
        bench.say(B, OkHandover(first))
        bench.say(B, DisconnectHandover(first))
        bench.give(asks(B, takeover=takeover))
        bench.run(20.0)
        assert bench.arbiter.view.commander == A
        assert bench.arbiter.view.epoch == 1

    def test_gcs_main_is_the_commander_and_nobody_else(self) -> None:
        bench = flight()
        seen = []
        bench.log.clear()
        bench.give(asks(C, give_to=B))  # denied
        bench.give(asks(A, give_to=B))
        first = key(bench)
        bench.say(B, OnHandover(first))
        bench.say(B, DroneConnected(first))
        bench.alive = {A, C}
        bench.run(30.0)
        for change in bench.views():
            status = control_status(change.view)
            assert list(status.gcs_secondary) == [0] * 10
            assert status.flags & 1, "it speaks for the whole system"
            if not seen or seen[-1] != status.gcs_main:
                seen.append(status.gcs_main)
        # never the partner, never the lowest number; nobody when it is lost
        assert seen == [A, B, 0]

    def test_no_notification_outlives_a_change_of_commander(self) -> None:
        bench = flight(standard={A, C})
        bench.give(asks(B))
        bench.say(B, OnHandover(key(bench)))
        bench.run(0.3)
        assert [(question.station, question.requester) for _at, question in questions(bench)] == [(A, B)]
        bench.give(asks(A, takeover=True))
        bench.say(B, DroneConnected(key(bench)))
        assert bench.arbiter.view.commander == B
        bench.log.clear()
        bench.run(60.0)
        assert questions(bench) == []

    @pytest.mark.parametrize("end", ["denied", "zone left", "too late"])
    def test_nor_the_end_of_the_request(self, end: str) -> None:
        bench = flight(standard={A})
        bench.give(asks(B))
        bench.say(B, OnHandover(key(bench)))
        bench.run(1.0)
        assert questions(bench) != []
        if end == "denied":
            bench.give(asks(A))
        elif end == "zone left":
            bench.position(inside(A), outside(B))
        else:
            bench.run(10.0)
        assert bench.arbiter.view.partner is None
        bench.log.clear()
        bench.run(30.0)
        assert questions(bench) == []

    @pytest.mark.parametrize(
        ("asked_s", "lives_s"),
        [(-5.0, 3.0), (0.0, 3.0), (2.9, 3.0), (3.0, 3.0), (17.0, 17.0), (60.0, 60.0), (61.0, 60.0), (1e9, 60.0)],
    )
    def test_a_request_lives_three_to_sixty_seconds(self, asked_s: float, lives_s: float) -> None:
        bench = flight(standard={A})
        bench.give(asks(B, timeout_s=asked_s))
        bench.say(B, OnHandover(key(bench)))
        asked_at = bench.now
        bench.run(lives_s - 0.1)
        assert bench.arbiter.view.partner == B
        bench.run(0.1)
        assert bench.arbiter.view.partner is None
        assert bench.records("transfer_aborted")[0].reason is Reason.COMMANDER_UNANSWERED
        # the owner's countdown ends when the request does
        for at, question in questions(bench):
            assert question.timeout_s == pytest.approx(max(3.0, asked_at + lives_s - at))

    def test_the_same_limits_hold_for_an_operator_who_is_asked_by_our_own_module(self) -> None:
        bench = flight()
        bench.give(asks(B, timeout_s=17.0))
        bench.say(B, OnHandover(key(bench)))
        bench.say(A, OkHandover(key(bench), Consent.WAITING))
        bench.run(16.9)
        assert bench.arbiter.view.partner == B
        bench.run(0.1)
        assert bench.arbiter.view.partner is None

    def test_of_two_requests_at_once_the_first_counts(self) -> None:
        bench = flight(standard={A}, facts=(inside(A), inside(B), inside(C), outside(D)))
        assert answers(bench.give(asks(B))) == [ControlAnswer(B, PENDING)]
        assert answers(bench.give(asks(C))) == [ControlAnswer(C, DENIED, "another handover is under way")]
        assert bench.arbiter.view.partner == B
        bench.say(B, OnHandover(key(bench)))
        bench.run(0.3)
        assert [question.requester for _at, question in questions(bench)] == [B]
        # the owner's yes is to the one it was asked for
        bench.give(asks(A, takeover=True))
        bench.say(B, DroneConnected(key(bench)))
        assert bench.arbiter.view.commander == B

    def test_a_grant_after_the_time_out_moves_nothing(self) -> None:
        bench = flight(standard={A})
        bench.give(asks(B, timeout_s=5.0))
        bench.say(B, OnHandover(key(bench)))
        late = key(bench)
        bench.run(7.5)
        assert bench.arbiter.view.partner is None
        bench.give(asks(A, takeover=True))  # from now on takeover is allowed; the old request is not alive again
        bench.say(B, DroneConnected(late))
        bench.run(0.4)
        assert bench.arbiter.view.commander == A
        assert bench.arbiter.view.takeover_allowed
        assert bench.arbiter.view.epoch == 1

    def test_accepted_alone_is_not_control(self) -> None:
        bench = flight()
        bench.give(asks(A, takeover=True))
        assert answers(bench.give(asks(B))) == [ControlAnswer(B, ACCEPTED)]
        assert bench.arbiter.view.commander == A
        assert control_status(bench.arbiter.view).gcs_main == A
        bench.say(B, OnHandover(key(bench)))
        assert control_status(bench.arbiter.view).gcs_main == A
        bench.say(B, DroneConnected(key(bench)))
        assert control_status(bench.arbiter.view).gcs_main == B

    @pytest.mark.parametrize("how", ["taken over", "given", "forced", "released and granted", "back to the parent"])
    def test_takeover_is_reset_with_the_owner(self, how: str) -> None:
        ground = how in ("released and granted", "back to the parent")
        bench = Bench().on_ground() if ground else flight()
        bench.give(asks(A, takeover=True))
        assert bench.arbiter.view.takeover_allowed
        assert control_status(bench.arbiter.view).flags == 3
        if how == "taken over":
            bench.give(asks(B))
        elif how == "given":
            bench.give(asks(A, give_to=B))
        elif how == "forced":
            bench.alive = {B}
            bench.run(5.0)
        else:
            bench.give(releases(A))
            assert not bench.arbiter.view.takeover_allowed
            bench.give(asks(B))
        if not ground:
            bench.say(B, OnHandover(key(bench)))
            bench.say(B, DroneConnected(key(bench)))
        assert bench.arbiter.view.commander == B
        assert not bench.arbiter.view.takeover_allowed
        if how == "back to the parent":
            bench.give(asks(B, takeover=True))
            bench.alive = {A}
            bench.run(6.0)
            assert bench.arbiter.view.commander == A
            assert not bench.arbiter.view.takeover_allowed
        assert control_status(bench.arbiter.view).flags == 1

    def test_takeover_is_over_with_the_flight(self) -> None:
        bench = flight()
        bench.give(asks(A, takeover=True))
        bench.autopilot_says(armed=False, flying=False)
        assert not bench.arbiter.view.takeover_allowed

    def test_takeover_outlives_a_gap_of_the_same_owner(self) -> None:
        bench = flight()
        bench.give(asks(A, takeover=True))
        bench.alive = set()
        bench.run(6.0)
        assert bench.arbiter.view.commander is None
        bench.back(A, for_good=False)
        assert bench.arbiter.view.commander == A
        assert bench.arbiter.view.takeover_allowed

    def test_where_takeover_is_allowed_the_zone_need_not_ask_either(self) -> None:
        bench = Bench().on_mission()
        bench.give(asks(A, takeover=True))
        bench.position(inside(A), inside(B))
        bench.say(B, OnHandover(key(bench)))
        bench.say(B, DroneConnected(key(bench)))
        assert bench.arbiter.view.commander == B

    @pytest.mark.parametrize("how", ["consents", "gives", "releases"])
    @pytest.mark.parametrize(("after_s", "echo"), [(0.0, True), (1.5, True), (9.9, True), (10.0, False)])
    def test_a_consent_that_is_repeated_after_the_commit_is_no_request(
        self, how: str, after_s: float, echo: bool
    ) -> None:
        """The answer was lost, so the program sends its command again; by then another one commands."""
        consent = {"consents": asks(A, takeover=True), "gives": asks(A, give_to=B), "releases": releases(A)}[how]
        bench = flight()
        if how == "consents":
            bench.give(asks(B))
        bench.give(consent)
        bench.say(B, OnHandover(key(bench)))
        bench.give(consent)
        bench.say(B, DroneConnected(key(bench)))
        moved = bench.arbiter.view
        assert (moved.commander, moved.partner, moved.epoch) == (B, None, 2)
        bench.run(after_s)
        (answer,) = answers(bench.give(consent))
        if echo:
            assert answer == ControlAnswer(A, ACCEPTED)
            assert bench.arbiter.view == moved
        else:
            assert answer.result is (PENDING if how == "consents" else DENIED)

    @pytest.mark.parametrize("consent", [asks(A, give_to=B), releases(A)], ids=["gives", "releases"])
    def test_the_same_if_it_is_repeated_only_then(self, consent: ControlRequested) -> None:
        bench = flight()
        bench.give(consent)
        bench.say(B, OnHandover(key(bench)))
        bench.say(B, DroneConnected(key(bench)))
        moved = bench.arbiter.view
        assert moved.commander == B
        assert answers(bench.give(consent)) == [ControlAnswer(A, ACCEPTED)]
        assert bench.arbiter.view == moved

    def test_a_release_on_the_ground_may_be_repeated_too(self) -> None:
        bench = Bench().on_ground()
        for _ in range(3):
            assert answers(bench.give(releases(A))) == [ControlAnswer(A, ACCEPTED)]
            bench.run(1.0)
        assert bench.arbiter.view.epoch == 2

    def test_but_not_after_somebody_else_has_taken_it_and_given_it_back(self) -> None:
        bench = Bench().on_ground()
        bench.give(releases(A))
        bench.give(asks(A))
        assert answers(bench.give(releases(A))) == [ControlAnswer(A, ACCEPTED)]
        assert bench.arbiter.view.commander is None
        assert bench.arbiter.view.epoch == 4

    def test_who_wants_it_back_at_once_asks_and_is_heard(self) -> None:
        bench = flight()
        bench.give(asks(A, give_to=B))
        bench.say(B, OnHandover(key(bench)))
        bench.say(B, DroneConnected(key(bench)))
        assert answers(bench.give(asks(A))) == [ControlAnswer(A, PENDING)]
        assert bench.arbiter.view.partner == A

    @pytest.mark.parametrize("how", ["B gives it", "C asks for it"])
    def test_a_consent_of_before_is_no_echo_of_the_next_transfer(self, how: str) -> None:
        # A consents; then C has it from B. That A asks now, in the same words, is a request.
        bench = flight(facts=(inside(A), inside(B), inside(C), outside(D)))
        bench.give(asks(B))
        bench.give(asks(A, takeover=True))
        bench.say(B, OnHandover(key(bench)))
        bench.say(B, DroneConnected(key(bench)))
        if how == "B gives it":
            bench.give(asks(B, give_to=C))
        else:
            bench.give(asks(C))
        transfer = key(bench, B)
        bench.say(C, OnHandover(transfer))
        if how == "C asks for it":
            bench.say(B, OkHandover(transfer))
        bench.say(C, DroneConnected(transfer))
        if how == "C asks for it":
            bench.say(B, DisconnectHandover(transfer))
        assert bench.arbiter.view.commander == C
        assert answers(bench.give(asks(A, takeover=True))) == [ControlAnswer(A, PENDING)]

    def test_nor_of_one_that_a_zone_begins_where_takeover_is_allowed(self) -> None:
        bench = flight(facts=(inside(A), inside(B), outside(C), outside(D)))
        bench.give(asks(B))
        bench.give(asks(A, takeover=True))
        bench.say(B, OnHandover(key(bench)))
        bench.say(B, DroneConnected(key(bench)))
        bench.give(asks(B, takeover=True))
        bench.run(6.0)
        bench.position(inside(A), inside(B), inside(C), outside(D))
        transfer = key(bench, B)
        bench.say(C, OnHandover(transfer))
        bench.say(C, DroneConnected(transfer))
        assert bench.arbiter.view.commander == C
        assert answers(bench.give(asks(A, takeover=True))) == [ControlAnswer(A, PENDING)]

    def test_asking_again_and_again_changes_nothing(self) -> None:
        bench = flight()
        bench.give(asks(B))
        before, deadline = bench.arbiter.view, bench.arbiter.next_deadline()
        for _ in range(20):
            assert answers(bench.give(asks(B, timeout_s=60.0))) == [ControlAnswer(B, PENDING)]
        assert bench.arbiter.view == before
        assert bench.arbiter.next_deadline() == deadline
        assert [type(m) for _at, _station, m, _n in bench.sent()] == [HandoverRequest]

    def test_takeover_set_twice_is_announced_once(self) -> None:
        bench = flight()
        for _ in range(3):
            bench.give(asks(A, takeover=True))
        assert [change.view.takeover_allowed for change in bench.views()] == [True]

    def test_denying_pauses_the_zone_as_well(self) -> None:
        bench = Bench().in_transfer()
        bench.say(B, OnHandover(key(bench)))
        bench.give(asks(A))
        assert bench.records("transfer_aborted")[0].reason is Reason.COMMANDER_DENIED
        bench.run(9.5)
        assert bench.arbiter.view.partner is None
        bench.run(1.0)
        assert bench.arbiter.view.partner == B


class TestCrossing:
    """A click of a commander of the standard says yes or no, and not to what: it may cross the next question."""

    @staticmethod
    def asked_twice() -> Bench:
        """A is asked whether C may have it, and C's place has just been taken by B, for the zone."""
        bench = flight(standard={A}, facts=(inside(A), outside(B), inside(C), outside(D)))
        bench.give(asks(C, timeout_s=60.0))
        bench.say(C, OnHandover(key(bench)))
        bench.run(5.0)
        bench.position(inside(A), inside(B), inside(C), outside(D))
        bench.say(B, OnHandover(key(bench)))
        assert bench.arbiter.view.partner == B
        return bench

    @pytest.mark.parametrize("takeover", [True, False], ids=["yes", "no"])
    def test_an_answer_to_the_first_question_is_none_to_the_second(self, takeover: bool) -> None:
        bench = self.asked_twice()
        bench.run(1.9)
        assert answers(bench.give(asks(A, takeover=takeover))) == [ControlAnswer(A, DENIED, IS_OVER.text)]
        assert (bench.arbiter.view.commander, bench.arbiter.view.partner) == (A, B)
        assert not any(isinstance(message, ConnectHandover) for _at, _station, message, _attempt in bench.sent())
        bench.run(0.2)
        assert answers(bench.give(asks(A, takeover=takeover))) == [ControlAnswer(A, ACCEPTED)]
        assert bench.arbiter.view.partner == (B if takeover else None)

    def test_a_late_yes_allows_nobody_to_take_over(self) -> None:
        bench = flight(standard={A})
        bench.give(asks(B, timeout_s=10.0))
        bench.say(B, OnHandover(key(bench)))
        bench.run(5.0)
        bench.position(inside(A), outside(B), outside(C), outside(D))
        assert bench.arbiter.view.partner is None
        assert answers(bench.give(asks(A, takeover=True))) == [ControlAnswer(A, DENIED, IS_OVER.text)]
        assert not bench.arbiter.view.takeover_allowed
        bench.run(2.0)
        assert answers(bench.give(asks(A, takeover=True))) == [ControlAnswer(A, ACCEPTED)]
        assert bench.arbiter.view.takeover_allowed

    def test_who_has_allowed_takeover_may_take_that_back_at_once(self) -> None:
        bench = flight(standard={A}, facts=(inside(A), outside(B), inside(C), outside(D)))
        bench.give(asks(A, takeover=True))
        bench.give(asks(C))
        bench.position(inside(A), inside(B), inside(C), outside(D))
        assert bench.arbiter.view.partner == B
        assert answers(bench.give(asks(A))) == [ControlAnswer(A, ACCEPTED)]
        assert bench.arbiter.view.partner is None


class TestNotification:
    """A commander of the standard is asked by its own command."""

    def test_it_is_repeated_until_somebody_says_something(self) -> None:
        bench = flight(standard={A})
        bench.give(asks(B, timeout_s=30.0))
        bench.say(B, OnHandover(key(bench)))
        asked_at = bench.now
        bench.run(2.0)
        assert [round(at - asked_at, 3) for at, _question in questions(bench)] == [0.2, 0.4, 0.7, 1.15, 1.825]

    def test_nothing_of_ours_is_sent_to_it(self) -> None:
        bench = flight(standard={A})
        bench.give(asks(B))
        bench.say(B, OnHandover(key(bench)))
        bench.run(1.0)
        bench.give(asks(A, takeover=True))
        bench.say(B, DroneConnected(key(bench)))
        bench.run(15.0)
        assert {action.station for _at, action in bench.log if isinstance(action, Send)} == {B, C, D}
        assert [a for _at, a in bench.log if isinstance(a, Send) and a.station == A] == []

    def test_a_commander_with_our_module_gets_our_message_instead(self) -> None:
        bench = flight()
        bench.give(asks(B))
        bench.say(B, OnHandover(key(bench)))
        bench.run(1.0)
        assert questions(bench) == []
        assert (A, OnHandover(key(bench), reason=Reason.REQUESTED, relayed=True)) in [
            (s, m) for _at, s, m, _n in bench.sent()
        ]

    def test_by_zone_it_has_the_operators_time(self) -> None:
        bench = Bench(Limits(operator_timeout_s=20.0), standard={A}).in_transfer()
        bench.say(B, OnHandover(key(bench)))
        asked_at = bench.now
        bench.run(19.9)
        assert bench.arbiter.view.partner == B
        assert questions(bench)[0] == (pytest.approx(asked_at + 0.2), NotifyOwner(A, B, pytest.approx(19.8)))
        bench.run(0.1)
        assert bench.arbiter.view.partner is None

    @pytest.mark.parametrize(("limit_s", "told_s"), [(1.0, 3.0), (100.0, 60.0)])
    def test_what_it_is_told_stays_within_the_standards_range(self, limit_s: float, told_s: float) -> None:
        bench = Bench(Limits(operator_timeout_s=limit_s), standard={A}).in_transfer()
        bench.say(B, OnHandover(key(bench)))
        bench.run(0.3)
        assert [question.timeout_s for _at, question in questions(bench)] == [told_s]


def test_view_changes_show_takeover_at_once() -> None:
    bench = flight()
    actions = bench.give(asks(A, takeover=True))
    view = replace(bench.arbiter.view, takeover_allowed=True)
    assert [action for action in actions if isinstance(action, ViewChanged)] == [ViewChanged(view, Reason.OPERATOR)]


def test_connect_goes_on_while_control_is_asked_for() -> None:
    bench = flight()
    bench.give(asks(B))
    bench.log.clear()
    bench.run(1.5)
    assert {a.station for _at, a in bench.log if isinstance(a, Send) and isinstance(a.message, Connect)} == {A, B, C, D}
