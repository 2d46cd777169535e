# SPDX-License-Identifier: GPL-3.0-or-later

"""The words of a scenario's timeline: what is done, and what is waited for. A small fixed vocabulary.

What breaks processes and links is in `fault_steps.py`.

`begin` does what the step does and returns a `Running`. The runner asks that again and again until it is done or the
step's time is over. A `wait` looks at the journals' entries since a line was last typed or a process killed; with
`since = "last"` since the entry that the wait before it found, with `since = "begin"` at the whole run. An entry
answers one wait only, so two waits for the same event mean two events.

`steady` is an expectation inside the timeline: it holds over a time, and its outcome stands in the verdict.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from mavproxy_handover.mission.geodesy import distance_m
from sitl.report.journal_reader import Entry
from sitl.report.matching import Match, describe, matches
from sitl.report.watch import Watch

__all__ = ["STEPS", "Deed", "Running", "Stage", "StepFailed", "done_at_once"]

#: from where a `wait` may look
SINCE = ("typed", "last", "begin")

_PLACE = re.compile(r"\{([A-Za-z0-9_-]+)\}")


class StepFailed(Exception):
    """A step can no longer be done. The message says what was seen."""


class Stage(Protocol):
    """The parts of a run that a step may read and change."""

    @property
    def watch(self) -> Watch:
        """The aircraft as last heard of."""

    #: word of `since` -> index of the first entry that a `wait` looks at
    since: dict[str, int]
    #: indexes of the entries that answered a wait
    taken: set[int]

    def entries(self) -> list[Entry]:
        """All journal entries so far, in order of arrival."""

    def sim_s(self) -> float:
        """Simulated time now."""

    def place(self, name: str) -> tuple[float, float]:
        """Latitude and longitude of a place of the scenario."""

    def type(self, process: str, line: str) -> None:
        """Type a line at a process. Raises StepFailed."""

    def kill(self, process: str) -> None:
        """Kill a process. Raises StepFailed."""

    def close(self, process: str, how: str) -> None:
        """Tell a process to end, in a way of `fault_steps.CLOSINGS`. Raises StepFailed."""

    def crash(self, process: str) -> None:
        """Kill what a process supervises. Raises StepFailed."""

    def restart(self, process: str) -> None:
        """Start a process again that was killed. Raises StepFailed."""

    def impair(self, orders: Sequence[str]) -> Callable[[], bool]:
        """Give the proxies orders; the function tells whether all are carried out. Both raise StepFailed."""

    def change_world(self, name: str, value: float) -> Callable[[], bool]:
        """Set a parameter of the simulation; the function tells whether it is set. Raises StepFailed."""

    def box(self, order: str) -> Callable[[], bool]:
        """Give the position box an order; the function tells whether it is carried out. Both raise StepFailed."""

    def transmit(self, position: int | None) -> None:
        """Move the switch of the pilot's transmitter; None: off. Raises StepFailed."""


@dataclass(slots=True)
class Running:
    """A step under way. `seen` tells what was seen so far, for the progress line and for the verdict."""

    done: Callable[[], bool]
    seen: Callable[[], str] = field(default=lambda: "")
    #: monotonic time of what was waited for, where that is known better than when it was noticed
    at: float | None = None


def done_at_once() -> bool:
    """For steps that take no time."""
    return True


@dataclass(frozen=True, slots=True)
class Deed:
    """An act or a wait: the base of the words of a timeline."""

    def places(self) -> tuple[str, ...]:
        """Places that the step names."""
        return ()

    def processes(self) -> tuple[str, ...]:
        """Processes that the step names."""
        return ()

    def at_least_s(self) -> float:
        """Simulated seconds that the step takes at any rate."""
        return 0.0

    def describe(self) -> str:
        """The step in words, for the story: "waiting for ..."."""
        raise NotImplementedError

    def begin(self, stage: Stage) -> Running:
        """Do it. Raises StepFailed."""
        raise NotImplementedError


