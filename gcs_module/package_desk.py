# SPDX-License-Identifier: GPL-3.0-or-later

"""The station's mission package: the one it holds, those it sends, the one it receives from another station."""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.mission.package import MissionPackage, from_bytes
from mavproxy_handover.wire.package_transfer import PackageReceiver, PackageSender

__all__ = ["PackageDesk"]

_RECEIVED = mavlink.HANDOVER_PACKAGE_RESULT_RECEIVED
_REFUSED = mavlink.HANDOVER_PACKAGE_RESULT_REFUSED


class PackageDesk:
    """Sends the held package to any number of receivers at once, by system id; receives one at a time."""

    def __init__(self, held: MissionPackage | None) -> None:
        self.held = held
        self._senders: dict[int, PackageSender] = {}
        self._receiver = PackageReceiver()

    def offer(self, receiver: int, component: int, *, until_loaded: bool = False) -> None:
        """Begin to send the held package to `receiver`. There must be one.

        `until_loaded`: the receiver is the vehicle, which has the last word when the autopilot holds the mission.
        """
        assert self.held is not None
        held, target = self.held, (receiver, component)
        self._senders[receiver] = PackageSender(
            held.to_bytes(), held.digest, held.name, target, until_loaded=until_loaded
        )

    def tick(self, now: float) -> list[tuple[int, Any]]:
        """(receiver, message) to send now."""
        return [(receiver, message) for receiver, sender in self._senders.items() for message in sender.tick(now)]

    def on_message(self, sender: int, component: int, message: Any, now: float) -> tuple[list[Any], str]:
        """Take in a package message of system `sender`; returns answers to it, and a line for the operator or ""."""
        kind = message.get_type()
        if kind == "MISSION_PACKAGE_ACK":
            return self._on_ack(sender, message, now)
        target = (sender, component)
        if kind == "MISSION_PACKAGE":
            return self._receiver.on_offer(message, target), ""
        answers, whole = self._receiver.on_chunk(message, target)
        if whole is None:
            return answers, ""
        digest, data = whole
        try:
            package = from_bytes(data)
            if package.digest != digest:
                raise MissionError("the contents do not have the digest that was promised")
        except MissionError as error:
            return [
                *answers,
                self._receiver.conclude(digest, _REFUSED, str(error), target),
            ], f"Mission refused: {error}"
        self.held = package
        line = f"Mission {package.name!r} received, {digest.hex()[:8]}."
        return [*answers, self._receiver.conclude(digest, _RECEIVED, "", target)], line

    def _on_ack(self, sender: int, ack: Any, now: float) -> tuple[list[Any], str]:
        outgoing = self._senders.get(sender)
        if outgoing is None:
            return [], ""
        was_finished = outgoing.result
        messages = outgoing.on_ack(ack, now)
        if outgoing.result == was_finished:
            return messages, ""
        if outgoing.result == _REFUSED:
            return messages, f"Mission refused: {outgoing.text}"
        if outgoing.result == _RECEIVED:
            return messages, "Mission received."
        return messages, "Mission loaded: written to the autopilot, read back, equal."
