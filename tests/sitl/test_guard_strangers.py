# SPDX-License-Identifier: GPL-3.0-or-later

"""Whoever is wired straight to the autopilot: functions that look like a pilot's, leases like a companion's."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import all as dialect

from tests.sitl.guard_cases import (
    SWITCH_LAST,
    WITH_RADIO,
    Case,
    Outcome,
    Pilot,
    came_home,
    cut,
    far_out,
    flights,
    guard_delay_s,
    in_guided,
    landed_at_home,
    loss,
    piloted,
    said,
    stranger,
)
from tests.sitl.guard_flight import ACCEPTED, DENIED, GUIDED, HELD, LIVE, LOST, RTL, STABILIZE, Flight, tunnel

AUX_FUNCTION = 218
#: switch functions, and positions of the switch
AUX_RTL, AUX_LAND, AUX_GUIDED, LOW, HIGH = 4, 18, 55, 0, 2


def during_the_return(order: Callable[[Flight], object]) -> Callable[[Flight], Outcome]:
    """On the way home by the guard. What is ordered is refused or undone, and costs no height: one moment in STABILIZE
    with the stick down is enough for ArduCopter to take the motors back for good."""

    def seen(flight: Flight) -> Outcome:
        flight.until(lambda: flight.mode == RTL, 6, "RTL")
        flight.run(1)
        from_m = flight.mark_altitude()
        flight.texts.clear()
        order(flight)
        flight.run(4)
        assert flight.lowest_m > from_m - 1.5, (
            f"from {from_m:.0f} m to {flight.lowest_m:.0f} m, ground at {flight.touch_down_m_s:.1f} m/s, {flight.texts}"
        )
        assert flight.mode == RTL, f"mode {flight.mode}, {flight.texts}"
        undone = any("undone" in text for text in flight.texts)
        landing = landed_at_home(flight)
        return f"{'undone' if undone else 'refused'}; RTL +{guard_delay_s(flight):.1f} s, {landing}"

    return seen


def switch_function(function: int, position: int) -> Callable[[Flight], None]:
    def order(flight: Flight) -> None:
        wire = stranger(flight)
        wire.send(dialect.MAVLink_command_long_message(1, 1, AUX_FUNCTION, 0, function, position, 0, 0, 0, 0, 0))

    return order


def far_out_with_a_stick(flight: Flight) -> None:
    """A transmitter's throttle stick is in the middle."""
    pilot = Pilot(flight)
    far_out(flight)
    pilot.hold()
    flight.run(0.5)


def commanders_function_afterwards(flight: Flight) -> Outcome:
    """Denied to the commander as well while the loss lasts; and done for him when it is over."""
    flight.until(lambda: flight.mode == RTL, 6, "RTL")
    flight.run(1)
    assert flight.command(AUX_FUNCTION, AUX_GUIDED, HIGH) == DENIED
    flight.sending = True
    said(flight, "HNDO: authority back, staying in RTL")
    flight.pace(4)
    assert flight.mode == RTL
    assert flight.command(AUX_FUNCTION, AUX_GUIDED, HIGH) == ACCEPTED
    flight.until(lambda: flight.mode == GUIDED, 3, "GUIDED by function")
    return "DENIED during the loss, ACCEPTED and done after it"


def function_with_the_loss(flight: Flight) -> Outcome:
    """The order comes two seconds after the last lease: what is found then was not a pilot's choice either."""
    flight.pilot.hold(SWITCH_LAST)
    wire = stranger(flight)
    flight.until(lambda: flight.now_ms - flight.last_lease_ms >= 2000, 3)
    wire.send(dialect.MAVLink_command_long_message(1, 1, AUX_FUNCTION, 0, 56, HIGH, 0, 0, 0, 0, 0))
    return came_home(flight)


def forged_leases(flight: Flight) -> Outcome:
    """Right in everything but the wire they come in on; damaged and recorded ones on the companion's own."""
    in_guided(flight)
    flight.real_time()
    recorded = flight.send_lease()
    flight.sending = False
    lost_ms = flight.last_lease_ms
    forger = stranger(flight, 1, 191)
    rejected, sequence = flight.status[7], flight.sequence
    while flight.now_ms < lost_ms + 4000 and flight.mode != RTL:
        sequence += 1
        forger.send(_lease(HELD, 251, 0xF00DCAFE, sequence & 0xFFFFFFFF, 1, flight.guard_nonce))
        flight.companion.send_raw(corrupted(tunnel(b"").pack(flight.companion.mav)))
        flight.companion.send_raw(corrupted(recorded))
        flight.companion.send_raw(recorded)
        for _ in range(20):
            flight.pump()
    flight.until(lambda: flight.mode == RTL, 2, "RTL")
    assert flight.status[7] >= rejected + 15, f"{flight.status[7] - rejected} refused"
    return f"refused; RTL +{guard_delay_s(flight):.1f} s"


def forged_while_real_ones_flow(flight: Flight) -> Outcome:
    flight.sending = True
    flight.until(lambda: flight.is_state(LIVE), 90, "lease live")
    forger = stranger(flight, 1, 191)
    before = flight.status
    flight.statuses.clear()
    for number in range(60):
        state, commander = ((HELD, 252), (LOST, 0))[number % 2]
        forger.send(_lease(state, commander, 0x666, number + 1, 1000 + number, flight.guard_nonce))
        flight.run(0.1)
    assert_unmoved(flight)
    assert flight.status[7] >= before[7] + 45, f"{flight.status[7] - before[7]} refused"
    assert flight.status[5] != before[5], "no real lease was heard"
    said(flight, "HNDO: strange lease refused, channel 0 not 1")
    return "60 refused, LIVE throughout"


