# SPDX-License-Identifier: GPL-3.0-or-later

"""Times of a copter along its path, with acceleration, braking and corners.

A simulation (`route_simulation.py`) has the least possible time: each leg at its full speed. A copter starts from rest,
climbs before it goes, rounds corners slowly and stops where it waits. Each costs two to four seconds. So the speed is
limited here at each place of the path, and from place to place by the copter's acceleration:

* 0 at the start, the end, at waits, at the end of a circle, and at the beginning of a return or a landing; also between
  a climb or descent on the spot and the next leg;
* at a corner: the speed of an arc that cuts the corner by `_CORNER_CUT_M`;
* otherwise the speed of the leg.

The numbers are ArduCopter's defaults (WPNAV_ACCEL 250, WPNAV_ACCEL_Z 100, WPNAV_ACCEL_C 0, which is twice the first,
WPNAV_RADIUS 200). Its tracks limit jerk as well, which makes acceleration slower by `_SPEED_UP`. The results were
compared to flights of the embedded vehicle and of ArduCopter (`tests/sitl/test_countdowns.py`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Final

from mavproxy_handover.mission.geodesy import east_north_m
from mavproxy_handover.mission.route_simulation import Sample

__all__ = ["Pace", "corner_mps", "speed_up_mps2"]

_ACCEL_MPS2, _CLIMB_ACCEL_MPS2, _CORNER_ACCEL_MPS2 = 2.5, 1.0, 5.0
_SPEED_UP: Final = 0.65
_CORNER_CUT_M: Final = 1.0
#: a turn below the first angle does not count, one above the second is a stop
_STRAIGHT, _BACK = math.radians(1.0), math.radians(175.0)
#: horizontal metres below which a piece leads up or down on the spot
_ON_THE_SPOT_M: Final = 0.05


class _Piece:
    """The piece between two places of a simulation.

    Its length in three dimensions, its time in the simulation, its direction, and the copter's braking on it.
    """

    __slots__ = ("accel", "curved", "east", "full_mps", "length_m", "north", "spot", "time_s", "up", "waits")

    def __init__(self, before: Sample, after: Sample) -> None:
        east, north = east_north_m(before.lat_deg, before.lon_deg, after.lat_deg, after.lon_deg)
        rise = after.alt_m - before.alt_m
        self.length_m = length = math.sqrt(east * east + north * north + rise * rise)
        self.time_s = after.time_s - before.time_s
        self.curved = after.curved
        self.spot = after.distance_along_m - before.distance_along_m < _ON_THE_SPOT_M
        #: True if the simulation waits here
        self.waits = length < 1e-6
        self.east, self.north, self.up = (
            (0.0, 0.0, 0.0) if self.waits else (east / length, north / length, rise / length)
        )
        flat = math.hypot(self.east, self.north)
        limits = (_ACCEL_MPS2 / flat if flat > 1e-3 else math.inf, _CLIMB_ACCEL_MPS2 / max(abs(self.up), 1e-9))
        self.accel = 0.0 if self.waits else min(limits)
        self.full_mps = 0.0 if self.waits or self.time_s <= 0.0 else length / self.time_s


class Pace:
    """Times and speeds of one simulation, at each of its places: `times_s`, and `speeds_mps` of the copter there.

    `rests`: the items before which it comes to rest, as a return and a landing are.
    """

    def __init__(self, samples: Sequence[Sample], rests: frozenset[int] = frozenset()) -> None:
        pieces = [_Piece(before, after) for before, after in pairwise(samples)]
        speeds = [0.0, *(_most(before, after) for before, after in pairwise(pieces)), 0.0][: len(samples)]
        for number, (before, after) in enumerate(pairwise(samples[1:]), 1):
            if before.rests or (before.seq != after.seq and after.seq in rests):
                speeds[number] = 0.0
        for number, piece in enumerate(pieces):
            faster = math.sqrt(speeds[number] ** 2 + 2.0 * _SPEED_UP * piece.accel * piece.length_m)
            speeds[number + 1] = min(speeds[number + 1], faster)
        for number in range(len(pieces) - 1, -1, -1):
            piece = pieces[number]
            speeds[number] = min(
                speeds[number], math.sqrt(speeds[number + 1] ** 2 + 2.0 * piece.accel * piece.length_m)
            )
        self.speeds_mps = speeds
        self.times_s = [0.0]
        for number, piece in enumerate(pieces):
            self.times_s.append(self.times_s[-1] + _time_s(piece, speeds[number], speeds[number + 1]))


def speed_up_mps2() -> float:
    """Acceleration of a copter on a level path."""
    return _SPEED_UP * _ACCEL_MPS2


def corner_mps(turn_rad: float) -> float:
    """Highest speed at a corner of that angle; infinite if it is none."""
    if turn_rad < _STRAIGHT:
        return math.inf
    if turn_rad > _BACK:
        return 0.0
    radius_m = _CORNER_CUT_M / (1.0 / math.cos(turn_rad / 2.0) - 1.0)
    return math.sqrt(_CORNER_ACCEL_MPS2 * radius_m)


def _most(before: _Piece, after: _Piece) -> float:
    """Highest speed between two pieces."""
    if before.waits or after.waits or before.spot is not after.spot:
        return 0.0
    full = min(before.full_mps, after.full_mps)
    if before.curved and after.curved:
        return full
    dot = before.east * after.east + before.north * after.north + before.up * after.up
    turn = math.acos(max(-1.0, min(1.0, dot)))
    return min(full, corner_mps(turn))


def _time_s(piece: _Piece, from_mps: float, to_mps: float) -> float:
    """Time of a piece: acceleration, full speed, braking."""
    if piece.waits or piece.full_mps <= 0.0:
        return piece.time_s
    faster, slower = 2.0 * _SPEED_UP * piece.accel, 2.0 * piece.accel
    square = (piece.length_m + from_mps**2 / faster + to_mps**2 / slower) / (1.0 / faster + 1.0 / slower)
    peak = max(from_mps, to_mps, min(piece.full_mps, math.sqrt(square)))
    speeding_m, slowing_m = (peak**2 - from_mps**2) / faster, (peak**2 - to_mps**2) / slower
    steady_m = max(0.0, piece.length_m - speeding_m - slowing_m)
    return 2.0 * (peak - from_mps) / faster + 2.0 * (peak - to_mps) / slower + (steady_m / peak if peak > 0.0 else 0.0)
