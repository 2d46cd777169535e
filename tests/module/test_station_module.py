# SPDX-License-Identifier: GPL-3.0-or-later

"""`module load handover_gcs`: load and unload, the operator's words, packages, and faults that stay inside."""

from __future__ import annotations

import json
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from MAVProxy.modules.lib.mp_module import MPModule
from pymavlink.dialects.v20 import ardupilotmega as stock
from pymavlink.dialects.v20 import handover as mavlink

from gcs_module import commands as station_commands
from gcs_module import module as gcs_module
from gcs_module.briefing import NAMES
from mavproxy_handover.core.common.model import Reason
from mavproxy_handover.mission import package as mission_package
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.tools.version import VERSION
from mavproxy_handover.wire.package_transfer import PackageReceiver, PackageSender
from mavproxy_handover.wire.texts import status_texts
from sitl.vehicles.ports import PortPicker
from tests.module.conftest import Clock
from tests.module.proxy import MPState
from tests.module.vehicle import frames
from tests.packages import MISSIONS, ROUND

START, PAUSE = mavlink.MAV_CMD_MISSION_START, mavlink.MAV_CMD_DO_PAUSE_CONTINUE
IN_PROGRESS, ACCEPTED = mavlink.MAV_RESULT_IN_PROGRESS, mavlink.MAV_RESULT_ACCEPTED


class Peer:
    """Another station's end of the ground link."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.setblocking(False)
        self.port: int = self.socket.getsockname()[1]
        self.own = mavlink.MAVLink(None, srcSystem=252, srcComponent=190)

    def received(self) -> list[Any]:
        found = []
        while True:
            try:
                found += frames(self.socket.recv(65536))
            except BlockingIOError:
                return found


class StationBench:
    """GCSA's module, the vehicle it listens to, and GCSB at the other end of the ground link."""

    def __init__(self, folder: Path, clock: Clock) -> None:
        self.clock, self.folder = clock, folder
        self.mpstate = MPState()
        self.peer = Peer()
        self.listens = PortPicker().udp()
        self.config = folder / "station.toml"
        self.configure()
        self.module: Any = None
        self._companion = mavlink.MAVLink(None, srcSystem=1, srcComponent=191)
        self._autopilot = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)

    def configure(self, mission: Path | None = ROUND, consent: str = "automatic") -> None:
        self.config.write_text(
            f"""
            [station]
            name = "GCSA"
            sysid = 251
            vehicle = 1
            consent = "{consent}"
            {"" if mission is None else f'mission = "{mission}"'}
            journal = "GCSA.jsonl"
            [ground]
            listen = "udpin:127.0.0.1:{self.listens}"
            allow_unsigned = true
            [[peer]]
            name = "GCSB"
            sysid = 252
            link = "udpout:127.0.0.1:{self.peer.port}"
            """
        )

    def load(self, **kwargs: Any) -> Any:
        self.module = self.mpstate.load("handover_gcs", gcs_module, config=str(self.config), **kwargs)
        return self.module

    def hear(self, message: Any, *, autopilot: bool = False) -> None:
        """A message of the companion (or the autopilot), as a MAVProxy without our dialect hands it over."""
        raw = message.pack(self._autopilot if autopilot else self._companion)
        self.mpstate.deliver(stock.MAVLink(None).decode(bytearray(raw)))

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.05)):
            self.clock.now += 0.05
            self.mpstate.loop()

    def sent(self) -> list[Any]:
        """What has been sent to the vehicle since this was last asked."""
        written = self.mpstate.mav_master[0].written
        found = [message for data in written for message in frames(data)]
        written.clear()
        return found

    def commands(self) -> list[tuple[int, float]]:
        return [(m.command, m.param1) for m in self.sent() if m.get_type() == "COMMAND_LONG"]

    def journal(self, event: str) -> list[dict[str, Any]]:
        assert self.module is None or self.module.event_log.wait_until_written(10.0)
        lines = (self.folder / "GCSA.jsonl").read_text().splitlines()
        return [entry for entry in map(json.loads, lines) if entry["event"] == event]

    def close(self) -> None:
        if self.mpstate.modules:
            self.mpstate.unload("handover_gcs")
        self.peer.socket.close()


@pytest.fixture
def station(monkeypatch: pytest.MonkeyPatch, clock: Clock, tmp_path: Path) -> Iterator[StationBench]:
    monkeypatch.setattr(gcs_module, "time", clock)
    monkeypatch.setattr(station_commands, "time", clock)
    bench = StationBench(tmp_path, clock)
    yield bench
    bench.close()
    assert bench.mpstate.escaped == []


def connect_message(nonce: int = 7, epoch: int = 1, commander: int = 251, digest: bytes = bytes(32)) -> Any:
    return mavlink.MAVLink_connect_message(251, 190, 1, 251, 1, nonce, epoch, commander, b"drone-1", list(digest))


def heartbeat(armed: bool) -> Any:
    return mavlink.MAVLink_heartbeat_message(2, 3, 128 if armed else 0, 0, 4, 3)


def key(handover_id: int = 3, epoch: int = 1) -> tuple[int, ...]:
    """target system and component, vehicle, from GCSA to GCSB"""
    return (251, 190, 1, 251, 252, handover_id, epoch)


# ---- loading ------------------------------------------------------------------------------------------------------


def test_load_and_unload_give_everything_back(station: StationBench) -> None:
    state = station.mpstate
    before = (dict(state.completions), dict(state.command_map), dict(state.completion_functions))
    module = station.load()
    assert module.name == "handover_gcs"
    assert f"handover_gcs {VERSION}: GCSA, vehicle 1, configuration {station.config}" in state.console.lines
    assert state.settings.source_system == 251
    links = module._links()
    assert len(links) == 2
    assert len(state.select_extra) == 1
    state.unload("handover_gcs")
    assert state.settings.source_system == 255
    assert (state.completions, state.command_map, state.completion_functions) == before
    assert (state.select_extra, state.public_modules) == ({}, {})
    assert [link.fileno() for link in links] == [-1, -1]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as again:
        again.bind(("127.0.0.1", station.listens))


def test_reload_needs_no_argument(station: StationBench) -> None:
    station.load()
    station.mpstate.unload("handover_gcs")
    assert station.mpstate.load("handover_gcs", gcs_module) is not None


def test_without_a_configuration_one_line_says_where_it_looked(station: StationBench) -> None:
    station.config.unlink()
    assert station.mpstate.load("handover_gcs", gcs_module) is None
    assert station.mpstate.console.lines == [
        'handover_gcs is not loaded: no configuration: looked for module load handover_gcs:{"config":"FILE"} (no '
        "spaces in it), ./station.toml; the shell's 'handover init station' writes one"
    ]


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        ({"config": "/nowhere/x.toml"}, "/nowhere/x.toml: no such file"),
        ({"config": 5}, "argument config: 5 must be the path of a file"),
        ({"config": "~nobody-of-that-name/x"}, "~nobody-of-that-name/x: Could not determine home directory."),
        ({"x": 1}, "unknown argument x; allowed are: config, journal, serve"),
    ],
)
def test_arguments_that_make_no_sense_are_one_line(
    station: StationBench, arguments: dict[str, object], line: str
) -> None:
    assert station.mpstate.load("handover_gcs", gcs_module, **arguments) is None
    assert station.mpstate.console.lines == [f"handover_gcs is not loaded: {line}"]


