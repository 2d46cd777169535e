# SPDX-License-Identifier: GPL-3.0-or-later

"""Which guard a lease is for, when one goes out at once, and what does not fit, in words."""

from __future__ import annotations

import struct

import pytest

from mavproxy_handover.doctor.advice import advice
from mavproxy_handover.vehicle.guard_link import GuardLink, misfit_of
from mavproxy_handover.wire.lease import unpack_guard_status
from mavproxy_handover.wire.lease_tag import lease_tag
from mavproxy_handover.wire.status import LeaseSequence

OURS = 0xC0FFEE01
KEY, OTHER_KEY = bytes(range(32)), bytes(range(1, 33))
TWO = "two guards answer: remove one of the two scripts from the card"
OLDER = "the guard is older than this companion: put the handover_guard.lua of this release on the card"
NEWER = "the guard is newer than this companion: install the same release on both"
NO_KEY = "the guard has no key: put handover.key on its card, beside the script"
OTHER = "the guard's status does not fit guard_key: its handover.key is another key, or a stranger sends it"
KEYED = "the guard has a key: set guard_key in the vehicle's configuration"


def leases(sequence: int = 10) -> LeaseSequence:
    """Of this companion, the last number of which was `sequence`."""
    sequences = LeaseSequence(OURS)
    sequences.sequence = sequence
    return sequences


def status(
    guard_nonce: int, nonce: int = OURS, flags: int = 0, key: bytes | None = None, target: int = 1, sequence: int = 9
) -> bytes:
    """A status in the state LIVE that echoes the lease of the companion `nonce`."""
    body = struct.pack("<BBBBIIIHBBI", 2, 2, 0, flags | (32 if key else 0), nonce, sequence, 7, 0, 4, 7, guard_nonce)
    return body + (lease_tag(key, 47117, (target, 191), body) if key else b"")


def test_before_a_status_the_lease_asks_for_the_nonce() -> None:
    assert GuardLink(1, None, leases()).addressed(0.0) == (0,)


def test_a_new_nonce_is_answered_at_once_and_the_lease_is_for_it() -> None:
    link = GuardLink(1, None, leases())
    link.on_status(status(5), 10.0)
    assert link.asks
    assert link.addressed(10.0) == (5,)
    link.answered()
    link.on_status(status(5), 10.5)
    assert not link.asks
    link.on_status(status(900), 20.0)
    assert link.asks
    assert link.addressed(20.0) == (900,)


def test_a_guard_without_a_lease_of_this_companion_is_answered_each_time_but_not_more_than_25_times_a_second() -> None:
    link = GuardLink(1, None, leases())
    answers = 0
    for tick in range(1000):
        link.on_status(status(5, nonce=0), tick / 1000)
        if link.asks:
            answers += 1
            link.answered()
    assert 20 <= answers <= 25


def test_the_next_nonce_is_of_the_same_guard() -> None:
    link = GuardLink(1, None, leases())
    for at, nonce in ((10.0, 0xFFFFFFFE), (10.5, 0xFFFFFFFF), (11.0, 1), (11.5, 2)):
        link.on_status(status(nonce), at)
        assert link.addressed(at) == (nonce,)
        assert not link.withholds(at)


def test_with_a_key_a_status_of_the_older_layout_is_named_and_is_none() -> None:
    """It has no tag that could prove the key: a stranger may send it."""
    older = struct.pack("<BBBBIIIHBB", 1, 2, 0, 0, OURS, 9, 7, 0, 4, 7)
    link = GuardLink(1, KEY, leases())
    assert link.on_status(older, 10.0) is None
    assert link.problem(10.0) == OLDER


