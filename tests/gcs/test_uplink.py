# SPDX-License-Identifier: GPL-3.0-or-later

"""Which link a station's own messages take: away from silence at once, after the vehicle's telemetry, else stay."""

from __future__ import annotations

from gcs_module.uplink import UplinkSelector

TICK_S = 0.01


class Links:
    """Frames come in at even rates; time goes on."""

    def __init__(self, count: int = 2) -> None:
        self.choice = UplinkSelector()
        self.now = 50.0
        self.received = [0.0] * count
        self.chosen = 0

    def run(self, seconds: float, *rates: float) -> float | None:
        """Seconds until the link was changed; None if it was not."""
        begin = self.now
        changed = None
        for _ in range(round(seconds / TICK_S)):
            self.now += TICK_S
            self.received = [count + rate * TICK_S for count, rate in zip(self.received, rates, strict=True)]
            chosen = self.choice.choose([int(count) for count in self.received], self.chosen, self.now)
            if chosen != self.chosen and changed is None:
                changed = self.now - begin
            self.chosen = chosen
        return changed


def test_a_silent_link_is_left_within_a_second() -> None:
    links = Links()
    assert links.run(5.0, 60, 10) is None
    left = links.run(2.0, 0, 10)
    assert left is not None
    assert 0.5 < left < 0.8
    assert links.chosen == 1


def test_the_first_link_may_be_dead_from_the_beginning() -> None:
    links = Links()
    left = links.run(2.0, 0, 60)
    assert left is not None
    assert left < 1.0


def test_the_station_follows_the_vehicles_telemetry() -> None:
    """Only the way up is cut: by the station's own count nothing is wrong, but the vehicle has moved."""
    links = Links()
    links.run(5.0, 60, 10)
    followed = links.run(3.0, 10, 60)
    assert followed is not None
    assert followed < 0.6
    assert links.chosen == 1


def test_between_links_that_are_equally_good_the_operators_choice_stands() -> None:
    links = Links()
    assert links.run(10.0, 30, 35) is None
    links.chosen = 1
    assert links.run(10.0, 35, 30) is None


def test_it_does_not_go_back_by_itself_to_a_link_that_is_only_back() -> None:
    links = Links()
    links.run(5.0, 60, 10)
    links.run(2.0, 0, 60)
    assert links.chosen == 1
    assert links.run(10.0, 10, 60) is None


def test_heartbeats_once_a_second_are_not_mistaken_for_a_dead_link() -> None:
    links = Links()
    assert links.run(20.0, 1, 1) is None


def test_all_links_silent_is_no_reason_to_move() -> None:
    links = Links()
    links.run(5.0, 60, 10)
    assert links.run(10.0, 0, 0) is None


def test_links_may_be_added_and_removed() -> None:
    links = Links(1)
    links.run(3.0, 60)
    links.received = [links.received[0], 0.0]
    assert links.run(3.0, 60, 10) is None
    links.received = [links.received[1]]
    links.chosen = 1
    assert links.run(3.0, 10) is None  # what the setting names is gone; MAVProxy itself falls back to the first
