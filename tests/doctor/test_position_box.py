# SPDX-License-Identifier: GPL-3.0-or-later

"""The position box: what is wrong with it is told apart, and what is well about it is said."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.doctor import position_box
from mavproxy_handover.link.box_line import BoxLine, Fix
from mavproxy_handover.mission.geodesy import offset
from mavproxy_handover.wire.box_layout import FULL, THESIS, BoxLayout, BoxRecord
from tests.doctor.machine import Found, Speaker, companion, free_port, heartbeat

HERE = BoxRecord(0.0, 52.679, 5.924, 12.0, 0.0, 0.0, 0.0, 0.0, 0.0, 90.0, 12.0)
#: what a box sends each time
Says = Callable[[], bytes]
Try = Callable[..., Found]


def record(**changed: float) -> bytes:
    return FULL.pack(replace(HERE, time_s=time.monotonic() + changed.pop("early_s", 0.0), **changed))


def autopilot(lat: float, lon: float, *, armed: bool = False) -> bytes:
    """Heartbeat and position."""
    own = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    place = mavlink.MAVLink_global_position_int_message(0, round(lat * 1e7), round(lon * 1e7), 12_000, 0, 0, 0, 0, 0)
    return heartbeat(armed=armed) + bytes(place.pack(own))


@pytest.fixture
def attempt(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Iterator[Try]:
    """A companion with a box that says this, and an autopilot that says that; what the doctor finds."""
    opened: list[Speaker] = []
    # the autopilot tells its heartbeat and position; for what it is asked and never answers nobody waits here
    monkeypatch.setattr("mavproxy_handover.doctor.flight_controller._Visit._asked", lambda _visit: iter(()))

    def attempt(says: Says | str, source: str = "box", flies: Says | None = None, more: str = "") -> Found:
        box = says
        if not isinstance(says, str):
            opened.append(Speaker(says))
            box = opened[-1].device
        opened.append(Speaker(flies or (lambda: autopilot(HERE.lat_deg, HERE.lon_deg))))
        machine = companion(tmp_path, opened[-1].device, {"GCSA": 9, "GCSB": 10})
        layout = "" if "layout" in more else 'layout = "full"'
        text = f'\n[position]\nsource = "{source}"\nbox = "{box}"\n{layout}\n{more}\n'
        machine.config.write_text(machine.config.read_text() + text)
        return machine.doctor(capsys, "--no-links")

    yield attempt
    for speaker in opened:
        speaker.close()


def of_box(found: Found, level: str | None = None) -> list[str]:
    """Without the records that are shown."""
    return [line for line in found.of("position box", level) if not line.startswith("record ")]


def test_a_box_that_all_is_well_with(attempt: Try) -> None:
    found = attempt(record)
    layout, sends, place = of_box(found, "ok")
    assert layout == "its layout: 'full', as it is configured"
    assert " records a second, " in sends
    assert (
        place
        == "its position: 52.679000 5.924000, 12 m above sea level: 0.0 m and 0.0 m in height from the autopilot's"
    )
    assert len(of_box(found)) == 3


@pytest.mark.parametrize(
    ("says", "words"),
    [
        (lambda: b"", "connects, and sends nothing in 3 s -> Look whether it has started"),
        (lambda: b"\xff" * 80, "what it sends is no record: record 1: time nan"),
        (
            lambda: b"$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\r\n",
            "what it sends is no record: record 1: ",
        ),
        (lambda: record(lat_deg=math.nan), "its position: it does not know one -> Give it a view of the sky"),
        (lambda: record(lat_deg=HERE.lat_deg + 0.01), "box and autopilot 1113 m apart (limit 25 m) -> Find out which"),
        (lambda: record(alt_m=60.0), "48 m apart in height (limit 30 m) -> Find out which"),
        (lambda: record(east_mps=20.0), "20.0 m/s apart in speed (limit 8 m/s) -> Find out which"),
    ],
    ids=["silent", "noise", "another protocol", "no fix", "another place", "another height", "another speed"],
)
def test_a_planted_fault_of_the_box_is_found(attempt: Try, says: Says, words: str) -> None:
    found = attempt(says)
    (said,) = [line for line in found.lines("error") if line.startswith("position box: ")]
    assert words in said
    assert found.code == 1


def test_a_silent_box_whose_connection_was_given_up_just_before_is_told_in_the_same_words(
    attempt: Try, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a busy machine the doctor listens for a little longer than the time after which a line is given up."""
    monkeypatch.setattr("mavproxy_handover.doctor.position_box._LISTEN_S", 3.3)
    (said,) = [line for line in attempt(lambda: b"").lines("error") if line.startswith("position box: ")]
    assert "connects, and sends nothing in 3 s -> Look whether it has started" in said


