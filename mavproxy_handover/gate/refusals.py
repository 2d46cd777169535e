# SPDX-License-Identifier: GPL-3.0-or-later

"""Answers refused frames in the protocol of the sender.

A ground station program shows its operator what it understands: a command that is denied, a mission that is rejected, a
parameter that may not be set. If there is no answer, the program assumes a bad link and sends again. So each refusal is
answered in the form of its protocol. No protocol has room for the reason, so a text tells it (`refusal_text`). Rules:

1. An answer goes to the sender: its system id, its component.
2. An answer comes from the component that was addressed, because the sender waits for that; from the autopilot
   (component 1) if all components were addressed.
3. No answer goes to an answer, nor to messages that programs send on their own: `SILENT`. Every other refusal has an
   answer or a text. So has a frame that is dropped, if a person may have meant it (`drop_has_words`).
4. A result that the sender does not know is replaced by another one (`client_capabilities`).
5. The text comes from the companion, to the station that asked. For a frame that was addressed to the companion there
   is a text only if its protocol has no answer. For reads there is none: programs read from every component.
6. `RefusalLimiter` limits the answers to a storm of refused frames, `OncePerCause` the texts, `OncePerStream` the
   texts for frames that are dropped.

Sources: MAVLink command, mission, parameter, extended parameter and file-transfer protocols.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Hashable
from math import inf
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.gate.judge import Fate, GateReason, Verdict
from mavproxy_handover.gate.policy.access import Access
from mavproxy_handover.gate.policy.messages import MESSAGE_RULES
from mavproxy_handover.gate.refusal_text import by_itself
from mavproxy_handover.wire.file_transfer import answer as file_answer
from mavproxy_handover.wire.file_transfer import head_of
from mavproxy_handover.wire.frames import Frame, field_bytes, field_int, target
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID, FTP_NAK, NOT_IN_CONTROL
from mavproxy_handover.wire.message_ids import MESSAGE_IDS, message_ids

__all__ = [
    "CAUSE_S",
    "SILENT",
    "STREAM_AGAIN_S",
    "STREAM_PAUSE_S",
    "OncePerCause",
    "OncePerStream",
    "RefusalLimiter",
    "asked_component",
    "drop_has_words",
    "has_words",
    "line_of_text",
    "pack_as",
    "refusal",
]

FTP_ERROR_NO_SESSION: Final = 5
FTP_ERROR_UNKNOWN_COMMAND: Final = 7
FTP_ERROR_FILE_PROTECTED: Final = 9
FTP_ERROR_FILE_NOT_FOUND: Final = 10

#: the same cause is told at most once in this time (s)
CAUSE_S: Final = 10.0

_RESULTS: Final = {
    GateReason.NOT_IN_CONTROL: NOT_IN_CONTROL,
    GateReason.COMMANDERS_IN_FLIGHT: NOT_IN_CONTROL,
    GateReason.LOCKED_WHILE_ARMED: mavlink.MAV_RESULT_DENIED,
    GateReason.MAINTENANCE_ONLY: mavlink.MAV_RESULT_DENIED,
    GateReason.UNKNOWN_COMMAND: mavlink.MAV_RESULT_UNSUPPORTED,
    GateReason.COMPANION_TARGET: mavlink.MAV_RESULT_UNSUPPORTED,
    GateReason.MANAGER_TARGET: mavlink.MAV_RESULT_UNSUPPORTED,
    GateReason.SITUATION: mavlink.MAV_RESULT_TEMPORARILY_REJECTED,
    GateReason.REHEARSAL: mavlink.MAV_RESULT_TEMPORARILY_REJECTED,
}

_FTP_ERRORS: Final = {
    GateReason.UNKNOWN_COMMAND: FTP_ERROR_UNKNOWN_COMMAND,
    GateReason.COMPANION_TARGET: FTP_ERROR_UNKNOWN_COMMAND,
    GateReason.FILE_BUSY: FTP_ERROR_NO_SESSION,
    GateReason.ABSENT: FTP_ERROR_FILE_NOT_FOUND,
}

#: a stream is told again after such a pause, and otherwise after this time (s)
STREAM_PAUSE_S: Final = 30.0
STREAM_AGAIN_S: Final = 300.0

#: Refused or dropped without a text: programs send these on their own.
SILENT: Final = frozenset(
    {
        # answers
        *("COMMAND_ACK", "MISSION_ACK", "LOGGING_ACK", "TERRAIN_DATA"),
        # sent at intervals
        *("PING", "TIMESYNC", "HEARTBEAT"),
        # sent at each connection, and by some programs at intervals
        "REQUEST_DATA_STREAM",
    }
)

#: reasons to drop a frame that have a text. The others are told elsewhere (a stream that ran before, a target that the
#: situation forbids), or are no fault of a person (a frame in another's name, a frame for another vehicle)
_DROPS_TOLD: Final = frozenset(
    (
        GateReason.NEVER,
        GateReason.NOT_IN_CONTROL,
        GateReason.NOT_ARMED,
        GateReason.REHEARSAL,
        GateReason.COMPONENT,
        GateReason.COMPANION_TARGET,
        GateReason.NO_NUMBER,
        GateReason.TOO_MANY,
    )
)
#: messages of the handover, which stations and companion send on their own
_OURS: Final = frozenset((Access.TRANSFER, Access.LIVENESS))
#: messages of `Access.NEVER` that a person may send on purpose
_MEANT: Final = message_ids(*(name for rule in MESSAGE_RULES if rule.told for name in rule.names))

_LIST: Final = mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_LIST
_QUESTIONS: Final = (Access.READ, Access.BULK, Access.RALLY_READ)
_Builder = Callable[[Frame, Verdict], mavlink.MAVLink_message]


def _unchanged(result: int) -> int:
    return result


def _command_ack(frame: Frame, verdict: Verdict, known: Callable[[int], int] = _unchanged) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_command_ack_message(
        command=field_int(frame, "command"),
        result=known(_RESULTS.get(verdict.reason, mavlink.MAV_RESULT_DENIED)),
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
    """PARAM_ERROR for a parameter, or for the list of all parameters, which has no name."""
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
    error = _FTP_ERRORS.get(verdict.reason, FTP_ERROR_FILE_PROTECTED)
    return file_answer((frame.sysid, frame.compid), head_of(field_bytes(frame, "payload")), FTP_NAK, bytes((error,)))


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
    # PARAM_ERROR is new: a pymavlink without it sends only the text
    if hasattr(mavlink, "MAVLink_param_error_message"):
        by_name["PARAM_SET"] = by_name["PARAM_REQUEST_LIST"] = _param_error
    return {MESSAGE_IDS[name]: build for name, build in by_name.items()}


_BUILDERS: Final = _builders()
_SILENT_IDS: Final = message_ids(*SILENT)
_TOLD_AS_STREAM: Final = message_ids(*(name for rule in MESSAGE_RULES if rule.stream for name in rule.names))


def refusal(frame: Frame, verdict: Verdict, own: mavlink.MAVLink, known: Callable[[int], int]) -> list[bytes]:
    """The answer to a refused frame, ready to send to its sender. Empty if the protocol has no answer.

    `known` turns a MAV_RESULT into one that its sender knows (`ClientCapabilities.result`).

    `own` packs it: its `srcSystem` is the vehicle's system id; its sequence number goes up by one, and its
    `srcComponent` is the same afterwards as before. Signed if `own` signs.
    """
    build = _BUILDERS.get(frame.msgid)
    if build is None or verdict.fate is not Fate.REFUSE or not frame.known or frame.msgid in _SILENT_IDS:
        return []
    if frame.msgid == _LIST and verdict.reason is GateReason.COMPANION_TARGET:  # programs ask every component for it
        return []
    message = _command_ack(frame, verdict, known) if build is _command_ack else build(frame, verdict)
    return [pack_as(message, own, asked_component(frame))]


def asked_component(frame: Frame) -> int:
    """The component that a frame is addressed to, which answers it; the autopilot if it is addressed to all."""
    aim = target(frame)
    return aim[1] if aim is not None and aim[1] != 0 else AUTOPILOT_COMPID


def has_words(frame: Frame, verdict: Verdict) -> bool:
    """Whether the gate tells why a frame was refused. `command_passes` tells why the situation forbids a command."""
    if verdict.reason is GateReason.SITUATION:
        return False
    if verdict.fate is not Fate.REFUSE or not frame.known or frame.msgid in _SILENT_IDS:
        return False
    if verdict.reason is GateReason.COMPANION_TARGET:
        return frame.msgid not in _BUILDERS and verdict.access not in _QUESTIONS
    return not by_itself(frame, verdict.access)


def drop_has_words(frame: Frame, verdict: Verdict) -> bool:
    """Whether the gate tells why a frame was dropped. `stale_streams` tells of sticks of a station without control."""
    reason = verdict.reason
    if reason not in _DROPS_TOLD or not frame.known or frame.msgid in _SILENT_IDS or verdict.access in _OURS:
        return False
    if reason is GateReason.NEVER:
        return frame.msgid in _MEANT
    return reason is not GateReason.NOT_IN_CONTROL or frame.msgid not in _TOLD_AS_STREAM


def line_of_text(text: str, severity: int, own: mavlink.MAVLink) -> bytes:
    """A line of text in the autopilot's name that answers no question. `own`: as for `refusal`."""
    return pack_as(
        mavlink.MAVLink_statustext_message(severity=severity, text=text.encode("ascii")), own, AUTOPILOT_COMPID
    )


