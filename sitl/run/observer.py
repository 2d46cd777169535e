# SPDX-License-Identifier: GPL-3.0-or-later

"""The passive monitor: listens on the vehicle's second port and journals what the aircraft truly did.

It must not disturb the flight, so it sends no heartbeat and no command that moves anything. It requests two things: the
firmware's version, and the landed state at 5 Hz. It uses the vehicle's own system id and a free component id, and
addresses the autopilot, so that nothing is passed on to other ports. The request is needed for more than its answer:
ArduPilot sends STATUSTEXT only to ports on which it has heard something. The vehicle's parameters set the streams. If a
scenario changes the world (wind, say), it sets the simulation's parameter in the same way. Programs that watch along
(`watchers.py`) get everything that comes, and may read the autopilot's parameters and missions.
"""

from __future__ import annotations

import math
import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.report.journal_reader import Entry
from sitl.report.watch import Watch
from sitl.run.pacing import BOOT_INTERVAL_S, Pacing
from sitl.run.watchers import Watchers

__all__ = ["Observer"]

_COMPONENT = mavlink.MAV_COMP_ID_USER1
_ASK_INTERVAL_S = 1.0
_LANDED_STATE_INTERVAL_US = 200_000


class Observer:
    """Connection to the vehicle plus the journal. `watch` is the aircraft as last heard of."""

    def __init__(
        self,
        address: str,
        sysid: int,
        speedup: float,
        journal: Path,
        watchers: Watchers | None = None,
        clock: Callable[[], float] = time.monotonic,
        pacing: Pacing | None = None,
    ) -> None:
        """Connect to `tcp:HOST:PORT`. Raises OSError if nothing listens there.

        `watchers`: see `watchers.py`; `clock`: the time in the journal; `speedup`: simulated seconds in a second of it;
        `pacing`: of a vehicle that does not know the page of simulated time.
        """
        self._clock, self._pacing = clock, pacing
        _, host, port = address.split(":")
        self.watch = Watch(sysid, speedup)
        self._sysid = sysid
        self._socket = socket.create_connection((host, int(port)), timeout=5.0)
        self._socket.setblocking(False)
        self._parser: Any = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=_COMPONENT)
        self._parser.robust_parsing = True
        self._journal = journal.open("w", encoding="utf-8", buffering=1)
        self._watchers = watchers or Watchers(())
        self._ask_at = 0.0
        #: parameters of the simulation that were set: what is wanted, and what the vehicle says
        self._wanted: dict[str, float] = {}
        self._said: dict[str, float] = {}
        self._set_at = 0.0
        self.connected = True

    def fileno(self) -> int:
        """For select."""
        return self._socket.fileno()

    def poll(self) -> list[Entry]:
        """Take in all that has come; returns the new entries, which are in the journal as well."""
        found: list[Entry] = []
        while self.connected:
            try:
                data = self._socket.recv(65536)
            except BlockingIOError:
                break
            except OSError:
                data = b""
            now = self._clock()
            if not data:
                self.connected = False
                break
            messages = self._parser.parse_buffer(data) or ()
            self._watchers.show(messages)
            for message in messages:
                if self._pacing is not None:
                    self._pacing.on_message(message)
                found += self.watch.on_message(message, now)
                if message.get_type() == "PARAM_VALUE" and message.param_id in self._wanted:
                    self._said[message.param_id] = message.param_value
        if self._pacing is not None:
            self._pacing.tick()
        self._ask()
        self._set()
        for frame in self._watchers.asked():
            self._write(frame)
        for entry in found:
            self._journal.write(entry.to_line() + "\n")
        return found

    def _ask(self) -> None:
        now = time.monotonic()
        if self.watch.firmware or not self.connected or now < self._ask_at:
            return
        self._ask_at = now + _ASK_INTERVAL_S
        self._command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, 0)
        self._command(
            mavlink.MAV_CMD_SET_MESSAGE_INTERVAL,
            mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
            _LANDED_STATE_INTERVAL_US,
        )
        if self._pacing is not None:
            interval_us = BOOT_INTERVAL_S * 1e6
            self._command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_SYSTEM_TIME, interval_us)

    def change_world(self, name: str, value: float) -> Callable[[], bool]:
        """Set a parameter of the simulation, again until the vehicle has it; the function tells whether it has."""
        self._wanted[name] = value
        self._said.pop(name, None)
        self._set_at = 0.0
        return lambda: self._has(name)

    def _has(self, name: str) -> bool:
        return abs(self._said.get(name, math.inf) - self._wanted[name]) <= 1e-4 * abs(self._wanted[name])

    def _set(self) -> None:
        now = time.monotonic()
        if now < self._set_at or not self.connected:
            return
        self._set_at = now + _ASK_INTERVAL_S
        for name, value in self._wanted.items():
            if not self._has(name):
                kind = mavlink.MAV_PARAM_TYPE_REAL32
                target = (self._sysid, mavlink.MAV_COMP_ID_AUTOPILOT1)
                self._send(mavlink.MAVLink_param_set_message(*target, name.encode("ascii"), value, kind))

    def _command(self, number: int, first: float, second: float) -> None:
        autopilot = mavlink.MAV_COMP_ID_AUTOPILOT1
        self._send(
            mavlink.MAVLink_command_long_message(self._sysid, autopilot, number, 0, first, second, 0, 0, 0, 0, 0)
        )

    def _send(self, message: Any) -> None:
        self._write(message.pack(self._parser))

    def _write(self, frame: bytes) -> None:
        try:
            self._socket.send(frame)
        except OSError:
            self.connected = False

    def close(self) -> None:
        """Close connection and journal."""
        if self._pacing is not None:
            self._pacing.release()
        self.connected = False
        self._socket.close()
        self._watchers.close()
        self._journal.close()
