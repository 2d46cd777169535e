# SPDX-License-Identifier: GPL-3.0-or-later

"""What a flight against the guard is: a name, what the aircraft is set up with, and the flight itself.

A flight ends with its outcome in words, one row of the table "Flown"; it raises where the outcome is wrong. Most are
put together of three parts: what the aircraft is doing, how authority goes, and what must be seen then.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from tests.sitl.firmware import Firmware
from tests.sitl.flown import recorded
from tests.sitl.guard_flight import (
    ACCEPTED,
    AUTO,
    GUIDED,
    LOITER,
    RTL,
    SPEEDUP,
    Flight,
    Transmitter,
    Wire,
    flying,
    target,
)
from tests.sitl.guard_log import GCS, actions_logged, mode_changes
from tests.sitl.guard_suite import EVERY_TIME

#: an outcome in words
Outcome = str
Step = Callable[[Flight], object]

#: from the last lease to the mode, by the autopilot's clock (s): the time-out, and 0.2 s at most
EARLIEST_S, LATEST_S = 3.0, 3.2
#: a landing counts as one at home within this
AT_HOME_M = 3.0
#: and as one in one piece below this
SOFT_M_S = 1.5


@dataclass(frozen=True, slots=True)
class Case:
    """One flight of the suite."""

    name: str
    fly: Callable[[Flight], Outcome]
    parameters: Mapping[str, float] = field(default_factory=dict)
    beside: Mapping[str, str] = field(default_factory=dict)
    """Files beside the guard's script, name -> text."""
    station_serial: int = 2


def flights(cases: Sequence[Case]) -> Callable[..., None]:
    """The test that flies these cases on every program there is, and says what came of them."""

    @pytest.mark.sitl
    @pytest.mark.parametrize(
        "case",
        [
            pytest.param(case, id=case.name, marks=() if case.name in EVERY_TIME else (pytest.mark.long,))
            for case in cases
        ],
    )
    def test(case: Case, arducopter: Firmware, tmp_path: Path, request: pytest.FixtureRequest) -> None:
        recorded(request, case.name, arducopter)
        beside = [tmp_path / name for name in case.beside]
        for path, text in zip(beside, case.beside.values(), strict=True):
            path.write_text(text, encoding="utf-8")
        with flying(
            arducopter,
            tmp_path / "flight",
            *beside,
            parameters=case.parameters,
            station_serial=case.station_serial,
        ) as flight:
            outcome = case.fly(flight)
        recorded(request, case.name, arducopter, outcome)

    return test


def loss(situation: Step, goes: Step, seen: Callable[[Flight], Outcome]) -> Callable[[Flight], Outcome]:
    """A flight in three parts."""

    def fly(flight: Flight) -> Outcome:
        situation(flight)
        goes(flight)
        return seen(flight)

    return fly


# ---- what the aircraft is doing ------------------------------------------------------------------------------------


def in_guided(flight: Flight) -> None:
    """Hovers at 20 m, at the pace of a cut."""
    flight.take_off()
    flight.pace(SPEEDUP)


def far_out(flight: Flight) -> None:
    """In GUIDED, 60 m from home."""
    in_guided(flight)
    flight.companion.send(target(80, 20))
    flight.until(lambda: flight.home_m > 60, 60, "60 m from home")


def in_mode(mode: int) -> Step:
    """The commander has chosen the mode, three seconds ago."""

    def fly(flight: Flight) -> None:
        in_guided(flight)
        assert flight.set_mode(mode) == ACCEPTED, f"mode {mode} refused, {flight.texts[-3:]}"
        flight.until(lambda: flight.mode == mode, 3, f"mode {mode}")
        flight.run(3)

    return fly


def in_auto(flight: Flight) -> None:
    """Flies the mission that was uploaded, from its take-off on."""
    flight.arm_with_lease()
    assert flight.command(300, 0, 0) == ACCEPTED, "mission not started"
    flight.until(lambda: flight.mode == AUTO and flight.altitude_m > 15, 60, "mission under way")
    flight.pace(SPEEDUP)


# ---- how authority goes --------------------------------------------------------------------------------------------


def cut(flight: Flight) -> None:
    flight.cut()


def companion_dies(flight: Flight) -> None:
    flight.companion_dies()


# ---- what must be seen ---------------------------------------------------------------------------------------------


def came_home(flight: Flight) -> Outcome:
    """RTL by the guard in time, then a soft landing at home."""
    flight.until(lambda: flight.mode == RTL, 6, "RTL")
    from_m = flight.altitude_m
    landing = landed_at_home(flight)
    return f"RTL +{guard_delay_s(flight):.1f} s from {max(from_m, 0):.0f} m, {landing}"


def landed_at_home(flight: Flight) -> Outcome:
    landing = landed(flight)
    assert flight.home_m <= AT_HOME_M, f"landed {flight.home_m:.0f} m from home"
    return landing


