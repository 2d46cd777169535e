# SPDX-License-Identifier: GPL-3.0-or-later

"""Whom the guard takes for a pilot: a switch of a transmitter that the radio failsafe watches, and no station."""

from __future__ import annotations

import struct

import pytest

from tests.lua.stub import (
    AUTO,
    BY_AUX,
    BY_ESCAPE,
    BY_GCS,
    BY_RC,
    GUIDED,
    LAND,
    LANDING,
    LOITER,
    ORDERING,
    PILOT,
    RETURNING,
    RTL,
    STABILIZE,
    Bench,
    command_frame,
)

DO_AUX_FUNCTION = 218
ACCEPTED, DENIED, FAILED = 0, 2, 4
ALT_HOLD = 2


@pytest.fixture
def bench() -> Bench:
    bench = Bench()
    bench.vehicle.rc = True
    return bench


@pytest.fixture
def unblocked() -> Bench:
    """Firmware that leaves no command to a script: during a loss it does every DO_AUX_FUNCTION at once."""
    bench = Bench(absent=["mavlink.block_command"])
    bench.vehicle.rc = True
    return bench


def going_home(bench: Bench) -> Bench:
    bench.fly(AUTO)
    bench.lose_lease()
    bench.until(lambda: bench.vehicle.mode == RTL)
    bench.run(500)
    assert bench.enforcement == RETURNING
    bench.vehicle.texts.clear()
    bench.vehicle.mode_requests.clear()
    return bench


def fill(bench: Bench, frames: int = 30) -> None:
    for _ in range(frames):
        bench.hear()


class TestRadio:
    """With FS_THR_ENABLE 0 the firmware calls any radio valid, one without a transmitter as well."""

    @pytest.mark.parametrize("firmware", [(4, 5, 7), (4, 7, 1)])
    def test_without_a_radio_failsafe_nobody_steers_by_hand(self, firmware: tuple[int, int, int]) -> None:
        bench = Bench(parameters={"FS_THR_ENABLE": 0.0}, firmware=firmware)
        bench.vehicle.rc = True
        bench.fly(LOITER, BY_RC)
        bench.lose_lease()
        bench.run(4000)
        assert bench.vehicle.mode == RTL

    def test_and_nobody_takes_over(self, bench: Bench) -> None:
        bench.vehicle.parameters["FS_THR_ENABLE"] = 0.0
        going_home(bench).pilot_chooses(STABILIZE)
        bench.run(200)
        assert bench.vehicle.mode == RTL
        assert bench.texts == ["HNDO: lease lost, switch undone, FS_THR_ENABLE 0"]

    def test_firmware_without_the_parameter_has_no_radio_failsafe(self) -> None:
        bench = Bench(without=["FS_THR_ENABLE"])
        bench.vehicle.rc = True
        bench.fly(LOITER, BY_RC)
        bench.lose_lease()
        bench.run(4000)
        assert bench.vehicle.mode == RTL
        assert not any("fault" in text for text in bench.texts)

    def test_a_parameter_that_cannot_be_read_is_no_radio_failsafe(self, bench: Bench) -> None:
        going_home(bench)
        del bench.vehicle.parameters["FS_THR_ENABLE"]
        bench.pilot_chooses(LOITER)
        bench.run(200)
        assert bench.vehicle.mode == RTL
        assert not any("fault" in text for text in bench.texts)

    def test_a_switch_without_a_radio_is_undone(self, bench: Bench) -> None:
        """A receiver that puts out its stored positions."""
        going_home(bench).pilot_chooses(LOITER)
        bench.vehicle.rc = False
        bench.run(200)
        assert bench.vehicle.mode == RTL
        assert bench.texts == ["HNDO: lease lost, switch undone, no radio"]

    def test_a_radio_that_falters_for_less_than_two_seconds_stays_the_pilots(self, bench: Bench) -> None:
        bench.fly(LOITER, BY_RC)
        bench.lose_lease()
        bench.run(4000)
        for _ in range(20):
            bench.vehicle.rc = False
            bench.run(1900)
            bench.vehicle.rc = True
            bench.run(100)
        assert (bench.enforcement, bench.vehicle.mode_requests) == (PILOT, [])

    def test_a_radio_failsafe_that_is_switched_off_ends_it(self, bench: Bench) -> None:
        bench.fly(LOITER, BY_RC)
        bench.lose_lease()
        bench.run(4000)
        bench.vehicle.parameters["FS_THR_ENABLE"] = 0.0
        bench.run(2100)
        assert bench.vehicle.mode == RTL

    def test_the_radio_failsafe_of_the_autopilot_comes_first(self, bench: Bench) -> None:
        bench.fly(LOITER, BY_RC)
        bench.lose_lease()
        bench.run(4000)
        bench.vehicle.rc = False
        bench.run(1000)
        bench.vehicle.mode, bench.vehicle.reason = LAND, 3
        bench.run(10_000)
        assert bench.vehicle.mode_requests == []

    def test_a_pilot_on_the_way_home_needs_no_radio_any_more(self, bench: Bench) -> None:
        going_home(bench)
        bench.vehicle.rc = False
        bench.run(10_000)
        assert bench.vehicle.mode_requests == []


