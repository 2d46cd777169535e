# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover check`: each finding by its words, the table, the exit codes, and the map."""

from __future__ import annotations

import re
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from mavproxy_handover.cli.check import main
from mavproxy_handover.core.common.model import StandingConsent, Station
from mavproxy_handover.mission import load
from mavproxy_handover.mission.check import Finding, Severity, check
from mavproxy_handover.mission.check_text import report_text
from mavproxy_handover.mission.map_findings import colours_of_items, list_findings
from mavproxy_handover.mission.picture import MapSheet, draw
from tests.depth import first

PNG = b"\x89PNG\r\n\x1a\n"


def findings(small, severity, **options):
    report = check(load(small.write()), **options)
    return [finding.text for finding in report.findings if finding.severity is severity]


def errors(small, **options):
    return findings(small, Severity.ERROR, **options)


def warnings(small, **options):
    return findings(small, Severity.WARNING, **options)


def move_zones(small, *bounds):
    for feature, (west, east) in zip(small.zones["features"], bounds, strict=True):
        feature["geometry"]["coordinates"] = [small.box(west, east)]


# --- findings ---


def test_sound_mission_has_nothing_worse_than_infos(small):
    report = check(load(small.write()))
    assert report.exit_code == 0
    assert [(f.severity, f.text) for f in report.findings] == [
        (Severity.INFO, "home or a rally point is never farther than 167 m (on the way to 2)")
    ]


def test_a_payload_of_a_station_that_the_route_leaves_is_a_warning(small):
    small.toml += '[payload]\ncamera = "B"\ngimbal = "flight"\n'
    (text,) = warnings(small)
    assert re.fullmatch(
        r"payload: the camera belongs to B\. \d+ % of the route is outside its zone, first on the way to item 1\. "
        r"No other station can work it there",
        text,
    )
    lines = report_text(check(load(small.write()))).splitlines()
    assert "payload     gimbal: the commander's; camera: that of B" in lines
    move_zones(small, (10.0, 10.006), (10.0, 10.006))
    assert [line for line in warnings(small) if line.startswith("payload")] == []


def test_a_rule_of_the_payload_without_effect_is_a_warning(small):
    small.toml += '[payload]\ncontrol = "flight"\nat_handover = "keep"\n'
    assert warnings(small) == [
        "payload: at_handover in mission.toml has no effect, because no station may ask for a payload. Remove it, or "
        "write 'request' for a kind"
    ]
    small.toml = small.toml.replace('"flight"', '"request"')
    assert warnings(small) == []


def test_a_speed_that_nobody_names_is_a_warning(small):
    del small.plan["mission"]["hoverSpeed"]
    assert warnings(small) == [
        "neither mission nor plan names a cruise speed: checked at 10 m/s, flown as the autopilot is set"
    ]


def test_gap_in_coverage_is_an_error_with_place_and_length(small):
    move_zones(small, (10.0, 10.002), (10.003, 10.006))
    assert errors(small) == [
        "no coverage for 111 m (22 s) from 0.00000 N 10.00200 E at 30 m, 111 m along the route, on the way to 2",
        "handover 1 A -> B: the zones do not overlap on the route, 0.00000 N 10.00300 E, 223 m along the route",
        "the zone of A overlaps no other zone",
        "the zone of B overlaps no other zone",
    ]


def test_gap_is_a_warning_when_the_mission_means_to_fly_it(small):
    move_zones(small, (10.0, 10.002), (10.003, 10.006))
    small.toml += '[policy]\non_out_of_coverage = "warn"\n'
    assert warnings(small) == [
        "no coverage for 111 m (22 s) from 0.00000 N 10.00200 E at 30 m, 111 m along the route, on the way to 2"
    ]


def test_too_little_time_for_a_transfer_is_an_error(small):
    move_zones(small, (10.0, 10.0021), (10.002, 10.006))
    # 11.1 m at 5 m/s
    assert errors(small) == ["handover 1 A -> B: 2.2 s inside both zones. A transfer and a second try need 6 s"]
    assert errors(small, transfer_s=1.0) == []


