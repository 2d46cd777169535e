# SPDX-License-Identifier: GPL-3.0-or-later

"""Onboard programs in the companion's module: what passes by their link, what they hear, and what is delegated."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.events import Announce
from mavproxy_handover.core.common.model import FlightAction, Reason
from mavproxy_handover.gate.intent import Aim
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.operator.checks.command_check import MOST
from tests.module.conftest import Bench
from tests.module.test_commands_in_flight import OUT_OF_FENCE, fly_to, take_off
from tests.module.test_restart import restart
from tests.module.vehicle import AUTO, GUIDED, HOME, frames

COMPONENT = 195
BRAKE, RTL, LAND = 17, 6, 9
SET_MODE = mavlink.MAV_CMD_DO_SET_MODE
POSITION_ONLY = 0xFF8


class Program:
    """Software on the companion, by UDP."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.setblocking(False)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", 0))
            self.port: int = free.getsockname()[1]
        self.own = mavlink.MAVLink(None, srcSystem=1, srcComponent=COMPONENT)
        self.heard: list[Any] = []

    def send(self, message: Any) -> None:
        data = message.pack(self.own)
        self.own.seq = (self.own.seq + 1) & 0xFF
        self.socket.sendto(data, ("127.0.0.1", self.port))

    def listen(self) -> list[Any]:
        """What it has heard so far."""
        while True:
            try:
                self.heard += frames(self.socket.recv(65536))
            except BlockingIOError:
                return self.heard

    def got(self, kind: str) -> list[Any]:
        return [message for message in self.listen() if message.get_type() == kind]

    def texts(self) -> str:
        return "".join(f"{'' if message.chunk_seq else '|'}{message.text}" for message in self.got("STATUSTEXT"))

    def command(self, number: int, *parameters: float) -> None:
        values = [*parameters, *[0.0] * (7 - len(parameters))]
        self.send(mavlink.MAVLink_command_long_message(1, 1, number, 0, *values))

    def target(self, place: tuple[float, float], alt_m: float = 40.0) -> None:
        body = (0, 1, 1, 6, POSITION_ONLY, round(place[0] * 1e7), round(place[1] * 1e7), alt_m, *[0.0] * 8)
        self.send(mavlink.MAVLink_set_position_target_global_int_message(*body))


@pytest.fixture
def program() -> Iterator[Program]:
    program = Program()
    yield program
    program.socket.close()


def configure(bench: Bench, program: Program, rights: str, more: str = "") -> None:
    bench.config.write_text(
        bench.config.read_text()
        + f"""
            [[onboard]]
            name = "precland"
            link = "udpin:127.0.0.1:{program.port}"
            component = {COMPONENT}
            rights = {rights}
            {more}
            """
    )


def written(bench: Bench, kind: str) -> list[Any]:
    """What the autopilot got from the program."""
    return [m for m in bench.autopilot.received if m.get_type() == kind and m.get_srcComponent() == COMPONENT]


def landing_target() -> Any:
    return mavlink.MAVLink_landing_target_message(0, 0, 8, 0.1, 0.1, 5.0, 0.0, 0.0)


def test_sensors_pass_by_name_and_all_else_is_refused_in_words(bench: Bench, program: Program) -> None:
    configure(bench, program, '["sensors"]', 'sensors = ["LANDING_TARGET"]')
    bench.connect()
    program.send(landing_target())
    program.send(mavlink.MAVLink_distance_sensor_message(0, 10, 100, 50, 0, 0, 25, 0))
    program.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    program.command(SET_MODE, 1, GUIDED)
    bench.wait(1.0)
    assert len(written(bench, "LANDING_TARGET")) == 1
    assert written(bench, "DISTANCE_SENSOR") == []
    assert written(bench, "COMMAND_LONG") == []
    acks = [(ack.command, ack.result) for ack in program.got("COMMAND_ACK")]
    assert acks == [(400, mavlink.MAV_RESULT_DENIED), (SET_MODE, mavlink.MAV_RESULT_DENIED)]
    assert "distance sensor of precland refused: its rights in [[onboard]] do not have it" in program.texts()
    assert "arm of precland refused: its rights in [[onboard]] do not have it" in program.texts()
    entries = bench.journal("refused")
    assert [(entry["station"], entry["what"]) for entry in entries] == [
        ("precland", "DISTANCE_SENSOR"),
        ("precland", "COMMAND_LONG/MAV_CMD_COMPONENT_ARM_DISARM"),
    ], "the next of the same message within half a second is counted only"
    program.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    bench.wait(1.0)
    assert program.texts().count("arm of precland refused") == 1, "once a minute"


