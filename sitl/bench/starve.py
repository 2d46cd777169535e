# SPDX-License-Identifier: GPL-3.0-or-later

"""Whether observers' requests cost the commander its telemetry.

The commander's telemetry of a real vehicle in flight is measured beside four observers that request everything they
can, and without requests, in turns. The baseline is the same flight with the same observers, which only send
heartbeats. Each message is counted at the commander, over all turns of a side; the message with the most loss is the
result.
"""

from __future__ import annotations

import itertools
import math
import random
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.cli.launch import companion_argv
from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.gate.policy.access import names
from mavproxy_handover.mission import package as mission_package
from mavproxy_handover.wire.ids import MISSION_START
from sitl.bench.loop import BenchError, Loop, Timer
from sitl.bench.numbers import abba
from sitl.bench.results import Measurement
from sitl.bench.rig import PARENT, make_stations, write_config
from sitl.bench.station import FakeStation
from sitl.bench.traffic import AUTOPILOT, VEHICLE
from sitl.run.processes import Processes
from sitl.script.places import guard_files, mission_folder
from sitl.vehicles import RunningVehicle, VehicleSpec, launch

__all__ = ["GREED", "OBSERVERS", "RATE_RATIO", "Plan", "measure", "slowest"]

RATE_RATIO: Final = 0.9
OBSERVERS: Final = 4
#: seen less often than this (1/s), a message says nothing about a rate
_LEAST_HZ: Final = 0.9
#: answers to requests, and messages about events, are no telemetry
_NO_TELEMETRY: Final = names("""
    STATUSTEXT PARAM_VALUE PARAM_ERROR COMMAND_ACK FILE_TRANSFER_PROTOCOL TIMESYNC MISSION_COUNT MISSION_ITEM_INT
    TERRAIN_REPORT AUTOPILOT_VERSION HOME_POSITION GPS_GLOBAL_ORIGIN CONNECT
""")
_STREAM_HZ: Final = 4
_READY_LIMIT_S: Final = 150.0
_UP_LIMIT_S: Final = 40.0
_SETTLE_S: Final = 2.0
#: until it flies its mission, and until it stands still
_MANOEUVRE_S: Final = 10.0
_COMPANION_CHANNEL: Final = 1


@dataclass(frozen=True, slots=True)
class Plan:
    """Pairs of turns, the seconds of each, and the kinds of vehicle."""

    pairs: int
    seconds: float
    vehicles: tuple[str, ...] = ("builtin", "arducopter")


@dataclass(frozen=True, slots=True)
class _Slowest:
    """The message that has lost most: its rates with and without greed (1/s), and their ratio."""

    name: str
    greedy_hz: float
    calm_hz: float
    ratio: float


def _ftp(opcode: int, path: bytes) -> mavlink.MAVLink_message:
    head = bytes([0, 0, 0, opcode, len(path), 0, 0, 0, 0, 0, 0, 0])
    return mavlink.MAVLink_file_transfer_protocol_message(0, VEHICLE, AUTOPILOT, list((head + path).ljust(251, b"\0")))


def _command(number: int, *parameters: float) -> mavlink.MAVLink_message:
    values = [*parameters, *[0.0] * (7 - len(parameters))]
    return mavlink.MAVLink_command_long_message(VEHICLE, AUTOPILOT, number, 0, *values)


def _somewhere() -> mavlink.MAVLink_message:
    lat, lon = random.uniform(52.0, 53.0), random.uniform(5.0, 6.0)
    return mavlink.MAVLink_terrain_check_message(round(lat * 1e7), round(lon * 1e7))


_indexes = itertools.count()

