# SPDX-License-Identifier: GPL-3.0-or-later

"""Follows the journals of several processes while they grow, and reads them afterwards.

A journal is a file of JSON lines; `t` is monotonic time, which all processes of one machine share, so `t` puts the
entries of different files in order. What may be wrong with a file, because a process can be killed at any moment: it
does not exist yet, its last line is half-written, a line is broken. None of that raises; broken lines are counted.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mavproxy_handover.store.journal import strangers_path

__all__ = ["Entry", "JournalReader", "is_number", "parse_line", "read_journals"]


#: monotonic seconds that no machine has seen, UTC included
_LATEST_T = 1e10
#: fields that are numbers; one that is none is left out
_NUMBERS = frozenset((
    "alt_m", "also", "attempt", "duration_s", "epoch", "handover_id", "heading_deg", "lat_deg", "lon_deg", "percent",
    "sim_s", "speed_mps", "volts",
))  # fmt: skip
#: no number in a journal is larger
_LARGEST = 1e12


def is_number(value: object) -> bool:
    """Whether it is a number that a program of ours writes: finite, and of a size that can be."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) < _LARGEST


@dataclass(frozen=True, slots=True)
class Entry:
    """One entry of a journal. `t` is monotonic seconds; `fields` has everything that is not an attribute here."""

    t: float
    who: str
    event: str
    text: str = ""
    fields: Mapping[str, Any] = field(default_factory=dict)

    def get(self, key: str, default: Any = None) -> Any:
        """Any value of the entry by its name in the file, the attributes included."""
        if key in ("t", "who", "event", "text"):
            return getattr(self, key)
        return self.fields.get(key, default)

    def to_line(self) -> str:
        """The entry as it stands in a file, without the line end."""
        plain = {"t": round(self.t, 4), "who": self.who, "event": self.event}
        if self.text:
            plain["text"] = self.text
        return json.dumps({**plain, **self.fields}, ensure_ascii=False)


def parse_line(line: str) -> Entry | None:
    """The entry in a line, None when there is none in it."""
    try:
        values = json.loads(line)
        if "\\ud" in line.lower():  # an escape may stand for half a character, which no file can hold
            values = json.loads(json.dumps(values, ensure_ascii=False).encode("utf-8", "replace"))
    except (ValueError, RecursionError):
        return None
    if not isinstance(values, dict):
        return None
    t, who, event = values.pop("t", None), values.pop("who", None), values.pop("event", None)
    text = values.pop("text", "")
    if not isinstance(t, (int, float)) or isinstance(t, bool) or not isinstance(event, str) or not isinstance(who, str):
        return None
    if not abs(t) < _LATEST_T:  # NaN and infinity are refused too
        return None
    plain = {key: value for key, value in values.items() if key not in _NUMBERS or is_number(value)}
    return Entry(float(t), who, event, str(text), plain)


class _Follower:
    """One growing file."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.broken = 0
        self._offset = 0
        self._rest = b""

    def read(self) -> list[Entry]:
        try:
            with self.path.open("rb") as file:
                size = file.seek(0, 2)
                if size < self._offset:  # the file was rolled over and starts again
                    self._offset, self._rest = 0, b""
                file.seek(self._offset)
                data = file.read()
        except FileNotFoundError:
            return []
        self._offset += len(data)
        *lines, self._rest = (self._rest + data).split(b"\n")
        found = []
        for line in lines:
            entry = parse_line(line.decode("utf-8", errors="replace"))
            if entry is not None:
                found.append(entry)
            elif line.strip():
                self.broken += 1
        return found


class JournalReader:
    """The journals of a run as one sequence that grows.

    `entries` stands in the order of arrival: what came in one `poll` is sorted by time; an index into it stays valid.
    """

    def __init__(self) -> None:
        self.entries: list[Entry] = []
        self._followers: list[_Follower] = []

    @property
    def broken(self) -> int:
        """Lines that were no entries."""
        return sum(follower.broken for follower in self._followers)

    def follow(self, path: Path) -> None:
        """Follow a file, which need not exist yet, and the one of the strangers beside it."""
        self._followers += [_Follower(path), _Follower(strangers_path(path))]

    def add(self, entries: Iterable[Entry]) -> None:
        """Take in entries that come from elsewhere than a file."""
        self.entries.extend(entries)

    def poll(self) -> list[Entry]:
        """Read what is new in every file; returns it, sorted by time."""
        new = [entry for follower in self._followers for entry in follower.read()]
        new.sort(key=lambda entry: entry.t)
        self.entries.extend(new)
        return new


def read_journals(paths: Iterable[Path]) -> list[Entry]:
    """All entries of the files, sorted by time; entries of one file keep their order."""
    reader = JournalReader()
    for path in paths:
        reader.follow(path)
    reader.poll()
    return reader.entries