def test_a_landing_that_is_led_away_is_told_to_all_stations(
    bench: Bench, program: Program, delivery: MissionPackage
) -> None:
    configure(bench, program, '["sensors"]', 'sensors = ["LANDING_TARGET"]')
    take_off(bench, delivery)
    program.send(mavlink.MAVLink_landing_target_message(0, 0, 12, 0.9, 0.9, 100.0, 0.0, 0.0))
    bench.wait(0.3)
    assert len(written(bench, "LANDING_TARGET")) == 1, "it does not land"
    bench.autopilot.mode = LAND
    bench.until(lambda: bench.companion.autopilot.aircraft.lands)
    program.send(mavlink.MAVLink_landing_target_message(0, 0, 12, 0.9, 0.9, 100.0, 0.0, 0.0))
    bench.wait(0.3)
    assert len(written(bench, "LANDING_TARGET")) == 1
    for station in (bench.a, bench.b):
        assert "landing target of precland refused: it leads the landing more than 10 m away" in station.texts()


def test_it_hears_telemetry_and_its_own_answers_and_stations_hear_none_of_them(bench: Bench, program: Program) -> None:
    configure(bench, program, "[]")
    bench.connect()
    program.send(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3))
    bench.wait(2.0)
    assert len(written(bench, "HEARTBEAT")) == 1
    assert program.got("HEARTBEAT")
    assert program.got("GLOBAL_POSITION_INT")
    assert program.got("TUNNEL") == [], "neither lease nor guard"
    bench.a.received.clear()
    program.heard.clear()
    bench.autopilot.say(mavlink.MAVLink_command_ack_message(512, 0, 0, 0, 1, COMPONENT))
    bench.autopilot.say(mavlink.MAVLink_command_ack_message(400, 0, 0, 0, 251, 190))
    for message in list(bench.autopilot._out):
        bench.mpstate.deliver(message)
    bench.wait(0.5)
    assert [ack.command for ack in program.got("COMMAND_ACK")] == [512]
    assert [ack.command for ack in bench.a.received.got("COMMAND_ACK")] == [400]


def test_heartbeats_of_a_second_component_are_dropped_without_a_word(bench: Bench, program: Program) -> None:
    """MAVSDK 3 sends heartbeats as component 190 beside those of its own component."""
    configure(bench, program, "[]")
    bench.connect()
    beat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    program.send(beat)
    bench.wait(0.5)
    program.own.srcComponent = 190
    for _ in range(3):
        program.send(beat)
        bench.wait(1.0)
    assert bench.journal("refused") == []
    assert program.texts() == ""
    beats = [m for m in bench.autopilot.received if m.get_type() == "HEARTBEAT" and m.get_srcSystem() == 1]
    assert {m.get_srcComponent() for m in beats} == {191, COMPONENT}
    program.send(landing_target())
    bench.wait(0.5)
    assert [entry["what"] for entry in bench.journal("refused")] == ["LANDING_TARGET"]


def test_a_program_with_another_component_than_configured_is_told_in_the_journal(
    bench: Bench, program: Program
) -> None:
    configure(bench, program, "[]")
    bench.connect()
    program.own.srcComponent = 190
    program.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    bench.wait(0.5)
    assert [entry["text"] for entry in bench.journal("told")] == [
        f"heartbeat of precland refused: component must be {COMPONENT}, as in [[onboard]]"
    ]


def test_the_journal_says_when_it_is_heard_and_when_it_is_silent(bench: Bench, program: Program) -> None:
    configure(bench, program, "[]")
    bench.connect()
    bench.run(3.0)
    assert bench.journal("onboard") == []
    for _second in range(3):
        program.send(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3))
        bench.wait(1.0)
    bench.run(8.0)
    found = [(entry["text"], entry["heard"]) for entry in bench.journal("onboard")]
    assert found == [("precland is heard", True), ("precland is silent for 5 s", False)]


