# SPDX-License-Identifier: GPL-3.0-or-later

"""START: arm in GUIDED, fly in AUTO, and an answer to the station whatever happens on the way."""

from __future__ import annotations

from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.mission.package import MissionPackage, load
from mavproxy_handover.monitors.preflight.rules import Finding
from tests.module.conftest import Bench
from tests.module.vehicle import AUTO, GUIDED, RTL, PlaneAutopilot
from tests.packages import MISSIONS

START, MODE, ARM = mavlink.MAV_CMD_MISSION_START, mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_COMPONENT_ARM_DISARM
AUX, TERMINATE = mavlink.MAV_CMD_DO_AUX_FUNCTION, mavlink.MAV_CMD_DO_FLIGHTTERMINATION
ACCEPTED, DENIED, FAILED = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_DENIED, mavlink.MAV_RESULT_FAILED
REJECTED, IN_PROGRESS = mavlink.MAV_RESULT_TEMPORARILY_REJECTED, mavlink.MAV_RESULT_IN_PROGRESS
NOT_IN_CONTROL = 10


def test_start_arms_in_guided_and_flies_in_auto(ready: Bench) -> None:
    ready.a.command(START)
    ready.until(lambda: ready.companion.view.phase is Phase.ON_MISSION)
    ready.run(0.5)
    sent = [(m.command, m.param1, m.param2) for m in ready.autopilot.got("COMMAND_LONG") if m.command != 511]
    assert sent == [(MODE, 1.0, GUIDED), (ARM, 1.0, 0.0), (START, 0.0, 0.0)]
    assert (ready.autopilot.mode, ready.autopilot.armed) == (AUTO, True)
    assert ready.a.acks(START) == [IN_PROGRESS, ACCEPTED]
    assert [entry["event"] for entry in ready.journal() if entry["event"].startswith("start")] == [
        "start",
        "start_sequence",
        "started",
    ]


def test_start_without_a_mission_says_what_is_missing_and_touches_nothing(bench: Bench) -> None:
    bench.connect()
    bench.a.command(START)
    bench.run(0.5)
    assert bench.a.acks(START) == [REJECTED]
    assert bench.a.texts() == "START refused: no mission loaded; outside the zone of GCSA"
    assert bench.autopilot.commands() == []


@pytest.mark.parametrize(("state", "answers"), [(None, "silent"), (0, "disabled"), (1, "waiting"), (3, "expired")])
def test_start_needs_a_live_guard(ready: Bench, state: int | None, answers: str) -> None:
    ready.autopilot.guard_state = state
    ready.wait(3.0)
    ready.a.command(START)
    ready.run(0.5)
    assert ready.a.acks(START) == [REJECTED], answers
    assert ready.a.texts() == "START refused: the guard does not answer the lease"
    assert ready.autopilot.commands() == []


def test_a_vehicle_without_a_guard_can_be_configured(bench: Bench, delivery: MissionPackage) -> None:
    bench.configure(guard=False)
    bench.autopilot.guard_state = None
    bench.connect()
    bench.share(delivery)
    bench.a.command(START)
    bench.until(lambda: bench.companion.view.phase is Phase.ON_MISSION)


def test_a_guard_that_echoes_another_companions_lease_is_not_ours(ready: Bench) -> None:
    ready.autopilot._lease = (12345, 1, 1)
    ready.autopilot._take = lambda message: None  # type: ignore[method-assign]
    ready.run(1.0)
    ready.a.command(START)
    ready.run(0.5)
    assert ready.a.texts() == "START refused: the guard does not answer the lease"


def test_a_partner_may_not_start(ready: Bench) -> None:
    ready.b.command(START)
    ready.run(0.5)
    assert ready.b.acks(START) == [NOT_IN_CONTROL]
    assert ready.autopilot.commands() == []


@pytest.mark.parametrize(
    ("command", "text"),
    [
        (MODE, "START failed: mode GUIDED refused (MAV_RESULT_DENIED): PreArm: bad compass"),
        (ARM, "START failed: arming refused (MAV_RESULT_DENIED): PreArm: bad compass"),
        (START, "START failed: MISSION_START refused (MAV_RESULT_DENIED): PreArm: bad compass"),
    ],
)
def test_a_refusal_of_the_autopilot_reaches_the_station_with_its_reason(ready: Bench, command: int, text: str) -> None:
    ready.autopilot.script[command] = DENIED
    ready.autopilot.reason = "PreArm: bad compass"
    ready.a.command(START)
    ready.until(lambda: FAILED in ready.a.acks(START))
    ready.run(0.2)
    assert ready.a.acks(START) == [IN_PROGRESS, FAILED]
    assert text in ready.a.texts()
    assert ready.companion.view.phase is Phase.ON_LOAD
    (entry,) = ready.journal("start_failed")
    assert entry["text"] == text


