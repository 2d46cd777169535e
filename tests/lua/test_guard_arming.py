# SPDX-License-Identifier: GPL-3.0-or-later

"""Guard rule 2: no live lease, no arming; armed on the ground without one: disarm."""

from __future__ import annotations

import pytest

from tests.lua.stub import AUTO, HELD, LOST, RECOVERING, RTL, TRANSFER, Bench

DISARM = 4


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_arming_waits_before_the_guard_has_run() -> None:
    assert Bench(heard=False).refusal == "Waiting for auxiliary authorisation"


def test_no_lease_since_boot_no_arming(bench: Bench) -> None:
    bench.run(100)
    assert bench.refusal == "HNDO: no lease from companion"


def test_live_lease_allows_arming(bench: Bench) -> None:
    bench.with_lease()
    assert bench.may_arm


def test_dead_lease_forbids_arming(bench: Bench) -> None:
    bench.with_lease()
    bench.sending = False
    bench.run(3100)
    assert bench.refusal == "HNDO: lease lost"


def test_a_loss_on_the_ground_is_said_once(bench: Bench) -> None:
    bench.with_lease()
    bench.vehicle.texts.clear()
    bench.sending = False
    bench.run(20_000)
    assert bench.texts == ["HNDO: lease lost"]


@pytest.mark.parametrize(
    ("state", "commander", "refusal"),
    [
        (HELD, 251, None),
        (TRANSFER, 251, None),
        (LOST, 0, "HNDO: no station has authority"),
        (HELD, 0, "HNDO: no station has authority"),
        (RECOVERING, 251, "HNDO: authority is being recovered"),
    ],
)
def test_arming_needs_a_commander_in_office(bench: Bench, state: int, commander: int, refusal: str | None) -> None:
    bench.companion.state, bench.companion.commander = state, commander
    bench.with_lease()
    assert bench.refusal == refusal


def test_what_says_that_authority_is_being_recovered_lets_nobody_arm_and_touches_nothing(bench: Bench) -> None:
    """The lease of a rehearsal: armed all the same, by force, the aircraft is left to whoever has armed it."""
    bench.companion.state, bench.companion.commander = RECOVERING, 251
    bench.with_lease()
    assert not bench.may_arm
    bench.vehicle.armed = True
    bench.run(2000)
    bench.vehicle.flying = True
    bench.run(10_000)
    assert (bench.vehicle.armed, bench.vehicle.disarms, bench.vehicle.mode_requests) == (True, 0, [])


def test_refusals_fit_the_arming_message(bench: Bench) -> None:
    bench.companion.component = 255
    bench.vehicle.parameters["HNDO_CHAN"] = 15.0
    bench.receive(bench.companion.lease(), channel=14)
    bench.run(100)
    assert bench.refusal == "HNDO: lease refused, channel 14 not 15"


def test_authorisation_is_taken_back_once_armed(bench: Bench) -> None:
    """The firmware keeps the last answer of a dead script: killed in flight, it must leave "no"."""
    bench.with_lease()
    assert bench.may_arm
    bench.vehicle.armed = True
    bench.run(100)
    bench.scripting.stop()
    bench.vehicle.armed = False
    assert bench.refusal == "HNDO: guard stopped while armed"


def test_authorisation_returns_after_landing(bench: Bench) -> None:
    bench.with_lease()
    bench.vehicle.armed = True
    bench.run(100)
    bench.vehicle.armed = False
    bench.run(100)
    assert bench.may_arm


def test_armed_by_force_without_lease_is_disarmed(bench: Bench) -> None:
    bench.run(5000)
    bench.vehicle.armed = True
    bench.run(100)
    assert not bench.vehicle.armed
    assert bench.texts[-1] == "HNDO: no lease, disarmed"
    assert bench.status.action == DISARM


def test_every_forced_arming_is_answered_at_once(bench: Bench) -> None:
    bench.run(5000)
    for count in (1, 2, 3):
        bench.vehicle.armed = True
        bench.run(100)
        assert (bench.vehicle.armed, bench.vehicle.disarms) == (False, count)


def test_lease_lost_while_armed_on_the_ground_is_disarmed(bench: Bench) -> None:
    bench.with_lease()
    bench.vehicle.armed = True
    bench.sending = False
    bench.run(2700)
    assert bench.vehicle.armed
    bench.run(500)
    assert not bench.vehicle.armed
    assert bench.texts[-1] == "HNDO: lease lost, disarmed"


def test_a_take_off_that_the_autopilot_does_not_call_flying_yet_is_left_alone(bench: Bench) -> None:
    """`get_likely_flying` is false for the first moments; a loss a moment later is one in flight, for all that."""
    bench.with_lease()
    bench.vehicle.armed, bench.vehicle.mode = True, AUTO
    bench.run(2000)
    assert (bench.vehicle.armed, bench.vehicle.mode, bench.vehicle.disarms) == (True, AUTO, 0)
    bench.sending = False
    bench.run(1000)
    bench.vehicle.flying = True
    bench.run(2300)
    assert (bench.vehicle.armed, bench.vehicle.mode, bench.vehicle.disarms) == (True, RTL, 0)


