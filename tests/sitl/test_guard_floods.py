# SPDX-License-Identifier: GPL-3.0-or-later

"""Leases that come late, and others' frames that fill the receive queue: no false alarm, and the leases are heard."""

from __future__ import annotations

import random
import struct
import time
from collections.abc import Callable
from itertools import cycle
from typing import Any, TypeAlias

from pymavlink.dialects.v20 import all as dialect

from tests.sitl.guard_cases import (
    SWITCH_LOITER,
    WITH_RADIO,
    Case,
    Outcome,
    cut,
    far_out,
    flights,
    guard_delay_s,
    in_guided,
    landed_at_home,
    loss,
    piloted,
    stays,
    stranger,
)
from tests.sitl.guard_flight import GUIDED, LIVE, LOITER, LOST, RTL, Flight, tunnel
from tests.sitl.guard_log import guard_records

Frames: TypeAlias = Callable[[], list[bytes]]

DURATION_S = 10
#: the autopilot's clock is as old as the last position (s)
TOLD_S = 0.2
#: no lease that the guard goes by is older (s): the time-out is 3
OLDEST_S = 2.5
SCRIPTING_COMMAND, REQUEST_MESSAGE, AUX_FUNCTION, AUX_LAND, HIGH = 42701, 512, 218, 18, 2
#: a private payload of somebody else
OTHER_PAYLOAD = 43000


def jitter(shortest_s: float, longest_s: float) -> Callable[[Flight], Outcome]:
    """A minute of leases at random distances."""

    def fly(flight: Flight) -> Outcome:
        in_guided(flight)
        flight.pace(2)
        flight.lease["ttl_ms"] = 5000
        flight.set_parameter("HNDO_TIMEOUT", 3)
        dice = random.Random(7)
        flight.lease_gap_s = lambda: dice.uniform(shortest_s, longest_s)
        stays(flight, GUIDED, 60)
        assert not flight.said("HNDO: lease lost"), flight.texts
        return "no false RTL"

    return fly


class Flood:
    """Somebody else's frames on SERIAL0, so many a second of the wall clock, or of the autopilot's if slower."""

    def __init__(self, flight: Flight, frames: list[bytes], per_second: int) -> None:
        self._flight, self._frames, self._per_second = flight, cycle(frames), per_second
        self.wire = stranger(flight)
        self._start, self._start_ms, self.sent = time.monotonic(), flight.now_ms, 0
        #: longest time without a lease of ours: a slow computer's, not the guard's
        self.gap_ms = 0

    def pump(self) -> None:
        """As the flight's own, with what is due of the flood."""
        flown_s = (self._flight.now_ms - self._start_ms) / 1000 + TOLD_S
        due = int(min(time.monotonic() - self._start, flown_s) * self._per_second) - self.sent
        if due > 0:
            self.wire.send_raw(b"".join(next(self._frames) for _ in range(due)))
            self.sent += due
        self.wire.receive()
        self._flight.pump()
        self.gap_ms = max(self.gap_ms, self._flight.now_ms - self._flight.last_lease_ms)

    def until(self, condition: Callable[[], bool], limit_s: float, what: str) -> None:
        end_ms = self._flight.now_ms + limit_s * 1000
        while not condition():
            assert self._flight.now_ms < end_ms, f"not within {limit_s} s: {what}; {self._flight.texts[-5:]}"
            self.pump()


def flood(frames: Frames, per_second: int) -> Callable[[Flight], Outcome]:
    """Ten seconds in real time, while the leases go on at 5 Hz."""

    def fly(flight: Flight) -> Outcome:
        in_guided(flight)
        flight.real_time()
        flight.texts.clear()
        flight.statuses.clear()
        end_ms = flight.now_ms + DURATION_S * 1000
        rising = Flood(flight, frames(), per_second)
        rising.until(lambda: flight.now_ms > end_ms, 2 * DURATION_S, "the end")
        assert flight.mode == GUIDED, f"mode {flight.mode}, our leases {rising.gap_ms} ms apart, {flight.texts}"
        assert {status[1] for status in flight.statuses} == {LIVE}
        assert len(flight.statuses) > DURATION_S, "the guard fell silent"
        assert rising.sent >= 0.9 * per_second * DURATION_S, f"only {rising.sent} frames sent"
        flight.close()
        told = guard_records(flight.directory)
        flooded = [record for record in told if record.TimeUS > told[-1].TimeUS - DURATION_S * 1e6]
        oldest_s = max(record.Age for record in flooded) / 1000
        assert oldest_s <= OLDEST_S, f"a lease was {oldest_s:.1f} s old"
        return "no false RTL"

    return fly


