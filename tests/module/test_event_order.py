# SPDX-License-Identifier: GPL-3.0-or-later

"""Events that are appended while an event is handled: their order, and what becomes of what was ordered before them."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.events import Action, Announce, Event, Fly, LinkJudged, PlaceJudged, Tick
from mavproxy_handover.core.common.model import FlightAction, Phase, Reason
from mavproxy_handover.mission.package import MissionPackage
from tests.module.conftest import Bench
from tests.module.vehicle import LAND, RTL

START, MODE, ARM = mavlink.MAV_CMD_MISSION_START, mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_COMPONENT_ARM_DISARM
FAILED, IN_PROGRESS = mavlink.MAV_RESULT_FAILED, mavlink.MAV_RESULT_IN_PROGRESS
#: a position in the zones of both stations
IN_BOTH_ZONES = (52.679, 5.9270)


def texts(bench: Bench, event: str) -> list[str]:
    return [entry["text"] for entry in bench.journal(event)]


def modes(bench: Bench) -> list[int]:
    """The modes that the autopilot was told to fly, in order."""
    return [int(m.param2) for m in bench.autopilot.got("COMMAND_LONG") if m.command == MODE]


@pytest.fixture
def flying(bench: Bench, delivery: MissionPackage) -> Bench:
    """On its mission, in both zones."""
    bench.config.write_text(bench.config.read_text() + '[policy]\nno_station = "off"\ncoverage_ends = "off"\n')
    bench.connect()
    bench.share(delivery, at_once=True)
    bench.wait(6.0)
    bench.a.command(START)
    bench.until(lambda: bench.companion.view.phase is Phase.ON_MISSION)
    bench.autopilot.position = IN_BOTH_ZONES
    bench.wait(20.0)
    bench.autopilot.received.clear()
    return bench


def test_a_return_that_is_followed_by_a_landing_is_told_and_never_ordered(flying: Bench) -> None:
    """The last look before a return finds that no place is in reach. So the return is followed by a landing."""
    places = flying.companion.autopilot.return_site
    look = places.before_return

    def finds_nothing(now: float, *, returning: bool) -> Callable[[], bool]:
        written = look(now, returning=returning)
        flying.companion.handle(PlaceJudged("home", False, "out of reach"), now)
        return written

    places.before_return = finds_nothing  # type: ignore[method-assign]
    flying.a.alive = flying.b.alive = False
    flying.until(lambda: flying.autopilot.mode in (LAND, RTL), 20.0)
    flying.wait(3.0)
    assert modes(flying) == [LAND]
    assert texts(flying, "fly") == ["the autopilot flies LAND"]
    assert texts(flying, "emergency") == ["commander lost: return", "commander lost: land"]
    assert texts(flying, "decision") == [
        "RETURN to home. GCSA silent for 5 s. 203 m away, needs 6 % of the battery (100 % left), covered by no station",
        "LAND. GCSA silent for 5 s",
    ]
    heard = flying.b.texts()
    assert heard.index("RETURN to home. GCSA silent for 5 s") < heard.index("LAND. GCSA silent for 5 s")


def test_a_return_to_another_place_is_ordered_after_the_place_is_written_and_told_once(
    bench: Bench, delivery: MissionPackage
) -> None:
    bench.connect()
    bench.share(delivery)
    bench.wait(6.0)
    bench.a.command(START)
    bench.until(lambda: bench.companion.view.phase is Phase.ON_MISSION)
    bench.autopilot.position = IN_BOTH_ZONES
    bench.wait(20.0)
    bench.autopilot.received.clear()
    bench.a.alive = bench.b.alive = False
    bench.until(lambda: bench.autopilot.mode == RTL, 20.0)
    bench.wait(3.0)
    assert modes(bench) == [RTL]
    assert texts(bench, "fly") == ["the autopilot flies RTL"]
    assert [text.partition(".")[0] for text in texts(bench, "decision")] == ["RETURN to home"]


def test_a_start_that_ends_with_its_commander_is_over_for_the_rules_too(ready: Bench) -> None:
    """The new view ends the START; the word that it is over is an event of its own."""
    ready.autopilot.script[ARM] = None
    ready.a.command(START)
    ready.until(lambda: ARM in ready.autopilot.commands())
    ready.a.alive = False
    ready.until(lambda: ready.companion.view.commander is None)
    ready.run(0.5)
    assert texts(ready, "start_failed") == ["START failed: its commander no longer has authority"]
    assert ready.a.acks(START) == [IN_PROGRESS, FAILED]
    assert ready.a.texts().count("START failed: its commander no longer has authority") == 1
    assert not ready.companion.arbiter._authority.starting
    assert ready.b.got("CONTROL_STATUS")[-1].gcs_main == 0


def test_a_way_home_that_ends_a_start_is_commanded_and_the_start_is_over(ready: Bench) -> None:
    ready.autopilot.script[ARM] = None
    ready.a.command(START)
    ready.until(lambda: ARM in ready.autopilot.commands())
    ready.autopilot.received.clear()
    ready.decide(Fly(FlightAction.LAND, Reason.COMMANDER_LOST))
    ready.run(1.0)
    assert modes(ready) == [LAND]
    assert texts(ready, "start_failed") == ["START failed: the aircraft is brought home"]
    assert ready.a.acks(START) == [IN_PROGRESS, FAILED]
    assert not ready.companion.arbiter._authority.starting


# ---- the order of events ------------------------------------------------------------------------------------------


def handled(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The texts of links that are judged and of decisions that are told from now on, in order."""
    seen: list[str] = []
    handle, decision = bench.companion.arbiter.handle, bench.companion.event_log.decision

    def handles(event: Event, now: float) -> list[Action]:
        if isinstance(event, LinkJudged):
            seen.append(event.text)
        result: list[Action] = handle(event, now)
        return result

    def decides(told: Announce) -> None:
        seen.append(told.text)
        decision(told)

    monkeypatch.setattr(bench.companion.arbiter, "handle", handles)
    monkeypatch.setattr(bench.companion.event_log, "decision", decides)
    return seen


