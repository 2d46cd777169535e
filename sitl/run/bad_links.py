# SPDX-License-Identifier: GPL-3.0-or-later

"""UDP proxies with bad weather, several in one process, on 127.0.0.1 only.

Started as `python -m sitl.run.bad_links --config FILE`:

    seed = 7
    [[link]]
    name = "wifi"
    listen = 14560         # one program sends here ...
    target = 14550         # ... and the other one listens here
    vehicle = "listen"     # which of the two the vehicle is: the one that sends to `listen` (default), or "target"
    [link.up]              # from the station to the vehicle; any value of Weather
    loss = 0.1
    [link.down]            # from the vehicle to the station
    delay_s = 0.05
    [[link.timeline]]      # later; `direction` up or down, both if it is left out; `at_s` from the start
    at_s = 20
    direction = "down"
    cut = true

When all ports are open it prints `ready`. Then it takes orders, a line each, on standard input, and answers each with a
line, `ok ...` or `error: ...`:

    cut wifi [up|down]     heal wifi [up|down]     loss wifi 0.2 [up|down]     clear wifi     show

`loss` stands for any value of Weather, in full or in short (delay, jitter, rate, queue, burst); `all` for every link.
It ends when its input does.
"""

from __future__ import annotations

import argparse
import heapq
import itertools
import select
import socket
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from sitl.run.ending import Orders
from sitl.run.impairment import Impairment
from sitl.script.weather import Weather, WeatherError
from sitl.vehicles.ports import LOOPBACK

try:
    import tomllib
except ModuleNotFoundError:  # Python 3.10
    import tomli as tomllib

__all__ = ["BadLinks", "LinkPlan", "load_plans", "main"]

DIRECTIONS: Final = ("up", "down")
_SHORT: Final = {
    "delay": "delay_s",
    "jitter": "jitter_s",
    "rate": "rate_bytes_per_s",
    "queue": "queue_s",
    "burst": "to_bad",
}
_IN_FLIGHT: Final = 50_000
_DATAGRAM_BYTES: Final = 65536
_AT_ONCE: Final = 64
_BAD_USAGE: Final = 2


@dataclass(frozen=True, slots=True)
class LinkPlan:
    """One proxy as configured. `timeline`: (seconds from the start, directions, values of Weather)."""

    name: str
    listen: int
    target: int
    vehicle_listens: bool = False
    up: Weather = field(default_factory=Weather)
    down: Weather = field(default_factory=Weather)
    timeline: tuple[tuple[float, tuple[str, ...], dict[str, Any]], ...] = ()


def load_plans(path: Path) -> tuple[str, list[LinkPlan]]:
    """Seed and proxies out of a configuration file. Raises WeatherError (one line) and OSError."""
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise WeatherError(f"{path}: {error}") from None
    try:
        _only(data, "", "seed", "link")
        plans = [_plan(table) for table in data.get("link", [])]
        names = [plan.name for plan in plans]
        if not plans or len(set(names)) < len(names):
            raise WeatherError("[[link]] must be there at least once, each with a name of its own")
    except (ValueError, TypeError, AttributeError) as error:
        raise WeatherError(f"{path}: {error}") from None
    return str(data.get("seed", 1)), plans


def _only(table: dict[str, Any], where: str, *known: str) -> None:
    for key in table:
        if key not in known:
            raise WeatherError(f"{where}{key}: must be one of {', '.join(known)}")


def _plan(table: dict[str, Any]) -> LinkPlan:
    name = table.get("name")
    if not isinstance(name, str) or not name.isprintable() or not name or " " in name or name == "all":
        raise WeatherError(f"link name = {name!r}: must be a word, and not 'all'")
    where = f"link {name}: "
    _only(table, where, "name", "listen", "target", "vehicle", "up", "down", "timeline")
    for key in ("listen", "target"):
        port = table.get(key)
        if not isinstance(port, int) or isinstance(port, bool) or not 1 <= port <= 65535:
            raise WeatherError(f"{where}{key} = {port!r}: must be a port, 1 to 65535")
    side = table.get("vehicle", "listen")
    if side not in ("listen", "target"):
        raise WeatherError(f"{where}vehicle = {side!r}: must be listen or target")
    timeline = []
    for entry in table.get("timeline", []):
        changes = dict(entry)
        at_s, direction = changes.pop("at_s", None), changes.pop("direction", None)
        if isinstance(at_s, bool) or not isinstance(at_s, (int, float)) or at_s < 0:
            raise WeatherError(f"{where}timeline at_s = {at_s!r}: must be 0 or more")
        timeline.append((float(at_s), _directions(direction), changes))
        Weather().changed(**changes)
    up, down = (Weather().changed(**table.get(direction, {})) for direction in DIRECTIONS)
    return LinkPlan(name, table["listen"], table["target"], side == "target", up, down, tuple(timeline))


def _directions(word: str | None) -> tuple[str, ...]:
    if word is None:
        return DIRECTIONS
    if word not in DIRECTIONS:
        raise WeatherError(f"direction {word!r}: must be up or down")
    return (word,)