def test_a_fault_closes_that_link_and_nothing_else(
    bench: Bench, program: Program, monkeypatch: pytest.MonkeyPatch
) -> None:
    configure(bench, program, '["sensors"]', 'sensors = ["LANDING_TARGET"]')
    bench.connect()
    bench.breaks = True
    (port,) = bench.companion.onboard.ports
    reads = port.read
    monkeypatch.setattr(port, "read", lambda _now, _once: 1 / 0)
    program.send(landing_target())
    bench.wait(1.0)
    assert port.dropped
    assert "Link of precland closed after an internal fault" in bench.a.texts()
    assert bench.companion.view.commander == 251
    monkeypatch.setattr(port, "read", reads)
    program.send(landing_target())
    leases = len(bench.autopilot.received)
    bench.run(1.0)
    assert written(bench, "LANDING_TARGET") == []
    assert len([m for m in bench.autopilot.received[leases:] if m.get_type() == "TUNNEL"]) >= 4


# ---- guided -------------------------------------------------------------------------------------------------------


def delegate(bench: Bench, name: str = "precland", wish: int = 1, nonce: int = 7) -> Any:
    """The commander's request; the answer."""
    before = len(bench.a.received)
    bench.a.send(mavlink.MAVLink_handover_delegate_message(1, 191, 1, wish, nonce, 0, name.encode()))
    bench.wait(0.3)
    return bench.a.received.got("HANDOVER_DELEGATE", before)[-1]


@pytest.fixture
def flown(bench: Bench, program: Program, delivery: MissionPackage) -> Bench:
    configure(bench, program, '["guided"]')
    return take_off(bench, delivery)


def in_guided(bench: Bench) -> None:
    bench.a.command(SET_MODE, 1, GUIDED)
    bench.until(lambda: bench.companion.autopilot.aircraft.custom_mode == GUIDED)
    bench.wait(1.0)
    bench.autopilot.received.clear()


NEAR = (HOME[0] + 0.0005, HOME[1])


def test_targets_pass_only_while_the_commander_has_delegated_them(flown: Bench, program: Program) -> None:
    program.target(NEAR)
    flown.wait(0.3)
    assert written(flown, "SET_POSITION_TARGET_GLOBAL_INT") == []
    assert "'handover delegate precland' in GUIDED" in program.texts()
    assert delegate(flown).accepted == 0
    assert "DELEGATE precland refused: the aircraft does not fly GUIDED; order GUIDED first" in flown.a.texts()
    in_guided(flown)
    assert delegate(flown, nonce=8).accepted == 1
    program.target(NEAR)
    flown.wait(0.3)
    assert len(written(flown, "SET_POSITION_TARGET_GLOBAL_INT")) == 1
    program.target(OUT_OF_FENCE)
    flown.wait(0.3)
    assert len(written(flown, "SET_POSITION_TARGET_GLOBAL_INT")) == 1
    assert "target of precland refused" in flown.a.texts()
    assert delegate(flown, "other", nonce=9).accepted == 0


def test_silence_ends_it_with_a_confirmed_hold(flown: Bench, program: Program) -> None:
    in_guided(flown)
    assert delegate(flown).accepted == 1
    program.target(NEAR)
    flown.wait(0.5)
    flown.until(lambda: flown.companion.autopilot.aircraft.custom_mode == BRAKE, 5.0)
    flown.wait(1.5)
    text = flown.a.texts()
    assert "precland no longer leads the aircraft: the program is silent. A hold is ordered." in text
    assert "Hold confirmed: BRAKE. Order GUIDED to lead it again." in text
    assert delegate(flown, nonce=7).accepted == 1, "a late copy gets the old answer"
    program.target(NEAR)
    flown.wait(0.3)
    assert len(written(flown, "SET_POSITION_TARGET_GLOBAL_INT")) == 1, "and begins nothing"
    ends = [entry for entry in flown.journal("onboard") if entry.get("end")]
    assert [entry["end"] for entry in ends] == ["silence"]


def stream(bench: Bench, program: Program, seconds: float) -> None:
    for _ in range(round(seconds / 0.2)):
        program.target(NEAR)
        bench.wait(0.2)


