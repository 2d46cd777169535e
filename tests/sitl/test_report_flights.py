# SPDX-License-Identifier: GPL-3.0-or-later

"""Reports of flights that nobody staged: of journals, telemetry logs and dataflash logs, in any combination."""

from __future__ import annotations

import csv
import json
import os
import re
import sys
from pathlib import Path
from xml.etree import ElementTree as Xml

import pytest

from mavproxy_handover.tools.resources import shipped
from sitl.report.exchange import exchanges
from sitl.report.export import COLUMNS
from sitl.report.page import main_report
from sitl.report.record import RecordError, RunRecord, load
from sitl.report.times import Times
from tests.sitl.recorded import (
    BEGUN_UTC,
    companion_entries,
    companion_log,
    dataflash,
    journal,
    station_entries,
    station_log,
)

#: modes 0, 11, 21 and 99
_PLANE, _COPTER = ["MANUAL", "RTL", "QRTL", "mode 99"], ["STABILIZE", "DRIFT", "SMART_RTL", "mode 99"]
KML = "{http://www.opengis.net/kml/2.2}"


def clocks(record: RunRecord) -> dict[str, str]:
    return {source.path.name: source.clock for source in record.sources}


def commanders(record: RunRecord) -> list[str]:
    return [change.commander for change in record.evidence.commanders()]


def test_the_log_of_a_station_alone_tells_a_whole_flight(tmp_path: Path) -> None:
    record = load([station_log("GCSB").write(tmp_path / "GCSB.tlog")])
    (story,) = record.stories
    assert story.vehicle == "drone-1"
    assert story.witness == "the telemetry log of GCSB"
    assert commanders(record) == ["station 251", "GCSB"]
    assert story.evidence.modes_flown() == ["AUTO", "RTL"]
    (transfer,) = exchanges(story.evidence)
    assert (transfer.committed, transfer.partner, round(transfer.duration_s or 0, 3)) == (True, "GCSB", 0.2)
    # what the other station said is not in this log, and is not lost for that
    assert not any(flight.lost for flight in transfer.flights)
    (emergency,) = story.evidence.of(event="emergency")
    assert emergency.t == pytest.approx(BEGUN_UTC + 40.5)
    assert clocks(record) == {"GCSB.tlog": "0.08 s ahead, shifted: GPS time, 62 readings"}


def test_the_log_of_the_autopilot_alone_tells_who_commanded(tmp_path: Path) -> None:
    record = load([dataflash(tmp_path / "00000001.BIN")])
    evidence = record.evidence
    assert commanders(record) == ["station 251", "station 252"]
    assert evidence.modes_flown() == ["AUTO", "RTL"]
    assert record.by_gps
    times = Times(evidence)
    assert times.zero_is == "take-off"
    assert times.utc(evidence.of(event="airborne")[0].t) == "14:13:22.0"
    assert times.plus(evidence.of(event="landed")[0].t) == "T+0:58.0"
    assert [entry.get("percent") for entry in evidence.of(event="battery")][::59] == [100, 71]
    assert len(evidence.samples) == 300


def test_a_dataflash_log_as_text_is_read_too(tmp_path: Path) -> None:
    log = tmp_path / "1.log"
    log.write_text(
        "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\n"
        "FMT, 131, 31, POS, QLLfff, TimeUS,Lat,Lng,Alt,RelHomeAlt,RelOriginAlt\n"
        "FMT, 133, 12, EV, QB, TimeUS,Id\n"
        "EV, 40000000, 10\n"
        "POS, 41000000, 52.684, 5.91, 1.0, 1.0, 1.0\n"
        "POS, 42000000, 52.685, 5.91, 9.0, 9.0, 9.0\n"
        "EV, 50000000, 11\n",
        encoding="utf-8",
    )
    record = load([log])
    assert [entry.event for entry in record.evidence.entries if entry.event != "sample"] == [
        "armed", "airborne", "landed", "disarmed",
    ]  # fmt: skip
    assert clocks(record) == {"1.log": "not shifted: no GPS time in it, and nothing to compare with"}


