# SPDX-License-Identifier: GPL-3.0-or-later

"""Expectations against journals made by hand: each holds on the flight as planned and fails on one that went wrong."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from sitl.report.evidence import Evidence, RunNotes, of_vehicle
from sitl.report.journal_reader import Entry
from sitl.report.loss import Heard
from sitl.report.matching import Match
from sitl.script.expect import (
    ALWAYS,
    Commanders,
    Commands,
    Corrections,
    Count,
    Countdown,
    Emergencies,
    Expectation,
    Follows,
    Handovers,
    ItemsReached,
    Landed,
    Loss,
    Memory,
    Modes,
    ModeWithin,
    NobodyDied,
    NoFault,
    Number,
    OfVehicle,
    OneCommander,
    Quiet,
    Said,
)
from tests.sitl.synthetic import SPEEDUP, VEHICLE_NAME, evidence, nominal, wall

FIVE = ("GCSA", "GCSB", "GCSA", "GCSB", "GCSA")


def without(event: str, which: Callable[[Entry], bool] = lambda entry: True) -> list[Entry]:
    return [entry for entry in nominal() if not (entry.event == event and which(entry))]


def with_entry(t: float, who: str, event: str, text: str = "", **fields: object) -> list[Entry]:
    return sorted([*nominal(), Entry(t, who, event, text, fields)], key=lambda entry: entry.t)


@pytest.mark.parametrize(
    "expectation",
    [
        Commanders(FIVE),
        Handovers(4),
        ItemsReached("all"),
        Landed(1.0, ("home",)),
        Emergencies(()),
        Count("transfer_begun", VEHICLE_NAME, count=4),
        Follows("transfer_committed", "transfer_begun", 0.23, VEHICLE_NAME),
        *ALWAYS,
    ],
    ids=lambda expectation: type(expectation).__name__,
)
def test_the_flight_as_planned_meets_every_expectation(expectation: Expectation) -> None:
    verdict = expectation.judge(evidence())
    assert verdict.held, verdict


def test_commanders_in_another_order_fail() -> None:
    verdict = Commanders(("GCSA", "GCSB")).judge(evidence())
    assert not verdict.held
    assert verdict.seen == "GCSA → GCSB → GCSA → GCSB → GCSA"


def test_authority_lost_in_between_is_seen() -> None:
    lost = with_entry(wall(100), VEHICLE_NAME, "view", phase="on_mission", epoch=2, lease="lost")
    verdict = Commanders(FIVE).judge(evidence(lost))
    assert not verdict.held
    assert verdict.seen.startswith("GCSA → GCSB → nobody → GCSB → GCSA")


def test_a_companion_that_was_restarted_obeys_nobody_until_it_has_heard_the_commander() -> None:
    entries = [
        *nominal(),
        Entry(wall(100), VEHICLE_NAME, "restarted", "", {"epoch": 3}),
        Entry(wall(101), VEHICLE_NAME, "view", "", {"epoch": 3, "commander": "GCSB"}),
    ]
    verdict = Commanders(FIVE).judge(evidence(sorted(entries, key=lambda entry: entry.t)))
    assert verdict.seen.startswith("GCSA → GCSB → nobody → GCSB → GCSA")


def test_a_handover_that_is_missing_fails() -> None:
    entries = without("transfer_committed", lambda entry: entry.get("handover_id") == 3)
    verdict = Handovers(4).judge(evidence(entries))
    assert not verdict.held
    assert verdict.seen == "3 committed (12 ms, 222 ms, 10 ms), 0 aborted"


def test_a_handover_without_its_duration_fails() -> None:
    entries = [
        replace(entry, fields={key: value for key, value in entry.fields.items() if key != "duration_s"})
        if entry.event == "transfer_committed" and entry.get("handover_id") == 2
        else entry
        for entry in nominal()
    ]
    verdict = Handovers(4).judge(evidence(entries))
    assert not verdict.held
    assert "no time" in verdict.seen


def test_an_aborted_attempt_fails_unless_it_is_expected() -> None:
    entries = with_entry(wall(90), VEHICLE_NAME, "transfer_aborted", handover_id=9, reason="partner_silent")
    assert not Handovers(4).judge(evidence(entries)).held
    assert Handovers(4, aborted=1).judge(evidence(entries)).held


def test_a_handover_that_takes_too_long_fails() -> None:
    assert Handovers(4, within_s=0.23).judge(evidence()).held
    verdict = Handovers(4, within_s=0.2).judge(evidence())
    assert not verdict.held
    assert verdict.wanted == "handovers: 4 committed within 0.2 s, 0 aborted"


def border(t: float, station: str = "GCSB") -> Entry:
    return Entry(t, VEHICLE_NAME, "zone_entered", "", {"station": station})


def committed(t: float, station: str = "GCSB") -> Entry:
    return Entry(t, VEHICLE_NAME, "transfer_committed", "", {"station": station})


def item(t: float, number: int, who: str = VEHICLE_NAME) -> Entry:
    return Entry(t, who, "reached", "", {"number": number})


PROMPT = Follows("transfer_committed", "zone_entered", 0.5)
BEHIND = Follows("transfer_committed", "reached", 0.5, number=11)
ORDER = Follows("fly", "transfer_committed", 0.5)


@pytest.mark.parametrize(
    ("expectation", "entries", "held", "seen"),
    [
        (PROMPT, [border(1.0), committed(1.5)], True, "after 0.500 s"),
        (PROMPT, [border(1.0), committed(1.75)], False, "after 0.750 s"),
        # each commit, and by the last border before it
        (PROMPT, [border(1.0), committed(1.25), border(9.0), committed(9.25)], True, "after 0.250 s, after 0.250 s"),
        (PROMPT, [border(1.0), committed(1.25), committed(9.0)], False, "after 0.250 s, after 8.000 s"),
        (PROMPT, [border(1.0, "GCSA"), committed(1.25)], False, "never before it"),
        (PROMPT, [border(1.0), border(1.2, "GCSA"), committed(1.25)], True, "after 0.250 s"),
        (PROMPT, [committed(1.0), border(1.25)], False, "never before it"),
        (PROMPT, [border(1.0)], False, "no such entry"),
        (BEHIND, [item(1.0, 11), committed(1.25)], True, "after 0.250 s"),
        (BEHIND, [item(1.0, 10), committed(1.25)], False, "never before it"),
        (BEHIND, [item(1.0, 11), item(1.2, 12), committed(1.75)], False, "after 0.750 s"),
        # an order tells of no station
        (ORDER, [committed(1.0), Entry(1.25, VEHICLE_NAME, "fly", "", {})], True, "after 0.250 s"),
        # the clock of another program is not the companion's word
        (BEHIND, [item(1.0, 11, "vehicle"), committed(1.25)], False, "never before it"),
    ],
)
def test_what_follows_has_to_follow_in_time(expectation: Follows, entries: list[Entry], held: bool, seen: str) -> None:
    verdict = expectation.judge(evidence(entries))
    assert (verdict.held, verdict.seen) == (held, seen)


def test_what_should_follow_is_told_in_words() -> None:
    verdict = Follows("transfer_committed", "reached", 5.0, "drone-1", 11).judge(evidence([]))
    assert verdict.wanted == "transfer committed (drone-1) within 5 s after reached 11"


def test_who_loses_authority_loses_it_under_the_epoch_that_it_had() -> None:
    lost = with_entry(wall(320), VEHICLE_NAME, "view", phase="emergency", epoch=5, lease="lost")
    verdict = OneCommander().judge(evidence(lost))
    assert verdict.held
    assert verdict.seen.endswith("GCSA 5, nobody 5")


def test_authority_taken_up_again_under_the_same_epoch_fails() -> None:
    entries = [
        *nominal(),
        Entry(wall(320), VEHICLE_NAME, "view", "", {"epoch": 5}),
        Entry(wall(321), VEHICLE_NAME, "view", "", {"epoch": 5, "commander": "GCSA"}),
    ]
    assert not OneCommander().judge(evidence(sorted(entries, key=lambda entry: entry.t))).held


@pytest.mark.parametrize(("p99_ms", "held"), [(49.9, True), (50.0, False), (float("inf"), False), (None, False)])
def test_a_number_must_be_below_its_limit(p99_ms: float | None, held: bool) -> None:
    entries = with_entry(wall(100), "GCSA", "measured", p99_ms=p99_ms)
    assert Number("measured", "p99_ms", "GCSA", below=50.0).judge(evidence(entries)).held is held


def test_every_one_of_several_numbers_counts() -> None:
    entries = [*nominal(), *(Entry(wall(100 + n), "GCSA", "measured", "", {"lost": n}) for n in range(2))]
    assert not Number("measured", "lost", below=1.0).judge(evidence(entries)).held


def test_many_numbers_are_told_as_a_range() -> None:
    entries = [*nominal(), *(Entry(wall(100 + n), "GCSA", "measured", "", {"lost": n}) for n in range(40))]
    assert Number("measured", "lost", below=50.0).judge(evidence(entries)).seen == "0 to 39 in 40 entries"


def test_a_number_that_nobody_measured_fails() -> None:
    verdict = Number("measured", "p99_ms", below=50.0).judge(evidence())
    assert (verdict.held, verdict.seen) == (False, "no such entry")


@pytest.mark.parametrize(("sizes", "held"), [((100, 103, 101), True), ((100, 109, 101), False), ((100,), False)])
def test_memory_that_grows_fails_even_if_it_is_given_back(sizes: tuple[int, ...], held: bool) -> None:
    entries = [Entry(wall(100 + n), "runner", "memory", "", {"resident_kb": mb * 1024}) for n, mb in enumerate(sizes)]
    entries += [Entry(wall(99), "runner", "memory", "", {"resident_kb": 1})]
    judged = evidence([*nominal(), *entries], marks={"quiet": wall(99.5), "flooded": wall(110)})
    assert Memory("quiet", "flooded", 4.0).judge(judged).held is held


def test_an_item_that_was_not_reached_is_named() -> None:
    verdict = ItemsReached("all").judge(evidence(without("reached", lambda entry: entry.get("number") == 8)))
    assert not verdict.held
    assert verdict.seen == "not reached: 8"


def test_the_landing_that_ends_the_mission_is_no_item_to_reach() -> None:
    assert "11" not in ItemsReached("all").judge(evidence()).wanted


def test_landing_elsewhere_fails_and_says_how_far() -> None:
    entries = [
        replace(entry, fields={"lat_deg": 52.68, "lon_deg": 5.924}) if entry.event == "landed" else entry
        for entry in nominal()
    ]
    verdict = Landed(3.0, ("home",)).judge(evidence(entries))
    assert not verdict.held
    # a thousandth of a degree of latitude is 111.3 m here
    assert verdict.seen == "111.3 m from home"


def test_landing_at_a_rally_point_counts_where_it_may() -> None:
    entries = [
        replace(entry, fields={"lat_deg": 52.679629, "lon_deg": 5.922374}) if entry.event == "landed" else entry
        for entry in nominal()
    ]
    assert Landed(3.0).judge(evidence(entries)).seen.endswith("m from rally point 1")
    assert Landed(3.0, ("rally 1",)).judge(evidence(entries)).held
    assert not Landed(3.0, ("rally 2",)).judge(evidence(entries)).held
    with pytest.raises(ValueError, match="must be one of home, rally, rally 1 and so on, last_item"):
        Landed(3.0, ("rally 0",))
    assert Landed(3.0).judge(evidence(entries)).held
    assert not Landed(3.0, ("home",)).judge(evidence(entries)).held


def test_a_vehicle_still_armed_has_not_landed() -> None:
    assert Landed(3.0).judge(evidence(without("disarmed"))).seen == "still armed at the end"


def test_a_flight_without_landing_has_not_landed() -> None:
    entries = [entry for entry in nominal() if not (entry.event == "landed" and entry.who == "vehicle")]
    assert Landed(3.0).judge(evidence(entries)).seen == "never landed"


def test_modes_are_those_in_the_air() -> None:
    entries = [
        Entry(1.0, "vehicle", "mode", "", {"mode": "GUIDED"}),
        Entry(2.0, "vehicle", "mode", "", {"mode": "AUTO"}),
        Entry(3.0, "vehicle", "airborne"),
        Entry(4.0, "vehicle", "mode", "", {"mode": "RTL"}),
        Entry(5.0, "vehicle", "landed"),
        Entry(6.0, "vehicle", "mode", "", {"mode": "STABILIZE"}),
    ]
    assert Modes(("AUTO", "RTL")).judge(evidence(entries)).held
    assert not Modes(("AUTO",)).judge(evidence(entries)).held


def test_a_mode_in_time_holds_and_a_late_one_fails() -> None:
    entries = with_entry(wall(104), "vehicle", "mode", mode="RTL")
    marks = {"killed": wall(100)}
    verdict = ModeWithin("RTL", "killed", 4.5).judge(evidence(entries, marks=marks))
    assert verdict.held
    assert verdict.seen == "after 4.0 s"
    assert not ModeWithin("RTL", "killed", 3.5).judge(evidence(entries, marks=marks)).held


def test_a_mode_of_the_same_moment_counts_whatever_the_order_of_the_two_clocks() -> None:
    entries = with_entry(wall(100) - 0.0001, "vehicle", "mode", mode="RTL")
    verdict = ModeWithin("RTL", "killed", 4.5).judge(evidence(entries, marks={"killed": wall(100)}))
    assert verdict.held
    assert verdict.seen == "after 0.0 s"


def test_a_mode_shown_before_the_moment_does_not_count() -> None:
    entries = with_entry(wall(90), "vehicle", "mode", mode="RTL")
    verdict = ModeWithin("RTL", "killed", 60).judge(evidence(entries, marks={"killed": wall(100)}))
    assert not verdict.held


def test_a_mode_after_a_moment_that_never_came_fails() -> None:
    assert ModeWithin("RTL", "killed", 60).judge(evidence()).seen == "'killed' never came"


def test_commands_are_counted_exactly_by_station() -> None:
    what = "COMMAND_LONG/MAV_CMD_DO_SET_MODE"
    right = Commands((("*SET_MODE",)), Match((("GCSB", [0, 1]),)))
    assert right.judge(evidence()).held
    extra = with_entry(wall(70), VEHICLE_NAME, "accepted", station="GCSB", what=what)
    verdict = right.judge(evidence(extra))
    assert not verdict.held
    assert verdict.seen == "GCSB 1 accepted, 1 refused"


def test_a_station_that_is_not_named_must_have_commanded_nothing() -> None:
    entries = with_entry(wall(70), VEHICLE_NAME, "accepted", station="GCSA", what="SET_MODE")
    assert not Commands(("*SET_MODE",), Match((("GCSB", [0, 1]),))).judge(evidence(entries)).held


def test_counts_hold_within_their_limits_only() -> None:
    of_b = Match((("station", "GCSB"),))
    assert Count("transfer_begun", match=of_b, count=2).judge(evidence()).held
    assert not Count("transfer_begun", match=of_b, count=4).judge(evidence()).held
    assert not Count("transfer_begun", match=of_b, at_least=3).judge(evidence()).held
    assert not Count("transfer_begun", match=of_b, at_most=1).judge(evidence()).held


def test_an_emergency_that_nobody_expected_fails() -> None:
    entries = with_entry(wall(90), VEHICLE_NAME, "emergency", "out of coverage: return", reason="out_of_coverage")
    assert not Emergencies(()).judge(evidence(entries)).held
    assert Emergencies(("out_of_coverage",)).judge(evidence(entries)).held


def test_what_the_autopilot_said_is_found_by_its_words() -> None:
    entries = with_entry(wall(90), "vehicle", "said", "HNDO: lease lost, RTL", severity=2)
    assert Said("*lease lost*").judge(evidence(entries)).held
    assert not Said("*lease lost*").judge(evidence()).held


def test_the_loss_that_stations_see_is_below_its_limit_at_each_of_them() -> None:
    expectation = Loss(0.05)
    whole, holes = Heard(12_000, 0), Heard(12_000, 7)
    assert expectation.judge(evidence(losses={"GCSA": whole, "GCSB": Heard(8_000, 3)})).held
    verdict = expectation.judge(evidence(losses={"GCSB": holes, "GCSA": whole}))
    assert (verdict.held, verdict.seen) == (False, "GCSA 0.0 % (0 of 12000); GCSB 0.1 % (7 of 12007)")
    assert not expectation.judge(evidence(losses={"GCSA": whole, "GCSB": Heard(0, 0)})).held, "nothing was heard"
    assert not expectation.judge(evidence(losses={"GCSA": whole, "GCSB": "GCSB.tlog cannot be read: no"})).held
    assert not expectation.judge(evidence()).held, "nothing was measured"


def test_a_dead_program_fails_every_run() -> None:
    verdict = NobodyDied().judge(evidence(deaths={"GCSB": "killed by SIGSEGV"}))
    assert not verdict.held
    assert verdict.seen == "GCSB killed by SIGSEGV"


def test_a_fault_fails_every_run_and_is_told_in_one_line() -> None:
    fault = "idle: Traceback (most recent call last):\n  File x\nKeyError: 'speech'\n"
    verdict = NoFault().judge(evidence(with_entry(wall(90), "GCSA", "fault", fault)))
    assert not verdict.held
    assert verdict.seen == "GCSA: idle: KeyError: 'speech'"


def test_a_commander_under_an_old_epoch_fails_every_run() -> None:
    entries = with_entry(wall(100), VEHICLE_NAME, "view", phase="on_mission", commander="GCSA", epoch=1, lease="held")
    assert not OneCommander().judge(evidence(entries)).held


def test_a_run_without_any_commander_fails() -> None:
    assert not OneCommander().judge(evidence(without("view"))).held


def test_what_comes_after_the_end_of_the_timeline_is_not_judged() -> None:
    entries = with_entry(wall(400), VEHICLE_NAME, "view", phase="on_load", epoch=5, lease="lost")
    assert not Commanders(FIVE).judge(evidence(entries)).held
    assert Commanders(FIVE).judge(evidence(entries, ended_t=wall(390))).held


# ---- several vehicles ---------------------------------------------------------------------------------------------


def test_what_is_judged_of_one_vehicle_is_nothing_of_another_one() -> None:
    """Two aircraft at the same stations: each one's commanders, modes and texts are its own."""
    entries = [
        Entry(1.0, "drone-1", "view", "", {"commander": 251, "epoch": 1}),
        Entry(1.0, "drone-2", "view", "", {"commander": 252, "epoch": 1}),
        Entry(2.0, "vehicle", "said", "one"),
        Entry(2.0, "vehicle of drone-2", "said", "two"),
        Entry(3.0, "GCSA", "control_gained", "I have drone-1", {"vehicle": "drone-1"}),
        Entry(3.0, "GCSA", "control_gained", "I have drone-2", {"vehicle": "drone-2"}),
        Entry(4.0, "GCSA", "peer", "Ground link to GCSB is up."),
        Entry(5.0, "drone-2", "fault", "a bug"),
    ]
    names = ["drone-1", "drone-2"]
    package = evidence().package
    first, second = (Evidence(of_vehicle(entries, name, names), package, RunNotes()) for name in names)
    first.others = {"drone-2": second}
    gained = Count("control_gained", "GCSA", count=1)
    for about, commander, text in ((lambda each: each, "GCSA", "one"), (of_second, "GCSB", "two")):
        assert about(Commanders((commander,))).judge(first).held
        assert about(Said(text)).judge(first).held
        assert not about(Said("one" if text == "two" else "two")).judge(first).held
        assert about(gained).judge(first).held
        assert about(Count("peer", count=1)).judge(first).held
    assert NoFault().judge(first).held
    verdict = of_second(NoFault()).judge(first)
    assert (verdict.held, verdict.seen) == (False, "drone-2: a bug")
    assert verdict.wanted.startswith("drone-2: ")
    assert of_vehicle(entries, "drone-1", ["drone-1"]) == entries, "one vehicle's journals are taken whole"


