# SPDX-License-Identifier: GPL-3.0-or-later

"""A list of mission items as a file, for programs that read and write lists by file transfer (`@MISSION/rally.dat`).

In front of the autopilot, as `mission_server.py` is for the mission protocol. Who may speak is not judged here, the
gate does. Rules:

1. The file is a head (magic, MAV_MISSION_TYPE, options, number of the first item, number of items) and the items, each
   as MISSION_ITEM_INT has it in its payload. What is read is the list of the moment at which it was opened.
2. A station has one file open, as with ArduPilot. Its session's requests are served here: read, burst, write and
   TerminateSession. Whatever the station opens next, here or at the autopilot, ends it; so does ResetSessions, which
   the autopilot answers. What is aimed at another component has nothing to do with it.
3. A list that is written counts when its session is terminated, whole and without a flaw, and is acknowledged when it
   has replaced the old one (`conclude`); anything else leaves the list as it was, and is answered by a refusal. A part
   of a list is not taken, as by ArduPilot.
4. A copy of the last request is answered as the first was: the answer may have been lost.
5. A burst is `BURST` answers at the most, which is all of a list for programs that read as ArduPilot's do.
6. Nothing that arrives raises; memory is bounded by the stations and `most` items each.

Sources: mavlink.io, "File Transfer Protocol (FTP)"; ArduPilot's GCS_FTP.cpp and AP_Filesystem_Mission.cpp.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.gate.mission_items import Flaw, filled, flaw, item_message, item_of
from mavproxy_handover.gate.mission_server import Sender, Turn, Upload
from mavproxy_handover.gate.policy.access import Access
from mavproxy_handover.mission.items import MissionItem
from mavproxy_handover.wire.file_transfer import DATA, DATA_BYTES, Head, answer, checksum, head_of, message
from mavproxy_handover.wire.frames import Frame, field_bytes, target
from mavproxy_handover.wire.ids import (
    AUTOPILOT_COMPID,
    EVERYBODY,
    FTP_ACK,
    FTP_BURST,
    FTP_CHECKSUM,
    FTP_CREATE,
    FTP_NAK,
    FTP_OPEN_READ,
    FTP_OPEN_WRITE,
    FTP_READ,
    FTP_RESET,
    FTP_TERMINATE,
    FTP_WRITE,
)

__all__ = ["BURST", "ListFile"]

#: 46 rally points in pieces of 80 bytes, as MAVProxy asks for them, are 22
BURST: Final = 24
_MAGIC: Final = 0x763D
_HEADER: Final = struct.Struct("<5H")
_ITEM: Final = struct.Struct("<4fiifHH6B")
_FAIL, _NO_SESSION, _END_OF_FILE = b"\x01", b"\x05", b"\x06"
_OPENS: Final = frozenset({FTP_OPEN_READ, FTP_CREATE, FTP_OPEN_WRITE})
#: of an open session -> what it takes
_ACCESS: Final = {
    FTP_READ: Access.RALLY_READ,
    FTP_BURST: Access.RALLY_READ,
    FTP_WRITE: Access.RALLY_WRITE,
}


@dataclass(slots=True)
class _File:
    """A file that a station has open, or had: `over`, and only a copy of what ended it is answered."""

    sender: Sender
    session: int
    data: bytearray
    writes: bool
    over: tuple[Head, Turn] | None = None


class ListFile:
    """Serves the list of MAV_MISSION_TYPE `kind`."""

    def __init__(
        self,
        kind: int,
        most: int,
        offered: Callable[[], Sequence[MissionItem]],
        check: Callable[[MissionItem], Flaw | None] = flaw,
    ) -> None:
        """`most`: items that the list may have. `offered`: what is in it. `check`: what is wrong with an item."""
        self._kind = kind
        self._longest = _HEADER.size + most * _ITEM.size
        self._offered = offered
        self._check = check
        #: by station
        self._files: dict[int, _File] = {}

    @property
    def writers(self) -> tuple[int, ...]:
        """The stations that have the file open for writing."""
        return tuple(station for station, file in self._files.items() if file.writes and file.over is None)

    def forget(self, station: int) -> None:
        """Whatever the station has open is given up."""
        self._files.pop(station, None)

    def access(self, station: int, frame: Frame) -> Access | None:
        """What a request of file transfer takes that belongs to a session with this file; None: it belongs to none.

        Opening it does not count: the path says what that takes (`policy/files.py`). But to open another one ends it.
        """
        file, aim = self._files.get(station), target(frame)
        if file is None or aim is None or aim[1] not in (EVERYBODY, AUTOPILOT_COMPID):
            return None
        head = head_of(field_bytes(frame, "payload"))
        if head.opcode in _OPENS or head.opcode == FTP_RESET:
            self.forget(station)
            return None
        if (frame.sysid, frame.compid) != file.sender or head.session != file.session:
            return None
        if head.opcode == FTP_TERMINATE:
            if file.over is not None and file.over[0].sequence != head.sequence:
                return None
            return Access.RALLY_WRITE if file.writes else Access.RALLY_READ
        return _ACCESS.get(head.opcode) if file.over is None else None

    def take(self, station: int, request: Any, sender: Sender) -> Turn:
        """A request that the gate lets through: it opens the file, or `access` knows it."""
        payload = bytes(request.payload)
        head = head_of(payload)
        data = payload[DATA][: head.size]
        if head.opcode == FTP_CHECKSUM:
            return _acknowledged(sender, head, checksum(self._content()).to_bytes(4, "little"))
        if head.opcode in _OPENS:
            return self._open(station, sender, head)
        file = self._files.get(station)
        if file is None:
            return _refused(sender, head, _NO_SESSION)
        if head.opcode == FTP_TERMINATE:
            return self._terminate(file, head)
        if file.writes != (head.opcode == FTP_WRITE):
            return _refused(sender, head, _FAIL)
        if file.writes:
            return self._write(file, head, data)
        return _burst(file, head) if head.opcode == FTP_BURST else _read(file, head)

    def conclude(self, station: int) -> Turn:
        """The list that `take` gave as a whole has replaced the old one: now its station hears so."""
        file = self._files[station]
        assert file.over is not None
        head = file.over[0]
        turn = _acknowledged(file.sender, head)
        file.over = head, turn
        return turn

    # ---- requests -------------------------------------------------------------------------------------------------

    def _open(self, station: int, sender: Sender, head: Head) -> Turn:
        writes = head.opcode != FTP_OPEN_READ
        content = bytearray() if writes else bytearray(self._content())
        self._files[station] = _File(sender, head.session, content, writes)
        return _acknowledged(sender, head, b"" if writes else len(content).to_bytes(4, "little"))

    def _write(self, file: _File, head: Head, data: bytes) -> Turn:
        end = head.offset + len(data)
        if end > self._longest:
            return _refused(file.sender, head, _FAIL, f"{end} bytes (at most {self._longest})")
        file.data.extend(bytes(max(0, end - len(file.data))))
        file.data[head.offset : end] = data
        return _acknowledged(file.sender, head)

    def _terminate(self, file: _File, head: Head) -> Turn:
        if file.over is not None:
            return file.over[1]
        if not file.writes:
            file.over = head, _acknowledged(file.sender, head)
            return file.over[1]
        file.over = head, _refused(file.sender, head, _FAIL)  # until `conclude`
        items = self._list(bytes(file.data))
        if isinstance(items, str):
            return replace(file.over[1], words=items)
        return Turn((), whole=Upload(file.sender, self._kind, items))

    # ---- the file -------------------------------------------------------------------------------------------------

    def _content(self) -> bytes:
        items = self._offered()
        parts = [_HEADER.pack(_MAGIC, self._kind, 0, 0, len(items))]
        for seq, item in enumerate(items):
            m = item_message(item, (0, 0), self._kind)
            place = m.x, m.y, m.z, seq, m.command, 0, 0, m.frame, 0, m.autocontinue, self._kind
            parts.append(_ITEM.pack(m.param1, m.param2, m.param3, m.param4, *place))
        return b"".join(parts)

    def _list(self, data: bytes) -> tuple[MissionItem, ...] | str:
        """What a file holds, or why it is no list."""
        if len(data) < _HEADER.size:
            return "the file has no head"
        magic, kind, options, start, number = _HEADER.unpack_from(data)
        if magic != _MAGIC or kind != self._kind:
            return "the file is of another kind"
        if options or start:
            return "a part of a list is not taken by file"
        if len(data) != _HEADER.size + number * _ITEM.size:
            return f"{number} items do not take {len(data)} bytes"
        items = []
        for seq in range(number):
            item = _item(data[_HEADER.size + seq * _ITEM.size :][: _ITEM.size], seq)
            wrong = self._check(item)
            if wrong is not None:
                return wrong.words
            items.append(item)
        return tuple(items)


def _item(data: bytes, seq: int) -> MissionItem:
    *params, x, y, z, _seq, command, _system, _component, frame, current, goes_on, kind = _ITEM.unpack(data)
    place = x, y, z, kind
    return filled(
        item_of(mavlink.MAVLink_mission_item_int_message(0, 0, seq, frame, command, current, goes_on, *params, *place))
    )


def _read(file: _File, head: Head) -> Turn:
    data = _piece(file, head.offset, head.size)
    return _acknowledged(file.sender, head, data) if data else _refused(file.sender, head, _END_OF_FILE)


def _burst(file: _File, head: Head) -> Turn:
    """Pieces one after the other, numbered on; the last of the file, and of the burst, says so, and its end is told."""
    answers: list[Any] = []
    size, offset = head.size or DATA_BYTES, head.offset
    while len(answers) < BURST and (data := _piece(file, offset, size)):
        last = len(data) < size or len(answers) == BURST - 1
        sequence = (head.sequence + 1 + len(answers)) & 0xFFFF
        piece = Head(sequence, head.session, FTP_ACK, len(data), head.opcode, int(last), offset)
        answers.append(message(file.sender, piece, data))
        offset += len(data)
    if len(answers) < BURST:
        sequence = (head.sequence + 1 + len(answers)) & 0xFFFF
        end = Head(sequence, head.session, FTP_NAK, 1, head.opcode, 0, offset)
        answers.append(message(file.sender, end, _END_OF_FILE))
    return Turn(tuple(answers))


def _piece(file: _File, offset: int, size: int) -> bytes:
    return bytes(file.data[offset : offset + min(size, DATA_BYTES)])


def _acknowledged(sender: Sender, head: Head, data: bytes = b"") -> Turn:
    return Turn((answer(sender, head, FTP_ACK, data),))


def _refused(sender: Sender, head: Head, error: bytes, words: str = "") -> Turn:
    return Turn((answer(sender, head, FTP_NAK, error),), words=words)
