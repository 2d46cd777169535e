# SPDX-License-Identifier: GPL-3.0-or-later

"""Every mode with every reason in every state of enforcement, on each kind of vehicle: what the guard takes it for.

The script is asked from within, so that nothing is left out; what it must say is written out here by ArduPilot's names,
whose numbers are compared with its headers where they are at hand (`test_guard_files`). What follows from what is seen
is the table of `test_guard_enforcement`, the same for every vehicle.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import pytest

from sitl.vehicles.lua_bindings import LuaScripting
from tests.lua.numbers import COPTER_NUMBERS, PLANE_NUMBERS, Numbers
from tests.lua.stub import CALM, COPTER, FAILSAFE, GUARD, MISSING, PILOT, PLANE, FakeVehicle

#: by the numbers of SEEN
SEEN = (
    "",
    *("AUTHORITY", "DISARMED", "GROUND", "RETURN", "LANDING", "LAND_ORDER", "TOLERATED", "OVERDUE"),
    *("HOLDING", "UNDECIDED", "MANUAL", "PILOT_CHOICE", "OTHER"),
)
MODES, REASONS, STATES = range(31), range(58), range(7)  # a few more than there are

_ASK = """
local asked = {state=0, mode=0, bits=0}
vehicle.is_landing = function() return asked.bits & 1 ~= 0 end
vehicle.is_taking_off = function() return asked.bits & 16 ~= 0 end
running.grace_over = true
return function()
    local now = clock()
    local letters = {}
    local mode, bits = asked.mode, asked.bits
    enforcement = asked.state
    state = bits & 4 ~= 0 and STATE.LOST or STATE.EXPIRED
    since.lost = now - 60000
    craft.armed, craft.flying, craft.mode, craft.reads_left = true, true, mode, 0
    craft.by_pilot, craft.radio_valid, craft.radio_at = bits & 2 ~= 0, true, now
    craft.changes, craft.avoided_at, craft.strayed = 5, nil, bits & 32 ~= 0
    loss.changes, loss.since, loss.climbing = 4, now, false
    loss.mode = bits & 8 ~= 0 and mode or nil
    for reason = 0, 57 do
        craft.reason = reason
        letters[#letters + 1] = string.char(64 + classify(now))
    end
    gcs:send_text(7, string.format("%d/%d/%d/", asked.state, mode, bits) .. table.concat(letters))
    asked.bits = bits + 1
    if asked.bits == 48 then asked.bits, asked.mode = 0, mode + 1 end
    if asked.mode == 31 then asked.mode, asked.state = 0, asked.state + 1 end
    if asked.state == 7 then return nil end
    return debug_again(), 1
end, 1
"""
_LAST_LINE = "\nreturn update, MS.UPDATE\n"


@dataclass(frozen=True)
class Moment:
    """What is seen, and in which state of the guard."""

    state: int
    mode: int
    reason: int
    landing: bool
    """The autopilot says that it comes down."""
    by_pilot: bool
    """The mode is believed to be the pilot's; his radio lives."""
    lost: bool
    """A companion says that nobody commands; otherwise there is none."""
    same: bool
    """It is the mode that the guard has set or left alone."""
    taking_off: bool
    strayed: bool
    """Somebody has led the mission back to an earlier item."""


def must_be(numbers: Numbers, seen: Moment) -> str:
    """By the rules of the page, in their order."""
    auto = seen.mode == numbers.auto
    if seen.mode in numbers.returns.values():
        return "RETURN"
    if auto and seen.reason in numbers.sequences.values() and not seen.strayed:
        return "RETURN"
    if seen.mode in numbers.landings.values() or (auto and seen.landing):
        ordered = seen.reason in numbers.commands.values() and not seen.lost
        feigned = seen.reason in numbers.pilots.values() and not seen.by_pilot
        return "LAND_ORDER" if (ordered or feigned) and not seen.same else "LANDING"
    if seen.same:
        return "TOLERATED" if seen.state in (PILOT, FAILSAFE) else "OVERDUE"
    if seen.reason in numbers.failsafes.values():
        return "HOLDING"
    if numbers.winged and seen.taking_off and seen.state in (CALM, MISSING):
        return "HOLDING"
    if not seen.by_pilot:
        return "OTHER"
    return "MANUAL" if seen.mode in numbers.by_hand.values() else "PILOT_CHOICE"


def moment(state: int, mode: int, bits: int, reason: int) -> Moment:
    return Moment(state, mode, reason, *(bool(bits >> bit & 1) for bit in range(6)))


def answers(kind: int) -> Iterator[tuple[int, int, int, str]]:
    """Asks the script about every moment there is: state, mode, bits, and what is seen for each reason, as letters."""
    text = GUARD.read_text(encoding="utf-8")
    assert text.endswith(_LAST_LINE)
    ask = _ASK.replace("return function()", "local function again()").replace("debug_again()", "again")
    ask = ask.replace("\nend, 1\n", "\nend\nreturn again, 1\n")
    vehicle = FakeVehicle()
    vehicle.type = kind
    scripting = LuaScripting(vehicle)
    scripting.load_text(text.removesuffix(_LAST_LINE) + ask, GUARD.name)
    while scripting.scripts:
        vehicle.texts.clear()
        scripting.run_due(vehicle.now_ms)
        vehicle.now_ms += 1
        for severity, told in vehicle.texts:
            if severity == 7:
                state, mode, bits, letters = told.split("/")
                yield int(state), int(mode), int(bits), letters
    assert vehicle.removed == []


@pytest.mark.parametrize(
    ("kind", "numbers"), [(COPTER, COPTER_NUMBERS), (PLANE, PLANE_NUMBERS)], ids=["Copter", "Plane"]
)
def test_every_mode_every_reason_every_state(kind: int, numbers: Numbers) -> None:
    wrong: list[tuple[Moment, str]] = []
    asked = 0
    for state, mode, bits, letters in answers(kind):
        asked += len(letters)
        wanted = [must_be(numbers, moment(state, mode, bits, reason)) for reason in REASONS]
        seen = [SEEN[ord(letter) - 64] for letter in letters]
        if seen != wanted:
            wrong += [(moment(state, mode, bits, r), seen[r]) for r in REASONS if seen[r] != wanted[r]]
    assert wrong[:5] == []
    assert asked == len(MODES) * len(REASONS) * len(STATES) * 48


def test_the_two_tables_differ_where_the_vehicles_do() -> None:
    """What is a return of one is something else of the other: a mixed-up table cannot pass for both."""
    for copter, plane in itertools.product(COPTER_NUMBERS.returns.values(), PLANE_NUMBERS.landings.values()):
        assert copter != plane
    assert COPTER_NUMBERS.auto != PLANE_NUMBERS.auto
    assert {6, 21, 27} & set(PLANE_NUMBERS.returns.values()) == {21}