def of_second(expectation: Expectation) -> Expectation:
    return OfVehicle("drone-2", expectation)


# ---- silence between two moments ------------------------------------------------------------------------------------

QUIET = Quiet(("zone_entered", "transfer_committed"), "apart", "truth", VEHICLE_NAME)


def marked(entries: list[Entry], **marks: float) -> Evidence:
    found = evidence(entries)
    found.notes.marks.update(marks)
    return found


def test_what_comes_before_and_behind_does_not_break_the_silence() -> None:
    entries = [border(9.9), border(20.0), committed(20.1), Entry(15.0, "GCSA", "zone_entered"), item(15.0, 3)]
    verdict = QUIET.judge(marked(entries, apart=10.0, truth=20.0))
    assert verdict.held, verdict
    assert verdict.seen == "none in 10.0 s"


@pytest.mark.parametrize("entry", [border(10.0), committed(19.9)])
def test_one_entry_breaks_it(entry: Entry) -> None:
    verdict = QUIET.judge(marked([entry], apart=10.0, truth=20.0))
    assert not verdict.held
    assert verdict.seen == f"{entry.event.replace('_', ' ')} after {entry.t - 10.0:.1f} s"


def test_silence_until_a_moment_that_never_came_is_none() -> None:
    assert not QUIET.judge(marked([], apart=10.0)).held
    assert QUIET.labels() == ("apart", "truth")


