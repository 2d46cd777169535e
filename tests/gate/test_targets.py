# SPDX-License-Identifier: GPL-3.0-or-later

"""Streams of guided targets: judged when the target changes, and not frame by frame."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from mavproxy_handover.core.common.model import AuthorityView, LeaseState, Phase
from mavproxy_handover.gate.intent import Aim
from mavproxy_handover.gate.judge import Fate, GateReason, Verdict
from mavproxy_handover.gate.policy.access import Access
from mavproxy_handover.gate.targets import HOLDS_S, TargetStreams
from mavproxy_handover.vehicle.profiles import COPTER, PLANE, Modes
from mavproxy_handover.wire.frames import Frame
from tests.gate.door import Door
from tests.gate.ledger import GCSA, GCSB, A, B

Make = Callable[..., Frame]
FLYING = AuthorityView(Phase.ON_MISSION, GCSA, None, 1, LeaseState.HELD)
ONLY_PLACE, ONLY_VELOCITY = 0b110111111000, 0b110111000111
GLOBAL = "SET_POSITION_TARGET_GLOBAL_INT"
#: about 3 m in 1e-7 degrees of latitude, and a little more and less
NEAR, FAR = 260, 280


class Watched:
    """A gate whose judge lets nothing pass that lies north of 53 degrees, and remembers what it was asked."""

    def __init__(self, step_s: float) -> None:
        self.asked: list[tuple[Aim, int]] = []
        self.breaks = False
        self.door = Door(step_s)
        self.door.change(FLYING)
        self.door.target_passes = self._judge

    def _judge(self, aim: Aim, station: int, _now: float) -> bool:
        if self.breaks:
            raise RuntimeError("a bug")
        self.asked.append((aim, station))
        return aim.first <= 53.0


def target(make: Make, lat: int, mask: int = ONLY_PLACE, **more: Any) -> Frame:
    return make(GLOBAL, type_mask=mask, lat_int=lat, lon_int=60_000_000, alt=40.0, coordinate_frame=6, **more)


def test_a_stream_that_stands_still_is_judged_once_a_second(make: Make) -> None:
    watched = Watched(step_s=0.05)
    frame = target(make, 520_000_000)
    fates = [watched.door.up(A, frame).verdict.fate for _ in range(60)]
    assert set(fates) == {Fate.FORWARD}
    assert len(watched.asked) == 3
    assert watched.asked[0] == (Aim(6, 52.0, 6.0, 40.0), GCSA)
    assert HOLDS_S == 1.0


@pytest.mark.parametrize(("step", "asked"), [(NEAR, 1), (FAR, 2)])
def test_a_target_that_moves_is_judged_when_it_has_moved_by_some_metres(make: Make, step: int, asked: int) -> None:
    watched = Watched(step_s=0.2)
    for shift in (0, step):
        assert watched.door.up(A, target(make, 520_000_000 + shift)).verdict.fate is Fate.FORWARD
    assert len(watched.asked) == asked


def test_of_wings_a_height_without_a_place_is_judged_too(make: Make) -> None:
    """The fault: ArduPlane takes the height of such a frame, and nothing looked at it."""
    watched = Watched(step_s=0.2)
    frame = target(make, 520_000_000, mask=ONLY_PLACE | 0b011)
    watched.door.up(A, frame)
    assert watched.asked == []
    watched.door.modes = PLANE.gate
    watched.door.up(A, frame)
    assert watched.asked == [(Aim(6, 0.0, 0.0, 40.0, here=True), GCSA)]


@pytest.mark.parametrize("mask", [ONLY_VELOCITY, 0b110111111111, 0b100], ids=["velocity", "nothing", "no height"])
def test_of_wings_the_height_is_judged_though_the_mask_leaves_it_out(make: Make, mask: int) -> None:
    """The fault: ArduPlane up to 4.6 flies to the height of nearly every such frame, whatever its mask leaves out."""
    watched = Watched(step_s=0.2)
    watched.door.modes = PLANE.gate
    watched.door.up(A, target(make, 520_000_000, mask=mask))
    assert watched.asked == [(Aim(6, 0.0, 0.0, 40.0, here=True), GCSA)]


def test_of_wings_a_height_that_is_left_out_and_no_number_is_dropped(make: Make) -> None:
    watched = Watched(step_s=0.2)
    watched.door.modes = PLANE.gate
    frame = make(GLOBAL, type_mask=ONLY_VELOCITY, coordinate_frame=6, alt=math.nan)
    assert watched.door.up(A, frame).verdict.fate is Fate.DROP


def test_a_target_whose_judgement_breaks_does_not_pass_with_its_next_copy(make: Make) -> None:
    """The fault: the next copy had the verdict of the target before."""
    watched = Watched(step_s=0.2)
    assert watched.door.up(A, target(make, 520_000_000)).verdict.fate is Fate.FORWARD
    watched.breaks = True
    out = target(make, 530_000_100)
    with pytest.raises(RuntimeError):
        watched.door.up(A, out)
    came = [watched.door.up(A, out) for _ in range(3)]
    assert {c.verdict.fate for c in came} == {Fate.DROP}
    assert [c.passed for c in came] == [[], [], []]


def test_what_would_leave_is_dropped_and_counted_until_the_target_is_another(make: Make) -> None:
    watched = Watched(step_s=0.2)
    out, inside = target(make, 530_000_100), target(make, 520_000_000)
    came = [watched.door.up(A, out) for _ in range(3)]
    assert {(c.verdict.fate, c.verdict.reason) for c in came} == {(Fate.DROP, GateReason.SITUATION)}
    assert [c.passed for c in came] == [[], [], []]
    assert watched.door.gate.counts[GCSA][GateReason.SITUATION] == 3
    assert watched.door.up(A, inside).passed == [inside.raw]
    assert len(watched.asked) == 2


def test_one_that_jumps_to_and_fro_gets_no_bad_target_through_and_costs_ten_judgements_a_second(make: Make) -> None:
    watched = Watched(step_s=0.01)
    out, inside = target(make, 540_000_000), target(make, 520_000_000)
    passed = [raw for _ in range(200) for frame in (inside, out) for raw in watched.door.up(A, frame).passed]
    assert out.raw not in passed
    assert len(watched.asked) <= 41  # of four seconds


def test_what_carries_no_place_is_not_judged(make: Make) -> None:
    watched = Watched(step_s=0.2)
    frame = target(make, 540_000_000, mask=ONLY_VELOCITY)
    assert watched.door.up(A, frame).verdict.fate is Fate.FORWARD
    assert watched.asked == []


def test_on_the_ground_and_of_who_does_not_command_nothing_is_judged(make: Make) -> None:
    watched = Watched(step_s=0.2)
    watched.door.up(B, target(make, 540_000_000, sysid=GCSB))
    watched.door.change(replace(FLYING, phase=Phase.ON_LOAD))
    assert watched.door.up(A, target(make, 540_000_000)).verdict.fate is Fate.FORWARD
    assert watched.asked == []


def test_another_message_and_another_frame_are_judged_for_themselves(make: Make) -> None:
    watched = Watched(step_s=0.2)
    watched.door.up(A, target(make, 520_000_000))
    watched.door.up(A, make(GLOBAL, type_mask=ONLY_PLACE, lat_int=520_000_000, lon_int=60_000_000, alt=40.0))
    watched.door.up(A, make("SET_POSITION_TARGET_LOCAL_NED", type_mask=ONLY_PLACE, coordinate_frame=1, x=9.0))
    assert [aim for aim, _station in watched.asked] == [
        Aim(6, 52.0, 6.0, 40.0),
        Aim(0, 52.0, 6.0, 40.0),
        Aim(1, 9.0, 0.0, 0.0),
    ]


FOLLOWED = "FOLLOW_TARGET"


@pytest.mark.parametrize(("lat", "fate"), [(520_000_000, Fate.FORWARD), (530_000_100, Fate.DROP)])
def test_the_place_of_the_system_that_is_followed_is_a_target(make: Make, lat: int, fate: Fate) -> None:
    """The fault: in FOLLOW an aircraft flew after any place that its commander sent, and nothing looked at it."""
    watched = Watched(step_s=0.2)
    frame = make(FOLLOWED, lat=lat, lon=60_000_000, alt=140.0)
    assert watched.door.up(A, frame).verdict.fate is fate
    assert watched.asked == [(Aim(0, lat / 1e7, 6.0, 140.0), GCSA)]


LOCAL = "SET_POSITION_TARGET_LOCAL_NED"
IGNORES_ALL = 0b110111111111


@pytest.mark.parametrize("mask", [ONLY_PLACE, IGNORES_ALL])
def test_of_wings_an_offset_of_the_height_has_no_bound_whatever_is_masked(make: Make, mask: int) -> None:
    """The fault: ArduPlane adds the z of each such frame to its height, and does not look at the mask."""
    watched = Watched(step_s=0.2)
    watched.door.modes = PLANE.gate
    watched.door.up(A, make(LOCAL, type_mask=mask, coordinate_frame=7, z=-3.0))
    assert watched.asked == [(Aim(3, 0.0, 0.0, 100_000.0, here=True), GCSA)]
    watched.door.up(A, make(LOCAL, type_mask=mask, coordinate_frame=7, z=0.0))
    watched.door.up(A, make(LOCAL, type_mask=mask, coordinate_frame=1, z=-3.0))
    assert len(watched.asked) == 1


def test_of_wings_no_offset_of_the_height_is_near_another(make: Make) -> None:
    """0 m leads nowhere and passes; 2.9 m right after it would climb 145 m in a second of such frames."""
    watched = Watched(step_s=0.2)
    watched.door.modes = PLANE.gate
    watched.door.up(A, make(LOCAL, type_mask=ONLY_PLACE, coordinate_frame=7, z=0.0))
    assert watched.asked == []
    watched.door.up(A, make(LOCAL, type_mask=ONLY_PLACE, coordinate_frame=7, z=-2.9))
    assert len(watched.asked) == 1


class Stream:
    """The targets of station A alone, all of which may be flown to. How often one was judged is counted."""

    def __init__(self, make: Make, modes: Modes) -> None:
        self._make, self._modes = make, modes
        self.judged = 0
        self._targets = TargetStreams(self._passes)

    def _passes(self, _aim: Aim, _station: int, _now: float) -> bool:
        self.judged += 1
        return True

    def sends(self, now: float, name: str = LOCAL, **fields: Any) -> Fate:
        fields = {"coordinate_frame": 7 if self._modes.takes_heights else 1, **fields}
        frame = self._make(name, type_mask=ONLY_PLACE, **fields)
        verdict = Verdict(Fate.FORWARD, Access.STREAM, GateReason.ALLOWED, name)
        return self._targets.limit(frame, verdict, GCSA, now, self._modes).fate


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_a_local_target_of_a_copter_three_metres_away_is_the_same_and_none_farther(make: Make, axis: str) -> None:
    stream = Stream(make, COPTER.gate)
    stream.sends(0.0, x=9.0)
    near = {"x": 9.0, "y": 0.0, "z": 0.0}
    near[axis] += 3.0
    assert (stream.sends(0.5, **near), stream.judged) == (Fate.FORWARD, 1)
    near[axis] += 0.1
    assert (stream.sends(0.5, **near), stream.judged) == (Fate.FORWARD, 2)


def test_a_verdict_on_a_target_is_valid_for_less_than_a_second_and_the_next_is_made_a_tenth_later(make: Make) -> None:
    stream = Stream(make, COPTER.gate)
    stream.sends(0.0)
    assert (stream.sends(0.99), stream.judged) == (Fate.FORWARD, 1)
    assert (stream.sends(1.0), stream.judged) == (Fate.FORWARD, 2)
    stream = Stream(make, COPTER.gate)
    stream.sends(0.0)
    assert (stream.sends(0.09, x=50.0), stream.judged) == (Fate.DROP, 1)
    assert (stream.sends(0.1, x=50.0), stream.judged) == (Fate.FORWARD, 2)


def test_of_wings_offsets_of_half_a_metre_are_judged_each_and_places_on_the_globe_are_near(make: Make) -> None:
    stream = Stream(make, PLANE.gate)
    for number, fields in enumerate(({"z": -20.0}, {"z": -20.5}, {"z": -20.5, "x": 0.5}), 1):
        stream.sends(0.3 * number, **fields)
        assert stream.judged == number
    place = {"lat_int": 520_000_000, "lon_int": 60_000_000, "alt": 40.0, "coordinate_frame": 6}
    stream.sends(2.0, GLOBAL, **place)
    stream.sends(2.5, GLOBAL, **{**place, "lat_int": 520_000_000 + NEAR})
    assert stream.judged == 4
    stream.sends(2.5, GLOBAL, **{**place, "lat_int": 520_000_000 + FAR})
    assert stream.judged == 5


#: the field of a guided target, and the bit that leaves it out
FIELDS = {
    "x": 0,
    "y": 1,
    "z": 2,
    "vx": 3,
    "vy": 4,
    "vz": 5,
    "afx": 6,
    "afy": 7,
    "afz": 8,
    "yaw": 10,
    "yaw_rate": 11,
}


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("field", FIELDS)
def test_a_number_that_is_none_reaches_the_autopilot_only_where_it_is_left_out(
    make: Make, field: str, value: float
) -> None:
    """The fault: ArduCopter looks at the velocity alone, and takes a place that is no number."""
    for name in (LOCAL, GLOBAL):
        named = {"z": "alt"}.get(field, field) if name == GLOBAL else field
        if name == GLOBAL and field in ("x", "y"):  # whole numbers there
            continue
        watched = Watched(step_s=0.2)
        taken = make(name, coordinate_frame=1, type_mask=0, **{named: value})
        verdict = watched.door.up(A, taken).verdict
        assert (verdict.fate, verdict.reason) == (Fate.DROP, GateReason.NO_NUMBER)
        left_out = make(name, coordinate_frame=1, type_mask=1 << FIELDS[field], **{named: value})
        assert watched.door.up(A, left_out).verdict.fate is Fate.FORWARD


def test_a_place_that_is_none_is_dropped_unasked(make: Make) -> None:
    watched = Watched(step_s=0.2)
    for frame in (
        make(FOLLOWED, lat=520_000_000, lon=60_000_000, alt=math.nan),
        make(FOLLOWED, lat=910_000_000, lon=60_000_000, alt=40.0),
        target(make, 910_000_000),
    ):
        assert watched.door.up(A, frame).verdict.fate is Fate.DROP
    assert watched.asked == []
