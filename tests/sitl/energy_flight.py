# SPDX-License-Identifier: GPL-3.0-or-later

"""An ArduCopter in the wind that flies out and comes back, its energy predicted and counted. For tests.

It takes off to 20 m, flies straight out, and returns by RTL; with a payload it lets go of that out there. Everything it
says goes through `EnergyMonitor`, the object that ships, in the autopilot's own time. Needs an ArduCopter SITL program.
"""

from __future__ import annotations

import select
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import all as dialect

from mavproxy_handover.core.safety.energy import EnergyFact, EnergyModel, Piece, Wind, way_home
from mavproxy_handover.core.safety.energy_prior import EnergySettings
from mavproxy_handover.mission.geodesy import bearing_deg, distance_m, offset
from mavproxy_handover.monitors.energy import EnergyMonitor
from mavproxy_handover.vehicle.state import VehicleState
from sitl.vehicles import VehicleSpec, launch
from tests.sitl.guard_flight import HOME, Wire

__all__ = ["Flight", "Flown", "arm", "fly"]

ALTITUDE_M = 20.0
AUTO, GUIDED = 3, 4
#: tries to write a mission
UPLOADS = 5
#: what is asked of the autopilot: message id -> times a second
RATES = {33: 5, 30: 4, 147: 4, 168: 2, 245: 2, 42: 2}
#: what EKF3 needs to tell the wind: the drag of SITL's quad (it prints these at its start)
DRAG = {"EK3_DRAG_BCOEF_X": 9.5, "EK3_DRAG_BCOEF_Y": 9.5, "EK3_DRAG_MCOEF": 0.082}
#: a servo gripper, and SITL's, which grabs a kilogram on the ground
GRIPPER = {"GRIP_ENABLE": 1.0, "GRIP_TYPE": 1.0, "SERVO9_FUNCTION": 28.0, "SIM_GRPS_ENABLE": 1.0, "SIM_GRPS_PIN": 9.0}


@dataclass(frozen=True, slots=True)
class Flown:
    """What a flight used (Wh), in all and from the turn on, and what was predicted: of all of it by what was configured
    and the true wind, of the return at the turn by what had been learned. `fact`: what was known at the turn."""

    used_wh: float
    planned_wh: float
    used_back_wh: float
    predicted_back_wh: float
    fact: EnergyFact


