# SPDX-License-Identifier: GPL-3.0-or-later

"""The report of a run made by hand: what stands in it, and that it needs nothing but itself."""

from __future__ import annotations

import json
import os
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path

import pytest
from shapely.affinity import translate
from shapely.geometry import MultiPolygon, Point, box, mapping, shape

from mavproxy_handover.mission.geodesy import wrap_longitude_deg
from mavproxy_handover.tools.resources import shipped
from sitl.report.page import main_report, write_report
from sitl.report.record import RecordError, load_run
from tests.depth import first
from tests.sitl.synthetic import write_folder


class Reader(HTMLParser):
    """Collects tables, images and links, and checks that every element is closed."""

    VOID = frozenset({"meta", "img", "br"})
    #: of an SVG: closed by themselves
    SHAPES = frozenset({"line", "path", "rect"})

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.rows: list[list[str]] = []
        self.images: list[str] = []
        self.links: list[str] = []
        self.sequences: list[str] = []
        self.captions: list[str] = []
        self.figures: dict[str, str] = {}
        self.outcome: list[str] = []
        self._figure = self._list = ""
        self.outside: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        if tag not in self.VOID | self.SHAPES:
            self.open.append(tag)
        if tag == "svg":
            self.sequences.append("")
        if tag == "figcaption":
            self.captions.append("")
        if tag == "ul":
            self._list = str(values.get("class"))
        if tag == "li" and self._list == "outcome":
            self.outcome.append("")
        self._figure = str(values.get("data-figure") or "")
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")
        if tag == "img":
            self.images.append(str(values.get("src")))
        if tag == "a":
            self.links.append(str(values.get("href")))
        self.outside += [
            value for key, value in attrs if key in ("src", "href") and value and re.match("[a-z]*:?//", value)
        ]

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert tag in self.SHAPES
        self.outside += [str(value) for key, value in attrs if key in ("src", "href")]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if not self.open:
            return
        if self.open[-1] in ("td", "th"):
            self.rows[-1][-1] += data
        if "svg" in self.open:
            self.sequences[-1] += data + "\n"
        if self.open[-1] == "figcaption":
            self.captions[-1] += data
        if self.open[-1] == "li" and self._list == "outcome":
            self.outcome[-1:] = [self.outcome[-1] + data]
        if self.open[-1] == "script" and self._figure:
            self.figures[self._figure] = self.figures.get(self._figure, "") + data


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = write_folder(tmp_path_factory.mktemp("run"))
    write_report(load_run(made))
    return made


@pytest.fixture(scope="module")
def page(folder: Path) -> Reader:
    reader = Reader()
    reader.feed((folder / "report.html").read_text(encoding="utf-8"))
    assert reader.open == []
    return reader


def test_the_report_needs_nothing_from_elsewhere(page: Reader) -> None:
    assert page.outside == []
    assert page.images == []
    assert set(page.figures) == {"map1", "timeline1"}


def test_what_came_of_it_stands_first(page: Reader) -> None:
    assert page.outcome == [
        "Landed at home, 0.0 m off.",
        "No emergency.",
        "4 handovers committed, in 9.8 ms to 221.8 ms.",
        "1 frame refused, of GCSB.",
        "Every expectation held.",
    ]


def test_every_handover_has_its_row_with_its_duration(page: Reader) -> None:
    rows = [row for row in page.rows if len(row) == 11 and row[0].isdigit()]
    assert [row[1] for row in rows] == ["GCSA → GCSB", "GCSB → GCSA", "GCSA → GCSB", "GCSB → GCSA"]
    assert [row[3] for row in rows] == ["12.4 ms", "221.8 ms", "15.1 ms", "9.8 ms"]
    assert [row[7] for row in rows] == ["0", "1", "0", "0"]
    assert [row[9] for row in rows] == ["first try", "2 tries", "first try", "first try"]


def test_each_kind_of_handover_is_drawn_once_and_the_odd_one_in_full(page: Reader) -> None:
    assert page.captions == [
        "Handover 1: GCSA → GCSB; so went 4",
        "Handover 2: GCSB → GCSA",
        "Handover 3: GCSA → GCSB",
    ]
    by_the_book, lost, relayed = page.sequences
    assert "1 HANDOVER_REQUEST, lost" in lost
    assert "lost" not in by_the_book + relayed
    assert "2 ON_HANDOVER, passed on" in relayed
    assert "GCSB commands, epoch 2" in by_the_book


