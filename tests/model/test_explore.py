# SPDX-License-Identifier: GPL-3.0-or-later

"""The rules of vehicle and stations, explored within the bounds of `plans.QUICK`.

Each setting is explored to its first `STATES` states (`LATER`: some to more), which are those that the fewest steps
lead to; with `--long`, and by `make explore`, to the bounds of the setting. And the test of that test: faults planted
in the rules are found.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from gcs_module import core as gcs
from mavproxy_handover.core.arbiter import Arbiter
from mavproxy_handover.core.authority import presence, transfer, transfer_manager, zones
from mavproxy_handover.core.authority.authority import Authority
from mavproxy_handover.core.authority.candidates import Candidates
from mavproxy_handover.core.authority.hearing import Hearing
from mavproxy_handover.core.authority.transfer import Cause, End, Step
from mavproxy_handover.core.authority.transfer_manager import TransferManager
from mavproxy_handover.core.common import causes
from mavproxy_handover.core.common.messages import DisconnectHandover
from mavproxy_handover.core.common.model import AuthorityView, Consent, LeaseState, Outcome, Reason, ZoneFact
from mavproxy_handover.core.safety import strategy
from mavproxy_handover.core.safety.conditions import Conditions
from mavproxy_handover.core.safety.gap import Crossing
from tests.depth import first
from tests.model.canonical import NOW
from tests.model.checks import Violation
from tests.model.explore import main
from tests.model.explorer import explore
from tests.model.plans import BLANK, CRASHES, MESSAGES, QUICK
from tests.model.setting import IMPATIENT, LUCKY, PARENT, Fault, Setting
from tests.model.steps import Graph, Label
from tests.model.world import State

#: of each setting in a test run. Of the faults planted below, two show later, in the settings of `LATER`: a commit
#: without consent after 1,688 states, a commit without the word of the partner after 4,543
STATES = 1000
LATER = {"transfer": 2000, "transfer, messages": 5000}
GCSA, GCSB = PARENT, PARENT + 1
COMMITTED = End(Outcome.COMMITTED, Reason.NONE)

TRANSFER = Setting("transfer", faults=1)
MESSAGE_LOST = Setting("a message", faults=1, kinds=MESSAGES)
LIARS = Setting("liars", faults=1, kinds=frozenset({Fault.LIE}))
TWO_MESSAGES = Setting("messages", faults=2, kinds=MESSAGES, limits=IMPATIENT)
LATE = Setting("late", path=("A", "AB", "A", "AB"), faults=1, kinds=frozenset({Fault.HOLD}))
OPERATOR = Setting("operator", operators="A", faults=0)
GAP = Setting("gap", path=("A", "=", "B"), faults=1, kinds=frozenset({Fault.KILL_STATION}))
GAP_TWICE = Setting("gap, twice", path=("A", "="), faults=2, kinds=frozenset({Fault.KILL_STATION}))
AWAITED = Setting("awaited", path=("A", "AB?", "AB"), faults=0)
ENERGY = Setting("energy", path=("AB", "aB"), faults=1, kinds=frozenset({Fault.SHORT}))
STATE_LOST = Setting("state file lost", path=("A", "_A", "AB"), faults=1, kinds=BLANK)


#: a third of the settings in each test run; `make explore` begins with all of them
@pytest.mark.parametrize(
    "setting",
    first(12, [*QUICK[::3], *(setting for n, setting in enumerate(QUICK) if n % 3)]),
    ids=lambda setting: setting.name,
)
def test_whatever_happens_authority_is_where_it_should_be(setting: Setting, pytestconfig: pytest.Config) -> None:
    limit = None if pytestconfig.getoption("--long") else LATER.get(setting.name, STATES)
    report = explore(Graph(setting), states_limit=limit)
    assert report.found is None, f"\n{report.found}"
    assert report.complete or setting.depth is not None or (limit is not None and report.states >= limit)
    assert report.states >= 200
    # a transfer was under way, and came to its end, in at least some of them
    assert report.station_states >= 50 or setting.standard == "AB"


def test_settings_that_show_a_fault_late_are_explored() -> None:
    assert LATER.keys() <= {setting.name for setting in QUICK}


def test_a_bound_by_states_says_to_which_depth_everything_was_explored() -> None:
    bounded = explore(Graph(TRANSFER), states_limit=500)
    assert (bounded.complete, bounded.extent) == (False, f"complete to depth {bounded.depth}")
    to_this_depth, deeper = (
        explore(Graph(replace(TRANSFER, depth=depth))) for depth in (bounded.depth, bounded.depth + 1)
    )
    assert to_this_depth.states < 500 <= bounded.states < deeper.states


def test_the_program_explores_deep_settings_until_so_many_states_are_known(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["--states", "300", "weak links"]) == 0
    out = capsys.readouterr().out
    assert "1/1 weak links: vehicle and 2 stations; path A AB; up to 2 of: kill station, lose, weak\n" in out
    assert re.search(
        r"^\| weak links \| 30\d \| \d+ \| complete to depth \d+ \| \d+ s \| [\d.]+ s \|$", out, re.MULTILINE
    )
    assert out.endswith("Nothing that must hold is violated in what was explored.\n")


@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        (["transfer"], ["transfer"]),
        (["whole", "lia"], ["liars", "whole flight"]),
        (["--quick", "liar"], ["liars", "three stations, liars"]),
    ],
)
def test_a_setting_is_explored_by_its_name_or_a_part_of_it(
    arguments: list[str], names: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*arguments, "--list"]) == 0
    assert re.findall(r"^\d+/\d+ (.*?): ", capsys.readouterr().out, re.MULTILINE) == names


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["transfers"], "no setting has one of these in its name: transfers\n"),
        (["--states", "-1"], "--states -1: 0 or more\n"),
    ],
)
def test_the_program_refuses_what_would_explore_nothing(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(arguments)
    assert capsys.readouterr().err.endswith(message)


def test_who_was_given_up_behind_a_restart_has_to_answer_before_it_is_asked_again() -> None:
    """It is heard while the forced transfer runs, as is a commander that was lost without a restart."""
    graph = Graph(Setting("given up", path=("A", "AB"), faults=2, kinds=CRASHES))
    state = graph.follow(graph.root(), ("move",))

    def follow_quietly(until: Callable[[AuthorityView], bool]) -> None:
        nonlocal state
        while not until(graph.vehicles[state.vehicle].view):
            state = graph.follow(state, graph.next_quietly(state))

    follow_quietly(lambda view: view.commander == GCSB)
    to_gcsa, to_vehicle = (("deliver", graph.channels.index(ends)) for ends in ((-1, 0), (0, -1)))
    killed, restarted = ("fault", Fault.KILL_STATION, 1), ("fault", Fault.RESTART_VEHICLE, -1)
    for label in (to_gcsa, to_gcsa, killed, restarted, to_vehicle, ("tick",), ("station returns", 1), ("tick",)):
        state = graph.follow(state, label)
    vehicle = graph.vehicles[state.vehicle]
    assert (vehicle.view.lease, vehicle.books.age(GCSB, graph.setting.limits)) == (LeaseState.LOST, 0)
    follow_quietly(lambda view: view.commander == GCSA)


def follow(graph: Graph, state: State, *labels: Label) -> State:
    for label in labels:
        state = graph.follow(state, label)
    return state


def quietly(graph: Graph, state: State, ticks: int) -> State:
    while ticks:
        label = graph.next_quietly(state)
        state = graph.follow(state, label)
        ticks -= label == ("tick",)
    return state


def deliver(graph: Graph, sender: int, receiver: int) -> Label:
    return "deliver", graph.channels.index((sender, receiver))


RESTARTED: Label = ("fault", Fault.RESTART_VEHICLE, -1)


def test_questions_to_a_station_that_was_not_heard_since_the_restart_do_not_count() -> None:
    """GCSB dies, the companion restarts, and GCSB is back four seconds later and answers the next question."""
    graph = Graph(Setting("not heard since", faults=2, kinds=CRASHES))
    to_gcsa, to_gcsb = deliver(graph, -1, 0), deliver(graph, -1, 1)
    state = follow(graph, graph.root(), ("move",), to_gcsa, to_gcsb, to_gcsb, deliver(graph, 1, -1))
    state = follow(graph, state, deliver(graph, 1, 0), ("fault", Fault.KILL_STATION, 1), RESTARTED)
    state = follow(graph, state, deliver(graph, 0, -1), to_gcsa, ("tick",), ("tick",), ("tick",))
    state = quietly(graph, follow(graph, state, ("station returns", 1)), 2)
    assert graph.vehicles[state.vehicle].view.commander == GCSB


def test_a_commit_to_a_deaf_station_is_found_after_a_restart(monkeypatch: pytest.MonkeyPatch) -> None:
    """After the restart GCSB is heard, hears nothing for seven seconds, and answers one question."""
    setting = Setting("deaf", faults=2, kinds=frozenset({Fault.DEAF, Fault.RESTART_VEHICLE}), limits=LUCKY)

    def commander_when_it_hears_again() -> int | None:
        graph = Graph(setting)
        downlink = graph.channels.index((-1, 1))
        state = quietly(graph, follow(graph, graph.root(), ("fault", Fault.DEAF, downlink), RESTARTED), 7)
        state = quietly(graph, follow(graph, state, ("heal", downlink), ("move",)), 2)
        return graph.vehicles[state.vehicle].view.commander

    assert commander_when_it_hears_again() == GCSA
    monkeypatch.setattr(Hearing, "barred", property(lambda self: False))
    monkeypatch.setattr(Hearing, "enough", property(lambda self: True))
    with pytest.raises(Violation, match=f"committed to station {GCSB}, which hears too little"):
        commander_when_it_hears_again()


def test_a_commit_to_a_station_that_was_not_heard_since_the_restart_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    setting = Setting("unheard", standard="B", faults=2, kinds=frozenset({Fault.CUT, Fault.RESTART_VEHICLE}))

    def commander_in_the_zone_of_gcsb() -> int | None:
        graph = Graph(setting)
        uplink = graph.channels.index((1, -1))
        state = follow(graph, graph.root(), ("move",), ("fault", Fault.CUT, uplink), RESTARTED)
        return graph.vehicles[quietly(graph, state, 2).vehicle].view.commander

    assert commander_in_the_zone_of_gcsb() == GCSA
    begin = presence.Presence.__init__

    def begin_as_heard(self: presence.Presence, *known: Any) -> None:
        begin(self, *known)
        self.heard_at = NOW

    monkeypatch.setattr(presence.Presence, "__init__", begin_as_heard)
    with pytest.raises(Violation, match=f"committed to station {GCSB}, which is lost itself"):
        commander_in_the_zone_of_gcsb()


def test_a_grant_on_the_ground_while_the_commander_may_still_come_back_is_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The companion restarts while GCSB commands, and the aircraft lands before GCSB is heard."""
    setting = Setting("landed", path=("A", "AB", "_AB"), faults=2, kinds=CRASHES)

    def commander_after_the_landing() -> int | None:
        graph = Graph(setting)
        state = quietly(graph, follow(graph, graph.root(), ("move",)), 3)
        assert graph.vehicles[state.vehicle].view.commander == GCSB
        state = follow(graph, state, ("fault", Fault.KILL_STATION, 1), RESTARTED, ("move",))
        return graph.vehicles[quietly(graph, state, 1).vehicle].view.commander

    assert commander_after_the_landing() is None
    grant = Arbiter._grant_parent

    def grant_at_once(self: Arbiter, now: float, actions: Any) -> None:
        until, self._authority.recover_until = self._authority.recover_until, None
        grant(self, now, actions)
        self._authority.recover_until = until if self._authority.lost else None

    monkeypatch.setattr(Arbiter, "_grant_parent", grant_at_once)
    with pytest.raises(Violation, match=f"station {GCSA} commands, and there was no transfer to it"):
        commander_after_the_landing()


