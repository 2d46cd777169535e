# SPDX-License-Identifier: GPL-3.0-or-later

"""A text in pieces, as those read it who put them together, and those who do not."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.wire.texts import marked_texts, pieces, status_texts

REFUSAL = "mode RTL refused: GCSA commands ('handover request')"


def put_together(parts: list[bytes]) -> str:
    """As a ground station program does: by number, up to the first piece that is not full."""
    text = b""
    for part in parts:
        text += part
        if len(part) < 50:
            return text.decode()
    raise AssertionError("the end never comes")


def test_a_text_that_fits_is_one_message_without_an_id() -> None:
    text = "x" * 50
    (message,) = status_texts(text, 4, 7)
    assert (message.text, message.id, message.chunk_seq, message.severity) == (text, 0, 0, 4)
    assert pieces("") == [b""]


def test_a_longer_one_comes_in_full_pieces() -> None:
    assert pieces(REFUSAL) == [b"mode RTL refused: GCSA commands ('handover request", b"')"]
    first, second = status_texts(REFUSAL, 4, 7)
    assert [(m.id, m.chunk_seq, m.severity) for m in (first, second)] == [(7, 0, 4), (7, 1, 4)]


@pytest.mark.parametrize(
    "text",
    [
        REFUSAL,
        "preflight: SCR_LD_CHECKSUM is -1: an SD card that is gone or changed is not noticed at arming",
        "one " * 60 + "end",
        "a" * 49 + " b",
        "a" * 50 + " b",
    ],
)
def test_put_together_it_is_the_text_without_further_blanks(text: str) -> None:
    """The fault: MAVProxy's console showed `SCR_LD_CHECKSUM is -1:                 an SD card`."""
    parts = pieces(text)
    assert put_together(parts) == text
    assert all(len(part) == 50 for part in parts[:-1])


def test_a_text_that_ends_with_a_full_piece_is_ended_by_an_empty_one() -> None:
    assert pieces("a" * 49 + " " + "b" * 50) == [b"a" * 49 + b" ", b"b" * 50, b""]


def test_no_character_is_cut_in_half() -> None:
    parts = pieces("ä" * 60)  # two bytes each
    assert "".join(part.decode() for part in parts) == "ä" * 60
    odd = pieces("x" + "ä" * 60)
    assert [part.decode().rstrip() for part in odd] == ["x" + "ä" * 24, "ä" * 24 + "ä", "ä" * 11]
    assert "".join(part.decode() for part in odd).replace(" ", "") == "x" + "ä" * 60


def test_nothing_that_can_be_said_breaks_it() -> None:
    for text in ("\ud800" * 80, " " * 200, "\0" * 120, "€" * 5000):
        messages = status_texts(text, 4, 65535)
        assert 1 <= len(messages) <= 256
        for message in messages:
            assert message.pack(mavlink.MAVLink(None, 1, 191))


LONG = "GCSA changed the mission on the autopilot. The package is not loaded any more. START needs 'handover share'."


def test_a_text_in_the_autopilots_name_has_no_holes_where_it_was_cut() -> None:
    """The fault: programs that put the pieces together showed 'locked while     armed'."""
    messages = marked_texts(LONG, 4, 7)
    assert "".join(message.text for message in messages) == f"Handover: {LONG}"
    assert [len(message.text) for message in messages] == [50, 50, 18]
    assert [(message.id, message.chunk_seq) for message in messages] == [(0x8007, 0), (0x8007, 1), (0x8007, 2)]


def test_one_that_fits_is_alone_and_one_that_fills_its_pieces_ends_with_an_empty_one() -> None:
    (alone,) = marked_texts("x" * 40, 4, 7)
    assert (alone.id, alone.text) == (0, "Handover: " + "x" * 40)
    assert [len(message.text) for message in marked_texts("x" * 90, 4, 7)] == [50, 50, 0]


def test_a_character_is_not_cut_in_half_there() -> None:
    messages = marked_texts("x" * 39 + "\u00fc" + "y" * 20, 4, 7)
    assert [bytes(message._text_raw) for message in messages] == [
        b"Handover: " + b"x" * 39 + b" ",
        "\u00fc".encode() + b"y" * 20,
    ]
