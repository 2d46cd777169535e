# SPDX-License-Identifier: GPL-3.0-or-later

"""MAVLink 2 signatures: they prove the sender of a frame, and that the frame is not replayed.

A signature is 13 bytes after the CRC: link id, 48-bit stamp (10 us since 2015-01-01), and the first 6 bytes of the
SHA-256 of key and frame (https://mavlink.io/en/guide/message_signing.html). Each station has its own key, so a valid
signature identifies the station. A *stream* is (system, component, link id). Rules that live here:

Signing
1. Only the flag, the CRC and the signature change; ids, sequence number and payload stay. The CRC is not computed again
   but corrected: CRCs are linear, so the flag changes it by a value that depends only on the length. So no CRC extra is
   needed, unknown messages can be signed, and a damaged frame stays damaged.
2. MAVLink 1 cannot be signed: the result is None, and the caller must not send the frame as if it were signed.
3. Stamps of a key rise with every frame and keep pace with time: they follow the wall clock, run on evenly when it is
   set back, and follow the newest stamp proven by the other end (MAVLink's rule). If the clock of one end is not set
   yet, the first valid frame of the other end corrects its stamps. So neither end is excluded.

Checking
4. The hash is checked first. A frame with a wrong hash is BAD and changes nothing, whatever its stamp says. Ids are
   sent in clear, so any sender could otherwise silence a station with one forged stamp from the far future.
5. Each stamp of a stream is accepted once. If a stream uses two links, or a network that reorders, newer frames
   overtake older ones. So a frame that was never heard is still accepted for OVERTAKEN_S after a newer one came. Every
   other frame that is not newer than the stream's newest is REPLAYED. This memory belongs to the key, so a frame of one
   link cannot be replayed on another.
6. The first frame of a stream is TOO_OLD if its stamp is more than `first_packet_tolerance_s` before a limit. The limit
   is the later of our clock and the newest stamp proven under this key. Nothing at or before the `floor` is ever
   accepted.
7. The table of streams is bounded. A full table forgets its oldest stream if rule 6 refuses all frames of that stream
   anyway; the floor rises to its stamp, so it stays refused. Otherwise: TOO_MANY_STREAMS. Only holders of the key can
   fill the table.
8. A frame of a running stream is TOO_OLD if it comes more than `max_age_s` later than the stream's frames usually do. A
   jammed link or an attacker has held it back. That is measured with the monotonic clock against the stream's own
   stamps, so no clock needs to be right. If the stamp is within `max_age_s` of our wall clock the frame is still fresh:
   the sender set its clock back.
9. After a restart the floor is the newest stamp that was proven before it (`state`, `restore`). Every frame captured
   before is refused, in known streams and unknown ones.

Effects of wrong clocks. Our wall clock is used only in rules 6 and 8 and never stored. Rules 5, 7 and 9 refuse every
frame that was accepted before. So no step of our clock makes a replay acceptable. A clock that is not set yet (no
battery, no GPS fix) reads too early and limits nothing; the stamps proven before still do. If our clock reads too late,
running streams are not affected. New streams are TOO_OLD until the clock is right, or until the station has heard us
and follows our stamps. A station whose clock was far ahead and then set right follows our stamps too. A program that
does not follow the other end's stamps needs a new key (`handover keys rotate`), which starts from zero.

Time is an argument: UTC and monotonic seconds. No data from outside raises.
"""

from __future__ import annotations

import hashlib
from collections import deque
from collections.abc import Mapping
from enum import Enum
from hmac import compare_digest
from typing import Final

from pymavlink.generator.mavcrc import x25crc

from mavproxy_handover.wire.frames import CRC_BYTES, FLAG_SIGNED, HEADER_V2, MAGIC_V2, SIGNATURE_BYTES, Frame

__all__ = [
    "KEY_BYTES",
    "MAX_TIMESTAMP",
    "OVERTAKEN_S",
    "SignatureVerdict",
    "SignedPeer",
    "SigningClock",
    "Verifier",
    "fingerprint",
    "resign",
    "sign",
    "timestamp_of",
    "unsign",
]

