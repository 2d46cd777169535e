# SPDX-License-Identifier: GPL-3.0-or-later

"""Guard rules 5 to 8: GCS id, tampering, few words, and surviving whatever comes in."""

from __future__ import annotations

import struct

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.lua.stub import (
    AUTO,
    BY_GCS,
    GUARD,
    GUIDED,
    HELD,
    LOST,
    RECOVERING,
    RTL,
    TRANSFER,
    Bench,
    Companion,
    command_frame,
    stated,
)

COMMAND_LONG, COMMAND_INT, COMMAND_ACK, TUNNEL = 76, 75, 77, 385
MAV_CMD_SCRIPTING, MAV_RESULT_DENIED = 42701, 2
TAMPERED = 8


@pytest.fixture
def bench() -> Bench:
    return Bench()


class TestGcsIdFollowsTheCommander:
    """Rule 5."""

    def test_at_the_first_lease(self, bench: Bench) -> None:
        bench.with_lease()
        assert bench.vehicle.parameters["MAV_GCS_SYSID"] == 251.0

    def test_at_each_new_epoch_within_a_cycle(self, bench: Bench) -> None:
        bench.fly()
        bench.companion.commander, bench.companion.epoch = 252, 8
        bench.receive(bench.companion.lease())
        bench.run(100)
        assert bench.vehicle.parameters["MAV_GCS_SYSID"] == 252.0

    def test_in_memory_only(self, bench: Bench) -> None:
        bench.with_lease()
        assert bench.vehicle.saved == []

    def test_older_name(self) -> None:
        bench = Bench(parameters={"SYSID_MYGCS": 255.0})
        del bench.vehicle.parameters["MAV_GCS_SYSID"]
        bench.scripting.restart()
        bench.with_lease()
        assert bench.vehicle.parameters["SYSID_MYGCS"] == 251.0
        assert "MAV_GCS_SYSID" not in bench.vehicle.parameters

    @pytest.mark.parametrize("high", [1.0, 254.0])
    @pytest.mark.parametrize("low", [250.0, 251.0])
    def test_range_of_ids_is_closed(self, low: float, high: float) -> None:
        bench = Bench(parameters={"MAV_GCS_SYSID": low, "MAV_GCS_SYSID_HI": high}).with_lease()
        assert bench.vehicle.parameters["MAV_GCS_SYSID"] == 251.0
        assert bench.vehicle.parameters["MAV_GCS_SYSID_HI"] == 0.0

    def test_one_that_is_closed_already_has_not_been_changed(self) -> None:
        bench = Bench(parameters={"MAV_GCS_SYSID": 251.0, "MAV_GCS_SYSID_HI": 0.0}).with_lease()
        bench.run(3000)
        assert not bench.status.flags & TAMPERED
        assert not any("changed" in text for text in bench.texts)

    def test_set_again_when_somebody_changes_it(self, bench: Bench) -> None:
        bench.with_lease()
        bench.run(2000)
        bench.vehicle.parameters["MAV_GCS_SYSID"] = 99.0
        bench.run(1100)
        assert bench.vehicle.parameters["MAV_GCS_SYSID"] == 251.0
        assert "HNDO: MAV_GCS_SYSID was changed, set again" in bench.texts
        assert bench.status.flags & TAMPERED

    def test_one_that_was_right_from_the_start_is_watched_as_well(self) -> None:
        bench = Bench(parameters={"MAV_GCS_SYSID": 251.0}).with_lease()
        bench.run(2000)
        bench.vehicle.parameters["MAV_GCS_SYSID"] = 99.0
        bench.run(1100)
        assert "HNDO: MAV_GCS_SYSID was changed, set again" in bench.texts

    def test_firmware_with_neither_name_is_told_of(self) -> None:
        bench = Bench(without=["MAV_GCS_SYSID"]).with_lease()
        bench.run(20_000)
        assert bench.texts.count("HNDO: SYSID_MYGCS cannot be set") == 2

    def test_transfer_keeps_the_commander(self, bench: Bench) -> None:
        bench.companion.state = TRANSFER
        bench.with_lease()
        assert bench.vehicle.parameters["MAV_GCS_SYSID"] == 251.0
        assert not bench.status.flags & TAMPERED

    @pytest.mark.parametrize("state", [HELD, TRANSFER, LOST, RECOVERING])
    def test_nobody_is_never_written(self, bench: Bench, state: int) -> None:
        """A lease without a commander is never live, whatever state it claims."""
        bench.with_lease()
        bench.companion.state, bench.companion.commander, bench.companion.epoch = state, 0, 8
        bench.run(2000)
        assert bench.vehicle.parameters["MAV_GCS_SYSID"] == 251.0

    @pytest.mark.parametrize("parameter", ["HNDO_SYSID_SW", "HNDO_ENABLE"])
    def test_switched_off(self, parameter: str) -> None:
        bench = Bench(parameters={parameter: 0.0}).with_lease()
        assert bench.vehicle.parameters["MAV_GCS_SYSID"] == 255.0


