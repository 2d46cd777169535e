# SPDX-License-Identifier: GPL-3.0-or-later

"""How long a transfer takes: on loopback, over slow links, over lossy ones.

Loopback is measured with real processes (`Flight`), because the programs themselves take the time. Over bad links the
links take it, and hundreds of transfers one after the other take hours. So these are flown in lanes (`Lane`): many
vehicles side by side in this process, with the real modules and real sockets and only MAVProxy's main loop replaced.
Two of the weathers are also flown with real processes, fewer times, to show that it makes no difference.

A link has the same delay and loss each way; vehicle to stations, and station to station.
"""

from __future__ import annotations

import socket
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from gcs_module import module as station_module
from mavproxy_handover.cli.launch import companion_argv, station_argv
from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.tools.resources import shipped
from sitl.bench.autopilot import SHUTTLE, STREAM, A, B, HostedVehicle, SerialAutopilot, Tour
from sitl.bench.results import Committed, Entry, Measurement, Say, quantile, read_journal, transfers
from sitl.bench.rig import (
    IDLE_S,
    VEHICLE,
    BenchError,
    Host,
    Loop,
    Rig,
    Timer,
    companion_config,
    key_file,
    last_words,
    station_config,
    station_entry,
)
from sitl.run.bad_links import BadLinks, LinkPlan
from sitl.run.processes import Child
from sitl.run.wiring import write_toml
from sitl.script.weather import Weather
from sitl.vehicles.ports import PortPicker

__all__ = ["FULL", "LOSSY", "QUICK", "Flight", "LanePlan", "Plan", "fly_lanes", "measure"]

#: "Numbers that are held to" in docs/architecture.md, in milliseconds
LOOPBACK_MEDIAN_MS, LOOPBACK_LATE_MS = 10.0, 50.0
ONE_WAY_TRIPS, SLACK_MS = 6, 50.0
LOSSY_LATE_MS: Final = 3000.0
#: after take-off, until every station has answered CONNECT with the mission that it holds
_SETTLE_S: Final = 3.0
_NAMES: Final = {A: "GCSA", B: "GCSB"}


# ---- one vehicle and two stations -----------------------------------------------------------------------------------


class Wires:
    """Ports and files of one vehicle with two stations, and the journals that they will write."""

    def __init__(self, folder: Path, weather: Weather | None, *, signing: bool) -> None:
        """`weather`: every link goes through a proxy with this both ways (`plans`); None: none does. `signing`: with a
        key for each station. Raises OSError, KeysError."""
        ports = PortPicker()
        self.listen = {sysid: ports.udp() for sysid in _NAMES}
        self._ground = {sysid: ports.udp() for sysid in _NAMES}
        vehicle_to, self._ground_to = self.listen, self._ground
        self.plans: list[LinkPlan] = []
        if weather is not None:
            vehicle_to = self._through("vehicle", vehicle_to, weather, ports)
            self._ground_to = self._through("ground", self._ground, weather, ports)
        self._keys = folder / "keys" if signing else None
        entries = [
            station_entry(name, sysid, vehicle_to[sysid], self._keys and key_file(self._keys, name))
            for sysid, name in _NAMES.items()
        ]
        self.companion = companion_config(folder / "companion", entries, dwell_s=0.0)
        self.stations = {sysid: self._station(folder, sysid, name) for sysid, name in _NAMES.items()}

    def _through(self, kind: str, targets: dict[int, int], weather: Weather, ports: PortPicker) -> dict[int, int]:
        """Put a proxy in front of each port; returns the ports to send to."""
        plans = [
            LinkPlan(f"{kind}-{sysid}", ports.udp(), port, up=weather, down=weather) for sysid, port in targets.items()
        ]
        self.plans += plans
        return {sysid: plan.listen for sysid, plan in zip(targets, plans, strict=True)}

    def _station(self, folder: Path, sysid: int, name: str) -> Path:
        own: Entry = {"name": name, "sysid": sysid, "vehicle": VEHICLE}
        if sysid == A:
            own["mission"] = str(shipped("missions") / "delivery")
        if self._keys is not None:
            own["key"] = str(key_file(self._keys, name))
        peers = {_NAMES[each]: (each, self._ground_to[each]) for each in _NAMES if each != sysid}
        return station_config(folder / name, own, self._ground[sysid], peers, keys=self._keys)

    @property
    def journals(self) -> list[Path]:
        """Companion's, GCSA's, GCSB's."""
        stations = [path.with_name(f"{_NAMES[sysid]}.jsonl") for sysid, path in self.stations.items()]
        return [self.companion.with_name("companion.jsonl"), *stations]

    def flown(self) -> list[Committed]:
        """All commits so far."""
        companion, *stations = map(read_journal, self.journals)
        return transfers(companion, stations)


