# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover install` and `uninstall`, below a folder. What is written is read by systemd's own programs, and as INI.

systemd itself is neither run nor spoken to.
"""

from __future__ import annotations

import configparser
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path, PurePosixPath

import pytest

from mavproxy_handover import cli
from mavproxy_handover.cli import install as installing
from mavproxy_handover.cli.machine import Item, below, files, uplink
from mavproxy_handover.config.vehicle import load_vehicle
from mavproxy_handover.store.keys import write_key
from mavproxy_handover.supervision.rules import Limits
from tests.loopback.conftest import vehicle_file

PROGRAM = "/opt/handover/bin/handover"
LINE = "/dev/ttyTHS1,921600"
WAYS = ["--wifi", "wlan0=192.168.1.20/24,192.168.1.1", "--lte", "wwan0"]


OF_THE_SERVICE = 'GROUP="handover", MODE="0660", ENV{ID_MM_DEVICE_IGNORE}="1"'
BY_ID = "/dev/serial/by-id/usb-FTDI_FT232R_USB_UART_A5-if00-port0"


def run(*words: str) -> int:
    return cli.main(list(words))


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return tmp_path / "root"


def install(root: Path, kind: str = "companion", *more: str) -> int:
    device = ["--device", LINE] if kind == "companion" and "--device" not in more else []
    return run("install", kind, *device, "--program", PROGRAM, "--root", str(root), *more)


def unit_of(text: str) -> configparser.ConfigParser:
    unit = configparser.ConfigParser(strict=False, interpolation=None)
    unit.optionxform = str  # type: ignore[assignment, method-assign]
    unit.read_string(text)
    return unit


def text_of(items: list[Item], name: str) -> str:
    (found,) = [item.text for item in items if item.path.name == name]
    return found


def everything(root: Path) -> dict[str, bytes]:
    return {str(path.relative_to(root)): path.read_bytes() for path in root.rglob("*") if path.is_file()}


# ---- the unit -------------------------------------------------------------------------------------------------------


def test_the_command_line_of_the_unit_is_one_of_ours(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    service = unit_of(text_of(files("companion", PROGRAM, LINE), "handover-companion.service"))["Service"]
    program, *words = shlex.split(service["ExecStart"])
    assert program == PROGRAM
    words[words.index("--config") + 1] = str(vehicle_file(tmp_path / "vehicle.toml", 14550))
    assert run(*words, "--print") == 0
    shown = shlex.split(capsys.readouterr().out)
    assert "--master=/dev/handover-autopilot,921600" in shown
    assert "--logfile=/var/lib/handover/flights/latest/drone-1.tlog" in shown


def test_the_unit_waits_for_the_main_loop_and_leaves_time_to_end() -> None:
    service = unit_of(text_of(files("companion", PROGRAM, LINE), "handover-companion.service"))["Service"]
    asked = {
        "Type": "notify",
        "WatchdogSec": "10",
        "KillMode": "control-group",
        "User": "handover",
        "Restart": "always",
    }
    assert {key: service[key] for key in asked} == asked
    assert service["StandardInput"] == "null"
    assert float(service["TimeoutStopSec"]) > Limits().end_s
    assert float(service["TimeoutStartSec"]) > Limits().start_s
    # the longest pause between two children, behind the last word to the watchdog
    assert Limits().hopeless_s + 10.0 / 3.0 < 10.0
    assert service["DevicePolicy"] == "closed"
    assert service["DeviceAllow"] == "char-ttyTHS rw"


@pytest.mark.parametrize(
    ("device", "option", "allowed"),
    [
        (None, "", None),
        ("udpin:0.0.0.0:14550", " --master udpin:0.0.0.0:14550", None),
        ("/dev/ttyUSB0,57600", " --master /dev/ttyUSB0,57600", "char-ttyUSB rw"),
    ],
)
def test_the_unit_of_a_station(device: str | None, option: str, allowed: str | None) -> None:
    found = files("station", PROGRAM, device)
    service = unit_of(text_of(found, "handover-station.service"))["Service"]
    assert service["ExecStart"] == (
        f"{PROGRAM} station --config /etc/handover/station.toml{option} --logs /var/lib/handover/flights -- --daemon"
    )
    assert service.get("DeviceAllow") == allowed
    rules = [item.text.splitlines()[-1] for item in found if "udev" in str(item.path)]
    assert rules == ([] if allowed is None else [f'SUBSYSTEM=="tty", KERNEL=="ttyUSB0", {OF_THE_SERVICE}'])


def test_who_commands_is_known_again_after_the_service_was_restarted() -> None:
    """It is kept in memory, and bound to the boot (store/state_store.py): both have to be there for the service."""
    service = unit_of(text_of(files("companion", PROGRAM, LINE), "handover-companion.service"))["Service"]
    assert service["RuntimeDirectory"] == "handover"
    assert service["RuntimeDirectoryPreserve"] == "yes", "/dev/shm is emptied by RemoveIPC=, /run is not writable"
    assert "ProcSubset" not in service, "/proc/sys/kernel/random/boot_id would be hidden"
    assert service["PrivateTmp"] == "yes"


def test_what_could_not_start_is_started_again_and_not_at_once() -> None:
    """At boot an address, a name or the autopilot's line may come later: all of these end it with 1 or 2."""
    for kind, pause in (("companion", "100ms"), ("station", "2")):
        service = unit_of(text_of(files(kind, PROGRAM, LINE), f"handover-{kind}.service"))["Service"]
        assert service["Restart"] == "always"
        assert "RestartPreventExitStatus" not in service
        assert service["RestartSec"] == pause
    service = unit_of(text_of(files("companion", PROGRAM, LINE), "handover-companion.service"))["Service"]
    shell, option, script = shlex.split(service["ExecStopPost"])
    assert (shell, option) == ("/bin/sh", "-c")
    script = script.replace("$$", "$").replace("sleep", "echo")  # as systemd reads it
    told = {
        result: subprocess.run([shell, option, script], env={"SERVICE_RESULT": result}, capture_output=True, check=True)
        for result in ("exit-code", "success", "watchdog", "signal")
    }
    assert {result for result, ended in told.items() if ended.stdout} == {"exit-code"}


