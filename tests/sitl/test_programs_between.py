# SPDX-License-Identifier: GPL-3.0-or-later

"""The programs that scenarios put beside and between the real ones, as processes: the station of the standard, the
rogue, the proxy's orders. The other end is a socket of the test."""

from __future__ import annotations

import json
import socket
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.mission import package as packages
from mavproxy_handover.wire.package_transfer import PackageReceiver
from sitl.run.processes import Child, Processes
from sitl.run.proxy import give_orders
from sitl.run.rogue import repertoire
from sitl.script.places import mission_folder
from sitl.script.steps import StepFailed
from sitl.vehicles.ports import LOOPBACK, PortPicker

pytestmark = pytest.mark.process

COMPANION = mavlink.MAV_COMP_ID_ONBOARD_COMPUTER
CONTROL = mavlink.MAV_CMD_REQUEST_OPERATOR_CONTROL


class Companion:
    """The vehicle's end of a link."""

    def __init__(self, port: int, key: bytes | None = None) -> None:
        self.socket = udp()
        self.socket.connect((LOOPBACK, port))
        self.mav: Any = mavlink.MAVLink(None, srcSystem=1, srcComponent=COMPANION)
        self.mav.robust_parsing = True
        if key is not None:
            self.mav.signing.secret_key = key
            self.mav.signing.sign_outgoing = True
            self.mav.signing.timestamp = int((time.time() - 1420070400) * 1e5)

    def say(self, message: Any) -> None:
        self.socket.send(message.pack(self.mav))

    def hear(self, kind: str, where: Callable[[Any], bool] = lambda message: True) -> Any:
        """The next message of a kind."""
        for _ in range(200):
            for message in self.mav.parse_buffer(self.socket.recv(65536)) or ():
                if message.get_type() == kind and where(message):
                    return message
        raise AssertionError(f"no {kind}")


#: sockets of the test under way
_OPEN: list[socket.socket] = []


