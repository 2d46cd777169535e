# SPDX-License-Identifier: GPL-3.0-or-later

"""The sockets of stations: opened, read and written here, and nowhere else.

A link belongs to one station. Its bytes go through a splitter of its own; who may say what is the gate's business.
`udpout:HOST:PORT` sends to a station that listens; `udpin:HOST:PORT` listens and answers the address that last
sent a whole frame of the link's owner: a stray frame must not draw the vehicle's messages away from the station.
Nothing here raises once a link is open: errors of the network are counted.
"""

from __future__ import annotations

import socket

from mavproxy_handover.wire.frames import Frame, FrameSplitter

__all__ = ["LinkError", "UdpLink"]

_DATAGRAM_BYTES = 65536
#: datagrams taken in one go, so that one flooding link cannot keep the others waiting
_READS_AT_ONCE = 64
#: senders to one socket whose streams are told apart
_SENDERS = 16


class LinkError(Exception):
    """A link cannot be opened; one line for people."""


class UdpLink:
    """One UDP link in pymavlink's device form."""

    def __init__(self, device: str, owners: frozenset[int] | None = None) -> None:
        """Open it. `owners`: system ids that may be answered, None = all. Raises LinkError (port in use, no host)."""
        kind, host, port = device.split(":")
        self.device = device
        self._owners = owners
        self.frames_in = 0
        self.frames_out = 0
        self.errors = 0
        self._peer: tuple[str, int] | None = None
        self._splitters: dict[tuple[str, int], FrameSplitter] = {}
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            if kind == "udpin":
                self._socket.bind((host, int(port)))
            else:
                self._peer = (socket.gethostbyname(host), int(port))
        except (OSError, ValueError) as error:  # ValueError: a host name that cannot be one
            self._socket.close()
            raise LinkError(f"link {device} cannot be opened: {getattr(error, 'strerror', None) or error}") from None
        self._learns = kind == "udpin"

    def _splitter(self, address: tuple[str, int]) -> FrameSplitter:
        """Each sender's stream has a splitter of its own, so that nobody's half frame spoils another's."""
        splitter = self._splitters.get(address)
        if splitter is None:
            if len(self._splitters) >= _SENDERS:
                del self._splitters[next(iter(self._splitters))]
            splitter = self._splitters[address] = FrameSplitter()
        return splitter

    @property
    def bad_crc(self) -> int:
        """Damaged frames of the senders that are remembered."""
        return sum(splitter.counters.bad_crc for splitter in self._splitters.values())

    def fileno(self) -> int:
        """For select; -1 once closed."""
        return self._socket.fileno()

    def read(self) -> list[Frame]:
        """All whole frames that have arrived."""
        frames: list[Frame] = []
        for _ in range(_READS_AT_ONCE):
            try:
                data, address = self._socket.recvfrom(_DATAGRAM_BYTES)
            except BlockingIOError:
                break
            except OSError:  # the station's port is closed (ICMP), the interface is down
                self.errors += 1
                continue
            found = self._splitter(address).feed(data)
            if self._learns and any(self.owned(frame) for frame in found):
                self._peer = address
            frames += found
        self.frames_in += len(frames)
        return frames

    def owned(self, frame: Frame) -> bool:
        """Whether a frame names one of the link's owners as its sender."""
        return self._owners is None or frame.sysid in self._owners

    def write(self, data: bytes) -> bool:
        """Send one frame; False if that could not be done now."""
        if self._peer is None:
            return False
        try:
            self._socket.sendto(data, self._peer)
        except OSError:
            self.errors += 1
            return False
        self.frames_out += 1
        return True

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
