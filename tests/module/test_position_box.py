# SPDX-License-Identifier: GPL-3.0-or-later

"""The position box in the companion: whose position counts, when it does not, and that everybody is told."""

from __future__ import annotations

import contextlib
import math
import socket
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as stock
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.mission.geodesy import offset
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.wire.box_layout import FULL, BoxRecord
from tests.module.conftest import Bench, Clock
from tests.module.vehicle import HOME, RTL, Station

#: in zone B of `delivery` alone
IN_B = (52.679, 5.932)


def measured(record: BoxRecord) -> BoxRecord:
    """With what else a box of listing 5.7 measures there, on a day of low pressure."""
    speed_mps = math.hypot(record.north_mps, record.east_mps)
    track_deg = math.degrees(math.atan2(record.east_mps, record.north_mps)) % 360.0
    baro_m = record.alt_m + 63.0 if math.isnan(record.baro_m) else record.baro_m
    agl_m = record.alt_m if math.isnan(record.agl_m) else record.agl_m
    return replace(record, baro_m=baro_m, agl_m=agl_m, track_deg=track_deg, speed_mps=speed_mps)


class Box:
    """A box on loopback, in the bench's time: a record in each round, of the autopilot's place but for what is set."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self._server = socket.create_server(("127.0.0.1", 0))
        self._server.setblocking(False)
        self.port: int = self._server.getsockname()[1]
        self._client: socket.socket | None = None
        #: where it says that the aircraft is, in place of where the autopilot does
        self.place: tuple[float, float] | None = None
        self.alt_m = 0.0
        self.changed: dict[str, float] = {}
        self.silent = False
        self.late_s = 0.0
        self.sends = FULL
        bench.each_round = self.step

    def configure(self, more: str = "") -> None:
        with self.bench.config.open("a") as file:
            layout = "" if "layout" in more else 'layout = "full"\n'
            file.write(f'\n[position]\nbox = "tcp:127.0.0.1:{self.port}"\n{layout}{more}\n')

    def step(self) -> None:
        with contextlib.suppress(BlockingIOError):
            accepted, _ = self._server.accept()
            self.cut()
            self._client = accepted
        if self._client is None or self.silent:
            return
        lat, lon = self.place or self.bench.autopilot.position or HOME
        at_s = self.bench.clock.now - 900.0 - self.late_s
        record = BoxRecord(at_s, lat, lon, self.alt_m, 0.0, 0.0, 0.0, 0.0, 0.0, 90.0, 12.0)
        try:
            self._client.sendall(self.sends.pack(measured(replace(record, **self.changed))))
        except OSError:
            self.cut()

    def cut(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None

    def close(self) -> None:
        self.bench.each_round = lambda: None
        self.cut()
        self._server.close()


@pytest.fixture
def box(bench: Bench) -> Iterator[Box]:
    made = Box(bench)
    yield made
    made.close()


SOURCE = 'source = "box"'


def standing(bench: Bench) -> Any:
    return bench.companion.autopilot.positions.box_state(bench.clock.now).value


def where(bench: Bench) -> tuple[float, float] | None:
    """The position that counts, if it is fresh."""
    aircraft = bench.companion.autopilot.aircraft
    fresh = bench.clock.now - aircraft.position.at < 0.5
    return aircraft.where[:2] if fresh and aircraft.where is not None else None


def told(bench: Bench, station: Station | None = None) -> list[str]:
    """What a station (GCSA) heard of the box."""
    said = (bench.a if station is None else station).told()
    return [text for _severity, text in said if text.startswith("position box")]


def real_rounds(bench: Bench, condition: Callable[[], bool], seconds: float = 20.0) -> None:
    """Rounds of the bench until it is so; the system's sockets take their own time."""
    end = time.monotonic() + 20.0
    for _ in range(round(seconds / 0.05)):
        if condition():
            return
        bench.run(0.05)
        assert time.monotonic() < end
    raise AssertionError(f"{standing(bench)}: {bench.mpstate.console.lines[-5:]}")


def sound(bench: Bench, box: Box, more: str = SOURCE) -> None:
    """Loaded, connected to everything, and the box in order."""
    box.configure(more)
    bench.connect()
    real_rounds(bench, lambda: standing(bench) == "sound")


