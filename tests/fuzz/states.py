# SPDX-License-Identifier: GPL-3.0-or-later

"""What outlives a restart, driven by bytes: state file, its copy in memory, stored package, its addresses of the
vehicle and replay state after any damage.

A plan's first byte says how the rest is meant: as a whole file, as damage to a good one, or as other values in a good
one, under a checksum that fits. Only what any caller may use is used. What must hold:

* `StateFile.load` gives what was kept, None, or StateError with a line; so does the copy in memory, with ValueError;
* a snapshot has the numbers that its messages can carry, each of its own kind, and an arbiter goes on from it;
* `load_package` gives the package of the digest that was asked for, or none; with the addresses that were saved, or
  none;
* `ReplayStore.load` never raises, and whatever it read, what was signed long ago stays refused.
"""

from __future__ import annotations

import atexit
import hashlib
import json
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.arbiter import Arbiter, Identity
from mavproxy_handover.core.common.causes import Cause
from mavproxy_handover.core.common.events import Tick
from mavproxy_handover.core.common.model import GuardState, Phase, Reason, Station
from mavproxy_handover.core.common.snapshot import PackMemory, Snapshot
from mavproxy_handover.mission import package as packages
from mavproxy_handover.store.memory import Condition, Slots
from mavproxy_handover.store.replay import ReplayStore
from mavproxy_handover.store.state_file import Kept, StateError, StateFile, pack, unpack
from mavproxy_handover.wire import codec
from mavproxy_handover.wire.frames import Frame, parse_one
from mavproxy_handover.wire.signing import SignatureVerdict, SignedPeer, sign
from mavproxy_handover.wire.status import authority_status
from mavproxy_handover.wire.vehicle_address import VehicleAddress
from tests.fuzz.reader import Reader

__all__ = ["KINDS", "Files", "check", "place_of", "run", "sealed", "seeds"]

#: how the bytes of a plan are meant
RAW, DAMAGED, VALUES = 0, 1, 2
KINDS: Final = ("state", "replay", "package", "memory", "addresses")
VEHICLE: Final = "drone-1"
KEY: Final = bytes(range(32))
STATIONS: Final = (Station(251, "GCSA"), Station(252, "GCSB"))
#: 2026-11-20 00:00 UTC, and the stamp of a frame that was signed a day before
UTC_S: Final = 1_795_132_800.0
LONG_AGO: Final = 37_506_240_000_000 - 86_400 * 100_000
ADDRESSES: Final = {251: (VehicleAddress("10.8.0.2", 14550),), 252: (VehicleAddress("10.9.0.2", 14551),)}
PACKAGE: Final = packages.load(Path(__file__).resolve().parents[2] / "missions" / "linear").with_addresses(ADDRESSES)
PACKS: Final = (PackMemory(59.0, 1.0, 60.0, 0.02),)
GOOD: Final = Snapshot(
    251, 4, 7, Phase.ON_MISSION, 2, PACKAGE.digest, (251, 252, 251), True, "land", lasting=(Cause.ENERGY,), packs=PACKS
)


class Files:
    """The folder of a vehicle that flew, with good files in it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.store = StateFile(folder, VEHICLE)
        self.store.save(GOOD, "boot", 7)
        (self.state,) = folder.iterdir()
        self.store.save_package(PACKAGE)
        self.package, self.addresses = folder / f"{VEHICLE}.mission", folder / f"{VEHICLE}.addresses"
        self.replay = folder / "replay.json"
        self.memory = folder / "state.now"
        slots = Slots(self.memory)
        slots.write(pack(Kept(GOOD, "boot", 8), VEHICLE), 8)
        slots.close()
        peer = self.heard()
        assert peer.check(frame(LONG_AGO), UTC_S - 86_400.0, 1.0) is SignatureVerdict.OK
        self._replay_store.close()
        #: what the last plan wrote
        self.spoilt: Path | None = None
        #: in the order of `KINDS`
        self.paths = (self.state, self.replay, self.package, self.memory, self.addresses)
        self.good = {path: path.read_bytes() for path in self.paths}

    def heard(self) -> SignedPeer:
        """A station's key as the next run has it."""
        self._replay_store, peer = ReplayStore(self.replay), SignedPeer(KEY)
        #: what was wrong with the file
        self.note = self._replay_store.load(UTC_S)
        assert self.note.isprintable()
        self._replay_store.attach("GCSA", peer)
        return peer

    def restore(self) -> None:
        for path in self.folder.iterdir():
            if path not in self.good:
                path.unlink() if path.is_file() else shutil.rmtree(path)
        if self.spoilt is not None:
            self.spoilt.write_bytes(self.good[self.spoilt])


def frame(stamp: int) -> Frame:
    """A signed heartbeat of GCSA."""
    plain = bytes(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(mavlink.MAVLink(None, 251, 190)))
    found = parse_one(sign(plain, KEY, 1, stamp) or b"")
    assert found is not None
    return found


def sealed(whole: dict[str, Any], part: str) -> bytes:
    """A file whose checksum over `part` fits, whatever that is."""
    text = json.dumps(whole[part], sort_keys=True)
    return json.dumps({**whole, "sha256": hashlib.sha256(text.encode()).hexdigest()}).encode()


def _value(reader: Reader, depth: int = 0) -> Any:
    """Any value that JSON has."""
    what = reader.byte() % 10
    if what == 0:
        return [None, True, False][reader.byte() % 3]
    if what in (1, 2, 3):
        return int.from_bytes(reader.take(reader.byte() % 10), "little", signed=what == 1)
    if what == 4:  # about the limits
        return (1 << [0, 1, 8, 16, 32, 48, 64, 400][reader.byte() % 8]) - 2 + reader.byte() % 4
    if what == 5:
        return [0.5, -0.0, 4.0, 1e308, float("inf"), float("nan")][reader.byte() % 6]
    if what == 6:
        return reader.counted().decode("latin-1")
    if what == 7:
        return reader.counted().hex()
    if depth > 3:
        return []
    values = [_value(reader, depth + 1) for _ in range(reader.byte() % 5)]
    return values if what == 8 else {str(number): value for number, value in enumerate(values)}