def test_a_box_that_is_not_there(attempt: Try) -> None:
    found = attempt(f"tcp:127.0.0.1:{free_port()}")
    (said,) = [line for line in found.lines("error") if line.startswith("position box: ")]
    assert "cannot be reached (Connection refused) -> Look at its power and its cable" in said


def test_a_host_that_nobody_knows(attempt: Try) -> None:
    (said,) = of_box(attempt("tcp:no.such.host.invalid:4001"), "error")
    assert "link tcp:no.such.host.invalid:4001 cannot be opened" in said


def test_a_box_that_only_checks_is_no_error_when_it_is_silent(attempt: Try) -> None:
    found = attempt(lambda: b"", "autopilot")
    assert of_box(found, "error") == []
    assert "sends nothing" in of_box(found, "warning")[0]


def test_records_that_come_late_are_told(attempt: Try) -> None:
    begun = time.monotonic()

    def ever_later() -> bytes:  # its time goes at half the pace
        return FULL.pack(replace(HERE, time_s=100.0 + (time.monotonic() - begun) / 2))

    (said,) = of_box(attempt(ever_later), "warning")
    assert " ms late at most" in said


def test_a_box_that_begins_anew_all_the_time_is_told(attempt: Try) -> None:
    count = 0

    def backwards_now_and_then() -> bytes:
        nonlocal count
        count += 1
        return record(early_s=5.0 if count % 10 == 0 else 0.0)

    (said,) = of_box(attempt(backwards_now_and_then), "warning")
    assert "times in doubt or cut off: record " in said
    assert "runs backwards" in said


@pytest.mark.parametrize(
    ("flies", "words"),
    [
        (
            heartbeat,
            "its position: not looked at: 52.679000 5.924000, 12 m above sea level, and the autopilot",
        ),
        (lambda: autopilot(*offset(52.679, 5.924, 0, 90), armed=True), "and the vehicle is armed"),
    ],
    ids=["the autopilot tells none", "armed"],
)
def test_what_cannot_be_compared_is_told(attempt: Try, flies: Says, words: str) -> None:
    (said,) = of_box(attempt(record, flies=flies), "warning")
    assert words in said


# ---- its layout -----------------------------------------------------------------------------------------------------

#: a box that points to the east, as both layouts have it; UTC 2023-11-14 22:13:20 and on
EAST = replace(HERE, baro_m=75.0, agl_m=0.0, track_deg=0.0, speed_mps=0.0)
KNOWN = {"thesis": THESIS, "full": FULL}


def sent(layout: BoxLayout) -> Says:
    begun = time.monotonic() - 1700000000.0
    return lambda: layout.pack(replace(EAST, time_s=time.monotonic() - begun))


@pytest.fixture
def listens_for_two(monkeypatch: pytest.MonkeyPatch) -> None:
    """The doctor listens until it has two records, and not for a time: a busy machine needs longer."""

    class Line(BoxLine):
        def read(self) -> Fix | None:
            fix = super().read()
            if len(self.head) >= 2 * max(THESIS.size, FULL.size):
                monkeypatch.setattr(position_box, "_LISTEN_S", 0.0)
            return fix

    monkeypatch.setattr(position_box, "BoxLine", Line)
    monkeypatch.setattr(position_box, "_LISTEN_S", 60.0)


