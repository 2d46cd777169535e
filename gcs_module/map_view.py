# SPDX-License-Identifier: GPL-3.0-or-later

"""One vehicle on MAVProxy's maps: hands over what has changed, to every map that is loaded, and takes all of it back.

Rules that live here
--------------------
* While no map is loaded nothing is worked out. A map that is loaded, closed or loaded again gets everything anew.
* A mission is looked at beside the main loop. One that cannot be is told as a fault, once, and not shown.
* A map that breaks is a fault, and left alone until it is loaded anew. Others go on.

A map lives in a process of its own; what it is given goes into a queue, which keeps nobody waiting.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

from gcs_module.map_items import Item, Paths
from gcs_module.map_layer import Now, drawn
from gcs_module.mission_map import MissionMap, mission_map
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.worker import Worker

__all__ = ["MapView", "loaded_maps"]

_WHERE = "map"


def loaded_maps(mpstate: Any) -> list[Any]:
    """The maps that MAVProxy has loaded and whose windows are open: "map", "map2" and so on."""
    # not its public modules: one that broke while it was loaded stays among them, half made
    loaded = (module for module, _package in list(mpstate.modules) if module.name.rstrip("0123456789") == "map")
    return [module.map for module in loaded if module.map.is_alive()]


@dataclass(slots=True)
class _Sheet:
    """What one map shows."""

    map: Any
    shown: dict[str, Item] = field(default_factory=dict)
    broken: bool = False


class MapView:
    """Of one vehicle. Times are monotonic seconds; not safe for threads, but for `remove`."""

    def __init__(self, name: str, maps: Callable[[], list[Any]], fault: Callable[[str, str], None]) -> None:
        """`name`: no other vehicle's; `fault` is told where something broke, and what."""
        self._name = name
        self._maps = maps
        self._fault = fault
        self._worker = Worker()
        self._sheets: list[_Sheet] = []
        #: of the mission that was looked at last; None: there is none, or it cannot be shown
        self._ground: MissionMap | None = None
        #: the digest of the mission that is being looked at, or was
        self._digest: bytes | None = None

    def show(self, package: MissionPackage | None, situation: Callable[[], Now], now: float, number: int = 0) -> None:
        """Bring the maps up to date; to be called each second. `package`: what the vehicle flies, None: not known;
        `situation` is asked only where there is a map; `number`: of the vehicle among several."""
        self._follow(self._maps())
        self._worker.tick(now)
        if not self._sheets:
            return
        self._look_at(package)
        items = drawn(self._ground, situation(), number)
        for sheet in self._sheets:
            self._attempt(sheet, items)

    def remove(self) -> None:
        """Take everything off the maps."""
        self._follow(self._maps())
        for sheet in self._sheets:
            self._attempt(sheet, {})
        self._sheets.clear()

    def _follow(self, maps: Iterable[Any]) -> None:
        known = {id(sheet.map): sheet for sheet in self._sheets}
        self._sheets = [known.get(id(each)) or _Sheet(each) for each in maps]

    def _look_at(self, package: MissionPackage | None) -> None:
        digest = None if package is None else package.digest
        if digest == self._digest:
            return
        if package is None:
            self._digest = self._ground = None
        elif self._worker.submit(lambda: mission_map(package), lambda result, _now: self._looked_at(package, result)):
            self._digest, self._ground = digest, None

    def _looked_at(self, package: MissionPackage, result: MissionMap | Exception) -> None:
        if package.digest != self._digest:
            return
        if isinstance(result, MissionMap):
            self._ground = result
        else:
            self._fault(_WHERE, f"mission {package.name!r} cannot be shown: {type(result).__name__}: {result}")

    def _attempt(self, sheet: _Sheet, items: dict[str, Item]) -> None:
        if sheet.broken:
            return
        try:
            self._bring(sheet, items)
        except Exception:
            sheet.broken = True
            self._fault(_WHERE, traceback.format_exc(limit=-3))

    def _bring(self, sheet: _Sheet, items: dict[str, Item]) -> None:
        for name in sheet.shown.keys() - items.keys():
            sheet.map.remove_object(self._key(name))
            del sheet.shown[name]
        changed = {name: item for name, item in items.items() if sheet.shown.get(name) != item}
        if not changed:
            return
        from gcs_module.map_drawing import map_object  # needs OpenCV, as the map does

        for name, item in changed.items():
            sheet.map.add_object(map_object(self._key(name), self._layer(item), item))
            sheet.shown[name] = item

    def _key(self, name: str) -> str:
        return f"{self._name} {name}"

    def _layer(self, item: Item) -> str:
        """The map draws its layers in the order of their names, and its aircraft in "3": lines below, words above."""
        return f"{'1' if isinstance(item, Paths) else 'z'} {self._name}"
