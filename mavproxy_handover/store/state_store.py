# SPDX-License-Identifier: GPL-3.0-or-later

"""The state in two copies: one in memory, written at once, and one on the disk, written later.

The copy in memory outlives the process. Writing it takes microseconds, so the main loop writes it before any message
tells of the new state. The copy on the disk outlives a loss of power. A thread writes it when the disk is ready. So a
slow, full or read-only disk delays only that copy.

Which copy a new run uses:

| memory | disk | what counts |
|---|---|---|
| valid | not later than memory, or no valid file | the copy in memory, which is the newest state |
| missing, void, damaged, or older than the disk | of this boot | only its numbers: no station has authority |
| void or damaged | of an earlier boot | as in the row before, because a newer state existed in this boot |
| missing | of an earlier boot | the disk, not `proven`: the stations decide (`core/authority/authority.py`) |

If there is no storage in memory, the first copy lies beside the second, bound to the boot. It is written without
waiting for the disk, as far as the system allows.
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
from mavproxy_handover.store.background_writer import CLOSE_S, BackgroundWriter
from mavproxy_handover.store.durable import discard
from mavproxy_handover.store.memory import Condition, Slots, boot_id, memory_folder, memory_name, passed_over
from mavproxy_handover.store.state_file import Kept, StateError, StateFile, pack, unpack

__all__ = ["StateStore", "in_flight"]

_STATE: Final = "state"
_PACKAGE: Final = "package"
#: most messages about the disk that wait to be read
_MOST_TROUBLES: Final = 8


def in_flight(folder: Path, vehicle: str) -> bool:
    """Whether the previous run of this boot ended in flight, according to the copy in memory. Never raises.

    A rehearsal is no flight. An invalid copy counts as no flight.
    """
    store = StateStore(folder, vehicle)
    try:
        held, _lost = store.held()
    finally:
        store.close()
    return held is not None and held.snapshot.phase is not Phase.ON_LOAD and not held.snapshot.rehearsal


class StateStore:
    """Stores one vehicle's state: in memory first, then in `folder`. Its own thread writes to the disk."""

    def __init__(self, folder: Path, vehicle: str) -> None:
        self._vehicle = vehicle
        self._disk = StateFile(folder, vehicle)
        self._boot = boot_id()
        #: problem with the storage of the state, "" if there is none
        self.note = ""
        self._slots, self._packages = self._open(folder)
        self._writer = BackgroundWriter("state")
        self._serial = 0
        #: state that the disk should hold, and serial of the state that it holds
        self._wanted: Kept | None = None
        self._written = 0
        self._troubles: deque[str] = deque(maxlen=_MOST_TROUBLES)

    def _open(self, folder: Path) -> tuple[Slots | None, StateFile | None]:
        """Open the copy in memory, and the store of packages in memory."""
        place = memory_folder(os.environ)
        name = memory_name(folder, self._vehicle)
        self.note = passed_over(os.environ)
        try:
            if place is not None:
                return Slots(place / f"{name}.state"), StateFile(place, name)
            why = self.note or "no storage in memory"
            self.note = f"{why}: the state is kept in {folder}, and a slow disk may hold up a handover"
            folder.mkdir(parents=True, exist_ok=True)
            return Slots(folder / f"{self._vehicle}.state.now"), None
        except OSError as error:
            self.note = f"the state outlives no restart: {error}"
            return None, None

    # ---- at the start ---------------------------------------------------------------------------------------------

    def recall(self) -> tuple[Snapshot | None, str]:
        """The state of the previous run, and the reason if its newest state is lost. Never raises."""
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
            lost = lost or "the copy in memory is gone, and the disk may be older"
            return replace(disk.snapshot, owner=None, proven=False), lost
        return replace(disk.snapshot, proven=False), ""

    def held(self) -> tuple[Kept | None, str]:
        """The valid copy in memory, and what is wrong with an invalid one."""
        if self._slots is None or self._slots.condition is Condition.EMPTY:
            return None, ""
        if self._slots.condition is Condition.HELD:
            try:
                held = unpack(self._slots.record, self._vehicle)
            except ValueError as error:
                return None, f"the copy in memory is not to be trusted: {error}"
            # of an earlier boot, if it is on a disk
            return (held, "") if held.boot == self._boot and held.serial == self._slots.serial else (None, "")
        return None, f"the copy in memory is {self._slots.condition.value}"

    def load_package(self, digest: bytes) -> MissionPackage | None:
        """The mission package with this digest, if it was kept."""
        kept = None if self._packages is None else self._packages.load_package(digest)
        return kept or self._disk.load_package(digest)

    # ---- in flight ------------------------------------------------------------------------------------------------

    def save(self, snapshot: Snapshot) -> None:
        """Store the snapshot; on return it outlives the process.

        Raises OSError: then no state outlives the process, not even an older one.
        """
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
            self._writer.put(_STATE, partial(self._to_disk, kept))

    def keep(self, package: MissionPackage) -> None:
        """Store the mission package when the disk is ready."""
        self._writer.put(_PACKAGE, partial(self._package_to_disk, package))

    def tick(self) -> list[str]:
        """Try again what failed on the disk. Returns the messages about the disk. Call it each second."""
        if self._wanted is not None and self._written < self._wanted.serial and self._writer.idle:
            self._writer.put(_STATE, partial(self._to_disk, self._wanted))
        troubles = []
        with suppress(IndexError):
            while True:
                troubles.append(self._troubles.popleft())
        return troubles

    def wait_until_written(self, within_s: float) -> bool:
        """Wait at most `within_s` until the disk has everything or has failed. Returns True if so."""
        return self._writer.wait_until_written(within_s)

    def close(self, within_s: float = CLOSE_S) -> bool:
        """Close the store and wait for the disk, at most `within_s`. Returns True if the disk has everything."""
        done = self._writer.close(within_s)
        if self._slots is not None:
            self._slots.close()
        return done

    def _void(self) -> None:
        """Make sure that the copy in memory does not count as the newest state any more."""
        slots = self._slots
        if slots is None:
            return
        try:
            slots.void()
        except OSError:  # marking it void fails too: remove the file
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
