# SPDX-License-Identifier: GPL-3.0-or-later

"""What the vehicle has decided about what is wrong: told the operator once, and shown while it is in force.

HANDOVER_DECISION is repeated with the same number while the decision lasts. After a restart of the companion the
numbers begin anew, so a number counts as known together with its words.
"""

from __future__ import annotations

from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from gcs_module.events import Notice

__all__ = ["Decisions"]

_OVER: Final[int] = mavlink.HANDOVER_ACTION_NONE
_WARN: Final[int] = mavlink.HANDOVER_ACTION_WARN


class Decisions:
    """The last one of one vehicle."""

    def __init__(self) -> None:
        self._known: tuple[int, str] | None = None
        #: the sentence of what is in force; "": nothing is wrong
        self.text = ""

    def on_message(self, m: Any) -> Notice | None:
        """A HANDOVER_DECISION; returns what to tell the operator, None if it is told already."""
        text = m.text.decode("utf-8", "replace") if isinstance(m.text, bytes) else m.text
        known = m.number, text
        if known == self._known:
            return None
        self._known = known
        self.text = "" if m.action == _OVER else text
        return Notice("decision", text, urgent=m.action not in (_OVER, _WARN))
