# SPDX-License-Identifier: GPL-3.0-or-later

"""The package as a whole: folder, bytes, digest; and bytes from a link that are anything but a package."""

from __future__ import annotations

import hashlib
import json
import re
import tracemalloc
import zlib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mavproxy_handover.core.authority.payload import PayloadKind, PayloadRules
from mavproxy_handover.mission import MissionError, MissionPackage, StationEntry, from_bytes, load
from mavproxy_handover.mission import package as mission_package
from mavproxy_handover.mission.package import MAX_PACKED_BYTES

MISSIONS = Path(__file__).resolve().parents[2] / "missions"


def refusal(small) -> str:
    with pytest.raises(MissionError) as caught:
        load(small.write())
    assert "\n" not in str(caught.value)
    return str(caught.value)


def bytes_refusal(data: bytes) -> str:
    with pytest.raises(MissionError) as caught:
        from_bytes(data)
    return str(caught.value)


def packed(files: object) -> bytes:
    return zlib.compress(json.dumps(files, sort_keys=True, ensure_ascii=False, separators=(",", ":")).encode())


def texts(small) -> dict[str, str]:
    return {path.name: path.read_text() for path in small.write().iterdir()}


# --- what is read ---


def test_package_holds_what_the_folder_says(small):
    small.toml = small.toml.replace(
        "expected_handovers = 1",
        'expected_handovers = 1\ndescription = "There."\ncruise_speed_mps = 8\ndelivery_waypoint = 2',
    )
    small.toml += '[policy]\non_out_of_coverage = "land"\n'
    package = load(small.write())
    assert (package.name, package.description, package.detector) == ("small", "There.", "polygons")
    assert package.stations == (StationEntry("A", 251), StationEntry("B", 252))
    assert package.parent.name == "A"
    assert package.station(252) == StationEntry("B", 252)
    assert package.station(9) is None
    assert [zone.station for zone in package.zones] == [251, 252]
    assert (package.expected_handovers, package.cruise_speed_mps, package.delivery_waypoint) == (1, 8.0, 2)
    assert package.policies == {"on_out_of_coverage": "land"}
    assert sorted(package.files) == ["mission.toml", "small.plan", "zones.geojson"]
    assert package.simulate().commanders == (251, 252)


def test_cruise_speed_is_the_plans_unless_stated(small):
    package = load(small.write())
    assert (package.cruise_speed_mps, package.cruise_speed_named) == (5.0, True)
    del small.plan["mission"]["hoverSpeed"]
    package = load(small.write())
    assert (package.cruise_speed_mps, package.cruise_speed_named) == (10.0, False)
    small.toml = "cruise_speed_mps = 7\n" + small.toml
    package = load(small.write())
    assert (package.cruise_speed_mps, package.cruise_speed_named) == (7.0, True)


def test_route_may_be_a_waypoint_file(small):
    small.write()
    (small.folder / "small.waypoints").write_text(
        "QGC WPL 110\n0 1 0 16 0 0 0 0 0 10.001 0 1\n1 0 3 22 0 0 0 0 0 10.001 30 1\n2 0 3 21 0 0 0 0 0 10.005 0 1\n"
    )
    (small.folder / "mission.toml").write_text(small.toml.replace("small.plan", "small.waypoints"))
    assert load(small.folder).simulate().commanders == (251, 252)


def test_policies_and_files_cannot_be_changed(small):
    package = load(small.write())
    with pytest.raises(TypeError):
        package.files["mission.toml"] = b""
    with pytest.raises(TypeError):
        package.policies["on_out_of_coverage"] = "warn"


# --- round trip ---


@pytest.mark.parametrize("name", ["delivery", "linear", "corridor", "meridian", "ridge", "field-test", "waypoints"])
def test_shipped_missions_survive_the_way_over_a_link(name):
    sent = load(MISSIONS / name)
    data = sent.to_bytes()
    assert len(data) < 4096
    got = from_bytes(data)
    assert got == sent
    assert got.digest == sent.digest
    for field in MissionPackage.__dataclass_fields__:
        assert getattr(got, field) == getattr(sent, field), field
    assert got.to_bytes() == data


def test_digest_is_the_sha256_of_the_files_as_sorted_json(small):
    small.toml = small.toml.replace("small.plan", "a.plan")
    small.write()
    (small.folder / "small.plan").rename(small.folder / "a.plan")
    package = load(small.folder)
    files = {name: (small.folder / name).read_text() for name in ("a.plan", "mission.toml", "zones.geojson")}
    plain = json.dumps(files, ensure_ascii=False, separators=(",", ":")).encode()
    assert package.digest == hashlib.sha256(plain).digest()
    assert zlib.decompress(package.to_bytes()) == plain


