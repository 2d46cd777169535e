# SPDX-License-Identifier: GPL-3.0-or-later

"""The state file: the snapshot of authority and the mission package, written so that a crash leaves the old or the new.

Rules
-----
* Written to a file beside it, synchronised, then renamed: never half.
* A checksum over everything: what does not fit is not guessed at. A file that is there but cannot be trusted says so
  (`StateError`); the companion then starts without authority, which in flight means the way home.
* The mission package has a file of its own, named by its digest, because it is large and seldom changes.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mavproxy_handover.core.model import FlightAction, Phase
from mavproxy_handover.core.snapshot import Snapshot
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.mission.package import MissionPackage, from_bytes
from mavproxy_handover.store.durable import sync_folder

__all__ = ["StateError", "StateStore", "recall"]

_FORMAT = 1
_MAX_SYSID = 255
_DIGEST_BYTES = 32


class StateError(Exception):
    """There is a state file and it cannot be trusted; one line for people."""


class StateStore:
    """Keeps one vehicle's state in `folder`."""

    def __init__(self, folder: Path, vehicle: str) -> None:
        self._folder = folder
        self._vehicle = vehicle
        self._path = folder / f"{vehicle}.state.json"
        self._package_path = folder / f"{vehicle}.mission"

    def save(self, snapshot: Snapshot) -> None:
        """Write the snapshot; on return it survives a crash and a loss of power. Raises OSError."""
        body = {
            "format": _FORMAT,
            "vehicle": self._vehicle,
            "owner": snapshot.owner,
            "epoch": snapshot.epoch,
            "handover_id": snapshot.handover_id,
            "phase": snapshot.phase.value,
            "route_at": snapshot.route_at,
            "digest": snapshot.digest.hex(),
            "route": list(snapshot.route),
            "takeover_allowed": snapshot.takeover_allowed,
            "out_of_coverage": snapshot.out_of_coverage,
        }
        text = json.dumps({"body": body, "sha256": _checksum(body)}, indent=1)
        _write(self._path, text.encode("utf-8"))

    def save_package(self, package: MissionPackage) -> None:
        """Write the mission package. Raises OSError."""
        _write(self._package_path, package.to_bytes())

    def load(self) -> Snapshot | None:
        """The last snapshot; None if there never was one. Raises StateError if there is one that cannot be trusted."""
        try:
            raw = self._path.read_bytes()
        except FileNotFoundError:
            return None
        except OSError as error:
            raise StateError(f"{self._path}: {error.strerror}") from None
        try:
            whole = json.loads(raw)
            body = whole["body"]
            if whole["sha256"] != _checksum(body):
                raise ValueError("its checksum does not fit")
            if body["format"] != _FORMAT or body["vehicle"] != self._vehicle:
                raise ValueError("it is of another vehicle or version")
            return _snapshot(body)
        except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
            raise StateError(f"{self._path}: not to be trusted: {error}") from None

    def load_package(self, digest: bytes) -> MissionPackage | None:
        """The stored mission package if it is the one with this digest."""
        try:
            package = from_bytes(self._package_path.read_bytes())
        except (OSError, MissionError):
            return None
        return package if package.digest == digest else None

    def clear(self) -> None:
        """Forget the snapshot: what it says is not true any more, and nothing is to be recovered. Raises OSError."""
        self._path.unlink(missing_ok=True)
        sync_folder(self._path)


def recall(store: StateStore | None) -> tuple[Snapshot | None, str]:
    """What the run before left behind, and why nothing could be recalled where something should have been."""
    if store is None:
        return None, ""
    try:
        return store.load(), ""
    except StateError as error:
        return None, str(error)


def _snapshot(body: Mapping[str, Any]) -> Snapshot:
    """Raises ValueError, KeyError, TypeError. Nothing is converted: what is not what was written is none of ours."""
    route = body["route"]
    if not isinstance(route, list):
        raise ValueError(f"route: {route!r} must be a list")
    digest = bytes.fromhex(body["digest"])
    if len(digest) not in (0, _DIGEST_BYTES):
        raise ValueError(f"digest: {len(digest)} bytes, must be {_DIGEST_BYTES}, or none")
    takeover_allowed = body["takeover_allowed"]
    if not isinstance(takeover_allowed, bool):
        raise ValueError(f"takeover_allowed: {takeover_allowed!r} must be true or false")
    owner, policy = body["owner"], body["out_of_coverage"]
    return Snapshot(
        owner=None if owner is None else _whole("owner", owner, 1, _MAX_SYSID),
        epoch=_whole("epoch", body["epoch"], 0, 0xFFFFFFFF),
        handover_id=_whole("handover_id", body["handover_id"], 0, 0xFFFF),
        phase=Phase(_whole("phase", body["phase"], 0, max(Phase))),
        route_at=_whole("route_at", body["route_at"], 0, len(route)),
        digest=digest,
        route=tuple(_whole("route", station, 1, _MAX_SYSID) for station in route),
        takeover_allowed=takeover_allowed,
        out_of_coverage=None if policy is None else FlightAction(_whole("out_of_coverage", policy, 0, 0xFF)),
    )


def _whole(key: str, value: object, least: int, most: int) -> int:
    if type(value) is not int or not least <= value <= most:
        raise ValueError(f"{key}: {value!r} must be a whole number from {least} to {most}")
    return value


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
