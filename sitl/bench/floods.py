# SPDX-License-Identifier: GPL-3.0-or-later

"""Floods of a feed and of onboard links: what they cost leases, the commander's telemetry, and its frames.

One companion process flies with RTK corrections of two stations and two onboard programs, one at a UDP port and one at
a TCP port. In turns, with a flood and without, the same is counted:

* leases that arrive at the autopilot, and the longest time between two of them;
* the commander's telemetry: the message whose rate has fallen most;
* frames that the commander sends, and that arrive at the autopilot.

There are three floods: corrections of the station that is their source, sensor frames of the program at UDP, and those
of the program at TCP.
"""

from __future__ import annotations

import socket
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import islice, pairwise
from pathlib import Path
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.cli.launch import companion_argv
from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.wire.ids import COMPANION_COMPID, LEASE_TUNNEL
from sitl.bench.autopilot import STREAM, A, SerialAutopilot
from sitl.bench.frames import IN_ZONE_A
from sitl.bench.load import LIMIT_S
from sitl.bench.reads import TELEMETRY_RATIO, slowest
from sitl.bench.results import Measurement, Pair, Say, compare, from_comparison, in_turns
from sitl.bench.rig import VEHICLE, Rig, Timer, companion_config, frame_key, shipped_mission
from sitl.bench.stations import load_mission, make_stations, uplink_message
from sitl.vehicles.ports import LOOPBACK, PortPicker

__all__ = ["FULL", "QUICK", "FloodPlan", "measure"]

#: leases and uplink frames with a flood, as a part of those without
RATIO: Final = 0.95
_UPLINK_HZ: Final = 50
_SETTLE_S: Final = 0.5
_EVERY_S: Final = 0.01
#: sticks pass after they have rested for a second in flight
_NO_STICKS_S: Final = 2.0
_PROGRAMS: Final = {"udp": 195, "tcp": 196}
_TUNNEL: Final = mavlink.MAVLINK_MSG_ID_TUNNEL


@dataclass(frozen=True, slots=True)
class FloodPlan:
    """Seconds of a turn, pairs of turns for each flood, and frames of a flood in a second."""

    seconds: float
    pairs: int
    frames_per_s: int = 3000


FULL = FloodPlan(6.0, 5)
QUICK = FloodPlan(1.5, 1)


@dataclass(frozen=True, slots=True)
class Turn:
    """The counts of one turn."""

    leases: int
    longest_gap_s: float
    telemetry: Counter[int]
    #: part of the commander's frames that arrived
    arrived: float
    flood: int


