# SPDX-License-Identifier: GPL-3.0-or-later

"""Payload authority: which station or onboard program commands gimbal, camera and winch, each for itself.

It never reaches a flight function: the gate picks payload commands by name (`gate/policy/payload.py`). Three ways, by
the mission's file, else by the vehicle's:

* `flight`: it is flight authority's.
* A name: it belongs to that station or onboard program, also after a handover of flight authority.
* `request`: it is flight authority's until a station asks for it. Another station gets it when the holder has released
  it, or is not heard any more. The commander always gets it. At a handover of flight authority it is released, or kept,
  as `at_handover` says.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from types import MappingProxyType
from typing import Final

__all__ = ["AT_HANDOVER", "FLIGHT", "REQUEST", "PayloadAuthority", "PayloadKind", "PayloadRules", "PayloadSettings"]

FLIGHT: Final = "flight"
REQUEST: Final = "request"
AT_HANDOVER: Final = ("release", "keep")


class PayloadKind(Enum):
    """The kinds of payload, by their keys in `[payload]`. `WINCH`: also gripper, sprayer and lights."""

    GIMBAL = "gimbal"
    CAMERA = "camera"
    WINCH = "winch"


@dataclass(frozen=True, slots=True)
class PayloadRules:
    """`[payload]` of a file, as it is written there. None: the file does not say it.

    `control`: of each kind that `kinds` does not name. Each is `FLIGHT`, `REQUEST`, or a name.
    """

    control: str | None = None
    at_handover: str | None = None
    kinds: Mapping[PayloadKind, str] = field(default_factory=lambda: MappingProxyType({}))

    def of(self, kind: PayloadKind) -> str | None:
        """The rule of a kind; None: the file has none."""
        return self.kinds.get(kind, self.control)


@dataclass(frozen=True, slots=True)
class PayloadSettings:
    """The rules that apply: those of the vehicle's file, and those of the mission, which go before."""

    vehicle: PayloadRules = field(default_factory=PayloadRules)
    mission: PayloadRules = field(default_factory=PayloadRules)

    def control(self, kind: PayloadKind) -> str:
        """`FLIGHT`, `REQUEST`, or the name of a station or an onboard program."""
        return self.mission.of(kind) or self.vehicle.of(kind) or FLIGHT

    def by(self, kind: PayloadKind) -> str:
        """The file that says so, in words."""
        return "mission" if self.mission.of(kind) is not None else "vehicle's file"

    @property
    def at_handover(self) -> str:
        """One of `AT_HANDOVER`."""
        return self.mission.at_handover or self.vehicle.at_handover or AT_HANDOVER[0]

    @property
    def follows_flight(self) -> bool:
        """Whether the whole payload is flight authority's."""
        return all(self.control(kind) == FLIGHT for kind in PayloadKind)


class PayloadAuthority:
    """Of one vehicle. Names are those of stations and of onboard programs; "" is none."""

    def __init__(self, settings: Callable[[], PayloadSettings], heard: Callable[[str], bool]) -> None:
        """`settings`: those that apply now. `heard`: whether the station of this name is heard."""
        self._settings = settings
        self._heard = heard
        self._commander = ""
        #: by kind: the station that asked for it
        self._requesters: dict[PayloadKind, str] = {}

    @property
    def settings(self) -> PayloadSettings:
        """The rules that apply now."""
        return self._settings()

    def holder(self, kind: PayloadKind) -> str:
        """The name of the station or program that has authority over this kind; "": none."""
        control = self._settings().control(kind)
        if control == FLIGHT:
            return self._commander
        return (self._requesters.get(kind) or self._commander) if control == REQUEST else control

    def authority_moved(self, commander: str) -> None:
        """Flight authority is this station's now; "": no station's."""
        if commander != self._commander and self._settings().at_handover == AT_HANDOVER[0]:
            self._requesters.clear()
        self._commander = commander

    def request(self, kind: PayloadKind, station: str) -> str:
        """A station asks for it. Returns why not, in words; "": it has it."""
        settings = self._settings()
        control = settings.control(kind)
        if station == self.holder(kind):
            return ""
        if control != REQUEST:
            whose = "that of flight" if control == FLIGHT else f"{control}'s"
            return f"{kind.value} authority is {whose} by the {settings.by(kind)}"
        requester = self._requesters.get(kind, "")
        if requester and self._heard(requester) and station != self._commander:
            return f"{requester} has {kind.value} authority; it must release it first"
        self._requesters[kind] = station
        return ""

    def release(self, kind: PayloadKind, station: str) -> str:
        """A station gives it back. Returns why not, in words; "": it is flight authority's again."""
        if station != self._requesters.get(kind):
            return f"it has no {kind.value} authority that was requested"
        del self._requesters[kind]
        return ""
