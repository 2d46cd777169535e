# SPDX-License-Identifier: GPL-3.0-or-later

"""A system manager of the MAVLink operator-control standard, built from the standard's text: a test double.

It uses no code of this project but the dialect. Its rules, in the words of the layout of 2026:

* CONTROL_STATUS once a second and at every change: flags (1 system manager, 2 takeover allowed), the station in control
  or 0.
* A request (32100, p1 1) of the owner, of any station while nobody is in control, or while takeover is allowed: granted
  and ACCEPTED; p2 says whether the next takeover is allowed.
* Else FAILED, and the same command goes to the owner, with the requester in p4, until the owner acknowledges it or p3
  seconds are over.
* A release (p1 0) counts from the owner only.
* A command that changes the vehicle, from another station than the owner: result 10, NOT_IN_CONTROL.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import handover as mavlink

__all__ = ["NOT_IN_CONTROL", "REQUEST", "Manager"]

REQUEST = 32100
NOT_IN_CONTROL = 10
_ACCEPTED, _DENIED, _FAILED = 0, 2, 4
_NOTIFY_S, _STATUS_S = 1.0, 1.0


@dataclass
class _Pending:
    """A request that the owner has not acknowledged yet."""

    owner: int
    requester: int
    timeout_s: float
    until: float
    next_at: float
    copies: int = 0


class Manager:
    """One component of a vehicle. `out`: (system, component, message) that it has sent since this was last emptied."""

    def __init__(self, sysid: int = 1, component: int = 1, *, permitted: tuple[int, ...] = (251, 252, 253)) -> None:
        self.sysid, self.component, self.permitted = sysid, component, permitted
        self.owner = 0
        self.takeover = False
        self.silent = False
        #: answers nothing, though it sends its status
        self.deaf = False
        self.manages = True
        self.out: list[tuple[int, int, Any]] = []
        self.granted: list[str] = []
        self.acknowledged: list[int] = []
        self._status_at = 0.0
        self._pending: _Pending | None = None

    def tick(self, now: float) -> None:
        """Send what is due."""
        if now >= self._status_at:
            self._say_status(now)
        asked = self._pending
        if asked is None:
            return
        if now >= asked.until:
            self._pending = None
        elif now >= asked.next_at:
            asked.next_at = now + _NOTIFY_S
            self._send(
                mavlink.MAVLink_command_long_message(
                    asked.owner, 0, REQUEST, min(asked.copies, 255), 1, 0, asked.timeout_s, asked.requester, 0, 0, 0
                )
            )
            asked.copies += 1

    def receive(self, sender: int, message: Any, now: float) -> None:
        """A message of a station."""
        if self.deaf:
            return
        kind = message.get_type()
        if kind == "COMMAND_ACK" and message.command == REQUEST:
            if self._pending is not None and sender == self._pending.owner and message.result == _ACCEPTED:
                self.acknowledged.append(sender)
                self._pending = None
        elif kind == "COMMAND_LONG" and message.target_system == self.sysid:
            if message.command == REQUEST:
                if message.target_component == self.component:
                    self._answer(sender, message, self._request(sender, message, now))
                    self._say_status(now)
            elif sender == self.owner:
                self.granted.append(mavlink.enums["MAV_CMD"][message.command].name)
                self._answer(sender, message, _ACCEPTED)
            else:
                self._answer(sender, message, NOT_IN_CONTROL)

    def _request(self, sender: int, message: Any, now: float) -> int:
        if sender not in self.permitted or message.param4 != sender:
            return _DENIED
        if message.param1 == 0:
            if sender != self.owner:
                return _DENIED
            self.owner, self.takeover = 0, False
            return _ACCEPTED
        if self.owner in (0, sender) or self.takeover:
            self.owner, self.takeover, self._pending = sender, message.param2 == 1, None
            return _ACCEPTED
        if self._pending is None or self._pending.requester != sender:
            self._pending = _Pending(self.owner, sender, message.param3, now + message.param3, now)
        return _FAILED

    def _answer(self, sender: int, message: Any, result: int) -> None:
        self._send(mavlink.MAVLink_command_ack_message(message.command, result, 0, 0, sender, 190))

    def _say_status(self, now: float) -> None:
        self._status_at = now + _STATUS_S
        flags = (1 if self.manages else 0) + (2 if self.takeover else 0)
        self._send(mavlink.MAVLink_control_status_message(flags, self.owner, [0] * 10))

    def _send(self, message: Any) -> None:
        if not self.silent:
            self.out.append((self.sysid, self.component, message))