class TestThrottleEscape:
    """PILOT_THR_BHV bit 1: throttle up leaves a descent, with reason 9."""

    @pytest.mark.parametrize("mode", [LOITER, ALT_HOLD])
    @pytest.mark.parametrize("descent", [RTL, LAND])
    def test_is_not_fought(self, bench: Bench, mode: int, descent: int) -> None:
        bench.fly(descent)
        bench.lose_lease()
        bench.run(4000)
        bench.vehicle.mode, bench.vehicle.reason = mode, BY_ESCAPE
        bench.run(10_000)
        assert (bench.enforcement, bench.vehicle.mode_requests) == (PILOT, [])

    def test_out_of_a_landing_of_auto(self, bench: Bench) -> None:
        bench.fly(AUTO)
        bench.vehicle.landing = True
        bench.lose_lease()
        bench.run(4000)
        bench.vehicle.landing = False
        bench.vehicle.mode, bench.vehicle.reason = LOITER, BY_ESCAPE
        bench.run(10_000)
        assert (bench.enforcement, bench.vehicle.mode_requests) == (PILOT, [])


class TestAuxFunction:
    """DO_AUX_FUNCTION changes the mode with the pilot's reason: 53, on 4.5 the mode switch's 1."""

    @pytest.fixture
    def bench(self, unblocked: Bench) -> Bench:
        return unblocked

    @pytest.mark.parametrize("reason", [BY_AUX, BY_RC])
    @pytest.mark.parametrize("shape", ["long", "int", "long in MAVLink 1", "int in MAVLink 1"])
    def test_of_a_station_is_undone_and_the_sender_named(self, bench: Bench, shape: str, reason: int) -> None:
        going_home(bench)
        bench.receive(
            command_frame(DO_AUX_FUNCTION, as_int=shape.startswith("int"), force_mavlink1=shape.endswith("1")),
            channel=2,
        )
        bench.pilot_chooses(STABILIZE, reason)
        bench.until(lambda: bench.vehicle.mode == RTL, 200)
        bench.run(5000)
        assert bench.vehicle.mode_requests == [RTL]
        assert bench.texts == ["HNDO: lease lost, DO_AUX of 66/190 undone"]

    @pytest.mark.parametrize("delay_ms", [0, 10, 200, 900])
    def test_it_may_act_later(self, bench: Bench, delay_ms: int) -> None:
        """The way back to the mode of the switch is debounced for 0.2 s."""
        going_home(bench)
        bench.receive(command_frame(DO_AUX_FUNCTION), channel=2)
        bench.run(delay_ms)
        bench.pilot_chooses(STABILIZE)
        bench.run(200)
        assert bench.vehicle.mode == RTL

    def test_a_second_later_a_pilot_is_believed_again(self, bench: Bench) -> None:
        going_home(bench)
        bench.receive(command_frame(DO_AUX_FUNCTION), channel=2)
        bench.run(1200)
        bench.pilot_chooses(STABILIZE)
        bench.run(5000)
        assert (bench.enforcement, bench.vehicle.mode_requests) == (PILOT, [])

    def test_one_of_long_ago_does_not_count_when_the_clock_has_gone_half_way_round(self, bench: Bench) -> None:
        bench.fly(AUTO)
        bench.receive(command_frame(DO_AUX_FUNCTION), channel=2)
        bench.run(15_000)
        bench.vehicle.now_ms += 0x90000000
        bench.with_lease()
        going_home(bench).pilot_chooses(STABILIZE)
        bench.run(5000)
        assert bench.vehicle.mode_requests == []

    def test_with_a_wrong_checksum_is_none(self, bench: Bench) -> None:
        """Damaged frames come in past a port's signing; they must not keep a pilot from his aircraft."""
        going_home(bench)
        frame = bytearray(command_frame(DO_AUX_FUNCTION))
        frame[-1] ^= 0xFF
        bench.receive(bytes(frame), channel=2)
        bench.pilot_chooses(STABILIZE)
        bench.run(5000)
        assert bench.vehicle.mode_requests == []

    def test_no_other_command_counts(self, bench: Bench) -> None:
        """MAV_CMD_SCRIPTING is read as well."""
        going_home(bench)
        bench.receive(command_frame(42701), channel=2)
        bench.pilot_chooses(STABILIZE)
        bench.run(5000)
        assert (bench.enforcement, bench.vehicle.mode_requests) == (PILOT, [])

    def test_in_a_flood_of_them_every_one_counts(self, bench: Bench) -> None:
        """Only ten a second are looked at; the others are noted all the same."""
        going_home(bench)
        for number in range(200):
            bench.receive(command_frame(DO_AUX_FUNCTION), channel=2)
            if number % 9 == 0:
                bench.pilot_chooses(STABILIZE if number % 2 else LOITER)
            bench.run(20)
        bench.run(200)
        assert bench.vehicle.mode == RTL
        assert bench.enforcement == RETURNING
        assert "HNDO: lease lost, pilot flies" not in bench.texts

    def test_does_not_take_the_aircraft_from_a_pilot(self, bench: Bench) -> None:
        """In the mode that it orders he flies already."""
        bench.fly(LOITER, BY_RC)
        bench.lose_lease()
        bench.run(4000)
        bench.receive(command_frame(DO_AUX_FUNCTION), channel=2)
        bench.vehicle.reason = BY_AUX
        bench.run(5000)
        assert (bench.enforcement, bench.vehicle.mode_requests) == (PILOT, [])

    def test_out_of_the_pilots_mode_is_undone(self, bench: Bench) -> None:
        bench.fly(LOITER, BY_RC)
        bench.lose_lease()
        bench.run(4000)
        bench.receive(command_frame(DO_AUX_FUNCTION), channel=2)
        bench.pilot_chooses(GUIDED, BY_AUX)
        bench.run(200)
        assert bench.vehicle.mode == RTL

    @pytest.mark.parametrize("mode", [LOITER, STABILIZE])
    def test_of_the_commander_before_the_loss_makes_no_pilot(self, bench: Bench, mode: int) -> None:
        """Nobody steers by hand in it."""
        bench.fly(AUTO)
        bench.receive(command_frame(DO_AUX_FUNCTION))
        bench.pilot_chooses(mode, BY_AUX)
        bench.run(30_000)
        assert bench.vehicle.mode == mode
        bench.lose_lease()
        bench.run(4000)
        assert bench.vehicle.mode == RTL

    def test_while_the_script_slept_counts_as_well(self, bench: Bench) -> None:
        """When within that time the mode changed is not known."""
        going_home(bench)
        bench.receive(command_frame(DO_AUX_FUNCTION), channel=2)
        bench.pilot_chooses(STABILIZE)
        bench.vehicle.now_ms += 4000
        bench.run(200)
        assert bench.vehicle.mode == RTL

    def test_modes_that_change_all_the_time_are_not_looked_at_for_ever(self, bench: Bench) -> None:
        going_home(bench)
        for number in range(40):
            if bench.vehicle.mode_requests:
                break
            bench.pilot_chooses((STABILIZE, LOITER)[number % 2], BY_AUX)
            bench.run(10)
        assert bench.vehicle.mode_requests == [RTL]
        assert number <= 12