def test_another_mode_of_the_commander_ends_it_and_is_not_held(flown: Bench, program: Program) -> None:
    in_guided(flown)
    assert delegate(flown).accepted == 1
    stream(flown, program, 1.0)
    flown.autopilot.received.clear()
    flown.a.command(SET_MODE, 1, RTL)
    stream(flown, program, 3.0)
    assert flown.autopilot.mode == RTL
    assert written(flown, "SET_POSITION_TARGET_GLOBAL_INT") == []
    sent = [
        m.get_type()
        for m in flown.autopilot.received
        if m.get_type() in ("COMMAND_LONG", "SET_POSITION_TARGET_GLOBAL_INT")
    ]
    assert sent[:2] == ["SET_POSITION_TARGET_GLOBAL_INT", "COMMAND_LONG"], "the stop goes first"
    assert "no longer leads the aircraft: the commander sent another command" in flown.a.texts()


def test_any_other_command_of_the_commander_ends_it_with_a_hold(flown: Bench, program: Program) -> None:
    in_guided(flown)
    assert delegate(flown).accepted == 1
    stream(flown, program, 1.0)
    flown.a.command(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, 5, -1)
    stream(flown, program, 2.0)
    assert flown.autopilot.mode == BRAKE
    assert "Hold confirmed: BRAKE" in flown.a.texts()


def test_the_commander_takes_it_back(flown: Bench, program: Program) -> None:
    in_guided(flown)
    assert delegate(flown).accepted == 1
    stream(flown, program, 1.0)
    assert delegate(flown, wish=0, nonce=9).accepted == 1
    flown.wait(2.0)
    assert flown.autopilot.mode == BRAKE
    assert "no longer leads the aircraft: the commander took it back" in flown.a.texts()


def test_only_the_commander_delegates(flown: Bench) -> None:
    in_guided(flown)
    flown.b.send(mavlink.MAVLink_handover_delegate_message(1, 191, 1, 1, 5, 0, b"precland"))
    flown.wait(0.3)
    assert flown.b.received.got("HANDOVER_DELEGATE")[-1].accepted == 0
    assert "DELEGATE precland refused: only the commander delegates" in flown.b.texts()


def test_a_transfer_for_safety_ends_it(flown: Bench, program: Program) -> None:
    in_guided(flown)
    assert delegate(flown).accepted == 1
    stream(flown, program, 1.0)
    flown.decide(Announce("TRANSFER. Out of coverage", FlightAction.TRANSFER, Reason.ZONE))
    flown.autopilot.received.clear()
    stream(flown, program, 1.0)
    assert written(flown, "SET_POSITION_TARGET_GLOBAL_INT") == []
    assert "no longer leads the aircraft: the companion has decided" in flown.a.texts()


def test_a_late_copy_of_an_earlier_request_begins_no_delegation(flown: Bench, program: Program) -> None:
    in_guided(flown)
    assert delegate(flown, nonce=7).accepted == 1
    stream(flown, program, 1.0)
    assert delegate(flown, wish=0, nonce=8).accepted == 1
    in_guided(flown)  # the commander flies itself
    assert delegate(flown, nonce=7).accepted == 1, "by a slower link: the answer of then"
    program.target(NEAR)
    flown.wait(0.3)
    assert written(flown, "SET_POSITION_TARGET_GLOBAL_INT") == []


def test_a_program_does_not_use_up_the_judgements_of_the_commander(flown: Bench, program: Program) -> None:
    in_guided(flown)
    check, now = flown.companion.autopilot.command_check, flown.clock.now
    aims = [Aim(3, HOME[0] + 0.00005 * number, HOME[1], 40.0) for number in range(30)]
    passed = [check.target(aim, 251, now, "precland") for aim in aims]
    assert passed.count(True) == MOST
    fly_to(flown, NEAR)
    assert len(flown.autopilot.got("COMMAND_INT", 251)) == 1