class TestScriptingCommand:
    """Rule 6: MAV_CMD_SCRIPTING would stop the guard; the firmware does not answer a blocked command."""

    def test_is_blocked_from_the_first_run(self) -> None:
        assert Bench().scripting.command_blocked(MAV_CMD_SCRIPTING)

    @pytest.mark.parametrize("shape", ["long", "int", "long in MAVLink 1", "int in MAVLink 1"])
    def test_is_answered_denied_on_the_channel_it_came_from(self, bench: Bench, shape: str) -> None:
        frame = command_frame(MAV_CMD_SCRIPTING, as_int=shape.startswith("int"), force_mavlink1=shape.endswith("1"))
        bench.receive(frame, channel=3)
        bench.run(100)
        answers = [(chan, payload) for chan, msgid, payload in bench.vehicle.messages if msgid == COMMAND_ACK]
        assert answers == [(3, struct.pack("<HBBiBB", MAV_CMD_SCRIPTING, MAV_RESULT_DENIED, 0, 0, 66, 190))]
        assert "HNDO: scripting command of 66/190 denied" in bench.texts
        assert bench.status.flags & TAMPERED

    def test_corrupted_command_is_not_answered(self, bench: Bench) -> None:
        frame = bytearray(command_frame(MAV_CMD_SCRIPTING))
        frame[-1] ^= 0xFF
        bench.receive(bytes(frame))
        bench.run(100)
        assert all(msgid != COMMAND_ACK for _, msgid, _ in bench.vehicle.messages)

    def test_other_commands_are_left_to_the_autopilot(self, bench: Bench) -> None:
        bench.receive(command_frame(400))
        bench.receive(command_frame(42702))
        bench.run(1000)
        assert all(msgid == TUNNEL for _, msgid, _ in bench.vehicle.messages)
        assert not bench.status.flags & TAMPERED