def counted(late_s: float = 0.0, stations: tuple[str, ...] = ("GCSA", "GCSB"), values: int = 15) -> list[Entry]:
    """Both stations count down to each handover, `late_s` too much."""
    shown = [
        Entry(done.t - left / SPEEDUP, who, "border_shown", "", {"station": done.get("station"), "in_s": left + late_s})
        for done in nominal()
        if done.event == "transfer_committed"
        for left in range(1, values + 1)
        for who in stations
    ]
    return sorted([*nominal(), *shown], key=lambda entry: entry.t)


class TestCountdown:
    def test_right_seconds_at_both_stations_hold(self) -> None:
        verdict = Countdown(15, 3).judge(evidence(counted()))
        assert verdict.held, verdict
        assert verdict.seen.endswith("s wrong at most, 4 handovers")

    @pytest.mark.parametrize(("late_s", "held"), [(2.5, True), (-2.5, True), (3.5, False), (-3.5, False)])
    def test_three_seconds_are_the_limit(self, late_s: float, held: bool) -> None:
        assert Countdown(15, 3).judge(evidence(counted(late_s))).held is held

    def test_one_station_that_shows_nothing_fails(self) -> None:
        verdict = Countdown(15, 3).judge(evidence(counted(stations=("GCSA",))))
        assert not verdict.held
        assert "GCSB showed 0 values before GCSB got it" in verdict.seen

    def test_too_few_values_fail(self) -> None:
        assert not Countdown(15, 3).judge(evidence(counted(values=5))).held

    def test_without_a_handover_it_fails(self) -> None:
        entries = [entry for entry in counted() if entry.event != "transfer_committed"]
        assert Countdown(15, 3).judge(evidence(entries)).seen.endswith("no handover was made")


