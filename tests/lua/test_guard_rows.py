# SPDX-License-Identifier: GPL-3.0-or-later

"""The guard's row for each firmware says the same as the companion's profile of that kind of aircraft."""

from __future__ import annotations

from typing import Any

import pytest
from lupa.lua53 import LuaRuntime

from mavproxy_handover.core.common.model import ModeClass
from mavproxy_handover.vehicle.profiles import PROFILES, Profile
from tests.lua.stub import GUARD

FIRMWARE = [profile for profile in PROFILES if profile.refines is None]


def python(value: Any) -> Any:
    """A table of Lua as a dictionary; a value as it is."""
    return {key: python(each) for key, each in value.items()} if hasattr(value, "items") else value


@pytest.fixture(scope="module")
def rows() -> dict[int, dict[str, Any]]:
    source = GUARD.read_text(encoding="utf-8")
    table = source[source.index("local ACTION =") : source.index("-- Names of vehicle types that are not supported")]
    found = python(LuaRuntime().execute(table + "return VEHICLES"))
    assert isinstance(found, dict)
    return found


def names(profile: Profile, flown: ModeClass) -> dict[int, str]:
    return {number: mode.name for number, mode in profile.modes.items() if mode.flown is flown}


def modes(ladders: dict[int, dict[int, dict[str, Any]]]) -> dict[int, tuple[int, ...]]:
    return {
        action: tuple(rung["mode"] for _number, rung in sorted(ladder.items())) for action, ladder in ladders.items()
    }


def test_each_firmware_with_a_profile_has_a_row_and_no_other(rows: dict[int, dict[str, Any]]) -> None:
    assert set(rows) == {profile.guard.firmware_type for profile in FIRMWARE}
    assert all(profile.guard is profile.refines.guard for profile in PROFILES if profile.refines is not None)


@pytest.mark.parametrize("profile", FIRMWARE, ids=[profile.name for profile in FIRMWARE])
def test_a_row_says_what_the_profile_says(rows: dict[int, dict[str, Any]], profile: Profile) -> None:
    row, guard = dict(rows[profile.guard.firmware_type]), profile.guard
    assert row.pop("radio_failsafe") == profile.radio_failsafe
    assert row.pop("auto") == profile.auto
    assert row.pop("rtl") == profile.back
    assert row.pop("returns") == names(profile, ModeClass.RETURN)
    assert row.pop("landings") == names(profile, ModeClass.LAND)
    assert set(row.pop("manual")) == guard.manual
    assert set(row.pop("pilots")) == guard.pilots
    assert set(row.pop("failsafes")) == guard.failsafes
    assert row.pop("commands") == guard.commands
    assert set(row.pop("sequences")) == guard.sequences
    assert set(row.pop("resumed")) == guard.resumed
    assert set(row.pop("lacks")) == guard.lacks
    assert row.pop("guesses") == guard.guesses
    ladders = row.pop("ladder"), row.pop("hover", {})
    assert (modes(ladders[0]), modes(ladders[1])) == (guard.ladder, guard.hover)
    assert row == {}, "a column that no profile has"
    for each in ladders:
        for ladder in each.values():
            for rung in ladder.values():
                assert rung["name"] == profile.mode_name(rung["mode"])
    assert guard.manual <= names(profile, ModeClass.HANDS).keys()