class TestRegistrations:
    """Rule 6: the receive table is common to all scripts."""

    def test_wiped_registrations_are_set_again_within_a_second(self, bench: Bench) -> None:
        bench.fly()
        bench.scripting.load_text("mavlink:init(1, 1) return", "wiper.lua")
        bench.run(2500)
        assert bench.vehicle.mode == AUTO
        assert "HNDO: MAVLink rx was reset by a script" in bench.texts
        assert bench.status.flags & TAMPERED

    def test_arming_is_refused_for_ten_seconds(self, bench: Bench) -> None:
        bench.with_lease()
        bench.scripting.load_text("mavlink:init(1, 1) return", "wiper.lua")
        bench.run(1500)
        assert bench.refusal == "HNDO: another script tampers"
        bench.run(10_500)
        assert bench.may_arm

    def test_and_not_again_when_the_clock_has_gone_half_way_round(self, bench: Bench) -> None:
        """A ground time of 25 days: the instant of the tampering then seems to lie ahead."""
        bench.with_lease()
        bench.scripting.load_text("mavlink:init(1, 1) return", "wiper.lua")
        bench.run(12_000)
        assert bench.may_arm
        bench.vehicle.now_ms += 0x80000000
        bench.run(1000)
        assert bench.may_arm

    def test_no_free_entry_the_guard_takes_the_first_one_for_the_lease(self, bench: Bench) -> None:
        bench.fly()
        bench.scripting.load_text("mavlink:init(1, 1) mavlink:register_rx_msgid(33) return", "greedy.lua")
        bench.run(2500)
        assert bench.vehicle.mode == AUTO
        assert "HNDO: MAVLink rx taken by another script" in bench.texts

    def test_a_script_that_fights_on_keeps_the_vehicle_on_the_ground(self, bench: Bench) -> None:
        bench.with_lease()
        bench.scripting.load_text(
            "local function f() mavlink:init(1, 1) mavlink:register_rx_msgid(33) return f, 100 end return f, 0",
            "fighter.lua",
        )
        bench.run(60_000)
        assert not bench.may_arm

    @pytest.mark.parametrize("firmware", [(4, 5, 7), (4, 6, 3), (4, 7, 0), (4, 7, 1)])
    @pytest.mark.parametrize("ids", [1, 2, 3, 4, 25])
    def test_table_of_an_earlier_script_is_never_overrun(self, ids: int, firmware: tuple[int, int, int]) -> None:
        """The bindings raise past every pcall when a script writes behind the table. One that is too small for commands
        keeps the vehicle on the ground: whether a pilot or a DO_AUX_FUNCTION chose a mode could not be told."""
        bench = Bench(earlier_script=f"mavlink:init(10, {ids}) mavlink:register_rx_msgid(33) return", firmware=firmware)
        bench.with_lease()
        bench.run(12_000)
        assert bench.refusal == (None if ids >= 4 else "HNDO: MAVLink rx taken by a script")
        assert bench.vehicle.removed == []
        assert not any("fault" in text for text in bench.texts)

    @pytest.mark.parametrize("firmware", [(4, 6, 3), (4, 7, 0)])
    def test_the_guards_own_table_is_taken_back_whole(self, firmware: tuple[int, int, int]) -> None:
        bench = Bench(firmware=firmware).with_lease()
        bench.scripting.load_text("mavlink:init(1, 1) mavlink:register_rx_msgid(33) return", "greedy.lua")
        bench.run(12_000)
        assert bench.may_arm
        bench.receive(command_frame(MAV_CMD_SCRIPTING))
        bench.run(100)
        assert "HNDO: scripting command of 66/190 denied" in bench.texts

    def test_a_table_that_is_taken_back_brings_leases_at_once(self, bench: Bench) -> None:
        bench.with_lease()
        bench.scripting.load_text("mavlink:init(1, 1) mavlink:register_rx_msgid(33) return", "greedy.lua")
        bench.until(lambda: "HNDO: MAVLink rx taken by another script" in bench.texts)
        bench.run(900)
        assert bench.companion.sequence - bench.status.sequence <= 3

    @pytest.mark.parametrize("firmware", [(4, 5, 7), (4, 7, 1)])
    def test_where_a_second_init_changes_nothing_the_guard_keeps_its_entries(
        self, firmware: tuple[int, int, int]
    ) -> None:
        bench = Bench(firmware=firmware).with_lease()
        bench.scripting.load_text("mavlink:init(1, 1) return", "wiper.lua")
        bench.run(3000)
        assert bench.may_arm
        assert not bench.status.flags & TAMPERED

    def test_a_queue_that_was_in_use_is_told(self) -> None:
        assert "HNDO: MAVLink rx was in use before" not in Bench().texts
        bench = Bench(earlier_script="mavlink:init(10, 25) return")
        assert "HNDO: MAVLink rx was in use before" in bench.texts

    def test_restarted_scripting_finds_its_registrations(self, bench: Bench) -> None:
        bench.with_lease()
        bench.scripting.restart()
        bench.run(500)
        assert bench.may_arm
        assert bench.scripting.command_blocked(MAV_CMD_SCRIPTING)
        assert not bench.status.flags & TAMPERED


