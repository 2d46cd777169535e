# SPDX-License-Identifier: GPL-3.0-or-later

"""Reads a recorded flight of whatever kind, by the name of its file."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from mavproxy_handover.vehicle.profiles import Profile
from sitl.replay.dataflash import read_dataflash
from sitl.replay.recording import Recording, RecordingError, read_tlog
from sitl.replay.table import read_table

__all__ = ["read_recording"]

_READERS: Final = {".tlog": lambda path, _profile: read_tlog(path), ".bin": read_dataflash, ".csv": read_table}


def read_recording(path: Path, profile: Profile) -> Recording:
    """Read it; `profile`: of the aircraft whose it is, where the file does not say. Raises RecordingError."""
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise RecordingError(f"{path}: must be one of {', '.join(_READERS)}")
    return reader(path, profile)
