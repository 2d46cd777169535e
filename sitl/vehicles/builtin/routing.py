# SPDX-License-Identifier: GPL-3.0-or-later

"""Which messages are for the autopilot, and which it passes on to its other channels.

As MAVLink_routing does it: the autopilot learns where each system and component was heard. A message for another
receiver goes where that one was heard and is not handled here. A broadcast is handled here and goes to every other
channel on which a system was heard. Heartbeats go to every other active channel. Its own frames coming back are
dropped. Private channels (MAVn_OPTIONS bit 1) do not forward, and get no forwarded frames.
"""

from __future__ import annotations

import functools

from pymavlink.dialects.v20 import all as dialect

from sitl.vehicles.builtin.link import Link
from sitl.vehicles.builtin.params import ParameterTable

__all__ = ["Router", "targets"]

_HEARTBEAT, _RADIO, _RADIO_STATUS = 0, 166, 109
_PRIVATE = 2
_AUTOPILOT = 1


@functools.cache
def _has_targets(msgid: int) -> tuple[bool, bool]:
    names = dialect.mavlink_map[msgid].fieldnames
    return "target_system" in names, "target_component" in names


def targets(message: dialect.MAVLink_message) -> tuple[int, int]:
    """Target system and component of a message, -1 where it has none."""
    has_system, has_component = _has_targets(message.get_msgId())
    system = message.target_system if has_system else -1
    component = message.target_component if has_component else -1
    return system, component


class Router:
    """Routes learned from traffic."""

    def __init__(self, links: dict[int, Link], parameters: ParameterTable) -> None:
        self._links = links
        self._parameters = parameters
        self._routes: dict[tuple[int, int, int], None] = {}

    def accept(self, link: Link, message: dialect.MAVLink_message, frame: bytes) -> bool:
        """Forward a message as needed; True when the autopilot handles it itself."""
        own = int(self._parameters["MAV_SYSID"])
        source = (message.get_srcSystem(), message.get_srcComponent())
        if source == (own, _AUTOPILOT):
            return False
        if source[0] != 0:
            route = (source[0], source[1], link.channel)
            self._routes[route] = None
        msgid = message.get_msgId()
        if msgid in (_RADIO, _RADIO_STATUS):
            return True
        private = self._private(link.channel)
        if msgid == _HEARTBEAT:
            if not private:
                self._pass_heartbeat(link, source, frame)
            return True
        system, component = targets(message)
        broadcast = system in (0, -1)
        ours = broadcast or system == own
        handle = ours and component in (0, -1, _AUTOPILOT)
        if private or (handle and not broadcast and component not in (0, -1)):
            return handle
        sent: set[int] = set()
        for route_system, route_component, channel in self._routes:
            if channel == link.channel or channel in sent:
                continue
            exact = (system, component) == (route_system, route_component)
            if self._private(channel) and not exact:
                continue
            fits = system == route_system and (component in (0, -1, route_component) or not ours)
            if broadcast or fits:
                self._links[channel].send_raw(frame)
                sent.add(channel)
        return handle or broadcast or (ours and not sent)

    def _pass_heartbeat(self, link: Link, source: tuple[int, int], frame: bytes) -> None:
        for channel, other in self._links.items():
            if channel == link.channel or not other.heard or self._private(channel):
                continue
            if (*source, channel) not in self._routes:
                other.send_raw(frame)

    def _private(self, channel: int) -> bool:
        row = self._parameters.find(f"MAV{channel + 1}_OPTIONS")
        return row is not None and bool(int(row.value) & _PRIVATE)
