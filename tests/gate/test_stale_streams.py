# SPDX-License-Identifier: GPL-3.0-or-later

"""Sticks that a station already sent before it had control do not fly the aircraft at the moment when it gets it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import AuthorityView, LeaseState, Phase
from mavproxy_handover.gate import stale_streams
from mavproxy_handover.gate.judge import Fate, GateReason
from mavproxy_handover.gate.policy.access import Access
from mavproxy_handover.gate.policy.messages import MESSAGE_RULES
from mavproxy_handover.gate.stale_streams import KINDS, News, State
from mavproxy_handover.wire.frames import Frame
from tests.gate import ledger
from tests.gate.door import Door
from tests.gate.frames import IDS
from tests.gate.ledger import GCSA, GCSB, STICKS, TRACKER_OF_B

Make = Callable[..., Frame]
#: every component of these is the station
A, B = (replace(station, components=frozenset(range(256))) for station in (ledger.A, ledger.B))
OF_A = AuthorityView(Phase.ON_MISSION, GCSA, None, 1, LeaseState.HELD, armed=True)
OF_B = replace(OF_A, commander=GCSB, epoch=2)
OF_NOBODY = replace(OF_A, commander=None, lease=LeaseState.LOST)

PASSES = (Fate.FORWARD, GateReason.ALLOWED)
REFUSED = (Fate.DROP, GateReason.NOT_IN_CONTROL)
RAN_BEFORE = (Fate.DROP, GateReason.RAN_BEFORE)

#: what MAVProxy sends after `rc 3 1200`, `rc all 0` and `rc all -1`
HELD: dict[str, Any] = {"chan3_raw": 1200}
LET_GO: dict[str, Any] = {}
LEFT_ALONE: dict[str, Any] = {f"chan{n}_raw": 65535 for n in range(1, 19)}
RELEASED = {f"chan{n}_raw": 0 if n <= 8 else 65534 for n in range(1, 19)}
OVERRIDE = "RC_CHANNELS_OVERRIDE"
HANDS_OFF = {"x": 32767, "y": 32767, "z": 32767, "r": 32767}


class Sky:
    """The door with time that only the test moves, and stations that beat once a second while they are there."""

    def __init__(self, make: Make) -> None:
        self.door = Door(step_s=0.0, stations=(A, B))
        self.make = make
        #: stations that are heard
        self.there = [A, B]
        self._beats = 0
        self.door.change(OF_A)

    def wait(self, seconds: float, *streams: Callable[[], object]) -> None:
        """Twenty rounds a second; `streams` are sent ten times a second."""
        for number in range(round(seconds * 20)):
            self.door.now += 0.05
            self._beats += 1
            if self._beats % 20 == 0:
                for station in self.there:
                    self.door.up(station, self.make("HEARTBEAT", sysid=station.sysid))
            if number % 2 == 0:
                for stream in streams:
                    stream()
            self.door.gate.tick(self.door.now)

    def send(self, name: str = OVERRIDE, sysid: int = GCSB, compid: int = 190, **fields: Any) -> tuple[Any, Any]:
        """A frame of a station; what became of it."""
        station = A if sysid == GCSA else B
        verdict = self.door.up(station, self.make(name, sysid=sysid, compid=compid, **fields)).verdict
        return verdict.fate, verdict.reason

    def sticks(self) -> tuple[Any, Any]:
        """The override that MAVProxy repeats."""
        return self.send(**HELD)

    @property
    def states(self) -> list[State]:
        return [news.state for news in self.door.told]

    def texts(self, station: int = GCSB) -> list[str]:
        """The lines of text that a station got."""
        messages = [mavlink.MAVLink(None).decode(bytearray(raw)) for raw in self.door.ports[station].heard]
        return [message.text for message in messages if message.get_type() == "STATUSTEXT"]


@pytest.fixture
def sky(make: Make) -> Sky:
    """GCSA commands; both stations have been heard for a while."""
    sky = Sky(make)
    sky.wait(2.0)
    return sky


# ---- before and after a handover -------------------------------------------------------------------------------------


def test_an_override_that_was_refused_to_an_observer_is_not_live_after_its_handover(sky: Sky) -> None:
    assert sky.sticks() == REFUSED
    sky.wait(3.0, sky.sticks)
    sky.door.change(OF_B)
    outcomes: list[Any] = []
    sky.wait(10.0, lambda: outcomes.append(sky.sticks()))
    assert set(outcomes) == {RAN_BEFORE}
    assert not any(frame == sky.make(OVERRIDE, sysid=GCSB, **HELD).raw for frame in sky.door.passed)
    assert sky.door.gate.counts[GCSB][GateReason.RAN_BEFORE] == len(outcomes)


@pytest.mark.parametrize("fields", [LET_GO, LEFT_ALONE, RELEASED], ids=["rc all 0", "rc all -1", "released"])
def test_a_release_passes_and_what_follows_it_is_obeyed(sky: Sky, fields: dict[str, Any]) -> None:
    sky.wait(1.0, sky.sticks)
    sky.door.change(OF_B)
    assert sky.sticks() == RAN_BEFORE
    assert sky.send(**fields) == PASSES
    assert sky.sticks() == PASSES
    assert sky.states == [State.REFUSED, State.RAN_BEFORE, State.OBEYED]


@pytest.mark.parametrize(
    ("name", "fields", "held"),
    [
        (OVERRIDE, {"chan9_raw": 65534}, False),
        (OVERRIDE, {"chan8_raw": 65534}, True),  # not a release there: a value of 65534
        (OVERRIDE, {"chan18_raw": 1500}, True),
        (OVERRIDE, {"chan1_raw": 1}, True),
        ("MANUAL_CONTROL", HANDS_OFF, False),
        ("MANUAL_CONTROL", {**HANDS_OFF, "z": 500}, True),
        ("MANUAL_CONTROL", {**HANDS_OFF, "buttons": 1}, True),
        ("MANUAL_CONTROL", {**HANDS_OFF, "buttons2": 1}, True),
        ("MANUAL_CONTROL", {**HANDS_OFF, "enabled_extensions": 1}, True),
        ("MANUAL_CONTROL", {}, True),  # sticks in the middle are a hand on them
        ("SET_POSITION_TARGET_LOCAL_NED", {}, True),
    ],
)
def test_what_holds_nothing_is_a_release(sky: Sky, name: str, fields: dict[str, Any], held: bool) -> None:
    sky.send(name, x=1) if name == "MANUAL_CONTROL" else sky.send(name, **HELD if name == OVERRIDE else {})
    sky.door.change(OF_B)
    assert sky.send(name, **fields) == (RAN_BEFORE if held else PASSES)
    assert sky.send(name, **fields) == (RAN_BEFORE if held else PASSES)


def test_what_an_observer_lets_go_of_before_its_handover_is_forgotten(sky: Sky) -> None:
    sky.wait(1.0, sky.sticks)
    assert sky.send(**LET_GO) == REFUSED
    sky.door.change(OF_B)
    assert sky.sticks() == PASSES
    assert sky.states == [State.REFUSED, State.ENDED]


def test_a_pause_ends_it_and_the_station_hears_so(sky: Sky) -> None:
    sky.wait(1.0, sky.sticks)
    sky.door.change(OF_B)
    sky.wait(1.0, sky.sticks)
    sky.wait(3.0)
    assert sky.states == [State.REFUSED, State.RAN_BEFORE, State.OBEYED]
    assert sky.sticks() == PASSES


@pytest.mark.parametrize(
    ("beats", "seconds", "outcome"), [(3, 0.9, RAN_BEFORE), (2, 10.0, RAN_BEFORE), (3, 1.0, PASSES), (4, 4.0, PASSES)]
)
@pytest.mark.parametrize("ticks", [False, True])
def test_a_pause_is_a_second_and_three_heartbeats(
    sky: Sky, beats: int, seconds: float, outcome: Any, ticks: bool
) -> None:
    """Whether or not a tick came between."""
    sky.sticks()
    sky.door.change(OF_B)
    assert sky.sticks() == RAN_BEFORE
    for _ in range(beats):
        sky.door.up(B, sky.make("HEARTBEAT", sysid=GCSB))
    sky.door.now += seconds
    if ticks:
        sky.door.gate.tick(sky.door.now)
        assert sky.states[-1] is (State.OBEYED if outcome == PASSES else State.RAN_BEFORE)
    assert sky.sticks() == outcome
    assert sky.states[-1] is (State.OBEYED if outcome == PASSES else State.RAN_BEFORE)


def test_a_pause_before_the_handover_is_one_too(sky: Sky) -> None:
    sky.wait(1.0, sky.sticks)
    sky.wait(3.0)
    sky.door.change(OF_B)
    assert sky.sticks() == PASSES


# ---- what is not a pause ---------------------------------------------------------------------------------------------


def test_a_hole_in_the_link_is_no_pause(sky: Sky) -> None:
    """Nothing of the station is heard for 3 s; the last thing before it and the first one behind it are heartbeats."""
    sky.wait(1.0, sky.sticks)
    sky.door.change(OF_B)
    sky.wait(1.0, sky.sticks)  # its last round is a heartbeat's
    sky.there = [A]
    sky.wait(3.0)
    sky.there = [A, B]
    sky.door.up(B, sky.make("HEARTBEAT", sysid=GCSB))
    outcomes: list[Any] = []
    sky.wait(5.0, lambda: outcomes.append(sky.sticks()))
    assert set(outcomes) == {RAN_BEFORE}


def test_a_system_behind_the_station_does_not_say_that_the_station_is_there(sky: Sky) -> None:
    sky.sticks()
    sky.door.change(OF_B)
    sky.sticks()
    sky.there = [A]
    for _ in range(5):
        sky.door.up(B, sky.make("HEARTBEAT", sysid=TRACKER_OF_B))
        sky.wait(1.0)
    assert sky.sticks() == RAN_BEFORE


def test_a_stall_of_our_own_is_no_pause(sky: Sky) -> None:
    """What came meanwhile is read in its order, all at one time."""
    sky.wait(1.0, sky.sticks)
    sky.door.change(OF_B)
    sky.door.now += 10.0
    for _ in range(3):
        assert sky.sticks() == RAN_BEFORE
        sky.door.up(B, sky.make("HEARTBEAT", sysid=GCSB))
    sky.door.gate.tick(sky.door.now)
    assert sky.sticks() == RAN_BEFORE


def test_a_station_is_one_by_whatever_it_speaks(sky: Sky) -> None:
    """Another component of it, and a system behind it: their sticks are the station's."""
    assert sky.send(sysid=TRACKER_OF_B, compid=1, **HELD) == REFUSED
    sky.door.change(OF_B)
    assert sky.sticks() == RAN_BEFORE
    assert sky.send(compid=191, **HELD) == RAN_BEFORE


