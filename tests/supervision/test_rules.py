# SPDX-License-Identifier: GPL-3.0-or-later

"""When a supervised process counts as dead or stalled, and what follows: in time that the test moves."""

from __future__ import annotations

from itertools import pairwise
from math import inf

import pytest

from mavproxy_handover.supervision.rules import Limits, Next, State, Watch
from mavproxy_handover.supervision.watchdog_pipe import BEAT, ENDING, LET_GO, Told

KILLED, ABORTED = -9, -6


def watch(limits: Limits | None = None) -> Watch:
    """Of a process that was started at 100 s."""
    found = Watch(limits or Limits())
    found.started(100.0)
    return found


def living(limits: Limits | None = None) -> Watch:
    """The same, and it has given its first sign at 101 s."""
    found = watch(limits)
    found.handle_signals(BEAT, 101.0)
    return found


def dies(supervised: Watch, now: float, code: int = KILLED) -> Next:
    """A process that lives dies; the next one lives half a second later."""
    supervised.handle_signals(BEAT, now - 0.1)
    after = supervised.ended(code, now)
    supervised.started(after.at)
    supervised.handle_signals(BEAT, after.at + 0.5)
    return after


# ---- patience -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("signs", "state", "due"),
    [
        (b"", State.STARTING, 110.0),
        (BEAT, State.LIVE, 102.2),
        (BEAT + LET_GO, State.LOOSE, inf),
        (BEAT + LET_GO + BEAT, State.LIVE, 102.2),
        (BEAT + ENDING, State.ENDING, 102.9),
        (BEAT + ENDING + BEAT, State.ENDING, 102.9),
        (BEAT + ENDING + LET_GO, State.ENDING, 102.9),
        (b"\0?\xff", State.STARTING, 110.0),
    ],
)
def test_each_state_has_its_patience(signs: bytes, state: State, due: float) -> None:
    supervised = watch()
    supervised.handle_signals(signs, 101.0)
    assert (supervised.state, supervised.due()) == (state, pytest.approx(due))


def test_every_sign_of_life_begins_the_time_anew() -> None:
    supervised = living()
    supervised.handle_signals(BEAT, 101.9)
    assert supervised.due() == pytest.approx(103.1)


def test_time_in_which_the_supervisor_itself_stood_still_does_not_count() -> None:
    supervised = living()
    supervised.pardon(7.0)
    assert supervised.due() == pytest.approx(109.2)


def test_who_is_asked_to_end_once_more_has_no_more_time() -> None:
    supervised = living()
    supervised.asked_to_end(105.0)
    supervised.asked_to_end(106.0)
    assert supervised.due() == pytest.approx(106.9)


# ---- ends ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("code", "passed_on"), [(0, 0), (1, 1), (2, 2), (KILLED, 137)])
def test_an_end_that_was_wanted_is_the_end(code: int, passed_on: int) -> None:
    supervised = living()
    supervised.asked_to_end(105.0)
    assert supervised.ended(code, 106.0) == Next(code=passed_on)


def test_the_word_exit_is_wanted_too() -> None:
    supervised = living()
    supervised.handle_signals(ENDING, 105.0)
    assert supervised.ended(0, 106.0) == Next(code=0)


@pytest.mark.parametrize(("code", "passed_on"), [(2, 2), (1, 1), (ABORTED, 134)])
def test_who_never_lived_is_not_tried_again(code: int, passed_on: int) -> None:
    assert watch().ended(code, 103.0) == Next(code=passed_on)


@pytest.mark.parametrize(
    ("code", "now", "why"),
    [
        (KILLED, 101.5, "it was killed by SIGKILL"),
        (ABORTED, 101.5, "it was killed by SIGABRT"),
        (-40, 101.5, "it was killed by signal 40"),
        (0, 101.5, "it ended with 0"),
        (1, 101.5, "it ended with 1"),
        (KILLED, 102.25, "its main loop stood still for 1.2 s"),
    ],
)
def test_any_other_end_is_a_death_and_it_is_started_again_at_once(code: int, now: float, why: str) -> None:
    assert living().ended(code, now) == Next(Told(why), now)


def test_one_that_dies_as_it_starts_again_is_tried_again_after_a_moment() -> None:
    supervised = living()
    supervised.ended(KILLED, 105.0)
    supervised.started(105.0)
    after = supervised.ended(ABORTED, 105.4)
    assert after == Next(Told("it was killed by SIGABRT"), pytest.approx(105.7))
    supervised.started(after.at)
    assert supervised.ended(KILLED, 116.0).told == Told("it had not started after 10.3 s", leases=False)


# ---- loads that fail ----------------------------------------------------------------------------------------------


