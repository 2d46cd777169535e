# SPDX-License-Identifier: GPL-3.0-or-later

"""UDP links.

`udpout` sends to one address and hears only that address. This works with address translation on either side: a
station's answer comes from the address that was written to, or it would not get through. A station that answers from
another address or socket than the one it listens on is not heard; use `udpin` for it. The socket is not connected, so
each datagram chooses its way out: a modem that returns with another address of our own needs no reconnect. On Linux the
kernel drops datagrams of other senders, before they cost anything here. Datagrams are then read without their sender's
address, because converting it takes longer than judging the frame. With `@WAY` datagrams leave only by that interface
or from that address. While it does not exist nothing is sent, and each frame looks for it again. A modem that returns
is another interface of the same name.

`udpin` listens. Any host can send to it, so:

* the peer, which gets the downlink, is the address whose frame was last called genuine (`accept_sender`). A peer that
  was heard within PEER_HOLD_S is not replaced;
* a datagram of the peer that is not made of complete frames goes through a lasting splitter, as some bridges cut frames
  anywhere. Datagrams of other senders are parsed one by one, and only if they begin with a frame, so that nothing is
  kept for unknown senders;
* a datagram made of complete frames is taken as it is, whatever waits in that splitter. So a forged frame start from
  the peer's address does not delay the peer's next frames until the end of a frame that never comes;
* only a limited number of other senders' datagrams is parsed in one `read`, at most half of them from one host; the
  rest is dropped unread. So the peer's datagrams do not wait, and a new station is heard although another host floods
  the link.

Datagrams of more than 2 KiB are dropped: no station sends them, and a long one made of frame starts costs much time.

Frames of a download share datagrams of at most `GATHERED_BYTES`. Reading costs a program per datagram, and its socket
holds far fewer small ones. The limit is 512 bytes, because gomavlib (mavp2p) reads no more of a datagram;
mavlink-router reads 1,120.

A flood fills the socket's buffer, and the system then drops the station's datagrams too. Linux counts dropped
datagrams, but also those that the filter of `udpout` rejects. So a drop counts as overflow only if the buffer is at
least half full. The device checks after every _LOOK datagrams, so that a full buffer is never emptied without a check.
"""

from __future__ import annotations

import ctypes
import ipaddress
import socket
import struct
import sys
import time
from typing import Final

from mavproxy_handover.link.base import PEER_HOLD_S, Clock, Device, reason
from mavproxy_handover.link.forms import DeviceSpec, Kind, LinkError
from mavproxy_handover.link.names import Address, endpoint, hear_both_kinds, host_of
from mavproxy_handover.wire.frames import MAGIC_V1, MAGIC_V2, Frame, FrameSplitter, parse_one

__all__ = ["GATHERED_BYTES", "UdpIn", "UdpOut", "UdpOutBy"]

GATHERED_BYTES: Final = 512

_DATAGRAM_BYTES: Final = 2048
#: datagrams read in one `read`
_TAKEN: Final = 256
#: of these, datagrams parsed: the peer's, and those of all other senders
_PEER_DATAGRAMS: Final = 64
_STRANGER_DATAGRAMS: Final = 32
_STRANGER_BYTES: Final = 8192
#: most bytes parsed of one host, with a short datagram counted as the length below. It is enough for all that the
#: stations of one host send on a ground link at once, a mission package included
_HOST_BYTES: Final = 4096
_SHORT_BYTES: Final = 256
_RECEIVE_BUFFER_BYTES: Final = 1 << 20
#: datagrams read between two checks of the buffer: far fewer than half of it holds
_LOOK: Final = 16

