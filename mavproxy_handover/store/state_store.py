# SPDX-License-Identifier: GPL-3.0-or-later

"""Two copies of the state: one in memory, at once; one on the disk, behind it.

The one in memory outlives the process, and to write it takes microseconds, so it is made in the main loop, before
anybody hears of what it says. The one on the disk outlives a loss of power. It is written by a thread, whenever the
disk lets it: a disk that is slow, full or read-only holds up nothing, and is late.

What a run makes of the two:

| memory | disk | what counts |
|---|---|---|
| fits | whatever it says, if it is no later | the copy in memory: it has the last word |
| not there, made void, damaged, or behind the disk | of this boot | nobody: the last word is lost; the disk's numbers |
| made void or damaged | of an earlier boot | the same: this boot had a last word |
| not there | of an earlier boot | the disk, not `proven`: the stations decide (`core/authority/authority.py`) |

Where no storage lives in memory the first copy lies beside the second, bound to the boot. It is written without waiting
for the disk, as far as the system lets one.
"""

from __future__ import annotations

import os
from collections import deque
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Final

from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.core.common.snapshot import Snapshot
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.store.background_writer import CLOSE_S, Behind
from mavproxy_handover.store.durable import discard
from mavproxy_handover.store.memory import Condition, Slots, boot_id, memory_folder, memory_name, passed_over
from mavproxy_handover.store.state_file import Kept, StateError, StateStore, pack, unpack

__all__ = ["StateKeeper", "in_flight"]

_STATE: Final = "state"
_PACKAGE: Final = "package"
#: so many words about the disk wait to be heard
_MOST_TROUBLES: Final = 8


def in_flight(folder: Path, vehicle: str) -> bool:
    """Whether the run before this one, in this boot, ended in flight, by the copy in memory. Never raises.

    A rehearsal is no flight. A copy that does not count says nothing.
    """
    keeper = StateKeeper(folder, vehicle)
    try:
        held, _lost = keeper.held()
    finally:
        keeper.close()
    return held is not None and held.snapshot.phase is not Phase.ON_LOAD and not held.snapshot.rehearsal


