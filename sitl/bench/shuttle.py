# SPDX-License-Identifier: GPL-3.0-or-later

"""An aircraft that is moved from zone to zone, so that transfers follow each other quickly; and its files.

It stands in the zone of the commander only, then in the region that both zones share. When the lease names the other
station, it stands in that one's zone only; then back. Each entry into the region is one transfer.
"""

from __future__ import annotations

import time
from pathlib import Path
from random import Random
from typing import Any

from mavproxy_handover.cli.keys import GROUND
from mavproxy_handover.tools.resources import shipped
from sitl.bench.autopilot import FakeAutopilot
from sitl.bench.rig import key_file, toml
from sitl.bench.traffic import VEHICLE, Place

__all__ = ["A", "B", "Shuttle", "Wires", "write_files"]

A, B = 251, 252
#: places in the delivery mission: zone of the station alone, and the region of both
_ALONE = {A: Place(52.6790, 5.9240), B: Place(52.6790, 5.9310)}
_REGION = Place(52.6790, 5.9255)
#: an entry without a transfer is given up after this time (s), and the region is entered again
_GIVE_UP_S = 60.0


class Shuttle:
    """Moves one autopilot's place. `pause_s`: between a commit and the next entry, about; a fifth more or less."""

    def __init__(self, autopilot: FakeAutopilot, pause_s: float, seed: int) -> None:
        self.autopilot = autopilot
        self.commits = 0
        #: entries that led to no commit
        self.given_up = 0
        self._pause_s = pause_s
        self._luck = Random(seed)
        self._from = A
        self._inside = False
        self._next_at = 0.0

    def step(self) -> None:
        """To be called often, once the aircraft is in the air."""
        now = time.monotonic()
        if not self._inside:
            if now >= self._next_at:
                self._inside = True
                self.autopilot.place = _REGION
                self._next_at = now + _GIVE_UP_S
            return
        commander = self.autopilot.commander
        committed = commander not in (None, self._from) and not self.autopilot.in_transfer
        if not committed and now < self._next_at:
            return
        if committed and commander in _ALONE:
            self._from = commander
            self.commits += 1
        else:
            self.given_up += 1
        self._inside = False
        self.autopilot.place = _ALONE[self._from]
        self._next_at = now + self._pause_s * self._luck.uniform(0.8, 1.2)


class Wires:
    """Files of one vehicle with two stations, and the journals that they will write."""

    def __init__(self, folder: Path) -> None:
        self.companion = folder / "companion" / "handover.toml"
        self.stations = {A: folder / "GCSA" / "station.toml", B: folder / "GCSB" / "station.toml"}

    @property
    def journals(self) -> tuple[Path, Path, Path]:
        """Companion's, GCSA's, GCSB's."""
        return (
            self.companion.with_name("companion.jsonl"),
            self.stations[A].with_name("GCSA.jsonl"),
            self.stations[B].with_name("GCSB.jsonl"),
        )


def write_files(
    folder: Path,
    vehicle_to: dict[int, int],
    ground_listen: dict[int, int],
    ground_to: dict[int, int],
    *,
    signing: bool = False,
) -> Wires:
    """Write the configurations; arguments: system id of a station -> UDP port of 127.0.0.1.

    `vehicle_to`: where the companion sends to for a station; `ground_listen`: where a station's ground link listens;
    `ground_to`: where the other one sends to. `signing`: with a key for each station. Raises OSError, KeysError.
    """
    names = {A: "GCSA", B: "GCSB"}
    wires = Wires(folder)
    keys = {sysid: {"key": str(key_file(folder / "keys", name))} if signing else {} for sysid, name in names.items()}
    ground_key = key_file(folder / "keys", GROUND) if signing else None
    vehicle: dict[str, Any] = {
        "vehicle": {
            "name": "drone-1",
            "sysid": VEHICLE,
            "parent": "GCSA",
            "journal": "companion.jsonl",
            "guard": False,
            "allow_unsigned": not signing,
        },
        "station": [
            {"name": name, "sysid": sysid, "links": [f"udpout:127.0.0.1:{vehicle_to[sysid]}"], **keys[sysid]}
            for sysid, name in names.items()
        ],
        # one transfer after the other, and a commander that is not heard for a while is no reason to fly home
        "limits": {"dwell_s": 0.0},
        "policy": {"out_of_coverage": "warn", "commander_lost": "warn"},
    }
    _put(wires.companion, vehicle)
    for sysid, name in names.items():
        other = B if sysid == A else A
        station: dict[str, Any] = {"name": name, "sysid": sysid, "vehicle": VEHICLE, "journal": f"{name}.jsonl"}
        station |= keys[sysid]
        if sysid == A:
            station["mission"] = str(shipped("missions") / "delivery")
        peer = {"name": names[other], "sysid": other, "link": f"udpout:127.0.0.1:{ground_to[other]}"}
        ground: dict[str, Any] = {"listen": f"udpin:127.0.0.1:{ground_listen[sysid]}"}
        ground |= {"key": str(ground_key)} if ground_key is not None else {"allow_unsigned": True}
        _put(wires.stations[sysid], {"station": station, "ground": ground, "peer": [peer]})
    return wires


def _put(path: Path, tables: dict[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(toml(tables), encoding="utf-8")