def _break_its_text(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    bench.breaks = True
    (port,) = bench.companion.onboard.ports
    monkeypatch.setattr(port, "say", lambda *_arguments: 1 / 0)


def test_a_fault_at_the_end_costs_no_command_of_the_commander(
    flown: Bench, program: Program, monkeypatch: pytest.MonkeyPatch
) -> None:
    in_guided(flown)
    assert delegate(flown).accepted == 1
    stream(flown, program, 1.0)
    _break_its_text(flown, monkeypatch)
    flown.a.command(SET_MODE, 1, RTL)
    flown.wait(1.0)
    assert flown.autopilot.mode == RTL
    assert flown.companion.faults == {"delegation": 1}


def test_a_fault_at_the_end_costs_no_hold(flown: Bench, program: Program, monkeypatch: pytest.MonkeyPatch) -> None:
    in_guided(flown)
    assert delegate(flown).accepted == 1
    stream(flown, program, 1.0)
    _break_its_text(flown, monkeypatch)
    flown.wait(4.0)
    assert flown.autopilot.mode == BRAKE
    assert "Hold confirmed: BRAKE" in flown.a.texts()


# ---- payload ------------------------------------------------------------------------------------------------------


def restarted(bench: Bench) -> None:
    """The companion dies in flight, and starts again."""
    bench.companion.onboard.close()
    restart(bench)
    bench.until(lambda: bench.companion.view.commander == 251)
    bench.wait(3.0)


def test_a_restart_in_flight_ends_it_with_a_hold(flown: Bench, program: Program) -> None:
    in_guided(flown)
    assert delegate(flown).accepted == 1
    stream(flown, program, 1.0)
    restarted(flown)
    stream(flown, program, 1.0)
    assert written(flown, "SET_POSITION_TARGET_GLOBAL_INT") == []
    assert flown.autopilot.mode == BRAKE
    text = flown.a.texts()
    assert "precland no longer leads the aircraft: the companion has restarted. A hold is ordered." in text
    assert "Hold confirmed: BRAKE. Order GUIDED to lead it again." in text
    assert [entry["end"] for entry in flown.journal("onboard") if entry.get("end")] == ["restart"]


def test_after_a_restart_nothing_is_held_that_the_commander_flies(flown: Bench, program: Program) -> None:
    restarted(flown)
    assert flown.autopilot.mode == AUTO
    in_guided(flown)
    flown.wait(3.0)
    assert flown.autopilot.mode == GUIDED, "it was ordered after the restart"
    assert flown.journal("onboard") == []


def test_without_a_right_to_lead_a_restart_leaves_guided_alone(
    bench: Bench, program: Program, delivery: MissionPackage
) -> None:
    configure(bench, program, "[]")
    take_off(bench, delivery)
    in_guided(bench)
    restarted(bench)
    assert bench.autopilot.mode == GUIDED


def test_a_station_asks_for_the_payload_and_flies_nothing_by_it(bench: Bench, delivery: MissionPackage) -> None:
    bench.config.write_text(bench.config.read_text() + '\n[payload]\ncontrol = "request"\n')
    take_off(bench, delivery)
    pitch, request = mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW, mavlink.MAV_CMD_REQUEST_OPERATOR_CONTROL

    def gimbals() -> list[int]:
        found = [m for m in bench.autopilot.received if m.get_type() == "COMMAND_LONG" and m.command == pitch]
        return [m.get_srcSystem() for m in found]

    bench.b.command(pitch, -30)
    bench.wait(0.5)
    assert gimbals() == []
    bench.b.send(mavlink.MAVLink_command_long_message(1, 154, request, 0, 1, 0, 10, 252, 0, 0, 0))
    bench.wait(0.5)
    ack = bench.b.received.got("COMMAND_ACK")[-1]
    assert (ack.get_srcComponent(), ack.command, ack.result) == (154, request, mavlink.MAV_RESULT_ACCEPTED)
    assert "GCSB has payload authority: gimbal" in bench.a.texts()
    bench.b.command(pitch, -30)
    bench.a.command(pitch, -90)
    bench.b.command(mavlink.MAV_CMD_NAV_LAND)
    bench.wait(0.5)
    assert gimbals() == [252]
    assert [m for m in bench.autopilot.received if getattr(m, "command", 0) == mavlink.MAV_CMD_NAV_LAND] == []
    assert "gimbal refused: another has payload authority" in bench.a.texts()
    status = [m for m in bench.b.received.got("CONTROL_STATUS") if m.get_srcComponent() == 154]
    assert (status[-1].gcs_main, status[-1].flags) == (252, 0)
    bench.a.send(mavlink.MAVLink_command_long_message(1, 154, request, 0, 1, 0, 10, 251, 0, 0, 0))
    bench.wait(0.5)
    assert "GCSA has payload authority: gimbal" in bench.b.texts()
    assert bench.companion.view.commander == 251


def test_preflight_says_which_sensors_the_autopilot_uses(bench: Bench, program: Program) -> None:
    configure(bench, program, '["sensors"]', 'sensors = ["LANDING_TARGET", "ODOMETRY"]')
    bench.autopilot.parameters.update({"PLND_ENABLED": 1.0, "PLND_TYPE": 1.0, "VISO_TYPE": 0.0})
    bench.connect()
    bench.until(lambda: bench.companion.autopilot.preflight.findings is not None, 60.0)
    texts = [finding.text for finding in bench.companion.autopilot.preflight.findings]
    used = "LANDING_TARGET of an onboard program moves the place of the landing (PLND_ENABLED, PLND_TYPE)"
    assert used in texts
    assert "ODOMETRY of an onboard program is not used: VISO_TYPE is 0" in texts


def test_preflight_says_that_the_limits_do_not_fit_the_line(bench: Bench, program: Program) -> None:
    configure(bench, program, '["sensors"]', 'sensors = ["ODOMETRY"]\nbytes_per_s = 15000')
    bench.connect()
    bench.module._to_autopilot._rated(9600)
    bench.until(lambda: bench.companion.autopilot.preflight.findings is not None, 60.0)
    texts = [finding.text for finding in bench.companion.autopilot.preflight.findings]
    assert "line to the autopilot: room for 480 bytes/s at 9600 baud, limits sum to 15000 (precland 15000)" in texts
    fields = (0, 20, 8, 1.0, 2.0, 3.0, [1.0, 0.0, 0.0, 0.0], *[0.5] * 6, [0.5] * 21, [0.5] * 21)
    for _round in range(30):
        program.send(mavlink.MAVLink_odometry_message(*fields))
    bench.wait(0.5)
    assert 0 < len(written(bench, "ODOMETRY")) < 30
    assert "odometry of precland refused: the line to the autopilot has no more room" in program.texts()


def test_preflight_says_which_sensor_no_program_sends(bench: Bench, program: Program) -> None:
    configure(bench, program, "[]")
    bench.autopilot.parameters.update({"PRX1_TYPE": 2.0})
    bench.connect()
    bench.until(lambda: bench.companion.autopilot.preflight.findings is not None, 60.0)
    texts = [finding.text for finding in bench.companion.autopilot.preflight.findings]
    assert "PRX1_TYPE is 2, and no onboard program may send OBSTACLE_DISTANCE or its like" in texts


def test_who_asks_for_the_payload_again_and_again_is_not_told_to_all(bench: Bench, delivery: MissionPackage) -> None:
    bench.config.write_text(bench.config.read_text() + '\n[payload]\ncontrol = "request"\n')
    take_off(bench, delivery)
    request, wishes = mavlink.MAV_CMD_REQUEST_OPERATOR_CONTROL, [1, 0] * 50
    for wish in wishes:
        bench.b.send(mavlink.MAVLink_command_long_message(1, 154, request, 0, wish, 0, 10, 252, 0, 0, 0))
        bench.run(0.05)
    assert bench.a.texts().count("has payload authority") == 4
    assert len([m for m in bench.a.received.got("CONTROL_STATUS") if m.get_srcComponent() == 154]) < 20
    acks = [ack.result for ack in bench.b.received.got("COMMAND_ACK") if ack.command == request]
    assert acks.count(mavlink.MAV_RESULT_ACCEPTED) == 4
    assert acks.count(mavlink.MAV_RESULT_TEMPORARILY_REJECTED) == len(wishes) - 4
    assert "PAYLOAD refused: too many requests, wait some seconds" in bench.b.texts()
    bench.wait(10.0)
    bench.b.send(mavlink.MAVLink_command_long_message(1, 154, request, 0, 1, 0, 10, 252, 0, 0, 0))
    bench.wait(0.5)
    assert bench.b.received.got("COMMAND_ACK")[-1].result == mavlink.MAV_RESULT_ACCEPTED


# ---- payload managers ---------------------------------------------------------------------------------------------


class Camera(Program):
    """A camera manager on board."""

    def __init__(self) -> None:
        super().__init__()
        self.own = mavlink.MAVLink(None, srcSystem=1, srcComponent=100)

    def beat(self) -> None:
        kind, autopilot = mavlink.MAV_TYPE_CAMERA, mavlink.MAV_AUTOPILOT_INVALID
        self.send(mavlink.MAVLink_heartbeat_message(kind, autopilot, 0, 0, 4, 3))


@pytest.fixture
def camera(bench: Bench) -> Iterator[Camera]:
    camera = Camera()
    bench.config.write_text(
        bench.config.read_text()
        + f"""
            [[onboard]]
            name = "cam"
            link = "udpin:127.0.0.1:{camera.port}"
            component = 100
            rights = ["manager"]

            [payload]
            camera = "GCSB"
            """
    )
    yield camera
    camera.socket.close()


def to_camera(command: int, *parameters: float) -> Any:
    return mavlink.MAVLink_command_long_message(1, 100, command, 0, *parameters, *[0.0] * (7 - len(parameters)))


def commands_of(camera: Camera) -> list[tuple[int, int]]:
    return [(m.get_srcSystem(), m.command) for m in camera.got("COMMAND_LONG")]


def test_stations_hear_a_camera_on_board_and_command_it(bench: Bench, camera: Camera, delivery: MissionPackage) -> None:
    take_off(bench, delivery)
    camera.beat()
    bench.wait(0.5)
    beats = [m for m in bench.b.received.got("HEARTBEAT") if m.get_srcComponent() == 100]
    assert [beat.type for beat in beats] == [mavlink.MAV_TYPE_CAMERA]
    bench.b.send(to_camera(mavlink.MAV_CMD_IMAGE_START_CAPTURE, 0, 0, 1))
    bench.a.send(to_camera(mavlink.MAV_CMD_IMAGE_START_CAPTURE, 0, 0, 1))
    bench.a.send(to_camera(mavlink.MAV_CMD_REQUEST_MESSAGE, 259))
    bench.a.send(to_camera(mavlink.MAV_CMD_NAV_LAND))
    bench.wait(0.5)
    wanted = [(252, mavlink.MAV_CMD_IMAGE_START_CAPTURE), (251, mavlink.MAV_CMD_REQUEST_MESSAGE)]
    assert sorted(commands_of(camera)) == sorted(wanted)
    to_autopilot = [m for m in bench.autopilot.received if getattr(m, "target_component", 0) == 100]
    assert to_autopilot == []
    acks = {ack.command: (ack.get_srcComponent(), ack.result) for ack in bench.a.received.got("COMMAND_ACK")}
    assert acks[mavlink.MAV_CMD_IMAGE_START_CAPTURE][0] == 100
    assert acks[mavlink.MAV_CMD_NAV_LAND] == (100, mavlink.MAV_RESULT_UNSUPPORTED)
    assert "no command of a camera, gimbal or winch" in bench.a.texts()
    camera.send(mavlink.MAVLink_command_ack_message(mavlink.MAV_CMD_IMAGE_START_CAPTURE, 0, 0, 0, 252, 190))
    camera.send(mavlink.MAVLink_camera_image_captured_message(0, 0, 1, 0, 0, 0, 0, [1, 0, 0, 0], 0, 1, b""))
    bench.wait(0.5)
    mine = [ack for ack in bench.b.received.got("COMMAND_ACK") if ack.get_srcComponent() == 100]
    assert [(ack.command, ack.result) for ack in mine] == [(mavlink.MAV_CMD_IMAGE_START_CAPTURE, 0)]
    assert bench.a.received.got("CAMERA_IMAGE_CAPTURED")
    assert bench.b.received.got("CAMERA_IMAGE_CAPTURED"), "the station that has the camera"


def test_a_camera_whose_link_has_a_fault_costs_nothing_else(
    bench: Bench, camera: Camera, delivery: MissionPackage, monkeypatch: pytest.MonkeyPatch
) -> None:
    take_off(bench, delivery)
    bench.breaks = True
    (port,) = bench.companion.onboard.ports
    monkeypatch.setattr(port, "write", lambda _raw: 1 / 0)
    bench.b.send(to_camera(mavlink.MAV_CMD_IMAGE_START_CAPTURE, 0, 0, 1))
    bench.wait(0.5)
    assert port.dropped
    assert "Link of cam closed after an internal fault" in bench.a.texts()
    before = len(bench.autopilot.received)
    bench.b.send(to_camera(mavlink.MAV_CMD_IMAGE_START_CAPTURE, 0, 0, 1))
    bench.run(1.0)
    late = bench.autopilot.received[before:]
    assert [m for m in late if getattr(m, "target_component", 0) == 100] == [], "the autopilot does not get it instead"
    assert len([m for m in late if m.get_type() == "TUNNEL"]) >= 4
    assert bench.companion.view.commander == 251