def landed(flight: Flight) -> Outcome:
    """To the ground and disarmed, softly."""
    flight.hurry()
    flight.until(lambda: not flight.armed, 300, "landed and disarmed")
    assert flight.touch_down_m_s > 0, "the simulation did not tell of a touch-down"
    assert flight.touch_down_m_s <= SOFT_M_S, f"hit the ground at {flight.touch_down_m_s:.1f} m/s"
    return f"landed {flight.home_m:.0f} m from home at {flight.touch_down_m_s:.1f} m/s"


def guard_delay_s(flight: Flight) -> float:
    """Ends the flight. How long after the last lease the guard first acted, by the autopilot's clock."""
    _end(flight)
    logged = actions_logged(flight.directory)
    assert logged, "the guard did nothing"
    delay_s = logged[0][1] / 1000
    assert EARLIEST_S <= delay_s <= LATEST_S, f"acted {delay_s:.2f} s after the last lease"
    return delay_s


def guard_did_nothing(flight: Flight) -> None:
    """Ends the flight. The guard chose no mode in it."""
    _end(flight)
    assert not actions_logged(flight.directory), actions_logged(flight.directory)


def chosen(flight: Flight) -> list[tuple[int, int, float]]:
    """Ends the flight. Its modes: mode, reason, and when, in seconds of the autopilot's clock."""
    _end(flight)
    return mode_changes(flight.directory)


def _end(flight: Flight) -> None:
    """Two seconds after what was last seen: the log is on its way to the file until then."""
    if flight.vehicle.alive():
        flight.run(2)
    flight.close()


def stays(flight: Flight, mode: int, seconds: float) -> None:
    """The mode does not change for so long."""
    end_ms = flight.now_ms + seconds * 1000
    while flight.now_ms < end_ms:
        flight.pump()
        assert flight.mode == mode, f"mode {flight.mode} instead of {mode}, {flight.texts[-5:]}"


def ended_by_gcs_failsafe(mode: int, name: str) -> Callable[[Flight], Outcome]:
    """What flies on without its station does so until the autopilot's own failsafe: FS_GCS_ENABLE 1, ten seconds."""

    def seen(flight: Flight) -> Outcome:
        silent_ms = flight.now_ms
        stays(flight, mode, 5)  # the guard's time-out is three; a busy machine may have sent the last heartbeat late
        flight.until(lambda: flight.mode == RTL, 9, "GCS failsafe")
        waited_s = (flight.now_ms - silent_ms) / 1000
        landing = landed_at_home(flight)
        guard_did_nothing(flight)
        modes = [entry[:2] for entry in chosen(flight)]
        assert modes[-1] == (RTL, GCS), modes
        return f"{name}, then the GCS failsafe's RTL +{waited_s:.0f} s; {landing}"

    return seen


# ---- a pilot -------------------------------------------------------------------------------------------------------

#: positions of the flight mode switch: LOITER is on the first, STABILIZE on the last
SWITCH_LOITER, SWITCH_SECOND, SWITCH_LAST = 1165, 1295, 1800
#: a vehicle that a pilot with a transmitter can take
WITH_RADIO: Mapping[str, float] = {"FS_THR_ENABLE": 1, "FLTMODE1": LOITER}


class Pilot:
    """Holds a transmitter as long as the flight lasts; the throttle stick is down until somebody says otherwise."""

    def __init__(self, flight: Flight) -> None:
        self._flight = flight
        self._transmitter = Transmitter(flight.vehicle)
        flight.pilot = self
        flight.at_close(self._transmitter.close)
        self.hold(throttle_pwm=1000)

    def hold(
        self, switch: int = SWITCH_LAST, throttle_pwm: int = 1500, rudder_pwm: int = 1500, seventh_pwm: int = 1000
    ) -> None:
        self._transmitter.send(switch, throttle_pwm, rudder_pwm, seventh_pwm)

    def takes(self, mode: int = LOITER, switch: int = SWITCH_LOITER) -> None:
        """By the switch, throttle in the middle."""
        self.hold(switch)
        self._flight.until(lambda: self._flight.mode == mode, 3, "the pilot's switch")


def piloted(flight: Flight) -> Pilot:
    """Hovers in GUIDED, a pilot with a transmitter stands by."""
    pilot = Pilot(flight)
    in_guided(flight)
    pilot.hold()
    flight.run(0.5)
    assert flight.mode == GUIDED, f"mode {flight.mode}, {flight.texts[-5:]}"
    return pilot


def lose_radio(flight: Flight) -> None:
    """The pilot's transmitter dies: no pulses come from the receiver."""
    flight.set_parameter("SIM_RC_FAIL", 1)


def said(flight: Flight, text: str, limit_s: float = 3) -> None:
    flight.until(lambda: flight.said(text), limit_s, text)


def stranger(flight: Flight, system: int = 99, component: int = 190) -> Wire:
    """Wired to SERIAL0, as a radio of its own would be; the simulation has room for one at a time."""
    wire = Wire(flight.vehicle.address(0), system, component)
    flight.at_close(wire.socket.close)
    return wire
