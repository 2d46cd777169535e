# SPDX-License-Identifier: GPL-3.0-or-later

"""The wire form of operator control: layouts of 2024 and 2026, COMMAND_LONG and COMMAND_INT, and what is no request."""

from __future__ import annotations

import math
import struct
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.events import ControlRequested
from mavproxy_handover.core.common.model import AuthorityView, LeaseState, Phase
from mavproxy_handover.gate.judge import StationIdentity
from mavproxy_handover.operator.requests.operator_control import notification, read_request
from mavproxy_handover.wire.status import control_status

A, B, TRACKER = 251, 252, 241
STATION = StationIdentity(A, frozenset({TRACKER}))
OLD = "release with takeover: the request of an old ground station?"
FLAGS = "action and takeover must be 0 or 1"


def long(*parameters: float) -> Any:
    values = (*parameters, *([0.0] * (7 - len(parameters))))
    return over_the_wire(mavlink.MAVLink_command_long_message(1, 191, 32100, 0, *values))


def short(*parameters: float) -> Any:
    """COMMAND_INT: x and y are integers there, and mean nothing here."""
    values = (*parameters, *([0.0] * (4 - len(parameters))))
    return over_the_wire(mavlink.MAVLink_command_int_message(1, 191, 0, 32100, 0, 0, *values, 0, 0, 0.0))


def over_the_wire(message: Any) -> Any:
    own = mavlink.MAVLink(None, srcSystem=A, srcComponent=190)
    (decoded,) = mavlink.MAVLink(None).parse_buffer(message.pack(own))
    return decoded


class TestRequest:
    @pytest.mark.parametrize("form", [long, short], ids=["COMMAND_LONG", "COMMAND_INT"])
    @pytest.mark.parametrize(
        ("parameters", "request_"),
        [
            ((1, 0, 10, A), ControlRequested(A, True, False, 10.0, A)),
            ((1, 1, 60, A), ControlRequested(A, True, True, 60.0, A)),
            # who leaves the system id out asks for itself
            ((1, 0, 10, 0), ControlRequested(A, True, False, 10.0, A)),
            ((1, 0), ControlRequested(A, True, False, 0.0, A)),
            # for another one: whether it may is not decided here
            ((1, 0, 30, B), ControlRequested(A, True, False, 30.0, B)),
            ((1, 0, 30, 255), ControlRequested(A, True, False, 30.0, 255)),
            # a system behind the station is the station
            ((1, 0, 30, TRACKER), ControlRequested(A, True, False, 30.0, A)),
            # the time is the arbiter's to limit
            ((1, 0, -3, A), ControlRequested(A, True, False, -3.0, A)),
            ((1, 0, 1e9, A), ControlRequested(A, True, False, 1e9, A)),
            ((0, 0, 0, A), ControlRequested(A, False, False, 0.0, A)),
            # a release is the sender's, whatever it says of others
            ((0, 0, 10, B), ControlRequested(A, False, False, 10.0, A)),
            ((0,), ControlRequested(A, False, False, 0.0, A)),
        ],
    )
    def test_of_2026(self, form: Any, parameters: tuple[float, ...], request_: ControlRequested) -> None:
        assert read_request(form(*parameters), STATION) == request_

    def test_what_the_standard_has_removed_is_not_read(self) -> None:
        # p5, p6 and p7 were an upper range and more, and were taken out in 2026
        assert read_request(long(1, 0, 10, A, 255, 7, -1), STATION) == ControlRequested(A, True, False, 10.0, A)

    @pytest.mark.parametrize("station", [1, A, B, 255])
    def test_the_sender_is_who_the_link_says(self, station: int) -> None:
        request = read_request(long(1, 0, 10, A), StationIdentity(station))
        assert isinstance(request, ControlRequested)
        assert (request.station, request.for_station) == (station, A)


class TestOldLayout:
    """2024: p1 system id, 0 from a ground station; p2 1 request, 0 release; p3 takeover; p4 time-out in seconds."""

    @pytest.mark.parametrize("form", [long, short], ids=["COMMAND_LONG", "COMMAND_INT"])
    @pytest.mark.parametrize("takeover", [0, 1])
    @pytest.mark.parametrize("timeout_s", [0, 3, 10, 60])
    def test_a_request_is_not_read_as_a_release(self, form: Any, takeover: int, timeout_s: int) -> None:
        assert read_request(form(0, 1, takeover, timeout_s), STATION) == OLD

    @pytest.mark.parametrize("sysid", [A, B, 255, 2])
    def test_a_request_that_names_its_sender_is_none_either(self, sysid: int) -> None:
        assert read_request(long(sysid, 1, 0, 10), STATION) == FLAGS
        assert read_request(long(sysid, 0, 0, 10), STATION) == FLAGS

    def test_a_release_of_then_reads_as_one_of_today(self) -> None:
        assert read_request(long(0, 0, 0, 0), STATION) == ControlRequested(A, False, False, 0.0, A)

    def test_a_release_of_then_with_takeover_gives_nothing_to_anybody(self) -> None:
        # p3 takeover is today's time-out
        assert read_request(long(0, 0, 1, 10), STATION) == ControlRequested(A, False, False, 1.0, A)


