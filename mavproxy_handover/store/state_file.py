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
import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from math import isfinite
from pathlib import Path
from typing import Any

from mavproxy_handover.core.common.causes import CAUSES, Cause, Ends
from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.core.common.snapshot import PackMemory, Snapshot
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.mission.package import MissionPackage, from_bytes
from mavproxy_handover.store.durable import sync_folder
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
    snapshot = kept.snapshot
    body = {
        "format": _FORMAT,
        "vehicle": vehicle,
        "boot": kept.boot,
        "serial": kept.serial,
        "owner": snapshot.owner,
        "epoch": snapshot.epoch,
        "handover_id": snapshot.handover_id,
        "phase": snapshot.phase.value,
        "route_at": snapshot.route_at,
        "digest": snapshot.digest.hex(),
        "route": list(snapshot.route),
        "takeover_allowed": snapshot.takeover_allowed,
        "out_of_coverage": snapshot.out_of_coverage,
        "gap_since": snapshot.gap_since,
        "proven": snapshot.proven,
        "rehearsal": snapshot.rehearsal,
        "held_since": snapshot.held_since,
        "held_for": None if snapshot.held_for is None else snapshot.held_for.value,
        "stands": snapshot.stands,
        "lasting": [cause.value for cause in snapshot.lasting],
        "packs": [asdict(memory) for memory in snapshot.packs],
        "kept": snapshot.kept,
        "kept_by": snapshot.kept_by.hex(),
    }
    return json.dumps({"body": body, "sha256": _checksum(body)}, indent=1).encode("utf-8")


def unpack(raw: bytes, vehicle: str) -> Kept:
    """Decode what `pack` made. Raises ValueError that says what is wrong."""
    try:
        whole = json.loads(raw)
        body = whole["body"]
        if whole["sha256"] != _checksum(body):
            raise ValueError("its checksum does not fit")
        if body["format"] != _FORMAT or body["vehicle"] != vehicle:
            raise ValueError("it is of another vehicle or version")
        if not isinstance(body["boot"], str):
            raise ValueError(f"boot: {body['boot']!r} must be a text")
        return Kept(_snapshot(body), body["boot"], _whole("serial", body["serial"], 0, (1 << 63) - 1))
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


def _snapshot(body: Mapping[str, Any]) -> Snapshot:
    """Decode the snapshot. Raises ValueError, KeyError, TypeError.

    Nothing is converted: a value of another type than was written is an error.
    """
    route = _list("route", body)
    owner, policy = body["owner"], body["out_of_coverage"]
    return Snapshot(
        owner=None if owner is None else _whole("owner", owner, 1, _MAX_SYSID),
        epoch=_whole("epoch", body["epoch"], 0, _MAX_EPOCH),
        handover_id=_whole("handover_id", body["handover_id"], 0, 0xFFFF),
        phase=Phase(_whole("phase", body["phase"], 0, max(Phase))),
        route_at=_whole("route_at", body["route_at"], 0, len(route)),
        digest=_digest("digest", body),
        route=tuple(_whole("route", station, 1, _MAX_SYSID) for station in route),
        takeover_allowed=_flag("takeover_allowed", body),
        out_of_coverage=None if policy is None else _policy(policy),
        gap_since=_since("gap_since", body["gap_since"]),
        proven=_flag("proven", body),
        rehearsal=_flag("rehearsal", body),
        held_since=_since("held_since", body["held_since"]),
        held_for=None if body["held_for"] is None else _cause("held_for", body["held_for"]),
        stands=_flag("stands", body),
        lasting=tuple(_lasting(word) for word in _list("lasting", body)),
        packs=tuple(_memory(values) for values in _list("packs", body)),
        kept=_flag("kept", body),
        kept_by=_digest("kept_by", body),
    )


def _digest(key: str, body: Mapping[str, Any]) -> bytes:
    digest = bytes.fromhex(body[key])
    if len(digest) not in (0, _DIGEST_BYTES):
        raise ValueError(f"{key}: {len(digest)} bytes, must be {_DIGEST_BYTES}, or none")
    return digest


def _list(key: str, body: Mapping[str, Any]) -> list[Any]:
    value = body[key]
    if not isinstance(value, list):
        raise ValueError(f"{key}: {value!r} must be a list")
    return value


def _flag(key: str, body: Mapping[str, Any]) -> bool:
    value = body[key]
    if not isinstance(value, bool):
        raise ValueError(f"{key}: {value!r} must be true or false")
    return value


def _whole(key: str, value: object, least: int, most: int) -> int:
    if type(value) is not int or not least <= value <= most:
        raise ValueError(f"{key}: {value!r} must be a whole number from {least} to {most}")
    return value


def _since(key: str, value: object) -> float | None:
    """A monotonic time, or none."""
    if value is not None and (type(value) is not float or not isfinite(value)):
        raise ValueError(f"{key}: {value!r} must be a time in seconds, or none")
    return value


def _cause(key: str, word: object) -> Cause:
    if type(word) is not str or word not in {cause.value for cause in Cause}:
        raise ValueError(f"{key}: {word!r} is no cause")
    return Cause(word)


def _lasting(word: object) -> Cause:
    cause = _cause("lasting", word)
    if CAUSES[cause].ends is not Ends.WITH_THE_FLIGHT:
        raise ValueError(f"lasting: {word!r} is none that lasts as long as the flight")
    return cause


def _memory(values: object) -> PackMemory:
    names = [entry.name for entry in fields(PackMemory)]
    if not isinstance(values, dict) or sorted(values) != sorted(names):
        raise ValueError(f"packs: {values!r} must have {', '.join(names)}")
    return PackMemory(**{name: _amount(name, values[name]) for name in names})


def _amount(key: str, value: object) -> float | None:
    """An amount, or None."""
    if value is not None and (type(value) is not float or not 0.0 <= value <= _MOST_AMOUNT):
        raise ValueError(f"packs: {key}: {value!r} must be a number from 0.0 to {_MOST_AMOUNT}, or none")
    return value


def _policy(word: object) -> str:
    policies = CAUSES[Cause.OUT_OF_COVERAGE].policies
    if type(word) is not str or word not in policies:
        raise ValueError(f"out_of_coverage: {word!r} must be one of {', '.join(policies)}")
    return word


def _checksum(body: object) -> str:
    return hashlib.sha256(json.dumps(body, sort_keys=True).encode("utf-8")).hexdigest()


def _write(path: Path, data: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(path.name + ".new")
    with beside.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    os.replace(beside, path)
    sync_folder(path)
