# SPDX-License-Identifier: GPL-3.0-or-later

"""Frames of downloads: they go to stations after all others, several in a datagram.

A datagram leaves at the end of a round of the main loop at the latest (`send`). LOG_DATA is paced
(`log_download.py`).
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Mapping
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.gate.log_download import LogDownload
from mavproxy_handover.gate.port import Port
from mavproxy_handover.wire.frames import Frame

__all__ = ["DOWNLOADS", "LOG_ANSWERS", "LOG_REQUESTS", "Downloads"]

_LOG_DATA: Final[int] = mavlink.MAVLINK_MSG_ID_LOG_DATA
#: messages of the vehicle that come in long rows
DOWNLOADS: Final = frozenset(
    (_LOG_DATA, mavlink.MAVLINK_MSG_ID_PARAM_VALUE, mavlink.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL)
)
#: messages of the vehicle that answer them: they go to the station that has asked
LOG_ANSWERS: Final = frozenset((_LOG_DATA, mavlink.MAVLINK_MSG_ID_LOG_ENTRY))
#: messages of a station that begin, end or change a download of logs
LOG_REQUESTS: Final = frozenset(
    (
        mavlink.MAVLINK_MSG_ID_LOG_REQUEST_DATA,
        mavlink.MAVLINK_MSG_ID_LOG_REQUEST_END,
        mavlink.MAVLINK_MSG_ID_LOG_REQUEST_LIST,
        mavlink.MAVLINK_MSG_ID_LOG_ERASE,
    )
)


class Downloads:
    """Of one vehicle. `to_autopilot` takes whole frames; `fault` is told what broke, and where."""

    def __init__(
        self, ports: Mapping[int, Port], to_autopilot: Callable[[bytes], None], fault: Callable[[str, str], None]
    ) -> None:
        self._ports = ports
        self._fault = fault
        self._log = LogDownload(to_autopilot)
        #: `send` has something to do
        self.wait = False

    def asked(self, port: Port, frame: Frame, now: float) -> None:
        """A message of LOG_REQUESTS, to be passed on."""
        self._log.asked(port, frame, now)

    def forward(self, port: Port, frame: Frame, raw: bytes, now: float) -> None:
        """A frame of the vehicle for a station. `raw`: the frame as it is sent."""
        try:
            kept = frame.msgid == _LOG_DATA and self._log.keeps(port, frame, raw, now)
            if not kept and not port.write_more(raw):
                port.write(raw)
            self.wait = True
        except Exception:
            self._fault(f"sending to {port.name}", traceback.format_exc(limit=-3))

    def send(self, now: float) -> None:
        """Send what waits; to be called in every round of the main loop while `wait`."""
        try:
            self.wait = self._log.send(now)
        except Exception:
            self.wait = False
            self._log.forget()
            self._fault("log download", traceback.format_exc(limit=-3))
        for port in self._ports.values():
            try:
                port.flush()
            except Exception:
                self._fault(f"sending to {port.name}", traceback.format_exc(limit=-3))

    def tick(self, now: float) -> None:
        """Time has passed; to be called often."""
        self._log.tick(now)

    def forget(self) -> None:
        """The download of logs ends: its station has lost authority, or the vehicle is armed."""
        self._log.forget()