class TestAuxFunctionDuringALoss:
    """From the first loss in flight on the guard answers for it.

    A moment in STABILIZE stops the motors for good when the throttle stick is down.
    """

    RTL_OFF = (4.0, 0.0)

    def results(self, bench: Bench) -> list[int]:
        found = [(chan, payload) for chan, msgid, payload in bench.vehicle.messages if msgid == 77]
        assert {chan for chan, _ in found} <= {2}
        acks = [struct.unpack("<HBBiBB", payload) for _, payload in found]
        assert {(ack[0], *ack[2:]) for ack in acks} <= {(DO_AUX_FUNCTION, 0, 0, 66, 190)}
        return [ack[1] for ack in acks]

    @pytest.mark.parametrize("as_int", [False, True])
    def test_it_is_refused(self, bench: Bench, as_int: bool) -> None:
        going_home(bench)
        assert bench.scripting.command_blocked(DO_AUX_FUNCTION)
        bench.receive(command_frame(DO_AUX_FUNCTION, as_int=as_int, values=self.RTL_OFF), channel=2)
        bench.run(200)
        assert self.results(bench) == [DENIED]
        assert bench.vehicle.aux_functions == []
        assert bench.texts == ["HNDO: DO_AUX of 66/190 denied"]

    def test_whatever_the_guard_is_at(self, bench: Bench) -> None:
        bench.fly(LOITER, BY_RC)
        bench.lose_lease()
        bench.run(4000)
        assert bench.enforcement == PILOT
        bench.receive(command_frame(DO_AUX_FUNCTION), channel=2)
        bench.run(200)
        assert self.results(bench) == [DENIED]

    @pytest.mark.parametrize(("works", "result"), [(True, ACCEPTED), (False, FAILED)])
    @pytest.mark.parametrize("as_int", [False, True])
    def test_with_authority_back_it_does_what_it_always_did(
        self, bench: Bench, as_int: bool, works: bool, result: int
    ) -> None:
        going_home(bench)
        bench.sending = True
        bench.run(1000)
        bench.vehicle.aux_works = works
        bench.receive(command_frame(DO_AUX_FUNCTION, as_int=as_int, values=(28.0, 2.0)), channel=2)
        bench.run(200)
        assert self.results(bench) == [result]
        assert bench.vehicle.aux_functions == [(28, 2)]

    def test_with_authority_back_every_one_is_done(self, bench: Bench) -> None:
        going_home(bench)
        bench.sending = True
        bench.run(1000)
        for number in range(20):
            bench.receive(command_frame(DO_AUX_FUNCTION, values=(28.0, float(number % 3))), channel=2)
            bench.run(50)
        assert self.results(bench) == [ACCEPTED] * 20
        assert bench.vehicle.aux_functions == [(28, number % 3) for number in range(20)]

    @pytest.mark.parametrize("values", [(-1.0, 0.0), (28.0, 3.0), (float("nan"), 0.0), (28.0, float("inf"))])
    def test_nonsense_has_failed(self, bench: Bench, values: tuple[float, float]) -> None:
        going_home(bench)
        bench.sending = True
        bench.run(1000)
        bench.receive(command_frame(DO_AUX_FUNCTION, values=values), channel=2)
        bench.run(200)
        assert self.results(bench) == [FAILED]
        assert not any("fault" in text for text in bench.texts)

    def test_before_the_first_loss_the_firmware_answers(self, bench: Bench) -> None:
        bench.run(10_000)
        bench.fly(AUTO)
        assert not bench.scripting.command_blocked(DO_AUX_FUNCTION)
        bench.receive(command_frame(DO_AUX_FUNCTION), channel=2)
        bench.run(200)
        assert self.results(bench) == []
        assert bench.vehicle.aux_functions == []

    def test_firmware_that_blocks_no_command_answers_always(self) -> None:
        bench = Bench(absent=["mavlink.block_command"])
        bench.vehicle.rc = True
        going_home(bench)
        bench.receive(command_frame(DO_AUX_FUNCTION), channel=2)
        bench.run(200)
        assert self.results(bench) == []
        bench.pilot_chooses(STABILIZE, BY_AUX)
        bench.run(200)
        assert bench.vehicle.mode == RTL


