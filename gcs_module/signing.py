# SPDX-License-Identifier: GPL-3.0-or-later

"""The station's key on MAVProxy's links to the vehicle.

Outgoing frames are signed. Incoming unsigned frames are refused, except those of a telemetry radio.
MAVProxy signs and checks. This module gives it the key, and does what MAVProxy does not. Rules that live here:

1. Each link has its own link id, from 1 up, the lowest free one first; a reload does not use ids up. 0 cannot be used:
   pymavlink replaces it by the other end's id.
2. Time stamps rise with every frame, also across a reload of this module, and keep pace with time on an idle link. They
   follow the newest stamp that the vehicle has proven. All links share one clock.
3. pymavlink's own check stores a frame's stamp before it verifies the hash. So one forged frame with a far future stamp
   would block the vehicle's frames here. The check is replaced by that of `wire.signing`, one for all links: a frame
   that was received by one link cannot be replayed on another. A vehicle sends copies of a frame on several
   links. One copy is accepted on each link, if it comes at most OVERTAKEN_S after the first one: MAVProxy judges its
   links by them. Each link has its own sequence numbers. So copies are recognized by their stamp, which no other frame
   of the vehicle has.
4. MAVProxy checks no signature of messages that it does not know, ours among them: `check` does.
5. Only a telemetry radio may send unsigned frames (RADIO, RADIO_STATUS).
6. `release` restores what MAVProxy's own `signing` had set up before.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.tools.clocks import Clocks
from mavproxy_handover.wire.frames import SIGNATURE_BYTES, Frame, parse_one
from mavproxy_handover.wire.signing import OVERTAKEN_S, SignatureVerdict, SigningClock, Verifier, fingerprint

__all__ = ["LinkSigning"]

_RADIO: Final = (mavlink.MAVLINK_MSG_ID_RADIO, mavlink.MAVLINK_MSG_ID_RADIO_STATUS)
_MAX_LINK_ID: Final = 255
#: bytes of the hash, at the end of a signature
_HASH_BYTES: Final = 6
#: latest frames of our own messages, whose copies by another link are recognized
_COPIES: Final = 64
#: frames whose copies may still come by another link: two seconds of 250 a second
_REMEMBERED: Final = 512
#: components of the vehicle; only holders of the key count
_STREAMS: Final = 64
#: fields of pymavlink's MAVLinkSigning that are set here and restored
_KEPT: Final = ("secret_key", "sign_outgoing", "allow_unsigned_callback", "link_id", "timestamp")


@dataclass(slots=True)
class _KeptStamps:
    """The stamps of one key that must survive a reload of this module."""

    sent: int = 0  #: newest stamp that was sent
    proven: int = 0  #: newest proven stamp of the vehicle


#: fingerprint of a key -> its stamps in this process
_stamps_by_key: dict[str, _KeptStamps] = {}


@dataclass(slots=True)
class _Link:
    master: Any
    mav: Any
    link_id: int
    kept: dict[str, Any]


@dataclass(slots=True)
class _Heard:
    """A genuine frame: when it first arrived, and the ids of the links that it came by."""

    at: float
    links: set[int]


class LinkSigning:
    """One station's key on all links to the vehicle."""

    def __init__(self, key: bytes, clocks: Clocks) -> None:
        """Raises ValueError for no key."""
        self._key = key
        self._clocks = clocks
        self._kept_stamps = _stamps_by_key.setdefault(fingerprint(key), _KeptStamps())
        self._stamps = SigningClock()
        self._stamps.follow(self._kept_stamps.sent)
        self._links: list[_Link] = []
        #: checks the frames that MAVProxy decodes, and those of our own messages (`check`)
        self._theirs, self._ours = self._verifier(), self._verifier()
        #: frames that arrived, by `_frame_id`
        self._heard: OrderedDict[bytes, _Heard] = OrderedDict()
        self._seen: deque[bytes] = deque(maxlen=_COPIES)

    def sign(self, masters: Sequence[Any], proven: Callable[[Any], None]) -> None:
        """Sign every link. Links are added and removed, so this is to be called once a second.

        `proven` is called with the link by which a frame of the vehicle arrives, as soon as it is checked."""
        for link in list(self._links):
            if all(link.master is not master for master in masters):
                self._keep_stamp(link)
                self._links.remove(link)
        for master in masters:
            link = self._link_of(master)
            link.mav = master.mav  # pymavlink makes another object when it switches to MAVLink 2
            self._set_up(link, proven)

    def _link_of(self, master: Any) -> _Link:
        for link in self._links:
            if link.master is master:
                return link
        kept = {name: getattr(master.mav.signing, name) for name in _KEPT}
        link = _Link(master, master.mav, self._free_id(), kept)
        self._links.append(link)
        return link

    def check(self, frame: Frame) -> SignatureVerdict | None:
        """The verdict on a frame that MAVProxy has not checked. None: a copy of one that came by another link."""
        verdict = self._ours.check(frame, self._clocks.utc(), self._clocks.monotonic())
        if verdict is SignatureVerdict.OK:
            self._seen.append(_frame_id(frame))
        elif verdict is SignatureVerdict.REPLAYED and _frame_id(frame) in self._seen:
            return None
        return verdict

    def release(self) -> None:
        """Restore the links."""
        self._kept_stamps.proven = max(self._kept_stamps.proven, self._ours.newest, self._theirs.newest)
        for link in self._links:
            self._keep_stamp(link)
            link.mav.__dict__.pop("check_signature", None)
            signing = link.mav.signing
            if signing.secret_key == self._key:
                newest = signing.timestamp
                for name, value in link.kept.items():
                    setattr(signing, name, value)
                if signing.secret_key is not None:
                    signing.timestamp = max(signing.timestamp, newest)
        self._links.clear()

    def _set_up(self, link: _Link, proven: Callable[[Any], None]) -> None:
        signing = link.mav.signing
        now_s = self._clocks.monotonic()
        if signing.secret_key == self._key:
            self._stamps.follow(signing.timestamp, now_s)
        stamp = self._stamps.next(self._clocks.utc(), now_s)
        if stamp is not None:
            signing.timestamp = stamp
            self._kept_stamps.sent = stamp
        signing.secret_key = self._key
        signing.sign_outgoing = True
        signing.link_id = link.link_id
        signing.allow_unsigned_callback = _radio_only
        link.mav.check_signature = partial(self._accept, link, proven)

    def _accept(self, link: _Link, proven: Callable[[Any], None], raw: bytes, _sysid: int, _compid: int) -> bool:
        """In place of pymavlink's check: a signed frame whose CRC is right."""
        frame = parse_one(bytes(raw))
        if frame is None:
            return False
        now_s = self._clocks.monotonic()
        verdict = self._theirs.check(frame, self._clocks.utc(), now_s)
        if verdict is SignatureVerdict.OK:
            self._remember_frame(link, frame, now_s)
        elif verdict is not SignatureVerdict.REPLAYED or not self._is_copy(link, frame, now_s):
            return False
        link.mav.signing.timestamp = max(link.mav.signing.timestamp, self._theirs.newest)
        proven(link.master)
        return True

    def _remember_frame(self, link: _Link, frame: Frame, now_s: float) -> None:
        if len(self._links) > 1:
            self._heard[_frame_id(frame)] = _Heard(now_s, {link.link_id})
            if len(self._heard) > _REMEMBERED:
                self._heard.popitem(last=False)

    def _is_copy(self, link: _Link, frame: Frame, now_s: float) -> bool:
        """Whether a known frame comes by this link for the first time, and soon enough."""
        heard = self._heard.get(_frame_id(frame))
        if heard is None or link.link_id in heard.links or now_s - heard.at > OVERTAKEN_S:
            return False
        heard.links.add(link.link_id)
        return True

    def _verifier(self) -> Verifier:
        verifier = Verifier(self._key, clock=self._stamps, max_streams=_STREAMS)
        verifier.floor = self._kept_stamps.proven
        return verifier

    def _free_id(self) -> int:
        taken = {link.link_id for link in self._links}
        return next((number for number in range(1, _MAX_LINK_ID) if number not in taken), _MAX_LINK_ID)

    def _keep_stamp(self, link: _Link) -> None:
        if link.mav.signing.secret_key == self._key:
            self._stamps.follow(link.mav.signing.timestamp, self._clocks.monotonic())
            self._kept_stamps.sent = max(self._kept_stamps.sent, link.mav.signing.timestamp)


def _frame_id(frame: Frame) -> bytes:
    """What the copies of a signed frame have in common: its sender, the sender's link id and the stamp."""
    return bytes((frame.sysid, frame.compid)) + frame.raw[-SIGNATURE_BYTES:-_HASH_BYTES]


def _radio_only(_mav: Any, msgid: int) -> bool:
    """Unsigned frames that are accepted: those that a telemetry radio inserts into the stream."""
    return msgid in _RADIO
