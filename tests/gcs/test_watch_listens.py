# SPDX-License-Identifier: GPL-3.0-or-later

"""What the page hears on a link, and that nothing ever leaves it: to nobody who speaks, asks, or waits."""

from __future__ import annotations

import ast
import asyncio
import re
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import handover as mavlink

import gcs_module.watch
from gcs_module.alarms import DECISIONS
from gcs_module.watch.link_reader import LinkReader
from gcs_module.watch.page_values import shown
from gcs_module.watch.passive_link import MOST_FRAMES, PassiveLink, parse_passive_link
from gcs_module.watch.scene import MOST_AIRCRAFT, Scene
from mavproxy_handover.core.common.model import AuthorityView, FlightAction, GuardState, LeaseState, Phase, Reason
from mavproxy_handover.link.forms import LinkError
from mavproxy_handover.wire import status
from mavproxy_handover.wire.frames import Frame, FrameSplitter, parse_one
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID, COMPANION_COMPID, LANGUAGE_COMPID

FOLDER = Path(gcs_module.watch.__file__).parent
#: what would send, write or lock, by its name
MUTE = {
    *("send", "sendall", "sendto", "sendmsg", "sendfile", "sock_sendall", "sock_sendto", "sock_sendfile"),
    *("create_datagram_endpoint", "create_connection", "open_connection", "drain"),
    *(
        "write",
        "write_text",
        "write_bytes",
        "writelines",
        "mkdir",
        "unlink",
        "rename",
        "replace_file",
        "touch",
        "flock",
    ),
}


def packed(message: mavlink.MAVLink_message, sysid: int = 1, component: int = LANGUAGE_COMPID) -> bytes:
    return bytes(message.pack(mavlink.MAVLink(None, srcSystem=sysid, srcComponent=component)))


def view(commander: int | None, phase: Phase = Phase.ON_MISSION) -> AuthorityView:
    lease = LeaseState.HELD if commander else LeaseState.LOST
    return AuthorityView(epoch=4, phase=phase, commander=commander, partner=None, lease=lease)


def authority(commander: int | None, phase: Phase = Phase.ON_MISSION) -> mavlink.MAVLink_message:
    message: mavlink.MAVLink_message = status.authority_status(
        view(commander, phase), 251, GuardState.LIVE, Reason.ZONE
    )
    return message


def heartbeat() -> mavlink.MAVLink_message:
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, 129, 3, 4, 3
    )


def position(lat: int = 526800000, lon: int = 59200000) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_global_position_int_message(0, lat, lon, 0, 40_000, 300, 400, 0, 9000)


def battery() -> mavlink.MAVLink_message:
    return mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 11_800, 0, 71, 0, 0, 0, 0, 0, 0)


class Listening:
    """A scene that hears what is said."""

    def __init__(self) -> None:
        self.scene, self.now = Scene(), 1000.0
        self.hearing = LinkReader(self.scene, "udpin", self.name)

    @staticmethod
    def name(sysid: int) -> str:
        return {251: "GCSA", 252: "GCSB"}.get(sysid, "")

    def hear(self, message: mavlink.MAVLink_message, sysid: int = 1, component: int = LANGUAGE_COMPID) -> None:
        frame = parse_one(packed(message, sysid, component))
        assert frame is not None
        self.hearing.on_frame(frame, self.now, 1.7e9)

    def row(self, name: str = "vehicle 1") -> dict[str, object]:
        rows = shown(self.scene, {}, self.now).aircraft
        return next(dict(row) for row in rows if row["name"] == name)


@pytest.fixture
def listening() -> Listening:
    return Listening()


def test_an_aircraft_is_shown_as_its_link_says(listening: Listening) -> None:
    listening.hear(authority(251))
    listening.hear(heartbeat(), component=AUTOPILOT_COMPID)
    listening.hear(position(), component=AUTOPILOT_COMPID)
    listening.hear(battery(), component=AUTOPILOT_COMPID)
    listening.hear(mavlink.MAVLink_handover_ahead_message(252, 0, 1, 251, 252, 1, 4, 42, 2, 2))
    row = listening.row()
    assert (row["commander"], row["lease"], row["guard"], row["next"]) == ("GCSA", "held", "live", "GCSB in 42 s")
    assert (row["phase"], row["battery"], row["place"]) == ("on mission · AUTO", "71 %, 11.8 V", "40 m, in GCSA")
    listening.now += 2.0
    assert listening.row()["next"] == "GCSB in 40 s"
    (mark,) = shown(listening.scene, {}, listening.now).marks
    assert (mark["at"], mark["heading"]) == ([52.68, 5.92], 90.0)