@pytest.mark.parametrize(
    ("command", "text"),
    [
        (MODE, "START failed: no answer to mode GUIDED"),
        (ARM, "START failed: no answer to arming"),
        (START, "START failed: no answer to MISSION_START"),
    ],
)
def test_a_command_is_asked_five_times_and_then_given_up(ready: Bench, command: int, text: str) -> None:
    ready.autopilot.script[command] = None
    ready.a.command(START)
    ready.until(lambda: FAILED in ready.a.acks(START))
    ready.run(0.2)
    assert ready.autopilot.commands().count(command) == 5
    assert text in ready.a.texts()


@pytest.mark.parametrize(
    ("command", "text"),
    [
        (MODE, "START failed: no answer to mode GUIDED to show"),
        (ARM, "START failed: no answer to arming to show"),
        (START, "START failed: no answer to mode AUTO to show"),
    ],
)
def test_what_the_autopilot_acknowledges_and_does_not_do_is_not_believed(ready: Bench, command: int, text: str) -> None:
    ready.autopilot.forgets.add(command)
    ready.a.command(START)
    ready.until(lambda: FAILED in ready.a.acks(START))
    ready.run(0.2)
    assert text in ready.a.texts()
    assert ready.companion.view.phase is Phase.ON_LOAD


def test_start_can_be_tried_again_after_it_failed(ready: Bench) -> None:
    ready.autopilot.script[ARM] = DENIED
    ready.a.command(START)
    ready.until(lambda: FAILED in ready.a.acks(START))
    del ready.autopilot.script[ARM]
    ready.a.command(START)
    ready.until(lambda: ready.companion.view.phase is Phase.ON_MISSION)
    ready.run(0.2)
    assert ready.a.acks(START) == [IN_PROGRESS, FAILED, IN_PROGRESS, ACCEPTED]


def test_start_asked_again_while_it_is_on_its_way_changes_nothing(ready: Bench) -> None:
    ready.autopilot.script[MODE] = None
    ready.a.command(START)
    ready.run(0.5)
    ready.a.command(START)
    ready.run(0.3)
    assert ready.a.acks(START) == [IN_PROGRESS, IN_PROGRESS]
    del ready.autopilot.script[MODE]
    ready.until(lambda: ready.companion.view.phase is Phase.ON_MISSION)
    ready.run(0.2)
    assert ready.a.acks(START) == [IN_PROGRESS, IN_PROGRESS, ACCEPTED]
    assert ready.autopilot.commands().count(ARM) == 1


def test_a_second_program_of_the_commander_does_not_take_the_answer_away(ready: Bench) -> None:
    ready.autopilot.script[MODE] = None
    ready.a.command(START)
    ready.run(0.5)
    other = mavlink.MAVLink(None, srcSystem=251, srcComponent=230)
    ready.a.send_bytes(mavlink.MAVLink_command_long_message(1, 1, START, 0, 0, 0, 0, 0, 0, 0, 0).pack(other))
    ready.run(0.3)
    del ready.autopilot.script[MODE]
    ready.until(lambda: ready.companion.view.phase is Phase.ON_MISSION)
    ready.run(0.2)
    answers = [(m.target_component, m.result) for m in ready.a.got("COMMAND_ACK") if m.command == START]
    assert answers == [(190, IN_PROGRESS), (230, REJECTED), (190, ACCEPTED)]


def test_no_mission_is_taken_while_the_aircraft_is_being_started(ready: Bench, delivery: MissionPackage) -> None:
    ready.autopilot.script[MODE] = None
    ready.a.command(START)
    ready.run(0.3)
    offer = mavlink.MAVLink_mission_package_message(1, 191, 100, list(range(32)), b"other")
    ready.a.send(offer)
    ready.run(0.3)
    (answer,) = [m for m in ready.a.got("MISSION_PACKAGE_ACK") if m.package_id == 0x03020100]
    assert (answer.result, answer.text) == (3, "only from the commander, on the ground, disarmed")