def test_any_changed_byte_is_another_mission(small):
    first = load(small.write())
    small.toml += "# a remark\n"
    second = load(small.write())
    assert first != second
    assert len({first, second, load(small.folder)}) == 2


def test_line_ends_and_byte_order_mark_of_a_checkout_change_nothing(small):
    first = load(small.write())
    path = small.folder / "mission.toml"
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n"))
    assert load(small.folder) == first


def test_files_that_the_mission_does_not_name_do_not_travel(small):
    first = load(small.write())
    (small.folder / "signing.key").write_text("secret")
    package = load(small.folder)
    assert package == first
    assert b"secret" not in zlib.decompress(package.to_bytes())


# --- folders that are refused ---


def test_refuses_a_folder_without_mission_toml(tmp_path):
    with pytest.raises(MissionError) as caught:
        load(tmp_path)
    assert str(caught.value) == f"{tmp_path}/mission.toml: No such file or directory"


def test_refuses_a_route_that_is_not_there(small):
    small.toml = small.toml.replace("small.plan", "other.plan")
    assert refusal(small) == f"{small.folder}/other.plan: No such file or directory"


def test_refuses_text_that_is_not_utf8(small):
    small.write()
    (small.folder / "zones.geojson").write_bytes(b"{\xff}")
    with pytest.raises(MissionError) as caught:
        load(small.folder)
    assert str(caught.value) == f"{small.folder}/zones.geojson: not UTF-8 text (byte 1)"


def test_refuses_text_that_is_no_toml(small):
    small.toml = "name = \n"
    assert refusal(small).startswith("mission.toml: not TOML: Invalid value (at line 1, column 8)")


def test_refuses_unknown_keys_and_suggests_the_right_one(small):
    small.toml = small.toml.replace("expected_handovers", "expected_handover")
    assert refusal(small) == (
        "mission.toml: unknown key 'expected_handover', did you mean 'expected_handovers'? (allowed: name, description,"
        " aircraft, detector, route, zones, terrain, corridor_m, endless_jump, expected_handovers,"
        " rally_reach_m, cruise_speed_mps, delivery_waypoint, stations, policy, energy, wings, payload, gap)"
    )


def test_refuses_an_endless_jump_that_is_no_flag(small):
    small.toml = small.toml.replace("detector", "endless_jump = 1\ndetector", 1)
    assert refusal(small) == "mission.toml: endless_jump is 1 (allowed: true or false)"


@pytest.mark.parametrize("key", ["name", "detector", "route", "zones"])
def test_refuses_a_missing_key(small, key):
    small.toml = re.sub(rf"^{key} = .*\n", "", small.toml, count=1, flags=re.MULTILINE)
    assert refusal(small) == f"mission.toml: key '{key}' is missing"


def test_refuses_a_route_outside_the_folder(small):
    small.toml = small.toml.replace('"small.plan"', '"../small.plan"')
    assert refusal(small) == (
        "mission.toml: route is not a plain file name (allowed: letters, digits, _ and -, an ending, no folder)"
    )


def test_refuses_an_unknown_detector(small):
    small.toml = small.toml.replace('"polygons"', '"polygon"')
    assert refusal(small) == "mission.toml: detector is 'polygon' (allowed: circles, polygons, waypoints, reached)"


def test_refuses_no_stations(small):
    small.toml = small.toml.split("[[stations]]", maxsplit=1)[0] + "stations = []\n"
    assert refusal(small) == "mission.toml: no stations (allowed: 1 or more, the parent first)"


def test_refuses_a_station_name_that_is_none(small):
    small.toml = small.toml.replace('name = "B"', 'name = "B 2"')
    assert refusal(small) == (
        "mission.toml: station 2: name is not a station's name (allowed: 1 to 16 letters, digits, - and _)"
    )


def test_refuses_a_station_name_twice(small):
    small.toml = small.toml.replace('name = "B"', 'name = "A"')
    assert refusal(small) == "mission.toml: station 2: name 'A' is taken by another station"


def test_refuses_a_system_id_twice(small):
    small.toml = small.toml.replace("252", "251")
    assert refusal(small) == "mission.toml: station 2: sysid 251 is taken by station 'A'"


