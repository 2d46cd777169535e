# SPDX-License-Identifier: GPL-3.0-or-later

"""Joins the pieces of STATUSTEXTs of the companion. The station's own sentences are in `core.py`.

MAVProxy shows most of them itself; those are not shown twice. A text longer than one message comes in pieces with a
common id; a missing piece must not keep the others from the operator. A decision also comes as HANDOVER_DECISION, and
is told from that: so a text waits a moment, and is left out if it is a decision. Pure: time is an argument.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from gcs_module.alarms import Level
from mavproxy_handover.wire.frames import Frame, field_bytes, field_int
from mavproxy_handover.wire.texts import MARK, SEVERITY

__all__ = ["SEVERITIES", "Text", "Texts"]

#: the level of a text, by its severity. `SEVERITY` has those of the companion; the others are the autopilot's
SEVERITIES: Final = {
    mavlink.MAV_SEVERITY_EMERGENCY: Level.EMERGENCY,
    mavlink.MAV_SEVERITY_ALERT: Level.EMERGENCY,
    mavlink.MAV_SEVERITY_ERROR: Level.WARNING,
    **{severity: level for level, severity in SEVERITY.items() if level > Level.INFO},
}
#: pieces of one text arrive within this time; and a complete text waits this long (s) for the decision that it may be
_TOGETHER_S, _WAITS_S = 2.0, 0.5
#: most texts in pieces, and complete ones, that wait at a time; most pieces of one text
_MOST, _PIECES = 16, 16
#: bytes of a full piece: a shorter one ends its text
_FULL: Final = 50


@dataclass(slots=True)
class _Parts:
    begun: float
    level: Level
    pieces: dict[int, bytes] = field(default_factory=dict)
    #: number of the last piece, None until it has come
    last: int | None = None

    @property
    def whole(self) -> bool:
        return self.last is not None and all(number in self.pieces for number in range(self.last + 1))

    @property
    def text(self) -> str:
        """The pieces that have come; "..." for each missing one."""
        last = max(self.pieces) if self.last is None else self.last
        parts = [self.pieces.get(number) for number in range(last + 1)]
        raw = b"".join(b"..." if part is None else part for part in parts)
        return raw.decode("utf-8", "replace") + ("" if self.last is not None else "...")


@dataclass(frozen=True, slots=True)
class Text:
    """A complete text. `shown`: by MAVProxy; `at`: when its wait is over."""

    at: float
    level: Level
    words: str
    shown: bool


class Texts:
    """The texts of one vehicle's companion, or of its other components. `shown`: whether MAVProxy has just shown this
    text. Times are monotonic seconds."""

    def __init__(self, shown: Callable[[str], bool]) -> None:
        self._shown = shown
        self._parts: dict[int, _Parts] = {}
        self._whole: deque[Text] = deque(maxlen=_MOST)

    def on_frame(self, frame: Frame, now: float) -> None:
        """A STATUSTEXT."""
        raw = field_bytes(frame, "text").split(b"\0", 1)[0]
        level = SEVERITIES.get(field_int(frame, "severity"), Level.INFO)
        text_id, number = field_int(frame, "id"), field_int(frame, "chunk_seq")
        if not text_id:
            self._add(raw.decode("utf-8", "replace"), level, now)
            return
        parts = self._parts.get(text_id)
        if parts is None or now - parts.begun > _TOGETHER_S:
            if len(self._parts) >= _MOST:
                self._give_up(min(self._parts, key=lambda each: self._parts[each].begun), now)
            parts = self._parts[text_id] = _Parts(now, level)
        if number >= _PIECES:
            return
        parts.pieces[number] = raw
        if len(raw) < _FULL:
            parts.last = number
        if parts.whole:
            self._give_up(text_id, now)

    def _give_up(self, text_id: int, now: float) -> None:
        """Do not wait for more pieces of this text."""
        parts = self._parts.pop(text_id)
        if parts.pieces:
            self._add(parts.text, parts.level, now)

    def _add(self, text: str, level: Level, now: float) -> None:
        words = " ".join(text.removeprefix(MARK).split())  # a piece may be padded with spaces
        if words:
            self._whole.append(Text(now + _WAITS_S, level, words, self._shown(text)))

    def due(self, now: float, told: Callable[[str], bool]) -> list[Text]:
        """The texts to tell now. `told`: whether a text is told already by other means."""
        for text_id in [each for each, parts in self._parts.items() if now - parts.begun > _TOGETHER_S]:
            self._give_up(text_id, now - _WAITS_S)
        found = []
        while self._whole and now >= self._whole[0].at:
            text = self._whole.popleft()
            if not told(text.words):
                found.append(text)
        return found

    def pop(self, beginning: str) -> str:
        """Take out the first waiting text that begins so, because it is told with something else; "" if there is
        none."""
        for text in self._whole:
            if text.words.startswith(beginning):
                self._whole.remove(text)
                return text.words
        return ""