class Flight:
    """One flight, followed. Time is the autopilot's, in seconds."""

    def __init__(self, address: str, settings: EnergySettings) -> None:
        self.wire = Wire(address, 255, 190)
        self.aircraft = VehicleState()
        self.faults: list[str] = []
        self.monitor = EnergyMonitor(settings, lambda _where, text: self.faults.append(text))
        self.now = 0.0
        self.used_wh = 0.0
        self.reached = 0
        self.asked: list[Any] = []
        self.results: dict[int, int] = {}
        self.ready = False
        self.texts: list[str] = []
        #: called after each position: a busy computer reads several at once
        self.on_position: Callable[[], object] = lambda: None
        self._second = 0.0
        self._beat_at = 0.0

    def pump(self) -> None:
        """Read what came."""
        if time.monotonic() >= self._beat_at:
            self._beat_at = time.monotonic() + 0.1
            self.wire.send(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
        select.select([self.wire.socket], [], [], 0.01)
        for message in self.wire.receive():
            if message.get_srcSystem() == 1 and message.get_srcComponent() == 1:
                self._take(message)
        if self.now >= self._second + 1.0:
            self._second = self.now
            self.monitor.update(self.aircraft, self.now, grounded=not self.aircraft.armed)

    def _take(self, message: Any) -> None:
        kind = message.get_type()
        self.now = max(self.now, getattr(message, "time_boot_ms", 0) / 1000.0)
        self.aircraft.on_message(message, self.now)
        if kind == "GLOBAL_POSITION_INT":
            self.on_position()
        if kind in ("WIND", "BATTERY_STATUS"):
            self.monitor.on_message(message, self.now, not self.aircraft.armed)
        if kind == "BATTERY_STATUS":
            self.used_wh = message.energy_consumed / 36.0
        elif kind == "MISSION_ITEM_REACHED":
            self.reached = message.seq
        elif kind == "COMMAND_ACK":
            self.results[message.command] = message.result
        elif kind in ("MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK"):
            self.asked.append(message)
        elif kind == "STATUSTEXT":
            self.texts.append(message.text)

    @property
    def on_ground(self) -> bool:
        """By its height: it takes off from the same place."""
        where = self.aircraft.where
        return where is not None and where[2] < 0.3

    def until(self, holds: Callable[[], object], limit_s: float, what: str) -> None:
        """Wait, for so much of the autopilot's time at most, and never for minutes of ours."""
        end, wall = self.now + limit_s, time.monotonic() + 30.0 + limit_s
        while not holds():
            if self.now >= end or time.monotonic() >= wall:
                raise AssertionError(f"not in time: {what}; {self.texts[-6:]}")
            self.pump()

    def command(self, command: int, *parameters: float) -> bool:
        """Whether the autopilot accepts it."""
        self.results.pop(command, None)
        self.wire.send(
            dialect.MAVLink_command_long_message(1, 1, command, 0, *parameters, *[0.0] * (7 - len(parameters)))
        )
        self.until(lambda: command in self.results, 10, f"an answer to command {command}")
        return self.results[command] == dialect.MAV_RESULT_ACCEPTED

    def upload(self, items: list[Any]) -> None:
        """Write a mission. A request that is repeated on a busy computer breaks an upload off: it is tried again."""
        answers = [self._upload(items)]
        while answers[-1].type != dialect.MAV_MISSION_ACCEPTED:
            assert len(answers) < UPLOADS, answers
            answers.append(self._upload(items))

    def _upload(self, items: list[Any]) -> Any:
        """One try; the autopilot's answer."""
        self.asked.clear()
        self.wire.send(dialect.MAVLink_mission_count_message(1, 1, len(items), 0))
        while True:
            self.until(lambda: self.asked, 20, "mission upload")
            message = self.asked.pop(0)
            if message.get_type() == "MISSION_ACK":
                return message
            self.wire.send(items[message.seq])


def _item(seq: int, command: int, place: tuple[float, float] = (0.0, 0.0), alt_m: float = 0.0, first: float = 0) -> Any:
    lat, lon = (round(degrees * 1e7) for degrees in place)
    return dialect.MAVLink_mission_item_int_message(1, 1, seq, 3, command, 0, 1, first, 0, 0, 0, lat, lon, alt_m, 0)


def fly(
    folder: Path,
    settings: EnergySettings,
    out: tuple[float, float],
    wind: Wind,
    speedup: float = 12.0,
    *,
    return_mps: float | None = None,
) -> Flown:
    """Out to a place so many metres east and north of home, in that wind, and back.

    With a `payload_kg` in the settings SITL's kilogram is carried out and left there. `return_mps`: RTL_SPEED; None: 0.
    """
    place = offset(HOME[0], HOME[1], *out)
    winds = {"SIM_WIND_SPD": wind.speed_mps, "SIM_WIND_DIR": wind.from_deg, "SIM_WIND_T": 1.0}
    gripper = GRIPPER if settings.payload_kg else {}
    speeds = {} if return_mps is None else {"RTL_SPEED": return_mps * 100.0}
    parameters = {"SCR_ENABLE": 0.0, **DRAG, **winds, **gripper, **speeds}
    spec = VehicleSpec(home=HOME, speedup=speedup, parameters=parameters)
    vehicle = launch("arducopter", spec, folder)
    flight = None
    try:
        flight = Flight(vehicle.address(1), settings)
        return _fly(flight, settings, place, wind, return_mps)
    finally:
        if flight is not None:
            flight.wire.socket.close()
        vehicle.stop()


def _fly(
    flight: Flight, settings: EnergySettings, place: tuple[float, float], wind: Wind, return_mps: float | None
) -> Flown:
    length, bearing = distance_m(*HOME[:2], *place), bearing_deg(*HOME[:2], *place)
    flight.until(lambda: flight.now > 0.0 or flight.aircraft.telemetry.heartbeat.at >= 0.0, 60, "the autopilot")
    for message, hertz in RATES.items():
        flight.command(511, message, 1e6 / hertz)
    flight.until(lambda: flight.now > 15.0, 60, "room for a mission")
    items = [_item(0, 16, HOME[:2]), _item(1, 22, alt_m=ALTITUDE_M), _item(2, 16, place, ALTITUDE_M)]
    if settings.payload_kg:
        items.append(_item(3, 211, first=1))  # the first gripper lets go
        flight.monitor.released(3)
    flight.upload([*items, _item(len(items), 20)])
    if settings.payload_kg:
        assert flight.command(211, 1, 1)
        flight.until(lambda: any("grabbed" in text for text in flight.texts), 30, "the payload in the gripper")
        end = flight.now + 5.0
        flight.until(lambda: flight.now >= end, 10, "the jaws to close")
    arm(flight)
    began_wh = flight.used_wh
    assert flight.command(300)
    flight.until(lambda: flight.reached >= 2, 900, "the way out")
    fact, turned_wh = flight.monitor.fact, flight.used_wh
    # in a wind that blows down to the ground, ArduCopter is long in noticing that it stands
    flight.until(lambda: flight.on_ground or not flight.aircraft.armed, 900, "the way back and the landing")
    assert flight.faults == []
    assert fact.model is not None
    prior = settings.model(wind)
    assert prior is not None
    assert not settings.payload_kg or any("released" in text for text in flight.texts), flight.texts
    out_pieces = (Piece(climb_m=ALTITUDE_M), Piece(length_m=length, bearing_deg=bearing))
    back = (bearing + 180.0) % 360.0
    return Flown(
        used_wh=flight.used_wh - began_wh,
        planned_wh=prior.need_wh(out_pieces) + prior.unloaded.need_wh(_home(prior, length, back, return_mps)),
        used_back_wh=flight.used_wh - turned_wh,
        predicted_back_wh=fact.model.unloaded.need_wh(_home(fact.model, length, back, return_mps)),
        fact=fact,
    )


def _home(model: EnergyModel, length: float, bearing: float, speed_mps: float | None) -> tuple[Piece, ...]:
    return way_home(length, bearing, ALTITUDE_M, 0.0, model.return_alt_m, speed_mps=speed_mps)


def arm(flight: Flight) -> None:
    """Armed in GUIDED, as soon as the autopilot can."""
    for _ in range(60):
        if flight.command(176, 1, GUIDED) and flight.command(400, 1):
            return
        end = flight.now + 2.0
        flight.until(lambda end=end: flight.now >= end, 10, "time to pass")
    raise AssertionError(f"it does not arm: {flight.texts[-6:]}")
