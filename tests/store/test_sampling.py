# SPDX-License-Identifier: GPL-3.0-or-later

"""Sampling: one entry a second of a kind, a bound for all kinds together, and what was left out is told."""

from __future__ import annotations

from mavproxy_handover.store.sampling import KINDS, Sampler


def test_one_of_a_kind_a_second_and_the_next_says_how_many_were_left_out() -> None:
    sampler = Sampler(100, 1.0)
    assert [sampler.admit(10.0 + n / 4, "a") for n in range(9)] == [0, None, None, None, 3, None, None, None, 3]
    assert sampler.admit(12.0, "b") == 0


def test_what_has_no_kind_is_never_like_another() -> None:
    sampler = Sampler(3, 10.0)
    assert [sampler.admit(10.0) for _ in range(4)] == [0, 0, 0, None]


def test_of_all_kinds_together_there_is_an_end() -> None:
    sampler = Sampler(5, 2.0)
    assert [sampler.admit(10.0, n) for n in range(7)] == [0, 0, 0, 0, 0, None, None]
    assert sampler.admit(11.9, 8) is None
    assert sampler.admit(12.0, 9) == 0  # one each 2 s from then on
    assert sampler.admit(12.0, 10) is None
    assert [sampler.admit(1000.0, n) for n in range(20, 27)] == [0, 0, 0, 0, 0, None, None]  # no more at once than ever


def test_an_hour_of_whatever_makes_no_more_entries_than_that() -> None:
    sampler = Sampler(60, 2.0)
    written = sum(sampler.admit(n / 30, n % 331) is not None for n in range(30 * 3600))
    assert 1800 <= written <= 60 + 1800


def test_what_no_entry_tells_of_is_told_once_a_minute() -> None:
    sampler = Sampler(1, 1e9)
    assert sampler.left_out(10.0) == 0
    sampler.admit(10.0, "a")
    for n in range(5):
        sampler.admit(10.0, n)
    assert sampler.left_out(10.5) == 5
    for n in range(7):
        sampler.admit(11.0, n)
    assert [sampler.left_out(at) for at in (11.0, 70.0)] == [0, 0]
    assert sampler.left_out(70.5) == 7
    assert sampler.left_out(500.0) == 0


def test_what_was_left_out_of_a_kind_that_never_comes_again_is_told_too() -> None:
    sampler = Sampler(10, 1.0)
    for _ in range(4):
        sampler.admit(10.0, "a")
    assert sampler.left_out(69.9) == 0
    assert sampler.left_out(70.0) == 3


def test_nothing_is_counted_twice_and_nothing_is_lost() -> None:
    sampler = Sampler(50, 0.5)
    asked = written = told = 0
    for n in range(20_000):
        also = sampler.admit(10.0 + n / 100, n * n % 1009)
        asked += 1
        if also is not None:
            written += 1
            told += also
        told += sampler.left_out(10.0 + n / 100)
    assert written + told + sampler.left_out(float("inf")) == asked


def test_memory_has_an_end() -> None:
    sampler = Sampler(10**6, 1e-6)
    for n in range(10 * KINDS):
        sampler.admit(10.0 + n, n)
    assert len(sampler._kinds) == KINDS
