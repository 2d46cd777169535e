# SPDX-License-Identifier: GPL-3.0-or-later

"""Between the rules' messages and frames: nothing is lost on the way, and nothing that is none of ours gets in."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
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
)
from mavproxy_handover.core.common.model import Consent, Outcome, Reason
from mavproxy_handover.wire import codec
from mavproxy_handover.wire.codec import AircraftState
from mavproxy_handover.wire.frames import parse_one

KEY = TransferKey(251, 252, 513, 67305985)
BORDER = CrossingKey(251, 252, 258, 67305985)
DIGEST = bytes(range(1, 33))

#: name on the wire -> id, and the message. Ids written out (docs/architecture.md, "A transfer").
MESSAGES: dict[str, tuple[int, Message]] = {
    "CONNECT": (47100, Connect(251, 1, 0xDEADBEEF, 7, 252, "drone-1", DIGEST)),
    "CONNECT_ACK": (47101, ConnectAck(252, 1, 1, 7, None, "GCSB", b"", accepted=False)),
    "HANDOVER_REQUEST": (47106, HandoverRequest(KEY, Reason.ZONE, 515)),
    "ON_HANDOVER": (47107, OnHandover(KEY, Consent.DENIED, Reason.OPERATOR, relay=True, relayed=False, crossing=770)),
    "OK_HANDOVER": (47108, OkHandover(KEY, Consent.WAITING, Reason.NONE)),
    "CONNECT_HANDOVER": (47109, ConnectHandover(KEY)),
    "DRONE_CONNECTED": (47110, DroneConnected(KEY, relay=False, relayed=True)),
    "DISCONNECT_HANDOVER": (47111, DisconnectHandover(KEY)),
    "HANDOVER_AHEAD": (47114, HandoverAhead(BORDER, 600.0, None, Consent.DENIED)),
    "OK_AHEAD": (47115, OkAhead(BORDER, Consent.WAITING)),
    "HANDOVER_RESULT": (47112, HandoverResult(KEY, 252, Outcome.COMMITTED, Reason.RELEASE_TIMEOUT)),
}


def over_the_wire(message: Message, **arguments: Any) -> Any:
    """The MAVLink message at the other end."""
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=191)
    raw = codec.pack(codec.encode(message, (251, 190), 1, **arguments), sender)
    assert parse_one(raw) is not None
    received = codec.decode_bytes(raw)
    assert received is not None
    return received


@pytest.mark.parametrize("name", list(MESSAGES))
def test_every_message_comes_back_as_it_went(name: str) -> None:
    msgid, message = MESSAGES[name]
    received = over_the_wire(message)
    assert (received.get_msgId(), received.get_type(), codec.name_of(message)) == (msgid, name, name)
    assert (received.target_system, received.target_component, received.vehicle) == (251, 190, 1)
    assert codec.decode(received) == message


def test_every_kind_of_message_is_covered_here() -> None:
    assert {type(message) for _msgid, message in MESSAGES.values()} == set(Message.__args__)


@pytest.mark.parametrize("consent", list(Consent))
@pytest.mark.parametrize("reason", list(Reason))
def test_every_consent_and_reason_fits(consent: Consent, reason: Reason) -> None:
    for message in (OnHandover(KEY, consent, reason), OkHandover(KEY, consent, reason)):
        assert codec.decode(over_the_wire(message)) == message


@pytest.mark.parametrize("relay", [True, False])
@pytest.mark.parametrize("relayed", [True, False])
def test_relay_flags_are_told_apart(relay: bool, relayed: bool) -> None:
    for message in (OnHandover(KEY, relay=relay, relayed=relayed), DroneConnected(KEY, relay, relayed)):
        assert codec.decode(over_the_wire(message)) == message


sysids = st.integers(1, 255)
keys = st.builds(TransferKey, sysids, sysids, st.integers(0, 0xFFFF), st.integers(0, 0xFFFFFFFF))
names = st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=20)
digests = st.just(b"") | st.binary(min_size=32, max_size=32).filter(any)
common = (sysids, st.integers(0, 0xFFFF), st.integers(0, 0xFFFFFFFF), st.integers(0, 0xFFFFFFFF), st.none() | sysids)
any_message = st.one_of(
    st.builds(Connect, *common, names, digests),
    st.builds(ConnectAck, *common, names, digests, st.booleans()),
    st.builds(HandoverRequest, keys, st.sampled_from(Reason)),
    st.builds(OnHandover, keys, st.sampled_from(Consent), st.sampled_from(Reason), st.booleans(), st.booleans()),
    st.builds(OkHandover, keys, st.sampled_from(Consent), st.sampled_from(Reason)),
    st.builds(ConnectHandover, keys),
    st.builds(DroneConnected, keys, st.booleans(), st.booleans()),
    st.builds(DisconnectHandover, keys),
    st.builds(HandoverResult, keys, st.none() | sysids, st.sampled_from(Outcome), st.sampled_from(Reason)),
)


@settings(deadline=None)
@given(any_message)
def test_any_message_comes_back_as_it_went(message: Message) -> None:
    assert codec.decode(over_the_wire(message)) == message


# ---- what must not get in -----------------------------------------------------------------------------------------

OUTSIDE: dict[str, Any] = {
    "consent of ON_HANDOVER": mavlink.MAVLink_on_handover_message(1, 191, 1, 251, 252, 1, 1, 3, 0, 0),
    "reason of ON_HANDOVER": mavlink.MAVLink_on_handover_message(1, 191, 1, 251, 252, 1, 1, 0, 255, 0),
    "consent of OK_HANDOVER": mavlink.MAVLink_ok_handover_message(1, 191, 1, 251, 252, 1, 1, 255, 0),
    "reason of OK_HANDOVER": mavlink.MAVLink_ok_handover_message(1, 191, 1, 251, 252, 1, 1, 0, 99),
    "reason of HANDOVER_REQUEST": mavlink.MAVLink_handover_request_message(
        1, 191, 1, 251, 252, 1, 1, 200, 0, 0, 0, 0, 0.0, 0, 0, 0
    ),
    "outcome of HANDOVER_RESULT": mavlink.MAVLink_handover_result_message(1, 191, 1, 251, 252, 1, 1, 252, 2, 0),
    "reason of HANDOVER_RESULT": mavlink.MAVLink_handover_result_message(1, 191, 1, 251, 252, 1, 1, 252, 0, 99),
}


@pytest.mark.parametrize("what", list(OUTSIDE))
def test_a_value_outside_its_enum_is_no_message(what: str) -> None:
    raw = OUTSIDE[what].pack(mavlink.MAVLink(None, srcSystem=252, srcComponent=190))
    received = codec.decode_bytes(bytes(raw))
    assert received is not None
    assert codec.decode(received) is None


@pytest.mark.parametrize(
    "message",
    [
        mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3),
        mavlink.MAVLink_mission_package_message(1, 191, 100, [0] * 32, b"x"),
        mavlink.MAVLink_authority_status_message(0, 0, 0, 0, 0, 0, 3, 0, 0),
        mavlink.MAVLink_command_long_message(1, 1, 300, 0, 0, 0, 0, 0, 0, 0, 0),
    ],
)
def test_other_messages_are_none_of_the_rules(message: Any) -> None:
    raw = message.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=191))
    assert codec.decode(codec.decode_bytes(bytes(raw))) is None


@settings(deadline=None)
@given(st.sampled_from(sorted(MESSAGES)), st.binary(max_size=255))
def test_any_payload_is_a_message_or_none_and_never_an_exception(name: str, payload: bytes) -> None:
    """A whole frame with a true CRC and anything inside it."""
    msgid = MESSAGES[name][0]
    head = bytes([0xFD, len(payload), 0, 0, 0, 252, 190]) + msgid.to_bytes(3, "little")
    crc = mavlink.x25crc(head[1:] + payload + bytes([mavlink.mavlink_map[msgid].crc_extra])).crc
    received = codec.decode_bytes(head + payload + crc.to_bytes(2, "little"))
    if received is None:
        return
    decoded = codec.decode(received)
    if decoded is None:
        return
    assert codec.name_of(decoded) == name
    if isinstance(decoded, (Connect, ConnectAck)) and "\ufffd" in decoded.name:
        return  # a name that is no ASCII does not come back as it was
    assert codec.decode(over_the_wire(decoded)) == decoded


@settings(deadline=None)
@given(st.binary(max_size=300))
def test_any_bytes_are_none_or_a_message_and_never_an_exception(raw: bytes) -> None:
    codec.decode_bytes(raw)
    codec.decode_bytes(b"\xfd" + raw)
    codec.decode_bytes(b"\xfe" + raw)


# ---- values -------------------------------------------------------------------------------------------------------


def test_a_request_tells_the_state_of_the_aircraft() -> None:
    state = AircraftState(526790000, 59240000, 30500, 27000, 9.5, 88, 4, 3)
    received = over_the_wire(HandoverRequest(KEY, Reason.ZONE), aircraft=state)
    assert (received.lat, received.lon, received.relative_alt) == (526790000, 59240000, 30500)
    assert (received.heading, received.groundspeed, received.battery_remaining) == (27000, 9.5, 88)
    assert (received.waypoint, received.custom_mode) == (4, 3)


def test_a_request_without_a_state_says_unknown() -> None:
    received = over_the_wire(HandoverRequest(KEY))
    assert (received.heading, received.battery_remaining) == (65535, -1)


def test_no_mission_is_a_digest_of_zeros_on_the_wire() -> None:
    received = over_the_wire(Connect(251, 1, 1, 0, None, "drone-1", b""))
    assert bytes(received.mission_digest) == bytes(32)
    assert (received.commander, received.name) == (0, "drone-1")


def test_a_long_name_is_cut_and_not_refused() -> None:
    received = over_the_wire(Connect(251, 1, 1, 0, None, "x" * 40, b""))
    assert received.name == "x" * 20


def test_frames_are_numbered_one_after_the_other_and_begin_again_after_255() -> None:
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=191)
    message = codec.encode(ConnectHandover(KEY), (252, 190), 1)
    assert [codec.pack(message, sender)[4] for _ in range(258)] == [*range(256), 0, 1]