def test_the_boxs_word_is_where_the_aircraft_is(bench: Bench, box: Box, delivery: MissionPackage) -> None:
    box.place = offset(*HOME, 5.0, 5.0)
    box.changed = {"north_mps": 3.0, "east_mps": 4.0, "alt_m": 12.0}
    sound(bench, box)
    bench.run(1.0)
    found = where(bench)
    assert found == pytest.approx(box.place, abs=1e-6)
    aircraft = bench.companion.autopilot.aircraft
    assert aircraft.track == pytest.approx((math.degrees(math.atan2(4.0, 3.0)), 5.0))
    assert aircraft.where[2] == pytest.approx(12.0), "above the autopilot's home"
    assert aircraft.position.value.hdg == 9000
    (last,) = bench.a.got("HANDOVER_TELEMETRY")[-1:]
    assert (last.lat / 1e7, last.lon / 1e7) == pytest.approx(box.place, abs=1e-6)
    assert told(bench) == [], "as it should be: nobody has to be told"
    assert [entry["standing"] for entry in bench.journal("position_source")] == ["sound"]


def test_the_autopilots_own_motion_stays_its_own(bench: Bench, box: Box) -> None:
    box.changed = {"north_mps": 3.0, "east_mps": 4.0}
    sound(bench, box)
    aircraft = bench.companion.autopilot.aircraft
    assert aircraft.track[1] == pytest.approx(5.0)
    assert aircraft.own_speed_mps == 0.0


def test_without_a_box_nothing_has_changed(bench: Bench) -> None:
    bench.connect()
    bench.run(1.0)
    assert where(bench) == pytest.approx(HOME, abs=1e-6)
    assert bench.companion.autopilot.positions.words(bench.companion.autopilot.aircraft, bench.clock.now) == ""


def test_zones_are_judged_by_the_box(bench: Bench, box: Box, delivery: MissionPackage) -> None:
    sound(bench, box)
    bench.share(delivery)
    bench.run(1.0)
    assert bench.companion.arbiter.zone() == 251
    assert "no position" not in bench.companion.arbiter.start_needs(251, bench.clock.now)
    bench.autopilot.position = box.place = IN_B
    bench.run(2.0)
    assert bench.companion.arbiter.zone() == 252


def test_a_box_that_is_not_there_leaves_no_position(bench: Bench, box: Box, delivery: MissionPackage) -> None:
    box.close()
    box.configure(SOURCE)
    bench.connect()
    bench.share(delivery)
    bench.run(8.0)
    assert where(bench) is None
    assert "no position" in bench.companion.arbiter.start_needs(251, bench.clock.now)
    (text,) = told(bench)
    assert text == "position box silent (Connection refused): no position is used"
    bench.mpstate.type("handover status")
    assert any("position  by the box; position box silent" in line for line in bench.mpstate.console.lines)


def test_a_box_that_falls_silent_and_comes_back(bench: Bench, box: Box) -> None:
    sound(bench, box)
    bench.run(6.0)
    box.silent = True
    bench.run(3.0)
    assert where(bench) is None
    assert standing(bench) == "silent"
    assert told(bench)[-1].startswith("position box silent")
    box.silent = False
    real_rounds(bench, lambda: standing(bench) == "sound")
    bench.run(6.0)
    assert where(bench) is not None
    assert told(bench)[-1].startswith("position box in order, 0.0 m from the autopilot's position")


def test_a_box_that_is_restarted(bench: Bench, box: Box) -> None:
    sound(bench, box)
    box.cut()
    box.changed = {"time_s": 0.5}
    bench.run(0.2)
    box.changed = {}
    real_rounds(bench, lambda: standing(bench) == "sound")
    assert where(bench) is not None


def test_one_position_that_is_apart_is_not_used(bench: Bench, box: Box, delivery: MissionPackage) -> None:
    sound(bench, box)
    bench.share(delivery)
    bench.run(1.0)
    entered = len(bench.journal("zone_entered"))
    box.place = IN_B
    bench.run(0.1)
    box.place = None
    bench.run(3.0)
    assert len(bench.journal("zone_entered")) == entered
    assert where(bench) == pytest.approx(HOME, abs=1e-6)
    assert [entry["standing"] for entry in bench.journal("position_source")] == ["sound"]


@pytest.mark.parametrize("what", ["place", "alt_m", "north_mps"])
def test_a_box_that_drifts_counts_no_more_and_everybody_is_told(bench: Bench, box: Box, what: str) -> None:
    sound(bench, box)
    bench.run(6.0)
    if what == "place":
        box.place = offset(*HOME, 0.0, 40.0)
    else:
        box.changed = {what: 50.0}
    bench.run(0.2)
    assert bench.companion.autopilot.aircraft.where[:2] == pytest.approx(HOME, abs=1e-6), "not used, not even once"
    bench.run(4.0)
    assert where(bench) is None
    assert "no position" in bench.companion.arbiter.start_needs(251, bench.clock.now)
    assert " apart" in told(bench)[-1]
    assert told(bench)[-1].endswith(": no position is used")
    assert told(bench, bench.b) == told(bench), "every station"
    box.place, box.changed = None, {}
    bench.run(3.0)
    assert where(bench) is None, "for five seconds it is not believed again"
    bench.run(5.0)
    assert where(bench) is not None