#: missing in Python's `socket`; equal on all common Linux machines (asm-generic/socket.h, linux/in.h)
_SO_ATTACH_FILTER: Final = 26
_SO_MEMINFO: Final = 55
#: its numbers (linux/sock_diag.h): bytes that wait, the most that may wait, and datagrams dropped so far
_MEMINFO: Final = struct.Struct("9I")
_RMEM_ALLOC, _RCVBUF, _DROPS = 0, 1, 8
_UNICAST_IF: Final = {socket.AF_INET: (socket.IPPROTO_IP, 50), socket.AF_INET6: (socket.IPPROTO_IPV6, 76)}
#: classic BPF (linux/filter.h): load 32 or 16 bits, go on if equal, return. A socket's filter sees a datagram from its
#: UDP header on, and the IP header from SKF_NET_OFF on.
_LOAD_32, _LOAD_16, _IF_EQUAL, _RETURN = 0x20, 0x28, 0x15, 0x06
_IP_HEADER: Final = -0x100000
_SOURCE_IN_HEADER: Final = {socket.AF_INET: 12, socket.AF_INET6: 8}
_UDP_SOURCE: Final = 0
_ALL, _NOTHING = 0xFFFFFFFF, 0


class _Udp(Device):
    settled = True

    def __init__(self, spec: DeviceSpec, clock: Clock) -> None:
        super().__init__(spec.text, clock)
        self._peer: Address | None = None
        #: only the peer's datagrams reach the socket
        self._peer_alone = False
        self._splitter = FrameSplitter()  #: for a peer whose datagrams are not made of complete frames
        family, self._address = endpoint(spec)
        try:
            self._socket = socket.socket(family, socket.SOCK_DGRAM)
        except OSError as error:
            raise LinkError(f"link {spec.text} cannot be opened: {reason(error)}") from None
        self._socket.setblocking(False)
        # the system limits this; a burst must fit in while one round of the main loop is slow
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER_BYTES)
        #: frames that wait to share a datagram, and their number
        self._gathered, self._gathered_frames = b"", 0
        #: datagrams until the next check of the buffer, and drops counted at the last check
        self._look_in = _LOOK
        self._dropped = 0

    @property
    def open(self) -> bool:
        return not self._closed and self._peer is not None

    def _peer_frames(self, data: bytes) -> list[Frame]:
        """Parse a datagram of the peer."""
        frame = parse_one(data)  # the usual case, with half the work
        if frame is not None and frame.known:
            if self._splitter.waiting:
                self._splitter = FrameSplitter()
            self.counters.bytes_in += len(data)
            self.counters.frames_in += 1
            return [frame]
        alone = FrameSplitter()
        frames = alone.feed(data)
        if sum(len(frame.raw) for frame in frames) == len(data):
            self._splitter = alone
            self.counters.bytes_in += len(data)
            self.counters.frames_in += len(frames)
            return frames
        return self._split(self._splitter, data, self._clock())

    def _late_frames(self) -> list[Frame]:
        """Frames of the peer after a frame that never ended; for a read without new data."""
        return self._split(self._splitter, b"", self._clock()) if self._splitter.waiting else []

    @property
    def unfinished(self) -> bool:
        return self._splitter.waiting > 0

    def fileno(self) -> int:
        return self._socket.fileno()

    def _shut(self) -> None:
        self._socket.close()

    def _count_dropped(self) -> None:
        """Count what the system dropped because the buffer was full."""
        self._look_in = _LOOK
        try:
            told = _MEMINFO.unpack(self._socket.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, _MEMINFO.size))
        except (OSError, struct.error):  # other systems do not report it
            return
        dropped, self._dropped = (told[_DROPS] - self._dropped) & 0xFFFFFFFF, told[_DROPS]
        if 2 * told[_RMEM_ALLOC] >= told[_RCVBUF]:
            self.counters.overflowed += dropped

    def _receive(self) -> tuple[bytes, Address] | None:
        """The next datagram; None if there is none. One that is too long is returned as empty."""
        self._look_in -= 1
        if not self._look_in:
            self._count_dropped()
        try:
            data, address = self._socket.recvfrom(_DATAGRAM_BYTES + 1)
        except OSError as error:
            self._not_received(error)
            return None
        if len(data) > _DATAGRAM_BYTES:
            self.counters.oversize += 1
            return b"", address
        return data, address

    def _not_received(self, error: OSError) -> None:
        if not self._closed and not isinstance(error, (BlockingIOError, InterruptedError)):
            self._failed(error)

    @property
    def flow_controlled(self) -> bool:
        return False

    def write_more(self, data: bytes) -> bool:
        if self._peer is None or self._closed:
            return False
        if len(self._gathered) + len(data) > GATHERED_BYTES:
            self.flush()
        self._gathered += data
        self._gathered_frames += 1
        return True

    def flush(self) -> None:
        if self._gathered:
            data, frames = self._gathered, self._gathered_frames
            self._gathered, self._gathered_frames = b"", 0
            self._send(data, frames)

    def write(self, data: bytes) -> bool:
        self.flush()
        return self._send(data)

    def _send(self, data: bytes, frames: int = 1) -> bool:
        """Send a datagram that holds `frames` frames."""
        if self._peer is None or self._closed:
            return self._refused(frames)
        try:
            self._socket.sendto(data, self._peer)
        except (BlockingIOError, InterruptedError):
            return self._refused(frames)
        except OSError as error:  # no route, the interface is down
            self._failed(error)
            return self._refused(frames)
        self.trouble = ""
        return self._sent(data, frames)


