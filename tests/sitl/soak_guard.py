# SPDX-License-Identifier: GPL-3.0-or-later

"""The guard in ArduCopter for an hour, with cuts of all lengths: python -m tests.sitl.soak_guard --minutes 60 --seed 1

Not part of `make test`. `--arducopter PATH`, as often as wanted, flies it on one version after the other.

The aircraft hovers in GUIDED; one event after the other, drawn with the seed, is played: leases missing for a short or
a long time, leases that say LOST, a companion that restarts, another commander, forged, replayed and corrupted leases,
a command that would stop scripting. After each it is known what the aircraft must do: go home within the time-out, or
fly on. Simulated time runs faster than the wall clock, so gaps are measured with the autopilot's clock as they were,
not as they were meant: a hiccup of this computer that makes a short one long is left out and counted. The first thing
that is wrong ends the flight of that version; exit code 1 then.
"""

from __future__ import annotations

import argparse
import random
import struct
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from sitl.vehicles import LaunchError, find_arducopter
from tests.sitl.firmware import Firmware, NotFirmware, firmware_of
from tests.sitl.guard_flight import (
    DENIED,
    GUIDED,
    HELD,
    LIVE,
    LOST,
    LOST_STATE,
    RTL,
    Flight,
    Wire,
    flying,
    target,
    tunnel,
)

TIMEOUT_S = LOST_TIME_S = 3.0
#: what the way of a status to here and a step of the wall clock are worth at ten times the speed
SLACK_S = 1.0
BAD_WORDS = ("HNDO: fault", "Lua:", "Scripting: stopped", "MAVLink rx", "guard stopped")


class Wrong(AssertionError):
    """The guard did something else than it must."""


