# SPDX-License-Identifier: GPL-3.0-or-later

"""The guard's word of who commands, with the station's name."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.gate.naming import named
from mavproxy_handover.wire.frames import parse_one
from tests.gate.door import Door
from tests.gate.frames import make_frame

NAMES = {250: "n" * 24, 251: "GCSA", 252: "GCSB", 253: "twenty letters and so", 254: "n" * 23}
SAYS = b"HNDO: lease live, 252 commands"


def read(text: bytes, version: int = 2) -> tuple[str, bool]:
    """What it becomes, and whether the frame is the one that came."""
    frame = make_frame("STATUSTEXT", sysid=1, compid=1, version=version, severity=6, text=text)
    raw = named(frame, NAMES)
    message = mavlink.MAVLink(None).decode(bytearray(raw))
    again = parse_one(raw)
    assert again is not None
    assert (again.sysid, again.compid, again.seq, again.version, message.severity) == (1, 1, frame.seq, version, 6)
    return message.text, raw == frame.raw


@pytest.mark.parametrize("version", [1, 2])
def test_it_says_the_name(version: int) -> None:
    assert read(b"HNDO: lease live, 252 commands", version) == ("HNDO: lease live, GCSB commands", False)
    assert read(b"HNDO: lease live, 253 commands", version)[0] == "HNDO: lease live, twenty letters and so commands"
    assert read(b"HNDO: lease live, 254 commands", version)[0] == f"HNDO: lease live, {'n' * 23} commands"


def test_it_keeps_the_number_of_the_frame() -> None:
    packer = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    packer.seq = 77
    frame = parse_one(mavlink.MAVLink_statustext_message(6, SAYS).pack(packer))
    assert frame is not None
    raw = named(frame, NAMES)
    assert (raw != frame.raw, raw[4]) == (True, 77)


def test_a_frame_without_such_a_text_is_passed_on_as_it_came() -> None:
    for frame in (
        make_frame("HEARTBEAT", sysid=1, compid=1),
        make_frame("STATUSTEXT", sysid=1, compid=1, severity=6, text=SAYS)._replace(known=False),
        make_frame("LOGGING_DATA", sysid=1, compid=1)._replace(known=False),
    ):
        assert named(frame, NAMES) == frame.raw


@pytest.mark.parametrize(
    "text",
    [
        b"HNDO: lease live, nobody commands",
        b"HNDO: lease live, 77 commands",
        b"HNDO: lease live, 250 commands",  # the name is too long for the text
        b"HNDO: lease live, 252252252 commands",
        b"HNDO: lease live, 252 commands\0 and more",
        b"said: HNDO: lease live, 252 commands",
        b"HNDO: lease live, \xb2 commands",
        b"PreArm: 252 commands",
        b"",
    ],
)
def test_anything_else_is_passed_on_as_it_came(text: bytes) -> None:
    assert read(text)[1]


def test_stations_hear_it_so() -> None:
    door = Door()
    door.gate.down(make_frame("STATUSTEXT", sysid=1, compid=1, text=b"HNDO: lease live, 252 commands"), door.now)
    for port in door.ports.values():
        (heard,) = port.heard
        assert mavlink.MAVLink(None).decode(bytearray(heard)).text == "HNDO: lease live, GCSB commands"
