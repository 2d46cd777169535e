# SPDX-License-Identifier: GPL-3.0-or-later

"""Numbers that several parts share: components within the vehicle, TUNNEL payload types, opcodes, commands and results.

Numbers of messages and enums that only one part needs are taken from the dialect there.
"""

from __future__ import annotations

from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

__all__ = [
    "AUTOPILOT_COMPID",
    "COMPANION_COMPID",
    "DOCTOR_COMPID",
    "EVERYBODY",
    "FTP_ACK",
    "FTP_BURST",
    "FTP_CHECKSUM",
    "FTP_CREATE",
    "FTP_NAK",
    "FTP_OPCODES",
    "FTP_OPEN_READ",
    "FTP_OPEN_WRITE",
    "FTP_READ",
    "FTP_RENAME",
    "FTP_RESET",
    "FTP_TERMINATE",
    "FTP_WRITE",
    "GUARD_STATUS_TUNNEL",
    "LANGUAGE_COMPID",
    "LEASE_TUNNEL",
    "LIMITS",
    "MISSION_START",
    "NOT_IN_CONTROL",
    "OPERATOR_CONTROL",
    "OUR_MESSAGES",
    "PAYLOAD_COMPIDS",
    "PROBE_COMPID",
    "RATES_COMPID",
    "AVAILABLE_MODES",
    "AVAILABLE_MODES_MONITOR",
    "STATION_COMPID",
    "STATION_COMPIDS",
    "TUNNEL_BYTES",
]

# ---- components ---------------------------------------------------------------------------------------------------

#: in a target field: all systems, or all components
EVERYBODY: Final = 0
AUTOPILOT_COMPID: Final[int] = mavlink.MAV_COMP_ID_AUTOPILOT1
#: the companion computer within the vehicle's system
COMPANION_COMPID: Final[int] = mavlink.MAV_COMP_ID_ONBOARD_COMPUTER
#: component that sends the messages of `handover.xml`. A program that does not know them does not count them, and would
#: see gaps in the companion's numbers
LANGUAGE_COMPID: Final[int] = mavlink.MAV_COMP_ID_PAIRING_MANAGER
#: the component of each kind of payload that answers requests of authority over it, and says which station has it
PAYLOAD_COMPIDS: Final[dict[str, int]] = {
    "gimbal": mavlink.MAV_COMP_ID_GIMBAL,
    "camera": mavlink.MAV_COMP_ID_CAMERA,
    "winch": mavlink.MAV_COMP_ID_WINCH,
}
#: component that sends link probes (see `link/timesync.py`)
PROBE_COMPID: Final[int] = mavlink.MAV_COMP_ID_UDP_BRIDGE
#: component with which the companion asks the autopilot for rates. MAVProxy prints every COMMAND_ACK except those to
#: this component. Commands typed on board come from component 191, and their answers are printed as before
RATES_COMPID: Final[int] = mavlink.MAV_COMP_ID_MAVCAN
#: component with which `handover doctor` asks, of the vehicle's system or a station's
DOCTOR_COMPID: Final[int] = mavlink.MAV_COMP_ID_ONBOARD_COMPUTER4
#: component of ground station programs
STATION_COMPID: Final[int] = mavlink.MAV_COMP_ID_MISSIONPLANNER

#: components that ground station programs send with: 0 pymavlink and DroneKit, 1 node-mavlink, 190 QGroundControl,
#: Mission Planner, MAVSDK and our own, 230 MAVProxy
STATION_COMPIDS: Final = frozenset((0, 1, STATION_COMPID, 230))

#: messages that are newer than the installed dialect, by number
AVAILABLE_MODES: Final = 435
AVAILABLE_MODES_MONITOR: Final = 437

# ---- messages, commands, results ----------------------------------------------------------------------------------

#: ids of the messages of `handover.xml`
OUR_MESSAGES: Final = range(47100, 47132)

#: TUNNEL payload types: the lease (companion to guard) and the guard's status (guard to companion)
LEASE_TUNNEL: Final = 47116
GUARD_STATUS_TUNNEL: Final = 47117
#: the payload field of a TUNNEL
TUNNEL_BYTES: Final = 128

#: START, which the companion executes itself on the ground
MISSION_START: Final[int] = mavlink.MAV_CMD_MISSION_START
#: the request of the operator-control standard
OPERATOR_CONTROL: Final[int] = mavlink.MAV_CMD_REQUEST_OPERATOR_CONTROL
#: the MAV_RESULT of the operator-control standard
NOT_IN_CONTROL: Final[int] = mavlink.MAV_RESULT_NOT_IN_CONTROL

#: HANDOVER_LIMIT by number, with the names of the configuration
LIMITS: Final[dict[int, str]] = {
    mavlink.HANDOVER_LIMIT_ENERGY: "energy",
    mavlink.HANDOVER_LIMIT_FENCE: "fence",
    mavlink.HANDOVER_LIMIT_COVERAGE: "coverage",
}

# ---- file transfer (MAVLink file transfer protocol, FtpOpcode) -----------------------------------------------------

FTP_TERMINATE: Final = 1
FTP_RESET: Final = 2
FTP_OPEN_READ: Final = 4
FTP_READ: Final = 5
FTP_CREATE: Final = 6
FTP_WRITE: Final = 7
FTP_OPEN_WRITE: Final = 11
FTP_RENAME: Final = 13
FTP_CHECKSUM: Final = 14
FTP_BURST: Final = 15
FTP_ACK: Final = 128
FTP_NAK: Final = 129

#: every opcode, and its name
FTP_OPCODES: Final = {
    0: "None",
    FTP_TERMINATE: "TerminateSession",
    FTP_RESET: "ResetSessions",
    3: "ListDirectory",
    FTP_OPEN_READ: "OpenFileRO",
    FTP_READ: "ReadFile",
    FTP_CREATE: "CreateFile",
    FTP_WRITE: "WriteFile",
    8: "RemoveFile",
    9: "CreateDirectory",
    10: "RemoveDirectory",
    FTP_OPEN_WRITE: "OpenFileWO",
    12: "TruncateFile",
    FTP_RENAME: "Rename",
    FTP_CHECKSUM: "CalcFileCRC32",
    FTP_BURST: "BurstReadFile",
    16: "ListDirectoryWithTime",
    FTP_ACK: "Ack",
    FTP_NAK: "Nak",
}
