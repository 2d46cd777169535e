# SPDX-License-Identifier: GPL-3.0-or-later

"""Sends the station's mission package to the vehicle and to stations. `inbox.py` handles the packages of other
stations.

An offer ends: a receiver that has not answered for NO_ANSWER_S is offered nothing more, and the operator is told. If
the receiver was not heard, it is offered the package again when it is heard. If it is heard and does not answer, only
the operator can try again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from gcs_module.inbox import Inbox
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.wire.package_transfer import PackageSender, package_id
from mavproxy_handover.wire.vehicle_address import pack_addresses

__all__ = ["NO_ANSWER_S", "MissionTransfer"]

#: the time (s) of about 30 offers
NO_ANSWER_S: Final = 15.0

_RECEIVED = mavlink.HANDOVER_PACKAGE_RESULT_RECEIVED
_REFUSED = mavlink.HANDOVER_PACKAGE_RESULT_REFUSED


@dataclass(slots=True)
class _Offer:
    package: MissionPackage
    target: tuple[int, int]
    until_loaded: bool
    sender: PackageSender
    #: time of the receiver's last answer, or of the beginning of the offer
    answered_at: float
    #: nothing is sent, because there was no answer
    given_up: bool = False
    #: after it was given up: whether the receiver was heard at the last check
    alive: bool = False


class MissionTransfer:
    """Sends the held package to any number of receivers at once, by system id."""

    def __init__(self, own: MissionPackage | None, file: Path | None = None) -> None:
        """`own`: the package of the station's own folder; `file`: where an accepted package of another station is
        saved."""
        self.inbox = Inbox(own, file)
        self._offers: dict[int, _Offer] = {}

    @property
    def held(self) -> MissionPackage | None:
        """The held package."""
        return self.inbox.held

    def offer(self, receiver: int, component: int, now: float, *, until_loaded: bool = False) -> None:
        """Begin to send the held package to `receiver`. There must be one.

        `until_loaded`: the receiver is the vehicle, which reports the end when the autopilot holds the mission.
        """
        held, target = self.held, (receiver, component)
        assert held is not None
        self._offers[receiver] = _Offer(held, target, until_loaded, _sender(held, target, until_loaded), now)

    def tick(self, now: float, alive: Callable[[int], bool]) -> tuple[list[tuple[int, Any]], list[tuple[int, str]]]:
        """(receiver, message) to send now, and (receiver, line for the operator). `alive`: whether a receiver is
        heard."""
        messages, lines = self.inbox.tick(now)
        for receiver, offer in list(self._offers.items()):
            line = self._check_offer(receiver, offer, now, alive(receiver))
            if line:
                lines.append((receiver, line))
            if not offer.given_up:
                messages += [(receiver, message) for message in offer.sender.tick(now)]
        return messages, lines

    def _check_offer(self, receiver: int, offer: _Offer, now: float, alive: bool) -> str:
        """Give an offer up, or resume it; returns a line for the operator or ""."""
        name = offer.package.name
        if not offer.given_up:
            if offer.sender.finished or now - offer.answered_at < NO_ANSWER_S:
                return ""
            offer.given_up, offer.alive = True, alive
            if alive:
                return f"Mission {name!r} not shared: no answer. 'handover share' tries again."
            return f"Mission {name!r} not shared: not heard. It will be offered when it is."
        came_back, offer.alive = alive and not offer.alive, alive
        if not came_back:
            return ""
        if self.held is None or offer.package.digest != self.held.digest:  # another package has been accepted since
            del self._offers[receiver]
            return ""
        offer.sender = _sender(offer.package, offer.target, offer.until_loaded)
        offer.answered_at, offer.given_up = now, False
        return f"Heard again: offering mission {name!r}."

    def on_message(self, sender: int, component: int, message: Any, now: float) -> tuple[list[Any], str]:
        """A package message of system `sender`; returns the answers to it, and a line for the operator or ""."""
        if message.get_type() == "MISSION_PACKAGE_ACK":
            return self._on_ack(sender, message, now)
        return self.inbox.on_message(sender, component, message), ""

    def _on_ack(self, sender: int, ack: Any, now: float) -> tuple[list[Any], str]:
        offer = self._offers.get(sender)
        if offer is None or ack.package_id != package_id(offer.package.digest):
            return [], ""
        offer.answered_at, offer.given_up = now, False
        outgoing = offer.sender
        was_finished = outgoing.result
        messages = outgoing.on_ack(ack, now)
        if outgoing.result == was_finished:
            return messages, ""
        if outgoing.result == _REFUSED:
            return messages, f"Mission refused: {outgoing.text}"
        if outgoing.result == _RECEIVED:
            return messages, "Mission received."
        if outgoing.text:  # the vehicle is in flight
            return messages, f"The vehicle has this mission: {outgoing.text}."
        return messages, "Mission loaded: written to the autopilot, read back, equal."


def _sender(package: MissionPackage, target: tuple[int, int], until_loaded: bool) -> PackageSender:
    """A station gets its own addresses of the vehicle, the vehicle those of all stations."""
    addresses = pack_addresses(package.addresses, None if until_loaded else target[0])
    data = package.to_bytes()
    return PackageSender(data, package.digest, package.name, target, until_loaded=until_loaded, addresses=addresses)
