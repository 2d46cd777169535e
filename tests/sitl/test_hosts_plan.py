# SPDX-License-Identifier: GPL-3.0-or-later

"""The bench on several hosts, as far as it is data: addresses, routes, tunnels, the flight, and what is counted."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from mavproxy_handover.config.files import load_station, load_vehicle
from mavproxy_handover.mission import package as packages
from sitl.hosts import main as command
from sitl.hosts import namespaces
from sitl.hosts.flight import flight
from sitl.hosts.main import main
from sitl.hosts.meter import Seen
from sitl.hosts.namespaces import _stays
from sitl.hosts.plan import LINK_INTERFACES, Plan, plan
from sitl.hosts.results import costs_of
from sitl.hosts.table import table
from sitl.hosts.tunnel import KeyPair, setup
from sitl.run.sites import Reach, Site
from sitl.run.wiring import lay_out
from sitl.script.expect import Count
from sitl.script.places import SetupError, mission_folder
from sitl.script.scenario import parse_scenario
from sitl.script.steps import Pause


def routes(made: Plan, host: str) -> list[str]:
    return [str(route) for route in made.host(host).routes]


# ---- addresses and routes -------------------------------------------------------------------------------------------


def test_the_route_of_listing_5_3_is_on_every_host_that_the_listing_is_for() -> None:
    made = plan(["GCSA", "GCSB"])
    assert routes(made, "mc")[0] == "192.168.10.0/24 via 192.168.11.1 dev eth0"
    assert routes(made, "gcsa")[0] == "192.168.11.0/24 via 192.168.10.1 dev eno1"
    assert routes(made, "gcsb")[0] == "192.168.11.0/24 via 192.168.10.1 dev eno1"


def test_the_addresses_are_those_of_listings_5_1_and_5_3() -> None:
    made = plan(["GCSA", "GCSB"])
    assert made.host("mc").address("eth0") == "192.168.11.100"
    assert made.host("gcsa").address("eno1") == "192.168.10.100"
    assert made.host("gcsb").address("eno1") == "192.168.10.128"
    assert [each.address for each in made.host("gateway").interfaces] == ["192.168.11.1/24", "192.168.10.1/24"]


def test_each_station_is_reached_by_two_paths() -> None:
    made = plan(["GCSA", "GCSB"], ["GCSB"])
    assert made.reach("GCSA", "wired") == ("192.168.10.100", "eth0")
    assert made.reach("GCSA", "lte") == ("100.64.1.2", "wwan0")
    assert made.reach("GCSB", "wired") == ("10.9.1.3", "wg-wired")
    assert made.reach("GCSB", "lte") == ("10.9.2.3", "wg-lte")
    assert made.reach("GCSB", "lte", inside=False) == ("100.64.2.2", "wwan0")


def test_every_cable_has_two_ends_that_are_on_hosts_of_the_plan() -> None:
    made = plan(["GCSA", "GCSB", "GCSC"])
    cables = [words for words in made.commands() if "veth" in words]
    assert cables[0] == [
        "link",
        "add",
        "eth0",
        "netns",
        "mc",
        "type",
        "veth",
        "peer",
        "name",
        "air",
        "netns",
        "gateway",
    ]
    assert len(cables) == 8, "two of the mission computer, two of each station"
    names = {host.name for host in made.hosts}
    assert {words[4] for words in cables} | {words[-1] for words in cables} <= names


@pytest.mark.parametrize(
    ("stations", "tunnelled", "said"),
    [
        ([], [], "0 stations"),
        ([f"GCS{number}" for number in range(9)], [], "9 stations"),
        (["GCSA", "lte"], [], "'lte'"),
        (["GCS A"], [], "'gcs a'"),
        (["GCSA"], ["GCSB"], "--tunnel GCSB: no station of this mission: GCSA"),
    ],
)
def test_what_cannot_be_laid_is_refused_by_name(stations: list[str], tunnelled: list[str], said: str) -> None:
    with pytest.raises(ValueError, match="station") as error:
        plan(stations, tunnelled)
    assert said in str(error.value)


@pytest.mark.parametrize(
    ("route", "stays"),
    [
        ({"dst": "default", "gateway": "192.168.10.1", "dev": "eno1"}, False),
        ({"dst": "8.8.8.8", "dev": "eno1"}, False),
        ({"dst": "2000::/3", "dev": "eno1"}, False),
        ({"dst": "0.0.0.0/1", "dev": "eno1"}, False),
        ({"dst": "192.168.11.0/24", "gateway": "192.168.10.1", "dev": "eno1"}, True),
        ({"dst": "10.9.1.0/24", "dev": "wg-wired"}, True),
        ({"dst": "fe80::/64", "dev": "eno1"}, True),
        ({"type": "multicast", "dst": "ff00::/8", "dev": "eno1"}, True),
        ({"type": "local", "dst": "192.168.10.100", "dev": "eno1"}, True),
    ],
)
def test_a_route_out_of_the_bench_is_known(route: dict[str, Any], stays: bool) -> None:
    assert _stays(route) is stays


# ---- tunnels --------------------------------------------------------------------------------------------------------


def test_the_aircraft_calls_and_keeps_the_path_open_and_the_station_waits() -> None:
    made = plan(["GCSA", "GCSB"], ["GCSA"])
    keys = {"mc": KeyPair("private-mc", "public-mc"), "gcsa": KeyPair("private-a", "public-a")}
    aircraft, station = made.tunnels[:2]
    assert setup(aircraft, keys) == (
        "[Interface]\nPrivateKey = private-mc\nListenPort = 51820\n\n[Peer]\nPublicKey = public-a\n"
        "AllowedIPs = 10.9.1.2/32\nEndpoint = 192.168.10.100:51820\nPersistentKeepalive = 25\n"
    )
    assert setup(station, keys) == (
        "[Interface]\nPrivateKey = private-a\nListenPort = 51820\n\n[Peer]\nPublicKey = public-mc\n"
        "AllowedIPs = 10.9.1.1/32\n"
    )


def test_each_path_has_a_tunnel_of_its_own_and_no_name_is_there_twice() -> None:
    ends = plan(["GCSA", "GCSB"], ["GCSA", "GCSB"]).tunnels
    assert [(end.host, end.interface, end.address) for end in ends] == [
        ("mc", "wg-wired", "10.9.1.1/24"),
        ("gcsa", "wg1-wired", "10.9.1.2/24"),
        ("gcsb", "wg2-wired", "10.9.1.3/24"),
        ("mc", "wg-lte", "10.9.2.1/24"),
        ("gcsa", "wg1-lte", "10.9.2.2/24"),
        ("gcsb", "wg2-lte", "10.9.2.3/24"),
    ]


def udp(size: int, source: int, target: int, first: int) -> bytes:
    """An IPv4 packet of that size with a UDP datagram."""
    header = struct.pack("!BBHHHBBH4s4s", 0x45, 0, size, 0, 0, 64, 17, 0, bytes(4), bytes(4))
    return (header + struct.pack("!HHHHB", source, target, size - 20, 0, first)).ljust(size, b"\0")


def test_of_the_tunnels_packets_those_that_carry_nothing_are_counted_apart() -> None:
    below, inside = Seen(51820), Seen(0)
    below.count(udp(156, 51820, 51820, 4))
    below.count(udp(60, 51820, 51820, 4))  # 32 bytes of payload: a keepalive
    below.count(udp(176, 51820, 51820, 1))  # a handshake
    below.count(udp(88, 14550, 40000, 4))  # another link on the same interface
    below.count(b"\x60" + bytes(87))
    assert (below.packets, below.total_bytes, below.own_packets, below.own_bytes) == (1, 156, 2, 236)
    inside.count(udp(88, 14550, 40000, 0xFD))
    assert (inside.packets, inside.total_bytes, inside.own_packets) == (1, 88, 0)


def test_the_cost_is_the_difference_to_the_same_path_without_a_tunnel(tmp_path: Path) -> None:
    path = tmp_path / "meter.jsonl"
    seen = {
        "wg-wired": {"packets": 4, "bytes": 300, "own_packets": 0, "own_bytes": 0},
        "eth0": {"packets": 4, "bytes": 580, "own_packets": 3, "own_bytes": 356},
    }
    asked = [
        {"wired/plain": {"round_trips": [0.001, 0.002]}, "wired/tunnel": {"round_trips": [0.004]}},
        {"wired/plain": {"round_trips": [0.003]}, "wired/tunnel": {"round_trips": [0.0045, 0.005]}},
    ]
    lines = [json.dumps({"t": 1.0, "asked": each, "seen": seen}) for each in asked]
    path.write_text("\n".join([*lines, '{"t": 3']), encoding="utf-8")
    cost = costs_of(path, {"wired": ("wg-wired", "eth0"), "lte": ("wg-lte", "wwan0")})
    assert list(cost) == ["wired"], "nothing was seen of the other path"
    assert (cost["wired"]["plain_ms"], cost["wired"]["tunnel_ms"], cost["wired"]["added_ms"]) == (2.0, 4.5, 2.5)
    assert (cost["wired"]["plain_99_ms"], cost["wired"]["tunnel_99_ms"]) == (3.0, 5.0)
    assert (cost["wired"]["packet_bytes"], cost["wired"]["packet_bytes_in_tunnel"]) == (75.0, 145.0)
    assert (cost["wired"]["added_bytes"], cost["wired"]["own_bytes"]) == (70.0, 356)


# ---- the flight -----------------------------------------------------------------------------------------------------


def scenario_of(cut: str, mission: str = "linear") -> Any:
    folder = mission_folder(mission)
    return parse_scenario(flight(packages.load(folder), folder, cut), "bench")


def test_the_path_stays_cut_until_the_next_station_commands() -> None:
    scenario = scenario_of("wired")
    words = [step.deed.describe() for step in scenario.steps if not isinstance(step.deed, Pause)]
    cut, healed = words.index("links: cut wired"), words.index("links: heal wired")
    assert words[healed - 1] == "transfer committed, station GCSB (drone-1)"
    assert [word for word in words[cut:healed] if "GCSA" in word] == [
        "GCSA types: handover stop",
        "command, what STOP, result accepted (GCSA)",
        "GCSA types: handover continue",
        "command, what CONTINUE, result accepted (GCSA)",
    ]
    assert scenario.links == {"GCSA": ("wired", "lte"), "GCSB": ("wired", "lte")}
    assert scenario.signed


@pytest.mark.parametrize(
    ("cut", "wanted"),
    [
        ("wired", [("GCSA", "degraded"), ("GCSA", "switched"), ("GCSB", "degraded"), ("GCSB", "switched")]),
        ("lte", [("GCSA", "degraded"), ("GCSB", "degraded")]),
        ("none", []),
    ],
)
def test_the_companion_must_notice_the_cut_and_move_the_downlink_off_the_best_path(
    cut: str, wanted: list[tuple[str, str]]
) -> None:
    counts = [each for each in scenario_of(cut).expectations if isinstance(each, Count) and each.event == "link"]
    values = [dict(each.match.values) for each in counts]
    assert [(each["station"], each["change"]) for each in values] == wanted
    links = {"wired": ["*@eth0", "*@wg-wired"], "lte": ["*@wwan0", "*@wg-lte"]}
    assert all(each["link"] == links[cut] for each in values if each["change"] == "degraded")
    made = plan(["GCSA", "GCSB"], ["GCSB"])
    for path, interfaces in LINK_INTERFACES.items():
        assert {made.reach("GCSA", path)[1], made.reach("GCSB", path)[1]} == set(interfaces)


def test_without_a_cut_no_step_changes_a_path() -> None:
    assert not [step for step in scenario_of("none").steps if "links:" in step.deed.describe()]


def test_any_mission_with_a_handover_is_flown_and_one_without_is_refused() -> None:
    assert scenario_of("lte", "corridor").name == "corridor-on-hosts"
    folder = mission_folder("linear")
    with pytest.raises(SetupError, match="foretells no handover"):
        flight(Alone(packages.load(folder)), folder, "wired")  # type: ignore[arg-type]


class Alone:
    """A package whose route simulation has the parent alone as commander."""

    def __init__(self, package: packages.MissionPackage) -> None:
        self._package = package

    def __getattr__(self, name: str) -> Any:
        return getattr(self._package, name)

    def simulate(self) -> Any:
        """One commander."""
        simulation = self._package.simulate()
        return SimpleNamespace(commanders=simulation.commanders[:1], duration_s=simulation.duration_s)


def test_companion_and_stations_are_configured_for_their_hosts(tmp_path: Path) -> None:
    folder = mission_folder("linear")
    package = packages.load(folder)
    sites = {
        "GCSA": Site(
            ("ip", "netns", "exec", "gcsa"),
            {"wired": Reach("192.168.10.100", "eth0"), "lte": Reach("100.64.1.2", "wwan0")},
            14550,
            "192.168.10.100",
            15550,
        ),
    }
    wiring = lay_out(tmp_path, package, folder, scenario_of("wired"), sites=sites)
    links = {entry.station.name: entry.links for entry in load_vehicle(wiring.companion_config).stations}
    assert links["GCSA"] == ("udpout:192.168.10.100:14550@eth0", "udpout:100.64.1.2:14550@wwan0")
    assert all(link.startswith("udpout:127.0.0.1:") for link in links["GCSB"])
    a, b = wiring.stations
    assert a.program().argv[:4] == ("ip", "netns", "exec", "gcsa")
    masters = [word for word in a.program().argv if word.startswith("--master=")]
    assert masters == ["--master=udpin:192.168.10.100:14550", "--master=udpin:100.64.1.2:14550"]
    assert load_station(a.config).ground == "udpin:192.168.10.100:15550"
    assert [peer.link for peer in load_station(b.config).peers] == ["udpout:192.168.10.100:15550"]


# ---- what is said ---------------------------------------------------------------------------------------------------

RESULTS: dict[str, Any] = {
    "hosts": [
        {
            "name": "mc",
            "says": "mission computer",
            "addresses": {"eth0": "192.168.11.100/24"},
            "routes": ["192.168.10.0/24 via 192.168.11.1 dev eth0"],
        }
    ],
    "paths": {"wired": "Ethernet", "lte": "slow"},
    "links": {"GCSA": {"wired": "10.9.1.2@wg-wired"}},
    "handovers": [{"to": "GCSB", "epoch": 2, "at_s": 79.8, "duration_s": 0.197, "while_cut": True}],
    "cut": {
        "at_s": 40.8,
        "healed_s": 79.9,
        "stations": {"GCSA": {"switched_s": 0.56, "companion": ["downlink on lte now"], "silent_s": None}},
    },
    "tunnel": {
        "made_by": "wireguard-go",
        "stations": ["GCSA"],
        "ends": {"mc wg-wired": "10.9.1.1/24, MTU 1420"},
        "paths": {
            "wired": {
                "plain_ms": 0.21,
                "tunnel_ms": 0.63,
                "added_ms": 0.42,
                "plain_99_ms": 1.94,
                "tunnel_99_ms": 3.21,
                "round_trips": [828, 817],
                "packets": 13190,
                "packet_bytes": 76.1,
                "packet_bytes_in_tunnel": 146.2,
                "added_bytes": 70.1,
                "own_packets": 3,
                "own_bytes": 356,
            }
        },
    },
}


def test_the_table_says_hosts_handovers_the_cut_and_what_the_tunnel_costs() -> None:
    text = "\n".join(table(RESULTS))
    for said in (
        "mc         mission computer     eth0 192.168.11.100/24",
        "route 192.168.10.0/24 via 192.168.11.1 dev eth0",
        "79.8 s  to GCSB in 197 ms, while the path was cut",
        "at 40.8 s, joined again at 79.9 s",
        "the companion left it after 0.56 s; longest time without telemetry at GCSA: not known",
        "+70 bytes for each packet (76 become 146, mean of 13190), and 3 packets of its own (356 bytes)",
        "+0.42 ms there and back (0.21 without, 0.63 with it, medians of 828 and 817; 99 % within 1.9 and 3.2)",
    ):
        assert said in text


def test_without_root_it_is_one_sentence_and_exit_code_2(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr(namespaces.os, "geteuid", lambda: 1000)
    assert main(["hosts", "--out", str(tmp_path / "run")]) == 2
    assert capsys.readouterr().err == ("handover bench hosts: network namespaces need root: run it with sudo\n")
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("missing", "words", "said"),
    [
        ("ip", [], "the program ip is missing: install iproute2"),
        ("wg", ["--tunnel"], "the program wg is missing: install wireguard-tools"),
    ],
)
def test_a_program_that_is_missing_is_named(
    missing: str,
    words: list[str],
    said: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    monkeypatch.setattr(namespaces.os, "geteuid", lambda: 0)
    monkeypatch.setattr("shutil.which", lambda name: None if name == missing else f"/usr/bin/{name}")
    assert main(["hosts", *words, "--out", str(tmp_path / "run")]) == 2
    assert said in capsys.readouterr().err


def test_a_station_of_another_mission_cannot_have_the_tunnel(capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main(["hosts", "--tunnel", "GCSX"]) == 2
    assert "--tunnel GCSX: no station of this mission: GCSA, GCSB" in capsys.readouterr().err
