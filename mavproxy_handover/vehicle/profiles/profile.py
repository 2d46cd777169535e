# SPDX-License-Identifier: GPL-3.0-or-later

"""The form of a profile: all that depends on the kind of aircraft, as data and as procedures.

There is one `Profile` object for each kind of aircraft (`copter.py`, `plane.py`, `quadplane.py`). Every other part asks
the aircraft or the mission for its profile, and the profile for the property that counts there. No other part asks what
kind of aircraft it is. A new kind of aircraft is a new file here, one line in `__init__.py`, and one row of the guard.

Each property says what the aircraft does, not what it is: `holds_by_circling`, not "has wings".
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Final, TypeAlias

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.handling import Handling
from mavproxy_handover.core.common.model import FlightAction, ModeClass
from mavproxy_handover.core.safety.energy_prior import EnergyPrior
from mavproxy_handover.vehicle.profiles.procedures import FlightProcedures

__all__ = [
    "READ_OF_EVERY",
    "SWITCHED",
    "GuardRow",
    "ItemRange",
    "Mode",
    "Modes",
    "Profile",
    "RuleGroup",
    "mode_names",
    "modes_of",
]

#: what the switches of the pilot's transmitter do; a station's RC override moves them as well
SWITCHED: Final = tuple(f"RC{channel}_OPTION" for channel in range(5, 17))
#: what is read of every firmware: of the guard, of the station that the autopilot obeys, and of what it says it is
READ_OF_EVERY: Final = (
    "SCR_ENABLE", "HNDO_ENABLE", "HNDO_CHAN", "HNDO_COMPID", "HNDO_TIMEOUT", "HNDO_LOST_T", "HNDO_SYSID_SW",
    "HNDO_ALONE_MAX", "Q_MAV_TYPE",
)  # fmt: skip

#: lowest and highest number of a parameter of an item, and that in words
ItemRange: TypeAlias = tuple[float, float, str]


class RuleGroup(Enum):
    """Groups of rules for the parameters of an autopilot (`monitors/preflight/`)."""

    EVERY = "of every firmware"
    ARDUCOPTER = "parameters of ArduCopter"
    ARDUPLANE = "parameters of ArduPlane"
    ARDUPLANE_ROTORS = "those of them that concern its rotors"


@dataclass(frozen=True, slots=True)
class Mode:
    """A flight mode: its name in the firmware, and what it does."""

    name: str
    flown: ModeClass


@dataclass(frozen=True, slots=True)
class Modes:
    """Modes and targets of an aircraft, as the gate judges them."""

    #: number -> name; a number that is not here is just a mode
    names: Mapping[int, str]
    #: the mode that flies the mission on
    auto: int
    #: modes that arm or take off on the ground, and the auxiliary functions (RCn_OPTION) of such modes
    take_off: tuple[int, ...]
    take_off_switches: tuple[int, ...] = ()
    #: the mode that flies after another system; None: it has none
    follow: int | None = None
    #: a height without a place is a target, and the height of a local target is added to its own
    takes_heights: bool = False
    #: what is streamed to it stops when its station does, and is ended by a velocity of zero
    takes_velocities: bool = True
    #: a kind of speed is read by its lowest 8 bits, not by comparing (ArduCopter up to 4.6)
    speed_type_bits: bool = False


@dataclass(frozen=True, slots=True)
class GuardRow:
    """The guard's row for a firmware (`ardupilot_lua/handover_guard.lua`), as far as the profile does not say it by
    other properties. Reasons are the firmware's ModeReason."""

    #: FWVersion:type()
    firmware_type: int
    #: modes in which a pilot steers by hand
    manual: frozenset[int]
    #: reasons of a mode: the pilot chose it; a failsafe of the autopilot; an order, with who gave it
    pilots: frozenset[int]
    failsafes: frozenset[int]
    commands: Mapping[int, str]
    #: HNDO_ACTION -> the modes that are tried in flight, and those while it hovers; none: the same
    ladder: Mapping[int, tuple[int, ...]]
    hover: Mapping[int, tuple[int, ...]] = field(default_factory=dict)
    #: reasons: the autopilot has led the mission to its landing sequence; a failsafe is over and its mode left
    sequences: frozenset[int] = frozenset()
    resumed: frozenset[int] = frozenset()
    #: values of HNDO_ACTION that the firmware does not have
    lacks: frozenset[int] = frozenset()
    #: whether it flies is an estimate, and whether its estimator is well is not told
    guesses: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Profile:
    """One kind of aircraft. There is one object for each; they are told apart by identity."""

    #: what a mission calls it (`aircraft` in mission.toml), and what people call its firmware
    name: str
    firmware: str
    #: the MAV_TYPEs that its autopilot gives itself, and that a plan for it gives
    types: frozenset[int]

    # ---- flight modes and words ---------------------------------------------------------------------------------

    #: number -> flight mode
    modes: Mapping[int, Mode]
    #: what the gate judges by
    gate: Modes
    #: the mode that flies the mission, the one that flies to places, and the one that returns
    auto: int
    guided: int
    back: int
    #: the mode that comes down here and now
    land: int
    #: modes that fly to the place which the rally list holds
    to_place: frozenset[int]
    #: what a STATUSTEXT of it says if the autopilot has chosen a mode by itself
    by_itself: re.Pattern[str]
    #: how START is carried out, for people
    starts_by: str
    #: how each order is carried out, for people
    carried_out: Mapping[FlightAction, str]
    #: how each order shows, for the rules
    handling: Handling
    #: START, hold, return and landing as conversations with the autopilot
    procedures: Callable[..., FlightProcedures]
    #: what flying costs where nothing is configured
    energy: EnergyPrior
    #: what the guard's row has
    guard: GuardRow
    #: what its autopilot says if a failsafe is over and flies the mode of before again, which it names; None: nothing
    restored: re.Pattern[str] | None = None
    #: what its autopilot says if the mission has ended and the mode changes for that; None: nothing
    by_mission: re.Pattern[str] | None = None
    #: MAV_CMD -> the mode that it leads to (None: any), where that differs from `mode_requests.py`
    commands: Mapping[int, ModeClass | None] = field(default_factory=dict)

    # ---- what it is -------------------------------------------------------------------------------------------

    #: the profile that its MAV_TYPE stands for, if another property tells it from that one; None: MAV_TYPE is enough
    refines: Profile | None = None
    #: the parameter that says (above 0) that it is the profile which refines this one
    refined_by: str = ""
    #: MAV_VTOL_STATEs that only this kind reports. In the air it stays of this kind, whatever MAV_TYPE it reports then
    proven_by: frozenset[int] = frozenset()
    #: MAV_VTOL_STATEs in which it hovers, or is about to, instead of flying forwards
    hovers_in: frozenset[int] = frozenset()

    # ---- how it flies -----------------------------------------------------------------------------------------

    #: it cannot stand still: it holds by circling, and circles above the return site
    holds_by_circling: bool = False
    #: it does not stop at waypoints: it flies past them in turns (`mission/wings.py`)
    flies_past: bool = False
    #: it takes off and lands vertically
    vertical: bool = True
    #: it lands only by a landing sequence of its mission (DO_LAND_START to NAV_LAND)
    lands_by_sequence: bool = False
    #: the mode that flies the mission also flies a landing sequence: as a return goes on, or as a landing is ordered
    lands_in_auto: bool = False
    #: a return is flown level, at the height of the place in the rally list; else it never comes down on its way
    returns_level: bool = False
    #: a return keeps a speed that a station has commanded just before it
    return_takes_speed: bool = True
    #: a station can command the speeds of climb and descent
    takes_vertical_speed: bool = True
    #: a guided target may lead it above the ceiling of its fence
    guided_passes_ceiling: bool = False
    #: it may be armed from its start on (ARMING_REQUIRE 0)
    may_be_always_armed: bool = False
    #: kinds of speed (SPEED_TYPE) that no station may set, with the reason, and the reason for a throttle; "": it may
    lasting_speeds: Mapping[int, str] = field(default_factory=dict)
    lasting_throttle: str = ""

    # ---- missions ---------------------------------------------------------------------------------------------

    #: MAV_CMDs that a route begins with, and ends with besides a return; the name of each for people
    begins: tuple[str, frozenset[int]] = ("NAV_TAKEOFF", frozenset((mavlink.MAV_CMD_NAV_TAKEOFF,)))
    ends: tuple[str, frozenset[int]] = ("NAV_LAND", frozenset((mavlink.MAV_CMD_NAV_LAND,)))
    #: a take-off item may have its height above the sea; and it has to have a place
    takeoff_above_sea: bool = True
    takeoff_needs_place: bool = False
    #: MAV_CMDs of `mission/items.py` that it does not fly, with the reason
    not_flown: Mapping[int, str] = field(default_factory=dict)
    #: MAV_CMDs that it does on the ground only, with the reason
    not_in_air: Mapping[int, str] = field(default_factory=dict)
    #: MAV_CMD -> what its autopilot stores of parameters 1 to 4, where that differs from `mission/items.py`
    stores: Mapping[int, str] = field(default_factory=dict)
    #: MAV_CMD and number of a parameter -> what its autopilot can store and fly
    item_ranges: Mapping[tuple[int, int], ItemRange] = field(default_factory=dict)
    #: MAV_CMDs that take no height from the item, and whether a height of 0 is stored as none
    height_unused: frozenset[int] = frozenset()
    height_zero_unused: bool = False
    #: what its operator has to know of how a return ends; "": nothing
    return_note: str = ""

    # ---- parameters -------------------------------------------------------------------------------------------

    #: kind of speed that its missions are flown by: SPEED_TYPE
    speed_type: int = mavlink.SPEED_TYPE_GROUNDSPEED
    #: the parameter of that -> its units in one m/s; a firmware has one of them
    cruise: Mapping[str, float] = field(default_factory=dict)
    #: the parameter of the speed of a return -> its units in one m/s; none: a return is flown at the speed of missions
    back_speed: Mapping[str, float] = field(default_factory=dict)
    #: the parameters of the least and of the most that it may be -> units in one m/s; none: any speed above 0
    slowest: Mapping[str, float] = field(default_factory=dict)
    fastest: Mapping[str, float] = field(default_factory=dict)
    #: the parameter of the height of a return -> its units in a metre
    return_alt: Mapping[str, float] = field(default_factory=dict)
    #: the parameter that has the loss of the radio noticed (0: not), and those of the GCS failsafe and of its time
    radio_failsafe: str = ""
    gcs_failsafe: str = ""
    gcs_timeout: str = ""
    #: values of the GCS failsafe that leave a flight without it, with the reason
    gcs_failsafe_lacks: Mapping[int, str] = field(default_factory=dict)
    #: what is read before flight; of two names in a row a firmware has one (up to 4.6, from 4.7)
    reads: tuple[str, ...] = ()
    #: which rules those are judged by
    rules: frozenset[RuleGroup] = frozenset((RuleGroup.EVERY,))
    #: the file of `ardupilot_lua/` that has the recommended values, and which aircraft it is for, in words
    parameter_file: str = ""
    parameter_file_for: str = ""

    def mode_name(self, number: int) -> str:
        """What people call a mode of this number."""
        mode = self.modes.get(number)
        return f"mode {number}" if mode is None else mode.name

    def flown(self, number: int) -> ModeClass:
        """What the mode of this number does."""
        mode = self.modes.get(number)
        return ModeClass.OTHER if mode is None else mode.flown


def modes_of(rows: Mapping[ModeClass, Mapping[int, str]]) -> dict[int, Mode]:
    """The modes of a firmware, from number and name for each thing that a mode does."""
    return {number: Mode(name, flown) for flown, names in rows.items() for number, name in names.items()}


def mode_names(enum: str) -> dict[int, str]:
    """Number and name of each mode that the dialect knows of a firmware. `enum`: its enum there."""
    return {
        number: entry.name.removeprefix(f"{enum}_")
        for number, entry in mavlink.enums[enum].items()
        if not entry.name.endswith("_ENUM_END")
    }