def test_time_for_one_try_only_is_an_error(small):
    move_zones(small, (10.0, 10.00221), (10.002, 10.006))
    # 23.4 m at 5 m/s
    assert errors(small) == ["handover 1 A -> B: 4.7 s inside both zones. A transfer and a second try need 6 s"]
    move_zones(small, (10.0, 10.0023), (10.002, 10.006))
    assert errors(small) == []


def infos(small, **options):
    return [f.text for f in check(load(small.write()), **options).findings if f.severity is Severity.INFO][:-1]


def test_a_region_that_is_over_before_an_operator_has_to_answer_is_worth_knowing(small):
    """He is asked beforehand: as long before it as he may take, and not before take-off."""
    move_zones(small, (10.0, 10.0023), (10.002, 10.006))
    handover = load(small.write()).simulate().handovers[0]
    begins_s, overlap_s = handover.time_s, handover.overlap_s
    assert infos(small, operator_s=begins_s) == [], "there is time enough"
    assert infos(small, operator_s=3.6 + begins_s) == []
    (text,) = infos(small, operator_s=3.8 + begins_s)  # the transfer needs its time too
    assert text.startswith("an operator who is asked may take ")
    assert text.endswith(f"is less at handover 1, even if asked early: {begins_s + overlap_s:.1f} s at the least")
    assert infos(small, transfer_s=5.0, operator_s=60.0) == [], "there it is an error"


def test_where_operators_are_known_to_be_asked_too_little_time_is_a_warning(small):
    stations = (Station(251, "A"), Station(252, "B"))
    slow = {"operator_s": 60.0}
    move_zones(small, (10.0, 10.0023), (10.002, 10.006))
    (text,) = [text for text in warnings(small, stations=stations, **slow) if "operator" in text]
    assert text.startswith("an operator who is asked may take 60 s to answer; there is less at handover 1")
    answered = (Station(251, "A"), replace(Station(252, "B"), consent=StandingConsent.AUTOMATIC))
    assert not [text for text in warnings(small, stations=answered, **slow) if "operator" in text]


def test_without_an_expected_number_the_number_of_handovers_is_told(small):
    small.toml = small.toml.replace("expected_handovers = 1\n", "")
    assert errors(small) == []
    assert infos(small) == [
        "mission.toml has no expected_handovers. Write 1 there, and a later change of the route shows"
    ]


def test_another_number_of_handovers_than_stated_is_an_error(small):
    small.toml = small.toml.replace("expected_handovers = 1", "expected_handovers = 3")
    assert errors(small) == ["the route makes 1 handovers, mission.toml expects 3"]


def test_takeoff_outside_the_parents_zone_is_an_error(small):
    move_zones(small, (10.002, 10.004), (10.0, 10.006))
    assert errors(small)[0] == "take-off is outside the zone of the parent station A"


def test_station_that_never_commands_is_a_warning(small):
    move_zones(small, (10.0, 10.006), (9.998, 10.0005))
    small.toml = small.toml.replace("expected_handovers = 1", "expected_handovers = 0")
    assert warnings(small) == ["station B never commands on this route"]
    assert errors(small) == []


def test_rally_point_in_no_zone_is_a_warning(small):
    small.plan["rallyPoints"]["points"].append([0.002, 10.003, 30])
    assert warnings(small) == [
        "rally point 2 at 0.00200 N 10.00300 E is in no zone: no station would command the aircraft there"
    ]


def test_rally_point_outside_the_geofence_is_a_warning(small):
    """ArduCopter passes over it without a word, and goes home."""
    fence = [[0.0008, 9.9], [0.0008, 10.1], [-0.01, 10.1], [-0.01, 9.9]]
    small.plan["geoFence"]["polygons"] = [{"inclusion": True, "polygon": fence, "version": 1}]
    small.plan["rallyPoints"]["points"].append([0.0009, 10.003, 30])
    text = "rally point 2 at 0.00090 N 10.00300 E is outside the geofence: no return goes there"
    assert text in warnings(small)