class StateKeeper:
    """Keeps one vehicle's state: in `folder`, and in memory before that. Its own thread writes to the disk."""

    def __init__(self, folder: Path, vehicle: str) -> None:
        self._vehicle = vehicle
        self._disk = StateStore(folder, vehicle)
        self._boot = boot_id()
        #: what is to be said of where the state is kept, "" if all is well
        self.note = ""
        self._slots, self._packages = self._open(folder)
        self._behind = Behind("state")
        self._serial = 0
        #: what the disk is to hold, and the serial of what it holds
        self._wanted: Kept | None = None
        self._written = 0
        self._troubles: deque[str] = deque(maxlen=_MOST_TROUBLES)

    def _open(self, folder: Path) -> tuple[Slots | None, StateStore | None]:
        """The copy in memory, and where packages are kept there."""
        place = memory_folder(os.environ)
        name = memory_name(folder, self._vehicle)
        self.note = passed_over(os.environ)
        try:
            if place is not None:
                return Slots(place / f"{name}.state"), StateStore(place, name)
            why = self.note or "no storage in memory"
            self.note = f"{why}: the state is kept in {folder}, and a slow disk may hold up a handover"
            folder.mkdir(parents=True, exist_ok=True)
            return Slots(folder / f"{self._vehicle}.state.now"), None
        except OSError as error:
            self.note = f"the state outlives no restart: {error}"
            return None, None

    # ---- at the start ---------------------------------------------------------------------------------------------

    def recall(self) -> tuple[Snapshot | None, str]:
        """What the run before left behind, and why what it had to say last cannot be had, if so. Never raises."""
        disk, trouble = None, ""
        try:
            disk = self._disk.load()
        except StateError as error:
            trouble = str(error)
        held, lost = self.held()
        self._serial = max(held.serial if held else 0, disk.serial if disk else 0)
        if held is not None and disk is not None and disk.boot == self._boot and disk.serial > held.serial:
            held, lost = None, "the copy in memory is older than the one on the disk"
        if held is not None:
            return held.snapshot, ""
        if disk is None:
            return None, trouble or lost
        if lost or (disk.boot and disk.boot == self._boot):
            lost = lost or "the copy in memory is gone, and the disk may be behind"
            return replace(disk.snapshot, owner=None, proven=False), lost
        return replace(disk.snapshot, proven=False), ""

    def held(self) -> tuple[Kept | None, str]:
        """The copy in memory that counts, and what is wrong with the one that is there."""
        if self._slots is None or self._slots.condition is Condition.EMPTY:
            return None, ""
        if self._slots.condition is Condition.HELD:
            try:
                held = unpack(self._slots.record, self._vehicle)
            except ValueError as error:
                return None, f"the copy in memory is not to be trusted: {error}"
            # of an earlier boot: it lay on a disk
            return (held, "") if held.boot == self._boot and held.serial == self._slots.serial else (None, "")
        return None, f"the copy in memory is {self._slots.condition.value}"

    def load_package(self, digest: bytes) -> MissionPackage | None:
        """The mission package with this digest, if it was kept."""
        kept = None if self._packages is None else self._packages.load_package(digest)
        return kept or self._disk.load_package(digest)

    # ---- in flight ------------------------------------------------------------------------------------------------

    def save(self, snapshot: Snapshot) -> None:
        """Keep the snapshot: on return it outlives the process. Raises OSError: then nothing does, nor an older one."""
        self._serial += 1
        kept = Kept(snapshot, self._boot, self._serial)
        try:
            if self._slots is None:
                raise OSError("there is nowhere to keep it")
            self._slots.write(pack(kept, self._vehicle), self._serial)
        except BaseException:
            self._void()
            raise
        finally:
            self._wanted = kept
            self._behind.put(_STATE, partial(self._to_disk, kept))

    def keep(self, package: MissionPackage) -> None:
        """Keep the mission package, when the disk lets us."""
        self._behind.put(_PACKAGE, partial(self._package_to_disk, package))

    def tick(self) -> list[str]:
        """To be called each second: what failed on the disk is tried again. Returns what there is to say of it."""
        if self._wanted is not None and self._written < self._wanted.serial and self._behind.idle:
            self._behind.put(_STATE, partial(self._to_disk, self._wanted))
        troubles = []
        with suppress(IndexError):
            while True:
                troubles.append(self._troubles.popleft())
        return troubles

    def settle(self, within_s: float) -> bool:
        """Wait until the disk has everything, or has failed; so long at most. Whether it is so."""
        return self._behind.settle(within_s)

    def close(self, within_s: float = CLOSE_S) -> bool:
        """The end: wait for the disk, so long at most; whether it has everything."""
        done = self._behind.close(within_s)
        if self._slots is not None:
            self._slots.close()
        return done

    def _void(self) -> None:
        """What is in memory must not be taken for the last word any more."""
        slots = self._slots
        if slots is None:
            return
        try:
            slots.void()
        except OSError:  # nor can that be written: then the file goes
            self._slots = None
            slots.close()
            discard(slots.path)

    # ---- in the thread --------------------------------------------------------------------------------------------

    def _to_disk(self, kept: Kept) -> None:
        try:
            self._disk.save(kept.snapshot, kept.boot, kept.serial)
        except OSError as error:
            self._troubles.append(f"the disk does not take it: {error.strerror or error}")
        else:
            self._written = kept.serial

    def _package_to_disk(self, package: MissionPackage) -> None:
        for store in (self._packages, self._disk):
            if store is None:
                continue
            try:
                store.save_package(package)
            except OSError as error:
                self._troubles.append(f"the mission package cannot be kept: {error.strerror or error}")