def test_records_that_waited_are_not_used(bench: Bench, box: Box) -> None:
    sound(bench, box)
    bench.run(6.0)
    box.silent = True
    bench.run(1.5)
    box.silent, box.late_s = False, 1.0
    bench.run(4.0)
    assert where(bench) is None
    assert standing(bench) == "late"
    assert "1.0 s late (limit 0.5 s): no position is used" in told(bench)[-1]


def test_without_a_fix_the_box_is_no_source(bench: Bench, box: Box) -> None:
    sound(bench, box)
    box.changed = {"lat_deg": math.nan}
    bench.run(2.0)
    assert standing(bench) == "no_position"
    assert where(bench) is None


def test_garbage_is_not_used_and_costs_nothing_else(bench: Bench, box: Box) -> None:
    sound(bench, box)
    client: Any = box._client
    client.sendall(b"\x5a" * 77)
    bench.run(1.0)
    real_rounds(bench, lambda: standing(bench) == "sound")
    assert bench.companion.faults == {}


# ---- while there is nothing to compare ------------------------------------------------------------------------------


def test_unchecked_it_counts_for_a_while_and_no_longer(bench: Bench, box: Box) -> None:
    sound(bench, box, SOURCE + "\nunchecked_s = 4")
    box.place = HOME
    bench.autopilot.position = None
    bench.run(3.5)
    assert where(bench) is not None
    bench.run(2.0)
    assert where(bench) is None
    assert standing(bench) == "unchecked"


def test_before_it_was_checked_once_it_does_not_count(bench: Bench, box: Box) -> None:
    box.place = HOME
    bench.autopilot.position = None
    box.configure(SOURCE)
    assert bench.load() is not None
    real_rounds(bench, lambda: standing(bench) == "unchecked")
    bench.run(1.0)
    assert where(bench) is None


def test_a_position_without_a_fix_is_nothing_to_check_it_by(bench: Bench, box: Box) -> None:
    sound(bench, box, SOURCE + "\nunchecked_s = 2")
    for fix in (3, 0):
        bench.autopilot._out = []
        bench.mpstate.deliver(_receiver(bench, fix))
    bench.run(3.0)
    assert standing(bench) == "unchecked"
    assert where(bench) is None


def _receiver(bench: Bench, fix: int) -> Any:
    message = stock.MAVLink_gps_raw_int_message(0, fix, 0, 0, 0, 0, 0, 0, 0, 0)
    raw = message.pack(stock.MAVLink(None, srcSystem=1, srcComponent=1))
    return stock.MAVLink(None).decode(bytearray(raw))


def test_disarmed_it_may_be_believed_alone(bench: Bench, box: Box) -> None:
    box.place = IN_B
    sound_armed = SOURCE + '\ncheck = "armed"'
    box.configure(sound_armed)
    bench.connect()
    real_rounds(bench, lambda: standing(bench) == "apart")
    bench.run(1.0)
    assert where(bench) == pytest.approx(IN_B, abs=1e-6)
    bench.autopilot.armed = True
    bench.run(2.0)
    assert where(bench) is None, "armed it is held against the autopilot's"
    bench.autopilot.armed = False
    bench.autopilot.silent = True
    bench.run(3.0)
    assert where(bench) is None, "and nobody says any more that it is disarmed"


# ---- the box only checks --------------------------------------------------------------------------------------------


def test_a_box_that_only_checks_takes_the_autopilots_word_away(bench: Bench, box: Box) -> None:
    sound(bench, box, "")
    bench.run(6.0)
    assert where(bench) == pytest.approx(HOME, abs=1e-6)
    box.place = offset(*HOME, 60.0, 0.0)
    bench.run(4.0)
    assert where(bench) is None
    assert told(bench)[-1].endswith("(limit 25 m): no position is used")
    box.place = None
    bench.run(7.0)
    assert where(bench) == pytest.approx(HOME, abs=1e-6)


def test_a_silent_box_that_only_checks_takes_nothing_away(bench: Bench, box: Box) -> None:
    sound(bench, box, "")
    bench.run(6.0)
    box.silent = True
    bench.run(3.0)
    assert where(bench) is not None
    assert told(bench)[-1].startswith("position box silent")
    assert "counts" not in told(bench)[-1]


def test_a_disagreement_outlasts_the_silence_of_who_only_checks_in_the_air(bench: Bench, box: Box) -> None:
    sound(bench, box, "")
    bench.autopilot.armed = True
    bench.run(2.0)
    box.place = offset(*HOME, 60.0, 0.0)
    bench.run(4.0)
    box.silent = True
    bench.run(6.0)
    assert where(bench) is None
    bench.autopilot.armed = False
    bench.run(3.0)
    assert where(bench) is not None, "on the ground it is forgotten"


