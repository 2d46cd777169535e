# SPDX-License-Identifier: GPL-3.0-or-later

"""Serves a list of mission items as a file (`@MISSION/rally.dat`), for programs that use file transfer for lists.

It answers in the autopilot's place, as `mission_server.py` does for the mission protocol. The gate decides which
station may send such requests. Rules:

1. The file is a header (magic, MAV_MISSION_TYPE, options, number of the first item, number of items) and the items,
   each as in the payload of MISSION_ITEM_INT. A station reads the list as it was when it opened the file.
2. A station has one file open, as with ArduPilot. The requests of its session are served here: read, burst, write and
   TerminateSession. The next file that the station opens, here or at the autopilot, ends the session. So does
   ResetSessions, which the autopilot answers. Requests to another component do not concern this file.
3. A written list counts when its session is terminated and the list is complete and valid. It is acknowledged when it
   has replaced the old one (`conclude`). Otherwise the list stays as it was, and the answer is a refusal. A part of a
   list is not accepted, as with ArduPilot.
4. A copy of the last request gets the first answer again, because that may have been lost.
5. A burst is at most `BURST` answers. That is a whole list for programs that read as ArduPilot's do.
6. No input raises an exception. Memory is bounded by the stations and by `most` items each.

Sources: mavlink.io, "File Transfer Protocol (FTP)"; ArduPilot's GCS_FTP.cpp and AP_Filesystem_Mission.cpp.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.gate.mission_server import Sender, Turn, Upload
from mavproxy_handover.gate.policy.access import Access
from mavproxy_handover.mission.items import MissionItem
from mavproxy_handover.mission.protocol_items import Flaw, filled, flaw, item_message, item_of
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

#: MAVProxy asks for pieces of 80 bytes: 46 rally points are 22 pieces
BURST: Final = 24
_MAGIC: Final = 0x763D
_HEADER: Final = struct.Struct("<5H")
_ITEM: Final = struct.Struct("<4fiifHH6B")
_FAIL, _NO_SESSION, _END_OF_FILE = b"\x01", b"\x05", b"\x06"
_OPENS: Final = frozenset({FTP_OPEN_READ, FTP_CREATE, FTP_OPEN_WRITE})
#: opcode of an open session -> class
_ACCESS: Final = {
    FTP_READ: Access.RALLY_READ,
    FTP_BURST: Access.RALLY_READ,
    FTP_WRITE: Access.RALLY_WRITE,
}


@dataclass(slots=True)
class _File:
    """A file that a station has open. If it is `over`, only a copy of the request that ended it is answered."""

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
        """`most`: the most items of the list. `offered`: its items. `check`: what is wrong with an item."""
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
        """Close what the station has open, without a result."""
        self._files.pop(station, None)

    def access(self, station: int, frame: Frame) -> Access | None:
        """The class of a request that belongs to a session with this file; None: it does not belong to one.

        Opening the file is judged by its path (`policy/files.py`). To open another file ends the session.
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

    def answer(self, station: int, request: Any, sender: Sender) -> Turn:
        """Answer a request that passed the gate: it opens the file, or belongs to a session (`access`)."""
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
        """Acknowledge the list that `answer` returned: it has replaced the old one."""
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
        """The items in a file, or why it is no valid list."""
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
    """Numbered pieces, one after the other. The last piece of the burst or of the file says so; then comes the end."""
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
