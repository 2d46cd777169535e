# SPDX-License-Identifier: GPL-3.0-or-later

"""Serial lines with noise, several in one process: each a pair of pseudo-terminals, or one and the autopilot's port.

Started as `python -m sitl.run.noisy_lines --config FILE [--autopilot PORT]`:

    [[line]]
    name = "GCSA"
    near = "/run/vehicle-GCSA" # what the companion opens: a link to the pseudo-terminal
    far = "/run/GCSA"          # and the station; without it the other end is TCP port PORT of this machine
    baud = 115200
    seed = 7
    damage = 0.0005            # see `sitl.run.noise`, each way
    bursts_per_s = 2.0

What is typed at it: `cut NAME` and `heal NAME`, answered by `ok` and the same. What is sent while a line is cut is
lost.

Bytes leave at the line's rate, ten bits each, in the pieces in which a serial port hands them over. Bytes that do not
fit into QUEUE_S of the rate are lost, as are bytes that no program reads. When all lines are there it prints `ready`.
At the end, which is the end of its standard input, it prints a line for each direction with what it did. For systems
with pseudo-terminals.
"""

from __future__ import annotations

import argparse
import os
import select
import socket
import sys
import time
import tty
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from sitl.run.ending import Orders
from sitl.run.noise import LineNoise
from sitl.script.weather import NoiseLevel
from sitl.vehicles.ports import LOOPBACK

try:
    import tomllib
except ModuleNotFoundError:  # Python 3.10
    import tomli as tomllib

__all__ = ["LinePlan", "NoisyLines", "load_lines", "main"]

BITS_OF_BYTE: Final = 10
#: what one read of a serial port brings, at most
PIECE_BYTES: Final = 32
QUEUE_S: Final = 1.0
_READ_BYTES: Final = 4096
_CONNECT_S: Final = 10.0
_BAD_USAGE: Final = 2


@dataclass(frozen=True, slots=True)
class LinePlan:
    """One line as configured. `far` None: the autopilot's port."""

    name: str
    near: Path
    far: Path | None
    baud: int
    noise: NoiseLevel
    seed: str = "1"


def load_lines(path: Path) -> list[LinePlan]:
    """The lines of a configuration file. Raises ValueError (one line) and OSError."""
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
        _only(data, "line")
        plans = [_plan(table) for table in data.get("line", [])]
        if not plans:
            raise ValueError("[[line]] must be there at least once")
    except (ValueError, TypeError, AttributeError) as error:
        raise ValueError(f"{path}: {error}") from None
    return plans


def _only(table: Mapping[str, Any], *known: str) -> None:
    for key in table:
        if key not in known:
            raise ValueError(f"{key}: must be one of {', '.join(known)}")


def _plan(table: Mapping[str, Any]) -> LinePlan:
    _only(table, "name", "near", "far", "baud", "seed", "damage", "bursts_per_s")
    name, near, far, baud = table.get("name"), table.get("near"), table.get("far"), table.get("baud")
    if not isinstance(name, str) or not isinstance(near, str) or not isinstance(far, str | None):
        raise ValueError(f"line {name!r}: name and near must be texts, and far if it is there")
    if not isinstance(baud, int) or not 1200 <= baud <= 4_000_000:
        raise ValueError(f"line {name!r}: baud = {baud!r}: must be 1200 to 4000000")
    noise = NoiseLevel(table.get("damage", 0.0), table.get("bursts_per_s", 0.0))
    return LinePlan(name, Path(near), None if far is None else Path(far), baud, noise, str(table.get("seed", 1)))


class _End:
    """One end of a line: a pseudo-terminal, or a connection."""

    def __init__(self, descriptor: int, held: int | None = None) -> None:
        self.descriptor = descriptor
        #: the other side of the terminal, so that it lasts while no program has it open
        self._held = held
        os.set_blocking(descriptor, False)

    def read(self) -> bytes | None:
        """The data that have arrived; None if the other end is closed."""
        try:
            return os.read(self.descriptor, _READ_BYTES) or None
        except BlockingIOError:
            return b""
        except OSError:
            return None

    def write(self, data: bytes) -> int:
        try:
            return os.write(self.descriptor, data)
        except OSError:  # not read: lost, as on any line
            return 0

    def close(self) -> None:
        for descriptor in (self.descriptor, self._held):
            if descriptor is not None:
                with suppress(OSError):
                    os.close(descriptor)


def _terminal(link: Path) -> _End:
    """A pseudo-terminal under the name `link`. Raises OSError."""
    near, far = os.openpty()
    tty.setraw(far)
    link.parent.mkdir(parents=True, exist_ok=True)
    link.unlink(missing_ok=True)
    link.symlink_to(os.ttyname(far))
    return _End(near, far)


def _autopilot(port: int) -> _End:
    """The autopilot's serial port, which is a TCP port. Raises OSError."""
    connection = socket.create_connection((LOOPBACK, port), _CONNECT_S)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return _End(connection.detach())


