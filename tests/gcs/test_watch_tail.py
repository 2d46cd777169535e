# SPDX-License-Identifier: GPL-3.0-or-later

"""Following a journal: every whole entry once, in order, whatever becomes of the file meanwhile."""

from __future__ import annotations

import json
from pathlib import Path

from gcs_module.watch.tail import HISTORY_BYTES, MAX_LINE, Entry, Tail, parse
from mavproxy_handover.store.journal import Journal

A_LOT = 1 << 24


def line(number: int) -> bytes:
    return (
        json.dumps({"t": 1.0, "utc": "1970-01-01T00:01:00+00:00", "who": "d", "event": "e", "n": number}).encode()
        + b"\n"
    )


def numbers(tail: Tail, most: int = A_LOT) -> list[int]:
    return [entry.fields["n"] for entry in tail.read(most)[0]]


def append(path: Path, data: bytes) -> None:
    with path.open("ab") as file:
        file.write(data)


def test_an_entry_counts_when_its_line_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "j.jsonl"
    tail = Tail(path)
    assert tail.read(A_LOT) == ([], 0)  # it does not exist yet
    append(path, line(1) + line(2)[:20])
    assert numbers(tail) == [1]
    append(path, line(2)[20:])
    assert numbers(tail) == [2]
    assert tail.read(A_LOT) == ([], 0)
    assert tail.broken == 0


def test_a_journal_that_rolls_over_is_read_to_its_end_and_from_its_beginning(tmp_path: Path) -> None:
    path = tmp_path / "j.jsonl"
    journal = Journal(path, "drone-1", max_bytes=1000)
    tail, found = Tail(path), []
    for number in range(60):
        journal.write("e", n=number)
        assert journal.wait_until_written(5.0)
        if number % 3 == 0:  # so some entries are read out of the file that has moved away
            found += numbers(tail)
    found += numbers(tail)
    journal.close()
    assert (tmp_path / "j.jsonl.1").exists()
    assert found == list(range(60))
    assert tail.broken == 0


def test_who_is_killed_in_a_line_and_begins_again_costs_that_line(tmp_path: Path) -> None:
    path = tmp_path / "j.jsonl"
    path.write_bytes(line(1) + line(2)[:-7])
    tail = Tail(path)
    assert numbers(tail) == [1]
    journal = Journal(path, "drone-1")
    journal.write("e", n=3)
    journal.close()
    assert numbers(tail) == [3]
    assert tail.broken == 1


def test_a_file_that_was_cut_or_taken_away_is_read_anew(tmp_path: Path) -> None:
    path = tmp_path / "j.jsonl"
    path.write_bytes(line(1) + line(2))
    tail = Tail(path)
    assert numbers(tail) == [1, 2]
    path.write_bytes(line(3))  # the same file, shorter
    assert numbers(tail) == [3]
    path.unlink()
    assert numbers(tail) == []
    path.write_bytes(line(4) + line(5) + line(6))
    assert numbers(tail) == [4, 5, 6]


def test_broken_lines_are_counted_and_cost_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "j.jsonl"
    junk = (
        b"{",
        b"[]",
        b"null",
        b'{"who": 1, "event": "e"}',
        b"\xff\xfe\x00",
        b"[" * 100_000,
        b'{"who":"a","event":[]}',
    )
    path.write_bytes(b"".join(each + b"\n" for each in junk) + b"\n\n" + line(7))
    tail = Tail(path)
    assert numbers(tail) == [7]
    assert tail.broken == len(junk)


def test_a_line_without_an_end_takes_no_memory(tmp_path: Path) -> None:
    path = tmp_path / "j.jsonl"
    path.write_bytes(line(1) + b"x" * (3 * MAX_LINE))
    tail = Tail(path)
    assert numbers(tail) == [1]
    assert len(tail._rest) <= MAX_LINE
    append(path, b"x" * 3 * MAX_LINE + b"\n" + line(2))
    assert numbers(tail) == [2]
    assert tail.broken == 1


def test_of_a_long_history_the_end_is_read(tmp_path: Path) -> None:
    path = tmp_path / "j.jsonl"
    count = HISTORY_BYTES // len(line(100_000)) + 5000
    path.write_bytes(b"".join(line(100_000 + number) for number in range(count)))
    tail, found = Tail(path), []
    while new := tail.read(1 << 20)[0]:
        assert len(new) * len(line(100_000)) <= (1 << 20) + 200
        found += [entry.fields["n"] for entry in new]
    assert found[-1] == 100_000 + count - 1
    assert found == list(range(found[0], found[-1] + 1))
    assert HISTORY_BYTES - 200 < len(found) * len(line(100_000)) <= HISTORY_BYTES


def test_what_cannot_be_opened_raises_nothing(tmp_path: Path) -> None:
    assert Tail(tmp_path).read(A_LOT) == ([], 0)  # a folder
    assert Tail(tmp_path / "a\0b").read(A_LOT) == ([], 0)


def test_values_of_another_kind_are_no_values() -> None:
    entry = parse(b'{"who":"d","event":"e","a":NaN,"b":true,"c":"x","d":2,"e":1e999,"utc":"9999-99","text":"t"}')
    assert entry is not None
    assert entry == Entry(None, "d", "e", "t", entry.fields)
    assert [entry.number(key) for key in "abcde"] == [None, None, None, 2.0, None]
    assert [entry.word(key) for key in "abcde"] == [None, None, "x", None, None]
