# SPDX-License-Identifier: GPL-3.0-or-later

"""The panel's process: reads its station all the time, keeps tracks and missions, and sends orders.

The values for the browsers are made from here (`known`). The page asks for them; nothing here waits for a browser.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections import OrderedDict
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Final

from gcs_module.panel.endpoint import find, running
from gcs_module.panel.orders import Order, OrderError, read_order
from gcs_module.panel.panel_values import Known, colours_of
from gcs_module.panel.reader import Reader
from gcs_module.watch.missions import Mission, mission_of
from gcs_module.watch.scene import Track
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.mission.package import from_bytes

__all__ = ["Session"]

_EVERY_S: Final = 0.1
#: most replies, tracks and missions that are kept
_REPLIES, _TRACKS, _MISSIONS = 64, 64, 8
_log = logging.getLogger(__name__)


class Session:
    """One station's panel. `name`: the station's, or the file of its socket; "": the only one that runs."""

    def __init__(self, name: str, clock: Callable[[], float] = time.monotonic) -> None:
        self._name = name
        self._clock = clock
        self._reader = Reader(self._where)
        self._task: asyncio.Task[None] | None = None
        #: number of an order -> whether it was used, and the answer
        self._replies: OrderedDict[int, tuple[bool, str]] = OrderedDict()
        #: places of each aircraft, by its name
        self.tracks: dict[str, Track] = {}
        #: missions by the digest of their package
        self.missions: dict[str, Mission] = {}
        self._read: set[str] = set()
        self._colours: dict[str, str] = {}

    def _where(self) -> Path | None:
        if self._name:
            return find(self._name)
        names = running()
        return find(names[0]) if len(names) == 1 else None

    # ---- the loop -------------------------------------------------------------------------------------------------

    def begin(self) -> None:
        """Start to read, in the running event loop."""
        self._task = asyncio.create_task(self._run())

    def end(self) -> None:
        """Stop, and close the connection."""
        if self._task is not None:
            self._task.cancel()
        self._reader.close()

    async def _run(self) -> None:
        while True:
            try:
                self.tick()
                await self._read_missions()
            except asyncio.CancelledError:
                raise
            except Exception:
                _log.exception("handover panel: reading the station")
            await asyncio.sleep(_EVERY_S)

    def tick(self) -> None:
        """Read what has arrived."""
        self._reader.tick(self._clock())
        while self._reader.replies:
            number, used, text = self._reader.replies.popleft()
            self._replies[number] = used, text
            while len(self._replies) > _REPLIES:
                self._replies.popitem(last=False)
        for craft in () if self._reader.seen is None else self._reader.seen.aircraft:
            if craft.position is not None and (craft.name in self.tracks or len(self.tracks) < _TRACKS):
                lat_deg, lon_deg = craft.position.value
                self.tracks.setdefault(craft.name, Track()).add(lat_deg, lon_deg, craft.commander)

    async def _read_missions(self) -> None:
        for digest in list(self._reader.missions.keys() - self._read):
            self._read.add(digest)
            data = self._reader.missions[digest]
            try:
                mission = await asyncio.get_running_loop().run_in_executor(None, partial(_mission, data))
            except MissionError as error:
                _log.warning("handover panel: mission %s cannot be shown: %s", digest[:8], error)
                continue
            self.missions[digest] = mission
            while len(self.missions) > _MISSIONS:
                del self.missions[next(iter(self.missions))]

    # ---- for the page ---------------------------------------------------------------------------------------------

    def known(self) -> Known:
        """What is known now."""
        now = self._clock()
        seen = self._reader.seen
        if seen is not None:
            self._colours = colours_of(seen.station, [peer.name for peer in seen.peers])
            for mission in self.missions.values():
                self._colours |= mission.colours
        return Known(
            name=self._name if seen is None else seen.station,
            seen=seen,
            age_s=self._reader.age_s(now),
            now=self._reader.station_now(now),
            fault=self._reader.fault,
            colours=self._colours,
        )

    def order(self, values: dict[str, Any]) -> tuple[int, str]:
        """Send the order of a browser; returns its number, and why it was not sent ("": it was)."""
        number = self._reader.next_number()
        try:
            order: Order = read_order({**values, "number": number})
        except OrderError as error:
            return number, f"Not sent: {error}"
        if self.known().dead or not self._reader.send(order):
            return number, "Not sent: the station's program does not answer."
        return number, ""

    def reply(self, number: int) -> tuple[bool, str] | None:
        """The station's answer to an order; None: not yet."""
        return self._replies.get(number)


def _mission(data: bytes) -> Mission:
    """Raises MissionError."""
    return mission_of(from_bytes(data))
