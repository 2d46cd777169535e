# SPDX-License-Identifier: GPL-3.0-or-later

"""A whole flight through the real module: the stations' own rules at the other end of real sockets.

Zone A ends at longitude 5.9285 on latitude 52.679, zone B begins at 5.9262 and ends at 5.9341.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import partial
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from gcs_module.core import FromVehicle, MissionHeld, StationCore, ToVehicle
from mavproxy_handover.core.common.messages import (
    DisconnectHandover,
    DroneConnected,
    OkHandover,
    OnHandover,
    TransferKey,
)
from mavproxy_handover.core.common.model import (
    AUTOMATIC,
    Consent,
    LeaseState,
    Phase,
    Station,
)
from mavproxy_handover.mission.package import MissionPackage, from_texts
from mavproxy_handover.wire import codec
from tests import console_lines
from tests.module import vehicle
from tests.module.conftest import Bench
from tests.module.vehicle import GUIDED, RTL

START, LAND = mavlink.MAV_CMD_MISSION_START, mavlink.MAV_CMD_NAV_LAND
PAUSE = mavlink.MAV_CMD_DO_PAUSE_CONTINUE
NOT_IN_CONTROL = 10
IN_A, IN_BOTH, IN_B, OUTSIDE = (52.679, 5.924), (52.679, 5.9272), (52.679, 5.931), (52.679, 5.936)


def give_rules(station: vehicle.Station, core: StationCore, bench: Bench) -> None:
    """From here on the station answers what its rules say, and not only CONNECT."""
    seen = len(station.received)
    original = station.step

    def step(now: float) -> None:
        nonlocal seen
        original(now)
        while seen < len(station.received):
            message, seen = codec.decode(station.received[seen]), seen + 1
            if message is None or not station.alive:
                continue
            for action in core.handle(FromVehicle(message), bench.clock.now):
                if isinstance(action, ToVehicle):
                    station.send(codec.encode(action.message, (1, 191), 1))

    station._answer = lambda message: None  # type: ignore[method-assign]
    station.step = step  # type: ignore[method-assign]


def begin_flight(
    bench: Bench, delivery: MissionPackage, *, refused: bool = False, operators: Mapping[str, str] | None = None
) -> Bench:
    """On its way in zone A, GCSA in command, no ground link between the stations. `refused`: GCSB has tried START;
    `operators`: who is on duty at a station."""
    bench.connect()
    bench.share(delivery, at_once=True)
    for station, other in ((bench.a, bench.b), (bench.b, bench.a)):
        core = StationCore(
            Station(station.sysid, station.name),
            "drone-1",
            (Station(other.sysid, other.name),),
            automatic=AUTOMATIC,
        )
        core.operator = (operators or {}).get(station.name, "")
        core.handle(MissionHeld(delivery.digest), bench.clock.now)
        give_rules(station, core, bench)
    bench.wait(1.5)
    # told later, it would stand among the steps of a handover
    bench.until(lambda: bench.mpstate.console.said("Preflight: guard, parameters and firmware fit."))
    if refused:
        bench.b.command(START)
        bench.run(0.3)
    bench.a.command(START)
    bench.until(lambda: bench.companion.view.phase is Phase.ON_MISSION)
    bench.run(0.5)
    return bench


@pytest.fixture
def flight(bench: Bench, delivery: MissionPackage) -> Bench:
    return begin_flight(bench, delivery)


def say(bench: Bench, message: Any) -> None:
    """The autopilot says it now."""
    bench.autopilot.say(message)
    bench.mpstate.deliver(bench.autopilot._out.pop())


def commander(bench: Bench) -> Any:
    return bench.companion.view.commander


def hand_over(bench: Bench) -> None:
    bench.autopilot.position = IN_BOTH
    bench.until(lambda: commander(bench) == 252)


def test_authority_moves_where_the_zones_overlap(flight: Bench) -> None:
    hand_over(flight)
    messages = [(entry["direction"], entry["name"], entry["station"]) for entry in flight.journal("message")]
    assert messages[:9] == [
        ("out", "HANDOVER_REQUEST", "GCSB"),
        ("in", "ON_HANDOVER", "GCSB"),
        ("out", "ON_HANDOVER", "GCSA"),
        ("in", "OK_HANDOVER", "GCSA"),
        ("out", "CONNECT_HANDOVER", "GCSB"),
        ("in", "DRONE_CONNECTED", "GCSB"),
        ("out", "DRONE_CONNECTED", "GCSA"),
        ("in", "DISCONNECT_HANDOVER", "GCSA"),
        ("out", "HANDOVER_RESULT", "GCSA"),
    ]
    (committed,) = flight.journal("transfer_committed")
    assert (committed["station"], committed["epoch"], committed["reason"]) == ("GCSB", 2, "zone")
    assert committed["duration_s"] < 1.0
    flight.run(0.5)
    status = flight.b.got("AUTHORITY_STATUS")[-1]
    assert (status.commander, status.partner, status.epoch, status.lease) == (252, 0, 2, LeaseState.HELD)
    assert flight.autopilot.leases()[-1][1:3] == (1, 252)
    assert flight.autopilot.leases()[-1][6] == 2


def test_every_position_is_judged_against_the_zones_even_at_twenty_a_second(
    flight: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The thesis checks its geofences every 50 ms (section 4.3.2)."""
    judged: list[float] = []
    check = flight.companion.autopilot.zones.update
    monkeypatch.setattr(
        flight.companion.autopilot.zones, "update", lambda now: (judged.append(round(now, 2)), check(now))
    )
    for _ in range(40):
        position = mavlink.MAVLink_global_position_int_message(1000, 526790000, 59240000, 41000, 40000, 0, 0, 0, 0)
        say(flight, position)
        flight.run(0.05)
    assert len(set(judged)) >= 39