@pytest.mark.parametrize(
    ("tells", "modes"),
    [
        ("MSG, 40100000, ArduPlane V4.7.0-dev (3f9c5a5)", _PLANE),
        ("VER, 40100000, 4, 7, 0, 3", _PLANE),
        ("MSG, 40100000, ArduCopter V4.7.0-dev (3f9c5a5)", _COPTER),
        ("VER, 40100000, 4, 7, 0, 2", _COPTER),
        ("EV, 40100000, 10", _COPTER),
    ],
)
def test_the_modes_of_a_dataflash_log_have_the_names_of_its_vehicle(
    tmp_path: Path, tells: str, modes: list[str]
) -> None:
    """What tells the vehicle may stand behind the first mode."""
    log = tmp_path / "1.log"
    log.write_text(
        "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\n"
        "FMT, 132, 14, MODE, QMBB, TimeUS,Mode,ModeNum,Rsn\n"
        "FMT, 133, 12, EV, QB, TimeUS,Id\n"
        "FMT, 134, 75, MSG, QZ, TimeUS,Message\n"
        "FMT, 136, 15, VER, QBBBB, TimeUS,Maj,Min,Pat,BU\n"
        "MODE, 40000000, 0, 0, 1\n"
        f"{tells}\n"
        "MODE, 42000000, 11, 11, 1\n"
        "MODE, 43000000, 21, 21, 1\n"
        "MODE, 44000000, 99, 99, 1\n",
        encoding="utf-8",
    )
    assert [entry.get("mode") for entry in load([log]).evidence.of(event="mode")] == modes


def test_thirteen_seconds_between_two_computers_are_taken_out_and_told(tmp_path: Path) -> None:
    companion_log().write(tmp_path / "vehicle" / "drone-1.tlog")
    journal(tmp_path / "vehicle" / "drone-1.jsonl", "drone-1", companion_entries())
    station_log("GCSB", ahead=13.0).write(tmp_path / "GCSB" / "GCSB.tlog")
    journal(tmp_path / "GCSB" / "GCSB.jsonl", "GCSB", station_entries(), ahead=13.0, mono=90.0)
    record = load([tmp_path])
    told = clocks(record)
    assert told["GCSB.tlog"] == "13.08 s ahead, shifted: GPS time, 62 readings"
    assert told["GCSB.jsonl"].startswith(
        "13.00 s ahead, shifted: as GCSB.tlog beside it, made exact by messages of hand"
    )
    assert told["drone-1.jsonl"] == "not shifted: as drone-1.tlog beside it"
    (transfer,) = exchanges(record.evidence)
    ways = [
        flight.received_t - flight.sent_t
        for flight in transfer.flights
        if flight.received_t is not None and flight.sent_t is not None
    ]
    assert len(ways) == 5
    assert all(way == pytest.approx(0.004, abs=0.0006) for way in ways)


def test_journals_alone_are_laid_together_by_their_messages(tmp_path: Path) -> None:
    one = journal(tmp_path / "a" / "drone-1.jsonl", "drone-1", companion_entries())
    other = journal(tmp_path / "b" / "GCSB.jsonl", "GCSB", station_entries(), ahead=-71.5, mono=3.0)
    record = load([one, other])
    assert clocks(record)["GCSB.jsonl"] == "71.50 s behind, shifted: messages of handovers, 5 of them"
    assert clocks(record)["drone-1.jsonl"] == "not shifted: nothing to compare its clock with"
    assert not record.by_gps
    # the places of the companion's own journal make the track
    assert record.stories[0].witness == "the companion's journal"
    assert len(record.evidence.samples) == 60
    assert record.evidence.modes_flown() == ["AUTO", "RTL"]
    assert [entry.t - BEGUN_UTC for entry in record.evidence.of("vehicle", "landed")] == pytest.approx([60.0], abs=0.01)
    assert not any(flight.lost for flight in exchanges(record.evidence)[0].flights)


