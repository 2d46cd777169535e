# SPDX-License-Identifier: GPL-3.0-or-later

"""The hosts of the bench as the kernel makes them: which host reaches which, what a cut does, what a tunnel carries.

Namespaces need root: without it every test here is skipped, and says so. A whole flight on hosts of their own takes
more than a minute: `make hosts` flies it.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from sitl.hosts import namespaces, tunnel
from sitl.report.journal_reader import Entry, parse_line
from tests.sitl.runner_flight import ROOT, processes_in

WHY_NOT = namespaces.cannot()
pytestmark = [
    pytest.mark.process,
    pytest.mark.skipif(bool(WHY_NOT), reason=f"the bench on several hosts: {WHY_NOT}"),
]
needs_tunnel = pytest.mark.skipif(
    bool(tunnel.cannot()) or shutil.which("wireguard-go") is None,
    reason="the tunnel of the bench needs wireguard-tools and wireguard-go",
)

#: what runs in a process of its own, because it leaves the mounts of the process that it is in
SCRIPT = """
import json, subprocess, sys, tempfile
from contextlib import ExitStack
from pathlib import Path
from sitl.hosts import tunnel
from sitl.hosts.namespaces import Namespaces, inside
from sitl.hosts.network import BenchNetwork
from sitl.hosts.plan import plan
from sitl.run.processes import Processes

TALK = "import socket,sys; s=socket.socket(socket.AF_INET, socket.SOCK_DGRAM); s.settimeout(2.0)"

def reaches(host, there, address):
    serve = TALK + "; s.bind((sys.argv[1], 7)); print('up', flush=True); s.sendto(*s.recvfrom(99))"
    server = subprocess.Popen(
        [*inside(there), sys.executable, "-c", serve, address], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )
    server.stdout.readline()
    ask = TALK + "; s.sendto(b'x', (sys.argv[1], 7)); s.recvfrom(99)"
    asked = subprocess.run([*inside(host), sys.executable, "-c", ask, address], capture_output=True)
    server.kill()
    server.wait()
    server.stdout.close()
    return asked.returncode == 0
"""


def ran(code: str, folder: Path) -> Any:
    """What a script prints as JSON in its last line."""
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT + code],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def known_namespaces() -> set[str]:
    """Network namespaces that some process is in, or that have a name here."""
    found = set()
    for link in Path("/proc").glob("[0-9]*/ns/net"):
        try:
            found.add(str(link.readlink()))
        except OSError:
            continue
    names = Path("/run/netns")
    return found | ({path.name for path in names.iterdir()} if names.is_dir() else set())


def interfaces() -> set[str]:
    return {path.name for path in Path("/sys/class/net").iterdir()}


def test_hosts_reach_each_other_by_both_paths_and_a_cut_path_reaches_nobody(tmp_path: Path) -> None:
    before = known_namespaces(), interfaces()
    found = ran(
        """
seen = {}
with Namespaces(plan(["GCSA", "GCSB"])) as made:
    made.check()
    network = BenchNetwork(made)
    seen["wired"] = reaches("mc", "gcsb", "192.168.10.128")
    seen["lte"] = reaches("mc", "gcsa", "100.64.1.2")
    seen["ground"] = reaches("gcsa", "gcsb", "192.168.10.128")
    network.change("cut wired")
    seen["wired cut"] = reaches("mc", "gcsb", "192.168.10.128")
    seen["lte meanwhile"] = reaches("mc", "gcsa", "100.64.1.2")
    seen["ground meanwhile"] = reaches("gcsa", "gcsb", "192.168.10.128")
    network.change("heal wired")
    seen["wired healed"] = reaches("mc", "gcsb", "192.168.10.128")
    seen["outside"] = subprocess.run(
        [*inside("gcsa"), "ip", "route", "get", "192.0.2.1"], capture_output=True, text=True
    ).stderr