def test_a_box_of_the_thesis_is_as_it_is_configured(attempt: Try) -> None:
    layout, sends, place = of_box(attempt(sent(THESIS), more="# layout: the default"), "ok")
    assert layout == "its layout: 'thesis', as it is configured"
    assert " records a second, " in sends
    heights = "75 m pressure altitude, 0 m above ground by pressure"
    assert place == f"its position: 52.679000 5.924000, {heights}: 0.0 m from the autopilot's"


@pytest.mark.parametrize(("configured", "other"), [("thesis", "full"), ("full", "thesis")])
def test_the_wrong_layout_is_told_with_the_likely_one(attempt: Try, configured: str, other: str) -> None:
    found = attempt(sent(KNOWN[other]), more=f'layout = "{configured}"')
    (said,) = [line for line in found.lines("error") if line.startswith("position box: ")]
    assert said == (
        f"position box: its layout: sends layout '{other}', not '{configured}' (set layout = \"{other}\" in [position])"
        f" -> Set layout = \"{other}\" in [position], or have the box send layout '{configured}'."
    )
    assert of_box(found, "ok") == []


def test_a_box_that_only_checks_with_the_wrong_layout_is_a_warning(attempt: Try) -> None:
    found = attempt(sent(FULL), "autopilot", more='layout = "thesis"')
    assert of_box(found, "error") == []
    assert of_box(found, "warning")[0].startswith("its layout: sends layout 'full', not 'thesis'")


@pytest.mark.usefixtures("listens_for_two")
def test_the_first_records_are_shown_under_each_layout(attempt: Try) -> None:
    found = attempt(sent(THESIS), more='layout = "full"')
    shown = [line for line in found.of("position box", "ok") if line.startswith("record ")]
    assert [line.partition(":")[0] for line in shown] == [
        "record 1 as 'full'",
        "record 1 as 'thesis'",
        "record 2 as 'full'",
        "record 2 as 'thesis'",
    ]
    # the box has sent for a while before somebody listens
    assert re.search(r": Time 17000000\d\d(\.\d+)? s \(2023-11-14 22:1[345]:\d\d UTC\), Latitude ", shown[1])
    assert shown[1].endswith(
        " UTC), Latitude 0.919421996658 rad, Longitude 0.103393304888 rad, "
        "BaroHeight 75 m, AglHeight 0 m, TrueTrack 0 rad, TrueHeading 1.5708 rad, GroundSpeed 0 m/s, "
        "EastVelocity 0 m/s, NorthVelocity 0 m/s, UpVelocity -0 m/s"
    )
    assert "alt 75 m, vel_north 0 m/s, vel_east 0 m/s, vel_up 1.5708 m/s, roll 0 rad" in shown[0]


def test_what_cannot_be_in_a_record_is_marked(attempt: Try) -> None:
    found = attempt(lambda: b"\xff" * 56)
    shown = [line for line in found.of("position box", "ok") if line.startswith("record 1 as 'full'")]
    assert shown[0].endswith(" (not possible: time nan must be 0 to 1e+11 s)")


def test_a_layout_that_is_undecided_says_what_to_do(attempt: Try) -> None:
    found = attempt(lambda: record(heading_deg=0.0), flies=heartbeat)
    (said,) = [line for line in found.lines("warning") if "position box: its layout" in line]
    assert "layout 'full' not recognised yet (the autopilot needs a position; or turn or move the aircraft) -> " in said
    assert said.endswith(
        "Give the autopilot a fix, or turn the aircraft away from north, and look again: START waits for it."
    )


def test_without_a_box_there_is_nothing_to_tell(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    speaker = Speaker(lambda: heartbeat(armed=True))
    try:
        machine = companion(tmp_path, speaker.device, {"GCSA": 9, "GCSB": 10})
        assert of_box(machine.doctor(capsys, "--no-links")) == []
    finally:
        speaker.close()