def test_the_journal_of_a_station_alone_tells_where_and_not_how_high(tmp_path: Path) -> None:
    entries = [(t, "telemetry", {key: values[key] for key in ("lat_deg", "lon_deg")})
               for t, event, values in companion_entries() if event == "position"]  # fmt: skip
    path = journal(tmp_path / "GCSA.jsonl", "GCSA", entries)
    assert main_report([str(path)]) == 0
    text = (tmp_path / "GCSA-report.html").read_text(encoding="utf-8")
    assert "It moved; how high, these files do not tell." in text
    assert "The aircraft by the journal of GCSA" in text


def test_a_log_without_gps_time_is_compared_by_the_autopilots_clock(tmp_path: Path) -> None:
    one = companion_log().write(tmp_path / "a" / "drone-1.tlog")
    other = station_log("GCSA", ahead=-5.0, gps=False).write(tmp_path / "b" / "GCSA.tlog")
    told = clocks(load([one, other]))
    assert re.fullmatch(r"4\.92 s behind, shifted: the autopilot's clock, \d+ readings", told["GCSA.tlog"])


def test_where_the_autopilots_clock_ran_at_another_speed_its_log_is_laid_along(tmp_path: Path) -> None:
    companion_log(speed=4.0).write(tmp_path / "drone-1.tlog")
    dataflash(tmp_path / "1.bin", speed=4.0)
    record = load([tmp_path])
    assert "laid along the telemetry by GPS time" in clocks(record)["1.bin"]
    assert "ran at another speed" in clocks(record)["drone-1.tlog"]
    (rtl,) = [entry for entry in record.evidence.of(event="mode") if entry.get("mode") == "RTL"]
    assert rtl.t == pytest.approx(BEGUN_UTC + 40.0, abs=0.1)


def test_the_nearest_witness_is_believed_and_the_next_one_fills_its_silence(tmp_path: Path) -> None:
    companion_log().write(tmp_path / "drone-1.tlog")
    log = dataflash(tmp_path / "1.bin")
    log.write_bytes(log.read_bytes()[:6000])  # it was cut in flight
    record = load([tmp_path])
    assert record.stories[0].witness == ("the autopilot's own log; where it is silent, the companion's telemetry log")
    assert [entry.event for entry in record.evidence.entries if entry.event in ("armed", "airborne", "landed")] == [
        "armed", "airborne", "landed",
    ]  # fmt: skip


def test_a_restart_in_flight_is_one_flight_even_after_a_reboot(tmp_path: Path) -> None:
    entries = companion_entries()
    path = journal(tmp_path / "drone-1.jsonl", "drone-1", [each for each in entries if each[0] < 33])
    restarted = [(35.0, "restarted", {"text": "restarted in flight; GCSB had authority"})]
    restarted += [(35.4, "view", {"phase": "on_mission", "commander": "GCSB", "epoch": 3, "lease": "held"})]
    later = tmp_path / "later.jsonl"
    # its monotonic time begins again, because the whole computer was started again
    journal(later, "drone-1", [*restarted, *(each for each in entries if each[0] > 36)], mono=-30.0)
    path.write_text(path.read_text(encoding="utf-8") + later.read_text(encoding="utf-8"), encoding="utf-8")
    later.unlink()
    record = load([path])
    assert [(each.commander, each.epoch) for each in record.evidence.commanders()] == [
        ("GCSA", 1), ("GCSB", 2), ("nobody", -1), ("GCSB", 3),
    ]  # fmt: skip
    times = [sample.t for sample in record.evidence.samples]
    assert times == sorted(times)
    assert main_report([str(path)]) == 0
    text = (tmp_path / "drone-1-report.html").read_text(encoding="utf-8")
    assert "The companion was restarted in flight once." in text


