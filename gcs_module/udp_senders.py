# SPDX-License-Identifier: GPL-3.0-or-later

"""Limits which senders MAVProxy's listening UDP links read and answer: the vehicle, whatever else sends to the port.

pymavlink's `udpin` stores the address of every sender and writes a copy of everything to each. It feeds the datagrams
of all of them to one parser. So a stranger with 250,000 ports makes a station only write copies, and three bytes from a
stranger delay the vehicle's next frames. MAVProxy's `--udp-timeout` applies to its outputs only. Here each such link
gets our `recv`; the rest stays pymavlink's. Rules that live here:

1. The station writes to addresses that sent a frame of the vehicle: one that the station's key proves; without a key,
   one with the vehicle's system id and a right CRC. There may be several, as the vehicle may have several modems, but
   at most MOST_SENDERS. An address that was silent for KEPT_S is forgotten, except the last one.
2. An address that was heard within PEER_HOLD_S is not replaced by a new one.
3. Without a key, while the vehicle is not heard on a link, the station writes to one address that sent a whole frame: a
   MAVProxy that talks with another program there continues to do so.
4. From other addresses only whole frames reach MAVProxy's parser, with a key only signed ones, so no bytes of a
   stranger wait in it. Waiting bytes, the beginning of a frame, may carry the vehicle's address without being its own.
   They are dropped when a datagram of whole frames comes from that address, and after PATIENCE_S.
5. One `recv` examines a limited number of datagrams from strangers, at most half of them from one host. After an empty
   result MAVProxy sleeps for 0.1 s, so a stranger could stop the station: if nothing was useful, `recv` returns an
   object that counts as data and holds no bytes.
"""

from __future__ import annotations

import errno
import traceback
from collections.abc import Callable, Sequence
from functools import partial
from math import inf
from typing import Any, Final

from pymavlink import mavutil

from mavproxy_handover.link.base import PEER_HOLD_S
from mavproxy_handover.wire.frames import PATIENCE_S, Frame, FrameSplitter, parse_one

__all__ = ["MOST_SENDERS", "KEPT_S", "UdpSenders"]

MOST_SENDERS: Final = 4
KEPT_S: Final = 10.0

#: datagrams read in one `recv`; of these, strangers' that are examined; and of these, from one host
_TAKEN: Final = 256
_LOOKED_AT: Final = 16
_OF_HOST: Final = 8
#: longer datagrams of strangers are not examined: one full of frame starts costs much time
_LOOKED_AT_BYTES: Final = 2048
_NOT_NOW: Final = (errno.EAGAIN, errno.EWOULDBLOCK, errno.ECONNREFUSED)

Address = tuple[str, int]


class _Nothing(bytes):
    """No bytes, of the length 1 (rule 5)."""

    def __len__(self) -> int:
        return 1

    def __getitem__(self, _place: Any) -> Any:
        return 0


_NOTHING: Final = _Nothing()


class _Link:
    """One listening UDP link of MAVProxy's."""

    def __init__(self, master: Any) -> None:
        self.master = master
        #: addresses that sent frames of the vehicle -> time of the last one
        self.vehicle: dict[Address, float] = {}
        #: the address that sent whole frames while no frame of the vehicle came
        self.other: tuple[Address, float] | None = None
        #: the sender of the bytes that the parser got last, and when
        self.sender: Address | None = None
        self.at = -inf
        #: frames of the vehicle so far
        self.frames = 0