KEY_BYTES: Final = 32
MAX_TIMESTAMP: Final = (1 << 48) - 1  #: reached in the year 2104
UNITS_PER_S: Final = 100_000
_EPOCH_S: Final = 1_420_070_400  # 2015-01-01 00:00 UTC

#: Time (s) for which a frame is still accepted after a newer one of its stream has come. The delays of a station's
#: links differ by less (`link.bundle.COPY_WINDOW_S`).
OVERTAKEN_S: Final = 2.0
#: slices of that time, plus the current one
_SLICES: Final = 4
_SLICE_S: Final = OVERTAKEN_S / _SLICES
#: most stamps in a slice; a stream of more than 1000 frames a second has less time
_SLICE_STAMPS: Final = 512

#: Allowed growth of a stream's usual delay: clocks drift, and slewing ones by up to 0.05 %.
_DRIFT_PER_S: Final = 0.001 * UNITS_PER_S


def timestamp_of(utc_s: float) -> int:
    """UTC seconds as a signature's stamp, limited to its 48 bits: a clock before 2015 gives 0."""
    return int(min(max(0.0, utc_s - _EPOCH_S) * UNITS_PER_S, MAX_TIMESTAMP))


def fingerprint(key: bytes) -> str:
    """Identifier of a key that may be shown and stored: 16 hexadecimal digits that do not reveal the key."""
    return hashlib.sha256(b"handover key fingerprint" + key).hexdigest()[:16]


# ---- signing ------------------------------------------------------------------------------------------------------


def _flag_in_crc(length: int) -> int:
    """Change of the CRC by the signed flag in a frame with `length` bytes of payload."""
    crc = x25crc()
    crc.crc = 0
    crc.accumulate(bytes([FLAG_SIGNED]) + bytes(HEADER_V2 - 3 + length + 1))  # bytes after the flag, CRC extra included
    return int(crc.crc)


_FLAG_IN_CRC: Final = tuple(_flag_in_crc(length) for length in range(256))


def _bare_length(raw: bytes) -> int:
    """Length without signature, if `raw` is one complete MAVLink 2 frame with flags that we understand; else 0."""
    if len(raw) < HEADER_V2 + CRC_BYTES or raw[0] != MAGIC_V2 or raw[2] & ~FLAG_SIGNED:
        return 0
    length = HEADER_V2 + raw[1] + CRC_BYTES
    return length if len(raw) == length + (SIGNATURE_BYTES if raw[2] else 0) else 0


def _with_flag(bare: bytes, flag: int) -> bytes:
    """Return a bare frame with its signed flag set to `flag`, and the corrected CRC."""
    crc = int.from_bytes(bare[-CRC_BYTES:], "little") ^ _FLAG_IN_CRC[bare[1]]
    return b"%b%c%b%b" % (bare[:2], flag, bare[3:-CRC_BYTES], crc.to_bytes(CRC_BYTES, "little"))


def sign(raw: bytes, key: bytes, link_id: int, timestamp: int) -> bytes | None:
    """Sign `raw`, an unsigned MAVLink 2 frame. `link_id`: 8 bits, `timestamp`: 48 bits.

    Returns None for MAVLink 1, a signed frame (use `resign`), or data that is not exactly one complete frame.
    """
    if len(raw) < 3 or raw[2]:
        return None
    return resign(raw, key, link_id, timestamp)


def resign(raw: bytes, key: bytes, link_id: int, timestamp: int) -> bytes | None:
    """Sign `raw` like `sign`, and replace a signature that it has. The caller has checked that signature."""
    length = _bare_length(raw)
    if not length:
        return None
    bare = raw[:length] if raw[2] else _with_flag(raw, FLAG_SIGNED)
    signed = b"%b%c%b" % (bare, link_id, timestamp.to_bytes(6, "little"))
    return signed + hashlib.sha256(key + signed).digest()[:6]


def unsign(raw: bytes) -> bytes:
    """Remove the signature of `raw`, for logs; an unsigned frame is returned unchanged."""
    length = _bare_length(raw)
    return _with_flag(raw[:length], 0) if length and raw[2] else raw


