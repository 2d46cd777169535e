# SPDX-License-Identifier: GPL-3.0-or-later

"""docs/encryption.md: its files bring tunnels up that carry packets, on namespaces with the addresses of the page."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from mavproxy_handover.config.files import load_vehicle
from mavproxy_handover.store.keys import write_key
from sitl.hosts import namespaces, tunnel
from tests.sitl.runner_flight import ROOT

PAGE = Path(__file__).resolve().parents[2] / "docs" / "encryption.md"
#: in the order of the page
FILES = ("mc/wg-wired", "mc/wg-lte", "gcsa/wg-wired", "gcsa/wg-lte")
WORDS = {"mc": "PUBLIC_KEY_OF_THE_AIRCRAFT", "gcsa": "PUBLIC_KEY_OF_GCSA", "gcsb": "PUBLIC_KEY_OF_GCSB"}
WHY_NOT = namespaces.cannot() or tunnel.cannot()
if not WHY_NOT:
    missing = [name for name in ("wg-quick", "wireguard-go", "nft") if shutil.which(name) is None]
    WHY_NOT = f"missing: {', '.join(missing)}" if missing else ""

SCRIPT = """
import json, os, socket, subprocess, sys, time
from pathlib import Path
from sitl.hosts.namespaces import Namespaces, inside
from sitl.hosts.plan import plan
from sitl.run.processes import Processes

ECHO = "import socket\\nu = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)\\nu.bind(('0.0.0.0', 7))\\n"
ECHO += "print('up', flush=True)\\nwhile True:\\n    u.sendto(*u.recvfrom(99))\\n"

FORGED = "import socket\\nu = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)\\n"
FORGED += "u.bind(('10.9.1.2', 14550))\\nu.sendto(b'x', ('10.9.1.1', 14000))\\n"

def answers(address, wait_s=6.0):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
        udp.settimeout(wait_s)
        udp.sendto(b"x", (address, 7))
        try:
            return udp.recvfrom(99)[1][0] == address
        except OSError:
            return False

folder, lost = Path(sys.argv[1]), sys.argv[2]
said = {}
with Namespaces(plan(["GCSA", "GCSB"])) as made, Processes() as processes:
    for host in ("gcsa", "gcsb", "mc"):
        # each computer has a /run/wireguard of its own, and its processes end with this one
        up = " && ".join(f"wg-quick up {folder / host}/wg-{path}.conf" for path in ("wired", "lte"))
        line = f"mount -t tmpfs none /run/wireguard && {up} && echo tunnels-up && exec sh"
        under = ("unshare", "--mount", "--pid", "--fork", "--kill-child", "sh", "-c", line)
        child = processes.start(host, [*inside(host), *under], folder / host)
        until = time.monotonic() + 20
        while "tunnels-up" not in child.console() and time.monotonic() < until:
            time.sleep(0.1)
        if "tunnels-up" not in child.console():
            sys.exit("\\n".join(child.console()))
        if host != "mc":
            echo = processes.start(f"echo-{host}", [*inside(host), sys.executable, "-c", ECHO], folder / host)
            while "up" not in echo.console():
                time.sleep(0.05)
    with made.entered("mc"):
        for address in ("10.9.1.2", "10.9.2.2", "10.9.1.3", "10.9.2.3"):
            said[address] = answers(address)
        def gets_past():
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ours:
                ours.bind(("10.9.1.1", 14000))
                ours.settimeout(1.0)
                subprocess.run([*inside("gateway"), sys.executable, "-c", FORGED], check=True)
                try:
                    return ours.recvfrom(9)[1] == ("10.9.1.2", 14550)
                except OSError:
                    return False

        for words in ("addr add 10.9.1.2/32 dev lo", "route add 10.9.1.1/32 via 192.168.11.100 dev air"):
            subprocess.run(["ip", "-n", "gateway", *words.split()], check=True)
        said["forged"] = gets_past()
        subprocess.run(["nft", "-f", str(folder / "rule.nft")], check=True)
        said["forged, with the rule"] = gets_past()
        said["through the tunnel, with the rule"] = answers("10.9.1.2")
        processes["mc"].type(f"wg set wg-wired peer {lost} remove; echo removed")
        while "removed" not in processes["mc"].console():
            time.sleep(0.05)
        said["removed"] = answers("10.9.1.3", wait_s=1.0)
        said["the other one"] = answers("10.9.1.2")
print(json.dumps(said))
"""


def blocks(kind: str) -> list[str]:
    return re.findall(rf"```{kind}\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)


@pytest.mark.process
@pytest.mark.skipif(bool(WHY_NOT), reason=f"the tunnels of docs/encryption.md: {WHY_NOT}")
def test_the_files_of_the_page_bring_up_two_tunnels_to_each_station(tmp_path: Path) -> None:
    texts = dict(zip(FILES, blocks("ini"), strict=True))
    for path, last in (("wired", "10.9.1"), ("lte", "10.9.2")):
        texts[f"gcsb/wg-{path}"] = texts[f"gcsa/wg-{path}"].replace(f"{last}.2/24", f"{last}.3/24")
    public = {}
    for host in WORDS:
        (tmp_path / host).mkdir(mode=0o700)
        private = namespaces.run(["wg", "genkey"])
        public[host] = namespaces.run(["wg", "pubkey"], text=private).strip()
        (tmp_path / host / "private.key").write_text(private)
    for name, text in texts.items():
        host = name.partition("/")[0]
        filled = text.replace("/etc/wireguard/private.key", str(tmp_path / host / "private.key"))
        for each, word in WORDS.items():
            filled = filled.replace(word, public[each])
        path = tmp_path / f"{name}.conf"
        path.write_text(filled)
        path.chmod(0o600)
    (rule,) = blocks("bash")
    (tmp_path / "rule.nft").write_text(rule)
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, str(tmp_path), public["gcsb"]],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout.splitlines()[-1]) == {
        "10.9.1.2": True,
        "10.9.2.2": True,
        "10.9.1.3": True,
        "10.9.2.3": True,
        "forged": True,
        "forged, with the rule": False,
        "through the tunnel, with the rule": True,
        "removed": False,
        "the other one": True,
    }


def test_the_stations_links_of_the_page_load(tmp_path: Path) -> None:
    (block,) = blocks("toml")
    (tmp_path / "keys").mkdir(mode=0o700)
    write_key(tmp_path / "keys" / "GCSA.key", bytes(range(32)))
    config = tmp_path / "vehicle.toml"
    config.write_text('[vehicle]\nname = "drone-1"\nparent = "GCSA"\njournal = "x.jsonl"\n' + block)
    (station,) = load_vehicle(config).stations
    assert station.links == ("udpout:10.9.1.2:14550@wg-wired", "udpout:10.9.2.2:14550@wg-lte")
