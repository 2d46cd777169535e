# SPDX-License-Identifier: GPL-3.0-or-later

"""The parameter protocol: list, read, set.

As in ArduPilot: a set is answered by PARAM_VALUE on every active channel, whether the value changed or not; an
unknown name or a value that is no number is not answered at all; a list is preceded by the banner and trickles
out beside the telemetry.
"""

from __future__ import annotations

from collections.abc import Mapping

from pymavlink.dialects.v20 import all as dialect

from sitl.vehicles.builtin.link import Link
from sitl.vehicles.builtin.params import Parameter, ParameterTable
from sitl.vehicles.builtin.telemetry import send_banner

__all__ = ["ParameterProtocol"]

_LIST_PER_STEP = 4
_NO_INDEX = 65535


class ParameterProtocol:
    """Handles PARAM_* messages."""

    def __init__(self, parameters: ParameterTable, links: Mapping[int, Link]) -> None:
        self._parameters = parameters
        self._links = links

    def handle(self, link: Link, message: dialect.MAVLink_message) -> bool:
        """Handle a message of this protocol; False: it is not one."""
        kind = message.get_type()
        if kind == "PARAM_REQUEST_LIST":
            send_banner(link)
            link.parameter_list = iter(list(enumerate(self._parameters)))
        elif kind == "PARAM_REQUEST_READ":
            self._read(link, message)
        elif kind == "PARAM_SET":
            if self.set(message.param_id, message.param_value):
                self.announce(message.param_id)
        else:
            return False
        return True

    def set(self, name: str, value: float) -> bool:
        """Set a parameter, with its effects beyond its value. False: no such parameter, or no number."""
        if not self._parameters.set(name, value):
            return False
        if name == "MAV_SYSID":
            for link in self._links.values():
                link.set_sysid(int(self._parameters[name]))
        return True

    def announce(self, name: str) -> None:
        """PARAM_VALUE to every active channel: a value was saved."""
        row = self._parameters.find(name)
        if row is not None:
            for link in self._links.values():
                if link.heard:
                    link.send(self._value(row, _NO_INDEX))

    def update(self, link: Link) -> None:
        """Send the next parameters of a running list."""
        if link.parameter_list is None:
            return
        for _ in range(_LIST_PER_STEP):
            entry = next(link.parameter_list, None)
            if entry is None:
                link.parameter_list = None
                return
            link.send(self._value(entry[1], entry[0]))

    def _read(self, link: Link, message: dialect.MAVLink_message) -> None:
        by_name = message.param_index == -1
        row = self._parameters.find(message.param_id) if by_name else self._parameters.at(message.param_index)
        if row is not None:
            link.send(self._value(row, _NO_INDEX if by_name else message.param_index))

    def _value(self, row: Parameter, index: int) -> dialect.MAVLink_message:
        return dialect.MAVLink_param_value_message(row.name.encode(), row.value, row.type, len(self._parameters), index)