def test_an_acknowledgement_meant_for_a_station_is_not_taken_for_ours(ready: Bench) -> None:
    """The commander's own mode change is refused while START waits for the answer to its own."""
    ready.autopilot.script[MODE] = None
    ready.a.command(START)
    ready.run(0.3)
    ready.autopilot.say(mavlink.MAVLink_command_ack_message(MODE, DENIED, 0, 0, 251, 190))
    for message in ready.autopilot._out:
        ready.mpstate.deliver(message)
    del ready.autopilot.script[MODE]
    ready.until(lambda: ready.companion.view.phase is Phase.ON_MISSION)


def test_a_start_that_is_overtaken_by_the_way_home_is_answered(ready: Bench) -> None:
    """The commander falls silent while the aircraft lifts off: it hears why its START came to nothing."""
    ready.autopilot.script[START] = None
    ready.a.command(START)
    ready.until(lambda: START in ready.autopilot.commands())
    ready.autopilot.airborne = True
    ready.a.alive = False
    ready.until(lambda: FAILED in ready.a.acks(START))
    assert "START failed: its commander no longer has authority" in ready.a.texts()
    ready.until(lambda: ready.autopilot.mode == RTL)


def test_an_aircraft_is_not_armed_for_a_commander_that_is_lost(ready: Bench) -> None:
    ready.a.alive = False
    ready.wait(3.0)
    ready.autopilot.script[ARM] = None
    ready.a.command(START)
    ready.until(lambda: FAILED in ready.a.acks(START))
    assert ready.companion.view.commander is None
    assert "START failed: its commander no longer has authority" in ready.a.texts()
    asked = len(ready.autopilot.commands())
    ready.a.alive = True
    ready.wait(6.0)
    assert len(ready.autopilot.commands()) == asked
    assert (ready.companion.view.commander, ready.companion.view.phase) == (251, Phase.ON_LOAD)
    ready.autopilot.script.clear()
    ready.a.command(START)
    ready.until(lambda: ready.companion.view.phase is Phase.ON_MISSION)


def test_in_flight_the_commanders_mission_start_is_the_autopilots_business(ready: Bench) -> None:
    ready.a.command(START)
    ready.until(lambda: ready.companion.view.phase is Phase.ON_MISSION)
    before = len(ready.autopilot.received)
    ready.a.command(START)
    ready.run(0.3)
    (passed,) = [m for m in ready.autopilot.received[before:] if m.get_type() == "COMMAND_LONG" and m.command == START]
    assert (passed.get_srcSystem(), passed.get_srcComponent()) == (251, 190)


def test_a_disarm_ends_a_start_that_is_under_way(ready: Bench) -> None:
    """The fault: the companion went on and armed."""
    ready.autopilot.script[MODE] = None
    ready.a.command(START)
    ready.until(lambda: MODE in ready.autopilot.commands())
    ready.a.command(ARM, 0)
    ready.run(0.2)
    del ready.autopilot.script[MODE]
    ready.wait(5.0)
    assert not any(m.command == ARM and m.param1 for m in ready.autopilot.got("COMMAND_LONG"))
    assert ready.a.acks(START) == [IN_PROGRESS, FAILED]
    assert "START failed: GCSA disarmed" in ready.a.texts()
    assert ready.companion.view.phase is Phase.ON_LOAD
    ready.a.command(START)
    ready.until(lambda: ready.companion.view.phase is Phase.ON_MISSION)


@pytest.mark.parametrize("command", [(AUX, 31, 0), (AUX, 31, 1), (AUX, 32, 2), (AUX, 81, 0), (TERMINATE, 0)], ids=str)
def test_what_stops_no_motor_ends_no_start(ready: Bench, command: tuple[int, ...]) -> None:
    """The fault: the emergency stop was released, and START failed because GCSA had disarmed."""
    ready.autopilot.script[MODE] = None
    ready.a.command(START)
    ready.until(lambda: MODE in ready.autopilot.commands())
    ready.a.command(*command)
    ready.run(0.2)
    del ready.autopilot.script[MODE]
    ready.until(lambda: ready.companion.view.phase is Phase.ON_MISSION)
    assert command[0] in ready.autopilot.commands()
    assert "disarmed" not in ready.a.texts()


