# SPDX-License-Identifier: GPL-3.0-or-later

"""When something of ours breaks: nothing reaches MAVProxy, a healthy arbiter's leases go on, a broken one's end.

The leases are the measure: while they flow the guard lets the aircraft fly.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.events import Fly, ModeSourceSeen
from mavproxy_handover.core.common.model import FlightAction, ModeSource, Phase, Reason
from mavproxy_handover.core.safety.battery import Batteries
from mavproxy_handover.core.safety.learning import Learner
from mavproxy_handover.gate.flush import FlushTracker
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.monitors.energy import EnergyMonitor
from mavproxy_handover.monitors.route import RouteMonitor
from mavproxy_handover.wire.conversation import Ask, Asking
from tests.module.conftest import Bench
from tests.module.vehicle import LAND as LAND_MODE
from tests.module.vehicle import RTL as RTL_MODE

START, MODE, RTL = mavlink.MAV_CMD_MISSION_START, mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH
NOT_IN_CONTROL = 10


def broken(*_arguments: Any, **_values: Any) -> Any:
    raise RuntimeError("a bug")


def leases_in(bench: Bench, seconds: float) -> int:
    before = len(bench.autopilot.leases())
    bench.run(seconds)
    return len(bench.autopilot.leases()) - before


@pytest.fixture
def flight(bench: Bench) -> Bench:
    bench.connect()
    return bench


HEALTHY: dict[str, Callable[[Bench, pytest.MonkeyPatch], None]] = {
    "reading a link": lambda b, patch: patch.setattr(b.companion.ports[252], "read", broken),
    "reading every link": lambda b, patch: [patch.setattr(port, "read", broken) for port in b.companion.ports.values()],
    "the descriptor of a link": lambda b, patch: patch.setattr(b.companion.ports[252].links[0], "fileno", broken),
    "judging a frame": lambda b, patch: patch.setattr(b.companion.gate, "up", broken),
    "sending to a station": lambda b, patch: patch.setattr(b.companion.ports[251], "write", broken),
    "the console": lambda b, patch: patch.setattr(b.mpstate.console, "writeln", broken),
    "asking what MAVProxy waits for": lambda b, patch: patch.setattr(
        "mavproxy_handover.companion.module.waited_for", broken
    ),
    "measuring links": lambda b, patch: patch.setattr(b.companion.ports[252], "tick", broken),
    "the side doors": lambda b, patch: patch.setattr(b.module, "_close_side_doors", broken),
    "the state of the aircraft": lambda b, patch: patch.setattr(b.companion.autopilot.aircraft, "on_message", broken),
    "the downlink": lambda b, patch: patch.setattr(b.companion.gate, "down", broken),
    "the telemetry": lambda b, patch: patch.setattr(b.companion.autopilot.aircraft, "record", broken),
    "the zone finder": lambda b, patch: patch.setattr(b.companion.autopilot.zones, "facts", broken),
    "a conversation": lambda b, patch: b.companion.autopilot.conversations.begin(
        "load", broken_asking(), broken, b.clock.now
    ),
}


def broken_asking() -> Asking:
    """A conversation with a bug in it, which shows with the next message."""
    yield Ask("anything", (), broken)


@pytest.mark.parametrize("part", list(HEALTHY))
def test_a_broken_part_does_not_stop_the_leases(flight: Bench, part: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        HEALTHY[part](flight, patch)
        assert 14 <= leases_in(flight, 3.0) <= 16
        assert not flight.companion.failed
        assert part == "the console" or flight.companion.faults, "what breaks is counted"
    assert flight.mpstate.escaped == []
    flight.wait(6.0)
    assert flight.companion.view.commander == 251, "and it is over when the cause is gone"


#: what breaks -> who is told of it
IN_FLIGHT: dict[str, tuple[Callable[[Bench, pytest.MonkeyPatch], None], str]] = {
    "telemetry": (HEALTHY["the telemetry"], "telemetry"),
    "sending to the partner": (
        lambda b, patch: patch.setattr(b.companion.ports[252], "write", broken),
        "sending to GCSB",
    ),
    "the memory of the batteries": (
        lambda b, patch: patch.setattr(EnergyMonitor, "memory", property(broken)),
        "memory of the batteries",
    ),
    "what was learned": (lambda b, patch: patch.setattr(Learner, "model", broken), "energy"),
    "what is left in the batteries": (lambda b, patch: patch.setattr(Batteries, "charge", broken), "energy"),
    "the console": (lambda b, patch: patch.setattr(b.mpstate.console, "writeln", broken), "console"),
    "the journal of decisions": (lambda b, patch: patch.setattr(b.companion.event_log, "decision", broken), "journal"),
    "keeping the state": (lambda b, patch: patch.setattr(b.companion._base.restart, "each_second", broken), "state"),
    "repeating what was decided": (
        lambda b, patch: patch.setattr(b.companion._parts.news.announcer, "tick", broken),
        "word of a decision",
    ),
    "the borders ahead": (
        lambda b, patch: patch.setattr(b.companion.autopilot.rounds._monitors.borders, "update", broken),
        "the way ahead",
    ),
    "the route": (lambda b, patch: patch.setattr(RouteMonitor, "deviation", property(broken)), "route condition"),
    "the fence": (
        lambda b, patch: patch.setattr("mavproxy_handover.monitors.conditions.breach", broken),
        "fence condition",
    ),
    "what the autopilot says to the places": (
        lambda b, patch: patch.setattr(b.companion.autopilot.return_site, "on_message", broken),
        "return sites",
    ),
}


@pytest.mark.parametrize("part", list(IN_FLIGHT))
def test_a_broken_part_does_not_silence_the_strategy(
    bench: Bench, delivery: MissionPackage, part: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In flight with a battery that empties: the aircraft returns all the same, and people know what has broken."""
    bench.autopilot.battery = 1.0
    bench.connect()
    bench.share(delivery)
    bench.run(1.5)
    bench.a.command(START)
    bench.until(lambda: bench.companion.view.phase is Phase.ON_MISSION)
    bench.run(2.0)
    bench.autopilot.battery = 0.3  # 37.8 Wh, of which 34.8 have to be left at the last
    bench.wait(10.0)
    assert bench.autopilot.mode != RTL_MODE
    plant, where = IN_FLIGHT[part]
    plant(bench, monkeypatch)
    bench.autopilot.battery = 0.05
    bench.until(lambda: bench.autopilot.mode == RTL_MODE, 90.0)
    bench.run(1.5)
    said = bench.a.texts()
    assert said.count(f"internal fault of the companion: {where}") == 1
    assert "RETURN to home. " in said
    assert not bench.companion.failed
    monkeypatch.undo()