class TestNobodyKeepsThePilotOut:
    """Once it is left to the guard, no DO_AUX_FUNCTION and no flood takes the aircraft from a pilot."""

    def test_not_one_whose_orders_are_denied(self, bench: Bench) -> None:
        going_home(bench)
        bench.run(1000)
        for number in range(100):
            bench.receive(command_frame(DO_AUX_FUNCTION), channel=2)
            if number == 50:
                bench.pilot_chooses(STABILIZE, BY_AUX)
            bench.run(30)
        assert (bench.enforcement, bench.vehicle.mode_requests) == (PILOT, [])
        assert "HNDO: DO_AUX of 66/190 denied" in bench.texts

    @pytest.mark.parametrize("mode", [STABILIZE, LAND])
    def test_not_one_who_fills_the_queue(self, bench: Bench, mode: int) -> None:
        going_home(bench)
        bench.run(1000)
        for number in range(100):
            fill(bench)
            if number == 50:
                bench.pilot_chooses(mode)
            bench.run(10)
        assert (bench.enforcement, bench.vehicle.mode_requests) == (PILOT if mode == STABILIZE else LANDING, [])

    @pytest.mark.parametrize(("after_ms", "believed"), [(300, False), (900, False), (1200, True)])
    def test_what_the_queue_lost_before_may_act_for_a_second(self, bench: Bench, after_ms: int, believed: bool) -> None:
        """The way back to the mode of the switch is debounced."""
        bench.fly(AUTO)
        bench.lose_lease()
        while bench.vehicle.mode != RTL:
            fill(bench)
            bench.run(10)
        bench.vehicle.mode_requests.clear()
        for number in range(200):
            if number == after_ms // 10:
                bench.pilot_chooses(STABILIZE)
            fill(bench)
            bench.run(10)
        assert bench.vehicle.mode_requests == ([] if believed else [RTL])
        assert ("HNDO: lease lost, switch undone, rx flooded" in bench.texts) is not believed

    @pytest.mark.parametrize("delay_ms", [0, 200, 900])
    def test_an_order_that_the_firmware_did_just_before(self, bench: Bench, delay_ms: int) -> None:
        """It stands in the queue until after the loss."""
        bench.fly(AUTO)
        lost_ms = bench.lose_lease()
        bench.until(lambda: bench.vehicle.now_ms >= lost_ms + 2980)
        bench.run(0)
        bench.receive(command_frame(DO_AUX_FUNCTION), channel=2)
        bench.run(delay_ms)
        bench.pilot_chooses(STABILIZE, BY_AUX)
        bench.run(300)
        assert bench.vehicle.mode == RTL
        assert bench.enforcement == RETURNING
        assert "HNDO: lease lost, pilot flies" not in bench.texts

    def test_an_order_that_the_guard_did_itself_makes_no_pilot(self, bench: Bench) -> None:
        """For the commander, with authority back."""
        going_home(bench)
        bench.sending = True
        bench.run(2000)
        bench.receive(command_frame(DO_AUX_FUNCTION, values=(56.0, 2.0)))
        bench.run(20)
        bench.pilot_chooses(LOITER, BY_AUX)
        bench.run(5000)
        assert bench.vehicle.aux_functions == [(56, 2)]
        bench.lose_lease()
        bench.run(4000)
        assert bench.vehicle.mode == RTL

    def test_a_stations_mode_is_not_the_pilots_for_that(self, bench: Bench) -> None:
        going_home(bench)
        bench.run(1500)
        bench.vehicle.mode, bench.vehicle.reason = LOITER, BY_GCS
        bench.run(200)
        assert (bench.vehicle.mode, bench.texts) == (RTL, ["HNDO: lease lost, command undone"])

    def test_nor_is_one_that_comes_while_the_pilots_switch_is_judged(self, bench: Bench) -> None:
        """And cannot be undone."""
        going_home(bench)
        bench.vehicle.refused_modes = {RTL}
        bench.run(1500)
        bench.until(lambda: bench.scripting.next_run_ms() == bench.vehicle.now_ms + 50)
        fill(bench, 20)
        bench.pilot_chooses(STABILIZE)
        bench.run(50)
        bench.vehicle.mode, bench.vehicle.reason = LOITER, BY_GCS
        bench.run(200)
        assert (bench.enforcement, bench.texts) == (ORDERING, ["HNDO: lease lost, RTL refused"])