def test_a_disarm_that_the_autopilot_refuses_ends_no_start(ready: Bench) -> None:
    """The fault: START was answered FAILED, and the aircraft flew its mission."""
    ready.a.command(START)
    ready.until(lambda: START in ready.autopilot.commands())
    ready.autopilot.script[ARM] = FAILED
    ready.a.command(ARM, 0)
    ready.wait(4.0)
    assert ready.a.acks(START) == [IN_PROGRESS, ACCEPTED]
    assert "START failed" not in ready.a.texts()
    assert (ready.companion.view.phase, ready.autopilot.armed) == (Phase.ON_MISSION, True)


@pytest.mark.parametrize("answer", [ACCEPTED, None], ids=["accepted", "no answer"])
def test_a_disarm_that_the_autopilot_does_not_refuse_ends_start_though_it_is_armed(
    ready: Bench, answer: int | None
) -> None:
    ready.autopilot.forgets.add(START)  # it says ACCEPTED and stays in GUIDED: START waits for AUTO
    ready.a.command(START)
    ready.until(lambda: START in ready.autopilot.commands())
    if answer is None:
        ready.autopilot.script[ARM] = None
    ready.a.command(ARM, 0)
    ready.run(1.5)
    assert ready.a.acks(START) == [IN_PROGRESS, FAILED]
    assert "START failed: GCSA disarmed" in ready.a.texts()


@pytest.mark.parametrize("command", [(AUX, 31, 2), (AUX, 32, 0), (AUX, 165, 0), (AUX, 65536 + 81, 2)], ids=str)
def test_a_switch_that_stops_the_motors_ends_a_start(ready: Bench, command: tuple[int, ...]) -> None:
    """The autopilot keeps 16 bits of a switch's number."""
    ready.autopilot.script[MODE] = None
    ready.a.command(START)
    ready.until(lambda: MODE in ready.autopilot.commands())
    ready.a.command(*command)
    ready.wait(5.0)
    assert command[0] in ready.autopilot.commands()
    assert ready.a.acks(START) == [IN_PROGRESS, FAILED]
    assert not ready.autopilot.armed


NO_EFFECT = "START had no effect: the vehicle had landed and disarmed. Send START again."


def landed(ready: Bench) -> None:
    """In flight, then on the ground and disarmed; the heartbeat that says so is still to come."""
    ready.a.command(START)
    ready.until(lambda: ready.companion.view.phase is Phase.ON_MISSION)
    ready.wait(3.0)
    ready.until(lambda: ready.clock.now - ready.companion.autopilot.aircraft.telemetry.heartbeat.at < 0.1)
    ready.autopilot.armed, ready.autopilot.airborne = False, False
    ready.autopilot.forgets.update((START, MODE))  # it says ACCEPTED, and nothing flies


@pytest.mark.parametrize(("command", "word"), [((START,), "START"), ((MODE, 1, AUTO), "AUTO")], ids=["START", "AUTO"])
def test_a_start_after_the_landing_and_before_the_heartbeat_says_so_is_answered_in_words(
    ready: Bench, command: tuple[int, ...], word: str
) -> None:
    """The fault: accepted, nothing flew, and the operator heard no word."""
    landed(ready)
    ready.a.command(*command)
    ready.run(2.0)
    assert ready.companion.view.phase is Phase.ON_LOAD
    assert NO_EFFECT.replace("START", word, 1) in ready.a.texts()
    assert "had no effect" not in ready.b.texts()
    ready.autopilot.forgets.clear()
    ready.a.command(START)
    ready.until(lambda: ready.companion.view.phase is Phase.ON_MISSION)


def test_a_station_that_commands_no_more_is_not_told_to_send_start_again(ready: Bench) -> None:
    landed(ready)
    ready.a.command(START)
    ready.run(0.1)
    orders = ready.companion.autopilot.orders
    orders._authority = replace(orders._authority, commands=lambda station: station == 252)
    ready.run(2.0)
    assert ready.companion.view.phase is Phase.ON_LOAD
    assert "had no effect" not in ready.a.texts()


def test_a_start_some_seconds_before_the_landing_is_not_said_to_have_had_no_effect(ready: Bench) -> None:
    ready.a.command(START)
    ready.until(lambda: ready.companion.view.phase is Phase.ON_MISSION)
    ready.a.command(START)
    ready.wait(3.0)
    ready.autopilot.armed, ready.autopilot.airborne = False, False
    ready.until(lambda: ready.companion.view.phase is Phase.ON_LOAD)
    ready.run(1.0)
    assert "had no effect" not in ready.a.texts()


