# SPDX-License-Identifier: GPL-3.0-or-later

"""The six lines with the question whether this station will take the aircraft."""

from __future__ import annotations

import random

from gcs_module.briefing import NAMES, Briefing

QUESTION = (251, 252, 1, 1, -1)


def tell(book: Briefing, number: int, words: str, now: float, order: list[int] | None = None) -> None:
    for line in order or list(range(1, 7)):
        book.add_line(number, line, 6, f"{words} {line}", now)


def test_each_line_has_its_name() -> None:
    book = Briefing()
    tell(book, 1, "a", 10.0)
    assert book.lines == tuple(f"{name:9} a {line}" for line, name in enumerate(NAMES, 1))
    assert book.at == 10.0


def test_lines_may_come_in_any_order_and_twice() -> None:
    book, order = Briefing(), [*range(1, 7), 2, 5]
    random.Random(7).shuffle(order)
    tell(book, 1, "a", 10.0, order)
    assert [line.split()[-1] for line in book.lines] == list("123456")


def test_what_is_not_whole_does_not_count_and_lines_of_two_do_not_mix() -> None:
    book = Briefing()
    tell(book, 1, "old", 10.0)
    tell(book, 2, "cut", 11.0, [1, 2, 3])
    assert all("old" in line for line in book.lines)
    tell(book, 3, "new", 12.0, [4, 5, 6])
    assert all("old" in line for line in book.lines)
    tell(book, 3, "new", 12.0, [1, 2, 3])
    assert all("new" in line for line in book.lines)


def test_lines_that_make_no_sense_are_passed_over() -> None:
    book = Briefing()
    for line, lines in ((0, 6), (7, 6), (255, 0)):
        book.add_line(1, line, lines, "x", 10.0)
    assert book.lines == ()


def test_it_is_shown_once_for_each_question_and_not_before_one() -> None:
    book = Briefing()
    tell(book, 1, "a", 10.0)
    assert book.due(None, 0.0) == ()
    assert book.due(QUESTION, 9.0) == book.lines
    tell(book, 2, "b", 20.0)
    assert book.due(QUESTION, 9.0) == ()
    assert book.due(None, 19.0) == ()
    assert book.due((251, 252, 2, 1, -1), 19.0) == book.lines


def test_one_that_comes_with_the_question_is_shown_with_it() -> None:
    book = Briefing()
    tell(book, 1, "a", 10.0)
    assert book.due(QUESTION, 10.0) == book.lines != ()


def test_a_line_of_a_newer_vehicle_is_shown_without_a_name() -> None:
    book = Briefing()
    for line in range(1, 9):
        book.add_line(1, line, 8, f"a {line}", 10.0)
    assert [text.split() for text in book.lines[6:]] == [["a", "7"], ["a", "8"]]


def test_one_that_is_older_than_the_question_is_not_shown_with_it() -> None:
    book = Briefing()
    tell(book, 1, "a", 10.0)
    assert book.due(QUESTION, 11.0) == ()
    tell(book, 2, "b", 12.0)
    assert book.due(QUESTION, 11.0) == book.lines
