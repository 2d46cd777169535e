# SPDX-License-Identifier: GPL-3.0-or-later

"""Frames with other bytes in their payload: pymavlink reads them as it reads its own."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.wire.frames import parse_one, target_offsets
from mavproxy_handover.wire.rewritten import rewritten

SENDER = (1, 191)


def frame_of(message, *, key=None, version_1=False):
    own = mavlink.MAVLink(None, *SENDER)
    own.seq = 77
    if key is not None:
        own.signing.secret_key = key
        own.signing.sign_outgoing = True
    frame = parse_one(bytes(message.pack(own, force_mavlink1=version_1)))
    assert frame is not None
    return frame


ACK = mavlink.MAVLink_command_ack_message(400, 0, 0, 0, 252, 190)
TEXT = mavlink.MAVLink_statustext_message(6, b"nothing to change")
EMPTY = mavlink.MAVLink_mission_clear_all_message(0, 0, 0)


@pytest.mark.parametrize("message", [ACK, TEXT, EMPTY], ids=lambda each: each.get_type())
@pytest.mark.parametrize("form", [{}, {"key": bytes(32)}, {"version_1": True}], ids=["plain", "signed", "version 1"])
def test_without_a_change_the_content_stays_and_the_signature_goes(message, form):
    again = parse_one(rewritten(frame_of(message, **form), {}))
    assert again is not None
    assert (again.version, again.signed, again.known) == (2, False, True)
    assert (again.sysid, again.compid, again.seq, again.msgid) == (*SENDER, 77, message.get_msgId())
    assert again.payload == frame_of(message, **form).payload


def test_changed_bytes_are_read_by_pymavlink():
    _length, system, component = target_offsets(mavlink.MAVLINK_MSG_ID_COMMAND_ACK)
    data = rewritten(frame_of(ACK, key=bytes(32)), {system: 255, component: 7})
    read = mavlink.MAVLink(None).decode(bytearray(data))
    assert (read.get_type(), read.command, read.target_system, read.target_component) == ("COMMAND_ACK", 400, 255, 7)
    assert (read.get_srcSystem(), read.get_srcComponent(), read.get_seq()) == (*SENDER, 77)


def test_a_payload_of_zeros_keeps_one_byte():
    _length, system, component = target_offsets(mavlink.MAVLINK_MSG_ID_COMMAND_ACK)
    data = rewritten(frame_of(mavlink.MAVLink_command_ack_message(0, 0, 0, 0, 5, 0)), {system: 0})
    assert data[1] == 1
    assert mavlink.MAVLink(None).decode(bytearray(data)).target_system == 0
    assert component is not None
