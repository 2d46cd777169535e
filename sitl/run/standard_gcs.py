# SPDX-License-Identifier: GPL-3.0-or-later

"""A ground station that speaks only the MAVLink standard: `python -m sitl.run.standard_gcs`.

It stands for any ground station program that knows the operator-control protocol of 2026. It sends heartbeats,
commands, and requests of control. It believes only the system manager's CONTROL_STATUS about which station is in
control. It acknowledges the manager's question at once and leaves the answer to its operator. A station that never asks
for control is a program without the protocol. The vehicle's texts are in its journal. The operator types:

    start pause continue land rtl arm mode    commands, repeated until acknowledged; mode: RTL

    upload param                              a mission of one item, a value for FS_OPTIONS, each once

    request  release                          control for this station, or for no station

    allow                                     the answer to the question: takeover allowed

    measure COUNT INTERVAL_S                  COUNT times a command, each once, and how long the acknowledgements take

What is measured is SET_MESSAGE_INTERVAL. The gate passes it to the autopilot if it comes from the commander. The
companion does not judge it by the situation, as it does CONTINUE, so none is refused near a border.

It ends when its input does. It uses no code of the vehicle's or the station's module.
"""

from __future__ import annotations

import argparse
import json
import select
import socket
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, TextIO

# the dialect of this project for CONTROL_STATUS and the command 32100 alone: pymavlink does not have them yet
from pymavlink.dialects.v20 import handover as mavlink

from sitl.run.ending import Orders
from sitl.vehicles.ports import LOOPBACK

__all__ = ["StandardGcs", "main"]

_COMMAND = mavlink.MAV_CMD_REQUEST_OPERATOR_CONTROL
_PAUSE = mavlink.MAV_CMD_DO_PAUSE_CONTINUE
_MEASURED = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
#: the message whose default rate is asked for
_MEASURED_PARAMETERS = (float(mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT), 0.0)
_HEARTBEAT_S = 1.0
_TRY_S, _TRIES = 1.5, 3
#: a command in progress may take that long to end
_END_S = 60.0
#: no acknowledgement after that long: lost
_LOST_S = 2.0
_EPOCH_2015_S = 1420070400
#: word -> command and its parameters
_WORDS: dict[str, tuple[int, tuple[float, ...]]] = {
    "start": (mavlink.MAV_CMD_MISSION_START, ()),
    "pause": (_PAUSE, (0.0,)),
    "continue": (_PAUSE, (1.0,)),
    "land": (mavlink.MAV_CMD_NAV_LAND, ()),
    "rtl": (mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH, ()),
    "arm": (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (1.0,)),
    "mode": (mavlink.MAV_CMD_DO_SET_MODE, (1.0, 6.0)),
}
#: a piece of a text that is shorter ends it
_PIECE = 50


@dataclass(slots=True)
class _Asked:
    """A command without a final answer."""

    word: str
    command: int
    parameters: tuple[float, ...]
    again_at: float
    tries: int = 1


@dataclass(slots=True)
class _Measurement:
    """The measured command in a row. `waiting`: when those were sent that are not acknowledged yet, oldest first."""

    left: int
    interval_s: float
    due_at: float
    waiting: deque[float]
    times_s: list[float]
    lost: int = 0
    refused: int = 0