# ---- RTK corrections ------------------------------------------------------------------------------------------------


def corrected(times: list[float], logged: list[float] | None = None, **marks: float) -> Evidence:
    """Corrections on the autopilot's line at these simulated times, and those of its log."""
    lined = [Entry(wall(sim_s), "listener", "to_autopilot", "", {"what": "GPS_RTCM_DATA"}) for sim_s in times]
    found = evidence([*nominal(), *lined], marks={label: wall(sim_s) for label, sim_s in marks.items()})
    found.notes.corrections = logged
    return found


SECONDS = [float(second) for second in range(100, 121)]


@pytest.mark.parametrize(
    ("times", "logged", "held"),
    [
        (SECONDS, None, True),
        (SECONDS[:10] + SECONDS[11:], None, False),
        (SECONDS[3:], None, False),
        (SECONDS[:-3], None, False),
        (SECONDS, [], False),
        ([], SECONDS, True),
        (SECONDS, SECONDS[:10] + SECONDS[11:], False),
    ],
)
def test_corrections_have_no_gap(times: list[float], logged: list[float] | None, held: bool) -> None:
    verdict = Corrections("fed", "later", 1.5).judge(corrected(times, logged, fed=100.0, later=120.0))
    assert verdict.held is held, verdict
    assert ("log" in verdict.seen) is (logged is not None)


def test_a_moment_that_never_came_shows_no_corrections() -> None:
    assert not Corrections("fed", "later", 1.5).judge(corrected(SECONDS, fed=100.0)).held
