# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover keys bundle`: one archive with what one station needs, and no more.

In it are the station's configuration, the keys that this configuration names, and its mission package, if that lies
beside the configuration. Rules:

1. Only the station's own keys and the key of the ground link go in: NAME.key, or NAME-VEHICLE.key for one of several
   vehicles. The key of another station, of the guard or of the autopilot is refused, also if the configuration names
   it.
2. A rotation that is under way is left out: the archive has the new key.
3. Of a mission's folder only the mission's own files go in: other things may lie beside them, bundles of other
   stations and copies of keys among them.
4. The archive is readable by its owner alone, and replaces no other file. Its folders unpack with mode 0700.
"""

from __future__ import annotations

import io
import os
import tarfile
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Final, NamedTuple

from mavproxy_handover.config.files import ConfigError
from mavproxy_handover.config.station import StationConfig, load_station
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.mission.package import file_names
from mavproxy_handover.store.keys import KeysError, load_key

__all__ = ["Entry", "make_bundle"]

GROUND: Final = "ground"


class Entry(NamedTuple):
    """A file of the archive: its name there, its contents, its mode."""

    name: str
    content: bytes
    mode: int


def make_bundle(station: str, config: Path, out: Path) -> list[Entry]:
    """Write the archive of this station. Returns what is in it. Raises KeysError, ConfigError, OSError."""
    config = config.expanduser().resolve()
    loaded = load_station(config)
    if loaded.station.name != station:
        raise KeysError(f"{config}: is the configuration of {loaded.station.name}, not of {station}")
    entries = [Entry(f"{station}/{config.name}", config.read_bytes(), 0o640)]
    entries += _keys(station, loaded, config)
    entries += _missions(station, loaded, config)
    _write(out, entries)
    return entries


def _keys(station: str, loaded: StationConfig, config: Path) -> Iterator[Entry]:
    names = {station} | {f"{station}-{vehicle.name}" for vehicle in loaded.vehicles}
    own = {Path(os.path.normpath(vehicle.key)) for vehicle in loaded.vehicles if vehicle.key is not None}
    ground = None if loaded.ground_key is None else Path(os.path.normpath(loaded.ground_key))
    for key in sorted(own | ({ground} if ground is not None else set())):
        allowed = key.stem == GROUND if key == ground else key.stem in names
        if not allowed:
            whose = "the ground link" if key == ground else station
            raise KeysError(f"{key}: is not named after {whose}: nothing written. A bundle has no other station's key")
        load_key(key)
        yield Entry(f"{station}/{_beside(key, config)}", key.read_bytes(), 0o600)


def _missions(station: str, loaded: StationConfig, config: Path) -> Iterator[Entry]:
    for mission in sorted({vehicle.mission for vehicle in loaded.vehicles if vehicle.mission is not None}):
        folder = Path(os.path.normpath(mission))
        try:
            names = file_names(folder)
        except MissionError as error:
            raise ConfigError(f"{error}. Nothing was written: see 'handover check {folder}'") from None
        for file in (folder / name for name in sorted(names)):
            if file.is_symlink():
                raise ConfigError(f"{file}: is a link to another file. Nothing was written: copy the file itself there")
            yield Entry(f"{station}/{_beside(file, config)}", file.read_bytes(), 0o640)


def _beside(path: Path, config: Path) -> str:
    if not path.is_relative_to(config.parent):
        raise ConfigError(f"{config}: {path} must be in a folder beside this file, so that both can be moved")
    return path.relative_to(config.parent).as_posix()


def _write(out: Path, entries: list[Entry]) -> None:
    descriptor = os.open(out, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(descriptor, "wb") as file, tarfile.open(fileobj=file, mode="w:gz") as archive:
        for folder in sorted({path.as_posix() for entry in entries for path in PurePosixPath(entry.name).parents[:-1]}):
            info = tarfile.TarInfo(folder)
            info.type, info.mode = tarfile.DIRTYPE, 0o700
            archive.addfile(info)
        for entry in entries:
            info = tarfile.TarInfo(entry.name)
            info.size, info.mode = len(entry.content), entry.mode
            archive.addfile(info, io.BytesIO(entry.content))