class Soak:
    """One aircraft, one random source, and the events."""

    def __init__(self, flight: Flight, seed: int, speedup: float) -> None:
        self.flight = flight
        self.random = random.Random(seed)
        self.speedup = speedup
        self.done: Counter[str] = Counter()
        self.worst_action_ms = 0
        self.events = (
            self.calm,
            self.short_cut,
            self.long_cut,
            self.long_cut_contested,
            self.short_lost,
            self.long_lost,
            self.restart,
            self.another_commander,
            self.forgery,
            self.stop_command,
        )

    def take_off(self) -> None:
        flight = self.flight
        flight.take_off()
        flight.lease["ttl_ms"] = 5000
        flight.set_parameter("HNDO_TIMEOUT", TIMEOUT_S)
        flight.set_parameter("SIM_SPEEDUP", self.speedup)
        flight.speedup = self.speedup
        flight.run(5)

    def step(self) -> None:
        flight = self.flight
        event = self.random.choice(self.events)
        flight.texts.clear()
        del flight.statuses[:-1]
        name = event.__name__
        if event() is False:
            name += " (left out: a hiccup made it longer)"
        self.done[name] += 1
        self.back_to_guided()
        bad = [text for text in flight.texts if any(word in text for word in BAD_WORDS)]
        if bad:
            raise Wrong(f"after {name}: {bad}")

    # ---- events ---------------------------------------------------------------------------------------------------

    def calm(self) -> bool:
        return self.pause(self.random.uniform(2, 15))

    def pause(self, seconds: float) -> bool:
        """Fly on with leases. False if this computer did not keep the pace."""
        flight, worst_ms = self.flight, 0
        end_ms = flight.now_ms + seconds * 1000
        while flight.now_ms < end_ms:
            flight.pump()
            worst_ms = max(worst_ms, flight.now_ms - flight.last_lease_ms)
        return self.must_fly_on(worst_ms)

    def must_fly_on(self, gap_ms: int) -> bool:
        flight = self.flight
        flight.run(1.0)
        if gap_ms > (TIMEOUT_S - SLACK_S) * 1000:
            return False
        if flight.mode != GUIDED or flight.status[2] != 0 or not flight.is_state(LIVE):
            raise Wrong(f"gap of {gap_ms} ms, mode {flight.mode}, status {flight.status}, texts {flight.texts[-5:]}")
        return True

    def short_cut(self) -> bool:
        flight = self.flight
        last_ms = flight.last_lease_ms
        flight.sending = False
        flight.run(self.random.uniform(0.3, TIMEOUT_S - SLACK_S - 0.4))
        flight.sending = True
        flight.until(lambda: flight.last_lease_ms > last_ms, 5, "leases again")
        return self.must_fly_on(flight.last_lease_ms - last_ms)

    def long_cut(self) -> None:
        flight = self.flight
        flight.sending = False
        last_ms = flight.last_lease_ms
        self.expect_return(last_ms, TIMEOUT_S)
        flight.run(self.random.uniform(0, 6))
        self.authority_back()

    def long_cut_contested(self) -> None:
        flight = self.flight
        flight.sending = False
        self.expect_return(flight.last_lease_ms, TIMEOUT_S)
        for _ in range(self.random.randint(1, 3)):
            flight.until(lambda: flight.mode == RTL, 5, "RTL")
            flight.texts.clear()
            flight.set_mode(GUIDED)
            flight.run(2.5)
            if flight.mode != RTL:
                raise Wrong(f"a mode change was not undone: mode {flight.mode}, {flight.texts}")
        self.authority_back()

    def short_lost(self) -> bool:
        flight = self.flight
        start_ms = flight.now_ms
        commander = self.nobody()
        flight.run(self.random.uniform(0.3, LOST_TIME_S - SLACK_S - 0.4))
        flight.lease["state"], flight.lease["commander"] = HELD, commander
        sent = flight.sequence
        flight.until(lambda: flight.sequence != sent, 5, "the next lease")
        return self.must_fly_on(flight.now_ms - start_ms)

    def long_lost(self) -> None:
        flight = self.flight
        commander = self.nobody()
        flight.statuses.clear()
        since_ms = flight.until(lambda: flight.is_state(LOST_STATE), 3, "LOST")
        self.expect_return(since_ms, LOST_TIME_S)
        flight.run(self.random.uniform(0, 4))
        flight.lease["state"], flight.lease["commander"] = HELD, commander
        self.authority_back()

    def nobody(self) -> int:
        commander = self.flight.lease["commander"]
        self.flight.lease["state"], self.flight.lease["commander"] = LOST, 0
        return commander

    def restart(self) -> bool:
        flight = self.flight
        last_ms = flight.last_lease_ms
        flight.sending = False
        flight.run(self.random.uniform(0.2, TIMEOUT_S - SLACK_S - 0.4))
        nonce = self.random.randrange(1, 1 << 32)
        flight.restart_companion(nonce)
        flight.sending = True
        flight.until(lambda: flight.status[4] == nonce, 3, "the new nonce")
        return self.must_fly_on(flight.last_lease_ms - last_ms)

    def another_commander(self) -> bool:
        flight = self.flight
        flight.lease["commander"] = 503 - flight.lease["commander"]  # 251 and 252
        flight.lease["epoch"] += 1
        going = self.pause(1.0)
        name = f"lease live, {flight.lease['commander']} commands"
        if not flight.said(name):
            raise Wrong(f"not said: {name}; {flight.texts}")
        return going

    def forgery(self) -> bool:
        flight = self.flight
        recorded = flight.send_lease()
        forger = Wire(flight.vehicle.address(0), 1, 191)
        worst_ms, rejected = 0, flight.status[7]
        try:
            for number in range(self.random.randint(10, 60)):
                payload = struct.pack("<BBBBIIIHHI", 2, LOST, 0, 0, 5, number, 0x7FFF0000, 5000, 0, flight.guard_nonce)
                forger.send(tunnel(payload))
                corrupted = bytearray(recorded)
                corrupted[self.random.randrange(10, len(corrupted))] ^= 1 << self.random.randrange(8)
                flight.companion.send_raw(bytes(corrupted))
                flight.companion.send_raw(recorded)
                for _ in range(4):
                    flight.pump()
                    worst_ms = max(worst_ms, flight.now_ms - flight.last_lease_ms)
        finally:
            forger.socket.close()
        flight.run(1)
        if flight.status[7] == rejected:
            raise Wrong("no forged lease was counted")
        return self.must_fly_on(worst_ms)

    def stop_command(self) -> bool:
        answer = self.flight.command(42701, 2)
        if answer != DENIED:
            raise Wrong(f"the command to stop scripting was answered {answer}")
        return self.pause(1.0)

    # ---- what must follow -----------------------------------------------------------------------------------------

    def expect_return(self, since_ms: int, limit_s: float) -> None:
        flight = self.flight
        flight.statuses.clear()
        acted_ms = flight.until(lambda: flight.statuses and flight.status[2] == 1, limit_s + 3, "guard acts") - since_ms
        if not (limit_s - SLACK_S) * 1000 <= acted_ms <= (limit_s + 0.2 + SLACK_S) * 1000:
            raise Wrong(f"acted after {acted_ms} ms, limit {limit_s} s")
        self.worst_action_ms = max(self.worst_action_ms, acted_ms)
        flight.until(lambda: flight.mode == RTL, 3, "RTL")

    def authority_back(self) -> None:
        flight = self.flight
        flight.sending = True
        flight.statuses.clear()
        flight.until(lambda: flight.is_state(LIVE), 5, "lease live again")
        flight.run(1)
        if flight.armed and flight.mode != RTL:
            raise Wrong(f"left RTL by itself: mode {flight.mode}")

    def back_to_guided(self) -> None:
        """The commander takes the aircraft back to its place."""
        flight = self.flight
        if not flight.armed:
            self.done["landed, took off again"] += 1
            self.take_off()
        for _ in range(5):
            if flight.mode == GUIDED:
                break
            flight.set_mode(GUIDED)
            flight.run(1.2)
        if flight.mode != GUIDED:
            raise Wrong(f"the commander cannot command: mode {flight.mode}, {flight.texts[-5:]}")
        flight.station.send(target(self.random.uniform(-45, 45), 25))
        flight.until(lambda: flight.is_state(LIVE), 5, "lease live")
        self.pause(2)


