# SPDX-License-Identifier: GPL-3.0-or-later

"""The model on a test bench: no sockets, no clock, as fast as it computes.

`Bench` plays the other end of the vehicle's channels: it sends messages as any system and component, lets
simulated time pass and keeps everything that comes back. Nothing in here is used in a simulation; tests and
experiments are its users.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import all as dialect

from sitl.vehicles.builtin.framing import FrameSplitter, decode
from sitl.vehicles.builtin.items import Item
from sitl.vehicles.builtin.vehicle import STEP_S, Vehicle, VehicleConfig

__all__ = ["COMPANION", "Bench", "Heard"]

COMPANION = (1, 191)
_HOME = (52.679, 5.924, 10.0, 0.0)
_PATIENCE_S = 2.0


@dataclass(frozen=True, slots=True)
class Heard:
    """A message of the vehicle, with the simulated time and the channel it came on."""

    time_s: float
    channel: int
    message: Any


class Bench:
    """A vehicle with clients on its channels."""

    def __init__(
        self,
        parameters: dict[str, float] | None = None,
        scripts: Sequence[Path] = (),
        channels: Sequence[int] = (1,),
        home: tuple[float, float, float, float] = _HOME,
        sysid: int = 1,
    ) -> None:
        self.records: list[str] = []
        config = VehicleConfig(
            home=home,
            sysid=sysid,
            scripts=tuple(scripts),
            channels=tuple(channels),
            record=self.records.append,
            overrides={"FS_THR_ENABLE": 0, "BATT_MONITOR": 4, "SCR_ENABLE": 1, **(parameters or {})},
        )
        self.vehicle = Vehicle(config)
        self.heard: list[Heard] = []
        self._splitters = {channel: FrameSplitter() for channel in channels}
        self._encoders: dict[tuple[int, int], dialect.MAVLink] = {}
        for link in self.vehicle.links.values():
            link.attach()

    @property
    def now_s(self) -> float:
        return self.vehicle.copter.time_s

    def send(self, message: dialect.MAVLink_message, source: tuple[int, int] = COMPANION, channel: int = 1) -> None:
        """Send a message to the vehicle as system and component `source`."""
        encoder = self._encoders.setdefault(source, dialect.MAVLink(None, *source))
        self.vehicle.receive(channel, message.pack(encoder))
        encoder.seq = (encoder.seq + 1) % 256
        self._collect()

    def run(
        self,
        seconds: float,
        until: Callable[[], bool] | None = None,
        every_s: float = 0.2,
        do: Callable[[], None] | None = None,
    ) -> bool:
        """Let time pass, calling `do` every `every_s`; stops early, and returns True, when `until` holds."""
        end_s, due_s = self.now_s + seconds, self.now_s
        while self.now_s < end_s - STEP_S / 2:
            if do is not None and self.now_s >= due_s:
                due_s += every_s
                do()
            self.vehicle.step()
            self._collect()
            if until is not None and until():
                return True
        return False

    def ask(self, message: dialect.MAVLink_message, answer: str, **sender: Any) -> Any:
        """Send and wait two simulated seconds for a message of type `answer`; None if there is none."""
        start = len(self.heard)
        self.send(message, **sender)
        if self.last(answer, start) is None:
            self.run(_PATIENCE_S, until=lambda: self.last(answer, start) is not None)
        return self.last(answer, start)

    def command(self, command: int, *params: float, **sender: Any) -> int | None:
        """COMMAND_LONG; returns the MAV_RESULT, None without an acknowledgement."""
        filled = [*params, *([0.0] * (7 - len(params)))]
        ack = self.ask(dialect.MAVLink_command_long_message(1, 1, command, 0, *filled), "COMMAND_ACK", **sender)
        return None if ack is None else int(ack.result)

    def upload(self, items: Sequence[Item], kind: int = 0, **sender: Any) -> int | None:
        """Upload items; returns the MAV_MISSION_RESULT, None if the vehicle stopped asking."""
        start = len(self.heard)
        self.send(dialect.MAVLink_mission_count_message(1, 1, len(items), kind), **sender)
        for _ in range(len(items) + 1):
            wanted = self._next_of(("MISSION_REQUEST", "MISSION_ACK"), start)
            if wanted is None:
                return None
            start = wanted[0] + 1
            if wanted[1].get_type() == "MISSION_ACK":
                return int(wanted[1].type)
            item = items[wanted[1].seq]
            head = (1, 1, wanted[1].seq, item.frame, item.command, 0, item.autocontinue, *item.params)
            self.send(dialect.MAVLink_mission_item_int_message(*head, item.x, item.y, item.z, kind), **sender)
        wanted = self._next_of(("MISSION_ACK",), start)
        return None if wanted is None else int(wanted[1].type)

    def download(self, kind: int = 0, **sender: Any) -> list[Item]:
        """Read back all items of a kind."""
        count = self.ask(dialect.MAVLink_mission_request_list_message(1, 1, kind), "MISSION_COUNT", **sender)
        items = []
        for index in range(count.count):
            m = self.ask(dialect.MAVLink_mission_request_int_message(1, 1, index, kind), "MISSION_ITEM_INT", **sender)
            params = (m.param1, m.param2, m.param3, m.param4)
            items.append(Item(m.command, m.frame, *params, m.x, m.y, m.z, m.autocontinue))
        return items

    def last(self, kind: str, start: int = 0) -> Any:
        """The newest message of a type heard since index `start`."""
        found = [h.message for h in self.heard[start:] if h.message.get_type() == kind]
        return found[-1] if found else None

    def texts(self) -> list[str]:
        return [h.message.text for h in self.heard if h.message.get_type() == "STATUSTEXT"]

    def fly(self, height_m: float = 20.0) -> None:
        """Arm in GUIDED and climb, from a ready vehicle on the ground."""
        results = [self.command(176, 1, 4), self.command(400, 1), self.command(22, 0, 0, 0, 0, 0, 0, height_m)]
        if results != [0, 0, 0]:
            raise AssertionError(f"take-off refused: {results} {self.texts()[-3:]}")
        if not self.run(60, until=lambda: self.vehicle.copter.above_home_m() > height_m - 0.5):
            raise AssertionError("did not climb")

    def _next_of(self, kinds: tuple[str, ...], start: int) -> tuple[int, Any] | None:
        def find() -> tuple[int, Any] | None:
            for index in range(start, len(self.heard)):
                if self.heard[index].message.get_type() in kinds:
                    return index, self.heard[index].message
            return None

        if find() is None:
            self.run(_PATIENCE_S, until=lambda: find() is not None)
        return find()

    def _collect(self) -> None:
        for channel, splitter in self._splitters.items():
            for frame in splitter.push(self.vehicle.take(channel)):
                message = decode(frame)
                if message is not None:
                    self.heard.append(Heard(self.now_s, channel, message))
