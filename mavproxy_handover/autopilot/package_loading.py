# SPDX-License-Identifier: GPL-3.0-or-later

"""From the first chunk of a mission package to a loaded mission: what is taken in, what is refused and why.

`MissionLoader` knows what a package says, `MissionWriter` gets it into the autopilot and reads it back. To read a
package and to walk its route takes as long as its sender likes, so both are done beside the main loop, and the walk
once only: the commanders that it finds are kept with the state of authority.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.autopilot.authority import Authority
from mavproxy_handover.autopilot.delivery import DeliveryPoint
from mavproxy_handover.autopilot.package_standing import ON_BOARD_RETRY_S, PackageStanding
from mavproxy_handover.autopilot.procedures import Plan, Procedures
from mavproxy_handover.autopilot.reports import Reports
from mavproxy_handover.config.files import VehicleConfig
from mavproxy_handover.core.events import MissionLoaded
from mavproxy_handover.core.safety.energy import Piece
from mavproxy_handover.gate.list_changes import ListChange
from mavproxy_handover.mission.crossings import WayAhead
from mavproxy_handover.mission.energy import PreparedWay
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.mission.gaps import Stretch
from mavproxy_handover.mission.items import RallyPoint
from mavproxy_handover.mission.package import MissionPackage, from_bytes
from mavproxy_handover.mission.pieces import Line, PieceRow
from mavproxy_handover.mission.plan import Route
from mavproxy_handover.mission.walk import Handover, legs_of
from mavproxy_handover.mission.zones import ZoneFinder
from mavproxy_handover.schedule import attempt
from mavproxy_handover.stations.port import StationPort
from mavproxy_handover.vehicle_address import Addresses, unpack_addresses
from mavproxy_handover.wire.conversation import Conversation, Conversations
from mavproxy_handover.wire.package_transfer import PackageReceiver, held_already
from mavproxy_handover.worker import Worker

__all__ = ["Along", "MissionLoader", "MissionWriter", "Prepared", "Way", "prepare", "way_of"]

#: so many legs ahead are looked at
_NEXT = 6
#: and so many where circles and splines are rows of short ones
_NEXT_PIECES = 40
_RECEIVED = mavlink.HANDOVER_PACKAGE_RESULT_RECEIVED
_LOADED = mavlink.HANDOVER_PACKAGE_RESULT_LOADED
_REFUSED = mavlink.HANDOVER_PACKAGE_RESULT_REFUSED
#: the sender of a package asks again every half second: what it was told is said again for so long (s)
_SAID_AGAIN_S: Final = 5.0
#: name of the conversation
_LOAD: Final = "load"
#: where a package came from that no station sent
_ON_BOARD: Final = "on board"


@dataclass(frozen=True, slots=True)
class MissionSurroundings:
    """What else there is to do about the mission that the autopilot holds."""

    #: keeps the mission package that it holds
    keep: Callable[[MissionPackage], None]
    #: throws away the mission files that a station has open for writing there
    close_files: Callable[[], None]
    #: whether a station is writing its mission or geofence
    list_open: Callable[[], bool]


class MissionWriter:
    """Takes packages from the stations and from on board to the autopilot. What takes time is the `worker`'s.

    `flies_by` is told which package the autopilot holds from now on, None while it holds none, and what is along it.
    `first_point`: what its rally list is to hold with the plan, and that alone; the rally points of the package are
    candidates (`places.py`). `overwrites` is called before a package is written.
    """

    def __init__(
        self,
        loader: MissionLoader,
        procedures: Callable[[], Procedures],
        conversations: Conversations,
        authority: Authority,
        reports: Reports,
        flies_by: Callable[[MissionPackage | None, Along, float], None],
        first_point: Callable[[MissionPackage], RallyPoint],
        standing: PackageStanding,
        overwrites: Callable[[], None],
        around: MissionSurroundings,
    ) -> None:
        self._loader = loader
        self._procedures = procedures
        self._conversations = conversations
        self._authority = authority
        self._reports = reports
        self._flies_by = flies_by
        self._first_point = first_point
        self._standing = standing
        self._overwrites = overwrites
        self._around = around
        #: the package that was loaded last, whatever the autopilot holds by now
        self.latest: MissionPackage | None = None
        self._worker = Worker()
        self._on_board_at = 0.0
        #: what is being written, and its sender; None: the package on board
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
                self._loader.forget()
        answers, whole = self._loader.on_message(message.get_type(), message, port.target, welcome)
        for answer in answers:
            port.send(answer)
        if whole is None:
            return
        digest, data = whole
        target, addresses = port.target, self._loader.addresses(digest)

        def read(result: Prepared | Exception, now: float) -> None:
            if not isinstance(result, Prepared):
                port.send(self._loader.refused(digest, self._why(result), target))
            elif not self._welcome(port, now):  # it took a while to read
                port.send(self._loader.refused(digest, "too late: it commands no more, or START was given", target))
            else:
                port.send(self._loader.received(digest, target))
                self._reports.narrator.package_received(result.package.name, port.name)
                self._load(result, port, now)

        if not self._worker.submit(lambda: self._loader.read(data, digest, addresses), read):
            port.send(self._loader.refused(digest, "another package is being read: share it again", target))

    def _still_true(self, digest: bytes, held: bytes, now: float) -> bool:
        """Whether the sender of this package may be told again what it was told last: an answer was lost."""
        said = self._loader.said(digest)
        if said == _RECEIVED:
            return _LOAD in self._conversations
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
        self._standing.changed(port, change, loaded, now)

    def fly(self, prepared: Prepared, now: float) -> None:
        """The autopilot holds this mission, which a station wrote and which was judged (`ground_uploads.py`)."""
        package, loader = prepared.package, self._loader
        loader.adopt(package, prepared.finder, prepared.way, now)
        self._around.keep(package)
        self._authority.handle(MissionLoaded(package.digest, prepared.commanders, loader.out_of_coverage), now)

    def flight_over(self, now: float) -> None:
        """On the ground again, and the mission was changed in flight: the package does not count any more."""
        loaded = bool(self._authority.arbiter.mission_digest)
        self.drop(now)
        if loaded:
            self._standing.flight_over(now)

    def changed_past(self, how: str, now: float) -> None:
        """The autopilot holds another mission or geofence than it did, and no station's message has changed it."""
        self._on_board_at = now + ON_BOARD_RETRY_S
        self.drop(now)
        self._reports.narrator.changed_past(how)
        self._standing.changed_past(how, now)

    def drop(self, now: float) -> None:
        """What the autopilot holds is not known any more."""
        self._loader.forget()
        if self._authority.arbiter.mission_digest:
            self._authority.handle(MissionLoaded(b"", ()), now)
        self._flies_by(None, Along(), now)

    def _break_off(self, why: str, now: float) -> None:
        """End the load that is under way."""
        if not self._conversations.drop(_LOAD) or self._writing is None:
            return
        (package, port), self._writing = self._writing, None
        self._failed(package, why, port, now)

    def load_on_board(self, package: MissionPackage, now: float) -> None:
        """The package on board, now that the autopilot is ready for it; again after a while if that failed.

        What a station wrote to the autopilot on the ground stays (`package_standing.py`).
        """
        waits = self._standing.kept or now < self._on_board_at
        if waits or self._authority.arbiter.mission_digest or _LOAD in self._conversations:
            return
        self._on_board_at = now + ON_BOARD_RETRY_S

        def prepared(result: Prepared | Exception, now: float) -> None:
            if not isinstance(result, Prepared):
                self._failed(package, self._why(result), None, now)
            elif not self._standing.kept and self._authority.arbiter.grounded(now):  # it took a while to prepare
                self._load(result, None, now)

        self._worker.submit(lambda: prepare(package), prepared)

    def walk_along(self, package: MissionPackage, found: Callable[[Along], None]) -> None:
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
        """Write a package to the autopilot and read it back; `port`: who sent it, None for the one on board."""
        authority, around = self._authority, self._around
        loader, package = self._loader, prepared.package
        if authority.arbiter.mission_digest:  # from the first item on, the autopilot no longer holds what it held
            authority.handle(MissionLoaded(b"", ()), now)
        self._flies_by(None, Along(), now)
        around.close_files()
        self._writing = package, port
        self._overwrites()

        def done(talk: Conversation, now: float) -> None:
            self._writing = None
            if talk.failure is not None:
                self._failed(package, talk.failure, port, now)
                return
            loader.adopt(package, prepared.finder, prepared.way, now)
            loader.forget()
            self._loaded_at = now
            self.latest = package
            if port is not None:
                port.send(loader.loaded(prepared, port.target))
            self._standing.loaded(package.name, port, now)
            self._reports.narrator.mission_written(package, talk.result.fence, talk.result.cruise_mps)
            around.keep(package)
            self._flies_by(package, prepared.along, now)
            authority.handle(MissionLoaded(package.digest, prepared.commanders, loader.out_of_coverage), now)

        asking = self._procedures().load(_plan(package, self._first_point(package)))
        self._conversations.begin(_LOAD, asking, done, now)

    def _failed(self, package: MissionPackage, why: str, port: StationPort | None, now: float) -> None:
        """Tell the sender, the other operators and the journal that a package was not loaded."""
        if port is not None:
            port.send(self._loader.refused(package.digest, why, port.target))
        self._reports.narrator.mission_failed(why, _ON_BOARD if port is None else port.name)
        self._standing.failed(package.name, why, None if port is None else port.name, now)


def _plan(package: MissionPackage, place: RallyPoint) -> Plan:
    route, named = package.route, package.cruise_speed_named
    return Plan(route.upload_items(), (place,), route.fence, package.cruise_speed_mps if named else None)