class TestTwoGuards:
    def test_one_after_the_other_is_a_restart_and_withholds_arming_for_a_moment(self) -> None:
        link = GuardLink(1, None, leases())
        link.on_status(status(5), 10.0)
        link.on_status(status(900), 10.4)
        assert (link.withholds(10.4), link.withholds(11.5), link.withholds(11.7)) == (True, True, False)
        assert link.problem(10.5) == ""
        assert link.addressed(10.5) == (900,)

    def test_after_three_seconds_without_the_first_there_is_no_doubt(self) -> None:
        link = GuardLink(1, None, leases())
        link.on_status(status(5), 10.0)
        link.on_status(status(900), 13.1)
        assert not link.withholds(13.1)

    def test_in_turn_they_are_two_and_both_get_leases(self) -> None:
        link = GuardLink(1, None, leases())
        for at, nonce in ((10.0, 5), (10.2, 900), (10.5, 5)):
            link.on_status(status(nonce), at)
        assert link.problem(10.5) == TWO
        assert set(link.addressed(10.5)) == {5, 900}
        assert (link.withholds(20.4), link.withholds(20.6)) == (True, False)
        assert link.problem(20.6) == ""

    def test_a_guard_that_has_found_another_one_says_so_in_flag_64(self) -> None:
        link = GuardLink(1, None, leases())
        link.on_status(status(5, flags=64), 10.0)
        assert link.problem(10.0) == TWO
        assert link.withholds(10.0)

    def test_recorded_statuses_do_not_take_the_leases_from_the_guard(self) -> None:
        """They prove the key of the guard, whose former nonces they tell; they echo no lease of late."""
        link = GuardLink(1, KEY, leases())
        link.on_status(status(5, key=KEY), 10.0)
        for number in range(200):
            at = 10.0 + number / 100
            link.on_status(status(1000 + 7 * number, nonce=0, key=KEY), at)
            link.on_status(status(3000 + 7 * number, sequence=0xFFFFFF00, key=KEY), at)
            assert 5 in link.addressed(at)
            if number % 50 == 49:
                link.on_status(status(5, key=KEY), at)


class TestVersions:
    def test_an_older_guard_is_read_and_named(self) -> None:
        link = GuardLink(1, None, leases())
        old = link.on_status(struct.pack("<BBBBIIIHBB", 1, 3, 0, 0, OURS, 9, 7, 0, 4, 7), 10.0)
        assert old is not None
        assert old.version == 1
        assert link.problem(10.0) == OLDER
        assert link.addressed(10.0) == (0,)
        assert link.problem(13.1) == ""

    def test_a_newer_guard_is_named(self) -> None:
        link = GuardLink(1, None, leases())
        assert link.on_status(b"\x03" + bytes(27), 10.0) is None
        assert link.problem(10.0) == NEWER

    @pytest.mark.parametrize("payload", [b"", b"\x00", b"\x02", bytes(24)])
    def test_noise_is_nothing(self, payload: bytes) -> None:
        link = GuardLink(1, None, leases())
        assert link.on_status(payload, 10.0) is None
        assert link.problem(10.0) == ""


class TestKey:
    def test_a_status_with_the_tag_counts(self) -> None:
        link = GuardLink(1, KEY, leases())
        assert link.on_status(status(5, key=KEY), 10.0) is not None
        assert (link.problem(10.0), link.addressed(10.0)) == ("", (5,))

    @pytest.mark.parametrize(
        ("payload", "problem"),
        [
            (status(5), NO_KEY),
            (status(5, key=OTHER_KEY), OTHER),
            (status(5, key=KEY, target=2), OTHER),
            (status(5, key=KEY)[:-1] + b"\x00", OTHER),
        ],
        ids=["no tag", "another key", "another vehicle", "damaged"],
    )
    def test_any_other_is_none_and_named(self, payload: bytes, problem: str) -> None:
        link = GuardLink(1, KEY, leases())
        assert link.on_status(payload, 10.0) is None
        assert (link.problem(10.0), link.addressed(10.0), link.asks) == (problem, (0,), False)

    def test_a_guard_with_a_key_where_the_companion_has_none(self) -> None:
        link = GuardLink(1, None, leases())
        assert link.on_status(status(5, key=KEY), 10.0) is not None
        assert link.problem(10.0) == KEYED


@pytest.mark.parametrize(
    ("payload", "keyed", "text"),
    [
        (status(5), False, ""),
        (status(5, key=KEY), True, ""),
        (status(5), True, NO_KEY),
        (status(5, key=KEY), False, KEYED),
        (status(5, flags=64), False, TWO),
        (struct.pack("<BBBBIIIHBB", 1, 3, 0, 0, OURS, 9, 7, 0, 4, 7), False, OLDER),
    ],
)
def test_one_status_shows_the_doctor_what_does_not_fit(payload: bytes, keyed: bool, text: str) -> None:
    told = unpack_guard_status(payload)
    assert told is not None
    assert misfit_of(told, keyed=keyed) == text
    assert advice("", text) != "Read ardupilot_lua/handover_guard.md." or text == ""
