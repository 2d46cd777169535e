# SPDX-License-Identifier: GPL-3.0-or-later

"""Whether a link is inside a tunnel, as the system's routes say it, and what that means to those who read it."""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from mavproxy_handover.doctor import tunnels as module
from mavproxy_handover.doctor.finding import Finding, Level
from mavproxy_handover.doctor.routes import Interface, interface_named, interface_of, interface_to
from mavproxy_handover.doctor.tunnels import tunnels
from sitl.hosts import namespaces, tunnel

KEY = Path("keys/GCSA.key")


def companion(*stations: tuple[str, Path | None, tuple[str, ...]]) -> Any:
    """A context whose vehicle has these stations: name, key, links."""
    entries = [
        SimpleNamespace(station=SimpleNamespace(name=name), key=key, links=links) for name, key, links in stations
    ]
    return SimpleNamespace(vehicle=SimpleNamespace(stations=entries), station=None, master=None)


def found(context: Any, monkeypatch: pytest.MonkeyPatch, *interfaces: Interface | None) -> list[Finding]:
    """What is said if the routes lead to these interfaces, one after the other."""
    answers = iter(interfaces)
    monkeypatch.setattr(module, "interface_to", lambda _address, _way="": next(answers))
    return list(tunnels(context))


@pytest.mark.parametrize(
    ("interface", "key", "level", "says"),
    [
        (
            Interface("wg0", "wireguard"),
            KEY,
            Level.OK,
            "inside WireGuard (wg0): others on the way to the end of the tunnel cannot read it; signed with the key of "
            "GCSA: no other program inside the tunnel can speak as GCSA",
        ),
        (
            Interface("wg0", "wireguard"),
            None,
            Level.OK,
            "inside WireGuard (wg0): others on the way to the end of the tunnel cannot read it; not signed: any "
            "program inside the tunnel, and a neighbour that forges its address, can speak as GCSA",
        ),
        (
            Interface("eth0", ""),
            KEY,
            Level.OK,
            "not inside a tunnel (leaves by eth0): others on the way can read it; signed with the key of GCSA: they "
            "cannot speak as GCSA",
        ),
        (
            Interface("wlan0", ""),
            None,
            Level.WARNING,
            "not inside a tunnel (leaves by wlan0): others on the way can read it; not signed: they can speak as GCSA",
        ),
        (
            Interface("tun0", "tun"),
            KEY,
            Level.OK,
            "inside a tunnel of a program (tun0): whether it encrypts is not known here; signed with the key of GCSA: "
            "others cannot speak as GCSA",
        ),
        (
            Interface("gre1", "gre"),
            None,
            Level.WARNING,
            "inside a tunnel that does not encrypt (gre1, gre): others on the way can read it; not signed: they can "
            "speak as GCSA",
        ),
        (
            Interface("ppp0", "ppp"),
            KEY,
            Level.OK,
            "leaves by a PPP line (ppp0): whether that is a modem's call or a tunnel is not known here; signed with "
            "the key of GCSA: others cannot speak as GCSA",
        ),
        (
            Interface("ipsec0", "xfrm"),
            KEY,
            Level.OK,
            "inside IPsec (ipsec0): whether it encrypts is not known here; signed with the key of GCSA: others "
            "cannot speak as GCSA",
        ),
        (
            Interface("lo", ""),
            None,
            Level.OK,
            "stays on this machine; not signed: any program here can speak as GCSA",
        ),
        (
            None,
            KEY,
            Level.OK,
            "whether it is inside a tunnel is not known: there is no route to 10.9.1.2 now; signed with the key of "
            "GCSA: others cannot speak as GCSA",
        ),
    ],
)
def test_one_sentence_says_the_tunnel_and_the_signature(
    interface: Interface | None, key: Path | None, level: Level, says: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (finding,) = found(companion(("GCSA", key, ("udpout:10.9.1.2:14550",))), monkeypatch, interface)
    assert (finding.what, finding.level, finding.found) == ("GCSA, udpout:10.9.1.2:14550", level, says)
    assert bool(finding.do) is (level is Level.WARNING)
    assert "docs/encryption.md" in finding.do or level is Level.OK
    assert finding.looked


def test_a_link_that_waits_to_be_called_is_not_known(monkeypatch: pytest.MonkeyPatch) -> None:
    (finding,) = found(companion(("GCSA", KEY, ("udpin:0.0.0.0:14550",))), monkeypatch)
    assert finding.found == (
        "whether it is inside a tunnel is not known: it waits to be called, on any address of this machine; signed "
        "with the key of GCSA: others cannot speak as GCSA"
    )


def test_a_link_that_waits_on_one_address_is_known_by_its_interface(monkeypatch: pytest.MonkeyPatch) -> None:
    owners = {"10.9.1.1": Interface("wg0", "wireguard")}
    monkeypatch.setattr(module, "interface_of", owners.get)
    links = ("udpin:10.9.1.1:14550", "tcpin:10.9.9.9:5760")
    said = [finding.found for finding in tunnels(companion(("GCSA", KEY, links)))]
    assert said[0] == (
        "waits at an address of WireGuard (wg0): others before the end of the tunnel cannot read "
        "its packets; only a firewall blocks packets from outside; signed with the key of GCSA: others cannot "
        "speak as GCSA"
    )
    assert said[1].startswith(
        "whether it is inside a tunnel is not known: it waits to be called on 10.9.9.9, whose interface is not known;"
    )


def test_a_serial_line_has_no_tunnel(monkeypatch: pytest.MonkeyPatch) -> None:
    (finding,) = found(companion(("GCSA", None, ("/dev/ttyUSB0,57600",))), monkeypatch)
    assert finding.level is Level.WARNING
    assert finding.found == (
        "not inside a tunnel (a serial line): others who receive it can read it; not signed: they can speak as GCSA"
    )


def test_the_interface_that_a_link_names_counts_and_no_route(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[str, str]] = []

    def answer(address: str, way: str = "") -> Interface:
        asked.append((address, way))
        return Interface("wg-lte", "wireguard")

    monkeypatch.setattr(module, "interface_to", answer)
    (finding,) = tunnels(companion(("GCSA", KEY, ("udpout:10.9.2.2:14550@wg-lte",))))
    assert asked == [("10.9.2.2", "wg-lte")]
    assert finding.found.startswith("inside WireGuard (wg-lte)")


def test_each_link_of_a_station_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    context = companion(("GCSA", KEY, ("udpout:10.9.1.2:14550", "udpout:100.64.1.2:14550")))
    said = [each.found.partition(":")[0] for each in found(context, monkeypatch, *WG_AND_LTE)]
    assert said == ["inside WireGuard (wg0)", "not inside a tunnel (leaves by wwan0)"]


WG_AND_LTE = (Interface("wg0", "wireguard"), Interface("wwan0", "wwan"))


def test_a_station_is_told_of_its_vehicle_and_its_ground_link(monkeypatch: pytest.MonkeyPatch) -> None:
    vehicle = SimpleNamespace(called="drone-1", key=KEY, links=("udpout:10.9.1.1:14550",))
    peer = SimpleNamespace(station=SimpleNamespace(name="GCSB"), link="udpout:192.168.10.128:15551")
    station = SimpleNamespace(vehicles=[vehicle], peers=[peer], ground_key=None)
    context: Any = SimpleNamespace(vehicle=None, station=station, master=None)
    first, second = found(context, monkeypatch, Interface("wg0", "wireguard"), Interface("eno1", ""))
    assert first.what == "drone-1, udpout:10.9.1.1:14550"
    assert first.found.endswith("no other program inside the tunnel can speak as drone-1")
    assert second.what == "GCSB, udpout:192.168.10.128:15551"
    assert second.level is Level.WARNING


# ---- the system's own word ------------------------------------------------------------------------------------------

linux = pytest.mark.skipif(sys.platform != "linux", reason="routes are asked of Linux")


@linux
def test_the_loopback_address_leads_to_lo() -> None:
    assert interface_to("127.0.0.1") == Interface("lo", "")
    assert interface_to("::1") == Interface("lo", "")


@linux
def test_an_interface_that_is_named_is_looked_up_by_its_name() -> None:
    assert interface_named("lo") == Interface("lo", "")
    assert interface_named("not-there") is None
    assert interface_to("127.0.0.1", "not-there") is None


@linux
def test_the_own_address_that_a_link_leaves_by_is_no_interface() -> None:
    assert interface_to("127.0.0.1", "127.0.0.1") == Interface("lo", "")


@linux
def test_an_own_address_leads_to_its_interface() -> None:
    assert interface_of("127.0.0.1") == Interface("lo", "")
    assert interface_of("192.0.2.77") is None


def test_where_the_system_has_no_such_answers_it_is_not_known(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_such_family(*_words: Any) -> Any:
        raise OSError("no such family")

    monkeypatch.setattr(socket, "socket", no_such_family)
    assert interface_to("192.0.2.1") is None


WHY_NOT = namespaces.cannot() or tunnel.cannot() or ("" if shutil.which("wireguard-go") else "no wireguard-go")
#: on the mission computer of the bench, GCSA inside the tunnel and GCSB outside: as root, and as nobody
BENCH = """
import json, os, subprocess, sys
from contextlib import ExitStack
from pathlib import Path
from sitl.hosts import tunnel
from sitl.hosts.namespaces import Namespaces, inside
from sitl.hosts.plan import plan
from sitl.run.processes import Processes

ask = "import json, os, sys; from mavproxy_handover.doctor.routes import interface_to; os.setuid(int(sys.argv[1]))\\n"
ask += "found = [interface_to(a, w) for a, w in (('10.9.1.2', ''), ('10.9.2.2', 'wg-lte'), ('192.168.10.128', ''),"
ask += " ('100.64.2.2', ''), ('192.0.2.1', ''))]\\n"
ask += "print(json.dumps([each and [each.name, each.kind] for each in found]))"
said = {}
with ExitStack() as stack:
    made = stack.enter_context(Namespaces(plan(["GCSA", "GCSB"], ["GCSA"])))
    processes = stack.enter_context(Processes())
    said["maker"] = tunnel.build(made, processes, Path("tunnels").resolve())
    for uid in ("0", "65534"):
        done = subprocess.run([*inside("mc"), sys.executable, "-c", ask, uid], capture_output=True, text=True)
        said[uid] = json.loads(done.stdout)
print(json.dumps(said))
"""


@pytest.mark.process
@pytest.mark.skipif(bool(WHY_NOT), reason=f"a tunnel to look at: {WHY_NOT}")
def test_a_real_tunnel_is_found_with_and_without_rights(tmp_path: Path) -> None:
    root = Path(__file__).resolve().parents[2]
    done = subprocess.run(
        [sys.executable, "-c", BENCH],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(root)},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout.splitlines()[-1])
    plain = [["eth0", "veth"], ["wwan0", "veth"], None]
    assert said["0"] == [["wg-wired", "wireguard"], ["wg-lte", "wireguard"], *plain]
    # wireguard-go has a TUN device; that it is WireGuard is seen by who may look for its socket
    kind = "tun" if said["maker"] == "wireguard-go" else "wireguard"
    assert said["65534"] == [["wg-wired", kind], ["wg-lte", kind], *plain]
