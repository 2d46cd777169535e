# SPDX-License-Identifier: GPL-3.0-or-later

"""Zones as people draw them: what is read of GeoJSON, KML, KMZ and a plan's geofence, and the words for each fault."""

from __future__ import annotations

import io
import json
import math
import zipfile
from pathlib import Path
from random import Random
from typing import Any

import pytest
from shapely.geometry import MultiPolygon, Polygon

from mavproxy_handover.mission import Circle, MissionError
from mavproxy_handover.mission.drawn import files
from mavproxy_handover.mission.drawn.areas import DrawnZone, corners_of, cut_at_meridian, simplified
from mavproxy_handover.mission.drawn.fence import without_parts
from mavproxy_handover.mission.drawn.files import read_zone_file

SQUARE = [[10.0, -0.001], [10.004, -0.001], [10.004, 0.001], [10.0, 0.001], [10.0, -0.001]]
BOW_TIE = [[10.0, 0.0], [10.004, 0.002], [10.004, 0.0], [10.0, 0.002], [10.0, 0.0]]
NEXT = "Put it right, or name the zones that count with --station NAME=ZONE"
DRAW = "Draw it as a polygon, or name the zones that count with --station NAME=ZONE"


def feature(coordinates: Any, kind: str = "Polygon", **properties: Any) -> dict[str, Any]:
    return {"type": "Feature", "properties": properties, "geometry": {"type": kind, "coordinates": coordinates}}


def geojson(folder: Path, *features: Any, name: str = "zones.geojson", **more: Any) -> Path:
    path = folder / name
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features, **more}), encoding="utf-8")
    return path


def ring(corners: Any, tag: str = "outerBoundaryIs") -> str:
    text = " ".join(",".join(map(str, corner)) for corner in corners)
    return f"<{tag}><LinearRing><coordinates>{text}</coordinates></LinearRing></{tag}>"


def placemark(name: str, geometry: str, more: str = "") -> str:
    return f"<Placemark><name>{name}</name>{more}{geometry}</Placemark>"


LINE = "<LineString><coordinates>1,2 3,4</coordinates></LineString>"


def kml_text(*placemarks: str, head: str = "") -> str:
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n{head}<kml xmlns="http://www.opengis.net/kml/2.2"><Document>'
        f"<Folder>{''.join(placemarks)}</Folder></Document></kml>"
    )


def kml(folder: Path, *placemarks: str, head: str = "", name: str = "zones.kml") -> Path:
    path = folder / name
    path.write_text(kml_text(*placemarks, head=head), encoding="utf-8")
    return path


def kmz(folder: Path, text: str | bytes, inner: str = "doc.kml", *, pack: int = zipfile.ZIP_DEFLATED) -> Path:
    path = folder / "zones.kmz"
    with zipfile.ZipFile(path, "w", pack) as archive:
        archive.writestr("files/icon.png", b"no picture")
        archive.writestr(inner, text)
    return path


def refusal(path: Path) -> str:
    with pytest.raises(MissionError) as caught:
        read_zone_file(path)
    return str(caught.value)


def fault(path: Path, number: int = 0) -> str:
    zone = read_zone_file(path)[number]
    assert zone.area is None
    assert zone.fault is not None
    return str(zone.fault)


def names(zones: tuple[DrawnZone, ...]) -> list[str]:
    return [zone.name for zone in zones]


# --- GeoJSON ---


def test_a_name_is_a_property_in_any_case_or_the_id_of_the_feature(tmp_path: Path) -> None:
    path = geojson(
        tmp_path,
        feature([SQUARE], station="GCSA", name="north"),
        feature([SQUARE], Name="South", stroke="#ff0000"),
        feature([SQUARE], TITLE="East"),
        {**feature([SQUARE]), "id": 7},
        feature([SQUARE], name=""),
    )
    assert names(read_zone_file(path)) == ["GCSA", "South", "East", "7", ""]


