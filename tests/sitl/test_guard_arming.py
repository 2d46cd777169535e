# SPDX-License-Identifier: GPL-3.0-or-later

"""Every way of arming: each arms with a live lease, and none does without, while nobody commands, or in recovery."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from pymavlink.dialects.v20 import all as dialect

from tests.sitl.guard_cases import SWITCH_LOITER, Case, Outcome, Pilot, flights, said, stranger
from tests.sitl.guard_flight import (
    ACCEPTED,
    FAILED,
    FORCE,
    GUIDED,
    HELD,
    HURRY,
    LIVE,
    LOITER,
    LOST,
    STABILIZE,
    WAITING,
    Flight,
    upload_mission,
)

ARM, AUX_FUNCTION, AUX_ARM, HIGH, MISSION_START = 400, 218, 153, 2, 300
RECOVERING = 4
#: by then the autopilot can arm in GUIDED
READY_S = 60
#: how often a busy machine may have the autopilot refuse to arm for a reason of its own
TRIES = 4
#: the seventh channel is a switch that arms
SWITCH = {"RC7_OPTION": AUX_ARM, "DISARM_DELAY": 0, "FLTMODE1": LOITER}


def to_stabilize(flight: Flight) -> None:
    """By the pilot's switch, there and back: no station may order this mode."""
    flight.pilot.hold(SWITCH_LOITER, throttle_pwm=1000)
    flight.run(1)
    flight.pilot.hold(throttle_pwm=1000)
    flight.until(lambda: flight.mode == STABILIZE, 3, "STABILIZE")


def by_command(flight: Flight) -> None:
    flight.set_mode(GUIDED)
    flight.arm()


def by_command_on_another_wire(flight: Flight) -> None:
    flight.set_mode(GUIDED)
    wire = stranger(flight)
    wire.send(dialect.MAVLink_command_long_message(1, 1, ARM, 0, 1, 0, 0, 0, 0, 0, 0))


def by_rudder(flight: Flight) -> None:
    to_stabilize(flight)
    flight.pilot.hold(throttle_pwm=1000, rudder_pwm=2000)
    flight.run(5)
    flight.pilot.hold(throttle_pwm=1000)


def by_switch(flight: Flight) -> None:
    to_stabilize(flight)
    flight.pilot.hold(throttle_pwm=1000, seventh_pwm=2000)


def by_function(flight: Flight) -> None:
    to_stabilize(flight)
    flight.command(AUX_FUNCTION, AUX_ARM, HIGH)


def by_mission_start(flight: Flight) -> None:
    """Starts a mission, and arms nothing: it is flown because it is an order that leads to a flight."""
    flight.command(MISSION_START, 0, 0)


WAYS: Mapping[str, Callable[[Flight], None]] = {
    "command": by_command,
    "command on another wire": by_command_on_another_wire,
    "rudder": by_rudder,
    "RC switch": by_switch,
    "DO_AUX_FUNCTION": by_function,
}


def ready(flight: Flight) -> None:
    """Everything but authority is there."""
    Pilot(flight)
    flight.pace(HURRY)
    flight.run(READY_S)


def rest(flight: Flight) -> None:
    """Sticks and switches back, disarmed."""
    flight.pilot.hold(throttle_pwm=1000)
    flight.run(1)
    if flight.armed:
        flight.command(ARM, 0)
        flight.until(lambda: not flight.armed, 3, "disarmed")


def with_lease(flight: Flight) -> Outcome:
    """The proof that the ways of the other cases are ways."""
    flight.sending = True
    ready(flight)
    flight.until(lambda: flight.is_state(LIVE), 5, "lease live")
    for name, way in WAYS.items():
        for _ in range(TRIES):
            if _arms(flight, way):
                break
            # on a busy machine the receiver comes late: the autopilot's own check, not the guard's
            assert not flight.said("HNDO: no"), flight.texts
            rest(flight)
        else:
            raise AssertionError(f"never arms by {name}; {flight.texts[-3:]}")
        rest(flight)
    return f"arms by {', '.join(WAYS)}"


def _arms(flight: Flight, way: Callable[[Flight], None]) -> bool:
    """Whether it is armed that way within six seconds."""
    way(flight)
    end_ms = flight.now_ms + 6000
    while not flight.armed and flight.now_ms < end_ms:
        flight.pump()
    return flight.armed


def refused_by_every_way(flight: Flight, text: str) -> None:
    upload_mission(flight)
    for name, way in {**WAYS, "MISSION_START": by_mission_start}.items():
        flight.texts.clear()
        way(flight)
        if way is not by_mission_start:
            said(flight, text, 6)
        end_ms = flight.now_ms + 2000
        while flight.now_ms < end_ms:
            flight.pump()
            assert not flight.armed, f"armed by {name}"
        rest(flight)


def without_lease(flight: Flight) -> Outcome:
    assert flight.status[1] == WAITING
    assert flight.status[8:10] == flight.firmware.numbers
    ready(flight)
    assert flight.arm() == FAILED
    refused_by_every_way(flight, "HNDO: no lease from companion")
    return "refused by every way"


def saying(state: int, commander: int, text: str) -> Callable[[Flight], Outcome]:
    """Leases flow and do not say that somebody commands."""

    def fly(flight: Flight) -> Outcome:
        flight.lease["state"], flight.lease["commander"] = state, commander
        flight.sending = True
        ready(flight)
        refused_by_every_way(flight, text)
        return "refused by every way"

    return fly


def forced(flight: Flight) -> Outcome:
    return armed_in_spite_of_it(flight, FORCE)


def all_checks_off(flight: Flight) -> Outcome:
    return armed_in_spite_of_it(flight, 0.0)


def armed_in_spite_of_it(flight: Flight, force: float) -> Outcome:
    """Past the arming checks; where the firmware lets nobody past there is nothing more to see."""
    ready(flight)
    flight.pace(4)
    flight.set_mode(GUIDED)
    flight.texts.clear()
    if flight.arm(force) != ACCEPTED:
        said(flight, "HNDO: no lease from companion")
        assert not flight.armed
        return "refused"
    # texts come at once, heartbeats once a second: the moment may be too short to be seen as armed
    said(flight, "HNDO: no lease, disarmed", 1.5)
    flight.until(lambda: not flight.armed, 2, "disarmed")
    assert flight.altitude_m < 0.3, flight.altitude_m
    return "disarmed within a second"


def lost_between_arming_and_take_off(flight: Flight) -> Outcome:
    flight.arm_with_lease()
    flight.run(0.5)
    flight.cut()
    said(flight, "HNDO: lease lost, disarmed", 6)
    flight.until(lambda: not flight.armed, 2, "disarmed")
    assert flight.status[2] == 4
    return "disarmed"


CASES = (
    Case("arming with a live lease, by every way", with_lease, SWITCH),
    Case("arming without a lease", without_lease, SWITCH),
    Case("arming while the lease says LOST", saying(LOST, 0, "HNDO: no station has authority"), SWITCH),
    Case("arming while it says HELD without a commander", saying(HELD, 0, "HNDO: no station has authority"), SWITCH),
    Case("arming while it says RECOVERING", saying(RECOVERING, 251, "HNDO: authority is being recovered"), SWITCH),
    Case("forced arming without a lease", forced),
    Case("arming without a lease, all checks off", all_checks_off, {"ARMING_CHECK": 0, "ARMING_SKIPCHK": -1}),
    Case("armed, lease lost on the ground", lost_between_arming_and_take_off),
)
test_arming = flights(CASES)