def test_who_releases_does_not_release_anothers_hand(sky: Sky) -> None:
    for compid in (190, 191):
        sky.send(compid=compid, **HELD)
    sky.door.change(OF_B)
    assert sky.send(compid=191, **LET_GO) == PASSES
    assert sky.send(compid=190, **HELD) == RAN_BEFORE
    assert sky.send(compid=190, **LET_GO) == PASSES
    assert sky.send(compid=191, **HELD) == PASSES


@pytest.mark.parametrize(("senders", "released"), [(8, PASSES), (9, RAN_BEFORE), (20, RAN_BEFORE)])
def test_of_many_senders_those_that_are_not_told_apart_can_only_pause(sky: Sky, senders: int, released: Any) -> None:
    for compid in range(1, senders + 1):
        sky.send(compid=compid, **HELD)
    sky.door.change(OF_B)
    for compid in range(1, senders + 1):
        assert sky.send(compid=compid, **LET_GO) == PASSES
    assert sky.send(compid=1, **HELD) == released
    sky.wait(3.0)
    assert sky.send(compid=1, **HELD) == PASSES


def test_one_stations_sticks_are_not_anothers_nor_one_kind_another(sky: Sky) -> None:
    sky.wait(1.0, sky.sticks)
    assert sky.send(sysid=GCSA, **HELD) == PASSES
    sky.door.change(OF_B)
    assert sky.send("MANUAL_CONTROL", z=500) == PASSES
    assert sky.send("SET_ATTITUDE_TARGET") == PASSES
    assert sky.sticks() == RAN_BEFORE


