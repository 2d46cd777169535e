# SPDX-License-Identifier: GPL-3.0-or-later

"""The guard's table of transitions: all of it written out again, and every pair that can happen flown."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sitl.vehicles.lua_bindings import LuaScripting
from tests.lua.stub import (
    AUTO,
    BRAKE,
    BY_BATTERY,
    BY_FENCE,
    BY_GCS,
    BY_RC,
    CALM,
    FAILSAFE,
    GUARD,
    GUIDED,
    LAND,
    LANDING,
    LOITER,
    MISSING,
    ORDERING,
    PILOT,
    RETURNING,
    RTL,
    SMART_RTL,
    STABILIZE,
    Bench,
    FakeVehicle,
)

CIRCLE = 7
STATES = ("CALM", "MISSING", "ORDERING", "RETURNING", "LANDING", "PILOT", "FAILSAFE")

#: what is seen -> for each state: next state, what is done, why; "=" is the same state
TABLE = {
    "AUTHORITY": ("CALM", *["CALM end_loss"] * 6),
    "DISARMED": ("MISSING announce", *["MISSING reset"] * 6),
    "GROUND": ("MISSING disarm", *["= disarm"] * 6),
    "RETURN": ("RETURNING watch",) * 7,
    "LANDING": ("LANDING watch",) * 7,
    "LAND_ORDER": (
        "LANDING watch",
        "LANDING watch",
        "ORDERING order",
        "ORDERING undo",
        "LANDING watch",
        "ORDERING undo",
        "ORDERING undo",
    ),
    "TOLERATED": (*["ORDERING order"] * 5, "=", "="),
    "OVERDUE": (
        *["ORDERING order"] * 3,
        *["ORDERING order: landing left"] * 2,
        "ORDERING order: radio gone",
        "ORDERING order: held 10 s",
    ),
    "HOLDING": ("FAILSAFE stand_back",) * 7,
    "UNDECIDED": ("MISSING", *["="] * 6),
    "MANUAL": ("PILOT stand_back",) * 7,
    "PILOT_CHOICE": ("ORDERING order", "ORDERING order", *["PILOT stand_back"] * 5),
    "OTHER": (*["ORDERING order"] * 3, *["ORDERING undo"] * 4),
}

_DUMP = """
local names, state_names = {}, {}
for name, response in pairs(RESPONSE) do names[response] = name end
for name, number in pairs(ENFORCEMENT) do state_names[number] = name end
for name, number in pairs(ENFORCEMENT) do
    for seen, column in pairs(SEEN) do
        local move = TRANSITIONS[number][column]
        local text = move.to and state_names[move.to] or "="
        text = text .. (move.response and " " .. names[move.response] or "") .. (move.why and ": " .. move.why or "")
        gcs:send_text(7, name .. "|" .. seen .. "|" .. text)
    end
