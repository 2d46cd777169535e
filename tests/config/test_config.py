# SPDX-License-Identifier: GPL-3.0-or-later

"""Configuration files: what they give, and that every mistake is one line with file, key, value and what is allowed."""

from __future__ import annotations

import re
from dataclasses import fields
from pathlib import Path

import pytest

from mavproxy_handover.config import files
from mavproxy_handover.config.files import (
    ConfigError,
    FleetVehicle,
    find_station_config,
    find_vehicle_config,
    load_station,
    load_vehicle,
    path_argument,
)
from mavproxy_handover.config.position import PositionSettings
from mavproxy_handover.config.sample import station_sample, vehicle_sample
from mavproxy_handover.config.station_keys import STATION_FILE
from mavproxy_handover.config.vehicle_keys import OBSERVERS, VEHICLE_FILE
from mavproxy_handover.core.common.causes import Cause
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import (
    AUTOMATIC,
    StandingConsent,
    Station,
)
from mavproxy_handover.core.safety.commands import Limit
from mavproxy_handover.core.safety.energy_prior import EnergySettings
from mavproxy_handover.core.safety.route import RouteLimits
from mavproxy_handover.gate.observers import ObserverLimits
from mavproxy_handover.link.quality import LinkLimits
from mavproxy_handover.tools.key_table import Key, KeyTable
from mavproxy_handover.tools.resources import DEPLOY

try:
    import tomllib
except ModuleNotFoundError:  # Python 3.10
    import tomli as tomllib

VEHICLE = """\
[vehicle]
name = "drone-1"
sysid = 7
parent = "GCSA"
journal = "log/companion.jsonl"
guard = false
listen_only_outputs = true
allow_unsigned = true

[[station]]
name = "GCSA"
sysid = 251
links = ["udpout:127.0.0.1:14551", "udpin:0.0.0.0:14661"]
sysids = [241, 242]

[[station]]
name = "GCSB"
sysid = 252
links = ["udpout:127.0.0.1:14552"]

[limits]
heartbeat_lost_s = 3
dwell_s = 7.5

[links]
silence_s = 2
loss = 0.4
round_trip_s = 2.5
bad_signatures = 5
hold_s = 0.5

[observers]
message_hz = 2
bytes_per_s = 1000
silence_s = 60

[route]
off_route_m = 12
off_heading_deg = 45
off_hold_s = 1.5
off_clear_s = 4

[policy]
out_of_coverage = "land"

[position]
source = "box"
box = "tcp:192.0.2.30:4001"
check = "armed"
apart_m = 40
"""