# ---- authority that comes back ---------------------------------------------------------------------------------------


def test_what_a_commander_streams_is_its_own_as_long_as_it_commands(sky: Sky) -> None:
    outcomes: list[Any] = []
    for view in (OF_A, replace(OF_A, partner=GCSB, lease=LeaseState.TRANSFER), replace(OF_A, epoch=7), OF_A):
        sky.door.change(view)
        sky.wait(3.0, lambda: outcomes.append(sky.send(sysid=GCSA, **HELD)))
    assert set(outcomes) == {PASSES}
    assert sky.door.told == []


def test_a_former_commanders_sticks_that_go_on_are_not_live_when_it_commands_again(sky: Sky) -> None:
    def of_a() -> tuple[Any, Any]:
        return sky.send(sysid=GCSA, **HELD)

    sky.wait(2.0, of_a)
    sky.door.change(OF_B)
    sky.wait(3.0, of_a)
    sky.door.change(replace(OF_A, epoch=3))
    assert of_a() == RAN_BEFORE
    assert sky.send(sysid=GCSA, **LET_GO) == PASSES
    assert of_a() == PASSES


@pytest.mark.parametrize("heard_meanwhile", [False, True])
def test_a_commander_whose_link_failed_does_not_come_back_with_its_hand_on_the_sticks(
    sky: Sky, heard_meanwhile: bool
) -> None:
    """Its heartbeat gives it authority again before any of its sticks was refused."""
    sky.wait(2.0, lambda: sky.send(sysid=GCSA, **HELD))
    sky.there = [B]
    sky.wait(5.0)
    sky.door.change(OF_NOBODY)
    sky.wait(1.0)
    if heard_meanwhile:
        assert sky.send(sysid=GCSA, **HELD) == REFUSED
    sky.there = [A, B]
    sky.door.up(A, sky.make("HEARTBEAT", sysid=GCSA))
    sky.door.change(replace(OF_A, epoch=2))
    outcomes: list[Any] = []
    sky.wait(5.0, lambda: outcomes.append(sky.send(sysid=GCSA, **HELD)))
    assert set(outcomes) == {RAN_BEFORE}
    sky.wait(3.0)
    assert sky.send(sysid=GCSA, **HELD) == PASSES