# ---- planted faults -------------------------------------------------------------------------------------------------


def commit_without_the_partners_word(patch: pytest.MonkeyPatch) -> None:
    patch.setitem(transfer.MOVES, (Step.CONNECT, Cause.TIMEOUT), COMMITTED)


def commit_without_consent(patch: pytest.MonkeyPatch) -> None:
    patch.setitem(transfer.MOVES, (Step.CONSENT, Cause.TIMEOUT), Step.CONNECT)


def commit_without_release(patch: pytest.MonkeyPatch) -> None:
    patch.setitem(transfer.MOVES, (Step.CONNECT, Cause.CONNECTED), COMMITTED)


def commit_raises_no_epoch(patch: pytest.MonkeyPatch) -> None:
    original = Authority.commit

    def forgetful(self: Authority, station: int) -> None:
        original(self, station)
        self.epoch -= 1

    patch.setattr(Authority, "commit", forgetful)


def release_by_the_partner(patch: pytest.MonkeyPatch) -> None:
    original = transfer.cause_of

    def credulous(message: Any, sender: int) -> Cause | None:
        return Cause.RELEASED if isinstance(message, DisconnectHandover) else original(message, sender)

    patch.setattr(transfer_manager, "cause_of", credulous)


def forced_while_the_commander_lives(patch: pytest.MonkeyPatch) -> None:
    original = TransferManager.begin

    def ruthless(self: TransferManager, partner: int, reason: Reason, now: float, actions: Any, **how: Any) -> None:
        original(self, partner, reason, now, actions, **{**how, "forced": True})

    patch.setattr(TransferManager, "begin", ruthless)