def test_a_ground_port_in_use_is_one_line(station: StationBench) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", station.listens))
        assert station.load() is None
    assert station.mpstate.console.lines == [
        f"handover_gcs is not loaded: link udpin:127.0.0.1:{station.listens} cannot be opened: Address already in use"
    ]
    assert station.mpstate.command_map == {}


def test_a_mission_folder_that_is_not_there_is_one_line_and_frees_the_port(station: StationBench) -> None:
    station.configure(mission=station.folder / "nothing")
    assert station.load() is None
    (line,) = station.mpstate.console.lines
    assert line.startswith(f"handover_gcs is not loaded: {station.folder / 'nothing' / 'mission.toml'}: ")
    station.configure()
    assert station.load() is not None


def test_a_journal_that_cannot_be_written_is_one_line(station: StationBench) -> None:
    (station.folder / "GCSA.jsonl").mkdir()
    assert station.load() is None
    assert station.mpstate.console.lines == [
        f"handover_gcs is not loaded: {station.folder / 'GCSA.jsonl'}: Is a directory"
    ]


# ---- the vehicle --------------------------------------------------------------------------------------------------


def test_connect_is_answered_although_mavproxy_does_not_know_the_message(station: StationBench) -> None:
    station.load()
    station.hear(connect_message())
    (answer,) = [m for m in station.sent() if m.get_type() == "CONNECT_ACK"]
    assert (answer.nonce, answer.station, answer.commander, answer.epoch, answer.name) == (7, 251, 251, 1, "GCSA")
    assert bytes(answer.mission_digest).hex().startswith("f433d144af77fc76")
    assert station.mpstate.console.said("GCSA is the commander now, epoch 1.")


def test_another_vehicle_is_not_answered(station: StationBench) -> None:
    station.load()
    station._companion.srcSystem = 2
    station.hear(connect_message())
    assert station.sent() == []


def test_what_a_vehicle_says_about_another_one_is_not_answered(station: StationBench) -> None:
    station.load()
    connect = mavlink.MAVLink_connect_message(251, 190, 2, 251, 1, 7, 1, 251, b"drone-2", [0] * 32)
    station.hear(connect)
    assert station.sent() == []
    assert station.module.aircraft[0].core.epoch == 0
    assert station.module.faults == {"message of the vehicle: about another one": 1}


def test_a_handover_is_consented_to_once_and_answered_as_often_as_asked(station: StationBench) -> None:
    station.load()
    station.hear(connect_message())
    station.sent()
    for _ in range(3):
        station.hear(mavlink.MAVLink_on_handover_message(*key(), 0, Reason.ZONE, 0))
    assert [(m.get_type(), m.consent) for m in station.sent()] == [("OK_HANDOVER", 0)] * 3
    assert [line for line in station.mpstate.console.lines if line.endswith("Handover Authorized.")] != []


def test_the_operator_is_asked_where_the_configuration_says_so(station: StationBench) -> None:
    station.configure(consent="operator")
    station.load()
    station.hear(connect_message())
    station.sent()
    station.hear(mavlink.MAVLink_on_handover_message(*key(), 0, Reason.ZONE, 0))
    assert [m.consent for m in station.sent()] == [2]
    assert "question  handover 3: 'handover accept' or 'handover deny'" in station.mpstate.type("handover status")
    station.mpstate.type("handover accept")
    assert [(m.get_type(), m.consent) for m in station.sent()] == [("OK_HANDOVER", 0)]


@pytest.mark.parametrize(("pause_s", "answers"), [(0.3, [2]), (0.8, [2, 0])])
def test_a_key_that_is_pressed_twice_answers_one_question(
    station: StationBench, pause_s: float, answers: list[int]
) -> None:
    """The fault: the second press answered a question that had come between the two."""
    station.configure(consent="operator")
    station.load()
    station.hear(connect_message())
    station.hear(mavlink.MAVLink_on_handover_message(*key(3), 0, Reason.ZONE, 0))
    station.mpstate.type("handover accept")
    station.sent()
    station.hear(mavlink.MAVLink_on_handover_message(*key(4), 0, Reason.REQUESTED, 0))
    station.run(pause_s)
    station.mpstate.type("handover accept")
    assert [m.consent for m in station.sent() if m.get_type() == "OK_HANDOVER"] == answers


@pytest.mark.parametrize("fails", ["writeln", "set_status"])
def test_a_console_that_breaks_does_not_keep_an_answer_back(
    station: StationBench, fails: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_arguments: Any, **_values: Any) -> None:
        raise BrokenPipeError

    station.load()
    station.hear(connect_message())
    station.sent()
    with monkeypatch.context() as patch:
        patch.setattr(station.mpstate.console, fails, broken)
        station.hear(mavlink.MAVLink_on_handover_message(*key(), 0, Reason.ZONE, 0))
        station.run(2.0)
    assert "OK_HANDOVER" in [m.get_type() for m in station.sent()]
    assert [m.get_type() for m in station.peer.received()].count("HEARTBEAT") >= 2


def test_urgent_lines_are_spoken_only_where_mavproxy_can_speak(station: StationBench) -> None:
    station.load()
    station.hear(connect_message())
    assert station.mpstate.spoken == []
    station.mpstate.modules.append((MPModule(station.mpstate, "speech"), gcs_module))
    station.hear(connect_message(epoch=2, commander=252))
    station.mpstate.modules.pop()
    assert station.mpstate.spoken == ["GCSB has drone-1: GCSB commands now."]


def test_the_vehicle_falling_silent_is_told(station: StationBench) -> None:
    station.load()
    station.hear(connect_message())
    station.run(7.0)
    assert station.mpstate.console.said("drone-1 is not heard any more.")


# ---- the ground link ----------------------------------------------------------------------------------------------


def test_heartbeats_go_to_the_peer_and_strangers_are_counted(station: StationBench) -> None:
    station.load()
    station.run(3.2)
    beats = [m for m in station.peer.received() if m.get_type() == "HEARTBEAT"]
    assert 3 <= len(beats) <= 4
    assert {m.get_srcSystem() for m in beats} == {251}
    stranger = mavlink.MAVLink(None, srcSystem=99, srcComponent=1)
    beat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    station.peer.socket.sendto(beat.pack(stranger), ("127.0.0.1", station.listens))
    station.peer.socket.sendto(beat.pack(station.peer.own), ("127.0.0.1", station.listens))
    station.run(0.2)
    assert station.module.faults == {"ground frame of a stranger": 1}
    assert "ground    GCSB: up" in station.mpstate.type("handover status")