class SigningClock:
    """Source of the stamps of one key (rule 3), for everything that is signed with it on all links."""

    def __init__(self) -> None:
        #: the newest stamp returned
        self.last = 0
        self._anchor = 0
        self._anchor_at: float | None = None

    def next(self, now_utc_s: float, now_s: float) -> int | None:
        """A stamp above all earlier ones; None when 48 bits are used up."""
        running = self._running(now_s)
        wall = timestamp_of(now_utc_s)
        if wall > running or self._anchor_at is None:
            self._anchor = running = max(wall, running)
            self._anchor_at = now_s
        stamp = max(running, self.last + 1)
        if stamp > MAX_TIMESTAMP:
            return None
        self.last = stamp
        return stamp

    def follow(self, timestamp: int, now_s: float | None = None) -> None:
        """Continue from a stamp that the other end proved. `now_s` None: its time is unknown."""
        if timestamp > (self._anchor if now_s is None else self._running(now_s)):
            self._anchor = timestamp
            self._anchor_at = now_s

    def _running(self, now_s: float) -> int:
        if self._anchor_at is None:
            return self._anchor
        passed_s = now_s - self._anchor_at
        return self._anchor + int(passed_s * UNITS_PER_S) if passed_s > 0.0 else self._anchor


def _checked(key: bytes) -> bytes:
    if len(key) != KEY_BYTES:
        raise ValueError(f"a signing key has {KEY_BYTES} bytes, not {len(key)}")
    return bytes(key)


# ---- checking -----------------------------------------------------------------------------------------------------


class SignatureVerdict(Enum):
    """Verdict on a signature. Only OK lets the frame pass."""

    OK = "ok"
    UNSIGNED = "unsigned"  #: no signature, or MAVLink 1
    BAD = "bad signature"  #: made with another key, or changed on its way
    REPLAYED = "replayed"  #: heard before, or newer ones were heard long enough ago
    TOO_OLD = "too old"  #: held back, or captured earlier, or the clocks differ
    TOO_MANY_STREAMS = "too many streams"


class _Stream:
    """Stamps of a stream that could come again: those of the last slices of time."""

    __slots__ = ("_ends", "_slices", "edge", "last", "turn_at", "usual", "usual_at")

    def __init__(self, first: int, edge: int, usual: int, now_s: float) -> None:
        #: the newest stamp
        self.last = first
        #: every stamp up to this is old, heard or not
        self.edge = edge
        #: monotonic time at arrival minus stamp, of the frame with the least delay so far, in stamp units
        self.usual = usual
        self.usual_at = now_s
        #: end of the current slice
        self.turn_at = now_s + _SLICE_S
        self._slices: deque[set[int]] = deque([{first}])
        #: newest stamp at the end of each past slice
        self._ends: deque[int] = deque()

    def accept(self, stamp: int, now_s: float) -> bool:
        """Returns True if this stamp is new, and remembers it."""
        present = self._slices[-1]
        if now_s >= self.turn_at or len(present) >= _SLICE_STAMPS:
            present = self._turn(now_s)
        if stamp > self.last:
            self.last = stamp
        elif stamp <= self.edge or any(stamp in heard for heard in self._slices):
            return False
        present.add(stamp)
        return True

    def _turn(self, now_s: float) -> set[int]:
        """Begin the slice of `now_s`. Stamps of slices that ended OVERTAKEN_S ago become old."""
        late_s = now_s - self.turn_at
        passed = 1 if late_s < 0.0 else 1 + min(int(late_s / _SLICE_S), _SLICES)
        for _ in range(passed):
            self._ends.append(self.last)
            self._slices.append(set())
            if len(self._ends) > _SLICES:
                self._slices.popleft()
                self.edge = self._ends.popleft()
        self.turn_at = now_s + _SLICE_S if late_s < 0.0 or passed > _SLICES else self.turn_at + passed * _SLICE_S
        return self._slices[-1]


