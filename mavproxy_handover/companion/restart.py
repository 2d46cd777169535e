# SPDX-License-Identifier: GPL-3.0-or-later

"""Authority kept over a restart: when the state is kept, and what a new run makes of the old one's.

Rules
-----
* It is kept before anybody hears of it: what is told must outlive a crash. No disk is waited for
  (`store/state_store.py`).
* If it cannot be kept, whatever the reason, what was kept before must go: after a restart it would give authority to
  whoever had it then. What the rules settled comes into force all the same.
* Without a store nothing is kept: a restart in flight means that nobody commands.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from mavproxy_handover.core.arbiter import Arbiter
from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.core.common.snapshot import Snapshot
from mavproxy_handover.event_log import EventLog
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.store.state_store import StateStore

__all__ = ["Restart"]


class Restart:
    """Reads what the run before left in `store`, and keeps there what the next one needs.

    `store` None: nothing is kept. `fault` is told what broke in that, `not_kept`, once in the same words, what memory
    or disk does not take.
    """

    def __init__(
        self, store: StateStore | None, fault: Callable[[str, str], None], not_kept: Callable[[str], None]
    ) -> None:
        self._store = store
        self._fault = fault
        self._not_kept = not_kept
        self._told: set[str] = set()
        #: what the run before left behind, if it did
        self.restored: Snapshot | None = None
        self._trouble = ""
        if store is not None:
            self.restored, self._trouble = store.recall()
        #: what is kept, or need not be; None if it is not known that anything is
        self._saved: Snapshot | None = self.restored

    def save(self, snapshot: Snapshot) -> None:
        """Keep the snapshot if it says something new."""
        if self._store is None or snapshot == self._saved:
            return
        try:
            self._store.save(snapshot)
            self._saved = snapshot
        except OSError as error:
            self._saved = None
            self._tell(error.strerror or str(error))
        except Exception as error:  # the new view comes into force behind this, whatever broke
            self._saved = None
            self._fault("state file", str(error))

    def each_second(self, snapshot: Snapshot) -> None:
        """The same again, if that failed; and the disk, if it did."""
        self.save(snapshot)
        if self._store is not None:
            for trouble in self._store.tick():
                self._tell(trouble)

    def _tell(self, trouble: str) -> None:
        if trouble not in self._told:
            self._told.add(trouble)
            self._not_kept(f"the state is not kept as it should be: {trouble}")

    def keep(self, package: MissionPackage) -> None:
        """Keep the mission package that the autopilot holds now."""
        if self._store is not None:
            self._store.keep(package)

    def resume(self, arbiter: Arbiter, event_log: EventLog) -> MissionPackage | None:
        """Go on where the run before this one ended, or say that this cannot be done.

        Returns the mission package that the autopilot still holds.
        """
        restored = self.restored
        if self._store is not None and self._store.note:
            event_log.kept_elsewhere(self._store.note)
        if self._trouble:
            event_log.state_lost(self._trouble)
        if restored is None:
            self._saved = arbiter.snapshot()  # what a run begins with need not be kept
            return None
        if self._store is None:
            return None
        # the epoch has risen: if this run ends soon, the next one must begin above it
        self.save(replace(arbiter.snapshot(), packs=restored.packs, kept=restored.kept, kept_by=restored.kept_by))
        if restored.phase is Phase.ON_LOAD:
            return None
        where = "a rehearsal" if restored.rehearsal else "flight"
        event_log.restarted(arbiter.name(restored.owner), arbiter.view.epoch, where, proven=restored.proven)
        package = self._store.load_package(restored.digest) if restored.digest else None
        if restored.digest and package is None:
            event_log.package_lost()
        return package

    def kept_by(self) -> MissionPackage | None:
        """The package by which a mission is judged that a station wrote in the run before; None: it is not known."""
        restored, store = self.restored, self._store
        if restored is None or store is None or not restored.kept or not restored.kept_by:
            return None
        return store.load_package(restored.kept_by)

    def settle(self, within_s: float) -> bool:
        """Wait until the disk has everything, so long at most; whether it has."""
        return self._store is None or self._store.settle(within_s)

    def close(self) -> None:
        """The run ends. A disk that hangs is not waited for."""
        if self._store is not None:
            self._store.close()
