# SPDX-License-Identifier: GPL-3.0-or-later

"""A lane: one vehicle and two stations in this process, on real sockets, with bad links between them if wanted.

Many lanes run side by side in one thread, because a transfer over slow or lossy links is nearly all waiting. What they
cannot show is what MAVProxy itself adds; `flight.py` does that with real processes, and for two weathers both are
measured.
"""

from __future__ import annotations

import socket
import time
from functools import partial
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import handover as mavlink

from gcs_module import module as station_module
from mavproxy_handover.companion import module as vehicle_module
from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.wire.ids import COMPANION_COMPID
from sitl.bench.autopilot import FakeAutopilot
from sitl.bench.host import IDLE_S, Host
from sitl.bench.loop import BenchError, Loop, Timer
from sitl.bench.shuttle import A, B, Shuttle, Wires, write_files
from sitl.bench.traffic import VEHICLE, Place
from sitl.run.bad_links import BadLinks, LinkPlan
from sitl.script.weather import Weather
from sitl.vehicles.ports import PortPicker

__all__ = ["Lane", "link_plans"]

_COMPONENT = mavlink.MAV_COMP_ID_MISSIONPLANNER
_STREAM = 50


def link_plans(ports: PortPicker, weather: Weather, targets: dict[str, int]) -> tuple[list[LinkPlan], dict[str, int]]:
    """A proxy with the same weather both ways for each port in `targets`.

    Also returns the ports to send to, by name.
    """
    plans = [LinkPlan(name, ports.udp(), port, up=weather, down=weather) for name, port in targets.items()]
    return plans, {plan.name: plan.listen for plan in plans}


class _VehicleMaster:
    """The companion's link to the autopilot: no wire, but no call within a call either."""

    def __init__(self) -> None:
        self.to_autopilot: list[bytes] = []

    def write(self, data: bytes) -> None:
        self.to_autopilot.append(bytes(data))