class Verifier:
    """Checks the signatures of one key, on all links of its holder. Rules 4 to 9 above."""

    def __init__(
        self,
        key: bytes,
        *,
        max_streams: int = 16,
        max_age_s: float | None = 30.0,
        first_packet_tolerance_s: float = 60.0,
        clock: SigningClock | None = None,
    ) -> None:
        """`clock`: clock of the signers of the same key, which follows proven stamps. `max_age_s` None: rule 8 is off.

        `max_age_s` must be well above 10 s, because stock MAVProxy updates its stamps only every 10 s. Raises
        ValueError for an invalid key or no streams.
        """
        if max_streams < 1:
            raise ValueError(f"max_streams = {max_streams}: must be 1 or more")
        #: SHA-256 that has processed the key
        self._keyed = hashlib.sha256(_checked(key))
        self._max_streams = max_streams
        self._max_age = None if max_age_s is None else int(max_age_s * UNITS_PER_S)
        self._tolerance = int(first_packet_tolerance_s * UNITS_PER_S)
        self._clock = clock
        self._streams: dict[tuple[int, int, int], _Stream] = {}
        #: the newest stamp proven under this key since the start
        self.newest = 0
        #: first frames of a stream must be above this stamp, which is known from before the start
        self.floor = 0
        #: age (s) of the last frame that was TOO_OLD, for the operator, who may have to set a clock
        self.behind_s = 0.0
        self.fingerprint = fingerprint(key)

    def check(self, frame: Frame, now_utc_s: float, now_s: float) -> SignatureVerdict:
        """The verdict on a frame with a valid CRC. Times: UTC as far as known, and monotonic."""
        if not frame.signed:
            return SignatureVerdict.UNSIGNED
        raw = frame.raw
        digest = self._keyed.copy()
        digest.update(raw[:-6])
        if not compare_digest(digest.digest()[:6], raw[-6:]):
            return SignatureVerdict.BAD
        stamp = int.from_bytes(raw[-12:-6], "little")
        delay = int(now_s * UNITS_PER_S) - stamp
        name = (frame.sysid, frame.compid, raw[-13])
        stream = self._streams.get(name)
        verdict = SignatureVerdict.OK
        if stream is None:
            verdict = self._first(name, stamp, delay, now_utc_s, now_s)
        elif not stream.accept(stamp, now_s):
            # it is remembered even if it should be too old, so that it never counts as fresh again
            return SignatureVerdict.REPLAYED
        else:
            late = delay - stream.usual - int((now_s - stream.usual_at) * _DRIFT_PER_S)
            if late <= 0:
                stream.usual, stream.usual_at = delay, now_s
            elif self._max_age is not None and late > self._max_age:
                if abs(timestamp_of(now_utc_s) - stamp) > self._max_age:
                    self.behind_s = late / UNITS_PER_S
                    verdict = SignatureVerdict.TOO_OLD
                else:  # rule 8: the sender set its clock back
                    stream.usual, stream.usual_at = delay, now_s
        if verdict is SignatureVerdict.OK and stamp > self.newest:
            self.newest = stamp
            if self._clock is not None:
                self._clock.follow(stamp, now_s)
        return verdict

    def state(self) -> dict[str, int]:
        """State for a restart: fingerprint of the key -> stamp up to which everything is old by then."""
        return {self.fingerprint: max(self.newest, self.floor)}

    def restore(self, state: Mapping[str, int], floor: int = 0) -> None:
        """Restore a `state` (rule 9), before the first frame. Entries of other keys are ignored.

        `floor`: refuse everything up to this stamp, if the state is lost.
        """
        self.floor = max(self.floor, state.get(self.fingerprint, 0), floor)
        if self._clock is not None:
            self._clock.follow(self.floor)

    def _first(
        self, name: tuple[int, int, int], stamp: int, delay: int, now_utc_s: float, now_s: float
    ) -> SignatureVerdict:
        earliest = max(max(self.newest, timestamp_of(now_utc_s)) - self._tolerance, self.floor + 1)
        if stamp < earliest:
            self.behind_s = (earliest - stamp) / UNITS_PER_S
            return SignatureVerdict.TOO_OLD
        if len(self._streams) >= self._max_streams:
            oldest = min(self._streams, key=lambda other: self._streams[other].last)
            last = self._streams[oldest].last
            if last >= self.newest - self._tolerance:
                return SignatureVerdict.TOO_MANY_STREAMS
            del self._streams[oldest]
            self.floor = max(self.floor, last)
        edge = max(earliest - 1, stamp - int(OVERTAKEN_S * UNITS_PER_S))
        self._streams[name] = _Stream(stamp, edge, delay, now_s)
        return SignatureVerdict.OK


