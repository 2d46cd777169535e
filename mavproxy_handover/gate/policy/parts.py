# SPDX-License-Identifier: GPL-3.0-or-later

"""The policy of messages that are judged by a part of their contents: opcode, payload type, mission type.

`*` is the row of every part without a row of its own; a table without `*` refuses those.

* File transfer is judged by opcode, because ArduPilot accepts missions and parameters as files; `files` judges the
  path. Only the commander may end a session. The autopilot itself closes a file that a reader leaves open.
* The same five messages write mission, fence and rally points. Only the commander may send them: a new plan contains
  its own fence and rally points. A type that does not exist is refused.
* The companion serves rally points itself, read and written. The autopilot's own list holds one point, the place that
  was chosen for a return, and no station's message reaches it. So clearing all three lists at once is handled like
  rally points; ArduPilot does not support it either.
"""

from __future__ import annotations

from typing import Final

from mavproxy_handover.gate.policy.access import ANY, Access, Rule, names
from mavproxy_handover.wire.ids import GUARD_STATUS_TUNNEL, LEASE_TUNNEL

__all__ = [
    "COMMAND_ACK_RULES",
    "FTP_RULES",
    "MISSION_READ_MESSAGES",
    "MISSION_READ_RULES",
    "MISSION_TYPES",
    "MISSION_TYPE_MESSAGES",
    "MISSION_TYPE_RULES",
    "TUNNEL_RULES",
]

TUNNEL_RULES: Final = (
    Rule(
        Access.NEVER,
        "lease and guard status pass between companion and autopilot only: from a station they are forged",
        (str(LEASE_TUNNEL), str(GUARD_STATUS_TUNNEL)),
    ),
    Rule(Access.MAINTENANCE, "carries contents that no table can judge", (ANY,)),
)

#: By the acknowledged command.
COMMAND_ACK_RULES: Final = (
    Rule(
        Access.CONTROL,
        "the answer to an operator-control request is the companion's",
        names("REQUEST_OPERATOR_CONTROL"),
    ),
    Rule(Access.STREAM, "the autopilot takes it for the next step of an accelerometer calibration", (ANY,)),
)

#: Messages that write items, with the kind of items in them.
MISSION_TYPE_MESSAGES: Final = names("""
    MISSION_COUNT MISSION_ITEM MISSION_ITEM_INT MISSION_WRITE_PARTIAL_LIST MISSION_CLEAR_ALL
""")

#: MAV_MISSION_TYPE by number.
MISSION_TYPES: Final = {0: "MISSION", 1: "FENCE", 2: "RALLY", 255: "ALL"}

MISSION_TYPE_RULES: Final = (
    Rule(Access.COMMAND, "writes the route", names("MISSION")),
    Rule(Access.COMMAND, "writes the fence, a limit that the autopilot keeps by itself", names("FENCE")),
    Rule(Access.RALLY_WRITE, "writes the rally points, of which a return chooses its place", names("RALLY")),
    Rule(Access.RALLY_WRITE, "clears all three at once, the rally points among them", names("ALL")),
)

#: Messages that read items, with the kind of items in them.
MISSION_READ_MESSAGES: Final = names("MISSION_REQUEST_LIST MISSION_REQUEST MISSION_REQUEST_INT MISSION_ACK")

MISSION_READ_RULES: Final = (
    Rule(Access.RALLY_READ, "asks for the rally points, or ends that: the companion's list", names("RALLY")),
    Rule(Access.READ, "asks for the mission or the fence, or ends that, and changes none", names("MISSION FENCE ALL")),
)

FTP_RULES: Final = (
    Rule(
        Access.BULK,
        "reads files and directories; for a second after each answer ArduPilot's streams have a quarter of their rates",
        names("None ListDirectory OpenFileRO ReadFile CalcFileCRC32 BurstReadFile ListDirectoryWithTime"),
    ),
    Rule(
        Access.COMMAND,
        "writes files; ArduPilot takes missions, fences and parameters through files too",
        names("CreateFile WriteFile RemoveFile CreateDirectory RemoveDirectory OpenFileWO TruncateFile Rename"),
    ),
    Rule(
        Access.COMMAND,
        "stations share one open file: to end it may end the commander's upload; an observer may end its own reading",
        names("TerminateSession ResetSessions"),
    ),
    Rule(Access.NEVER, "a server's answer, and no station is a server", names("Ack Nak")),
)
