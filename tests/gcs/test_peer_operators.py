# SPDX-License-Identifier: GPL-3.0-or-later

"""The names of the operators at other stations, as they travel and as they arrive."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from gcs_module.duty import Duty
from gcs_module.peer_operators import MOST_LETTERS, PeerOperators, operator_message
from mavproxy_handover.wire import codec

NOW = 50.0


def arrived(name: str) -> str:
    """The name that another station shows."""
    duty = Duty(required=False)
    duty.command(name, NOW, "")
    known = PeerOperators((252,))
    raw = codec.pack(operator_message(251, duty), mavlink.MAVLink(None, srcSystem=252))
    known.on_message(252, codec.decode_bytes(bytes(raw)), NOW)
    found = known.of(252)
    assert found is not None
    assert found.at == NOW
    return str(found.value)


@pytest.mark.parametrize("name", ["Jansen", "de Vries", "Žižka", "Σωκράτης", "", "O'Neil-Smith Jr."])
def test_a_name_arrives_as_it_was_given(name: str) -> None:
    assert arrived(name) == name


def test_a_long_name_of_wide_letters_is_cut_between_letters() -> None:
    assert arrived("漢" * 30) == "漢" * 20


def test_the_name_of_another_program_is_plain_text_of_bounded_length() -> None:
    known = PeerOperators((252,))
    given = mavlink.MAVLink_station_operator_message(251, 190, 1, list(b"a\x1b[2J\nb" + b"x" * 52))
    known.on_message(252, given, NOW)
    found = known.of(252)
    assert found is not None
    assert found.value == ("a[2Jb" + "x" * 52)[:MOST_LETTERS]


def test_a_stranger_is_not_heard_and_a_silent_station_is_not_known() -> None:
    known = PeerOperators((252,))
    known.on_message(253, mavlink.MAVLink_station_operator_message(251, 190, 1, list(b"Eve".ljust(60, b"\0"))), NOW)
    assert known.of(252) is None
    assert known.of(253) is None
