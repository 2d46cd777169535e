# SPDX-License-Identifier: GPL-3.0-or-later

"""The mission package that a station holds, and the packages that other stations offer.

What arrives over the ground link is an offer, with any sender id. Rules that live here:

1. A package that the station read from its own folder is never replaced.
2. An offer is accepted when the vehicle announces its digest over its own link, or when the operator takes it by name.
   Until then it waits, one for each station, and has no effect.
3. While the vehicle is armed, or not known to be disarmed, the held package is not replaced. A station that holds none
   may accept the one that the vehicle announces, because the vehicle flies it.
4. A package is parsed beside the main loop, because its contents decide how long that takes.
5. An accepted package is saved in a file of the station. After a restart it is held again only if the vehicle announces
   its digest; the operator cannot take it as an offer. The file is written and read beside the main loop. A file that
   cannot be read counts as no package.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.mission.package import MissionPackage, from_bytes
from mavproxy_handover.store.durable import replace_whole
from mavproxy_handover.tools.worker import Worker
from mavproxy_handover.wire.package_transfer import MAX_PACKAGE_BYTES, PackageReceiver

__all__ = ["Inbox"]

_RECEIVED = mavlink.HANDOVER_PACKAGE_RESULT_RECEIVED
_REFUSED = mavlink.HANDOVER_PACKAGE_RESULT_REFUSED


@dataclass(frozen=True, slots=True)
class _Sender:
    """System and component that sent a package."""

    sysid: int
    component: int

    @property
    def target(self) -> tuple[int, int]:
        return self.sysid, self.component


class Inbox:
    """`own`: the package of the station's own folder, None if it has none. `file`: where an accepted package is saved;
    None: nowhere."""

    def __init__(self, own: MissionPackage | None, file: Path | None = None) -> None:
        #: the held package
        self.held = own
        self._own = own is not None
        #: offers that wait, by station
        self._waiting: dict[int, MissionPackage] = {}
        self._receivers: dict[int, PackageReceiver] = {}
        self._worker = Worker()
        #: for the file, so that no offer waits for the disk
        self._file_worker = Worker()
        self._file = None if own is not None else file
        #: the saved package: whether it has still to be read, the one of the run before, and the one that has still to
        #: be written
        self._unread = self._file is not None
        self._saved: MissionPackage | None = None
        self._unwritten: MissionPackage | None = None
        #: messages to send and lines for the operator, from packages that were parsed
        self._messages: list[tuple[int, Any]] = []
        self._lines: list[tuple[int, str]] = []

    @property
    def waiting(self) -> tuple[MissionPackage, ...]:
        """The offers that wait."""
        return tuple(self._waiting.values())

    # ---- from other stations --------------------------------------------------------------------------------------

    def on_message(self, sysid: int, component: int, message: Any) -> list[Any]:
        """A MISSION_PACKAGE or MISSION_CHUNK of another station; returns the answers to it."""
        sender = _Sender(sysid, component)
        receiver = self._receivers.setdefault(sysid, PackageReceiver())
        if message.get_type() == "MISSION_PACKAGE":
            return [
                *(
                    self._early_answer(bytes(message.mission_digest), receiver, sender)
                    or receiver.on_offer(message, sender.target)
                )
            ]
        answers, whole = receiver.on_chunk(message, sender.target)
        if whole is None:
            return answers
        digest, data = whole

        def read(result: MissionPackage | Exception, _now: float) -> None:
            self._messages.append((sysid, self._conclude(result, digest, receiver, sender)))

        if not self._worker.submit(lambda: from_bytes(data), read):
            answers.append(
                receiver.conclude(digest, _REFUSED, "another package is being read: share it again", sender.target)
            )
        return answers

    def _early_answer(self, digest: bytes, receiver: PackageReceiver, sender: _Sender) -> list[Any]:
        """The answer to an offer that can be given before the package arrives; empty if there is none."""
        if self.held is not None and self.held.digest == digest:
            return [receiver.conclude(digest, _RECEIVED, "", sender.target)]
        if self._own:
            return [receiver.refuse(digest, "this station has a mission of its own", sender.target)]
        return []

    def _conclude(
        self, result: MissionPackage | Exception, digest: bytes, receiver: PackageReceiver, sender: _Sender
    ) -> Any:
        if isinstance(result, MissionPackage) and result.digest != digest:
            result = MissionError("the contents do not have the digest that was promised")
        if not isinstance(result, MissionPackage):
            why = str(result) if isinstance(result, (MissionError, TimeoutError)) else f"internal fault: {result}"
            self._lines.append((sender.sysid, f"Mission refused: {why}"))
            return receiver.conclude(digest, _REFUSED, why, sender.target)
        self._waiting[sender.sysid] = result
        name, short = result.name, digest.hex()[:8]
        now = f"'handover take {name}' uses it now."
        line = f"Mission {name!r} ({short}) offered. It is used when the vehicle flies it; {now}"
        self._lines.append((sender.sysid, line))
        return receiver.conclude(digest, _RECEIVED, "", sender.target)

    def tick(self, now: float) -> tuple[list[tuple[int, Any]], list[tuple[int, str]]]:
        """(receiver, message) to send now, and (station, line for the operator). To be called often."""
        self._worker.tick(now)
        self._file_worker.tick(now)
        if self._file is not None and not self._file_worker.busy:
            self._read_or_write(self._file)
        messages, self._messages = self._messages, []
        lines, self._lines = self._lines, []
        return messages, lines

    def _read_or_write(self, file: Path) -> None:
        """Read the package that the run before has saved, then write the one that this run has accepted."""
        if self._unread:
            self._unread = not self._file_worker.submit(lambda: _read(file), self._on_read)
        elif self._unwritten is not None:
            package = self._unwritten
            if self._file_worker.submit(lambda: _write(file, package), lambda result, _now: self._on_written(result)):
                self._unwritten = None

    def _on_read(self, result: MissionPackage | Exception | None, _now: float) -> None:
        if isinstance(result, Exception):
            self._lines.append((0, f"The mission that was kept cannot be read: {result}"))
        else:
            self._saved = result

    def _on_written(self, result: object) -> None:
        if isinstance(result, Exception):
            self._lines.append((0, f"The mission is not kept for a restart: {result}"))

    # ---- what makes one count -------------------------------------------------------------------------------------

    def accept_announced(self, digest: bytes, disarmed: bool) -> str:
        """The vehicle announces the package of this digest: accept it if it is offered. Returns a line for the
        operator, "" if nothing changes.

        `disarmed`: the vehicle is known to be disarmed.
        """
        offers = (*self._waiting.values(), *(() if self._saved is None else (self._saved,)))
        found = next((package for package in offers if package.digest == digest), None)
        if found is None or not self._may_replace(found, disarmed):
            return ""
        self._replace_held(found)
        return f"Mission {found.name!r}, {digest.hex()[:8]}, is the vehicle's: taken."

    def accept_offer(self, name: str, disarmed: bool) -> str:
        """The operator takes the offer with this name, or with a digest that begins so.

        Returns a line for the operator.
        """
        found = [
            package
            for package in self._waiting.values()
            if name == package.name or package.digest.hex().startswith(name)
        ]
        if len({package.digest for package in found}) != 1:
            offers = ", ".join(f"{package.name} ({package.digest.hex()[:8]})" for package in self._waiting.values())
            problem = "Several missions are called that" if found else f"No mission {name!r} is offered"
            return f"{problem}; offered are: {offers or 'none'}."
        package = found[0]
        if self._own:
            return "This station has a mission of its own: it is not replaced."
        if not self._may_replace(package, disarmed):
            return "Not while the vehicle is armed, or not known to be disarmed."
        self._replace_held(package)
        return f"Mission {package.name!r}, {package.digest.hex()[:8]}, taken."

    def _may_replace(self, package: MissionPackage, disarmed: bool) -> bool:
        if self._own or (self.held is not None and self.held.digest == package.digest):
            return False
        return self.held is None or disarmed

    def _replace_held(self, package: MissionPackage) -> None:
        if package is not self._saved:
            self._unwritten = package
        self.held = package
        self._waiting = {sysid: other for sysid, other in self._waiting.items() if other.digest != package.digest}


def _read(file: Path) -> MissionPackage | None:
    """The package in this file; None: there is no file. Raises MissionError, OSError."""
    try:
        with file.open("rb") as stream:
            data = stream.read(MAX_PACKAGE_BYTES + 1)
    except FileNotFoundError:
        return None
    if len(data) > MAX_PACKAGE_BYTES:
        raise MissionError(f"{file} is larger than {MAX_PACKAGE_BYTES} bytes")
    return from_bytes(data)


def _write(file: Path, package: MissionPackage) -> None:
    """Replace the file's contents by this package. Raises OSError."""
    replace_whole(file, package.to_bytes())
