# SPDX-License-Identifier: GPL-3.0-or-later

"""A station that ends while it commands an aircraft in flight offers it to the others first, in bounded time."""

from __future__ import annotations

import threading
import time
from types import SimpleNamespace
from typing import Any

import pytest

from gcs_module import closing as closing_module
from gcs_module.closing import WAIT_S, Closing

NOW = 100.0


class Craft:
    """One aircraft of the station."""

    def __init__(self, name: str = "drone-1", *, flown: bool = True) -> None:
        self.state: Any = SimpleNamespace(flown_from_here=flown)
        self.heard = True
        self.core: Any = SimpleNamespace(vehicle_name=name, vehicle_alive=lambda now: self.heard)
        self.core.control = SimpleNamespace(in_use=False)
        self.core.commander = 251
        self.typed: list[list[str]] = []
        self.commands: Any = SimpleNamespace(run=self.typed.append)


def closing(*crafts: Craft) -> tuple[Closing, list[str]]:
    told: list[str] = []
    return Closing(crafts, told.append), told


def test_nothing_happens_before_it_is_asked() -> None:
    craft = Craft()
    made, told = closing(craft)
    made.tick(NOW)
    assert (craft.typed, told) == ([], [])


def test_the_aircraft_in_flight_are_released_and_it_ends_when_they_are_taken() -> None:
    first, second, grounded = Craft(), Craft("drone-2"), Craft("drone-3", flown=False)
    made, told = closing(first, second, grounded)
    assert made.flown == "drone-1 and drone-2"
    ended: list[bool] = []
    made.ask(lambda: ended.append(True))
    made.tick(NOW)
    assert (first.typed, second.typed, grounded.typed) == ([["release"]], [["release"]], [])
    assert told == ["This station ends, and offers drone-1 and drone-2 to the other stations, for at most 10 s."]
    first.state.flown_from_here = False
    made.tick(NOW + 1.0)
    assert not ended
    second.state.flown_from_here = False
    made.tick(NOW + 2.0)
    made.tick(NOW + 3.0)
    assert (ended, len(told)) == ([True], 1)


@pytest.mark.parametrize("why", ["time", "silence"])
def test_it_ends_though_no_station_takes_it(why: str) -> None:
    craft = Craft()
    made, told = closing(craft)
    ended: list[bool] = []
    made.ask(lambda: ended.append(True))
    made.tick(NOW)
    made.tick(NOW + WAIT_S - 0.1)
    assert not ended
    craft.heard = why != "silence"
    made.tick(NOW + (WAIT_S if why == "time" else WAIT_S - 0.05))
    assert ended == [True]
    assert told[1:] == ["No station has taken drone-1. It loses its commander now, and acts by itself."]


def test_an_aircraft_that_loses_its_commander_meanwhile_was_not_taken() -> None:
    craft = Craft()
    made, told = closing(craft)
    made.ask(lambda: None)
    made.tick(NOW)
    craft.state.flown_from_here, craft.core.commander = False, None
    made.tick(NOW + 1.0)
    assert told[1:] == ["No station has taken drone-1. It loses its commander now, and acts by itself."]


def test_without_our_companion_the_release_is_confirmed() -> None:
    craft = Craft()
    craft.core.control.in_use = True
    made, _told = closing(craft)
    made.ask(lambda: None)
    made.tick(NOW)
    assert craft.typed == [["release"], ["release"]]


def test_on_the_ground_it_ends_at_once() -> None:
    made, told = closing(Craft(flown=False))
    ended: list[bool] = []
    made.ask(lambda: ended.append(True))
    made.tick(NOW)
    assert (ended, told) == ([True], [])


def test_a_main_loop_that_stands_still_keeps_nothing_from_ending(monkeypatch: pytest.MonkeyPatch) -> None:
    made, _told = closing(Craft())
    waited: list[float] = []
    never = SimpleNamespace(wait=lambda seconds: bool(waited.append(seconds)))
    monkeypatch.setattr(made, "_done", never)
    made.wait()
    assert sum(waited) == pytest.approx(closing_module.WAIT_S + closing_module._STALLED_S)
    assert max(waited) <= 0.1, "a signal just before one of them is noticed soon"


def test_the_waiting_thread_goes_on_when_it_is_over() -> None:
    craft = Craft()
    made, _told = closing(craft)
    waits = threading.Thread(target=made.wait)
    waits.start()
    until = time.monotonic() + 10.0
    while not craft.typed and time.monotonic() < until:
        made.tick(NOW)
        time.sleep(0.01)
    craft.state.flown_from_here = False
    made.tick(NOW + 0.1)
    waits.join(5.0)
    assert not waits.is_alive()


def test_a_terminal_that_is_gone_stops_no_release_and_no_end() -> None:
    """SIGHUP is one of the ways to end: the first line may fail."""
    craft = Craft()

    def gone(_text: str) -> None:
        raise OSError(5, "Input/output error")

    made, ended = Closing([craft], gone), list[bool]()
    made.ask(lambda: ended.append(True))
    with pytest.raises(OSError, match="Input/output error"):
        made.tick(NOW)
    assert craft.typed == [["release"]]
    with pytest.raises(OSError, match="Input/output error"):
        made.tick(NOW + WAIT_S)
    assert ended == [True]
    made.tick(NOW + WAIT_S + 1.0)
    assert ended == [True]


def test_a_fault_at_one_aircraft_keeps_no_other_one_from_being_released() -> None:
    first, second = Craft(), Craft("drone-2")

    def fails(_args: list[str]) -> None:
        raise RuntimeError("a fault")

    first.commands.run = fails
    made, told = closing(first, second)
    made.ask(lambda: None)
    with pytest.raises(RuntimeError, match="a fault"):
        made.tick(NOW)
    assert second.typed == [["release"]]
    assert len(told) == 1
