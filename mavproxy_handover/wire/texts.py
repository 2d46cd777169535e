# SPDX-License-Identifier: GPL-3.0-or-later

"""Texts as STATUSTEXT messages: a text that is longer than one message is sent in pieces.

Most programs join the pieces by id and number without changes (MAVProxy, MAVSDK, QGroundControl). So a text is cut
where a piece is full, even within a word. A piece that is not full ends the text (MAVLink: "any null character in the
text field is taken to mean this was the last chunk"). No character is cut: such a piece is filled up with blanks.

A program without support for this system may show only texts of the autopilot's component (MAVProxy does). It gets the
companion's texts in the autopilot's name. Such a text begins with `MARK`, and its number is above those of ArduPilot,
which counts its own texts from 1.

Source: mavlink.io, STATUSTEXT; MAVProxy's module link and QGroundControl join pieces as described.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.levels import Level
from mavproxy_handover.wire.frames import Frame, field_bytes, field_int

__all__ = [
    "COMMANDS_NOW",
    "MARK",
    "MOST_IDS",
    "SEVERITY",
    "TEXT_BYTES",
    "is_marked",
    "marked_texts",
    "pieces",
    "status_texts",
]

#: level of a sentence -> the severity of its STATUSTEXT
SEVERITY: Final[Mapping[Level, int]] = {
    Level.INFO: mavlink.MAV_SEVERITY_INFO,
    Level.ADVISORY: mavlink.MAV_SEVERITY_NOTICE,
    Level.WARNING: mavlink.MAV_SEVERITY_WARNING,
    Level.EMERGENCY: mavlink.MAV_SEVERITY_CRITICAL,
}
#: end of the text that names the commander. Our stations tell that from AUTHORITY_STATUS, and leave out this text
COMMANDS_NOW: Final = " commands now"
#: prefix of a text of the companion that is sent in the autopilot's name
MARK: Final = "Handover: "
#: the number of such a text in several pieces is above this
_MARKED_IDS: Final = 0x8000
#: number of texts after which the ids repeat
MOST_IDS: Final = 0x7FFF
TEXT_BYTES: Final = 50
#: most pieces: their number is a byte
_MOST: Final = 256


def pieces(text: str) -> list[bytes]:
    """Cut the text into pieces of `TEXT_BYTES`, UTF-8. The last one is shorter or empty. A text that fits is
    one piece.
    """
    rest = text.encode("utf-8", "replace")
    if len(rest) <= TEXT_BYTES:
        return [rest]
    found = []
    while len(rest) >= TEXT_BYTES:
        end = _whole_characters(rest)
        found.append(rest[:end].ljust(TEXT_BYTES))
        rest = rest[end:]
    return [*found, rest][:_MOST]


def _whole_characters(rest: bytes) -> int:
    """Number of bytes of a piece that contain only complete characters."""
    end = TEXT_BYTES
    while rest[end : end + 1] and rest[end] & 0xC0 == 0x80:
        end -= 1
    return end


def status_texts(text: str, severity: int, text_id: int) -> list[Any]:
    """The messages with the text. `text_id`, 1 to 65535: id of a text in several pieces; a single piece has none."""
    return _messages(pieces(text), severity, text_id)


def marked_texts(text: str, severity: int, text_id: int) -> list[Any]:
    """The messages with the text in the autopilot's name. `text_id`, 1 to `MOST_IDS`."""
    return _messages(pieces(f"{MARK}{text}"), severity, _MARKED_IDS + text_id)


def _messages(parts: list[bytes], severity: int, text_id: int) -> list[Any]:
    together = text_id if len(parts) > 1 else 0
    return [mavlink.MAVLink_statustext_message(severity, part, together, n) for n, part in enumerate(parts)]


def is_marked(frame: Frame) -> bool:
    """True if a STATUSTEXT of the autopilot's component is a text of the companion, or a piece of one."""
    return field_int(frame, "id") > _MARKED_IDS or field_bytes(frame, "text").startswith(MARK.encode())
