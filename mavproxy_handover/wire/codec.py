# SPDX-License-Identifier: GPL-3.0-or-later

"""Translates between the rules' messages and MAVLink messages.

`decode` accepts every frame. It returns None for a frame that is not one of our messages, or that has invalid values.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.messages import (
    Connect,
    ConnectAck,
    ConnectHandover,
    CrossingKey,
    DisconnectHandover,
    DroneConnected,
    HandoverAhead,
    HandoverRequest,
    HandoverResult,
    Message,
    OkAhead,
    OkHandover,
    OnHandover,
    TransferKey,
    TransferMessage,
)
from mavproxy_handover.core.common.model import Consent, Outcome, Reason
from mavproxy_handover.core.common.never import assert_never

__all__ = ["AircraftState", "decode", "decode_bytes", "encode", "name_of", "pack", "values_of"]

_RELAY = mavlink.HANDOVER_FLAGS_RELAY
_RELAYED = mavlink.HANDOVER_FLAGS_RELAYED
#: the longest name of an operator in CONNECT_ACK
_OPERATOR_BYTES = 30
_ACCEPTED = mavlink.HANDOVER_CONNECT_RESULT_ACCEPTED
_VERSION_DIFFERS = mavlink.HANDOVER_CONNECT_RESULT_VERSION_DIFFERS
_UNMANNED = mavlink.HANDOVER_CONNECT_RESULT_UNMANNED
_NO_DIGEST = bytes(32)
_MOST_S = 0xFFFF


@dataclass(frozen=True, slots=True)
class AircraftState:
    """State of the aircraft in HANDOVER_REQUEST, in MAVLink's units (degE7, mm, cdeg, m/s, %)."""

    lat: int = 0
    lon: int = 0
    relative_alt: int = 0
    heading: int = 0xFFFF
    groundspeed: float = 0.0
    battery_remaining: int = -1
    waypoint: int = 0
    custom_mode: int = 0


def name_of(message: Message) -> str:
    """The MAVLink name of a message, for journals and consoles."""
    return _NAMES[type(message)]


def values_of(message: TransferMessage) -> dict[str, Any]:
    """Values of a transfer's message for the journal, which leaves out None."""
    return {
        "name": name_of(message),
        "handover_id": message.key.handover_id,
        "epoch": message.key.epoch,
        "relayed": getattr(message, "relayed", False) or None,
        "consent": message.consent.name.lower() if isinstance(message, (OnHandover, OkHandover)) else None,
    }


_NAMES: dict[type, str] = {
    Connect: "CONNECT",
    ConnectAck: "CONNECT_ACK",
    HandoverAhead: "HANDOVER_AHEAD",
    OkAhead: "OK_AHEAD",
    HandoverRequest: "HANDOVER_REQUEST",
    OnHandover: "ON_HANDOVER",
    OkHandover: "OK_HANDOVER",
    ConnectHandover: "CONNECT_HANDOVER",
    DroneConnected: "DRONE_CONNECTED",
    DisconnectHandover: "DISCONNECT_HANDOVER",
    HandoverResult: "HANDOVER_RESULT",
}


def encode(
    message: Message, target: tuple[int, int], vehicle: int, aircraft: AircraftState | None = None
) -> mavlink.MAVLink_message:
    """The MAVLink message for `message`, addressed to `target` (system, component)."""
    match message:
        case Connect():
            return mavlink.MAVLink_connect_message(*target, vehicle, *_state(message))
        case ConnectAck():
            manned = _ACCEPTED if message.manned else _UNMANNED
            result = manned if message.accepted else _VERSION_DIFFERS
            operator = _cut(message.operator)
            return mavlink.MAVLink_connect_ack_message(*target, vehicle, *_state(message), result, operator)
        case HandoverAhead():
            said = (0 if each is None else 1 + each for each in (message.commander, message.partner))
            in_s = min(_MOST_S, max(0, round(message.in_s)))
            return mavlink.MAVLink_handover_ahead_message(*target, vehicle, *_crossing(message.key), in_s, *said)
        case OkAhead():
            return mavlink.MAVLink_ok_ahead_message(*target, vehicle, *_crossing(message.key), message.consent)
        case _:
            key = message.key
            head = (*target, vehicle, key.from_station, key.to_station, key.handover_id, key.epoch)
            return _encode_step(message, head, aircraft or AircraftState())


def _cut(operator: str) -> bytes:
    """An operator's name as it travels: whole letters only."""
    return operator.encode("utf-8")[:_OPERATOR_BYTES].decode("utf-8", "ignore").encode("utf-8")


def _plain(operator: bytes) -> str:
    """An operator's name as it came, for journals: printable. pymavlink itself reads ASCII only."""
    name = operator.partition(b"\0")[0].decode("utf-8", "replace")
    return "".join(letter if letter.isprintable() else "?" for letter in name).strip()


def _crossing(key: CrossingKey) -> tuple[int, ...]:
    return key.from_station, key.to_station, key.crossing, key.epoch


def _state(message: Connect | ConnectAck) -> tuple[Any, ...]:
    return (
        message.station,
        message.protocol_version,
        message.nonce,
        message.epoch,
        message.commander or 0,
        message.name.encode("utf-8")[:20],
        list(message.mission_digest or _NO_DIGEST),
    )