class TestNonsense:
    """Bad input is an answer with a reason, never an exception and never a request."""

    @pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
    @pytest.mark.parametrize("position", [0, 1, 2, 3])
    def test_no_numbers(self, position: int, value: float) -> None:
        parameters = [1.0, 0.0, 10.0, float(A)]
        parameters[position] = value
        assert read_request(long(*parameters), STATION) == "parameters must be numbers"

    @pytest.mark.parametrize("value", [-1.0, 0.5, 0.9999, 1.0001, 2.0, 3.4e38, -0.5])
    @pytest.mark.parametrize("position", [0, 1])
    def test_neither_yes_nor_no(self, position: int, value: float) -> None:
        parameters = [1.0, 0.0, 10.0, float(A)]
        parameters[position] = value
        assert read_request(long(*parameters), STATION) == FLAGS

    @pytest.mark.parametrize("sysid", [-1.0, 0.5, 250.5, 256.0, 1000.0, 3.4e38, -3.4e38])
    def test_no_system_id(self, sysid: float) -> None:
        assert read_request(long(1, 0, 10, sysid), STATION) == "system id must be 0 to 255"
        assert read_request(long(0, 0, 10, sysid), STATION) == "system id must be 0 to 255"

    def test_every_bit_pattern_is_read_or_refused(self) -> None:
        patterns = [0x00000000, 0x80000000, 0x3F800000, 0x7F800000, 0xFF800000, 0x7FC00000, 0x00000001, 0x437B0000]
        values = [struct.unpack("<f", struct.pack("<I", pattern))[0] for pattern in patterns]
        for first in values:
            for second in values:
                for fourth in values:
                    got = read_request(long(first, second, 10.0, fourth), STATION)
                    assert isinstance(got, (ControlRequested, str))
                    if isinstance(got, ControlRequested):
                        assert first in (0, 1)
                        assert second in (0, 1)
                        assert not (first == 0 and second == 1)


class TestNotification:
    def test_the_same_command_with_the_requester_in_it(self) -> None:
        own = mavlink.MAVLink(None, srcSystem=1, srcComponent=191)
        raw = notification((A, 190), B, 12.5).pack(own)
        (m,) = mavlink.MAVLink(None).parse_buffer(raw)
        assert (m.get_srcSystem(), m.get_srcComponent()) == (1, 191)
        assert (m.target_system, m.target_component, m.command, m.confirmation) == (A, 190, 32100, 0)
        assert (m.param1, m.param2, m.param3, m.param4) == (1.0, 0.0, 12.5, 252.0)
        assert (m.param5, m.param6, m.param7) == (0.0, 0.0, 0.0)


class TestControlStatus:
    def packed(self, view: AuthorityView) -> bytes:
        own = mavlink.MAVLink(None, srcSystem=1, srcComponent=191)
        return bytes(control_status(view).pack(own, force_mavlink1=False))

    @pytest.mark.parametrize(
        ("view", "payload"),
        [
            (AuthorityView(), b"\x01"),
            (AuthorityView(Phase.ON_MISSION, A, None, 3, LeaseState.HELD), b"\x01\xfb"),
            # the partner of a transfer controls nothing, and is not among the secondaries
            (AuthorityView(Phase.ON_HANDOVER, A, B, 3, LeaseState.TRANSFER), b"\x01\xfb"),
            (AuthorityView(Phase.ON_MISSION, A, takeover_allowed=True), b"\x03\xfb"),
            (AuthorityView(Phase.ON_HANDOVER, None, B, 3, LeaseState.LOST), b"\x01"),
            (AuthorityView(Phase.ON_MISSION, None, None, 3, LeaseState.RECOVERING, takeover_allowed=True), b"\x03"),
        ],
    )
    def test_twelve_bytes_flags_first(self, view: AuthorityView, payload: bytes) -> None:
        raw = self.packed(view)
        assert int.from_bytes(raw[7:10], "little") == 512
        # MAVLink 2 leaves trailing zeros out: what is there is flags, then gcs_main
        assert raw[10 : 10 + raw[1]] == payload
        message = mavlink.MAVLink(None).decode(bytearray(raw))
        assert (message.flags, message.gcs_main) == (payload[0], (payload + b"\0")[1])
        assert list(message.gcs_secondary) == [0] * 10
