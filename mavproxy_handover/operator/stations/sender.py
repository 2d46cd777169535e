# SPDX-License-Identifier: GPL-3.0-or-later

"""Sends the companion's own messages to the autopilot and to the stations, each in the right name.

The companion is component 191 of the vehicle. A ground station program that asked the autopilot waits for the
autopilot's answer, so the companion answers in that name. So it does with texts for a station that has not shown our
module, because a stock MAVProxy shows no others; they are marked (`wire/texts.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.operator.stations.port import StationPort
from mavproxy_handover.tools.schedule import attempt
from mavproxy_handover.wire import codec
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID, COMPANION_COMPID, RATES_COMPID
from mavproxy_handover.wire.texts import MOST_IDS, marked_texts, status_texts

__all__ = ["MessageSender"]


class MessageSender:
    """Packs and sends messages of vehicle `sysid`; `write_autopilot` takes whole frames.

    `fault` is told about a station that a message could not be sent to. Only that message is lost: an exception does
    not reach the caller.
    """

    def __init__(
        self,
        sysid: int,
        write_autopilot: Callable[[bytes], None],
        ports: Mapping[int, StationPort],
        fault: Callable[[str, str], None],
    ) -> None:
        self._own = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=COMPANION_COMPID)
        self._as_autopilot = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=AUTOPILOT_COMPID)
        self._rates = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=RATES_COMPID)
        self._write_autopilot = write_autopilot
        self._fault = fault
        #: of the last text
        self._text_id = 0
        #: every station by system id
        self.ports = ports

    def to_autopilot(self, message: Any) -> None:
        """Send a message to the autopilot."""
        self._write_autopilot(codec.pack(message, self._own))

    def ask_rates(self, message: Any) -> None:
        """Send the autopilot a request for a rate. Its answer is not awaited."""
        self._write_autopilot(codec.pack(message, self._rates))

    def to_stations(self, message: Any) -> None:
        """Send a message to every station, on its best link."""
        for port in self.ports.values():
            self._try(port, port.send, message)

    def beat(self, heartbeat: Any) -> None:
        """Send the companion's heartbeat to the stations that get it."""
        for port in self.ports.values():
            if port.companion_heartbeat:
                self._try(port, port.send, heartbeat)

    def acknowledge(
        self, port: StationPort, asker: tuple[int, int], command: int, result: int, component: int = AUTOPILOT_COMPID
    ) -> None:
        """COMMAND_ACK to `asker` (system, component), in the name of the `component` that was asked."""
        ack = mavlink.MAVLink_command_ack_message(command, result, 0, 0, *asker)
        if component == AUTOPILOT_COMPID:
            self.as_autopilot(port, ack)
        else:
            self._try(port, lambda: port.write(codec.pack(ack, self._own)))

    def as_autopilot(self, port: StationPort, message: Any) -> None:
        """Send a station a message in the autopilot's name, because it waits for the autopilot's answer."""
        self._try(port, lambda: port.write(codec.pack(message, self._as_autopilot)))

    def say(self, port: StationPort, text: str, severity: int = mavlink.MAV_SEVERITY_WARNING) -> None:
        """Send a text to the station's operator, by default as a warning.

        A text that is longer than STATUSTEXT is sent in pieces that belong together (`wire/texts.py`)."""
        self._text_id = self._text_id % MOST_IDS + 1
        self._say(port, text, severity)

    def say_to_all(self, text: str, severity: int = mavlink.MAV_SEVERITY_WARNING) -> None:
        """Send a text to the operators of all stations, by default as a warning."""
        self._text_id = self._text_id % MOST_IDS + 1
        for port in self.ports.values():
            self._say(port, text, severity)

    def _say(self, port: StationPort, text: str, severity: int) -> None:
        if port.capabilities.ours:
            for message in status_texts(text, severity, self._text_id):
                self._try(port, port.send, message)
        else:
            for message in marked_texts(text, severity, self._text_id):
                self.as_autopilot(port, message)

    def _try(self, port: StationPort, send: Callable[..., None], *arguments: Any) -> None:
        attempt(self._fault, f"sending to {port.name}", send, *arguments)