def test_a_conversation_that_breaks_is_over_and_is_told(flight: Bench) -> None:
    ends: list[str | None] = []
    conversations = flight.companion.autopilot.conversations
    conversations.begin("load", broken_asking(), lambda ended, now: ends.append(ended.failure), flight.clock.now)
    flight.run(1.0)
    assert ends == ["internal fault: a bug"]
    assert "load" not in conversations
    assert flight.companion.faults == {"conversation load": 1}


def test_what_breaks_is_journalled_ten_times_and_counted_for_ever(
    flight: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(flight.companion.ports[252], "read", broken)
        flight.run(2.0)
    entries = flight.journal("fault")
    assert len(entries) == 10
    assert entries[0]["text"].startswith("link: ")
    assert "RuntimeError: a bug" in entries[0]["text"]
    assert flight.companion.faults["link"] >= 40
    lines = flight.mpstate.type("handover status")
    assert any(line.startswith("faults    link ") for line in lines)


def test_an_action_that_breaks_does_not_take_those_behind_it_along(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sending on a change of view breaks: who commands, and what is journalled of it, must not depend on that."""
    bench.load()
    monkeypatch.setattr(bench.companion._parts.beacons, "send_authority_status", broken)
    bench.until(lambda: bench.companion.view.commander == 251)
    assert bench.companion.faults["action ViewChanged"] == 2  # disarmed, then the grant
    bench.run(2.0)
    assert bench.companion.arbiter.connected(252, bench.clock.now)
    monkeypatch.undo()


def test_the_way_home_is_commanded_although_the_console_is_gone(
    bench: Bench, delivery: MissionPackage, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench.connect()
    bench.share(delivery)
    bench.run(1.0)
    bench.a.command(START)
    bench.until(lambda: bench.companion.view.phase is Phase.ON_MISSION)
    bench.run(0.5)
    with monkeypatch.context() as patch:
        patch.setattr(bench.mpstate.console, "writeln", broken)
        bench.a.alive = bench.b.alive = False
        bench.until(lambda: bench.journal("fly"))
    assert bench.autopilot.mode == RTL_MODE
    assert bench.journal("fly")[-1]["obeyed"] is True


# ---- the arbiter itself -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("entry_point", ["handle", "next_deadline", "grounded", "alone_s"])
def test_a_broken_arbiter_fails_closed(flight: Bench, entry_point: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(flight.companion.arbiter, entry_point, broken)
        flight.run(1.5)
    assert flight.companion.failed
    assert flight.companion.view.commander is None
    assert leases_in(flight, 5.0) == 0, "and it stays so, although the cause is gone"
    flight.autopilot.received.clear()
    flight.a.command(RTL)
    flight.wait(3.0)
    assert {m.get_srcSystem() for m in flight.autopilot.received} == {1}, "neither command nor heartbeat passes"
    assert flight.a.acks(RTL) == [NOT_IN_CONTROL]
    assert flight.mpstate.console.said("INTERNAL FAULT, authority ends here: RuntimeError: a bug")
    (entry,) = flight.journal("failed_closed")
    assert entry["reason"] == "fault"
    assert "RuntimeError: a bug" in entry["text"]
    assert [m.commander for m in flight.b.got("AUTHORITY_STATUS")][-1] == 0
    assert flight.mpstate.type("handover status")[0] == "phase     ON_LOAD  (INTERNAL FAULT: no station commands)"


@pytest.mark.parametrize("part", ["snapshot", "the state", "the gate"])
def test_a_view_that_cannot_be_put_in_force_fails_closed(
    airborne: Bench, part: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The former one would stay in force, with leases, and the arbiter would believe that the new one does."""
    companion = airborne.companion
    with monkeypatch.context() as patch:
        if part == "snapshot":
            patch.setattr(companion.arbiter, "snapshot", broken)
        elif part == "the state":
            patch.setattr(companion._base.restart, "save", broken)
        else:
            patch.setattr(companion.gate, "change", once_broken(companion.gate.change))
        airborne.a.alive = False
        airborne.wait(6.0)
    assert companion.failed
    assert companion.view.commander is None
    assert leases_in(airborne, 5.0) == 0
    assert airborne.autopilot.mode == RTL_MODE
    (entry,) = airborne.journal("failed_closed")
    assert "a new view could not be put in force" in entry["text"]
    assert "RuntimeError: a bug" in entry["text"]
    assert [m.get_type() for m in airborne.autopilot.received if m.get_srcSystem() == 251][:1] == [
        "RC_CHANNELS_OVERRIDE"
    ], "what the commander had open is closed"


def test_what_breaks_behind_a_view_that_is_in_force_ends_nothing(
    airborne: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(FlushTracker, "flush", broken)
        airborne.a.alive = False
        airborne.wait(6.0)
    assert not airborne.companion.failed
    assert airborne.companion.view.commander is None
    assert airborne.companion.faults["what follows from a new view"] == 1
    assert leases_in(airborne, 1.0) >= 4


def test_a_start_that_is_under_way_ends_with_the_arbiter(
    bench: Bench, delivery: MissionPackage, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Otherwise a vehicle without a guard would take off with nobody in command."""
    bench.connect()
    bench.share(delivery)
    bench.run(1.0)
    bench.autopilot.script[MODE] = None
    bench.a.command(START)
    bench.run(0.3)
    with monkeypatch.context() as patch:
        patch.setattr(bench.companion.arbiter, "handle", broken)
        bench.run(0.3)
    del bench.autopilot.script[MODE]
    bench.wait(5.0)
    assert not bench.autopilot.armed
    assert mavlink.MAV_CMD_COMPONENT_ARM_DISARM not in bench.autopilot.commands()
    assert bench.a.acks(START)[-1] == mavlink.MAV_RESULT_FAILED
    assert "START failed: internal fault" in bench.a.texts()


@pytest.fixture
def airborne(bench: Bench, delivery: MissionPackage) -> Bench:
    """In flight, and GCSA has sticks and a velocity open at the autopilot."""
    bench.connect()
    bench.share(delivery, at_once=True)
    bench.run(1.0)
    bench.a.command(START)
    bench.until(lambda: bench.companion.view.phase is Phase.ON_MISSION)
    bench.run(0.5)
    bench.a.send(mavlink.MAVLink_rc_channels_override_message(1, 1, 1500, *[65535] * 17))
    velocity = 0b1101_1100_0111
    bench.a.send(mavlink.MAVLink_set_position_target_global_int_message(0, 1, 1, 6, velocity, 0, 0, 0, 5, *[0] * 7))
    bench.run(0.1)
    bench.autopilot.received.clear()
    return bench


@pytest.mark.parametrize("entry_point", ["grounded", "alone_s"])
def test_an_arbiter_that_cannot_say_how_things_are_brings_the_aircraft_home(
    airborne: Bench, entry_point: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What energy, places and the lease rest on is asked of it each second."""
    with monkeypatch.context() as patch:
        patch.setattr(airborne.companion.arbiter, entry_point, broken)
        airborne.run(2.0)
    assert airborne.companion.failed
    assert airborne.autopilot.mode == RTL_MODE
    assert len(airborne.journal("failed_closed")) == 1


def test_positions_that_are_compared_to_no_zone_bring_the_aircraft_home(
    airborne: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing else would say that it has left them all."""
    monkeypatch.setattr(airborne.companion.autopilot.zones, "facts", broken)
    airborne.wait(4.0)
    assert not airborne.companion.failed
    airborne.until(lambda: airborne.autopilot.mode == RTL_MODE, 3.0)
    assert airborne.companion.failed
    (entry,) = airborne.journal("failed_closed")
    assert entry["text"].startswith("positions cannot be compared to the zones: ")


def test_what_breaks_behind_the_comparison_costs_no_more_than_itself(
    airborne: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(RouteMonitor, "update", broken)
    airborne.wait(10.0)
    assert not airborne.companion.failed
    assert airborne.companion.faults.keys() == {"route"}


def test_a_return_is_ordered_although_who_asked_for_start_cannot_be_told(
    bench: Bench, delivery: MissionPackage, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench.connect()
    bench.share(delivery)
    bench.run(1.0)
    bench.autopilot.script[mavlink.MAV_CMD_COMPONENT_ARM_DISARM] = None
    bench.a.command(START)
    bench.run(0.3)
    assert bench.companion.autopilot.orders.starting
    monkeypatch.setattr(bench.companion.ports[251], "write", broken)
    bench.companion._parts.actions.perform(Fly(FlightAction.RETURN, Reason.ENERGY), bench.clock.now)
    bench.run(1.0)
    assert bench.autopilot.mode == RTL_MODE


def test_a_station_that_cannot_be_written_to_costs_the_others_nothing(
    flight: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither what the autopilot says nor what the gate answers."""
    monkeypatch.setattr(flight.companion.ports[251], "write", broken)
    flight.b.received.clear()
    flight.wait(5.0)
    assert len(flight.b.got("GLOBAL_POSITION_INT")) >= 20
    assert len([m for m in flight.b.got("HEARTBEAT") if m.get_srcComponent() == 1]) >= 4
    assert flight.companion.faults.keys() == {"sending to GCSA"}


def test_telling_one_station_of_a_fault_may_break_too(flight: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    companion = flight.companion
    companion.faults["clock"] = 1
    monkeypatch.setattr(companion.ports[251], "write", broken)
    companion._parts.faults.each_second(flight.clock.now)
    monkeypatch.undo()
    flight.run(1.5)
    assert flight.b.texts().count("internal fault of the companion: clock") == 1
    assert flight.b.texts().count("internal fault of the companion: sending to GCSA") == 1


def test_a_fault_is_told_to_whoever_hears_it_later(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """And again at the next take-off, if more of it came since."""
    bench.load()
    monkeypatch.setattr(bench.companion.event_log, "clock", broken)
    words = "internal fault of the companion: clock"
    bench.a.alive = bench.b.alive = False
    bench.wait(5.0)
    assert bench.companion.faults["clock"] >= 4
    assert words not in bench.a.texts() + bench.b.texts()
    bench.a.alive = bench.b.alive = True
    bench.wait(5.0)
    assert [each.texts().count(words) for each in (bench.a, bench.b)] == [1, 1]
    bench.autopilot.armed = True
    bench.wait(5.0)
    assert [each.texts().count(words) for each in (bench.a, bench.b)] == [2, 2]


def test_what_the_commander_had_open_is_closed_when_the_arbiter_breaks(
    airborne: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nobody is left who would release the sticks, and the way home must not wait for the autopilot's time-outs."""
    with monkeypatch.context() as patch:
        patch.setattr(airborne.companion.arbiter, "handle", broken)
        airborne.run(1.0)
    assert airborne.companion.failed
    closed = [m for m in airborne.autopilot.received if m.get_srcSystem() == 251]
    assert [m.get_type() for m in closed] == ["RC_CHANNELS_OVERRIDE", "SET_POSITION_TARGET_GLOBAL_INT"]
    assert (closed[0].chan1_raw, closed[1].vx) == (0, 0.0)
    home = next(m for m in airborne.autopilot.received if m.get_type() == "COMMAND_LONG" and m.command == MODE)
    assert airborne.autopilot.received.index(closed[-1]) < airborne.autopilot.received.index(home)
    assert airborne.autopilot.mode == RTL_MODE
    assert [entry["text"] for entry in airborne.journal("flush")] == [
        "RC override released (GCSA)",
        "guided stream stopped (GCSA)",
    ]


@pytest.mark.parametrize("part", ["flush", "end of START", "console"])
def test_the_way_home_is_commanded_although_more_than_the_arbiter_breaks(
    airborne: Bench, part: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    companion = airborne.companion
    with monkeypatch.context() as patch:
        patch.setattr(companion.arbiter, "handle", broken)
        if part == "flush":
            patch.setattr(FlushTracker, "flush", broken)
        elif part == "console":
            patch.setattr(airborne.mpstate.console, "writeln", broken)
        else:
            orders = companion.autopilot.orders
            patch.setattr(orders, "give_start_up", once_broken(orders.give_start_up))
        airborne.run(1.0)
    assert airborne.companion.failed
    assert airborne.companion.faults[part] >= 1
    assert airborne.autopilot.mode == RTL_MODE


def once_broken(original: Callable[..., Any]) -> Callable[..., Any]:
    """Breaks at the first call: the way home ends a START too."""
    calls: list[Any] = []

    def call(*arguments: Any) -> Any:
        calls.append(arguments)
        if len(calls) == 1:
            broken()
        return original(*arguments)

    return call


def test_a_mode_that_the_commander_chose_is_the_commander_s_though_the_journal_breaks(
    airborne: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The fault: a fault in the journal hid who had chosen the mode, and it counted as another source's."""
    hands: list[Any] = []
    handle = airborne.companion.arbiter.handle

    def watched(event: Any, now: float) -> Any:
        hands.append(event)
        return handle(event, now)

    monkeypatch.setattr(airborne.companion.arbiter, "handle", watched)
    monkeypatch.setattr(airborne.companion.event_log, "accepted", broken)
    airborne.a.command(MODE, 1, 5)
    airborne.run(0.3)
    assert any(isinstance(event, ModeSourceSeen) and event.hand is ModeSource.COMMANDER for event in hands)


# ---- odd things from MAVProxy -------------------------------------------------------------------------------------


class OddMessage:
    """A message as no MAVLink library makes it."""

    def __init__(self, raw: bytes) -> None:
        self._raw = raw

    def get_msgbuf(self) -> bytes:
        return self._raw


@pytest.mark.parametrize(
    "message",
    [
        OddMessage(b""),
        OddMessage(b"\xfd"),
        OddMessage(bytes(280)),
        OddMessage(bytes.fromhex("fd09000007010100000000000000000608c00403") + b"\0\0"),
        object(),
        None,
    ],
)
def test_no_message_of_the_vehicles_side_makes_anything_escape(flight: Bench, message: Any) -> None:
    flight.breaks = True
    flight.mpstate.deliver(message)
    assert flight.mpstate.escaped == []
    assert leases_in(flight, 1.0) >= 4


def test_the_master_may_come_and_go(flight: Bench) -> None:
    master = flight.mpstate.mav_master.pop()
    flight.run(1.0)
    flight.mpstate.mav_master.append(master)
    assert leases_in(flight, 1.0) >= 4
    assert flight.companion.faults == {}


def test_a_master_that_cannot_write_costs_frames_and_nothing_else(flight: Bench) -> None:
    master = flight.mpstate.mav_master[0]
    master.broken = OSError("device gone")
    flight.run(2.0)
    assert flight.companion.view.commander == 251
    master.broken = None
    assert leases_in(flight, 1.0) >= 4


def test_a_handler_keeps_its_socket_whatever_happens(flight: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """MAVProxy takes the socket of a handler that raises off its list without a word."""
    with monkeypatch.context() as patch:
        patch.setattr(flight.companion, "on_station", broken)
        flight.b.command(RTL)
        for descriptor, (function, argument) in list(flight.mpstate.select_extra.items()):
            flight.mpstate._call(function, argument)
            assert descriptor in flight.mpstate.select_extra
    assert len(flight.mpstate.select_extra) == 2


def test_unload_gives_the_settings_back_although_closing_breaks(flight: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(flight.companion, "close", broken)
        assert flight.mpstate.unload("handover")
    assert flight.mpstate.settings.mavfwd
    assert flight.mpstate.select_extra == {}
    flight.companion.close()


def test_rounds_of_the_main_loop_after_unload_do_no_harm(flight: Bench) -> None:
    """At the end of MAVProxy the main loop may come round once more."""
    module = flight.module
    flight.mpstate.unload("handover")
    module.idle_task()
    module.mavlink_packet(None)
    assert flight.mpstate.escaped == []


# ---- what it takes to fail closed -----------------------------------------------------------------------------------


@pytest.mark.parametrize("also", ["the entry", "the journal", "the console"])
def test_what_breaks_while_it_fails_closed_does_not_stop_that(
    airborne: Bench, also: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The fault: the entry in the journal was made unguarded, before the way home was ordered."""
    companion = airborne.companion
    with monkeypatch.context() as patch:
        patch.setattr(companion.arbiter, "handle", broken)
        patch.setattr(companion.event_log, "failed_closed", broken)
        if also == "the journal":  # so a fault cannot be written down either
            patch.setattr(companion.journal, "write", broken)
        elif also == "the console":
            patch.setattr(airborne.mpstate.console, "writeln", broken)
        airborne.wait(3.0)
    assert companion.failed
    assert companion.view.commander is None
    assert companion.faults["journal"] >= 1
    assert airborne.autopilot.mode == RTL_MODE
    assert leases_in(airborne, 5.0) == 0
    assert "RETURN: internal fault of the companion, no station commands" in airborne.b.texts()


def test_it_comes_home_though_nobody_can_say_whether_it_lands(airborne: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(type(airborne.companion.autopilot.orders), "landing", property(broken))
        airborne.companion.fail_closed("planted", airborne.clock.now)
        airborne.run(2.0)
    assert airborne.companion.faults["way home"] == 1
    assert airborne.autopilot.mode == RTL_MODE
    assert "RETURN: internal fault of the companion, no station commands" in airborne.b.texts()


def test_what_lands_already_is_not_made_to_return(airborne: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """The fault: a landing, decided because no place could be reached, was ended by a return."""
    airborne.autopilot.mode = LAND_MODE
    airborne.run(2.0)
    monkeypatch.setattr(airborne.companion.arbiter, "handle", broken)
    airborne.wait(3.0)
    assert airborne.companion.failed
    assert airborne.autopilot.mode == LAND_MODE
    assert MODE not in airborne.autopilot.commands()
    assert "LAND: internal fault of the companion, no station commands" in airborne.b.texts()


def test_nor_what_was_ordered_to_land_and_does_not_show_it(airborne: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    airborne.autopilot.script[MODE] = None  # the answer is lost
    airborne.companion.autopilot.orders.fly(FlightAction.LAND, airborne.clock.now)
    airborne.run(0.2)
    monkeypatch.setattr(airborne.companion.arbiter, "handle", broken)
    airborne.run(0.5)
    assert airborne.companion.failed
    del airborne.autopilot.script[MODE]
    airborne.wait(3.0)
    assert airborne.autopilot.mode == LAND_MODE


def test_what_comes_down_in_its_mission_lands(airborne: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """A return would climb once more, and a mission that lands on its way would take off again."""
    telemetry = airborne.companion.autopilot.aircraft.telemetry
    landing = replace(telemetry.landed, state=mavlink.MAV_LANDED_STATE_LANDING)
    monkeypatch.setattr(telemetry, "landed", landing)
    airborne.companion.fail_closed("planted", airborne.clock.now)
    airborne.wait(3.0)
    assert airborne.autopilot.mode == LAND_MODE
