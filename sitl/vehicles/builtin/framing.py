# SPDX-License-Identifier: GPL-3.0-or-later

"""Frames out of a byte stream, as the autopilot's own parser cuts them.

A frame begins with one of the two magic bytes and is as long as its header says; unknown incompatibility flags
end it at once. Whether its checksum fits is judged afterwards, by `decode`, because scripts are shown frames
that do not. Signatures are carried along and not verified. Nothing in here raises on any input.
"""

from __future__ import annotations

from pymavlink.dialects.v20 import all as dialect

__all__ = ["FrameSplitter", "decode", "message_id"]

_MAGIC_2, _MAGIC_1 = 0xFD, 0xFE
_HEAD_2, _HEAD_1 = 10, 6
_SIGNED = 0x01
_SIGNATURE_LENGTH = 13

_decoder = dialect.MAVLink(None)


class FrameSplitter:
    """Collects bytes and yields whole frames; counts the bytes that belonged to none."""

    def __init__(self) -> None:
        self._buffer = bytearray()
        self.skipped = 0

    def push(self, data: bytes) -> list[bytes]:
        """Add received bytes; returns the frames completed by them."""
        self._buffer += data
        frames: list[bytes] = []
        while True:
            self._find_magic()
            length = self._frame_length()
            if length is None or len(self._buffer) < length:
                return frames
            if length == 0:
                del self._buffer[0]
                self.skipped += 1
                continue
            frames.append(bytes(self._buffer[:length]))
            del self._buffer[:length]

    def _find_magic(self) -> None:
        for index, byte in enumerate(self._buffer):
            if byte in (_MAGIC_2, _MAGIC_1):
                if index:
                    del self._buffer[:index]
                    self.skipped += index
                return
        self.skipped += len(self._buffer)
        self._buffer.clear()

    def _frame_length(self) -> int | None:
        """Length of the frame at the head; None: not enough bytes to tell; 0: not a frame."""
        buffer = self._buffer
        if len(buffer) < 3:
            return None
        if buffer[0] == _MAGIC_1:
            return _HEAD_1 + buffer[1] + 2
        if buffer[2] & ~_SIGNED:
            return 0
        return _HEAD_2 + buffer[1] + 2 + (_SIGNATURE_LENGTH if buffer[2] & _SIGNED else 0)


def message_id(frame: bytes) -> int:
    """Message id of a whole frame."""
    return frame[5] if frame[0] == _MAGIC_1 else int.from_bytes(frame[7:10], "little")


def decode(frame: bytes) -> dialect.MAVLink_message | None:
    """The message in a frame; None when the id is unknown or the checksum or length does not fit."""
    if message_id(frame) not in dialect.mavlink_map:
        return None
    try:
        return _decoder.decode(bytearray(frame))
    except (dialect.MAVError, ValueError, IndexError):
        return None