def restart_grants_at_once(patch: pytest.MonkeyPatch) -> None:
    original = Authority.restore

    def generous(self: Authority, restored: Any) -> None:
        original(self, restored)
        self.lost, self.recover_until = False, None
        self.refresh(Reason.RESTARTED, [])

    patch.setattr(Authority, "restore", generous)


def restart_raises_no_epoch(patch: pytest.MonkeyPatch) -> None:
    original = Authority.restore

    def forgetful(self: Authority, restored: Any) -> None:
        original(self, restored)
        self.epoch -= 1
        self.refresh(Reason.RESTARTED, [])

    patch.setattr(Authority, "restore", forgetful)


def any_epoch_will_do(patch: pytest.MonkeyPatch) -> None:
    original = TransferManager.on_message

    def lenient(self: TransferManager, station: int, message: Any, now: float, actions: Any) -> str | None:
        if self._authority.transfer is not None:
            message = shown_with(message, self._authority.transfer.key)
        return original(self, station, message, now, actions)

    patch.setattr(TransferManager, "on_message", lenient)


def shown_with(message: Any, key: Any) -> Any:
    """The message, with this key."""
    values = {name: getattr(message, name) for name in message.__dataclass_fields__}
    return type(message)(**{**values, "key": key})


def a_step_that_never_ends(patch: pytest.MonkeyPatch) -> None:
    patch.delitem(transfer.MOVES, (Step.RELEASE, Cause.TIMEOUT))


