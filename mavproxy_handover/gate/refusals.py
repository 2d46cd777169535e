# SPDX-License-Identifier: GPL-3.0-or-later

"""Answers to refused frames, in the asker's own protocol.

A ground station program shows an operator what it understands: a command that is denied, a mission that is
rejected, a parameter that may not be set. Silence it takes for a bad link, and sends again. So each refusal is
answered in the form of its protocol; where there is none, by a line of text. Rules:

1. An answer goes to the sender: its system id, its component.
2. An answer comes from the component that was addressed, because that is where the asker waits for it; from the
   autopilot (component 1) if everybody was addressed.
3. No answer to an answer, and none to what programs repeat on their own, of which a line of text each time
   would only annoy: `SILENT`.
4. PARAM_ERROR is young, and few programs show it: a line of text goes with it.
5. `RefusalLimiter` keeps a storm of refused frames from becoming a storm of answers.

Sources: MAVLink command, mission, parameter, extended parameter and file-transfer protocols.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Callable, Hashable
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.gate.judge import Fate, GateReason, Verdict
from mavproxy_handover.wire.frames import Frame, field_bytes, field_int, target
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID, FTP_NAK, NOT_IN_CONTROL

__all__ = ["SILENT", "RefusalLimiter", "line_of_text", "refusal"]

FTP_ERROR_NO_SESSION: Final = 5
FTP_ERROR_UNKNOWN_COMMAND: Final = 7
FTP_ERROR_FILE_PROTECTED: Final = 9

#: Sequence number, session, opcode, (size, requested opcode, burst, padding), offset.
_FTP_REQUEST: Final = struct.Struct("<HBB4x4s")
#: Sequence number, session, opcode, size (of the error), the opcode that is refused, (burst, padding), offset, error.
_FTP_ANSWER: Final = struct.Struct("<HBBBB2x4sB")

TEXT_LIMIT: Final = 50  #: characters of a STATUSTEXT

_RESULTS: Final = {
    GateReason.NOT_IN_CONTROL: NOT_IN_CONTROL,
    GateReason.COMMANDERS_IN_FLIGHT: NOT_IN_CONTROL,
    GateReason.LOCKED_WHILE_ARMED: mavlink.MAV_RESULT_DENIED,
    GateReason.MAINTENANCE_ONLY: mavlink.MAV_RESULT_DENIED,
    GateReason.UNKNOWN_COMMAND: mavlink.MAV_RESULT_UNSUPPORTED,
    GateReason.COMPANION_TARGET: mavlink.MAV_RESULT_UNSUPPORTED,
    GateReason.SITUATION: mavlink.MAV_RESULT_TEMPORARILY_REJECTED,
}

_FTP_ERRORS: Final = {
    GateReason.UNKNOWN_COMMAND: FTP_ERROR_UNKNOWN_COMMAND,
    GateReason.COMPANION_TARGET: FTP_ERROR_UNKNOWN_COMMAND,
    GateReason.FILE_BUSY: FTP_ERROR_NO_SESSION,
}

_WORDS: Final = {
    GateReason.NOT_IN_CONTROL: "not in control",
    GateReason.COMMANDERS_IN_FLIGHT: "not in flight",
    GateReason.LOCKED_WHILE_ARMED: "locked while armed",
    GateReason.MAINTENANCE_ONLY: "maintenance only",
}

#: Refused without a word: programs send these again and again, unasked, or they are answers themselves.
SILENT: Final = frozenset(
    {
        "COMMAND_ACK",
        "MISSION_ACK",
        "LOGGING_ACK",
        "PING",
        "REQUEST_DATA_STREAM",
        "SERIAL_CONTROL",
        "CAN_FRAME",
        "CANFD_FRAME",
        "TUNNEL",
        "V2_EXTENSION",
        "REMOTE_LOG_BLOCK_STATUS",
        "HIL_STATE",
        "HIL_CONTROLS",
        "HIL_RC_INPUTS_RAW",
        "HIL_ACTUATOR_CONTROLS",
        "HIL_SENSOR",
        "HIL_GPS",
        "HIL_OPTICAL_FLOW",
        "HIL_STATE_QUATERNION",
    }
)

_LIST: Final = mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_LIST
_Builder = Callable[[Frame, Verdict], mavlink.MAVLink_message]


def _command_ack(frame: Frame, verdict: Verdict) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_command_ack_message(
        command=field_int(frame, "command"),
        result=_RESULTS.get(verdict.reason, mavlink.MAV_RESULT_DENIED),
        target_system=frame.sysid,
        target_component=frame.compid,
    )


def _mission_ack(frame: Frame, verdict: Verdict) -> mavlink.MAVLink_message:
    typed = frame.msgid != mavlink.MAVLINK_MSG_ID_MISSION_SET_CURRENT
    unknown = verdict.reason is GateReason.UNKNOWN_COMMAND
    return mavlink.MAVLink_mission_ack_message(
        target_system=frame.sysid,
        target_component=frame.compid,
        type=mavlink.MAV_MISSION_UNSUPPORTED if unknown else mavlink.MAV_MISSION_DENIED,
        mission_type=field_int(frame, "mission_type") if typed else mavlink.MAV_MISSION_TYPE_MISSION,
    )


def _param_error(frame: Frame, _verdict: Verdict) -> mavlink.MAVLink_message:
    """Of a parameter, or of the list of all of them, which has no name."""
    listed = frame.msgid == _LIST
    return mavlink.MAVLink_param_error_message(
        target_system=frame.sysid,
        target_component=frame.compid,
        param_id=b"" if listed else field_bytes(frame, "param_id"),
        param_index=-1,
        error=mavlink.MAV_PARAM_ERROR_PERMISSION_DENIED,
    )


def _param_ext_ack(frame: Frame, _verdict: Verdict) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_param_ext_ack_message(
        param_id=field_bytes(frame, "param_id"),
        param_value=field_bytes(frame, "param_value"),
        param_type=field_int(frame, "param_type"),
        param_result=mavlink.PARAM_ACK_FAILED,
    )


def _ftp_nak(frame: Frame, verdict: Verdict) -> mavlink.MAVLink_message:
    request = field_bytes(frame, "payload")
    sequence, session, opcode, offset = _FTP_REQUEST.unpack_from(request)
    error = _FTP_ERRORS.get(verdict.reason, FTP_ERROR_FILE_PROTECTED)
    answer = _FTP_ANSWER.pack((sequence + 1) & 0xFFFF, session, FTP_NAK, 1, opcode, offset, error)
    return mavlink.MAVLink_file_transfer_protocol_message(
        target_network=0,
        target_system=frame.sysid,
        target_component=frame.compid,
        payload=list(answer.ljust(len(request), b"\0")),
    )


def _text(_frame: Frame, verdict: Verdict) -> mavlink.MAVLink_message:
    why = _WORDS.get(verdict.reason, "refused")
    room = TEXT_LIMIT - len("Handover: : ") - len(why)
    part = verdict.what.rpartition("/")[2]  # of PARAM_SET/NAME the name: an operator knows what was typed
    text = f"Handover: {part[:room]}: {why}"
    return mavlink.MAVLink_statustext_message(
        severity=mavlink.MAV_SEVERITY_WARNING, text=text.encode("ascii", "replace")
    )


def _builders() -> dict[int, _Builder]:
    by_name: dict[str, _Builder] = {
        "COMMAND_LONG": _command_ack,
        "COMMAND_INT": _command_ack,
        "MISSION_COUNT": _mission_ack,
        "MISSION_ITEM": _mission_ack,
        "MISSION_ITEM_INT": _mission_ack,
        "MISSION_WRITE_PARTIAL_LIST": _mission_ack,
        "MISSION_CLEAR_ALL": _mission_ack,
        "MISSION_SET_CURRENT": _mission_ack,
        "PARAM_EXT_SET": _param_ext_ack,
        "FILE_TRANSFER_PROTOCOL": _ftp_nak,
    }
    # PARAM_ERROR is young: with a pymavlink that lacks it, a line of text has to do.
    if hasattr(mavlink, "MAVLink_param_error_message"):
        by_name["PARAM_SET"] = by_name["PARAM_REQUEST_LIST"] = _param_error
    return {msgid: by_name[cls.msgname] for msgid, cls in mavlink.mavlink_map.items() if cls.msgname in by_name}


_BUILDERS: Final = _builders()
_SILENT_IDS: Final = frozenset(msgid for msgid, cls in mavlink.mavlink_map.items() if cls.msgname in SILENT)


def refusal(frame: Frame, verdict: Verdict, own: mavlink.MAVLink, *, words: bool = True) -> list[bytes]:
    """The answers to a refused frame, each a frame ready to send to its sender; none if there is none to give.

    Without `words` none of them is a line of text.

    `own` packs them: its `srcSystem` is the vehicle's system id; its sequence number goes up by one for each, and
    its `srcComponent` is the same afterwards as before. Signed if `own` signs.
    """
    if verdict.fate is not Fate.REFUSE or not frame.known or frame.msgid in _SILENT_IDS:
        return []
    build = _BUILDERS.get(frame.msgid)
    # Programs ask every component for its parameters or version: no operator wants to read of each.
    if (build is None or frame.msgid == _LIST) and verdict.reason is GateReason.COMPANION_TARGET:
        return []
    messages = [] if build is None else [build(frame, verdict)]
    if words and (build is None or (build is _param_error and verdict.reason is not GateReason.COMPANION_TARGET)):
        messages.append(_text(frame, verdict))
    aim = target(frame)
    compid = aim[1] if aim is not None and aim[1] != 0 else AUTOPILOT_COMPID
    return [_pack(message, own, compid) for message in messages]


def line_of_text(text: str, severity: int, own: mavlink.MAVLink) -> bytes:
    """A line of text in the autopilot's name, where nothing that was asked is answered. `own`: as for `refusal`."""
    return _pack(
        mavlink.MAVLink_statustext_message(severity=severity, text=text.encode("ascii")), own, AUTOPILOT_COMPID
    )


def _pack(message: mavlink.MAVLink_message, own: mavlink.MAVLink, compid: int) -> bytes:
    before = own.srcComponent
    own.srcComponent = compid
    try:
        packed: bytes = message.pack(own)
    finally:
        own.srcComponent = before
    own.seq = (own.seq + 1) & 0xFF
    return packed


class RefusalLimiter:
    """At most `most` answers of one kind to one station in any `window_s`. `kept_back` counts the others.

    A kind is whatever the caller tells apart, and the caller keeps them few: a refused frame's message id.
    """

    def __init__(self, most: int = 5, window_s: float = 1.0) -> None:
        if most < 1:
            raise ValueError(f"most = {most}: must be 1 or more")
        self.kept_back = 0
        self._most = most
        self._window_s = window_s
        self._sent: dict[tuple[int, Hashable], deque[float]] = {}

    def allow(self, station_sysid: int, kind: Hashable, now: float) -> bool:
        """Whether an answer may go out now (monotonic seconds); if so, it is counted as sent."""
        sent = self._sent.setdefault((station_sysid, kind), deque(maxlen=self._most))
        if len(sent) == self._most and now - sent[0] < self._window_s:
            self.kept_back += 1
            return False
        sent.append(now)
        return True
