# SPDX-License-Identifier: GPL-3.0-or-later

"""Keeps authority across a restart: stores the state, and lets a new run go on from it.

Rules
-----
* The state is stored before any message tells of it, because what was told must survive a crash. This does not wait for
  a disk (`store/state_store.py`).
* If the state cannot be stored, for whatever reason, the older stored state must be removed. After a restart it would
  give authority to the former commander. The new state is in force anyway.
* Without a store nothing is kept: after a restart in flight no station commands.
* After a power loss the disk may hold an older state than the one that was told. `store/state_store.py` decides whether
  a stored state is `proven` to be the newest one. If it is not, `core/authority/authority.py` asks the stations.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from mavproxy_handover.core.arbiter import Arbiter
from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.core.common.snapshot import Snapshot
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.operator.stations.event_log import EventLog
from mavproxy_handover.store.state_store import StateStore

__all__ = ["Restart"]


class Restart:
    """Reads the state of the previous run from `store`, and stores the state for the next one.

    `store` None: nothing is kept. `fault` gets exceptions. `not_kept` gets each error of memory or disk once.
    """

    def __init__(
        self, store: StateStore | None, fault: Callable[[str, str], None], not_kept: Callable[[str], None]
    ) -> None:
        self._store = store
        self._fault = fault
        self._not_kept = not_kept
        self._told: set[str] = set()
        #: state of the previous run, if any
        self.restored: Snapshot | None = None
        self._trouble = ""
        if store is not None:
            self.restored, self._trouble = store.recall()
        #: the stored snapshot, or one that need not be stored; None if it is not certain that one is stored
        self._saved: Snapshot | None = self.restored

    def save(self, snapshot: Snapshot) -> None:
        """Store the snapshot if it has changed."""
        if self._store is None or snapshot == self._saved:
            return
        try:
            self._store.save(snapshot)
            self._saved = snapshot
        except OSError as error:
            self._saved = None
            self._tell(error.strerror or str(error))
        except Exception as error:  # the new view comes into force after this, whatever failed
            self._saved = None
            self._fault("state file", str(error))

    def each_second(self, snapshot: Snapshot) -> None:
        """Try again what failed in memory or on the disk."""
        self.save(snapshot)
        if self._store is not None:
            for trouble in self._store.tick():
                self._tell(trouble)

    def _tell(self, trouble: str) -> None:
        if trouble not in self._told:
            self._told.add(trouble)
            self._not_kept(f"the state is not kept as it should be: {trouble}")

    def keep(self, package: MissionPackage) -> None:
        """Store the mission package that the autopilot has now."""
        if self._store is not None:
            self._store.keep(package)

    def resume(self, arbiter: Arbiter, event_log: EventLog) -> MissionPackage | None:
        """Continue from the state of the previous run, or report that this is impossible.

        Returns the mission package that the autopilot still has.
        """
        restored = self.restored
        if self._store is not None and self._store.note:
            event_log.kept_elsewhere(self._store.note)
        if self._trouble:
            event_log.state_lost(self._trouble)
        if restored is None:
            self._saved = arbiter.snapshot()  # the state at the start of a run need not be stored
            return None
        if self._store is None:
            return None
        # the epoch has risen: the next run must begin above it, even if this one ends soon
        self.save(replace(arbiter.snapshot(), packs=restored.packs, kept=restored.kept, kept_by=restored.kept_by))
        if restored.phase is Phase.ON_LOAD:
            return None
        where = "a rehearsal" if restored.rehearsal else "flight"
        event_log.restarted(restored.owner, arbiter.view.epoch, where, proven=restored.proven)
        package = self._store.load_package(restored.digest) if restored.digest else None
        if restored.digest and package is None:
            event_log.package_lost()
        return package

    def kept_by(self) -> MissionPackage | None:
        """The package for judging a mission that a station wrote in the previous run; None if it is not known."""
        restored, store = self.restored, self._store
        if restored is None or store is None or not restored.kept or not restored.kept_by:
            return None
        return store.load_package(restored.kept_by)

    def wait_until_written(self, within_s: float) -> bool:
        """Wait at most `within_s` until the disk has everything. Returns True if it has."""
        return self._store is None or self._store.wait_until_written(within_s)

    def close(self) -> None:
        """Close the store at the end of the run. This does not wait for a disk that hangs."""
        if self._store is not None:
            self._store.close()