def udp() -> socket.socket:
    """A socket that is closed with the test."""
    _OPEN.append(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
    _OPEN[-1].settimeout(5.0)
    return _OPEN[-1]


@pytest.fixture
def processes() -> Iterator[Processes]:
    with Processes() as running:
        yield running
    while _OPEN:
        _OPEN.pop().close()


def lines_of(journal: Path, event: str) -> list[dict[str, Any]]:
    """Wait for an event in a journal; every entry of it."""
    until = time.monotonic() + 60
    while time.monotonic() < until:
        entries = [json.loads(line) for line in journal.read_text().splitlines()] if journal.exists() else []
        found = [entry for entry in entries if entry["event"] == event]
        if found:
            return found
        time.sleep(0.02)
    raise AssertionError(f"no {event} in {journal}")


def begin_standard(processes: Processes, folder: Path, *more: str) -> tuple[Child, int]:
    port = PortPicker().udp()
    argv = [sys.executable, "-m", "sitl.run.standard_gcs", "--name", "GCSA", "--sysid", "251", "--listen", str(port)]
    child = processes.start("GCSA", [*argv, "--journal", str(folder / "GCSA.jsonl"), *more], folder)
    lines_of(folder / "GCSA.jsonl", "loaded")
    return child, port


def status(owner: int, flags: int = mavlink.GCS_CONTROL_STATUS_FLAGS_SYSTEM_MANAGER) -> Any:
    return mavlink.MAVLink_control_status_message(flags, owner, [0] * 10)


def test_a_station_of_the_standard_commands_and_answers_the_question(processes: Processes, tmp_path: Path) -> None:
    child, port = begin_standard(processes, tmp_path)
    companion = Companion(port)
    companion.say(status(0, flags=0))  # not the system manager's
    companion.say(status(251))
    assert companion.hear("HEARTBEAT").get_srcSystem() == 251
    (control,) = lines_of(tmp_path / "GCSA.jsonl", "control")
    assert (control["owner"], control["own"]) == (251, True)
    child.type("pause")
    pause = companion.hear("COMMAND_LONG")
    assert (pause.command, pause.target_component, pause.param1) == (mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 1, 0)
    again = companion.hear("COMMAND_LONG")
    assert again.command == pause.command, "repeated until acknowledged"
    companion.say(mavlink.MAVLink_command_ack_message(pause.command, mavlink.MAV_RESULT_NOT_IN_CONTROL, 0, 0, 251, 190))
    assert lines_of(tmp_path / "GCSA.jsonl", "command")[0]["result"] == "not_in_control"
    companion.say(mavlink.MAVLink_command_long_message(251, 190, CONTROL, 0, 1, 0, 30, 252, 0, 0, 0))
    assert companion.hear("COMMAND_ACK").result == mavlink.MAV_RESULT_ACCEPTED
    assert lines_of(tmp_path / "GCSA.jsonl", "notified")[0]["asker"] == 252
    child.type("allow")
    allow = companion.hear("COMMAND_LONG", lambda message: message.command == CONTROL)
    assert (allow.param1, allow.param2, allow.param4, allow.target_component) == (1, 1, 251, COMPANION)


def test_a_station_of_the_standard_counts_what_is_not_acknowledged(processes: Processes, tmp_path: Path) -> None:
    child, port = begin_standard(processes, tmp_path)
    companion = Companion(port)
    companion.say(status(251))
    companion.hear("HEARTBEAT")
    child.type("measure 3 0.05")
    for number in range(3):
        asked = companion.hear("COMMAND_LONG")
        if number < 2:
            companion.say(mavlink.MAVLink_command_ack_message(asked.command, 0, 0, 0, 251, 190))
    (measured,) = lines_of(tmp_path / "GCSA.jsonl", "measured")
    assert (measured["count"], measured["lost"]) == (2, 1)
    assert 0 < measured["median_ms"] <= measured["p99_ms"] <= measured["max_ms"]


def test_a_station_with_a_key_signs_and_believes_no_unsigned_word(processes: Processes, tmp_path: Path) -> None:
    key = bytes(range(32))
    (tmp_path / "GCSA.key").write_text(key.hex(), encoding="ascii")
    _, port = begin_standard(processes, tmp_path, "--key", str(tmp_path / "GCSA.key"))
    Companion(port).say(status(99))
    companion = Companion(port, key)
    companion.say(status(251))
    assert companion.hear("HEARTBEAT").get_signed()
    assert [entry["owner"] for entry in lines_of(tmp_path / "GCSA.jsonl", "control")] == [251]


def begin_rogue(processes: Processes, folder: Path, more: str = "") -> tuple[Child, Companion, socket.socket]:
    """The rogue between a companion and a station; `more`: tables of its configuration."""
    ports = PortPicker()
    listen, target = ports.udp(), ports.udp()
    station = udp()
    station.bind((LOOPBACK, target))
    config = folder / "rogue.toml"
    journal = folder / "rogue.jsonl"
    link = f'[[link]]\nname = "GCSB"\nlisten = {listen}\ntarget = {target}\n'
    config.write_text(f'journal = "{journal}"\nvehicle = 1\n{link}{more}', encoding="utf-8")
    child = processes.start("rogue", [sys.executable, "-m", "sitl.run.rogue", "--config", str(config)], folder)
    lines_of(journal, "loaded")
    return child, Companion(listen), station


def test_the_rogue_passes_on_and_plays_again_what_it_kept(processes: Processes, tmp_path: Path) -> None:
    child, companion, station = begin_rogue(processes, tmp_path)
    companion.socket.send(b"down")
    data, rogue = station.recvfrom(100)
    assert data == b"down"
    child.type("record GCSB")
    lines_of(tmp_path / "rogue.jsonl", "recording")
    for word in (b"one", b"two"):
        station.sendto(word, rogue)
        assert companion.socket.recv(100) == word
    child.type("replay GCSB")
    assert [companion.socket.recv(100), companion.socket.recv(100)] == [b"one", b"two"]
    assert lines_of(tmp_path / "rogue.jsonl", "replay_ended")[0]["datagrams"] == 2


def test_the_rogue_sends_every_kind_of_message_once_under_the_name_it_is_told(
    processes: Processes, tmp_path: Path
) -> None:
    child, companion, station = begin_rogue(processes, tmp_path)
    companion.socket.send(b"down")
    station.recv(100)
    child.type("attack GCSB 77")
    kinds = [message.get_msgId() for message in repertoire(1)]
    assert len(set(kinds)) == len(kinds) == 15
    heard: list[Any] = []
    while len(heard) < len(kinds):
        heard += companion.mav.parse_buffer(companion.socket.recv(1000)) or []
    assert [message.get_msgId() for message in heard] == kinds
    assert {message.get_srcSystem() for message in heard} == {77}


def test_the_rogue_forges_a_neighbours_words_and_a_whole_package(processes: Processes, tmp_path: Path) -> None:
    package = packages.load(mission_folder("linear"))
    (tmp_path / "stranger.bin").write_bytes(package.to_bytes())
    station = udp()
    station.bind((LOOPBACK, 0))
    more = (
        f'[[ground]]\nname = "GCSB"\nsysid = 252\ntarget = {station.getsockname()[1]}\n'
        f'[package]\nfile = "{tmp_path / "stranger.bin"}"\ndigest = "{package.digest.hex()}"\nname = "linear"\n'
    )
    child, _companion, _station = begin_rogue(processes, tmp_path, more)
    child.type("forge GCSB 251")
    ended = lines_of(tmp_path / "rogue.jsonl", "forge_ended")[0]["datagrams"]
    parser: Any = mavlink.MAVLink(None)
    heard = [m for _ in range(ended) for m in parser.parse_buffer(station.recv(1000)) or []]
    assert {(m.get_srcSystem(), getattr(m, "target_system", 252)) for m in heard} == {(251, 252)}
    words = [(m.get_type(), m.from_station, m.to_station) for m in heard if hasattr(m, "handover_id")]
    assert set(words) == {("ON_HANDOVER", 252, 251), ("DRONE_CONNECTED", 252, 251)}
    receiver, whole = PackageReceiver(), None
    for message in heard:
        if message.get_type() == "MISSION_PACKAGE":
            receiver.on_offer(message, (251, 190))
        elif message.get_type() == "MISSION_CHUNK":
            whole = receiver.on_chunk(message, (251, 190))[1] or whole
    assert whole is not None
    assert packages.from_bytes(whole[1]).digest == package.digest


_FLOOD = ("COMMAND_LONG", "PARAM_REQUEST_READ", "DISCONNECT_HANDOVER")


def test_a_flood_has_the_rate_that_was_asked_for_valid_and_broken(processes: Processes, tmp_path: Path) -> None:
    child, companion, station = begin_rogue(processes, tmp_path)
    companion.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
    companion.socket.send(b"down")
    station.recv(100)
    child.type("flood GCSB 252 2000 0.5")
    assert lines_of(tmp_path / "rogue.jsonl", "flood_ended")[0]["datagrams"] == 1000
    received = [companion.socket.recv(1000) for _ in range(200)]
    good = []
    for data in received:
        parser: Any = mavlink.MAVLink(None)
        parser.robust_parsing = True
        good += [m.get_type() for m in parser.parse_buffer(data) or [] if m.get_type() in _FLOOD]
    assert 60 <= len(good) <= 70, "one in three is valid"
    signed = [data for data in received if data[0] == 0xFD and data[2] == 1 and len(data) == 10 + data[1] + 2 + 13]
    assert 30 <= len(signed) <= 36, "every other one of these carries a signature"
    assert all(good.count(kind) >= 15 for kind in _FLOOD), "a third of these each"


def test_orders_reach_every_link_that_a_pattern_means(processes: Processes, tmp_path: Path) -> None:
    ports = PortPicker()
    names = ("ground-A-B", "ground-B-A", "air-A")
    links = [f'[[link]]\nname = "{name}"\nlisten = {ports.udp()}\ntarget = {ports.udp()}\n' for name in names]
    (tmp_path / "links.toml").write_text("".join(links), encoding="utf-8")
    argv = [sys.executable, "-m", "sitl.run.bad_links", "--config", str(tmp_path / "links.toml")]
    child = processes.start("impairment", argv, tmp_path)
    until = time.monotonic() + 60
    while "ready" not in child.console():
        assert time.monotonic() < until
        time.sleep(0.02)
    done = give_orders(child, names, ["cut ground-*", "loss air-A 0.2"])
    while not done():
        assert time.monotonic() < until
        time.sleep(0.02)
    assert child.console()[1:] == ["ok cut ground-A-B", "ok cut ground-B-A", "ok loss air-A 0.2"]
    with pytest.raises(StepFailed, match=r"'cut sea-\*': no link through the proxy is called so: ground-A-B"):
        give_orders(child, names, ["cut sea-*"])
    done = give_orders(child, names, ["loss air-A 2"])
    while len(child.console()) < 5:
        assert time.monotonic() < until
        time.sleep(0.02)
    with pytest.raises(StepFailed, match=r"loss = 2\.0: must be 0 to 1"):
        done()


def test_a_killed_process_starts_again_and_its_console_goes_on(processes: Processes, tmp_path: Path) -> None:
    argv = [sys.executable, "-c", "print('here', flush=True); input()"]
    first = processes.start("one", argv, tmp_path)
    with pytest.raises(ValueError, match="'one' still runs"):
        processes.restart("one")
    until = time.monotonic() + 60
    while first.console() != ["here"]:
        assert time.monotonic() < until
        time.sleep(0.02)
    first.kill()
    second = processes.restart("one")
    while second.console() != ["here", "here"]:
        assert time.monotonic() < until
        time.sleep(0.02)
    assert processes["one"] is second
    assert second.pid != first.pid
    assert processes.dead() == []
    assert (second.resident_kb() or 0) > 1000


# ---- beside the autopilot -------------------------------------------------------------------------------------------


def begin_beside(processes: Processes, folder: Path, name: str, module: str, config: str) -> socket.socket:
    """A program that connects to the autopilot; returns the autopilot's end, when the program is there."""
    server = socket.create_server((LOOPBACK, 0))
    _OPEN.append(server)
    server.settimeout(60.0)
    file = folder / f"{name}.toml"
    file.write_text(f'journal = "{folder / name}.jsonl"\n{config}', encoding="utf-8")
    argv = [sys.executable, "-m", module, "--config", str(file), "--autopilot", str(server.getsockname()[1])]
    processes.start(name, argv, folder)
    lines_of(folder / f"{name}.jsonl", "loaded")
    return server


def packed(message: Any, component: int = COMPANION) -> bytes:
    data: bytes = message.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=component))
    return data


