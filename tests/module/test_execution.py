# SPDX-License-Identifier: GPL-3.0-or-later

"""What was decided, as the autopilot is commanded it and as everybody is told it, through the whole module."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as stock
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.events import ConditionsSeen
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.monitors.conditions import breach
from mavproxy_handover.vehicle.mode_requests import of_text
from tests.module.conftest import Bench
from tests.module.test_route import beside, take_off
from tests.module.vehicle import AUTO, GUIDED, LAND, RTL

LOITER, STABILIZE = 5, 0
MODE, PAUSE = mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_DO_PAUSE_CONTINUE
RADIO, FENCE = mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER, mavlink.MAV_SYS_STATUS_GEOFENCE
OUTSIDE = (52.678146, 5.95)  # east of every zone


@pytest.fixture
def flown(bench: Bench, delivery: MissionPackage) -> Bench:
    return take_off(bench, delivery)


def say_health(bench: Bench, *, enabled: int = 0, healthy: int = 0) -> None:
    """SYS_STATUS, twice a second from now on."""

    def each_round() -> None:
        if round(bench.clock.now * 20) % 10 == 0:
            bench.mpstate.deliver(packed(stock.MAVLink_sys_status_message(enabled, enabled, healthy, *[0] * 10)))

    bench.each_round = each_round


def packed(message: Any) -> Any:
    """As MAVProxy hands it over."""
    return stock.MAVLink(None).decode(bytearray(message.pack(stock.MAVLink(None, srcSystem=1, srcComponent=1))))


def modes(bench: Bench) -> list[int]:
    """The modes that the autopilot was commanded since START."""
    return [int(m.param2) for m in bench.autopilot.got("COMMAND_LONG") if m.command == MODE][1:]


def decisions(bench: Bench) -> list[str]:
    return [entry["text"] for entry in bench.journal("decision")]


def test_a_decision_is_one_sentence_to_every_station_and_program(flown: Bench) -> None:
    flown.autopilot.position = OUTSIDE
    flown.until(lambda: flown.autopilot.mode == RTL)
    flown.run(0.5)
    (entry,) = flown.journal("decision")
    text = entry["text"]
    figures = "1.8 km away, needs 27 % of the battery (100 % left), covered by GCSA all the way"
    assert text == f"RETURN to home. Out of coverage, 1079 m outside the zone of GCSB. {figures}"
    assert (entry["action"], entry["reason"], entry["place"]) == ("return", "out_of_coverage", "home")
    for station in (flown.a, flown.b):
        told = station.got("HANDOVER_DECISION")
        assert {(m.text, m.action, m.cause, m.place) for m in told} == {(text, 4, 13, "home")}
        assert station.texts().count(text) == 1
        pieces = [m for m in station.got("STATUSTEXT") if m.severity == mavlink.MAV_SEVERITY_CRITICAL]
        assert len({m.id for m in pieces}) == 1
        assert [m.chunk_seq for m in pieces] == list(range(len(pieces)))
    assert flown.mpstate.console.said(f"{text}.")
    flown.mpstate.type("handover status")
    assert f"decision  {text}" in flown.mpstate.console.lines


def test_it_is_repeated_while_it_lasts_with_the_same_number_and_its_end_three_times(flown: Bench) -> None:
    flown.autopilot.position = OUTSIDE
    flown.until(lambda: flown.autopilot.mode == RTL)
    flown.wait(9.0)
    told = [m.number for m in flown.b.got("HANDOVER_DECISION")]
    assert (len(told), len(set(told))) == (5, 1)
    flown.autopilot.position = beside(0.5, 0.0)
    flown.wait(12.0)
    over = [m for m in flown.b.got("HANDOVER_DECISION") if m.action == 255]
    assert [m.text for m in over] == ["ALL CLEAR. Over: out of coverage"] * 3
    assert over[0].number == told[0] + 1
    flown.mpstate.type("handover status")
    assert not any(line.startswith("decision") for line in flown.mpstate.console.lines)


def test_a_pilot_at_a_live_radio_is_not_fought(flown: Bench) -> None:
    say_health(flown, enabled=RADIO, healthy=RADIO)
    flown.run(2.0)
    flown.autopilot.position = OUTSIDE
    flown.until(lambda: flown.autopilot.mode == RTL)
    flown.wait(20.0)
    flown.autopilot.mode = LOITER
    flown.wait(60.0)
    assert (flown.autopilot.mode, modes(flown)) == (LOITER, [RTL])
    assert decisions(flown)[-1] == (
        "PILOT: a pilot has taken over, LOITER; RETURN is not commanded any more (out of coverage)"
    )
    flown.autopilot.mode = AUTO  # given back
    flown.until(lambda: flown.autopilot.mode == RTL)
    assert modes(flown) == [RTL, RTL]


def test_a_pilot_who_takes_over_before_the_return_is_acknowledged_is_not_fought(flown: Bench) -> None:
    """The fault: RTL was sent again each second until its answer came, and LAND after it."""
    say_health(flown, enabled=RADIO, healthy=RADIO)
    flown.run(2.0)
    flown.autopilot.script[MODE] = None
    flown.autopilot.position = OUTSIDE
    flown.until(lambda: modes(flown))
    flown.autopilot.mode = LOITER
    flown.run(1.0)  # until it beats
    told = modes(flown)
    flown.wait(15.0)
    assert modes(flown) == told
    assert set(told) == {RTL}
    assert [entry["text"] for entry in flown.journal("fly")] == ["not commanded again: the autopilot is in LOITER now"]


def test_without_a_pilot_the_return_is_commanded_again_in_a_moment(flown: Bench) -> None:
    """No radio is known, so that nothing says who has chosen LOITER."""
    flown.autopilot.script[MODE] = None
    flown.autopilot.position = OUTSIDE
    flown.until(lambda: modes(flown))
    flown.autopilot.mode = LOITER
    flown.run(2.0)
    flown.autopilot.script.clear()
    flown.until(lambda: flown.autopilot.mode == RTL, 7.0)


@pytest.mark.parametrize("healthy", [0, RADIO], ids=["radio failsafe", "its loss would not be noticed"])
def test_without_a_live_radio_nobody_is_a_pilot(flown: Bench, healthy: int) -> None:
    say_health(flown, enabled=RADIO, healthy=healthy)
    told = mavlink.MAVLink_param_value_message(b"FS_THR_ENABLE", float(healthy == 0), 2, 900, 65535)
    flown.companion.autopilot.aircraft.on_message(told, flown.clock.now)
    flown.run(2.0)
    flown.autopilot.position = OUTSIDE
    flown.until(lambda: flown.autopilot.mode == RTL)
    flown.wait(20.0)
    flown.autopilot.mode = LOITER
    flown.until(lambda: flown.autopilot.mode == RTL)
    assert modes(flown) == [RTL, RTL]


def test_that_a_lost_radio_would_go_unnoticed_is_read_before_the_flight(bench: Bench) -> None:
    bench.autopilot.parameters |= {"FS_THR_ENABLE": 0.0}
    bench.connect()
    bench.until(lambda: bench.companion.autopilot.preflight.findings is not None, 60.0)
    autopilot = bench.companion.autopilot
    assert autopilot.rounds._monitors.mode_and_motion.radio_watched(autopilot.aircraft) is False


def test_the_commanders_accepted_command_is_its_word(flown: Bench) -> None:
    flown.autopilot.position = OUTSIDE
    flown.until(lambda: flown.autopilot.mode == RTL)
    flown.wait(3.0)
    flown.a.command(MODE, 1.0, GUIDED)
    flown.wait(60.0)
    assert (flown.autopilot.mode, modes(flown)) == (GUIDED, [RTL, GUIDED])
    assert decisions(flown)[-1] == "GUIDED: chosen by GCSA; RETURN is not commanded any more (out of coverage)"


def test_what_nobody_is_known_to_have_chosen_is_commanded_away(flown: Bench) -> None:
    flown.autopilot.position = OUTSIDE
    flown.until(lambda: flown.autopilot.mode == RTL)
    flown.wait(3.0)
    flown.autopilot.mode = GUIDED
    flown.wait(3.0)
    assert (flown.autopilot.mode, modes(flown)) == (RTL, [RTL, RTL])


@pytest.mark.parametrize(
    "text",
    [
        "Battery Failsafe",
        "EKF Failsafe: changed to LAND Mode",
        "Polygon fence breached",
        "Failsafe: Terrain data missing",
    ],
)
def test_a_failsafe_of_the_autopilot_has_its_way(flown: Bench, text: str) -> None:
    say_health(flown, enabled=RADIO, healthy=RADIO)
    flown.run(2.0)
    flown.mpstate.deliver(packed(stock.MAVLink_statustext_message(4, text.encode())))
    flown.autopilot.mode = LAND
    flown.wait(3.0)
    flown.autopilot.position = OUTSIDE
    flown.wait(10.0)
    assert modes(flown) == []
    assert decisions(flown)[-1].endswith(". A failsafe of the autopilot acts")


@pytest.mark.parametrize("text", ["Battery Failsafe Cleared", "Fence breach cleared", "Handover: GCS failsafe off"])
def test_the_end_of_one_and_what_others_say_of_it_is_none(text: str) -> None:
    assert of_text(text) is None


def test_a_breach_of_the_fence_is_told(flown: Bench) -> None:
    breach = stock.MAVLink_fence_status_message(1, 1, mavlink.FENCE_BREACH_BOUNDARY, 1000)
    for _ in range(6):
        flown.mpstate.deliver(packed(breach))
        flown.run(0.5)
    assert decisions(flown) == ["WARNING. Outside the fence (its border)"]
    for _ in range(10):
        flown.mpstate.deliver(packed(stock.MAVLink_fence_status_message(0, 1, 0, 1000)))
        flown.run(0.5)
    assert decisions(flown)[1:] == ["ALL CLEAR. Over: outside the fence"]
    assert modes(flown) == []


def test_so_is_one_that_only_the_status_of_the_system_tells(flown: Bench) -> None:
    say_health(flown, enabled=FENCE)
    flown.wait(4.0)
    assert decisions(flown) == ["WARNING. Outside the fence"]


def test_a_fence_that_is_off_cannot_be_left(flown: Bench) -> None:
    say_health(flown)
    flown.wait(4.0)
    assert decisions(flown) == []


def test_the_policy_may_have_the_companion_return(bench: Bench, delivery: MissionPackage) -> None:
    bench.config.write_text(bench.config.read_text() + '\n[policy]\nfence = "return"\n')
    take_off(bench, delivery)
    say_health(bench, enabled=FENCE)
    bench.wait(4.0)
    assert modes(bench) == [RTL]


def test_what_was_commanded_into_a_link_that_was_cut_is_commanded_when_it_is_back(flown: Bench) -> None:
    flown.autopilot.script[MODE] = None  # it hears nothing
    flown.autopilot.position = OUTSIDE
    flown.run(2.0)
    flown.autopilot.silent = True
    flown.wait(15.0)
    assert flown.autopilot.mode == AUTO
    flown.autopilot.script.clear()
    flown.autopilot.silent = False
    flown.until(lambda: flown.autopilot.mode == RTL, 3.0)


def test_an_internal_fault_is_told_to_everybody(flown: Bench) -> None:
    flown.companion.fail_closed("test", flown.clock.now)
    flown.run(1.0)
    text = "RETURN: internal fault of the companion, no station commands"
    assert [m.text for m in flown.a.got("HANDOVER_DECISION")][-1] == text
    assert text in flown.b.texts()


def say_fix(bench: Bench, kind: int) -> None:
    bench.mpstate.deliver(packed(stock.MAVLink_gps_raw_int_message(0, kind, *[0] * 8)))


def test_positions_of_a_receiver_that_has_lost_its_fix_are_guesses(flown: Bench) -> None:
    """Flown: GLOBAL_POSITION_INT goes on, fresh, when the fix is gone."""
    say_fix(flown, mavlink.GPS_FIX_TYPE_3D_FIX)
    flown.wait(5.0)
    assert decisions(flown) == []
    say_fix(flown, mavlink.GPS_FIX_TYPE_NO_FIX)
    flown.autopilot.position = OUTSIDE
    flown.wait(5.0)
    assert decisions(flown) == ["WARNING. No fresh position for 3 s"]
    say_fix(flown, mavlink.GPS_FIX_TYPE_3D_FIX)
    flown.wait(3.0)
    assert any(text.startswith("RETURN to home. Out of coverage") for text in decisions(flown))


def test_a_vehicle_without_a_receiver_has_its_position_from_elsewhere(flown: Bench) -> None:
    say_fix(flown, mavlink.GPS_FIX_TYPE_NO_GPS)
    flown.wait(5.0)
    assert decisions(flown) == []


def test_a_return_that_somebody_has_begun_while_the_line_was_cut_is_not_commanded_again(flown: Bench) -> None:
    """Flown: its first heartbeat counted before its mode did, so the order of before went out once more."""
    flown.autopilot.silent = True
    flown.wait(15.0)
    flown.autopilot.mode, flown.autopilot.silent = RTL, False
    flown.wait(10.0)
    assert modes(flown) == []


def test_an_autopilot_that_is_heard_again_is_not_commanded_by_the_mode_of_before(flown: Bench) -> None:
    """The fault: its EXTENDED_SYS_STATE came first, and what the guard had done meanwhile was commanded once more."""
    flown.autopilot.silent = True
    flown.wait(5.0)
    flown.a.alive = flown.b.alive = False
    flown.wait(8.0)
    flown.autopilot.mode = RTL  # by the guard
    told = modes(flown)
    flown.mpstate.deliver(packed(stock.MAVLink_extended_sys_state_message(0, 2)))
    flown.run(0.2)
    assert modes(flown) == told
    flown.autopilot.silent = False
    flown.wait(3.0)
    assert modes(flown) == told


# ---- what is not told any more ------------------------------------------------------------------------------------


def in_a_return(bench: Bench) -> Bench:
    bench.autopilot.position = OUTSIDE
    bench.until(lambda: bench.autopilot.mode == RTL)
    return bench


def test_a_return_whose_positions_have_stopped_is_not_given_up(flown: Bench) -> None:
    """The fault: nothing was known of its motion, its time ran on, and it was landed where it was."""
    in_a_return(flown)
    for second in range(50):
        if second == 5:
            flown.autopilot.position = None
        flown.mpstate.deliver(
            packed(stock.MAVLink_nav_controller_output_message(0, 0, 0, 0, 2000 - 10 * second, 0, 0, 0))
        )
        flown.run(1.0)
    assert flown.autopilot.mode == RTL
    assert modes(flown) == [RTL]


@pytest.mark.parametrize(("east", "mode"), [(1e-4, LAND), (-1e-4, RTL)], ids=["blown away", "gets on"])
def test_where_the_autopilot_does_not_say_how_far_it_is_the_place_is_known(
    flown: Bench, east: float, mode: int
) -> None:
    """The fault: without NAV_CONTROLLER_OUTPUT a return that was blown away was never given up."""
    in_a_return(flown)
    for _ in range(45):
        lat, lon = flown.autopilot.position or OUTSIDE
        flown.autopilot.position = lat, lon + east
        flown.run(1.0)
    assert flown.autopilot.mode == mode


@pytest.mark.parametrize(("stops", "fought"), [(False, False), (True, True)], ids=["goes on", "stopped"])
def test_a_radio_of_which_nothing_is_heard_any_more_lives_not_for_ever(flown: Bench, stops: bool, fought: bool) -> None:
    say_health(flown, enabled=RADIO, healthy=RADIO)
    flown.run(2.0)
    in_a_return(flown)
    flown.wait(3.0)
    if stops:
        flown.each_round = lambda: None
    flown.wait(11.0)
    flown.autopilot.mode = LOITER
    flown.wait(10.0)
    assert (flown.autopilot.mode == RTL) is fought


def test_a_companion_that_starts_again_takes_no_aircraft_from_a_pilot(flown: Bench) -> None:
    """The fault: low energy lasts as long as the flight, and the first heartbeat came before SYS_STATUS."""
    say_health(flown, enabled=RADIO, healthy=RADIO)
    flown.run(2.0)
    flown.autopilot.battery = 0.05
    flown.until(lambda: flown.autopilot.mode == RTL, 30.0)
    flown.wait(5.0)
    flown.autopilot.mode = LOITER
    flown.wait(5.0)
    flown.mpstate.unload("handover")
    flown.run(1.0)
    flown.load()
    flown.autopilot._beat_at = 0.0
    flown.wait(20.0)
    assert (flown.autopilot.mode, modes(flown)) == (LOITER, [RTL])
    flown.each_round = lambda: None  # and when nothing is heard of the radio any more, it is ordered home
    flown.until(lambda: flown.autopilot.mode == RTL, 15.0)


def test_a_fence_of_which_nothing_is_heard_any_more_is_not_breached(flown: Bench) -> None:
    say_health(flown, enabled=FENCE, healthy=0)
    flown.run(2.0)
    assert breach(flown.companion.autopilot.aircraft, flown.clock.now)
    flown.each_round = lambda: None
    flown.wait(4.0)
    assert not breach(flown.companion.autopilot.aircraft, flown.clock.now)


def test_a_hold_that_the_autopilot_refuses_is_a_return_at_once(bench: Bench, delivery: MissionPackage) -> None:
    """The fault: it was waited for, and the zone was left meanwhile. ArduCopter refuses a pause in a circle."""
    bench.configure(more='[policy]\noff_route = "hold"')
    take_off(bench, delivery)

    def at_8_mps(lat: float, lon: float) -> None:
        place = round(lat * 1e7), round(lon * 1e7)
        bench.autopilot.say(stock.MAVLink_global_position_int_message(1000, *place, 0, 0, 800, 0, 0, 0))

    bench.autopilot.say_position = at_8_mps  # type: ignore[method-assign]
    bench.wait(3.0)
    bench.autopilot.script[PAUSE] = mavlink.MAV_RESULT_FAILED
    bench.companion.handle(ConditionsSeen(off_route=True, off_route_words="off route: 80 m"), bench.clock.now)

    def pauses() -> int:
        return [m.command for m in bench.autopilot.got("COMMAND_LONG")].count(PAUSE)

    bench.until(pauses)
    asked = bench.clock.now
    bench.until(lambda: bench.autopilot.mode == RTL)
    assert (bench.clock.now - asked < 0.5, pauses()) == (True, 1)
