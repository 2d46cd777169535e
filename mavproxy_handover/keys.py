# SPDX-License-Identifier: GPL-3.0-or-later

"""Signing keys on disk, and what must be remembered so that old frames stay refused after a restart.

A key is 32 bytes: the SHA-256 of a passphrase, as MAVProxy (`signing key`), Mission Planner and QGroundControl up to
2025 make theirs. Newer QGroundControl makes another key of the same passphrase (PBKDF2) and takes ours as 64 digits
instead ("raw hex key"); those are what a key file holds. Rules that live here:

1. One file for each station, `NAME.key`, mode 0600 from the moment it exists, written whole or not at all. A file that
   others may read, that belongs to somebody else or that holds anything but a key is refused with one line.
2. No message, exception or log line carries a key or a part of one; a fingerprint names it.
3. While `NAME.key.old` is there, a rotation is under way and the key in it is accepted too (`wire.signing.SignedPeer`).
   So a rotation cuts off nobody: not a vehicle that flies, which has its keys in memory, and not one whose companion
   restarts in flight.
4. The replay state is one stamp for each key: everything up to it is old after a restart. What is written is a little
   ahead of what was accepted, so that nothing accepted after the last write is accepted again after a crash.
5. A replay state that cannot be read shuts nobody out for good and lets nothing old in: everything signed before now
   is refused, and a note says so.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import secrets
import stat
import threading
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from mavproxy_handover.wire.signing import (
    KEY_BYTES,
    MAX_TIMESTAMP,
    UNITS_PER_S,
    SignedPeer,
    fingerprint,
    timestamp_of,
)

__all__ = [
    "MIN_PASSPHRASE",
    "KeysError",
    "ReplayStore",
    "StationKeys",
    "check_distinct",
    "key_of",
    "key_path",
    "load_key",
    "load_station_keys",
    "make_passphrase",
    "previous_path",
    "retire_key",
    "rotate_key",
    "write_key",
]

MIN_PASSPHRASE: Final = 16

_ALPHABET: Final = "abcdefghijkmnpqrstuvwxyz23456789"  # 32 characters; 0 and o, 1 and l look alike
_GROUPS: Final = 5  # of 5 characters of 5 bits: 125 bits
_NAME: Final = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,19}")
_CONTENT: Final = re.compile(rb"[0-9a-fA-F]{64}")
_PASSPHRASE: Final = re.compile(r"[!-~]+")
_AWKWARD: Final = "\"'\\;#"  # MAVProxy's command line takes them for something else
_MODE: Final = 0o600


class KeysError(Exception):
    """A key cannot be used or kept. The message is one line for people and holds no key."""

    def __init__(self, message: str) -> None:
        super().__init__(" ".join(message.splitlines()))


@dataclass(frozen=True, slots=True, repr=False)
class StationKeys:
    """The keys of one station; `previous` only while a rotation is under way. Its repr shows no key."""

    current: bytes
    previous: bytes | None = None

    def __repr__(self) -> str:
        previous = "" if self.previous is None else f", previous {fingerprint(self.previous)}"
        return f"StationKeys({fingerprint(self.current)}{previous})"


# ---- passphrases --------------------------------------------------------------------------------------------------


def make_passphrase() -> str:
    """A new passphrase of 125 random bits: five groups of five, easy to read out and to type, one word to a shell."""
    return "-".join("".join(secrets.choice(_ALPHABET) for _ in range(5)) for _ in range(_GROUPS))


def key_of(passphrase: str) -> bytes:
    """The key that MAVProxy makes of `passphrase`, and others with it.

    Raises KeysError for one that some program could not be given, or that is short enough to be guessed from a
    recorded frame.
    """
    if len(passphrase) < MIN_PASSPHRASE:
        raise KeysError(f"the passphrase has {len(passphrase)} characters, must have {MIN_PASSPHRASE} or more")
    if not _PASSPHRASE.fullmatch(passphrase) or any(character in _AWKWARD for character in passphrase):
        raise KeysError(
            "the passphrase must be ASCII letters, digits and signs, without blanks and " + " ".join(_AWKWARD)
        )
    return hashlib.sha256(passphrase.encode("ascii")).digest()


# ---- key files ----------------------------------------------------------------------------------------------------


def key_path(folder: Path, name: str) -> Path:
    """Where the key of station `name` is kept. Raises KeysError for a name that cannot be a file's."""
    if not _NAME.fullmatch(name):
        raise KeysError(f"station name {name!r} must be 1 to 20 letters, digits, '_', '-' or '.', to name a key file")
    return folder / f"{name}.key"


def previous_path(path: Path) -> Path:
    """Where the key before the last rotation is kept."""
    return path.with_name(path.name + ".old")


