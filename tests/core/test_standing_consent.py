# SPDX-License-Identifier: GPL-3.0-or-later

"""Stations that cannot be asked: what the vehicle's file answers for them, and what START needs."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mavproxy_handover.core.common.events import (
    Advise,
    BeginStart,
    NotifyOwner,
    OperatorControlShown,
    StartRefused,
    StartRequested,
    StationHeard,
)
from mavproxy_handover.core.common.messages import Connect, DroneConnected, OnHandover
from mavproxy_handover.core.common.model import FlightAction, Reason, StandingConsent
from tests.core.bench import KEY, A, B, Bench, inside

AUTOMATIC, REFUSE = StandingConsent.AUTOMATIC, StandingConsent.REFUSE
WRITE = (
    'GCSB cannot be asked for consent: write consent = "automatic" or consent = "refuse" in its [[station]] of the '
    "vehicle's file"
)


def needs(bench: Bench) -> tuple[str, ...]:
    """What START from GCSA is refused for; () if it begins."""
    actions = bench.give(StartRequested(A))
    refused = [action for action in actions if isinstance(action, StartRefused)]
    assert len(refused) + actions.count(BeginStart(A)) == 1
    return refused[0].needs if refused else ()


class TestStart:
    def test_without_the_key_it_is_refused_by_name_and_with_the_line_to_write(self) -> None:
        assert needs(Bench(standard={B}, shown=False).on_ground()) == (WRITE,)

    def test_automatic_is_enough(self) -> None:
        assert needs(Bench(standard={B}, shown=False, consent=AUTOMATIC).on_ground()) == ()

    def test_refuse_where_the_route_needs_that_border(self) -> None:
        bench = Bench(standard={B}, shown=False, consent=REFUSE, route=(A, B)).on_ground()
        assert needs(bench) == ('GCSB has consent = "refuse", and the route needs GCSA -> GCSB',)

    def test_refuse_where_it_does_not(self) -> None:
        assert needs(Bench(standard={B}, shown=False, consent=REFUSE, route=(A,)).on_ground()) == ()

    def test_a_program_that_has_shown_operator_control_needs_no_key(self) -> None:
        bench = Bench(standard={B}, shown=False).on_ground()
        bench.give(OperatorControlShown(B))
        assert needs(bench) == ()

    def test_so_does_one_that_speaks_our_messages(self) -> None:
        bench = Bench(standard={B}, shown=False).on_ground()
        bench.say(B, Connect(B, 1, 5, 0, None, "GCSB", b""))
        assert needs(bench) == ()

    def test_a_heartbeat_shows_nothing(self) -> None:
        bench = Bench(standard={B}, shown=False).on_ground()
        for _ in range(20):
            bench.give(StationHeard(B))
        assert needs(bench) == (WRITE,)

    def test_what_was_shown_before_a_restart_counts_no_more(self) -> None:
        bench = Bench(standard={B}).on_ground().restart()
        bench.on_ground()
        assert needs(bench) == (WRITE,)


class TestCommander:
    """GCSA is the commander that cannot be asked, GCSB has our module."""

    def at_the_border(self, consent: StandingConsent | None, *, shown: bool = False) -> Bench:
        bench = Bench(standard={A}, consent=consent, shown=True, route=(A,)).on_mission()
        bench.arbiter._presence[A].shows_control = shown
        bench.log.clear()
        bench.position(inside(A), inside(B))
        return bench

    def questions(self, bench: Bench) -> list[NotifyOwner]:
        return [action for _at, action in bench.log if isinstance(action, NotifyOwner)]

    def test_automatic_is_its_consent_and_it_is_not_asked(self) -> None:
        bench = self.at_the_border(AUTOMATIC)
        bench.say(B, OnHandover(KEY, relay=True))
        bench.say(B, DroneConnected(KEY, relay=True))
        assert bench.arbiter.view.commander == B
        assert self.questions(bench) == []

    def test_refuse_begins_no_planned_handover_and_both_operators_hear_why_once(self) -> None:
        bench = self.at_the_border(REFUSE)
        bench.run(40.0)
        assert (bench.arbiter.view.commander, bench.arbiter.view.partner) == (A, None)
        assert bench.sent() == []
        text = 'No handover: GCSA gives no handover: the vehicle\'s file says consent = "refuse".'
        assert [action for _at, action in bench.log if isinstance(action, Advise)] == [Advise((A, B), text)]

    def test_where_its_zone_ends_the_aircraft_stops_inside(self) -> None:
        bench = self.at_the_border(REFUSE)
        bench.position(replace(inside(A), ends_s=4.0, beyond=frozenset({B})), inside(B))
        bench.run(1.5)
        assert [fly.action for fly in bench.flights()] == [FlightAction.HOLD]

    def test_refuse_answers_another_operators_request_at_once(self) -> None:
        bench = self.at_the_border(REFUSE)
        bench.give(bench.request(B))
        bench.say(B, OnHandover(KEY, relay=True))
        assert (bench.arbiter.view.commander, bench.arbiter.view.partner) == (A, None)
        assert [record.reason for record in bench.records("transfer_aborted")] == [Reason.CONSENT_REFUSED]
        assert self.questions(bench) == []

    def test_automatic_answers_no_other_operators_request(self) -> None:
        bench = Bench(standard={A}, consent=AUTOMATIC).on_ground()
        bench.give(bench.request(B))
        bench.say(B, OnHandover(KEY, relay=True))
        assert self.questions(bench) == [NotifyOwner(A, B, 10.0)]
        assert bench.arbiter.view.commander == A

    def test_automatic_answers_as_soon_as_the_zone_ends_while_another_operator_asks(self) -> None:
        """The request of GCSB is for people to answer. While it waits, the zone ends: that needs no answer."""
        bench = Bench(standard={A}, consent=AUTOMATIC, route=(A,)).on_mission()
        bench.position(inside(A), replace(inside(B), awaits=True))
        bench.give(bench.request(B, timeout_s=30.0))
        bench.say(B, OnHandover(KEY, relay=True))
        bench.run(1.0)
        assert bench.arbiter.view.commander == A
        bench.position(inside(A, exit_s=6.0), inside(B))
        bench.say(B, DroneConnected(KEY, relay=True))
        assert bench.arbiter.view.commander == B

    @pytest.mark.parametrize(
        ("shown", "reason"), [(False, Reason.CANNOT_BE_ASKED), (True, Reason.COMMANDER_UNANSWERED)]
    )
    def test_without_the_key_it_is_asked_and_its_silence_has_its_reason(self, shown: bool, reason: Reason) -> None:
        bench = self.at_the_border(None, shown=shown)
        bench.say(B, OnHandover(KEY, relay=True))
        assert self.questions(bench) == [NotifyOwner(A, B, 30.0)]
        bench.run(30.0)
        assert [record.reason for record in bench.records("transfer_aborted")] == [reason]


class TestPartner:
    def test_refuse_is_never_partner_and_both_operators_hear_why(self) -> None:
        bench = Bench(standard={B}, consent=REFUSE, route=(A,)).on_mission()
        bench.position(inside(A), inside(B))
        bench.run(5.0)
        assert bench.arbiter.view.partner is None
        advice = [action for _at, action in bench.log if isinstance(action, Advise)]
        assert advice == [Advise((A, B), 'GCSB takes no handover: the vehicle\'s file says consent = "refuse".')]

    def test_nor_after_the_commander_is_lost(self) -> None:
        bench = Bench(standard={B}, consent=REFUSE, route=(A,)).on_mission()
        bench.position(inside(A), inside(B))
        bench.alive = {B}
        bench.run(20.0)
        assert bench.arbiter.view.commander is None

    def test_automatic_takes_the_aircraft(self) -> None:
        bench = Bench(standard={B}, consent=AUTOMATIC, shown=False).on_mission()
        bench.position(inside(A), inside(B))
        assert bench.arbiter.view.partner == B
