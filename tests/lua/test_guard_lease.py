# SPDX-License-Identifier: GPL-3.0-or-later

"""Guard rule 1: a lease counts only if CRC, length, channel, sysid, component, version, nonce and sequence fit."""

from __future__ import annotations

import struct

import pytest

from tests.lua.stub import HELD, LEASE_LAYOUT, RECOVERING, TRANSFER, Bench
from tests.lua.stub import LOST as NOBODY

WAITING, LIVE, EXPIRED, LOST = 1, 2, 3, 4


@pytest.fixture
def bench() -> Bench:
    return Bench()


def refused(bench: Bench, frame: bytes, channel: int = 1) -> bool:
    """Whether the guard counts the frame as refused and takes nothing from it."""
    bench.run(600)
    before = bench.status
    assert bench.receive(frame, channel)
    bench.run(600)
    after = bench.status
    taken = (after.nonce, after.sequence, after.epoch) != (before.nonce, before.sequence, before.epoch)
    return not taken and after.rejected == before.rejected + 1


def test_good_lease_is_accepted_and_answered(bench: Bench) -> None:
    bench.receive(bench.companion.lease())
    bench.run(600)
    status = bench.status
    assert (status.version, status.state, status.nonce, status.sequence, status.epoch) == (2, LIVE, 0xC0FFEE01, 1, 7)
    assert (status.rejected, status.fw_major, status.fw_minor) == (0, 4, 7)


def test_corrupted_known_message_reaches_the_script_and_is_refused(bench: Bench) -> None:
    frame = bytearray(bench.companion.lease())
    frame[10 + 5 + 2] = 252  # another commander, old CRC
    assert refused(bench, bytes(frame))


@pytest.mark.parametrize("position", [-1, -2])
def test_wrong_crc_byte_is_refused(bench: Bench, position: int) -> None:
    frame = bytearray(bench.companion.lease())
    frame[position] ^= 0x01
    assert refused(bench, bytes(frame))


def test_other_channel_is_refused_and_named(bench: Bench) -> None:
    assert refused(bench, bench.companion.lease(), channel=2)
    assert "HNDO: lease refused, channel 2 not 1" in bench.texts
    assert bench.refusal == "HNDO: lease refused, channel 2 not 1"


def test_channel_0_is_a_channel_like_any(bench: Bench) -> None:
    bench.vehicle.parameters["HNDO_CHAN"] = 0.0
    bench.run(100)
    bench.receive(bench.companion.lease(), channel=1)
    bench.run(600)
    assert bench.refusal == "HNDO: lease refused, channel 1 not 0"
    bench.receive(bench.companion.lease(), channel=0)
    bench.run(600)
    assert bench.statuses(channel=0)[-1].state == LIVE


def test_a_strange_lease_between_good_ones_is_said(bench: Bench) -> None:
    bench.with_lease()
    bench.receive(bench.companion.lease(), channel=2)
    bench.run(600)
    assert bench.texts[-1] == "HNDO: strange lease refused, channel 2 not 1"
    assert bench.may_arm


def test_another_system_id_is_refused(bench: Bench) -> None:
    bench.companion.system = 251
    assert refused(bench, bench.companion.lease())


def test_another_component_is_refused(bench: Bench) -> None:
    bench.companion.component = 190
    assert refused(bench, bench.companion.lease())


def test_the_companions_component_is_a_parameter(bench: Bench) -> None:
    bench.vehicle.parameters["HNDO_COMPID"] = 190.0
    bench.run(100)
    bench.receive(bench.companion.lease())
    bench.run(100)
    assert bench.refusal == "HNDO: lease refused, component 191"
    bench.companion.component = 190
    bench.receive(bench.companion.lease())
    bench.run(600)
    assert bench.may_arm
    assert bench.vehicle.messages[-1][2][3] == 190  # the status goes there, too


def test_a_refusal_of_long_ago_is_not_why_arming_is_refused_now(bench: Bench) -> None:
    bench.receive(bench.companion.lease(), channel=2)
    bench.run(100)
    bench.with_lease()
    bench.sending = False
    bench.run(5000)
    assert bench.refusal == "HNDO: lease lost"