def pack_as(message: mavlink.MAVLink_message, own: mavlink.MAVLink, compid: int) -> bytes:
    """Pack an answer in the name of a component of the vehicle. `own`: as for `refusal`."""
    before = own.srcComponent
    own.srcComponent = compid
    try:
        packed: bytes = message.pack(own)
    finally:
        own.srcComponent = before
    own.seq = (own.seq + 1) & 0xFF
    return packed


class RefusalLimiter:
    """Allows at most `most` answers of one kind to one station in any `window_s`. `kept_back` counts the others.

    The caller defines the kinds, and must keep them few: for example the message id of a refused frame.
    """

    def __init__(self, most: int = 5, window_s: float = 1.0) -> None:
        if most < 1:
            raise ValueError(f"most = {most}: must be 1 or more")
        self.kept_back = 0
        self._most = most
        self._window_s = window_s
        self._sent: dict[tuple[int, Hashable], deque[float]] = {}

    def allow(self, station_sysid: int, kind: Hashable, now: float) -> bool:
        """Whether an answer may go out now (monotonic seconds). If so, it counts as sent."""
        sent = self._sent.setdefault((station_sysid, kind), deque(maxlen=self._most))
        if len(sent) == self._most and now - sent[0] < self._window_s:
            self.kept_back += 1
            return False
        sent.append(now)
        return True


