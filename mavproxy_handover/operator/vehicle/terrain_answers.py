# SPDX-License-Identifier: GPL-3.0-or-later

"""Answers TERRAIN_REQUEST of the autopilot out of the heights that the mission brings.

1. A block is answered if all its heights are known (`mission/terrain_blocks.py`). A request with such a block stays
   aboard: the autopilot asks again for the rest, and that goes to the stations (`gate/feeds.py`).
2. One block is computed and sent in each tick (20 a second), so that neither the main loop nor the line waits.
3. The autopilot counts heights above the sea. A grid whose ground at home is more than `LEVEL_M` from the autopilot's
   home counts from another level: it is not used, and people are told. Until home is known, a request that the grid
   could answer stays aboard without an answer: the autopilot asks again.

A fault passes the request to the stations. Memory is bounded by `_MOST` requests.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.mission.terrain import Terrain
from mavproxy_handover.mission.terrain_blocks import bits_of, heights_of
from mavproxy_handover.operator.base.context import Reports
from mavproxy_handover.vehicle.state import VehicleState
from mavproxy_handover.wire.frames import Frame, field_bytes, field_int
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID

__all__ = ["LEVEL_M", "TerrainAnswers"]

#: farthest difference (m) of the ground at home from the autopilot's home: a grid is coarse, home may be on a roof
LEVEL_M: Final = 25.0
#: open requests; ArduPilot keeps twelve blocks
_MOST: Final = 12
_REQUEST: Final[int] = mavlink.MAVLINK_MSG_ID_TERRAIN_REQUEST
_Corner = tuple[int, int, int]


class TerrainAnswers:
    """Of one vehicle (`vehicle`: its system id). `package`: the mission on board."""

    def __init__(
        self, vehicle: int, package: Callable[[], MissionPackage | None], aircraft: VehicleState, reports: Reports
    ) -> None:
        self._vehicle = vehicle
        self._package = package
        self._aircraft = aircraft
        self._reports = reports
        #: corner and spacing -> blocks that wait to be sent
        self._waiting: dict[_Corner, list[int]] = {}
        #: the grid that was found to count from another level
        self._refused: Terrain | None = None

    def takes(self, frame: Frame, now: float) -> bool:
        """Whether a frame of the autopilot is a request that is answered here, at least in part."""
        if frame.msgid != _REQUEST or not frame.known:
            return False
        if (frame.sysid, frame.compid) != (self._vehicle, AUTOPILOT_COMPID):
            return False
        try:
            return self._takes(frame)
        except Exception:
            self._reports.fault("answering a terrain request", traceback.format_exc(limit=-3))
            return False

    def _takes(self, frame: Frame) -> bool:
        terrain = self._grid()
        if terrain is None:
            return False
        lat, lon = (int.from_bytes(field_bytes(frame, name), "little", signed=True) for name in ("lat", "lon"))
        corner = lat, lon, field_int(frame, "grid_spacing")
        bits = bits_of(field_int(frame, "mask"))
        first = next((n for n, bit in enumerate(bits) if _heights(terrain, corner, bit) is not None), None)
        if first is None:
            return False
        if self._home() is None:
            return True
        if self._terrain() is None:
            return False
        self._waiting[corner] = bits[first:]
        while len(self._waiting) > _MOST:
            del self._waiting[next(iter(self._waiting))]
        return True

    def tick(self, _now: float) -> None:
        """Send the next block; to be called often."""
        if not self._waiting:
            return
        corner = next(iter(self._waiting))
        bits = self._waiting[corner]
        bit, terrain = bits.pop(0), self._terrain()
        if not bits or terrain is None:
            del self._waiting[corner]
        heights = None if terrain is None else _heights(terrain, corner, bit)
        if heights is not None:
            self._reports.message_sender.to_autopilot(mavlink.MAVLink_terrain_data_message(*corner, bit, heights))

    def _grid(self) -> Terrain | None:
        """The grid of the mission, if its level was not found to be another."""
        package = self._package()
        terrain = None if package is None else package.terrain
        return None if terrain is self._refused else terrain

    def _home(self) -> tuple[tuple[float, float], float] | None:
        """Place and height of the autopilot's home, if both are known."""
        home, home_m = self._aircraft.telemetry.home.value, self._aircraft.home_alt_m
        return None if home is None or home_m is None else (home, home_m)

    def _terrain(self) -> Terrain | None:
        """The grid of the mission, if it is known to count from the level that the autopilot counts from."""
        terrain, known = self._grid(), self._home()
        if terrain is None or known is None:
            return None
        home, home_m = known
        ground_m = terrain.between_m(home)
        if ground_m is None:
            return None
        if abs(ground_m - home_m) > LEVEL_M:
            self._refused = terrain
            text = (
                f"The mission's terrain is at {ground_m:.0f} m where the autopilot's home is at {home_m:.0f} m: it is "
                "not sent to the autopilot. Use heights above the sea."
            )
            self._reports.event_log.terrain_refused(text)
            self._reports.message_sender.say_to_all(text)
            return None
        return terrain


def _heights(terrain: Terrain, corner: _Corner, bit: int) -> list[int] | None:
    return heights_of(terrain, (corner[0] / 1e7, corner[1] / 1e7), corner[2], bit)