def test_drone_connected_over_the_ground_link_releases_the_vehicle(station: StationBench) -> None:
    station.load()
    station.hear(connect_message())
    station.hear(mavlink.MAVLink_on_handover_message(*key(), 0, Reason.ZONE, 0))
    station.sent()
    word = mavlink.MAVLink_drone_connected_message(*key(), 0)
    station.peer.socket.sendto(word.pack(station.peer.own), ("127.0.0.1", station.listens))
    station.run(0.1)
    assert [m.get_type() for m in station.sent()] == ["DISCONNECT_HANDOVER"]
    (entry,) = [entry for entry in station.journal("message") if entry["name"] == "DRONE_CONNECTED"]
    assert (entry["direction"], entry["via"], entry["station"]) == ("in", "ground", "GCSB")


def test_a_word_about_another_vehicle_releases_nothing(station: StationBench) -> None:
    """The other station may be for several: transfers of two vehicles may have one number."""
    station.load()
    station.hear(connect_message())
    station.hear(mavlink.MAVLink_on_handover_message(*key(), 0, Reason.ZONE, 0))
    station.sent()
    word = mavlink.MAVLink_drone_connected_message(251, 190, 2, 251, 252, 3, 1, 0)
    station.peer.socket.sendto(word.pack(station.peer.own), ("127.0.0.1", station.listens))
    station.run(0.1)
    assert station.sent() == []
    assert station.module.faults == {"ground frame of another vehicle": 1}


def test_a_package_of_another_vehicle_is_refused(station: StationBench, delivery: MissionPackage) -> None:
    station.configure(mission=None)
    station.load()
    offer = mavlink.MAVLink_mission_package_message(251, 0, 100, list(delivery.digest), b"delivery", 2)
    station.peer.socket.sendto(offer.pack(station.peer.own), ("127.0.0.1", station.listens))
    station.run(0.1)
    (answer,) = [m for m in station.peer.received() if m.get_type() == "MISSION_PACKAGE_ACK"]
    refused = mavlink.HANDOVER_PACKAGE_RESULT_REFUSED
    assert (answer.result, answer.text) == (refused, "vehicle 2 is not one of this station's")


# ---- the operator -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("typed", ["", " help"])
def test_no_word_shows_the_usage(station: StationBench, typed: str) -> None:
    station.load()
    lines = station.mpstate.type(f"handover{typed}")
    words = "status|share|rehearse|start|stop|continue|request|release|resume|return|ack|telemetry|briefing|accept"
    words += "|deny|connect|disconnect|give|override|delegate|payload|take|operator|set"
    assert lines[0] == f"usage: handover <{words}>"
    assert lines[-1] == "  set       NAME VALUE: telemetry = 10.0, request_timeout = 30.0, mavproxy_lines = 0"
    assert len(lines) == 27


@pytest.mark.parametrize("words", ["foo", "start now", "share all", "Status", "accept maybe", "\x07", "x " * 200])
def test_unknown_words_are_named_and_the_usage_shown(station: StationBench, words: str) -> None:
    station.load()
    lines = station.mpstate.type(f"handover {words}")
    assert lines[0] == f"handover: unknown command {' '.join(words.split())!r}"
    assert lines[1].startswith("usage: handover <")
    assert station.commands() == []


def test_completion_offers_words_and_settings(station: StationBench) -> None:
    station.load()
    assert station.mpstate.completions["handover"] == [
        "<status|share|rehearse|start|stop|continue|request|release|resume|return|ack|telemetry|briefing|accept|deny|"
        "connect|disconnect>",
        "give <GCSB>",
        "override <energy|fence|coverage>",
        "delegate <no>",
        "payload <request|release> <gimbal|camera|winch>",
        "rehearse <end|report>",
        "connect <no>",
        "take",
        "set (HANDOVERSETTING)",
        "operator",
    ]
    assert station.mpstate.completion_functions["(HANDOVERSETTING)"]("") == [
        "telemetry",
        "request_timeout",
        "mavproxy_lines",
    ]


@pytest.mark.parametrize(
    "words", ["set", "set telemetry", "set telemetry x", "set telemetry -1", "set nothing 1", "set telemetry 5 6"]
)
def test_settings_take_odd_values_without_harm(station: StationBench, words: str) -> None:
    station.load()
    station.mpstate.type(f"handover {words}")
    assert station.module.commands.settings.telemetry in (10.0, 5.0)
    assert station.module.faults == {}


@pytest.mark.parametrize(
    ("word", "command", "parameter"), [("start", START, 0.0), ("stop", PAUSE, 0.0), ("continue", PAUSE, 1.0)]
)
def test_a_command_is_sent_until_it_is_answered_and_the_answer_shown(
    station: StationBench, word: str, command: int, parameter: float
) -> None:
    station.load()
    station.mpstate.type(f"handover {word}")
    assert station.commands() == [(command, parameter)]
    station.run(1.6)
    assert station.commands() == [(command, parameter)], "asked again"
    station.hear(mavlink.MAVLink_command_ack_message(command, ACCEPTED, 0, 0, 251, 190), autopilot=True)
    station.run(5.0)
    assert station.commands() == []
    assert station.mpstate.console.said(f"{word.upper()} accepted.")
    assert station.journal("command")[-1]["result"] == "accepted"


def test_a_refusal_is_shown_in_words(station: StationBench) -> None:
    station.load()
    station.mpstate.type("handover start")
    station.hear(mavlink.MAVLink_command_ack_message(START, 10, 0, 0, 251, 190), autopilot=True)
    station.run(0.6)
    assert station.mpstate.console.said("START refused: not in control.")


def test_the_answer_to_a_request_of_control_is_the_companions(station: StationBench) -> None:
    station.load()
    station.mpstate.type("handover request")
    station.run(0.1)
    (control,) = station.commands()
    assert control == (mavlink.MAV_CMD_REQUEST_OPERATOR_CONTROL, 1.0)
    station.hear(mavlink.MAVLink_command_ack_message(control[0], mavlink.MAV_RESULT_DENIED, 0, 0, 251, 190))
    station.run(0.6)
    assert [entry.get("result") for entry in station.journal("command")] == [None, "denied"]


def test_start_waits_for_its_end(station: StationBench) -> None:
    station.load()
    station.mpstate.type("handover start")
    for _ in range(3):
        station.hear(mavlink.MAVLink_command_ack_message(START, IN_PROGRESS, 0, 0, 251, 190), autopilot=True)
    station.run(10.0)
    assert not station.mpstate.console.said("START refused")
    assert station.commands() == [(START, 0.0)], "not asked again while it is on its way"
    station.hear(mavlink.MAVLink_command_ack_message(START, ACCEPTED, 0, 0, 251, 190), autopilot=True)
    station.run(0.1)
    assert station.mpstate.console.said("START accepted.")


@pytest.mark.parametrize("word", ["start", "stop", "continue"])
def test_the_operator_sees_that_a_command_is_sent(station: StationBench, word: str) -> None:
    """As figures 6.2 and 6.13 of the thesis have it: `Sending stop command.`"""
    station.load()
    station.mpstate.type(f"handover {word}")
    assert [line for line in station.mpstate.console.lines if line.endswith(f"]: {word.upper()} sent.")] != []


