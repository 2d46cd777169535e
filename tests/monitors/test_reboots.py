# SPDX-License-Identifier: GPL-3.0-or-later

"""The autopilot's time since its start goes back: it has started again."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from mavproxy_handover.monitors.reboots import RebootMonitor


def at(boot_ms: int) -> SimpleNamespace:
    return SimpleNamespace(time_boot_ms=boot_ms)


@pytest.mark.parametrize(
    ("times", "restarts"),
    [
        ([1000, 2000, 3000], 0),
        ([500_000, 498_500, 501_000], 0),  # two messages in the wrong order
        ([500_000, 3000, 4000], 1),
        ([500_000, 3000, 40_000, 100], 2),
        ([0xFFFFFF00, 0xFFFFFFFF, 40, 1000], 0),  # 49.7 days
        ([3000], 0),
    ],
)
def test_a_time_that_goes_back_is_a_restart(times: list[int], restarts: int) -> None:
    monitor = RebootMonitor()
    assert sum(monitor.seen(at(ms), flying=True, now=float(n)) for n, ms in enumerate(times)) == restarts


def test_a_message_without_the_time_says_nothing() -> None:
    monitor = RebootMonitor()
    monitor.seen(at(500_000), flying=True, now=1.0)
    assert not monitor.seen(SimpleNamespace(), flying=True, now=2.0)
    assert monitor.seen(at(10), flying=False, now=3.0)


@pytest.mark.parametrize(("flown_at", "now", "in_flight"), [(None, 5.0, False), (1.0, 5.0, True), (1.0, 62.0, False)])
def test_it_was_in_flight_if_the_aircraft_flew_until_just_now(
    flown_at: float | None, now: float, in_flight: bool
) -> None:
    monitor = RebootMonitor()
    if flown_at is not None:
        monitor.seen(at(1), flying=True, now=flown_at)
    assert monitor.in_flight(now) is in_flight
