# SPDX-License-Identifier: GPL-3.0-or-later

"""Authority kept over a restart: when the state file is written, and what a new run makes of the old one's.

Rules
-----
* It is written before anybody hears of it: what is told must outlive a crash.
* If it cannot be written, the old file must go: after a restart it would give authority to whoever had it then.
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
from mavproxy_handover.store.state import StateStore

__all__ = ["Memory"]


class Memory:
    """Keeps the arbiter's snapshot in `store`; `known` is what the store says by now, or need not say.

    `fault` is told what could not be written.
    """

    def __init__(self, store: StateStore | None, known: Snapshot, fault: Callable[[str, str], None]) -> None:
        self._store = store
        #: what the state file says; None if it is not known to say anything
        self._saved: Snapshot | None = known
        self._fault = fault

    def save(self, snapshot: Snapshot) -> None:
        """Write the snapshot if it says something new. To be called again each second: it may have failed."""
        if self._store is None or snapshot == self._saved:
            return
        try:
            self._store.save(snapshot)
            self._saved = snapshot
        except OSError as error:
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

    def resume(
        self, restored: Snapshot | None, trouble: str, arbiter: Arbiter, narrator: Narrator
    ) -> MissionPackage | None:
        """Go on where the run before this one ended, or say that this cannot be done.

        `restored` and `trouble`: what `recall` returned. Returns the mission package that the autopilot still holds.
        """
        journal = narrator.journal
        if trouble:
            journal.write("state_lost", trouble, reason="fault")
            narrator.tell(f"State file: {trouble}: nobody commands.")
        if restored is None or self._store is None:
            return None
        self.save(arbiter.snapshot())  # the epoch has risen: if this run ends soon, the next one must begin above it
        if restored.phase is Phase.ON_LOAD:
            return None
        name, epoch = arbiter.name(restored.owner), arbiter.view.epoch
        journal.write("restarted", f"restarted in flight; {name} had authority", epoch=epoch)
        narrator.tell(f"Restarted in flight, epoch {epoch}: waiting for {name}.")
        package = self._store.load_package(restored.digest) if restored.digest else None
        if restored.digest and package is None:
            journal.write("state_lost", "the mission package of the run before is gone: no zones", reason="fault")
        return package
