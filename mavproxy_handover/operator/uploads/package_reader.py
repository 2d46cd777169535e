# SPDX-License-Identifier: GPL-3.0-or-later

"""Mission packages of stations: received in chunks, checked and read."""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.config.files import VehicleConfig
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.mission.package import from_bytes
from mavproxy_handover.operator.uploads.prepared import Prepared, prepare
from mavproxy_handover.wire.package_transfer import PackageReceiver
from mavproxy_handover.wire.vehicle_address import Addresses, unpack_addresses

__all__ = ["PackageReader"]

_RECEIVED = mavlink.HANDOVER_PACKAGE_RESULT_RECEIVED
_LOADED = mavlink.HANDOVER_PACKAGE_RESULT_LOADED
_REFUSED = mavlink.HANDOVER_PACKAGE_RESULT_REFUSED


class PackageReader:
    """Receives the packages that stations send for one vehicle, and reads them."""

    def __init__(self, config: VehicleConfig) -> None:
        self._config = config
        self._receiver = PackageReceiver()
        #: the vehicle's addresses that the last offer carried, and the digest of its package
        self._addresses: tuple[bytes, Addresses] = b"", {}

    def on_message(
        self, kind: str, message: Any, target: tuple[int, int], welcome: bool
    ) -> tuple[list[Any], tuple[bytes, bytes] | None]:
        """Take one message of a package. Returns the answers, and (digest, data) when the package is complete.

        `welcome`: the sender may load a mission now (it commands, the aircraft is on the ground and disarmed).
        """
        if kind == "MISSION_PACKAGE":
            digest = bytes(message.mission_digest)
            if not welcome and self._receiver.last_word(digest, target) is None:
                text = "only from the commander, on the ground, disarmed"
                return [self._receiver.refuse(digest, text, target)], None
            if welcome:
                self._addresses = digest, unpack_addresses(message.addresses)
            return self._receiver.on_offer(message, target), None
        if kind != "MISSION_CHUNK" or not welcome:
            return [], None
        return self._receiver.on_chunk(message, target)

    def addresses(self, digest: bytes) -> Addresses:
        """The vehicle's addresses in the offer of this package; empty: none."""
        offered, addresses = self._addresses
        return addresses if offered == digest else {}

    def read(self, data: bytes, digest: bytes, addresses: Addresses) -> Prepared:
        """Read a complete package and prepare it, in a worker thread. Raises MissionError.

        `addresses`: of the offer; the package keeps the addresses of its own stations.
        """
        package = from_bytes(data)
        if package.digest != digest:
            raise MissionError("the contents do not have the digest that was promised")
        known = {entry.station.name: entry.station.sysid for entry in self._config.stations}
        for station in package.stations:
            if known.get(station.name) != station.sysid:
                raise MissionError(f"station {station.name} ({station.sysid}) is not one of this vehicle's")
        if package.parent.sysid != self._config.parent:
            raise MissionError(f"parent {package.parent.name} is not this vehicle's")
        return prepare(package.with_addresses(addresses))

    def said(self, digest: bytes) -> int | None:
        """The last result that was sent to the sender of this package; None: none that is still valid."""
        return self._receiver.said(digest)

    def forget(self) -> None:
        """Results that were sent are not valid any more: a package that is offered again is loaded again."""
        self._receiver.forget()

    def received(self, digest: bytes, target: tuple[int, int]) -> Any:
        """The answer to the sender: the package is complete and can be loaded."""
        return self._receiver.conclude(digest, _RECEIVED, "", target)

    def refused(self, digest: bytes, why: str, target: tuple[int, int]) -> Any:
        """The answer to the sender: the package cannot be loaded, or the autopilot did not take it."""
        return self._receiver.conclude(digest, _REFUSED, why, target)

    def loaded(self, prepared: Prepared, target: tuple[int, int]) -> Any:
        """The answer to the sender: the autopilot holds the package's mission."""
        return self._receiver.conclude(prepared.package.digest, _LOADED, "", target)
