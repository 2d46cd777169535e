# SPDX-License-Identifier: GPL-3.0-or-later

"""STATUSTEXT of the companion: whole, in order, and nothing twice."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from gcs_module.alarms import Level
from gcs_module.texts import Text, Texts
from mavproxy_handover.wire.frames import Frame, parse_one

NOW = 100.0


def piece(text: bytes | str, text_id: int = 0, number: int = 0, severity: int = mavlink.MAV_SEVERITY_WARNING) -> Frame:
    raw = text.encode() if isinstance(text, str) else text
    packed = mavlink.MAVLink_statustext_message(severity, raw, text_id, number).pack(mavlink.MAVLink(None, 1, 191))
    frame = parse_one(bytes(packed))
    assert frame is not None
    return frame


def nothing(_text: str) -> bool:
    return False


def shown(texts: Texts, now: float = NOW + 10.0) -> list[str]:
    return [text.words for text in texts.due(now, nothing)]


def test_a_short_text_waits_a_moment() -> None:
    texts = Texts(nothing)
    texts.on_frame(piece("hello"), NOW)
    assert texts.due(NOW + 0.4, nothing) == []
    assert texts.due(NOW + 0.5, nothing) == [Text(NOW + 0.5, Level.WARNING, "hello", False)]
    assert texts.due(NOW + 9.0, nothing) == []


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 2, 0), (0, 0, 1, 2, 2)])
def test_pieces_come_in_any_order_and_twice(order: tuple[int, ...]) -> None:
    parts = ["a" * 49 + " ", "b" * 49 + " ", "end"]
    texts = Texts(nothing)
    for number in order:
        texts.on_frame(piece(parts[number], 7, number), NOW)
    assert shown(texts, NOW + 1.0) == ["".join(parts)]


def test_a_full_last_piece_is_ended_by_an_empty_one() -> None:
    texts = Texts(nothing)
    for number, text in enumerate(("a" * 50, "b" * 50, "")):
        texts.on_frame(piece(text, 3, number), NOW)
    assert shown(texts, NOW + 1.0) == ["a" * 50 + "b" * 50]


def test_a_character_may_be_cut_by_the_end_of_a_piece() -> None:
    raw = ("x" * 49 + "\u00e9ffel").encode()
    texts = Texts(nothing)
    for number in range(2):
        texts.on_frame(piece(raw[50 * number : 50 * number + 50], 3, number), NOW)
    assert shown(texts, NOW + 1.0) == ["x" * 49 + "\u00e9ffel"]


@pytest.mark.parametrize(
    ("came", "text"),
    [((0, 2), "a" * 50 + "...end"), ((1, 2), "..." + "b" * 50 + "end"), ((0, 1), "a" * 50 + "b" * 50 + "...")],
)
def test_what_is_lost_of_it_is_dots(came: tuple[int, ...], text: str) -> None:
    parts = ["a" * 50, "b" * 50, "end"]
    texts = Texts(nothing)
    for number in came:
        texts.on_frame(piece(parts[number], 7, number), NOW)
    assert shown(texts, NOW + 1.9) == []
    assert shown(texts, NOW + 2.1) == [text]


def test_another_text_under_the_same_number_is_another_one() -> None:
    texts = Texts(nothing)
    texts.on_frame(piece("a" * 50, 7, 0), NOW)
    texts.on_frame(piece("b" * 50, 7, 0), NOW + 60.0)
    texts.on_frame(piece("end", 7, 1), NOW + 60.0)
    assert shown(texts, NOW + 70.0) == ["b" * 50 + "end"]


def test_however_many_begin_only_so_many_wait() -> None:
    texts = Texts(nothing)
    for number in range(1, 200):
        texts.on_frame(piece("a" * 50, number, 0), NOW + number * 0.001)
        texts.on_frame(piece("a" * 50, number, 200), NOW)
    assert len(shown(texts)) <= 32


@pytest.mark.parametrize(
    ("severity", "level"),
    [(0, "EMERGENCY"), (1, "EMERGENCY"), (2, "EMERGENCY"), (3, "WARNING"), (4, "WARNING"), (5, "ADVISORY"), (6, "INFO"),
     (7, "INFO"), (200, "INFO")],
)  # fmt: skip
def test_how_grave_it_is(severity: int, level: str) -> None:
    texts = Texts(nothing)
    texts.on_frame(piece("text", severity=severity), NOW)
    assert [text.level for text in texts.due(NOW + 1.0, nothing)] == [Level[level]]


def test_blanks_that_fill_a_piece_are_one() -> None:
    texts = Texts(nothing)
    texts.on_frame(piece("START refused: no mission loaded;".ljust(50), 4, 0), NOW)
    texts.on_frame(piece("outside the zone of GCSA", 4, 1), NOW)
    assert shown(texts, NOW + 1.0) == ["START refused: no mission loaded; outside the zone of GCSA"]


@pytest.mark.parametrize("raw", [b"", b"   ", b"\0\0\0"])
def test_nothing_is_not_shown(raw: bytes) -> None:
    texts = Texts(nothing)
    texts.on_frame(piece(raw), NOW)
    assert shown(texts) == []


def test_bytes_that_are_no_text_are_shown_as_they_can_be() -> None:
    texts = Texts(nothing)
    texts.on_frame(piece(b"\xff\xfe low"), NOW)
    assert shown(texts) == ["\ufffd\ufffd low"]


def test_what_is_told_already_is_left_out() -> None:
    texts = Texts(nothing)
    texts.on_frame(piece("RETURN to home"), NOW)
    texts.on_frame(piece("other"), NOW)
    assert [text.words for text in texts.due(NOW + 1.0, lambda text: text.startswith("RETURN"))] == ["other"]


def test_a_text_can_be_taken_by_its_beginning_once() -> None:
    texts = Texts(nothing)
    texts.on_frame(piece("START refused: why"), NOW)
    assert texts.pop("STOP refused: ") == ""
    assert texts.pop("START refused: ") == "START refused: why"
    assert texts.pop("START refused: ") == ""
    assert shown(texts) == []


def test_what_mavproxy_has_shown_is_known() -> None:
    texts = Texts(lambda text: text == "one  two")
    for words in ("one  two", "three"):
        texts.on_frame(piece(words), NOW)
    assert [(text.words, text.shown) for text in texts.due(NOW + 1.0, nothing)] == [("one two", True), ("three", False)]
