# SPDX-License-Identifier: GPL-3.0-or-later

"""Payload authority: which station or onboard program commands gimbal, camera and winch.

It never reaches a flight function: the gate picks payload commands by name (`gate/policy/payload.py`). Three ways, by
the vehicle's file:

* `flight`: it is flight authority's.
* A name: it belongs to that station or onboard program, also after a handover of flight authority.
* `request`: it is flight authority's until a station asks for it. Another station gets it when the holder has released
  it, or is not heard any more. The commander always gets it. At a handover of flight authority it is released, or kept,
  as `at_handover` says.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

__all__ = ["AT_HANDOVER", "FLIGHT", "REQUEST", "PayloadAuthority", "PayloadSettings"]

FLIGHT: Final = "flight"
REQUEST: Final = "request"
AT_HANDOVER: Final = ("release", "keep")


@dataclass(frozen=True, slots=True)
class PayloadSettings:
    """The rule of the payload. `control`: `FLIGHT`, `REQUEST`, or the name of a station or an onboard program."""

    control: str = FLIGHT
    at_handover: str = AT_HANDOVER[0]


class PayloadAuthority:
    """Of one vehicle. Names are those of stations and of onboard programs; "" is none."""

    def __init__(self, settings: PayloadSettings, heard: Callable[[str], bool]) -> None:
        """`heard`: whether the station of this name is heard."""
        self.settings = settings
        self._heard = heard
        self._commander = ""
        #: the station that asked for it
        self._requester = ""

    @property
    def holder(self) -> str:
        """The name of the station or program that has payload authority; "": none."""
        control = self.settings.control
        if control == FLIGHT:
            return self._commander
        return (self._requester or self._commander) if control == REQUEST else control

    def authority_moved(self, commander: str) -> None:
        """Flight authority is this station's now; "": no station's."""
        if commander != self._commander and self.settings.at_handover == AT_HANDOVER[0]:
            self._requester = ""
        self._commander = commander

    def request(self, station: str) -> str:
        """A station asks for it. Returns why not, in words; "": it has it."""
        control = self.settings.control
        if station == self.holder:
            return ""
        if control != REQUEST:
            return f"payload authority is {'that of flight' if control == FLIGHT else control} by the vehicle's file"
        taken = self._requester if self._requester and self._heard(self._requester) else ""
        if taken and station != self._commander:
            return f"{taken} has it; it must release it first"
        self._requester = station
        return ""

    def release(self, station: str) -> str:
        """A station gives it back. Returns why not, in words; "": it is flight authority's again."""
        if station != self._requester:
            return "it has no payload authority that was requested"
        self._requester = ""
        return ""
