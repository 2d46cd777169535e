# SPDX-License-Identifier: GPL-3.0-or-later

"""The station's module and its panel: what the panel is told, and what an order does. The socket is a real one."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from gcs_module import commands as station_commands
from gcs_module import duty_commands
from gcs_module import module as gcs_module
from gcs_module.duty import Duty
from gcs_module.panel.endpoint import find, running
from gcs_module.panel.orders import Order
from gcs_module.panel.reader import Reader
from gcs_module.panel.snapshot import AircraftSeen
from gcs_module.peer_operators import operator_message
from mavproxy_handover.core.common.model import Reason
from mavproxy_handover.mission.package import from_bytes
from mavproxy_handover.wire import codec
from mavproxy_handover.wire.frames import parse_one
from tests.module.conftest import Clock
from tests.module.test_station_module import StationBench, authority, connect_message, key


@pytest.fixture
def station(monkeypatch: pytest.MonkeyPatch, clock: Clock, tmp_path: Path) -> Iterator[StationBench]:
    monkeypatch.setattr(gcs_module, "time", clock)
    monkeypatch.setattr(station_commands, "time", clock)
    monkeypatch.setattr(duty_commands, "time", clock)
    monkeypatch.setenv("HANDOVER_PANELS", str(tmp_path / "panels"))
    bench = StationBench(tmp_path, clock)
    bench.configure(consent="operator")
    yield bench
    bench.close()
    assert bench.mpstate.escaped == []


@pytest.fixture
def panel() -> Iterator[Reader]:
    made = Reader(lambda: find("GCSA"))
    yield made
    made.close()


def run(station: StationBench, panel: Reader, seconds: float = 0.6) -> AircraftSeen:
    for _ in range(round(seconds / 0.05)):
        station.run(0.05)
        panel.tick(station.clock.now)
    assert panel.seen is not None
    return panel.seen.aircraft[0]


def order(station: StationBench, panel: Reader, do: str, argument: str = "", vehicle: int = 1) -> tuple[bool, str]:
    number = panel.next_number()
    assert panel.send(Order(number, do, vehicle, argument))
    run(station, panel)
    ((used, text),) = [(used, text) for which, used, text in panel.replies if which == number]
    return used, text


def ask(station: StationBench, handover_id: int, reason: Reason = Reason.ZONE) -> None:
    station.hear(mavlink.MAVLink_on_handover_message(*key(handover_id), 0, reason, 0))


def ahead(crossing: int, in_s: int = 20) -> Any:
    return mavlink.MAVLink_handover_ahead_message(251, 190, 1, 251, 252, crossing, 1, in_s, 0, 0)


def answers(station: StationBench, kind: str) -> list[int]:
    return [m.consent for m in station.sent() if m.get_type() == kind]


def test_the_panel_is_told_what_the_station_knows(station: StationBench, panel: Reader) -> None:
    module = station.load()
    digest = module.aircraft[0].mission_transfer.held.digest
    station.hear(connect_message(digest=digest))
    station.hear(authority(zone_ends=31))
    station.hear(mavlink.MAVLink_heartbeat_message(2, 3, 0x81, 3, 4, 3), autopilot=True)
    place = (0, 526790000, 59240000, 40000, 30000, 300, 400, 0, 9000)
    station.hear(mavlink.MAVLink_global_position_int_message(*place), autopilot=True)
    began = station.clock.now
    seen = run(station, panel)
    assert panel.seen is not None
    assert (panel.seen.station, [(peer.name, peer.up) for peer in panel.seen.peers]) == ("GCSA", [("GCSB", False)])
    assert (seen.name, seen.commander, seen.own, seen.phase, seen.epoch) == ("drone-1", "GCSA", True, "on_mission", 1)
    assert (seen.height_m.value, seen.speed_mps.value, seen.height_m.at) == (30.0, 5.0, began)
    assert seen.mode is not None
    assert (seen.mode.value, seen.zone) == ("AUTO", "GCSA")
    assert seen.zone_ends_at == began + 30.0
    assert from_bytes(panel.missions[seen.mission]).digest == digest


def of_payload(component: int, station: int) -> bytes:
    own = mavlink.MAVLink(None, srcSystem=1, srcComponent=component)
    return bytes(mavlink.MAVLink_control_status_message(0, station, [0] * 10).pack(own))


def test_the_payload_is_shown_by_kind_with_its_age(station: StationBench, panel: Reader) -> None:
    module = station.load()
    station.hear(connect_message())
    station.hear(authority())
    assert run(station, panel).payload == ()
    began = station.clock.now
    for component, holder in ((154, 252), (100, 251), (169, 0)):
        frame = parse_one(of_payload(component, holder))
        assert frame is not None
        module.aircraft[0].on_frame(frame, None)
    seen = run(station, panel)
    found = tuple(tuple(each) for each in seen.payload)
    assert found == (("gimbal", "GCSB", began), ("camera", "GCSA", began), ("winch", "no station", began))
    assert module.aircraft[0].core.commander == 251, "it is no flight authority"
    lines = station.mpstate.type("handover status")
    assert [line for line in lines if line.startswith("payload")] == [
        "payload   gimbal: GCSB",
        "payload   camera: GCSA",
        "payload   winch: no station",
    ]
    station.clock.now += 10.0
    assert "payload   gimbal: GCSB (11 s old)" in station.mpstate.type("handover status")


def test_a_station_asks_for_the_whole_payload_or_for_a_part(station: StationBench) -> None:
    station.load()
    station.hear(connect_message())
    station.sent()
    station.mpstate.type("handover payload request camera")
    station.run(0.1)
    asked = [(m.target_component, m.param1) for m in station.sent() if m.get_type() == "COMMAND_LONG"]
    assert asked == [(100, 1.0)]
    station.mpstate.type("handover payload release")
    station.run(0.1)
    asked = [(m.target_component, m.param1) for m in station.sent() if m.get_type() == "COMMAND_LONG"]
    assert asked == [(154, 0.0), (100, 0.0), (169, 0.0)]
    for typed in ("lamp", "request lamp", "request camera now"):
        told = station.mpstate.type(f"handover payload {typed}")
        assert told
        assert station.sent() == []


def test_an_accept_answers_the_question_that_it_names(station: StationBench, panel: Reader) -> None:
    station.load()
    station.hear(connect_message())
    ask(station, 3)
    question = run(station, panel).question
    assert question is not None
    assert (question.take, question.from_station, question.to_station) == (False, "GCSA", "GCSB")
    station.sent()
    assert order(station, panel, "accept", question.number) == (True, "Accepted.")
    assert answers(station, "OK_HANDOVER") == [0]
    assert run(station, panel).question is None
    assert [entry["order"] for entry in station.journal("panel")] == ["accept"]


def test_an_accept_for_a_question_that_was_replaced_does_nothing(station: StationBench, panel: Reader) -> None:
    station.load()
    station.hear(connect_message())
    ask(station, 3)
    first = run(station, panel).question
    ask(station, 4)
    second = run(station, panel, 4.0).question
    assert first is not None
    assert second is not None
    assert first.number != second.number
    station.sent()
    for do in ("accept", "deny"):
        used, text = order(station, panel, do, first.number)
        assert (used, text) == (False, "Not used: another question has taken its place. Read it, then answer.")
    assert answers(station, "OK_HANDOVER") == []
    assert order(station, panel, "deny", second.number) == (True, "Denied.")
    assert answers(station, "OK_HANDOVER") == [1]
    assert order(station, panel, "accept", second.number) == (False, "Not used: that question is over.")
    assert answers(station, "OK_HANDOVER") == []


def test_an_answer_while_the_served_program_is_silent_is_not_used(station: StationBench, panel: Reader) -> None:
    """Nothing is answered in a silent program's name, so no answer may look as if it was given."""
    module = station.load()
    station.hear(connect_message())
    ask(station, 3)
    question = run(station, panel).question
    assert question is not None
    module.aircraft[0].mute = True
    station.sent()
    silent = "the program served by this station is silent. Start it, then answer."
    for do in ("accept", "deny"):
        assert order(station, panel, do, question.number) == (False, f"Not used: {silent}")
    assert station.mpstate.type("handover accept")[-1].endswith(f"Answer not used: {silent}")
    assert answers(station, "OK_HANDOVER") == []
    module.aircraft[0].mute = False
    seen = run(station, panel).question
    assert seen is not None
    assert seen.number == question.number, "it is still open"
    assert order(station, panel, "accept", question.number) == (True, "Accepted.")
    assert answers(station, "OK_HANDOVER") == [0]


