# SPDX-License-Identifier: GPL-3.0-or-later

"""Replay protection across restarts: a stamp for each key, and one for the frames that the autopilot was sent.

Rules that live here:

1. After a restart every frame up to the stamp is old (`wire.signing`, rule 9). The written stamp is a little ahead of
   the last accepted frame. So no frame that was accepted after the last write is accepted again after a crash. The same
   lead keeps our own stamps above those that the autopilot has received.
2. If a file cannot be read, everything signed before now is refused, and a note says so. So no old frame is accepted,
   and no station is excluded permanently. A missing file means a first start: then only the clock says what is new.
3. A copy in memory-backed storage is written before the one on the disk. Within a boot it is the newer one. So a full
   disk or a missing file does not let old frames in.
4. Reading and writing never raise, and never wait for the disk in the main loop, which sends the lease.
"""

from __future__ import annotations

import json
import os
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, Final

from mavproxy_handover.store.background_writer import CLOSE_S, BackgroundWriter
from mavproxy_handover.store.durable import checksum, discard, replace_whole, sync_folder
from mavproxy_handover.wire.signing import MAX_TIMESTAMP, UNITS_PER_S, SignedPeer, timestamp_of

__all__ = ["ReplayStore"]

_FORMAT: Final = "handover replay state 1"

#: peer -> fingerprint of a key -> stamp
_Stamps = dict[str, dict[str, int]]


class ReplayStore:
    """The replay state of all peers in one file. Use: load, attach each peer, tick from the main loop, close.

    A thread writes the file, because waiting for a disk would delay the lease. A write is due when the accepted stamps
    have used up half of the `reserve_s` by which the file is ahead. It comes at most every `interval_s`. If no frame
    arrives, nothing is written.

    After a crash frames that were signed within the reserve are refused. So a station is heard again at most
    `reserve_s` after its last frame, or as soon as it has heard us.
    """

    def __init__(
        self, path: Path, reserve_s: float = 4.0, interval_s: float = 1.0, *, memory: Path | None = None
    ) -> None:
        """`memory`: path of the copy in memory-backed storage, None if there is none."""
        self.path = path
        self._memory = memory
        #: problem with the file, "" if there is none
        self.note = ""
        #: number of failed writes
        self.errors = 0
        self._reserve = int(reserve_s * UNITS_PER_S)
        self._interval_s = interval_s
        self._floor = 0
        self._written: _Stamps = {}
        self._peers: dict[str, SignedPeer] = {}
        self._attached: _Stamps = {}
        self._not_before_s = float("-inf")
        self._writer = BackgroundWriter("replay-state")

    def load(self, now_utc_s: float, *, first: bool = True) -> str:
        """Read the file; returns its problem (`note`). Never raises.

        `first` False: this is a restart, so the file must exist.
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
        """The copy in memory; None if there is no valid one."""
        try:
            return None if self._memory is None else _unpack(self._memory.read_bytes())
        except (OSError, ValueError, RecursionError):
            return None

    def attach(self, name: str, peer: SignedPeer) -> None:
        """Restore the state of the keys of `peer`, and save it from now on. Call this before its first frame."""
        peer.restore(self._written.get(name, {}), self._floor)
        self._peers[name] = peer
        self._attached[name] = peer.state()

    def tick(self, now_s: float) -> None:
        """Write if a write is due. Returns at once."""
        if now_s < self._not_before_s or not self._writer.idle or not self._due():
            return
        self._not_before_s = now_s + self._interval_s
        self._writer.put("stamps", partial(self._write, self._stamps(self._reserve)))

    def wait_until_written(self, within_s: float) -> bool:
        """Wait at most `within_s` until the current write is done. Returns True if it is."""
        return self._writer.wait_until_written(within_s)

    def close(self, within_s: float = CLOSE_S) -> bool:
        """Write the state, and wait for it at most `within_s`. Returns True if it is written. No call may follow.

        It waits for a current write too, because that one must not come last.
        """
        if self._peers:
            self._writer.put("stamps", partial(self._write, self._stamps(0), last=True))
        return self._writer.close(within_s)

    def _lost(self, why: str, now_utc_s: float) -> str:
        """Refuse everything signed before now, because the state cannot be read.

        The file's own time may be later than a clock that is not set yet; the later one counts.
        """
        self._floor = timestamp_of(now_utc_s)
        with suppress(OSError):
            self._floor = max(self._floor, timestamp_of(self.path.stat().st_mtime))
        kept = self.path.with_name(self.path.name + ".damaged")
        self.note = f"{self.path}: replay state cannot be read ({why}); what was signed before now is refused"
        # linked, not moved: if the file were missing at a start before the next write, old frames would count as new
        with suppress(OSError):
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
        """Stamps to write, ahead by `reserve` for keys whose frames arrived. Peers that are not attached keep their old
        stamps.
        """
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
            except OSError:  # an older copy must not take precedence over a newer file
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
        if last and self._memory is not None:  # the file is complete
            discard(self._memory)


def _pack(stamps: _Stamps) -> bytes:
    content = {"format": _FORMAT, "sha256": checksum(stamps), "stamps": stamps}
    return json.dumps(content, sort_keys=True).encode("ascii") + b"\n"


def _unpack(data: bytes) -> _Stamps:
    """Parse what `_pack` wrote. Raises ValueError that says what is wrong."""
    try:
        content: Any = json.loads(data)
    except (ValueError, RecursionError):
        raise ValueError("it is cut or no JSON") from None
    if not isinstance(content, dict) or content.get("format") != _FORMAT:
        raise ValueError(f"it is not in the form {_FORMAT!r}")
    stamps = content.get("stamps")
    if content.get("sha256") != checksum(stamps):
        raise ValueError("its checksum is wrong")
    if not isinstance(stamps, dict) or not all(_is_peer(entry) for entry in stamps.values()):
        raise ValueError("it holds something else than stamps")
    return stamps


def _is_peer(entry: Any) -> bool:
    return isinstance(entry, dict) and all(
        isinstance(stamp, int) and not isinstance(stamp, bool) and 0 <= stamp <= MAX_TIMESTAMP
        for stamp in entry.values()
    )