def test_a_name_is_one_printable_line_of_at_most_60_characters(tmp_path: Path) -> None:
    path = geojson(tmp_path, feature([SQUARE], name="\n North\t\x07 field "), feature([SQUARE], name="x" * 100))
    assert names(read_zone_file(path)) == ["North field", "x" * 60]
    assert names(read_zone_file(kml(tmp_path, placemark("y " * 100, f"<Polygon>{ring(SQUARE)}</Polygon>")))) == [
        ("y " * 30).strip()
    ]


def test_a_file_with_one_zone_without_a_name_gives_its_own(tmp_path: Path) -> None:
    (zone,) = read_zone_file(geojson(tmp_path, feature([SQUARE]), name="Hilltop.geojson"))
    assert zone.name == "Hilltop"
    assert zone.place == "Hilltop.geojson: feature 1"


def test_a_feature_and_a_bare_geometry_are_files_of_one_zone(tmp_path: Path) -> None:
    for document in (feature([SQUARE]), feature([SQUARE])["geometry"]):
        path = tmp_path / "A.json"
        path.write_text(json.dumps(document), encoding="utf-8")
        (zone,) = read_zone_file(path)
        assert zone.name == "A"
        assert isinstance(zone.area, Polygon)


def test_parts_collections_holes_and_circles_are_read(tmp_path: Path) -> None:
    far = [[lon + 0.01, lat] for lon, lat in SQUARE]
    hole = [[10.001, -0.0005], [10.002, -0.0005], [10.002, 0.0005], [10.001, -0.0005]]
    collection = {
        "type": "GeometryCollection",
        "geometries": [feature([SQUARE])["geometry"], feature([far])["geometry"]],
    }
    path = geojson(
        tmp_path,
        feature([[SQUARE, hole], [far]], "MultiPolygon", name="A"),
        {"type": "Feature", "properties": {"name": "B"}, "geometry": collection},
        feature([10.0, 0.5, 12.0], "Point", name="C", radius_m=400, max_alt_m=120),
    )
    parts, collected, circle = read_zone_file(path)
    assert isinstance(parts.area, MultiPolygon)
    assert [len(part.interiors) for part in parts.area.geoms] == [1, 0]
    assert isinstance(collected.area, MultiPolygon)
    assert circle.area == Circle(0.5, 10.0, 400.0)
    assert (circle.min_alt_m, circle.max_alt_m) == (None, 120.0)


def test_a_ring_that_is_not_closed_is_closed_and_parts_that_touch_are_joined(tmp_path: Path) -> None:
    beside = [[lon + 0.004, lat] for lon, lat in SQUARE]
    path = geojson(tmp_path, feature([SQUARE[:-1]], name="A"), feature([[SQUARE], [beside]], "MultiPolygon", name="B"))
    opened, joined = read_zone_file(path)
    assert opened.area == Polygon(SQUARE)
    assert isinstance(joined.area, Polygon)
    assert joined.area.bounds == (10.0, -0.001, 10.008, 0.001)


def test_a_zone_across_the_180th_meridian_is_cut_there(tmp_path: Path) -> None:
    across = [[179.99, -17.0], [-179.99, -17.0], [-179.99, -16.9], [179.99, -16.9], [179.99, -17.0]]
    (zone,) = read_zone_file(geojson(tmp_path, feature([across], name="Taveuni")))
    assert isinstance(zone.area, MultiPolygon)
    assert sorted(part.bounds for part in zone.area.geoms) == [
        pytest.approx((-180.0, -17.0, -179.99, -16.9)),
        pytest.approx((179.99, -17.0, 180.0, -16.9)),
    ]