def test_no_answer_is_an_answer(station: StationBench) -> None:
    station.load()
    station.mpstate.type("handover stop")
    station.run(6.0)
    assert station.commands() == [(PAUSE, 0.0)] * 3
    assert station.mpstate.console.said("STOP: no answer of the vehicle.")


def acknowledge(station: StationBench, command: int, result: int = ACCEPTED, target: int = 251) -> None:
    station.hear(mavlink.MAVLink_command_ack_message(command, result, 0, 0, target, 190), autopilot=True)


def test_an_answer_that_may_be_the_last_command_s_is_not_taken_for_the_new_one_s(station: StationBench) -> None:
    """The fault: CONTINUE arrived late, its answer counted as that to STOP too, and STOP was lost on its way."""
    station.load()
    station.mpstate.type("handover continue")
    station.run(0.5)
    station.mpstate.type("handover stop")
    acknowledge(station, PAUSE)
    station.run(1.6)
    assert station.commands() == [(PAUSE, 1.0), (PAUSE, 0.0), (PAUSE, 0.0)]
    assert not station.mpstate.console.said("STOP accepted.")
    acknowledge(station, PAUSE)
    station.run(0.1)
    assert station.mpstate.console.said("STOP accepted.")


@pytest.mark.parametrize(
    ("first", "second", "repeated"),
    [
        ("continue", "stop", (PAUSE, 1.0)),
        ("stop", "continue", (PAUSE, 0.0)),
        ("resume", "stop", (mavlink.MAV_CMD_DO_SET_MODE, 1.0)),
        ("start", "stop", (START, 0.0)),
        ("request", "release", (mavlink.MAV_CMD_REQUEST_OPERATOR_CONTROL, 1.0)),
    ],
)
def test_a_command_is_not_repeated_after_the_operator_s_next_word(
    station: StationBench, first: str, second: str, repeated: tuple[int, float]
) -> None:
    """The fault: a second and a half later it undid what the operator had ordered since."""
    station.load()
    station.mpstate.type(f"handover {first}")
    station.run(0.5)
    station.mpstate.type(f"handover {second}")
    station.run(8.0)
    sent = station.commands()
    assert sent.count(repeated) == 1
    assert len(sent) == 4
    ended = station.journal("command")
    assert ("replaced", f"{first.upper()} was not answered: {second.upper()} takes its place.") in [
        (entry.get("result"), entry["text"]) for entry in ended
    ]


def test_the_same_word_about_another_station_takes_the_place_of_the_one_before(station: StationBench) -> None:
    station.load()
    station.mpstate.type("handover give GCSB")
    station.run(0.5)
    station.mpstate.type("handover request")
    acknowledge(station, mavlink.MAV_CMD_REQUEST_OPERATOR_CONTROL)
    station.run(0.1)
    assert not station.mpstate.console.said("REQUEST accepted.")


def test_a_start_that_is_under_way_is_told_though_stop_was_typed(station: StationBench) -> None:
    station.load()
    station.mpstate.type("handover start")
    acknowledge(station, START, IN_PROGRESS)
    station.run(0.1)
    station.mpstate.type("handover stop")
    acknowledge(station, PAUSE)
    acknowledge(station, START)
    station.run(0.1)
    assert station.mpstate.console.said("START accepted.")
    assert station.mpstate.console.said("STOP accepted.")


def test_the_answer_to_another_station_is_none_to_this_one(station: StationBench) -> None:
    """The fault: where the vehicle's answers reach several stations, START was told accepted that was never judged."""
    station.load()
    station.mpstate.type("handover stop")
    acknowledge(station, PAUSE, target=252)
    station.run(0.1)
    assert not station.mpstate.console.said("STOP accepted.")
    acknowledge(station, PAUSE, target=0)
    station.run(0.1)
    assert station.mpstate.console.said("STOP accepted.")


def test_a_command_without_any_link_is_told_and_does_not_escape(station: StationBench) -> None:
    station.load()
    station.mpstate.mav_master.clear()
    station.mpstate.type("handover start")
    station.run(6.0)
    assert station.mpstate.console.said("START: no answer of the vehicle.")


def test_an_answer_to_no_question_says_so(station: StationBench) -> None:
    station.load()
    assert station.mpstate.type("handover accept")[-1].endswith("There is no question to answer.")


def test_status_in_every_state(station: StationBench) -> None:
    station.load()
    assert station.mpstate.type("handover status")[:3] == [
        "vehicle   not heard, ON_LOAD",
        "commander no station, epoch 0; this station is observer",
        "mission   'delivery' f433d144, the vehicle has not",
    ]
    station.hear(connect_message())
    assert station.mpstate.type("handover status")[:2] == [
        "vehicle   connected, ON_LOAD",
        "commander GCSA, epoch 1; this station is commander",
    ]


# ---- the mission package ------------------------------------------------------------------------------------------


def test_share_sends_the_package_to_the_vehicle_and_to_the_peer(
    station: StationBench, delivery: MissionPackage
) -> None:
    station.load()
    station.hear(connect_message())
    station.sent()
    assert station.mpstate.type("handover share")[-1].endswith("Sharing mission 'delivery'.")
    vehicle, other = PackageReceiver(), PackageReceiver()
    got: dict[str, bytes] = {}
    for _ in range(60):
        station.run(0.05)
        for message in station.sent():
            for answer in receive(vehicle, message, "vehicle", got):
                station.hear(answer)
        for message in station.peer.received():
            for answer in receive(other, message, "peer", got):
                station.peer.socket.sendto(answer.pack(station.peer.own), ("127.0.0.1", station.listens))
    assert got == {"vehicle": delivery.to_bytes(), "peer": delivery.to_bytes()}
    assert station.mpstate.console.said("vehicle: Mission received.")
    assert station.mpstate.console.said("GCSB: Mission received.")
    assert station.mpstate.console.said("vehicle: Mission loaded: written to the autopilot, read back, equal.")


def exchange(station: StationBench, sender: PackageSender) -> None:
    """GCSB sends a package over the ground link."""
    for _ in range(60):
        messages = sender.tick(station.clock.now)
        for message in station.peer.received():
            if message.get_type() == "MISSION_PACKAGE_ACK":
                messages += sender.on_ack(message, station.clock.now)
        for message in messages:
            station.peer.socket.sendto(message.pack(station.peer.own), ("127.0.0.1", station.listens))
        station.run(0.05)


def receive(receiver: PackageReceiver, message: Any, who: str, got: dict[str, bytes]) -> list[Any]:
    """The receiver's answers; the vehicle loads a package in no time and says so when it is next offered."""
    if message.get_type() == "MISSION_PACKAGE":
        if who == "vehicle" and who in got:
            return [
                receiver.conclude(bytes(message.mission_digest), mavlink.HANDOVER_PACKAGE_RESULT_LOADED, "", (251, 190))
            ]
        return receiver.on_offer(message, (251, 190))
    if message.get_type() != "MISSION_CHUNK":
        return []
    answers, whole = receiver.on_chunk(message, (251, 190))
    if whole is not None:
        got[who] = whole[1]
        answers.append(receiver.conclude(whole[0], mavlink.HANDOVER_PACKAGE_RESULT_RECEIVED, "", (251, 190)))
    return answers