def test_decisions_and_commanders_are_told_once_and_alarm(listening: Listening) -> None:
    listening.hear(authority(251))
    for _ in range(3):
        text = b"RETURN to home. GCSA silent for 5 s"
        listening.hear(mavlink.MAVLink_handover_decision_message(7, FlightAction.RETURN, 5, b"home", b"", text))
        listening.hear(authority(None, Phase.EMERGENCY))
    alarms = [(row["level"], row["text"]) for row in shown(listening.scene, {}, listening.now).alarms]
    assert alarms == [("emergency", "RETURN to home. GCSA silent for 5 s"), ("emergency", "no station commands")]
    told = [line.text for line in listening.scene.feed]
    assert told == ["RETURN to home. GCSA silent for 5 s", "no station commands, epoch 4"]
    assert listening.scene.feed[0].level is DECISIONS[FlightAction.RETURN]


def test_an_action_of_a_newer_version_alarms_as_a_return_does(listening: Listening) -> None:
    listening.hear(authority(251))
    listening.hear(mavlink.MAVLink_handover_decision_message(7, 77, 5, b"", b"", b"DITCH: all is wrong"))
    alarms = [(row["level"], row["text"]) for row in shown(listening.scene, {}, listening.now).alarms]
    assert alarms == [("emergency", "DITCH: all is wrong")]
    assert [(line.level, line.text) for line in listening.scene.feed] == [
        (DECISIONS[FlightAction.RETURN], "DITCH: all is wrong")
    ]
    over = mavlink.MAVLink_handover_decision_message(8, mavlink.HANDOVER_ACTION_NONE, 0, b"", b"", b"all is well")
    listening.hear(over)
    assert shown(listening.scene, {}, listening.now).alarms == ()


def test_texts_of_the_companion_are_told_unless_a_message_has_said_so(listening: Listening) -> None:
    listening.hear(authority(251))
    decided = b"HOLD. Coverage ends in 5 s"
    listening.hear(mavlink.MAVLink_handover_decision_message(7, FlightAction.HOLD, 5, b"", b"", decided))
    for text in (decided, b"GCSA commands now (handover 1)", b"energy: the budget closes"):
        listening.hear(mavlink.MAVLink_statustext_message(4, text), component=COMPANION_COMPID)
    listening.hearing.tick(listening.now + 1.0, 1.7e9)
    assert [line.text for line in listening.scene.feed] == ["HOLD. Coverage ends in 5 s", "energy: the budget closes"]


def test_it_is_known_by_its_name_once_that_is_said(listening: Listening) -> None:
    listening.hear(authority(251))
    listening.hear(mavlink.MAVLink_connect_ack_message(251, 0, 1, 251, 3, 0, 4, 251, b"drone-7", [0] * 32, 0))
    assert list(listening.scene.aircraft) == ["drone-7"]
    listening.hear(authority(252))
    assert listening.row("drone-7")["commander"] == "GCSB"


def test_the_payload_is_shown_by_kind_with_its_age(listening: Listening) -> None:
    listening.hear(authority(251))
    assert listening.row()["payload"] == "", "the commander's: the vehicle says nothing of it"
    for component, station in ((154, 252), (100, 252), (169, 0)):
        listening.hear(mavlink.MAVLink_control_status_message(0, station, [0] * 10), component=component)
    assert listening.row()["payload"] == "gimbal GCSB, camera GCSB, winch no station"
    listening.hear(mavlink.MAVLink_control_status_message(1, 251, [0] * 10), component=COMPANION_COMPID)
    assert listening.row()["payload"] == "gimbal GCSB, camera GCSB, winch no station"
    listening.now += 20.0
    listening.hear(authority(251))
    assert listening.row()["payload"] == "gimbal GCSB (20 s old), camera GCSB (20 s old), winch no station (20 s old)"


def test_nobody_else_makes_an_aircraft(listening: Listening) -> None:
    gcs = mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3)
    listening.hear(gcs, sysid=255, component=190)
    listening.hear(gcs, sysid=255, component=AUTOPILOT_COMPID)
    listening.hear(position(), sysid=9, component=AUTOPILOT_COMPID)
    listening.hear(authority(251), sysid=9, component=77)
    assert listening.scene.aircraft == {}
    for sysid in range(1, 256):
        listening.hear(authority(251), sysid=sysid)
    assert len(listening.scene.aircraft) == MOST_AIRCRAFT


@pytest.mark.parametrize("msgid", sorted(mavlink.mavlink_map))
def test_no_message_whatever_is_in_it_raises(listening: Listening, msgid: int) -> None:
    listening.hear(authority(251))
    kind = mavlink.mavlink_map[msgid]
    for filling in (b"\0", b"\xff", b"\x7f", b"\x80"):
        payload = filling * kind.unpacker.size
        for component in (AUTOPILOT_COMPID, COMPANION_COMPID, LANGUAGE_COMPID):
            frame = Frame(_raw(msgid, payload, component), 2, msgid, 1, component, 0, False, payload, True)
            listening.hearing.on_frame(frame, listening.now, 1.7e9)
    listening.hearing.tick(listening.now + 10.0, 1.7e9)
    assert shown(listening.scene, {}, listening.now).aircraft


