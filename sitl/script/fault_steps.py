# SPDX-License-Identifier: GPL-3.0-or-later

"""The words of a scenario's timeline that break things, and mend them: processes, links, the world around.

Links are known by name where `[impair]` puts the proxy between the two ends: `air-GCSA` from the vehicle to a station
(`air-GCSA-wifi` where it has several), `ground-GCSA-GCSB` from one station to another, one direction only. A `*` in a
name stands for anything. In `handover bench hosts` the paths of its network have names as well: `wired`, `lte`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from sitl.script.box_orders import parse_order
from sitl.script.steps import Deed, Running, Stage, done_at_once

__all__ = ["CLOSINGS", "FAULT_STEPS", "Box", "Close", "Crash", "Impair", "Kill", "Restart", "World"]


@dataclass(frozen=True, slots=True)
class Kill(Deed):
    """A process killed with SIGKILL: "companion" (with its supervisor: it stays dead) or a station's name."""

    value: str

    def processes(self) -> tuple[str, ...]:
        return (self.value,)

    def describe(self) -> str:
        return f"{self.value} is killed"

    def begin(self, stage: Stage) -> Running:
        stage.kill(self.value)
        return Running(done_at_once)


@dataclass(frozen=True, slots=True)
class Crash(Deed):
    """The MAVProxy that a process supervises, killed with SIGKILL: "companion". It is started again by itself."""

    value: str

    def processes(self) -> tuple[str, ...]:
        return (self.value,)

    def describe(self) -> str:
        return f"the MAVProxy of {self.value} is killed, its supervisor is not"

    def begin(self, stage: Stage) -> Running:
        stage.crash(self.value)
        return Running(done_at_once)


#: how a station is closed
CLOSINGS: Final = ("terminate", "hang up", "interrupt", "end of input", "exit")


@dataclass(frozen=True, slots=True)
class Close(Deed):
    """A station that is told to end. It writes `unloaded` into its journal when it does.

    `how`: "terminate" (SIGTERM), "hang up" (SIGHUP), "interrupt" (SIGINT), "end of input", or the word "exit".
    """

    station: str
    how: str

    def __post_init__(self) -> None:
        if self.how not in CLOSINGS:
            raise ValueError(f"how: {self.how!r} must be one of {', '.join(CLOSINGS)}")

    def processes(self) -> tuple[str, ...]:
        return (self.station,)

    def describe(self) -> str:
        return f"{self.station} is closed ({self.how})"

    def begin(self, stage: Stage) -> Running:
        stage.close(self.station, self.how)
        return Running(done_at_once)


@dataclass(frozen=True, slots=True)
class Restart(Deed):
    """A process that was killed or closed, started again with the same command line in the same folder."""

    value: str

    def processes(self) -> tuple[str, ...]:
        return (self.value,)

    def describe(self) -> str:
        return f"{self.value} is started again"

    def begin(self, stage: Stage) -> Running:
        stage.restart(self.value)
        return Running(done_at_once)


@dataclass(frozen=True, slots=True)
class Impair(Deed):
    """Orders to the proxies between the programs, one or several; to a serial line "cut" and "heal".

    They are those of `python -m sitl.run.bad_links`.
    """

    value: tuple[str, ...]

    def __post_init__(self) -> None:
        for line in self.value:
            if len(line.split()) < 2:
                raise ValueError(f"{line!r} must be an order and a link: 'cut air-GCSA', 'loss * 0.2'")

    def describe(self) -> str:
        return f"links: {', '.join(self.value)}"

    def begin(self, stage: Stage) -> Running:
        answered = stage.impair(self.value)
        return Running(answered)


@dataclass(frozen=True, slots=True)
class World(Deed):
    """A change of the world: a parameter of the simulation itself (SIM_*), or of the guard (HNDO_*).

    The parameters of the guard exist after it has started. No station's authority is needed.
    """

    name: str
    value: float

    def __post_init__(self) -> None:
        if not self.name.startswith(("SIM_", "HNDO_")):
            raise ValueError(f"name: {self.name!r} must begin with SIM_ or HNDO_: a station sets the others")

    def describe(self) -> str:
        return f"{self.name} is {self.value:g}"

    def begin(self, stage: Stage) -> Running:
        return Running(stage.change_world(self.name, self.value))


@dataclass(frozen=True, slots=True)
class Box(Deed):
    """The position box gets an order: "stall", "restart 3", "drift 0 4", and the others of `sitl/run/data_box.py`."""

    value: str

    def __post_init__(self) -> None:
        parse_order(self.value)

    def describe(self) -> str:
        return f"position box: {self.value}"

    def begin(self, stage: Stage) -> Running:
        return Running(stage.box(self.value))


@dataclass(frozen=True, slots=True)
class Guard(Deed):
    """Switches the guard off (false) or on, without any station's authority."""

    value: bool

    def describe(self) -> str:
        return f"the guard is switched {'on' if self.value else 'off'}"

    def begin(self, stage: Stage) -> Running:
        return Running(stage.change_world("HNDO_ENABLE", float(self.value)))


@dataclass(frozen=True, slots=True)
class Transmit(Deed):
    """A pilot moves the flight mode switch of the transmitter, 1 to 6, and so switches it on; 0: off."""

    value: int

    def __post_init__(self) -> None:
        if not 0 <= self.value <= 6:
            raise ValueError(f"{self.value} must be 1 to 6, or 0: off")

    def describe(self) -> str:
        return f"the pilot's switch is at {self.value}" if self.value else "the pilot's transmitter is off"

    def begin(self, stage: Stage) -> Running:
        stage.transmit(self.value or None)
        return Running(done_at_once)


#: word in the file -> step
FAULT_STEPS: Mapping[str, type[Deed]] = {
    "kill": Kill,
    "crash": Crash,
    "close": Close,
    "restart": Restart,
    "impair": Impair,
    "world": World,
    "box": Box,
    "guard": Guard,
    "pilot": Transmit,
}