def block(bit: int, corner: tuple[float, float] = (52.0, 5.0)) -> Any:
    where = (*(round(each * 1e7) for each in corner), 100, bit)
    return mavlink.MAVLink_terrain_data_message(*where, list(range(16)))


def test_the_listener_relays_every_byte_and_journals_what_it_is_told(processes: Processes, tmp_path: Path) -> None:
    port = PortPicker().tcp()
    config = f'listen = {port}\nmessages = ["TERRAIN_DATA", "TERRAIN_REPORT"]\n'
    server = begin_beside(processes, tmp_path, "listener", "sitl.run.line_listener", config)
    companion = socket.create_connection((LOOPBACK, port), 10.0)
    autopilot, _ = server.accept()
    _OPEN.extend((companion, autopilot))
    sent = b"noise" + packed(block(9)) + packed(mavlink.MAVLink_system_time_message(1, 2))
    companion.sendall(sent)
    assert autopilot.recv(len(sent), socket.MSG_WAITALL) == sent
    (entry,) = lines_of(tmp_path / "listener.jsonl", "to_autopilot")
    assert (entry["what"], entry["component"], entry["gridbit"]) == ("TERRAIN_DATA", COMPANION, 9)
    # the second row of blocks ends seven steps of 100 m to the north
    assert entry["north_deg"] == pytest.approx(52.0 + 700 / 111_319, abs=1e-6)
    assert (entry["lowest_m"], entry["highest_m"]) == (0, 15)
    told = packed(mavlink.MAVLink_terrain_report_message(1, 2, 100, 5.0, 6.0, 0, 56), component=1)
    autopilot.sendall(told)
    assert companion.recv(len(told), socket.MSG_WAITALL) == told
    assert lines_of(tmp_path / "listener.jsonl", "from_autopilot")[0]["pending"] == 0
    companion.close()  # it starts again
    again = socket.create_connection((LOOPBACK, port), 10.0)
    other, _ = server.accept()
    _OPEN.extend((again, other))
    again.sendall(sent)
    assert other.recv(len(sent), socket.MSG_WAITALL) == sent


