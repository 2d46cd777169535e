# SPDX-License-Identifier: GPL-3.0-or-later

"""The one copy of the autopilot's parameters: what counts, how old it is, and what a later reading no longer finds."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.vehicle.parameters import Parameter, Parameters

REAL32, INT8 = mavlink.MAV_PARAM_TYPE_REAL32, mavlink.MAV_PARAM_TYPE_INT8


def told(name: str, value: float, kind: int = REAL32) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_param_value_message(name.encode("ascii"), value, kind, 900, 65535)


@pytest.fixture
def parameters() -> Parameters:
    return Parameters()


def test_a_parameter_has_its_value_its_type_and_its_time(parameters: Parameters) -> None:
    parameters.on_value(told("FENCE_TYPE", 7.0, INT8), 12.5)
    assert parameters.get("FENCE_TYPE") == Parameter(7.0, 2, 12.5)
    assert parameters.get("FENCE_RADIUS") is None


def test_what_is_told_again_is_younger_and_a_change_only_if_it_differs(parameters: Parameters) -> None:
    parameters.on_value(told("RTL_ALT", 3000.0), 1.0)
    parameters.on_value(told("RTL_ALT", 3000.0), 5.0)
    assert parameters.get("RTL_ALT") == Parameter(3000.0, 9, 5.0)
    assert parameters.changes == 1
    parameters.on_value(told("RTL_ALT", 2500.0), 6.0)
    assert parameters.changes == 2


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_value_that_is_no_number_leaves_what_was_known(parameters: Parameters, value: float) -> None:
    parameters.on_value(told("RTL_ALT", 3000.0), 1.0)
    parameters.on_value(told("RTL_ALT", value), 2.0)
    assert parameters.get("RTL_ALT") == Parameter(3000.0, 9, 1.0)


def test_what_a_later_reading_does_not_find_is_not_among_its_values(parameters: Parameters) -> None:
    parameters.on_value(told("HNDO_ENABLE", 1.0), 1.0)
    parameters.on_value(told("RTL_ALT", 3000.0), 1.0)
    parameters.on_value(told("RTL_ALT", 3000.0), 9.0)
    assert dict(parameters.since()) == {"HNDO_ENABLE": 1.0, "RTL_ALT": 3000.0}
    assert dict(parameters.since(8.0)) == {"RTL_ALT": 3000.0}
    assert parameters.since(8.0).get("HNDO_ENABLE") is None
    assert "HNDO_ENABLE" not in parameters.since(8.0)
    assert len(parameters.since(8.0)) == 1
    assert not parameters.since(10.0)


def test_values_show_what_is_told_after_they_were_taken(parameters: Parameters) -> None:
    values = parameters.since(3.0)
    parameters.on_value(told("RTL_ALT", 1500.0), 4.0)
    assert values["RTL_ALT"] == 1500.0


def test_made_up_names_take_bounded_memory_and_leave_what_is_known(parameters: Parameters) -> None:
    parameters.on_value(told("RTL_ALT", 3000.0), 1.0)
    for number in range(6000):
        parameters.on_value(told(f"X{number}", 1.0), 2.0)
    assert len(parameters.since()) == 5000
    parameters.on_value(told("RTL_ALT", 2500.0), 3.0)
    assert parameters.since()["RTL_ALT"] == 2500.0


def test_a_reading_counts_from_its_beginning_and_what_it_did_not_find_is_missing(parameters: Parameters) -> None:
    parameters.on_value(told("HNDO_ENABLE", 1.0), 1.0)
    assert parameters.read is None
    parameters.on_value(told("RTL_ALT", 3000.0), 5.0)
    changes = parameters.changes
    parameters.reading_ended(5.0)
    assert parameters.read is not None
    assert dict(parameters.read) == {"RTL_ALT": 3000.0}
    assert parameters.changes == changes + 1, "who judges by it has to look again"
