# SPDX-License-Identifier: GPL-3.0-or-later

"""What a station has open: mission package, ground link, signing, journal. All of it, or nothing."""

from __future__ import annotations

from dataclasses import dataclass

from gcs_module.ground import GroundLink
from gcs_module.signing import LinkSigning
from mavproxy_handover.clocks import Clocks
from mavproxy_handover.config.station import StationConfig
from mavproxy_handover.mission import package as mission_package
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.store.journal import Journal
from mavproxy_handover.store.keys import load_key

__all__ = ["Means"]


@dataclass(frozen=True, slots=True)
class Means:
    """Opened by `of`, given back by `close`."""

    held: MissionPackage | None
    signing: LinkSigning | None
    ground: GroundLink
    journal: Journal

    @classmethod
    def of(cls, config: StationConfig, clocks: Clocks) -> Means:
        """Open what the configuration names. Raises MissionError, KeysError, LinkError, OSError."""
        held = None if config.mission is None else mission_package.load(config.mission)
        signing = None if config.key is None else LinkSigning(load_key(config.key), clocks)
        ground = GroundLink(config, clocks)
        try:
            return cls(held, signing, ground, Journal(config.journal, config.station.name))
        except OSError:
            ground.close()
            raise

    def close(self) -> None:
        """Give it all back."""
        if self.signing is not None:
            self.signing.release()
        self.ground.close()
        self.journal.close()
