# SPDX-License-Identifier: GPL-3.0-or-later

"""Parameters that the companion reads by name: the autopilot's answers are for it alone."""

from __future__ import annotations

from pymavlink.dialects.v20 import handover as mavlink

from tests.module.conftest import Bench

READ = {"FS_OPTIONS": 8.0, "FENCE_ENABLE": 1.0, "BATT_MONITOR": 4.0}


def values(bench: Bench) -> list[tuple[str, float]]:
    """What GCSA, which commands, was told of parameters."""
    return [(m.param_id, m.param_value) for m in bench.a.got("PARAM_VALUE")]


def reads(bench: Bench) -> list[str]:
    """What the companion has asked for by name."""
    return [m.param_id for m in bench.autopilot.got("PARAM_REQUEST_READ", 1)]


def test_no_station_hears_what_the_companion_reads_before_a_flight(bench: Bench) -> None:
    """The fault: each answer has the index 65535, by which MAVSDK 3 waited for ever for another parameter."""
    bench.autopilot.parameters.update(READ)
    bench.connect()
    bench.until(lambda: set(READ) <= set(reads(bench)))
    bench.run(3.0)
    assert values(bench) == []


def test_a_station_that_reads_or_sets_a_parameter_is_answered(bench: Bench) -> None:
    bench.autopilot.parameters.update(READ)
    bench.connect()
    bench.until(lambda: set(READ) <= set(reads(bench)))
    bench.a.send(mavlink.MAVLink_param_request_read_message(1, 1, b"FS_OPTIONS", -1))
    bench.run(0.5)
    assert values(bench) == [("FS_OPTIONS", 8.0)]
    bench.a.send(mavlink.MAVLink_param_set_message(1, 1, b"FENCE_ENABLE", 1.0, 2))
    bench.run(0.5)
    assert values(bench)[1:] == [("FENCE_ENABLE", 1.0)]
