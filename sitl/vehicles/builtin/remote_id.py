# SPDX-License-Identifier: GPL-3.0-or-later

"""Remote ID of the autopilot: whose place as the operator's it gives to the transponder at DID_MAVPORT.

As AP_OpenDroneID does it, once a second. Only the operator's place is modelled, and arming never needs it.
The parameters are there only if DID_ENABLE is given: ArduPilot hides the others while that is 0.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from pymavlink.dialects.v20 import all as dialect

from sitl.vehicles.builtin.link import Link
from sitl.vehicles.builtin.params import ParameterTable

__all__ = ["RemoteId"]

_EVERY_S: Final = 1.0
_PARAMETERS: Final = {"DID_ENABLE": 0, "DID_MAVPORT": -1, "DID_CANDRIVER": 0, "DID_OPTIONS": 0}
_PLACE: Final = ("operator_latitude", "operator_longitude", "operator_altitude_geo", "timestamp")


class RemoteId:
    """The last word about the operator."""

    def __init__(self, parameters: ParameterTable, links: Mapping[int, Link]) -> None:
        self._parameters = parameters
        self._links = links
        self._system: Any = dialect.MAVLink_open_drone_id_system_message(
            0, 0, bytes(20), 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0
        )
        self._due_s = 0.0
        if parameters.waits("DID_ENABLE"):
            for name, value in _PARAMETERS.items():
                parameters.define(name, value)

    def handle(self, message: Any) -> bool:
        """Take in a message; False: it is about something else."""
        kind: str = message.get_type()
        if kind == "OPEN_DRONE_ID_SYSTEM":
            self._system = message
        elif kind == "OPEN_DRONE_ID_SYSTEM_UPDATE":
            for name in _PLACE:
                setattr(self._system, name, getattr(message, name))
        return kind.startswith("OPEN_DRONE_ID_")

    def update(self, now_s: float) -> None:
        """Send what is due."""
        if "DID_ENABLE" not in self._parameters or self._parameters["DID_ENABLE"] < 1 or now_s < self._due_s:
            return
        link = self._links.get(int(self._parameters["DID_MAVPORT"]))
        if link is None:
            return
        self._due_s = now_s + _EVERY_S
        system = self._system
        fields = [getattr(system, name) for name in system.fieldnames]
        link.send(dialect.MAVLink_open_drone_id_system_message(*fields))