class Flight(Rig):
    """One vehicle and two stations as real processes: three MAVProxy, and a fourth process for bad links."""

    def __init__(
        self,
        folder: Path,
        pause_s: float,
        *,
        bad_links: bool = False,
        signing: bool = False,
        seed: int = 1,
        companion: Callable[[Path, str, Path], list[str]] = companion_argv,
    ) -> None:
        """`bad_links`: proxies on every link, perfect ones until `weather` is called. `companion`: its command line, of
        configuration, master and tlog. Raises OSError, KeysError.
        """
        super().__init__(folder)
        self.autopilot = SerialAutopilot(self.loop, SHUTTLE[0][0])
        self.tour = Tour(self.autopilot.model, SHUTTLE, pause_s, seed)
        self.wires = Wires(folder, Weather() if bad_links else None, signing=signing)
        self._seed = seed
        self._companion_argv = companion

    def close(self) -> None:
        super().close()
        self.autopilot.close()

    def set_up(self) -> None:
        if self.wires.plans:
            self._start_links(self.wires.plans)
        for sysid, name in _NAMES.items():
            master = f"udpin:127.0.0.1:{self.wires.listen[sysid]}"
            self.run(name, station_argv(self.wires.stations[sysid], master, self.folder / name / "mav.tlog"))
        log = self.folder / "companion" / "mav.tlog"
        self.run("companion", self._companion_argv(self.wires.companion, self.autopilot.device, log))
        model = self.autopilot.model
        model.stream(STREAM)
        self.wait(lambda: model.commander == A, "the parent commands", every_s=0.2)
        self.processes["GCSA"].type("handover share")
        self.wait(self._loaded, "vehicle and partner have the mission package", every_s=0.2)
        model.take_off()
        self.loop.every(0.01, lambda: self.tour.step(time.monotonic()), 1.0)

    def _start_links(self, plans: list[LinkPlan]) -> None:
        links = [{"name": plan.name, "listen": plan.listen, "target": plan.target} for plan in plans]
        config = write_toml(self.folder / "links.toml", {"link": links}, {"seed": self._seed})
        links_process = self.run("links", [sys.executable, "-m", "sitl.run.bad_links", "--config", str(config)])
        self.wait(lambda: "ready" in last_words(links_process), "the links are there", every_s=0.2)

    @property
    def companion(self) -> Child:
        """The companion's process; with a supervisor that."""
        return self.processes["companion"]

    def restart_companion(self) -> None:
        """Kill it, and start it again at once."""
        self.companion.kill()
        self.processes.restart("companion")

    def _loaded(self) -> bool:
        companion, _parent, partner = self.wires.journals
        return _has(companion, "mission_written") and _has(partner, "package_received")

    def weather(self, order: str) -> None:
        """Give the links an order, such as `loss all 0.2`. Raises BenchError if they do not take it."""
        links = self.processes["links"]
        before = len(links.console())
        links.type(order)
        self.wait(lambda: len(links.console()) > before, f"the links take {order!r}", every_s=0.2)
        answer = links.console()[-1]
        if not answer.startswith("ok"):
            raise BenchError(f"links: {order!r}: {answer}")

    def shuttle_until(self, commits: int, limit_s: float) -> None:
        """Let the aircraft go back and forth until that many commits in all, `limit_s` at most."""
        until = time.monotonic() + limit_s
        while self.tour.commits < commits and time.monotonic() < until:
            self.loop.run(0.5)
            self.check()


def _has(journal: Path, event: str) -> bool:
    return journal.is_file() and any(entry["event"] == event for entry in read_journal(journal))


class _StationMaster:
    """A station's link to the vehicle: a UDP port that listens and answers the last sender."""

    def __init__(self, port: int, sysid: int) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setblocking(False)
        self.socket.bind(("127.0.0.1", port))
        self.address = f"udpin:127.0.0.1:{port}"
        self._vehicle: tuple[str, int] | None = None
        #: what MAVProxy's links have for sending messages; frames go out through `write`
        self.mav = mavlink.MAVLink(self, srcSystem=sysid, srcComponent=mavlink.MAV_COMP_ID_MISSIONPLANNER)
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True

    def write(self, data: bytes) -> None:
        if self._vehicle is not None:
            self.socket.sendto(bytes(data), self._vehicle)

    def read(self) -> list[Any]:
        """The messages that have arrived."""
        messages: list[Any] = []
        while True:
            try:
                data, self._vehicle = self.socket.recvfrom(65536)
            except OSError:
                return messages
            messages += self._parser.parse_buffer(data) or []


