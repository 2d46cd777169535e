# SPDX-License-Identifier: GPL-3.0-or-later

"""RC_CHANNELS_OVERRIDE, and RC_CHANNELS that show what is held: no stick flies the aircraft here.

As in ArduCopter: only the station that the autopilot obeys may (MAV_GCS_SYSID), 0 releases the first eight channels and
UINT16_MAX - 1 the others, UINT16_MAX leaves a channel alone, and a hold is over after RC_OVERRIDE_TIME. There is no
receiver: a channel without an override shows 0.
"""

from __future__ import annotations

from pymavlink.dialects.v20 import all as dialect

from sitl.vehicles.builtin.params import ParameterTable

__all__ = ["Sticks"]

#: the others of the message are not taken in
_CHANNELS = 16
_SHOWN = 18
_IGNORED, _RELEASED = 0xFFFF, 0xFFFE


class Sticks:
    """Channels that a ground station holds."""

    def __init__(self, parameters: ParameterTable) -> None:
        self._parameters = parameters
        #: channel, from 1 -> value, and when it came
        self._held: dict[int, tuple[int, float]] = {}

    def take(self, message: dialect.MAVLink_message, now_s: float) -> None:
        """Apply RC_CHANNELS_OVERRIDE."""
        if message.get_srcSystem() != self._parameters["MAV_GCS_SYSID"]:
            return
        for channel in range(1, _CHANNELS + 1):
            value = getattr(message, f"chan{channel}_raw")
            if value == _IGNORED or (channel > 8 and value == 0):
                continue
            if value == (0 if channel <= 8 else _RELEASED):
                self._held.pop(channel, None)
            else:
                self._held[channel] = value, now_s

    def channels(self, now_s: float) -> list[int]:
        """The value that every channel shows."""
        limit_s = self._parameters["RC_OVERRIDE_TIME"]
        live = {channel: value for channel, (value, at_s) in self._held.items() if now_s - at_s <= limit_s}
        return [live.get(channel, 0) for channel in range(1, _SHOWN + 1)]