@pytest.mark.parametrize("lon", [179.999, -179.999])
def test_a_circle_across_the_180th_meridian_is_cut_on_either_side(lon: float) -> None:
    circle = Circle(-17.0, lon, 500.0).outline()
    area = cut_at_meridian(circle)
    west, _south, east, _north = area.bounds
    assert (west, east) == (-180.0, 180.0)
    assert area.area == pytest.approx(circle.area)


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        (feature([BOW_TIE], name="A"), "the outline crosses itself near latitude 0.001000, longitude 10.002000 "
         "(allowed: a plain area). Draw the outline again, without the crossing"),
        (feature(SQUARE, "LineString", name="A"),
         f"a LineString is no zone (allowed: Polygon, MultiPolygon, Point with radius_m). {DRAW}"),
        (feature([10.0, 0.0], "Point", name="A"),
         f"a Point is no zone without radius_m (allowed: Polygon, MultiPolygon, Point with radius_m). {DRAW}"),
        (feature([SQUARE], name="A", radius_m=3), "radius_m on a Polygon (allowed: on a Point). Remove it"),
        (feature([SQUARE], name="A", max_altm=3), "unknown property 'max_altm', did you mean 'max_alt_m'?"),
        (feature([SQUARE[:2]], name="A"), f"2 corners (allowed: 3 or more). {NEXT}"),
        (feature([], name="A"), f"no ring in the polygon (allowed: 1 or more). {NEXT}"),
        (feature([], "MultiPolygon", name="A"),
         "no area in it (allowed: Polygon, MultiPolygon, Point with radius_m). Draw the zone as a polygon"),
        (feature([[[520000.0, 5800000.0], *SQUARE]], name="A"),
         f"longitude of corner 1 is 520000.0 (allowed: a number from -180 to 180). {NEXT}"),
    ],
)  # fmt: skip
def test_a_feature_that_is_no_zone_is_told_with_file_and_name(entry: Any, said: str, tmp_path: Path) -> None:
    assert fault(geojson(tmp_path, entry)) == f"zones.geojson: feature 1 (A): {said}"


def test_lines_and_points_beside_zones_are_aside(tmp_path: Path) -> None:
    line = feature(SQUARE, "LineString", name="Road")
    point = feature([10.0, 0.0], "Point")
    collection = {"type": "GeometryCollection", "geometries": [line["geometry"], feature([SQUARE])["geometry"]]}
    mixed = {"type": "Feature", "properties": {"name": "A"}, "geometry": collection}
    found = read_zone_file(geojson(tmp_path, line, mixed, point))
    assert [(zone.name, zone.aside, zone.area is None) for zone in found] == [
        ("Road", True, True),
        ("A", False, False),
        ("", True, True),
    ]


def test_a_single_area_among_lines_has_the_name_of_its_file(tmp_path: Path) -> None:
    path = kml(tmp_path, placemark("", LINE), placemark("", f"<Polygon>{ring(SQUARE)}</Polygon>"), name="Nord.kml")
    assert [(zone.name, zone.aside) for zone in read_zone_file(path)] == [("", True), ("Nord", False)]


def test_an_area_that_is_drawn_wrong_is_not_aside(tmp_path: Path) -> None:
    path = kml(tmp_path, placemark("A", f"<Polygon>{ring(BOW_TIE)}</Polygon>"), placemark("B", LINE))
    wrong, line = read_zone_file(path)
    assert (wrong.aside, line.aside) == (False, True)
    assert wrong.fault is not None


def test_swapped_coordinates_are_noticed_from_home(tmp_path: Path) -> None:
    swapped = [[lat + 52.0, lon] for lon, lat in SQUARE]
    path = geojson(tmp_path, feature([swapped], name="A"))
    (zone,) = read_zone_file(path, (52.0, 10.0))
    assert str(zone.fault) == (
        "zones.geojson: feature 1 (A): corner 1 is far from home, and near it when swapped: longitude comes first"
    )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "line 1, column 2: not JSON: Expecting property name enclosed in double quotes"),
        ('{"type": "Topology"}',
         "not GeoJSON of zones (allowed: FeatureCollection, Feature, a geometry). Export it as GeoJSON"),
        ('{"type": "FeatureCollection", "features": []}',
         "no zone in it (allowed: a feature with a polygon). Draw one for each station"),
        ('{"type": "FeatureCollection", "features": [], "crs": {"properties": {"name": "urn:EPSG::25832"}}}',
         "crs is 'urn:EPSG::25832' (allowed: longitude and latitude in WGS 84). Export it as EPSG:4326"),
        ("\udcff", "not UTF-8 text (byte 0). Save it as UTF-8"),
    ],
)  # fmt: skip
def test_a_file_that_is_no_geojson_of_zones_is_refused(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "zones.geojson"
    path.write_text(text, encoding="utf-8", errors="surrogateescape")
    assert refusal(path) == f"zones.geojson: {said}"


def test_a_crs_that_is_wgs_84_is_taken(tmp_path: Path) -> None:
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}}
    assert names(read_zone_file(geojson(tmp_path, feature([SQUARE], name="A"), crs=crs))) == ["A"]


