# SPDX-License-Identifier: GPL-3.0-or-later

"""Who is connected to whom: the configuration files are ones that the real programs take, and every link meets."""

from __future__ import annotations

import stat
from pathlib import Path

import pytest

from mavproxy_handover.config.files import load_station, load_vehicle
from mavproxy_handover.config.position import PositionSettings
from mavproxy_handover.mission import package as packages
from mavproxy_handover.store.keys import load_key
from mavproxy_handover.wire.box_layout import FULL
from sitl.run.bad_links import load_plans
from sitl.run.fleet import others_of
from sitl.run.noisy_lines import load_lines
from sitl.run.wiring import StationWires, Wiring, lay_out
from sitl.script.places import mission_folder
from sitl.script.scenario import ScenarioError, parse_scenario
from sitl.script.weather import NoiseLevel

try:
    import tomllib
except ModuleNotFoundError:  # Python 3.10
    import tomli as tomllib

SCENARIO = """
name = "x"
description = "d"
mission = "{mission}"
{more}
[[step]]
wait_landed = true
[[expect]]
emergencies = []
"""


def wired(folder: Path, more: str = "", mission: str = "delivery") -> Wiring:
    scenario = parse_scenario(SCENARIO.format(mission=mission, more=more), "x.toml")
    return lay_out(folder, packages.load(mission_folder(mission)), mission_folder(mission), scenario)


def station(wiring: Wiring, name: str) -> StationWires:
    return next(station for station in wiring.stations if station.name == name)


def companion_ports(wiring: Wiring, name: str) -> list[int]:
    """Where the companion sends for a station."""
    config = load_vehicle(wiring.companion_config)
    links = next(entry.links for entry in config.stations if entry.station.name == name)
    assert all(link.startswith("udpout:127.0.0.1:") for link in links)
    return [int(link.rsplit(":", 1)[1]) for link in links]


def ground_port(wiring: Wiring, name: str, other: str) -> int:
    """Where a station sends to reach another one."""
    peers = load_station(station(wiring, name).config).peers
    return int(next(peer.link for peer in peers if peer.station.name == other).rsplit(":", 1)[1])


def listens(wiring: Wiring, name: str) -> int:
    ground = load_station(station(wiring, name).config).ground
    assert ground is not None
    return int(ground.rsplit(":", 1)[1])


def test_plain_links_go_straight_to_the_stations(tmp_path: Path) -> None:
    wiring = wired(tmp_path)
    for name, other in (("GCSA", "GCSB"), ("GCSB", "GCSA")):
        assert companion_ports(wiring, name) == list(station(wiring, name).masters)
        assert ground_port(wiring, name, other) == listens(wiring, other)
    assert (wiring.between, wiring.impaired) == ((), ())


def test_a_station_without_a_link_gets_the_vehicles_address_with_the_parents_mission(tmp_path: Path) -> None:
    wiring = wired(tmp_path, 'address = ["GCSB"]')
    (link,) = next(
        entry.links for entry in load_vehicle(wiring.companion_config).stations if entry.station.name == "GCSB"
    )
    assert link.startswith("udpin:127.0.0.1:")
    parent, partner = (load_station(station(wiring, name).config) for name in ("GCSA", "GCSB"))
    (vehicle,) = parent.vehicles
    assert vehicle.mission is not None
    (address,) = packages.load(vehicle.mission).addresses[252]
    assert address.text == link.replace("udpin", "udpout")
    assert "--master=udpin:127.0.0.1:0" in " ".join(station(wiring, "GCSB").program().argv)
    assert (parent.offered_addresses_local, partner.offered_addresses_local) == (False, True)
    assert "addresses.toml" not in [path.name for path in mission_folder("delivery").iterdir()]


@pytest.mark.parametrize(
    "more",
    ['links = {GCSB = ["wifi", "lte"]}', 'standard = ["GCSB"]', 'rogue = ["GCSB"]', 'serial = [{lines = ["GCSB"]}]'],
)
def test_nothing_stands_in_the_link_of_a_station_that_gets_the_address(tmp_path: Path, more: str) -> None:
    with pytest.raises(ScenarioError, match="address: 'GCSB' gets the vehicle's address, and cannot be in "):
        wired(tmp_path, f'address = ["GCSB"]\n{more}')