def test_what_a_commander_let_go_of_or_never_held_is_not_held_against_it(sky: Sky) -> None:
    sky.send(sysid=GCSA, **HELD)
    sky.send(sysid=GCSA, **LET_GO)
    sky.send("GPS_RTCM_DATA", sysid=GCSA)
    sky.door.change(OF_B)
    sky.door.change(replace(OF_A, epoch=3))
    assert sky.send(sysid=GCSA, **HELD) == PASSES
    assert sky.send("MANUAL_CONTROL", sysid=GCSA, z=500) == PASSES


@pytest.mark.parametrize(("senders", "released"), [(8, PASSES), (9, RAN_BEFORE)])
def test_of_many_hands_of_a_commander_those_that_are_not_told_apart_count_as_held(
    sky: Sky, senders: int, released: Any
) -> None:
    for fields in (HELD, LET_GO):
        for compid in range(1, senders + 1):
            assert sky.send(sysid=GCSA, compid=compid, **fields) == PASSES
    sky.door.change(OF_B)
    sky.door.change(replace(OF_A, epoch=3))
    assert sky.send(sysid=GCSA, **HELD) == released


def test_what_one_commander_held_is_not_held_against_the_next(sky: Sky) -> None:
    sky.send(sysid=GCSA, **HELD)
    sky.door.change(OF_B)
    assert sky.sticks() == PASSES
    sky.door.change(OF_NOBODY)
    sky.door.change(OF_B)
    assert sky.sticks() == RAN_BEFORE


def test_a_gate_that_begins_in_the_middle_of_a_flight_takes_every_stream_for_one_that_ran(make: Make) -> None:
    sky = Sky(make)
    sky.door.gate.distrust()
    outcomes = [sky.send(sysid=GCSA, **HELD), sky.send("MANUAL_CONTROL", sysid=GCSA, z=500)]
    assert outcomes == [RAN_BEFORE] * 2
    assert sky.send("GPS_RTCM_DATA", sysid=GCSA) == PASSES, "corrections are meant to run on"
    assert sky.send(sysid=GCSA, **LET_GO) == PASSES
    assert sky.send(sysid=GCSA, **HELD) == PASSES
    sky.wait(3.0)
    assert sky.send("SET_ATTITUDE_TARGET", sysid=GCSA) == PASSES, "three heartbeats without it"
    assert {news.kind for news in sky.door.told} == {"RC override", "manual control"}, "of the others nobody hears"


