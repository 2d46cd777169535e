# SPDX-License-Identifier: GPL-3.0-or-later

"""Telemetry for observers: thinned, bounded, answered, and never asked of the autopilot."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.gate.observers import ALWAYS, DEFAULTS, STREAMS, WISHES, ObserverLimits, ObserverRates
from mavproxy_handover.wire.frames import Frame

GCSA, GCSB = 251, 252
ACCEPTED, DENIED = 0, 2
ATTITUDE, GLOBAL_POSITION_INT, VFR_HUD, PARAM_VALUE = 30, 33, 74, 22

Make = Callable[..., Frame]


@pytest.fixture
def rates() -> ObserverRates:
    return ObserverRates()


def want(make: Make, msgid: float, interval_us: float, name: str = "COMMAND_LONG") -> Frame:
    return make(name, sysid=GCSA, compid=77, command=511, param1=float(msgid), param2=float(interval_us))


def ask(make: Make, msgid: float, name: str = "COMMAND_LONG") -> Frame:
    return make(name, sysid=GCSA, compid=77, command=510, param1=float(msgid))


def stream(make: Make, group: int, rate_hz: int, start: int = 1) -> Frame:
    return make("REQUEST_DATA_STREAM", req_stream_id=group, req_message_rate=rate_hz, start_stop=start)


def passed(rates: ObserverRates, frame: Frame, times: list[float], station: int = GCSA) -> list[float]:
    return [t for t in times if rates.due(frame, station, t)]


def every(step_s: float, until_s: float) -> list[float]:
    return [round(number * step_s, 6) for number in range(int(until_s / step_s))]


# ---- what everybody hears -------------------------------------------------------------------------------------------


def test_without_asking_position_comes_five_times_a_second_and_the_battery_once(
    rates: ObserverRates, make: Make
) -> None:
    twenty_hz = every(0.05, 10.0)  # the last one is early, as it may be
    assert len(passed(rates, make("GLOBAL_POSITION_INT", sysid=1, compid=1), twenty_hz)) == 50 + 1
    assert len(passed(rates, make("SYS_STATUS", sysid=1, compid=1), twenty_hz)) == 10 + 1
    assert passed(rates, make("ATTITUDE", sysid=1, compid=1), twenty_hz) == []


def test_what_is_rare_or_vital_is_never_thinned(rates: ObserverRates, make: Make) -> None:
    vital = ("HEARTBEAT", "AUTHORITY_STATUS", "CONTROL_STATUS", "STATUSTEXT")
    assert (*vital, "ADSB_VEHICLE", "COLLISION", "OPEN_DRONE_ID_ARM_STATUS") == ALWAYS
    for name in ALWAYS:
        assert passed(rates, make(name, sysid=1), [0.0, 0.0, 0.001]) == [0.0, 0.0, 0.001]


def test_each_battery_and_each_component_has_an_interval_of_its_own(rates: ObserverRates, make: Make) -> None:
    first, second = (make("BATTERY_STATUS", sysid=1, compid=1, id=number) for number in (0, 1))
    other = make("BATTERY_STATUS", sysid=1, compid=180, id=0)
    for now in (0.0, 1.0, 2.0):
        assert [rates.due(frame, GCSA, now) for frame in (first, second, other, first)] == [True, True, True, False]


def test_a_sender_that_is_not_punctual_loses_no_messages(rates: ObserverRates, make: Make) -> None:
    """One a second is wanted, one a second comes, a tenth of a second early or late."""
    jitter = [0.0, 0.1, -0.1, 0.05, -0.1, 0.1, 0.0, -0.05, -0.1, 0.1]
    times = [number + jitter[number % 10] for number in range(1, 101)]
    assert len(passed(rates, make("SYS_STATUS", sysid=1, compid=1), times)) == 100


def test_a_quarter_of_the_interval_early_is_early_enough(rates: ObserverRates, make: Make) -> None:
    frame = make("SYS_STATUS", sysid=1, compid=1)
    assert passed(rates, frame, [0.0, 0.74, 0.75, 1.74, 1.75]) == [0.0, 0.75, 1.75]


def test_a_pause_is_not_made_up_for(rates: ObserverRates, make: Make) -> None:
    frame = make("SYS_STATUS", sysid=1, compid=1)
    assert passed(rates, frame, [0.0, 100.0, 100.1, 100.4, 100.6, 101.4, 101.6]) == [0.0, 100.0, 100.6, 101.6]


# ---- wishes ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["COMMAND_LONG", "COMMAND_INT"])
def test_a_wish_is_acknowledged_and_kept_to(rates: ObserverRates, make: Make, name: str) -> None:
    (ack,) = rates.asked(want(make, ATTITUDE, 500_000, name), GCSA, 0.0)
    assert (ack.get_type(), ack.command, ack.result) == ("COMMAND_ACK", 511, ACCEPTED)
    assert (ack.target_system, ack.target_component) == (GCSA, 77)
    assert (ack.progress, ack.result_param2) == (0, 0)
    frame = make("ATTITUDE", sysid=1, compid=1)
    assert len(passed(rates, frame, every(0.1, 10.0))) == 20 + 1
    assert passed(rates, frame, every(0.1, 10.0), GCSB) == []


def test_a_wish_can_slow_down_and_switch_off_what_everybody_hears(rates: ObserverRates, make: Make) -> None:
    frame = make("GLOBAL_POSITION_INT", sysid=1, compid=1)
    rates.asked(want(make, GLOBAL_POSITION_INT, 1_000_000), GCSA, 0.0)
    assert len(passed(rates, frame, every(0.1, 10.0))) == 10 + 1
    rates.asked(want(make, GLOBAL_POSITION_INT, -1), GCSA, 10.0)
    assert passed(rates, frame, [20.0, 21.0]) == []
    rates.asked(want(make, GLOBAL_POSITION_INT, 0), GCSA, 21.0)  # back to the default
    assert len(passed(rates, frame, [22.0 + t for t in every(0.1, 10.0)])) == 50 + 1


@pytest.mark.parametrize("msgid", [PARAM_VALUE, 0, 253, 385, 110, 47105, 99999, -1, 30.5, float("nan"), float("inf")])
def test_nothing_but_harmless_telemetry_can_be_wished_for(rates: ObserverRates, make: Make, msgid: float) -> None:
    """Parameters, heartbeats, texts, tunnels, files, our own messages, and what is no message."""
    (ack,) = rates.asked(want(make, msgid, 100_000), GCSA, 0.0)
    assert (ack.command, ack.result) == (511, DENIED)
    assert not rates.due(make("PARAM_VALUE", sysid=1, compid=1), GCSA, 1.0)


@pytest.mark.parametrize("interval_us", [-2.0, float("nan"), float("inf"), -float("inf")])
def test_intervals_that_mean_nothing_are_denied(rates: ObserverRates, make: Make, interval_us: float) -> None:
    (ack,) = rates.asked(want(make, ATTITUDE, interval_us), GCSA, 0.0)
    assert ack.result == DENIED
    assert not rates.due(make("ATTITUDE", sysid=1, compid=1), GCSA, 0.0)


@pytest.mark.parametrize("name", ["COMMAND_LONG", "COMMAND_INT"])
@pytest.mark.parametrize(
    ("msgid", "told_us"),
    [
        (GLOBAL_POSITION_INT, 200_000),
        (ATTITUDE, 250_000),
        (VFR_HUD, -1),
        (PARAM_VALUE, 0),
        (0, 0),
        (ATTITUDE + 1, 100_000),
    ],
)
def test_the_interval_told_is_the_one_that_is_kept_to(
    rates: ObserverRates, make: Make, name: str, msgid: int, told_us: int
) -> None:
    rates.asked(want(make, ATTITUDE, 250_000), GCSA, 0.0)
    rates.asked(want(make, ATTITUDE + 1, 1.0), GCSA, 0.0)  # a million a second: what is granted is 10
    ack, told = rates.asked(ask(make, msgid, name), GCSA, 0.0)
    assert (ack.command, ack.result, ack.target_system, ack.target_component) == (510, ACCEPTED, GCSA, 77)
    assert (told.get_type(), told.message_id, told.interval_us) == ("MESSAGE_INTERVAL", msgid, told_us)


def test_an_interval_too_long_to_tell_is_told_as_the_longest(rates: ObserverRates, make: Make) -> None:
    rates.asked(want(make, ATTITUDE, 1e30), GCSA, 0.0)
    _ack, told = rates.asked(ask(make, ATTITUDE), GCSA, 0.0)
    assert told.interval_us == 0x7FFFFFFF
    assert told.pack(mavlink.MAVLink(None))


def test_a_long_interval_is_told_to_the_microsecond(rates: ObserverRates, make: Make) -> None:
    rates.asked(want(make, ATTITUDE, 60_000_000), GCSA, 0.0)
    _ack, told = rates.asked(ask(make, ATTITUDE), GCSA, 0.0)
    assert told.interval_us == 60_000_000


def test_the_interval_of_what_is_no_message_is_denied(rates: ObserverRates, make: Make) -> None:
    for msgid in (99999.0, -1.0, 0.5, float("nan")):
        (ack,) = rates.asked(ask(make, msgid), GCSA, 0.0)
        assert (ack.command, ack.result) == (510, DENIED)


def test_a_stream_is_a_group_of_wishes_without_an_answer(rates: ObserverRates, make: Make) -> None:
    assert rates.asked(stream(make, 10, 2), GCSA, 0.0) == []
    attitude, hud = make("ATTITUDE", sysid=1, compid=1), make("VFR_HUD", sysid=1, compid=1)
    assert len(passed(rates, attitude, every(0.1, 10.0))) == 20 + 1
    assert passed(rates, hud, [0.0]) == []
    rates.asked(stream(make, 0, 1), GCSA, 10.0)  # all of them
    assert rates.due(hud, GCSA, 10.0)
    rates.asked(stream(make, 10, 2, start=0), GCSA, 10.0)
    assert not rates.due(attitude, GCSA, 20.0)
    assert rates.due(hud, GCSA, 20.0)


def test_a_stream_of_rate_zero_is_stopped(rates: ObserverRates, make: Make) -> None:
    rates.asked(stream(make, 11, 5), GCSA, 0.0)
    rates.asked(stream(make, 11, 0), GCSA, 0.0)
    assert not rates.due(make("VFR_HUD", sysid=1, compid=1), GCSA, 1.0)


def test_unknown_streams_and_other_messages_change_nothing(rates: ObserverRates, make: Make) -> None:
    for group in (4, 5, 13, 255):
        assert rates.asked(stream(make, group, 5), GCSA, 0.0) == []
    assert rates.asked(make("PARAM_SET"), GCSA, 0.0) == []
    assert rates.asked(make("COMMAND_LONG", command=400), GCSA, 0.0) == []
    assert rates.asked(Frame(b"", 2, 76, GCSA, 1, 0, False, b"", False), GCSA, 0.0) == []
    for name in WISHES:
        assert not rates.due(make(name, sysid=1, compid=1), GCSA, 1.0), name


# ---- bounds ---------------------------------------------------------------------------------------------------------


def test_no_message_comes_more_often_than_the_limit(make: Make) -> None:
    rates = ObserverRates(ObserverLimits(message_hz=4.0))
    rates.asked(want(make, ATTITUDE, 1_000), GCSA, 0.0)
    assert len(passed(rates, make("ATTITUDE", sysid=1, compid=1), every(0.01, 10.0))) == pytest.approx(40, abs=1)


def test_all_wishes_together_stay_under_the_limit_in_bytes_and_the_default_set_is_not_their_victim(make: Make) -> None:
    rates = ObserverRates(ObserverLimits(message_hz=50.0, bytes_per_s=1000.0))
    rates.asked(stream(make, 0, 50), GCSA, 0.0)
    rates.asked(want(make, GLOBAL_POSITION_INT, 0), GCSA, 0.0)
    fields = {"ATTITUDE": {"roll": 1.0, "yawspeed": 1.0}, "VFR_HUD": {"climb": 1.0, "throttle": 99}}
    frames = [make(name, sysid=1, compid=1, **values) for name, values in fields.items()]
    position = make("GLOBAL_POSITION_INT", sysid=1, compid=1, lat=1, lon=1, hdg=9)
    sent, positions = 0, 0
    for now in every(0.02, 20.0):
        sent += sum(len(frame.raw) for frame in frames if rates.due(frame, GCSA, now))
        positions += rates.due(position, GCSA, now)
    assert sent == pytest.approx(21_000, rel=0.03)  # a second's worth to begin with, then 1000 bytes a second
    assert positions == 100 + 1


def test_what_is_left_of_the_bytes_is_used_up(make: Make) -> None:
    frame = make("ATTITUDE", sysid=1, compid=1, yawspeed=1.0)
    rates = ObserverRates(ObserverLimits(bytes_per_s=len(frame.raw)))
    rates.asked(stream(make, 10, 10), GCSA, 0.0)
    assert passed(rates, frame, [0.0, 0.5, 1.0, 1.5, 2.0]) == [0.0, 1.0, 2.0]


def test_one_stations_wishes_take_nothing_from_another(make: Make) -> None:
    rates = ObserverRates(ObserverLimits(bytes_per_s=100.0))
    for station in (GCSA, GCSB):
        rates.asked(stream(make, 10, 10), station, 0.0)
    frame = make("ATTITUDE", sysid=1, compid=1, yawspeed=1.0)
    assert [t for t in every(0.1, 5.0) if rates.due(frame, GCSA, t)] == passed(rates, frame, every(0.1, 5.0), GCSB)


def test_wishes_end_with_a_long_silence_and_stay_while_the_station_is_heard(rates: ObserverRates, make: Make) -> None:
    frame = make("ATTITUDE", sysid=1, compid=1)
    rates.asked(want(make, ATTITUDE, 1_000_000), GCSA, 0.0)
    rates.note_heard(GCSA, 20.0)
    assert rates.due(frame, GCSA, 50.0)
    assert not rates.due(frame, GCSA, 51.0)
    rates.note_heard(GCSA, 51.0)
    assert not rates.due(frame, GCSA, 52.0)


def test_a_station_that_commands_is_forgotten(rates: ObserverRates, make: Make) -> None:
    rates.asked(want(make, ATTITUDE, 1_000_000), GCSA, 0.0)
    rates.forget(GCSA)
    rates.forget(GCSB)
    assert not rates.due(make("ATTITUDE", sysid=1, compid=1), GCSA, 1.0)


def test_many_sources_of_one_message_do_not_fill_the_memory(rates: ObserverRates, make: Make) -> None:
    for compid in range(1, 256):
        for number in range(5):
            rates.due(make("BATTERY_STATUS", sysid=1, compid=compid, id=number), GCSA, 0.0)
            assert len(rates._observers[GCSA].due_at) <= 512


def test_an_observer_gets_ten_of_a_message_and_four_thousand_bytes_a_second_for_half_a_minute() -> None:
    assert ObserverLimits() == ObserverLimits(message_hz=10.0, bytes_per_s=4000.0, silence_s=30.0)


@pytest.mark.parametrize("name", ["message_hz", "bytes_per_s", "silence_s"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan")])
def test_limits_that_let_nothing_through_are_refused(name: str, value: float) -> None:
    limits: dict[str, Any] = {name: value}
    with pytest.raises(ValueError, match=f"{name} = .*: must be above 0"):
        ObserverLimits(**limits)
    slow: dict[str, Any] = {name: 0.5}
    assert getattr(ObserverLimits(**slow), name) == 0.5


def test_every_stream_is_a_part_of_what_may_be_wished_for() -> None:
    dialect = {cls.msgname for cls in mavlink.mavlink_map.values()}
    grantable = {*DEFAULTS, *WISHES}
    assert grantable <= dialect
    assert len(grantable) == len(DEFAULTS) + len(WISHES)
    for group in STREAMS.values():
        assert set(group) <= grantable
    assert set(STREAMS) <= set(mavlink.enums["MAV_DATA_STREAM"])
    forbidden = {
        "PARAM_VALUE",
        "TUNNEL",
        "FILE_TRANSFER_PROTOCOL",
        "LOG_DATA",
        "COMMAND_ACK",
        "STATUSTEXT",
        "SERIAL_CONTROL",
    }
    assert not grantable & forbidden


@given(st.binary(min_size=33, max_size=33), st.sampled_from(["COMMAND_LONG", "COMMAND_INT", "REQUEST_DATA_STREAM"]))
def test_whatever_is_asked_nothing_raises_and_every_answer_can_be_sent(contents: bytes, name: str) -> None:
    msgid = {"COMMAND_LONG": 76, "COMMAND_INT": 75, "REQUEST_DATA_STREAM": 66}[name]
    size = mavlink.mavlink_map[msgid].unpacker.size
    payload = bytearray(contents.ljust(size, b"\0")[:size])
    rates = ObserverRates()
    for command in (510, 511):
        if name != "REQUEST_DATA_STREAM":
            payload[28:30] = command.to_bytes(2, "little")
        for answer in rates.asked(Frame(b"", 2, msgid, GCSA, 1, 0, False, bytes(payload), True), GCSA, 0.0):
            assert answer.pack(mavlink.MAVLink(None))
