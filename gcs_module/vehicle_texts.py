# SPDX-License-Identifier: GPL-3.0-or-later

"""The texts of one vehicle (STATUSTEXT), each shown to the operator once.

MAVProxy shows the texts of the vehicle that it has chosen. This module shows the companion's texts, and the gate's
texts about this station's sticks. Of a vehicle that MAVProxy does not show, it also shows the other components'
texts of severity NOTICE or worse.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from gcs_module.decisions import Decisions
from gcs_module.event_log import FlightEventLog
from gcs_module.texts import SEVERITIES, Texts
from mavproxy_handover.gate.stale_streams import full_form
from mavproxy_handover.wire.frames import Frame, field_int
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID
from mavproxy_handover.wire.texts import COMMANDS_NOW, is_marked

__all__ = ["VehicleTexts"]


class VehicleTexts:
    """`companion`: the companion's texts that wait; `decisions` takes out the text of a decision (`pop`).
    `shown_by_mavproxy`: whether MAVProxy shows this vehicle's texts. Times are monotonic seconds."""

    def __init__(
        self,
        companion: Texts,
        decisions: Decisions,
        event_log: FlightEventLog,
        shown_by_mavproxy: Callable[[], bool],
    ) -> None:
        self._companion = companion
        self._others = Texts(lambda _text: False)
        self._decisions = decisions
        self._event_log = event_log
        self._shown_by_mavproxy = shown_by_mavproxy

    def on_companion(self, frame: Frame, now: float) -> None:
        """A STATUSTEXT of the companion."""
        self._companion.on_frame(frame, now)

    def on_other(self, frame: Frame, m: Any, now: float) -> None:
        """A STATUSTEXT of another component of the vehicle."""
        text = m.text.decode("ascii", "replace") if isinstance(m.text, bytes) else m.text
        full = full_form(text.rstrip("\0"))
        if full is not None:
            self._event_log.stream(full, now)
        elif frame.compid == AUTOPILOT_COMPID and is_marked(frame):  # the companion's, in the autopilot's name
            self._companion.on_frame(frame, now)
        elif field_int(frame, "severity") in SEVERITIES and not self._shown_by_mavproxy():
            self._others.on_frame(frame, now)

    def show_due(self, now: float) -> None:
        """Show the texts whose wait is over; to be called often."""
        for texts in (self._companion, self._others):
            for text in texts.due(now, self._is_told_elsewhere):
                self._event_log.text(text, now)

    def pop(self, beginning: str) -> str:
        """Take out a waiting text of the companion that begins so; "" if there is none."""
        return self._companion.pop(beginning)

    def _is_told_elsewhere(self, text: str) -> bool:
        """Decisions and changes of the commander arrive as messages of ours too, and are told from those."""
        return self._decisions.told(text) or COMMANDS_NOW in text