@dataclass(frozen=True, slots=True)
class Wait(Deed):
    """Until a journal has an entry with this source, this event and these values."""

    event: str
    who: str = ""
    since: str = "typed"
    match: Match = field(default_factory=Match)

    def __post_init__(self) -> None:
        if self.since not in SINCE:
            raise ValueError(f"since: {self.since!r} must be one of {', '.join(SINCE)}")

    def describe(self) -> str:
        return describe(self.who, self.event, self.match)

    def begin(self, stage: Stage) -> Running:
        look_at = stage.since[self.since]

        def done() -> bool:
            nonlocal look_at
            entries = stage.entries()
            while look_at < len(entries):
                index, look_at = look_at, look_at + 1
                if index not in stage.taken and matches(entries[index], self.who, self.event, self.match):
                    stage.taken.add(index)
                    stage.since["last"] = index + 1
                    running.at = entries[index].t
                    return True
            return False

        running = Running(done, lambda: _flight(stage.watch))
        return running


@dataclass(frozen=True, slots=True)
class Type(Deed):
    """A line typed at the console of a station or of the rogue; {place} stands for its latitude and longitude."""

    station: str
    line: str

    def processes(self) -> tuple[str, ...]:
        return (self.station,)

    def places(self) -> tuple[str, ...]:
        return tuple(_PLACE.findall(self.line))

    def describe(self) -> str:
        return f"{self.station} types: {self.line}"

    def begin(self, stage: Stage) -> Running:
        def coordinates(found: re.Match[str]) -> str:
            return "{:.7f} {:.7f}".format(*stage.place(found.group(1)))

        stage.type(self.station, _PLACE.sub(coordinates, self.line))
        return Running(done_at_once)


@dataclass(frozen=True, slots=True)
class WaitReady(Deed):
    """Until the autopilot knows where it is and could be armed in GUIDED."""

    value: bool

    def describe(self) -> str:
        return "the autopilot's position estimate"

    def begin(self, stage: Stage) -> Running:
        return Running(lambda: stage.watch.position_ready, lambda: "no absolute position estimate")


@dataclass(frozen=True, slots=True)
class WaitMode(Deed):
    """Until the autopilot shows a flight mode."""

    value: str

    def describe(self) -> str:
        return f"mode {self.value}"

    def begin(self, stage: Stage) -> Running:
        return Running(lambda: stage.watch.mode == self.value, lambda: f"mode {stage.watch.mode}")


@dataclass(frozen=True, slots=True)
class WaitArmed(Deed):
    """Until the motors are armed (true) or not (false)."""

    value: bool

    def describe(self) -> str:
        return "arming" if self.value else "disarming"

    def begin(self, stage: Stage) -> Running:
        return Running(lambda: stage.watch.armed is self.value, lambda: "armed" if stage.watch.armed else "not armed")


@dataclass(frozen=True, slots=True)
class WaitReached(Deed):
    """Until the autopilot says that it reached a mission item."""

    value: int

    def describe(self) -> str:
        return f"mission item {self.value}"

    def begin(self, stage: Stage) -> Running:
        return Running(
            lambda: self.value in stage.watch.reached,
            lambda: f"reached: {', '.join(map(str, stage.watch.reached)) or 'none'}",
        )


@dataclass(frozen=True, slots=True)
class WaitLanded(Deed):
    """Until the aircraft has flown, is on the ground again and has disarmed."""

    value: bool

    def describe(self) -> str:
        return "landing"

    def begin(self, stage: Stage) -> Running:
        return Running(lambda: stage.watch.landed and not stage.watch.armed, lambda: _flight(stage.watch))


@dataclass(frozen=True, slots=True)
class WaitHeight(Deed):
    """Until the aircraft is so high above home."""

    above_m: float | None = None
    below_m: float | None = None

    def describe(self) -> str:
        return "height " + _range_words(self.above_m, self.below_m, "m")

    def begin(self, stage: Stage) -> Running:
        def done() -> bool:
            sample = stage.watch.sample
            return sample is not None and _within(sample.alt_m, self.above_m, self.below_m)

        return Running(done, lambda: _flight(stage.watch))