def test_without_a_mission_there_is_nothing_to_share(station: StationBench) -> None:
    station.configure(mission=None)
    station.load()
    assert station.mpstate.type("handover share")[-1].endswith(
        "There is no mission to share: set mission in [station]."
    )
    station.run(1.0)
    assert [m for m in station.sent() if m.get_type() == "MISSION_PACKAGE"] == []


def test_a_package_under_a_false_digest_is_refused(station: StationBench, delivery: MissionPackage) -> None:
    station.configure(mission=None)
    station.load()
    sender = PackageSender(delivery.to_bytes(), bytes(range(32)), delivery.name, (251, 0))
    exchange(station, sender)
    assert sender.result == mavlink.HANDOVER_PACKAGE_RESULT_REFUSED
    assert station.mpstate.console.said("GCSB: Mission refused: the contents do not have the digest that was promised")
    assert station.mpstate.type("handover share")[-1].endswith("set mission in [station].")


def offered(station: StationBench, package: MissionPackage) -> PackageSender:
    """GCSB has sent this package over the ground link."""
    sender = PackageSender(package.to_bytes(), package.digest, package.name, (251, 0))
    exchange(station, sender)
    return sender


def shown(station: StationBench, announced: bytes = bytes(32)) -> bytes:
    """The digest that the station answers with when the vehicle announces its own."""
    station.sent()
    station.hear(connect_message(digest=announced))
    station.hear(connect_message(digest=announced))
    return bytes([m for m in station.sent() if m.get_type() == "CONNECT_ACK"][-1].mission_digest)


def test_a_package_of_another_station_counts_once_the_vehicle_announces_it(
    station: StationBench, delivery: MissionPackage
) -> None:
    station.configure(mission=None)
    station.load()
    assert offered(station, delivery).result == mavlink.HANDOVER_PACKAGE_RESULT_RECEIVED
    assert station.mpstate.console.said(
        "GCSB: Mission 'delivery' (f433d144) offered. It is used when the vehicle flies it; "
        "'handover take delivery' uses it now."
    )
    assert shown(station) == bytes(32)
    assert station.mpstate.type("handover share")[-1].endswith("set mission in [station].")
    assert shown(station, delivery.digest) == delivery.digest
    assert station.mpstate.console.said("vehicle: Mission 'delivery', f433d144, is the vehicle's: taken.")


def test_whoever_sends_a_package_the_one_of_the_own_folder_stays(
    station: StationBench, delivery: MissionPackage
) -> None:
    """Eight datagrams made the parent write a stranger's route to the autopilot."""
    station.load()
    stranger = mission_package.load(MISSIONS / "linear")
    sender = offered(station, stranger)
    assert (sender.result, sender.text) == (
        mavlink.HANDOVER_PACKAGE_RESULT_REFUSED,
        "this station has a mission of its own",
    )
    station.hear(heartbeat(armed=False), autopilot=True)
    assert shown(station, stranger.digest) == delivery.digest
    assert station.mpstate.type("handover take linear")[-1].endswith(
        "No mission 'linear' is offered; offered are: none."
    )
    assert station.mpstate.type("handover share")[-1].endswith("Sharing mission 'delivery'.")


def test_a_deviation_from_the_mission_that_the_vehicle_has_is_the_operator_s_warning(
    station: StationBench, delivery: MissionPackage
) -> None:
    """Known by the vehicle's telemetry, and of another mission than its own a station says nothing."""
    station.load()

    def fly(times: int) -> list[str]:
        for place, waypoint in [((52.679, 5.924), 1), *[((52.6786, 5.9252), 2)] * times]:
            lat, lon = (round(value * 1e7) for value in place)
            values = (0, 0, 12600, 90, lat, lon, 0, 30000, 0, 0, 0, 0, 0, 0, 0, 0, waypoint, 0, 251, 1, 3)
            station.hear(mavlink.MAVLink_handover_telemetry_message(251, 190, *values))
            station.run(1.0)
        return [entry["text"] for entry in station.journal("off_route")]

    station.hear(connect_message(digest=bytes(32)))
    assert fly(10) == []
    station.hear(connect_message(digest=delivery.digest))
    station.hear(mavlink.MAVLink_handover_telemetry_message(251, 190, *[0] * 20, 3))
    assert fly(10) == ["Off route: 39 m left of the leg to waypoint 2, as this station sees it."]
    assert any("OFF ROUTE" in line for line in station.mpstate.type("handover status"))


def test_in_flight_nothing_replaces_what_is_held(station: StationBench, delivery: MissionPackage) -> None:
    """A partner whose package was swapped could not be partner any more."""
    station.configure(mission=None)
    station.load()
    offered(station, delivery)
    assert shown(station, delivery.digest) == delivery.digest
    other = mission_package.load(MISSIONS / "linear")
    offered(station, other)
    station.hear(heartbeat(armed=True), autopilot=True)
    assert shown(station, other.digest) == delivery.digest
    line = station.mpstate.type("handover take linear")[-1]
    assert line.endswith("Not while the vehicle is armed, or not known to be disarmed.")
    station.hear(heartbeat(armed=False), autopilot=True)
    assert shown(station, other.digest) == other.digest


def test_the_operator_may_take_an_offer_by_name(station: StationBench, delivery: MissionPackage) -> None:
    station.configure(mission=None)
    station.load()
    offered(station, delivery)
    assert "offered   'delivery' f433d144: 'handover take delivery'" in station.mpstate.type("handover status")
    assert station.mpstate.type("handover take delivery")[-1].endswith("Mission 'delivery', f433d144, taken.")
    assert shown(station) == delivery.digest
    assert station.mpstate.type("handover share")[-1].endswith("Sharing mission 'delivery'.")


@pytest.mark.parametrize("announced", [True, False])
def test_of_the_vehicle_a_station_takes_the_package_that_it_announces_and_no_other(
    station: StationBench, delivery: MissionPackage, announced: bool
) -> None:
    station.configure(mission=None)
    station.load()
    station.hear(connect_message(digest=delivery.digest if announced else bytes(32)))
    sender = PackageSender(delivery.to_bytes(), delivery.digest, delivery.name, (251, 0))
    messages = sender.tick(0.0)
    for _ in range(20):
        for message in messages:
            station.hear(message)
        station.run(0.2)
        acks = [m for m in station.sent() if m.get_type() == "MISSION_PACKAGE_ACK"]
        messages = [message for ack in acks for message in sender.on_ack(ack, 0.0)]
    held = station.module.aircraft[0].mission_transfer.held
    assert held == (delivery if announced else None)


# ---- faults -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("part", ["_read_ground", "_send_package", "_beat"])
def test_what_breaks_is_counted_and_stops_nothing_else(
    station: StationBench, part: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_arguments: Any) -> None:
        raise RuntimeError("a bug")

    station.load()
    with monkeypatch.context() as patch:
        owner = station.module.aircraft[0] if part == "_send_package" else station.module
        patch.setattr(owner, part, broken)
        station.mpstate.type("handover stop")
        station.run(6.0)
        station.hear(connect_message())
    assert station.mpstate.console.said("STOP: no answer of the vehicle.")
    assert "CONNECT_ACK" in [m.get_type() for m in station.sent()]
    assert station.module.faults
    assert station.journal("fault")[0]["text"].count("RuntimeError: a bug") == 1
    assert any(line.startswith("faults    ") for line in station.mpstate.type("handover status"))


