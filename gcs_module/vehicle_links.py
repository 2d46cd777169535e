# SPDX-License-Identifier: GPL-3.0-or-later

"""MAVProxy's links of one vehicle: those of the station's configuration, and those to addresses that came with a
mission. `vehicle_addresses.py` decides which address is opened and when.

If the configuration has no link to the vehicle, `handover station` starts MAVProxy with the waiting link, because
MAVProxy cannot run without a link. The first real link replaces it.
"""

from __future__ import annotations

import json
import socket
from collections.abc import Callable, Iterable
from contextlib import closing
from typing import Any

from gcs_module.links import Links
from mavproxy_handover.wire.vehicle_address import WAITING_LABEL, WAITING_LINK, VehicleAddress

__all__ = ["VehicleLinks"]


class VehicleLinks:
    """Links of the vehicle `sysid`. `label`: MAVProxy's label for a new link; "" if the station has one vehicle.

    `listening`: the ports of the station's ground link, to which none of its own links may lead.
    """

    def __init__(
        self, mpstate: Any, links: Links, sysid: int, label: str, listening: Callable[[], Iterable[int]]
    ) -> None:
        self._mpstate = mpstate
        self._links = links
        self._sysid = sysid
        self._label = label
        self._listening = listening
        #: the links that were opened here
        self._opened: dict[VehicleAddress, Any] = {}

    def own(self) -> tuple[str, ...]:
        """The links of the station's own configuration, by MAVProxy's names."""
        return tuple(
            str(master.address)
            for master in self._links.of(self._sysid)
            if not _waits(master) and not any(master is opened for opened in self._opened.values())
        )

    def is_open(self, address: VehicleAddress) -> bool:
        """Whether a link to this address was opened here, also if the operator has removed it since."""
        return address in self._opened

    def is_removed(self, address: VehicleAddress) -> bool:
        """Whether the operator has removed a link that was opened here."""
        master = self._opened.get(address)
        return master is not None and not any(master is each for each in self._mpstate.mav_master)

    def leads_back(self, address: VehicleAddress) -> bool:
        """Whether the address is one of this computer's interfaces. Nothing is sent."""
        with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as probe:
            try:
                probe.bind((address.host, 0))
            except OSError:
                return False
        return True

    def is_ours(self, address: VehicleAddress) -> bool:
        """Whether a link of this program listens at the address, on any interface."""
        ports = set(self._listening())
        for link in (*self._mpstate.mav_master, *self._mpstate.mav_outputs):
            ports |= _bound(getattr(link, "port", None))
        return address.port in ports

    def open(self, address: VehicleAddress) -> str:
        """Make MAVProxy open a link to the address; returns why it could not, "" if it did."""
        link = self._mpstate.module("link")
        if link is None:
            return "MAVProxy's module 'link' is not loaded"
        label = f":{json.dumps({'label': self._label}, separators=(',', ':'))}" if self._label else ""
        if not link.link_add(f"{address.text}{label}"):
            return "MAVProxy cannot open it"
        self._opened[address] = self._mpstate.mav_master[-1]
        for master in list(self._mpstate.mav_master):
            if _waits(master):
                self._remove(link, master)
        return ""

    def close(self) -> str:
        """Close the links that were opened here; returns why one is still open, "" if none is."""
        if not self._opened:
            return ""
        link = self._mpstate.module("link")
        if link is None:
            return "MAVProxy's module 'link' is not loaded"
        opened = self._opened
        others = [master for master in self._mpstate.mav_master if not any(master is each for each in opened.values())]
        if not others:
            link.link_add(WAITING_LINK)
        for master in list(opened.values()):
            self._remove(link, master)
        masters = self._mpstate.mav_master
        self._opened = {each: opened[each] for each in opened if any(opened[each] is master for master in masters)}
        return "MAVProxy cannot close it" if self._opened else ""

    def _remove(self, link: Any, master: Any) -> None:
        number = next((at for at, each in enumerate(self._mpstate.mav_master) if each is master), None)
        if number is not None:
            link.cmd_link_remove([str(number)])


def _waits(master: Any) -> bool:
    return getattr(master, "label", None) == WAITING_LABEL


def _bound(port: Any) -> set[int]:
    """The port that a link's socket is bound to."""
    if not isinstance(port, socket.socket):
        return set()
    try:
        return {port.getsockname()[1]}
    except OSError:
        return set()