def loads_fail(supervised: Watch, now: float, times: int, *, each_s: float = 0.5, code: int = 2) -> list[Next]:
    """A process that was started at `now` cannot be loaded, again and again: each says so after `each_s`."""
    ends = []
    for _ in range(times):
        supervised.started(now)
        ends.append(supervised.ended(code, now + each_s))
        now = ends[-1].at
    return ends


@pytest.mark.parametrize("code", [1, 2])
def test_a_load_that_fails_is_tried_again_with_growing_pauses_and_is_no_restart(code: int) -> None:
    supervised = living()
    supervised.ended(KILLED, 101.5)
    ends = loads_fail(supervised, 101.5, 20, code=code)
    assert all(after.told is not None and after.told.leases for after in ends)
    pauses = [later.at - earlier.at - 0.5 for earlier, later in pairwise(ends)]
    assert ends[0].at == pytest.approx(102.3)
    assert pauses == [pytest.approx(0.6)] + [pytest.approx(1.0)] * 18
    assert ends[-1].told is not None
    assert ends[-1].told.why == (
        f"it was killed by SIGKILL; failed loads since then: 20, the last one ended with {code}"
    )


def test_a_crash_loop_is_not_hidden_by_loads_that_fail_between_the_crashes() -> None:
    """Three judges die within seconds of their life; the loads between them fail for two minutes each time."""
    supervised = living()
    assert dies(supervised, 110.0).told == Told("it was killed by SIGKILL")
    loads_fail(supervised, 110.5, 80)
    assert dies(supervised, 240.0).told == Told("it was killed by SIGKILL")
    loads_fail(supervised, 240.5, 80)
    assert dies(supervised, 370.0).told == Told("it was killed by SIGKILL", leases=False)


def test_what_is_without_leases_stays_so_after_a_load_that_failed() -> None:
    supervised = living()
    for at in (110.0, 111.0, 112.0):
        dies(supervised, at)
    supervised.ended(KILLED, 120.0)
    (after,) = loads_fail(supervised, 125.0, 1)
    assert after.told is not None
    assert not after.told.leases
    assert after.at == pytest.approx(130.5)


@pytest.mark.parametrize("code", [KILLED, 70, 0])
def test_other_ends_of_a_start_are_deaths(code: int) -> None:
    supervised = living()
    leases = []
    now = 105.0
    supervised.ended(KILLED, now)
    for _ in range(2):
        supervised.started(now)
        after = supervised.ended(code, now + 0.5)
        assert after.told is not None
        leases.append(after.told.leases)
        now = after.at
    assert leases == [True, False]


def test_a_load_that_fails_after_the_pauses_begins_with_the_first_one_once_a_process_has_lived() -> None:
    supervised = living()
    supervised.ended(KILLED, 105.0)
    loads_fail(supervised, 105.0, 5)
    dies(supervised, 200.0)
    (after,) = loads_fail(supervised, 201.0, 1)
    assert after.at == pytest.approx(201.8)


def test_a_second_companion_that_is_started_in_flight_gives_up() -> None:
    supervised = Watch(Limits(), in_flight=True)
    first, second, third = loads_fail(supervised, 100.0, 3, code=75)
    assert first.told is not None
    assert second.told is not None
    assert third == Next(code=2)


def test_in_flight_the_first_start_is_tried_again_too() -> None:
    supervised = Watch(Limits(), in_flight=True)
    (after,) = loads_fail(supervised, 100.0, 1)
    assert after.told == Told("it was started in flight; failed loads since then: 1, the last one ended with 2")
    assert after.at == pytest.approx(100.8)


def test_a_death_after_the_module_was_unloaded_is_one() -> None:
    supervised = living()
    supervised.handle_signals(LET_GO, 103.0)
    assert supervised.ended(ABORTED, 150.0).told == Told("it was killed by SIGABRT")


# ---- too often ----------------------------------------------------------------------------------------------------


def test_the_third_restart_in_a_minute_sends_no_more_leases() -> None:
    supervised = living()
    assert [dies(supervised, at).told.leases for at in (110.0, 140.0, 169.9)] == [True, True, False]  # type: ignore[union-attr]


def test_the_third_one_in_more_than_that_does() -> None:
    supervised = living()
    ends = [dies(supervised, at) for at in (110.0, 140.0, 170.0, 200.0)]
    assert [after.told for after in ends] == [Told("it was killed by SIGKILL")] * 4


def test_nor_does_any_after_it_however_long_it_lives_and_they_come_slowly() -> None:
    supervised = living()
    third = [dies(supervised, at) for at in (110.0, 111.0, 112.0)][-1]
    assert third.at == 112.0
    for at in (113.0, 400.0, 9000.0):
        assert dies(supervised, at) == Next(Told("it was killed by SIGKILL", leases=False), at + 5.0)


def test_how_many_count_together_can_be_set() -> None:
    supervised = living(Limits(window_s=0.0))
    assert all(dies(supervised, 110.0 + n).told == Told("it was killed by SIGKILL") for n in range(20))
