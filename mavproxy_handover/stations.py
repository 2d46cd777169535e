# SPDX-License-Identifier: GPL-3.0-or-later

"""The stations as the companion reaches them: links, who may speak on them, and what came of it."""

from __future__ import annotations

from collections import Counter

from mavproxy_handover.config import StationLinks
from mavproxy_handover.gate.judge import StationIdentity
from mavproxy_handover.links import LinkError, UdpLink
from mavproxy_handover.wire.frames import Frame

__all__ = ["StationPort", "open_ports"]


class StationPort:
    """One station: its identity, its links, its counters."""

    def __init__(self, config: StationLinks, links: tuple[UdpLink, ...]) -> None:
        self.sysid = config.station.sysid
        self.name = config.station.name
        self.identity = StationIdentity(config.station.sysid, config.sysids)
        self.links = links
        #: component that the station's own messages come from
        self.component = 0
        #: verdicts by reason, for `handover stations`
        self.verdicts: Counter[str] = Counter()
        #: the station sent RC override or manual control since it last became commander
        self.steered = False
        self._best = 0

    @property
    def target(self) -> tuple[int, int]:
        """System and component to address."""
        return self.sysid, self.component

    def read(self, link: UdpLink) -> list[Frame]:
        """Frames that arrived on `link`; the link that speaks is the one that is answered on."""
        frames = link.read()
        if any(link.owned(frame) for frame in frames):
            self._best = self.links.index(link)
        return frames

    def write(self, data: bytes) -> None:
        """Send on the link that was heard last."""
        self.links[self._best].write(data)

    def write_all(self, data: bytes) -> None:
        """Send on every link: transfer messages must get through."""
        for link in self.links:
            link.write(data)

    def close(self) -> None:
        """Close all links."""
        for link in self.links:
            link.close()


def open_ports(configs: tuple[StationLinks, ...]) -> dict[int, StationPort]:
    """Open every link of every station, or none. Raises LinkError."""
    ports: dict[int, StationPort] = {}
    opened: list[UdpLink] = []
    try:
        for config in configs:
            links = []
            for device in config.links:
                links.append(UdpLink(device, config.sysids))
                opened.append(links[-1])
            ports[config.station.sysid] = StationPort(config, tuple(links))
    except LinkError:
        for link in opened:
            link.close()
        raise
    return ports
