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
4. `RefusalLimiter` keeps a storm of refused frames from becoming a storm of answers.

Sources: MAVLink command, mission, parameter, extended parameter and file-transfer protocols.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Hashable
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.gate.judge import Action, GateReason, Verdict
from mavproxy_handover.wire.frames import Frame, field_offset, target

__all__ = ["SILENT", "RefusalLimiter", "refusal"]

AUTOPILOT_COMPID: Final = 1

#: MAV_RESULT_NOT_IN_CONTROL, of the operator-control standard.
RESULT_NOT_IN_CONTROL: Final = 10

FTP_NAK: Final = 129
FTP_ERROR_UNKNOWN_COMMAND: Final = 7
FTP_ERROR_FILE_PROTECTED: Final = 9
FTP_PAYLOAD_BYTES: Final = 251

TEXT_LIMIT: Final = 50  #: characters of a STATUSTEXT

_RESULTS: Final = {
    GateReason.NOT_IN_CONTROL: RESULT_NOT_IN_CONTROL,
    GateReason.RATES_OF_COMMANDER: RESULT_NOT_IN_CONTROL,
    GateReason.MAINTENANCE_ONLY: mavlink.MAV_RESULT_DENIED,
    GateReason.UNKNOWN_COMMAND: mavlink.MAV_RESULT_UNSUPPORTED,
    GateReason.COMPANION_TARGET: mavlink.MAV_RESULT_UNSUPPORTED,
}

_WORDS: Final = {
    GateReason.NOT_IN_CONTROL: "not in control",
    GateReason.RATES_OF_COMMANDER: "not in control",
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
        "LOG_REQUEST_LIST",
        "LOG_REQUEST_DATA",
        "LOG_REQUEST_END",
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

_Builder = Callable[[Frame, Verdict], mavlink.MAVLink_message]


def _integer(frame: Frame, field: str, length: int) -> int:
    offset = field_offset(frame.msgid, field)
    return int.from_bytes(frame.payload[offset : offset + length], "little")


def _bytes(frame: Frame, field: str, length: int) -> bytes:
    offset = field_offset(frame.msgid, field)
    return frame.payload[offset : offset + length]


def _command_ack(frame: Frame, verdict: Verdict) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_command_ack_message(
        command=_integer(frame, "command", 2),
        result=_RESULTS.get(verdict.reason, mavlink.MAV_RESULT_DENIED),
        target_system=frame.sysid,
        target_component=frame.compid,
    )


def _mission_ack(frame: Frame, _verdict: Verdict) -> mavlink.MAVLink_message:
    typed = frame.msgid != mavlink.MAVLINK_MSG_ID_MISSION_SET_CURRENT
    return mavlink.MAVLink_mission_ack_message(
        target_system=frame.sysid,
        target_component=frame.compid,
        type=mavlink.MAV_MISSION_DENIED,
        mission_type=_integer(frame, "mission_type", 1) if typed else mavlink.MAV_MISSION_TYPE_MISSION,
    )


def _param_error(frame: Frame, _verdict: Verdict) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_param_error_message(
        target_system=frame.sysid,
        target_component=frame.compid,
        param_id=_bytes(frame, "param_id", 16),
        param_index=-1,
        error=mavlink.MAV_PARAM_ERROR_PERMISSION_DENIED,
    )


def _param_ext_ack(frame: Frame, _verdict: Verdict) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_param_ext_ack_message(
        param_id=_bytes(frame, "param_id", 16),
        param_value=_bytes(frame, "param_value", 128),
        param_type=_integer(frame, "param_type", 1),
        param_result=mavlink.PARAM_ACK_FAILED,
    )


def _ftp_nak(frame: Frame, verdict: Verdict) -> mavlink.MAVLink_message:
    request = _bytes(frame, "payload", FTP_PAYLOAD_BYTES)
    sequence = (int.from_bytes(request[0:2], "little") + 1) & 0xFFFF
    unknown = verdict.reason in (GateReason.UNKNOWN_COMMAND, GateReason.COMPANION_TARGET)
    answer = bytearray(FTP_PAYLOAD_BYTES)
    answer[0:2] = sequence.to_bytes(2, "little")
    answer[2] = request[2]  # session
    answer[3] = FTP_NAK
    answer[4] = 1  # size: the error code
    answer[5] = request[3]  # the opcode that is refused
    answer[8:12] = request[8:12]  # offset
    answer[12] = FTP_ERROR_UNKNOWN_COMMAND if unknown else FTP_ERROR_FILE_PROTECTED
    return mavlink.MAVLink_file_transfer_protocol_message(
        target_network=0,
        target_system=frame.sysid,
        target_component=frame.compid,
        payload=list(answer),
    )


def _text(_frame: Frame, verdict: Verdict) -> mavlink.MAVLink_message:
    why = _WORDS.get(verdict.reason, "refused")
    room = TEXT_LIMIT - len("Handover: : ") - len(why)
    text = f"Handover: {verdict.what[:room]}: {why}"
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
        by_name["PARAM_SET"] = _param_error
    return {msgid: by_name[cls.msgname] for msgid, cls in mavlink.mavlink_map.items() if cls.msgname in by_name}


_BUILDERS: Final = _builders()
_SILENT_IDS: Final = frozenset(msgid for msgid, cls in mavlink.mavlink_map.items() if cls.msgname in SILENT)


def refusal(frame: Frame, verdict: Verdict, own: mavlink.MAVLink) -> bytes | None:
    """The answer to a refused frame, ready to send to its sender, or None if there is none to give.

    `own` packs it: its `srcSystem` is the vehicle's system id; its sequence number goes up by one, and its
    `srcComponent` is the same afterwards as before. Signed if `own` signs.
    """
    if verdict.action is not Action.REFUSE or not frame.known or frame.msgid in _SILENT_IDS:
        return None
    build = _BUILDERS.get(frame.msgid)
    if build is None:
        # Programs ask every component for its parameters or version: no operator wants to read of each.
        if verdict.reason is GateReason.COMPANION_TARGET:
            return None
        build = _text
    message = build(frame, verdict)
    aim = target(frame)
    before = own.srcComponent
    own.srcComponent = aim[1] if aim is not None and aim[1] != 0 else AUTOPILOT_COMPID
    try:
        packed: bytes = message.pack(own)
    finally:
        own.srcComponent = before
    own.seq = (own.seq + 1) & 0xFF
    return packed


class RefusalLimiter:
    """At most `per_second` answers of one kind to one station in any second. `kept_back` counts the others.

    A kind is whatever the caller tells apart, and the caller keeps them few: a refused frame's message id.
    """

    def __init__(self, per_second: int = 5) -> None:
        if per_second < 1:
            raise ValueError(f"per_second = {per_second}: must be 1 or more")
        self.kept_back = 0
        self._per_second = per_second
        self._sent: dict[tuple[int, Hashable], deque[float]] = {}

    def allow(self, station_sysid: int, kind: Hashable, now: float) -> bool:
        """Whether an answer may go out now (monotonic seconds); if so, it is counted as sent."""
        sent = self._sent.setdefault((station_sysid, kind), deque(maxlen=self._per_second))
        if len(sent) == self._per_second and now - sent[0] < 1.0:
            self.kept_back += 1
            return False
        sent.append(now)
        return True