# --- KML and KMZ ---


def test_each_placemark_with_polygons_is_a_zone_of_its_name(tmp_path: Path) -> None:
    hole = [[10.001, -0.0005], [10.002, -0.0005], [10.002, 0.0005], [10.001, -0.0005]]
    two = [[lon + 0.01, lat, 35.0] for lon, lat in SQUARE]
    group = f"<MultiGeometry><Polygon>{ring(SQUARE)}</Polygon><Polygon>{ring(two)}</Polygon></MultiGeometry>"
    north, south = read_zone_file(
        kml(
            tmp_path,
            placemark("North &amp; field", f"<Polygon>{ring(SQUARE)}{ring(hole, 'innerBoundaryIs')}</Polygon>"),
            placemark("\n South\n", group),
        )
    )
    assert names((north, south)) == ["North & field", "South"]
    assert north.place == "zones.kml: placemark 1 (North & field)"
    assert isinstance(north.area, Polygon)
    assert len(north.area.interiors) == 1
    assert isinstance(south.area, MultiPolygon)


def test_our_properties_are_read_from_the_data_of_a_placemark(tmp_path: Path) -> None:
    data = (
        '<ExtendedData><Data name="station"><value>GCSA</value></Data><SchemaData><SimpleData name="max_alt_m">120'
        '</SimpleData></SchemaData><Data name="radius_m"><value>400</value></Data></ExtendedData>'
    )
    path = kml(tmp_path, placemark("mast", "<Point><coordinates>10.0,0.5,12</coordinates></Point>", data))
    (zone,) = read_zone_file(path)
    assert (zone.name, zone.area, zone.max_alt_m) == ("GCSA", Circle(0.5, 10.0, 400.0), 120.0)


def test_older_and_careless_files_are_read(tmp_path: Path) -> None:
    text = (
        '<?xml version="1.0" encoding="ISO-8859-1"?><kml xmlns="http://earth.google.com/kml/2.1"><Placemark>'
        "<gx:balloonVisibility>1</gx:balloonVisibility><name>Süd</name><Polygon><outerBoundaryIs><LinearRing>"
        "<coordinates>10.0, -0.001 10.004 ,-0.001\n10.004,0.001\t10.0,0.001</coordinates></LinearRing>"
        "</outerBoundaryIs></Polygon></Placemark></kml>"
    )
    path = tmp_path / "zones.KML"
    path.write_bytes(text.encode("latin-1"))
    (zone,) = read_zone_file(path)
    assert (zone.name, zone.area) == ("Süd", Polygon(SQUARE))


