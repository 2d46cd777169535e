# SPDX-License-Identifier: GPL-3.0-or-later

"""The queue of events: one at a time, in the order of appending, in time that never goes back."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mavproxy_handover.companion.event_queue import EventQueue
from mavproxy_handover.core.common.events import Cancel, Event


class Handler:
    """Notes what is handled. `follows`: what is appended while the event of a number is handled, with its time."""

    def __init__(self, follows: dict[int, list[tuple[int, float]]]) -> None:
        self.follows = follows
        self.seen: list[tuple[str, int | None, float]] = []
        self.breaks: set[int] = set()
        self.clears: set[int] = set()
        self.queue = EventQueue(self.handle, self.emptied)

    def put(self, number: int, now: float) -> None:
        self.queue.put(Cancel(number), now)

    def handle(self, event: Event, now: float) -> None:
        assert isinstance(event, Cancel)
        number = event.station
        self.seen.append(("begin", number, now))
        for follower, at in self.follows.get(number, []):
            self.put(follower, at)
        if number in self.clears:
            self.queue.clear()
        if number in self.breaks:
            raise RuntimeError("a bug")
        self.seen.append(("end", number, now))

    def emptied(self, now: float) -> None:
        self.seen.append(("empty", None, now))


def test_an_event_that_is_appended_comes_after_the_one_that_is_handled_and_before_put_returns() -> None:
    handler = Handler({1: [(2, 5.0), (3, 5.0)], 2: [(4, 5.0)]})
    handler.put(1, 5.0)
    assert [(what, number) for what, number, _now in handler.seen] == [
        *(("begin", 1), ("end", 1)),
        *(("begin", 2), ("end", 2)),
        *(("begin", 3), ("end", 3)),
        *(("begin", 4), ("end", 4)),
        ("empty", None),
    ]


def test_each_event_keeps_its_time_and_time_never_goes_back() -> None:
    handler = Handler({1: [(2, 7.0), (3, 6.0)]})
    handler.put(1, 5.0)
    handler.put(4, 6.5)
    handler.put(5, 8.0)
    assert [now for what, _number, now in handler.seen if what == "begin"] == [5.0, 7.0, 7.0, 7.0, 8.0]


def test_what_waits_is_dropped_when_the_queue_is_cleared() -> None:
    handler = Handler({1: [(2, 5.0), (3, 5.0)]})
    handler.clears = {1}
    handler.put(1, 5.0)
    assert handler.seen == [("begin", 1, 5.0), ("end", 1, 5.0), ("empty", None, 5.0)]


def test_after_an_exception_what_waits_is_handled_before_the_next_event() -> None:
    handler = Handler({1: [(2, 5.0)]})
    handler.breaks = {1, 3}
    with pytest.raises(RuntimeError):
        handler.put(1, 5.0)
    handler.put(4, 6.0)
    with pytest.raises(RuntimeError):
        handler.put(3, 7.0)
    assert handler.seen == [
        ("begin", 1, 5.0),
        *(("begin", 2, 5.0), ("end", 2, 5.0)),
        *(("begin", 4, 6.0), ("end", 4, 6.0)),
        ("empty", None, 6.0),
        ("begin", 3, 7.0),
        ("empty", None, 7.0),
    ]


def test_what_is_appended_when_the_queue_is_empty_is_handled_too() -> None:
    seen: list[int | None] = []
    rest = [Cancel(2)]

    def emptied(now: float) -> None:
        seen.append(None)
        while rest:
            queue.put(rest.pop(), now)

    queue: EventQueue[float] = EventQueue(lambda event, _now: seen.append(getattr(event, "station", 0)), emptied)
    queue.put(Cancel(1), 5.0)
    assert seen == [1, None, 2, None]


@given(
    st.lists(st.tuples(st.integers(0, 20), st.floats(0.0, 100.0)), min_size=1, max_size=20),
    st.dictionaries(st.integers(0, 20), st.lists(st.tuples(st.integers(21, 40), st.floats(0.0, 100.0)), max_size=4)),
    st.dictionaries(st.integers(21, 40), st.lists(st.tuples(st.integers(41, 60), st.floats(0.0, 100.0)), max_size=3)),
)
def test_whatever_is_appended_by_whatever_is_handled_one_at_a_time_in_order(
    given_events: list[tuple[int, float]],
    first: dict[int, list[tuple[int, float]]],
    second: dict[int, list[tuple[int, float]]],
) -> None:
    """Expected is what a list says to which each event adds its followers at the end."""
    follows = first | second
    handler = Handler(follows)
    expected: list[int] = []
    for number, now in given_events:
        handler.put(number, now)
        waiting = [number]
        for each in waiting:
            expected.append(each)
            waiting += [follower for follower, _at in follows.get(each, [])]
    steps = [step for step in handler.seen if step[0] != "empty"]
    assert [number for what, number, _now in steps if what == "begin"] == expected
    assert [what for what, _number, _now in steps] == ["begin", "end"] * len(expected)
    times = [now for _what, _number, now in steps]
    assert times == sorted(times)
    assert sum(what == "empty" for what, _number, _now in handler.seen) == len(given_events)
