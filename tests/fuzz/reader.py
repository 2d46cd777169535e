# SPDX-License-Identifier: GPL-3.0-or-later

"""How the harnesses read a plan: every string of bytes is one, and zeros lie behind its end."""

from __future__ import annotations

__all__ = ["Reader"]


class Reader:
    """Takes a plan from its beginning to its end."""

    def __init__(self, plan: bytes) -> None:
        self._plan, self._at = plan, 0

    def more(self) -> bool:
        return self._at < len(self._plan)

    def byte(self) -> int:
        self._at += 1
        return self._plan[self._at - 1] if self._at <= len(self._plan) else 0

    def take(self, length: int) -> bytes:
        self._at += length
        return self._plan[self._at - length : self._at]

    def counted(self) -> bytes:
        """So many bytes as the first one says."""
        return self.take(self.byte())