def test_rally_point_out_of_reach_is_an_error(small):
    small.plan["rallyPoints"]["points"].append([0.0009, 10.003, 30])
    small.toml = "rally_reach_m = 99\n" + small.toml
    assert errors(small) == [
        "rally point 2 at 0.00090 N 10.00300 E is out of reach: 100 m off the route (allowed: 99 m). Remove it, or "
        "declare the distance with rally_reach_m in mission.toml"
    ]
    small.toml = small.toml.replace("99", "100", 1)
    assert errors(small) == []


def test_rally_point_kilometres_off_is_an_error_unless_it_is_declared(small):
    small.plan["rallyPoints"]["points"].append([0.0, 10.15, 30])
    (text,) = errors(small)
    assert "is out of reach: 16141 m off the route (allowed: 5000 m)" in text
    small.toml = "rally_reach_m = 20000\n" + small.toml
    assert errors(small) == []


def test_route_that_leaves_the_geofence_is_an_error(small):
    fence = [[0.01, 9.9], [0.01, 10.004], [-0.01, 10.004], [-0.01, 9.9]]
    small.plan["geoFence"]["polygons"] = [{"inclusion": True, "polygon": fence, "version": 1}]
    (text,) = errors(small)
    assert text.startswith("the route leaves the geofence of the plan at 0.00000 N 10.0040")


def test_route_that_enters_a_forbidden_circle_is_an_error(small):
    small.plan["geoFence"]["circles"] = [{"inclusion": False, "circle": {"center": [0.0, 10.003], "radius": 20}}]
    (text,) = errors(small)
    assert text.startswith("the route leaves the geofence of the plan at 0.00000 N 10.0028")


def test_route_inside_its_geofence_passes(small):
    fence = [[0.01, 9.9], [0.01, 10.1], [-0.01, 10.1], [-0.01, 9.9]]
    small.plan["geoFence"]["polygons"] = [{"inclusion": True, "polygon": fence, "version": 1}]
    assert errors(small) == []


def test_oddities_of_the_plan_are_warnings(small):
    small.plan["rallyPoints"]["points"] = []
    assert warnings(small) == ["no rally point: the aircraft can only return to home"]


def test_worst_findings_come_first(small):
    small.plan["rallyPoints"]["points"] = []
    small.toml = small.toml.replace("expected_handovers = 1", "expected_handovers = 2")
    report = check(load(small.write()))
    assert [f.severity for f in report.findings] == [Severity.ERROR, Severity.WARNING, Severity.INFO]
    assert report.exit_code == 1


@pytest.mark.parametrize(
    "name",
    first(
        3, ["delivery", "meridian", "dike", "linear", "corridor", "ridge", "field-test", "waypoints", "ferry", "hills"]
    ),
)
def test_shipped_missions_pass_without_a_warning(missions, name):
    report = check(load(missions / name))
    assert [f.text for f in report.findings if f.severity is not Severity.INFO] == []


# --- table ---


def test_table_of_the_delivery_lists_its_four_handovers(missions):
    lines = report_text(check(load(missions / "delivery"))).splitlines()
    assert lines[0].startswith("mission     delivery  (mission.toml, delivery.plan, zones.geojson; digest ")
    assert lines[4] == "commanders  GCSA -> GCSB -> GCSA -> GCSB -> GCSA"
    rows = [line.split() for line in lines[8:12]]
    assert [row[:3] for row in rows] == [
        ["1", "GCSA", "GCSB"],
        ["2", "GCSB", "GCSA"],
        ["3", "GCSA", "GCSB"],
        ["4", "GCSB", "GCSA"],
    ]
    assert lines[-1] == "check passed: 0 errors, 0 warnings"


def test_the_vehicles_addresses_are_listed_by_station(missions, tmp_path):
    folder = Path(shutil.copytree(missions / "delivery", tmp_path / "delivery"))
    (folder / "addresses.toml").write_text('[vehicle]\nGCSB = ["udpout:10.0.0.2:14552", "udpout:10.0.0.2:5762"]\n')
    report = check(load(folder))
    assert (
        "addresses   GCSA none; GCSB udpout:10.0.0.2:14552, udpout:10.0.0.2:5762 (addresses.toml, not in the digest)"
        in report_text(report).splitlines()
    )
    assert report.count(Severity.WARNING) == 0