def test_both_stations_are_told_of_the_border_before_it_is_reached(flight: Bench) -> None:
    """150 m before B's zone: the climb is over, and waypoint 2 is flown to."""
    flight.autopilot.waypoint = 2
    flight.wait(3.0)
    for station in (flight.a, flight.b):
        told = station.got("HANDOVER_AHEAD")
        assert {(m.from_station, m.to_station, m.crossing, m.epoch) for m in told} == {(251, 252, 1, 1)}
        assert 10 < told[-1].in_s < 40
        assert (told[-1].commander, told[-1].partner) == (1, 1)  # both have agreed, as their configuration has it
    (foreseen,) = flight.journal("foreseen")
    assert foreseen["text"].startswith("GCSA -> GCSB is expected in ")
    assert [entry["text"] for entry in flight.journal("foreseen_answer")] == [
        "GCSA agrees to it beforehand",
        "GCSB agrees to it beforehand",
    ]
    hand_over(flight)
    assert flight.a.got("ON_HANDOVER")[-1].crossing == flight.b.got("HANDOVER_REQUEST")[-1].crossing == 1
    assert 1 in {status.crossing for status in flight.a.got("AUTHORITY_STATUS")}
    assert not [entry for entry in flight.journal("message") if "AHEAD" in entry["name"]]


def test_the_partners_operator_is_briefed_with_the_question_and_nobody_else(flight: Bench) -> None:
    flight.autopilot.waypoint = 2
    flight.wait(3.0)
    assert flight.a.got("HANDOVER_BRIEFING") == []
    lines = flight.b.got("HANDOVER_BRIEFING")[:6]
    assert [(m.number, m.line, m.lines) for m in lines] == [(1, line, 6) for line in range(1, 7)]
    leg, battery, wind, links, alerts, following = [m.text for m in lines]
    assert "52.67900 5.92400, " in leg
    assert "above home" in leg
    assert battery.startswith("100% left; mission with reserve ")
    assert battery.endswith((" all the way", " at its end only")), "the line is not cut"
    assert wind == "not known"
    assert links.startswith("GCSA ")
    assert "; GCSB " in links
    assert alerts == "none"
    assert following.startswith("GCSA -> GCSB in ")
    flight.wait(11.0)
    assert {m.number for m in flight.b.got("HANDOVER_BRIEFING")} == {1, 2}, "as long as the question is open, anew"