class StandardGcs:
    """The station's part. Times are monotonic seconds."""

    def __init__(self, name: str, sysid: int, vehicle: int, listen: int, journal: TextIO, key: bytes | None) -> None:
        """Raises OSError: port in use."""
        self.name = name
        self.vehicle = vehicle
        self._journal = journal
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind((LOOPBACK, listen))
        self.socket.setblocking(False)
        self._peer: tuple[str, int] | None = None
        self._mav: Any = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=mavlink.MAV_COMP_ID_MISSIONPLANNER)
        self._mav.robust_parsing = True
        if key is not None:
            self._mav.signing.secret_key = key
            self._mav.signing.sign_outgoing = True
            self._mav.signing.timestamp = int((time.time() - _EPOCH_2015_S) * 1e5)
        self._sysid = sysid
        self._beat_at = 0.0
        self._owner: int | None = None
        #: component that manages control, learnt from CONTROL_STATUS
        self._manager = 0
        self._asked: list[_Asked] = []
        self._measurement: _Measurement | None = None
        #: what has come of texts in pieces, by component and id
        self._pieces: dict[tuple[int, int], str] = {}
        self.note("loaded", "a station of the MAVLink standard")

    def note(self, event: str, text: str = "", **values: object) -> None:
        """Write to the journal."""
        now = datetime.now(timezone.utc).isoformat(timespec="milliseconds")
        entry = {"t": round(time.monotonic(), 4), "utc": now, "who": self.name, "event": event, "text": text, **values}
        self._journal.write(json.dumps(entry) + "\n")

    # ---- in ---------------------------------------------------------------------------------------------------------

    def readable(self, now: float) -> None:
        """Take in what has come."""
        while True:
            try:
                data, address = self.socket.recvfrom(65536)
            except OSError:
                return
            for message in self._mav.parse_buffer(data) or ():
                if message.get_srcSystem() == self.vehicle and message.get_type() != "BAD_DATA":
                    self._peer = address
                    self._on_message(message, now)

    def _on_message(self, message: Any, now: float) -> None:
        kind = message.get_type()
        if kind == "CONTROL_STATUS":
            self._on_status(message)
        elif kind == "COMMAND_ACK" and message.target_system in (0, self._sysid):
            self._on_ack(message, now)
        elif kind == "COMMAND_LONG" and message.command == _COMMAND and message.target_system == self._sysid:
            self._on_question(message)
        elif kind == "MISSION_ACK" and message.target_system == self._sysid:
            self.note("upload", f"mission answered by {message.type}", result=message.type)
        elif kind == "PARAM_ERROR" and message.target_system == self._sysid:
            self.note("parameter", f"{message.param_id} answered by {message.error}", result=message.error)
        elif kind == "STATUSTEXT":
            self._on_text(message)

    def _on_text(self, message: Any) -> None:
        key = message.get_srcComponent(), message.id
        text = self._pieces.pop(key, "") + message.text
        if message.id and len(message.text) == _PIECE:
            self._pieces[key] = text
            return
        self.note("said", " ".join(text.split()), severity=message.severity, component=key[0])

    def _on_status(self, message: Any) -> None:
        if not message.flags & mavlink.GCS_CONTROL_STATUS_FLAGS_SYSTEM_MANAGER:
            return
        self._manager = message.get_srcComponent()
        if message.gcs_main != self._owner:
            self._owner = message.gcs_main
            text = f"station {self._owner} is in control" if self._owner else "no station is in control"
            self.note("control", text, owner=self._owner, own=self._owner == self._sysid)

    def _on_question(self, message: Any) -> None:
        """The manager reports that a station asks for control; this must be acknowledged at once."""
        asker = int(message.param4)
        result = mavlink.MAV_RESULT_ACCEPTED
        self._send(
            mavlink.MAVLink_command_ack_message(
                _COMMAND, result, 0, 0, message.get_srcSystem(), message.get_srcComponent()
            )
        )
        self.note("notified", f"station {asker} asks for control", asker=asker, timeout_s=message.param3)

    def _on_ack(self, message: Any, now: float) -> None:
        measured = self._measurement
        if measured is not None and message.command == _MEASURED and measured.waiting:
            measured.times_s.append(now - measured.waiting.popleft())
            measured.refused += message.result != mavlink.MAV_RESULT_ACCEPTED
            return
        for asked in [asked for asked in self._asked if asked.command == message.command]:
            if message.result == mavlink.MAV_RESULT_IN_PROGRESS:
                asked.again_at, asked.tries = now + _END_S, _TRIES
                continue
            self._asked.remove(asked)
            self._conclude(asked.word, _result_name(message.result))

    def _conclude(self, word: str, result: str) -> None:
        self.note("command", f"{word}: {result}", what=word, result=result)

    # ---- the operator -----------------------------------------------------------------------------------------------

    def order(self, line: str, now: float) -> None:
        """Carry out a line that was typed; what cannot be understood is journalled."""
        word, *rest = line.split() or [""]
        if word in _WORDS and not rest:
            self._ask(word, *_WORDS[word], now)
        elif word in ("request", "allow") and not rest:
            takeover = 1.0 if word == "allow" else 0.0
            self._ask(word, _COMMAND, (1.0, takeover, 30.0, float(self._sysid)), now)
        elif word == "release" and not rest:
            self._ask(word, _COMMAND, (0.0, 0.0, 0.0, float(self._sysid)), now)
        elif word == "upload" and not rest:
            kind = mavlink.MAV_MISSION_TYPE_MISSION
            self._send(mavlink.MAVLink_mission_count_message(self.vehicle, mavlink.MAV_COMP_ID_AUTOPILOT1, 1, kind))
        elif word == "param" and not rest:
            target = self.vehicle, mavlink.MAV_COMP_ID_AUTOPILOT1
            self._send(mavlink.MAVLink_param_set_message(*target, b"FS_OPTIONS", 0.0, mavlink.MAV_PARAM_TYPE_REAL32))
        elif word == "measure" and len(rest) == 2 and rest[0].isdecimal():
            self._measurement = _Measurement(int(rest[0]), float(rest[1]), now, deque(), [])
        else:
            self.note("fault", f"not understood: {line!r}")

    def _ask(self, word: str, command: int, parameters: tuple[float, ...], now: float) -> None:
        self._asked.append(_Asked(word, command, parameters, now + _TRY_S))
        self._command(command, parameters)

    def _command(self, command: int, parameters: tuple[float, ...]) -> None:
        component = self._manager if command == _COMMAND else mavlink.MAV_COMP_ID_AUTOPILOT1
        values = (*parameters, *([0.0] * (7 - len(parameters))))
        self._send(mavlink.MAVLink_command_long_message(self.vehicle, component, command, 0, *values))

    def _send(self, message: Any) -> None:
        if self._peer is None:
            return
        try:
            self.socket.sendto(message.pack(self._mav), self._peer)
        except OSError:  # no receiver now
            pass
        self._mav.seq = (self._mav.seq + 1) % 256

    # ---- time -------------------------------------------------------------------------------------------------------

    def tick(self, now: float) -> None:
        """Heartbeats, repetitions, the measurement."""
        if now >= self._beat_at:
            self._beat_at = now + _HEARTBEAT_S
            self._send(
                mavlink.MAVLink_heartbeat_message(
                    mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
                )
            )
        for asked in list(self._asked):
            if now < asked.again_at:
                continue
            if asked.tries == _TRIES:
                self._asked.remove(asked)
                self._conclude(asked.word, "no answer")
                continue
            asked.tries, asked.again_at = asked.tries + 1, now + _TRY_S
            self._command(asked.command, asked.parameters)
        self._measure(now)

    def _measure(self, now: float) -> None:
        measured = self._measurement
        if measured is None:
            return
        while measured.waiting and now - measured.waiting[0] > _LOST_S:
            measured.waiting.popleft()
            measured.lost += 1
        if measured.left and now >= measured.due_at:
            measured.left -= 1
            measured.due_at += measured.interval_s
            measured.waiting.append(now)
            self._command(_MEASURED, _MEASURED_PARAMETERS)
        if measured.left or measured.waiting:
            return
        self._measurement = None
        times = sorted(measured.times_s) or [float("inf")]
        median, most = times[len(times) // 2], times[min(len(times) - 1, int(len(times) * 0.99))]
        self.note(
            "measured",
            f"{len(measured.times_s)} commands: median {median * 1000:.1f} ms, 99 % {most * 1000:.1f} ms",
            count=len(measured.times_s),
            lost=measured.lost,
            refused=measured.refused,
            median_ms=round(median * 1000, 2),
            p99_ms=round(most * 1000, 2),
            max_ms=round(times[-1] * 1000, 2),
        )


def _result_name(result: int) -> str:
    names = mavlink.enums["MAV_RESULT"]
    return names[result].name.removeprefix("MAV_RESULT_").lower() if result in names else str(result)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the station until standard input ends."""
    parser = argparse.ArgumentParser(prog="python -m sitl.run.standard_gcs", description="A station of the standard.")
    parser.add_argument("--name", required=True)
    parser.add_argument("--sysid", type=int, required=True)
    parser.add_argument("--vehicle", type=int, default=1, help="its system id")
    parser.add_argument("--listen", type=int, required=True, help="UDP port on 127.0.0.1")
    parser.add_argument("--journal", type=Path, required=True)
    parser.add_argument("--key", type=Path, help="file with 64 hexadecimal digits: frames are signed and checked")
    arguments = parser.parse_args(argv)
    key = None if arguments.key is None else bytes.fromhex(arguments.key.read_text(encoding="ascii").strip())

    orders = Orders()
    with arguments.journal.open("a", encoding="utf-8", buffering=1) as journal:
        station = StandardGcs(arguments.name, arguments.sysid, arguments.vehicle, arguments.listen, journal, key)
        _serve(station, orders)
    return 0


def _serve(station: StandardGcs, orders: Orders) -> None:
    sources: list[Any] = [*orders.descriptors, station.socket]
    while True:
        readable, _, _ = select.select(sources, [], [], 0.01)
        now = time.monotonic()
        if station.socket in readable:
            station.readable(now)
        for descriptor in orders.descriptors:
            lines = orders.read(descriptor) if descriptor in readable else []
            if lines is None:
                return
            for line in lines:
                station.order(line, now)
        station.tick(now)


if __name__ == "__main__":
    raise SystemExit(main())
