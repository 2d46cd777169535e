# SPDX-License-Identifier: GPL-3.0-or-later

"""Signing keys on disk, one file for each station.

A key has 32 bytes: the SHA-256 of a passphrase, as in MAVProxy (`signing key`), Mission Planner and older
QGroundControl. Newer QGroundControl derives another key from the same passphrase (PBKDF2), but accepts 64 hexadecimal
digits instead ("raw hex key"). A key file holds these digits. Rules that live here:

1. One file for each station, `NAME.key`, with mode 0600 from the start, written completely or not at all. The file is
   refused with a message of one line for any of three reasons. Other users may read it, it belongs to another user, or
   it holds anything except a key.
2. No message, exception or log line contains a key or a part of one. A fingerprint names it.
3. While `NAME.key.old` exists, a rotation is in progress and the key in it is accepted too (`wire.signing.SignedPeer`).
   So a rotation does not disconnect a vehicle in flight, which has its keys in memory, or a companion that restarts in
   flight.
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
from mavproxy_handover.store.portable import CLOSED_ON_EXEC, NEVER_WAIT, user
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
_AWKWARD: Final = "\"'\\;#"  # MAVProxy's command line gives them another meaning


class KeysError(Exception):
    """A key cannot be used or stored. The message is one line for people and contains no key."""

    def __init__(self, message: str) -> None:
        super().__init__(" ".join(message.splitlines()))


@dataclass(frozen=True, slots=True, repr=False)
class StationKeys:
    """The keys of one station; `previous` only during a rotation. Its repr shows no key."""

    current: bytes
    previous: bytes | None = None

    def __repr__(self) -> str:
        previous = "" if self.previous is None else f", previous {fingerprint(self.previous)}"
        return f"StationKeys({fingerprint(self.current)}{previous})"


# ---- passphrases --------------------------------------------------------------------------------------------------


def make_passphrase() -> str:
    """Make a passphrase of 125 random bits: five groups of five characters.

    It is easy to read out and to type, and a shell reads it as one word.
    """
    return "-".join("".join(secrets.choice(_ALPHABET) for _ in range(5)) for _ in range(_GROUPS))


def key_of(passphrase: str) -> bytes:
    """Derive the key from `passphrase` as MAVProxy and other programs do.

    Raises KeysError if some program cannot take this passphrase, or if it is so short that it could be guessed from a
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
    """Path of the key file of station `name`. Raises KeysError for a name that cannot be a file name."""
    if not _NAME.fullmatch(name):
        raise KeysError(f"station name {name!r} must be 1 to 20 letters, digits, '_', '-' or '.', to name a key file")
    return folder / f"{name}.key"


def previous_path(path: Path) -> Path:
    """Path of the key before the last rotation."""
    return path.with_name(path.name + ".old")


def load_key(path: Path, owner: int | None = None, warn: Callable[[str], None] | None = None) -> bytes:
    """Read the 32 bytes in a key file. Raises KeysError if it is missing, readable by others, or holds no key.

    `owner`: the user that will use the key; None: the user that runs this process. `warn`: gets what is wrong with mode
    or owner, which then is no error. It is for a restart in flight, which must not fail because of it.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | CLOSED_ON_EXEC | NEVER_WAIT)  # do not hang on a pipe
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
    """Reason why an open key file cannot be used, "" if it can. It is open so that it cannot be exchanged meanwhile."""
    if not stat.S_ISREG(status.st_mode):
        return "is not a file"
    runs = user()
    if runs is None:
        return ""  # rights are in access lists, which are not judged
    mode = stat.S_IMODE(status.st_mode)
    if mode & ~(stat.S_IRUSR | stat.S_IWUSR):
        return f"mode {mode:04o} must be 0600, because only its owner may read a key: chmod 600 {path}"
    if status.st_uid != (runs if owner is None else owner):
        must = f"{runs}, who runs this" if owner is None else f"{owner}, who is to use it"
        return f"belongs to user {status.st_uid}, must belong to {must}"
    return ""


def load_station_keys(path: Path, owner: int | None = None, warn: Callable[[str], None] | None = None) -> StationKeys:
    """Read the key in `path` and, during a rotation, the one before it. Raises KeysError.

    `owner` and `warn` have the same meaning as in `load_key`.
    """
    current = load_key(path, owner, warn)
    old = previous_path(path)
    previous = load_key(old, owner, warn) if os.path.lexists(old) else None
    return StationKeys(current, None if previous == current else previous)


def check_distinct(keys: Mapping[str, StationKeys]) -> None:
    """Raise KeysError if two stations share a key: one could then pretend to be the other."""
    owners: dict[bytes, str] = {}
    for name, station in keys.items():
        for key in (station.current, station.previous):
            if key is not None and owners.setdefault(key, name) != name:
                raise KeysError(f"{owners[key]} and {name} have the same key; each station needs one of its own")


def write_key(path: Path, key: bytes) -> None:
    """Write a new key file, mode 0600. It never replaces an existing file. Raises KeysError."""
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
    """Replace the key in `path` by `key`. The old one is kept beside it and accepted until it is retired.

    Raises KeysError if there is no valid key, or if an earlier rotation is not finished.
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
    """Remove the key before the last rotation. Raises KeysError if there is none, or if the current key is invalid."""
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