def test_refuses_a_system_id_out_of_range(small):
    small.toml = small.toml.replace("252", "256")
    assert refusal(small) == "mission.toml: station 2: sysid is 256 (allowed: a whole number from 1 to 255)"


def test_refuses_unknown_keys_of_a_station(small):
    small.toml = small.toml.replace("sysid = 252", "sys_id = 252")
    assert refusal(small) == (
        "mission.toml: station 2: unknown key 'sys_id', did you mean 'sysid'? (allowed: name, sysid, place)"
    )


def test_refuses_unknown_policies(small):
    small.toml += '[policy]\nout_of_coverage = "land"\n'
    assert refusal(small) == (
        "mission.toml: [policy]: unknown key 'out_of_coverage', did you mean 'on_out_of_coverage'?"
        " (allowed: on_out_of_coverage)"
    )


def test_refuses_an_unknown_word_of_a_policy(small):
    small.toml += '[policy]\non_out_of_coverage = "rtl"\n'
    assert refusal(small) == ("mission.toml: [policy]: on_out_of_coverage is 'rtl' (allowed: return, land, warn)")


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ('gimbal = "GCSX"', "gimbal is 'GCSX' (allowed: flight, request, A, B)"),
        ("camera = 252", "camera is 252 (allowed: flight, request, A, B)"),
        ('control = ""', "control is '' (allowed: flight, request, A, B)"),
        ('at_handover = "give"', "at_handover is 'give' (allowed: release, keep)"),
        (
            'gimbl = "A"',
            "unknown key 'gimbl', did you mean 'gimbal'? (allowed: control, gimbal, camera, winch, at_handover)",
        ),
    ],
)
def test_refuses_what_is_wrong_with_the_payload(small, text, problem):
    small.toml += f"[payload]\n{text}\n"
    assert refusal(small) == f"mission.toml: [payload]: {problem}"


def test_the_payload_travels_with_the_package_and_an_older_package_says_nothing_of_it(small):
    older = load(small.write())
    assert older.payload == PayloadRules()
    small.toml += '[payload]\ncontrol = "request"\ncamera = "B"\nat_handover = "keep"\n'
    package = load(small.write())
    assert package.digest != older.digest
    read = from_bytes(package.to_bytes())
    assert read.payload == PayloadRules("request", "keep", {PayloadKind.CAMERA: "B"})
    assert from_bytes(older.to_bytes()).digest == older.digest


def test_refuses_a_speed_of_zero(small):
    small.toml = "cruise_speed_mps = 0\n" + small.toml
    assert refusal(small) == "mission.toml: cruise_speed_mps is 0 (allowed: a number from 0.1 to 100)"


def test_refuses_a_number_that_is_none(small):
    small.toml = "cruise_speed_mps = nan\n" + small.toml
    assert refusal(small) == "mission.toml: cruise_speed_mps is nan (allowed: a number from 0.1 to 100)"


def test_refuses_a_truth_value_for_a_number(small):
    small.toml = small.toml.replace("expected_handovers = 1", "expected_handovers = true")
    assert refusal(small) == ("mission.toml: expected_handovers is true (allowed: a whole number from 0 to 1000)")


def test_refuses_a_delivery_that_is_not_flown_to(small):
    small.items.insert(1, {"type": "SimpleItem", "command": 178, "frame": 2, "params": [1, 8, -1, 0, 0, 0, 0]})
    small.toml = "delivery_waypoint = 2\n" + small.toml
    assert refusal(small) == (
        "mission.toml: delivery_waypoint 2 is DO_CHANGE_SPEED (allowed: an item that is flown to)"
    )


def test_refuses_a_delivery_beyond_the_route(small):
    small.toml = "delivery_waypoint = 4\n" + small.toml
    assert refusal(small) == "mission.toml: delivery_waypoint is 4 (allowed: a whole number from 1 to 3)"