def test_three_heartbeats_without_a_stream_are_a_pause_after_the_gate_was_started(make: Make) -> None:
    for beats, outcome in ((2, RAN_BEFORE), (3, PASSES)):
        sky = Sky(make)
        sky.door.gate.distrust()
        for _ in range(beats):
            sky.door.up(A, make("HEARTBEAT", sysid=GCSA))
        sky.door.now += 10.0
        assert sky.send(sysid=GCSA, **HELD) == outcome


def test_a_frame_for_another_aircraft_is_refused_for_that_and_does_not_hold_the_stream(sky: Sky) -> None:
    sky.sticks()
    sky.door.change(OF_B)
    elsewhere: list[Any] = []
    sky.wait(3.0, lambda: elsewhere.append(sky.send(target_system=9, **HELD)))
    assert set(elsewhere) == {(Fate.DROP, GateReason.OTHER_TARGET)}
    assert sky.sticks() == PASSES


# ---- which streams ---------------------------------------------------------------------------------------------------


def test_the_kinds_of_sticks_are_those_of_the_ledger() -> None:
    families = {rule.stream: list(rule.names) for rule in MESSAGE_RULES if rule.stream}
    assert sorted(map(sorted, families.values())) == sorted(map(sorted, STICKS))
    assert all(rule.access is Access.STREAM for rule in MESSAGE_RULES if rule.stream)
    assert len(families) == len([rule for rule in MESSAGE_RULES if rule.stream]), "one row each"
    assert {name for name, msgid in IDS.items() if msgid in KINDS} == {
        name for names in STICKS for name in names if name in IDS
    }


@pytest.mark.parametrize("name", sorted(name for names in STICKS for name in names if name in IDS))
def test_each_of_them_is_refused_after_a_handover_until_it_has_paused(sky: Sky, name: str) -> None:
    fields = HELD if name == OVERRIDE else {}
    assert sky.send(name, **fields) == REFUSED
    sky.door.change(OF_B)
    assert sky.send(name, **fields) == RAN_BEFORE
    sky.wait(3.0)
    assert sky.send(name, **fields) == PASSES


@pytest.mark.parametrize("name", ["GPS_RTCM_DATA", "GPS_INJECT_DATA", "TERRAIN_DATA", "OPEN_DRONE_ID_SYSTEM"])
def test_what_is_meant_to_run_on_does(sky: Sky, name: str) -> None:
    sky.wait(1.0, lambda: sky.send(name))
    sky.door.change(OF_B)
    assert sky.send(name) == PASSES
    assert sky.door.told == []


def test_commands_are_no_streams(sky: Sky) -> None:
    sky.send("COMMAND_LONG", command=176)
    sky.door.change(OF_B)
    assert sky.send("COMMAND_LONG", command=176) == PASSES


def test_what_is_not_the_stations_is_not_held_against_it(sky: Sky) -> None:
    for frame in (
        sky.make(OVERRIDE, sysid=GCSA, **HELD),
        sky.make(OVERRIDE, sysid=GCSB, target_system=9, **HELD),
        sky.make(OVERRIDE, sysid=GCSB, **HELD)._replace(known=False),
    ):
        assert sky.door.up(B, frame).verdict.reason is not GateReason.NOT_IN_CONTROL
    sky.door.change(OF_B)
    assert sky.sticks() == PASSES


# ---- what the station is told ----------------------------------------------------------------------------------------


def test_the_station_is_told_at_once_before_and_after_and_when_it_is_over(sky: Sky) -> None:
    sky.sticks()
    assert sky.texts() == ["Handover: RC override: not in control", "Handover: RC override: end it before handover"]
    sky.wait(5.0, sky.sticks)
    assert len(sky.texts()) == 2
    sky.door.change(OF_B)
    sky.sticks()
    assert sky.texts()[2:] == [
        "Handover: RC override: stop it for 3 s first",
        "Handover: it ran before you had control",
    ]
    sky.send(**LET_GO)
    assert sky.texts()[4:] == ["Handover: RC override: obeyed from now on"]
    assert sky.texts(GCSA) == []
    assert sky.door.told == [
        News(GCSB, "RC override", State.REFUSED),
        News(GCSB, "RC override", State.RAN_BEFORE),
        News(GCSB, "RC override", State.OBEYED),
    ]


