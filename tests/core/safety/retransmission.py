# SPDX-License-Identifier: GPL-3.0-or-later

"""When ground station programs send a command again by themselves, if no answer arrives. Read in their public source.

A copy is `marked` if it says of itself that it is one (COMMAND_LONG.confirmation above 0). `pauses` are the shortest
and the longest pause (s) before the second copy, the third and so on. `endless`: the program goes on until it sees what
it wants; `pauses` are then those of one round.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

__all__ = ["QUIET_S", "QUIET_OF_MISSION_SET_CURRENT_S", "TIMERS", "Timer"]

#: what the rule waits (s), written out
QUIET_S: Final = 10.0
QUIET_OF_MISSION_SET_CURRENT_S: Final = 20.0


@dataclass(frozen=True, slots=True)
class Timer:
    """One program's retransmission of one kind of message."""

    program: str
    sends: str
    pauses: tuple[tuple[float, float], ...]
    source: str
    marked: bool = False
    endless: bool = False
    quiet_s: float = QUIET_S


#: each read of the port waits 1.2 s at most, and the time is looked at only between two reads
_MP = "Mission Planner"
_MP_SOURCE = "ExtLibs/ArduPilot/Mavlink/MAVLinkInterface.cs"
_QGC = "QGroundControl"
_SDK = "MAVSDK"
_SDK_MISSION = "cpp/src/mavsdk/core/mavlink_mission_transfer_client.cpp"

TIMERS: Final = (
    # 3,000 ms, looked at every 500 ms; commands that fly are sent once (`_shouldRetry`)
    Timer(_QGC, "COMMAND_LONG, COMMAND_INT", (), "src/Vehicle/MavCommandQueue.cc"),
    Timer(_QGC, "a command of the connection", ((3.0, 3.5), (0.5, 0.5)), "the same, 3 tries", marked=True),
    Timer(_QGC, "a COMMAND_INT with its timer started anew", ((3.0, 3.5),) * 2, "4.x, Vehicle.cc, 3 tries"),
    Timer("QGroundControl 3", "COMMAND_LONG", ((3.0, 3.0),) * 3, "src/Vehicle/Vehicle.cc, _sendMavCommandAgain"),
    Timer(_QGC, "a mode until it is flown", ((1.3, 1.3),) * 2, "FirmwarePlugin.cc, _setFlightModeAndValidate"),
    Timer(_QGC, "COMPONENT_ARM_DISARM in 3.5", ((3.0, 3.0),) * 2, "FirmwarePlugin.cc, _armVehicleAndValidate"),
    Timer(_QGC, "SET_MODE in 3.x", ((0.5, 0.5),) * 4, "Vehicle.cc, sendMessageMultiple"),
    Timer(_QGC, "MISSION_COUNT", ((1.5, 1.5),) * 6, "src/MissionManager/PlanManager.cc; a whole upload only once"),
    Timer(_SDK, "COMMAND_LONG, COMMAND_INT", ((0.5, 0.5),) * 3, "core/mavlink_command_sender.cpp; counter stays 0"),
    Timer(_SDK, "the same after IN_PROGRESS", ((3.0, 3.0), (0.5, 0.5), (0.5, 0.5)), "the same"),
    Timer(_SDK, "MISSION_SET_CURRENT", ((0.5, 0.5),) * 4, _SDK_MISSION, quiet_s=QUIET_OF_MISSION_SET_CURRENT_S),
    Timer(
        _SDK,
        "MISSION_SET_CURRENT, after each MISSION_CURRENT of another item",
        ((0.1, 2.0),),
        _SDK_MISSION,
        endless=True,
        quiet_s=QUIET_OF_MISSION_SET_CURRENT_S,
    ),
    Timer(_SDK, "MISSION_COUNT", ((0.5, 0.5),) * 4, _SDK_MISSION),
    Timer(_MP, "COMMAND_LONG", ((2.0, 3.2),) * 3, f"{_MP_SOURCE}, doCommandAsync", marked=True),
    Timer(_MP, "COMPONENT_ARM_DISARM", ((10.0, 11.2),) * 3, "the same", marked=True),
    Timer(_MP, "COMMAND_INT", ((2.0, 3.2),) * 3, f"{_MP_SOURCE}, doCommandIntAsync"),
    Timer(_MP, "DO_SET_MODE and SET_MODE twice", ((0.0, 0.1), (0.01, 0.1)), f"{_MP_SOURCE}, setMode"),
    Timer(_MP, "the same until the mode is flown", ((1.0, 1.3),) * 30, "GCSViews/FlightData.cs, the button Auto"),
    Timer(
        _MP,
        "MISSION_SET_CURRENT",
        ((2.0, 3.2),) * 5,
        f"{_MP_SOURCE}, setWPCurrentAsync",
        quiet_s=QUIET_OF_MISSION_SET_CURRENT_S,
    ),
    Timer(_MP, "MISSION_COUNT", ((0.7, 1.9),) * 3, f"{_MP_SOURCE}, setWPTotalAsync"),
    Timer("MAVProxy", "mode, guided, wp set, arm, wp load", (), "modules/mavproxy_mode.py and others: once each"),
    Timer("our station", "handover start, continue, resume", ((1.5, 1.6),) * 2, "gcs_module/commands.py"),
    Timer("a script", "a mode every second until it is flown", ((1.0, 1.1),), "as DroneKit's examples", endless=True),
)
