# SPDX-License-Identifier: GPL-3.0-or-later

"""What all tried programs share: options, the journal, and words that are typed to them.

The tests start each program in an environment of its own, where nothing of this project is installed. So this file uses
the standard library only. A program reads one word in a line and writes one `command` entry for it: `what` is the word,
`result` is the program's own answer, `took_s` the seconds until that answer. Texts of the vehicle are `said` entries.
"""

from __future__ import annotations

import argparse
import json
import queue
import sys
import threading
import time
from collections.abc import Callable, Mapping
from datetime import datetime, timezone
from pathlib import Path
from typing import TextIO

__all__ = ["COMMAND_RESULTS", "MISSION", "PARAMETER", "Journal", "Program", "Texts", "arguments", "serve"]

#: word -> what does the job: the program's own answer and, for what was read, how many of it
Jobs = Mapping[str, Callable[[], tuple[str, "int | None"]]]

#: MAV_RESULT in words
COMMAND_RESULTS = ("accepted", "temporarily_rejected", "denied", "unsupported", "failed", "in_progress", "cancelled")
#: what `upload` sends: command, latitude and longitude in degrees, height above home in metres; the first is home
MISSION = (
    (16, 52.6767, 5.9222, 0.0),
    (22, 52.6767, 5.9222, 12.0),
    (16, 52.677, 5.9222, 12.0),
)
#: what `param` sets
PARAMETER = ("FS_OPTIONS", 0.0)
#: a piece of a text that is shorter ends it
_PIECE = 50


def arguments(description: str | None) -> argparse.Namespace:
    """The options of every program: who it is, and where it finds the vehicle."""
    parser = argparse.ArgumentParser(description=(description or "").partition("\n")[0])
    parser.add_argument("--name", required=True, help="of the station, in the journal")
    parser.add_argument("--sysid", type=int, required=True, help="of the station")
    parser.add_argument("--vehicle", type=int, default=1, help="system id of the vehicle")
    parser.add_argument("--journal", type=Path, required=True)
    parser.add_argument("--control", type=Path, help="definitions of operator control, XML; only MAVSDK reads them")
    parser.add_argument(
        "--no-heartbeats", action="store_true", help="send no heartbeats; only pymavlink's program knows it"
    )
    place = parser.add_mutually_exclusive_group(required=True)
    place.add_argument("--listen", type=int, help="UDP port to which the companion sends")
    place.add_argument("--tcp", type=int, help="TCP port of the vehicle")
    return parser.parse_args()


class Journal:
    """Writes entries as all journals of this project have them."""

    def __init__(self, name: str, file: TextIO) -> None:
        self._name, self._file = name, file
        self._lock = threading.Lock()

    def note(self, event: str, text: str = "", **values: object) -> None:
        """Write one entry. Any thread may."""
        now = datetime.now(timezone.utc).isoformat(timespec="milliseconds")
        entry = {"t": round(time.monotonic(), 4), "utc": now, "who": self._name, "event": event, "text": text, **values}
        with self._lock:
            self._file.write(json.dumps(entry) + "\n")


class Texts:
    """STATUSTEXT as `said` entries. The pieces of a long text are joined."""

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self._pieces: dict[tuple[int, int], str] = {}

    def take(self, component: int, number: int, text: str, severity: int) -> None:
        """Take in one message. `number`: the id that the pieces of a long text share, else 0."""
        whole = self._pieces.pop((component, number), "") + text
        if number and len(text) == _PIECE:
            self._pieces[component, number] = whole
            return
        self._journal.note("said", " ".join(whole.split()), severity=severity, component=component)


class _Typed:
    """The words that were typed, read by a thread."""

    def __init__(self) -> None:
        self._lines: queue.Queue[str | None] = queue.Queue()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        for line in sys.stdin:
            self._lines.put(line.strip())
        self._lines.put(None)

    def next(self) -> str | None:
        """The next word; "" if there is none; None if the input has ended."""
        try:
            return self._lines.get_nowait()
        except queue.Empty:
            return ""


class Program:
    """A program that is tried."""

    jobs: Jobs

    def idle(self) -> None:
        """Nothing is typed."""
        time.sleep(0.05)

    def end(self) -> None:
        """The input has ended."""


def serve(
    description: str | None,
    version: str,
    make: Callable[[str, argparse.Namespace, Journal], Program],
) -> None:
    """Do what is typed until the input ends. `make` gets the vehicle's address in pymavlink's form."""
    options = arguments(description)
    address = f"tcp:127.0.0.1:{options.tcp}" if options.tcp else f"udpin:127.0.0.1:{options.listen}"
    with options.journal.open("a", encoding="utf-8", buffering=1) as file:
        journal = Journal(options.name, file)
        program = make(address, options, journal)
        typed = _Typed()
        journal.note("loaded", version)
        while (word := typed.next()) is not None:
            if word:
                _carry_out(word, program.jobs, journal)
            else:
                program.idle()
        program.end()


def _carry_out(word: str, jobs: Jobs, journal: Journal) -> None:
    """Do one job and write what came of it. An exception of the program is its answer."""
    began = time.monotonic()
    try:
        result, count = jobs[word]() if word in jobs else ("unknown word", None)
    except Exception as error:  # what the program raises is what its user sees
        result, count = f"raised {error!r}", None
    took_s = round(time.monotonic() - began, 4)
    more = {} if count is None else {"count": count}
    journal.note("command", f"{word}: {result}", what=word, result=result, took_s=took_s, **more)