class TestLanding:
    """A landing takes nothing home: it is a pilot's, the companion's or a failsafe's, or undone."""

    @pytest.mark.parametrize("reason", [BY_AUX, BY_RC])
    def test_by_a_stations_function_is_undone(self, unblocked: Bench, reason: int) -> None:
        going_home(unblocked)
        unblocked.receive(command_frame(DO_AUX_FUNCTION, values=(18.0, 2.0)), channel=2)
        unblocked.pilot_chooses(LAND, reason)
        unblocked.run(200)
        assert unblocked.vehicle.mode == RTL
        assert unblocked.texts[-1] == "HNDO: lease lost, DO_AUX of 66/190 undone"

    def test_of_auto_by_a_stations_function_is_undone(self, unblocked: Bench) -> None:
        going_home(unblocked)
        unblocked.receive(command_frame(DO_AUX_FUNCTION, values=(16.0, 2.0)), channel=2)
        unblocked.vehicle.landing = True
        unblocked.pilot_chooses(AUTO, BY_AUX)
        unblocked.run(200)
        assert unblocked.vehicle.mode == RTL

    def test_by_a_switch_is_the_pilots(self, bench: Bench) -> None:
        going_home(bench).pilot_chooses(LAND)
        bench.run(5000)
        assert (bench.enforcement, bench.vehicle.mode_requests) == (LANDING, [])

    def test_by_a_switch_without_a_radio_is_undone(self, bench: Bench) -> None:
        going_home(bench).pilot_chooses(LAND)
        bench.vehicle.rc = False
        bench.run(200)
        assert bench.vehicle.mode == RTL

    def test_is_not_taken_for_one_before_the_queue_is_read(self, unblocked: Bench) -> None:
        going_home(unblocked)
        unblocked.until(lambda: unblocked.scripting.next_run_ms() == unblocked.vehicle.now_ms + 50)
        for _ in range(20):
            unblocked.hear()
        unblocked.receive(command_frame(DO_AUX_FUNCTION, values=(18.0, 2.0)), channel=2)
        unblocked.pilot_chooses(LAND, BY_AUX)
        unblocked.run(50)
        assert unblocked.enforcement == RETURNING
        unblocked.run(50)
        assert unblocked.vehicle.mode == RTL

    def test_found_at_the_loss_is_left_whoever_chose_it(self, bench: Bench) -> None:
        bench.fly(AUTO)
        bench.receive(command_frame(DO_AUX_FUNCTION, values=(18.0, 2.0)))
        bench.pilot_chooses(LAND, BY_AUX)
        bench.run(2000)
        bench.lose_lease()
        bench.run(10_000)
        assert (bench.enforcement, bench.vehicle.mode_requests) == (LANDING, [])