class _Proxy:
    """One link: two sockets and the weather between them."""

    def __init__(self, plan: LinkPlan, seed: str, start: float) -> None:
        """Raises OSError: port in use."""
        self.name = plan.name
        self.near = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.far = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        for sock in (self.near, self.far):
            sock.setblocking(False)
        try:
            self.near.bind((LOOPBACK, plan.listen))
            self.far.bind((LOOPBACK, 0))
        except OSError:
            self.close()
            raise
        self._target = (LOOPBACK, plan.target)
        self._client: tuple[str, int] | None = None
        weather = {"up": plan.up, "down": plan.down}
        self.weather = {way: Impairment(f"{seed}/{plan.name}/{way}", weather[way]) for way in DIRECTIONS}
        for at_s, directions, changes in plan.timeline:
            for way in directions:
                self.weather[way].schedule(start + at_s, **changes)
        outward, back = DIRECTIONS if plan.vehicle_listens else ("down", "up")
        self._outward, self._back = self.weather[outward], self.weather[back]

    def receive(self, sock: socket.socket, now: float) -> list[tuple[float, Callable[[], None]]]:
        """Take what has arrived on one of the sockets; when to send it on, and how."""
        plans: list[tuple[float, Callable[[], None]]] = []
        for _ in range(_AT_ONCE):
            try:
                data, address = sock.recvfrom(_DATAGRAM_BYTES)
            except OSError:
                break
            if sock is self.near:
                self._client = address
                plans += [(at, self._sender(self.far, copy)) for at, copy in self._outward.plan(data, now)]
            elif address == self._target:
                plans += [(at, self._sender(self.near, copy)) for at, copy in self._back.plan(data, now)]
        return plans

    def _sender(self, sock: socket.socket, data: bytes) -> Callable[[], None]:
        def send() -> None:
            address = self._target if sock is self.far else self._client
            if address is not None:
                try:
                    sock.sendto(data, address)
                except OSError:  # no receiver, or the system is full: a datagram is lost
                    pass

        return send

    def close(self) -> None:
        self.near.close()
        self.far.close()


class BadLinks:
    """All proxies of a process, and the orders that change their weather."""

    def __init__(self, seed: str, plans: Sequence[LinkPlan], start: float) -> None:
        """Open all ports. Raises OSError."""
        self._proxies: dict[str, _Proxy] = {}
        self._heap: list[tuple[float, int, Callable[[], None]]] = []
        self._number = itertools.count()
        try:
            for plan in plans:
                self._proxies[plan.name] = _Proxy(plan, seed, start)
        except OSError:
            self.close()
            raise
        self.sockets = {
            sock.fileno(): (proxy, sock) for proxy in self._proxies.values() for sock in (proxy.near, proxy.far)
        }

    def readable(self, fileno: int, now: float) -> None:
        """Something has arrived on this descriptor."""
        proxy, sock = self.sockets[fileno]
        for at, send in proxy.receive(sock, now):
            if at <= now and not (self._heap and self._heap[0][0] <= at):
                send()
            elif len(self._heap) < _IN_FLIGHT:  # beyond that it is lost, as in any full queue
                heapq.heappush(self._heap, (at, next(self._number), send))

    def send_due(self, now: float) -> float | None:
        """Send what is due; seconds until the next is, None if nothing waits."""
        while self._heap and self._heap[0][0] <= now:
            heapq.heappop(self._heap)[2]()
        return self._heap[0][0] - now if self._heap else None

    def order(self, line: str) -> str:
        """Carry out a line of standard input; the answer. Never raises."""
        words = line.split()
        try:
            return "ok " + self._carry_out(words)
        except WeatherError as error:
            return f"error: {error}"

    def _carry_out(self, words: list[str]) -> str:
        if words == ["show"]:
            return "; ".join(
                f"{name} {way}: {weather.passed} passed, {weather.lost} lost"
                for name, proxy in self._proxies.items()
                for way, weather in proxy.weather.items()
            )
        if len(words) < 2:
            raise WeatherError("must be: cut|heal|clear LINK [up|down], VALUE LINK NUMBER [up|down], or show")
        what, name, *rest = words
        if name != "all" and name not in self._proxies:
            raise WeatherError(f"link {name!r}: must be all or one of {', '.join(self._proxies)}")
        if what in ("cut", "heal"):
            changes: dict[str, object] = {"cut": what == "cut"}
        elif what == "clear":
            changes = {name: getattr(Weather(), name) for name in Weather.__dataclass_fields__}
        else:
            changes = {_SHORT.get(what, what): _number(rest.pop(0) if rest else "")}
        if len(rest) > 1:
            raise WeatherError(f"{' '.join(rest)!r}: must be up or down, or nothing")
        directions = _directions(rest[0] if rest else None)
        chosen = list(self._proxies.values()) if name == "all" else [self._proxies[name]]
        for proxy in chosen:
            for way in directions:
                proxy.weather[way].change(**changes)
        return " ".join(words)

    def close(self) -> None:
        """Close all ports."""
        for proxy in self._proxies.values():
            proxy.close()


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise WeatherError(f"{text!r}: must be a number") from None


def main(argv: Sequence[str] | None = None) -> int:
    """Run the proxies until standard input ends. Exit code 2: the configuration is wrong or a port is in use."""
    parser = argparse.ArgumentParser(prog="python -m sitl.run.bad_links", description="UDP proxies with bad weather.")
    parser.add_argument("--config", type=Path, required=True, metavar="FILE", help="the links, as TOML")
    arguments = parser.parse_args(argv)
    try:
        seed, plans = load_plans(arguments.config)
        links = BadLinks(seed, plans, time.monotonic())
    except (WeatherError, OSError) as error:
        print(f"impairment: {error}", file=sys.stderr)
        return _BAD_USAGE

    orders = Orders()
    print("ready", flush=True)
    try:
        _serve(links, orders)
    except KeyboardInterrupt:
        pass
    finally:
        links.close()
    return 0


def _serve(links: BadLinks, orders: Orders) -> None:
    while True:
        timeout_s = links.send_due(time.monotonic())
        readable, _, _ = select.select([*orders.descriptors, *links.sockets], [], [], timeout_s)
        for descriptor in readable:
            if descriptor not in orders.descriptors:
                links.readable(descriptor, time.monotonic())
                continue
            lines = orders.read(descriptor)
            if lines is None:
                return
            for line in lines:
                print(links.order(line), flush=True)


if __name__ == "__main__":
    raise SystemExit(main())
