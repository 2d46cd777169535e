# SPDX-License-Identifier: GPL-3.0-or-later

"""The station's mission package, and those that other stations send it.

What comes over the ground link is an offer, whoever it names as its sender. Rules that live here:

1. A package that the station read from its own folder is never replaced.
2. An offer counts when the vehicle announces its digest, over its own link, or when the operator takes it by name.
   Until then it waits, one for each station, and nothing is done with it.
3. While the vehicle is armed, or not known to be disarmed, nothing replaces the package that is held. A station that
   holds none may take the one that the vehicle announces: it is what the vehicle flies.
4. A package is read beside the main loop, however it is made.
5. A package that was taken is kept in a file of the station. After a restart it counts again if the vehicle announces
   its digest, and for nothing else: it is no offer that an operator could take. The file is written and read beside the
   main loop, and one that cannot be read is no package.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.mission.package import MissionPackage, from_bytes
from mavproxy_handover.store.durable import replace_whole
from mavproxy_handover.wire.package_transfer import MAX_PACKAGE_BYTES, PackageReceiver
from mavproxy_handover.worker import Worker

__all__ = ["Inbox"]

_RECEIVED = mavlink.HANDOVER_PACKAGE_RESULT_RECEIVED
_REFUSED = mavlink.HANDOVER_PACKAGE_RESULT_REFUSED


@dataclass(frozen=True, slots=True)
class _Sender:
    """Who sent a package: system and component."""

    sysid: int
    component: int

    @property
    def target(self) -> tuple[int, int]:
        return self.sysid, self.component


class Inbox:
    """`own`: the package of the station's own folder, None if it has none. `file`: where a package that was taken is
    kept; None: nowhere."""

    def __init__(self, own: MissionPackage | None, file: Path | None = None) -> None:
        #: the package that counts
        self.held = own
        self._own = own is not None
        #: offered by a station, and waiting
        self._waiting: dict[int, MissionPackage] = {}
        self._receivers: dict[int, PackageReceiver] = {}
        self._worker = Worker()
        #: for the file, so that no offer has to wait for the disk
        self._keeper = Worker()
        self._file = None if own is not None else file
        #: of the run before, not read yet, read, or not there; and one that has still to be written
        self._unread = self._file is not None
        self._kept: MissionPackage | None = None
        self._unwritten: MissionPackage | None = None
        #: what is to be sent, and said to the operator, because something was read
        self._messages: list[tuple[int, Any]] = []
        self._lines: list[tuple[int, str]] = []

    @property
    def waiting(self) -> tuple[MissionPackage, ...]:
        """The packages that do not count yet."""
        return tuple(self._waiting.values())

    # ---- from other stations --------------------------------------------------------------------------------------

    def on_message(self, sysid: int, component: int, message: Any) -> list[Any]:
        """A MISSION_PACKAGE or MISSION_CHUNK of another station; returns answers to it."""
        sender = _Sender(sysid, component)
        receiver = self._receivers.setdefault(sysid, PackageReceiver())
        if message.get_type() == "MISSION_PACKAGE":
            return [
                *(
                    self._known(bytes(message.mission_digest), receiver, sender)
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

    def _known(self, digest: bytes, receiver: PackageReceiver, sender: _Sender) -> list[Any]:
        """What can be said of an offer before it is sent."""
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
        line = f"Mission {name!r} offered, {short}: it counts once the vehicle has it, or after 'handover take {name}'."
        self._lines.append((sender.sysid, line))
        return receiver.conclude(digest, _RECEIVED, "", sender.target)

    def tick(self, now: float) -> tuple[list[tuple[int, Any]], list[tuple[int, str]]]:
        """(receiver, message) to send now, and (station, line for the operator). To be called often."""
        self._worker.tick(now)
        self._keeper.tick(now)
        if self._file is not None and not self._keeper.busy:
            self._keep(self._file)
        messages, self._messages = self._messages, []
        lines, self._lines = self._lines, []
        return messages, lines

    def _keep(self, file: Path) -> None:
        """Read what the run before has kept, then write what this one has taken."""
        if self._unread:
            self._unread = not self._keeper.submit(lambda: _read(file), self._was_kept)
        elif self._unwritten is not None:
            package = self._unwritten
            if self._keeper.submit(lambda: _write(file, package), lambda result, _now: self._was_written(result)):
                self._unwritten = None

    def _was_kept(self, result: MissionPackage | Exception | None, _now: float) -> None:
        if isinstance(result, Exception):
            self._lines.append((0, f"The mission that was kept cannot be read: {result}"))
        else:
            self._kept = result

    def _was_written(self, result: object) -> None:
        if isinstance(result, Exception):
            self._lines.append((0, f"The mission is not kept for a restart: {result}"))

    # ---- what makes one count -------------------------------------------------------------------------------------

    def accept_announced(self, digest: bytes, disarmed: bool) -> str:
        """The vehicle holds the package of this digest; returns a line for the operator, "" if nothing changes.

        `disarmed`: the vehicle is known to be.
        """
        offers = (*self._waiting.values(), *(() if self._kept is None else (self._kept,)))
        found = next((package for package in offers if package.digest == digest), None)
        if found is None or not self._may_take(found, disarmed):
            return ""
        self._replace_held(found)
        return f"Mission {found.name!r}, {digest.hex()[:8]}, is the vehicle's: taken."

    def accept_offer(self, name: str, disarmed: bool) -> str:
        """The operator takes the offer of this name, or whose digest begins so; returns a line for the operator."""
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
        if not self._may_take(package, disarmed):
            return "Not while the vehicle is armed, or not known to be disarmed."
        self._replace_held(package)
        return f"Mission {package.name!r}, {package.digest.hex()[:8]}, taken."

    def _may_take(self, package: MissionPackage, disarmed: bool) -> bool:
        if self._own or (self.held is not None and self.held.digest == package.digest):
            return False
        return self.held is None or disarmed

    def _replace_held(self, package: MissionPackage) -> None:
        if package is not self._kept:
            self._unwritten = package
        self.held = package
        self._waiting = {sysid: other for sysid, other in self._waiting.items() if other.digest != package.digest}


def _read(file: Path) -> MissionPackage | None:
    """The package in this file; None: there is none. Raises MissionError, OSError."""
    try:
        with file.open("rb") as stream:
            data = stream.read(MAX_PACKAGE_BYTES + 1)
    except FileNotFoundError:
        return None
    if len(data) > MAX_PACKAGE_BYTES:
        raise MissionError(f"{file} is larger than {MAX_PACKAGE_BYTES} bytes")
    return from_bytes(data)


def _write(file: Path, package: MissionPackage) -> None:
    """Replace the file by this package. Raises OSError."""
    replace_whole(file, package.to_bytes())