def test_the_transponder_believes_the_autopilot_alone(processes: Processes, tmp_path: Path) -> None:
    server = begin_beside(processes, tmp_path, "transponder", "sitl.run.transponder", "vehicle = 1\n")
    autopilot, _ = server.accept()
    _OPEN.append(autopilot)
    autopilot.settimeout(10.0)
    parser: Any = mavlink.MAVLink(None)
    said = [message.get_type() for _ in range(2) for message in parser.parse_buffer(autopilot.recv(100)) or ()]
    assert said[:2] == ["HEARTBEAT", "OPEN_DRONE_ID_ARM_STATUS"]

    def operator(lat: int) -> Any:
        return mavlink.MAVLink_open_drone_id_system_update_message(1, 0, lat, 50_000_000, 3.0, 4)

    autopilot.sendall(packed(operator(1)) + packed(operator(2), component=1) * 2 + packed(operator(3), component=1))
    journal = tmp_path / "transponder.jsonl"
    while len(entries := lines_of(journal, "operator")) < 2:
        time.sleep(0.02)
    assert [entry["operator_latitude"] for entry in entries] == [2, 3]


def test_a_program_beside_a_station_answers_for_the_ground(processes: Processes, tmp_path: Path) -> None:
    child, companion, station = begin_rogue(processes, tmp_path)
    child.type("terrain GCSB 252 70 60")
    child.type("record GCSB")
    lines_of(tmp_path / "rogue.jsonl", "recording")
    companion.say(mavlink.MAVLink_terrain_request_message(520000000, 50000000, 100, 0b101))
    assert station.recv(100), "the station hears it, too"
    answers = [companion.hear("TERRAIN_DATA") for _ in range(1)]
    assert (answers[0].gridbit, answers[0].data[0], answers[0].get_srcSystem()) == (0, 70, 252)
    assert lines_of(tmp_path / "rogue.jsonl", "terrain_asked")[0]["parts"] == 2
