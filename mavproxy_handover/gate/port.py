# SPDX-License-Identifier: GPL-3.0-or-later

"""A station, as the gate needs it."""

from __future__ import annotations

from typing import Protocol

from mavproxy_handover.gate.client_capabilities import ClientCapabilities
from mavproxy_handover.gate.judge import StationIdentity

__all__ = ["Port"]


class Port(Protocol):
    """The links to one station."""

    @property
    def sysid(self) -> int:
        """The station's system id."""

    @property
    def name(self) -> str:
        """The station's name in texts for people."""

    @property
    def capabilities(self) -> ClientCapabilities:
        """What the station's programs understand, as far as they have shown it."""

    @property
    def identity(self) -> StationIdentity:
        """The systems and components that may speak on the station's links."""

    @property
    def heartbeat(self) -> bytes:
        """The station's last heartbeat, a whole frame; empty: there was none."""

    @property
    def heartbeat_at(self) -> float:
        """The time of that heartbeat (monotonic s)."""

    def write(self, data: bytes) -> None:
        """Send a whole frame to the station."""

    def write_more(self, data: bytes) -> bool:
        """Keep a whole frame of a download, to be sent with those that follow; False: not now."""

    def flush(self) -> None:
        """Send the frames that `write_more` has kept."""

    @property
    def flow_controlled(self) -> bool:
        """Whether `write_more` refuses what the station cannot take yet."""