STATION = """\
[station]
name = "GCSA"
sysid = 251
vehicle = 7
consent = "operator"
mission = "missions/delivery"
journal = "/var/log/GCSA.jsonl"

[ground]
listen = "udpin:127.0.0.1:15551"
key = "keys/ground.key"

[[peer]]
name = "GCSB"
sysid = 252
link = "udpout:127.0.0.1:15552"

[route]
off_route_m = 12
off_heading_deg = 45
off_hold_s = 1.5
off_clear_s = 4
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "x.toml"


def with_change(text: str, old: str, new: str) -> str:
    assert text.count(old) >= 1, f"{old!r} is not in it"
    return text.replace(old, new, 1)


# ---- what they give -----------------------------------------------------------------------------------------------


def test_everything_a_vehicle_can_say(file: Path) -> None:
    file.write_text(VEHICLE)
    loaded = load_vehicle(file)
    assert (loaded.path, loaded.name, loaded.sysid, loaded.parent) == (file, "drone-1", 7, 251)
    assert loaded.journal == file.parent / "log" / "companion.jsonl"
    assert loaded.listen_only_outputs is True
    a, b = loaded.stations
    assert (a.station, a.sysids) == (Station(251, "GCSA"), frozenset({251, 241, 242}))
    assert a.links == ("udpout:127.0.0.1:14551", "udpin:0.0.0.0:14661")
    assert (b.station, b.sysids) == (Station(252, "GCSB"), frozenset({252}))
    assert loaded.limits == Limits(
        heartbeat_lost_s=3.0, dwell_s=7.5, policies={Cause.OUT_OF_COVERAGE: "land"}, guard_required=False
    )
    links = LinkLimits(silence_s=2.0, loss=0.4, round_trip_s=2.5, bad_signatures=5.0, hold_s=0.5)
    assert (a.limits, b.limits) == (links, links)
    assert loaded.observers == ObserverLimits(message_hz=2.0, bytes_per_s=1000.0, silence_s=60.0)
    assert loaded.route == RouteLimits(off_route_m=12.0, off_heading_deg=45.0, off_hold_s=1.5, off_clear_s=4.0)
    assert loaded.position == PositionSettings("box", "tcp:192.0.2.30:4001", "armed", apart_m=40.0)


def test_the_least_a_vehicle_must_say(file: Path) -> None:
    file.write_text(
        '[vehicle]\nname = "d"\nparent = "A"\nallow_unsigned = true\n'
        '[[station]]\nname = "A"\nsysid = 2\nlinks = ["udpin:0.0.0.0:1"]\n'
    )
    loaded = load_vehicle(file)
    assert (loaded.sysid, loaded.journal.name, loaded.listen_only_outputs) == (1, "handover.jsonl", False)
    assert loaded.limits == Limits()
    assert loaded.limits.guard_required is True
    assert [entry.limits for entry in loaded.stations] == [LinkLimits()]
    assert loaded.observers == ObserverLimits()
    assert loaded.route == RouteLimits(off_route_m=30.0, off_heading_deg=60.0, off_hold_s=3.0, off_clear_s=3.0)
    assert (loaded.position.source, loaded.position.box, loaded.position.check) == ("autopilot", "", "always")


def test_everything_a_station_can_say(file: Path) -> None:
    file.write_text(STATION)
    loaded = load_station(file)
    assert (loaded.path, loaded.station) == (file, Station(251, "GCSA"))
    assert loaded.vehicles == (FleetVehicle(7, mission=file.parent / "missions" / "delivery"),)
    assert loaded.automatic == frozenset({"forced"})
    assert loaded.journal == Path("/var/log/GCSA.jsonl")
    assert loaded.ground == "udpin:127.0.0.1:15551"
    (peer,) = loaded.peers
    assert (peer.station, peer.link) == (Station(252, "GCSB"), "udpout:127.0.0.1:15552")
    assert loaded.route == RouteLimits(off_route_m=12.0, off_heading_deg=45.0, off_hold_s=1.5, off_clear_s=4.0)


def test_the_least_a_station_must_say(file: Path) -> None:
    file.write_text('[station]\nname = "A"\nsysid = 251\n')
    loaded = load_station(file)
    assert (loaded.vehicles, loaded.automatic) == ((FleetVehicle(1),), frozenset(AUTOMATIC))
    assert (loaded.journal, loaded.ground, loaded.peers) == (file.parent / "A.jsonl", None, ())
    assert loaded.route == RouteLimits()


@pytest.mark.parametrize(
    ("lines", "automatic"),
    [
        ("", {"zone", "link", "forced"}),
        ('consent = "operator"', {"forced"}),
        ('consent = "operator"\nforced = "automatic"', {"forced"}),
        ('consent = "operator"\nforced = "ask"', set()),
        ('forced = "ask"', {"zone", "link"}),
        ('consent = ["zone", "request"]', {"zone", "request", "forced"}),
        ('consent = ["zone", "forced"]\nforced = "ask"', {"zone"}),
        ("consent = []", {"forced"}),
    ],
)
def test_a_forced_handover_has_a_key_of_its_own(file: Path, lines: str, automatic: set[str]) -> None:
    file.write_text(f'[station]\nname = "A"\nsysid = 251\n{lines}\n')
    assert load_station(file).automatic == automatic


@pytest.mark.parametrize(
    ("lines", "consent"),
    [
        ("module = false", None),
        ('module = false\nconsent = "automatic"', StandingConsent.AUTOMATIC),
        ('module = false\nconsent = "refuse"', StandingConsent.REFUSE),
    ],
)
def test_the_consent_of_a_station_that_cannot_be_asked(file: Path, lines: str, consent: StandingConsent | None) -> None:
    station = f'[[station]]\nname = "A"\nsysid = 251\nlinks = ["udpin:0.0.0.0:1"]\n{lines}\n'
    file.write_text(f'[vehicle]\nname = "d"\nparent = "A"\nallow_unsigned = true\n{station}')
    assert load_vehicle(file).stations[0].station == Station(251, "A", True, consent)


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        (
            'consent = "automatic"',
            "[station 1] consent: goes with module = false; with our module the station's own file has its consent",
        ),
        ('module = false\nconsent = "operator"', "[station 1] consent: 'operator' must be one of automatic, refuse"),
        ("module = false\nconsent = true", "[station 1] consent: True must be a text"),
    ],
)
def test_a_mistake_about_it_is_one_line(file: Path, lines: str, expected: str) -> None:
    station = f'[[station]]\nname = "A"\nsysid = 251\nlinks = ["udpin:0.0.0.0:1"]\n{lines}\n'
    text = f'[vehicle]\nname = "d"\nparent = "A"\nallow_unsigned = true\n{station}'
    assert the_line(file, text, load_vehicle) == expected


def test_the_samples_that_ship_are_sound(file: Path) -> None:
    file.write_text(vehicle_sample())
    for path in (file, DEPLOY / "demo" / "handover.toml"):
        vehicle = load_vehicle(path)
        assert {entry.station.sysid: entry.station.name for entry in vehicle.stations} == {251: "GCSA", 252: "GCSB"}
    file.write_text(station_sample())
    for path in (file, DEPLOY / "demo" / "GCSA.toml", DEPLOY / "demo" / "GCSB.toml"):
        assert [vehicle.sysid for vehicle in load_station(path).vehicles] == [1]


def test_the_numbers_of_energy_are_read_and_may_be_left_out(file: Path) -> None:
    file.write_text(VEHICLE + '[energy]\nbattery_wh = 41\ncells = 3\nhover_w = 354.5\nstart = "warn"\n')
    assert load_vehicle(file).energy == EnergySettings(battery_wh=41.0, cells=3.0, hover_w=354.5, start="warn")
    file.write_text(VEHICLE)
    assert load_vehicle(file).energy == EnergySettings()


@pytest.mark.parametrize("word", ["auto", "always", "never"])
def test_who_gets_the_result_of_the_standard_is_said_station_by_station(file: Path, word: str) -> None:
    file.write_text(VEHICLE.replace("sysids = [241, 242]", f'not_in_control = "{word}"'))
    assert [station.not_in_control for station in load_vehicle(file).stations] == [word, "auto"]


def test_what_becomes_of_commands_is_read_and_may_be_left_out(file: Path) -> None:
    file.write_text(VEHICLE + '[commands]\nenergy = "off"\nfence = "refuse"\ncoverage = "warn"\n')
    assert load_vehicle(file).commands == {Limit.ENERGY: "off", Limit.COVERAGE: "warn"}
    file.write_text(VEHICLE)
    assert load_vehicle(file).commands == {}


def uncommented(text: str) -> str:
    """Every key in force, without the second tables of a kind."""
    lines = [line[2:] if re.match(r"# (\[\[(?:vehicle|onboard)|\w+ = )", line) else line for line in text.splitlines()]
    return "\n".join(lines) + "\n"


def test_the_vehicles_sample_with_every_key_in_force_is_sound_and_has_the_defaults(file: Path) -> None:
    """What is written as a comment is a default, or an example inside its range."""
    text = uncommented(vehicle_sample())
    file.write_text(text.replace("module = true ", "module = false "))  # consent goes with that
    loaded = load_vehicle(file)
    assert loaded.limits == Limits()
    assert {entry.limits for entry in loaded.stations} == {LinkLimits()}
    assert loaded.observers == ObserverLimits()
    assert loaded.route == RouteLimits()
    assert loaded.commands == {}
    assert loaded.position == PositionSettings(box="tcp:192.0.2.30:4001")
    assert loaded.energy.battery_wh == 41.0


def test_the_stations_sample_with_every_key_in_force_is_sound_and_has_the_defaults(file: Path) -> None:
    lines = uncommented(station_sample()).splitlines()
    own = ("vehicle = ", "mission = ", "key = ")
    begin = lines.index("[[vehicle]]")
    file.write_text("\n".join([line for line in lines[:begin] if not line.startswith(own)] + lines[begin:]))
    loaded = load_station(file)
    assert [vehicle.name for vehicle in loaded.vehicles] == ["drone-1"]
    assert loaded.automatic == frozenset(AUTOMATIC)
    assert loaded.route == RouteLimits()


@pytest.mark.parametrize(
    ("text", "tables"), [(vehicle_sample(), VEHICLE_FILE), (station_sample(), STATION_FILE)], ids=["vehicle", "station"]
)
def test_a_sample_has_every_key_of_every_table_once_and_says_what_it_means(
    text: str, tables: tuple[KeyTable, ...]
) -> None:
    found = tomllib.loads(uncommented(text))
    assert list(found) == [table.name for table in tables]
    for table in tables:
        first = found[table.name][0] if table.many else found[table.name]
        assert list(first) == list(table.names)
        assert [key.name for key in table.keys if not key.says] == []


def test_a_sample_for_an_installation_has_its_files_in_that_folder(file: Path) -> None:
    file.write_text(vehicle_sample("/var/lib/x/"))
    loaded = load_vehicle(file)
    assert (loaded.journal, loaded.state) == (Path("/var/lib/x/handover.jsonl"), Path("/var/lib/x/state"))
    file.write_text(station_sample("/var/lib/x/"))
    assert load_station(file).journal == Path("/var/lib/x/GCSA.jsonl")


# ---- mistakes of the vehicle's file -------------------------------------------------------------------------------

PROGRAM = '[[onboard]]\nname = "x"\nlink = "udpin:127.0.0.1:14600"\ncomponent = 25\n'


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("127.0.0.1", "0.0.0.0", "[onboard 1] link: 'udpin:0.0.0.0:14600' leaves this machine; use 127.0.0.1, or set"),
        ("udpin:127.0.0.1:14600", "tcp:10.0.0.7:5760", "[onboard 1] link: 'tcp:10.0.0.7:5760' leaves this machine"),
        ("25", "191", "[onboard 1] component: 191 is the companion's component; choose another, such as 25"),
        ("25", "1", "[onboard 1] component: 1 must be 2 to 255"),
        ("25", '25\nrights = ["fly"]', "[onboard 1] rights: 'fly' must be one of sensors, payload, guided"),
        ("25", '25\nrights = ["sensors"]', "[onboard 1] sensors: is missing: rights has 'sensors'. Name the messages"),
        ("25", '25\nsensors = ["ODOMETRY"]', "[onboard 1] sensors: names messages, but rights lacks 'sensors'"),
        ("25", '25\nrights = ["sensors"]\nsensors = ["HEARTBEAT"]', "[onboard 1] sensors: 'HEARTBEAT' must be one of"),
        ('"x"', '"no"', "[onboard 1] name: 'no' is a word of 'handover delegate'; choose another"),
        ('"x"', '"a b"', "[onboard 1] name: 'a b' must be 1 to 20 printable ASCII characters without a space"),
        ('"x"', '"GCSA"', "[[onboard]] name 'GCSA' is also a station's; choose another"),
        (PROGRAM, PROGRAM * 2, "[onboard 2] name: 'x' is given twice; each program needs its own"),
    ],
)
def test_a_mistake_in_an_onboard_program_is_one_line(file: Path, old: str, new: str, expected: str) -> None:
    assert PROGRAM.count(old) == 1
    head = VEHICLE[: VEHICLE.index("[limits]")]
    assert the_line(file, head + PROGRAM.replace(old, new), load_vehicle).startswith(expected)


def test_an_onboard_program_of_this_machine_or_by_an_explicit_word_is_loaded(file: Path) -> None:
    head = VEHICLE[: VEHICLE.index("[limits]")]
    file.write_text(head + PROGRAM)
    (program,) = load_vehicle(file).onboard
    assert (program.name, program.rights.component, program.rights.rights) == ("x", 25, frozenset())
    file.write_text(head + PROGRAM.replace("127.0.0.1", "0.0.0.0") + "remote = true\n")
    assert load_vehicle(file).onboard[0].remote


VEHICLE_MISTAKES: dict[str, tuple[str, str, str]] = {
    "a source that nobody knows": (
        'source = "box"',
        'source = "gps"',
        "[position] source: 'gps' must be one of autopilot, box",
    ),
    "a box that is nowhere": (
        'box = "tcp:192.0.2.30:4001"\n',
        "",
        "[position] box: is missing: where is the box? It must be tcp:HOST:PORT",
    ),
    "a box that is no TCP server": (
        "tcp:192.0.2.30:4001",
        "udpin:0.0.0.0:4001",
        "[position] box: 'udpin:0.0.0.0:4001' must be tcp:HOST:PORT: the box is a TCP server",
    ),
    "a layout that nobody knows": (
        'check = "armed"',
        'layout = "theses"',
        "[position] layout: 'theses' must be one of thesis, full, or a layout's file, which ends with .toml",
    ),
    "a check that is never made": (
        'check = "armed"',
        'check = "never"',
        "[position] check: 'never' must be one of always, armed",
    ),
    "a limit that is none": ("apart_m = 40", "apart_m = 1001", "[position] apart_m: 1001 must be 2 to 1000"),
    "no name": ('name = "drone-1"\n', "", "[vehicle] name: is missing; it must be a text"),
    "name of the wrong kind": ('"drone-1"', "5", "[vehicle] name: 5 must be a text"),
    "name too long": ('"drone-1"', '"' + "x" * 21 + '"', "[vehicle] name: 'xxxxxxxxxxxxxxxxxxxxx' must be 1 to 20 "),
    "name empty": ('"drone-1"', '""', "[vehicle] name: '' must be 1 to 20 printable ASCII characters"),
    "name not ASCII": ('"drone-1"', '"Drohne Köln"', "[vehicle] name: 'Drohne Köln' must be 1 to 20 printable ASCII"),
    "name with a line break": ('"drone-1"', '"a\\nb"', "[vehicle] name: 'a\\nb' must be 1 to 20 printable ASCII"),
    "sysid 0": ("sysid = 7", "sysid = 0", "[vehicle] sysid: 0 must be a MAVLink system id, 1 to 255"),
    "sysid 256": ("sysid = 7", "sysid = 256", "[vehicle] sysid: 256 must be a MAVLink system id, 1 to 255"),
    "sysid true": ("sysid = 7", "sysid = true", "[vehicle] sysid: True must be a whole number"),
    "sysid a fraction": ("sysid = 7", "sysid = 7.0", "[vehicle] sysid: 7.0 must be a whole number"),
    "sysid of a station": ("sysid = 7", "sysid = 251", "[[station]] sysid 251 of GCSA is also the vehicle's"),
    "no parent": ('parent = "GCSA"\n', "", "[vehicle] parent: is missing; it must be a text"),
    "unknown parent": (
        'parent = "GCSA"',
        'parent = "GCSX"',
        "[vehicle] parent: 'GCSX' must be one of the stations: GCSA, GCSB",
    ),
    "guard a number": ("guard = false", "guard = 0", "[vehicle] guard: 0 must be true or false"),
    "misspelt key": ("guard = false", "gaurd = false", "[vehicle] gaurd: unknown key; did you mean 'guard'?"),
    "unknown key": (
        "guard = false",
        "zzz = 1",
        "[vehicle] zzz: unknown key; allowed are: name, sysid, parent, journal, guard, listen_only_outputs",
    ),
    "key with a line break": ("guard = false", '"a\\nb" = 1', "[vehicle] a b: unknown key; allowed are: name, "),
    "misspelt table": ("[limits]", "[limit]", "unknown table [limit]; did you mean [limits]?"),
    "unknown table": (
        "[limits]",
        "[zzz]",
        "unknown table [zzz]; allowed are: vehicle, station, limits, policy",
    ),
    "one station in single brackets": (
        VEHICLE[VEHICLE.index("[[station]]") : VEHICLE.index("[limits]")],
        '[station]\nname = "GCSA"\n',
        "[station] must be written [[station]], once for each",
    ),
    "no station": (
        VEHICLE[VEHICLE.index("[[station]]") : VEHICLE.index("[limits]")],
        "",
        "[station] is missing",
    ),
    "two stations of one name": ('name = "GCSB"', 'name = "GCSA"', "[[station]] name 'GCSA' is given twice"),
    "two stations of one sysid": (
        "sysid = 252",
        "sysid = 251",
        "[[station]] sysid 251 of GCSB is also GCSA's",
    ),
    "a station with another's tracker": (
        "sysid = 252",
        "sysid = 241",
        "[[station]] sysid 241 of GCSB is also GCSA's",
    ),
    "two stations on one link": ("14552", "14551", "[[station]] link udpout:127.0.0.1:14551 is given twice"),
    "an energy key that is none": (
        "[policy]",
        "[energy]\nhover = 354\n[policy]",
        "[energy] hover: unknown key; did you mean 'hover_w'?",
    ),
    "energy of the wrong kind": (
        "[policy]",
        '[energy]\nhover_w = "354"\n[policy]',
        "[energy] hover_w: '354' must be a number",
    ),
    "energy out of its range": (
        "[policy]",
        "[energy]\nhover_w = 9\n[policy]",
        "[energy] hover_w: 9 must be 10 to 200000",
    ),
    "energy that is no number": (
        "[policy]",
        "[energy]\nhover_w = nan\n[policy]",
        "[energy] hover_w: nan must be 10 to 200000",
    ),
    "half a cell": ("[policy]", "[energy]\ncells = 3.5\n[policy]", "[energy] cells: 3.5 must be a whole number"),
    "a limit of commands that is none": (
        "[policy]",
        '[commands]\ncover = "off"\n[policy]',
        "[commands] cover: unknown key; did you mean 'coverage'?",
    ),
    "a policy of commands that is none": (
        "[policy]",
        '[commands]\nfence = "return"\n[policy]',
        "[commands] fence: 'return' must be one of refuse, warn, off",
    ),
    "a policy of commands that is no word": (
        "[policy]",
        "[commands]\nfence = true\n[policy]",
        "[commands] fence: True must be a text",
    ),
    "a start that is none": (
        "[policy]",
        '[energy]\nstart = "never"\n[policy]',
        "[energy] start: 'never' must be one of refuse, warn, off",
    ),
    "a payload without a mass": (
        "[policy]",
        "[energy]\npayload_kg = 1\n[policy]",
        "[energy] payload_kg: 1 says nothing without mass_kg, the mass at take-off with it",
    ),
    "energy that is no table": ("[vehicle]", "energy = 3\n[vehicle]", "[energy] must be a table"),
    "no links": (
        'links = ["udpout:127.0.0.1:14552"]',
        "",
        "[station 2] links: is missing; it must be a list",
    ),
    "empty links": ('["udpout:127.0.0.1:14552"]', "[]", "[station 2] links: must name at least one link"),
    "links not a list": (
        '["udpout:127.0.0.1:14552"]',
        '"udpout:127.0.0.1:14552"',
        "[station 2] links: 'udpout:127.0.0.1:14552' must be a list",
    ),
    "link of another kind": (
        "udpout:127.0.0.1:14552",
        "udp:127.0.0.1:14552",
        "[station 2] links: 'udp:127.0.0.1:14552' must be one of udpin:HOST:PORT, udpout:HOST:PORT",
    ),
    "link without a port": ("udpout:127.0.0.1:14552", "udpout:127.0.0.1", "must be one of udpin:HOST:PORT, udpout:"),
    "link without a host": ("udpout:127.0.0.1:14552", "udpout::14552", "must be one of udpin:HOST:PORT, udpout:"),
    "link with a line break": (
        "udpout:127.0.0.1:14552",
        "udpout:a\\nb:14552",
        "[station 2] links: 'udpout:a\\nb:14552'",
    ),
    "port 0": (":14552", ":0", "[station 2] links: 'udpout:127.0.0.1:0': port must be 1 to 65535"),
    "port 65536": (":14552", ":65536", "[station 2] links: 'udpout:127.0.0.1:65536': port must be 1 to 65535"),
    "port a word": (":14552", ":mavlink", "[station 2] links: 'udpout:127.0.0.1:mavlink': port must be 1 to 65535"),
    "port of thousands of digits": (":14552", ":" + "1" * 5000, ": port must be 1 to 65535"),
    "link a number": ('"udpout:127.0.0.1:14552"', "14552", "[station 2] links: 14552 must be one of udpin:"),
    "no such word about a result": (
        "sysids = [241, 242]",
        'not_in_control = "sometimes"',
        "[station 1] not_in_control: 'sometimes' must be one of auto, always, never",
    ),
    "a result that is no word": (
        "sysids = [241, 242]",
        "not_in_control = true",
        "[station 1] not_in_control: True must be a text",
    ),
    "extra sysid 0": ("[241, 242]", "[241, 0]", "[station 1] sysids: 0 must be a MAVLink system id, 1 to 255"),
    "extra sysid true": ("[241, 242]", "[true]", "[station 1] sysids: True must be a MAVLink system id, 1 to 255"),
    "limit below its range": ("dwell_s = 7.5", "dwell_s = -1", "[limits] dwell_s: -1 must be 0 to 600"),
    "limit above its range": (
        "heartbeat_lost_s = 3",
        "heartbeat_lost_s = 61",
        "[limits] heartbeat_lost_s: 61 must be 1.5 to 60",
    ),
    "deaf and back at the same share": (
        "dwell_s = 7.5",
        "deaf_share = 0.25\ndeaf_back_share = 0.22",
        "[limits] deaf_back_share = 0.22 must be above deaf_share = 0.25",
    ),
    "asked less often than it must answer": (
        "dwell_s = 7.5",
        "connect_interval_s = 10",
        "[limits] connect_interval_s = 10 must be below deaf_lost_s = 10: a commander that answers every question "
        "would be lost before the next one",
    ),
    "limit not a number": ("dwell_s = 7.5", "dwell_s = nan", "[limits] dwell_s: nan must be 0 to 600"),
    "limit without an end": ("dwell_s = 7.5", "dwell_s = inf", "[limits] dwell_s: inf must be 0 to 600"),
    "limit of hundreds of digits": (
        "dwell_s = 7.5",
        "dwell_s = 1" + "0" * 400,
        "[limits] dwell_s: inf must be 0 to 600",
    ),
    "limit a text": ("dwell_s = 7.5", 'dwell_s = "7"', "[limits] dwell_s: '7' must be a number"),
    "misspelt limit": ("dwell_s", "dwel_s", "[limits] dwel_s: unknown key; did you mean 'dwell_s'?"),
    "guard as a limit": ("dwell_s = 7.5", "guard_required = false", "[limits] guard_required: unknown key"),
    "link limit below its range": (
        "loss = 0.4",
        "loss = 0",
        "[links] loss: 0 must be 0.01 to 1",
    ),
    "link limit above its range": (
        "silence_s = 2\n",
        "silence_s = 61\n",
        "[links] silence_s: 61 must be 1.5 to 60",
    ),
    "link limit a text": (
        "round_trip_s = 2.5",
        'round_trip_s = "1"',
        "[links] round_trip_s: '1' must be a number",
    ),
    "misspelt link limit": (
        "round_trip_s =",
        "round_trip =",
        "[links] round_trip: unknown key; did you mean 'round_trip_s'?",
    ),
    "unknown link limit": (
        "hold_s = 0.5",
        "zzz = 1",
        "[links] zzz: unknown key; allowed are: silence_s, loss, round_trip_s, bad_signatures, hold_s",
    ),
    "links in double brackets": ("[links]", "[[links]]", "[links] must be a table"),
    "observer limit above its range": (
        "message_hz = 2",
        "message_hz = 101",
        "[observers] message_hz: 101 must be 0.1 to 100",
    ),
    "misspelt observer limit": (
        "bytes_per_s =",
        "bytes_per_sec =",
        "[observers] bytes_per_sec: unknown key; did you mean 'bytes_per_s'?",
    ),
    "misspelt table of observers": (
        "[observers]",
        "[observer]",
        "unknown table [observer]; did you mean [observers]?",
    ),
    "a cause that there is not": (
        'out_of_coverage = "land"',
        'out_of_covrage = "land"',
        "[policy] out_of_covrage: unknown key; did you mean 'out_of_coverage'?",
    ),
    "what cannot be switched off": (
        'out_of_coverage = "land"',
        'out_of_coverage = "off"',
        "[policy] out_of_coverage: 'off' must be one of return, land, warn",
    ),
    "a hold-off out of range": (
        "[observers]",
        "[hold_off]\nguard_lost = -1.0\n[observers]",
        "[hold_off] guard_lost: -1 must be 0 to 600",
    ),
    "unknown policy": (
        'out_of_coverage = "land"',
        'out_of_coverage = "hover"',
        "[policy] out_of_coverage: 'hover' must be one of return, land, warn",
    ),
}


def the_line(file: Path, text: str, load: object) -> str:
    """The one line that a text is refused with, without the file at its head."""
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        load(file)  # type: ignore[operator]
    line = str(caught.value)
    assert "\n" not in line
    assert line.startswith(f"{file}: ")
    return line.removeprefix(f"{file}: ")


@pytest.mark.parametrize("mistake", list(VEHICLE_MISTAKES))
def test_a_mistake_in_a_vehicles_file_is_one_line(file: Path, mistake: str) -> None:
    old, new, expected = VEHICLE_MISTAKES[mistake]
    assert expected in the_line(file, with_change(VEHICLE, old, new), load_vehicle)


def test_limits_that_are_no_table(file: Path) -> None:
    text = "limits = 5\n" + VEHICLE[: VEHICLE.index("[limits]")]
    assert the_line(file, text, load_vehicle) == "[limits] must be a table"


def test_stations_that_are_no_tables(file: Path) -> None:
    text = "station = [5]\n" + VEHICLE[: VEHICLE.index("[[station]]")]
    assert the_line(file, text, load_vehicle) == "[station 1] must be a table"


#: what a number needs beside it at the end of its range
BESIDE = {
    "connect_interval_s": "deaf_lost_s = 120\n",
    "payload_kg": "mass_kg = 1000\n",
    "onboard.component": 'name = "x"\nlink = "/dev/ttyS9"\n',
    "onboard.bytes_per_s": 'name = "x"\nlink = "/dev/ttyS9"\ncomponent = 25\n',
    "onboard.landing_m": 'name = "x"\nlink = "/dev/ttyS9"\ncomponent = 25\n',
}
NUMBERS = [
    pytest.param(table, key, id=f"{table.name}.{key.name}")
    for table in VEHICLE_FILE
    for key in table.keys
    if key.limits is not None and table.name not in ("vehicle", "station")
]


@pytest.mark.parametrize(("table", "key"), NUMBERS)
def test_every_number_has_a_range_that_is_kept_and_holds_its_default(file: Path, table: KeyTable, key: Key) -> None:
    assert key.limits is not None
    low, high = key.limits
    assert key.default is None or low <= key.default <= high
    head = VEHICLE[: VEHICLE.index("[limits]")]
    beside = BESIDE.get(f"{table.name}.{key.name}" if table.many else key.name, "")
    for inside in (low, high):
        file.write_text(f"{head}{table.header}\n{key.name} = {inside}\n{beside}")
        load_vehicle(file)  # what is in range is none that the limits' own checks refuse
    for outside in (low - 1, high + 1):
        line = the_line(file, f"{head}{table.header}\n{key.name} = {outside}\n{beside}", load_vehicle)
        where = f"{table.name} 1" if table.many else table.name
        assert line == f"[{where}] {key.name}: {outside:g} must be {low:.12g} to {high:.12g}"


#: limits that no configuration changes
FIXED = {"retry_growth", "reserve_timeout_s", "exit_soon_s"}


@pytest.mark.parametrize("name", sorted(FIXED))
def test_a_limit_that_no_configuration_changes_is_refused_by_name(file: Path, name: str) -> None:
    head = VEHICLE[: VEHICLE.index("[limits]")]
    assert the_line(file, f"{head}[limits]\n{name} = 2\n", load_vehicle).startswith(f"[limits] {name}: unknown key")


@pytest.mark.parametrize(
    ("name", "limits", "others"),
    [
        ("limits", Limits, {"policies", "hold_off_s", "clear_s", "guard_required", *FIXED}),
        ("links", LinkLimits, set()),
        ("observers", ObserverLimits, set()),
        ("energy", EnergySettings, set()),
        ("route", RouteLimits, set()),
        ("position", PositionSettings, {"layout_file", "layout_text"}),
    ],
)
def test_every_limit_of_the_rules_is_a_key(name: str, limits: type, others: set[str]) -> None:
    (table,) = [table for table in VEHICLE_FILE if table.name == name]
    assert {entry.name for entry in fields(limits)} == set(table.names) | others


def test_no_allowance_of_an_observer_is_below_the_longest_frame() -> None:
    """MAVLink 2: 10 bytes of header, 255 of payload, 2 of CRC, 13 of signature."""
    assert (OBSERVERS["bytes_per_s"].limits or (0,))[0] >= 280


@pytest.mark.parametrize("misspelt", ["keys", "Key", "kye"])
def test_a_misspelt_key_is_named_and_not_only_missed(file: Path, misspelt: str) -> None:
    """Signing is asked for and the file of the key is there, under a name that nobody reads."""
    text = with_change(VEHICLE, "allow_unsigned = true\n", "")
    text = with_change(text, 'name = "GCSA"\n', f'name = "GCSA"\n{misspelt} = "keys/GCSA.key"\n')
    assert the_line(file, text, load_vehicle) == f"[station 1] {misspelt}: unknown key; did you mean 'key'?"


@pytest.mark.parametrize("foreign", ["signature", "passphrase"])
def test_a_key_of_another_name_altogether_is_named_first_too(file: Path, foreign: str) -> None:
    text = with_change(VEHICLE, "allow_unsigned = true\n", "")
    text = with_change(text, 'name = "GCSA"\n', f'name = "GCSA"\n{foreign} = "x"\n')
    allowed = (
        "name, sysid, links, key, module, consent, sysids, not_in_control, components, operator_id, companion_heartbeat"
    )
    assert the_line(file, text, load_vehicle) == f"[station 1] {foreign}: unknown key; allowed are: {allowed}"


def test_a_key_that_is_missing_and_misspelt_nowhere(file: Path) -> None:
    text = with_change(VEHICLE, "allow_unsigned = true\n", "")
    assert the_line(file, text, load_vehicle) == (
        "[station 1] key: is missing: any program could speak as GCSA; 'handover keys make GCSA' makes one; "
        "allow_unsigned = true in [vehicle] does without"
    )


def test_a_required_key_that_is_misspelt_is_named_and_not_only_missed(file: Path) -> None:
    line = the_line(file, with_change(VEHICLE, 'links = ["udpout:127.0.0.1:14552"]', 'link = ["x"]'), load_vehicle)
    assert line == "[station 2] link: unknown key; did you mean 'links'?"


# ---- mistakes of the station's file -------------------------------------------------------------------------------

STATION_MISTAKES: dict[str, tuple[str, str, str]] = {
    "a route that is never off": (
        "off_route_m = 12",
        "off_route_m = 1001",
        "[route] off_route_m: 1001 must be 5 to 1000",
    ),
    "misspelt key of the route": (
        "off_heading_deg",
        "off_heading",
        "[route] off_heading: unknown key; did you mean 'off_heading_deg'?",
    ),
    "no sysid": ("sysid = 251\n", "", "[station] sysid: is missing; it must be a whole number"),
    "the vehicle's sysid": ("vehicle = 7", "vehicle = 251", "[station] vehicle: 251 is the station's own sysid"),
    "vehicle 0": ("vehicle = 7", "vehicle = 0", "[station] vehicle: 0 must be a MAVLink system id, 1 to 255"),
    "consent": (
        '"operator"',
        '"maybe"',
        "[station] consent: 'maybe' must be one of automatic, operator",
    ),
    "forced": (
        'consent = "operator"\n',
        'forced = "operator"\n',
        "[station] forced: 'operator' must be one of automatic, ask",
    ),
    "mission a number": ('"missions/delivery"', "5", "[station] mission: 5 must be a text"),
    "misspelt key": ("consent", "consnet", "[station] consnet: unknown key; did you mean 'consent'?"),
    "misspelt table": ("[ground]", "[grund]", "unknown table [grund]; did you mean [ground]?"),
    "a station in double brackets": ("[station]", "[[station]]", "[station] must be a table"),
    "ground calls": (
        "udpin:127.0.0.1:15551",
        "udpout:127.0.0.1:15551",
        "[ground] listen: 'udpout:127.0.0.1:15551' must be udpin:HOST:PORT",
    ),
    "ground without listen": (
        'listen = "udpin:127.0.0.1:15551"',
        "",
        "[ground] listen: is missing; it must be a text",
    ),
    "ground without a key": (
        'key = "keys/ground.key"\n',
        "",
        "[ground] key: is missing: any program could speak as another station; 'handover keys make ground' makes one, "
        "the same for all; allow_unsigned = true does without",
    ),
    "ground open by half a word": (
        'key = "keys/ground.key"\n',
        'allow_unsigned = "yes"\n',
        "[ground] allow_unsigned: 'yes' must be true or false",
    ),
    "peer listens": (
        "udpout:127.0.0.1:15552",
        "udpin:127.0.0.1:15552",
        "[peer 1] link: 'udpin:127.0.0.1:15552' must be udpout:HOST:PORT",
    ),
    "peer without ground": (
        '[ground]\nlisten = "udpin:127.0.0.1:15551"\nkey = "keys/ground.key"\n',
        "",
        "[ground] is missing; [[peer]] needs a place to listen",
    ),
    "a peer with our sysid": ("sysid = 252", "sysid = 251", "[[peer]] sysid 251 is given twice"),
    "a peer with the vehicle's sysid": ("sysid = 252", "sysid = 7", "[[peer]] sysid 7 is given twice"),
    "peer in single brackets": ("[[peer]]", "[peer]", "[peer] must be written [[peer]], once for each"),
    "misspelt link of a peer": ("link = ", "links = ", "[peer 1] links: unknown key; did you mean 'link'?"),
    "peer without a link": (
        'link = "udpout:127.0.0.1:15552"\n',
        "",
        "[peer 1] link: is missing; it must be a text",
    ),
}


@pytest.mark.parametrize("mistake", list(STATION_MISTAKES))
def test_a_mistake_in_a_stations_file_is_one_line(file: Path, mistake: str) -> None:
    old, new, expected = STATION_MISTAKES[mistake]
    assert expected in the_line(file, with_change(STATION, old, new), load_station)


# ---- a station for several vehicles -------------------------------------------------------------------------------

FLEET = """\
[station]
name = "GCSA"
sysid = 251
consent = "operator"

