# SPDX-License-Identifier: GPL-3.0-or-later

"""Signing keys on disk: one file for each station.

A key is 32 bytes: the SHA-256 of a passphrase, as MAVProxy (`signing key`), Mission Planner and older QGroundControl
make theirs. Newer QGroundControl makes another key of the same passphrase (PBKDF2) and takes ours as 64 hexadecimal
digits instead ("raw hex key"); those are what a key file holds. Rules that live here:

1. One file for each station, `NAME.key`, mode 0600 from the moment it exists, written whole or not at all. A file that
   others may read, that belongs to somebody else or that holds anything but a key is refused with one line.
2. No message, exception or log line carries a key or a part of one; a fingerprint names it.
3. While `NAME.key.old` is there, a rotation is under way and the key in it is accepted too (`wire.signing.SignedPeer`).
   So a rotation cuts off nobody: not a vehicle that flies, which has its keys in memory, and not one whose companion
   restarts in flight.
"""

from __future__ import annotations

import hashlib
import os
import re
import secrets
import stat
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from mavproxy_handover.store.durable import discard, sync_folder, write_beside
from mavproxy_handover.wire.signing import KEY_BYTES, fingerprint

__all__ = [
    "MIN_PASSPHRASE",
    "KeysError",
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
_MAX_FILE_BYTES: Final = 128
_PASSPHRASE: Final = re.compile(r"[!-~]+")
_AWKWARD: Final = "\"'\\;#"  # MAVProxy's command line takes them for something else


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


def load_key(path: Path, owner: int | None = None, warn: Callable[[str], None] | None = None) -> bytes:
    """The 32 bytes in a key file. Raises KeysError: missing, not ours alone, or not a key.

    `owner`: the user who is to use it; None: the user who runs this. `warn`: is told what is wrong with mode or owner,
    which is then no error: for a restart in flight, which must not fail for it."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)  # a pipe must not stop the start
        try:
            problem = _problem(path, os.fstat(descriptor), owner)
            if problem and warn is not None and stat.S_ISREG(os.fstat(descriptor).st_mode):
                warn(f"{path}: {problem}")
                problem = ""
            content = b"" if problem else os.read(descriptor, _MAX_FILE_BYTES + 1)
        finally:
            os.close(descriptor)
    except FileNotFoundError:
        raise KeysError(f"{path}: no such key file; 'handover keys make' writes one") from None
    except OSError as error:
        raise KeysError(f"{path}: {error.strerror}") from None
    if problem:
        raise KeysError(f"{path}: {problem}")
    digits = content.strip()
    if len(content) > _MAX_FILE_BYTES or not _CONTENT.fullmatch(digits):
        raise KeysError(f"{path}: must hold 64 hexadecimal digits and nothing else")
    key = bytes.fromhex(digits.decode("ascii"))
    if key == bytes(KEY_BYTES):
        raise KeysError(f"{path}: a key of zeros switches signing off in MAVLink; make another one")
    return key


def _problem(path: Path, status: os.stat_result, owner: int | None) -> str:
    """What keeps a key file, open already so that nobody swaps it, from being used; "" if nothing does."""
    if not stat.S_ISREG(status.st_mode):
        return "is not a file"
    mode = stat.S_IMODE(status.st_mode)
    if mode & ~(stat.S_IRUSR | stat.S_IWUSR):
        return f"mode {mode:04o} must be 0600, a key is for its owner alone: chmod 600 {path}"
    if status.st_uid != (os.geteuid() if owner is None else owner):
        must = f"{os.geteuid()}, who runs this" if owner is None else f"{owner}, who is to use it"
        return f"belongs to user {status.st_uid}, must belong to {must}"
    return ""


def load_station_keys(path: Path, owner: int | None = None, warn: Callable[[str], None] | None = None) -> StationKeys:
    """The key in `path` and, if a rotation is under way, the one before it. Raises KeysError. `owner`, `warn`: as
    above."""
    current = load_key(path, owner, warn)
    old = previous_path(path)
    previous = load_key(old, owner, warn) if os.path.lexists(old) else None
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
        discard(temporary)
    sync_folder(path)


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
        try:
            os.replace(temporary, path)
        except OSError:
            discard(old)
            raise
    except OSError as error:
        raise KeysError(f"{path}: {error.strerror}") from None
    finally:
        discard(temporary)
    sync_folder(path)


def retire_key(path: Path) -> None:
    """Remove the key before the last rotation. Raises KeysError: there is none, or the current one is no good."""
    load_key(path)
    old = previous_path(path)
    try:
        os.unlink(old)
    except FileNotFoundError:
        raise KeysError(f"{old}: no such file; no rotation is under way") from None
    except OSError as error:
        raise KeysError(f"{old}: {error.strerror}") from None
    sync_folder(path)


def _temporary(path: Path, key: bytes) -> Path:
    if len(key) != KEY_BYTES:
        raise ValueError(f"a signing key has {KEY_BYTES} bytes, not {len(key)}")
    try:
        return write_beside(path, key.hex().encode("ascii") + b"\n")
    except OSError as error:
        raise KeysError(f"{path}: {error.strerror}") from None
