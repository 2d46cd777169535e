# SPDX-License-Identifier: GPL-3.0-or-later

"""One vehicle on MAVProxy's maps: gives every loaded map what has changed, and removes everything at the end.

Rules that live here
--------------------
* While no map is loaded, nothing is computed. A map that is loaded or loaded again gets everything.
* A mission's map is computed beside the main loop. If that fails, the fault is told once, and the mission is not shown.
* An exception of a map is a fault: that map gets nothing more until it is loaded again. Others continue.

A map runs in its own process and gets its items by a queue, which never blocks.
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
from mavproxy_handover.tools.worker import Worker

__all__ = ["MapView", "loaded_maps"]

_WHERE = "map"


def loaded_maps(mpstate: Any) -> list[Any]:
    """The maps that MAVProxy has loaded and whose windows are open: "map", "map2" and so on."""
    # not from its public modules: they still contain a module whose loading failed
    loaded = (module for module, _package in list(mpstate.modules) if module.name.rstrip("0123456789") == "map")
    return [module.map for module in loaded if module.map.is_alive()]


@dataclass(slots=True)
class _ShownMap:
    """One map, and the items that it shows."""

    map: Any
    shown: dict[str, Item] = field(default_factory=dict)
    broken: bool = False


class MapView:
    """One vehicle's. Times are monotonic seconds; not safe for threads, except `remove`."""

    def __init__(self, name: str, maps: Callable[[], list[Any]], fault: Callable[[str, str], None]) -> None:
        """`name`: unique for each vehicle; `fault` gets the place of a fault, and its text."""
        self._name = name
        self._maps = maps
        self._fault = fault
        self._worker = Worker()
        self._shown_maps: list[_ShownMap] = []
        #: the map of the last mission; None: there is no mission, or it cannot be shown
        self._ground: MissionMap | None = None
        #: the digest of the mission whose map is computed, or was
        self._digest: bytes | None = None

    def show(self, package: MissionPackage | None, situation: Callable[[], Now], now: float, number: int = 0) -> None:
        """Update the maps; to be called each second. `package`: the one that the vehicle flies, None: not known;
        `situation` is called only if a map is loaded; `number`: of the vehicle among several."""
        self._follow(self._maps())
        self._worker.tick(now)
        if not self._shown_maps:
            return
        self._request_map(package)
        items = drawn(self._ground, situation(), number)
        for shown_map in self._shown_maps:
            self._attempt(shown_map, items)

    def remove(self) -> None:
        """Remove everything from the maps."""
        self._follow(self._maps())
        for shown_map in self._shown_maps:
            self._attempt(shown_map, {})
        self._shown_maps.clear()

    def _follow(self, maps: Iterable[Any]) -> None:
        known = {id(shown_map.map): shown_map for shown_map in self._shown_maps}
        self._shown_maps = [known.get(id(each)) or _ShownMap(each) for each in maps]

    def _request_map(self, package: MissionPackage | None) -> None:
        digest = None if package is None else package.digest
        if digest == self._digest:
            return
        if package is None:
            self._digest = self._ground = None
        elif self._worker.submit(lambda: mission_map(package), lambda result, _now: self._on_map(package, result)):
            self._digest, self._ground = digest, None

    def _on_map(self, package: MissionPackage, result: MissionMap | Exception) -> None:
        if package.digest != self._digest:
            return
        if isinstance(result, MissionMap):
            self._ground = result
        else:
            self._fault(_WHERE, f"mission {package.name!r} cannot be shown: {type(result).__name__}: {result}")

    def _attempt(self, shown_map: _ShownMap, items: dict[str, Item]) -> None:
        if shown_map.broken:
            return
        try:
            self._update_map(shown_map, items)
        except Exception:
            shown_map.broken = True
            self._fault(_WHERE, traceback.format_exc(limit=-3))

    def _update_map(self, shown_map: _ShownMap, items: dict[str, Item]) -> None:
        for name in shown_map.shown.keys() - items.keys():
            shown_map.map.remove_object(self._key(name))
            del shown_map.shown[name]
        changed = {name: item for name, item in items.items() if shown_map.shown.get(name) != item}
        if not changed:
            return
        from gcs_module.map_drawing import map_object  # needs OpenCV, as the map does

        for name, item in changed.items():
            shown_map.map.add_object(map_object(self._key(name), self._layer(item), item))
            shown_map.shown[name] = item

    def _key(self, name: str) -> str:
        return f"{self._name} {name}"

    def _layer(self, item: Item) -> str:
        """The name of an item's layer: paths are drawn below MAVProxy's aircraft, words above.

        The map draws its layers in the order of their names, and its aircraft in "3".
        """
        return f"{'1' if isinstance(item, Paths) else 'z'} {self._name}"