def test_an_answer_just_after_another_question_is_not_used(station: StationBench, panel: Reader) -> None:
    """The number is right, but nobody can have read the question in that time."""
    station.load()
    station.hear(connect_message())
    ask(station, 3)
    run(station, panel)
    ask(station, 4)
    second = run(station, panel, 0.3).question
    assert second is not None
    station.sent()
    assert order(station, panel, "accept", second.number) == (
        False,
        "Not used: the question is new. Read it, then answer again.",
    )
    assert answers(station, "OK_HANDOVER") == []


def test_an_early_answer_can_be_changed(station: StationBench, panel: Reader) -> None:
    station.load()
    station.hear(connect_message())
    station.hear(ahead(1))
    seen = run(station, panel)
    assert seen.question is not None
    assert seen.border is not None
    assert (seen.question.early, seen.border.answer, seen.border.number) == (True, "waiting", seen.question.number)
    assert order(station, panel, "accept", seen.question.number) == (True, "Accepted.")
    border = run(station, panel, 1.0).border
    assert border is not None
    assert border.answer == "granted"
    assert order(station, panel, "accept", border.number) == (True, "Accepted.")
    assert order(station, panel, "deny", border.number) == (True, "Denied.")
    assert run(station, panel).border.answer == "denied"  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("do", "argument", "command", "first"),
    [
        ("request", "", 32100, 1.0),
        ("release", "", 32100, 0.0),
        ("give", "GCSB", 32100, 1.0),
        ("stop", "", mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0.0),
        ("continue", "", mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 1.0),
        ("resume", "", mavlink.MAV_CMD_DO_SET_MODE, 1.0),
        ("return", "", mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH, 0.0),
    ],
)
def test_an_order_sends_what_the_typed_command_sends(
    station: StationBench, panel: Reader, do: str, argument: str, command: int, first: float
) -> None:
    station.load()
    station.hear(connect_message())
    run(station, panel)
    station.sent()
    assert order(station, panel, do, argument)[0]
    assert (command, first) in station.commands()
    station.sent()
    station.mpstate.type(f"handover {do} {argument}".rstrip())
    assert (command, first) in station.commands()