class UdpOut(_Udp):
    """Sends to `HOST:PORT` and hears only this address."""

    def __init__(self, spec: DeviceSpec, clock: Clock = time.monotonic) -> None:
        """Raises LinkError: unknown host."""
        assert spec.kind is Kind.UDP_OUT
        super().__init__(spec, clock)
        self._peer = self._address
        self._peer_alone = _hear_only(self._socket, self._address)  # set before any datagram can have arrived

    def read(self, once: bool = False) -> list[Frame]:
        if once and self._peer_alone:  # nearly every read: skip what only the other cases need
            self._look_in -= 1
            if not self._look_in:
                self._count_dropped()
            try:
                data = self._socket.recv(_DATAGRAM_BYTES + 1)
            except OSError as error:
                self._not_received(error)
                return self._late_frames()
            if len(data) > _DATAGRAM_BYTES:
                self.counters.oversize += 1
                data = b""
            return self._peer_frames(data)
        frames: list[Frame] = []
        looked_at = 0
        for _ in range(_TAKEN):
            received = self._receive()
            if received is None:
                break
            data, address = received
            if address != self._peer:
                self.counters.strangers += 1
                continue
            frames += self._peer_frames(data)
            looked_at += 1
            if once or looked_at == _PEER_DATAGRAMS:
                return frames
        return frames + self._late_frames()


class UdpOutBy(UdpOut):
    """A `UdpOut` that sends by one interface, or from one address."""

    def __init__(self, spec: DeviceSpec, clock: Clock = time.monotonic) -> None:
        """Raises LinkError for an unknown host. An interface that is missing now is no error."""
        super().__init__(spec, clock)
        self._way, self._by_name = spec.way, not _is_address(spec.way)
        #: the interface must be found before anything is sent
        self._lost = True

    def _send(self, data: bytes, frames: int = 1) -> bool:
        if self._lost and not self._closed and not self._bind_way():
            return self._refused(frames)
        sent = super()._send(data, frames)
        self._lost = not sent and self._by_name and self.trouble != ""
        return sent

    def _bind_way(self) -> bool:
        try:
            if self._by_name:  # internally by number, which may be changed at any time and needs no rights
                number = socket.if_nametoindex(self._way)
                level, option = _UNICAST_IF[self._socket.family]
                self._socket.setsockopt(level, option, struct.pack("!I", number))
            else:
                self._socket.bind((self._way, 0))
        except OSError as error:
            self._failed(error)
            return False
        return True


