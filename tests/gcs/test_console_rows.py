# SPDX-License-Identifier: GPL-3.0-or-later

"""MAVProxy's own rows of its console: what is not updated any more is marked, and says so."""

from __future__ import annotations

from gcs_module.console_rows import ConsoleRows
from tests.module.proxy import Console


class Bench:
    """A console with MAVProxy's rows, which it fills as it would with no message yet."""

    def __init__(self) -> None:
        self.console = Console()
        self.now = 100.0
        self.rows = ConsoleRows(lambda: self.console, lambda: self.now, lambda: "")
        self.rows.tick(self.now)
        self.console.set_status("Alt", "Alt ---", row=2)

    def run(self, seconds: int, **values: str) -> None:
        """A second is a look; what is given is updated in each."""
        for _ in range(seconds):
            self.now += 1.0
            for name, text in values.items():
                self.console.set_status(name, text, row=2)
            self.rows.tick(self.now)


def test_values_that_are_not_updated_for_three_seconds_are_grey_in_brackets_with_their_age() -> None:
    bench = Bench()
    bench.run(2, Alt="Alt 40m", Roll="Roll 0")
    bench.run(3, Roll="Roll 1")
    assert bench.console.looks["Alt"] == ("Alt 40m", "black", "white")
    bench.run(1, Roll="Roll 1")
    assert bench.console.looks["Alt"] == ("[Alt 40m]", "grey", "white")
    assert bench.console.looks["Roll"] == ("Roll 1", "black", "white")
    assert bench.console.looks["HANDOVER OLD"] == ("Values in [ ] are old: 4 s.", "black", "yellow")
    bench.run(60, Roll="Roll 1")
    assert bench.console.statuses["HANDOVER OLD"] == "Values in [ ] are old: 64 s."


def test_a_value_that_is_updated_again_is_as_it_was_and_nothing_is_said_of_age() -> None:
    bench = Bench()
    bench.run(1, Alt="Alt 40m")
    bench.run(10)
    bench.run(1, Alt="Alt 41m")
    assert bench.console.looks["Alt"] == ("Alt 41m", "black", "white")
    assert bench.console.statuses["HANDOVER OLD"] == ""


def test_the_same_value_again_is_an_update() -> None:
    bench = Bench()
    bench.run(20, Alt="Alt 40m")
    assert bench.console.looks["Alt"] == ("Alt 40m", "black", "white")


def test_what_was_never_known_is_not_marked_nor_what_is_no_measured_value() -> None:
    bench = Bench()
    bench.console.set_status("Params", "Param 1371/1371", row=3)
    bench.run(20)
    assert (bench.console.statuses["Alt"], bench.console.statuses["Params"]) == ("Alt ---", "Param 1371/1371")
    assert "HANDOVER OLD" not in bench.console.statuses


def test_colours_of_a_value_come_back() -> None:
    bench = Bench()
    bench.console.set_status("GPS", "GPS: OK6 (10)", row=0, fg="green")
    bench.run(5)
    assert bench.console.looks["GPS"] == ("[GPS: OK6 (10)]", "grey", "white")
    bench.rows.release()
    assert bench.console.looks["GPS"] == ("GPS: OK6 (10)", "green", "white")
    assert bench.console.statuses["HANDOVER OLD"] == ""


def test_the_time_of_a_flight_that_is_over_is_not_old() -> None:
    bench = Bench()
    bench.console.set_status("FlightTime", "FlightTime 3:20", row=3)
    bench.run(10, Alt="Alt 0m")
    assert bench.console.statuses["FlightTime"] == "FlightTime 3:20"
    bench.run(5)
    assert bench.console.statuses["FlightTime"] == "[FlightTime 3:20]"


def test_a_value_of_which_half_is_known_is_marked() -> None:
    bench = Bench()
    bench.run(1, AGL="AGL ---/40m")
    bench.run(5)
    assert bench.console.statuses["AGL"] == "[AGL ---/40m]"


def test_every_link_has_its_row() -> None:
    bench = Bench()
    bench.console.set_status("Link1", "Link 1 OK 100.0% (10426 pkts, 0 lost, 0.00s delay)", row=1, fg="green")
    bench.run(5)
    assert bench.console.statuses["Link1"] == "[Link 1 OK 100.0% (10426 pkts, 0 lost, 0.00s delay)]"


def test_why_an_observer_gets_no_values_is_said() -> None:
    bench = Bench()
    bench.rows = ConsoleRows(lambda: bench.console, lambda: bench.now, lambda: "GCSB commands and gets them all.")
    bench.run(1)
    bench.run(1, Alt="Alt 40m")
    bench.run(5)
    assert bench.console.statuses["HANDOVER OLD"] == "Values in [ ] are old: 5 s. GCSB commands and gets them all."


def test_a_console_that_is_loaded_anew_is_followed_and_given_back_as_it_was() -> None:
    bench = Bench()
    first = bench.console
    bench.run(1, Alt="Alt 40m")
    bench.console = Console()
    bench.run(2, Alt="Alt 40m")
    bench.run(5)
    assert (first.statuses["Alt"], bench.console.statuses["Alt"]) == ("Alt 40m", "[Alt 40m]")
    bench.rows.release()
    assert "set_status" not in vars(first)
    assert "set_status" not in vars(bench.console)


def test_one_that_is_put_in_its_place_by_somebody_else_stays() -> None:
    bench = Bench()
    bench.run(1)

    def others(name: str, text: str = "", row: int = 0, fg: str = "black", bg: str = "white") -> None:
        """Another module's."""

    bench.console.set_status = others  # type: ignore[method-assign]
    bench.rows.release()
    assert bench.console.set_status is others