def test_refuses_a_package_that_could_not_be_sent(small):
    noise = "".join(hashlib.sha256(bytes([n % 256, n // 256])).hexdigest() for n in range(3000))
    small.zones["note"] = noise
    assert refusal(small) == f"{small.folder}: larger than 65536 bytes when packed: it could not be sent"


# --- waypoint lists ---


def test_waypoint_zones_follow_the_route(small):
    small.items[1:1] = [small.item(2, 16, 0.0, 10.003, 30)]
    small.toml = """\
name = "small"
detector = "waypoints"
corridor_m = 55.6597
route = "small.plan"
expected_handovers = 1
[[stations]]
name = "A"
sysid = 251
waypoints = [1, 2]
[[stations]]
name = "B"
sysid = 252
waypoints = [2, 3, 4]
"""
    package = load(small.write())
    west, _, east, north = package.zones[0].area.bounds
    # 55.6597 m are half a thousandth of a degree of longitude
    assert (west, east) == (pytest.approx(10.0005, abs=1e-7), pytest.approx(10.0035, abs=1e-7))
    assert north == pytest.approx(55.6597 / 110574.276, abs=1e-8)
    (handover,) = package.simulate().handovers
    assert handover.lon_deg == pytest.approx(10.0025, abs=1e-6)
    assert handover.overlap_length_m == pytest.approx(111.319, abs=0.1)


WAYPOINTS_TOML = """\
name = "small"
detector = "waypoints"
corridor_m = 100
route = "small.plan"
expected_handovers = 0
[[stations]]
name = "A"
sysid = 251
waypoints = [1, 2, 3]
"""


def test_single_waypoint_covers_a_circle_and_a_gap_in_the_list_cuts_the_zone(small):
    small.items[1:1] = [small.item(n, 16, 0.0, 10.001 + n / 100, 30) for n in range(2, 5)]
    small.toml = WAYPOINTS_TOML.replace("[1, 2, 3]", "[2, 4]")
    area = load(small.write()).zones[0].area
    assert [round(part.bounds[0], 4) for part in sorted(area.geoms, key=lambda part: part.bounds)] == [10.0201, 10.0401]


def test_refuses_a_waypoint_beyond_the_route(small):
    small.toml = WAYPOINTS_TOML.replace("[1, 2, 3]", "[1, 2, 4]")
    assert refusal(small) == "mission.toml: station 1: waypoint 4 is not on the route (allowed: 1 to 3)"


def test_refuses_a_waypoint_that_is_not_flown_to(small):
    small.items[1] = {"type": "SimpleItem", "command": 178, "frame": 2, "params": [1, 8, -1, 0, 0, 0, 0]}
    small.toml = WAYPOINTS_TOML
    assert refusal(small) == (
        "mission.toml: station 1: waypoint 2 is DO_CHANGE_SPEED (allowed: an item that is flown to)"
    )


def test_refuses_an_empty_waypoint_list(small):
    small.toml = WAYPOINTS_TOML.replace("[1, 2, 3]", "[]")
    assert refusal(small) == "mission.toml: station 1: no waypoints (allowed: 1 or more items of the route)"


def test_refuses_zones_with_waypoints(small):
    small.toml = 'zones = "zones.geojson"\n' + WAYPOINTS_TOML
    assert refusal(small) == (
        "mission.toml: key 'zones' does not go with detector 'waypoints' (the zones follow the route)"
    )


def test_refuses_a_corridor_with_polygons(small):
    small.toml = "corridor_m = 100\n" + small.toml
    assert refusal(small) == (
        "mission.toml: key 'corridor_m' does not go with detector 'polygons' (allowed: with 'waypoints', 'reached')"
    )


def test_refuses_waypoints_of_a_station_with_polygons(small):
    small.toml = small.toml.replace("sysid = 252", "sysid = 252\nwaypoints = [1]")
    assert refusal(small) == "mission.toml: station 2: unknown key 'waypoints' (allowed: name, sysid, place)"


# --- bytes that are refused ---


def test_refuses_bytes_that_are_not_compressed():
    assert bytes_refusal(b"hello") == "mission package: not compressed data"
    assert bytes_refusal(b"") == "mission package: cut short, or something follows it"


def test_refuses_too_many_bytes():
    assert bytes_refusal(bytes(MAX_PACKED_BYTES + 1)) == "mission package: 65537 bytes (allowed: at most 65536)"


def test_refuses_a_bomb_without_unpacking_it():
    bomb = zlib.compress(bytes(60_000_000), 9)
    assert len(bomb) <= MAX_PACKED_BYTES
    tracemalloc.start()
    try:
        assert bytes_refusal(bomb) == "mission package: more than 1048576 bytes when unpacked"
        assert tracemalloc.get_traced_memory()[1] < 4_000_000
    finally:
        tracemalloc.stop()


def test_refuses_a_package_cut_short_or_with_something_behind_it(small):
    data = load(small.write()).to_bytes()
    assert bytes_refusal(data[:-1]) == "mission package: cut short, or something follows it"
    assert bytes_refusal(data + b"\0") == "mission package: cut short, or something follows it"


def test_refuses_json_that_is_no_package():
    assert bytes_refusal(zlib.compress(b"[")) == "mission package: not JSON"
    assert bytes_refusal(zlib.compress(b"\xff")) == "mission package: not JSON"
    assert bytes_refusal(zlib.compress(b"[" * 40_000)) == "mission package: not JSON"
    assert bytes_refusal(packed([])) == "mission package: not files by name"
    assert bytes_refusal(packed({"mission.toml": 1})) == "mission package: not files by name"
    assert bytes_refusal(packed({})) == "mission package: no mission.toml in it"


@pytest.mark.parametrize(
    "name", ["../x.plan", "/etc/passwd", "a/b.plan", ".hidden", "noending", "a b.plan", "x.plan\0"]
)
def test_refuses_names_that_are_no_plain_files(small, name):
    assert bytes_refusal(packed({**texts(small), name: ""})) == (
        "mission package: a file is not a plain file name (allowed: letters, digits, _ and -, an ending, no folder)"
    )


def test_refuses_files_that_nobody_names(small):
    assert bytes_refusal(packed({**texts(small), "extra.txt": ""})) == (
        "mission package: file 'extra.txt' is not named in mission.toml"
    )


def test_refuses_a_file_left_out(small):
    files = texts(small)
    del files["small.plan"]
    assert bytes_refusal(packed(files)) == "mission package: file 'small.plan' is missing"


def test_refuses_another_form_of_the_same_content(small):
    loose = zlib.compress(json.dumps(texts(small), sort_keys=True).encode())
    assert bytes_refusal(loose) == "mission package: not in the canonical form"
    twice = zlib.decompress(packed(texts(small)))[:-1] + b',"mission.toml":""}'
    assert bytes_refusal(zlib.compress(twice)) == "mission package: not in the canonical form"
    assert bytes_refusal(zlib.compress(b'{"mission.toml":"\\ud800"}')) == "mission package: not in the canonical form"


def only_mission_errors(data: bytes) -> None:
    try:
        package = from_bytes(data)
    except MissionError as error:
        text = str(error)
    else:
        # what is accepted can be walked and sent on
        package.simulate()
        assert from_bytes(package.to_bytes()) == package
        text = "accepted"
    assert "\n" not in text
    assert len(text) < 2000


def spoiled_toml(more):
    return packed({**DELIVERY, "mission.toml": DELIVERY["mission.toml"] + more})


@pytest.mark.parametrize(
    ("more", "why"),
    [
        ("a." * 1900 + "a = 1\n", "line 30: 1900 dots (allowed: at most 100)"),
        ("a." * 100_000 + "a = 1\n", "characters (allowed: at most 65536)"),
        ("x = 1" + " " * 5000 + "\n", "line 30: 5005 characters (allowed: at most 4000)"),
        ("[" + "a." * 101 + "a]\n", "line 30: 101 dots (allowed: at most 100)"),
        ("x = " + "9" * 400 + "\n", "a number of hundreds of digits"),
    ],
)
def test_what_would_cost_a_parser_its_time_is_refused_before_it_is_parsed(more, why, monkeypatch):
    """A key of many dots is 147 bytes on the wire and 25 s of a processor."""
    data = spoiled_toml(more)
    monkeypatch.setattr(mission_package.tomllib, "loads", lambda _text: pytest.fail("it was parsed"))
    with pytest.raises(MissionError) as raised:
        from_bytes(data)
    assert why in str(raised.value)


ROOM = mission_package.MAX_PLAIN_BYTES - 2


@pytest.mark.parametrize(
    ("plain", "why"),
    [
        (b"[" + b"[]," * (ROOM // 3 - 2) + b"[]]", "more than 50000 lists and tables"),
        (b"[" * ROOM, "more than 50000 lists and tables"),
        (b'{"a":' * (ROOM // 5), "more than 50000 lists and tables"),
        (b"[" + b"1," * (ROOM // 2 - 2) + b"1]", "more than 200000 values"),
        ((b"9" * 399 + b" ") * (ROOM // 400), "not JSON"),
        ((b"1234567890" * 40) + b" " * 1000, "a number of hundreds of digits"),
    ],
    ids=["lists", "deep", "tables", "numbers", "nearly endless numbers", "an endless number"],
)
def test_what_would_be_parsed_in_one_go_is_bounded(plain, why, monkeypatch):
    """While C code parses or searches no other thread gets a turn: not even the one that sends the lease."""
    if why != "not JSON":
        monkeypatch.setattr(mission_package.json, "loads", lambda _text: pytest.fail("it was parsed"))
    with pytest.raises(MissionError, match=why):
        from_bytes(zlib.compress(plain))


def test_a_mission_toml_with_as_many_dots_as_are_allowed_is_parsed():
    with pytest.raises(MissionError, match="unknown key 'a'"):
        from_bytes(spoiled_toml("a." * 99 + "a = 1\n"))


@settings(deadline=None)
@given(st.binary(max_size=300))
def test_random_bytes_raise_nothing_but_mission_errors(data):
    only_mission_errors(data)
    only_mission_errors(zlib.compress(data))


DELIVERY = {name: data.decode() for name, data in load(MISSIONS / "delivery").files.items()}
SCALARS = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.integers(-300, 300),
    st.floats(),
    st.text(max_size=8),
    st.sampled_from(["Point", "ComplexItem", "GCSA", 1e308, -0.0, 10**400]),
)
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(st.text(max_size=8), inner, max_size=3)),
)


def paths(tree, here=()):
    yield here
    children = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, child in children:
        yield from paths(child, (*here, key))


def replaced(tree, path, value):
    if not path:
        return value
    copy = dict(tree) if isinstance(tree, dict) else list(tree)
    copy[path[0]] = replaced(copy[path[0]], path[1:], value)
    return copy


@settings(deadline=None, max_examples=400)
@given(st.data(), st.sampled_from(["delivery.plan", "zones.geojson"]))
def test_any_value_anywhere_in_plan_or_zones_raises_nothing_but_mission_errors(data, name):
    tree = json.loads(DELIVERY[name])
    path = data.draw(st.sampled_from(list(paths(tree))))
    spoiled = json.dumps(replaced(tree, path, data.draw(VALUES)))
    only_mission_errors(packed({**DELIVERY, name: spoiled}))


@settings(deadline=None, max_examples=300)
@given(st.data())
def test_any_change_of_mission_toml_raises_nothing_but_mission_errors(data):
    text = DELIVERY["mission.toml"]
    start = data.draw(st.integers(0, len(text)))
    end = data.draw(st.integers(start, min(len(text), start + 12)))
    spoiled = text[:start] + data.draw(st.text(st.characters(exclude_categories=["Cs"]), max_size=12)) + text[end:]
    only_mission_errors(packed({**DELIVERY, "mission.toml": spoiled}))


@settings(deadline=None)
@given(st.data())
def test_one_flipped_byte_of_a_package_is_refused(data):
    """zlib's own checksum and the canonical form leave no room for a changed byte."""
    whole = bytearray(load(MISSIONS / "linear").to_bytes())
    whole[data.draw(st.integers(0, len(whole) - 1))] ^= data.draw(st.integers(1, 255))
    try:
        assert from_bytes(bytes(whole)).digest == load(MISSIONS / "linear").digest
    except MissionError:
        pass


@pytest.mark.parametrize(("aircraft", "vehicle", "command"), [("copter", 2, 20), ("plane", 1, 17)])
def test_refuses_a_mission_that_stays_at_home(small, aircraft, vehicle, command):
    small.toml = f'aircraft = "{aircraft}"\n{small.toml}'
    small.plan["mission"]["vehicleType"] = vehicle
    small.items[:] = [small.item(1, command, 0.0, 0.0, 0)]
    with pytest.raises(MissionError) as caught:
        load(small.write())
    assert str(caught.value) == (
        "small.plan: nothing is flown: the aircraft stays at home (allowed: at least one item that leads away, or up)"
    )


def test_a_station_may_have_a_place_for_remote_id(small):
    small.toml = small.toml.replace("sysid = 252", "sysid = 252\nplace = [52, -4.25, 31.5]")
    assert load(small.write()).station(252) == StationEntry("B", 252, (), (52.0, -4.25, 31.5))


@pytest.mark.parametrize(
    "place", ["[52.0, 4.0]", "[91.0, 4.0, 0.0]", "[52.0, 181.0, 0.0]", "[52.0, 4.0, nan]", "[true, 4, 0]", '"here"']
)
def test_refuses_a_place_that_is_none(small, place):
    small.toml = small.toml.replace("sysid = 252", f"sysid = 252\nplace = {place}")
    assert refusal(small).startswith("mission.toml: station 2: ")
