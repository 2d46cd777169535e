# SPDX-License-Identifier: GPL-3.0-or-later

"""The ground link: how stations reach each other without the vehicle. One port that listens, one device for each peer.

What comes in is as good as the network it comes over: nothing is signed here. The rules of `core` take from a peer only
what can make a handover succeed that the vehicle has asked for.
"""

from __future__ import annotations

from mavproxy_handover.config.files import StationConfig
from mavproxy_handover.link.devices import Device, LinkError, open_device
from mavproxy_handover.wire.frames import Frame

__all__ = ["GroundLink"]


class GroundLink:
    """Opens everything or nothing. Raises LinkError."""

    def __init__(self, config: StationConfig) -> None:
        self.devices: list[Device] = []
        self._listening: Device | None = None
        self._peers: dict[int, Device] = {}
        try:
            if config.ground is not None:
                self._listening = self._opened(config.ground)
            for peer in config.peers:
                self._peers[peer.station.sysid] = self._opened(peer.link)
        except LinkError:
            self.close()
            raise

    @property
    def listening(self) -> int | None:
        """The descriptor to wait on; None without a ground link."""
        return None if self._listening is None else self._listening.fileno()

    @property
    def peers(self) -> tuple[int, ...]:
        """System ids of the other stations."""
        return tuple(self._peers)

    def read(self) -> list[Frame]:
        """What has arrived, from whomever."""
        return [] if self._listening is None else self._listening.read()

    def write(self, peer: int, data: bytes) -> None:
        """Send a frame to a peer; to nobody if there is none of that id."""
        device = self._peers.get(peer)
        if device is not None:
            device.write(data)

    def close(self) -> None:
        """Close everything."""
        for device in self.devices:
            device.close()

    def _opened(self, text: str) -> Device:
        device = open_device(text)
        self.devices.append(device)
        return device
