# SPDX-License-Identifier: GPL-3.0-or-later

"""Whom MAVProxy's listening UDP links answer, and whom they hear: the vehicle, whoever else sends.

pymavlink's `udpin` remembers everybody who ever sent it a byte, writes a copy of everything to each, and puts what all
of them send through one parser. So a stranger with 250,000 ports makes a station do nothing but write copies, and three
bytes of his hold up the vehicle's next frames. MAVProxy's `--udp-timeout` is for its outputs alone. Here each such link
gets a `recv` of ours; all the rest is pymavlink's. Rules that live here:

1. Written to is who sent a frame of the vehicle: one that the station's key proves; without a key, one with the
   vehicle's system id and a right CRC. That may be several, as the vehicle may have several modems, but no more than
   MOST_SENDERS. One that was silent for KEPT_S is forgotten, but for the last.
2. One who was heard within PEER_HOLD_S does not have to go for a newcomer.
3. Without a key, while the vehicle is not heard on a link, whoever sent a whole frame is written to, one at a time: a
   MAVProxy that talks with something else there goes on doing so.
4. Of those who are not written to, only whole frames get to MAVProxy's parser, signed ones where there is a key, so
   nothing of a stranger waits in it. What waits there, the beginning of a frame, sent perhaps in the name of the
   vehicle's address, is thrown away when a datagram of whole frames comes from there, and after PATIENCE_S.
5. Of strangers' datagrams only so many are looked at in one `recv`, half of them of one host at most. After an empty
   one MAVProxy sleeps for 0.1 s, so a stranger could stop the station: what comes back when nothing was worth it counts
   as something, and holds nothing.
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

#: datagrams taken off a socket in one `recv`; of these, strangers' that are looked at; and of these, of one host
_TAKEN: Final = 256
_LOOKED_AT: Final = 16
_OF_HOST: Final = 8
#: longer ones of strangers are not looked at: one made of frame starts costs much
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
        #: who sent frames of the vehicle -> when the last one came
        self.vehicle: dict[Address, float] = {}
        #: who sent whole frames, while nobody sent the vehicle's
        self.other: tuple[Address, float] | None = None
        #: who sent what the parser got last, and when
        self.sender: Address | None = None
        self.at = -inf
        #: frames of the vehicle so far
        self.frames = 0


class UdpSenders:
    """One station's. `vehicle`: its system id; `keyed`: whether `proven` says who is the vehicle."""

    def __init__(
        self, vehicle: int, keyed: bool, clock: Callable[[], float], fault: Callable[[str, str], None]
    ) -> None:
        self._vehicle = vehicle
        self._keyed = keyed
        self._clock = clock
        self._fault = fault
        self._links: list[_Link] = []

    def watch(self, masters: Sequence[Any]) -> None:
        """See to every listening UDP link; links come and go, so this is to be called once a second."""
        self._links = [link for link in self._links if any(link.master is master for master in masters)]
        now = self._clock()
        for master in masters:
            if isinstance(master, mavutil.mavudp) and master.udp_server:
                self._forget_silent(self._link_of(master), now)

    def received(self, master: Any) -> int:
        """How many frames came by a link since it began: by those that anybody can send to, of the vehicle alone."""
        for link in self._links:
            if link.master is master:
                return link.frames
        return int(master.mav.total_packets_received)

    def proven(self, master: Any) -> None:
        """What the parser of a link got last held a frame that the key proves to be the vehicle's."""
        for link in self._links:
            if link.master is master and link.sender is not None:
                link.frames += 1
                self._heard(link, link.sender, self._clock())

    def release(self) -> None:
        """Give the links back as they were; those that are written to now stay so."""
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
        """In the place of pymavlink's `recv`: what the parser is to get next. OSError as from there."""
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
                taken = self._taken(link, data, address, known)
            except Exception:
                self._fault("callers", traceback.format_exc(limit=-3))
                taken = data
            if taken:
                link.sender, link.at = address, self._clock()
                return taken
        return _NOTHING

    def _taken(self, link: _Link, data: bytes, address: Address, known: bool) -> bytes:
        """What of a datagram the parser gets."""
        mav = link.master.mav
        if known and self._keyed and not mav.buf_len():  # nearly always so
            return data
        frames = _frames(data)
        whole = b"".join(frame.raw for frame in frames)
        if not self._keyed and frames:
            self._judge(link, frames, address)
        if not known:
            data = b"".join(frame.raw for frame in frames if frame.signed) if self._keyed else whole
        late = self._clock() - link.at >= PATIENCE_S
        if data and mav.buf_len() and (late or (known and len(whole) == len(data))):
            mav.buf, mav.buf_index = bytearray(), 0
        return data

    def _judge(self, link: _Link, frames: list[Frame], address: Address) -> None:
        """Without a key."""
        now = self._clock()
        of_vehicle = sum(frame.sysid == self._vehicle and frame.known for frame in frames)
        if of_vehicle:
            link.frames += of_vehicle
            self._heard(link, address, now)
        elif not link.vehicle and address[1] and _may_follow(link.other, address, now):
            link.other = (address, now)
            self._write_to(link)

    # ---- out ------------------------------------------------------------------------------------------------------

    def _heard(self, link: _Link, address: Address, now: float) -> None:
        """The vehicle speaks from there."""
        if not address[1]:  # nobody can be written to at port 0, and an error ends pymavlink's round of writing
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
        # where `link add` has set a time-out, pymavlink looks at when it heard each; that is seen to here
        link.master.clients_last_alive = dict.fromkeys(addresses, inf)


def _may_follow(before: tuple[Address, float] | None, address: Address, now: float) -> bool:
    """Whether somebody may be written to in the place of another."""
    return before is None or before[0] == address or now - before[1] > PEER_HOLD_S


def _frames(data: bytes) -> list[Frame]:
    """The whole frames in a datagram; one of an unknown message only if it is all there is."""
    frame = parse_one(data)
    return FrameSplitter().feed(data) if frame is None else [frame]
