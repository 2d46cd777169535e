# SPDX-License-Identifier: GPL-3.0-or-later

"""Loads mission packages into the autopilot: those of stations, and the one on board.

`PackageReader` receives and reads a package. `PackageLoader` writes it to the autopilot and reads it back. Reading a
package and walking its route take time, so a worker thread does both. The route is walked once: the commanders that the
walk finds are saved with the state of authority.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.events import MissionLoaded
from mavproxy_handover.gate.list_changes import ListChange
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.mission.items import RallyPoint
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.operator.base.context import Context
from mavproxy_handover.operator.stations.port import StationPort
from mavproxy_handover.operator.uploads.flown_mission import FlownMission
from mavproxy_handover.operator.uploads.ground_uploads import GroundUploads
from mavproxy_handover.operator.uploads.mission_readiness import ON_BOARD_RETRY_S, MissionReadiness
from mavproxy_handover.operator.uploads.package_reader import PackageReader
from mavproxy_handover.operator.uploads.prepared import Along, Prepared, prepare
from mavproxy_handover.tools.schedule import attempt
from mavproxy_handover.tools.worker import Worker
from mavproxy_handover.vehicle.mission_protocol import LOADING
from mavproxy_handover.vehicle.procedures import Plan
from mavproxy_handover.wire.conversation import Conversation
from mavproxy_handover.wire.package_transfer import held_already

__all__ = ["MissionSurroundings", "PackageLoader"]

_RECEIVED = mavlink.HANDOVER_PACKAGE_RESULT_RECEIVED
_LOADED = mavlink.HANDOVER_PACKAGE_RESULT_LOADED
#: the sender of a package asks every half second; for this time (s) the last answer is repeated
_SAID_AGAIN_S: Final = 5.0
#: name of the conversation
#: the source of a package that no station has sent
_ON_BOARD: Final = "on board"


@dataclass(frozen=True, slots=True)
class MissionSurroundings:
    """The functions of the companion that the mission needs."""

    #: saves the mission package that the autopilot holds
    keep: Callable[[MissionPackage], None]
    #: discards the mission files that a station has open for writing at the autopilot
    close_files: Callable[[], None]
    #: whether a station is writing the mission or the geofence
    list_open: Callable[[], bool]


class PackageLoader:
    """Loads the packages of one vehicle. `close_files`: as in `MissionSurroundings`. Times are monotonic seconds."""

    def __init__(
        self,
        context: Context,
        reader: PackageReader,
        flown: FlownMission,
        readiness: MissionReadiness,
        uploads: GroundUploads,
        close_files: Callable[[], None],
    ) -> None:
        self._reader = reader
        self._procedures = context.procedures
        self._conversations = context.conversations
        self._authority = context.authority
        self._reports = context.reports
        self._flown = flown
        self._readiness = readiness
        self._uploads = uploads
        self._close_files = close_files
        self._worker = Worker()
        self._on_board_at = 0.0
        #: the package that is being written, and its sender; None: the package on board
        self._writing: tuple[MissionPackage, StationPort | None] | None = None
        #: when a package was loaded last
        self._loaded_at = -inf

    def on_message(self, port: StationPort, message: Any, held: bytes, now: float) -> None:
        """A message of a package. `held`: the digest of the package that the autopilot holds unchanged."""
        welcome = self._welcome(port, now)
        if message.get_type() == "MISSION_PACKAGE":
            digest = bytes(message.mission_digest)
            if not welcome and digest == held and now - self._loaded_at > _SAID_AGAIN_S:
                port.send(held_already(digest, port.target))
                return
            if not self._still_true(digest, held, now):
                self._reader.forget()
        answers, whole = self._reader.on_message(message.get_type(), message, port.target, welcome)
        for answer in answers:
            port.send(answer)
        if whole is None:
            return
        digest, data = whole
        target, addresses = port.target, self._reader.addresses(digest)

        def read(result: Prepared | Exception, now: float) -> None:
            if not isinstance(result, Prepared):
                port.send(self._reader.refused(digest, self._why(result), target))
            elif not self._welcome(port, now):  # it took a while to read
                port.send(self._reader.refused(digest, "too late: it has no authority, or START was given", target))
            else:
                port.send(self._reader.received(digest, target))
                self._reports.event_log.package_received(result.package.name, port.name)
                self._load(result, port, now)

        if not self._worker.submit(lambda: self._reader.read(data, digest, addresses), read):
            port.send(self._reader.refused(digest, "another package is being read: share it again", target))

    def _still_true(self, digest: bytes, held: bytes, now: float) -> bool:
        """Whether the sender of this package may be told again what it was told last: an answer was lost."""
        said = self._reader.said(digest)
        if said == _RECEIVED:
            return LOADING in self._conversations
        if said == _LOADED:
            return digest == held and now - self._loaded_at <= _SAID_AGAIN_S
        return True

    def list_changed(self, port: StationPort, change: ListChange, now: float) -> None:
        """On the ground a station's message changes a list of the autopilot: no package counts any more."""
        loaded = bool(self._authority.arbiter.mission_digest)
        self._on_board_at = now + ON_BOARD_RETRY_S
        why = f"{port.name} changed the {change.what} meanwhile"
        attempt(self._reports.fault, "end of a load", self._break_off, why, now)
        self.drop(now)
        self._readiness.changed(port, change, loaded, now)

    def flight_over(self, now: float) -> None:
        """On the ground again, and the mission was changed in flight: the package does not count any more."""
        loaded = bool(self._authority.arbiter.mission_digest)
        self.drop(now)
        if loaded:
            self._readiness.flight_over(now)

    def changed_past(self, how: str, now: float) -> None:
        """The autopilot holds another mission or geofence than it did, and no station's message has changed it."""
        self._on_board_at = now + ON_BOARD_RETRY_S
        self.drop(now)
        self._reports.event_log.changed_past(how)
        self._readiness.changed_past(how, now)

    def drop(self, now: float) -> None:
        """What the autopilot holds is not known any more."""
        self._reader.forget()
        self._forget_mission(now)

    def _forget_mission(self, now: float) -> None:
        if self._authority.arbiter.mission_digest:
            self._authority.handle(MissionLoaded(b"", ()), now)
        self._flown.drop(now)

    def _break_off(self, why: str, now: float) -> None:
        """End the load that is under way."""
        if not self._conversations.drop(LOADING) or self._writing is None:
            return
        (package, port), self._writing = self._writing, None
        self._failed(package, why, port, now)

    def load_on_board(self, now: float) -> None:
        """Load the package on board, if there is one and the autopilot holds no mission; again later if that failed.

        A mission that a station wrote to the autopilot on the ground stays (`mission_readiness.py`).
        """
        package = self._readiness.on_board
        waits = self._readiness.kept or now < self._on_board_at
        if package is None or waits or self._authority.arbiter.mission_digest or LOADING in self._conversations:
            return
        self._on_board_at = now + ON_BOARD_RETRY_S

        def prepared(result: Prepared | Exception, now: float) -> None:
            if not isinstance(result, Prepared):
                self._failed(package, self._why(result), None, now)
            elif not self._readiness.kept and self._authority.arbiter.grounded(now):  # it took a while to prepare
                self._load(result, None, now)

        self._worker.submit(lambda: prepare(package), prepared)

    def find_along(self, package: MissionPackage, found: Callable[[Along], None]) -> None:
        """Beside the main loop: what lies along the way of a package that the autopilot holds already."""

        def prepared(result: Prepared | Exception, _now: float) -> None:
            if isinstance(result, Prepared):
                found(result.along)
            else:
                self._reports.fault("way of the mission", f"{type(result).__name__}: {result}")

        self._worker.submit(lambda: prepare(package), prepared)

    def tick(self, now: float) -> None:
        """Time has passed; to be called often."""
        self._worker.tick(now)

    def _welcome(self, port: StationPort, now: float) -> bool:
        return self._authority.commands(port.sysid) and self._authority.arbiter.grounded(now)

    def _why(self, error: Exception) -> str:
        if isinstance(error, (MissionError, TimeoutError)):
            return str(error)
        self._reports.fault("mission package", f"{type(error).__name__}: {error}")
        return "internal fault"

    def _load(self, prepared: Prepared, port: StationPort | None, now: float) -> None:
        """Write a package to the autopilot and read it back; `port`: of its sender, None for the package on board."""
        reader, package = self._reader, prepared.package
        self._forget_mission(now)  # from the first item on, the autopilot does not hold the former mission
        self._close_files()
        self._writing = package, port
        self._uploads.forget()

        def done(talk: Conversation, now: float) -> None:
            self._writing = None
            if talk.failure is not None:
                self._failed(package, talk.failure, port, now)
                return
            reader.forget()
            self._loaded_at = now
            self._flown.remember(package)
            if port is not None:
                port.send(reader.loaded(prepared, port.target))
            self._readiness.loaded(package.name, port, now)
            self._reports.event_log.mission_written(package, talk.result.fence, talk.result.cruise_mps)
            self._flown.loaded(prepared, now)

        asking = self._procedures().load(_plan(package, self._flown.first_point(package)))
        self._conversations.begin(LOADING, asking, done, now)

    def _failed(self, package: MissionPackage, why: str, port: StationPort | None, now: float) -> None:
        """Tell the sender, the other operators and the journal that a package was not loaded."""
        if port is not None:
            port.send(self._reader.refused(package.digest, why, port.target))
        self._reports.event_log.mission_failed(why, _ON_BOARD if port is None else port.name)
        self._readiness.failed(package.name, why, None if port is None else port.name, now)


def _plan(package: MissionPackage, place: RallyPoint) -> Plan:
    route, named = package.route, package.cruise_speed_named
    return Plan(route.upload_items(), (place,), route.fence, package.cruise_speed_mps if named else None)