def test_an_override_is_asked_for_and_alarms_are_acknowledged(station: StationBench, panel: Reader) -> None:
    station.load()
    station.hear(connect_message())
    station.hear(authority())
    station.hear(authority(commander=0, epoch=2))
    alarm = run(station, panel).alarms[0]
    assert (alarm.name, alarm.level, alarm.acknowledged) == ("commander", 3, False)
    assert alarm.cause.startswith("The commander is lost")
    assert order(station, panel, "acknowledge") == (True, "Acknowledge.")
    assert run(station, panel).alarms[0].acknowledged
    station.sent()
    assert order(station, panel, "override", "energy") == (True, "Override energy.")
    assert [m.limit for m in station.sent() if m.get_type() == "HANDOVER_OVERRIDE"] != []


@pytest.mark.parametrize(
    ("do", "argument", "vehicle", "says"),
    [
        ("give", "GCSX", 1, "Not used: no station 'GCSX'; there are GCSB."),
        ("stop", "", 9, "Not used: this station has no vehicle 9."),
        ("accept", "1.2.3", 1, "Not used: that question is over."),
    ],
)
def test_an_order_that_makes_no_sense_says_why(
    station: StationBench, panel: Reader, do: str, argument: str, vehicle: int, says: str
) -> None:
    station.load()
    station.hear(connect_message())
    run(station, panel)
    station.sent()
    assert order(station, panel, do, argument, vehicle) == (False, says)
    assert station.commands() == []


