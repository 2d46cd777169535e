# SPDX-License-Identifier: GPL-3.0-or-later

"""A real commander's flight, replayed: `tests/data/commander.tlog` (how it was made: `record_commander.py` beside it).

A stock MAVProxy, system 251, that set parameters, loaded mission, fence and rally points, moved files, read logs, flew
in GUIDED, AUTO and by sticks, and tried what no station may.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from mavproxy_handover.core.common.model import AuthorityView, LeaseState, Phase
from mavproxy_handover.gate.flush import FlushTracker
from mavproxy_handover.gate.judge import Fate, StationIdentity, Verdict, judge
from mavproxy_handover.wire.frames import Frame, FrameSplitter, parse_one

STATION, OTHER, VEHICLE = 251, 252, 1
LOG = Path(__file__).parents[1] / "data" / "commander.tlog"

#: What may be forwarded of an observer's: it asks, and changes nothing. Written out from the log, all of it.
HARMLESS = {
    "COMMAND_LONG/MAV_CMD_GET_HOME_POSITION": 11,
    "COMMAND_LONG/MAV_CMD_REQUEST_MESSAGE": 1,
    "MISSION_REQUEST_INT/FENCE": 3,
    "MISSION_REQUEST_INT/MISSION": 4,
    "MISSION_REQUEST_LIST/FENCE": 1,
    "MISSION_REQUEST_LIST/MISSION": 1,
    "PARAM_REQUEST_READ": 1,
}
#: ... and of it what slows down what the commander hears: on the ground only.
DEAR = {
    "FILE_TRANSFER_PROTOCOL/BurstReadFile": 2,
    "FILE_TRANSFER_PROTOCOL/CalcFileCRC32": 1,
    "FILE_TRANSFER_PROTOCOL/ListDirectory": 2,
    "FILE_TRANSFER_PROTOCOL/OpenFileRO": 2,
}
#: One station after the other reads logs, and on the ground only.
LOGS = {"LOG_REQUEST_DATA": 1, "LOG_REQUEST_LIST": 1}
#: What not even the commander's reaches the autopilot.
FORBIDDEN = {
    "COMMAND_LONG/MAV_CMD_SCRIPTING": 1,
    "DEVICE_OP_READ": 1,
    "SERIAL_CONTROL": 1,
    "SETUP_SIGNING": 1,
    "STATUSTEXT": 1,
    "SYSTEM_TIME": 1,
    "TUNNEL/200": 1,
}
#: What the companion answers of the commander's: rally points, read and written.
RALLY_POINTS = {
    "MISSION_CLEAR_ALL/RALLY": 1,
    "MISSION_COUNT/RALLY": 1,
    "MISSION_ITEM_INT/RALLY": 1,
    "MISSION_REQUEST_INT/RALLY": 1,
    "MISSION_REQUEST_LIST/RALLY": 1,
}
#: What a filter judges after the policy: feeds.
FEEDS = {"GPS_RTCM_DATA": 1}
LOCKED_WHILE_ARMED = {
    "LOG_ERASE": 1,
    "COMMAND_LONG/MAV_CMD_DO_FENCE_ENABLE": 2,
    "COMMAND_LONG/MAV_CMD_PREFLIGHT_STORAGE": 1,
    "FILE_TRANSFER_PROTOCOL/CreateFile (parameters)": 1,
    "PARAM_SET/FS_GCS_ENABLE": 1,
    "PARAM_SET/RTL_ALT": 1,
    "PARAM_SET/WPNAV_SPEED": 1,
    "SET_GPS_GLOBAL_ORIGIN": 1,
}
#: in flight the companion's matter first
JUDGED = {
    "COMMAND_INT/MAV_CMD_DO_REPOSITION": 2,
    "COMMAND_LONG/MAV_CMD_DO_CHANGE_SPEED": 1,
    "COMMAND_LONG/MAV_CMD_DO_PAUSE_CONTINUE": 1,
    "COMMAND_LONG/MAV_CMD_DO_SET_MISSION_CURRENT": 2,
    "COMMAND_LONG/MAV_CMD_DO_SET_MODE": 1,
    "MISSION_CLEAR_ALL/FENCE": 1,
    "MISSION_CLEAR_ALL/MISSION": 1,
    "MISSION_COUNT/FENCE": 1,
    "MISSION_COUNT/MISSION": 1,
    "MISSION_ITEM_INT/FENCE": 3,
    "MISSION_ITEM_INT/MISSION": 4,
}
FRAMES = 286


@pytest.fixture(scope="module")
def flight() -> list[Frame]:
    data, position, frames = LOG.read_bytes(), 0, []
    while position < len(data):
        start = position + 8  # behind the time
        signature = 13 if data[start] == 0xFD and data[start + 2] & 1 else 0
        position = start + data[start + 1] + (12 if data[start] == 0xFD else 8) + signature
        frame = parse_one(data[start:position])
        assert frame is not None
        frames.append(frame)
    assert len(frames) == FRAMES
    assert {frame.sysid for frame in frames} == {STATION}
    return frames


def view(commander: int | None, partner: int | None, phase: Phase, armed: bool) -> AuthorityView:
    lease = LeaseState.LOST if commander is None else LeaseState.TRANSFER if partner else LeaseState.HELD
    return AuthorityView(phase, commander, partner, 1, lease, armed)


OBSERVER_VIEWS = [
    view(commander, partner, phase, armed)
    for phase in Phase
    for armed in (False, True)
    for commander, partner in ((OTHER, None), (OTHER, STATION), (None, None))
]


def replay(flight: list[Frame], view: AuthorityView) -> list[Verdict]:
    return [judge(frame, StationIdentity(STATION), view, VEHICLE) for frame in flight]


def counted(verdicts: list[Verdict], action: Fate) -> dict[str, int]:
    return dict(Counter(verdict.what for verdict in verdicts if verdict.fate is action))


@pytest.mark.parametrize("view", OBSERVER_VIEWS)
def test_a_commanders_whole_flight_replayed_as_an_observer_changes_nothing(
    flight: list[Frame], view: AuthorityView
) -> None:
    verdicts = replay(flight, view)
    assert counted(verdicts, Fate.FORWARD) == (HARMLESS if view.armed else {**HARMLESS, **DEAR, **LOGS})
    tracker = FlushTracker(VEHICLE)
    for frame, verdict in zip(flight, verdicts, strict=True):
        tracker.saw(frame, verdict, STATION)
    assert [closing.what for closing in tracker.flush(STATION)] == ([] if view.armed else ["log download ended"])


@pytest.mark.parametrize("armed", [False, True])
def test_the_commander_itself_is_not_hindered(flight: list[Frame], armed: bool) -> None:
    verdicts = replay(flight, view(STATION, None, Phase.ON_MISSION, armed))
    refused = {**counted(verdicts, Fate.REFUSE), **counted(verdicts, Fate.DROP)}
    assert refused == {**FORBIDDEN, **({**LOCKED_WHILE_ARMED, **LOGS} if armed else {})}
    consumed = counted(verdicts, Fate.CONSUME)
    assert consumed == {**RALLY_POINTS, **JUDGED, **FEEDS}, "the companion passes the latter on when it has looked"
    assert sum(counted(verdicts, Fate.FORWARD).values()) == FRAMES - sum(refused.values()) - sum(consumed.values())


def test_the_flight_from_another_stations_link_is_no_ones(flight: list[Frame]) -> None:
    for frame in flight:
        assert judge(frame, StationIdentity(OTHER), OBSERVER_VIEWS[0], VEHICLE).fate is Fate.DROP


@pytest.mark.parametrize("cut", [1, 7, 64, 280, 4096])
def test_any_cut_of_the_stream_gives_the_same_flight(flight: list[Frame], cut: int) -> None:
    stream = b"".join(frame.raw for frame in flight)
    splitter = FrameSplitter()
    found = [frame for start in range(0, len(stream), cut) for frame in splitter.feed(stream[start : start + cut])]
    assert found == flight
