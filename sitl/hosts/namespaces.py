# SPDX-License-Identifier: GPL-3.0-or-later

"""Network namespaces that end with the run.

Their names exist only in a mount namespace of the run. `ip netns` keeps a namespace by a mount below /run/netns. Here
that folder, and /run/wireguard, are file systems in memory that only this process and its children see. The folders
themselves stay, as `ip netns` leaves them: removing one would also remove what another run has mounted on it. So two
runs can use the same names. The kernel removes namespaces, cables and tunnels with the last process of the run, also
after SIGKILL: every process of a run ends with its parent. Nothing is made in the namespace in which the command was
started.

`check` refuses a network that a packet could leave. Each namespace must have the interfaces of the plan and no other,
no default route, and no route to a network outside the plan.
"""

from __future__ import annotations

import ctypes
import errno
import ipaddress
import json
import os
import shutil
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final

from sitl.hosts.plan import Plan
from sitl.script.places import SetupError

__all__ = ["Namespaces", "cannot", "inside", "is_inside", "run"]

_NEW_NETWORK, _NEW_MOUNTS = 0x4000_0000, 0x0002_0000
_PRIVATE, _RECURSIVE = 1 << 18, 1 << 14
_NETNS: Final = Path("/run/netns")
#: where wireguard-go and `wg` meet
_WIREGUARD: Final = Path("/run/wireguard")
#: the networks that a namespace of the bench may have routes to
_OURS: Final = tuple(map(ipaddress.ip_network, ("192.168.10.0/23", "100.64.0.0/16", "10.9.0.0/16", "127.0.0.0/8")))
#: routes that lead to no other host
_LOCAL: Final = ("local", "broadcast", "multicast", "anycast", "unreachable")
_LIMIT_S: Final = 20.0


def cannot() -> str:
    """Why namespaces cannot be made here, in one sentence; "" if they can."""
    if not hasattr(os, "geteuid") or not Path("/proc/self/ns/net").exists():
        return "network namespaces need Linux"
    if os.geteuid() != 0:
        return "network namespaces need root: run it with sudo"
    if shutil.which("ip") is None:
        return "the program ip is missing: install iproute2"
    return ""


def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


def _call(what: str, result: int) -> None:
    """Raises SetupError for a system call that failed."""
    if result != 0:
        code = ctypes.get_errno()
        more = " (a container may forbid it)" if code == errno.EPERM else ""
        raise SetupError(f"{what}: {os.strerror(code)}{more}")