class _Way:
    """One direction of a line."""

    def __init__(self, source: _End, sink: _End, noise: LineNoise, baud: int) -> None:
        self.source = source
        self.noise = noise
        self.passed = self.lost = 0
        self.cut = False
        self._sink = sink
        self._byte_s = BITS_OF_BYTE / baud
        self._free_at = 0.0
        #: when the last byte of each piece leaves
        self._waiting: deque[tuple[float, bytes]] = deque()

    def on_bytes(self, data: bytes, now: float) -> None:
        """Bytes (or none) go onto the line."""
        if self.cut:
            self.lost += len(data)
            return
        data = self.noise.carry(data, now)
        for start in range(0, len(data), PIECE_BYTES):
            piece = data[start : start + PIECE_BYTES]
            begins_at = max(now, self._free_at)
            if begins_at - now > QUEUE_S:
                self.lost += len(piece)
                continue
            self._free_at = begins_at + len(piece) * self._byte_s
            self._waiting.append((self._free_at, piece))

    def deliver(self, now: float) -> None:
        """Hand over what has crossed the line by now."""
        while self._waiting and self._waiting[0][0] <= now:
            piece = self._waiting.popleft()[1]
            written = self._sink.write(piece)
            self.passed += written
            self.lost += len(piece) - written

    def due(self) -> float:
        """When there is something to do."""
        return min(self.noise.burst_at, self._waiting[0][0] if self._waiting else self.noise.burst_at)


class NoisyLines:
    """All lines of a process."""

    def __init__(self, plans: Sequence[LinePlan], port: int | None, now: float) -> None:
        """Make all terminals, and connect to the autopilot at `port`. Raises OSError."""
        self._ends: list[_End] = []
        self.ways: dict[str, _Way] = {}
        try:
            for plan in plans:
                near = self._opened(_terminal(plan.near))
                far = self._opened(_autopilot(port or 0) if plan.far is None else _terminal(plan.far))
                for way, source, sink in (("down", near, far), ("up", far, near)):
                    noise = LineNoise(f"{plan.seed}/{plan.name}/{way}", plan.noise, now)
                    self.ways[f"{plan.name} {way}"] = _Way(source, sink, noise, plan.baud)
        except OSError:
            self.close()
            raise
        self._by_descriptor = {way.source.descriptor: way for way in self.ways.values()}

    def _opened(self, end: _End) -> _End:
        self._ends.append(end)
        return end

    def descriptors(self) -> list[int]:
        """Descriptors to wait for."""
        return list(self._by_descriptor)

    def readable(self, descriptor: int, now: float) -> None:
        """Something has arrived at an end."""
        way = self._by_descriptor[descriptor]
        data = way.source.read()
        if data is None:  # the autopilot is gone
            del self._by_descriptor[descriptor]
        else:
            way.on_bytes(data, now)

    def turn(self, now: float) -> float:
        """Do what is due; seconds until there is something again."""
        for way in self.ways.values():
            if way.noise.burst_at <= now:
                way.on_bytes(b"", now)
            way.deliver(now)
        return max(0.0, min(way.due() for way in self.ways.values()) - now)

    def order(self, line: str) -> str:
        """Carry out a line that was typed; returns the answer."""
        what, _, name = line.partition(" ")
        ways = [self.ways[key] for key in (f"{name} down", f"{name} up") if key in self.ways]
        if what not in ("cut", "heal") or not ways:
            return f"{line!r} must be cut or heal, and the name of a line"
        for way in ways:
            way.cut = what == "cut"
        return f"ok {line}"

    def summary(self) -> list[str]:
        """A line for each direction."""
        return [
            f"{name}: {way.passed} bytes, {way.lost} lost, {way.noise.damaged} damaged, {way.noise.bursts} bursts"
            for name, way in self.ways.items()
        ]

    def close(self) -> None:
        """Take all terminals away."""
        for end in self._ends:
            end.close()


def main(argv: Sequence[str] | None = None) -> int:
    """Run the lines until standard input ends. Exit code 2: the configuration is wrong or a line cannot be made."""
    parser = argparse.ArgumentParser(prog="python -m sitl.run.noisy_lines", description="Serial lines with noise.")
    parser.add_argument("--config", type=Path, required=True, metavar="FILE", help="the lines, as TOML")
    parser.add_argument("--autopilot", type=int, metavar="PORT", help="the autopilot's TCP port on this machine")
    arguments = parser.parse_args(argv)
    try:
        lines = NoisyLines(load_lines(arguments.config), arguments.autopilot, time.monotonic())
    except (ValueError, OSError) as error:
        print(f"lines: {error}", file=sys.stderr)
        return _BAD_USAGE

    orders = Orders()
    print("ready", flush=True)
    try:
        _serve(lines, orders)
    except KeyboardInterrupt:
        pass
    finally:
        lines.close()
        print("\n".join(lines.summary()), flush=True)
    return 0


def _serve(lines: NoisyLines, orders: Orders) -> None:
    while True:
        timeout_s = min(lines.turn(time.monotonic()), 1.0)
        readable, _, _ = select.select([*orders.descriptors, *lines.descriptors()], [], [], timeout_s)
        for descriptor in readable:
            if descriptor not in orders.descriptors:
                lines.readable(descriptor, time.monotonic())
            else:
                typed = orders.read(descriptor)
                if typed is None:
                    return
                for line in typed:
                    print(lines.order(line), flush=True)


if __name__ == "__main__":
    raise SystemExit(main())