class Lane:
    """One vehicle that shuttles between two stations, all of it in this process, with bad links between them.

    Many lanes run side by side in one thread, because a transfer over slow or lossy links is nearly all waiting. What
    they cannot show is what MAVProxy itself adds.
    """

    def __init__(self, loop: Loop, folder: Path, weather: Weather, pause_s: float, seed: int) -> None:
        """Everything is made and loaded. Raises OSError, BenchError."""
        self._loop = loop
        self.wires = Wires(folder, weather, signing=False)
        self.vehicle = HostedVehicle(loop, VEHICLE, SHUTTLE, pause_s, seed)
        self._links = BadLinks(str(seed), self.wires.plans, time.monotonic())
        self._stations: list[tuple[Host, _StationMaster]] = []
        self._timers: list[Timer] = []
        for descriptor in self._links.sockets:
            loop.add_reader(descriptor, partial(self._pass, descriptor))
        loop.add_clock(self._send_due)
        try:
            for sysid in _NAMES:
                self._open_station(sysid)
            self.vehicle.load(self.wires.companion)
        except BaseException:
            self.close()
            raise
        self._timers += [loop.every(IDLE_S, self._idle), loop.every(1.0, self._beat)]

    def _send_due(self) -> float | None:
        return self._links.send_due(time.monotonic())

    def _pass(self, descriptor: int) -> None:
        self._links.readable(descriptor, time.monotonic())

    def _open_station(self, sysid: int) -> None:
        master = _StationMaster(self.wires.listen[sysid], sysid)
        host = Host(self._loop, master, sysid, mavlink.MAV_COMP_ID_MISSIONPLANNER)
        self._stations.append((host, master))
        host.load(station_module, str(self.wires.stations[sysid]))
        self._loop.add_reader(master.socket.fileno(), lambda: self._to_station(host, master))

    @staticmethod
    def _to_station(host: Host, master: _StationMaster) -> None:
        for message in master.read():
            host.deliver(message)

    def _idle(self) -> None:
        for host, _master in self._stations:
            host.idle_if_due()

    def _beat(self) -> None:
        """MAVProxy's own heartbeat, which the companion switches off and the stations do not."""
        for _host, master in self._stations:
            master.mav.heartbeat_send(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0)

    @property
    def commanded(self) -> bool:
        """The parent has authority."""
        return bool(self.vehicle.companion.view.commander == A)

    def share(self) -> None:
        """The parent sends the mission package to the vehicle and to the other station."""
        self._stations[0][0].type("handover share")

    @property
    def ready(self) -> bool:
        """The vehicle and both stations have the mission."""
        digest = self.vehicle.companion.arbiter.mission_digest
        held = [host.modules[0][0].aircraft[0].core.digest for host, _master in self._stations]
        return bool(digest) and all(one == digest for one in held)

    @property
    def flying(self) -> bool:
        return bool(self.vehicle.companion.view.phase in (Phase.ON_MISSION, Phase.ON_HANDOVER))

    def check(self) -> None:
        """Raises BenchError if something broke inside a module."""
        stations = [str(dict(host.modules[0][0].faults)) for host, _ in self._stations if host.modules[0][0].faults]
        broken = [text for text in (self.vehicle.faults(), *stations) if text]
        if broken:
            raise BenchError(f"faults inside the modules: {'; '.join(broken)}")

    def close(self) -> None:
        """Unload everything and close all sockets."""
        for timer in self._timers:
            timer.cancel()
        for host, master in self._stations:
            self._loop.remove_reader(master.socket.fileno())
            host.unload()
            master.socket.close()
        self.vehicle.close()
        self._loop.remove_clock(self._send_due)
        for descriptor in self._links.sockets:
            self._loop.remove_reader(descriptor)
        self._links.close()


# ---- what is measured -----------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Condition:
    """The properties of the links. `late_limit_ms`: the limit for 99 of 100 transfers; None: no limit."""

    name: str
    weather: Weather
    #: about this time (s) between a commit and the next entry
    pause_s: float
    #: lanes that share the work in a full run
    lanes: int
    late_limit_ms: float | None
    median_limit_ms: float | None = None

    @property
    def trips_limit_ms(self) -> float:
        """Six one-way trips, without any time for the programs."""
        return ONE_WAY_TRIPS * self.weather.delay_s * 1e3