def test_nobody_commands_while_armed_on_the_ground(bench: Bench) -> None:
    bench.with_lease()
    bench.vehicle.armed = True
    bench.companion.state, bench.companion.commander = LOST, 0
    bench.run(3000)
    assert bench.vehicle.armed
    bench.run(400)
    assert not bench.vehicle.armed


def test_recovering_companion_does_not_disarm(bench: Bench) -> None:
    bench.with_lease()
    bench.vehicle.armed = True
    bench.companion.state = RECOVERING
    bench.run(5000)
    assert bench.vehicle.armed


def test_refused_disarm_is_repeated_once_a_second(bench: Bench) -> None:
    bench.vehicle.disarm_works = False
    bench.run(5000)
    bench.vehicle.armed = True
    bench.run(3050)
    assert bench.vehicle.disarms == 4
    assert bench.status.flags == 3  # enforcing, armed


def test_no_disarm_at_a_touch_of_the_ground(bench: Bench) -> None:
    """A script's disarm stops the motors in the air as well, and landed is an estimate."""
    bench.fly()
    bench.vehicle.mode = 6
    bench.sending = False
    bench.run(4000)
    for _ in range(5):
        bench.vehicle.flying = False
        bench.run(2800)
        bench.vehicle.flying = True
        bench.run(100)
    assert bench.vehicle.disarms == 0
    bench.vehicle.flying = False
    bench.run(3200)
    assert bench.vehicle.disarms == 1


def test_forced_arming_right_after_a_landing(bench: Bench) -> None:
    bench.fly()
    bench.vehicle.mode = 6
    bench.lose_lease()
    bench.run(5000)
    bench.vehicle.armed = bench.vehicle.flying = False
    bench.run(500)
    bench.vehicle.armed = True
    bench.run(100)
    assert bench.vehicle.disarms == 1


def test_disabled_guard_allows_arming(bench: Bench) -> None:
    bench.vehicle.parameters["HNDO_ENABLE"] = 0.0
    bench.run(5000)
    assert bench.may_arm
    bench.vehicle.armed = True
    bench.run(5000)
    assert bench.vehicle.armed
    assert bench.status.state == 0


def test_enabling_gives_the_companion_time(bench: Bench) -> None:
    bench.vehicle.parameters["HNDO_ENABLE"] = 0.0
    bench.run(5000)
    bench.vehicle.armed = True
    bench.vehicle.parameters["HNDO_ENABLE"] = 1.0
    bench.run(2900)
    assert bench.vehicle.armed
    bench.run(300)
    assert not bench.vehicle.armed


def test_too_many_authorisers_is_said_and_keeps_the_vehicle_down() -> None:
    greedy = "for _ = 1, 3 do arming:set_aux_auth_passed(arming:get_aux_auth_id()) end"
    bench = Bench(earlier_script=greedy).with_lease()
    assert "HNDO: no arming authorisation available" in bench.texts
    assert bench.refusal == "Too many auxiliary authorisers"
    assert bench.status.state == 2  # what the companion is told goes on
    assert not any("fault" in text for text in bench.texts)


FAULT = "HNDO: guard fault, see messages"


@pytest.mark.parametrize("part", ["vehicle.get_mode", "arming.is_armed", "param.set"])
def test_a_guard_with_a_fault_lets_no_vehicle_arm(part: str) -> None:
    """The fault: the lease was live, so the vehicle armed, though nothing would have brought it home. Missing are what
    enforcement looks at, and what housekeeping sets."""
    bench = Bench(absent=[part])
    bench.with_lease()
    bench.run(2000)
    assert bench.status.state == 2
    assert any(text.startswith("HNDO: fault ") for text in bench.texts)
    assert bench.refusal == FAULT


def test_not_even_the_call_that_fails_lets_it_arm() -> None:
    """The authorisation of that call is withdrawn in the call itself, not 50 ms later."""
    bench = Bench(absent=["param.set"])
    bench.sending = True
    for _ in range(50):
        bench.run(10)
        assert not bench.may_arm
    assert bench.status.state == 2


#: takes a binding away and gives it back: in this host scripts share them
BREAKER = """
local there = vehicle.get_mode
function update()
    vehicle.get_mode = param:get("BREAKS") ~= 1 and there or nil
    return update, 10
end
return update, 10
"""


def test_after_a_fault_the_vehicle_arms_again_in_ten_seconds() -> None:
    bench = Bench(earlier_script=BREAKER, parameters={"BREAKS": 0.0}).with_lease()
    assert bench.may_arm
    bench.vehicle.parameters["BREAKS"] = 1.0
    bench.run(100)
    assert bench.refusal == FAULT
    bench.vehicle.parameters["BREAKS"] = 0.0
    bench.run(9900)
    assert bench.refusal == FAULT
    bench.run(200)
    assert bench.may_arm


def test_and_not_again_when_the_clock_has_gone_half_way_round() -> None:
    """A ground time of 25 days: the instant of the fault then seems to lie ahead."""
    bench = Bench(earlier_script=BREAKER, parameters={"BREAKS": 1.0}).with_lease()
    assert bench.refusal == FAULT
    bench.vehicle.parameters["BREAKS"] = 0.0
    bench.run(11_000)
    assert bench.may_arm
    bench.vehicle.now_ms += 0x80000000
    bench.run(1000)
    assert bench.may_arm