def test_map_and_timeline_hold_what_was_flown(page: Reader) -> None:
    there, held = (json.loads(page.figures[name]) for name in ("map1", "timeline1"))
    named = [trace.get("name") for trace in there["data"]]
    assert {"GCSA commands", "GCSB commands", "planned route", "handover region", "geofence", "handover"} <= set(named)
    lanes = {trace["y"][0] for trace in held["data"] if trace["type"] == "bar"}
    assert lanes == {"link GCSA", "commander", "phase", "lease", "guard", "mode"}
    commander = next(trace for trace in held["data"] if trace["type"] == "bar" and trace["y"][0] == "commander")
    assert commander["text"] == ["GCSA", "GCSB", "GCSA", "GCSB", "GCSA"]


def test_refusals_are_listed_with_their_reason(page: Reader) -> None:
    rows = [row for row in page.rows if "not in control" in row]
    assert rows == [["T+0:11.0", "", "GCSB", "COMMAND_LONG/MAV_CMD_DO_SET_MODE", "not in control", ""]]


def test_accepted_commands_are_counted(page: Reader) -> None:
    assert ["GCSA", "COMMAND_LONG/MAV_CMD_MISSION_START", "1"] in page.rows


def test_every_link_leads_to_a_file_beside_the_report(page: Reader, folder: Path) -> None:
    assert {"./companion/companion.jsonl", "./vehicle.jsonl", "./GCSA/GCSA.jsonl"} <= set(page.links)
    for link in page.links:
        assert (folder / link).is_file()


def test_a_failed_expectation_is_in_the_verdict(tmp_path: Path) -> None:
    verdicts = [
        {"held": True, "wanted": "a", "seen": "a"},
        {"held": False, "wanted": "landed <at> home", "seen": "never"},
    ]
    text = write_report(load_run(write_folder(tmp_path / "run", verdicts=verdicts))).read_text(encoding="utf-8")
    assert "1 of 2 expectations failed" in text
    assert "landed &lt;at&gt; home" in text
    assert "Every expectation held" not in text


def test_the_report_is_the_same_when_it_is_made_again(folder: Path) -> None:
    before = (folder / "report.html").read_bytes()
    assert main_report([str(folder)]) == 0
    assert (folder / "report.html").read_bytes() == before


def test_a_flight_without_a_verdict_has_pictures_too(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "run")
    (folder / "run.json").unlink()
    text = write_report(load_run(folder)).read_text(encoding="utf-8")
    assert "Expectations" not in text
    assert "flight of delivery" in text
    assert text.count("data-figure=") == 2
    assert (folder / "map.png").stat().st_size > 20_000


def test_a_flight_whose_aircraft_was_not_watched_has_a_report(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "run")
    (folder / "vehicle.jsonl").unlink()
    assert "Handovers" in write_report(load_run(folder)).read_text(encoding="utf-8")


