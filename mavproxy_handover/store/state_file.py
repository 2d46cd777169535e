# SPDX-License-Identifier: GPL-3.0-or-later

"""The state file: the snapshot of authority and the mission package. A crash leaves the old state or the new one.

Rules
-----
* The state is written to a file beside it, synchronised, then renamed, so it is never incomplete.
* A checksum covers everything. A damaged file is not repaired: it raises `StateError`. The companion then starts
  without authority, which in flight means a return.
* The file contains the boot in which it was written, and its serial. A disk may be late, so the file may not be the
  newest state. `state_store.py` decides what counts.
* The mission package has its own file, because it is large and seldom changes. The vehicle's addresses that came with
  it are in a further file, bound to the digest of the package. Damage there costs only the addresses.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields
from functools import partial
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple

from mavproxy_handover.core.common.causes import CAUSES, Cause, Ends
from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.core.common.snapshot import PackMemory, Snapshot
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.mission.package import MissionPackage, from_bytes
from mavproxy_handover.store.durable import opened, sealed, sync_folder
from mavproxy_handover.wire.vehicle_address import (
    ENTRY_BYTES,
    MAX_ADDRESSES,
    Addresses,
    pack_addresses,
    unpack_addresses,
)

__all__ = ["Kept", "StateError", "StateFile", "pack", "unpack"]

_FORMAT = 9
_MAX_SYSID = 255
#: the next run begins one above the stored epoch, and each change of authority takes one more of the 32 bits
_MAX_EPOCH = 0xFFFF_0000
_DIGEST_BYTES = 32
_MOST_ADDRESS_BYTES = _DIGEST_BYTES + MAX_ADDRESSES * ENTRY_BYTES
#: above the largest value that is accepted of a battery monitor, so no such value makes the file invalid
_MOST_AMOUNT = 1e12


class StateError(Exception):
    """The state file exists but cannot be trusted. The message is one line for people."""


@dataclass(frozen=True, slots=True)
class Kept:
    """A stored snapshot, with its boot of the system ("" if unknown) and its serial within that boot."""

    snapshot: Snapshot
    boot: str = ""
    serial: int = 0


def pack(kept: Kept, vehicle: str) -> bytes:
    """Encode the state of a vehicle, with a checksum over all of it."""
    head = {"format": _FORMAT, "vehicle": vehicle, "boot": kept.boot, "serial": kept.serial}
    state = {key: field.written(getattr(kept.snapshot, key)) for key, field in _FIELDS.items()}
    return sealed({**head, **state}, indent=1)


def unpack(raw: bytes, vehicle: str) -> Kept:
    """Decode what `pack` made. Raises ValueError that says what is wrong.

    Nothing is converted: a value of another type than was written is an error.
    """
    try:
        body = opened(raw)
        if body["format"] != _FORMAT or body["vehicle"] != vehicle:
            raise ValueError("it is of another vehicle or version")
        if not isinstance(body["boot"], str):
            raise ValueError(f"boot: {body['boot']!r} must be a text")
        snapshot = Snapshot(**{key: field.read(key, body[key]) for key, field in _FIELDS.items()})
        _whole(0, len(snapshot.route), "route_at", snapshot.route_at)
        return Kept(snapshot, body["boot"], _whole(0, (1 << 63) - 1, "serial", body["serial"]))
    except (KeyError, TypeError, OverflowError, RecursionError) as error:
        raise ValueError(str(error)) from None


class StateFile:
    """The state files of one vehicle in `folder`."""

    def __init__(self, folder: Path, vehicle: str) -> None:
        self._folder = folder
        self._vehicle = vehicle
        self._path = folder / f"{vehicle}.state.json"
        self._package_path = folder / f"{vehicle}.mission"
        self._addresses_path = folder / f"{vehicle}.addresses"

    def save(self, snapshot: Snapshot, boot: str = "", serial: int = 0) -> None:
        """Write the snapshot; on return it survives a crash and a loss of power. Raises OSError."""
        _write(self._path, pack(Kept(snapshot, boot, serial), self._vehicle))

    def save_package(self, package: MissionPackage) -> None:
        """Write the mission package. Raises OSError."""
        _write(self._package_path, package.to_bytes())
        _write(self._addresses_path, _bound(package.digest, pack_addresses(package.addresses)))

    def load(self) -> Kept | None:
        """The last saved state; None if there never was one. Raises StateError if the file cannot be trusted."""
        try:
            raw = self._path.read_bytes()
        except FileNotFoundError:
            return None
        except OSError as error:
            raise StateError(f"{self._path}: {error.strerror}") from None
        try:
            return unpack(raw, self._vehicle)
        except ValueError as error:
            raise StateError(f"{self._path}: not to be trusted: {error}") from None

    def load_package(self, digest: bytes) -> MissionPackage | None:
        """The stored mission package if it is the one with this digest."""
        try:
            package = from_bytes(self._package_path.read_bytes())
        except (OSError, MissionError):
            return None
        return package.with_addresses(self._addresses(digest)) if package.digest == digest else None

    def _addresses(self, digest: bytes) -> Addresses:
        """The addresses that came with the package with this digest; none if that is not certain."""
        try:
            with self._addresses_path.open("rb") as stream:
                raw = stream.read(_MOST_ADDRESS_BYTES + 1)
        except OSError:
            return {}
        packed = raw[hashlib.sha256().digest_size :]
        return unpack_addresses(packed) if raw == _bound(digest, packed) else {}


def _bound(digest: bytes, packed: bytes) -> bytes:
    """Addresses with a checksum over them and the digest of their package."""
    return hashlib.sha256(digest + packed).digest() + packed


class _Field(NamedTuple):
    """How a value of the snapshot is read and written. `read` gets the key and the value, and raises ValueError,
    TypeError."""

    read: Callable[[str, Any], Any]
    written: Callable[[Any], object] = lambda value: value


def _optional(read: Callable[[str, Any], Any], key: str, value: object) -> Any:
    return None if value is None else read(key, value)


def _each(read: Callable[[str, Any], Any], key: str, value: object) -> tuple[Any, ...]:
    if not isinstance(value, list):
        raise ValueError(f"{key}: {value!r} must be a list")
    return tuple(read(key, entry) for entry in value)


def _digest(key: str, value: str) -> bytes:
    digest = bytes.fromhex(value)
    if len(digest) not in (0, _DIGEST_BYTES):
        raise ValueError(f"{key}: {len(digest)} bytes, must be {_DIGEST_BYTES}, or none")
    return digest


def _flag(key: str, value: object) -> bool:
    if not isinstance(value, bool):
        raise ValueError(f"{key}: {value!r} must be true or false")
    return value


def _whole(least: int, most: int, key: str, value: object) -> int:
    if type(value) is not int or not least <= value <= most:
        raise ValueError(f"{key}: {value!r} must be a whole number from {least} to {most}")
    return value


def _since(key: str, value: object) -> float:
    """A monotonic time."""
    if type(value) is not float or not isfinite(value):
        raise ValueError(f"{key}: {value!r} must be a time in seconds, or none")
    return value


def _phase(key: str, value: object) -> Phase:
    return Phase(_whole(0, max(Phase), key, value))


def _cause(key: str, word: object) -> Cause:
    if type(word) is not str or word not in {cause.value for cause in Cause}:
        raise ValueError(f"{key}: {word!r} is no cause")
    return Cause(word)


def _lasting(key: str, word: object) -> Cause:
    cause = _cause(key, word)
    if CAUSES[cause].ends is not Ends.WITH_THE_FLIGHT:
        raise ValueError(f"{key}: {word!r} is none that lasts as long as the flight")
    return cause


def _memory(key: str, values: object) -> PackMemory:
    names = [entry.name for entry in fields(PackMemory)]
    if not isinstance(values, dict) or sorted(values) != sorted(names):
        raise ValueError(f"{key}: {values!r} must have {', '.join(names)}")
    return PackMemory(**{name: _optional(_amount, f"{key}: {name}", values[name]) for name in names})


def _amount(key: str, value: object) -> float:
    if type(value) is not float or not 0.0 <= value <= _MOST_AMOUNT:
        raise ValueError(f"{key}: {value!r} must be a number from 0.0 to {_MOST_AMOUNT}, or none")
    return value


def _policy(key: str, word: object) -> str:
    policies = CAUSES[Cause.OUT_OF_COVERAGE].policies
    if type(word) is not str or word not in policies:
        raise ValueError(f"{key}: {word!r} must be one of {', '.join(policies)}")
    return word


_FLAG = _Field(_flag)
_TIME = _Field(partial(_optional, _since))
_DIGEST = _Field(_digest, bytes.hex)
_STATION = partial(_whole, 1, _MAX_SYSID)

#: the fields of the snapshot, in the order of the file
_FIELDS = {
    "owner": _Field(partial(_optional, _STATION)),
    "epoch": _Field(partial(_whole, 0, _MAX_EPOCH)),
    "handover_id": _Field(partial(_whole, 0, 0xFFFF)),
    "phase": _Field(_phase, int),
    "route_at": _Field(lambda _key, value: value),  # judged when the route is known
    "digest": _DIGEST,
    "route": _Field(partial(_each, _STATION)),
    "takeover_allowed": _FLAG,
    "out_of_coverage": _Field(partial(_optional, _policy)),
    "gap_since": _TIME,
    "proven": _FLAG,
    "rehearsal": _FLAG,
    "held_since": _TIME,
    "held_for": _Field(partial(_optional, _cause), lambda cause: None if cause is None else cause.value),
    "stands": _FLAG,
    "lasting": _Field(partial(_each, _lasting), lambda causes: [cause.value for cause in causes]),
    "packs": _Field(partial(_each, _memory), lambda packs: [asdict(memory) for memory in packs]),
    "kept": _FLAG,
    "kept_by": _DIGEST,
}


def _write(path: Path, data: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(path.name + ".new")
    with beside.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    os.replace(beside, path)
    sync_folder(path)