def test_four_stations_have_three_peers_each_and_no_port_twice(tmp_path: Path) -> None:
    wiring = wired(tmp_path, mission="corridor")
    ports = []
    for entry in wiring.stations:
        assert len(load_station(entry.config).peers) == 3
        ports += [*entry.masters, listens(wiring, entry.name)]
    assert len(ports) == len(set(ports)) == 8


def test_impaired_links_go_through_the_proxy_with_the_weather_that_was_asked_for(tmp_path: Path) -> None:
    more = '[links]\nGCSA = ["wifi", "lte"]\n[impair]\nlinks = ["air", "ground"]\nseed = 7\nloss = 0.2\n'
    wiring = wired(tmp_path, more)
    (proxy,) = wiring.between
    seed, plans = load_plans(Path(proxy.argv[-1]))
    assert seed == "7"
    assert {(plan.up.loss, plan.down.loss) for plan in plans} == {(0.2, 0.2)}
    through = {plan.name: (plan.listen, plan.target) for plan in plans}
    assert tuple(through) == wiring.impaired
    assert set(through) == {"air-GCSA-wifi", "air-GCSA-lte", "air-GCSB", "ground-GCSA-GCSB", "ground-GCSB-GCSA"}
    a = station(wiring, "GCSA")
    pairs = list(zip(companion_ports(wiring, "GCSA"), a.masters, strict=True))
    assert pairs == [through["air-GCSA-wifi"], through["air-GCSA-lte"]]
    assert through["ground-GCSA-GCSB"] == (ground_port(wiring, "GCSA", "GCSB"), listens(wiring, "GCSB"))
    masters = [word for word in a.program().argv if word.startswith("--master=")]
    assert masters == [f"--master=udpin:127.0.0.1:{port}" for port in a.masters]


def test_serial_lines_stand_in_the_place_of_links_for_station_and_autopilot(tmp_path: Path) -> None:
    noise = "damage = 0.001\nbursts_per_s = 2\n"
    more = f'[[serial]]\nlines = ["GCSB"]\nbaud = 57600\nseed = 7\n{noise}[[serial]]\nlines = ["autopilot"]\n'
    wiring = wired(tmp_path, more)
    near, far = tmp_path / "lines" / "vehicle-GCSB", tmp_path / "lines" / "GCSB"
    (links,) = (entry.links for entry in load_vehicle(wiring.companion_config).stations if entry.station.sysid == 252)
    assert links == (f"serial:{near}:57600",)
    b = station(wiring, "GCSB")
    assert [word for word in b.program().argv if word.startswith("--master=")] == [f"--master={far},57600"]
    assert companion_ports(wiring, "GCSA") == list(station(wiring, "GCSA").masters)
    (program,) = wiring.programs_between("tcp:127.0.0.1:5762", "tcp:127.0.0.1:5760")
    assert program.argv[-2:] == ("--autopilot", "5762")
    to_station, to_autopilot = load_lines(Path(program.argv[-3]))
    assert (to_station.near, to_station.far, to_station.baud, to_station.seed) == (near, far, 57600, "7")
    assert to_station.noise == NoiseLevel(0.001, 2)
    assert (to_autopilot.near, to_autopilot.far) == (tmp_path / "lines" / "vehicle-autopilot", None)
    assert to_autopilot.noise == NoiseLevel()
    assert f"--master={to_autopilot.near},115200" in wiring.companion("tcp:127.0.0.1:5762").argv


