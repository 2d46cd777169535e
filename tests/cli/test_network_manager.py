# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover install` where NetworkManager has the interfaces, the clock, and room on the disk."""

from __future__ import annotations

import configparser
from datetime import datetime, timedelta, timezone
from pathlib import Path

import pytest

from mavproxy_handover.cli import keyfiles
from mavproxy_handover.cli.install import install, uninstall
from mavproxy_handover.cli.machine import files, uplink
from mavproxy_handover.config.files import ConfigError
from mavproxy_handover.store.flights import Flight, Room, to_go

LINE, PROGRAM = "/dev/ttyTHS1,921600", "/opt/handover/bin/handover"
ARGV = ["companion", "--device", LINE, "--wifi", "wlan0=192.0.2.20/24,192.0.2.1", "--lte", "wwan0"]
CONNECTIONS = Path("etc/NetworkManager/system-connections")


def sections(text: str) -> configparser.ConfigParser:
    parser = configparser.ConfigParser(interpolation=None, strict=True)
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    parser.read_string(text)
    return parser


def test_a_wifi_with_an_address_of_its_own() -> None:
    item = keyfiles.keyfile(uplink("wifi", "wlan0=192.0.2.20/24,192.0.2.1"), "Field")
    assert (str(item.path), item.mode) == (
        "/etc/NetworkManager/system-connections/handover-wifi.nmconnection",
        0o600,
    )
    found = sections(item.text)
    assert dict(found["connection"]) == {
        "id": "handover-wifi",
        "type": "wifi",
        "autoconnect-priority": "10",
        "interface-name": "wlan0",
    }
    assert dict(found["wifi"]) == {"ssid": "Field"}
    assert dict(found["wifi-security"]) == {"key-mgmt": "wpa-psk"}, "the passphrase comes from nmcli --ask"
    assert dict(found["ipv4"]) == {
        "method": "manual",
        "address1": "192.0.2.20/24,192.0.2.1",
        "route-table": "101",
        "may-fail": "true",
        "routing-rule1": "priority 1001 from 0.0.0.0/0 oif wlan0 table 101",
        "routing-rule2": "priority 1001 from 192.0.2.20/32 table 101",
        "routing-rule3": "priority 33101 from 0.0.0.0/0 table 101",
    }


@pytest.mark.parametrize(
    ("text", "kind", "named"), [("eth0", "ethernet", True), ("wwan0", "gsm", False), ("wlan1", "wifi", True)]
)
def test_each_kind_of_interface(text: str, kind: str, named: bool) -> None:
    found = sections(keyfiles.keyfile(uplink("lte", text), "Field").text)
    assert found["connection"]["type"] == kind
    assert ("interface-name" in found["connection"]) is named
    assert found["ipv4"]["method"] == "auto"
    assert found["ipv4"]["route-table"] == "102"


@pytest.mark.parametrize("ssid", [None, "", "a;b", "x" * 33, "a\nb"])
def test_a_wifi_needs_its_name(ssid: str | None) -> None:
    with pytest.raises(ConfigError, match="--ssid"):
        keyfiles.keyfile(uplink("wifi", "wlan0"), ssid)


def image(tmp_path: Path, manager: bool) -> Path:
    if manager:
        (tmp_path / "usr/sbin").mkdir(parents=True)
        (tmp_path / "usr/sbin/NetworkManager").touch()
    return tmp_path


@pytest.mark.parametrize("manager", [True, False])
def test_install_writes_for_the_program_that_has_the_interfaces(tmp_path: Path, manager: bool) -> None:
    root = image(tmp_path, manager)
    assert install([*ARGV, "--ssid", "Field", "--root", str(root), "--program", PROGRAM]) == 0
    keyed, networkd = (root / CONNECTIONS).exists(), (root / "etc/systemd/network").exists()
    assert (keyed, networkd) == (manager, not manager)
    if manager:
        assert sorted(path.name for path in (root / CONNECTIONS).iterdir()) == [
            "handover-lte.nmconnection",
            "handover-wifi.nmconnection",
        ]


def test_a_person_may_say_which_program_it_is(tmp_path: Path) -> None:
    root = image(tmp_path, manager=True)
    assert install([*ARGV, "--network", "networkd", "--root", str(root), "--program", PROGRAM]) == 0
    assert not (root / CONNECTIONS).exists()


def test_without_its_name_nothing_is_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = image(tmp_path, manager=True)
    assert install([*ARGV, "--root", str(root), "--program", PROGRAM]) == 2
    assert capsys.readouterr().err == (
        "handover install: --wifi wlan0: NetworkManager runs here: name the Wi-Fi with --ssid NAME\n"
    )
    assert not (root / "etc").exists()


def test_a_passphrase_that_nmcli_has_added_outlives_another_install(tmp_path: Path) -> None:
    root = image(tmp_path, manager=True)
    argv = [*ARGV, "--ssid", "Field", "--root", str(root), "--program", PROGRAM]
    assert install(argv) == 0
    wifi = root / CONNECTIONS / "handover-wifi.nmconnection"
    wifi.write_text(wifi.read_text() + "psk=secret\n")
    assert install(argv) == 0
    assert "psk=secret" in wifi.read_text()
    assert uninstall(["companion", "--root", str(root)]) == 0
    assert not (root / CONNECTIONS / "handover-lte.nmconnection").exists()


def test_the_unit_starts_after_the_clock_and_does_without_one() -> None:
    """An order alone: a boat without a network has no right clock, and starts as well."""
    for kind in ("companion", "station"):
        (unit,) = [item.text for item in files(kind, PROGRAM, LINE) if item.path.name == f"handover-{kind}.service"]
        lines = unit.splitlines()
        assert "After=time-sync.target" in lines
        assert not [line for line in lines if line.startswith(("Wants=time", "Requires=time", "BindsTo=time"))]
    (wait,) = [item for item in files("companion", PROGRAM, LINE) if "systemd-time-wait-sync" in str(item.path)]
    assert "TimeoutStartSec=30" in wait.text.splitlines()


NOW = datetime(2026, 11, 29, tzinfo=timezone.utc)


def flight(day: int, size: float, held: bool = False) -> Flight:
    at = NOW - timedelta(days=day)
    return Flight(Path(f"{day}"), "drone-1", at, at, int(size), held)


@pytest.mark.parametrize(
    ("keep", "free", "gone"), [(0, 0, []), (5, 5, []), (5, 4, [3]), (5, 2.5, [3, 2]), (50, 0, [3, 2])]
)
def test_the_oldest_flights_go_until_there_is_room(keep: float, free: float, gone: list[int]) -> None:
    found = [flight(1, 2, held=True), flight(2, 2), flight(3, 2)]
    assert [int(each.path.name) for each in to_go(found, NOW, 90, 1e9, Room(keep, free))] == gone


def test_what_is_too_old_makes_room_first() -> None:
    found = [flight(2, 2), flight(100, 3)]
    assert [int(each.path.name) for each in to_go(found, NOW, 90, 1e9, Room(5, 2))] == [100]
