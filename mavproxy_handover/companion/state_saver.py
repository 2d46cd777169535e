# SPDX-License-Identifier: GPL-3.0-or-later

"""Saves the state of authority, the batteries and the mission package for the next run."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from dataclasses import replace

from mavproxy_handover.companion.autopilot_parts import Autopilot
from mavproxy_handover.companion.restart import Restart
from mavproxy_handover.core.arbiter import Arbiter
from mavproxy_handover.core.common.snapshot import Snapshot
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.store.journal import Journal

__all__ = ["PackageSaver", "StateSaver"]


class PackageSaver:
    """Saves the mission package that the autopilot holds, for the next run and beside the journal."""

    def __init__(self, restart: Restart, journal: Journal) -> None:
        self._restart = restart
        self._journal = journal

    def save(self, package: MissionPackage) -> None:
        """The autopilot holds this package now."""
        self._restart.keep(package)
        self.lay_beside_journal(package)

    def lay_beside_journal(self, package: MissionPackage) -> None:
        """Write the files of the package beside the journal, so that the journal can be read with them alone."""
        self._journal.lay_beside(f"mission-{package.digest.hex()[:8]}", package.files)


class StateSaver:
    """Saves the state of one vehicle."""

    def __init__(
        self, restart: Restart, arbiter: Arbiter, autopilot: Autopilot, fault: Callable[[str, str], None]
    ) -> None:
        self._restart = restart
        self._arbiter = arbiter
        self._autopilot = autopilot
        self._fault = fault

    def save(self) -> None:
        """Save the state if it has changed."""
        self._restart.save(self._snapshot())

    def each_second(self) -> None:
        """Save the state, and try again what memory or disk did not take."""
        self._restart.each_second(self._snapshot())

    def _snapshot(self) -> Snapshot:
        kept, kept_by = self._autopilot.mission.kept
        snapshot = replace(self._arbiter.snapshot(), kept=kept, kept_by=kept_by)
        try:
            return replace(snapshot, packs=self._autopilot.energy.memory)
        except Exception:  # the rest of the state is worth more
            self._fault("memory of the batteries", traceback.format_exc(limit=-3))
            return snapshot