def _raw(msgid: int, payload: bytes, component: int) -> bytes:
    body = bytes([len(payload), 0, 0, 0, 1, component]) + msgid.to_bytes(3, "little") + payload
    crc = mavlink.x25crc(body + bytes([mavlink.mavlink_map[msgid].crc_extra]))
    return b"\xfd" + body + crc.crc.to_bytes(2, "little")


def test_links_that_need_a_word_are_refused() -> None:
    for text in ("udpout:127.0.0.1:1", "tcpin:0.0.0.0:1", "/dev/ttyUSB0", "serial:/dev/ttyUSB0:57600", "udpin:x", ""):
        with pytest.raises(LinkError):
            parse_passive_link(text)
    taken = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    taken.bind(("127.0.0.1", 0))
    with taken, pytest.raises(LinkError, match="Address already in use"):
        PassiveLink(
            parse_passive_link(f"udpin:127.0.0.1:{taken.getsockname()[1]}"), lambda _frame: None, time.monotonic
        ).bind()


def calls() -> Iterator[tuple[str, str]]:
    for path in sorted(FOLDER.glob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Attribute):
                yield path.name, node.attr
            elif isinstance(node, ast.Name):
                yield path.name, node.id


def test_no_line_of_it_sends_or_writes() -> None:
    found = {(name, word) for name, word in calls() if word in MUTE}
    assert found == {("web_auth.py", "send")}  # the answer to a browser


def test_files_are_opened_only_for_reading() -> None:
    opened = {(name, word) for name, word in calls() if word in ("open", "O_RDONLY", "O_WRONLY", "O_RDWR", "O_CREAT")}
    assert opened == {("tail.py", "open"), ("tail.py", "O_RDONLY"), ("tiles.py", "open")}
    tiles = (FOLDER / "tiles.py").read_text(encoding="utf-8")
    assert re.findall(r"open\((.*?)\)", tiles) == ['"rb"']


#: what programs answer: a question to each system, and to all
QUESTIONS = b"".join(
    packed(message, sysid=1, component=AUTOPILOT_COMPID)
    for message in (
        heartbeat(),
        mavlink.MAVLink_ping_message(1, 1, 0, 0),
        mavlink.MAVLink_timesync_message(0, 1),
        mavlink.MAVLink_command_long_message(0, 0, 512, 0, 148, 0, 0, 0, 0, 0, 0),
        mavlink.MAVLink_mission_request_list_message(0, 0),
        mavlink.MAVLink_param_request_list_message(0, 0),
    )
)


async def heard(ear: PassiveLink, opened: socket.socket | None, count: int, frames: list[Frame]) -> None:
    listener = asyncio.create_task(ear.run(opened))
    for _ in range(300):
        if len(frames) >= count:
            break
        await asyncio.sleep(0.01)
    await asyncio.sleep(0.3)  # for an answer, if there was one
    listener.cancel()


def test_who_speaks_to_it_by_udp_gets_no_answer() -> None:
    frames: list[Frame] = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    ear = PassiveLink(parse_passive_link(f"udpin:127.0.0.1:{port}"), frames.append, time.monotonic)
    opened = ear.bind()
    assert opened is not None
    with opened, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
        peer.connect(("127.0.0.1", port))
        for datagram in (QUESTIONS, b"", b"\xfd", b"\xff" * 2000, QUESTIONS + b"\xfd\x01"):
            peer.send(datagram)
        asyncio.run(heard(ear, opened, 12, frames))
        peer.setblocking(False)
        with pytest.raises(BlockingIOError):
            peer.recv(1)
    assert len(frames) == 12
    assert ear.garbage == 1 + 2000 + 2


def test_a_server_it_listens_to_gets_no_byte_and_is_found_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gcs_module.watch.passive_link._AGAIN_S", 0.05)
    frames: list[Frame] = []
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(5.0)
        ear = PassiveLink(parse_passive_link(f"tcp:127.0.0.1:{server.getsockname()[1]}"), frames.append, time.monotonic)

        async def serve() -> None:
            listener = asyncio.create_task(ear.run(None))
            for number in (1, 2):
                peer, _address = await asyncio.to_thread(server.accept)
                peer.settimeout(0.4)
                peer.sendall(QUESTIONS[:30])
                await asyncio.sleep(0.05)
                peer.sendall(QUESTIONS[30:])
                with pytest.raises(TimeoutError):
                    await asyncio.to_thread(peer.recv, 1)
                assert len(frames) == 6 * number
                peer.close()
            listener.cancel()

        asyncio.run(serve())
    assert ear.state.startswith(("connected", "not connected"))


def test_a_flood_is_thrown_away() -> None:
    frames: list[Frame] = []
    ear = PassiveLink(parse_passive_link("udpin:127.0.0.1:1"), frames.append, lambda: 5.5)
    flood = FrameSplitter(1 << 22).feed(packed(heartbeat()) * (MOST_FRAMES + 500))
    ear._handle_frames(flood)
    assert (len(frames), ear.thrown_away) == (MOST_FRAMES, 500)
