# SPDX-License-Identifier: GPL-3.0-or-later

"""MAVProxy's lines at a station: noise is left out, each event is told once, and no refusal is lost."""

from __future__ import annotations

import pytest

from gcs_module.terminal.lines import ConsoleLines
from gcs_module.terminal.noise import NOISE, TWICE, is_noise

REFUSED = "Got COMMAND_ACK: DO_SET_MODE: NOT_IN_CONTROL"


class Console:
    """MAVProxy's console."""

    def __init__(self) -> None:
        self.lines: list[tuple[str, str]] = []

    def writeln(self, text: str, fg: str = "black", bg: str = "white") -> None:
        self.lines.append((text, fg))


class Bench:
    """The filter with a console and a clock."""

    def __init__(self) -> None:
        self.console = Console()
        self.now = 100.0
        self.all = False
        self.filter = ConsoleLines(lambda: self.console, lambda: self.now, lambda: self.all)
        self.filter.tick()

    def shown(self) -> list[str]:
        return [text for text, _colour in self.console.lines]


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_the_line_of_a_refusal_is_left_out_when_the_vehicle_says_why(bench: Bench) -> None:
    bench.console.writeln(REFUSED)
    assert bench.shown() == []
    bench.filter.said("mode RTL refused: GCSA commands ('handover request')")
    bench.now += 2.0
    bench.filter.tick()
    assert bench.shown() == []


def test_a_refusal_without_a_text_is_shown_after_a_second(bench: Bench) -> None:
    bench.console.writeln(REFUSED)
    bench.now += 0.9
    bench.filter.tick()
    assert bench.shown() == []
    bench.now += 0.2
    bench.filter.tick()
    assert bench.shown() == [REFUSED]


def test_one_text_is_for_one_refusal(bench: Bench) -> None:
    other = "Got COMMAND_ACK: NAV_TAKEOFF: DENIED"
    bench.console.writeln(REFUSED)
    bench.console.writeln(other)
    bench.filter.said("mode RTL refused: GCSA commands")
    bench.now += 2.0
    bench.filter.tick()
    assert bench.shown() == [other]


@pytest.mark.parametrize(
    "line",
    [
        "Got COMMAND_ACK: DO_SET_MODE: ACCEPTED",
        "Got COMMAND_ACK: NAV_LAND: IN_PROGRESS",
        "Mode RTL",
        "AP: mode RTL refused: GCSA commands",
    ],
)
def test_every_other_line_is_shown_at_once(bench: Bench, line: str) -> None:
    bench.console.writeln(line, fg="red")
    assert bench.console.lines == [(line, "red")]


def test_a_text_without_a_refusal_leaves_the_line(bench: Bench) -> None:
    bench.console.writeln(REFUSED)
    bench.filter.said("PreArm: Compass not healthy")
    bench.now += 2.0
    bench.filter.tick()
    assert bench.shown() == [REFUSED]


def test_a_console_that_replaces_the_first_one_is_filtered_as_well(bench: Bench) -> None:
    first, bench.console = bench.console, Console()
    bench.filter.tick()
    bench.console.writeln(REFUSED)
    first.writeln("Mode RTL")
    assert bench.shown() == []
    assert first.lines == [("Mode RTL", "black")]


def test_at_the_end_what_waits_is_shown_and_the_console_is_as_before(bench: Bench) -> None:
    bench.console.writeln(REFUSED)
    bench.filter.release()
    assert bench.shown() == [REFUSED]
    bench.console.writeln(REFUSED)
    assert bench.shown() == [REFUSED, REFUSED]
    assert "writeln" not in vars(bench.console)


def test_a_flood_of_refusals_is_not_kept(bench: Bench) -> None:
    for _ in range(50):
        bench.console.writeln(REFUSED)
    assert len(bench.shown()) == 50 - ConsoleLines.WAITING