def test_lease_for_another_system_is_not_delivered(bench: Bench) -> None:
    assert not bench.receive(bench.companion.lease(target_system=2))


def test_broadcast_lease_is_refused(bench: Bench) -> None:
    assert refused(bench, bench.companion.lease(target_system=0))
    assert refused(bench, bench.companion.lease(target_component=0))


@pytest.mark.parametrize(
    ("version", "text"),
    [
        (0, "HNDO: companion is older, update it"),
        (1, "HNDO: companion is older, update it"),
        (3, "HNDO: guard is older, update it"),
        (255, "HNDO: guard is older, update it"),
    ],
)
def test_another_layout_version_is_refused_and_says_which_side_is_older(bench: Bench, version: int, text: str) -> None:
    assert refused(bench, bench.companion.lease(version=version))
    assert bench.texts[-1] == text
    assert bench.refusal == text


def test_the_lease_of_the_release_before_says_that_the_companion_is_older(bench: Bench) -> None:
    assert refused(bench, bench.companion.tunnel(struct.pack("<BBBBIIIHH", 1, HELD, 251, 0, 5, 1, 7, 5000, 0)))
    assert bench.refusal == "HNDO: companion is older, update it"


@pytest.mark.parametrize("state", [0, 6, 255])
def test_unknown_state_is_refused(bench: Bench, state: int) -> None:
    assert refused(bench, bench.companion.lease(state=state))


def test_stated_length_must_be_that_of_a_lease(bench: Bench) -> None:
    assert refused(bench, bench.companion.lease(length=23))
    assert refused(bench, bench.companion.lease(length=25))


def test_a_lease_without_content_is_refused(bench: Bench) -> None:
    assert refused(bench, bench.companion.tunnel(b"", length=24))


@pytest.mark.parametrize("count", range(1, 9))
def test_a_lease_that_ends_early_is_no_fault(bench: Bench, count: int) -> None:
    assert bench.receive(bench.companion.tunnel(bytes([2, HELD, 251, 1, 5, 5, 5, 5])[:count], length=24))
    bench.run(200)
    assert bench.refusal != "HNDO: guard fault, see messages"
    assert not any("fault" in text for text in bench.texts)


def test_bytes_behind_the_lease_are_refused(bench: Bench) -> None:
    payload = struct.pack(LEASE_LAYOUT, 2, HELD, 251, 0, 5, 1, 7, 5000, 0, bench.companion.guard_nonce) + b"\x01"
    assert refused(bench, bench.companion.tunnel(payload, length=24))


def test_nonce_zero_is_refused(bench: Bench) -> None:
    assert refused(bench, bench.companion.lease(nonce=0))


def test_signed_frame_is_read_like_any_other(bench: Bench) -> None:
    bench.companion.packer.signing.secret_key = bytes(32)
    bench.companion.packer.signing.sign_outgoing = True
    frame = bench.companion.lease()
    assert frame[2] == 0x01
    assert bench.receive(frame)
    bench.run(600)
    assert bench.status.state == LIVE


def test_other_tunnel_payloads_are_none_of_the_guards_business(bench: Bench) -> None:
    bench.receive(bench.companion.tunnel(b"\x01" * 128, kind=47117))
    bench.receive(bench.companion.tunnel(b"", kind=0, length=0))
    bench.run(600)
    assert (bench.status.state, bench.status.rejected) == (WAITING, 0)


def test_trailing_zeros_that_were_not_sent_count_as_zeros(bench: Bench) -> None:
    bench.companion.sequence = 0x01000000 - 1
    short = bench.companion.lease(epoch=0, ttl_ms=0, guard_nonce=0)
    assert short[1] < 25
    assert bench.receive(short)
    bench.run(50)
    assert (bench.status.state, bench.status.rejected) == (WAITING, 0)  # it was read, and asks for the nonce
    assert bench.texts[1:] == []


