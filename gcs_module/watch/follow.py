# SPDX-License-Identifier: GPL-3.0-or-later

"""Finds journals, reads their new entries, listens to links, and reads missions.

Rules that live here
--------------------
* A folder is searched again every few seconds, as is a journal's mission: aircraft and stations may start later.
* A thread reads disks and missions: a slow one delays only what it brings.
* A fault in one file, link or mission is counted and shown in the heading; the others go on.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Final

from gcs_module.watch.journals import Writer
from gcs_module.watch.link_reader import LinkReader
from gcs_module.watch.missions import MOST_MISSIONS, Mission, beside, read
from gcs_module.watch.page_values import Shown, shown
from gcs_module.watch.passive_link import PassiveLink
from gcs_module.watch.scene import Scene
from gcs_module.watch.tail import Entry, Tail
from mavproxy_handover.link.forms import DeviceSpec
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.store.journal import strangers_path
from mavproxy_handover.wire.frames import Frame

__all__ = ["MOST_JOURNALS", "Follower", "journals_in"]

#: most journals that are followed
MOST_JOURNALS: Final = 256
_EVERY_S, _LOOK_S = 0.25, 2.0
#: bytes read at a time, of all files together: some hundredths of a second to parse
_AT_A_TIME: Final = 512 * 1024


def journals_in(path: Path) -> list[Path]:
    """The journals of a path: the file itself, or those in a folder and its subfolders.

    Journals of strangers' input are left out: nothing in them is proven.
    """
    if not path.is_dir():
        return [path]
    found = sorted(path.glob("*.jsonl")) + sorted(path.glob("*/*.jsonl"))
    beside_them = {strangers_path(each) for each in found}
    return [each for each in found if each not in beside_them]


class _Journal:
    def __init__(self, scene: Scene, path: Path) -> None:
        self.tail = Tail(path)
        self.writer = Writer(scene, path.name)
        self.mission: Path | None = None


class Follower:
    """Follows the input of one page. `paths`: journals, and folders of them; `devices`: links; `missions`: for aircraft
    without a mission beside their journals."""

    def __init__(self, paths: Sequence[Path], devices: Iterable[DeviceSpec], missions: Sequence[Mission]) -> None:
        self.scene = Scene()
        self.missions: dict[str, Mission] = {each.key: each for each in missions}
        self.shown: Shown = shown(self.scene, self.missions, 0.0)
        #: faults here, by kind
        self.faults: dict[str, int] = {}
        self._paths = paths
        self._given = tuple(missions)
        self._journals: dict[Path, _Journal] = {}
        self._folders: dict[Path, str] = {}
        self._tasks: list[asyncio.Task[None]] = []
        self._links: list[tuple[PassiveLink, LinkReader]] = []
        for device in devices:
            reader = LinkReader(self.scene, device.text, self._station_name)
            link = PassiveLink(device, partial(self._read_frame, reader), time.monotonic)
            self._links.append((link, reader))
        self._sockets = [link.bind() for link, _reader in self._links]

    def begin(self) -> None:
        """Start to follow, in the running event loop."""
        for (link, _reader), opened in zip(self._links, self._sockets, strict=True):
            self._tasks.append(asyncio.create_task(link.run(opened)))
        for job in (self._read, self._find_new, self._show):
            self._tasks.append(asyncio.create_task(self._forever(job)))

    def end(self) -> None:
        """Stop, and close everything."""
        for task in self._tasks:
            task.cancel()
        for journal in self._journals.values():
            journal.tail.close()
        for opened in self._sockets:
            if opened is not None:
                opened.close()

    def heading(self) -> str:
        """The heading of the page: what is followed, and its state."""
        broken = sum(each.tail.broken for each in self._journals.values())
        parts = [f"{len(self.scene.aircraft)} aircraft"]
        if self._journals or self._paths:
            parts.append(f"{len(self._journals)} journals" + (f", {broken} lines broken" if broken else ""))
        for link, _reader in self._links:
            lost = f", {link.thrown_away} frames too many" if link.thrown_away else ""
            parts.append(f"{link.device.text} {link.state}{lost}")
        if self.scene.left_out:
            parts.append("more aircraft or stations than can be shown")
        parts += [f"{what} ({count})" if count > 1 else what for what, count in self.faults.items()]
        parts.append(time.strftime("%H:%M:%S UTC", time.gmtime()))
        return " · ".join(parts)

    # ---- jobs -----------------------------------------------------------------------------------------------------

    async def _forever(self, job: Callable[[], Awaitable[float]]) -> None:
        """Run a job again and again; a fault costs one turn of it."""
        while True:
            try:
                pause_s = await job()
            except Exception as error:
                self._fault(f"{type(error).__name__} in {getattr(job, '__name__', '?').strip('_')}")
                pause_s = 1.0
            await asyncio.sleep(pause_s)

    def _fault(self, what: str) -> None:
        if what in self.faults or len(self.faults) < 8:
            self.faults[what] = self.faults.get(what, 0) + 1

    async def _read(self) -> float:
        """Read the next part of each journal."""
        journals = list(self._journals.values())
        if not journals:
            return _EVERY_S
        found = await asyncio.to_thread(_read_all, [each.tail for each in journals])
        now, utc_now = time.monotonic(), time.time()
        # in the order of their times, as far as clocks agree: an aircraft's entry comes before its stations'
        entries = [(journal, entry) for journal, (new, _) in zip(journals, found, strict=True) for entry in new]
        entries.sort(key=lambda each: each[1].utc or utc_now)
        for journal, entry in entries:
            journal.writer.add_entry(entry, now, utc_now)
        share = _AT_A_TIME // len(journals)
        return 0.0 if any(taken >= share for _, taken in found) else _EVERY_S

    async def _find_new(self) -> float:
        """Find new journals and missions."""
        laid = await asyncio.to_thread(self._find)
        for path in laid[0]:
            if path not in self._journals and len(self._journals) < MOST_JOURNALS:
                self._journals[path] = _Journal(self.scene, path)
        for path, folder in laid[1].items():
            journal = self._journals.get(path)
            if journal is not None and folder is not None:
                await self._mission(folder)
                journal.mission = folder
        for journal in self._journals.values():
            craft = journal.writer.aircraft
            if craft is not None and journal.mission is not None:
                craft.mission = self._folders.get(journal.mission, "")
        for craft in self.scene.aircraft.values():
            if not craft.mission and len(self._given) == 1:
                craft.mission = self._given[0].key
        return _LOOK_S

    def _find(self) -> tuple[list[Path], dict[Path, Path | None]]:
        found = [path for given in self._paths for path in journals_in(given)]
        return found, {path: beside(path) for path in found}

    async def _mission(self, folder: Path) -> None:
        if folder in self._folders or len(self._folders) >= MOST_MISSIONS:
            return
        try:
            mission = await asyncio.to_thread(read, folder)
        except MissionError as error:
            self._folders[folder] = ""
            self._fault(f"mission: {error}")
            return
        self._folders[folder] = mission.key
        self.missions.setdefault(mission.key, mission)

    async def _show(self) -> float:
        now = time.monotonic()
        for _link, reader in self._links:
            reader.tick(now, time.time())
        self.shown = shown(self.scene, self.missions, now)
        return 1.0

    @staticmethod
    def _read_frame(reader: LinkReader, frame: Frame) -> None:
        reader.on_frame(frame, time.monotonic(), time.time())

    def _station_name(self, sysid: int) -> str:
        names = {each.names[sysid] for each in self.missions.values() if sysid in each.names}
        return names.pop() if len(names) == 1 else ""


def _read_all(tails: Sequence[Tail]) -> list[tuple[list[Entry], int]]:
    return [tail.read(_AT_A_TIME // len(tails)) for tail in tails]
