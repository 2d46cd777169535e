# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover station`: one MAVProxy for all vehicles of a station, each link with the name of its vehicle."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from mavproxy_handover.cli.launch import station_argv
from mavproxy_handover.cli.run import station
from mavproxy_handover.config.files import ConfigError

ONE = '[station]\nname = "GCSA"\nsysid = 251\nvehicle = 7\n'
SEVERAL = """
[station]
name = "GCSA"
sysid = 251
[[vehicle]]
name = "drone-1"
sysid = 3
links = ["udpin:0.0.0.0:14550", "serial:/dev/ttyUSB0:57600"]
allow_unsigned = true
[[vehicle]]
name = "drone-2"
sysid = 4
links = ["tcp:10.0.0.2:5760"]
allow_unsigned = true
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "station.toml"


def options(argv: list[str], name: str) -> list[str]:
    return [word.partition("=")[2] for word in argv if word.startswith(f"--{name}=")]


def test_with_one_vehicle_its_link_is_the_command_lines(file: Path) -> None:
    file.write_text(ONE)
    argv = station_argv(file, "udpin:0.0.0.0:14550", Path("x.tlog"))
    assert options(argv, "master") == ["udpin:0.0.0.0:14550"]
    assert options(argv, "target-system") == ["7"]


def test_with_several_each_link_has_its_vehicles_name(file: Path) -> None:
    file.write_text(SEVERAL)
    argv = station_argv(file, None, Path("x.tlog"))
    assert options(argv, "master") == [
        'udpin:0.0.0.0:14550:{"label":"drone-1/1"}',
        '/dev/ttyUSB0,57600:{"label":"drone-1/2"}',
        'tcp:10.0.0.2:5760:{"label":"drone-2"}',
    ]
    assert options(argv, "target-system") == ["3"]
    assert options(argv, "source-system") == ["251"]


MISSING = "--master is missing: there is no [[vehicle]] that names the links"
NO_PEER = 'no [[peer]] that may send the vehicle\'s address (offered_addresses = "ask")'
PEER = """
[ground]
listen = "udpin:127.0.0.1:15552"
allow_unsigned = true
[[peer]]
name = "GCSB"
sysid = 252
link = "udpout:127.0.0.1:15551"
"""


def test_without_a_link_to_the_vehicle_a_station_waits_for_its_address(file: Path) -> None:
    """MAVProxy without any link would listen on every interface, or open a serial port that it finds."""
    file.write_text(f"{ONE}{PEER}")
    masters = options(station_argv(file, None, Path("x.tlog")), "master")
    assert masters == ['udpin:127.0.0.1:0:{"label":"no-vehicle-yet"}']


@pytest.mark.parametrize(
    ("text", "master", "problem"),
    [
        (SEVERAL, "udpin:0.0.0.0:1", "[[vehicle]] names the links: --master does not go together with it"),
        (ONE, None, f"{MISSING}, and {NO_PEER}"),
        (f'{ONE}offered_addresses = "refuse"\n{PEER}', None, f"{MISSING}, and {NO_PEER}"),
    ],
)
def test_links_are_named_in_one_place(
    file: Path, text: str, master: str | None, problem: str, capsys: pytest.CaptureFixture[str]
) -> None:
    file.write_text(text)
    with pytest.raises(ConfigError) as error:
        station_argv(file, master, Path("x.tlog"))
    assert str(error.value) == f"{file}: {problem}"
    words = [f"--config={file}", "--print", *([f"--master={master}"] if master else [])]
    assert station(words) == 2
    assert capsys.readouterr().err == f"handover station: {file}: {problem}\n"


@pytest.mark.parametrize("link", ["udpin:[::]:14550", "tcp:[2001:db8::9]:5760", "udpout:[fe80::1%wlan0]:14550"])
def test_mavproxy_s_own_links_have_no_ipv6(file: Path, link: str) -> None:
    file.write_text(ONE)
    words = f"link {link}: MAVProxy opens this one, and knows no IPv6: give an IPv4 address"
    with pytest.raises(ConfigError, match=re.escape(words)):
        station_argv(file, link, Path("x.tlog"))
    file.write_text(SEVERAL.replace("tcp:10.0.0.2:5760", link))
    with pytest.raises(ConfigError, match=re.escape(words)):
        station_argv(file, None, Path("x.tlog"))