def function_under_a_flood(flight: Flight) -> Outcome:
    """The stranger hides the order to land among frames that fill the queue: it is no pilot's for that."""
    far_out(flight)
    flight.cut()
    flight.until(lambda: flight.mode == RTL, 6, "RTL")
    flight.set_parameter("SIM_SPEEDUP", 1)
    rising = Flood(flight, tunnels(), 2000)
    end_ms = flight.now_ms + 2000
    rising.until(lambda: flight.now_ms > end_ms, 5, "the queue is full")
    flight.texts.clear()
    rising.wire.send(dialect.MAVLink_command_long_message(1, 1, AUX_FUNCTION, 0, AUX_LAND, HIGH, 0, 0, 0, 0, 0))
    end_ms = flight.now_ms + 4000
    rising.until(lambda: flight.now_ms > end_ms, 6, "what the guard makes of it")
    assert flight.mode == RTL, f"mode {flight.mode}, {flight.texts}"
    done = "undone" if flight.said("undone") else "refused"
    landing = landed_at_home(flight)
    return f"{done}; RTL +{guard_delay_s(flight):.1f} s, {landing}"


def pilot_under_a_flood(flight: Flight) -> Outcome:
    """A pilot takes over while somebody fills the queue: an order that it loses is one that nobody does."""
    flight.until(lambda: flight.mode == RTL, 6, "RTL")
    flight.set_parameter("SIM_SPEEDUP", 1)
    rising = Flood(flight, tunnels(), 2000)
    end_ms = flight.now_ms + 2000
    rising.until(lambda: flight.now_ms > end_ms, 5, "the queue is full")
    flight.texts.clear()
    flight.pilot.hold(SWITCH_LOITER)
    end_ms = flight.now_ms + 3000
    rising.until(lambda: flight.now_ms > end_ms, 5, "what the guard makes of it")
    assert flight.mode == LOITER, f"mode {flight.mode}, {flight.texts}"
    assert not flight.said("undone"), flight.texts
    stays(flight, LOITER, 5)
    return "left to the pilot"


def tunnels() -> list[bytes]:
    return [_packed(tunnel(b"\x55" * 20, OTHER_PAYLOAD))]


def commands() -> list[bytes]:
    return [_packed(dialect.MAVLink_command_long_message(1, 1, REQUEST_MESSAGE, 0, 1, 0, 0, 0, 0, 0, 0))]


def scripting_commands() -> list[bytes]:
    return [_packed(dialect.MAVLink_command_long_message(1, 1, SCRIPTING_COMMAND, 0, 2, 0, 0, 0, 0, 0, 0))]


def false_leases() -> list[bytes]:
    """Of the right system and component, on the wrong channel."""
    lease = struct.Struct("<BBBBIIIHHI")
    forged = [lease.pack(2, LOST, 0, 0, 5, number, 0x7FFF0000, 5000, 0, number) for number in range(100)]
    return [_packed(tunnel(payload), 1, 191) for payload in forged]


def _packed(message: Any, system: int = 99, component: int = 190) -> bytes:
    return bytes(message.pack(dialect.MAVLink(None, srcSystem=system, srcComponent=component)))


CASES = (
    Case("leases at random distances of 0.1 to 1.5 s", jitter(0.1, 1.5)),
    Case("leases at random distances of 0.1 to 2.5 s", jitter(0.1, 2.5)),
    Case("flood, TUNNEL 2000/s", flood(tunnels, 2000)),
    Case("flood, COMMAND_LONG 200/s", flood(commands, 200)),
    Case("flood, MAV_CMD_SCRIPTING 400/s", flood(scripting_commands, 400)),
    Case("flood, false leases 400/s", flood(false_leases, 400)),
    Case("a stranger's DO_AUX_FUNCTION 18 under a flood", function_under_a_flood),
    Case("the pilot's switch under a flood", loss(piloted, cut, pilot_under_a_flood), WITH_RADIO),
)
test_floods = flights(CASES)