print(json.dumps(seen))
""",
        tmp_path,
    )
    assert "unreachable" in found.pop("outside")
    assert found == {
        "wired": True,
        "lte": True,
        "ground": True,
        "wired cut": False,
        "lte meanwhile": True,
        "ground meanwhile": True,
        "wired healed": True,
    }
    assert (known_namespaces() <= before[0], interfaces()) == (True, before[1])


#: a run that has made its folders, and then does what it is told
RUN = """
import sys
from pathlib import Path
from sitl.hosts import namespaces
from sitl.hosts.plan import plan
folder = Path(sys.argv[1])
namespaces._NETNS, namespaces._WIREGUARD = folder / "netns", folder / "wireguard"
made = namespaces.Namespaces(plan(["GCSA"]))
made._separate()
(namespaces._NETNS / "mc").touch()
made._made.append("mc")
print("ready", flush=True)
if sys.stdin.readline() == "close\\n":
    made.close()
    print("closed", flush=True)
    sys.stdin.readline()
print((namespaces._NETNS / "mc").exists(), flush=True)
"""


def begun_run(folder: Path) -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [sys.executable, "-c", RUN, str(folder)],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    return process


def test_the_end_of_one_run_takes_nothing_from_another_run(tmp_path: Path) -> None:
    """A folder that is removed takes along what is mounted on it, in other mount namespaces too."""
    first = begun_run(tmp_path)
    second = begun_run(tmp_path)
    first.communicate("close\n", timeout=20)
    assert second.communicate("look\n", timeout=20)[0] == "True\n"


def test_a_way_out_is_found_before_anything_is_flown(tmp_path: Path) -> None:
    said = ran(
        """
said = []
with Namespaces(plan(["GCSA"])) as made:
    for words in (
        ["-n", "gcsa", "route", "add", "default", "via", "192.168.10.1"],
        ["-n", "mc", "link", "add", "other", "type", "bridge"],
    ):
        subprocess.run(["ip", *words], check=True)
        if "other" in words:
            subprocess.run(["ip", "-n", "gcsa", "route", "del", "default"], check=True)
            subprocess.run(["ip", "-n", "mc", "link", "set", "other", "up"], check=True)
        try:
            made.check()
        except Exception as error:
            said.append(str(error))
print(json.dumps(said))
""",
        tmp_path,
    )
    assert "host gcsa has a route out of the bench" in said[0]
    assert said[1].startswith("host mc has the interfaces ['eth0', 'lo', 'other', 'wwan0']")


@needs_tunnel
def test_a_tunnel_carries_what_is_sent_to_its_addresses_by_both_paths(tmp_path: Path) -> None:
    found = ran(
        """
with ExitStack() as stack:
    made = stack.enter_context(Namespaces(plan(["GCSA", "GCSB"], ["GCSB"])))
    processes = stack.enter_context(Processes())
    maker = tunnel.build(made, processes, Path("tunnels").resolve())
    keys = subprocess.run([*inside("mc"), "wg", "show", "all", "private-key"], capture_output=True, text=True).stdout
    seen = {
        "wired": reaches("mc", "gcsb", "10.9.1.3"),
        "lte": reaches("mc", "gcsb", "10.9.2.3"),
        "back": reaches("gcsb", "mc", "10.9.1.1"),
        "other": reaches("gcsa", "gcsb", "10.9.1.3"),
        "keys": [line.split()[-1] for line in keys.splitlines()],
    }
print(json.dumps(seen))
""",
        tmp_path,
    )
    keys = found.pop("keys")
    assert found == {"wired": True, "lte": True, "back": True, "other": False}
    assert len(set(keys)) == 2, "one for each host"
    texts = [path.read_text(errors="replace") for path in tmp_path.rglob("*") if path.is_file()]
    assert texts, "the consoles of wireguard-go are kept there"
    assert [key for key in keys if any(key in text for text in texts)] == [], "a private key is on a disk"


# ---- the command ----------------------------------------------------------------------------------------------------


@pytest.fixture
def begun(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """`handover bench hosts` until its companion is up."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs are deaf to it
    process = started(tmp_path / "run", "--speedup", "2")
    signal.signal(signal.SIGINT, before)
    until = time.monotonic() + 60
    while not (tmp_path / "run" / "companion" / "companion.jsonl").exists():
        assert process.poll() is None, process.communicate()[1]
        assert time.monotonic() < until, "the companion did not come up"
        time.sleep(0.1)
    yield process
    if process.poll() is None:
        process.kill()
        process.communicate()