@pytest.mark.parametrize(
    ("line", "modules", "allowed"),
    [
        ("/dev/ttyTHS1,921600", [], ["char-ttyTHS rw"]),
        ("/dev/ttyACM0,115200", ["cdc_acm"], ["char-ttyACM rw"]),
        (BY_ID, ["cdc_acm", "usbserial"], ["char-ttyACM rw", "char-ttyUSB rw"]),
    ],
)
def test_a_line_that_is_plugged_in_later_is_allowed_too(line: str, modules: list[str], allowed: list[str]) -> None:
    """systemd allows what /proc/devices lists when the service starts: the driver has to be there by then."""
    lines = text_of(files("companion", PROGRAM, line), "handover-companion.service").splitlines()
    assert [each for each in lines if "modprobe" in each] == [
        f"{key}=modprobe@{module}.service" for module in modules for key in ("Wants", "After")
    ]
    assert [each.partition("=")[2] for each in lines if each.startswith("DeviceAllow")] == allowed


def test_no_template_leaves_a_gap() -> None:
    ways = (uplink("wifi", WAYS[1]), uplink("lte", WAYS[3]))
    for kind in ("companion", "station"):
        for item in files(kind, PROGRAM, LINE, ways):
            assert not re.search(r"@[A-Z_]+@", item.text), item.path


needs_systemd = pytest.mark.skipif(
    shutil.which("systemd-analyze") is None, reason="no systemd-analyze here: the units are NOT verified"
)


@needs_systemd
@pytest.mark.parametrize("name", ["companion", "station", "logs"])
def test_systemd_takes_the_units_and_finds_them_little_exposed(root: Path, name: str) -> None:
    unit = next(
        item
        for item in files("companion" if name == "logs" else name, PROGRAM, LINE)
        if item.path.name == f"handover-{name}.service"
    )
    program = below(root, PurePosixPath(PROGRAM))
    program.parent.mkdir(parents=True)
    shell = below(root, PurePosixPath("/bin/sh"))
    shell.parent.mkdir()
    for each in (program, shell):
        each.write_text("#!/bin/sh\n")
        each.chmod(0o755)
    path = below(root, unit.path)
    path.parent.mkdir(parents=True)
    path.write_text(unit.text)
    for target in ("sysinit.target", "basic.target", "multi-user.target", "shutdown.target"):
        (path.parent / target).write_text(f"[Unit]\nDescription={target}\n")
    words = ["systemd-analyze", "verify", f"--root={root}", "--man=no", "--recursive-errors=no", str(unit.path)]
    verified = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
    assert (verified.returncode, verified.stderr) == (0, "")
    words = ["systemd-analyze", "security", "--offline=true", "--no-pager", "--threshold=30", str(path)]
    judged = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
    exposure = re.search(r"Overall exposure level for \S+: ([\d.]+)", judged.stdout)
    assert exposure is not None, judged.stderr
    assert float(exposure[1]) <= 3.0
    assert judged.returncode == 0


# ---- line, network --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("device", "match", "baud"),
    [
        ("/dev/ttyTHS1,921600", 'KERNEL=="ttyTHS1"', 921600),
        ("/dev/ttyAMA0", 'KERNEL=="ttyAMA0"', 57600),
        ("serial:/dev/ttyS0:115200", 'KERNEL=="ttyS0"', 115200),
        (
            "/dev/serial/by-id/usb-Hex_ProfiCNC_CubeOrange_2A0030001851-if00,115200",
            'ENV{ID_SERIAL}=="Hex_ProfiCNC_CubeOrange_2A0030001851", ENV{ID_USB_INTERFACE_NUM}=="00"',
            115200,
        ),
        (
            "/dev/serial/by-id/usb-FTDI_FT232R_USB_UART_A5-if00-port0,57600",
            'ENV{ID_SERIAL}=="FTDI_FT232R_USB_UART_A5", ENV{ID_USB_INTERFACE_NUM}=="00", ENV{.ID_PORT}=="0"',
            57600,
        ),
        (
            "/dev/serial/by-id/usb-Moxa_UPort_1410-if01-port3",
            'ENV{ID_SERIAL}=="Moxa_UPort_1410", ENV{ID_USB_INTERFACE_NUM}=="01", ENV{.ID_PORT}=="3"',
            57600,
        ),
    ],
)
def test_the_autopilots_line_gets_a_name_of_its_own(device: str, match: str, baud: int) -> None:
    found = files("companion", PROGRAM, device)
    rule = text_of(found, "70-handover-companion.rules").splitlines()[-1]
    assert rule == f'SUBSYSTEM=="tty", {match}, SYMLINK+="handover-autopilot", {OF_THE_SERVICE}'
    assert f"--master /dev/handover-autopilot,{baud} " in text_of(found, "handover-companion.service")