def judged(text: str) -> LinkJudged:
    return LinkJudged(252, False, False, text)


def told(text: str) -> Announce:
    return Announce(text, None, Reason.NONE)


def test_events_that_an_action_appends_come_after_all_actions_in_the_order_of_appending(
    ready: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = handled(ready, monkeypatch)
    announce = ready.companion._parts.news.announcer.tell

    def tell(action: Announce, now: float) -> None:
        announce(action, now)
        if action.text == "first":
            ready.companion.handle(judged("appended first"), now)
            ready.companion.handle(judged("appended second"), now)

    monkeypatch.setattr(ready.companion._parts.news.announcer, "tell", tell)
    ready.decide(told("first"), told("second"))
    assert seen == ["first", "second", "appended first", "appended second"]


def test_an_action_that_breaks_costs_neither_the_next_one_nor_an_event_that_waits(
    ready: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = handled(ready, monkeypatch)

    def tell(action: Announce, now: float) -> None:
        if action.text == "first":
            ready.companion.handle(judged("appended"), now)
            raise RuntimeError("a bug")

    monkeypatch.setattr(ready.companion._parts.news.announcer, "tell", tell)
    ready.decide(told("first"), told("second"))
    assert seen == ["first", "second", "appended"]
    assert ready.companion.faults == {"action Announce": 1}


def test_after_an_internal_fault_no_event_that_waits_is_handled(flying: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """The arbiter breaks on an event that another one has appended; more of them wait."""
    seen = handled(flying, monkeypatch)
    companion = flying.companion

    def tell(_action: Announce, now: float) -> None:
        for text in ("breaks", "waits", "waits too"):
            companion.handle(judged(text), now)

    handle = companion.arbiter.handle

    def breaks(event: Event, now: float) -> list[Action]:
        result: list[Action] = handle(event, now)
        if isinstance(event, LinkJudged) and event.text == "breaks":
            raise RuntimeError("a bug")
        return result

    companion.arbiter.handle = breaks
    monkeypatch.setattr(companion._parts.news.announcer, "tell", tell)
    flying.decide(told("first"), told("second"))
    assert seen[:3] == ["first", "second", "breaks"]
    assert "waits" not in seen
    assert companion.failed
    assert companion.view.commander is None
    flying.wait(3.0)
    assert companion.view.commander is None, "it hears both stations, and grants nothing"
    assert "waits" not in seen
    assert modes(flying) == [RTL]


def test_of_two_orders_only_the_last_one_is_given_to_the_autopilot(flying: Bench) -> None:
    flying.decide(Fly(FlightAction.RETURN, Reason.COMMANDER_LOST), Fly(FlightAction.LAND, Reason.COMMANDER_LOST))
    flying.run(2.0)
    assert modes(flying) == [LAND]


def test_an_event_that_is_handled_inside_another_one_is_noticed(
    ready: Bench, monkeypatch: pytest.MonkeyPatch, nested_events: list[str]
) -> None:
    """The check that all tests of this folder end with can fail."""
    monkeypatch.setattr(
        ready.companion._parts.news.announcer, "tell", lambda _told, now: ready.companion._apply_event(Tick(), now)
    )
    ready.decide(told("first"))
    assert nested_events == ["Tick inside Tick"]
    nested_events.clear()
