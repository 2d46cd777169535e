# SPDX-License-Identifier: GPL-3.0-or-later

"""The story in the terminal: what is told of an entry, and what it looks like."""

from __future__ import annotations

import io
import re

import pytest

from sitl.report.journal_reader import Entry
from sitl.run.story import Story, sentence


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(
    ("entry", "told"),
    [
        (
            Entry(1, "drone-1", "transfer_committed", "x", {"handover_id": 2, "station": "GCSB", "duration_s": 0.0124}),
            "handover 2 committed in 12 ms: GCSB commands",
        ),
        (Entry(1, "drone-1", "accepted", "", {"station": "GCSA", "what": "SET_MODE"}), "SET_MODE of GCSA accepted"),
        (Entry(1, "drone-1", "zone_left", "zone of GCSA left"), "zone of GCSA left"),
        (Entry(1, "vehicle", "mode", "mode RTL", {"mode": "RTL"}), "mode RTL"),
        (Entry(1, "vehicle", "said", "HNDO: lease lost, RTL", {"severity": 2}), "says: HNDO: lease lost, RTL"),
        (Entry(1, "vehicle", "said", "EKF3 IMU0 origin set", {"severity": 6}), None),
        (Entry(1, "drone-1", "mode", "mode RTL", {"mode": "RTL"}), None),
        (Entry(1, "drone-1", "position", "", {"lat_deg": 1.0}), None),
        (Entry(1, "GCSA", "command", "STOP sent", {"what": "STOP"}), None),
        (Entry(1, "GCSA", "command", "x", {"what": "STOP", "result": "not_in_control"}), "STOP: not in control"),
        (Entry(1, "GCSA", "fault", "idle: Traceback\n  File x\nKeyError: 'a'"), "FAULT: idle: KeyError: 'a'"),
    ],
)
def test_what_is_told_of_an_entry(entry: Entry, told: str | None) -> None:
    assert sentence(entry) == told


def test_a_line_has_simulated_time_and_who() -> None:
    stream = io.StringIO()
    Story(stream).entry(Entry(1, "drone-1", "zone_left", "zone of GCSA left"), 83.24)
    assert stream.getvalue() == "   83.2 s  drone-1   zone of GCSA left\n"


def test_colour_is_for_terminals_only() -> None:
    entry = Entry(1, "drone-1", "connected", "GCSB is connected", {"station": "GCSB"})
    plain, terminal = io.StringIO(), Terminal()
    Story(plain, ["GCSA", "GCSB"]).entry(entry, 1.0)
    Story(terminal, ["GCSA", "GCSB"]).entry(entry, 1.0)
    assert "\033" not in plain.getvalue()
    assert terminal.getvalue().startswith("\033[38;5;208m")


def test_progress_on_a_terminal_is_wiped_by_the_next_line() -> None:
    terminal = Terminal()
    story = Story(terminal)
    story.progress("waiting for landing", 5.0)
    story.line("landed")
    assert "waiting for landing" in terminal.getvalue()
    assert terminal.getvalue().index("\r\033[K", 1) < terminal.getvalue().index("landed\n")


def test_no_color_leaves_the_colours_out_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_COLOR", "1")
    terminal = Terminal()
    story = Story(terminal, ["GCSA"])
    story.heading("nominal")
    story.entry(Entry(1, "drone-1", "zone_left", "zone of GCSA left", {"station": "GCSA"}), 1.0)
    story.verdict(True, "one handover")
    story.progress("flies", 2.0)
    assert re.findall(r"\033\[[0-9;]*m", terminal.getvalue()) == []
