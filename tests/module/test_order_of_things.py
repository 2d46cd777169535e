# SPDX-License-Identifier: GPL-3.0-or-later

"""What comes before what when a station's frame is served: authority first, then the autopilot, then the books."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common import events
from mavproxy_handover.gate.judge import GateReason
from mavproxy_handover.link.autopilot_line import AutopilotLink
from mavproxy_handover.tools.clocks import Clocks
from mavproxy_handover.wire.signing import SignedPeer
from tests.module.conftest import Bench
from tests.module.proxy import Master
from tests.module.vehicle import Station


def speed(metres_per_s: float) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_command_long_message(
        1, 1, mavlink.MAV_CMD_DO_CHANGE_SPEED, 0, 1, metres_per_s, -1, 0, 0, 0, 0
    )


def test_after_a_stall_the_first_frame_is_judged_by_the_authority_there_is_now(bench: Bench) -> None:
    """The commander was silent for too long while nothing ran; its command comes before the first tick."""
    bench.connect()
    link = bench.companion.ports[251].links[0]
    function, argument = bench.mpstate.select_extra[link.fileno()]
    bench.mpstate.mav_master[0].written.clear()
    command = speed(7)
    bench.clock.now += 30.0
    bench.a.send(command)
    function(argument)
    assert bench.companion.view.commander is None
    assert not any(command.get_msgbuf()[10:-2] in raw for raw in bench.mpstate.mav_master[0].written)


def packed(message: mavlink.MAVLink_message) -> mavlink.MAVLink_message:
    """As the autopilot sends it."""
    message.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=1))
    return message


def position() -> mavlink.MAVLink_message:
    return packed(mavlink.MAVLink_global_position_int_message(0, *[1] * 8))


def spied(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The names of the events that the arbiter gets from now on."""
    seen: list[str] = []
    handle = bench.companion.arbiter.handle

    def noted(event: Any, now: float) -> Any:
        seen.append(type(event).__name__)
        return handle(event, now)

    monkeypatch.setattr(bench.companion.arbiter, "handle", noted)
    return seen


