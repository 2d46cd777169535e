# SPDX-License-Identifier: GPL-3.0-or-later

"""Transfer of a mission package by MISSION_PACKAGE, MISSION_CHUNK and MISSION_PACKAGE_ACK.

The receiver leads: it always says which offset it needs next. So a lost, doubled or reordered message costs only time,
and an interrupted transfer goes on where it stopped. The sender keeps a few chunks in flight. If it hears nothing it
repeats its offer, because the receiver may have restarted and lost the package. The package is complete only when its
size fits and its contents parse to the announced digest. The caller checks that.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.wire.vehicle_address import ENTRY_BYTES, MAX_ADDRESSES

__all__ = ["CHUNK_BYTES", "MAX_PACKAGE_BYTES", "PackageReceiver", "PackageSender", "held_already", "package_id"]

CHUNK_BYTES = 200
MAX_PACKAGE_BYTES = 64 * 1024
_WINDOW = 8
_RETRY_S = 0.5

_RECEIVING = mavlink.HANDOVER_PACKAGE_RESULT_RECEIVING
_RECEIVED = mavlink.HANDOVER_PACKAGE_RESULT_RECEIVED
_LOADED = mavlink.HANDOVER_PACKAGE_RESULT_LOADED
_REFUSED = mavlink.HANDOVER_PACKAGE_RESULT_REFUSED


def package_id(digest: bytes) -> int:
    """Identifier of a package in chunk messages: the first four bytes of its digest."""
    return int.from_bytes(digest[:4], "little")


def refusal(digest: bytes, text: str, target: tuple[int, int]) -> Any:
    """The message that refuses an offer."""
    return _ack(target, digest, 0, _REFUSED, text)


def held_already(digest: bytes, target: tuple[int, int]) -> Any:
    """The message that says that a package is loaded already, while nothing can be written; nothing is remembered."""
    return _ack(target, digest, 0, _LOADED, "held already, nothing was written")


def _ack(target: tuple[int, int], digest: bytes, offset: int, result: int, text: str = "") -> Any:
    return mavlink.MAVLink_mission_package_ack_message(
        *target, package_id(digest), offset, result, text.encode("utf-8")[:50]
    )


class PackageSender:
    """Sends one package to one receiver. Times are monotonic seconds."""

    def __init__(
        self,
        data: bytes,
        digest: bytes,
        name: str,
        target: tuple[int, int],
        *,
        until_loaded: bool = False,
        addresses: bytes = b"",
    ) -> None:
        """`until_loaded`: RECEIVED is not final, because the receiver is going to load the package. `addresses`: the
        vehicle's, as `vehicle_address.py` packs them; each offer has them. The digest does not cover them.
        """
        self._until_loaded = until_loaded
        self._data = data
        self._digest = digest
        self._name = name
        self._target = target
        self._addresses = list(addresses.ljust(MAX_ADDRESSES * ENTRY_BYTES, b"\0"))
        self._id = package_id(digest)
        self._retry_at = 0.0
        self._wanted: int | None = None
        self._acknowledged = 0
        #: None while it runs, then RECEIVED, LOADED or REFUSED
        self.result: int | None = None
        self.text = ""

    @property
    def finished(self) -> bool:
        """True if there is nothing more to send."""
        return self.result is not None and not (self._until_loaded and self.result == _RECEIVED)

    @property
    def progress(self) -> float:
        """Part of the package that the receiver has acknowledged, 0 to 1."""
        return 1.0 if self.result is not None else self._acknowledged / max(1, len(self._data))

    def tick(self, now: float) -> list[Any]:
        """Messages to send now."""
        if self.finished or now < self._retry_at:
            return []
        self._retry_at = now + _RETRY_S
        self._wanted = None
        offer = mavlink.MAVLink_mission_package_message(
            *self._target,
            len(self._data),
            list(self._digest),
            self._name.encode("utf-8")[:32],
            addresses=self._addresses,
        )
        return [offer]

    def on_ack(self, ack: Any, now: float) -> list[Any]:
        """Handle a MISSION_PACKAGE_ACK of the receiver; returns the messages to send."""
        if ack.package_id != self._id or self.finished:
            return []
        if ack.result in (_RECEIVED, _LOADED, _REFUSED):
            self.result, self.text = ack.result, ack.text
            return []
        if ack.next_offset > len(self._data) or ack.next_offset == self._wanted:
            return []
        self.result = None
        self._wanted = self._acknowledged = ack.next_offset
        self._retry_at = now + _RETRY_S
        return self._chunks(ack.next_offset)

    def _chunks(self, start: int) -> list[Any]:
        chunks = []
        for offset in range(start, min(start + _WINDOW * CHUNK_BYTES, len(self._data)), CHUNK_BYTES):
            piece = self._data[offset : offset + CHUNK_BYTES]
            chunks.append(
                mavlink.MAVLink_mission_chunk_message(
                    *self._target, self._id, offset, len(piece), list(piece.ljust(CHUNK_BYTES, b"\0"))
                )
            )
        return chunks


@dataclass(slots=True)
class _Incoming:
    digest: bytes
    name: str
    size: int
    data: bytearray
    #: offset at which the sender's current window ends; an answer is due there
    answer_at: int


def _said(done: tuple[bytes, int, str]) -> tuple[bytes, int, int, str]:
    digest, result, text = done
    return digest, 0, result, text


class PackageReceiver:
    """Receives one package at a time; a new offer replaces an unfinished one.

    The caller parses a complete package, which may take time. Until `conclude` its sender is told that there is nothing
    more to send.
    """

    def __init__(self) -> None:
        self._incoming: _Incoming | None = None
        #: complete, and not concluded yet
        self._whole: _Incoming | None = None
        self._done: tuple[bytes, int, str] | None = None

    def on_offer(self, offer: Any, target: tuple[int, int]) -> list[Any]:
        """Handle MISSION_PACKAGE; returns the answer."""
        digest = bytes(offer.mission_digest)
        known = self.last_word(digest, target)
        if known is not None:
            return [known]
        if not 0 < offer.size <= MAX_PACKAGE_BYTES:
            text = f"package of {offer.size} bytes, allowed are {MAX_PACKAGE_BYTES}"
            return [_ack(target, digest, 0, _REFUSED, text)]
        whole = self._whole
        if whole is not None and whole.digest == digest and whole.size == offer.size:
            return [_ack(target, digest, whole.size, _RECEIVING)]
        incoming = self._incoming
        if incoming is None or incoming.digest != digest or incoming.size != offer.size:
            incoming = self._incoming = _Incoming(digest, offer.name, offer.size, bytearray(), 0)
        return [self._next(incoming, target)]

    def last_word(self, digest: bytes, target: tuple[int, int]) -> Any | None:
        """The final answer about this package again; None if it must be sent (again)."""
        if self._done is None or self._done[0] != digest or self._done[1] == _REFUSED:
            return None
        return _ack(target, *_said(self._done))

    def said(self, digest: bytes) -> int | None:
        """The result that `conclude` remembers of this package; None: it remembers none."""
        return self._done[1] if self._done is not None and self._done[0] == digest else None

    def forget(self) -> None:
        """Forget all results: a package that is offered again has to be sent again."""
        self._done = None

    def on_chunk(self, chunk: Any, target: tuple[int, int]) -> tuple[list[Any], tuple[bytes, bytes] | None]:
        """Handle MISSION_CHUNK; returns answers, and (digest, data) once the package is complete."""
        incoming = self._incoming
        if incoming is None or chunk.package_id != package_id(incoming.digest):
            done = self._done
            if done is not None and chunk.package_id == package_id(done[0]):  # our final answer was lost
                return [_ack(target, *_said(done))], None
            return [], None
        have = len(incoming.data)
        piece = bytes(chunk.data)[: min(chunk.length, CHUNK_BYTES)]
        if chunk.offset > have:  # an earlier chunk was lost: ask for it at once, but only once for each window
            if have >= incoming.answer_at:
                return [], None
            incoming.answer_at = have
            return [_ack(target, incoming.digest, have, _RECEIVING)], None
        if chunk.offset + len(piece) <= have:
            return [], None
        incoming.data += piece[have - chunk.offset :]
        if len(incoming.data) >= incoming.size:
            self._incoming, self._whole = None, incoming
            return [], (incoming.digest, bytes(incoming.data[: incoming.size]))
        if len(incoming.data) >= incoming.answer_at:
            return [self._next(incoming, target)], None
        return [], None

    def refuse(self, digest: bytes, text: str, target: tuple[int, int]) -> Any:
        """The message that refuses an offer; nothing is remembered, so it may be offered again."""
        return refusal(digest, text, target)

    def conclude(self, digest: bytes, result: int, text: str, target: tuple[int, int]) -> Any:
        """Remember the result of a complete package, and return the message that reports it."""
        self._whole = None
        self._done = (digest, result, text)
        return _ack(target, digest, 0, result, text)

    def _next(self, incoming: _Incoming, target: tuple[int, int]) -> Any:
        incoming.answer_at = len(incoming.data) + _WINDOW * CHUNK_BYTES
        return _ack(target, incoming.digest, len(incoming.data), _RECEIVING)