def test_a_position_box_stands_beside_the_vehicle_and_the_companion_goes_to_it(tmp_path: Path) -> None:
    wiring = wired(tmp_path, '[box]\nsource = "box"\napart_m = 40\n')
    (program,) = wiring.programs_between("tcp:127.0.0.1:5762", "tcp:127.0.0.1:5760")
    assert program.name == "box"
    assert program.argv[-2:] == ("--vehicle", "tcp:127.0.0.1:5760")
    listens = program.argv[program.argv.index("--listen") + 1]
    position = load_vehicle(wiring.companion_config).position
    assert position == PositionSettings("box", f"tcp:{listens}", apart_m=40.0)
    assert "--layout" not in program.argv, "both have the thesis's"
    full = wired(tmp_path / "full", '[box]\nsource = "box"\nlayout = "full"\n')
    (program,) = full.programs_between("tcp:127.0.0.1:5762", "tcp:127.0.0.1:5760")
    assert program.argv[program.argv.index("--layout") + 1] == "full"
    assert load_vehicle(full.companion_config).position.layout is FULL
    assert load_vehicle(wired(tmp_path / "without").companion_config).position == PositionSettings()


def test_without_a_serial_line_the_companion_goes_to_the_autopilot_itself(tmp_path: Path) -> None:
    wiring = wired(tmp_path)
    assert wiring.programs_between("tcp:127.0.0.1:5762", "tcp:127.0.0.1:5760") == ()
    assert "--master=tcp:127.0.0.1:5762" in wiring.companion("tcp:127.0.0.1:5762").argv


def test_the_listener_is_what_the_companion_opens(tmp_path: Path) -> None:
    wiring = wired(tmp_path, 'listen = ["TERRAIN_DATA"]\ntransponder = true\n')
    listener, transponder = wiring.programs_between("tcp:127.0.0.1:5762", "tcp:127.0.0.1:5760")
    config = tomllib.loads((tmp_path / "listener" / "listener.toml").read_text())
    assert config["messages"] == ["TERRAIN_DATA"]
    assert listener.argv[-2:] == ("--autopilot", "5762")
    assert transponder.argv[-2:] == ("--autopilot", "5760")
    assert f"--master=tcp:127.0.0.1:{config['listen']}" in wiring.companion("tcp:127.0.0.1:5762").argv


def test_the_rogue_sits_before_the_proxy(tmp_path: Path) -> None:
    wiring = wired(tmp_path, 'rogue = ["GCSB"]\n[impair]\nlinks = ["air"]\n')
    proxy, rogue = wiring.between
    _, plans = load_plans(Path(proxy.argv[-1]))
    air = next(plan for plan in plans if plan.name == "air-GCSB")
    (tap,) = tomllib.loads(Path(rogue.argv[-1]).read_text())["link"]
    assert companion_ports(wiring, "GCSB") == [tap["listen"]]
    assert (tap["name"], tap["target"]) == ("GCSB", air.listen)
    assert (air.target,) == station(wiring, "GCSB").masters


def test_a_station_of_the_standard_has_no_module_and_is_nobodys_peer(tmp_path: Path) -> None:
    wiring = wired(tmp_path, 'standard = ["GCSA"]\non_board = true\n')
    vehicle = load_vehicle(wiring.companion_config)
    assert [entry.station.standard for entry in vehicle.stations] == [True, False]
    assert vehicle.mission == mission_folder("delivery")
    assert "sitl.run.standard_gcs" in station(wiring, "GCSA").program().argv
    b = load_station(station(wiring, "GCSB").config)
    assert (b.peers, b.vehicles[0].mission) == ((), mission_folder("delivery"))


def test_a_program_that_is_tried_gets_the_options_of_the_one_whose_place_it_has(tmp_path: Path) -> None:
    more = 'standard = ["GCSA", "GCSB"]\non_board = true\nnot_in_control = {GCSA = "never"}\n'
    scenario = parse_scenario(SCENARIO.format(mission="delivery", more=more), "x.toml")
    folder = mission_folder("delivery")
    wiring = lay_out(tmp_path, packages.load(folder), folder, scenario, {"GCSA": ("python", "theirs.py", "--fast")})
    theirs, ours = (station(wiring, name).program().argv for name in ("GCSA", "GCSB"))
    assert theirs[:5] == ("python", "theirs.py", "--fast", "--name", "GCSA")
    assert ours[1:5] == ("-m", "sitl.run.standard_gcs", "--name", "GCSB")
    assert theirs[5::2] == ours[5::2] == ("--sysid", "--vehicle", "--listen", "--journal")
    assert [entry.not_in_control for entry in load_vehicle(wiring.companion_config).stations] == ["never", "auto"]