[[vehicle]]
name = "drone-1"
sysid = 1
links = ["udpin:0.0.0.0:14550", "/dev/ttyUSB0,57600"]
key = "keys/GCSA-drone-1.key"
mission = "missions/delivery"

[[vehicle]]
name = "drone-2"
sysid = 2
links = ["udpin:0.0.0.0:14560"]
allow_unsigned = true

[ground]
listen = "udpin:127.0.0.1:15551"
key = "keys/ground.key"

[[peer]]
name = "GCSB"
sysid = 252
link = "udpout:127.0.0.1:15552"
"""


def test_each_vehicle_of_a_station_has_its_own_links_key_and_mission(file: Path) -> None:
    file.write_text(FLEET)
    loaded = load_station(file)
    assert loaded.vehicles == (
        FleetVehicle(
            1,
            "drone-1",
            ("udpin:0.0.0.0:14550", "/dev/ttyUSB0,57600"),
            file.parent / "keys" / "GCSA-drone-1.key",
            file.parent / "missions" / "delivery",
        ),
        FleetVehicle(2, "drone-2", ("udpin:0.0.0.0:14560",)),
    )
    assert [vehicle.called for vehicle in loaded.vehicles] == ["drone-1", "drone-2"]
    assert (loaded.automatic, loaded.ground) == (frozenset({"forced"}), "udpin:127.0.0.1:15551")


def test_a_vehicle_without_a_table_is_called_by_its_number(file: Path) -> None:
    file.write_text(STATION)
    assert [vehicle.called for vehicle in load_station(file).vehicles] == ["vehicle 7"]


FLEET_MISTAKES: dict[str, tuple[str, str, str]] = {
    "two vehicles of one name": ('"drone-2"', '"drone-1"', "[[vehicle]] name 'drone-1' is given twice"),
    "two vehicles of one sysid": ("sysid = 2\n", "sysid = 1\n", "[[vehicle]] sysid 1 is given twice"),
    "two vehicles on one link": ("14560", "14550", "[[vehicle]] link udpin:0.0.0.0:14550 is given twice"),
    "one vehicle with a link twice": (
        '"/dev/ttyUSB0,57600"',
        '"udpin:0.0.0.0:14550"',
        "[[vehicle]] link udpin:0.0.0.0:14550 is given twice",
    ),
    "two vehicles with one key": (
        "allow_unsigned = true",
        'key = "keys/GCSA-drone-1.key"',
        "keys/GCSA-drone-1.key is given twice",
    ),
    "no name": ('name = "drone-2"\n', "", "[vehicle 2] name: is missing; it must be a text"),
    "a name that cannot be typed": (
        '"drone-2"',
        '"drone 2"',
        "[vehicle 2] name: 'drone 2' must be letters, digits, '.', '_' or '-', one letter at least",
    ),
    "a name that is a number": (
        '"drone-2"',
        '"1"',
        "[vehicle 2] name: '1' must be letters, digits, '.', '_' or '-', one letter at least",
    ),
    "a name that ends a label": (
        '"drone-2"',
        '"drone-1/2"',
        "[vehicle 2] name: 'drone-1/2' must be letters, digits, '.', '_' or '-', one letter at least",
    ),
    "no sysid": ("sysid = 2\n", "", "[vehicle 2] sysid: is missing; it must be a whole number"),
    "sysid 0": ("sysid = 2\n", "sysid = 0\n", "[vehicle 2] sysid: 0 must be a MAVLink system id, 1 to 255"),
    "the station's sysid": ("sysid = 2\n", "sysid = 251\n", "[vehicle 2] sysid: 251 is the station's own sysid"),
    "a peer's sysid": ("sysid = 2\n", "sysid = 252\n", "[[peer]] sysid 252 is given twice"),
    "no links": ('links = ["udpin:0.0.0.0:14560"]\n', "", "[vehicle 2] links: is missing; it must be a list"),
    "empty links": ('["udpin:0.0.0.0:14560"]', "[]", "[vehicle 2] links: must name at least one link"),
    "a link that is none": ("udpin:0.0.0.0:14560", "udp:14560", "[vehicle 2] links: 'udp:14560' must be one of udpin:"),
    "a link that is a number": ('["udpin:0.0.0.0:14560"]', "[14560]", "[vehicle 2] links: 14560 must be one of udpin:"),
    "no key": (
        "allow_unsigned = true\n",
        "",
        "[vehicle 2] key: is missing: any program could speak as drone-2; 'handover keys make GCSA-drone-2' makes one, "
        "for this station and this vehicle alone; allow_unsigned = true does without",
    ),
    "unsigned by half a word": (
        "allow_unsigned = true",
        'allow_unsigned = "yes"',
        "[vehicle 2] allow_unsigned: 'yes' must be true or false",
    ),
    "a mission that is a number": ('"missions/delivery"', "5", "[vehicle 1] mission: 5 must be a text"),
    "misspelt key": ("links = [", "link = [", "[vehicle 1] link: unknown key; did you mean 'links'?"),
    "the station's key beside": (
        'consent = "operator"\n',
        'key = "keys/GCSA.key"\n',
        "[station] key: does not go together with [[vehicle]]: each says its own key",
    ),
    "the station's mission beside": (
        'consent = "operator"\n',
        'mission = "missions/delivery"\n',
        "[station] mission: does not go together with [[vehicle]]: each says its own mission",
    ),
    "the station's vehicle beside": (
        'consent = "operator"\n',
        "vehicle = 1\n",
        "[station] vehicle: does not go together with [[vehicle]]: each says its own sysid",
    ),
    "misspelt table": (FLEET[FLEET.index("[[vehicle]]") :], "[[vehicles]]\n", "unknown table [vehicles]; did you mean"),
    "in single brackets": (
        FLEET[FLEET.index("[[vehicle]]") :],
        '[vehicle]\nname = "drone-1"\n',
        "[vehicle] must be written [[vehicle]], once for each",
    ),
}


@pytest.mark.parametrize("mistake", list(FLEET_MISTAKES))
def test_a_mistake_about_several_vehicles_is_one_line(file: Path, mistake: str) -> None:
    old, new, expected = FLEET_MISTAKES[mistake]
    assert expected in the_line(file, with_change(FLEET, old, new), load_station)


def test_an_empty_list_of_vehicles_is_a_mistake(file: Path) -> None:
    text = 'vehicle = []\n[station]\nname = "GCSA"\nsysid = 251\n'
    assert the_line(file, text, load_station) == "[[vehicle]] must be there at least once, or not be named"


# ---- files --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("load", [load_vehicle, load_station])
def test_a_file_that_is_no_toml_says_where(file: Path, load: object) -> None:
    line = the_line(file, "[vehicle\nname = 1", load)
    assert line.startswith("not valid TOML: ")
    assert "line 1" in line


@pytest.mark.parametrize("load", [load_vehicle, load_station])
@pytest.mark.parametrize(
    "data",
    [b"\xff\xfe[", b"x = 1" + b"0" * 5000, b"x = " + b"[" * 5000, b"\0"],
    ids=["no UTF-8", "a number of thousands of digits", "brackets thousands deep", "a zero"],
)
def test_a_file_of_anything_is_one_line(file: Path, load: object, data: bytes) -> None:
    file.write_bytes(data)
    with pytest.raises(ConfigError) as caught:
        load(file)  # type: ignore[operator]
    assert str(caught.value).startswith(f"{file}: not valid TOML: ")
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there(file: Path) -> None:
    with pytest.raises(ConfigError) as caught:
        load_vehicle(file)
    assert str(caught.value) == f"{file}: no such file"


def test_a_file_that_is_a_folder(tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as caught:
        load_vehicle(tmp_path)
    assert str(caught.value) == f"{tmp_path}: Is a directory"


# ---- where they are looked for ------------------------------------------------------------------------------------


@pytest.fixture
def places(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Path]:
    """Every place holds a file."""
    here, etc = tmp_path / "here", tmp_path / "etc"
    here.mkdir()
    etc.mkdir()
    found = {
        "argument": tmp_path / "argument.toml",
        "variable": tmp_path / "variable.toml",
        "here": here / "handover.toml",
        "etc": etc / "vehicle.toml",
    }
    for path in found.values():
        path.touch()
    monkeypatch.chdir(here)
    monkeypatch.setenv("HANDOVER_CONFIG", str(found["variable"]))
    monkeypatch.setattr(files, "VEHICLE_PLACES", ("./handover.toml", str(found["etc"])))
    return found


def test_the_order_is_argument_variable_here_etc(places: dict[str, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    assert files.VEHICLE_PLACES[0] == "./handover.toml"
    assert find_vehicle_config(str(places["argument"])) == places["argument"]
    assert find_vehicle_config(None) == places["variable"]
    monkeypatch.delenv("HANDOVER_CONFIG")
    assert find_vehicle_config(None) == places["here"]
    places["here"].unlink()
    assert find_vehicle_config(None) == places["etc"]


def test_the_last_place_is_etc() -> None:
    assert files.VEHICLE_PLACES == ("./handover.toml", "/etc/handover/vehicle.toml")


def test_a_file_that_is_named_is_never_passed_over(places: dict[str, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    """A misspelt name must not silently fly with another vehicle's configuration."""
    assert find_vehicle_config("missing.toml") == Path("missing.toml").resolve()
    monkeypatch.setenv("HANDOVER_CONFIG", "missing.toml")
    assert find_vehicle_config(None) == Path("missing.toml").resolve()