class Flooded(Rig):
    """A vehicle in flight, its companion, two stations and two onboard programs."""

    def __init__(self, folder: Path, frames_per_s: int) -> None:
        """Raises OSError."""
        super().__init__(folder)
        self.autopilot = SerialAutopilot(self.loop, IN_ZONE_A)
        self.commander, self.source = self.stations = make_stations(self.loop, 2)
        self._at_once = max(1, round(frames_per_s * _EVERY_S))
        picker = PortPicker()
        self._ports = {"udp": picker.udp(), "tcp": picker.tcp()}
        self._datagrams = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._datagrams.setblocking(False)
        self._stream: socket.socket | None = None
        self._leases: list[float] = []
        self._underway: set[bytes] = set()
        self._number = self._flood = 0
        corrections = mavlink.MAVLink_gps_rtcm_data_message(0, 180, bytes(180))
        target = mavlink.MAVLink_landing_target_message(0, 0, 8, 0.1, 0.1, 5.0, 0.0, 0.0)
        own = {
            kind: mavlink.MAVLink(None, srcSystem=VEHICLE, srcComponent=number) for kind, number in _PROGRAMS.items()
        }
        #: kind of flood -> sends one frame of it
        self.floods: dict[str, Callable[[], None]] = {
            "feed": partial(self.source.put, self.source.pack(corrections)),
            "onboard udp": partial(self._datagram, bytes(target.pack(own["udp"]))),
            "onboard tcp": partial(self._bytes, bytes(target.pack(own["tcp"]))),
        }

    def set_up(self) -> None:
        links = {"udp": f"udpin:{LOOPBACK}:{self._ports['udp']}", "tcp": f"tcpin:{LOOPBACK}:{self._ports['tcp']}"}
        rights = {"rights": ["sensors"], "sensors": ["LANDING_TARGET"]}
        more = {
            "feeds": {"rtk": [self.source.name, self.commander.name]},
            "onboard": [
                {"name": f"program-{kind}", "component": number, "link": links[kind], **rights}
                for kind, number in _PROGRAMS.items()
            ],
        }
        entries = [station.entry() for station in self.stations]
        config = companion_config(self.folder / "companion", entries, more=more)
        self.run("companion", companion_argv(config, self.autopilot.device, self.folder / "companion" / "mav.tlog"))
        model = self.autopilot.model
        model.stream(STREAM)
        model.on_frame = self._saw
        self.wait(lambda: self.commander.commander == A, "the parent commands")
        package = shipped_mission("delivery")
        load_mission(self, self.commander, package)
        self.commander.digest = package.digest
        model.take_off()
        self.wait(lambda: self.commander.phase == Phase.ON_MISSION, "the aircraft is on its mission")
        self._stream = socket.create_connection((LOOPBACK, self._ports["tcp"]))
        self._stream.setblocking(False)
        self.loop.add_reader(self._stream.fileno(), self._drain)
        self.loop.run(_NO_STICKS_S)

    def close(self) -> None:
        super().close()
        for station in self.stations:
            station.close()
        self.autopilot.close()
        self._datagrams.close()
        if self._stream is not None:
            self._stream.close()

    def turn(self, kind: str, flooded: bool, seconds: float) -> Turn:
        """Count for these seconds, with this flood or without. Raises BenchError."""
        timers: list[Timer] = []
        if flooded:
            timers.append(self.loop.every(_EVERY_S, partial(self._send_flood, self.floods[kind])))
        self.loop.run(_SETTLE_S)
        self._underway.clear()
        before, first, begun, flood = self.commander.heard.copy(), len(self._leases), self._number, self._flood
        started_at = time.monotonic()
        timers.append(self.loop.every(1.0 / _UPLINK_HZ, self._send))
        self.loop.run(seconds)
        marks = [started_at, *self._leases[first:], time.monotonic()]
        heard = self.commander.heard - before
        timers[-1].cancel()
        self.loop.run(_SETTLE_S)
        for timer in timers:
            timer.cancel()
        self.check()
        sent = self._number - begun
        return Turn(
            len(marks) - 2,
            max(after - earlier for earlier, after in pairwise(marks)),
            heard,
            (sent - len(self._underway)) / sent,
            self._flood - flood,
        )

    def _saw(self, raw: bytes) -> None:
        self._underway.discard(frame_key(raw))
        ours = raw[0] == 0xFD and raw[6] == COMPANION_COMPID and int.from_bytes(raw[7:10], "little") == _TUNNEL
        if ours and int.from_bytes(raw[10:12], "little") == LEASE_TUNNEL:
            self._leases.append(self.autopilot.received_at)

    def _send(self) -> None:
        self._number += 1
        raw = self.commander.pack(uplink_message(self._number))
        self._underway.add(frame_key(raw))
        self.commander.put(raw)

    def _send_flood(self, send: Callable[[], None]) -> None:
        for _number in range(self._at_once):
            try:
                send()
            except BlockingIOError:  # the companion does not read faster
                return
            self._flood += 1

    def _datagram(self, raw: bytes) -> None:
        self._datagrams.sendto(raw, (LOOPBACK, self._ports["udp"]))

    def _bytes(self, raw: bytes) -> None:
        if self._stream is not None:
            self._stream.send(raw)

    def _drain(self) -> None:
        if self._stream is not None:
            self._stream.recv(65536)


def measure(plan: FloodPlan, folder: Path, say: Say) -> Iterator[Measurement]:
    """Four lines for each flood. Raises BenchError, ConfigError, OSError, MissionError."""
    with Flooded(folder / "floods", plan.frames_per_s) as rig:
        for kind in rig.floods:
            turns: list[tuple[Turn, Turn]] = []
            for with_flood, without in islice(in_turns(partial(rig.turn, kind, seconds=plan.seconds)), plan.pairs):
                turns.append((with_flood, without))
                say(
                    f"{kind}: {with_flood.flood} frames; leases {with_flood.leases} of {without.leases}, uplink "
                    f"{with_flood.arrived:.3f} of {without.arrived:.3f}, longest gap {with_flood.longest_gap_s:.2f} s"
                )
            yield from _results(kind, turns, plan)


def _results(kind: str, turns: list[tuple[Turn, Turn]], plan: FloodPlan) -> Iterator[Measurement]:
    seconds, case = plan.seconds, {"flood": kind}
    details: dict[str, Any] = {"frames_of_the_flood_per_s": [flooded.flood / seconds for flooded, _calm in turns]}
    rates = {
        "leases at the autopilot": ("1/s", [Pair(a.leases / seconds, b.leases / seconds) for a, b in turns]),
        "the commander's frames that arrive": ("part", [Pair(a.arrived, b.arrived) for a, b in turns]),
    }
    for what, (unit, pairs) in rates.items():
        yield from_comparison("floods", what, unit, case, compare(pairs), limit=RATIO, at_least=True, details=details)
    flooded, calm = Counter[int](), Counter[int]()
    for with_flood, without in turns:
        flooded += with_flood.telemetry
        calm += without.telemetry
    lost = slowest(flooded, calm, seconds * len(turns))
    yield Measurement(
        "floods",
        "telemetry at the commander, slowest message",
        "Hz",
        case,
        lost.greedy_hz,
        lost.calm_hz,
        lost.ratio,
        pairs=len(turns),
        limit=TELEMETRY_RATIO,
        at_least=True,
        details={"message": lost.name, **details},
    )
    gap_s, calm_gap_s = (max(turn[side].longest_gap_s for turn in turns) for side in (0, 1))
    yield Measurement(
        "floods",
        "longest gap between leases",
        "s",
        case,
        gap_s,
        calm_gap_s,
        limit=LIMIT_S,
        judged="ours",
        details=details,
    )