class TestSequence:
    def test_repeated_sequence_is_refused(self, bench: Bench) -> None:
        bench.receive(bench.companion.lease())
        assert refused(bench, bench.companion.frame())

    def test_replayed_older_lease_is_refused(self, bench: Bench) -> None:
        old = bench.companion.lease()
        bench.receive(old)
        bench.receive(bench.companion.lease())
        assert refused(bench, old)

    def test_replay_does_not_keep_a_dead_lease_alive(self, bench: Bench) -> None:
        frame = bench.companion.lease()
        for _ in range(40):
            bench.receive(frame)
            bench.run(100)
        assert bench.status.state == EXPIRED
        assert not bench.may_arm

    def test_sequence_wraps_to_zero(self, bench: Bench) -> None:
        bench.companion.sequence = 0xFFFFFFFD
        for expected in (0xFFFFFFFE, 0xFFFFFFFF, 0, 1):
            bench.receive(bench.companion.lease())
            bench.run(600)
            assert bench.status.sequence == expected
        assert bench.status.rejected == 0

    def test_gaps_are_allowed(self, bench: Bench) -> None:
        bench.receive(bench.companion.lease())
        bench.companion.sequence += 1000
        bench.receive(bench.companion.lease())
        bench.run(600)
        assert bench.status.sequence == 1002

    def test_half_the_range_ahead_counts_as_behind(self, bench: Bench) -> None:
        bench.receive(bench.companion.lease())
        bench.companion.sequence = 0x80000001
        assert refused(bench, bench.companion.frame())

    def test_the_largest_step_ahead_is_one_less(self, bench: Bench) -> None:
        bench.receive(bench.companion.lease())
        bench.companion.sequence = 0x80000000
        bench.receive(bench.companion.frame())
        bench.run(600)
        assert (bench.status.sequence, bench.status.rejected) == (0x80000000, 0)

    def test_epoch_does_not_go_back_within_a_nonce(self, bench: Bench) -> None:
        bench.receive(bench.companion.lease())
        assert refused(bench, bench.companion.lease(epoch=6))
        bench.receive(bench.companion.lease(epoch=8))
        bench.run(600)
        assert bench.status.epoch == 8


class TestNonce:
    """A new nonce is a companion that restarted, or somebody who pretends so."""

    def test_newer_epoch_is_accepted_at_once(self, bench: Bench) -> None:
        bench.fly()
        bench.receive(bench.companion.lease(nonce=5, sequence=1, epoch=8))
        bench.run(50)
        assert (bench.status.nonce, bench.status.sequence, bench.status.epoch) == (5, 1, 8)

    def test_same_epoch_waits_until_the_old_one_is_dead(self, bench: Bench) -> None:
        bench.fly()
        assert refused(bench, bench.companion.lease(nonce=5, epoch=7)) is False  # the old one goes on
        assert bench.status.nonce == 0xC0FFEE01
        assert bench.status.rejected == 1
        bench.lose_lease()
        bench.run(3500)
        bench.receive(bench.companion.lease(nonce=5, epoch=7))
        bench.run(600)
        assert (bench.status.nonce, bench.status.state) == (5, LIVE)

    def test_older_epoch_is_refused_in_flight_even_after_silence(self, bench: Bench) -> None:
        bench.fly()
        bench.lose_lease()
        bench.run(10_000)
        assert refused(bench, bench.companion.lease(nonce=5, epoch=6))
        assert bench.status.state == EXPIRED

    def test_older_epoch_is_accepted_on_the_ground_after_silence(self, bench: Bench) -> None:
        bench.with_lease()
        bench.sending = False
        assert refused(bench, bench.companion.lease(nonce=5, epoch=1))
        bench.run(3500)
        bench.receive(bench.companion.lease(nonce=5, epoch=1))
        bench.run(600)
        assert (bench.status.nonce, bench.status.epoch, bench.status.state) == (5, 1, LIVE)

    def test_replaced_nonce_never_comes_back(self, bench: Bench) -> None:
        bench.with_lease()
        bench.sending = False
        recorded = bench.companion.frame(nonce=0xC0FFEE01, sequence=500, epoch=9)
        bench.receive(bench.companion.lease(nonce=5, epoch=8))
        bench.run(10_000)
        assert refused(bench, recorded)

    def test_the_last_eight_are_remembered_and_no_more(self, bench: Bench) -> None:
        """The memory is bounded; what is older has an epoch that keeps it out."""
        for number in range(10):
            bench.receive(bench.companion.lease(nonce=100 + number, epoch=20 + number))
            bench.run(100)
        bench.vehicle.armed = bench.vehicle.flying = True
        for nonce, why in ((100, "nonce"), (101, "old nonce"), (108, "old nonce")):
            bench.run(11_000)  # said once in ten seconds
            assert refused(bench, bench.companion.lease(nonce=nonce, epoch=20))
            assert bench.texts[-1] == f"HNDO: lease refused, {why}"

    def test_epoch_is_compared_modulo_two_to_the_32(self, bench: Bench) -> None:
        bench.receive(bench.companion.lease(epoch=0xFFFFFFFF))
        bench.run(100)
        bench.receive(bench.companion.lease(nonce=5, epoch=0))
        bench.run(600)
        assert (bench.status.nonce, bench.status.epoch) == (5, 0)

    def test_the_first_one_counts_in_flight_whatever_its_epoch(self, bench: Bench) -> None:
        bench.vehicle.armed = bench.vehicle.flying = True
        bench.receive(bench.companion.lease(epoch=0x80000001))
        bench.run(600)
        assert (bench.status.state, bench.status.epoch, bench.status.rejected) == (LIVE, 0x80000001, 0)

    def test_large_nonces_survive_the_round_trip(self, bench: Bench) -> None:
        bench.companion.nonce = 0xFFFFFFFF
        bench.with_lease()
        bench.run(600)
        assert bench.status.nonce == 0xFFFFFFFF
        assert bench.status.rejected == 0