def soak(firmware: Firmware, minutes: float, seed: int, speedup: float) -> bool:
    """One version, for so many minutes of the autopilot's time; says how it went. True if all was as it must be."""
    print(firmware, flush=True)
    started = time.monotonic()
    with tempfile.TemporaryDirectory() as folder, flying(firmware, Path(folder)) as flight:
        aircraft = Soak(flight, seed, speedup)
        flight.beating = {251, 252}
        aircraft.take_off()
        begin_ms = shown_ms = flight.now_ms
        failure = ""
        try:
            while flight.now_ms - begin_ms < minutes * 60_000:
                aircraft.step()
                if flight.now_ms - shown_ms > 300_000:
                    shown_ms = flight.now_ms
                    print(f"{(shown_ms - begin_ms) / 60_000:.0f} min, {sum(aircraft.done.values())} events", flush=True)
        except AssertionError as error:
            failure = str(error)
        for name, count in sorted(aircraft.done.items()):
            print(f"{count:5} {name}")
        flown = (flight.now_ms - begin_ms) / 60_000
        wall_s = time.monotonic() - started
        print(f"{flown:.1f} min flown in {wall_s:.0f} s, slowest action {aircraft.worst_action_ms} ms after the loss")
        print(f"WRONG: {failure}" if failure else "all as it must be", flush=True)
    return not failure


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="The guard in ArduCopter, with random cuts of its leases.")
    parser.add_argument("--minutes", type=float, default=60, help="of the autopilot's time, each (default: 60)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--speedup", type=float, default=10)
    parser.add_argument(
        "--arducopter", action="append", metavar="PATH", help="an arducopter SITL program; may be given several times"
    )
    arguments = parser.parse_args(argv)
    try:
        programs = [find_arducopter(path) for path in arguments.arducopter or [None]]
        firmwares = [firmware_of(program) for program in programs if program]
    except (LaunchError, NotFirmware) as error:
        parser.error(str(error))
    if not firmwares:
        parser.error("no arducopter SITL program: give --arducopter PATH")
    went_well = [soak(firmware, arguments.minutes, arguments.seed, arguments.speedup) for firmware in firmwares]
    return 0 if all(went_well) else 1


if __name__ == "__main__":
    sys.exit(main())
