# SPDX-License-Identifier: GPL-3.0-or-later

"""Procedures of the companion with an autopilot: START, hold, return, landing.

Each profile has a subclass of `FlightProcedures`, in its own file. Each procedure is an `Asking`
(`wire/conversation.py`), and each checks that the autopilot did what it acknowledged: a mode counts when a heartbeat
shows it. Source: mavlink.io "Command Protocol".
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final, Protocol

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import FlightAction, ModeClass
from mavproxy_handover.wire.conversation import Ask, Asking, AutopilotError, NoAnswer, RefusedError, command_long
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID

__all__ = ["Aircraft", "Firmware", "FlightProcedures", "LandingSequence", "heartbeat"]

_ARMED: Final = mavlink.MAV_MODE_FLAG_SAFETY_ARMED
#: what was acknowledged shows in a heartbeat by then (s)
_SHOWS_S: Final = 3.0


class Firmware(Protocol):
    """Part of a profile that the procedures of every firmware need."""

    @property
    def starts_by(self) -> str:
        """How START is carried out, for people."""
        ...

    @property
    def speed_type(self) -> int:
        """Kind of speed that its missions are flown by: SPEED_TYPE."""
        ...

    def mode_name(self, number: int) -> str:
        """What people call a mode of this number."""
        ...


class LandingSequence(Protocol):
    """Whether the mode that flies the mission flies a landing sequence (`vehicle/plane_landing.py`)."""

    @property
    def may_be(self) -> bool:
        """Whether it is at an item of a landing sequence, or at one of a mission that is not known."""
        ...

    @property
    def is_on(self) -> bool:
        """Whether it is at an item of a landing sequence that is known."""
        ...

    def lands(self) -> None:
        """Note that it was told to land."""


class Aircraft(Protocol):
    """Part of the vehicle's state that the procedures read, and one thing that they note there (`vehicle/state.py`)."""

    @property
    def foreign(self) -> str:
        """What it is, in words, if it is of no profile; "" otherwise."""
        ...

    @property
    def custom_mode(self) -> int:
        """The number of its flight mode."""
        ...

    @property
    def flown(self) -> ModeClass | None:
        """What that mode does; None: not known."""
        ...

    @property
    def armed(self) -> bool:
        """By its last heartbeat."""
        ...

    @property
    def in_auto(self) -> bool:
        """Its mode is the one that flies missions."""
        ...

    @property
    def hovers(self) -> bool:
        """Whether it can fly forwards, and hovers."""
        ...

    @property
    def near_ground(self) -> bool:
        """Whether it takes off, or lands."""
        ...

    @property
    def stopped_in(self) -> ModeClass | None:
        """What it flew when it was stopped; None: it was not stopped."""
        ...

    @property
    def ways_down(self) -> LandingSequence:
        """Whether AUTO flies a landing sequence."""
        ...

    def stop_from(self, flown: ModeClass) -> None:
        """Note what it flies, because it is about to be stopped."""