class _StationMaster:
    """A station's link to the vehicle: a UDP port that listens and answers the last sender."""

    def __init__(self, port: int, sysid: int) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setblocking(False)
        self.socket.bind(("127.0.0.1", port))
        self._vehicle: tuple[str, int] | None = None
        #: what MAVProxy's links have for sending messages; frames go out through `write`
        self.mav = mavlink.MAVLink(self, srcSystem=sysid, srcComponent=_COMPONENT)
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
    """One vehicle that shuttles between two stations."""

    def __init__(self, loop: Loop, folder: Path, weather: Weather, pause_s: float, seed: int) -> None:
        """Everything is made and loaded. Raises OSError, BenchError."""
        #: the aircraft goes back and forth; not before it is in the air and the stations know it
        self.shuttling = False
        self._loop = loop
        self._timers: list[Timer] = []
        self._links: BadLinks | None = None
        self._stations: dict[int, tuple[Host, _StationMaster]] = {}
        ports = PortPicker()
        listen = {sysid: ports.udp() for sysid in (A, B)}
        ground = {sysid: ports.udp() for sysid in (A, B)}
        vehicle_to, ground_to = listen, ground
        plans: list[LinkPlan] = []
        if weather != Weather():
            named = {f"vehicle-{sysid}": port for sysid, port in listen.items()}
            named |= {f"ground-{sysid}": port for sysid, port in ground.items()}
            plans, senders = link_plans(ports, weather, named)
            vehicle_to = {sysid: senders[f"vehicle-{sysid}"] for sysid in (A, B)}
            ground_to = {sysid: senders[f"ground-{sysid}"] for sysid in (A, B)}
        self.wires: Wires = write_files(folder, vehicle_to, ground, ground_to)
        master = _VehicleMaster()
        self._master = master
        self._parser = mavlink.MAVLink(None)
        self.autopilot = FakeAutopilot(loop, self._from_autopilot, Place(52.6790, 5.9240))
        self.shuttle = Shuttle(self.autopilot, pause_s, seed)
        try:
            if plans:
                self._links = BadLinks(str(seed), plans, time.monotonic())
                self._open_links(self._links)
            for sysid in (A, B):
                self._open_station(sysid, listen[sysid])
            self.companion = Host(loop, master, VEHICLE, COMPANION_COMPID)
            self.module = self.companion.load(vehicle_module, str(self.wires.companion))
        except BaseException:
            self.close()
            raise
        self._timers += [loop.every(IDLE_S, self._idle), loop.every(1.0, self._beat)]

    def _open_links(self, links: BadLinks) -> None:
        for descriptor in links.sockets:
            self._loop.add_reader(descriptor, partial(self._pass, links, descriptor))
        self._loop.add_clock(self._send_due)

    def _send_due(self) -> float | None:
        return None if self._links is None else self._links.send_due(time.monotonic())

    @staticmethod
    def _pass(links: BadLinks, descriptor: int) -> None:
        links.readable(descriptor, time.monotonic())

    def _open_station(self, sysid: int, port: int) -> None:
        master = _StationMaster(port, sysid)
        host = Host(self._loop, master, sysid, _COMPONENT)
        self._stations[sysid] = (host, master)
        host.load(station_module, str(self.wires.stations[sysid]))
        self._loop.add_reader(master.socket.fileno(), lambda: self._to_station(host, master))

    # ---- what goes on ---------------------------------------------------------------------------------------------

    def _from_autopilot(self, raw: bytes) -> None:
        for message in self._parser.parse_buffer(raw) or []:
            self.companion.deliver(message)
        self._to_autopilot()

    def _to_autopilot(self) -> None:
        waiting, self._master.to_autopilot = self._master.to_autopilot, []
        for raw in waiting:
            self.autopilot.receive(raw)

    @staticmethod
    def _to_station(host: Host, master: _StationMaster) -> None:
        for message in master.read():
            host.deliver(message)

    def _idle(self) -> None:
        self.companion.idle_if_due()
        self._to_autopilot()
        for host, _master in self._stations.values():
            host.idle_if_due()
        if self.shuttling:
            self.shuttle.step()

    def _beat(self) -> None:
        """MAVProxy's own heartbeat, which the companion switches off and the stations do not."""
        for _host, master in self._stations.values():
            master.mav.heartbeat_send(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0)

    # ---- from the start to the air --------------------------------------------------------------------------------

    def begin(self) -> None:
        """The aircraft stands in the parent's zone and speaks."""
        self.autopilot.stream(_STREAM)

    @property
    def commanded(self) -> bool:
        """The parent has authority."""
        return bool(self.module.companion.view.commander == A)

    def share(self) -> None:
        """The parent sends the mission package to the vehicle and to the other station."""
        self._stations[A][0].type("handover share")

    @property
    def ready(self) -> bool:
        """The vehicle and both stations have the mission."""
        digest = self.module.companion.arbiter.mission_digest
        held = [host.modules[0][0].core.digest for host, _master in self._stations.values()]
        return bool(digest) and all(one == digest for one in held)

    @property
    def flying(self) -> bool:
        return bool(self.module.companion.view.phase in (Phase.ON_MISSION, Phase.ON_HANDOVER))

    def check(self) -> None:
        """Raises BenchError if something broke inside a module."""
        faults = dict(self.module.companion.faults)
        for host, _master in self._stations.values():
            faults.update(host.modules[0][0].faults)
        if faults or self.module.companion.failed:
            raise BenchError(f"faults inside the modules: {faults}")

    def close(self) -> None:
        """Unload everything and close all sockets."""
        for timer in self._timers:
            timer.cancel()
        self.autopilot.silence()
        for host, master in self._stations.values():
            self._loop.remove_reader(master.socket.fileno())
            host.unload()
            master.socket.close()
        if hasattr(self, "companion"):
            self.companion.unload()
        if self._links is not None:
            self._loop.remove_clock(self._send_due)
            for descriptor in self._links.sockets:
                self._loop.remove_reader(descriptor)
            self._links.close()