#: what a greedy observer asks for, and how often a second
GREED: Final[dict[str, tuple[float, Callable[[], mavlink.MAVLink_message]]]] = {
    "parameter list": (2.0, lambda: mavlink.MAVLink_param_request_list_message(VEHICLE, AUTOPILOT)),
    "directory": (2.0, lambda: _ftp(3, b"/")),
    "file": (2.0, lambda: _ftp(4, b"@PARAM/param.pck")),
    "banner": (2.0, lambda: _command(mavlink.MAV_CMD_DO_SEND_BANNER)),
    "terrain": (2.0, _somewhere),
    "mission list": (2.0, lambda: mavlink.MAVLink_mission_request_list_message(VEHICLE, AUTOPILOT, 0)),
    "mission item": (10.0, lambda: mavlink.MAVLink_mission_request_int_message(VEHICLE, AUTOPILOT, 1, 0)),
    "parameter": (
        20.0,
        lambda: mavlink.MAVLink_param_request_read_message(VEHICLE, AUTOPILOT, b"", next(_indexes) % 500),
    ),
    "version": (2.0, lambda: _command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)),
    "home": (2.0, lambda: _command(mavlink.MAV_CMD_GET_HOME_POSITION)),
    "streams": (1.0, lambda: mavlink.MAVLink_request_data_stream_message(VEHICLE, AUTOPILOT, 0, 50, 1)),
    "interval": (1.0, lambda: _command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 30, 1000)),
    "log list": (1.0, lambda: mavlink.MAVLink_log_request_list_message(VEHICLE, AUTOPILOT, 0, 0xFFFF)),
}


class _Flight:
    """A vehicle, its companion, the commander and the observers. Leaving the `with` block ends all processes."""

    def __init__(self, folder: Path, kind: str) -> None:
        """Raises OSError."""
        self.loop = Loop()
        self.stations = make_stations(self.loop, 1 + OBSERVERS)
        self._folder, self._kind = folder, kind
        self._processes = Processes()
        self._vehicle: RunningVehicle | None = None
        self._greed: list[Timer] = []

    @property
    def commander(self) -> FakeStation:
        return self.stations[0]

    def __enter__(self) -> _Flight:
        try:
            self._take_off()
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *_exception: object) -> None:
        self.close()

    def close(self) -> None:
        self._processes.stop_all()
        if self._vehicle is not None:
            self._vehicle.stop()
        for station in self.stations:
            station.close()

    def _take_off(self) -> None:
        package = mission_package.load(mission_folder("delivery"))
        home = package.route.home
        script, parameters = guard_files()
        spec = VehicleSpec(
            home=(home.lat_deg, home.lon_deg, home.alt_m, 0.0),
            sysid=VEHICLE,
            scripts=(script,),
            defaults=parameters,
            parameters={"HNDO_CHAN": _COMPANION_CHANNEL},
        )
        self._vehicle = launch(self._kind, spec, self._folder / "vehicle")
        home_folder = self._folder / "companion"
        config = write_config(home_folder, self.stations, guard=True)
        argv = companion_argv(config, self._vehicle.companion_master, home_folder / "mav.tlog")
        self._processes.start("companion", argv, home_folder)
        commander = self.commander
        self._wait(lambda: commander.commander == PARENT, _UP_LIMIT_S, "the parent commands")
        commander.share(package)
        self._wait(lambda: commander.shared or bool(commander.share_trouble), _READY_LIMIT_S, "the mission is loaded")
        if commander.share_trouble:
            raise BenchError(f"mission package refused: {commander.share_trouble}")
        commander.digest = package.digest  # the observers have none, so none takes the aircraft
        start = self.loop.every(3.0, lambda: commander.send(_command(MISSION_START)))
        self._wait(lambda: commander.phase == Phase.ON_MISSION, _READY_LIMIT_S, "the aircraft has started")
        start.cancel()
        self.loop.run(_MANOEUVRE_S)
        commander.send(_command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0))  # it stays in the zone of no other station
        commander.send(mavlink.MAVLink_request_data_stream_message(VEHICLE, AUTOPILOT, 0, _STREAM_HZ, 1))
        self.loop.run(_MANOEUVRE_S)

    def _wait(self, condition: Callable[[], bool], limit_s: float, what: str) -> None:
        try:
            self.loop.run_until(lambda: condition() or not self._alive(), limit_s, what)
            if not self._alive():
                raise BenchError(f"{what}: a process has ended")
        except BenchError as error:
            tail = " | ".join(self._processes["companion"].console()[-5:])
            raise BenchError(f"{self._kind}: {error} (console: {tail})") from None

    def _alive(self) -> bool:
        return self._vehicle is not None and self._vehicle.alive() and self._processes["companion"].alive()

    def turn(self, greedy: bool, seconds: float) -> Counter[int]:
        """The messages that the commander hears in this time (s), by id. Raises BenchError."""
        if greedy:
            for number, observer in enumerate(self.stations[1:]):
                self._ask(observer, number)
        self.loop.run(_SETTLE_S)
        before = self.commander.heard.copy()
        self.loop.run(seconds)
        heard = self.commander.heard - before
        for timer in self._greed:
            timer.cancel()
        self._greed = []
        if not self._alive() or self.commander.commander != PARENT or self.commander.phase != Phase.ON_MISSION:
            raise BenchError(f"{self._kind}: the flight did not go on as it was")
        return heard

    def _ask(self, observer: FakeStation, number: int) -> None:
        def asks(make: Callable[[], Any]) -> Callable[[], None]:
            return lambda: observer.send(make())

        for place, (per_second, make) in enumerate(GREED.values()):
            first_in_s = (number * 0.618 + place * 0.382) % 1.0 / per_second
            self._greed.append(self.loop.every(1.0 / per_second, asks(make), first_in_s))