class TestFullQueue:
    """It may have lost a DO_AUX_FUNCTION that the firmware does: nobody is believed then, and for a second."""

    @pytest.fixture
    def bench(self, unblocked: Bench) -> Bench:
        return unblocked

    def test_a_switch_in_a_flood_is_undone(self, bench: Bench) -> None:
        going_home(bench)
        for number in range(60):
            fill(bench)
            if number == 30:
                bench.pilot_chooses(STABILIZE)
            bench.run(10)
        assert bench.vehicle.mode == RTL
        assert bench.vehicle.mode_requests == [RTL]
        assert bench.texts == ["HNDO: lease lost, switch undone, rx flooded"]

    def test_a_command_that_a_full_queue_has_lost(self, bench: Bench) -> None:
        going_home(bench)
        fill(bench, 25)
        assert not bench.receive(command_frame(DO_AUX_FUNCTION), channel=2)
        bench.pilot_chooses(STABILIZE, BY_AUX)
        bench.run(300)
        assert bench.vehicle.mode == RTL

    @pytest.mark.parametrize("delay_ms", [300, 500, 700, 900])
    def test_it_may_act_up_to_a_second_later(self, bench: Bench, delay_ms: int) -> None:
        going_home(bench)
        fill(bench, 25)
        bench.run(delay_ms)
        bench.pilot_chooses(STABILIZE)
        bench.run(300)
        assert bench.vehicle.mode == RTL

    def test_the_command_is_found_behind_others(self, bench: Bench) -> None:
        going_home(bench)
        fill(bench, 20)
        bench.receive(command_frame(DO_AUX_FUNCTION), channel=2)
        bench.pilot_chooses(STABILIZE, BY_AUX)
        bench.run(300)
        assert bench.vehicle.mode == RTL
        assert bench.texts == ["HNDO: lease lost, DO_AUX of 66/190 undone"]

    def test_a_busy_queue_is_no_full_one(self, bench: Bench) -> None:
        going_home(bench)
        fill(bench, 20)
        bench.pilot_chooses(STABILIZE)
        bench.run(5000)
        assert bench.vehicle.mode_requests == []

    def test_a_second_after_the_flood_a_pilot_is_believed(self, bench: Bench) -> None:
        going_home(bench)
        for _ in range(20):
            fill(bench)
            bench.run(10)
        bench.run(1200)
        bench.pilot_chooses(STABILIZE)
        bench.run(5000)
        assert bench.vehicle.mode_requests == []

    def test_a_flood_of_long_ago_does_not_count_when_the_clock_has_gone_half_way_round(self, bench: Bench) -> None:
        bench.fly(AUTO)
        fill(bench)
        bench.run(15_000)
        bench.vehicle.now_ms += 0x90000000
        bench.with_lease()
        going_home(bench).pilot_chooses(STABILIZE)
        bench.run(5000)
        assert bench.vehicle.mode_requests == []

    def test_a_queue_that_cannot_be_read_makes_no_pilot(self, bench: Bench) -> None:
        going_home(bench)
        bench.scripting.load_text("mavlink.receive_chan = nil return", "breaker.lua")
        bench.run(50)
        bench.pilot_chooses(STABILIZE)
        bench.run(300)
        assert bench.vehicle.mode == RTL

    def test_without_an_entry_for_commands_nobody_is_believed(self) -> None:
        bench = Bench(earlier_script="mavlink:init(10, 1) mavlink:register_rx_msgid(33) return")
        bench.vehicle.rc = True
        going_home(bench).pilot_chooses(STABILIZE)
        bench.run(300)
        assert bench.vehicle.mode == RTL
        assert bench.texts[-1] == "HNDO: lease lost, switch undone, rx taken"


def test_a_station_that_orders_the_pilots_own_mode_takes_nothing_from_him(bench: Bench) -> None:
    bench.fly(LOITER, BY_RC)
    bench.lose_lease()
    bench.run(4000)
    bench.vehicle.reason = BY_GCS
    bench.run(5000)
    assert (bench.enforcement, bench.vehicle.mode_requests) == (PILOT, [])