def test_a_damaged_file_of_the_addresses_is_an_error_with_its_line(missions, tmp_path):
    folder = Path(shutil.copytree(missions / "delivery", tmp_path / "delivery"))
    (folder / "addresses.toml").write_text("x =")
    report = check(load(folder))
    (text,) = [finding.text for finding in report.findings if finding.severity is Severity.ERROR]
    assert text.startswith(f"{folder}/addresses.toml: not TOML: ")
    assert "(at line 1, column 4" in text or "(at end of document)" in text
    assert text.endswith("The mission is used without addresses of the vehicle. Put the file right, or remove it.")
    assert report.exit_code == 1


def test_an_address_on_the_stations_own_computer_is_a_warning(missions, tmp_path):
    folder = Path(shutil.copytree(missions / "delivery", tmp_path / "delivery"))
    (folder / "addresses.toml").write_text('[vehicle]\nGCSB = ["udpout:127.0.0.1:14552"]\n')
    report = check(load(folder))
    assert [finding.text for finding in report.findings if finding.severity is Severity.WARNING] == [
        "addresses.toml: GCSB: udpout:127.0.0.1:14552 is the station's own computer: give the vehicle's address, as "
        "the station reaches it"
    ]


def test_a_mission_without_addresses_says_nothing_of_them(missions):
    assert "addresses" not in report_text(check(load(missions / "delivery")))


# --- command ---


def test_command_passes_a_sound_mission(small, capsys):
    assert main([str(small.write())]) == 0
    out, err = capsys.readouterr()
    assert out.splitlines()[-1] == "check passed: 0 errors, 0 warnings"
    assert err == ""


def test_command_takes_the_mission_file_for_its_folder(small, capsys):
    assert main([str(small.write() / "mission.toml")]) == 0
    assert "check passed" in capsys.readouterr().out


def test_command_fails_a_mission_with_errors(small, capsys):
    move_zones(small, (10.0, 10.002), (10.003, 10.006))
    assert main([str(small.write())]) == 1
    assert capsys.readouterr().out.splitlines()[-1] == "check failed: 4 errors, 0 warnings"


