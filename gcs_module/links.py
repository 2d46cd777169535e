# SPDX-License-Identifier: GPL-3.0-or-later

"""MAVProxy's links at a station with several vehicles, and which vehicle each link belongs to.

MAVProxy has one list of links for all vehicles. One link is set (`link`), and one vehicle is chosen (`vehicle`, its
setting `target_system`). Commands leave by the set link, for any vehicle, and `vehicle` sets the first link if the
vehicle has not been heard yet. Rules that live here:

1. A link belongs to the vehicle that its label names (`drone-1`, or `drone-1/2` for its second one). `handover station`
   sets the labels. A link without a label belongs to no vehicle. With one vehicle all links belong to it, and the other
   rules have no effect.
2. A message to a vehicle leaves by that vehicle's own link, whichever link is set. Without one it is not sent.
3. The set link is one of the chosen vehicle's.
4. A frame with a vehicle's system id on a link of another vehicle is dropped. Neither this module nor MAVProxy's other
   modules get it, so two aircraft with the same system id are not mixed up.
5. Sticks (RC_CHANNELS_OVERRIDE) go only to the vehicle that was chosen when they were set: MAVProxy repeats them ten
   times a second to the vehicle that is chosen now. See `vehicle_selection.py`.

With one vehicle too, a UDP link gets the largest receive buffer that the system allows, for the time in which this
program is slow. By default it holds about one second, and later frames are missing in the station's log.
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

#: channel values that do not move a stick: ignored, or released
_NO_STICK: Final = (0, 65534, 65535)
#: first byte of a MAVLink 2 frame, and the index of its system id
_MAGIC: Final = 0xFD
_SYSID_AT: Final = 5
#: the system limits this value (Linux: net.core.rmem_max)
_RECEIVE_BUFFER_BYTES: Final = 1 << 20
_CHANNELS: Final = tuple(f"chan{number}_raw" for number in range(1, 19))


@dataclass(slots=True)
class _Replaced:
    """The parts of a link that are replaced here, as they were."""

    master: Any
    mav: Any
    callback: Any
    ours: Any = None


class Links:
    """One station's links. `told`: gets a line for the operator about a link, once; `refused`: counts dropped
    frames."""

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
        self._replaced: list[_Replaced] = []
        self._roomy: WeakSet[socket.socket] = WeakSet()
        #: serial lines, on which MAVProxy's writes would block
        self._lines: list[LineWriter] = []
        #: the link in use for each vehicle
        self._carriers: dict[int, Any] = {}
        #: the vehicle for which the sticks were set (rule 5)
        self.sticks_for = 0

    @property
    def several(self) -> bool:
        """Whether the station has more than one vehicle."""
        return len(self._names) > 1

    def of(self, sysid: int) -> list[Any]:
        """A vehicle's links."""
        return self.of_each()[sysid]

    def of_each(self) -> dict[int, list[Any]]:
        """The links of every vehicle, with one pass over all links."""
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
        """The link for messages to this vehicle; None: it has none."""
        if not self.several:
            return self._mpstate.master()
        own = self.of(sysid)
        kept = self._carriers.get(sysid)
        first = kept if any(kept is master for master in own) else next(iter(own), None)
        alive = (master for master in own if not getattr(master, "linkerror", False))
        return next(alive, first) if getattr(first, "linkerror", False) else first

    def number(self, sysid: int) -> int:
        """The index of the vehicle's link in use, from 0 on; -1: none of them."""
        if not self.several:
            return int(self._mpstate.settings.link) - 1
        carrier, own = self.carrier(sysid), self.of(sysid)
        return next((number for number, master in enumerate(own) if master is carrier), -1)

    def use(self, sysid: int, number: int) -> Any:
        """Use this one of the vehicle's links from now on; returns it."""
        link = self.of(sysid)[number]
        self._carriers[sysid] = link
        if sysid == self._chosen or not self.several:
            self._set(link)
        return link

    def refresh(self) -> None:
        """Set up new links and forget removed ones; to be called once a second."""
        masters = self._mpstate.mav_master
        ports = [getattr(master, "port", None) for master in masters]
        self._lines = [line for line in self._lines if any(line.port is port for port in ports)]
        for port in ports:
            self._enlarge_buffer(port)
            if is_line(port) and not any(line.port is port for line in self._lines):
                self._lines.append(LineWriter(port))
        if not self.several:
            return
        self._replaced = [
            replaced for replaced in self._replaced if any(replaced.master is master for master in masters)
        ]
        for number, master in enumerate(masters, 1):
            if self._owner(master) is None:
                names = ", ".join(self._names.values())
                self._tell_once(f"Link {number} ({master.address}) is no vehicle's: its label names none of {names}.")
            self._watch(master)

    def push(self) -> None:
        """Send what serial lines did not accept at once; to be called often."""
        for line in self._lines:
            with suppress(OSError):  # the line is gone: MAVProxy notices that with the next frame
                line.push()

    def align(self) -> None:
        """Set a link of the chosen vehicle (rule 3). The operator's choice among its links stands."""
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
        """Restore the links."""
        for replaced in self._replaced:
            replaced.mav.__dict__.pop("send", None)
            if replaced.mav.callback is replaced.ours:
                replaced.mav.callback = replaced.callback
        self._replaced.clear()
        for line in self._lines:
            line.release()
        self._lines.clear()

    @property
    def _chosen(self) -> int:
        return int(self._mpstate.settings.target_system)

    def _owner(self, master: Any) -> int | None:
        """System id of the vehicle that the link's label names; None: it names no vehicle of this station."""
        label = getattr(master, "label", None)
        return self._by_name.get(label.partition("/")[0]) if isinstance(label, str) else None

    def _set(self, link: Any) -> None:
        masters = self._mpstate.mav_master
        self._mpstate.settings.link = 1 + next(number for number, master in enumerate(masters) if master is link)

    def _tell_once(self, text: str) -> None:
        if text not in self._known:
            self._known.add(text)
            self._told(text)

    def _enlarge_buffer(self, port: Any) -> None:
        """Enlarge the receive buffer of a UDP socket, once."""
        if not isinstance(port, socket.socket) or port.type != socket.SOCK_DGRAM or port in self._roomy:
            return
        self._roomy.add(port)
        try:
            if port.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) < _RECEIVE_BUFFER_BYTES:
                port.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER_BYTES)
        except OSError:
            return  # it is closed: MAVProxy opens another one, or reports it

    # ---- what goes through ----------------------------------------------------------------------------------------

    def _watch(self, master: Any) -> None:
        replaced = next((replaced for replaced in self._replaced if replaced.master is master), None)
        if replaced is not None and replaced.mav is master.mav:
            return
        if replaced is not None:  # pymavlink makes another object when it switches to MAVLink 2, and keeps our callback
            self._replaced.remove(replaced)
            master.mav.callback = replaced.callback
        mav = master.mav
        replaced = _Replaced(master, mav, mav.callback)
        if mav.callback is not None:
            replaced.ours = mav.callback = partial(self._received, replaced)
        mav.send = partial(self._send, master, mav.send)
        self._replaced.append(replaced)

    def _received(self, replaced: _Replaced, message: Any, *arguments: Any, **named: Any) -> None:
        """In place of MAVProxy's callback (rule 4)."""
        sysid, owner = _speaker(message), self._owner(replaced.master)
        if sysid in self._names and owner != sysid:
            self._refused[f"{self._names[sysid]}: frame on a link of another"] += 1
            link = "a link of no vehicle" if owner is None else f"the link of {self._names[owner]}"
            self._tell_once(
                f"Another program speaks as {self._names[sysid]} on {link}: not heard. Is a system id given twice?"
            )
            return
        replaced.callback(message, *arguments, **named)

    def _send(self, master: Any, send: Callable[..., None], message: Any, *more: Any, **named: Any) -> None:
        """In place of pymavlink's `send` (rules 2 and 5)."""
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
            self._tell_once(f"{self._names[target]} has no link: what is meant for it is not sent.")
        else:
            carrier.mav.send(message, *more, **named)


def _speaker(message: Any) -> int:
    """The system id of a frame's sender; for a message that MAVProxy does not know, from the raw frame."""
    sysid: int = message.get_srcSystem()
    raw = b"" if sysid or message.get_type() == "BAD_DATA" else bytes(message.get_msgbuf())
    return raw[_SYSID_AT] if len(raw) > _SYSID_AT and raw[0] == _MAGIC else sysid


def _moves(override: Any) -> bool:
    """Whether an override moves a channel, rather than ignoring or releasing it."""
    return any(getattr(override, channel, 0) not in _NO_STICK for channel in _CHANNELS)
