# SPDX-License-Identifier: GPL-3.0-or-later

"""The name of the operator on duty, in a file beside the station's configuration.

A restart of the station's program signs the operator off, because no program knows who sits there now. The file is
only for the line that says so: it never signs an operator on. It is written beside the main loop.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from gcs_module.duty import is_name
from mavproxy_handover.store.durable import replace_whole
from mavproxy_handover.tools.worker import Worker

__all__ = ["DutyFile", "signed_off"]

_FILE_BYTES: Final = 200


class DutyFile:
    """`configuration`: path of the station's file; `station`: the station's name. Times are monotonic seconds."""

    def __init__(self, configuration: Path, station: str, worker: Worker | None = None) -> None:
        self.path = configuration.with_name(f"{station}.operator")
        self._worker = Worker() if worker is None else worker
        self._written = self._wanted = ""
        #: why the last write failed; "" if it did not
        self.fault = ""

    def before(self) -> str:
        """The operator who was on duty when the program last ended; "" if none was. A damaged file counts as none."""
        try:
            with self.path.open("rb") as stream:
                name = stream.read(_FILE_BYTES).decode("utf-8").strip()
        except (OSError, UnicodeDecodeError):
            return ""
        self._written = self._wanted = name if is_name(name) else ""
        return self._written

    def keep(self, name: str) -> None:
        """Note the operator on duty from now on; "": none is."""
        self._wanted = name

    def tick(self, now: float) -> None:
        """Write a change; to be called often, returns at once."""
        self._worker.tick(now)
        name = self._wanted
        if name != self._written and self._worker.submit(lambda: self._write(name), self._on_written):
            self._written = name

    def _write(self, name: str) -> None:
        if name:
            replace_whole(self.path, f"{name}\n".encode())
        else:
            self.path.unlink(missing_ok=True)

    def _on_written(self, result: object, _now: float) -> None:
        self.fault = f"{self.path}: {result}" if isinstance(result, Exception) else ""


def signed_off(name: str) -> str:
    """The line after a restart of the program. `name`: the operator who was on duty before."""
    return (
        f"{name} is signed off: this station's program was started again. To sign on again, type "
        f"'handover operator {name}'."
    )
