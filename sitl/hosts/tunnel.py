# SPDX-License-Identifier: GPL-3.0-or-later

"""WireGuard between the aircraft and stations, with keys made for the run: they are never on a disk.

The kernel's own WireGuard is used if it is there, else wireguard-go, a process for each interface. `setup` is the file
that `wg setconf` takes, as docs/encryption.md shows it.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from sitl.hosts.namespaces import Namespaces, inside, run
from sitl.hosts.plan import KEEPALIVE_S, TunnelEnd
from sitl.run.processes import Processes
from sitl.script.places import SetupError

__all__ = ["KeyPair", "build", "cannot", "setup"]

_TUN: Final = Path("/dev/net/tun")
_LIMIT_S: Final = 10.0
_POLL_S: Final = 0.05


@dataclass(frozen=True, slots=True)
class KeyPair:
    """A host's key. `private` leaves this process by pipes only."""

    private: str
    public: str


def cannot() -> str:
    """Why there can be no tunnel here, in one sentence; "" if there can be one, as far as programs go."""
    if shutil.which("wg") is None:
        return "the program wg is missing: install wireguard-tools"
    return ""


def setup(end: TunnelEnd, keys: Mapping[str, KeyPair]) -> str:
    """The configuration of one end, for `wg setconf`. Only an end that calls its peer keeps the path open."""
    lines = ["[Interface]", f"PrivateKey = {keys[end.host].private}", f"ListenPort = {end.port}"]
    for host, address, endpoint in end.peers:
        lines += ["", "[Peer]", f"PublicKey = {keys[host].public}", f"AllowedIPs = {address}/32"]
        if endpoint:
            lines += [f"Endpoint = {endpoint}", f"PersistentKeepalive = {KEEPALIVE_S}"]
    return "\n".join(lines) + "\n"


def build(namespaces: Namespaces, processes: Processes, folder: Path) -> str:
    """Make all tunnels of the plan; returns what makes them, in words. Raises SetupError."""
    why = cannot()
    if why:
        raise SetupError(f"--tunnel: {why}")
    ends = namespaces.plan.tunnels
    keys = {}
    for host in sorted({end.host for end in ends}):
        private = run(["wg", "genkey"]).strip()
        keys[host] = KeyPair(private, run(["wg", "pubkey"], text=private).strip())
    maker = "the kernel's WireGuard" if _kernel(ends[0]) else "wireguard-go"
    if maker == "wireguard-go":
        _start(ends, processes, folder)
    # those that wait to be called first: a call that nothing answers is made again after 5 s only
    for end in sorted(ends, key=_calls):
        at = ["ip", "-n", end.host]
        if maker != "wireguard-go":
            run([*at, "link", "add", end.interface, "type", "wireguard"])
        run([*inside(end.host), "wg", "setconf", end.interface, "/dev/stdin"], text=setup(end, keys))
        run([*at, "addr", "add", end.address, "dev", end.interface])
        run([*at, "link", "set", end.interface, "mtu", str(end.mtu), "up"])
    namespaces.check([(end.host, end.interface) for end in ends])
    _await_up([end for end in ends if _calls(end)])
    return maker


def _calls(end: TunnelEnd) -> bool:
    """Whether this end calls its peers."""
    return any(endpoint for _host, _address, endpoint in end.peers)


def _await_up(ends: Sequence[TunnelEnd]) -> None:
    """Wait until every peer has answered. Raises SetupError."""
    until = time.monotonic() + _LIMIT_S
    for end in ends:
        while True:
            told = run([*inside(end.host), "wg", "show", end.interface, "latest-handshakes"])
            if all(int(line.split()[-1]) for line in told.splitlines()):
                break
            if time.monotonic() > until:
                raise SetupError(f"--tunnel: no answer through {end.interface} of {end.host} within {_LIMIT_S:g} s")
            time.sleep(_POLL_S)


def _kernel(end: TunnelEnd) -> bool:
    """Whether the kernel has WireGuard."""
    at = ["ip", "-n", end.host, "link"]
    try:
        run([*at, "add", end.interface, "type", "wireguard"])
    except SetupError:
        return False
    run([*at, "del", end.interface])
    return True


def _start(ends: tuple[TunnelEnd, ...], processes: Processes, folder: Path) -> None:
    """A process of wireguard-go for each interface. Raises SetupError."""
    if shutil.which("wireguard-go") is None:
        raise SetupError("--tunnel: this kernel has no WireGuard and wireguard-go is missing: install wireguard-go")
    if not _TUN.exists():
        raise SetupError(f"--tunnel: this kernel has no WireGuard, and wireguard-go needs {_TUN}: it is not there")
    until = time.monotonic() + _LIMIT_S
    for end in ends:
        argv = [*inside(end.host), "wireguard-go", "-f", end.interface]
        processes.start(f"{end.host}-{end.interface}", argv, folder)
    for end in ends:
        child = processes[f"{end.host}-{end.interface}"]
        while not _listens(end):
            if not child.alive() or time.monotonic() > until:
                said = (child.console() or ["it does not say why"])[-1]
                raise SetupError(f"--tunnel: wireguard-go does not start for {end.interface}: {said}")
            time.sleep(_POLL_S)


def _listens(end: TunnelEnd) -> bool:
    """Whether `wg` can talk to it."""
    try:
        run([*inside(end.host), "wg", "show", end.interface])
    except SetupError:
        return False
    return True