class UdpIn(_Udp):
    """Listens on `HOST:PORT` and answers the sender that proved genuine."""

    def __init__(self, spec: DeviceSpec, clock: Clock = time.monotonic) -> None:
        """Raises LinkError: port in use, not an address of this machine."""
        assert spec.kind is Kind.UDP_IN
        super().__init__(spec, clock)
        self._heard_at = 0.0
        #: senders of the frames of the last read, by identity of the frame: two senders may send equal frames
        self._senders: dict[int, Address] = {}
        self._last: list[Frame] = []
        try:
            hear_both_kinds(self._socket)
            self._socket.bind(self._address)
        except OSError as error:
            self._socket.close()
            raise LinkError(f"link {spec.text} cannot be opened: {reason(error)}") from None

    def read(self, once: bool = False) -> list[Frame]:
        frames: list[Frame] = []
        senders: dict[int, Address] = {}
        peers = strangers = stranger_bytes = 0
        hosts: dict[str, int] = {}
        for _ in range(_TAKEN):
            received = self._receive()
            if received is None:
                break
            data, address = received
            if address == self._peer:
                found = self._peer_frames(data)
                peers += 1
            elif (
                strangers < _STRANGER_DATAGRAMS
                and stranger_bytes < _STRANGER_BYTES
                and hosts.get(host_of(address[0]), 0) < _HOST_BYTES
                and _begins_with_frame(data)
            ):
                found = self._split(FrameSplitter(), data)
                strangers += 1
                stranger_bytes += len(data)
                host = host_of(address[0])
                hosts[host] = hosts.get(host, 0) + max(len(data), _SHORT_BYTES)
            else:
                self.counters.strangers += 1
                continue
            for frame in found:
                senders[id(frame)] = address
            frames += found
            if peers and (once or peers == _PEER_DATAGRAMS):
                break
        if self._peer is not None and not peers:
            found = self._late_frames()
            for frame in found:
                senders[id(frame)] = self._peer
            frames += found
        self._senders, self._last = senders, list(frames)
        return frames

    def accept_sender(self, frame: Frame) -> bool:
        address = self._senders.get(id(frame))
        if address is None:
            return False
        now = self._clock()
        if address != self._peer:
            if self._peer is not None and now - self._heard_at <= PEER_HOLD_S:
                return False
            self._peer = address
            self._splitter = FrameSplitter()
        self._heard_at = now
        return True

    def reply(self, frame: Frame, data: bytes) -> None:
        address = self._senders.get(id(frame))
        if address is None or self._closed:
            return
        try:
            self._socket.sendto(data, address)
        except OSError:  # a bad address of an unknown sender is no fault of the link
            self.counters.refused_out += 1


def _is_address(way: str) -> bool:
    try:
        ipaddress.IPv4Address(way)
    except ValueError:
        return False
    return True


def _hear_only(udp: socket.socket, address: Address) -> bool:
    """Let the kernel drop datagrams from any other address; False if it cannot."""
    if sys.platform != "linux" or any(address[3:]):  # a link-local address belongs to another host on another interface
        return False
    host = socket.inet_pton(udp.family, address[0])
    source = _IP_HEADER + _SOURCE_IN_HEADER[udp.family]
    words = range(0, len(host), 4)
    program = (  # operation, instructions to skip if equal and if not equal, operand
        *(
            line
            for at in words
            for line in (
                (_LOAD_32, 0, 0, (source + at) & _ALL),
                (_IF_EQUAL, 0, 2 * (len(words) - 1 - at // 4) + 3, int.from_bytes(host[at : at + 4], "big")),
            )
        ),
        (_LOAD_16, 0, 0, _UDP_SOURCE),
        (_IF_EQUAL, 0, 1, address[1]),
        (_RETURN, 0, 0, _ALL),
        (_RETURN, 0, 0, _NOTHING),
    )
    code = ctypes.create_string_buffer(b"".join(struct.pack("HBBI", *line) for line in program))
    try:
        udp.setsockopt(socket.SOL_SOCKET, _SO_ATTACH_FILTER, struct.pack("HP", len(program), ctypes.addressof(code)))
        # some systems like Linux accept it and do nothing; the returned size is a number of instructions
        found = udp.getsockopt(socket.SOL_SOCKET, _SO_ATTACH_FILTER, len(code))
    except OSError:
        return False
    return found == code.raw[: len(program)]


def _begins_with_frame(data: bytes) -> bool:
    return len(data) > 0 and data[0] in (MAGIC_V1, MAGIC_V2)
