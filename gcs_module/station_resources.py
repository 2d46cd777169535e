# SPDX-License-Identifier: GPL-3.0-or-later

"""The resources that a station opens: mission packages, ground link, signing, journal. All of them are opened, or
none."""

from __future__ import annotations

from dataclasses import dataclass

from gcs_module.ground import GroundLink
from gcs_module.signing import LinkSigning
from mavproxy_handover.config.served import parse_served
from mavproxy_handover.config.station import FleetVehicle, StationConfig
from mavproxy_handover.link.devices import Device, LinkError, open_device
from mavproxy_handover.mission import package as mission_package
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.store.journal import Journal
from mavproxy_handover.store.keys import KeysError, load_key
from mavproxy_handover.tools.clocks import Clocks

__all__ = ["StationResources", "VehicleResources"]


@dataclass(frozen=True, slots=True)
class VehicleResources:
    """One vehicle's: the package of its own folder, and the key on its links."""

    held: MissionPackage | None
    signing: LinkSigning | None


@dataclass(frozen=True, slots=True)
class StationResources:
    """Opened by `of`, closed by `close`."""

    #: in the order of the configuration
    vehicles: tuple[VehicleResources, ...]
    ground: GroundLink
    journal: Journal
    #: link to a served program; None: there is none
    served: Device | None

    @classmethod
    def of(cls, config: StationConfig, clocks: Clocks) -> StationResources:
        """Open what the configuration names. Raises MissionError, KeysError, LinkError, OSError."""
        keys = _keys(config.vehicles)
        vehicles = tuple(
            VehicleResources(
                None if vehicle.mission is None else mission_package.load(vehicle.mission),
                LinkSigning(keys[vehicle.sysid], clocks) if vehicle.sysid in keys else None,
            )
            for vehicle in config.vehicles
        )
        ground = GroundLink(config, clocks)
        served: Device | None = None
        try:
            if config.serve is not None:
                served = open_device(parse_served(config.serve).text)
            return cls(vehicles, ground, Journal(config.journal, config.station.name), served)
        except (OSError, LinkError):
            ground.close()
            if served is not None:
                served.close()
            raise

    def close(self) -> None:
        """Close everything."""
        for vehicle in self.vehicles:
            if vehicle.signing is not None:
                vehicle.signing.release()
        self.ground.close()
        if self.served is not None:
            self.served.close()
        self.journal.close()


def _keys(vehicles: tuple[FleetVehicle, ...]) -> dict[int, bytes]:
    """The keys by system id. Raises KeysError, also if two vehicles share a key: a frame to one could be replayed to
    the other."""
    keys = {vehicle.sysid: load_key(vehicle.key) for vehicle in vehicles if vehicle.key is not None}
    owners: dict[bytes, str] = {}
    for vehicle in vehicles:
        key = keys.get(vehicle.sysid)
        if key is not None and owners.setdefault(key, vehicle.called) != vehicle.called:
            raise KeysError(
                f"{owners[key]} and {vehicle.called} have the same key: what is sent to one could be played to the "
                "other; each vehicle needs one of its own"
            )
    return keys
