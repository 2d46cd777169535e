# SPDX-License-Identifier: GPL-3.0-or-later

"""The book of a rehearsal: what its report says, and that nobody fills it."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from mavproxy_handover.mission.geodesy import distance_m
from mavproxy_handover.operator.rehearsal.rehearsal_stats import MOST, Foreseen, LinkSeen, RehearsalStats

HERE, THERE = (52.67900, 5.92720), (52.67900, 5.92850)
CHECK = (
    Foreseen("GCSA", "GCSB", HERE, 3, 14.2),
    Foreseen("GCSB", "GCSA", THERE, 7, 12.0),
)


def book(foreseen: Sequence[Foreseen] = CHECK) -> RehearsalStats:
    return RehearsalStats(100.0, foreseen)


def link(
    silent_s: float | None = 0.1, loss: float | None = 0.0, round_trip_s: float | None = 0.02, station: str = "GCSA"
) -> LinkSeen:
    return LinkSeen(station, "udp", silent_s, loss, round_trip_s)


class TestLinks:
    def test_each_station_and_place_has_a_line(self) -> None:
        seen = book()
        for step in range(20):
            place = "GCSA" if step < 10 else "GCSA+GCSB"
            seen.saw(100.5 + step / 2, place, HERE, [link(), link(station="GCSB")])
        good = "lost 0% (most 0%), trip 20 ms (most 20), silent 0.1 s at 52.67900 5.92720"
        assert seen.lines(110.0)[4:10] == (
            "link GCSA udp",
            f"  GCSA 5 s, {good}",
            f"  GCSA+GCSB 5 s, {good}",
            "link GCSB udp",
            f"  GCSA 5 s, {good}",
            f"  GCSA+GCSB 5 s, {good}",
        )

    def test_the_longest_silence_says_where_it_was(self) -> None:
        seen = book()
        seen.saw(101.0, "GCSA", HERE, [link(silent_s=0.5)])
        seen.saw(102.0, "GCSA", THERE, [link(silent_s=4.0)])
        seen.saw(103.0, "GCSA", HERE, [link(silent_s=0.2)])
        assert "silent 4.0 s at 52.67900 5.92850" in seen.lines(103.0)[-2]

    def test_loss_is_the_mean_and_the_most_round_trips_the_median_and_the_most(self) -> None:
        seen = book()
        for number, (loss, trip_s) in enumerate([(0.0, 0.010), (0.1, 0.030), (0.8, 0.900)], 1):
            seen.saw(100.0 + number, "GCSA", HERE, [link(loss=loss, round_trip_s=trip_s)])
        assert "lost 30% (most 80%), trip 30 ms (most 900)" in seen.lines(104.0)[-2]
        (entry,) = seen.entry(104.0)["links"]
        assert (entry["loss"], entry["loss_most"]) == (0.3, 0.8)
        assert (entry["round_trip_s"], entry["round_trip_most_s"]) == (0.03, 0.9)

    def test_what_was_never_measured_is_not_said_to_be_good(self) -> None:
        seen = book()
        seen.saw(101.0, "no zone", None, [link(None, None, None)])
        assert seen.lines(101.0)[-2] == "  no zone 1 s, never heard"

    def test_more_places_than_there_is_room_for_are_counted(self) -> None:
        seen = book(())
        for number in range(MOST + 3):
            seen.saw(101.0 + number, f"zone {number}", HERE, [link()])
        lines = seen.lines(300.0)
        assert sum(line.startswith("  zone ") for line in lines) == MOST
        assert lines[-1] == "3 more entries left out"


class TestHandovers:
    def test_one_as_the_check_has_it(self) -> None:
        seen = book()
        seen.saw(111.0, "GCSA+GCSB", (52.67900, 5.92735), [])
        seen.handover("GCSA", "GCSB", 112.0, 0.034, "zone", distance_m)
        lines = seen.lines(120.0)
        assert lines[1] == "handovers 1, 1 of 2 that the check has"
        assert lines[2] == (
            "  1: GCSA -> GCSB at 12 s, took 0.03 s of 14.2 s in flight, 10 m off the check's place, item 3"
        )
        assert lines[3] == "  not made: GCSB -> GCSA, way to item 7"

    def test_all_of_them_in_order(self) -> None:
        seen = book()
        for number, (before, after) in enumerate([("GCSA", "GCSB"), ("GCSB", "GCSA")]):
            seen.saw(110.0 + number, "GCSA+GCSB", HERE, [])
            seen.handover(before, after, 110.0 + number, 0.1, "zone", distance_m)
        assert seen.lines(120.0)[1] == "handovers 2, 2 of 2 that the check has"
        assert not any("not made" in line for line in seen.lines(120.0))

    def test_one_that_the_check_does_not_have(self) -> None:
        seen = book()
        seen.saw(111.0, "GCSA+GCSB", HERE, [])
        seen.handover("GCSB", "GCSC", 112.0, 0.5, "given", distance_m)
        assert seen.lines(120.0)[2] == ("  1: GCSB -> GCSC at 12 s, took 0.50 s (given); the check has none here")
        assert seen.entry(120.0)["handovers"][0]["item"] is None

    def test_what_the_check_has_may_be_known_later(self) -> None:
        seen = book(())
        seen.expects(())
        seen.expects(CHECK)
        seen.expects(CHECK[:1])
        assert seen.lines(101.0)[1] == "handovers 0, 0 of 2 that the check has"
        late = book(())
        late.handover("GCSA", "GCSB", 101.0, 0.1, "zone", distance_m)
        late.expects(CHECK)
        assert late.entry(102.0)["foreseen"] == 0, "which of them was made cannot be told any more"

    def test_one_that_is_left_out_is_missed(self) -> None:
        seen = book()
        seen.handover("GCSB", "GCSA", 112.0, 0.5, "zone", distance_m)
        assert seen.entry(120.0)["missed"] == [["GCSA", "GCSB", 3]]

    def test_one_that_came_to_nothing(self) -> None:
        seen = book()
        seen.aborted("GCSA", "GCSB", 112.0, 4.0, "partner silent")
        assert seen.lines(120.0)[1] == "handovers 0, 0 of 2 that the check has"
        assert seen.lines(120.0)[2] == "  1: GCSA -> GCSB at 12 s: came to nothing (partner silent), 4.0 s"


class TestTheRest:
    def test_refusals_are_counted(self) -> None:
        seen = book(())
        for _ in range(3):
            seen.refused("GCSB", "COMMAND_LONG/MAV_CMD_NAV_LAND", "not in control")
        assert "refused 3 x COMMAND_LONG/MAV_CMD_NAV_LAND of GCSB: not in control" in seen.lines(101.0)

    def test_nobody_fills_it(self) -> None:
        seen = book(())
        for number in range(MOST + 5):
            seen.refused("GCSB", f"message {number}", "unknown message")
            seen.would(101.0, "would LAND")
            seen.aborted("GCSA", "GCSB", 101.0, 1.0, "cancelled")
        entry = seen.entry(101.0)
        assert [len(entry[kind]) for kind in ("refused", "would", "handovers")] == [MOST] * 3
        assert entry["left_out"] == 15

    def test_what_would_have_been_done(self) -> None:
        seen = book(())
        seen.saw(130.0, "no zone", HERE, [])
        seen.would(131.0, "would RETURN to home. Out of coverage")
        assert seen.lines(140.0)[-1] == "31 s, no zone: would RETURN to home. Out of coverage"

    def test_nothing_is_said_too(self) -> None:
        assert book(()).lines(140.0)[-1] == "nothing would have been commanded"

    @pytest.mark.parametrize("restarted", [False, True])
    def test_how_it_ended(self, restarted: bool) -> None:
        seen = RehearsalStats(100.0, (), restarted=restarted)
        assert seen.lines(110.0)[0] == "rehearsal under way, 10 s" + (", seen since a restart" if restarted else "")
        seen.end(160.0, "ended by GCSA")
        assert seen.over
        assert seen.lines(500.0)[0].startswith("rehearsal ended by GCSA, 60 s")
        assert (seen.entry(500.0)["over"], seen.entry(500.0)["restarted"]) == (True, restarted)

    def test_the_lines_fit_the_message(self) -> None:
        """120 bytes each."""
        seen = book()
        seen.saw(1e5, "GCSA+GCSB", HERE, [LinkSeen("GCSA", "udpout:192.168.100.100:14551", 123.4, 0.123, 12.345)])
        seen.handover("GCSA", "GCSB", 1e5, 12.345, "zone ends", distance_m)
        assert max(len(line.encode()) for line in seen.lines(1e5)) <= 120