class TestFewWords:
    """Rule 7."""

    def test_texts_fit_one_message(self, bench: Bench) -> None:
        bench.vehicle.refused_modes = {RTL, 9}
        bench.receive(bench.companion.lease(), channel=15)
        bench.fly()
        bench.receive(command_frame(MAV_CMD_SCRIPTING))
        bench.lose_lease()
        bench.run(20_000)
        assert bench.texts
        assert all(len(text) <= 50 and text.startswith("HNDO: ") for text in bench.texts)

    def test_a_flood_of_strange_leases_is_said_once_in_ten_seconds(self, bench: Bench) -> None:
        for _ in range(200):
            bench.receive(bench.companion.lease(), channel=2)
            bench.run(50)
        assert [text for text in bench.texts if "refused" in text] == ["HNDO: lease refused, channel 2 not 1"]
        assert bench.status.rejected > 190

    def test_frames_of_one_moment_are_one_text(self, bench: Bench) -> None:
        for _ in range(5):
            bench.receive(bench.companion.lease(), channel=2)
        bench.run(60)
        assert [text for text in bench.texts if "refused" in text] == ["HNDO: lease refused, channel 2 not 1"]

    @pytest.mark.parametrize("boot_ms", [0x7FFFFFFF - 2000, 0xFFFFFFFF - 2000])
    def test_the_gap_lasts_over_the_edges_of_the_clock(self, boot_ms: int) -> None:
        bench = Bench(boot_ms=boot_ms)
        for _ in range(80):
            bench.receive(bench.companion.lease(), channel=2)
            bench.run(100)
        assert len([text for text in bench.texts if "refused" in text]) == 1

    @pytest.mark.parametrize("days", [1, 25, 40, 49])
    def test_what_was_said_weeks_ago_is_said_again(self, bench: Bench, days: int) -> None:
        """The autopilot's milliseconds have 32 bits: after 24.8 days a difference has its sign bit set."""
        for _ in range(2):
            bench.receive(command_frame(MAV_CMD_SCRIPTING))
            bench.run(1500)
        assert bench.texts.count("HNDO: scripting command of 66/190 denied") == 1
        bench.vehicle.now_ms += days * 86_400_000
        bench.receive(command_frame(MAV_CMD_SCRIPTING))
        bench.run(500)
        assert bench.texts.count("HNDO: scripting command of 66/190 denied") == 2

    def test_normal_flight_is_silent(self, bench: Bench) -> None:
        bench.fly()
        bench.run(60_000)
        assert bench.texts == []

    def test_commander_is_named_at_each_change(self, bench: Bench) -> None:
        bench.fly()
        bench.companion.commander, bench.companion.epoch = 252, 8
        bench.run(1000)
        assert bench.texts == ["HNDO: lease live, 252 commands"]

    def test_dataflash_record_once_a_second(self, bench: Bench) -> None:
        bench.fly()
        bench.vehicle.records.clear()
        bench.run(40_000)
        assert len(bench.vehicle.records) == 40
        name, record = bench.vehicle.records[-1]
        assert name == "HNDO"
        assert {key: record[key] for key in ("St", "Ac", "Fl", "Cmd", "LSt", "Ep", "Rej")} == {
            "St": 2,
            "Ac": 0,
            "Fl": 6,
            "Cmd": 251,
            "LSt": HELD,
            "Ep": 7,
            "Rej": 0,
        }

    def test_dataflash_record_before_any_lease_has_no_age(self, bench: Bench) -> None:
        bench.run(2500)
        _, record = bench.vehicle.records[-1]
        assert (record["St"], record["Age"]) == (1, 0)

    def test_dataflash_record_at_once_where_nobody_is_to_be_told(self) -> None:
        bench = Bench(heard=False)
        bench.until(lambda: len(bench.vehicle.records) == 3)
        bench.vehicle.armed = True
        bench.vehicle.records.clear()
        bench.run(60)
        assert [record["Fl"] for _, record in bench.vehicle.records] == [2]

    @pytest.mark.parametrize("absent", ["logger", "logger.write"])
    def test_firmware_without_a_logger_has_no_fault(self, absent: str) -> None:
        bench = Bench(absent=[absent]).with_lease()
        bench.run(3000)
        assert bench.vehicle.records == []
        assert not any("fault" in text for text in bench.texts)

    def test_dataflash_record_at_once_on_change(self, bench: Bench) -> None:
        bench.fly()
        bench.vehicle.records.clear()
        bench.lose_lease()
        acted_ms = bench.until(lambda: bench.vehicle.mode == RTL)
        bench.run(20)
        assert [record["Ac"] for _, record in bench.vehicle.records][-1] == 1
        assert bench.vehicle.now_ms - acted_ms <= 100