def _encode_step(message: TransferMessage, head: tuple[int, ...], aircraft: AircraftState) -> mavlink.MAVLink_message:
    match message:
        case HandoverRequest():
            return mavlink.MAVLink_handover_request_message(
                *head,
                message.reason,
                aircraft.lat,
                aircraft.lon,
                aircraft.relative_alt,
                aircraft.heading,
                aircraft.groundspeed,
                aircraft.battery_remaining,
                aircraft.waypoint,
                aircraft.custom_mode,
                message.crossing,
            )
        case OnHandover():
            said = message.consent, message.reason, _flags(message), message.crossing
            return mavlink.MAVLink_on_handover_message(*head, *said)
        case OkHandover():
            return mavlink.MAVLink_ok_handover_message(*head, message.consent, message.reason)
        case ConnectHandover():
            return mavlink.MAVLink_connect_handover_message(*head)
        case DroneConnected():
            return mavlink.MAVLink_drone_connected_message(*head, _flags(message))
        case DisconnectHandover():
            return mavlink.MAVLink_disconnect_handover_message(*head)
        case HandoverResult():
            commander = message.commander or 0
            return mavlink.MAVLink_handover_result_message(*head, commander, message.outcome, message.reason)
        case _:
            assert_never(message)


def _flags(message: OnHandover | DroneConnected) -> int:
    return (_RELAY if message.relay else 0) | (_RELAYED if message.relayed else 0)


def decode(m: Any) -> Message | None:
    """The rules' message in a decoded MAVLink message, or None if there is none."""
    try:
        return _decode(m)
    except ValueError:  # a value outside its enum
        return None


def _decode(m: Any) -> Message | None:
    kind = m.get_msgId()
    if kind in (mavlink.MAVLINK_MSG_ID_CONNECT, mavlink.MAVLINK_MSG_ID_CONNECT_ACK):
        digest = bytes(m.mission_digest)
        common = (
            m.station,
            m.protocol_version,
            m.nonce,
            m.epoch,
            m.commander or None,
            m.name,
            b"" if digest == _NO_DIGEST else digest,
        )
        if kind == mavlink.MAVLINK_MSG_ID_CONNECT:
            return Connect(*common)
        accepted, manned = m.result in (_ACCEPTED, _UNMANNED), m.result != _UNMANNED
        return ConnectAck(*common, accepted, manned, _plain(m._operator_raw))
    if kind in (mavlink.MAVLINK_MSG_ID_HANDOVER_AHEAD, mavlink.MAVLINK_MSG_ID_OK_AHEAD):
        border = CrossingKey(m.from_station, m.to_station, m.crossing, m.epoch)
        if kind == mavlink.MAVLINK_MSG_ID_OK_AHEAD:
            return OkAhead(border, Consent(m.consent))
        commander, partner = (Consent(each - 1) if each else None for each in (m.commander, m.partner))
        return HandoverAhead(border, float(m.in_s), commander, partner)
    if not mavlink.MAVLINK_MSG_ID_HANDOVER_REQUEST <= kind <= mavlink.MAVLINK_MSG_ID_HANDOVER_RESULT:
        return None
    key = TransferKey(m.from_station, m.to_station, m.handover_id, m.epoch)
    if kind == mavlink.MAVLINK_MSG_ID_HANDOVER_REQUEST:
        return HandoverRequest(key, Reason(m.reason), m.crossing)
    if kind == mavlink.MAVLINK_MSG_ID_ON_HANDOVER:
        flags = m.flags
        passed_on = {"relay": bool(flags & _RELAY), "relayed": bool(flags & _RELAYED)}
        return OnHandover(key, Consent(m.consent), Reason(m.reason), **passed_on, crossing=m.crossing)
    if kind == mavlink.MAVLINK_MSG_ID_OK_HANDOVER:
        return OkHandover(key, Consent(m.consent), Reason(m.reason))
    if kind == mavlink.MAVLINK_MSG_ID_CONNECT_HANDOVER:
        return ConnectHandover(key)
    if kind == mavlink.MAVLINK_MSG_ID_DRONE_CONNECTED:
        return DroneConnected(key, relay=bool(m.flags & _RELAY), relayed=bool(m.flags & _RELAYED))
    if kind == mavlink.MAVLINK_MSG_ID_DISCONNECT_HANDOVER:
        return DisconnectHandover(key)
    return HandoverResult(key, m.commander or None, Outcome(m.outcome), Reason(m.reason))


_PARSER = mavlink.MAVLink(None)


def decode_bytes(raw: bytes) -> Any | None:
    """Decode the MAVLink message of one complete frame whose CRC is checked; None if that fails."""
    try:
        return _PARSER.decode(bytearray(raw))
    except Exception:  # pymavlink raises its own error and, on odd lengths, struct.error
        return None


def pack(message: Any, own: mavlink.MAVLink) -> bytes:
    """Pack `message` as `own` sends it, and increment the sequence number, which pymavlink leaves to its caller."""
    data = bytes(message.pack(own))
    own.seq = (own.seq + 1) & 0xFF
    return data
