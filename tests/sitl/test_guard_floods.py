# SPDX-License-Identifier: GPL-3.0-or-later

"""Leases that come late, and others' frames that fill the receive queue: no false alarm, and the leases are heard."""

from __future__ import annotations

import random
import struct
import time
from collections.abc import Callable
from itertools import cycle

from pymavlink.dialects.v20 import all as dialect

from tests.sitl.guard_cases import Case, Outcome, flights, in_guided, stays, stranger
from tests.sitl.guard_flight import GUIDED, LIVE, LOST, Flight, tunnel
from tests.sitl.guard_log import guard_records

DURATION_S = 10
#: no lease that the guard goes by is older (s): the time-out is 3
OLDEST_S = 2.5
SCRIPTING_COMMAND, REQUEST_MESSAGE = 42701, 512
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


def flood(frames: Callable[[dialect.MAVLink], list[bytes]], per_second: int) -> Callable[[Flight], Outcome]:
    """Ten seconds of somebody else's frames on SERIAL0, in real time, while the leases go on at 5 Hz."""

    def fly(flight: Flight) -> Outcome:
        in_guided(flight)
        flight.real_time()
        wire = stranger(flight)
        flying_by = cycle(frames(wire.mav))
        flight.texts.clear()
        flight.statuses.clear()
        sent = 0
        start = time.monotonic()
        while (passed := time.monotonic() - start) < DURATION_S:
            due = int(passed * per_second) - sent
            if due > 0:
                wire.send_raw(b"".join(next(flying_by) for _ in range(due)))
                sent += due
            wire.receive()
            flight.pump()
        assert flight.mode == GUIDED, f"mode {flight.mode}, {flight.texts}"
        assert {status[1] for status in flight.statuses} == {LIVE}
        assert len(flight.statuses) > DURATION_S, "the guard fell silent"
        assert sent >= 0.9 * per_second * DURATION_S, f"only {sent} frames sent"
        flight.close()
        last_us = max(record.TimeUS for record in guard_records(flight.directory))
        flooded = [r for r in guard_records(flight.directory) if r.TimeUS > last_us - DURATION_S * 1e6]
        oldest_s = max(record.Age for record in flooded) / 1000
        assert oldest_s <= OLDEST_S, f"a lease was {oldest_s:.1f} s old"
        return "no false RTL"

    return fly


def tunnels(mav: dialect.MAVLink) -> list[bytes]:
    return [bytes(tunnel(b"\x55" * 20, OTHER_PAYLOAD).pack(mav))]


def commands(mav: dialect.MAVLink) -> list[bytes]:
    return [bytes(dialect.MAVLink_command_long_message(1, 1, REQUEST_MESSAGE, 0, 1, 0, 0, 0, 0, 0, 0).pack(mav))]


def scripting_commands(mav: dialect.MAVLink) -> list[bytes]:
    return [bytes(dialect.MAVLink_command_long_message(1, 1, SCRIPTING_COMMAND, 0, 2, 0, 0, 0, 0, 0, 0).pack(mav))]


def false_leases(mav: dialect.MAVLink) -> list[bytes]:
    """Of the right system and component, on the wrong channel."""
    own = dialect.MAVLink(None, srcSystem=1, srcComponent=191)
    return [
        bytes(tunnel(struct.pack("<BBBBIIIHH", 1, LOST, 0, 0, 5, number, 0x7FFF0000, 5000, 0)).pack(own))
        for number in range(100)
    ]


CASES = (
    Case("leases at random distances of 0.1 to 1.5 s", jitter(0.1, 1.5)),
    Case("leases at random distances of 0.1 to 2.5 s", jitter(0.1, 2.5)),
    Case("flood, TUNNEL 2000/s", flood(tunnels, 2000)),
    Case("flood, COMMAND_LONG 200/s", flood(commands, 200)),
    Case("flood, MAV_CMD_SCRIPTING 400/s", flood(scripting_commands, 400)),
    Case("flood, false leases 400/s", flood(false_leases, 400)),
)
test_floods = flights(CASES)
