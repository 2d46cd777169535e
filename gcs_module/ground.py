# SPDX-License-Identifier: GPL-3.0-or-later

"""The ground link, by which stations reach each other without the vehicle: one listening port, one device for each
peer.

All stations sign with one key, the ground link's own. Frames without a signature, with a wrong one or received before
are dropped and counted; this also holds after a restart (`store/replay.py`). Even so the rules of `core` accept from a
peer only what helps a handover that the vehicle has asked for: the key proves that a station has sent it, and only the
vehicle's link says what is true.
"""

from __future__ import annotations

from collections import Counter

from mavproxy_handover.config.station import StationConfig
from mavproxy_handover.link.devices import Device, LinkError, open_device
from mavproxy_handover.store.keys import load_station_keys
from mavproxy_handover.store.replay import ReplayStore
from mavproxy_handover.tools.clocks import Clocks
from mavproxy_handover.wire.frames import Frame
from mavproxy_handover.wire.signing import SignatureVerdict, SignedPeer

__all__ = ["GroundLink"]

#: components of all stations together; only holders of the key count
_STREAMS = 64


class GroundLink:
    """Opens everything or nothing. Raises LinkError, KeysError."""

    def __init__(self, config: StationConfig, clocks: Clocks) -> None:
        self.devices: list[Device] = []
        #: dropped frames, by the fault of their signature
        self.refused: Counter[str] = Counter()
        #: a message about the replay state, "" if it is in order
        self.note = ""
        self._clocks = clocks
        self._listening: Device | None = None
        self._peers: dict[int, Device] = {}
        self._signing: SignedPeer | None = None
        self._replay: ReplayStore | None = None
        if config.ground_key is not None:
            keys = load_station_keys(config.ground_key)
            self._signing = SignedPeer(keys.current, keys.previous, max_streams=_STREAMS)
            self._replay = ReplayStore(config.journal.parent / f"{config.station.name}.ground-replay.json")
            self.note = self._replay.load(clocks.utc())
            self._replay.attach("ground", self._signing)
        try:
            if config.ground is not None:
                self._listening = self._opened(config.ground)
            for peer in config.peers:
                self._peers[peer.station.sysid] = self._opened(peer.link)
        except LinkError:
            self._close_devices()
            raise

    @property
    def signed(self) -> bool:
        """Whether the link has a key."""
        return self._signing is not None

    @property
    def listening(self) -> int | None:
        """The descriptor to wait on; None without a ground link."""
        return None if self._listening is None else self._listening.fileno()

    @property
    def peers(self) -> tuple[int, ...]:
        """System ids of the other stations."""
        return tuple(self._peers)

    def read(self) -> list[Frame]:
        """The frames that have arrived from stations with the key; without a key, from any sender."""
        frames = [] if self._listening is None else self._listening.read()
        return [frame for frame in frames if self._proven(frame)]

    def _proven(self, frame: Frame) -> bool:
        if self._signing is None:
            return True
        verdict = self._signing.check(frame, self._clocks.utc(), self._clocks.monotonic())
        if verdict is not SignatureVerdict.OK:
            self.refused[verdict.value] += 1
        return verdict is SignatureVerdict.OK

    def write(self, peer: int, data: bytes) -> None:
        """Send a frame to a peer; an unknown peer gets nothing."""
        device = self._peers.get(peer)
        if device is None:
            return
        if self._signing is not None:
            signed = self._signing.sign(data, 0, self._clocks.utc(), self._clocks.monotonic())
            if signed is None:
                return
            data = signed
        device.write(data)

    def tick(self, now: float) -> None:
        """Save what must survive a restart; to be called often, returns at once."""
        if self._replay is not None:
            self._replay.tick(now)

    def close(self) -> None:
        """Close everything."""
        self._close_devices()
        if self._replay is not None:
            self._replay.close()

    def _close_devices(self) -> None:
        for device in self.devices:
            device.close()

    def _opened(self, text: str) -> Device:
        device = open_device(text)
        self.devices.append(device)
        return device