def test_command_says_in_one_line_what_cannot_be_read(small, capsys):
    small.toml = small.toml.replace("252", "251")
    assert main([str(small.write())]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err == "handover check: mission.toml: station 2: sysid 251 is taken by station 'A'\n"


def test_command_tells_all_faults_at_once(small, capsys):
    small.toml = small.toml.replace("252", "251") + '[policy]\non_out_of_coverage = "hope"\n'
    small.items[1]["command"] = 189
    small.items[1]["params"] = [0, 0, 0, 0, 91, 10.005, 30]
    assert main([str(small.write())]) == 2
    told = capsys.readouterr().err.splitlines()
    assert [line.split(": ")[1] for line in told] == ["mission.toml", "mission.toml", "small.plan"]
    assert "sysid 251 is taken" in told[0]
    assert "'hope'" in told[1]
    assert "item 2: latitude is 91" in told[2]


def test_command_without_a_mission_is_bad_input_and_help_is_not(capsys):
    assert main([]) == 2
    assert main(["--help"]) == 0
    assert "handover check" in capsys.readouterr().out


# --- map ---


@pytest.mark.parametrize(
    "name", ["delivery", "linear", "corridor", "meridian", "ridge", "field-test", "waypoints", "ferry", "dike", "hills"]
)
def test_map_of_each_shipped_mission_is_drawn(missions, tmp_path, name):
    target = tmp_path / "map.png"
    draw(load(missions / name), target)
    data = target.read_bytes()
    assert data.startswith(PNG)
    width, height = int.from_bytes(data[16:20], "big"), int.from_bytes(data[20:24], "big")
    assert width > 1000
    assert height > 400


def test_map_names_stations_waypoints_handovers_and_delivery(missions):
    axes = Figure().add_subplot()
    MapSheet(load(missions / "delivery")).paint(axes)
    written = [text.get_text() for text in axes.texts]
    handovers = ["1: GCSA → GCSB\n13.5 s", "2: GCSB → GCSA\n15.4 s", "3: GCSA → GCSB\n14.9 s", "4: GCSB → GCSA\n15.5 s"]
    for words in (
        "GCSA",
        "GCSB",
        "1, 14",
        "take-off, landing, home",
        "8",
        "delivery, 15 m",
        "R1",
        "R2",
        "200 m",
        "N",
        *handovers,
    ):
        assert words in written
    legend = [text.get_text() for text in axes.get_legend().get_texts()]
    assert legend == [
        "handover region",
        "geofence",
        "route, GCSA commands",
        "route, GCSB commands",
        "return site",
        "handover starts (time inside both zones)",
    ]
    assert axes.get_aspect() == 1.0


def test_map_has_the_whole_path_and_each_place_of_handovers_once():
    """The splines leave their zone by 100 m. On the circle ten handovers are at two places."""
    data = Path(__file__).resolve().parents[1] / "data" / "missions"
    package, axes = load(data / "spline"), Figure().add_subplot()
    sheet = MapSheet(package)
    sheet.paint(axes)
    for sample in package.simulate().samples:
        x, y = sheet.place(sample.lat_deg, sample.lon_deg)
        assert axes.get_xlim()[0] < x < axes.get_xlim()[1]
        assert axes.get_ylim()[0] < y < axes.get_ylim()[1]
    axes = Figure().add_subplot()
    MapSheet(load(data / "loiter_turns")).paint(axes)
    pairs = [text.get_text().partition("\n")[0] for text in axes.texts if "→" in text.get_text()]
    assert pairs == ["1 ... 9: A → B", "2 ... 10: B → A"]


def test_zones_that_lie_on_each_other_are_both_named():
    axes = Figure().add_subplot()
    MapSheet(load(Path(__file__).resolve().parents[1] / "data" / "missions" / "spline")).paint(axes)
    places = {text.get_text(): (text.xy, text.xyann) for text in axes.texts if text.get_text() in ("A", "B")}
    assert places["A"] != places["B"]


def test_map_lists_errors_and_warnings_and_marks_their_items():
    package = load(Path(__file__).resolve().parents[1] / "data" / "missions" / "spline")
    findings = check(package).findings
    colours = colours_of_items(findings)
    assert {2, 3, 4, 5, 6} <= set(colours)
    axes = Figure().add_subplot()
    MapSheet(package, marked=colours).paint(axes)
    list_findings(axes, findings, 60.0)
    written = {text.get_text(): text for text in axes.texts}
    assert "error: handover 2 B -> A: 5.9 s inside both zones. A transfer and a second try need 6 s" in written
    assert "warning: no rally point: the aircraft can only return to home" in written
    assert not any(words.startswith("info") for words in written)
    assert [round(part, 2) for part in written["3"].get_bbox_patch().get_edgecolor()[:3]] == [0.82, 0.0, 0.0]
    assert [round(part, 2) for part in written["1, 5, 7"].get_bbox_patch().get_edgecolor()[:3]] == [0.82, 0.0, 0.0]


def test_a_list_of_many_findings_says_how_many_are_left():
    axes = Figure().add_subplot()
    list_findings(axes, [Finding(Severity.ERROR, f"fault {n}") for n in range(50)], 60.0)
    written = [text.get_text() for text in axes.texts]
    assert (written[0], written[-1], len(written)) == ("error: fault 0", "and 30 more, which the check prints", 21)


def test_map_of_a_mission_with_gaps_holes_and_fences_is_drawn(small, tmp_path):
    small.zones["features"][0]["geometry"]["coordinates"].append(small.box(10.0015, 10.0018, -0.0005, 0.0005))
    move_zones_b = small.zones["features"][1]
    move_zones_b["geometry"] = {
        "type": "MultiPolygon",
        "coordinates": [[small.box(10.003, 10.0035)], [small.box(10.004, 10.0045)]],
    }
    move_zones_b["properties"].update(min_alt_m=10, max_alt_m=100)
    small.plan["geoFence"]["circles"] = [{"inclusion": False, "circle": {"center": [0.0, 10.01], "radius": 20}}]
    target = tmp_path / "map.png"
    draw(load(small.write()), target)
    assert target.read_bytes().startswith(PNG)


def test_command_draws_the_map(small, tmp_path, capsys):
    target = tmp_path / "map.png"
    assert main([str(small.write()), "--map", str(target)]) == 0
    assert target.read_bytes().startswith(PNG)
    assert "check passed" in capsys.readouterr().out


def test_map_that_cannot_be_written_is_bad_input(small, tmp_path, capsys):
    assert main([str(small.write()), "--map", str(tmp_path / "none" / "map.png")]) == 2
    assert capsys.readouterr().err == (
        f"handover check: {tmp_path}/none/map.png: cannot write the map: No such file or directory\n"
    )
    assert main([str(small.write()), "--map", str(tmp_path / "map.bmp")]) == 2
    assert "map.bmp: cannot write the map: Format 'bmp' is not supported" in capsys.readouterr().err


def test_map_without_matplotlib_says_which_extra_brings_it(small, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    assert main([str(small.write()), "--map", str(tmp_path / "map.png")]) == 2
    assert capsys.readouterr().err == (
        f"handover check: {tmp_path}/map.png: a map needs matplotlib: pip install mavproxy-handover-sim\n"
    )


# --- what the vehicle's file says of consent ---


def vehicle_file(folder, consent):
    folder.joinpath("handover.toml").write_text(
        f"""
        [vehicle]
        name = "drone-1"
        parent = "A"
        allow_unsigned = true
        [[station]]
        name = "A"
        sysid = 251
        links = ["udpout:127.0.0.1:9"]
        [[station]]
        name = "B"
        sysid = 252
        module = false
        {consent}
        links = ["udpout:127.0.0.1:10"]
        """
    )


def checked(small, capsys, *words):
    code = main([str(small.write()), *words])
    said = capsys.readouterr()
    return code, [line for line in said.out.splitlines() if "consent" in line], said.err


def test_a_station_that_cannot_be_asked_and_has_no_consent_is_a_warning(small, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    vehicle_file(tmp_path, "")
    assert checked(small, capsys) == (
        0,
        [
            'warning: B cannot be asked for consent: write consent = "automatic" or consent = "refuse" in its '
            "[[station]] of the vehicle's file. Else START needs its program to show operator control first"
        ],
        "",
    )


def test_consent_that_is_refused_where_the_route_needs_it_is_an_error(small, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    vehicle_file(tmp_path, 'consent = "refuse"')
    assert checked(small, capsys) == (
        1,
        ['error:   B has consent = "refuse", and the route needs A -> B'],
        "",
    )


def test_with_consent_or_with_the_file_of_another_vehicle_nothing_is_said(small, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    vehicle_file(tmp_path, 'consent = "automatic"')
    assert checked(small, capsys) == (0, [], "")
    vehicle_file(tmp_path, "")
    text = tmp_path.joinpath("handover.toml").read_text()
    tmp_path.joinpath("handover.toml").write_text(text.replace('"A"', '"C"'))
    assert checked(small, capsys) == (0, [], "")


def test_a_named_file_counts_whatever_its_stations_are_called(small, tmp_path, capsys):
    vehicle_file(tmp_path, "")
    path = tmp_path / "handover.toml"
    path.write_text(path.read_text().replace('"A"', '"C"'))
    assert len(checked(small, capsys, "--config", str(path))[1]) == 1
    path.write_text("[vehicle]")
    code, _lines, error = checked(small, capsys, "--config", str(path))
    assert (code, error.count("\n")) == (2, 1)
    assert error.startswith(f"handover check: {path}: ")
