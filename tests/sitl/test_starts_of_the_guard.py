# SPDX-License-Identifier: GPL-3.0-or-later

"""A guard that starts again, and two guards on one card: which leases count then, in ArduCopter.

Not in the table "Flown" of the guard's page yet: its rows are those of all three versions.
"""

from __future__ import annotations

import re

from tests.lua.stub import GUARD
from tests.sitl.guard_cases import Case, Outcome, flights, in_guided, said
from tests.sitl.guard_flight import ACCEPTED, FAILED, GUIDED, HURRY, LIVE, Flight

STARTS = 6
SCRIPT = GUARD.read_text(encoding="utf-8")
VERSION = re.search(r'VERSION = "([\d.]+)"', SCRIPT)
assert VERSION is not None
LOADED = f"HNDO: handover guard {VERSION[1]} loaded"


def start_again(flight: Flight) -> int:
    """The guard starts again, as scripting does; returns the autopilot's time of it."""
    flight.set_parameter("SCR_ENABLE", 0)
    flight.until(lambda: flight.said("Scripting: stopped"), 10, "scripting stopped")
    flight.texts.clear()
    flight.run(1.5)  # the autopilot looks once a second whether it is to begin again
    flight.set_parameter("SCR_ENABLE", 1)
    return flight.until(lambda: flight.said(LOADED), 20, "the guard runs again")


def recorded_leases(flight: Flight) -> Outcome:
    """What was recorded before a start neither counts nor permits arming; true leases do at once."""
    flight.sending = True
    flight.until(lambda: flight.is_state(LIVE), 90, "lease live")
    recorded = []
    for _ in range(40):
        recorded.append(flight.send_lease())
        flight.run(0.1)
    nonces = {flight.guard_nonce}
    flight.sending = False
    for _ in range(STARTS - 1):
        start_again(flight)
        flight.statuses.clear()
        flight.meet_the_guard()
        flight.run(1)
        nonces.add(flight.guard_nonce)
    assert len(nonces) == STARTS
    flight.statuses.clear()
    for frame in recorded:
        flight.companion.send_raw(frame)
        flight.run(0.1)
    assert {status[1] for status in flight.statuses} == {1}
    said(flight, "HNDO: lease for another guard or start")
    assert flight.set_mode(GUIDED) == ACCEPTED
    assert flight.arm() == FAILED
    begun_ms = flight.now_ms
    flight.sending = True
    flight.until(lambda: flight.is_state(LIVE), 5, "true leases count")
    live_s = (flight.now_ms - begun_ms) / 1000
    return f"refused; {STARTS} starts, {STARTS} nonces; a true lease is live after {live_s:.1f} s"


def starts_in_flight(flight: Flight) -> Outcome:
    """It has a live lease before it would act, and touches nothing."""
    in_guided(flight)
    flight.real_time()
    before = flight.guard_nonce
    flight.statuses.clear()
    loaded_ms = start_again(flight)
    flight.until(lambda: flight.guard_nonce not in (0, before) and flight.is_state(LIVE), 5, "lease live again")
    live_ms = flight.now_ms
    flight.run(6)
    assert (flight.mode, flight.armed) == (GUIDED, True)
    assert not any(status[2] for status in flight.statuses)
    return f"live after {(live_ms - loaded_ms) / 1000:.1f} s, no action"


def two_guards(flight: Flight) -> Outcome:
    """Neither of them lets the vehicle arm."""
    flight.sending = True
    flight.pace(HURRY)
    flight.run(45)
    assert flight.set_mode(GUIDED) == ACCEPTED
    for _ in range(8):
        assert flight.arm() == FAILED
        flight.run(2)
    said(flight, "HNDO: two guards run, remove one script")
    refusals = {text for text in flight.texts if text.startswith("Arm: HNDO")}
    assert refusals
    return f"refused: {', '.join(sorted(refusals))}"


CASES = (
    Case("leases recorded before the guard's start", recorded_leases),
    Case("the guard starts again in flight", starts_in_flight),
    Case(
        "two guards on one card",
        two_guards,
        parameters={"SCR_HEAP_SIZE": 600_000},
        beside={"handover_guard_copy.lua": SCRIPT},
    ),
)
test_starts = flights(CASES)