def test_a_start_that_its_own_station_ends_by_a_disarm_is_not_said_to_have_had_no_effect(ready: Bench) -> None:
    """The fault: it flew on for a second, then the station disarmed, and heard that it had landed before."""
    ready.a.command(START)
    ready.until(lambda: ready.companion.view.phase is Phase.ON_MISSION)
    ready.wait(3.0)
    ready.a.command(MODE, 1, AUTO)
    ready.run(0.3)
    ready.a.command(ARM, 0, 21196)
    ready.until(lambda: ready.companion.view.phase is Phase.ON_LOAD)
    ready.run(1.0)
    assert "had no effect" not in ready.a.texts()


TAKE_OFF, FLY = mavlink.MAV_CMD_NAV_TAKEOFF, mavlink.MAV_CMD_SOLO_BTN_FLY_HOLD
LAND_START, RETURN_PATH = mavlink.MAV_CMD_DO_LAND_START, 188
MODE = mavlink.MAV_CMD_DO_SET_MODE


def test_a_rover_does_not_start_and_the_operator_reads_why(ready: Bench) -> None:
    """Mode 4 and mode 3 are no GUIDED and no AUTO there."""
    ready.autopilot.kind = mavlink.MAV_TYPE_GROUND_ROVER
    ready.run(1.5)
    ready.a.command(START)
    ready.run(0.5)
    assert ready.a.acks(START)[-1] == REJECTED
    assert "START refused: ardupilotmega ground rover is neither ArduCopter nor ArduPlane" in ready.a.texts()
    assert START not in ready.autopilot.commands()


def test_an_arduplane_that_is_set_to_say_that_it_is_a_copter_does_not_start(
    bench: Bench, delivery: MissionPackage
) -> None:
    """It would be flown by a copter's modes: RTL, 6, is its FBWB."""
    bench.autopilot.parameters["Q_MAV_TYPE"] = 2.0
    bench.connect()
    bench.share(delivery)
    bench.wait(12.0)
    bench.a.command(START)
    bench.run(0.5)
    assert bench.a.acks(START) == [REJECTED]
    needs = "START refused: Q_MAV_TYPE is 2: its modes are taken for those of another aircraft"
    assert needs in bench.a.texts()
    (finding,) = [each for each in bench.companion.autopilot.preflight.findings or () if each.parameter == "Q_MAV_TYPE"]
    assert finding.text.endswith("; START is refused")


@pytest.mark.parametrize("told", [0.0, 1.0])
def test_one_that_says_what_it_is_starts(bench: Bench, told: float) -> None:
    plane = bench.autopilot = PlaneAutopilot()
    plane.position, plane.way_down = (52.69, 5.42), 9
    plane.parameters |= {"RTL_AUTOLAND": 1.0, "ARMING_REQUIRE": 1.0, "Q_MAV_TYPE": told}
    bench.connect()
    bench.share(load(MISSIONS / "dike"))
    bench.wait(12.0)
    bench.a.command(START)
    bench.until(lambda: bench.companion.view.phase is Phase.ON_MISSION)


