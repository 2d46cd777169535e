# SPDX-License-Identifier: GPL-3.0-or-later

"""Guard and companion that do not fit, and a guard that restarts: what the companion sends, refuses and says."""

from __future__ import annotations

import struct
from collections.abc import Callable

import pytest
from pymavlink.dialects.v20 import ardupilotmega as stock
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.store.keys import key_of, write_key
from mavproxy_handover.wire.lease_tag import lease_tag
from tests.module.conftest import Bench
from tests.module.vehicle import Autopilot

START = mavlink.MAV_CMD_MISSION_START
KEY = key_of("correct-horse-battery-staple")
OLDER = "the guard is older than this companion: put the handover_guard.lua of this release on the card"
TWO = "two guards answer: remove one of the two scripts from the card"
NO_KEY = "the guard has no key: put handover.key on its card, beside the script"


def old_guard(autopilot: Autopilot) -> Callable[[int], None]:
    """The guard of the release before: it refuses leases of this one, and goes on telling that it has none."""

    def say(_state: int) -> None:
        body = struct.pack("<BBBBIIIHBB", 1, 1, 0, 0, 0, 0, 0, 4, 4, 6)
        autopilot.say(stock.MAVLink_tunnel_message(1, 191, 47117, 20, list(body.ljust(128, b"\0"))))

    return say


def two_guards(autopilot: Autopilot) -> Callable[[int], None]:
    """Two speak in turn."""
    say = autopilot.say_guard

    def both(state: int) -> None:
        autopilot.guard_nonce ^= 0x5A5A5A5A
        say(state)

    return both


def refusal(bench: Bench) -> str:
    bench.a.command(START)
    bench.run(0.5)
    return bench.a.texts()


def test_a_guard_that_has_restarted_gets_a_lease_for_it_at_once(ready: Bench) -> None:
    assert {lease[9] for lease in ready.autopilot.leases()[-4:]} == {0x0BADCAFE}
    ready.run(0.1)
    ready.autopilot.guard_nonce = 0x12345678
    ready.autopilot.received.clear()
    ready.autopilot._guard_at = 0.0  # it speaks now
    ready.run(0.1)
    assert 0x12345678 in [lease[9] for lease in ready.autopilot.leases()]


def test_an_older_guard_is_named_and_nothing_starts(ready: Bench) -> None:
    ready.autopilot.say_guard = old_guard(ready.autopilot)  # type: ignore[method-assign]
    ready.wait(4.0)
    assert refusal(ready) == f"START refused: {OLDER}"
    assert ready.autopilot.commands() == []
    assert any(OLDER in line for line in ready.mpstate.console.lines)


def test_two_guards_are_named_and_nothing_starts(ready: Bench) -> None:
    ready.autopilot.say_guard = two_guards(ready.autopilot)  # type: ignore[method-assign]
    ready.wait(3.0)
    assert refusal(ready) == f"START refused: {TWO}"
    assert {lease[3] for lease in ready.autopilot.leases()[-8:]} == {2}
    assert any(TWO in line for line in ready.mpstate.console.lines)


def test_in_flight_the_operators_hear_of_it(ready: Bench) -> None:
    ready.a.command(START)
    ready.until(lambda: ready.autopilot.airborne)
    ready.run(2.0)
    ready.autopilot.say_guard = two_guards(ready.autopilot)  # type: ignore[method-assign]
    ready.wait(3.0)
    assert TWO in ready.a.texts()


def test_with_a_key_a_guard_without_one_counts_as_silent_and_is_named(bench: Bench, delivery: MissionPackage) -> None:
    write_key(bench.folder / "guard.key", KEY)
    bench.configure(more='guard_key = "guard.key"')
    bench.connect()
    bench.share(delivery)
    bench.wait(4.0)
    assert refusal(bench) == f"START refused: {NO_KEY}"
    assert {struct.unpack_from("<I", raw, 20)[0] for raw in bench.autopilot.lease_payloads()} == {0}

    def tagged(state: int) -> None:
        body = struct.pack("<BBBBIIIHBBI", 2, state, 0, 32, *bench.autopilot._lease, 0, 4, 6, 77)
        body += lease_tag(KEY, 47117, (1, 191), body)
        bench.autopilot.say(stock.MAVLink_tunnel_message(1, 191, 47117, 32, list(body.ljust(128, b"\0"))))

    bench.autopilot.say_guard = tagged  # type: ignore[method-assign]
    bench.autopilot.guard_nonce = 77
    bench.wait(4.0)
    assert struct.unpack_from("<I", bench.autopilot.lease_payloads()[-1], 20) == (77,)
    bench.a.command(START)
    bench.until(lambda: bench.autopilot.airborne)


class TestRebootInFlight:
    """The autopilot starts again in flight; its guard and its state are new, its mission is still there."""

    SAID = "Autopilot restarted in flight. Check the aircraft."

    @pytest.fixture
    def rebooted(self, ready: Bench) -> Bench:
        ready.a.command(START)
        ready.until(lambda: ready.autopilot.airborne)
        ready.wait(3.0)
        autopilot = ready.autopilot
        autopilot.say(stock.MAVLink_attitude_message(500_000, 0, 0, 0, 0, 0, 0))
        ready.mpstate.deliver(autopilot._out[-1])
        autopilot.received.clear()
        autopilot.silent = True
        ready.wait(2.0)
        autopilot.silent, autopilot.guard_nonce, autopilot.mode, autopilot._lease = False, 99, 0, (0, 0, 0)
        autopilot.say(stock.MAVLink_attitude_message(3_000, 0, 0, 0, 0, 0, 0))
        ready.mpstate.deliver(autopilot._out[-1])
        return ready

    def test_still_armed_the_operators_hear_it_nothing_is_written_and_the_guard_has_a_lease(
        self, rebooted: Bench
    ) -> None:
        rebooted.wait(10.0)
        assert self.SAID in rebooted.a.texts()
        assert [entry["text"] for entry in rebooted.journal() if entry["event"] == "autopilot_restarted"] == [self.SAID]
        written = {m.get_type() for m in rebooted.autopilot.received}
        assert not written & {"MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_CLEAR_ALL", "PARAM_SET", "SET_MODE"}
        assert rebooted.autopilot.commands() == []
        assert rebooted.autopilot.leases()[-1][9] == 99
        assert (rebooted.companion.view.phase.name, rebooted.companion.view.commander) == ("ON_MISSION", 251)
        rebooted.autopilot.received.clear()
        rebooted.a.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 6)
        rebooted.run(1.0)
        assert rebooted.autopilot.mode == 6

    def test_disarmed_it_does_not_read_like_a_landing_alone(self, rebooted: Bench) -> None:
        rebooted.autopilot.armed = rebooted.autopilot.airborne = False
        rebooted.wait(3.0)
        assert self.SAID in rebooted.a.texts()
        assert rebooted.companion.view.phase.name == "ON_LOAD"
