# SPDX-License-Identifier: GPL-3.0-or-later

"""MAVProxy's links, and whose they are, where a station is for several vehicles.

MAVProxy has one list of links for all vehicles, one of them set (`link`), and one vehicle chosen (`vehicle`, its
setting `target_system`). What is typed goes by the link that is set, whoever it is meant for, and `vehicle` sets the
first link when the vehicle has not been heard yet. Rules that live here:

1. A link belongs to the vehicle that its label names (`drone-1`, or `drone-1/2` for its second one): `handover station`
   gives the labels. A link without one belongs to nobody. With one vehicle all links are its own, and nothing of this
   is done.
2. What is addressed to a vehicle leaves by its own link, whatever link is set. Where it has none, nothing leaves.
3. The link that is set is one of the chosen vehicle's.
4. What claims to be one of our vehicles on a link that is not its own gets no further: not to this module, nor to
   MAVProxy's other ones. Two aircraft of one system id are not mixed up.
5. Sticks (RC_CHANNELS_OVERRIDE) go only to the vehicle that was chosen when they were set: MAVProxy repeats them ten
   times a second to whoever is chosen now. See `vehicle_selection.py`.

For one vehicle too: what waits at a UDP link while this program is slow has as much room as the system gives. It is a
second's worth otherwise, and what comes behind it is missing in the station's log.
"""

from __future__ import annotations

import socket
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any, Final
from weakref import WeakSet

from mavproxy_handover.config.files import FleetVehicle
from mavproxy_handover.link.line_writer import LineWriter, is_line

__all__ = ["Links"]

#: values of a channel that leave it alone, or give it back
_NO_STICK: Final = (0, 65534, 65535)
#: first byte of a frame of MAVLink 2, and where the system id stands in it
_MAGIC: Final = 0xFD
_SYSID_AT: Final = 5
#: more than the system allows (Linux: net.core.rmem_max) is cut by the system
_RECEIVE_BUFFER_BYTES: Final = 1 << 20
_CHANNELS: Final = tuple(f"chan{number}_raw" for number in range(1, 19))


@dataclass(slots=True)
class _Door:
    """What a link had in the places that are taken here."""

    master: Any
    mav: Any
    callback: Any
    ours: Any = None