@dataclass(frozen=True, slots=True)
class FlightProcedures(ABC):
    """Questions and orders to the autopilot of system `sysid`. `heard` returns its last STATUSTEXT, for reasons.
    `aircraft`: its state, which has each message before the procedures have it."""

    sysid: int
    heard: Callable[[], str]
    aircraft: Aircraft

    @abstractmethod
    def start(self) -> Asking:
        """Arm, then fly the mission: what START means."""

    def call_off_start(self) -> Asking:
        """After a START that was called off halfway: leave nothing that takes off."""
        yield from ()

    @abstractmethod
    def hold(self, pause: bool) -> Asking:
        """Stop, or go on. Returns what it does."""

    def stand(self) -> Asking:
        """Leave GUIDED and stop where it is. Returns what it does."""
        return (yield from self.hold(pause=True))

    def holds_by(self, pause: bool) -> ModeClass | None:
        """What is flown after `hold`; None: the mode stays."""
        return None

    @abstractmethod
    def bring_home(self, action: FlightAction) -> Asking:
        """Return, or land. Returns the name of the mode that the autopilot took."""

    @abstractmethod
    def return_anew(self) -> Asking:
        """Leave a return and begin it again: it reads its place when it begins. What `bring_home` returns."""

    def set_speed(self, speed_mps: float) -> Asking:
        """Fly the mission at that speed until it leaves the mode that flies it."""
        what, command = f"speed {speed_mps:g} m/s", mavlink.MAV_CMD_DO_CHANGE_SPEED
        yield from self._do(what, command, self.firmware.speed_type, speed_mps, -1)

    # ---- commands and modes -------------------------------------------------------------------------------------

    @property
    @abstractmethod
    def firmware(self) -> Firmware:
        """The firmware that these procedures are for."""

    def _do(self, what: str, command: int, *parameters: float) -> Asking:
        """Send a command; ends when it is accepted, raises RefusedError when it is refused."""
        message = command_long((self.sysid, AUTOPILOT_COMPID), command, *parameters)
        result = yield Ask(what, (message,), _ack_of(command))
        if result != mavlink.MAV_RESULT_ACCEPTED:
            name = mavlink.enums["MAV_RESULT"][result].name if result in mavlink.enums["MAV_RESULT"] else str(result)
            raise RefusedError(f"{what} refused ({name}){self._why}")

    @property
    def _why(self) -> str:
        """The last text of the autopilot, after a colon."""
        reason = self.heard()
        return f": {reason}" if reason else ""

    def _set_mode(self, mode: int) -> Asking:
        """Have it change the mode."""
        flag = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        name = f"mode {self.firmware.mode_name(mode)}"
        yield from self._do(name, mavlink.MAV_CMD_DO_SET_MODE, flag, mode)
        return name

    def _mode(self, mode: int) -> Asking:
        """Change the mode and see it in a heartbeat."""
        name = yield from self._set_mode(mode)
        yield from self._shows(name, lambda m: bool(m.custom_mode == mode))

    def _first_of(self, ways: Iterable[Callable[[], Asking]], passes_by: frozenset[int] = frozenset()) -> Asking:
        """Try one way after another. Returns the result of the first one that the autopilot takes.

        `passes_by`: modes that a way may set before it fails. If any other mode has replaced the mode of the beginning,
        a pilot, the commander or a failsafe has chosen it. Then no further way is tried, and the rules judge that mode.
        """
        stays = passes_by | {self.aircraft.custom_mode}
        errors: list[NoAnswer] = []
        for way in ways:
            try:
                return (yield from way())
            except NoAnswer as error:
                errors.append(error)
            if self.aircraft.custom_mode not in stays:
                name = self.firmware.mode_name(self.aircraft.custom_mode)
                raise AutopilotError(f"not commanded again: the autopilot is in {name} now")
        raise _disobeys(errors)

    def _arm(self) -> Asking:
        """Arm, and see it in a heartbeat."""
        yield from self._do("arming", mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        yield from self._shows("arming", lambda m: bool(m.base_mode & _ARMED))

    def _shows(self, what: str, shows: Callable[[Any], bool]) -> Asking:
        yield Ask(f"{what} to show", (), heartbeat(shows), timeout_s=_SHOWS_S, tries=1)


def _disobeys(errors: Sequence[NoAnswer]) -> AutopilotError:
    """What is raised if one way after the other came to nothing: a refusal if each was refused."""
    refused = all(isinstance(error, RefusedError) for error in errors)
    return (RefusedError if refused else AutopilotError)(f"the autopilot does not obey: {errors[-1]}")


def _ack_of(command: int) -> Callable[[Any], Any]:
    def answer(m: Any) -> Any:
        if m.get_type() != "COMMAND_ACK" or m.command != command or m.result == mavlink.MAV_RESULT_IN_PROGRESS:
            return None
        return m.result

    return answer


def heartbeat(shows: Callable[[Any], bool]) -> Callable[[Any], Any]:
    """The answer that is a heartbeat which shows it."""

    def answer(m: Any) -> Any:
        return True if m.get_type() == "HEARTBEAT" and shows(m) else None

    return answer