def test_what_breaks_in_a_briefing_costs_one_line(flight: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(type(flight.companion.autopilot.return_site), "brief", lambda _self: 1 / 0)
    monkeypatch.setattr(type(flight.companion.autopilot.command_check), "way_on_wh", lambda _self: 1 / 0)
    flight.autopilot.waypoint = 2
    flight.wait(3.0)
    texts = [m.text for m in flight.b.got("HANDOVER_BRIEFING")[:6]]
    assert texts[1] == "not known (internal fault)"
    assert "above home" in texts[0]
    assert flight.companion.faults["briefing"] > 0


def test_off_the_mission_nothing_is_foreseen(flight: Bench) -> None:
    flight.autopilot.waypoint = 2
    flight.wait(3.0)
    assert flight.a.got("HANDOVER_AHEAD") != []
    flight.autopilot.mode = GUIDED
    flight.wait(4.0)
    flight.a.received.clear()
    flight.wait(20.0)
    assert flight.a.got("HANDOVER_AHEAD") == []


def test_who_commands_is_told_to_everybody_once_with_the_number_of_the_handover(flight: Bench) -> None:
    hand_over(flight)
    flight.wait(3.0)
    (committed,) = flight.journal("transfer_committed")
    assert committed["handover_id"] > 0
    told = f"GCSB commands now (handover {committed['handover_id']})"
    for station in (flight.a, flight.b):
        notices = [text for severity, text in station.told() if severity == mavlink.MAV_SEVERITY_NOTICE]
        loaded = ["Mission delivery loaded from GCSA: written, read back, equal."] if station is flight.b else []
        notices[0] = notices[0].removeprefix("Handover: ")  # it may come before the program has shown that it is ours
        assert notices == ["GCSA commands now", *loaded, told]


def test_commands_of_the_new_commander_pass_and_those_of_the_old_one_do_not(flight: Bench) -> None:
    flight.b.command(LAND)
    flight.run(0.2)
    assert flight.b.acks(LAND) == [NOT_IN_CONTROL]
    hand_over(flight)
    flight.autopilot.received.clear()
    flight.a.command(LAND)
    flight.b.command(LAND, 1.0)
    flight.run(2.5)
    assert flight.a.acks(LAND) == [NOT_IN_CONTROL]
    assert [(m.get_srcSystem(), m.param1) for m in flight.autopilot.got("COMMAND_LONG") if m.command == LAND] == [
        (252, 1.0)
    ]
    assert {m.get_srcSystem() for m in flight.autopilot.got("HEARTBEAT")} == {1, 252}


def test_during_the_transfer_the_old_commander_still_commands_and_the_lease_says_transfer(flight: Bench) -> None:
    silent = partial(vehicle.Station.step, flight.a)
    flight.a._answer = lambda message: None  # type: ignore[method-assign]
    flight.a.step = silent  # type: ignore[method-assign]
    flight.autopilot.position = IN_BOTH
    flight.until(lambda: flight.companion.view.partner == 252)
    flight.run(0.5)
    assert commander(flight) == 251
    assert flight.autopilot.leases()[-1][1:3] == (2, 251)
    flight.a.command(LAND)
    flight.run(0.2)
    assert [m.get_srcSystem() for m in flight.autopilot.got("COMMAND_LONG") if m.command == LAND] == [251]
    flight.wait(5.0)
    assert flight.companion.view.partner is None
    assert flight.journal("transfer_aborted")[0]["reason"] == "commander_silent"
    assert commander(flight) == 251


def test_telemetry_goes_to_the_commander_and_to_a_partner(flight: Bench) -> None:
    flight.run(2.0)
    assert flight.b.got("HANDOVER_TELEMETRY") == []
    telemetry = flight.a.got("HANDOVER_TELEMETRY")
    assert (telemetry[-1].lat, telemetry[-1].lon, telemetry[-1].zone) == (526790000, 59240000, 251)
    hand_over(flight)
    flight.a.received.clear()
    flight.run(2.5)
    assert flight.a.got("HANDOVER_TELEMETRY") == []
    assert len(flight.b.got("HANDOVER_TELEMETRY")) >= 2


def test_in_two_zones_at_once_the_telemetry_names_both_of_them(flight: Bench) -> None:
    """The thesis's `Handover Zone` (figures 6.13 and 6.14)."""
    flight.run(1.5)
    assert [m.other_zone for m in flight.a.got("HANDOVER_TELEMETRY")[-1:]] == [0]
    hand_over(flight)
    flight.run(1.5)
    assert [(m.zone, m.other_zone) for m in flight.b.got("HANDOVER_TELEMETRY")[-1:]] == [(252, 251)]
    flight.autopilot.position = IN_B
    flight.run(1.5)
    assert [(m.zone, m.other_zone) for m in flight.b.got("HANDOVER_TELEMETRY")[-1:]] == [(252, 0)]
    texts = [entry["text"] for entry in flight.journal("handover_zone")]
    assert texts == ["Handover Zone (GCSA and GCSB)"], "as it is entered, before authority moves"
    console = [line.split("]: ")[-1] for line in flight.mpstate.console.lines]
    assert [line for line in console if line.startswith("Handover Zone")] == [f"{text}." for text in texts]
    (last,) = flight.journal("position")[-1:]
    assert "other_zone" not in last or last["other_zone"] is None


def test_the_console_says_whose_stop_and_continue_are_accepted_and_rejected(flight: Bench) -> None:
    """As figure 6.14 of the thesis has it."""
    flight.b.command(PAUSE, 0.0)
    flight.run(0.3)
    flight.a.command(PAUSE, 0.0)
    flight.run(0.3)
    flight.a.command(PAUSE, 1.0)
    flight.run(0.3)
    console = [line.split("]: ")[-1] for line in flight.mpstate.console.lines]
    assert [line for line in console if " accepted from " in line or " rejected from " in line] == [
        "START accepted from GCSA.",
        "STOP rejected from GCSB: not in control.",
        "STOP accepted from GCSA.",
        "CONTINUE accepted from GCSA.",
    ]


def told_on_console(bench: Bench) -> list[str]:
    return [line.split("]: ")[-1] for line in bench.mpstate.console.lines]


def test_the_console_tells_each_step_of_a_handover_once(flight: Bench) -> None:
    """As figures 6.3 and 6.14 of the thesis have them."""
    hand_over(flight)
    flight.run(2.0)
    console = told_on_console(flight)
    assert console[console.index("Zone of GCSB entered.") :][:10] == [
        "Zone of GCSB entered.",
        "Handover Zone (GCSA and GCSB).",
        "Handover 1: GCSA -> GCSB.",
        "Handover request sent to GCSB. Waiting for GCSB and GCSA.",
        "GCSB is ready.",
        "OK handover received from GCSA.",
        "Connect handover sent to GCSB. Waiting for GCSB and GCSA.",
        "Drone connected received from GCSB.",
        "Disconnect received from GCSA.",
        "Handover 1 committed: GCSB commands, epoch 2.",
    ]
    for line in ("Handover request sent", "GCSB is ready", "OK handover", "Connect handover", "Disconnect received"):
        assert sum(each.startswith(line) for each in console) == 1, line


def test_the_console_tells_no_step_that_does_not_count(flight: Bench) -> None:
    """Words of a station that has no part in a transfer, and of one that is over."""
    before = len(told_on_console(flight))
    for station in (flight.a, flight.b):
        for word in (OnHandover, OkHandover, DroneConnected, DisconnectHandover):
            station.send(codec.encode(word(TransferKey(251, 252, 7, 1)), (1, 191), 1))
    flight.run(1.0)
    hand_over(flight)
    done = len(told_on_console(flight))
    flight.a.send(codec.encode(OkHandover(TransferKey(251, 252, 1, 1)), (1, 191), 1))
    flight.run(1.0)
    steps = ("is ready", "OK handover", "received from")
    assert [line for line in told_on_console(flight)[before:] if any(step in line for step in steps)] == [
        "GCSB is ready.",
        "OK handover received from GCSA.",
        "Drone connected received from GCSB.",
        "Disconnect received from GCSA.",
    ]
    assert [line for line in told_on_console(flight)[done:] if any(step in line for step in steps)] == []


def test_the_console_says_that_an_operator_is_asked_or_has_denied(flight: Bench) -> None:
    def consent(station: vehicle.Station, word: Consent) -> None:
        view = flight.companion.view
        key = TransferKey(view.commander or 0, view.partner or 0, view.handover_id, view.epoch)
        message = OnHandover(key, word) if station is flight.b else OkHandover(key, word)
        station.send(codec.encode(message, (1, 191), 1))
        flight.run(0.1)

    for station in (flight.a, flight.b):
        station.step = partial(vehicle.Station.step, station)  # type: ignore[method-assign]
    flight.autopilot.position = IN_BOTH
    flight.until(lambda: flight.companion.view.partner == 252)
    before = told_on_console(flight).index("Handover 1: GCSA -> GCSB.")
    for station, word in (
        (flight.b, Consent.WAITING),
        (flight.b, Consent.WAITING),
        (flight.b, Consent.GRANTED),
        (flight.a, Consent.WAITING),
        (flight.a, Consent.DENIED),
    ):
        consent(station, word)
    assert [line for line in told_on_console(flight)[before:] if "GCS" in line][:6] == [
        "Handover 1: GCSA -> GCSB.",
        "Handover request sent to GCSB. Waiting for GCSB and GCSA.",
        "GCSB asks its operator.",
        "GCSB is ready.",
        "GCSA asks its operator.",
        "GCSA denies the handover.",
    ]


def test_a_handover_of_a_lost_commander_waits_for_the_partner_alone(flight: Bench) -> None:
    flight.autopilot.position = IN_BOTH
    flight.b.alive = False
    flight.wait(4.0)
    flight.a.alive, flight.b.alive = False, True
    flight.until(lambda: commander(flight) == 252)
    console = told_on_console(flight)
    assert console[console.index("GCSA is lost: no station commands.") + 1 :][:3] == [
        "Connect handover sent to GCSB. Waiting for GCSB.",
        "Drone connected received from GCSB.",
        "Handover 2 committed: GCSB commands, epoch 2.",
    ]


def test_the_console_says_from_whom_the_mission_came_and_who_gets_telemetry(flight: Bench) -> None:
    """As figures 6.2, 6.4 and 6.14 of the thesis have it."""
    flight.run(2.0)
    hand_over(flight)
    flight.run(2.0)
    console = told_on_console(flight)
    assert console.count("Mission 'delivery' received from GCSA.") == 1
    assert [line for line in console if line.startswith("Telemetry")] == [
        "Telemetry goes to GCSA, once a second.",
        "Telemetry goes to GCSB, once a second.",
    ]


def test_the_console_says_that_start_of_another_station_is_rejected(bench: Bench, delivery: MissionPackage) -> None:
    """As figure 6.2 of the thesis has it."""
    bench.connect()
    bench.share(delivery)
    bench.run(1.5)
    bench.b.command(START)
    bench.run(0.3)
    assert "START rejected from GCSB: not in control." in told_on_console(bench)
    assert bench.companion.view.phase is Phase.ON_LOAD


def test_the_companion_prints_every_line_that_the_page_names(bench: Bench, delivery: MissionPackage) -> None:
    """`docs/thesis.md`; what a position box and a flight out of coverage print is seen in those flights."""
    begin_flight(bench, delivery, refused=True)
    for station in (bench.b, bench.a):
        station.command(PAUSE, 0.0)
        bench.run(0.3)
    hand_over(bench)
    bench.autopilot.position = IN_B
    bench.wait(6.0)
    for station in (bench.a, bench.b):
        station.command(PAUSE, 0.0)
        bench.run(0.3)
    bench.autopilot.position = IN_BOTH
    bench.until(lambda: commander(bench) == 251)
    rows = [row for row in console_lines.lines("authority") if row.who == "companion"]
    assert len(rows) == 26
    console = told_on_console(bench)
    assert [row.today for row in rows if not row.stands_in(console)] == []


def test_other_commands_and_refusals_without_end_fill_no_console(flight: Bench) -> None:
    for _ in range(600):
        flight.b.command(PAUSE, 0.0)
        flight.b.command(LAND)
        flight.run(0.05)
    shown = [line for line in flight.mpstate.console.lines if "rejected from" in line]
    assert 1 <= len(shown) <= 400
    assert all("STOP rejected from GCSB" in line for line in shown)


def test_every_station_hears_of_the_delivery_point_and_of_the_landing(flight: Bench) -> None:
    for number in (8, 9):
        say(flight, mavlink.MAVLink_mission_item_reached_message(number))
    say(flight, mavlink.MAVLink_extended_sys_state_message(0, mavlink.MAV_LANDED_STATE_ON_GROUND))
    flight.run(0.3)
    flight.autopilot.airborne, flight.autopilot.armed = False, False
    flight.run(2.0)
    for station in (flight.a, flight.b):
        told = [text for _severity, text in station.told() if "delivery point" in text or "flight is over" in text]
        assert told == ["delivery point reached, waypoint 8", "landed: the flight is over"]


def test_there_and_back_again_is_two_epochs(flight: Bench) -> None:
    hand_over(flight)
    flight.autopilot.position = IN_B
    flight.wait(6.0)
    flight.autopilot.position = IN_BOTH
    flight.until(lambda: commander(flight) == 251)
    assert flight.companion.view.epoch == 3
    assert [entry["station"] for entry in flight.journal("transfer_committed")] == ["GCSB", "GCSA"]


def test_outside_every_zone_the_aircraft_is_brought_home(flight: Bench) -> None:
    hand_over(flight)
    flight.autopilot.position = OUTSIDE
    flight.until(lambda: flight.autopilot.mode == RTL)
    flight.run(1.5)
    assert flight.companion.view.phase is Phase.EMERGENCY
    assert flight.journal("emergency")[-1]["reason"] == "out_of_coverage"
    (fly,) = flight.journal("fly")
    assert (fly["action"], fly["obeyed"], fly["text"]) == ("return", True, "the autopilot flies RTL")
    assert commander(flight) == 252, "the commander keeps its authority"


def test_a_waypoint_and_the_delivery_are_told(flight: Bench) -> None:
    for message in (
        mavlink.MAVLink_mission_current_message(8),
        mavlink.MAVLink_mission_item_reached_message(8),
    ):
        flight.autopilot.say(message)
        flight.mpstate.deliver(flight.autopilot._out[-1])
    assert flight.journal("waypoint")[-1]["number"] == 8
    assert flight.journal("delivery")[-1]["number"] == 8
    assert flight.mpstate.console.said("Delivery point reached, waypoint 8.")


def with_a_change_of_speed_behind_the_delivery(delivery: MissionPackage) -> MissionPackage:
    """The same mission with item 9, DO_CHANGE_SPEED to 6 m/s."""
    files = {name: text.decode() for name, text in delivery.files.items()}
    plan = json.loads(files["delivery.plan"])
    speed = {"type": "SimpleItem", "command": 178, "frame": 2, "autoContinue": True, "params": [1, 6, -1, 0, 0, 0, 0]}
    plan["mission"]["items"].insert(8, speed)
    return from_texts({**files, "delivery.plan": json.dumps(plan)}, "delivery")


@pytest.mark.parametrize("announced", [(9,), (8, 9), (8, 8)], ids=["overtaken", "both", "twice"])
def test_the_delivery_point_is_told_once_also_when_a_do_item_overtakes_its_announcement(
    bench: Bench, delivery: MissionPackage, announced: tuple[int, ...]
) -> None:
    """ArduCopter announces the waypoint and DO_CHANGE_SPEED in one step; a link carries the later of the two."""
    bench.connect()
    bench.share(with_a_change_of_speed_behind_the_delivery(delivery))
    bench.run(1.0)
    for number in (7, *announced, 10):
        say(bench, mavlink.MAVLink_mission_item_reached_message(number))
    assert [entry["number"] for entry in bench.journal("reached")] == [7, *announced, 10]
    assert [entry["number"] for entry in bench.journal("delivery")] == [8]
    bench.run(0.3)
    told = [text for _severity, text in bench.a.told() if "elivery" in text]
    assert told == ["delivery point reached, waypoint 8"]


def test_a_transfer_can_be_called_off_at_the_vehicle(flight: Bench) -> None:
    flight.b.alive = True
    flight.b.step = partial(vehicle.Station.step, flight.b)  # type: ignore[method-assign]
    flight.autopilot.position = IN_BOTH
    flight.until(lambda: flight.companion.view.partner == 252)
    flight.mpstate.type("handover cancel")
    assert flight.companion.view.partner is None
    assert flight.journal("transfer_aborted")[-1]["reason"] == "cancelled"


def test_the_sticks_of_the_former_commander_are_let_go(flight: Bench) -> None:
    flight.a.send(mavlink.MAVLink_rc_channels_override_message(1, 1, 1500, 1500, 1400, 1500, 0, 0, 0, 0))
    flight.run(0.1)
    flight.autopilot.received.clear()
    hand_over(flight)
    flight.run(0.2)
    (release,) = [m for m in flight.autopilot.got("RC_CHANNELS_OVERRIDE", 251) if m.chan1_raw != 1500]
    assert [getattr(release, f"chan{number}_raw") for number in (1, 2, 3, 4)] == [0, 0, 0, 0]
    assert flight.journal("flush")[0]["station"] == "GCSA"


def test_landing_ends_the_flight_and_the_next_can_begin(flight: Bench) -> None:
    flight.autopilot.armed = flight.autopilot.airborne = False
    flight.autopilot.mode = RTL
    flight.until(lambda: flight.companion.view.phase is Phase.ON_LOAD)
    flight.run(1.0)
    assert flight.journal("landed")
    flight.a.received.clear()
    flight.a.command(START)
    flight.until(lambda: flight.companion.view.phase is Phase.ON_MISSION)
