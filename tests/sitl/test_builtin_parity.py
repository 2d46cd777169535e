# SPDX-License-Identifier: GPL-3.0-or-later

"""The built-in vehicle against ArduCopter's SITL program: the same session on both, and the answers compared.

The session is what this system does with a vehicle: upload, read back, arm, START, pause, continue, a mission
to its end, RTL to a rally point, the refusals on the way. Texts of sensors and of SITL itself are left out;
times and places may differ by what a model may differ. Skipped where there is no program.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as dialect

from sitl.vehicles import RunningVehicle, VehicleSpec, find_arducopter, launch
from sitl.vehicles.builtin.framing import FrameSplitter, decode

pytestmark = [
    pytest.mark.sitl,
    pytest.mark.skipif(find_arducopter() is None, reason="no arducopter SITL program"),
]

SPEEDUP = 10.0
HOME = (52.679, 5.924, 10.0, 0.0)
COMPANION = (1, 191)
READY_FLAGS = 831
Place = tuple[int, int]

#: Texts about things only one of the two has.
FOREIGN_TEXTS = (
    "EKF",
    "AHRS",
    "GPS",
    "Barometer",
    "Calibrating",
    "Field",
    "SIM",
    "ArduPilot",
    "Fence",
    "PreArm",
    "No ap_message",
)

MISSION = [
    (0, 16, (0, 0, 0, 0), (520000000, 50000000), 0.0),
    (3, 22, (15, 1, 2, float("nan")), (0, 0), 15.0),
    (6, 178, (1, 6, -1, 0), (0, 0), 0.0),
    (6, 16, (2.7, 3, 4, float("nan")), (526795000, 59240000), 20.123),
    (3, 19, (3, 0, -50, 1), (526795000, 59246000), 20.0),
    (3, 112, (2.5, 0, 0, 0), (0, 0), 0.0),
    (3, 16, (0, 0, 0, 0), (526793000, 59246000), 22.0),
    (2, 177, (6, 1, 0, 0), (0, 0), 0.0),
    (0, 16, (0, 0, 0, 0), (526792000, 59243000), 32.0),
    (2, 20, (0, 0, 0, 0), (5, 6), 7.0),
]
RALLY = [(3, 5100, (1, 2, 3, 4), (526796000, 59240000), 20.7), (0, 5100, (0, 0, 0, 0), (526700000, 59300000), 30.0)]
FENCE = [(3, 5001, (4, 0, 0, 0), place, 0.0) for place in ((52670, 591), (52670, 594), (52690, 594), (52690, 591))]
FENCE = [(frame, cmd, p, (x * 10000, y * 100000), z) for frame, cmd, p, (x, y), z in FENCE]


def area(*corners: tuple[int, float]) -> list[Any]:
    """Items of a fence: (command, parameter 1) for each, all at places of their own."""
    return [
        (0, command, (size, 0, 0, 0), (526700000 + n * 1000, 59100000 + n * n * 1000), 0.0)
        for n, (command, size) in enumerate(corners)
    ]


#: Whole ones, and some that are none: what is answered, and what is kept then.
FENCES = [
    area(*[(5002, 3)] * 6, (5003, 750.5), (5004, 25)),
    area(*[(5001, 3)] * 2),
    area(*[(5001, 2)] * 2),
    area((5001, 3), (5001, 3), (5002, 3)),
    area((5001, 3), (5001, 4), (5001, 3)),
    area((5001, 3), (5003, 50), (5001, 3), (5001, 3)),
    area((5004, 0)),
    area((5003, 900), *[(5001, 4)] * 4),
]

#: Commands tried on the ground before arming, as (command, param1, param2, ...).
GROUND_COMMANDS = [
    (176, 1, 6),
    (400, 1),
    (176, 1, 99),
    (176, 0, 6),
    (176, 1, 4),
    (22, 0, 0, 0, 0, 0, 0, 10),
    (193, 2),
    (178, 1, 0),
    (178, 4, 3),
    (192, -1, 1),
    (300, 1, 0),
    (400, 0.5),
    (401,),
    (410,),
    (510, 33),
    (510, 99999),
    (511, 99999, 100000),
    (512, 148),
    (512, 99999),
    (520, 1),
    (520, 0),
    (224, 40),
    (42428,),
    (43000,),
    (32100,),
]


class Session:
    """One client on one vehicle, and everything it heard."""

    def __init__(self, kind: str, directory: Path) -> None:
        self.kind = kind
        spec = VehicleSpec(home=HOME, speedup=SPEEDUP, parameters={"RALLY_LIMIT_KM": 0, "MAV2_EXTRA3": 4})
        self.vehicle: RunningVehicle = launch(kind, spec, directory)
        _, host, port = self.vehicle.companion_master.split(":")
        self.socket = socket.create_connection((host, int(port)), timeout=30)
        self.socket.settimeout(0.005)
        self.splitter = FrameSplitter()
        self.encoder = dialect.MAVLink(None, *COMPANION)
        self.heard: list[Any] = []
        self.now_s = 0.0

    def close(self) -> None:
        self.socket.close()
        self.vehicle.stop()

    def send(self, message: dialect.MAVLink_message) -> None:
        self.socket.sendall(message.pack(self.encoder))
        self.encoder.seq = (self.encoder.seq + 1) % 256

    def pump(self) -> None:
        try:
            data = self.socket.recv(65536)
        except TimeoutError:
            return
        assert data, f"{self.kind} closed the connection"
        for frame in self.splitter.push(data):
            message = decode(frame)
            if message is not None:
                self.heard.append(message)
                if message.get_type() == "GLOBAL_POSITION_INT":
                    self.now_s = message.time_boot_ms / 1000

    def until(self, holds: Callable[[], Any], sim_s: float) -> Any:
        """Wait until `holds` gives something, at most `sim_s` of simulated time (and a minute of the wall clock)."""
        end_s, wall_s = self.now_s + sim_s, time.monotonic() + 60
        while not (found := holds()):
            if self.now_s >= end_s or time.monotonic() >= wall_s:
                raise AssertionError(f"{self.kind}: nothing within {sim_s} s, last texts {self.texts()[-5:]}")
            self.pump()
        return found

    def next(self, kinds: Sequence[str], start: int, sim_s: float = 30.0) -> Any:
        return self.until(lambda: next((m for m in self.heard[start:] if m.get_type() in kinds), None), sim_s)

    def command(self, command: int, *params: float) -> int:
        start = len(self.heard)
        filled = [*params, *([0.0] * (7 - len(params)))]
        self.send(dialect.MAVLink_command_long_message(1, 1, command, 0, *filled))
        return int(self.next(["COMMAND_ACK"], start).result)

    def upload(self, items: Sequence[Any], kind: int) -> int:
        start = len(self.heard)
        self.send(dialect.MAVLink_mission_count_message(1, 1, len(items), kind))
        asked = -1
        while True:
            m = self.next(["MISSION_REQUEST", "MISSION_ACK"], start)
            start = self.heard.index(m, start) + 1
            if m.get_type() == "MISSION_ACK":
                return int(m.type)
            if m.seq == asked:
                continue  # the program asks twice now and then
            asked = m.seq
            frame, command, params, (x, y), z = items[m.seq]
            item = (1, 1, m.seq, frame, command, 0, 1, *params, x, y, z, kind)
            self.send(dialect.MAVLink_mission_item_int_message(*item))

    def download(self, kind: int) -> list[tuple[Any, ...]]:
        start = len(self.heard)
        self.send(dialect.MAVLink_mission_request_list_message(1, 1, kind))
        items = []
        for index in range(self.next(["MISSION_COUNT"], start).count):
            start = len(self.heard)
            self.send(dialect.MAVLink_mission_request_int_message(1, 1, index, kind))
            m = self.next(["MISSION_ITEM_INT"], start)
            params = (m.param1, m.param2, m.param3, m.param4)
            items.append((m.seq, m.frame, m.command, m.current, m.autocontinue, *params, m.x, m.y, round(m.z, 2)))
        return items

    def texts(self) -> list[str]:
        return [m.text for m in self.heard if m.get_type() == "STATUSTEXT" and not m.text.startswith(FOREIGN_TEXTS)]

    def beats(self) -> list[tuple[int, int, int]]:
        """Changes of arming, mode and state in the heartbeats, the first seconds left out.

        Landed and still armed lasts about a second: whether a heartbeat falls into it is chance, so it is left out.
        """
        seen: list[tuple[int, int, int]] = []
        for m in self.heard:
            if m.get_type() == "HEARTBEAT" and m.get_srcComponent() == 1 and m.system_status != 1:
                beat = (m.base_mode & 128, m.custom_mode, m.system_status)
                just_landed = seen and seen[-1] == (128, m.custom_mode, 4) and beat == (128, m.custom_mode, 3)
                if (not seen or seen[-1] != beat) and not just_landed:
                    seen.append(beat)
        return seen

    def reached(self) -> list[int]:
        return [m.seq for m in self.heard if m.get_type() == "MISSION_ITEM_REACHED"]

    def armed(self) -> bool:
        beat = next(m for m in reversed(self.heard) if m.get_type() == "HEARTBEAT")
        return bool(beat.base_mode & 128)

    def latest(self, kind: str) -> Any:
        return next(m for m in reversed(self.heard) if m.get_type() == kind)

    def shows(self, kind: str, fits: Callable[[Any], bool]) -> bool:
        """Whether the latest message of that kind fits; with none yet it does not."""
        return any(fits(m) for m in [m for m in self.heard if m.get_type() == kind][-1:])

    def place(self) -> Place:
        m = self.latest("GLOBAL_POSITION_INT")
        return m.lat, m.lon


def fly(session: Session) -> dict[str, Any]:
    """The session; returns what is compared."""
    found: dict[str, Any] = {}
    session.until(
        lambda: any(m.get_type() == "EKF_STATUS_REPORT" and m.flags == READY_FLAGS for m in session.heard), 60
    )
    session.until(lambda: session.now_s > 30, 60)
    found["ground"] = [(c[0], c[1:2], session.command(*c)) for c in GROUND_COMMANDS]
    found["fences"] = [(session.upload(fence, 1), session.download(1)) for fence in FENCES]
    found["uploads"] = [session.upload(MISSION, 0), session.upload(FENCE, 1), session.upload(RALLY, 2)]
    found["mission"], found["fence"], found["rally"] = (session.download(kind) for kind in (0, 1, 2))
    bad = [(3, 9999, (0, 0, 0, 0), (0, 0), 0.0)] * 2
    found["refused"] = [session.upload(bad, 1), session.upload(bad, 2), session.upload(MISSION[:1], 5)]
    session.heard.clear()
    session.until(lambda: any(m.get_type() == "HEARTBEAT" for m in session.heard), 5)
    found["start"] = [session.command(176, 1, 4), session.command(400, 1), session.command(300)]
    started_s = session.now_s
    session.until(
        lambda: (
            session.shows("MISSION_CURRENT", lambda m: m.seq == 3)
            and session.shows("VFR_HUD", lambda m: m.groundspeed > 4)
        ),
        60,
    )
    found["in flight"] = [session.command(400, 0), session.command(300, 0, 1), session.command(193, 0)]
    session.until(lambda: session.shows("VFR_HUD", lambda m: m.groundspeed < 0.3), 30)
    found["paused"] = session.latest("MISSION_CURRENT").mission_state
    found["continue"] = session.command(193, 1)
    session.until(lambda: not session.armed(), 300)
    found["flight_s"] = session.now_s - started_s
    found["landed at"] = session.place()
    found["texts"], found["beats"], found["reached"] = session.texts(), session.beats(), session.reached()
    session.heard.clear()
    session.until(lambda: any(m.get_type() == "HEARTBEAT" for m in session.heard), 5)
    guided = [session.command(176, 1, 4), session.command(400, 1), session.command(22, 0, 0, 0, 0, 0, 0, 10)]
    session.until(lambda: session.shows("GLOBAL_POSITION_INT", lambda m: m.relative_alt > 9500), 60)
    place = (1, 1, 6, 192, 0, 0, -1.0, 1.0, 0.0, 0.0, 526795500, 59240000, 12.0)
    session.send(dialect.MAVLink_command_int_message(*place))
    session.until(lambda: session.shows("GLOBAL_POSITION_INT", lambda m: m.lat > 526795300), 60)
    found["guided"] = [*guided, session.command(178, 1, 3), session.command(176, 1, 17), session.command(20)]
    session.until(lambda: not session.armed(), 150)
    found["rally at"] = session.place()
    found["second texts"] = session.texts()
    return found


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[Session, dict[str, Any]]]:
    results = {}
    for kind in ("arducopter", "builtin"):
        session = Session(kind, tmp_path_factory.mktemp(kind))
        try:
            results[kind] = (session, fly(session))
        finally:
            session.close()
    return results


Both = dict[str, tuple[Session, dict[str, Any]]]

SAME = [
    "ground",
    "fences",
    "uploads",
    "fence",
    "rally",
    "refused",
    "start",
    "in flight",
    "paused",
    "continue",
    "guided",
]


@pytest.mark.parametrize("what", [*SAME, "texts", "second texts", "beats", "reached"])
def test_both_answer_the_same(both: Both, what: str) -> None:
    assert both["builtin"][1][what] == both["arducopter"][1][what]


def test_both_read_the_same_mission_back(both: Both) -> None:
    ours, theirs = both["builtin"][1]["mission"], both["arducopter"][1]["mission"]
    assert ours[1:] == theirs[1:]
    assert ours[0][:9] == theirs[0][:9]  # home: the same item, measured by different sensors
    assert ours[0][9:] == (
        pytest.approx(theirs[0][9], abs=20),
        pytest.approx(theirs[0][10], abs=20),
        pytest.approx(10, abs=1),
    )


def test_both_need_about_the_same_time(both: Both) -> None:
    assert both["builtin"][1]["flight_s"] == pytest.approx(both["arducopter"][1]["flight_s"], rel=0.12)


@pytest.mark.parametrize("where", ["landed at", "rally at"])
def test_both_land_at_the_same_place(both: Both, where: str) -> None:
    ours, theirs = both["builtin"][1][where], both["arducopter"][1][where]
    assert ours == (pytest.approx(theirs[0], abs=150), pytest.approx(theirs[1], abs=250))  # 1.7 m each way


def test_the_model_sends_nothing_that_the_program_does_not(both: Both) -> None:
    kinds = {name: {m.get_type() for m in session.heard} for name, (session, _) in both.items()}
    assert kinds["builtin"] <= kinds["arducopter"]
    assert kinds["arducopter"] - kinds["builtin"] <= {
        "AHRS", "AHRS2", "ESC_TELEMETRY_1_TO_4", "SIMSTATE", "TERRAIN_REPORT", "WIND", "PARAM_VALUE",
    }  # fmt: skip


def test_every_parameter_of_the_model_is_one_of_the_program(tmp_path: Path) -> None:
    tables = {}
    for kind in ("arducopter", "builtin"):
        session = Session(kind, tmp_path / kind)
        try:
            session.until(lambda s=session: s.now_s > 5, 60)
            session.send(dialect.MAVLink_param_request_list_message(1, 1))
            session.until(
                lambda s=session: any(
                    m.get_type() == "PARAM_VALUE" and m.param_index == m.param_count - 1 for m in s.heard
                ),
                120,
            )
            values = [m for m in session.heard if m.get_type() == "PARAM_VALUE" and m.param_index != 65535]
            tables[kind] = {m.param_id: (m.param_type, m.param_value) for m in values}
        finally:
            session.close()
    for name in ("STAT_RUNTIME", "MIS_TOTAL"):
        tables["builtin"].pop(name)
    assert {name: tables["arducopter"].get(name) for name in tables["builtin"]} == tables["builtin"]