class TestLife:
    """A lease dies min(HNDO_TIMEOUT, ttl) after it came in."""

    def test_dies_after_the_timeout(self, bench: Bench) -> None:
        bench.receive(bench.companion.lease(ttl_ms=60_000))
        bench.run(2900)
        assert bench.status.state == LIVE
        bench.run(200)
        assert bench.status.state == EXPIRED

    def test_dies_sooner_when_it_says_so(self, bench: Bench) -> None:
        bench.receive(bench.companion.lease(ttl_ms=1000))
        bench.run(900)
        assert bench.status.state == LIVE
        bench.run(200)
        assert bench.status.state == EXPIRED

    def test_timeout_follows_the_parameter(self, bench: Bench) -> None:
        bench.vehicle.parameters["HNDO_TIMEOUT"] = 10.0
        bench.receive(bench.companion.lease(ttl_ms=60_000))
        bench.run(9900)
        assert bench.status.state == LIVE
        bench.run(200)
        assert bench.status.state == EXPIRED

    def test_age_counts_from_reception_not_from_reading(self, bench: Bench) -> None:
        bench.receive(bench.companion.lease(ttl_ms=1000))
        bench.vehicle.now_ms += 900  # the scripting thread sleeps, the lease waits in the queue
        bench.run(200)
        assert bench.status.state == EXPIRED

    def test_clock_may_wrap_during_a_lease(self) -> None:
        bench = Bench(boot_ms=0xFFFFFFFF - 2000)
        bench.with_lease().run(4000)
        assert bench.vehicle.millis() < 4000
        assert bench.status.state == LIVE
        bench.sending = False
        bench.run(3300)
        assert bench.status.state == EXPIRED

    def test_clock_may_cross_the_sign_bit(self) -> None:
        bench = Bench(boot_ms=0x7FFFFFFF - 5000)
        bench.with_lease().run(3700)
        bench.sending = False
        bench.run(2000)
        assert bench.vehicle.millis() > 0x80000000
        assert bench.status.state == LIVE
        bench.run(1300)
        assert bench.status.state == EXPIRED

    def test_lease_that_comes_in_during_the_very_call_is_live(self) -> None:
        bench = Bench()
        due_ms = bench.scripting.next_run_ms()
        assert due_ms is not None
        bench.vehicle.now_ms = due_ms + 3
        bench.receive(bench.companion.lease())
        bench.vehicle.now_ms = due_ms
        bench.run(0)
        assert bench.status.state == LIVE