class UdpSenders:
    """One station's links. `vehicle`: its system id; `keyed`: whether `proven` tells which frames are the vehicle's."""

    def __init__(
        self, vehicle: int, keyed: bool, clock: Callable[[], float], fault: Callable[[str, str], None]
    ) -> None:
        self._vehicle = vehicle
        self._keyed = keyed
        self._clock = clock
        self._fault = fault
        self._links: list[_Link] = []

    def watch(self, masters: Sequence[Any]) -> None:
        """Handle every listening UDP link. Links are added and removed, so this is to be called once a second."""
        self._links = [link for link in self._links if any(link.master is master for master in masters)]
        now = self._clock()
        for master in masters:
            if isinstance(master, mavutil.mavudp) and master.udp_server:
                self._forget_silent(self._link_of(master), now)

    def received(self, master: Any) -> int:
        """The frames that came by a link since it began; on listening links only the vehicle's."""
        for link in self._links:
            if link.master is master:
                return link.frames
        return int(master.mav.total_packets_received)

    def proven(self, master: Any) -> None:
        """The bytes that a link's parser got last contained a frame that the key proves to be the vehicle's."""
        for link in self._links:
            if link.master is master and link.sender is not None:
                link.frames += 1
                self._on_vehicle_frame(link, link.sender, self._clock())

    def release(self) -> None:
        """Restore the links; their present addresses stay."""
        for link in self._links:
            link.master.__dict__.pop("recv", None)
        self._links.clear()

    def _link_of(self, master: Any) -> _Link:
        for link in self._links:
            if link.master is master:
                return link
        link = _Link(master)
        self._links.append(link)
        self._write_to(link)
        master.recv = partial(self._receive, link)
        return link

    # ---- in -------------------------------------------------------------------------------------------------------

    def _receive(self, link: _Link, _count: int | None = None) -> bytes:
        """In place of pymavlink's `recv`: the bytes for the parser. Raises OSError as that does."""
        looked_at: dict[str, int] = {}
        for _ in range(_TAKEN):
            try:
                data, address = link.master.port.recvfrom(mavutil.UDP_MAX_PACKET_LEN)
            except OSError as error:
                if error.errno in _NOT_NOW:
                    break
                raise
            known = address in link.master.clients
            if not known:
                count = looked_at.get(address[0], 0)
                if len(data) > _LOOKED_AT_BYTES or count == _OF_HOST or sum(looked_at.values()) == _LOOKED_AT:
                    continue
                looked_at[address[0]] = count + 1
            try:
                taken = self._for_parser(link, data, address, known)
            except Exception:
                self._fault("UDP senders", traceback.format_exc(limit=-3))
                taken = data  # a fault of this limit must not make the station deaf: the signature is checked later
            if taken:
                link.sender, link.at = address, self._clock()
                return taken
        return _NOTHING

    def _for_parser(self, link: _Link, data: bytes, address: Address, known: bool) -> bytes:
        """The part of a datagram that the parser gets."""
        mav = link.master.mav
        if known and self._keyed and not mav.buf_len():  # the usual case
            return data
        frames = _frames(data)
        whole = b"".join(frame.raw for frame in frames)
        if not self._keyed and frames:
            self._note_sender(link, frames, address)
        if not known:
            data = b"".join(frame.raw for frame in frames if frame.signed) if self._keyed else whole
        late = self._clock() - link.at >= PATIENCE_S
        if data and mav.buf_len() and (late or (known and len(whole) == len(data))):
            mav.buf, mav.buf_index = bytearray(), 0
        return data

    def _note_sender(self, link: _Link, frames: list[Frame], address: Address) -> None:
        """Without a key: note the sender of these frames."""
        now = self._clock()
        of_vehicle = sum(frame.sysid == self._vehicle and frame.known for frame in frames)
        if of_vehicle:
            link.frames += of_vehicle
            self._on_vehicle_frame(link, address, now)
        elif not link.vehicle and address[1] and _may_follow(link.other, address, now):
            link.other = (address, now)
            self._write_to(link)

    # ---- out ------------------------------------------------------------------------------------------------------

    def _on_vehicle_frame(self, link: _Link, address: Address, now: float) -> None:
        """The vehicle sends from this address."""
        if not address[1]:  # port 0 cannot be written to, and an error ends pymavlink's loop over its addresses
            return
        if address not in link.vehicle and len(link.vehicle) >= MOST_SENDERS:
            oldest = min(link.vehicle, key=lambda one: link.vehicle[one])
            if now - link.vehicle[oldest] <= PEER_HOLD_S:
                return
            del link.vehicle[oldest]
        newcomer = address not in link.vehicle
        link.vehicle[address] = now
        if newcomer:
            link.other = None
            self._write_to(link)

    def _forget_silent(self, link: _Link, now: float) -> None:
        newest = max(link.vehicle.values(), default=now)
        kept = {address: at for address, at in link.vehicle.items() if now - at <= KEPT_S or at == newest}
        if len(kept) != len(link.vehicle):
            link.vehicle = kept
            self._write_to(link)

    def _write_to(self, link: _Link) -> None:
        addresses = set(link.vehicle) or ({link.other[0]} if link.other is not None else set())
        link.master.clients = addresses
        # if `link add` has set a time-out, pymavlink checks when it heard each address; this module does that instead
        link.master.clients_last_alive = dict.fromkeys(addresses, inf)


def _may_follow(before: tuple[Address, float] | None, address: Address, now: float) -> bool:
    """Whether an address may be replaced by this one."""
    return before is None or before[0] == address or now - before[1] > PEER_HOLD_S


def _frames(data: bytes) -> list[Frame]:
    """The whole frames in a datagram; one of an unknown message only if it is the whole datagram."""
    frame = parse_one(data)
    return FrameSplitter().feed(data) if frame is None else [frame]