def test_a_fault_in_a_command_is_told_to_the_operator(station: StationBench, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_arguments: Any) -> None:
        raise RuntimeError("a bug")

    station.load()
    with monkeypatch.context() as patch:
        patch.setattr(station.module.aircraft[0].core, "vehicle_alive", broken)
        lines = station.mpstate.type("handover status")
    assert lines[-1] == "handover: internal fault, see the journal"


def test_rounds_of_the_main_loop_after_unload_do_no_harm(station: StationBench) -> None:
    module = station.load()
    station.mpstate.unload("handover_gcs")
    module.idle_task()
    module.mavlink_packet(None)
    station.clock.now += 5
    module.idle_task()


def test_what_the_gate_says_of_this_stations_sticks_is_told_in_full(station: StationBench) -> None:
    assert station.load() is not None
    for text in ("stop it for 3 s first", "not a word of the gate's"):
        station.hear(mavlink.MAVLink_statustext_message(4, f"Handover: RC override: {text}".encode()), autopilot=True)
    station.hear(mavlink.MAVLink_statustext_message(4, b"Handover: SET_MODE: not in control"), autopilot=True)
    full = (
        "RC override has been running since before this station had control: still refused, until it is released "
        "(rc all 0) or has paused for 3 s."
    )
    assert sum(full in line for line in station.mpstate.console.lines) == 1
    assert [entry["text"] for entry in station.journal("stream")] == [full]


# ---- what the vehicle decides -------------------------------------------------------------------------------------


def decision(number: int, action: int, text: str, place: str = "home", figures: str = "") -> Any:
    return mavlink.MAVLink_handover_decision_message(number, action, 5, place.encode(), figures.encode(), text.encode())


def authority(phase: int = 1, commander: int = 251, epoch: int = 1, zone: int = 251, zone_ends: int = 0) -> Any:
    return mavlink.MAVLink_authority_status_message(phase, commander, 0, zone, epoch, 0, 0, 0, 0, 0, 0, zone_ends)


def statustext(text: str, severity: int = 4, text_id: int = 0, number: int = 0) -> Any:
    return mavlink.MAVLink_statustext_message(severity, text.encode(), text_id, number)


RETURNS = "RETURN to home. GCSA silent for 5 s; 0.4 km"
TOLD = f"{RETURNS}. No station commands. When it is in your zone, type 'handover request' to take over."


def test_a_decision_is_told_once_with_what_may_be_done_and_shown_while_it_lasts(station: StationBench) -> None:
    station.load()
    for _ in range(3):
        station.hear(decision(1, 4, RETURNS, figures="GCSA silent for 5 s"))
        station.hear(statustext(RETURNS, 2))
        station.run(0.6)
    assert sum(f"EMERGENCY: {TOLD}" in line for line in station.mpstate.console.lines) == 1
    assert sum(RETURNS in line for line in station.mpstate.console.lines) == 1, "it is told already"
    (entry,) = station.journal("decision")
    assert entry["text"] == TOLD
    shown = station.mpstate.type("handover status")
    assert f"decision  {RETURNS}" in shown
    assert f"alarm     EMERGENCY: {TOLD}" in shown
    for _ in range(3):
        station.hear(decision(2, 255, "ALL CLEAR. Over: commander lost"))
    assert sum("ALL CLEAR" in line for line in station.mpstate.console.lines) == 1
    assert station.module.aircraft[0].decisions.text == ""
    assert not any(line.startswith("alarm") for line in station.mpstate.type("handover status"))


def test_a_decision_longer_than_its_message_is_one_line_with_all_of_it(station: StationBench) -> None:
    station.load()
    text = (
        "RETURN to rally 2. Energy: 99.4 Wh left, the way back needs 101.2 Wh with the reserve; 1.9 km, "
        "needs 21 % of the battery (38 % left), OUT OF REACH, the way is too near to the ground, "
        "covered by GCSA all the way"
    )
    for _ in range(2):  # by each of two links
        for piece in status_texts(text, mavlink.MAV_SEVERITY_CRITICAL, 9):
            station.hear(piece)
        station.hear(
            decision(1, 4, text[:160], "rally 2", "energy: 99.4 Wh left, the way back needs 101.2 Wh with the r")
        )
        station.run(1.0)
    (line,) = (line for line in station.mpstate.console.lines if "RETURN" in line)
    assert line.endswith(
        f"EMERGENCY: {text}. No station commands. When it is in your zone, type 'handover request' to take over."
    )
    assert f"decision  {text}" in station.mpstate.type("handover status")


def test_after_a_restart_of_the_companion_a_number_that_was_there_is_another_word(station: StationBench) -> None:
    station.load()
    station.hear(decision(1, 0, "WARNING. Guard silent for 5 s", figures="guard silent for 5 s"))
    station.hear(decision(1, 4, "RETURN: GCSA silent for 5 s", figures="GCSA silent for 5 s", place=""))
    assert [entry["text"].partition(". No station")[0].rstrip(".") for entry in station.journal("decision")] == [
        "WARNING. Guard silent for 5 s",
        "RETURN: GCSA silent for 5 s",
    ]


@pytest.mark.parametrize(
    ("commander", "words"),
    [
        (251, " You command. When the cause is over, 'handover resume' continues the mission."),
        (252, " Another station commands: this one may not act."),
    ],
)
def test_what_an_operator_may_do_depends_on_who_commands(station: StationBench, commander: int, words: str) -> None:
    station.load()
    station.hear(authority(commander=commander))
    station.hear(decision(1, 4, RETURNS, figures="GCSA silent for 5 s"))
    assert station.mpstate.console.lines[-1].endswith(f"EMERGENCY: {RETURNS}.{words}")


def test_a_decision_of_a_kind_that_is_not_known_here_is_an_emergency_in_its_own_words(station: StationBench) -> None:
    station.load()
    station.hear(decision(1, 77, "DITCH: everything is wrong"))
    assert station.mpstate.console.lines[-1].endswith("EMERGENCY: DITCH: everything is wrong")


def test_an_alarm_is_said_again_until_it_is_acknowledged(
    station: StationBench, capsys: pytest.CaptureFixture[str]
) -> None:
    station.load()
    station.hear(authority())
    station.hear(decision(1, 4, RETURNS, figures="GCSA silent for 5 s"))
    assert capsys.readouterr().out == "\a"
    for _ in range(25):
        station.hear(authority())
        station.run(1.0)
    assert sum("GCSA silent for 5 s" in line for line in station.mpstate.console.lines) == 3, "after 10 and 20 s again"
    assert capsys.readouterr().out == "\a\a"
    assert f"acknowledged: {RETURNS}." in station.mpstate.type("handover ack")[0]
    for _ in range(25):
        station.hear(authority())
        station.run(1.0)
    assert sum(f"]: EMERGENCY: {RETURNS}" in line for line in station.mpstate.console.lines) == 3
    assert any("(acknowledged)" in line for line in station.mpstate.type("handover status"))
    assert station.mpstate.type("handover ack") == ["no alarm to acknowledge"]
    assert [entry["level"] for entry in station.journal("acknowledged")] == ["emergency"]


