# SPDX-License-Identifier: GPL-3.0-or-later

"""What must outlive a restart so that old signed frames stay refused, and ours are not: one stamp for each key, and one
for what the autopilot was sent.

Rules that live here:

1. Everything up to the stamp is old after a restart (`wire.signing`, rule 9). What is written is a little ahead of what
   was accepted, so that nothing accepted after the last write is accepted again after a crash.
   The same lead keeps our own stamps above those that the autopilot has had.
2. A file that cannot be read shuts nobody out for good and lets nothing old in: everything signed before now is
   refused, and a note says so. A missing file is a first start: then the clock alone says what is new.
3. A copy in memory-backed storage is written before the one on the disk. Within a boot it is the newer one: a disk that
   is full, or a file that is gone, lets nothing old in.
4. Neither reading nor writing raises or waits for the disk in the main loop: the lease goes out from there.
"""

from __future__ import annotations

import hashlib
import json
import os
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, Final

from mavproxy_handover.store.background_writer import CLOSE_S, Behind
from mavproxy_handover.store.durable import discard, replace_whole, sync_folder
from mavproxy_handover.wire.signing import MAX_TIMESTAMP, UNITS_PER_S, SignedPeer, timestamp_of

__all__ = ["ReplayStore"]

_FORMAT: Final = "handover replay state 1"

#: peer -> fingerprint of a key -> stamp
_Stamps = dict[str, dict[str, int]]


class ReplayStore:
    """The replay state of all peers in one file: load, attach each peer, tick from the main loop, close.

    A write happens beside the main loop: waiting for a disk there would hold up the lease. How often follows from the
    stamps: when those accepted have used up half of the `reserve_s` that the file is ahead, but never sooner than
    `interval_s` after the last write; while nobody sends, nothing is written. After a crash what is signed within the
    reserve is refused, so a station is heard again at most `reserve_s` after its last frame, or as soon as it heard us.
    """

    def __init__(
        self, path: Path, reserve_s: float = 4.0, interval_s: float = 1.0, *, memory: Path | None = None
    ) -> None:
        """`memory`: the file's copy in memory-backed storage, None where there is none."""
        self.path = path
        self._memory = memory
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
        self._behind = Behind("replay-state")

    def load(self, now_utc_s: float, *, first: bool = True) -> str:
        """Read the file; returns what is to be said of it (`note`). Never raises.

        `first` False: it is a restart, so there was a file.
        """
        newer = self._in_memory()
        if newer is not None:
            self._written = newer
            return self.note
        try:
            data = self.path.read_bytes()
        except FileNotFoundError as error:
            if not first:
                return self._lost(error.strerror or str(error), now_utc_s)
            self.note = f"{self.path}: no replay state yet; signed frames are accepted if they are new by the clock"
            return self.note
        except OSError as error:
            return self._lost(error.strerror or str(error), now_utc_s)
        try:
            self._written = _unpack(data)
        except (ValueError, RecursionError) as error:
            return self._lost(str(error), now_utc_s)
        return self.note

    def _in_memory(self) -> _Stamps | None:
        """The copy in memory; None if there is none that can be used."""
        try:
            return None if self._memory is None else _unpack(self._memory.read_bytes())
        except (OSError, ValueError, RecursionError):
            return None

    def attach(self, name: str, peer: SignedPeer) -> None:
        """Give `peer` what is known of its keys, and keep its state from now on. Before its first frame."""
        peer.restore(self._written.get(name, {}), self._floor)
        self._peers[name] = peer
        self._attached[name] = peer.state()

    def tick(self, now_s: float) -> None:
        """Write if it is time to. Returns at once."""
        if now_s < self._not_before_s or not self._behind.idle or not self._due():
            return
        self._not_before_s = now_s + self._interval_s
        self._behind.put("stamps", partial(self._write, self._stamps(self._reserve)))

    def settle(self, within_s: float) -> bool:
        """Wait, so long at most, until the write that is under way is done; whether it is."""
        return self._behind.settle(within_s)

    def close(self, within_s: float = CLOSE_S) -> bool:
        """Write the state as it is, and wait for that, so long at most; whether it is done. Then the store is over.

        A write that is under way is waited for as well, lest that one comes last.
        """
        if self._peers:
            self._behind.put("stamps", partial(self._write, self._stamps(0), last=True))
        return self._behind.close(within_s)

    def _lost(self, why: str, now_utc_s: float) -> str:
        """The state cannot be had. What the file's own time says may be later than a clock that is not set yet."""
        self._floor = timestamp_of(now_utc_s)
        with suppress(OSError):
            self._floor = max(self._floor, timestamp_of(self.path.stat().st_mtime))
        kept = self.path.with_name(self.path.name + ".damaged")
        self.note = f"{self.path}: replay state cannot be read ({why}); what was signed before now is refused"
        with suppress(OSError):  # linked, not moved: were it missing at a start before the next write, all would be new
            discard(kept)
            os.link(self.path, kept)
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

    def _write(self, stamps: _Stamps, *, last: bool = False) -> None:
        data = _pack(stamps)
        if self._memory is not None:
            try:
                replace_whole(self._memory, data, sync=False)
            except OSError:  # an older copy must not count before a newer file
                discard(self._memory)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            replace_whole(self.path, data)
        except OSError as error:
            self.errors += 1
            self.note = f"{self.path}: replay state cannot be written ({error.strerror})"
            return
        sync_folder(self.path)
        self._written = stamps
        if last and self._memory is not None:  # the file has everything
            discard(self._memory)


def _pack(stamps: _Stamps) -> bytes:
    body = json.dumps(stamps, sort_keys=True)
    digest = hashlib.sha256(body.encode("ascii")).hexdigest()
    return json.dumps({"format": _FORMAT, "sha256": digest, "stamps": stamps}, sort_keys=True).encode("ascii") + b"\n"


def _unpack(data: bytes) -> _Stamps:
    """What `_pack` wrote. Raises ValueError that says what is wrong."""
    try:
        content: Any = json.loads(data)
    except (ValueError, RecursionError):
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