def started(folder: Path, *words: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "mavproxy_handover.cli", "bench", "hosts", "--json", "--out", str(folder), *words],
        cwd=folder.parent,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.mark.parametrize(
    "number",
    [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.long), signal.SIGKILL],
    ids=lambda each: each.name,
)
def test_however_it_is_ended_nothing_is_left(
    begun: subprocess.Popen[str], number: signal.Signals, tmp_path: Path
) -> None:
    assert Path(f"/proc/{begun.pid}/ns/net").readlink() != Path("/proc/self/ns/net").readlink()
    hosts = {str(Path(f"/proc/{pid}/ns/net").readlink()) for pid in processes_in(tmp_path / "run")}
    assert len(hosts) >= 3, "mission computer and two stations"
    begun.send_signal(number)
    _out, said = begun.communicate(timeout=30)
    if number != signal.SIGKILL:
        assert begun.returncode == 130
        assert said.strip().endswith("stopped; every process was ended, every host is gone")
    until = time.monotonic() + 10
    while processes_in(tmp_path / "run") or hosts & known_namespaces():
        assert time.monotonic() < until, "something is left behind"
        time.sleep(0.1)
    assert not {"mc", "gcsa", "gcsb", "gateway", "lte"} & known_namespaces()


@needs_tunnel
@pytest.mark.long
def test_a_flight_with_a_path_cut_a_handover_and_a_tunnel(tmp_path: Path) -> None:
    """Judged by journals, telemetry logs and the results, and by no sentence."""
    folder = tmp_path / "run"
    process = started(folder, "--tunnel", "GCSA", "--speedup", "2")
    out, story = process.communicate(timeout=800)
    assert process.returncode == 0, story
    results = json.loads((folder / "hosts.json").read_text(encoding="utf-8"))
    marks = json.loads((folder / "run.json").read_text(encoding="utf-8"))["marks"]
    journal = entries(folder / "companion" / "companion.jsonl")
    assert json.loads(out)["hosts"] == results
    # authority: one change in the cut, none lost
    committed = [entry for entry in journal if entry.event == "transfer_committed"]
    assert [entry.get("station") for entry in committed] == ["GCSB", "GCSA"]
    assert marks["cut"] < committed[0].t < marks["healed"] < committed[1].t
    assert [entry.event for entry in journal if entry.event in ("authority_lost", "emergency", "fault")] == []
    # links: the downlink of each station moved to the other path within a second
    for station, prefix in (("GCSA", "udpout:10.9.2.2:"), ("GCSB", "udpout:100.64.2.2:")):
        moved = [
            entry
            for entry in journal
            if entry.event == "link" and entry.get("change") == "switched" and entry.get("station") == station
        ]
        first = next(entry for entry in moved if entry.t > marks["cut"])
        assert str(first.get("link")).startswith(prefix)
        assert first.t - marks["cut"] < 1.5
        assert results["cut"]["stations"][station]["silent_s"] < 2.0
    # the tunnel: 60 bytes of headers, and 0 to 15 to fill up to 16
    for cost in results["tunnel"]["paths"].values():
        assert 60.0 <= cost["added_bytes"] <= 75.0
        assert cost["packets"] > 1000
        assert min(cost["round_trips"]) > 100
    assert set(results["tunnel"]["paths"]) == {"wired", "lte"}
    assert Path(json.loads(out)["report"]).stat().st_size > 50_000


def entries(path: Path) -> list[Entry]:
    found = [parse_line(line) for line in path.read_text(encoding="utf-8").splitlines()]
    return [entry for entry in found if entry is not None]