@pytest.mark.parametrize("signed", [True, False])
def test_signed_links_have_a_key_for_each_station_that_nobody_else_may_read(tmp_path: Path, signed: bool) -> None:
    wiring = wired(tmp_path, f"signed = {str(signed).lower()}\n")
    keys = [entry.key for entry in load_vehicle(wiring.companion_config).stations]
    own = [load_station(entry.config).vehicles[0].key for entry in wiring.stations]
    assert keys == own
    if not signed:
        assert keys == [None, None]
        return
    contents = {key.read_text() for key in keys if key is not None}
    assert len(contents) == 2
    assert all(key is not None and stat.S_IMODE(key.stat().st_mode) == 0o600 for key in keys)


@pytest.mark.parametrize("word", ["", "same", "other"])
def test_companion_and_card_have_the_same_key_or_two(tmp_path: Path, word: str) -> None:
    wiring = wired(tmp_path, f'guard_key = "{word}"\n' if word else "")
    own = load_vehicle(wiring.companion_config).guard_key
    if not word:
        assert (own, wiring.card) == (None, ())
        return
    (card,) = wiring.card
    assert own is not None
    assert card.name == "handover.key"  # as the guard looks for it
    assert (load_key(own) == load_key(card)) is (word == "same")


# ---- several vehicles ---------------------------------------------------------------------------------------------


@pytest.fixture
def two(tmp_path: Path) -> Wiring:
    text = SCENARIO.format(mission="delivery", more='signed = true\nfleet = {drone-2 = "linear"}')
    scenario = parse_scenario(text, "x.toml")
    package = packages.load(mission_folder("delivery"))
    others = others_of(scenario, package)
    return lay_out(tmp_path, package, mission_folder("delivery"), scenario, others=others)


def test_each_vehicle_has_a_link_and_a_key_of_its_own_at_each_station(two: Wiring) -> None:
    companions = {1: load_vehicle(two.companion_config), 2: load_vehicle(two.others["drone-2"])}
    assert [(each.name, each.sysid) for each in companions.values()] == [("drone-1", 1), ("drone-2", 2)]
    for entry in two.stations:
        config = load_station(entry.config)
        assert [vehicle.name for vehicle in config.vehicles] == ["drone-1", "drone-2"]
        for vehicle in config.vehicles:
            there = next(each for each in companions[vehicle.sysid].stations if each.station == config.station)
            assert [link.replace("udpout", "udpin") for link in there.links] == list(vehicle.links)
            assert vehicle.key == there.key
        keys = [load_key(vehicle.key) for vehicle in config.vehicles if vehicle.key is not None]
        assert len(set(keys)) == 2
        assert [word for word in entry.program().argv if word.startswith("--master=")] == [
            f'--master={vehicle.links[0]}:{{"label":"{vehicle.name}"}}' for vehicle in config.vehicles
        ]


def test_the_parent_alone_has_the_missions_and_each_vehicle_its_own(two: Wiring) -> None:
    a, b = (load_station(entry.config) for entry in two.stations)
    assert [vehicle.mission for vehicle in a.vehicles] == [mission_folder("delivery"), mission_folder("linear")]
    assert [vehicle.mission for vehicle in b.vehicles] == [None, None]


def test_a_further_vehicle_has_the_same_stations(tmp_path: Path) -> None:
    text = SCENARIO.format(mission="delivery", more='fleet = {drone-2 = "corridor"}')
    with pytest.raises(
        ScenarioError, match=r"x\.toml: \[fleet\] drone-2: 'corridor' has other stations than the first"
    ):
        others_of(parse_scenario(text, "x.toml"), packages.load(mission_folder("delivery")))