def damaged_while_real_ones_flow(flight: Flight) -> Outcome:
    flight.sending = True
    flight.until(lambda: flight.is_state(LIVE), 90, "lease live")
    recorded = flight.send_lease()
    damaged: dict[str, Callable[[], bytes]] = {
        "replayed": lambda: recorded,
        "truncated": lambda: _next(flight, length=23),
        "too long": lambda: _next(flight, length=25),
        "of another version": lambda: _next(flight, version=1),
        "of no state": lambda: _next(flight, state=9),
        "for another component": lambda: _next(flight, target=0),
        "of another nonce": lambda: _next(flight, nonce=0x666),
        "of no nonce": lambda: _next(flight, nonce=0),
        "for another start of the guard": lambda: _next(flight, guard_nonce=flight.guard_nonce ^ 1),
    }
    flight.statuses.clear()
    for name, frame in damaged.items():
        flight.until(lambda: bool(flight.statuses), 3, "status")
        before = flight.status[7]
        flight.companion.send_raw(frame())
        flight.until(lambda before=before: flight.status[7] == before + 1, 3, f"a lease {name} is counted as refused")
    # firmware 4.5 keeps what is corrupted to itself; later ones hand it to scripts
    before = flight.status[7]
    flight.companion.send_raw(corrupted(_next(flight)))
    flight.run(1.5)
    assert flight.status[7] == before + (flight.firmware.numbers > (4, 5)), "a corrupted lease"
    # cut off in the middle: the parser takes what follows for the rest of it, and the real ones go on
    sequence = flight.status[5]
    flight.companion.send_raw(_next(flight)[:20])
    flight.until(lambda: flight.status[5] not in (sequence, sequence + 1), 5, "real leases go on")
    assert_unmoved(flight)
    return f"{len(damaged) + 2} kinds refused, LIVE throughout"


def assert_unmoved(flight: Flight) -> None:
    """Nothing that was forged changed state, nonce, epoch or the autopilot's station."""
    assert {status[1] for status in flight.statuses} == {LIVE}
    assert {(status[4], status[6]) for status in flight.statuses} == {(0xF00DCAFE, 1)}
    assert flight.parameter(flight.firmware.gcs_id) == 251


def _lease(state: int, commander: int, nonce: int, sequence: int, epoch: int, guard_nonce: int) -> Any:
    fields = (2, state, commander, 0, nonce, sequence, epoch, 5000, 0, guard_nonce)
    return tunnel(struct.pack("<BBBBIIIHHI", *fields))


def _next(flight: Flight, **changes: int) -> bytes:
    """A lease that would be the next one, of another commander, with one thing wrong."""
    value = {"version": 2, "state": HELD, "nonce": 0xF00DCAFE, "length": 24, "target": 1, **changes}
    guard_nonce = value.get("guard_nonce", flight.guard_nonce)
    sequence = (flight.sequence + 1) & 0xFFFFFFFF
    fields = (value["version"], value["state"], 252, 0, value["nonce"], sequence, 1, 5000, 0, guard_nonce)
    message = tunnel(struct.pack("<BBBBIIIHHI", *fields))
    message.payload_length, message.target_component = value["length"], value["target"]
    return bytes(message.pack(flight.companion.mav))


def corrupted(frame: bytes | bytearray) -> bytes:
    """A known message with a wrong CRC, which reaches scripts."""
    return bytes(frame[:-1]) + bytes([frame[-1] ^ 0x01])


CASES = (
    Case(
        "a stranger's DO_AUX_FUNCTION 4, RTL off, throttle stick in the middle",
        loss(far_out_with_a_stick, cut, during_the_return(switch_function(AUX_RTL, LOW))),
        WITH_RADIO,
    ),
    Case(
        "a stranger's DO_AUX_FUNCTION 4, RTL off, no radio",
        loss(far_out, cut, during_the_return(switch_function(AUX_RTL, LOW))),
    ),
    Case(
        "a stranger's DO_AUX_FUNCTION 18, LAND",
        loss(far_out, cut, during_the_return(switch_function(AUX_LAND, HIGH))),
    ),
    Case(
        "a stranger's DO_AUX_FUNCTION 55, GUIDED",
        loss(far_out, cut, during_the_return(switch_function(AUX_GUIDED, HIGH))),
    ),
    Case("the commander's DO_AUX_FUNCTION during and after a loss", loss(far_out, cut, commanders_function_afterwards)),
    Case(
        "STABILIZE by a station during the return, no radio",
        loss(far_out, cut, during_the_return(lambda flight: flight.set_mode(STABILIZE))),
    ),
    Case(
        "a stranger's DO_AUX_FUNCTION 56, LOITER, within the time-out",
        loss(piloted, cut, function_with_the_loss),
        WITH_RADIO,
    ),
    Case("forged, damaged and recorded leases after the last real one", forged_leases),
    Case("forged leases on another channel, while real ones flow", forged_while_real_ones_flow),
    Case("damaged leases on the companion's channel, while real ones flow", damaged_while_real_ones_flow),
)
test_strangers = flights(CASES)