def load_key(path: Path) -> bytes:
    """The 32 bytes in a key file. Raises KeysError: missing, not ours alone, or not a key."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)  # a pipe must not stop the start
    except FileNotFoundError:
        raise KeysError(f"{path}: no such key file; 'handover keys make' writes one") from None
    except OSError as error:
        raise KeysError(f"{path}: {error.strerror}") from None
    with os.fdopen(descriptor, "rb") as file:
        status = os.fstat(file.fileno())
        mode = stat.S_IMODE(status.st_mode)
        if not stat.S_ISREG(status.st_mode):
            raise KeysError(f"{path}: is not a file")
        if mode & 0o177:
            raise KeysError(f"{path}: mode {mode:04o} must be 0600, or others may read the key: chmod 600 {path}")
        if status.st_uid != os.geteuid():
            raise KeysError(
                f"{path}: belongs to user {status.st_uid}, must belong to the user who runs this, {os.geteuid()}"
            )
        try:
            content = file.read(256).strip()
        except OSError as error:
            raise KeysError(f"{path}: {error.strerror}") from None
    if not _CONTENT.fullmatch(content):
        raise KeysError(f"{path}: must hold 64 hexadecimal digits and nothing else")
    key = bytes.fromhex(content.decode("ascii"))
    if key == bytes(KEY_BYTES):
        raise KeysError(f"{path}: a key of zeros means no signing to MAVLink; make another one")
    return key


def load_station_keys(path: Path) -> StationKeys:
    """The key in `path` and, if a rotation is under way, the one before it. Raises KeysError."""
    current = load_key(path)
    old = previous_path(path)
    previous = load_key(old) if os.path.lexists(old) else None
    return StationKeys(current, None if previous == current else previous)


def check_distinct(keys: Mapping[str, StationKeys]) -> None:
    """Raise KeysError if two stations share a key: who holds it could then speak for both."""
    owners: dict[bytes, str] = {}
    for name, station in keys.items():
        for key in (station.current, station.previous):
            if key is not None and owners.setdefault(key, name) != name:
                raise KeysError(f"{owners[key]} and {name} have the same key; each station needs one of its own")


def write_key(path: Path, key: bytes) -> None:
    """Write a new key file, mode 0600. Never over one that exists. Raises KeysError."""
    temporary = _temporary(path, key)
    try:
        os.link(temporary, path)  # unlike a rename, this does not replace
    except FileExistsError:
        raise KeysError(f"{path}: exists already; 'handover keys rotate' replaces a key") from None
    except OSError as error:
        raise KeysError(f"{path}: {error.strerror}") from None
    finally:
        _discard(temporary)
    _sync_folder(path)


def rotate_key(path: Path, key: bytes) -> None:
    """Put `key` in the place of the one in `path`, which is kept beside it and accepted until it is retired.

    Raises KeysError: no good key there, or an earlier rotation is not finished.
    """
    current = load_key(path)
    old = previous_path(path)
    if os.path.lexists(old):
        raise KeysError(f"{old}: an earlier rotation is not finished; 'handover keys retire' ends it")
    if current == key:
        raise KeysError(f"{path}: holds this very key already")
    temporary = _temporary(path, key)
    try:
        os.link(path, old)
        os.replace(temporary, path)
    except OSError as error:
        raise KeysError(f"{path}: {error.strerror}") from None
    finally:
        _discard(temporary)
    _sync_folder(path)


def retire_key(path: Path) -> None:
    """Remove the key before the last rotation. Raises KeysError, also if there is none or the current one is no good."""
    load_key(path)
    old = previous_path(path)
    try:
        os.unlink(old)
    except FileNotFoundError:
        raise KeysError(f"{old}: no such file; no rotation is under way") from None
    except OSError as error:
        raise KeysError(f"{old}: {error.strerror}") from None
    _sync_folder(path)


def _temporary(path: Path, key: bytes) -> Path:
    """A file beside `path` that holds `key`, complete and on the disk, never readable by others."""
    if len(key) != KEY_BYTES:
        raise ValueError(f"a signing key has {KEY_BYTES} bytes, not {len(key)}")
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    try:
        _write_whole(temporary, key.hex().encode("ascii") + b"\n")
    except OSError as error:
        _discard(temporary)
        raise KeysError(f"{path}: {error.strerror}") from None
    return temporary


def _write_whole(path: Path, data: bytes) -> None:
    """A new file, mode 0600 from the start, and on the disk when this returns. Raises OSError."""
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, _MODE)
    with os.fdopen(descriptor, "wb") as file:
        os.fchmod(file.fileno(), _MODE)  # the umask may have taken away more
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def _discard(path: Path) -> None:
    with suppress(OSError):
        os.unlink(path)


def _sync_folder(path: Path) -> None:
    """Names are on the disk only when their folder is."""
    with suppress(OSError):
        descriptor = os.open(path.parent, os.O_RDONLY | os.O_CLOEXEC)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


# ---- replay state -------------------------------------------------------------------------------------------------

#: peer -> fingerprint of a key -> stamp
_Stamps = dict[str, dict[str, int]]


class ReplayStore:
    """The replay state of all peers in one file: load, attach each peer, tick from the main loop, close.

    A write happens beside the main loop: waiting for a disk there would hold up the lease. How often follows from the
    stamps: when those accepted have used up half of the `reserve_s` that the file is ahead, but never sooner than
    `interval_s` after the last write; while nobody sends, nothing is written. After a crash what is signed within the
    reserve is refused, so a station is heard again at most `reserve_s` after its last frame, or as soon as it heard us.
    """

    def __init__(self, path: Path, reserve_s: float = 4.0, interval_s: float = 1.0) -> None:
        self.path = path
        #: what is to be said of the file, "" if it is as it should be
        self.note = ""
        #: writes that failed
        self.errors = 0
        self._reserve = int(reserve_s * UNITS_PER_S)
        self._interval_s = interval_s
        self._floor = 0
        self._written: _Stamps = {}
        self._peers: dict[str, SignedPeer] = {}
        self._attached: _Stamps = {}
        self._not_before_s = float("-inf")
        self._writer: threading.Thread | None = None

    def load(self, now_utc_s: float) -> str:
        """Read the file; returns what is to be said of it (`note`). Never raises."""
        try:
            data = self.path.read_bytes()
        except FileNotFoundError:
            self.note = f"{self.path}: no replay state yet; signed frames are accepted if they are new by the clock"
            return self.note
        except OSError as error:
            return self._lost(error.strerror or str(error), now_utc_s)
        try:
            self._written = _unpack(data)
        except (ValueError, RecursionError) as error:
            return self._lost(str(error), now_utc_s)
        return self.note

    def attach(self, name: str, peer: SignedPeer) -> None:
        """Give `peer` what is known of its keys, and keep its state from now on. Before its first frame."""
        peer.restore(self._written.get(name, {}), self._floor)
        self._peers[name] = peer
        self._attached[name] = peer.state()

    def tick(self, now_s: float) -> None:
        """Write if it is time to. Returns at once."""
        if now_s < self._not_before_s or (self._writer is not None and self._writer.is_alive()) or not self._due():
            return
        self._not_before_s = now_s + self._interval_s
        self._writer = threading.Thread(target=self._write, args=(self._stamps(self._reserve),), name="replay-state")
        self._writer.start()

    def close(self) -> None:
        """Write the state as it is, and wait until that is done. The store is not used after this."""
        if self._writer is not None:
            self._writer.join()
        if self._peers:
            self._write(self._stamps(0))

    def _lost(self, why: str, now_utc_s: float) -> str:
        """The state cannot be had. What the file's own time says may be later than a clock that is not set yet."""
        self._floor = timestamp_of(now_utc_s)
        with suppress(OSError):
            self._floor = max(self._floor, timestamp_of(self.path.stat().st_mtime))
        kept = self.path.with_name(self.path.name + ".damaged")
        self.note = f"{self.path}: replay state cannot be read ({why}); what was signed before now is refused"
        with suppress(OSError):
            os.replace(self.path, kept)
            self.note += f"; the file is kept as {kept.name}"
        return self.note

    def _due(self) -> bool:
        for name, peer in self._peers.items():
            written = self._written.get(name, {})
            for key, stamp in peer.state().items():
                if stamp > self._attached[name][key] and stamp + self._reserve // 2 > written.get(key, 0):
                    return True
        return False

    def _stamps(self, reserve: int) -> _Stamps:
        """What to write: of peers that are not here now, what was there before; ahead only where frames came in."""
        stamps = dict(self._written)
        for name, peer in self._peers.items():
            attached = self._attached[name]
            stamps[name] = {
                key: min(stamp + reserve, MAX_TIMESTAMP) if stamp > attached[key] else stamp
                for key, stamp in peer.state().items()
            }
        return stamps

    def _write(self, stamps: _Stamps) -> None:
        temporary = self.path.with_name(f".{self.path.name}.{secrets.token_hex(4)}")
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            _write_whole(temporary, _pack(stamps))
            os.replace(temporary, self.path)
        except OSError as error:
            self.errors += 1
            self.note = f"{self.path}: replay state cannot be written ({error.strerror})"
            _discard(temporary)
            return
        _sync_folder(self.path)
        self._written = stamps