@pytest.mark.parametrize(
    ("geometry", "said"),
    [
        (f"<Polygon>{ring(BOW_TIE)}</Polygon>", "the outline crosses itself near latitude 0.001000, longitude "
         "10.002000 (allowed: a plain area). Draw the outline again, without the crossing"),
        ("<LineString><coordinates>1,2 3,4</coordinates></LineString>",
         f"a LineString is no zone (allowed: Polygon, MultiGeometry of polygons, Point with radius_m). {DRAW}"),
        ("<MultiGeometry><gx:Track/></MultiGeometry>",
         f"a Track is no zone (allowed: Polygon, MultiGeometry of polygons, Point with radius_m). {DRAW}"),
        ("", "no area in it (allowed: Polygon, MultiPolygon, Point with radius_m). Draw the zone as a polygon"),
        ("<Polygon/>", "a Polygon without outerBoundaryIs. Draw it again"),
        ("<Polygon><outerBoundaryIs><LinearRing><coordinates>10;0</coordinates></LinearRing></outerBoundaryIs>"
         "</Polygon>", f"corner 1 is '10;0' (allowed: longitude,latitude or longitude,latitude,height). {NEXT}"),
        ("<Polygon><outerBoundaryIs><LinearRing><coordinates>nan,0</coordinates></LinearRing></outerBoundaryIs>"
         "</Polygon>", f"longitude of corner 1 is nan (allowed: a number from -180 to 180). {NEXT}"),
    ],
)  # fmt: skip
def test_a_placemark_that_is_no_zone_is_told_with_file_and_name(geometry: str, said: str, tmp_path: Path) -> None:
    head = ""
    path = kml(tmp_path, placemark("A", geometry), placemark("B", f"<Polygon>{ring(SQUARE)}</Polygon>"), head=head)
    assert fault(path) == f"zones.kml: placemark 1 (A): {said}"
    assert read_zone_file(path)[1].fault is None


def test_a_limit_that_is_no_number_is_told(tmp_path: Path) -> None:
    data = '<ExtendedData><Data name="max_alt_m"><value>low</value></Data></ExtendedData>'
    path = kml(tmp_path, placemark("A", f"<Polygon>{ring(SQUARE)}</Polygon>", data))
    assert fault(path) == f"zones.kml: placemark 1: max_alt_m is 'low' (allowed: a number). {NEXT}"