class OncePerCause:
    """Tells each cause to a station once in `window_s`, and at most `most` causes in that time.

    The caller defines the causes. They may contain data that a station sent: memory is still bounded, and a station
    that sends a new cause each time is told `most` of them. A call costs two look-ups.
    """

    def __init__(self, window_s: float = CAUSE_S, most: int = 10) -> None:
        self._window_s = window_s
        self._most = most
        #: by station: cause -> when it was told, oldest first
        self._told: dict[int, dict[Hashable, float]] = {}

    def allow(self, station_sysid: int, cause: Hashable, now: float) -> bool:
        """Whether the cause may be told now (monotonic seconds). If so, it counts as told."""
        told = self._told.setdefault(station_sysid, {})
        at = told.get(cause)
        if at is not None and now - at < self._window_s:
            return False
        while told:
            oldest = next(iter(told))
            if now - told[oldest] < self._window_s:
                break
            del told[oldest]
        if len(told) >= self._most:
            return False
        told[cause] = now
        return True


class OncePerStream:
    """Tells a stream of frames once: again after a pause of `STREAM_PAUSE_S`, or after `STREAM_AGAIN_S`.

    The caller defines the streams. Memory is bounded, as that of `OncePerCause`. A call costs two look-ups.
    """

    def __init__(self, most: int = 32) -> None:
        self._most = most
        #: by station: stream -> when it was told, and when its last frame came
        self._streams: dict[int, dict[Hashable, tuple[float, float]]] = {}

    def allow(self, station_sysid: int, stream: Hashable, now: float) -> bool:
        """Whether the stream may be told now (monotonic seconds). If so, it counts as told."""
        streams = self._streams.setdefault(station_sysid, {})
        told_at, came_at = streams.get(stream, (-inf, -inf))
        if now - came_at < STREAM_PAUSE_S and now - told_at < STREAM_AGAIN_S:
            streams[stream] = told_at, now
            return False
        if stream not in streams and len(streams) >= self._most:
            for other in [other for other, (_told, came) in streams.items() if now - came >= STREAM_PAUSE_S]:
                del streams[other]
            if len(streams) >= self._most:
                return False
        streams[stream] = now, now
        return True
