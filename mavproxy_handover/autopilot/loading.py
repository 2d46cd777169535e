# SPDX-License-Identifier: GPL-3.0-or-later

"""From the first chunk of a mission package to a loaded mission: what is taken in, what is refused and why.

`MissionLoader` knows what a package says, `MissionWriter` gets it into the autopilot and reads it back.
"""

from __future__ import annotations

from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.autopilot.copter import Copter
from mavproxy_handover.autopilot.ties import Ties
from mavproxy_handover.config.files import VehicleConfig
from mavproxy_handover.core.events import MissionLoaded
from mavproxy_handover.core.model import FlightAction
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.mission.package import MissionPackage, from_bytes
from mavproxy_handover.mission.zones import ZoneFinder
from mavproxy_handover.stations.port import StationPort
from mavproxy_handover.wire.conversation import Conversation, Conversations
from mavproxy_handover.wire.package_transfer import PackageReceiver

__all__ = ["MissionLoader", "MissionWriter"]

_RECEIVED = mavlink.HANDOVER_PACKAGE_RESULT_RECEIVED
_LOADED = mavlink.HANDOVER_PACKAGE_RESULT_LOADED
_REFUSED = mavlink.HANDOVER_PACKAGE_RESULT_REFUSED
_ON_BOARD_RETRY_S = 10.0
#: name of the conversation
_LOAD: Final = "load"


class MissionLoader:
    """Receives packages for one vehicle and remembers what the loaded one says."""

    def __init__(self, config: VehicleConfig) -> None:
        self._config = config
        self._receiver = PackageReceiver()
        self.package: MissionPackage | None = None
        #: facts about the zones of the loaded mission
        self.finder: ZoneFinder | None = None
        self.delivery: int | None = None
        #: commanders in the order in which the route needs them
        self.commanders: tuple[int, ...] = ()
        #: the mission's own policy, None if it has none
        self.out_of_coverage: FlightAction | None = None

    def on_message(
        self, kind: str, message: Any, target: tuple[int, int], welcome: bool
    ) -> tuple[list[Any], MissionPackage | None]:
        """Take in one message of a package; returns answers, and the package once it is whole and fit to be loaded.

        `welcome`: the sender may load a mission now (it commands, the aircraft is on the ground and disarmed).
        """
        if kind == "MISSION_PACKAGE":
            digest = bytes(message.mission_digest)
            if not welcome and self._receiver.last_word(digest, target) is None:
                text = "only the commander's, on the ground, disarmed"
                return [self._receiver.refuse(digest, text, target)], None
            return self._receiver.on_offer(message, target), None
        if kind != "MISSION_CHUNK" or not welcome:
            return [], None
        answers, whole = self._receiver.on_chunk(message, target)
        if whole is None:
            return answers, None
        digest, data = whole
        try:
            package = from_bytes(data)
            self._check(package, digest)
        except MissionError as error:
            return [*answers, self._receiver.conclude(digest, _REFUSED, str(error), target)], None
        return [*answers, self._receiver.conclude(digest, _RECEIVED, "", target)], package

    def _check(self, package: MissionPackage, digest: bytes) -> None:
        if package.digest != digest:
            raise MissionError("the contents do not have the digest that was promised")
        known = {entry.station.name: entry.station.sysid for entry in self._config.stations}
        for station in package.stations:
            if known.get(station.name) != station.sysid:
                raise MissionError(f"station {station.name} ({station.sysid}) is not one of this vehicle's")
        if package.parent.sysid != self._config.parent:
            raise MissionError(f"parent {package.parent.name} is not this vehicle's")

    def concluded(self, package: MissionPackage, failure: str | None, target: tuple[int, int]) -> Any:
        """The autopilot holds the package's mission, or `failure` says why not. Returns the answer to the sender."""
        if failure is not None:
            return self._receiver.conclude(package.digest, _REFUSED, failure, target)
        self.adopt(package)
        return self._receiver.conclude(package.digest, _LOADED, "", target)

    def adopt(self, package: MissionPackage) -> None:
        """This is the mission that the autopilot holds."""
        self.package = package
        self.finder = package.zone_finder()
        self.delivery = package.delivery_waypoint
        self.commanders = tuple(package.walk().commanders)
        word = package.policies.get("on_out_of_coverage")
        self.out_of_coverage = None if word is None else FlightAction[word.upper()]


class MissionWriter:
    """Takes packages from the stations and from on board to the autopilot."""

    def __init__(self, loader: MissionLoader, copter: Copter, conversations: Conversations, ties: Ties) -> None:
        self._loader = loader
        self._copter = copter
        self._conversations = conversations
        self._ties = ties
        self._on_board_at = 0.0

    def on_message(self, port: StationPort, message: Any, welcome: bool, now: float) -> None:
        """A message of a package; `welcome`: its sender may load a mission now."""
        answers, package = self._loader.on_message(message.get_type(), message, port.target, welcome)
        for answer in answers:
            port.send(answer)
        if package is not None:
            self._ties.narrator.package_received(package.name, port.name)
            self._load(package, port, now)

    def load_on_board(self, package: MissionPackage, now: float) -> None:
        """The package on board, now that the autopilot is ready for it; again after a while if that failed."""
        if self._ties.arbiter.mission_digest or _LOAD in self._conversations:
            return
        if now >= self._on_board_at:
            self._on_board_at = now + _ON_BOARD_RETRY_S
            self._load(package, None, now)

    def _load(self, package: MissionPackage, port: StationPort | None, now: float) -> None:
        """Write a package to the autopilot and read it back; `port`: who sent it, None for the one on board."""
        ties, loader = self._ties, self._loader
        if ties.arbiter.mission_digest:  # from the first item on, the autopilot no longer holds what it held
            ties.handle(MissionLoaded(b"", ()), now)
        source = "on board" if port is None else port.name

        def done(talk: Conversation, now: float) -> None:
            if port is not None:
                port.send(loader.concluded(package, talk.failure, port.target))
            elif talk.failure is None:
                loader.adopt(package)
            if talk.failure is not None:
                ties.narrator.mission_failed(talk.failure, source)
                return
            ties.narrator.mission_written()
            ties.keep(package)
            ties.handle(MissionLoaded(package.digest, loader.commanders, loader.out_of_coverage), now)

        asking = self._copter.load(package.route.upload_items(), package.route.rally)
        self._conversations.begin(_LOAD, asking, done, now)