def test_two_vehicles_are_both_in_the_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = station_log("GCSA")
    other = station_log("GCSA", sysid=2, vehicle="drone-2", east_deg=0.01)
    log.data += other.data
    path = log.write(tmp_path / "GCSA.tlog")
    assert main_report([str(path), "--csv", str(tmp_path / "f.csv")]) == 0
    assert capsys.readouterr().out.split() == [str(tmp_path / "GCSA-report.html"), str(tmp_path / "f.csv")]
    text = (tmp_path / "GCSA-report.html").read_text(encoding="utf-8")
    assert "<h1>drone-1</h1>" in text
    assert "<h1>drone-2</h1>" in text
    assert set(re.findall(r'data-figure="(\w+)"', text)) == {"map1", "timeline1", "map2", "timeline2"}
    with (tmp_path / "f.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert {row["vehicle"] for row in rows} == {"drone-1", "drone-2"}


def test_the_table_has_what_held_at_each_place(tmp_path: Path) -> None:
    companion_log().write(tmp_path / "drone-1.tlog")
    journal(tmp_path / "drone-1.jsonl", "drone-1", companion_entries())
    assert main_report([str(tmp_path), "--csv", str(tmp_path / "f.csv")]) == 0
    with (tmp_path / "f.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == COLUMNS
    (row,) = [row for row in rows if row["utc"].startswith("2026-09-21T14:14:05.0")]
    assert row["commander"] == "GCSB"
    assert (row["mode"], row["phase"], row["epoch"], row["armed"]) == ("RTL", "on_mission", "2", "1")
    assert (row["lat_deg"], row["lon_deg"], row["battery_percent"]) == ("52.6878634", "5.9100000", "78")
    assert row["emergency"] == "coverage ends ahead: return"


def test_the_track_for_map_programs_is_cut_where_the_commander_changes(tmp_path: Path) -> None:
    companion_log().write(tmp_path / "drone-1.tlog")
    journal(tmp_path / "drone-1.jsonl", "drone-1", companion_entries())
    words = [str(tmp_path), "--mission", str(shipped("missions") / "linear"), "--kml", str(tmp_path / "f.kml")]
    assert main_report(words) == 0
    tree = Xml.parse(tmp_path / "f.kml")
    names = [mark.findtext(f"{KML}name") for mark in tree.iter(f"{KML}Placemark")]
    assert names == [
        "zone of GCSA",
        "zone of GCSB",
        "GCSA commands, from T-0:02.6",
        "GCSB commands, from T+0:27.6",
        "emergency: coverage ends ahead: return",
        "handover 1, GCSA to GCSB",
    ]
    coordinates = tree.find(f".//{KML}LineString/{KML}coordinates")
    assert coordinates is not None
    assert str(coordinates.text).split()[0] == "5.9100000,52.6840000,0.00"


def test_what_was_recorded_at_another_time_is_of_another_flight(tmp_path: Path) -> None:
    station_log("GCSA").write(tmp_path / "today.tlog")
    before = companion_log(begun=BEGUN_UTC - 86400.0)
    before.write(tmp_path / "yesterday.tlog")
    record = load([tmp_path])
    assert list(clocks(record)) == ["today.tlog"]
    assert record.left_out == (f"{tmp_path}/yesterday.tlog: of another flight",)


def test_a_month_of_flights_is_not_read_for_the_last_one(tmp_path: Path) -> None:
    station_log("GCSA").write(tmp_path / "today.tlog")
    old = tmp_path / "old.tlog"
    old.write_bytes(b"")
    os.utime(old, (BEGUN_UTC, BEGUN_UTC))
    dataflash(tmp_path / "1.bin")
    os.utime(tmp_path / "1.bin", (0, 0))  # an autopilot without a clock
    record = load([tmp_path])
    assert set(clocks(record)) == {"today.tlog", "1.bin"}
    assert record.left_out == (f"{old}: days older than the rest",)


def test_without_plotly_the_page_says_what_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = station_log("GCSB").write(tmp_path / "GCSB.tlog")
    monkeypatch.setitem(sys.modules, "plotly", None)
    assert main_report([str(path)]) == 0
    text = (tmp_path / "GCSB-report.html").read_text(encoding="utf-8")
    assert "No pictures: plotly is not installed (pip install mavproxy-handover-sim)." in text
    assert "1 handover committed" in text
    assert "<script" not in text


def test_a_log_that_is_cut_or_spoilt_anywhere_is_read_as_far_as_it_goes(tmp_path: Path) -> None:
    whole = station_log("GCSB").write(tmp_path / "GCSB.tlog").read_bytes()
    for cut in (len(whole) // 3, len(whole) // 2 + 7):
        (tmp_path / "GCSB.tlog").write_bytes(whole[:cut])
        assert load([tmp_path]).evidence.samples
    spoilt = bytearray(whole)
    spoilt[5000:5300] = b"\xfd\xfe" * 150
    (tmp_path / "GCSB.tlog").write_bytes(bytes(spoilt))
    (source,) = load([tmp_path]).sources
    assert source.broken > 0
    log = dataflash(tmp_path / "GCSB.bin")
    (tmp_path / "GCSB.tlog").unlink()
    spoilt = bytearray(log.read_bytes())
    spoilt[5000:5100] = b"\xa3\x95" * 50
    log.write_bytes(bytes(spoilt))
    (source,) = load([log]).sources
    assert source.broken > 0


def test_a_single_time_that_cannot_be_is_not_believed(tmp_path: Path) -> None:
    path = station_log("GCSB").write(tmp_path / "GCSB.tlog")
    data = path.read_bytes()
    path.write_bytes(data.replace(data[:2], b"\x7f\xff", 1))  # 290 000 years from now
    (source,) = load([path]).sources
    assert source.broken == 1
    assert source.span is not None
    assert source.span[1] - source.span[0] < 70.0


def test_values_that_are_none_cost_their_entry_alone(tmp_path: Path) -> None:
    path = journal(tmp_path / "drone-1.jsonl", "drone-1", companion_entries())
    lines = path.read_text(encoding="utf-8").splitlines()
    odd = [
        {"lat_deg": "north", "lon_deg": 5.0}, {"lat_deg": 1e300, "lon_deg": 5.0}, {"t": float("nan")}, {"t": 1e300},
        {"utc": "tomorrow"}, {"who": 7}, {"alt_m": None},
    ]  # fmt: skip
    for number, values in enumerate(odd):
        lines[20 + number] = json.dumps({**json.loads(lines[20 + number]), "event": "position", **values})
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    assert main_report([str(path), "--csv", str(tmp_path / "f.csv"), "--kml", str(tmp_path / "f.kml")]) == 0
    assert 50 <= len(load([path]).evidence.samples) < 60


@pytest.mark.parametrize(
    ("name", "content", "why"),
    [
        ("a.txt", b"", "a.txt: not a file that is known by its ending"),
        ("a.bin", b"no log", "a.bin: no dataflash log: it does not begin like one"),
        ("a.tlog", b"no log either" * 9, "a.tlog: a telemetry log in which nothing is told"),
        ("a.jsonl", b"{}\n", "a.jsonl: a journal in which nothing is told"),
    ],
)
def test_what_is_no_record_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, content: bytes, why: str
) -> None:
    (tmp_path / name).write_bytes(content)
    assert main_report([str(tmp_path / name)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("handover report: ")
    assert why in err
    assert err.count("\n") == 1


def test_a_mission_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    path = station_log("GCSB").write(tmp_path / "GCSB.tlog")
    with pytest.raises(RecordError, match=r"mission\.toml"):
        load([path], tmp_path)


def test_words_of_a_log_are_text_in_the_pictures_too(tmp_path: Path) -> None:
    entries = companion_entries()
    entries.append((41.0, "fly", {"text": "</script><script>alert(1)</script>"}))
    path = journal(tmp_path / "drone-1.jsonl", "drone-1", sorted(entries, key=lambda entry: entry[0]))
    assert main_report([str(path)]) == 0
    text = (tmp_path / "drone-1-report.html").read_text(encoding="utf-8")
    assert "<script>alert" not in text
    found = re.search(r'data-figure="timeline1">(.*?)</script>', text)
    assert found is not None
    decisions = json.loads(found.group(1))["data"][-2]
    assert any("&lt;/script&gt;&lt;script&gt;alert(1)" in words for words in decisions["hovertext"])