def test_a_fault_while_an_order_is_carried_out_ends_nothing(
    station: StationBench, panel: Reader, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = station.load()
    station.hear(connect_message())
    run(station, panel)

    def fails(_args: list[str]) -> None:
        raise RuntimeError("planted")

    monkeypatch.setattr(module.aircraft[0].commands, "run", fails)
    assert order(station, panel, "stop") == (False, "Not used: internal fault, see the station's journal.")
    assert module.faults["panel"] == 1
    run(station, panel)
    assert panel.connected


def test_without_an_operator_on_duty_the_panel_asks_for_nothing(station: StationBench, panel: Reader) -> None:
    station.config.write_text(station.config.read_text().replace("vehicle = 1", "vehicle = 1\nrequire_operator = true"))
    station.load()
    station.hear(connect_message())
    run(station, panel)
    station.sent()
    used, text = order(station, panel, "request")
    assert not used
    assert text == "Not used: no operator is on duty. Sign on first."
    assert station.commands() == []
    station.mpstate.type("handover operator Jansen")
    assert order(station, panel, "request")[0]


def test_operators_sign_on_and_off_and_a_shift_changes_by_the_panel(station: StationBench, panel: Reader) -> None:
    station.load()
    station.hear(connect_message())
    station.hear(authority())
    run(station, panel)
    assert order(station, panel, "sign_on", "Jansen", 0) == (True, "Jansen is on duty.")
    assert panel.seen is not None
    assert (panel.seen.operator, panel.seen.next_operator) == ("Jansen", "")
    told = "Read the briefing, then confirm it. Jansen is on duty until then."
    assert order(station, panel, "sign_on", "Bakker", 0) == (True, told)
    assert panel.seen.next_operator == "Bakker"
    assert panel.seen.next_until is not None
    assert order(station, panel, "sign_on", "Bakker", 0) == (True, "Read the briefing, then confirm it.")
    assert panel.seen.operator == "Jansen", "a second press does not confirm"
    used, text = order(station, panel, "confirm", "Visser", 0)
    assert (used, text) == (False, "Not used: the time to confirm is over. Sign on again.")
    assert order(station, panel, "sign_on", "Jansen", 0) == (True, "Jansen stays on duty.")
    assert order(station, panel, "confirm", "Bakker", 0)[0] is False
    order(station, panel, "sign_on", "Bakker", 0)
    assert order(station, panel, "confirm", "Bakker", 0) == (True, "Bakker is on duty, after Jansen.")
    assert panel.seen.operator == "Bakker"
    used, text = order(station, panel, "sign_off", "", 0)
    assert not used
    assert text.startswith("Bakker stays on duty: drone-1 flies under this station's command")
    assert order(station, panel, "sign_on", "off", 0) == (False, "Not used: 'off' is no name.")
    names = [(entry.get("operator"), entry.get("before")) for entry in station.journal("operator")]
    assert names == [("Jansen", None), ("Bakker", "Jansen")]


def test_start_and_share_are_the_typed_commands(station: StationBench, panel: Reader) -> None:
    station.load()
    station.hear(connect_message())
    run(station, panel)
    station.sent()
    assert order(station, panel, "start") == (True, "Start.")
    assert mavlink.MAV_CMD_MISSION_START in [command for command, _first in station.commands()]
    station.sent()
    assert order(station, panel, "share") == (True, "Share.")
    assert "MISSION_PACKAGE" in {m.get_type() for m in station.sent()}


def test_a_lifted_limit_is_told_with_its_end(station: StationBench, panel: Reader) -> None:
    station.load()
    station.hear(connect_message())
    station.hear(authority())
    run(station, panel)
    order(station, panel, "override", "fence")
    (asked,) = {m.nonce for m in station.sent() if m.get_type() == "HANDOVER_OVERRIDE"}
    now = station.clock.now
    station.hear(mavlink.MAVLink_handover_override_message(251, 190, 1, 2, asked, 60))
    (limit,) = run(station, panel).overrides
    assert limit[0] in ("energy", "fence", "coverage")
    assert now + 59.0 < limit[1] < now + 62.0
    assert run(station, panel, 62.0).overrides == ()


def test_the_operator_of_another_station_is_told_by_the_ground_link(station: StationBench, panel: Reader) -> None:
    module = station.load()
    duty = Duty(required=False)
    duty.command("Bakker", 0.0, "")
    seen = run(station, panel)
    assert seen is not None
    assert panel.seen is not None
    assert panel.seen.peers[0].operator is None
    frame = parse_one(bytes(codec.pack(operator_message(251, duty), mavlink.MAVLink(None, srcSystem=252))))
    assert frame is not None
    module._on_peer(frame)
    run(station, panel)
    assert panel.seen.peers[0].operator is not None
    assert panel.seen.peers[0].operator.value == "Bakker"


def test_unload_closes_the_socket_and_the_panel_notices(station: StationBench, panel: Reader) -> None:
    station.load()
    station.hear(connect_message())
    run(station, panel)
    assert running() == ["GCSA"]
    station.mpstate.unload("handover_gcs")
    panel.tick(station.clock.now)
    assert not panel.connected
    assert running() == []


def test_without_a_place_for_the_socket_the_station_works(
    station: StationBench, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "panels").write_text("")
    assert station.load() is not None
    assert station.mpstate.console.said("No panel can connect: ")
    station.hear(connect_message())
    assert station.mpstate.console.said("GCSA is the commander now")