class TestStatus:
    def test_twice_a_second(self, bench: Bench) -> None:
        bench.fly()
        bench.vehicle.messages.clear()
        bench.run(10_000)
        assert 19 <= len(bench.statuses()) <= 21

    def test_at_once_on_change(self, bench: Bench) -> None:
        bench.with_lease()
        bench.run(5000)
        bench.vehicle.armed = True
        bench.vehicle.messages.clear()
        bench.run(60)
        assert bench.status.flags == 2

    def test_sent_without_any_lease_where_something_was_heard(self, bench: Bench) -> None:
        bench.run(1100)
        assert bench.status.state == 1
        assert (bench.status.nonce, bench.status.sequence, bench.status.epoch) == (0, 0, 0)

    def test_disabled(self) -> None:
        bench = Bench(parameters={"HNDO_ENABLE": 0.0})
        bench.run(600)
        assert bench.status.state == 0

    def test_at_once_with_a_new_epoch(self, bench: Bench) -> None:
        bench.with_lease()
        bench.run(5000)
        bench.vehicle.messages.clear()
        bench.receive(bench.companion.lease(epoch=8))
        bench.run(60)
        assert bench.status.epoch == 8

    def test_change_that_a_full_link_keeps_back_is_not_logged_again_and_again(self, bench: Bench) -> None:
        bench.with_lease()
        bench.run(5000)
        bench.vehicle.link_open = False
        bench.vehicle.armed = True
        bench.vehicle.records.clear()
        bench.run(3000)
        assert len(bench.vehicle.records) <= 4

    def test_full_link_is_tried_again_in_the_next_cycle(self, bench: Bench) -> None:
        bench.with_lease()
        bench.run(5000)
        bench.vehicle.link_open = False
        bench.run(3000)
        bench.vehicle.messages.clear()
        bench.vehicle.link_open = True
        bench.run(60)
        assert len(bench.statuses()) == 1

    def test_refused_count_wraps_at_16_bits(self) -> None:
        bench = Bench()
        strange = bench.companion.lease()
        delivered = 0
        while delivered <= 65_536:
            for _ in range(12):
                delivered += bench.receive(strange, channel=2)
            bench.run(10)
        bench.run(600)
        assert bench.status.rejected == delivered - 65_536

    @pytest.mark.parametrize("changes", [{"nonce": 0}, {"version": 1}, {"guard_nonce": 5}])
    def test_it_wraps_for_each_kind_of_refusal(self, changes: dict[str, int]) -> None:
        """The shipped script, with 65,535 leases refused before."""
        text = GUARD.read_text(encoding="utf-8").replace("local refused = {count=0,", "local refused = {count=65535,")
        bench = Bench(heard=False)
        bench.load_instead(text)
        bench.run(100)
        bench.ask()
        assert bench.status.rejected == 65_535
        bench.receive(bench.companion.lease(**changes))
        bench.run(600)
        assert bench.status.rejected == 0