def test_an_autopilot_on_the_network_needs_no_name() -> None:
    found = files("companion", PROGRAM, "tcp:127.0.0.1:5762")
    assert not [item for item in found if "udev" in str(item.path)]
    assert "--master tcp:127.0.0.1:5762 " in text_of(found, "handover-companion.service")


@pytest.mark.parametrize(
    "device",
    [
        *("ttyTHS1", "/dev/null", "/dev/../etc/passwd", "/dev/serial/by-id/x y", '/dev/tty"0', "udpin:x", ""),
        *("tcp:a b:5762", "tcp:%h:5762", "tcp:$X:5762", "tcp:x\n[Install]:5762", "udpout:10.1.0.9:14550@wwan0"),
    ],
)
def test_a_device_that_is_none_is_bad_usage(device: str, root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert install(root, "companion", "--device", device) == 2
    assert capsys.readouterr().err.startswith("handover install: --device")
    assert not root.exists()


def radios(path: Path, *links: str, kind: str = "companion") -> Path:
    """A configuration with these links to its stations, or to its vehicle."""
    listed = ", ".join(f'"{link}"' for link in links)
    path.parent.mkdir(parents=True, exist_ok=True)
    if kind == "companion":
        path.write_text(re.sub(r"links = \[.*\]", f"links = [{listed}]", usable(path)))
    else:
        vehicle = f'[[vehicle]]\nname = "drone-1"\nsysid = 1\nallow_unsigned = true\nlinks = [{listed}]\n'
        journal = 'journal = "/var/lib/handover/j.jsonl"'
        path.write_text(f'[station]\nname = "GCSA"\nsysid = 251\n{journal}\n{vehicle}')
    return path


@pytest.mark.parametrize("kind", ["companion", "station"])
@pytest.mark.parametrize("there", [True, False], ids=["is there", "is given"])
def test_radios_of_the_configuration_are_lines_of_the_service(
    kind: str, there: bool, root: Path, tmp_path: Path
) -> None:
    """A link to a station may be a serial line as well as the autopilot's is."""
    name = "vehicle.toml" if kind == "companion" else "station.toml"
    config = radios((root / "etc/handover" if there else tmp_path) / name, f"{BY_ID},57600", "tcp:x:1", kind=kind)
    assert install(root, kind, *(() if there else ("--config", str(config)))) == 0
    unit = (root / f"etc/systemd/system/handover-{kind}.service").read_text()
    allowed = re.findall("DeviceAllow=(.*) rw", unit)
    assert allowed == [*(["char-ttyACM", "char-ttyTHS"] if kind == "companion" else ["char-ttyACM"]), "char-ttyUSB"]
    rules = (root / f"etc/udev/rules.d/70-handover-{kind}.rules").read_text().splitlines()[1:]
    radio = 'ENV{ID_SERIAL}=="FTDI_FT232R_USB_UART_A5", ENV{ID_USB_INTERFACE_NUM}=="00", ENV{.ID_PORT}=="0", '
    assert f'SUBSYSTEM=="tty", {radio}{OF_THE_SERVICE}' in rules
    assert len(rules) == (2 if kind == "companion" else 1)


def test_a_radio_that_udev_could_not_find_is_bad_input(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = radios(tmp_path / "vehicle.toml", "/dev/radio,57600")
    assert install(root, "companion", "--config", str(config)) == 2
    assert "links /dev/radio,57600: a line is /dev/ttyNAME" in capsys.readouterr().err
    assert not root.exists()


def sections(text: str) -> list[tuple[str, dict[str, str]]]:
    """A file of networkd, in which a section may stand more than once."""
    found: list[tuple[str, dict[str, str]]] = []
    for line in text.splitlines():
        if line.startswith("["):
            found.append((line.strip("[]"), {}))
        elif line and not line.startswith("#"):
            key, _equals, value = line.partition("=")
            found[-1][1][key] = value
    return found


def test_each_way_has_a_routing_table_of_its_own() -> None:
    found = files("companion", PROGRAM, LINE, (uplink("wifi", WAYS[1]), uplink("lte", WAYS[3])))
    assert sections(text_of(found, "20-handover-wifi.network")) == [
        ("Match", {"Name": "wlan0"}),
        ("Link", {"RequiredForOnline": "no"}),
        ("Network", {"Address": "192.168.1.20/24"}),
        ("Route", {"Destination": "192.168.1.0/24", "Scope": "link", "Table": "101"}),
        ("Route", {"Gateway": "192.168.1.1", "Table": "101"}),
        ("RoutingPolicyRule", {"OutgoingInterface": "wlan0", "Table": "101", "Priority": "1001"}),
        ("RoutingPolicyRule", {"From": "192.168.1.20", "Table": "101", "Priority": "1001"}),
        ("RoutingPolicyRule", {"Table": "101", "Priority": "33101"}),
    ]
    assert sections(text_of(found, "20-handover-lte.network")) == [
        ("Match", {"Name": "wwan0"}),
        ("Link", {"RequiredForOnline": "no"}),
        ("Network", {"DHCP": "ipv4"}),
        ("DHCPv4", {"RouteTable": "102"}),
        ("RoutingPolicyRule", {"OutgoingInterface": "wwan0", "Table": "102", "Priority": "1002"}),
        ("RoutingPolicyRule", {"Table": "102", "Priority": "33102"}),
    ]


def as_ip_does_it(texts: list[str]) -> str:
    """What networkd makes of these files, in words of ip(8), up to `main` as it is on a machine."""
    lines = []
    for text in texts:
        found = sections(text)
        name, address = dict(found)["Match"]["Name"], dict(found)["Network"]["Address"]
        lines += [f"ip link add {name} type bridge", f"ip link set {name} up", f"ip addr add {address} dev {name}"]
        for section, keys in found:
            table = f"table {keys.get('Table')}"
            if section == "Route":
                where = f"default via {keys['Gateway']}" if "Gateway" in keys else f"{keys['Destination']} scope link"
                on_link = "onlink" if keys.get("GatewayOnLink") == "yes" else ""
                lines.append(f"ip route add {where} dev {name} {table} {on_link}")
            elif section == "RoutingPolicyRule":
                what = f"oif {keys['OutgoingInterface']}" if "OutgoingInterface" in keys else ""
                what += f"from {keys['From']}" if "From" in keys else ""
                lines.append(f"ip rule add {what} {table} priority {keys['Priority']}")
    return "\n".join(lines)


NETWORK_OF_ITS_OWN = ["unshare", "--user", "--map-root-user", "--net", "sh", "-ec"]


def has_networks() -> bool:
    if not all(shutil.which(name) for name in ("unshare", "ip")):
        return False
    words = [*NETWORK_OF_ITS_OWN, "ip link add x type bridge; ip rule add oif x table 7"]
    return subprocess.run(words, capture_output=True, check=False).returncode == 0


@pytest.mark.skipif(not has_networks(), reason="no network of our own here: the routes are NOT tried")
@pytest.mark.parametrize(
    ("asked", "by", "gateway"),
    [
        ("10.9.9.9 oif wlan0", "wlan0", "192.168.1.1"),
        ("10.9.9.9 from 192.168.1.20", "wlan0", "192.168.1.1"),
        ("10.9.9.9 oif wwan0", "wwan0", "10.64.0.1"),
        ("10.9.9.9 from 10.64.0.7", "wwan0", "10.64.0.1"),
        ("10.9.9.9", "wlan0", "192.168.1.1"),
        ("192.168.1.10", "wlan0", None),
        ("192.168.1.10 oif wlan0", "wlan0", None),
        ("192.168.1.10 from 192.168.1.20", "wlan0", None),
        ("192.168.1.10 oif wwan0", "wwan0", "10.64.0.1"),
        ("192.168.1.10 from 10.64.0.7", "wwan0", "10.64.0.1"),
    ],
)
def test_the_kernel_sends_what_is_bound_to_a_way_by_that_way(asked: str, by: str, gateway: str | None) -> None:
    """And whoever is in the same network without asking its gateway, which may be none."""
    ways = (uplink("wifi", WAYS[1]), uplink("lte", "wwan0=10.64.0.7/32,10.64.0.1"))
    texts = [item.text for item in files("companion", PROGRAM, LINE, ways) if item.path.suffix == ".network"]
    words = [*NETWORK_OF_ITS_OWN, f"{as_ip_does_it(texts)}\nip route get {asked}"]
    found = subprocess.run(words, capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stderr
    assert f" dev {by} " in found.stdout
    assert re.findall(r" via (\S+)", found.stdout) == ([] if gateway is None else [gateway])


def test_two_ways_have_two_interfaces(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert install(root, "companion", "--wifi", "wlan0", "--lte", "wlan0=1.2.3.4/24") == 2
    assert "--wifi and --lte are both wlan0" in capsys.readouterr().err
    assert not root.exists()


@pytest.mark.parametrize(
    "text",
    [
        *("", "a b", "averyverylonginterface", "wlan0=", "wlan0=1.2.3.4", "wlan0=1.2.3.4/33", "wlan0=1.2.3.4/24,x"),
        *("wlan0=1.2.3.4/24,1.2.4.1", "wlan0=1.2.3.4/24,1.2.3.4", "wl\u00e4n0"),
    ],
)
def test_a_way_that_is_none_is_bad_usage(text: str, root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert install(root, "companion", "--wifi", text) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"handover install: --wifi {text}: INTERFACE")
    assert error.count("\n") == 1
    assert not root.exists()


# ---- what is written ------------------------------------------------------------------------------------------------


def test_everything_lies_below_the_root_with_its_mode_and_is_taken_back(
    root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert install(root, "companion", *WAYS) == 0
    assert "systemctl enable --now handover-companion" in capsys.readouterr().out
    configuration = root / "etc/handover/vehicle.toml"
    assert configuration.stat().st_mode & 0o777 == 0o640
    text = configuration.read_text()
    assert 'journal = "/var/lib/handover/handover.jsonl"' in text
    assert 'state = "/var/lib/handover/state"' in text
    written = everything(root)
    assert set(written) == {
        "etc/handover/installed.json",
        "etc/handover/vehicle.toml",
        "etc/systemd/network/20-handover-lte.network",
        "etc/systemd/network/20-handover-wifi.network",
        "etc/systemd/system/handover-companion.service",
        "etc/systemd/system/handover-logs.service",
        "etc/systemd/system/handover-logs.timer",
        "etc/systemd/system/systemd-time-wait-sync.service.d/10-handover.conf",
        "etc/sysusers.d/handover.conf",
        "etc/tmpfiles.d/handover.conf",
        "etc/udev/rules.d/70-handover-companion.rules",
    }
    assert install(root, "companion", *WAYS) == 0
    assert everything(root) == written, "a second time changes nothing"
    assert run("uninstall", "companion", "--root", str(root)) == 0
    assert set(everything(root)) == {"etc/handover/vehicle.toml"}
    assert run("uninstall", "companion", "--root", str(root)) == 1
    assert "is not installed" in capsys.readouterr().err


def test_what_is_asked_for_no_more_is_taken_back(root: Path) -> None:
    assert install(root, "companion", *WAYS) == 0
    assert install(root, "companion", *WAYS[:2]) == 0
    assert not (root / "etc/systemd/network/20-handover-lte.network").exists()
    assert (root / "etc/systemd/network/20-handover-wifi.network").exists()


def test_what_both_need_stays_until_the_last_one_goes(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert install(root) == install(root, "station") == 0
    kept = everything(root)
    assert run("uninstall", "companion", "--root", str(root), "--purge") == 1
    assert "handover-station needs configuration, keys and state too" in capsys.readouterr().err
    assert everything(root) == kept
    assert run("uninstall", "companion", "--root", str(root)) == 0
    assert (root / "etc/sysusers.d/handover.conf").exists()
    assert run("uninstall", "station", "--root", str(root), "--purge") == 0
    assert everything(root) == {}


@pytest.mark.parametrize("before", [True, False], ids=["somebody else's", "changed since"])
def test_what_somebody_has_changed_is_neither_written_over_nor_deleted(
    root: Path, before: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    unit = root / "etc/systemd/system/handover-companion.service"
    if before:
        unit.parent.mkdir(parents=True)
    else:
        assert install(root) == 0
    unit.write_text("[Unit]\n")
    kept = everything(root)
    assert install(root) == 1
    assert "handover-companion.service: nothing written (--force" in capsys.readouterr().err
    assert everything(root) == kept
    if not before:
        assert run("uninstall", "companion", "--root", str(root)) == 1
        assert "and left: /etc/systemd/system/handover-companion.service" in capsys.readouterr().err
        assert unit.read_text() == "[Unit]\n"
        assert run("uninstall", "companion", "--root", str(root), "--purge") == 1
        assert (root / "etc/handover/vehicle.toml").exists(), "nothing is purged while something was left"
        assert run("uninstall", "companion", "--root", str(root), "--force") == 0
        assert not unit.exists()
    assert install(root, "companion", "--force") == 0
    assert "Type=notify" in unit.read_text()


def usable(path: Path) -> str:
    """A configuration whose journal and state lie where the service may write; its text."""
    text = vehicle_file(path, 14550).read_text()
    text = re.sub(r'journal = ".*?"', 'journal = "/var/lib/handover/j.jsonl"', text)
    text = text.replace("[vehicle]", '[vehicle]\nstate = "/var/lib/handover/state"', 1)
    path.write_text(text)
    return text


def with_keys(path: Path, named: str = "keys/GCSA.key", more: str = "") -> str:
    """The same with a key for its station, and one that it does not name; its text."""
    text = usable(path).replace("sysid = 251", f'sysid = 251\nkey = "{named}"')
    text = text.replace("[vehicle]", f"[vehicle]\n{more}", 1)
    path.write_text(text)
    (path.parent / "keys").mkdir(mode=0o700, exist_ok=True)
    for name in ("GCSA", "another"):
        write_key(path.parent / "keys" / f"{name}.key", bytes(range(32)))
    return text


def test_a_configuration_comes_with_the_keys_that_it_names(tmp_path: Path, root: Path) -> None:
    given = tmp_path / "mine" / "handover.toml"
    given.parent.mkdir()
    text = with_keys(given)
    assert install(root, "companion", "--config", str(given)) == 0
    assert (root / "etc/handover/vehicle.toml").read_text() == text
    key = root / "etc/handover/keys/GCSA.key"
    assert key.read_bytes() == (given.parent / "keys" / "GCSA.key").read_bytes()
    assert key.stat().st_mode & 0o777 == 0o600
    assert key.parent.stat().st_mode & 0o777 == 0o750
    assert list(key.parent.iterdir()) == [key], "no more secrets than are needed"
    loaded = load_vehicle(root / "etc/handover/vehicle.toml")
    assert loaded.journal == Path("/var/lib/handover/j.jsonl")
    assert loaded.stations[0].key == key


def test_journal_and_state_named_relative_to_the_file_lie_where_the_service_may_write(
    tmp_path: Path, root: Path
) -> None:
    """The fault: the files that `handover init` writes were refused."""
    given = tmp_path / "mine" / "handover.toml"
    given.parent.mkdir()
    text = with_keys(given)
    text = text.replace('"/var/lib/handover/', '"')
    assert 'journal = "j.jsonl"' in text
    assert 'state = "state"' in text
    given.write_text(text)
    assert install(root, "companion", "--config", str(given)) == 0
    loaded = load_vehicle(root / "etc/handover/vehicle.toml")
    assert loaded.journal == Path("/var/lib/handover/j.jsonl")
    assert loaded.state == Path("/var/lib/handover/state")
    assert given.read_text() == text


@pytest.mark.parametrize("place", ["/srv/j.jsonl", "../j.jsonl"])
def test_a_journal_that_the_service_cannot_write_is_refused(
    place: str, tmp_path: Path, root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = tmp_path / "handover.toml"
    given.write_text(usable(given).replace("/var/lib/handover/j.jsonl", place))
    assert install(root, "companion", "--config", str(given)) == 2
    assert "the service may write below /var/lib/handover alone" in capsys.readouterr().err
    assert not root.exists()


@pytest.mark.parametrize(
    ("named", "more", "error"),
    [
        ("../GCSA.key", "", "GCSA.key: keys lie in keys/ beside that file, or in /etc/handover/keys"),
        ("/srv/GCSA.key", "", "key /srv/GCSA.key: keys lie in keys/"),
        ("keys/none.key", "", "none.key"),
        ("keys/GCSA.key", 'mission = "missions/delivery"', "put it where the service can read it"),
        ("keys/GCSA.key", 'mission = "/home/me/delivery"', "mission /home/me/delivery: put it where"),
    ],
)
def test_what_the_service_would_not_find_is_refused_before_anything_is_written(
    named: str, more: str, error: str, tmp_path: Path, root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = tmp_path / "handover.toml"
    with_keys(given, named, more)
    assert install(root, "companion", "--config", str(given)) == 2
    assert error in capsys.readouterr().err
    assert not root.exists()


LAYOUT = "".join(
    f'[[field]]\nfield = "{name}"\ntype = "double"\nunit = "{unit}"\noffset = {8 * number}\n'
    for number, (name, unit) in enumerate(
        [("time", "s"), ("lat", "rad"), ("lon", "rad"), ("vel_north", "m/s"), ("vel_east", "m/s")]
    )
)


def with_layout(given: Path, name: str) -> None:
    text = with_keys(given)
    given.write_text(f'{text}\n[position]\nsource = "box"\nbox = "tcp:10.0.0.9:4001"\nlayout = "{name}"\n')


def test_a_configuration_comes_with_the_layout_of_its_position_box(tmp_path: Path, root: Path) -> None:
    given = tmp_path / "mine" / "handover.toml"
    given.parent.mkdir()
    (given.parent / "acme.toml").write_text(LAYOUT)
    with_layout(given, "acme.toml")
    assert install(root, "companion", "--config", str(given)) == 0
    there = root / "etc/handover/acme.toml"
    assert there.read_text() == LAYOUT
    assert there.stat().st_mode & 0o777 == 0o640
    assert load_vehicle(root / "etc/handover/vehicle.toml").position.layout.size == 40


@pytest.mark.parametrize(
    ("name", "error"),
    [
        ("layouts/acme.toml", "acme.toml: put it beside that file, or where the service can read it"),
        ("vehicle.toml", "vehicle.toml is a configuration's name there: give it another name"),
    ],
)
def test_a_layout_that_the_service_would_not_find_is_refused(
    tmp_path: Path, root: Path, capsys: pytest.CaptureFixture[str], name: str, error: str
) -> None:
    given = tmp_path / "handover.toml"
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text(LAYOUT)
    with_layout(given, name)
    assert install(root, "companion", "--config", str(given)) == 2
    assert error in capsys.readouterr().err
    assert not root.exists()


def test_a_file_that_cannot_be_put_in_place_leaves_no_draft(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The fault: the draft stayed, and of a key it holds the key."""

    def refuse(_source: Path, _target: Path) -> Path:
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(Path, "replace", refuse)
    key = Item(PurePosixPath("/etc/handover/keys/GCSA.key"), "0" * 64 + "\n", 0o600)
    with pytest.raises(OSError, match="Input/output error"):
        installing._write(below(root, key.path), key)
    assert everything(root) == {}


def test_keys_and_missions_that_are_in_their_places_already_are_named_by_them(tmp_path: Path, root: Path) -> None:
    given = tmp_path / "handover.toml"
    with_keys(given, "/etc/handover/keys/GCSA.key", 'mission = "/var/lib/handover/missions/delivery"')
    assert install(root, "companion", "--config", str(given)) == 0
    assert not (root / "etc/handover/keys").exists()


def test_another_configuration_takes_the_place_of_the_one_there_by_force_alone(
    tmp_path: Path, root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert install(root) == 0
    there = root / "etc/handover/vehicle.toml"
    sample = there.read_text()
    given = tmp_path / "handover.toml"
    text = with_keys(given)
    capsys.readouterr()
    assert install(root, "companion", "--config", str(given)) == 0
    assert there.read_text() == sample
    assert "kept     /etc/handover/vehicle.toml (and not what would be written now)" in capsys.readouterr().out
    assert install(root, "companion", "--config", str(given), "--force") == 0
    assert there.read_text() == text
    assert install(root, "companion", "--force") == 0
    assert there.read_text() == text, "a sample takes nothing's place"
    assert run("uninstall", "companion", "--root", str(root)) == 0
    assert there.read_text() == text, "nor is it taken back"


def test_a_key_is_not_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = tmp_path / "handover.toml"
    with_keys(given)
    assert run("install", "companion", "--device", LINE, "--config", str(given), "--print") == 0
    shown = capsys.readouterr().out
    assert "/etc/handover/keys/GCSA.key" in shown
    assert bytes(range(32)).hex() not in shown.lower()


def test_a_configuration_that_cannot_be_used_is_not_installed(
    tmp_path: Path, root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = vehicle_file(tmp_path / "handover.toml", 14550)
    assert install(root, "companion", "--config", str(given)) == 2
    assert "the service may write below /var/lib/handover alone" in capsys.readouterr().err
    given.write_text("[vehicle]\nnmae = 1\n")
    assert install(root, "companion", "--config", str(given)) == 2
    assert str(given) in capsys.readouterr().err
    assert not root.exists()


def test_printing_writes_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run("install", "companion", "--device", LINE, *WAYS, "--print") == 0
    shown = capsys.readouterr().out
    for item in files("companion", str(Path(sys.prefix) / "bin" / "handover"), LINE, (uplink("wifi", WAYS[1]),)):
        assert f"# {item.path}  (mode 0644)" in shown
        assert item.text in shown
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("program", ["handover", "/opt/hand over/bin/handover", "/opt/x\n[Install]", ""])
def test_a_program_is_a_plain_path(program: str, root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["install", "companion", "--device", LINE, "--root", str(root), "--program", program]
    assert run(*words) == (2 if program else 0)
    assert ("--program" in capsys.readouterr().err) is bool(program)


def test_a_companion_without_a_line_is_bad_usage(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("install", "companion", "--root", str(root)) == 2
    assert "--device is missing" in capsys.readouterr().err


def test_a_root_that_cannot_be_written_to_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "root").write_text("a file")
    assert install(tmp_path / "root") == 1
    error = capsys.readouterr().err
    assert error.startswith("handover install: ")
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    "text",
    [
        *("{", "[]", "null", '{"companion": []}', '{"companion": {"/etc/x": 1}}', "\ufeff"),
        '{"companion": {"/bin/sh": "00"}}',
        '{"companion": {"/etc/../bin/sh": "00"}}',
        '{"companion": {"etc/x": "00"}}',
    ],
)
def test_a_list_that_cannot_be_read_is_no_list(text: str, root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert install(root) == 0
    (root / "etc/handover/installed.json").write_text(text)
    kept = everything(root)
    for words in (("uninstall", "companion"), ("install", "companion", "--device", LINE)):
        assert run(*words, "--root", str(root)) == 1
        assert "installed.json cannot be read: delete it, and install with --force" in capsys.readouterr().err
    assert everything(root) == kept
    (root / "etc/handover/installed.json").unlink()
    assert install(root, "companion", "--force") == 0
    assert run("uninstall", "companion", "--root", str(root)) == 0


def test_an_installation_that_was_cut_short_can_be_taken_back(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (root / "etc/udev/rules.d").mkdir(parents=True)
    in_the_way = root / "etc/udev/rules.d/.70-handover-companion.rules.new"
    in_the_way.mkdir()
    assert install(root) == 1
    assert "70-handover-companion.rules.new" in capsys.readouterr().err
    assert (root / "etc/systemd/system/handover-companion.service").exists()
    assert run("uninstall", "companion", "--root", str(root)) == 0
    assert everything(root) == {}


@pytest.mark.skipif(
    os.geteuid() != 0 or not all(shutil.which(f"systemd-{name}") for name in ("sysusers", "tmpfiles")),
    reason="not root, or no systemd-sysusers and systemd-tmpfiles: whose the files become is NOT tried",
)
def test_the_user_is_made_and_the_files_become_whose_they_should_be(root: Path, tmp_path: Path) -> None:
    given = tmp_path / "handover.toml"
    with_keys(given)
    assert install(root, "companion", "--config", str(given)) == 0
    for _ in range(2):  # at each start of the computer
        for words in (["sysusers"], ["tmpfiles", "--create"]):
            config = below(root, PurePosixPath(f"/etc/{words[0]}.d/handover.conf"))
            done = subprocess.run(
                [f"systemd-{words[0]}", f"--root={root}", *words[1:], str(config)],
                capture_output=True,
                text=True,
                check=False,
            )
            assert done.returncode == 0, done.stderr
        name, _x, uid, gid, *_rest = (root / "etc/passwd").read_text().splitlines()[-1].split(":")
        assert name == "handover"
        modes = {}
        for path in ("etc/handover", "etc/handover/vehicle.toml", "etc/handover/keys", "etc/handover/keys/GCSA.key"):
            status = (root / path).stat()
            modes[path] = (f"{status.st_mode & 0o777:o}", status.st_uid == int(uid), status.st_gid == int(gid))
        assert modes == {
            "etc/handover": ("750", False, True),
            "etc/handover/vehicle.toml": ("640", False, True),
            "etc/handover/keys": ("750", False, True),
            "etc/handover/keys/GCSA.key": ("600", True, True),
        }
    assert (root / "var/lib/handover/flights").stat().st_uid == int(uid)


# ---- on the machine itself ------------------------------------------------------------------------------------------


@pytest.fixture
def machine(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that is taken for this machine, and programs that note how they were called; their notes."""
    programs, notes = tmp_path / "programs", tmp_path / "notes"
    programs.mkdir()
    for name in ("systemctl", "systemd-sysusers", "systemd-tmpfiles", "udevadm"):
        program = programs / name
        program.write_text(f'#!/bin/sh\necho "${{0##*/}} $*" >> {notes}\nfor last; do :; done\n')
        if name.startswith("systemd-"):  # as those do
            program.write_text(program.read_text() + f'test -e "{root}$last"\n')
        program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{programs}:/bin:/usr/bin")
    monkeypatch.setattr(installing, "_HERE", root)
    monkeypatch.setattr(installing, "_HIDDEN", ("/home",))
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    return notes


def noted(notes: Path) -> list[str]:
    lines = notes.read_text().splitlines()
    notes.unlink()
    return lines


def test_what_reads_the_files_is_run_behind_it_and_what_reads_them_no_more_as_well(root: Path, machine: Path) -> None:
    assert run("install", "companion", "--device", LINE) == 0
    assert noted(machine) == [
        "systemd-sysusers /etc/sysusers.d/handover.conf",
        "systemd-tmpfiles --create /etc/tmpfiles.d/handover.conf",
        "udevadm control --reload",
        "systemctl daemon-reload",
        "udevadm trigger --subsystem-match=tty --action=change",
    ]
    assert run("uninstall", "companion", "--purge") == 0
    assert noted(machine) == [
        "systemctl disable --now handover-companion.service handover-logs.timer",
        "udevadm control --reload",
        "systemctl daemon-reload",
    ]
    assert everything(root) == {}


def test_a_program_that_fails_is_named(root: Path, machine: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (root.parent / "programs" / "udevadm").write_text("#!/bin/sh\nexit 1\n")
    assert run("install", "companion", "--device", LINE) == 1
    assert "this failed: udevadm control --reload" in capsys.readouterr().err


def test_whoever_is_not_root_is_told_what_to_type(
    root: Path, machine: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    ours = Path(sys.prefix) / "bin" / "handover"
    for words in (["install", "companion", "--device", "tcp:a b:1"], ["uninstall", "station", "--force"]):
        assert run(*words) == 1
        typed = shlex.split(capsys.readouterr().err.partition("only root may do that here: ")[2])
        assert typed == ["sudo", str(ours), *words]
    assert run("install", "companion", "--device", LINE, "--print") == 0
    assert not root.exists()
    assert not machine.exists()


@pytest.mark.parametrize("there", [True, False])
def test_a_program_that_the_service_could_not_run_is_refused(
    there: bool, root: Path, machine: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    program = root.parent / "bin" / "handover"
    if there:
        program.parent.mkdir()
        program.symlink_to("/bin/sh")
        monkeypatch.setattr(installing, "_HIDDEN", (str(program.parent),))
    assert run("install", "companion", "--device", LINE, "--program", str(program)) == 2
    error = capsys.readouterr().err
    assert ("is hidden from the service: install it in /opt/handover" if there else "there is no such program") in error
    assert not root.exists()


@pytest.mark.parametrize("value", ["-1", "3601", "nan", "soon"])
def test_a_time_out_of_range_is_bad_usage(value: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("companion", "--master", "x", "--restarts-within", value) == 2
    assert "--restarts-within" in capsys.readouterr().err
