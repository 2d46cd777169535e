# SPDX-License-Identifier: GPL-3.0-or-later

"""Following journals: what a killed process leaves behind must neither stop nor fool a run."""

from __future__ import annotations

from pathlib import Path

from sitl.report.journal_reader import Entry, JournalReader, parse_line, read_journals


def line(t: float, who: str, event: str) -> str:
    return f'{{"t": {t}, "who": "{who}", "event": "{event}"}}\n'


def test_an_entry_keeps_everything_that_stands_in_its_line() -> None:
    entry = parse_line('{"t": 1.5, "utc": "x", "who": "drone-1", "event": "view", "text": "a", "epoch": 3}')
    assert entry is not None
    assert (entry.t, entry.who, entry.event, entry.text) == (1.5, "drone-1", "view", "a")
    assert (entry.get("epoch"), entry.get("who"), entry.get("none", 7)) == (3, "drone-1", 7)


def test_an_entry_survives_writing_and_reading() -> None:
    entry = Entry(12.3456, "vehicle", "reached", "item 3 reached", {"number": 3})
    assert parse_line(entry.to_line()) == entry


def test_a_number_that_is_none_is_left_out_of_its_entry() -> None:
    for odd in ("[1]", '"3"', "true", "NaN", "Infinity", "1" + "0" * 400, "null", "{}"):
        entry = parse_line(f'{{"t": 1, "who": "a", "event": "landed", "lat_deg": {odd}, "lon_deg": 5.0, "mode": [1]}}')
        assert entry is not None
        assert entry.fields == {"lon_deg": 5.0, "mode": [1]}, odd


def test_what_is_no_entry_is_none() -> None:
    for text in ("", "{", "[]", "3", '{"t": "x", "who": "a", "event": "b"}', '{"t": 1, "who": "a"}', '{"t": true}'):
        assert parse_line(text) is None


def test_a_journal_is_followed_from_before_it_exists(tmp_path: Path) -> None:
    reader = JournalReader()
    reader.follow(tmp_path / "a.jsonl")
    assert reader.poll() == []
    (tmp_path / "a.jsonl").write_text(line(1, "a", "loaded"))
    assert [entry.event for entry in reader.poll()] == ["loaded"]
    assert reader.poll() == []


def test_a_half_written_line_waits_for_its_other_half(tmp_path: Path) -> None:
    path = tmp_path / "a.jsonl"
    whole = line(1, "a", "loaded")
    reader = JournalReader()
    reader.follow(path)
    path.write_text(whole[:20])
    assert reader.poll() == []
    path.write_text(whole)
    assert [entry.event for entry in reader.poll()] == ["loaded"]
    assert reader.broken == 0


def test_a_character_cut_in_two_is_whole_again(tmp_path: Path) -> None:
    path = tmp_path / "a.jsonl"
    data = '{"t": 1, "who": "a", "event": "x", "text": "Übergabe"}\n'.encode()
    cut = data.index("Ü".encode()) + 1
    reader = JournalReader()
    reader.follow(path)
    path.write_bytes(data[:cut])
    reader.poll()
    path.write_bytes(data)
    assert [entry.text for entry in reader.poll()] == ["Übergabe"]


def test_broken_lines_are_counted_and_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "a.jsonl"
    path.write_text(line(1, "a", "loaded") + "garbage\n\n" + line(2, "a", "view"))
    reader = JournalReader()
    reader.follow(path)
    assert [entry.event for entry in reader.poll()] == ["loaded", "view"]
    assert reader.broken == 1


def test_a_journal_that_rolled_over_is_read_from_its_new_beginning(tmp_path: Path) -> None:
    path = tmp_path / "a.jsonl"
    reader = JournalReader()
    reader.follow(path)
    path.write_text(line(1, "a", "one") + line(2, "a", "two"))
    reader.poll()
    path.write_text(line(3, "a", "three"))
    assert [entry.event for entry in reader.poll()] == ["three"]


def test_several_journals_become_one_in_the_order_of_time(tmp_path: Path) -> None:
    (tmp_path / "a.jsonl").write_text(line(1, "a", "first") + line(4, "a", "fourth"))
    (tmp_path / "b.jsonl").write_text(line(2, "b", "second") + line(3, "b", "third"))
    entries = read_journals([tmp_path / "a.jsonl", tmp_path / "b.jsonl", tmp_path / "missing.jsonl"])
    assert [entry.event for entry in entries] == ["first", "second", "third", "fourth"]
    assert [entry.who for entry in entries] == ["a", "b", "b", "a"]


def test_an_index_into_the_entries_stays_valid(tmp_path: Path) -> None:
    reader = JournalReader()
    reader.follow(tmp_path / "a.jsonl")
    reader.add([Entry(9.0, "vehicle", "mode")])
    (tmp_path / "a.jsonl").write_text(line(1, "a", "late"))
    reader.poll()
    assert [entry.event for entry in reader.entries] == ["mode", "late"]