def test_a_named_file_may_lie_at_home(places: dict[str, Path], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    assert find_vehicle_config("~/argument.toml") == places["argument"]


def test_nowhere_is_one_line(places: dict[str, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("HANDOVER_CONFIG")
    places["here"].unlink()
    places["etc"].unlink()
    with pytest.raises(ConfigError) as caught:
        find_vehicle_config(None)
    assert str(caught.value) == (
        'no configuration: looked for module load handover:{"config":"FILE"} (no spaces in it), $HANDOVER_CONFIG, '
        f"./handover.toml, {places['etc']}; the shell's 'handover init vehicle' writes one"
    )


def test_a_station_is_looked_for_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError, match="'handover init station'"):
        find_station_config(None)
    (tmp_path / "station.toml").touch()
    assert find_station_config(None) == tmp_path / "station.toml"
    assert find_station_config("other.toml") == tmp_path / "other.toml"


def test_links_in_a_circle_are_one_line(tmp_path: Path) -> None:
    circle = tmp_path / "circle.toml"
    circle.symlink_to(circle)
    with pytest.raises(ConfigError) as caught:
        load_vehicle(find_vehicle_config(str(circle)))
    assert str(circle) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("value", [5, 1.5, True, [], {}, "", "a\0b"])
def test_an_argument_that_is_no_path_is_one_line(value: object) -> None:
    with pytest.raises(ConfigError) as caught:
        path_argument("config", value)
    assert str(caught.value) == f"argument config: {value!r} must be the path of a file"


def test_an_argument_that_is_a_path() -> None:
    assert path_argument("config", "x.toml") == "x.toml"
    assert path_argument("journal", None) is None