class TestByHand:
    """Whatever else arms or takes off on the ground needs what START needs, whoever commands."""

    @pytest.mark.parametrize(
        ("command", "first", "second", "word"),
        [
            (ARM, 1.0, 0.0, "arm"),
            (ARM, 1.0, 21196.0, "arm"),
            (TAKE_OFF, 0.0, 0.0, "take-off"),
            (AUX, 153.0, 2.0, "auxiliary switch armdisarm"),
            (AUX, 153.0 + 65536.0, 2.0, "auxiliary switch armdisarm"),
            (FLY, 0.0, 0.0, "solo btn fly hold"),
            (MODE, 1.0, 28.0, "mode TURTLE"),
            (MODE, 1.0, 28.0 + 256.0, "mode TURTLE"),
        ],
        ids=["arm", "by force", "take off", "switch", "its number + 2^16", "button", "turtle", "its number + 2^8"],
    )
    def test_without_a_mission_it_is_refused_and_the_operator_reads_why(
        self, bench: Bench, command: int, first: float, second: float, word: str
    ) -> None:
        bench.connect()
        bench.a.command(command, first, second)
        bench.run(0.5)
        assert bench.a.acks(command) == [REJECTED]
        assert bench.a.texts() == f"{word} refused: no mission loaded; outside the zone of GCSA"
        assert command not in bench.autopilot.commands()
        (entry,) = [entry for entry in bench.journal() if entry["event"] == "refused"]
        assert entry["reason"] == "no mission loaded; outside the zone of GCSA"

    def test_a_mode_that_arms_is_refused_in_whatever_message_it_comes(self, bench: Bench) -> None:
        bench.connect()
        bench.a.send(mavlink.MAVLink_set_mode_message(1, 1, 28))
        bench.a.send(mavlink.MAVLink_set_mode_message(1, 1, 4))
        bench.run(0.5)
        assert bench.a.texts() == "mode TURTLE refused: no mission loaded; outside the zone of GCSA"
        assert [m.custom_mode for m in bench.autopilot.received if m.get_type() == "SET_MODE"] == [4]

    @pytest.mark.parametrize("command", [ARM, TAKE_OFF, AUX])
    def test_with_all_that_start_needs_it_passes(self, ready: Bench, command: int) -> None:
        ready.a.command(command, 153.0 if command == AUX else 1.0, 2.0)
        ready.run(0.5)
        assert command in ready.autopilot.commands()
        (entry,) = [
            e for e in ready.journal() if e["event"] == "accepted" and str(e["what"]).startswith("COMMAND_LONG")
        ]
        assert entry["station"] == "GCSA"

    @pytest.mark.parametrize("command", [ARM, START])
    def test_whoever_begins_a_flight_hears_what_does_not_fit(self, ready: Bench, command: int) -> None:
        ready.companion.autopilot.preflight.findings = (Finding("", "the guard is old"),)
        ready.a.command(command, 1.0)
        ready.run(0.5)
        assert ready.a.texts().count("preflight: the guard is old") == 1

    @pytest.mark.parametrize(("command", "word"), [(LAND_START, "land start"), (RETURN_PATH, "return path start")])
    def test_nothing_begins_in_the_middle_of_the_mission(self, ready: Bench, command: int, word: str) -> None:
        """The fault: an aircraft that its pilot had armed was in AUTO by these, with whatever START lacked."""
        ready.autopilot.armed = True
        ready.run(1.5)
        for _ in range(2):
            ready.a.command(command)
            ready.wait(4.0)  # sent anew it lifts nothing
        assert ready.a.acks(command) == [REJECTED, REJECTED]
        assert f"{word} refused: on the ground a flight begins with START" in ready.a.texts()
        assert command not in ready.autopilot.commands()
        entries = [entry for entry in ready.journal() if entry["event"] == "refused"]
        assert [entry["reason"] for entry in entries][:1] == ["on the ground a flight begins with START"]

    @pytest.mark.parametrize("command", [LAND_START, RETURN_PATH])
    def test_in_flight_they_are_a_way_home(self, ready: Bench, command: int) -> None:
        ready.a.command(START)
        ready.until(lambda: ready.companion.view.phase is Phase.ON_MISSION)
        ready.a.command(command)
        ready.run(0.5)
        assert command in ready.autopilot.commands()

    def test_to_disarm_needs_nothing(self, bench: Bench) -> None:
        bench.connect()
        bench.a.command(ARM, 0.0, 21196.0)
        bench.run(0.5)
        assert ARM in bench.autopilot.commands()

    def test_armed_by_hand_it_may_take_off_by_hand(self, ready: Bench) -> None:
        ready.autopilot.armed = True
        ready.run(1.5)
        ready.a.command(TAKE_OFF)
        ready.run(0.5)
        assert TAKE_OFF in ready.autopilot.commands()

    def test_in_flight_the_commander_arms_and_takes_off_as_ever(self, ready: Bench) -> None:
        ready.a.command(START)
        ready.until(lambda: ready.companion.view.phase is Phase.ON_MISSION)
        ready.a.command(TAKE_OFF)
        ready.run(0.5)
        assert TAKE_OFF in ready.autopilot.commands()

    def test_nobody_else_may(self, ready: Bench) -> None:
        ready.b.command(ARM, 1.0)
        ready.run(0.5)
        assert ready.b.acks(ARM) == [NOT_IN_CONTROL]
        assert ARM not in ready.autopilot.commands()