def test_a_position_that_waited_through_a_stall_does_not_count(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """It would pass for the present one."""
    bench.connect()
    seen = spied(bench, monkeypatch)
    for stall_s, counts in ((0.1, True), (3.0, False)):
        seen.clear()
        bench.mpstate.deliver(position())
        bench.clock.now += stall_s
        bench.module.idle_task()
        assert ("PositionSeen" in seen) is counts
        assert not bench.companion.autopilot.aircraft.uncompared


def test_a_fresh_position_counts_before_it_is_judged_whether_positions_are_fresh(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench.connect()
    link = bench.companion.ports[251].links[0]
    function, argument = bench.mpstate.select_extra[link.fileno()]
    bench.clock.now += 30.0
    bench.mpstate.deliver(position())
    bench.a.send(speed(7))
    seen = spied(bench, monkeypatch)
    function(argument)
    assert seen.index("PositionSeen") < seen.index("Tick")


def test_a_frame_is_on_its_way_before_anything_is_written_down(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    bench.connect()
    command = speed(7)
    on_its_way: list[bool] = []
    note = bench.companion.journal.note

    def noted(event: str, *arguments: Any, **values: Any) -> None:
        if event == "accepted":
            written = b"".join(bench.mpstate.mav_master[0].written)
            on_its_way.append(bytes(command.get_msgbuf()[10:-2]) in written)
        note(event, *arguments, **values)

    monkeypatch.setattr(bench.companion.journal, "note", noted)
    served(bench, bench.a, command)
    assert on_its_way == [True]


def test_with_a_key_of_the_autopilot_what_cannot_be_signed_goes_there_as_it_is() -> None:
    """MAVLink 1 has no signatures; whether the autopilot takes it is the autopilot's business."""
    master = Master()
    state = SimpleNamespace(mav_master=[master], logqueue=None)
    link = AutopilotLink(
        state, lambda: master, SignedPeer(bytes(range(32))), Clocks(time.time, time.monotonic), lambda _baud: None
    )
    old = bytes(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3).pack(mavlink.MAVLink(None, 251, 190), True))
    assert old[0] == 0xFE
    new = bytes(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3).pack(mavlink.MAVLink(None, 251, 190)))
    link.write(old)
    link.write(new)
    assert master.written[0] == old
    assert (len(master.written[1]), master.written[1][2]) == (len(new) + 13, 1)


# ---- what is noted with the next tick --------------------------------------------------------------------------------


def sticks() -> mavlink.MAVLink_message:
    return mavlink.MAVLink_rc_channels_override_message(1, 1, *[1500] * 8)


def served(bench: Bench, station: Station, *messages: mavlink.MAVLink_message) -> None:
    """The station's frames are read, and nothing else happens."""
    port = bench.companion.ports[station.sysid]
    for message in messages:
        station.send(message)
        bench.module._serve(port, port.links[0], once=True)


def overrides(bench: Bench) -> list[int]:
    """The first channel of every override that went to the autopilot."""
    parser = mavlink.MAVLink(None)
    messages = [parser.decode(bytearray(raw)) for raw in bench.mpstate.mav_master[0].written]
    return [m.chan1_raw for m in messages if m.get_type() == "RC_CHANNELS_OVERRIDE"]


def test_what_the_commander_streams_goes_out_at_once_and_is_counted_with_the_next_tick(bench: Bench) -> None:
    bench.connect()
    bench.autopilot.armed = True
    bench.run(2.0)  # known to be there without sticks
    counts = bench.companion.gate.counts[251]
    before = counts[GateReason.ALLOWED]
    served(bench, bench.a, sticks(), sticks())
    assert overrides(bench) == [1500, 1500]
    assert counts[GateReason.ALLOWED] == before
    bench.companion.tick(bench.clock.now)
    assert counts[GateReason.ALLOWED] == before + 2


@pytest.mark.parametrize("end", ["commander silent", "fault inside"])
def test_sticks_are_released_though_they_had_not_been_noted_yet(bench: Bench, end: str) -> None:
    bench.connect()
    bench.autopilot.armed = True
    bench.run(2.0)
    served(bench, bench.a, sticks())
    if end == "fault inside":
        bench.companion.fail_closed("planted", bench.clock.now)
    else:
        bench.companion.handle(events.Tick(), bench.clock.now + 30.0)
    assert bench.companion.view.commander is None
    assert overrides(bench) == [1500, 0]


def beats(station: Station) -> list[int]:
    """The components whose heartbeats it has heard, in this order."""
    return [m.get_srcComponent() for m in station.received if m.get_type() == "HEARTBEAT" and m.get_srcSystem() == 1]


def test_the_first_heartbeat_that_a_station_hears_is_the_autopilots(bench: Bench) -> None:
    """Flown with MAVSDK 3: it looks for the autopilot when the vehicle is heard first, and never again."""
    bench.autopilot.silent = True
    assert bench.load() is not None
    bench.run(1.3)
    bench.autopilot.silent = False
    bench.run(0.5)
    for station in (bench.a, bench.b):
        assert beats(station)[:2] == [1, 191]


def test_whenever_a_station_begins_to_hear_the_autopilots_heartbeat_is_next(bench: Bench) -> None:
    """Ours follows it at once: there is hardly a moment at which ours would be the first to be heard."""
    bench.connect()
    for place in range(10):
        bench.run(0.35)
        bench.b.received.clear()
        bench.until(lambda: beats(bench.b))
        assert beats(bench.b)[0] == 1, f"the {place}th time"
    bench.a.received.clear()
    bench.run(10.0)
    heard = beats(bench.a)
    assert len(heard) > 16
    assert heard == [1, 191] * (len(heard) // 2)


def test_a_companion_whose_autopilot_is_silent_is_heard_all_the_same(bench: Bench) -> None:
    bench.connect()
    bench.autopilot.silent = True
    bench.run(0.5)
    bench.a.received.clear()
    bench.run(10.0)
    assert beats(bench.a) == [191] * 5, "every other second"


def test_an_autopilot_that_beats_often_makes_the_companion_beat_no_more(bench: Bench) -> None:
    bench.connect()
    bench.each_round = lambda: bench.mpstate.deliver(packed(mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 3, 3)))
    bench.a.received.clear()
    bench.until(lambda: 191 in beats(bench.a))
    bench.a.received.clear()
    bench.run(9.6)
    assert beats(bench.a).count(1) > 150
    assert beats(bench.a).count(191) == 10, "one in 0.9 s"