def test_journals_cut_anywhere_still_make_a_report(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "run")
    journal = folder / "companion" / "companion.jsonl"
    data = journal.read_bytes()
    for part in (3, 7, 40):
        journal.write_bytes(data[: len(data) // part])
        write_report(load_run(folder))


def test_a_folder_with_nothing_of_a_flight_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="no journals"):
        load_run(tmp_path)


def test_a_folder_in_which_nothing_is_told_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.jsonl").write_text("")
    with pytest.raises(RecordError, match=r"a\.jsonl: a journal in which nothing is told"):
        load_run(tmp_path)


def test_a_staged_run_without_its_mission_is_refused(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "run")
    shutil.rmtree(folder / "mission")
    with pytest.raises(RecordError, match="no mission package"):
        load_run(folder)


def test_a_mission_that_lies_beside_the_journal_will_do_and_of_several_the_newest(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "run")
    (folder / "mission").rename(folder / "companion" / "drone-1-mission-0a1b2c3d")
    shutil.copytree(shipped("missions") / "linear", folder / "companion" / "drone-1-mission-4e5f6071")
    os.utime(folder / "companion" / "drone-1-mission-4e5f6071", (1.0, 1.0))
    assert load_run(folder).evidence.package.name == "delivery"


def test_the_folder_of_a_companions_run_is_titled_by_its_mission(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "run")
    (folder / "run.json").write_text('{"begun_utc": "2026-05-01T10:00:00+00:00", "version": "1.0"}')
    record = load_run(folder)
    assert record.title == "flight of delivery"
    text = write_report(record).read_text(encoding="utf-8")
    assert "mission delivery; begun 2026-05-01T10:00:00+00:00</p>" in text


def test_a_record_that_is_no_record_is_refused(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "run")
    (folder / "run.json").write_text(json.dumps([1]))
    with pytest.raises(RecordError, match=r"run\.json"):
        load_run(folder)


def test_of_a_run_with_two_vehicles_both_are_told(tmp_path: Path) -> None:
    """The second one flies half the way, and its companion dies there."""
    folder = write_folder(tmp_path / "run")
    for path, target in (("vehicle.jsonl", "vehicle/seen.jsonl"), ("companion/companion.jsonl", "companion/c.jsonl")):
        lines = (folder / path).read_text(encoding="utf-8").replace('"drone-1"', '"drone-2"').splitlines()
        (folder / "drone-2" / target).parent.mkdir(parents=True)
        half = lines[: len(lines) // 2] if path.startswith("companion") else lines
        (folder / "drone-2" / target).write_text("\n".join(half) + "\n", encoding="utf-8")
    record = load_run(folder)
    assert [story.vehicle for story in record.stories] == ["drone-1", "drone-2"]
    text = write_report(record).read_text(encoding="utf-8")
    assert "<h1>drone-1</h1>" in text
    first, second = text.split("<h1>drone-2</h1>")
    assert "4 handovers committed" in first
    assert "2 handovers committed" in second
    assert "No station commanded for" in second
    assert (folder / "map-drone-2.png").stat().st_size > 20_000


def test_what_journals_say_is_text_and_not_markup(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "run")
    journal = folder / "companion" / "companion.jsonl"
    entry = {"t": 1020.0, "who": "drone-1", "event": "fault", "text": "<script>alert(1)</script>"}
    with journal.open("a", encoding="utf-8") as file:
        file.write(json.dumps(entry) + "\n")
    text = write_report(load_run(folder)).read_text(encoding="utf-8")
    assert "<script>alert" not in text
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in text


def _east(lon: float, by: float) -> float:
    return wrap_longitude_deg(lon + by)


def over_the_meridian(folder: Path, circles: bool) -> None:
    """The flight of a folder, moved so that the 180th meridian runs through both zones and their overlap."""
    by = 180.0 - 5.9275
    plan_file, zones_file = folder / "mission" / "delivery.plan", folder / "mission" / "zones.geojson"
    plan = json.loads(plan_file.read_text(encoding="utf-8"))
    places = [(item["params"], 5) for item in plan["mission"]["items"]]
    places += [(plan["mission"]["plannedHomePosition"], 1)]
    places += [(point, 1) for point in plan["rallyPoints"]["points"]]
    places += [(corner, 1) for polygon in plan["geoFence"]["polygons"] for corner in polygon["polygon"]]
    for place, index in places:
        place[index] = _east(place[index], by)
    plan_file.write_text(json.dumps(plan), encoding="utf-8")
    zones = json.loads(zones_file.read_text(encoding="utf-8"))
    for feature in zones["features"]:
        area = translate(shape(feature["geometry"]), by)
        if circles:
            feature["geometry"] = mapping(Point(_east(area.centroid.x - by, by), area.centroid.y))
            feature["properties"]["radius_m"] = 400
            continue
        west, east = area.intersection(box(0, -90, 180, 90)), area.intersection(box(180, -90, 360, 90))
        feature["geometry"] = mapping(MultiPolygon([west, translate(east, -360)]))
    zones_file.write_text(json.dumps(zones), encoding="utf-8")
    mission = folder / "mission" / "mission.toml"
    if circles:
        mission.write_text(
            mission.read_text(encoding="utf-8").replace('"polygons"  ', '"circles"  ', 1), encoding="utf-8"
        )
    for journal in folder.rglob("*.jsonl"):
        entries = [json.loads(line) for line in journal.read_text(encoding="utf-8").splitlines()]
        for entry in entries:
            if "lon_deg" in entry:
                entry["lon_deg"] = _east(entry["lon_deg"], by)
        journal.write_text("".join(json.dumps(entry) + "\n" for entry in entries), encoding="utf-8")


@pytest.mark.parametrize("circles", first(1, [False, True]))
def test_a_flight_across_the_180th_meridian_has_its_report_and_pictures(
    folder: Path, tmp_path: Path, circles: bool
) -> None:
    moved = write_folder(tmp_path / "run")
    over_the_meridian(moved, circles)
    assert main_report([str(moved)]) == 0
    assert {path.name for path in moved.glob("*.png")} == {path.name for path in folder.glob("*.png")}
    if circles:
        return
    usual, there = ((run / "map.png").read_bytes()[16:24] for run in (folder, moved))
    width, height = (int.from_bytes(usual[at : at + 4], "big") for at in (0, 4))
    assert abs(int.from_bytes(there[:4], "big") - width) < 0.02 * width
    assert abs(int.from_bytes(there[4:], "big") - height) < 0.02 * height, "a map of the same shape"