def _change(reader: Reader, table: dict[str, Any]) -> None:
    """Other values under some keys; keys that are gone, keys that are new."""
    while reader.more():
        names = [*sorted(table), "more"]
        name = names[reader.byte() % len(names)]
        if isinstance(table.get(name), dict) and reader.byte() % 2:
            _change(reader, table[name])
        elif reader.byte() % 16 == 0:
            table.pop(name, None)
        else:
            table[name] = _value(reader)


def _damaged(reader: Reader, data: bytes) -> bytes:
    found = bytearray(data)
    while reader.more() and found:
        place = (reader.byte() << 8 | reader.byte()) % len(found)
        what = reader.byte() % 4
        if what == 0:
            found[place] ^= reader.byte()
        elif what == 1:
            del found[place:]
        elif what == 2:
            del found[place : place + reader.byte()]
        else:
            found[place:place] = reader.counted()
    return bytes(found)


def _check_kept(kept: Kept) -> None:
    assert type(kept.boot) is str
    assert type(kept.serial) is int
    assert kept.serial >= 0
    check(kept.snapshot)


def _read_memory(path: Path) -> None:
    """The copy in memory, as the keeper reads it."""
    slots = Slots(path)
    if slots.condition is Condition.HELD:
        with suppress(ValueError):
            _check_kept(unpack(slots.record, VEHICLE))
    slots.close()


def place_of(name: str) -> int:
    """The number of a value among those of the state file."""
    files = _files()
    return sorted(json.loads(files.good[files.state])["body"]).index(name)


def check(snapshot: Snapshot) -> None:
    """A snapshot that was read can be gone on from, and told."""
    assert snapshot.owner is None or (type(snapshot.owner) is int and 1 <= snapshot.owner <= 255)
    assert type(snapshot.epoch) is int
    assert 0 <= snapshot.epoch <= 0xFFFFFFFF
    assert type(snapshot.handover_id) is int
    assert 0 <= snapshot.handover_id <= 0xFFFF
    assert type(snapshot.phase) is Phase
    assert len(snapshot.digest) in (0, 32)
    assert type(snapshot.route_at) is int
    assert 0 <= snapshot.route_at <= len(snapshot.route)
    assert all(type(station) is int and 1 <= station <= 255 for station in snapshot.route)
    assert type(snapshot.takeover_allowed) is bool
    assert type(snapshot.proven) is bool
    assert snapshot.out_of_coverage is None or snapshot.out_of_coverage in ("return", "land", "warn")
    arbiter = Arbiter(Identity("drone", STATIONS, 251), restored=snapshot)
    for now in (0.0, 30.0):
        arbiter.handle(Tick(), now)
    view = arbiter.view
    assert view.commander is None
    status = authority_status(view, 0, GuardState.SILENT, Reason.RESTARTED)
    assert codec.pack(status, mavlink.MAVLink(None, 1, 191))


def seeds() -> Iterator[bytes]:
    """Each way of damage to each file."""
    yield bytes([RAW, 0]) + sealed({"body": {"format": 1, "vehicle": VEHICLE}}, "body")
    yield bytes([RAW, 1]) + b'{"format": "handover replay state 1"}'
    yield bytes([RAW, 2]) + PACKAGE.to_bytes()[:200]
    for kind in range(len(KINDS)):
        yield bytes([DAMAGED, kind, 0, 30, 0, 1])
        yield bytes([DAMAGED, kind, 0, 90, 1])
        for name in range(16):
            for what in range(10):
                yield bytes([VALUES, kind, name, 1, 1, what, 4, 2, 1, 1, 1])


@cache
def _files() -> Files:
    """A folder that is used again and again, and is gone with the process."""
    folder = tempfile.mkdtemp(prefix="handover-fuzz-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Files(Path(folder))


def run(plan: bytes) -> Snapshot | None:
    """Carry a plan out; any exception is a finding. What was recovered."""
    files = _files()
    files.restore()
    reader = Reader(plan)
    how, kind = reader.byte() % 3, reader.byte() % len(KINDS)
    path = files.paths[kind]
    good = files.good[path]
    if how == RAW:
        data = plan[2:]
    elif how == DAMAGED or path not in (files.state, files.replay):
        data = _damaged(reader, good)
    else:
        whole = json.loads(good)
        part = "body" if path == files.state else "stamps"
        _change(reader, whole[part])
        try:
            data = sealed(whole, part)
        except ValueError:  # Python writes no number of thousands of digits
            data = good
    path.write_bytes(data)
    files.spoilt = path
    return _read(files)


def _read(files: Files) -> Snapshot | None:
    kept, line = None, ""
    try:
        kept = files.store.load()
    except StateError as error:
        line = str(error)
    assert line.isprintable()
    snapshot = None if kept is None else kept.snapshot
    if kept is not None:
        _check_kept(kept)
    if files.spoilt == files.memory:
        _read_memory(files.memory)
    for digest in (PACKAGE.digest, bytes(32)) if files.spoilt in (files.package, files.addresses) else ():
        package = files.store.load_package(digest)
        assert package is None or package.digest == digest
        assert package is None or package.addresses in (ADDRESSES, {})
    peer = files.heard()
    if files.note or files.replay.read_bytes() == files.good[files.replay]:  # with a clock that says nothing
        assert peer.check(frame(LONG_AGO), 0.0, 1.0) is SignatureVerdict.TOO_OLD
    return snapshot
