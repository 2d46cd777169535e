# SPDX-License-Identifier: GPL-3.0-or-later

"""From the first chunk of a mission package to a loaded mission: what is taken in, what is refused and why."""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.config import VehicleConfig
from mavproxy_handover.core.events import FlightAction
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.mission.package import MissionPackage, from_bytes
from mavproxy_handover.mission.zones import ZoneFinder
from mavproxy_handover.wire.package_transfer import PackageReceiver

__all__ = ["MissionLoader"]

_RECEIVED = mavlink.HANDOVER_PACKAGE_RESULT_RECEIVED
_LOADED = mavlink.HANDOVER_PACKAGE_RESULT_LOADED
_REFUSED = mavlink.HANDOVER_PACKAGE_RESULT_REFUSED


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