def an_abort_that_is_never_retried(patch: pytest.MonkeyPatch) -> None:
    """Asked again after the first abort, it knows nobody."""
    original = Candidates.wanted

    def forgetful(self: Candidates, owner: int, now: float, actions: list[Any]) -> tuple[int, Reason] | None:
        found = original(self, owner, now, actions)
        if found is not None:
            self.zones._fresh.discard(found[0])
        return found

    patch.setattr(Candidates, "wanted", forgetful)


def lost_too_soon(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(presence.Presence, "lost_at", lambda self: self.heard_at + 3.0)


def lost_and_nobody_takes_it(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(TransferManager, "_seek_successor", lambda self, lost, now, actions: None)


def the_first_position_counts_as_entry(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(zones.ZoneTracker, "forget_entries", lambda self: None)


def seen_with(change: Callable[[ZoneFact, dict[int, ZoneFact]], ZoneFact]) -> Callable[[pytest.MonkeyPatch], None]:
    """The tracker sees other facts than it is told; `change`: of a fact, and what it was told before."""

    def plant(patch: pytest.MonkeyPatch) -> None:
        original = zones.ZoneTracker.update

        def other(self: zones.ZoneTracker, facts: Any, now: float) -> Any:
            return original(self, [change(fact, self._facts) for fact in facts], now)

        patch.setattr(zones.ZoneTracker, "update", other)

    return plant


def called_before_its_waypoint(patch: pytest.MonkeyPatch) -> None:
    seen_with(lambda fact, _before: replace(fact, awaits=False))(patch)


def not_called_at_its_waypoint(patch: pytest.MonkeyPatch) -> None:
    seen_with(lambda fact, before: replace(fact, awaits=fact.awaits or fact.station in before))(patch)


def an_epoch_that_is_never_learnt(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Authority, "learn", lambda self, station, answer, actions: None)


def told_before_the_gate(patch: pytest.MonkeyPatch) -> None:
    original = Arbiter.handle

    def hasty(self: Arbiter, event: Any, now: float) -> Any:
        return sorted(original(self, event, now), key=lambda action: type(action).__name__ != "Send")

    patch.setattr(Arbiter, "handle", hasty)


def station_believes_anything(patch: pytest.MonkeyPatch) -> None:
    def gullible(self: gcs.StationCore, commander: int | None, epoch: int, actions: list[Any], *, over: bool) -> None:
        self.commander, self.epoch = commander, epoch

    patch.setattr(gcs.StationCore, "_update_authority", gullible)


def station_answers_old_questions(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(gcs.StationCore, "_stale", lambda self, key, *, of_vehicle: False)


def station_consents_for_its_operator(patch: pytest.MonkeyPatch) -> None:
    original = gcs.StationCore._consent

    def eager(self: gcs.StationCore, *asked: Any, as_partner: bool) -> Any:
        part, new = original(self, *asked, as_partner=as_partner)
        part.consent = Consent.GRANTED
        return part, new

    patch.setattr(gcs.StationCore, "_consent", eager)


def a_gap_that_never_ends(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Crossing, "open", lambda self, _now, *, commanded: self.gap is not None)
    patch.setattr(Crossing, "ends_at", lambda _self: None)


def alone_in_no_gap(patch: pytest.MonkeyPatch) -> None:
    """Who has been in one is in it for good."""
    original = Crossing.seen

    def kept(self: Crossing, gap: Any, now: float, *, covered: bool, exposed: bool) -> None:
        original(self, gap or self.gap, now, covered=covered, exposed=exposed)

    patch.setattr(Crossing, "seen", kept)


def new_time_with_each_loss(patch: pytest.MonkeyPatch) -> None:
    def generous(self: Conditions, now: float) -> None:
        self.crossing.since = None
        self.crossing.begin(now)

    patch.setattr(Conditions, "commander_lost", generous)


def energy_is_nothing(patch: pytest.MonkeyPatch) -> None:
    look = Conditions.evaluate
    patch.setattr(Conditions, "evaluate", lambda self, now: look(self, now) - {causes.Cause.ENERGY})


def what_is_milder_comes_first(patch: pytest.MonkeyPatch) -> None:
    """At a border another station is waited for, and not returned for the energy."""
    decide = strategy.decide
    patch.setattr(strategy, "decide", lambda found, *more: decide(found - {causes.Cause.ENERGY} or found, *more))


PLANTED: dict[Callable[[pytest.MonkeyPatch], None], tuple[Setting, str]] = {
    commit_without_the_partners_word: (TWO_MESSAGES, "committed without the word of station 252"),
    commit_without_consent: (TRANSFER, "committed without the consent of station 251"),
    commit_without_release: (TRANSFER, "committed before station 251 released"),
    commit_raises_no_epoch: (TRANSFER, "a commit that does not raise the epoch by one"),
    release_by_the_partner: (LIARS, "committed before station 251 released"),
    forced_while_the_commander_lives: (TRANSFER, "committed without the consent of station 251"),
    restart_grants_at_once: (TRANSFER, "the restart itself grants authority to station 251"),
    restart_raises_no_epoch: (TRANSFER, "the restart raises the epoch by 0"),
    any_epoch_will_do: (LATE, "of another epoch or transfer changed something"),
    a_step_that_never_ends: (TRANSFER, "what is due does not get done"),
    an_abort_that_is_never_retried: (TRANSFER, "station 251 commands on, though the zones of [252] were entered"),
    lost_too_soon: (TRANSFER, "station 251 lost authority, heard 3 s ago"),
    lost_and_nobody_takes_it: (TRANSFER, "no station commands, though [252] live"),
    the_first_position_counts_as_entry: (TRANSFER, "authority wanders to station 25"),
    called_before_its_waypoint: (AWAITED, "authority wanders to station 252"),
    not_called_at_its_waypoint: (AWAITED, "station 251 commands on, though the zones of [252] were entered"),
    an_epoch_that_is_never_learnt: (STATE_LOST, "believes 251 commands"),
    told_before_the_gate: (TRANSFER, "is told of epoch"),
    station_believes_anything: (MESSAGE_LOST, "a station's epoch fell"),
    station_answers_old_questions: (MESSAGE_LOST, "about an old epoch"),
    a_gap_that_never_ends: (GAP, "ALONE for longer than the gap's limit"),
    alone_in_no_gap: (GAP, "ALONE, and in no gap"),
    new_time_with_each_loss: (GAP_TWICE, "ALONE for longer than the gap's limit"),
    energy_is_nothing: (ENERGY, "the energy is for the way back only, and it flies on"),
    what_is_milder_comes_first: (ENERGY, "the energy is for the way back only, and it flies on"),
    station_consents_for_its_operator: (OPERATOR, "OkHandover without the operator's word"),
}


@pytest.mark.parametrize("plant", PLANTED, ids=lambda plant: plant.__name__)
def test_a_planted_fault_is_found(plant: Callable[[pytest.MonkeyPatch], None], monkeypatch: pytest.MonkeyPatch) -> None:
    setting, what = PLANTED[plant]
    plant(monkeypatch)
    report = explore(Graph(setting))
    assert report.found is not None
    assert what in report.found.what


def test_a_violation_is_told_step_by_step(monkeypatch: pytest.MonkeyPatch) -> None:
    lost_too_soon(monkeypatch)
    found = explore(Graph(TRANSFER)).found
    assert found is not None
    assert [line for line in found.story if line[:3].strip()] == [
        "  1 FAULT KILL_STATION GCSA",
        "-- from here on nothing more goes wrong, what is down comes up --",
        "  2 tick",
        "  3 tick",
        "  4 tick",
    ]
    assert str(found).endswith("VIOLATION: station 251 lost authority, heard 3 s ago")
