# SPDX-License-Identifier: GPL-3.0-or-later

"""All changes of the mission that the autopilot holds: packages, uploads on the ground and in flight, restarts."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.gate.list_changes import ListChange
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.operator.base.context import Context
from mavproxy_handover.operator.checks.read_back import ReadBack
from mavproxy_handover.operator.stations.port import StationPort
from mavproxy_handover.operator.uploads.flight_uploads import FlightUploads
from mavproxy_handover.operator.uploads.flown_mission import FlownMission
from mavproxy_handover.operator.uploads.ground_uploads import GroundUploads
from mavproxy_handover.operator.uploads.mission_readiness import MissionReadiness
from mavproxy_handover.operator.uploads.package_loading import PackageLoader
from mavproxy_handover.operator.uploads.prepared import Along, Prepared, way_of
from mavproxy_handover.tools.schedule import attempt
from mavproxy_handover.wire.conversation import Conversation

__all__ = ["MissionOnBoard", "MissionSources"]

#: name of the conversation
_HELD: Final = "held"
#: the restart of the companion in flight is over after this time (s): work that needs much processor time waits for it
_RESTART_S: Final = 10.0


@dataclass(frozen=True, slots=True)
class MissionSources:
    """The parts that bring a mission to the autopilot, or notice that it holds another one."""

    loader: PackageLoader
    uploads: GroundUploads
    flight_uploads: FlightUploads
    readiness: MissionReadiness
    read_back: ReadBack


class MissionOnBoard:
    """The changes of one vehicle's mission. Times are monotonic seconds."""

    def __init__(
        self,
        context: Context,
        flown: FlownMission,
        sources: MissionSources,
        give_start_up: Callable[[str, float], None],
    ) -> None:
        """`give_start_up` ends a START that is under way, for a reason in words."""
        self._context = context
        self.flown = flown
        self.flight_uploads = sources.flight_uploads
        self._sources = sources
        self._give_start_up = give_start_up
        #: work that waits until a restart in flight is over, and when it is due
        self._later: Callable[[float], None] = _nothing
        self._later_at = math.inf

    @property
    def kept(self) -> tuple[bool, bytes]:
        """Whether a station wrote the autopilot's mission on the ground, and the digest of the package that judges it.

        The digest is empty if there is no such package.
        """
        package, kept = self.flown.latest, self._sources.readiness.kept
        return kept, package.digest if kept and package is not None else b""

    # ---- after a restart of the companion -------------------------------------------------------------------------

    def restore(self, package: MissionPackage, now: float) -> None:
        """The autopilot holds this package, as the previous run has saved.

        It is read back. If a station has replaced it in flight, the mission is read from the autopilot. Gaps are
        computed at once, and the borders of zones when the restart is over.
        """
        self.flown.remember(package)
        self.flown.set_mission(Prepared(package, package.zone_finder(), (), way_of(package)), now)

        def found(along: Along) -> None:
            if self.flown.route is package.route:
                self.flown.set_along(along)

        self._later = lambda _now: self._sources.loader.find_along(package, found)
        self._later_at = now if package.gaps else now + _RESTART_S

        def done(talk: Conversation, now: float) -> None:
            if talk.result:
                self.flown.reroute(None, now)
                self._later, self._later_at = self.flight_uploads.found, now + _RESTART_S

        asking = self._context.procedures().holds_another(package.route.upload_items())
        self._context.conversations.begin(_HELD, asking, done, now)

    def restore_upload(self, package: MissionPackage | None, now: float) -> None:
        """In the previous run, a station wrote the mission that the autopilot holds. On the ground it is judged again.

        `package`: its zones count; None: those of the package on board.
        """
        self._sources.readiness.kept = True
        if package is not None and self.flown.latest is None:
            self.flown.remember(package)
        if self._context.authority.arbiter.view.phase is Phase.ON_LOAD:
            self._sources.uploads.found(now)

    def replay(self, prepared: Prepared, now: float) -> None:
        """The autopilot of a recorded flight holds this mission; it cannot be asked."""
        self.flown.set_mission(prepared, now)

    # ---- changes --------------------------------------------------------------------------------------------------

    def on_package(self, port: StationPort, message: Any, now: float) -> None:
        """A message of a mission package. Only the commander can load one, and only on the ground."""
        held = b"" if self.flown.changed else self._context.authority.arbiter.mission_digest
        self._sources.loader.on_message(port, message, held, now)

    def list_changed(self, port: StationPort, change: ListChange, on_ground: bool, now: float) -> None:
        """A station's message that changes the mission or the geofence was sent to the autopilot.

        Not on the ground (in a rehearsal) the package counts until the end of the phase, as after an upload in flight.
        """
        if not on_ground:
            self.flown.reroute(None, now)
            return
        why = f"{port.name} changed the {change.what}"
        attempt(self._context.reports.fault, "end of START", self._give_start_up, why, now)
        self._sources.loader.list_changed(port, change, now)
        self._sources.uploads.changed(port, change, now)

    def check_read_back(self, now: float) -> None:
        """Drop the mission if it was read back and differs; to be called after each conversation with the autopilot."""
        difference = self._sources.read_back.pop_difference()
        if difference:
            self._sources.loader.changed_past(difference, now)
            self._sources.read_back.refuse(now)

    def drop(self, now: float) -> None:
        """The mission that the autopilot holds is not known any more."""
        self._sources.loader.drop(now)

    def authority_moved(self, now: float) -> None:
        """Another station has authority, or no station."""
        self.flight_uploads.authority_moved(now)

    # ---- time -----------------------------------------------------------------------------------------------------

    def tick(self, now: float) -> None:
        """Time has passed; to be called often."""
        fault, sources = self._context.reports.fault, self._sources
        attempt(fault, "mission read back", self.check_read_back, now)
        if self.flown.unjudged:
            attempt(fault, "the plan", self.flown.judge, now)
        attempt(fault, "mission packages", sources.loader.tick, now)
        attempt(fault, "mission read back", sources.read_back.tick, now)
        attempt(fault, "uploads in flight", self.flight_uploads.tick, now)
        attempt(fault, "uploads on the ground", sources.uploads.tick, now)

    def load_on_board(self, grounded: bool, now: float) -> None:
        """Load the package on board if the autopilot needs it. `grounded`: neither armed nor about to be."""
        sources = self._sources
        if self.flown.changed_aloft and grounded:
            sources.loader.flight_over(now)
            if sources.readiness.kept:
                sources.uploads.found(now)
        if grounded and self._context.state.position.value is not None:
            sources.loader.load_on_board(now)

    def do_later(self, now: float) -> None:
        """Do the work that waits for the end of a restart, if it is due."""
        if now >= self._later_at:
            self._later_at = math.inf
            self._later(now)


def _nothing(_now: float) -> None:
    """No work waits."""