BOMB = (
    '<!DOCTYPE kml [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;"><!ENTITY c SYSTEM "file:///etc/passwd">'
    "]>\n"
)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (kml_text(placemark("&b;&c;", ""), head=BOMB),
         "it has a document type (allowed: plain KML). Remove the line <!DOCTYPE ...>"),
        (kml_text(placemark("&nbsp;", "")), "line 2, column 80: not XML: undefined entity. Export it as KML again"),
        ("<kml><Document>", "line 1, column 16: not XML: no element found. Export it as KML again"),
        ("no xml", "line 1, column 1: not XML: syntax error. Export it as KML again"),
        ("<gpx/>", "its first element is <gpx> (allowed: <kml>). Export it as KML"),
        (kml_text(), "no zone in it (allowed: a placemark with a polygon). Draw one for each station"),
        ("<kml>" + "<Folder>" * 100,
         "more than 60 elements deep, or more than 200000 elements. Leave out what is no zone"),
        ('<?xml version="1.0" encoding="no-such"?><kml/>',
         "not readable as XML (unknown encoding: no-such). Export it as KML in UTF-8"),
    ],
)  # fmt: skip
def test_a_file_that_is_no_kml_of_zones_is_refused(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "zones.kml"
    path.write_text(text, encoding="utf-8")
    assert refusal(path) == f"zones.kml: {said}"
    assert refusal(kmz(tmp_path, text)) == f"zones.kmz: {said}"


@pytest.mark.parametrize("inner", ["doc.kml", "zones/North.KML"])
def test_a_kmz_is_its_kml(inner: str, tmp_path: Path) -> None:
    text = kml_text(placemark("North", f"<Polygon>{ring(SQUARE)}</Polygon>"))
    (zone,) = read_zone_file(kmz(tmp_path, text, inner))
    assert (zone.place, zone.area) == ("zones.kmz: placemark 1 (North)", Polygon(SQUARE))


def test_a_kmz_that_cannot_be_unpacked_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "zones.kmz"
    path.write_bytes(b"PK\x03\x04 and no more")
    assert refusal(path) == "zones.kmz: not a readable KMZ archive (File is not a zip file). Export it again, or as KML"
    path = kmz(tmp_path, "x", "readme.txt")
    assert refusal(path) == (
        "zones.kmz: no .kml file in the archive (allowed: a KMZ file). Export it as KMZ, or as KML"
    )
    data = bytearray(kmz(tmp_path, "<kml>" * 50, pack=zipfile.ZIP_STORED).read_bytes())
    data[data.index(b"<kml>")] ^= 1
    path.write_bytes(data)
    assert refusal(path) == (
        "zones.kmz: not a readable KMZ archive (Bad CRC-32 for file 'doc.kml'). Export it again, or as KML"
    )
    monkeypatch.setattr(files, "MAX_FILE_BYTES", 50_000)
    path = kmz(tmp_path, b" " * 60_000)
    assert refusal(path) == "zones.kmz: doc.kml is larger than 50000 bytes when unpacked. Leave out what is no zone"


def test_what_a_kmz_says_of_its_own_size_is_not_believed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A header that says 10 bytes does not let more than the limit be unpacked."""
    monkeypatch.setattr(files, "MAX_FILE_BYTES", 50_000)
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("doc.kml", b" " * 60_000)
    data = stream.getvalue().replace((60_000).to_bytes(4, "little"), (10).to_bytes(4, "little"))
    path = tmp_path / "zones.kmz"
    path.write_bytes(data)
    assert refusal(path).startswith("zones.kmz: not a readable KMZ archive (Bad CRC-32")


# --- the geofence of a plan ---


def fence_plan(folder: Path, **fence: Any) -> Path:
    path = folder / "field.plan"
    path.write_text(json.dumps({"fileType": "Plan", "geoFence": {"version": 2, **fence}}), encoding="utf-8")
    return path


def corners(inclusion: bool = True) -> dict[str, Any]:
    return {"inclusion": inclusion, "polygon": [[lat, lon] for lon, lat in SQUARE[:-1]], "version": 1}


def test_inclusion_areas_of_a_geofence_are_zones_without_names(tmp_path: Path) -> None:
    circle = {"circle": {"center": [0.5, 10.0], "radius": 400}, "inclusion": True, "version": 1}
    path = fence_plan(tmp_path, polygons=[corners(), corners(False), corners()], circles=[circle])
    zones = read_zone_file(path)
    assert [(zone.name, zone.place, zone.fence_part) for zone in zones] == [
        ("", "field.plan: geoFence, polygon 1", 0),
        ("", "field.plan: geoFence, polygon 3", 2),
        ("", "field.plan: geoFence, circle 1", 3),
    ]
    assert zones[0].area == Polygon(SQUARE)
    assert zones[2].area == Circle(0.5, 10.0, 400.0)
    left = json.loads(without_parts(path.read_text(encoding="utf-8"), {0, 3}))
    assert left["geoFence"] == {"version": 2, "polygons": [corners(False), corners()], "circles": []}


def test_a_plan_without_inclusion_areas_has_no_zone(tmp_path: Path) -> None:
    path = fence_plan(tmp_path, polygons=[corners(False)], circles=[])
    assert refusal(path) == (
        "field.plan: no zone in it (allowed: an inclusion polygon or circle in the geofence). Draw one for each station"
    )


# --- files ---


def test_a_file_of_another_kind_a_missing_and_a_large_one_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert refusal(tmp_path / "zones.shp") == (
        "zones.shp: not a file of zones (allowed: a file that ends in .geojson, .json, .kml, .kmz, .plan). Export it so"
    )
    assert refusal(tmp_path / "zones.kml") == f"{tmp_path}/zones.kml: No such file or directory"
    path = geojson(tmp_path, feature([SQUARE], name="A"))
    monkeypatch.setattr(files, "MAX_FILE_CORNERS", 4)
    assert refusal(path) == "zones.geojson: 5 corners (allowed: at most 4). Export it with less detail"
    monkeypatch.setattr(files, "MAX_FILE_BYTES", 100)
    assert refusal(path) == f"{path}: larger than 100 bytes. Leave out what is not needed"


# --- simplified ---


def wavy(number: int, waves_m: float) -> Polygon:
    """A circle of 1 km at the equator, whose border has waves."""
    radii = [1000.0 + waves_m * math.sin(0.7 * n) for n in range(number)]
    angles = [2.0 * math.pi * n / number for n in range(number)]
    return Polygon(
        [(10.0 + r * math.sin(a) / 111319.5, r * math.cos(a) / 110574.3) for r, a in zip(radii, angles, strict=True)]
    )


@pytest.mark.parametrize(("waves_m", "most_m"), [(0.0, 0.05), (3.0, 7.0)])
def test_a_zone_of_many_corners_is_simplified_as_little_as_is_enough(waves_m: float, most_m: float) -> None:
    area = wavy(5000, waves_m)
    found, moved_m = simplified(area)
    assert corners_of(area) == 5001
    assert 500 <= corners_of(found) <= 1000
    assert 0.0 < moved_m <= most_m
    assert isinstance(found, Polygon)
    assert found.is_valid
    far = max(found.exterior.distance(area.exterior.interpolate(n / 997, normalized=True)) for n in range(997))
    assert far * 111319.5 <= moved_m + 0.01


def test_a_zone_of_few_corners_and_a_circle_stay_as_they_are() -> None:
    area, circle = wavy(900, 3.0), Circle(0.0, 10.0, 400.0)
    assert simplified(area) == (area, 0.0)
    assert simplified(circle) == (circle, 0.0)


def test_parts_that_cannot_have_fewer_corners_are_told() -> None:
    squares = [Polygon([(x, 0), (x + 0.4, 0), (x + 0.4, 0.4)]) for x in range(20)]
    with pytest.raises(ValueError, match="80 corners are left"):
        simplified(MultiPolygon(squares), 50)


# --- damaged files ---


def _damaged(data: bytes, random: Random) -> bytes:
    """The data with a few bytes changed, removed, or written twice."""
    found = bytearray(data)
    for _ in range(random.randint(1, 8)):
        at, length = random.randrange(len(found)), random.randint(1, 12)
        change = random.randrange(3)
        if change == 0:
            found[at] = random.choice(b'0"<>{}[],:-&e/ \xff')
        elif change == 1:
            del found[at : at + length]
        else:
            found[at:at] = found[at : at + length]
    return bytes(found) or b"x"


@pytest.mark.parametrize("kind", ["kml", "kmz", "geojson", "plan"])
def test_a_damaged_file_is_read_or_refused_in_one_line(kind: str, tmp_path: Path) -> None:
    hole = [[10.001, -0.0005], [10.002, -0.0005], [10.002, 0.0005], [10.001, -0.0005]]
    text = kml_text(placemark("A", f"<Polygon>{ring(SQUARE)}{ring(hole, 'innerBoundaryIs')}</Polygon>"))
    circle = {"circle": {"center": [0.5, 10.0], "radius": 400}, "inclusion": True, "version": 1}
    path = {
        "kml": lambda: kml(tmp_path, placemark("A", f"<Polygon>{ring(SQUARE)}</Polygon>")),
        "kmz": lambda: kmz(tmp_path, text),
        "geojson": lambda: geojson(
            tmp_path, feature([SQUARE, hole], name="A"), feature([1.0, 2.0], "Point", radius_m=9)
        ),
        "plan": lambda: fence_plan(tmp_path, polygons=[corners()], circles=[circle]),
    }[kind]()
    data, random, read = path.read_bytes(), Random(48), 0
    for _ in range(1500):
        path.write_bytes(_damaged(data, random))
        try:
            zones = read_zone_file(path, (0.0, 10.0))
        except MissionError as error:
            assert str(error).isprintable()  # noqa: PT017
            continue
        read += 1
        for zone in zones:
            assert (zone.area is None) is (zone.fault is not None)
    assert read > 10