def _slow(delay_s: float, lanes: int) -> Condition:
    limit_ms = ONE_WAY_TRIPS * delay_s * 1e3 + SLACK_MS
    return Condition(f"{delay_s * 1e3:g} ms one way", Weather(delay_s=delay_s), 0.3 + 2 * delay_s, lanes, limit_ms)


def _lossy(loss: float, lanes: int, limit_ms: float | None) -> Condition:
    return Condition(f"{loss:.0%} loss each way", Weather(loss=loss), 0.6, lanes, limit_ms)


#: conditions that are flown at the same time; together they must leave the machine most of its time
SLOW: Final = (_slow(0.05, 2), _slow(0.25, 6))
LOSSY: Final = (_lossy(0.05, 2, None), _lossy(0.20, 5, LOSSY_LATE_MS), _lossy(0.40, 8, None))
_LOOPBACK: Final = Condition("loopback", Weather(), 0.15, 1, LOOPBACK_LATE_MS, LOOPBACK_MEDIAN_MS)


@dataclass(frozen=True, slots=True)
class LanePlan:
    """Transfers of each condition, the time limit for all of them, and lanes (None: as many as usual)."""

    transfers: int
    limit_s: float
    lanes: int | None = None


@dataclass(frozen=True, slots=True)
class Plan:
    """Transfers on loopback, and with bad links between real processes (each with its time limit); then the lanes."""

    loopback: int
    loopback_limit_s: float
    checked: int
    check_limit_s: float
    waves: tuple[tuple[Condition, ...], ...]
    lanes: LanePlan


FULL = Plan(300, 120.0, 20, 60.0, (SLOW, LOSSY), LanePlan(300, 200.0))
QUICK = Plan(20, 15.0, 0, 0.0, ((SLOW[0], LOSSY[1]),), LanePlan(6, 15.0, 2))


def measure(plan: Plan, folder: Path, say: Say) -> Iterator[Measurement]:
    """Loopback unsigned and signed, then bad links."""
    for signing in (False, True):
        where = folder / ("loopback-signed" if signing else "loopback")
        wanted = plan.loopback // 3 if signing else plan.loopback
        yield from fly_loopback(where, wanted, plan.loopback_limit_s, say, signing=signing)
    if plan.checked:
        yield from fly_with_bad_links(folder / "bad-links", plan.checked, plan.check_limit_s, say)
    for number, wave in enumerate(plan.waves):
        yield from fly_lanes(folder / f"lanes-{number}", wave, plan.lanes, say)


def _measurements(
    condition: Condition, flown: Sequence[Committed], how: str, given_up: int, wanted: int
) -> Iterator[Measurement]:
    if not flown:
        raise BenchError(f"{condition.name}: not one transfer was committed")
    since_entry = [one.since_entry_s * 1e3 for one in flown]
    messages = [float(one.messages) for one in flown]
    parts = {"median": 0.5, "95 %": 0.95, "99 %": 0.99, "max": 1.0}
    details = {
        "transfers": len(flown),
        "wanted": wanted,
        **{f"{name}_ms": value for name, value in _quantiles(since_entry).items()},
        "committed_attempt_ms": _quantiles([one.duration_s * 1e3 for one in flown]),
        "six_one_way_trips_ms": condition.trips_limit_ms,
        "messages_median": median(messages),
        "messages_max": max(messages),
        "attempts_that_failed": sum(one.failed_attempts for one in flown),
        "committed_by_release_timeout": sum(one.by_timeout for one in flown),
        "entries_given_up": given_up,
    }
    limits = {"median": condition.median_limit_ms, "99 %": condition.late_limit_ms}
    for name, part in parts.items():
        yield Measurement(
            "transfers",
            f"duration, {name}",
            "ms",
            {"links": condition.name, "how": how, "n": len(flown), "messages": round(median(messages))},
            ours=quantile(since_entry, part),
            baseline=condition.trips_limit_ms or None,
            limit=limits.get(name),
            judged="ours",
            details=details if name == "median" else {},
            note="from the zone check that noticed the region to the commit, failed attempts included; "
            "baseline: six one-way trips",
        )


def _quantiles(values: Sequence[float]) -> dict[str, float]:
    parts = {"median": 0.5, "p95": 0.95, "p99": 0.99, "max": 1.0}
    return {name: quantile(values, part) for name, part in parts.items()}