class TestSurvival:
    """Rule 8."""

    def test_enforcement_goes_on_when_receiving_fails(self) -> None:
        bench = Bench(absent=["mavlink.receive_chan"])
        bench.vehicle.armed = bench.vehicle.flying = True
        bench.vehicle.mode, bench.vehicle.reason = AUTO, BY_GCS
        bench.run(3500)
        assert bench.vehicle.mode == RTL
        assert bench.vehicle.removed == []

    @pytest.mark.parametrize("name", ["mavlink.send_chan", "param.set", "arming.set_aux_auth_failed", "gcs.last_seen"])
    def test_enforcement_goes_on_when_housekeeping_fails(self, name: str) -> None:
        bench = Bench(absent=[name])
        bench.fly()
        bench.lose_lease()
        bench.run(3500)
        assert bench.vehicle.mode == RTL
        assert bench.vehicle.removed == []

    def test_fault_is_told_and_not_repeated(self) -> None:
        bench = Bench(absent=["arming.set_aux_auth_failed"])
        bench.run(25_000)
        assert len([text for text in bench.texts if "fault" in text]) == 3

    def test_stalled_script_hears_the_waiting_leases_first(self, bench: Bench) -> None:
        bench.fly()
        for _ in range(20):
            bench.vehicle.now_ms += 200
            bench.receive(bench.companion.lease())
        bench.run(200)
        assert bench.vehicle.mode == AUTO
        assert bench.vehicle.mode_requests == []

    @pytest.mark.parametrize("slept_ms", [560, 900])
    def test_half_a_second_is_a_stall(self, bench: Bench, slept_ms: int) -> None:
        """Here longer than the lease lives."""
        bench.companion.ttl_ms = 500
        bench.fly()
        for _ in range(8):
            for _ in range(slept_ms // 100):
                bench.vehicle.now_ms += 100
                bench.receive(bench.companion.lease())
            bench.run(200)
        assert bench.vehicle.mode_requests == []

    def test_stalled_script_with_nothing_but_stale_leases_acts_soon(self, bench: Bench) -> None:
        bench.fly()
        bench.lose_lease()
        for _ in range(25):
            bench.receive(bench.companion.lease())
        bench.vehicle.now_ms += 5000
        bench.run(100)
        assert bench.vehicle.mode == RTL

    def test_stalled_script_acts_soon_though_a_flood_never_ends(self, bench: Bench) -> None:
        bench.fly()
        bench.lose_lease()
        bench.vehicle.now_ms += 5000
        for _ in range(30):
            for _ in range(25):
                bench.hear()
            bench.run(10)
        assert bench.vehicle.mode == RTL

    def test_a_script_that_is_always_late_enforces_all_the_same(self, bench: Bench) -> None:
        """The fault: each call came as late as after a stall, so each only read, as long as the queue held something:
        the guard never acted on leases that say that no station has authority."""
        bench.fly()
        bench.companion.state, bench.companion.commander = LOST, 0
        for _ in range(20):
            for _ in range(3):
                bench.vehicle.now_ms += 200
                bench.receive(bench.companion.lease())
            bench.scripting.run_due(bench.vehicle.now_ms)
        assert bench.vehicle.mode == RTL

    def test_stalled_script_without_leases_acts_at_once(self, bench: Bench) -> None:
        bench.fly()
        bench.lose_lease()
        bench.vehicle.now_ms += 5000
        bench.run(0)
        assert bench.vehicle.mode == RTL

    @pytest.mark.parametrize(
        "frame",
        [
            command_frame(MAV_CMD_SCRIPTING),
            command_frame(218),
            command_frame(400),
            Companion().lease(),
            Companion().tunnel(b"\1" * 60, kind=200),
        ],
        ids=["scripting command", "DO_AUX_FUNCTION", "another command", "lease of another channel", "another TUNNEL"],
    )
    def test_a_flood_does_not_drown_the_leases(self, bench: Bench, frame: bytes) -> None:
        """A thousand a second: few of them may cost a CRC."""
        bench.fly()
        for _ in range(1000):
            for _ in range(10):
                bench.receive(frame, channel=2)
            bench.run(10)
        assert bench.vehicle.mode == AUTO
        assert bench.vehicle.mode_requests == []

    def test_a_flood_of_commands_is_answered_ten_times_a_second(self, bench: Bench) -> None:
        for _ in range(100):
            bench.receive(command_frame(MAV_CMD_SCRIPTING), channel=2)
            bench.run(10)
        assert 10 <= len([chan for chan, msgid, _ in bench.vehicle.messages if msgid == COMMAND_ACK]) <= 20

    def test_the_eleventh_within_a_second_is_not_answered(self, bench: Bench) -> None:
        seen = len(bench.vehicle.records)
        bench.until(lambda: len(bench.vehicle.records) > seen)  # the second begins
        for _ in range(20):
            bench.receive(command_frame(MAV_CMD_SCRIPTING), channel=2)
            bench.run(20)
        assert len([chan for chan, msgid, _ in bench.vehicle.messages if msgid == COMMAND_ACK]) == 10
        bench.run(1000)
        bench.receive(command_frame(MAV_CMD_SCRIPTING), channel=2)
        bench.run(100)
        assert len([chan for chan, msgid, _ in bench.vehicle.messages if msgid == COMMAND_ACK]) == 11

    def test_a_few_in_a_row_are_answered_each(self, bench: Bench) -> None:
        for _ in range(5):
            bench.receive(command_frame(MAV_CMD_SCRIPTING), channel=2)
        bench.run(100)
        assert len([chan for chan, msgid, _ in bench.vehicle.messages if msgid == COMMAND_ACK]) == 5

    def test_a_full_queue_of_forged_leases_does_not_drown_the_real_one(self, bench: Bench) -> None:
        bench.fly()
        forger = Companion(nonce=666)
        for _ in range(100):
            for _ in range(3):
                bench.receive(forger.lease())
            bench.run(50)
        assert bench.vehicle.mode == AUTO
        assert bench.status.nonce == 0xC0FFEE01

    @settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
    @given(
        payload=st.binary(min_size=0, max_size=128),
        kind=st.sampled_from([47116, 47117, 0]),
        length=st.integers(0, 255),
        flip=st.one_of(st.none(), st.integers(0, 200)),
    )
    def test_no_frame_stops_the_guard(
        self, bench: Bench, payload: bytes, kind: int, length: int, flip: int | None
    ) -> None:
        frame = bytearray(Companion().tunnel(payload, kind=kind, length=length))
        if flip is not None:
            frame[10 + flip % (len(frame) - 10)] ^= 0x55
        bench.receive(bytes(frame))
        bench.run(60)
        assert bench.vehicle.removed == []
        assert not any("fault" in text for text in bench.texts)

    @settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
    @given(fields=st.tuples(*[st.integers(0, 255)] * 4, *[st.integers(0, 2**32 - 1)] * 3, *[st.integers(0, 65535)] * 2))
    def test_no_well_formed_lease_stops_the_guard(self, bench: Bench, fields: tuple[int, ...]) -> None:
        frame = bench.companion.tunnel(
            struct.pack("<BBBBIIIHHI", 2, 1 + fields[1] % 4, *fields[2:], bench.companion.guard_nonce)
        )
        bench.receive(frame)
        bench.run(60)
        assert bench.vehicle.removed == []
        assert not any("fault" in text for text in bench.texts)


class TestInstructionBudget:
    """10 000 VM instructions a call end the script for good, pcall or not."""

    LIMIT = 4000

    @pytest.fixture
    def bench(self) -> Bench:
        return Bench(count_instructions=True)

    def fill(self, bench: Bench) -> None:
        for number in range(30):
            if number % 2:
                bench.receive(command_frame(MAV_CMD_SCRIPTING, as_int=True), channel=number % 4)
            else:
                bench.receive(bench.companion.lease(ttl_ms=0x7FFF))

    def test_full_queue_of_the_dearest_frames(self, bench: Bench) -> None:
        bench.fly()
        for _ in range(50):
            self.fill(bench)
            bench.run(100)
        assert 2000 < bench.most_instructions < self.LIMIT
        assert bench.most_instructions <= stated("VM instructions in one call, at the worst")[0]
        assert bench.vehicle.removed == []

    def test_full_queue_of_frames_refused_early(self, bench: Bench) -> None:
        for _ in range(50):
            for _ in range(25):
                bench.receive(bench.companion.lease(), channel=2)
            bench.run(50)
        assert bench.most_instructions < 2100

    def test_full_queue_after_a_stall_at_the_moment_of_the_loss(self, bench: Bench) -> None:
        bench.fly()
        bench.lose_lease()
        bench.vehicle.now_ms += 10_000
        self.fill(bench)
        bench.companion.state, bench.companion.commander, bench.companion.epoch = LOST, 0, 9
        bench.vehicle.mode = GUIDED
        bench.run(5000)
        assert bench.most_instructions < self.LIMIT

    def test_many_restarts_of_the_companion(self, bench: Bench) -> None:
        bench.fly()
        for number in range(20):
            bench.companion.nonce += 1
            bench.companion.epoch += 1
            bench.companion.commander = 1 + number
            self.fill(bench)
            bench.run(100)
        bench.companion.state = RECOVERING
        assert bench.most_instructions < self.LIMIT