class Links:
    """One station's. `told`: a line for the operator about a link, said once; `refused`: counts what was not let in."""

    def __init__(
        self,
        mpstate: Any,
        vehicles: Sequence[FleetVehicle],
        told: Callable[[str], None],
        refused: Counter[str],
    ) -> None:
        self._mpstate = mpstate
        self._names = {vehicle.sysid: vehicle.called for vehicle in vehicles}
        self._by_name = {vehicle.name: vehicle.sysid for vehicle in vehicles if vehicle.name}
        self._told = told
        self._refused = refused
        self._known: set[str] = set()
        self._doors: list[_Door] = []
        self._roomy: WeakSet[socket.socket] = WeakSet()
        #: serial lines, which MAVProxy would wait for
        self._lines: list[LineWriter] = []
        #: the link that each vehicle's messages take
        self._carriers: dict[int, Any] = {}
        #: whose the sticks are that are set (rule 5)
        self.sticks_for = 0

    @property
    def several(self) -> bool:
        """Whether there are vehicles to be told apart."""
        return len(self._names) > 1

    def of(self, sysid: int) -> list[Any]:
        """A vehicle's links."""
        return self.of_each()[sysid]

    def of_each(self) -> dict[int, list[Any]]:
        """The links of every vehicle, for one look at each link."""
        masters: list[Any] = self._mpstate.mav_master
        if not self.several:
            return dict.fromkeys(self._names, masters)
        found: dict[int, list[Any]] = {sysid: [] for sysid in self._names}
        for master in masters:
            owner = self._owner(master)
            if owner is not None:
                found[owner].append(master)
        return found

    def carrier(self, sysid: int) -> Any | None:
        """The link that a message to this vehicle takes; None: it has none."""
        if not self.several:
            return self._mpstate.master()
        own = self.of(sysid)
        kept = self._carriers.get(sysid)
        first = kept if any(kept is master for master in own) else next(iter(own), None)
        alive = (master for master in own if not getattr(master, "linkerror", False))
        return next(alive, first) if getattr(first, "linkerror", False) else first

    def number(self, sysid: int) -> int:
        """Which of a vehicle's links is in use, from 0 on; -1: none of them."""
        if not self.several:
            return int(self._mpstate.settings.link) - 1
        carrier, own = self.carrier(sysid), self.of(sysid)
        return next((number for number, master in enumerate(own) if master is carrier), -1)

    def use(self, sysid: int, number: int) -> Any:
        """From now on this one of its links is used; returns it."""
        link = self.of(sysid)[number]
        self._carriers[sysid] = link
        if sysid == self._chosen or not self.several:
            self._set(link)
        return link

    def see_to(self) -> None:
        """Look after links that have come and gone; to be called once a second."""
        masters = self._mpstate.mav_master
        ports = [getattr(master, "port", None) for master in masters]
        self._lines = [line for line in self._lines if any(line.port is port for port in ports)]
        for port in ports:
            self._give_room(port)
            if is_line(port) and not any(line.port is port for line in self._lines):
                self._lines.append(LineWriter(port))
        if not self.several:
            return
        self._doors = [door for door in self._doors if any(door.master is master for master in masters)]
        for number, master in enumerate(masters, 1):
            if self._owner(master) is None:
                names = ", ".join(self._names.values())
                self._once(f"Link {number} ({master.address}) is no vehicle's: its label names none of {names}.")
            self._watch(master)

    def push(self) -> None:
        """Send what serial lines did not take at once; to be called often."""
        for line in self._lines:
            with suppress(OSError):  # it is gone: MAVProxy finds out with the next frame
                line.push()

    def align(self) -> None:
        """The link that is set is the chosen vehicle's (rule 3); a choice among its own links is the operator's."""
        chosen = self._chosen
        if not self.several or chosen not in self._names:
            return
        set_now = self._mpstate.master()
        if set_now is not None and self._owner(set_now) == chosen:
            self._carriers[chosen] = set_now
            return
        link = self.carrier(chosen)
        if link is not None:
            self._set(link)

    def release(self) -> None:
        """Give the links back as they were."""
        for door in self._doors:
            door.mav.__dict__.pop("send", None)
            if door.mav.callback is door.ours:
                door.mav.callback = door.callback
        self._doors.clear()
        for line in self._lines:
            line.release()
        self._lines.clear()

    @property
    def _chosen(self) -> int:
        return int(self._mpstate.settings.target_system)

    def _owner(self, master: Any) -> int | None:
        """System id of the vehicle that a link's label names; None: none of them."""
        label = getattr(master, "label", None)
        return self._by_name.get(label.partition("/")[0]) if isinstance(label, str) else None

    def _set(self, link: Any) -> None:
        masters = self._mpstate.mav_master
        self._mpstate.settings.link = 1 + next(number for number, master in enumerate(masters) if master is link)

    def _once(self, text: str) -> None:
        if text not in self._known:
            self._known.add(text)
            self._told(text)

    def _give_room(self, port: Any) -> None:
        """What waits at a UDP socket gets more room, once; of what is none nothing is changed."""
        if not isinstance(port, socket.socket) or port.type != socket.SOCK_DGRAM or port in self._roomy:
            return
        self._roomy.add(port)
        try:
            if port.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) < _RECEIVE_BUFFER_BYTES:
                port.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER_BYTES)
        except OSError:
            return  # closed by now: MAVProxy opens another one, or tells of it

    # ---- what goes through ----------------------------------------------------------------------------------------

    def _watch(self, master: Any) -> None:
        door = next((door for door in self._doors if door.master is master), None)
        if door is not None and door.mav is master.mav:
            return
        if door is not None:  # pymavlink makes another one when it switches to MAVLink 2, and keeps our callback
            self._doors.remove(door)
            master.mav.callback = door.callback
        mav = master.mav
        door = _Door(master, mav, mav.callback)
        if mav.callback is not None:
            door.ours = mav.callback = partial(self._received, door)
        mav.send = partial(self._send, master, mav.send)
        self._doors.append(door)

    def _received(self, door: _Door, message: Any, *arguments: Any, **named: Any) -> None:
        """In the place of MAVProxy's callback (rule 4)."""
        sysid, owner = _speaker(message), self._owner(door.master)
        if sysid in self._names and owner != sysid:
            self._refused[f"{self._names[sysid]}: frame on a link of another"] += 1
            link = "a link of nobody" if owner is None else f"the link of {self._names[owner]}"
            self._once(
                f"Another program speaks as {self._names[sysid]} on {link}: not heard. Is a system id given twice?"
            )
            return
        door.callback(message, *arguments, **named)

    def _send(self, master: Any, send: Callable[..., None], message: Any, *more: Any, **named: Any) -> None:
        """In the place of pymavlink's `send` (rules 2 and 5)."""
        target = getattr(message, "target_system", 0)
        if target not in self._names:
            send(message, *more, **named)
            return
        if message.get_type() == "RC_CHANNELS_OVERRIDE" and target != self.sticks_for and _moves(message):
            return
        if self._owner(master) == target:
            send(message, *more, **named)
            return
        carrier = self.carrier(target)
        if carrier is None:
            self._once(f"{self._names[target]} has no link: what is meant for it is not sent.")
        else:
            carrier.mav.send(message, *more, **named)


def _speaker(message: Any) -> int:
    """The system id of a frame's sender; of a message that MAVProxy does not know it stands in the frame alone."""
    sysid: int = message.get_srcSystem()
    raw = b"" if sysid or message.get_type() == "BAD_DATA" else bytes(message.get_msgbuf())
    return raw[_SYSID_AT] if len(raw) > _SYSID_AT and raw[0] == _MAGIC else sysid


def _moves(override: Any) -> bool:
    """Whether sticks hold a channel, rather than leave it alone or give it back."""
    return any(getattr(override, channel, 0) not in _NO_STICK for channel in _CHANNELS)