def fly_loopback(folder: Path, wanted: int, limit_s: float, say: Say, *, signing: bool) -> Iterator[Measurement]:
    """Real processes, perfect links."""
    condition = replace(_LOOPBACK, name="loopback, signed" if signing else "loopback")
    with Flight(folder, condition.pause_s, signing=signing) as flight:
        flight.shuttle_until(wanted, limit_s)
        flown, given_up = flight.wires.flown(), flight.tour.given_up
    yield from _measurements(condition, flown, "real processes", given_up, wanted)
    took_ms = median(one.duration_s for one in flown) * 1e3
    say(f"{condition.name}, real processes: {len(flown)} transfers, median {took_ms:.1f} ms")


def fly_with_bad_links(folder: Path, each: int, limit_s: float, say: Say) -> Iterator[Measurement]:
    """Real processes over 50 ms one way, then over 20 % loss: the check on the lanes."""
    orders = {SLOW[0]: ("delay all 0.05",), LOSSY[1]: ("delay all 0", "loss all 0.2")}
    with Flight(folder, LOSSY[1].pause_s, bad_links=True, seed=2) as flight:
        for condition, weather in orders.items():
            for order in weather:
                flight.weather(order)
            # the transfer that the change of weather fell into is left out
            flight.shuttle_until(flight.tour.commits + 1, limit_s)
            before, given_up = len(flight.wires.flown()), flight.tour.given_up
            flight.shuttle_until(flight.tour.commits + each, limit_s)
            flown = flight.wires.flown()[before:]
            say(f"{condition.name}, real processes: {len(flown)} transfers")
            yield from _measurements(condition, flown, "real processes", flight.tour.given_up - given_up, each)


class _Fleet:
    """The lanes of one condition."""

    def __init__(self, loop: Loop, folder: Path, condition: Condition, lanes: int, seed: int) -> None:
        self.condition = condition
        self.lanes: list[Lane] = []
        self.open = True
        for number in range(lanes):
            name = f"{condition.name.replace(' ', '-').replace('%', '')}-{number}"
            self.lanes.append(Lane(loop, folder / name, condition.weather, condition.pause_s, seed + number))

    @property
    def commits(self) -> int:
        return sum(lane.vehicle.tour.commits for lane in self.lanes)

    def close(self) -> None:
        if self.open:
            self.open = False
            for lane in self.lanes:
                lane.close()

    def outcome(self, wanted: int) -> Iterator[Measurement]:
        """Check that nothing broke, close all, and read the journals. Raises BenchError."""
        for lane in self.lanes:
            lane.check()
        given_up = sum(lane.vehicle.tour.given_up for lane in self.lanes)
        self.close()
        flown = [one for lane in self.lanes for one in lane.wires.flown()]
        return _measurements(self.condition, flown, "in lanes", given_up, wanted)


def fly_lanes(folder: Path, conditions: Sequence[Condition], plan: LanePlan, say: Say) -> Iterator[Measurement]:
    """These conditions at the same time; each ends when it has enough."""
    loop = Loop(many=True)
    fleets: list[_Fleet] = []
    try:
        for number, condition in enumerate(conditions):
            lanes = condition.lanes if plan.lanes is None else plan.lanes
            fleets.append(_Fleet(loop, folder, condition, lanes, 1000 * (number + 1)))
        _into_the_air(loop, [lane for fleet in fleets for lane in fleet.lanes])
        yield from _watch(loop, fleets, plan, say)
    finally:
        for fleet in fleets:
            fleet.close()


def _into_the_air(loop: Loop, lanes: list[Lane]) -> None:
    for lane in lanes:
        lane.vehicle.autopilot.stream(STREAM)
        loop.run(0.037)  # not all in step
    loop.run_until(lambda: all(lane.commanded for lane in lanes), 60.0, "the parents command")
    for lane in lanes:
        lane.share()
    loop.run_until(lambda: all(lane.ready for lane in lanes), 120.0, "the missions are loaded")
    for lane in lanes:
        lane.vehicle.autopilot.take_off()
    loop.run_until(lambda: all(lane.flying for lane in lanes), 20.0, "the aircraft are on their missions")
    loop.run(_SETTLE_S)
    for lane in lanes:
        lane.vehicle.moves = True


def _watch(loop: Loop, fleets: list[_Fleet], plan: LanePlan, say: Say) -> Iterator[Measurement]:
    began = told_at = time.monotonic()
    while any(fleet.open for fleet in fleets):
        loop.run(0.5)
        now = time.monotonic()
        late = now - began > plan.limit_s
        for fleet in fleets:
            if fleet.open and (late or fleet.commits >= plan.transfers):
                yield from fleet.outcome(plan.transfers)
        if now - told_at > 15.0:
            told_at = now
            say("; ".join(f"{fleet.condition.name}: {fleet.commits}" for fleet in fleets))