NOISY = (
    "200",
    "height 15",
    "waypoint 3",
    "AP: No ap_message for mavlink id (168)",
    "Detected vehicle 1:191 on link 0",
    "Got COMMAND_ACK: MISSION_START: IN_PROGRESS",
    "Got MISSION_ACK: TYPE_RALLY: ACCEPTED",
)
#: lines that say something, and look like noise
TELLING = (
    "Got COMMAND_ACK: MISSION_START: DENIED",
    "Got MISSION_ACK: TYPE_MISSION: DENIED",
    "AP: PreArm: Compass not healthy",
    "AP: Mission: 3 WP",
    "AP: EKF variance",
    "AP: HNDO: no authority, RTL",
    "Mode RTL",
    "ARMED",
    "height 15 m is too low",
    "link 1 down",
    "Unloading module handover_gcs",
)


@pytest.mark.parametrize("line", NOISY)
def test_noise_is_left_out_unless_all_is_wanted(bench: Bench, line: str) -> None:
    bench.console.writeln(line)
    assert bench.shown() == []
    bench.all = True
    bench.console.writeln(line)
    assert bench.shown() == [line]


@pytest.mark.parametrize("line", TELLING)
def test_a_line_that_says_something_comes(bench: Bench, line: str) -> None:
    assert not is_noise(line)
    bench.console.writeln(line)
    bench.now += 1.1
    bench.filter.tick()
    assert bench.shown() == [line]


SAID = "RETURN to rally 2. GCSA silent for 3 s. 538 m away"
ONCE = (
    ("AP: GCSB commands now (handover 1)", "I have drone-1: GCSB is the commander now, epoch 2."),
    ("AP: GCSB commands now", "GCSB has drone-1: GCSB commands now, epoch 2."),
    ("AP: no station commands now", "EMERGENCY: No station commands drone-1."),
    (f"AP: {SAID}", f"EMERGENCY: {SAID}. When it is in your zone, type 'handover request' to take over."),
    ("AP: ALL CLEAR. Over: commander lost", "ALL CLEAR. Over: commander lost"),
    ("AP: Control denied: GCSB has no mission", "REQUEST refused: GCSB has no mission."),
)


@pytest.mark.parametrize(("line", "own"), ONCE)
@pytest.mark.parametrize("first", ["MAVProxy", "the station"])
def test_an_event_is_told_once_by_the_station(bench: Bench, line: str, own: str, first: str) -> None:
    own = f"[12:37:03|GCSB][ONMISSION]: {own}"
    for each in (line, own) if first == "MAVProxy" else (own, line):
        bench.console.writeln(each)
        bench.now += 0.4
        bench.filter.tick()
    bench.now += 2.0
    bench.filter.tick()
    assert bench.shown() == [own]


@pytest.mark.parametrize("line", [line for line, _own in ONCE])
def test_an_event_that_the_station_does_not_tell_comes_a_second_later(bench: Bench, line: str) -> None:
    bench.console.writeln("[12:37:03|GCSB][ONMISSION]: Ground link to GCSA is down.")
    bench.console.writeln(line)
    assert len(bench.shown()) == 1
    bench.now += 1.1
    bench.filter.tick()
    assert bench.shown()[1:] == [line]


def test_a_text_about_a_refusal_ends_the_wait_of_an_answer_and_not_of_an_event(bench: Bench) -> None:
    bench.console.writeln("AP: ALL CLEAR. Over: commander lost")
    bench.console.writeln(REFUSED)
    bench.filter.said("mode RTL refused: GCSA commands")
    bench.now += 1.1
    bench.filter.tick()
    assert bench.shown() == ["AP: ALL CLEAR. Over: commander lost"]


def test_each_row_says_why() -> None:
    assert all(row.why for row in NOISE)
    assert all(row.own for row in TWICE)


@pytest.mark.parametrize(
    ("said", "shown"),
    [
        ("AP: \x1b]52;c;bHM=\x07\x1b[2Jx", "AP: ]52;c;bHM=[2Jx"),
        ("AP: \x1b[8mhidden", "AP: [8mhidden"),
        ("AP: \x9b2Jx\rYOU", "AP: 2JxYOU"),
        ("AP: x\n[12:31:54|GCSA]: GCSA commands", "AP: x [12:31:54|GCSA]: GCSA commands"),
        ("AP: \u202ederomra", "AP: deromra"),
        ("two\nlines\tof MAVProxy", "two\nlines\tof MAVProxy"),
    ],
)
def test_a_text_of_the_vehicle_commands_no_terminal(bench: Bench, said: str, shown: str) -> None:
    bench.console.writeln(said)
    assert bench.shown() == [shown]