def test_who_commands_stands_in_the_status_row_and_how_grave_it_is(station: StationBench) -> None:
    station.load()
    console = station.mpstate.console
    station.run(1.1)
    assert console.looks["HANDOVER"] == ("vehicle 1: NOT HEARD YET", "black", "white")
    station.hear(authority())
    station.hear(connect_message())
    station.run(1.1)
    assert console.looks["HANDOVER"] == ("CONTROL: GCSA (you)", "black", "white")
    station.run(4.0)
    assert console.looks["HANDOVER"] == ("drone-1: NOT HEARD FOR 4 s", "black", "orange")
    station.hear(mavlink.MAVLink_heartbeat_message(2, 3, 128 + 1, 6, 4, 3), autopilot=True)
    station.hear(authority(phase=3, commander=0))
    station.hear(connect_message(epoch=1, commander=0))
    station.run(1.1)
    assert console.looks["HANDOVER"] == ("NO COMMANDER - RTL", "white", "red")


def test_the_brackets_say_the_mode_where_the_mission_is_not_flown_and_how_old_that_is(station: StationBench) -> None:
    station.load()
    station.hear(authority())
    station.hear(connect_message())
    station.hear(mavlink.MAVLink_heartbeat_message(2, 3, 128 + 1, 6, 4, 3), autopilot=True)
    station.hear(statustext("Something."))
    station.run(0.6)
    assert station.mpstate.console.lines[-1].endswith("|GCSA][ONMISSION RTL]: WARNING: Something.")
    station.run(6.0)
    assert station.mpstate.console.lines[-1].endswith(
        "|GCSA][ONMISSION 5 s old]: WARNING: drone-1 is not heard any more."
    )


def test_texts_of_the_companion_are_shown_whole_and_by_their_severity(station: StationBench) -> None:
    station.load()
    station.hear(statustext("x" * 49 + " ", 5, 7, 0))
    station.hear(statustext("and the end", 5, 7, 1))
    station.hear(statustext("by the way", 6))
    station.run(0.6)
    assert station.mpstate.console.lines[-2].endswith("]: " + "x" * 49 + " and the end")
    assert station.mpstate.console.lines[-1].endswith("]: by the way")
    assert [entry["text"] for entry in station.journal("text")] == ["x" * 49 + " and the end", "by the way"]


def test_who_commands_is_told_from_our_own_message(station: StationBench) -> None:
    station.load()
    station.hear(connect_message())
    station.hear(connect_message(epoch=2, commander=252))
    station.hear(statustext("GCSB commands now (handover 3)", 5))
    station.run(0.6)
    assert sum("commands now" in line for line in station.mpstate.console.lines) == 1


def test_the_reason_of_a_refusal_is_told_with_it(station: StationBench) -> None:
    station.load()
    station.mpstate.type("handover start")
    station.hear(mavlink.MAVLink_command_ack_message(START, 1, 0, 0, 251, 190), autopilot=True)
    station.hear(statustext("START refused: no mission loaded; outside the ".ljust(50), 4, 3, 0))
    station.hear(statustext("zone of GCSA", 4, 3, 1))
    station.run(1.0)
    said = [line for line in station.mpstate.console.lines if "refused" in line]
    assert len(said) == 1
    assert said[0].endswith("]: START refused: no mission loaded; outside the zone of GCSA.")


def test_after_a_return_continue_says_what_brings_the_mission_back(station: StationBench) -> None:
    station.load()
    station.hear(mavlink.MAVLink_heartbeat_message(2, 3, 128 + 1, 6, 4, 3), autopilot=True)
    station.mpstate.type("handover continue")
    station.hear(mavlink.MAVLink_command_ack_message(PAUSE, 4, 0, 0, 251, 190), autopilot=True)
    station.run(0.6)
    words = "CONTINUE refused: failed. The aircraft is in RTL: 'handover resume' brings it back to its mission."
    assert station.mpstate.console.lines[-1].endswith(words)


def test_resume_asks_for_auto_unless_something_is_wrong(station: StationBench) -> None:
    station.load()
    station.mpstate.type("handover resume")
    station.run(0.1)
    (sent,) = [m for m in station.sent() if m.get_type() == "COMMAND_LONG"]
    assert (sent.command, sent.param1, sent.param2) == (mavlink.MAV_CMD_DO_SET_MODE, 1.0, 3.0)
    station.run(8.0)
    station.sent()
    station.hear(decision(1, 4, RETURNS, figures="GCSA silent for 5 s"))
    station.mpstate.type("handover resume")
    station.run(0.1)
    assert station.commands() == []
    assert station.mpstate.console.said(f"RESUME not sent: {RETURNS}")


def test_why_resume_is_refused_is_told_in_one_line(station: StationBench) -> None:
    """The companion calls it by the mode that it asks for."""
    station.load()
    station.mpstate.type("handover resume")
    station.hear(mavlink.MAVLink_command_ack_message(mavlink.MAV_CMD_DO_SET_MODE, 1, 0, 0, 251, 190), autopilot=True)
    station.hear(statustext("AUTO refused: leaves coverage in 57 m (item 3)", 4))
    station.run(1.0)
    said = [line.partition("]: ")[2] for line in station.mpstate.console.lines if "]: RESUME" in line]
    assert said == ["RESUME sent.", "RESUME refused: leaves coverage in 57 m (item 3)."]


def test_the_end_of_the_zone_and_that_it_was_left_are_told_once(station: StationBench) -> None:
    station.load()
    for zone, ends in ((251, 0), (251, 20), (251, 16), (251, 15), (251, 3), (252, 0), (252, 0), (0, 0)):
        station.hear(authority(zone=zone, zone_ends=ends))
    said = [line.partition("]: ")[2] for line in station.mpstate.console.lines if "]: " in line and "zone" in line]
    assert said == [
        "The zone of GCSA ends in 15 s.",
        "vehicle 1 has left the zone of GCSA: it is in the zone of GCSB.",
    ]


def test_all_of_the_telemetry_with_its_units_and_its_age(station: StationBench) -> None:
    station.load()
    assert station.mpstate.type("handover telemetry") == [
        "telemetry none yet: the vehicle sends it to who commands, and to a partner"
    ]
    station.hear(
        mavlink.MAVLink_handover_telemetry_message(
            251, 190, 1_700_000_000_000_000, 61500, 15800, 81, 526790000, 59240000, 41000, 40000, 0.01, -0.02, 0.003,
            3.0, 4.0, -0.5, 9000, 5.0, 4, 123.0, 251, 1, 3,
        )
    )  # fmt: skip
    shown = station.mpstate.type("handover telemetry")
    assert shown == [
        "time      2023-11-14 22:13:20 UTC, 61.5 s after the autopilot's start",
        "battery   15.80 V",
        "          81 % left",
        "position  52.6790000 5.9240000 deg",
        "altitude  41.0 m above the sea, 40.0 m above home",
        "rates     roll 0.010, pitch -0.020, yaw 0.003 rad/s",
        "velocity  north 3.0, east 4.0, down -0.5 m/s",
        "heading   90 deg",
        "speed     5.0 m/s over ground",
        "waypoint  4, 123 m away",
        "zone      GCSA",
        "mode      3, armed",
    ]
    assert station.mpstate.console.said("battery 81%, 123 m to waypoint 4, zone GCSA")
    station.run(12.0)
    assert station.mpstate.type("handover telemetry")[0] == "telemetry (12 s old)"
    assert any(
        line.startswith("telemetry ") and line.endswith("(12 s old)")
        for line in station.mpstate.type("handover status")
    )