def test_who_goes_on_is_reminded_every_half_minute_before_and_after(make: Make) -> None:
    sky = Sky(make)
    told = []
    for later_s in (0.0, 29.0, 1.0, 29.0, 1.0):
        sky.door.now += later_s
        sky.sticks()
        told.append(len(sky.door.told))
    assert told == [1, 1, 2, 2, 3]
    sky.door.change(OF_B)
    for _ in range(4):
        sky.sticks()
        sky.door.now += 15.0
    assert sky.states == [State.REFUSED] * 3 + [State.RAN_BEFORE] * 2


def test_an_observer_that_has_ended_it_hears_so(sky: Sky) -> None:
    sky.wait(1.0, sky.sticks)
    sky.wait(3.0)
    assert sky.texts()[-1] == "Handover: RC override: it has ended"


def test_whoever_takes_and_releases_a_thousand_times_a_second_gets_a_line_a_second(sky: Sky) -> None:
    for _ in range(2000):
        sky.door.now += 0.001
        sky.send(**HELD)
        sky.send(**LET_GO)
    assert len(sky.texts()) <= 3 * 3


def test_every_line_fits_and_every_first_one_is_told_in_full() -> None:
    kinds = {rule.stream for rule in MESSAGE_RULES if rule.stream}
    for kind in kinds:
        for state in State:
            lines = stale_streams.lines(News(GCSB, kind, state))
            assert all(len(line) <= 50 for line in lines)
            full = stale_streams.full_form(lines[0])
            assert full is not None
            assert kind.lower() in full.lower()
            assert [stale_streams.full_form(line) for line in lines[1:]] == [None] * len(lines[1:])
    assert stale_streams.full_form("Handover: SET_MODE: not in control") is None
    full = stale_streams.full_form("Handover: RC override: stop it for 3 s first")
    assert full == (
        "RC override has been running since before this station had control: still refused, until it is released "
        "(rc all 0) or has paused for 3 s."
    )


def test_warnings_are_warnings_and_the_end_of_it_is_a_notice(sky: Sky) -> None:
    sky.sticks()
    sky.door.change(OF_B)
    sky.sticks()
    sky.send(**LET_GO)
    severities = [mavlink.MAVLink(None).decode(bytearray(raw)).severity for raw in sky.door.ports[GCSB].heard]
    assert severities == [4, 4, 4, 4, 5]


def test_nobody_needs_to_be_known_for_a_change_of_authority(make: Make) -> None:
    door = Door()
    for view in (OF_NOBODY, replace(OF_A, commander=99), OF_NOBODY):
        door.change(view)
    assert door.told == []


# ---- on the ground ---------------------------------------------------------------------------------------------------

NOT_ARMED = (Fate.DROP, GateReason.NOT_ARMED)
ON_GROUND = AuthorityView(Phase.ON_LOAD, GCSA, None, 1, LeaseState.HELD)


@pytest.mark.parametrize(
    ("name", "fields", "on_ground"),
    [
        (OVERRIDE, {"chan3_raw": 1000, "chan4_raw": 2000}, NOT_ARMED),
        (OVERRIDE, LET_GO, PASSES),
        (OVERRIDE, RELEASED, PASSES),
        ("MANUAL_CONTROL", {"r": 1000}, NOT_ARMED),
        ("MANUAL_CONTROL", HANDS_OFF, PASSES),
        ("GPS_RTCM_DATA", {}, PASSES),
        ("SET_ATTITUDE_TARGET", {}, PASSES),
    ],
)
def test_no_stick_arms_an_aircraft_on_the_ground(
    sky: Sky, name: str, fields: dict[str, Any], on_ground: tuple[Any, Any]
) -> None:
    """Rudder and switches arm by an override as by a pilot's own: to arm needs what START needs, and a command."""
    sky.door.change(ON_GROUND)
    assert sky.send(name, GCSA, **fields) == on_ground
    sky.door.change(replace(ON_GROUND, armed=True))
    assert sky.send(name, GCSA, **fields) == PASSES
    sky.door.change(replace(OF_A, armed=False))
    assert sky.send(name, GCSA, **fields) == PASSES