def slowest(greedy: Counter[int], calm: Counter[int], seconds: float) -> _Slowest:
    """The message whose rate has fallen most, of those that are telemetry. Raises BenchError if there is none."""
    found = _Slowest("", 0.0, 0.0, math.inf)
    for msgid, count in calm.items():
        known = mavlink.mavlink_map.get(msgid)
        if known is None or known.msgname in _NO_TELEMETRY or count < _LEAST_HZ * seconds:
            continue
        ratio = greedy[msgid] / count
        if ratio < found.ratio:
            found = _Slowest(known.msgname, greedy[msgid] / seconds, count / seconds, ratio)
    if not found.name:
        raise BenchError("the commander hears no telemetry")
    return found


def measure(folder: Path, vehicle: str, plan: Plan, say: Callable[[str], None]) -> Iterator[Measurement]:
    """Fly, ask, count. Raises BenchError, LaunchError, OSError, MissionError."""
    heard: dict[bool, Counter[int]] = {True: Counter(), False: Counter()}
    begun = time.monotonic()
    with _Flight(folder, vehicle) as flight:
        say(f"{vehicle}: in the air after {time.monotonic() - begun:.0f} s")
        for number, order in enumerate(islice(abba(), plan.pairs), 1):
            for greedy in order:
                heard[greedy] += flight.turn(greedy, plan.seconds)
            seconds = number * plan.seconds
            lost = slowest(heard[True], heard[False], seconds)
            say(f"{vehicle}, {seconds:.0f} s each: {lost.name} {lost.greedy_hz:.2f} of {lost.calm_hz:.2f} Hz")
    texts = mavlink.MAVLINK_MSG_ID_STATUSTEXT
    kinds = {msgid: mavlink.mavlink_map[msgid].msgname for msgid in heard[False] if msgid in mavlink.mavlink_map}
    yield Measurement(
        "starve",
        "telemetry at the commander, slowest message",
        "Hz",
        {"vehicle": vehicle, "observers": OBSERVERS},
        lost.greedy_hz,
        lost.calm_hz,
        lost.ratio,
        pairs=plan.pairs,
        limit=RATE_RATIO,
        at_least=True,
        details={
            "message": lost.name,
            "statustext_hz": [heard[greedy][texts] / seconds for greedy in (True, False)],
            "rates_hz": {
                name: [heard[greedy][msgid] / seconds for greedy in (True, False)] for msgid, name in kinds.items()
            },
            "asked_hz_by_each": {what: per_second for what, (per_second, _make) in GREED.items()},
        },
        note=f"{vehicle}: {lost.name} has lost most; lines of text come {heard[True][texts] / seconds:.1f} and "
        f"{heard[False][texts] / seconds:.1f} times a second",
    )
