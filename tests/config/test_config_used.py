# SPDX-License-Identifier: GPL-3.0-or-later

"""That the companion keeps to the limits of the configuration, and not to the defaults."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.companion import commands as vehicle_commands
from mavproxy_handover.companion import module as vehicle_module
from tests.module.conftest import Bench, Clock

Make = Callable[[str], Bench]
ATTITUDE = mavlink.MAVLINK_MSG_ID_ATTITUDE
SET, GET = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAV_CMD_GET_MESSAGE_INTERVAL


@pytest.fixture
def make(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Make]:
    """A bench whose configuration has a few lines more."""
    benches: list[Bench] = []

    def make(more: str) -> Bench:
        clock = Clock()
        monkeypatch.setattr(vehicle_module, "time", clock)
        monkeypatch.setattr(vehicle_commands, "time", clock)
        monkeypatch.setattr(vehicle_module, "_last", {})
        bench = Bench(tmp_path, clock)
        bench.config.write_text(bench.config.read_text() + more)
        benches.append(bench)
        bench.connect()
        return bench

    yield make
    for bench in benches:
        bench.close()
        assert bench.mpstate.escaped == []


def weak_after_s(bench: Bench) -> float | None:
    """GCSB falls silent: how long until the companion calls its link bad, within 5 s."""
    bench.b.alive = False
    silent_at = bench.clock.now
    while bench.clock.now < silent_at + 5.0:
        bench.run(0.05)
        if any(entry["measure"] == "silence" and entry["station"] == "GCSB" for entry in bench.journal("link")):
            return bench.clock.now - silent_at
    return None


def test_silence_of_a_link_is_judged_by_the_configured_limit(make: Make) -> None:
    after_s = weak_after_s(make("[links]\nsilence_s = 1.5\n"))
    # the last heartbeat is up to a second old when the station falls silent, and links are looked at now and then
    assert after_s is not None
    assert 0.5 <= after_s <= 2.0


def test_a_patient_limit_is_kept_to_as_well(make: Make) -> None:
    assert weak_after_s(make("[links]\nsilence_s = 20\n")) is None


def test_an_observer_is_granted_what_the_configuration_allows(make: Make) -> None:
    bench = make("[observers]\nmessage_hz = 4\n")
    bench.b.command(SET, ATTITUDE, 10_000)  # 100 Hz
    bench.b.command(GET, ATTITUDE)
    bench.run(0.3)
    assert bench.b.acks(SET) == [mavlink.MAV_RESULT_ACCEPTED]
    assert [(m.message_id, m.interval_us) for m in bench.b.got("MESSAGE_INTERVAL")] == [(ATTITUDE, 250_000)]