end
"""
_LAST_LINE = "\nreturn update, MS.UPDATE\n"


def shipped_table() -> dict[tuple[str, str], str]:
    """The table as it stands in the script, which tells it from within."""
    text = GUARD.read_text(encoding="utf-8")
    assert text.endswith(_LAST_LINE)
    vehicle = FakeVehicle()
    scripting = LuaScripting(vehicle)
    # in a call of its own: it takes many instructions
    dump = f"\nreturn function()\n{_DUMP}\nreturn update, 60000\nend, 1\n"
    scripting.load_text(text.removesuffix(_LAST_LINE) + dump, GUARD.name)
    scripting.run_due(vehicle.now_ms)
    scripting.run_due(vehicle.now_ms + 1)
    assert vehicle.removed == []
    cells = [text.split("|") for severity, text in vehicle.texts if severity == 7]
    return {(state, seen): what for state, seen, what in cells}


def test_every_pair_is_what_is_written_here() -> None:
    wanted = {(state, seen): row[number] for seen, row in TABLE.items() for number, state in enumerate(STATES)}
    assert len(wanted) == 7 * 13
    assert shipped_table() == wanted


# ---- flown ----------------------------------------------------------------------------------------------------------


def lose(bench: Bench) -> Bench:
    bench.lose_lease()
    bench.run(3300)
    return bench


def calm(bench: Bench) -> None:
    bench.fly(AUTO)


def missing(bench: Bench) -> None:
    bench.fly(AUTO)
    bench.vehicle.flying, bench.vehicle.disarm_works = False, False
    lose(bench)


def ordering(bench: Bench) -> None:
    bench.vehicle.refused_modes = {RTL, LAND}
    lose(bench.fly(AUTO))


def returning(bench: Bench) -> None:
    lose(bench.fly(AUTO))


def landing(bench: Bench) -> None:
    bench.fly(AUTO)
    bench.vehicle.landing = True
    lose(bench)


def pilot(bench: Bench) -> None:
    bench.vehicle.rc = True
    lose(bench.fly(LOITER, BY_RC))


def failsafe(bench: Bench) -> None:
    lose(bench.fly(BRAKE, BY_FENCE))


BRING = (calm, missing, ordering, returning, landing, pilot, failsafe)


def set_mode(mode: int, reason: int) -> Callable[[Bench], None]:
    def see(bench: Bench) -> None:
        bench.vehicle.landing, bench.vehicle.flying = False, True
        bench.vehicle.mode, bench.vehicle.reason = mode, reason

    return see


def see_authority(bench: Bench) -> None:
    bench.sending = True
    bench.run(300)
    bench.vehicle.mode_requests.clear()


def see_disarmed(bench: Bench) -> None:
    bench.vehicle.armed = bench.vehicle.flying = False


def see_ground(bench: Bench) -> None:
    bench.vehicle.flying, bench.vehicle.disarm_works = False, False
    bench.run(4000)


def by_switch(mode: int) -> Callable[[Bench], None]:
    def see(bench: Bench) -> None:
        bench.vehicle.landing, bench.vehicle.flying = False, True
        bench.pilot_chooses(mode)

    return see


SEE: dict[str, Callable[[Bench], None]] = {
    "AUTHORITY": see_authority,
    "DISARMED": see_disarmed,
    "GROUND": see_ground,
    "RETURN": set_mode(SMART_RTL, BY_GCS),
    "LANDING": set_mode(LAND, BY_BATTERY),
    "LAND_ORDER": set_mode(LAND, BY_GCS),
    "HOLDING": set_mode(CIRCLE, BY_FENCE),
    "MANUAL": by_switch(STABILIZE),
    "PILOT_CHOICE": by_switch(GUIDED),
    "OTHER": set_mode(GUIDED, BY_GCS),
}


@pytest.mark.parametrize("seen", SEE)
@pytest.mark.parametrize("state", STATES)
def test_pairs_that_a_mode_brings_about(state: str, seen: str) -> None:
    """No mode is accepted here: a guard that asks for one goes on asking."""
    bench = Bench()
    BRING[STATES.index(state)](bench)
    bench.run(60)
    assert bench.enforcement == STATES.index(state)
    bench.vehicle.refused_modes = {RTL, LAND}
    if state == "CALM" and seen != "AUTHORITY":  # the loss begins with what is seen
        bench.lose_lease()
        SEE[seen](bench)
        bench.vehicle.mode_requests.clear()
        bench.run(3400)
    else:
        if state == "ORDERING":
            bench.run(2500)  # its pauses are over but for those of LAND, two seconds
        bench.vehicle.mode_requests.clear()
        SEE[seen](bench)
        bench.run(2100 if state == "ORDERING" else 130)
    target, _, response = TABLE[seen][STATES.index(state)].partition(" ")
    assert STATES[bench.enforcement] == (state if target == "=" else target)
    acts = response.startswith(("order", "undo"))
    assert bool(bench.vehicle.mode_requests) == acts, (response, bench.vehicle.mode_requests)
    assert bool(bench.vehicle.disarms) == (response == "disarm" or state == "MISSING")


def test_a_loss_that_begins_while_a_switch_is_judged_waits_for_the_verdict() -> None:
    bench = Bench()
    calm(bench)
    lost_ms = bench.lose_lease() + 3000
    bench.until(lambda: bench.vehicle.now_ms >= lost_ms - 20)
    by_switch(STABILIZE)(bench)
    for _ in range(5):  # more than a call reads
        for _ in range(14):
            bench.hear()
        bench.run(10)
    assert (bench.enforcement, bench.vehicle.mode_requests) == (MISSING, [])


@pytest.mark.parametrize("state", STATES[1:])
def test_a_switch_whose_frames_are_not_read_yet_changes_nothing(state: str) -> None:
    """Twelve frames are read in a call, and more than those wait."""
    bench = Bench()
    BRING[STATES.index(state)](bench)
    bench.vehicle.mode_requests.clear()
    bench.until(lambda: bench.scripting.next_run_ms() == bench.vehicle.now_ms + 50)
    by_switch(STABILIZE)(bench)
    for _ in range(20):
        bench.hear()
    bench.run(50)
    assert (STATES[bench.enforcement], bench.vehicle.mode_requests) == (state, [])
    bench.run(60)
    assert bench.enforcement == PILOT


@pytest.mark.parametrize(("state", "name"), [(PILOT, "pilot flies"), (FAILSAFE, "failsafe acts")])
def test_what_is_stood_back_for_is_kept(state: int, name: str) -> None:
    bench = Bench()
    BRING[state](bench)
    bench.run(5000)
    assert (bench.enforcement, bench.vehicle.mode_requests) == (state, [])
    assert bench.texts == [f"HNDO: lease lost, {name}"]


def test_a_landing_of_auto_that_is_left_is_over() -> None:
    bench = Bench()
    landing(bench)
    assert bench.texts == ["HNDO: lease lost, in AUTO, landing"]
    bench.vehicle.landing = False
    bench.run(60)
    assert bench.vehicle.mode_requests == [RTL]
    assert bench.texts[-1] == "HNDO: lease lost, landing left, RTL"


def test_a_pilot_without_a_radio_is_over() -> None:
    bench = Bench()
    pilot(bench)
    bench.vehicle.rc = False
    bench.run(1900)
    assert bench.enforcement == PILOT
    bench.run(200)
    assert bench.vehicle.mode_requests == [RTL]
    assert bench.texts[-1] == "HNDO: lease lost, radio gone, RTL"


def test_a_failsafe_that_only_holds_is_over() -> None:
    bench = Bench()
    failsafe(bench)
    bench.run(9500)
    assert bench.enforcement == FAILSAFE
    bench.run(500)
    assert bench.vehicle.mode_requests == [RTL]
    assert bench.texts[-1] == "HNDO: lease lost, held 10 s, RTL"


@pytest.mark.parametrize("state", [PILOT, FAILSAFE])
def test_after_that_a_refused_way_home_is_asked_for_again(state: int) -> None:
    """The mode that was left alone is not stood back for a second time."""
    bench = Bench()
    BRING[state](bench)
    bench.vehicle.rc, bench.vehicle.refused_modes = False, {RTL, LAND}
    bench.until(lambda: bench.enforcement == ORDERING, 20_000)
    bench.run(10_000)
    assert bench.enforcement == ORDERING
    assert bench.vehicle.mode_requests[:4] == [RTL, RTL, RTL, LAND]
    assert len(bench.vehicle.mode_requests) > 5


def test_nothing_is_done_while_authority_is_there() -> None:
    bench = Bench().fly(AUTO)
    bench.run(5000)
    assert (bench.enforcement, bench.vehicle.mode_requests, bench.vehicle.disarms) == (CALM, [], 0)


@pytest.mark.parametrize(("state", "seen"), [("RETURNING", "OTHER"), ("LANDING", "OTHER"), ("PILOT", "OTHER")])
def test_a_missing_entry_is_a_fault_that_is_told_and_the_guard_acts(state: str, seen: str) -> None:
    """A row that somebody has cut short."""
    text = GUARD.read_text(encoding="utf-8")
    shortened, count = re.subn(rf"(TRANSITIONS\[E\.{state}\] = +\{{.*), \w+\}}", r"\1}", text)
    assert count == 1
    bench = Bench()
    bench.scripting.stop()
    bench.scripting.enabled = True
    bench.scripting.load_text(shortened, GUARD.name)
    BRING[STATES.index(state)](bench)
    SEE[seen](bench)
    bench.run(60)
    assert bench.vehicle.mode_requests[-1] == RTL
    assert any(text.startswith("HNDO: fault, no entry") for text in bench.texts)


def test_a_missing_entry_sets_no_mode_on_the_ground() -> None:
    text, count = re.subn(
        r"(TRANSITIONS\[E\.CALM\] = +\{)calm, told, gone.*", r"\1calm}", GUARD.read_text(encoding="utf-8")
    )
    assert count == 1
    bench = Bench()
    bench.load_instead(text)
    bench.run(5000)
    assert bench.enforcement == MISSING
    assert bench.vehicle.mode_requests == []
    assert any(text == "HNDO: fault, no entry 0/2" for text in bench.texts)


MOMENT = st.fixed_dictionaries(
    {},
    optional={
        "armed": st.booleans(),
        "flying": st.booleans(),
        "mode": st.integers(0, 28),
        "reason": st.integers(0, 55),
        "rc": st.booleans(),
        "landing": st.booleans(),
        "ekf_failed": st.booleans(),
        "disarm_works": st.booleans(),
        "refused_modes": st.sampled_from([set(), {RTL}, {RTL, LAND}]),
    },
)


@settings(max_examples=150, deadline=None)
@given(moments=st.lists(st.tuples(MOMENT, st.booleans(), st.sampled_from([10, 60, 400, 3500, 11_000])), max_size=12))
def test_whatever_came_before_a_station_gets_nowhere_during_a_loss(
    moments: list[tuple[dict[str, object], bool, int]],
) -> None:
    bench = Bench()
    for changes, sending, run_ms in moments:
        for name, value in changes.items():
            setattr(bench.vehicle, name, value)
        bench.vehicle.flying = bench.vehicle.flying and bench.vehicle.armed
        bench.sending = sending
        bench.run(run_ms)
    bench.vehicle.armed = bench.vehicle.flying = True
    bench.vehicle.refused_modes, bench.vehicle.landing, bench.sending = set(), False, False
    bench.run(3500)
    # the mode of a pilot or a failsafe, ordered again, stays theirs
    bench.vehicle.mode = CIRCLE if bench.vehicle.mode == GUIDED else GUIDED
    bench.vehicle.reason = BY_GCS
    bench.run(2100)  # the pause after a refused LAND
    assert bench.vehicle.mode in (RTL, LAND)
    assert bench.enforcement in (RETURNING, LANDING)
    assert bench.vehicle.removed == []
    assert not any("fault" in text for text in bench.texts)


@settings(max_examples=100, deadline=None)
@given(moments=st.lists(st.tuples(MOMENT, st.sampled_from([10, 60, 400])), max_size=12))
def test_while_authority_is_there_nothing_is_done_whatever_happens(
    moments: list[tuple[dict[str, object], int]],
) -> None:
    bench = Bench().with_lease()
    for changes, run_ms in moments:
        for name, value in changes.items():
            setattr(bench.vehicle, name, value)
        bench.run(run_ms)
        assert (bench.enforcement, bench.vehicle.mode_requests, bench.vehicle.disarms) == (CALM, [], 0)


def test_the_states_are_those_of_the_log() -> None:
    text = re.search(r"^local ENFORCEMENT = {(.*?)}", GUARD.read_text(encoding="utf-8"), re.MULTILINE)
    assert text is not None
    numbers = {name: int(number) for name, number in re.findall(r"(\w+)=(\d+)", text[1])}
    assert numbers == {name: number for number, name in enumerate(STATES)}
    assert [numbers[name] for name in ("LANDING", "RETURNING", "ORDERING")] == [LANDING, RETURNING, ORDERING]