# ---- around it ------------------------------------------------------------------------------------------------------


def test_an_unknown_host_is_one_clear_error(bench: Bench) -> None:
    with bench.config.open("a") as file:
        file.write('\n[position]\nbox = "tcp:no.such.host.invalid:4001"\n')
    assert bench.load() is None
    said = [line for line in bench.mpstate.console.lines if "is not loaded" in line]
    assert len(said) == 1
    assert "link tcp:no.such.host.invalid:4001 cannot be opened" in said[0]


def test_unloaded_it_is_left_alone(bench: Bench, box: Box, tmp_path: Path, clock: Clock) -> None:
    sound(bench, box)
    line = bench.module._box
    assert line.descriptors()
    bench.mpstate.unload("handover")
    assert line.descriptors() == []


def test_what_breaks_in_reading_costs_that_reading(bench: Bench, box: Box, monkeypatch: pytest.MonkeyPatch) -> None:
    sound(bench, box)

    def broken() -> None:
        raise RuntimeError("no")

    monkeypatch.setattr(bench.module._box, "read", broken)
    bench.run(3.0)
    assert set(bench.companion.faults) == {"position box"}
    assert bench.companion.view.commander == 251, "all else goes on"
    assert where(bench) is None


def test_without_a_position_the_battery_goes_on_emptying(bench: Bench, box: Box, delivery: MissionPackage) -> None:
    """The fault: the way back was that of the last position, with what was left then, and the mission went on until
    nothing was left."""
    sound(bench, box)
    bench.share(delivery)
    bench.run(2.0)
    bench.a.command(mavlink.MAV_CMD_MISSION_START)
    bench.until(lambda: bench.companion.view.phase is Phase.ON_MISSION)
    bench.run(5.0)
    box.silent = True
    returned_at = None
    for second in range(80):
        bench.autopilot.battery = 1.0 - 0.01 * second
        bench.run(1.0)
        if returned_at is None and bench.autopilot.mode == RTL:
            returned_at = bench.autopilot.battery
    # home is next to it; with a reserve of 20 % and what it may have flown since, that leaves something
    assert returned_at is not None
    assert 0.25 < returned_at < 0.9
    assert bench.autopilot.mode == RTL, "on its way back nothing is known, and it is not landed for that"
    assert any(
        entry["text"].startswith("RETURN to home. ") and "Wh left" in entry["text"]
        for entry in bench.journal("decision")
    )


# ---- a hostile one --------------------------------------------------------------------------------------------------


def test_unchecked_it_cannot_put_the_aircraft_elsewhere(bench: Bench, box: Box, delivery: MissionPackage) -> None:
    """The fault: as soon as the autopilot's position was gone, the box was believed whatever it said."""
    box.configure(SOURCE)
    bench.connect()
    bench.share(delivery)
    bench.run(3.0)
    assert where(bench) == pytest.approx(HOME, abs=1e-4)
    box.place = HOME
    bench.autopilot.position = None
    bench.run(1.0)
    assert where(bench) == pytest.approx(HOME, abs=1e-4), "it is believed for a while"
    box.place = IN_B
    bench.run(3.0)
    assert where(bench) is None
    assert standing(bench) == "unchecked"


def test_a_box_that_lies_by_turns_is_told_and_not_used(bench: Bench, box: Box) -> None:
    box.configure(SOURCE)
    bench.connect()
    bench.run(2.0)
    for _ in range(60):
        box.place = IN_B
        bench.run(0.05)
        box.place = None
        bench.run(0.05)
    bench.run(0.05)
    assert standing(bench) == "apart"
    assert any("apart (limit 25 m)" in text for text in told(bench))


def test_ten_thousand_records_a_second_cost_a_part_of_a_tick(bench: Bench, box: Box) -> None:
    """As fast as the socket takes them: what is kept stays less than a record, and no tick takes long."""
    box.configure(SOURCE)
    bench.connect()
    bench.run(2.0)
    line, at_s = bench.module._box, bench.clock.now - 900.0
    records = (
        FULL.pack(BoxRecord(at_s + number * 2e-4, *HOME, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 90.0, 12.0))
        for number in range(1, 30_000)
    )
    flood = b"".join(records)
    assert box._client is not None
    box.silent = True
    box._client.setblocking(False)
    worst_s, before = 0.0, line.counters.records
    for _ in range(20):
        with contextlib.suppress(BlockingIOError):
            flood = flood[box._client.send(flood) :]
        begun = time.process_time()
        line.read()
        worst_s = max(worst_s, time.process_time() - begun)
        assert line._stream.waiting < 56
    assert line.counters.records - before > 5000
    assert worst_s < 0.03
