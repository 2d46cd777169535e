# SPDX-License-Identifier: GPL-3.0-or-later

"""Makes the messages of an autopilot from samples of a flight, for recordings that are none of MAVLink.

The aircraft stands for `PRELUDE_S` where the samples begin, disarmed, before the first of them: there a companion finds
its stations and its mission. Velocity comes from the samples, or from the way between two of them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.mission.geodesy import distance_m
from mavproxy_handover.vehicle.profiles import Profile
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID
from sitl.replay.recording import Recording

__all__ = ["PRELUDE_S", "Sample", "recorded"]

PRELUDE_S: Final = 8.0
#: heartbeats, and what else comes at that rate (s); positions in between come at this one
_BEAT_S: Final = 0.5
_STEP_S: Final = 0.05
#: without a sample for longer than this the position is not known: nothing is made up in between
_GAP_S: Final = 2.0
_FLYING_M: Final = 1.0
_SYSID: Final = 1


@dataclass(frozen=True, slots=True)
class Sample:
    """The aircraft at a time (UTC s): place (degrees), height above home (m), and other values.

    None: not known. `velocity`: to the north, to the east, down (m/s). `remaining`: of the battery (%). `current_a`,
    `voltage_v`: its.
    """

    at: float
    lat_deg: float
    lon_deg: float
    alt_m: float
    velocity: tuple[float, float, float] | None = None
    armed: bool | None = None
    flying: bool | None = None
    mode: int | None = None
    waypoint: int | None = None
    remaining: float | None = None
    voltage_v: float | None = None
    current_a: float | None = None
    consumed_mah: float | None = None


def recorded(path: Path, kind: str, samples: Sequence[Sample], assumed: Iterable[str], profile: Profile) -> Recording:
    """The recording that these samples of a vehicle are; they rise in time, and there are two at least."""
    maker = _Maker(profile)
    first = samples[0]
    begin = first.at - PRELUDE_S
    for number in range(int(PRELUDE_S / _STEP_S)):
        maker.stands(first, begin + number * _STEP_S)
    for one, other in zip(samples, [*samples[1:], None], strict=True):
        maker.flies(one, other)
    return Recording(path, kind, _SYSID, maker.messages, assumed=list(assumed))


class _Maker:
    """Collects messages."""

    def __init__(self, profile: Profile) -> None:
        self._auto = profile.auto
        self._type = min(profile.types)  # the commonest of a firmware
        self.messages: list[tuple[float, Any]] = []
        self._encoder = mavlink.MAVLink(None, srcSystem=_SYSID, srcComponent=AUTOPILOT_COMPID)
        self._decoder = mavlink.MAVLink(None)
        self._beat_at = -math.inf

    def stands(self, sample: Sample, at: float) -> None:
        """On the ground, disarmed, where it is in the sample."""
        self._state(sample, at, armed=False, flying=False, mode=0)
        self._position(sample.lat_deg, sample.lon_deg, 0.0, (0.0, 0.0, 0.0), at)

    def flies(self, one: Sample, other: Sample | None) -> None:
        """From one sample to the next."""
        velocity = one.velocity if one.velocity is not None else _between(one, other)
        flying = one.alt_m > _FLYING_M if one.flying is None else one.flying
        armed = True if one.armed is None else one.armed
        mode = self._auto if one.mode is None else one.mode
        last = one.at + _STEP_S / 2 if other is None or other.at - one.at > _GAP_S else other.at
        steps = max(1, math.ceil((last - one.at) / _STEP_S - 1e-6))
        for number in range(steps):
            at = one.at + number * (last - one.at) / steps
            part = 0.0 if other is None or other.at <= one.at else (at - one.at) / (other.at - one.at)
            target = other or one
            lat_deg = one.lat_deg + part * (target.lat_deg - one.lat_deg)
            lon_deg = one.lon_deg + part * (target.lon_deg - one.lon_deg)
            alt_m = one.alt_m + part * (target.alt_m - one.alt_m)
            self._state(one, at, armed=armed, flying=flying, mode=mode)
            self._position(lat_deg, lon_deg, alt_m, velocity, at)

    def _state(self, sample: Sample, at: float, *, armed: bool, flying: bool, mode: int) -> None:
        if at - self._beat_at < _BEAT_S - 1e-6:
            return
        self._beat_at = at
        base = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (mavlink.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0)
        state = mavlink.MAV_STATE_ACTIVE if flying else mavlink.MAV_STATE_STANDBY
        landed = mavlink.MAV_LANDED_STATE_IN_AIR if flying else mavlink.MAV_LANDED_STATE_ON_GROUND
        ardupilot = mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
        self._add(mavlink.MAVLink_extended_sys_state_message(0, landed), at)
        if sample.waypoint is not None:
            self._add(mavlink.MAVLink_mission_current_message(max(0, sample.waypoint)), at)
        if sample.remaining is not None or sample.voltage_v is not None:
            self._battery(sample, at)
        self._add(mavlink.MAVLink_heartbeat_message(self._type, ardupilot, base, mode, state, 3), at)

    def _battery(self, sample: Sample, at: float) -> None:
        cells = [0xFFFF] * 10
        if sample.voltage_v is not None:
            cells[0] = round(max(0.0, min(65.0, sample.voltage_v)) * 1000)
        current = -1 if sample.current_a is None else round(max(0.0, min(320.0, sample.current_a)) * 100)
        consumed = -1 if sample.consumed_mah is None else round(sample.consumed_mah)
        remaining = -1 if sample.remaining is None else round(max(0.0, min(100.0, sample.remaining)))
        self._add(mavlink.MAVLink_battery_status_message(0, 0, 0, 0x7FFF, cells, current, consumed, -1, remaining), at)

    def _position(
        self, lat_deg: float, lon_deg: float, alt_m: float, velocity: tuple[float, float, float], at: float
    ) -> None:
        vx, vy, vz = (max(-32000, min(32000, round(each * 100))) for each in velocity)
        alt_mm = max(-2_000_000_000, min(2_000_000_000, round(alt_m * 1000)))
        where = round(lat_deg * 1e7), round(lon_deg * 1e7), alt_mm, alt_mm
        self._add(mavlink.MAVLink_global_position_int_message(0, *where, vx, vy, vz, 0xFFFF), at)

    def _add(self, message: Any, at: float) -> None:
        self.messages.append((at, self._decoder.decode(bytearray(message.pack(self._encoder)))))


def _between(one: Sample, other: Sample | None) -> tuple[float, float, float]:
    """The mean velocity of the way to the next sample."""
    if other is None or not 0.0 < other.at - one.at <= _GAP_S:
        return 0.0, 0.0, 0.0
    passed_s = other.at - one.at
    north = math.copysign(distance_m(one.lat_deg, one.lon_deg, other.lat_deg, one.lon_deg), other.lat_deg - one.lat_deg)
    east = math.copysign(distance_m(one.lat_deg, one.lon_deg, one.lat_deg, other.lon_deg), other.lon_deg - one.lon_deg)
    return north / passed_s, east / passed_s, (one.alt_m - other.alt_m) / passed_s