class SignedPeer:
    """The other end of a key: a station, or the autopilot. Checks its frames and signs the frames to it.

    During a rotation it has two keys. Both are accepted. Frames are signed with the current key, except while the peer
    has proven only the previous one. Once the current key was seen, we never sign with the previous one again: a thief
    of that key may be the reason for the rotation.
    """

    def __init__(
        self,
        current: bytes,
        previous: bytes | None = None,
        *,
        max_streams: int = 16,
        max_age_s: float | None = 30.0,
        first_packet_tolerance_s: float = 60.0,
        keeps_sent: bool = False,
    ) -> None:
        """Options and errors are those of `Verifier`.

        `keeps_sent`: our own stamps outlive a restart as well. The autopilot need not send us anything. It would refuse
        all that is signed with older stamps, and a clock that is not set yet would give us no newer ones.
        """
        self.clock = SigningClock()
        self._sent_name = f"{fingerprint(current)} sent" if keeps_sent else ""
        self._keys = (current,) if previous is None else (current, previous)
        self._verifiers = [
            Verifier(
                key,
                max_streams=max_streams,
                max_age_s=max_age_s,
                first_packet_tolerance_s=first_packet_tolerance_s,
                clock=self.clock,
            )
            for key in self._keys
        ]
        #: outside a rotation there is only one key
        self._only = self._verifiers[0] if previous is None else None
        self._current_seen = False
        self._in_use = 0
        #: verifier that found the last TOO_OLD frame
        self._behind = self._verifiers[0]

    @property
    def behind_s(self) -> float:
        """See `Verifier.behind_s`."""
        return self._behind.behind_s

    def check(self, frame: Frame, now_utc_s: float, now_s: float) -> SignatureVerdict:
        """The verdict on a frame from this peer."""
        if self._only is not None:
            return self._only.check(frame, now_utc_s, now_s)
        verdict = SignatureVerdict.BAD
        for verifier in self._verifiers:
            verdict = verifier.check(frame, now_utc_s, now_s)
            if verdict is SignatureVerdict.OK:
                self._current_seen = self._current_seen or verifier is self._verifiers[0]
                self._in_use = 0 if self._current_seen else 1
            elif verdict is SignatureVerdict.TOO_OLD:
                self._behind = verifier
            if verdict is not SignatureVerdict.BAD:
                break
        return verdict

    def sign(self, raw: bytes, link_id: int, now_utc_s: float, now_s: float) -> bytes | None:
        """Sign `raw` for this peer on link `link_id`; our signature replaces any other. None: see `sign`."""
        stamp = self.clock.next(now_utc_s, now_s)
        return None if stamp is None else self.seal(raw, link_id, stamp)

    def seal(self, raw: bytes, link_id: int, stamp: int) -> bytes | None:
        """Sign `raw` with a stamp that was drawn from `clock` before, for a frame that goes out on several links."""
        return resign(raw, self._keys[self._in_use], link_id, stamp)

    def state(self) -> dict[str, int]:
        """See `Verifier.state`: an entry for each key, and one for what we sent, if that is kept."""
        state = {name: stamp for verifier in self._verifiers for name, stamp in verifier.state().items()}
        if self._sent_name:
            state[self._sent_name] = self.clock.last
        return state

    def restore(self, state: Mapping[str, int], floor: int = 0) -> None:
        """See `Verifier.restore`."""
        for verifier in self._verifiers:
            verifier.restore(state, floor)
        if self._sent_name in state:
            self.clock.last = max(self.clock.last, state[self._sent_name])
            self.clock.follow(self.clock.last)