class TestChannelAny:
    """HNDO_CHAN -1: the first channel that brings a good lease, until it is dead on the ground."""

    @pytest.fixture
    def bench(self) -> Bench:
        return Bench(parameters={"HNDO_CHAN": -1.0})

    def test_any_negative_number_means_any_and_the_largest_channel_is_15(self) -> None:
        bench = Bench(parameters={"HNDO_CHAN": -1.0}, firmware=(4, 7, 1))
        bench.vehicle.parameters["HNDO_CHAN"] = -7.0
        bench.ask(channel=15)
        bench.receive(bench.companion.lease(), channel=15)
        bench.run(600)
        assert bench.may_arm
        bench.vehicle.parameters["HNDO_CHAN"] = 99.0
        bench.receive(bench.companion.lease(), channel=15)
        bench.run(600)
        assert bench.statuses(channel=15)[-1].sequence == 3

    def test_any_channel_may_begin(self, bench: Bench) -> None:
        bench.ask(channel=3)
        bench.receive(bench.companion.lease(), channel=3)
        bench.run(600)
        assert bench.statuses(channel=3)[-1].state == LIVE

    def test_then_it_is_locked(self, bench: Bench) -> None:
        bench.ask(channel=3)
        bench.receive(bench.companion.lease(), channel=3)
        bench.run(600)
        bench.receive(bench.companion.lease(), channel=2)
        bench.run(600)
        assert bench.statuses(channel=3)[-1].rejected == 1
        assert bench.statuses(channel=2) == []

    def test_it_is_free_again_on_the_ground_after_silence(self, bench: Bench) -> None:
        bench.ask(channel=3)
        bench.receive(bench.companion.lease(), channel=3)
        bench.run(4000)
        bench.receive(bench.companion.lease(), channel=2)
        bench.run(600)
        assert bench.statuses(channel=2)[-1].state == LIVE

    def test_it_stays_locked_while_armed(self, bench: Bench) -> None:
        bench.ask(channel=3)
        bench.receive(bench.companion.lease(), channel=3)
        bench.run(300)
        bench.vehicle.armed = bench.vehicle.flying = True
        bench.run(4000)
        bench.receive(bench.companion.lease(), channel=2)
        bench.run(600)
        assert bench.statuses(channel=3)[-1].state == EXPIRED
        assert bench.statuses(channel=2) == []


@pytest.mark.parametrize(
    ("state", "commander", "expected"),
    [
        (HELD, 251, LIVE),
        (TRANSFER, 251, LIVE),
        (RECOVERING, 251, LIVE),
        (NOBODY, 0, LOST),
        (NOBODY, 251, LOST),
        (HELD, 0, LOST),
        (TRANSFER, 0, LOST),
        (RECOVERING, 0, LOST),
    ],
)
def test_a_lease_without_commander_says_that_nobody_commands(
    bench: Bench, state: int, commander: int, expected: int
) -> None:
    bench.receive(bench.companion.lease(state=state, commander=commander))
    bench.run(600)
    assert bench.status.state == expected


def test_vehicle_id_of_older_firmware() -> None:
    bench = Bench()
    del bench.vehicle.parameters["MAV_SYSID"]
    bench.vehicle.parameters["SYSID_THISMAV"] = 9.0
    bench.run(1100)
    bench.companion.system = 9
    bench.receive(bench.companion.lease(target_system=9))
    bench.run(600)
    assert bench.vehicle.messages[-1][2][2] == 9
    assert bench.may_arm


@pytest.mark.parametrize("name", ["MAV_SYSID", "SYSID_THISMAV"])
def test_vehicle_id_counts_from_the_start(name: str) -> None:
    bench = Bench(parameters={name: 9.0}, without=[] if name == "MAV_SYSID" else ["MAV_SYSID"])
    bench.companion.system = 9
    bench.receive(bench.companion.lease(target_system=9))
    bench.run(100)
    bench.receive(bench.companion.lease(target_system=9))
    bench.run(100)
    assert bench.may_arm


def test_vehicle_that_does_not_tell_its_id_is_1() -> None:
    bench = Bench(without=["MAV_SYSID"]).with_lease()
    assert bench.may_arm
    bench.run(5000)
    assert bench.may_arm