@dataclass(frozen=True, slots=True)
class WaitSpeed(Deed):
    """Until the aircraft is so fast over ground."""

    above_mps: float | None = None
    below_mps: float | None = None

    def describe(self) -> str:
        return "speed " + _range_words(self.above_mps, self.below_mps, "m/s")

    def begin(self, stage: Stage) -> Running:
        def done() -> bool:
            sample = stage.watch.sample
            return sample is not None and _within(sample.speed_mps, self.above_mps, self.below_mps)

        return Running(done, lambda: _flight(stage.watch))


@dataclass(frozen=True, slots=True)
class WaitNear(Deed):
    """Until the aircraft is that near a place."""

    place: str
    within_m: float

    def places(self) -> tuple[str, ...]:
        return (self.place,)

    def describe(self) -> str:
        return f"{self.within_m:g} m from {self.place}"

    def begin(self, stage: Stage) -> Running:
        def away_m() -> float:
            sample = stage.watch.sample
            return math.inf if sample is None else distance_m(sample.lat_deg, sample.lon_deg, *stage.place(self.place))

        return Running(lambda: away_m() <= self.within_m, lambda: f"{away_m():.0f} m away")


@dataclass(frozen=True, slots=True)
class Pause(Deed):
    """A time of the simulation, in seconds."""

    value: float

    def at_least_s(self) -> float:
        return self.value * 1.5 + 10.0

    def describe(self) -> str:
        return f"{self.value:g} s"

    def begin(self, stage: Stage) -> Running:
        until = stage.sim_s() + self.value
        return Running(lambda: stage.sim_s() >= until, lambda: f"{until - stage.sim_s():.0f} s left")


@dataclass(frozen=True, slots=True)
class Steady(Deed):
    """All of this holds at every moment of `for_s` simulated seconds: the aircraft goes on as it was."""

    for_s: float
    what: str
    mode: str = ""
    above_mps: float | None = None
    below_mps: float | None = None

    def at_least_s(self) -> float:
        return self.for_s * 1.5 + 10.0

    def describe(self) -> str:
        return f"{self.what} for {self.for_s:g} s"

    def begin(self, stage: Stage) -> Running:
        begun = stage.sim_s()
        slowest, fastest = math.inf, -math.inf
        modes: list[str] = []

        def seen() -> str:
            if fastest < slowest:
                return "nothing was seen"
            return f"{slowest:.1f} to {fastest:.1f} m/s, mode {', '.join(modes)}, over {stage.sim_s() - begun:.1f} s"

        def done() -> bool:
            nonlocal slowest, fastest
            watch = stage.watch
            if watch.sample is None or watch.sample.sim_s < begun:
                return False
            slowest, fastest = min(slowest, watch.sample.speed_mps), max(fastest, watch.sample.speed_mps)
            if watch.mode not in modes:
                modes.append(watch.mode)
            if self.mode and modes != [self.mode]:
                raise StepFailed(seen())
            if not _within(slowest, self.above_mps, None) or not _within(fastest, None, self.below_mps):
                raise StepFailed(seen())
            return watch.sample.sim_s - begun >= self.for_s

        return Running(done, seen)


def _within(value: float, above: float | None, below: float | None) -> bool:
    return (above is None or value > above) and (below is None or value < below)


def _range_words(above: float | None, below: float | None, unit: str) -> str:
    parts = [f"above {above:g} {unit}"] if above is not None else []
    return " and ".join(parts + ([f"below {below:g} {unit}"] if below is not None else []))


def _flight(watch: Watch) -> str:
    sample = watch.sample
    place = "" if sample is None else f", {sample.alt_m:.0f} m, {sample.speed_mps:.1f} m/s"
    return f"{'armed' if watch.armed else 'not armed'}, mode {watch.mode or 'unknown'}{place}"


#: word in the file -> step
STEPS: Mapping[str, type[Deed]] = {
    "wait": Wait,
    "type": Type,
    "pause_s": Pause,
    "steady": Steady,
    "wait_ready": WaitReady,
    "wait_mode": WaitMode,
    "wait_armed": WaitArmed,
    "wait_reached": WaitReached,
    "wait_landed": WaitLanded,
    "wait_height": WaitHeight,
    "wait_speed": WaitSpeed,
    "wait_near": WaitNear,
}