def run(words: Sequence[str], *, text: str | None = None) -> str:
    """Run a program to its end and return its output. Raises SetupError with its last line."""
    try:
        done = subprocess.run(
            list(words), input=text, capture_output=True, text=True, check=False, timeout=_LIMIT_S, errors="replace"
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise SetupError(f"{' '.join(words)}: {error}") from None
    if done.returncode != 0:
        said = (done.stderr.strip() or done.stdout.strip() or f"exit code {done.returncode}").splitlines()[-1]
        raise SetupError(f"{' '.join(words)}: {said}")
    return done.stdout


def inside(host: str) -> tuple[str, ...]:
    """Words before a command line that runs on that host."""
    return ("ip", "netns", "exec", host)


def is_inside(host: str) -> bool:
    """Whether this process is on that host of a run."""
    with suppress(OSError):
        return os.path.samefile("/proc/self/ns/net", _NETNS / host)
    return False


class Namespaces:
    """The hosts of a plan. Use it as a context manager; within it this process is on the host that `entered` names."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self._outside = -1
        self._made: list[str] = []
        #: folder -> the device that was mounted on it
        self._mounted: dict[Path, int] = {}

    def __enter__(self) -> Namespaces:
        """Make all hosts. Raises SetupError, and leaves nothing then."""
        why = cannot()
        if why:
            raise SetupError(why)
        try:
            self._outside = os.open("/proc/self/ns/net", os.O_RDONLY | os.O_CLOEXEC)
            self._separate()
            for words in self.plan.commands():
                run(["ip", *words])
                if words[:2] == ["netns", "add"]:
                    self._made.append(words[2])
            for host in self.plan.hosts:
                self.forward(host.name, host.forwards)
            self.check()
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *_details: object) -> None:
        self.close()

    def _separate(self) -> None:
        _call("a mount namespace of the bench's own", _libc().unshare(_NEW_MOUNTS))
        _call("private mounts", _libc().mount(b"none", b"/", b"none", _RECURSIVE | _PRIVATE, None))
        for folder in (_NETNS, _WIREGUARD):
            folder.mkdir(parents=True, exist_ok=True)
            _call(f"{folder}", _libc().mount(b"none", str(folder).encode(), b"tmpfs", 0, b"mode=0700"))
            self._mounted[folder] = folder.stat().st_dev

    # ---- while they are there -------------------------------------------------------------------------------------

    @contextmanager
    def entered(self, host: str) -> Iterator[None]:
        """Put this thread, and the processes that it starts meanwhile, on that host. Raises SetupError."""
        with (_NETNS / host).open("rb") as there:
            _call(f"host {host}", _libc().setns(there.fileno(), _NEW_NETWORK))
        try:
            yield
        finally:
            _call("the way back", _libc().setns(self._outside, _NEW_NETWORK))

    def forward(self, host: str, yes: bool) -> None:
        """Whether the host passes on packets that are for another one. Raises SetupError."""
        value = "1" if yes else "0"
        script = f"echo {value} > /proc/sys/net/ipv4/ip_forward"
        run([*inside(host), "sh", "-c", script])

    def check(self, more: Sequence[tuple[str, str]] = ()) -> None:
        """Raises SetupError if a packet can leave. `more`: host and interface of each addition to the plan."""
        for host in self.plan.hosts:
            wanted = {"lo", *(each.name for each in host.interfaces), *host.ports}
            wanted |= {name for where, name in more if where == host.name}
            links = self.links(host.name)
            # a kernel may put devices of its tunnel modules into every namespace; they lead nowhere while down
            found = {name for name, flags in links.items() if name in wanted or "UP" in flags}
            if found != wanted:
                raise SetupError(f"host {host.name} has the interfaces {sorted(found)}, not {sorted(wanted)}")
            for route in json.loads(run(["ip", "-j", "-n", host.name, "route", "show", "table", "all"]) or "[]"):
                if not _stays(route):
                    raise SetupError(f"host {host.name} has a route out of the bench: {route}")

    def links(self, host: str) -> dict[str, list[str]]:
        """Interface -> its flags. Raises SetupError."""
        found = json.loads(run(["ip", "-j", "-n", host, "link", "show"]) or "[]")
        return {each["ifname"]: each["flags"] for each in found}

    # ---- the end --------------------------------------------------------------------------------------------------

    def _ours(self, folder: Path) -> bool:
        """Whether the run's own file system is mounted there now."""
        with suppress(OSError):
            return folder.stat().st_dev == self._mounted.get(folder)
        return False

    def close(self) -> None:
        """Remove everything. Safe to call twice, never raises: what is left goes with this process."""
        for name in reversed(self._made):
            if self._ours(_NETNS):  # or the name would be one of this machine's
                with suppress(SetupError):
                    run(["ip", "netns", "del", name])
        self._made.clear()
        for folder in reversed(self._mounted):
            if self._ours(folder):
                _libc().umount2(str(folder).encode(), 2)  # lazily
        self._mounted.clear()
        if self._outside >= 0:
            os.close(self._outside)
            self._outside = -1


def _stays(route: dict[str, Any]) -> bool:
    """Whether a route leads to no host outside of the bench."""
    if route.get("type") in _LOCAL:
        return True
    to = str(route.get("dst", "default"))
    if to == "default":
        return False
    network = ipaddress.ip_network(to, strict=False)
    if network.version == 6:
        return network.is_link_local or network.is_multicast or network.is_loopback
    return any(network.subnet_of(ours) for ours in _OURS if ours.version == 4)
