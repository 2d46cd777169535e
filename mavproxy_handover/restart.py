# SPDX-License-Identifier: GPL-3.0-or-later

"""Authority kept over a restart: when the state file is written, and what a new run makes of the old one's.

Rules
-----
* It is written before anybody hears of it: what is told must outlive a crash.
* If it cannot be written, whatever the reason, the old file must go: after a restart it would give authority to whoever
  had it then. What the rules settled comes into force all the same.
* Without a store nothing is kept: a restart in flight means that nobody commands.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

from mavproxy_handover.core.arbiter import Arbiter
from mavproxy_handover.core.model import Phase
from mavproxy_handover.core.snapshot import Snapshot
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.narrator import Narrator
from mavproxy_handover.store.state import StateStore, recall

__all__ = ["Restart"]


class Restart:
    """Reads what the run before left in `store`, and keeps there what the next one needs.

    `store` None: nothing is kept. `fault` is told what could not be written.
    """

    def __init__(self, store: StateStore | None, fault: Callable[[str, str], None]) -> None:
        self._store = store
        self._fault = fault
        #: what the run before left behind, if it did
        self.restored: Snapshot | None
        self.restored, self._trouble = recall(store)
        #: what the state file says, or need not say; None if it is not known to say anything
        self._saved: Snapshot | None = self.restored

    def save(self, snapshot: Snapshot) -> None:
        """Write the snapshot if it says something new. To be called again each second: it may have failed."""
        if self._store is None or snapshot == self._saved:
            return
        try:
            self._store.save(snapshot)
            self._saved = snapshot
        except Exception as error:  # the new view comes into force behind this, whatever broke
            self._saved = None
            self._fault("state file", str(error))
            with suppress(OSError):
                self._store.clear()

    def keep(self, package: MissionPackage) -> None:
        """Write the mission package that the autopilot holds now."""
        if self._store is None:
            return
        try:
            self._store.save_package(package)
        except OSError as error:
            self._fault("state file", str(error))

    def resume(self, arbiter: Arbiter, narrator: Narrator) -> MissionPackage | None:
        """Go on where the run before this one ended, or say that this cannot be done.

        Returns the mission package that the autopilot still holds.
        """
        restored = self.restored
        if self._trouble:
            narrator.state_lost(self._trouble)
        if restored is None:
            self._saved = arbiter.snapshot()  # what a run begins with need not be written
            return None
        if self._store is None:
            return None
        self.save(arbiter.snapshot())  # the epoch has risen: if this run ends soon, the next one must begin above it
        if restored.phase is Phase.ON_LOAD:
            return None
        narrator.restarted(arbiter.name(restored.owner), arbiter.view.epoch)
        package = self._store.load_package(restored.digest) if restored.digest else None
        if restored.digest and package is None:
            narrator.package_lost()
        return package