_FORMAT: Final = "handover replay state 1"


def _pack(stamps: _Stamps) -> bytes:
    body = json.dumps(stamps, sort_keys=True)
    digest = hashlib.sha256(body.encode("ascii")).hexdigest()
    return json.dumps({"format": _FORMAT, "sha256": digest, "stamps": stamps}, sort_keys=True).encode("ascii") + b"\n"


def _unpack(data: bytes) -> _Stamps:
    """What `_pack` wrote. Raises ValueError that says what is wrong."""
    try:
        content: Any = json.loads(data)
    except ValueError:
        raise ValueError("it is cut or no JSON") from None
    if not isinstance(content, dict) or content.get("format") != _FORMAT:
        raise ValueError(f"it is not in the form {_FORMAT!r}")
    stamps = content.get("stamps")
    body = json.dumps(stamps, sort_keys=True)
    if content.get("sha256") != hashlib.sha256(body.encode("ascii")).hexdigest():
        raise ValueError("its checksum is wrong")
    if not isinstance(stamps, dict) or not all(_is_peer(entry) for entry in stamps.values()):
        raise ValueError("it holds something else than stamps")
    return stamps


def _is_peer(entry: Any) -> bool:
    return isinstance(entry, dict) and all(
        isinstance(stamp, int) and not isinstance(stamp, bool) and 0 <= stamp <= MAX_TIMESTAMP
        for stamp in entry.values()
    )
