# SPDX-License-Identifier: GPL-3.0-or-later

"""docs/bench-of-hosts.md: its script makes address and route as listing 5.3 has them, and its configuration loads."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from mavproxy_handover.config.files import load_vehicle
from mavproxy_handover.store.keys import write_key
from sitl.hosts import namespaces
from sitl.hosts.main import main
from tests.sitl.runner_flight import ROOT

PAGE = Path(__file__).resolve().parents[2] / "docs" / "bench-of-hosts.md"
#: the values of the comment in the script, as listing 5.3 has them for the mission computer
MISSION_COMPUTER = ("192.168.11.100/24", "192.168.10.0/24", "192.168.11.1", "eth0")
STATION = ("192.168.10.100/24", "192.168.11.0/24", "192.168.10.1", "eno1")

SCRIPT = """
import json, subprocess, sys
from sitl.hosts.namespaces import Namespaces, inside, run
from sitl.hosts.plan import plan

said = {}
with Namespaces(plan(["GCSA", "GCSB"])) as made:
    for host, interface, script in (("gcsa", "eno1", sys.argv[1]), ("mc", "eth0", sys.argv[2])):
        run(["ip", "-n", host, "address", "flush", "dev", interface])
        run(["ip", "-n", host, "link", "set", interface, "down"])
        for _ in range(2):  # a second time changes nothing
            run([*inside(host), "sh", "-c", script])
        said[host] = run(["ip", "-n", host, "route", "show", "dev", interface]).splitlines()
print(json.dumps(said))
"""


def blocks(kind: str) -> list[str]:
    return re.findall(rf"```{kind}\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)


def script() -> str:
    (found,) = [block for block in blocks("bash") if block.startswith("#!/bin/sh")]
    return found


@pytest.mark.process
@pytest.mark.skipif(bool(namespaces.cannot()), reason=f"the script of docs/bench-of-hosts.md: {namespaces.cannot()}")
def test_the_script_makes_address_and_route_of_listing_5_3() -> None:
    station = script()
    mission_computer = station
    for ours, theirs in zip(STATION, MISSION_COMPUTER, strict=True):
        assert f"={ours}\n" in station
        mission_computer = mission_computer.replace(f"={ours}\n", f"={theirs}\n")
    assert ", ".join(MISSION_COMPUTER) in station, "the comment says what the mission computer has"
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, station, mission_computer],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    routes = {host: [line.strip() for line in lines] for host, lines in json.loads(done.stdout).items()}
    assert "192.168.11.0/24 via 192.168.10.1" in routes["gcsa"]
    assert "192.168.10.0/24 via 192.168.11.1" in routes["mc"]


def test_the_vehicles_links_load(tmp_path: Path) -> None:
    (block,) = blocks("toml")
    (tmp_path / "keys").mkdir(mode=0o700)
    for name in ("GCSA", "GCSB"):
        write_key(tmp_path / "keys" / f"{name}.key", name.encode() * 8)
    config = tmp_path / "vehicle.toml"
    config.write_text('[vehicle]\nname = "drone-1"\nparent = "GCSA"\njournal = "x.jsonl"\n' + block)
    links = {station.station.name: station.links for station in load_vehicle(config).stations}
    assert links["GCSA"] == ("udpout:192.168.10.100:14550@eth0", "udpout:100.64.1.2:14550@wwan0")
    assert links["GCSB"] == ("udpout:192.168.10.128:14550@eth0", "udpout:100.64.2.2:14550@wwan0")


def test_the_options_that_the_page_names_are_there(capsys: pytest.CaptureFixture[str]) -> None:
    text = PAGE.read_text(encoding="utf-8")
    named = set(re.findall(r"^\| `(--[a-z]+)", text, re.MULTILINE))
    assert main(["hosts", "--help"]) == 0
    shown = capsys.readouterr().out
    assert named >= {"--mission", "--vehicle", "--cut", "--tunnel", "--speedup", "--watch"}
    assert [option for option in named if option not in shown] == []