def test_the_handover_zone_has_its_name_and_that_of_both_stations(station: StationBench) -> None:
    station.load()
    values = dict.fromkeys(mavlink.MAVLink_handover_telemetry_message.fieldnames, 0)
    values |= {"target_system": 251, "target_component": 190, "zone": 251, "other_zone": 252}
    station.hear(mavlink.MAVLink_handover_telemetry_message(**values))
    assert "zone      Handover Zone (GCSA and GCSB)" in station.mpstate.type("handover telemetry")
    assert any(
        line.startswith("telemetry ") and "zone Handover Zone (GCSA and GCSB)" in line
        for line in station.mpstate.type("handover status")
    )


def test_a_text_that_mavproxy_has_shown_is_heard_and_not_shown_again(
    station: StationBench, capsys: pytest.CaptureFixture[str]
) -> None:
    station.load()
    station.mpstate.status.last_apm_msg = "Something is wrong."
    station.hear(statustext("Something is wrong."))
    station.run(0.6)
    assert not station.mpstate.console.said("Something is wrong.")
    assert capsys.readouterr().out == "\a"
    assert [entry["text"] for entry in station.journal("text")] == ["Something is wrong."]


@pytest.mark.parametrize("line", ["give", "give GCSB now", "override", "take"])
def test_a_word_that_takes_a_name_says_so_without_one(station: StationBench, line: str) -> None:
    station.load()
    (shown,) = station.mpstate.type(f"handover {line}")
    assert shown.startswith(f"usage: handover {line.split(maxsplit=1)[0]} ")


# ---- consent with foresight ---------------------------------------------------------------------------------------


def ahead(in_s: int = 20, commander: int = 252, partner: int = 251, crossing: int = 1) -> Any:
    return mavlink.MAVLink_handover_ahead_message(251, 190, 1, commander, partner, crossing, 1, in_s, 0, 0)


def briefing(number: int, line: int, text: str, target: int = 251) -> Any:
    return mavlink.MAVLink_handover_briefing_message(target, 190, number, line, 6, text.encode())


LINES = ("to waypoint 3", "84% left", "not known", "GCSB 12 ms; GCSA 9 ms", "none", "GCSB -> GCSA in 20 s")


@pytest.fixture
def asked(station: StationBench) -> StationBench:
    """GCSB commands; GCSA's operator is told of the border ahead."""
    station.configure(consent="operator")
    station.load()
    station.hear(connect_message(commander=252))
    station.hear(authority(commander=252, zone=252))
    station.sent()
    station.hear(ahead())
    return station


def test_who_is_asked_beforehand_hears_of_it_answers_and_sees_it_in_the_status_row(asked: StationBench) -> None:
    (word,) = asked.sent()
    assert (word.get_type(), word.crossing, word.consent) == ("OK_AHEAD", 1, 2)
    assert asked.mpstate.console.said("Handover GCSB -> GCSA of drone-1 in 20 s.")
    asked.run(1.5)
    assert asked.mpstate.console.statuses["HANDOVER"] == "CONTROL: GCSB - GCSA IN 19 s: ACCEPT?"
    assert "ahead     GCSB -> GCSA in " in "\n".join(asked.mpstate.type("handover status"))
    asked.mpstate.type("handover accept")
    (word,) = [m for m in asked.sent() if m.get_type() == "OK_AHEAD"]
    assert word.consent == 0
    asked.run(1.0)
    assert asked.mpstate.console.statuses["HANDOVER"] == "CONTROL: GCSB - GCSA IN 18 s"
    asked.mpstate.type("handover deny")
    (word,) = [m for m in asked.sent() if m.get_type() == "OK_AHEAD"]
    assert word.consent == 1


def test_with_the_question_the_briefing_is_shown_once(asked: StationBench) -> None:
    for number in (1, 2):
        for line, text in enumerate(LINES, 1):
            asked.hear(briefing(number, line, text))
        asked.run(1.0)
    lines = asked.mpstate.console.lines
    assert lines.count("drone-1 as it is:") == 1
    assert "  battery   84% left" in lines
    assert asked.mpstate.type("handover briefing") == [f"{name:9} {t}" for name, t in zip(NAMES, LINES, strict=True)]
    (entry,) = asked.journal("briefing")
    assert "next      GCSB -> GCSA in 20 s" in entry["text"]


def test_a_briefing_for_another_station_is_not_this_ones(asked: StationBench) -> None:
    for line, text in enumerate(LINES, 1):
        asked.hear(briefing(1, line, text, target=252))
    assert "none yet" in asked.mpstate.type("handover briefing")[0]


def test_who_does_not_command_sees_height_speed_and_battery_and_their_age(station: StationBench) -> None:
    """MAVProxy's own rows get few messages there, or none at all."""
    station.load()
    station.hear(connect_message(commander=252))
    position = mavlink.MAVLink_global_position_int_message(0, 526800000, 59200000, 41000, 40000, 300, -400, 0, 9000)
    station.hear(position, autopilot=True)
    station.run(1.0)
    looks = station.mpstate.console.looks
    assert looks["HANDOVER VALUES"] == ("40 m, 5.0 m/s", "black", "white")
    power = mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 15800, 0, 94, 0, 0, 0, 0, 0, 0)
    station.hear(power, autopilot=True)
    station.run(5.0)
    assert looks["HANDOVER VALUES"] == ("40 m, 5.0 m/s, battery 94% (5 s old)", "grey", "white")
    station.hear(connect_message(epoch=2, commander=251))
    station.run(1.0)
    assert looks["HANDOVER VALUES"][0] == "", "MAVProxy's own rows say more"


def test_mavproxys_old_values_are_marked_and_given_back_when_the_module_goes(station: StationBench) -> None:
    station.load()
    station.hear(connect_message(commander=252))
    station.run(1.0)
    console = station.mpstate.console
    console.set_status("Alt", "Alt 40m", row=2)
    for _ in range(5):
        station.hear(connect_message(commander=252))
        station.run(1.0)
    assert console.looks["Alt"] == ("[Alt 40m]", "grey", "white")
    assert console.statuses["HANDOVER OLD"].endswith(" s. GCSB commands and gets them all.")
    assert station.mpstate.unload("handover_gcs")
    assert console.looks["Alt"] == ("Alt 40m", "black", "white")
    assert "set_status" not in vars(console)
