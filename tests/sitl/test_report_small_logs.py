# SPDX-License-Identifier: GPL-3.0-or-later

"""Reports of short, old and odd logs: each says what the log shows, and none ends in a traceback.

The logs in `tests/data/logs` are small ones of our own making: one position, one position in the air, two flights with
ten minutes on the ground between them, and a log as ArduCopter 3.1 wrote it (no POS, no ARM, GPS without TimeUS).
"""

from __future__ import annotations

import html
import json
import re
import struct
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.vehicle.profiles import COPTER
from sitl.replay.reading import read_recording
from sitl.replay.recording import RecordingError
from sitl.report.dataflash import corrections_logged
from sitl.report.page import main_report
from tests.sitl.recorded import companion_entries, journal, station_entries

LOGS = Path(__file__).parents[1] / "data" / "logs"
ARMED = 128


def words_of(page: Path) -> str:
    """What a reader sees of the page."""
    text = re.sub(r"<(style|script).*?</\1>", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    return re.sub(r"\s+", " ", html.unescape(re.sub(r"<[^>]+>", " ", text)))


def report(log: Path, folder: Path) -> str:
    page = folder / "report.html"
    assert main_report([str(log), "--out", str(page)]) == 0
    return words_of(page)


def tlog(path: Path, heights_m: list[float], *, armed: bool, begun_s: float = 1.7e9) -> Path:
    """A telemetry log with a heartbeat and a position each second, moving north."""
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    data = b""
    for second, height_m in enumerate(heights_m):
        stamp = struct.pack(">Q", int((begun_s + second) * 1e6))
        base = 81 | (ARMED if armed else 0)
        beat = mavlink.MAVLink_heartbeat_message(2, 3, base, 4, 4, 3)
        lat, alt = 520_000_000 + 100 * second, int(height_m * 1000)
        place = mavlink.MAVLink_global_position_int_message(
            1000 * second, lat, 50_000_000, 10_000 + alt, alt, 0, 0, 0, 0
        )
        data += b"".join(stamp + message.pack(sender) for message in (beat, place))
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("name", ["one_sample", "one_above", "none_above"])
def test_a_log_with_hardly_a_position_gives_a_page(name: str, tmp_path: Path) -> None:
    words = report(LOGS / f"{name}.tlog", tmp_path)
    assert "It did not leave the ground." in words
    assert "No position is known" not in words


def test_two_flights_in_one_log_are_counted_without_the_time_on_the_ground(tmp_path: Path) -> None:
    """Each is 30 s in the air; ten minutes lie between them."""
    words = report(LOGS / "two_hops.tlog", tmp_path)
    assert "after 2 flights, 1 min 0 s in the air" in words
    assert "11 min" not in words.partition("Decisions")[0]


def test_a_log_that_begins_in_the_air_says_so(tmp_path: Path) -> None:
    words = report(tlog(tmp_path / "late.tlog", [50.0] * 20 + [0.0] * 5, armed=True), tmp_path)
    assert "The record begins in the air, 50 m above home." in words
    assert "T+ counts from the first entry" in words
    cut = report(tlog(tmp_path / "cut.tlog", [50.0] * 20, armed=True), tmp_path)
    assert "The record begins in the air, 50 m above home." in cut
    assert "What is recorded ends in the air, 50 m above home" in cut


def test_a_log_that_begins_on_the_ground_does_not_say_so(tmp_path: Path) -> None:
    words = report(tlog(tmp_path / "whole.tlog", [0.0] * 3 + [50.0] * 20, armed=True), tmp_path)
    assert "begins in the air" not in words
    assert "T+ counts from take-off" in words


def test_an_old_dataflash_log_tells_that_the_aircraft_flew(tmp_path: Path) -> None:
    """It was up to 25 m high for most of a minute."""
    words = report(LOGS / "copter31.bin", tmp_path)
    assert re.search(r"Landed at 52\.\d+ 5\.000000 after \d+\.\d+ s in the air", words), words[:400]
    assert "by the height alone" in words
    assert "Modes flown: STABILIZE" in words
    assert "No position is known" not in words


def test_a_dataflash_log_without_gps_time_has_no_time_of_day(tmp_path: Path) -> None:
    """Its times are seconds since the autopilot was started, which would be the first of January 1970."""
    log = tmp_path / "no_gps_time.log"
    lines = ["FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns"]
    lines.append("FMT, 130, 30, POS, QLLfff, TimeUS,Lat,Lng,Alt,RelHomeAlt,RelOriginAlt")
    lines.append("FMT, 131, 13, ARM, QBI, TimeUS,ArmState,ArmChecks")
    lines.append("ARM, 5000000, 1, 0")
    for second in range(5, 40):
        height_m = min(second - 5, 10, 39 - second)
        lines.append(f"POS, {second * 1000000}, 52.{second:07d}, 5.0, {height_m + 10.0}, {height_m}, {height_m}")
    lines.append("ARM, 40000000, 0, 0")
    log.write_text("\n".join(lines) + "\n")
    words = report(log, tmp_path)
    assert "1970" not in words
    assert "UTC is not known" in words
    assert "in the air" in words


def test_a_file_name_is_a_path_in_the_links_of_a_page(tmp_path: Path) -> None:
    """A browser would run a file called `javascript:...`."""
    name = "javascript:alert(1)%41 #.tlog"
    tlog(tmp_path / name, [0.0, 0.0], armed=False)
    assert main_report([str(tmp_path)]) == 0
    (link,) = [
        each for each in re.findall(r'href="([^"]+)"', (tmp_path / "report.html").read_text()) if "alert" in each
    ]
    assert link == "./javascript%3Aalert%281%29%2541%20%23.tlog"


def test_latest_is_the_whole_flight_and_not_only_the_last_run(tmp_path: Path) -> None:
    """The last folder may be that of a station that was started anew."""
    base = tmp_path / "flights"
    for name, entries in (
        ("20230914T221300Z-drone-1", companion_entries()),
        ("20230914T221330Z-GCSA", station_entries()),
    ):
        folder = base / name
        folder.mkdir(parents=True)
        who = name.partition("-")[2]
        journal(folder / f"{who}.jsonl", who, entries)
    (base / "latest").symlink_to("20230914T221330Z-GCSA")
    assert main_report([str(base / "latest")]) == 0
    words = words_of(base / "20230914T221330Z-GCSA" / "report.html")
    assert "drone-1.jsonl" in words
    assert "GCSA.jsonl" in words


def test_a_program_reads_the_outcome_as_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    journal(tmp_path / "drone-1.jsonl", "drone-1", companion_entries())
    assert main_report([str(tmp_path), "--csv", str(tmp_path / "track.csv"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["held"] is None
    assert told["files"] == [str(tmp_path / "report.html"), str(tmp_path / "track.csv")]
    assert [vehicle["vehicle"] for vehicle in told["vehicles"]] == ["drone-1"]
    lines = told["vehicles"][0]["outcome"]
    assert lines
    assert {line["gravity"] for line in lines} <= {"plain", "good", "warning", "bad"}
    words = words_of(tmp_path / "report.html")
    assert all(line["text"] in words for line in lines)


def test_a_telemetry_log_with_another_name_is_no_dataflash_log(tmp_path: Path) -> None:
    """pymavlink's reader writes a line for each byte that it cannot read: 189,000 lines for one file."""
    log = tmp_path / "flight.bin"
    log.write_bytes((LOGS / "two_hops.tlog").read_bytes())
    with pytest.raises(RecordingError, match=r"flight\.bin: not a dataflash log: it does not begin like one"):
        read_recording(log, COPTER)


def record(number: int, pattern: str, *values: object) -> bytes:
    return b"\xa3\x95" + bytes([number]) + struct.pack(pattern, *values)


def test_the_newest_log_tells_when_corrections_came(tmp_path: Path) -> None:
    assert corrections_logged(tmp_path) is None
    columns = b"TimeUS,Chan,RTCMId,Len,CRC"
    formats = record(128, "<BB4s16s64s", 128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns")
    formats += record(128, "<BB4s16s64s", 140, 20, b"RTCM", b"QBHHI", columns)
    rows = b"".join(record(140, "<QBHHI", round(s * 1e6), 1, 1005, 25, 7) for s in (30.5, 31.5))
    (tmp_path / "00000001.BIN").write_bytes(formats)
    assert corrections_logged(tmp_path) == []
    (tmp_path / "00000002.BIN").write_bytes(formats + rows)
    assert corrections_logged(tmp_path) == [30.5, 31.5]
