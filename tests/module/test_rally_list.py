# SPDX-License-Identifier: GPL-3.0-or-later

"""The rally list as stations see it: the companion's own, read by everybody and written by the commander."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.monitors.return_site import candidates as watch
from mavproxy_handover.operator.return_site.rally_list import MOST_POINTS
from tests.module.conftest import Bench
from tests.module.test_places import HOME, RALLY, RALLY_1, RALLY_2, listed
from tests.module.vehicle import Station

ACCEPTED, ERROR, DENIED = mavlink.MAV_MISSION_ACCEPTED, mavlink.MAV_MISSION_ERROR, mavlink.MAV_MISSION_DENIED
NEW = (526795000, 59290000)


@pytest.fixture
def ready(bench: Bench, delivery: MissionPackage) -> Bench:
    bench.connect()
    bench.share(delivery, at_once=True)
    bench.wait(6.0)
    bench.a.received.clear()
    bench.b.received.clear()
    return bench


def send(bench: Bench, station: Station, message: Any) -> list[Any]:
    """Send it; what came back about rally points."""
    station.received.clear()
    station.send(message)
    bench.run(0.2)
    return [m for m in station.received if getattr(m, "mission_type", None) == message.mission_type]


def count(number: int) -> Any:
    return mavlink.MAVLink_mission_count_message(1, 1, number, RALLY)


def item(seq: int, place: tuple[int, int] = NEW, *, alt: float = 25.0, frame: int = 3, command: int = 5100) -> Any:
    return mavlink.MAVLink_mission_item_int_message(1, 1, seq, frame, command, 0, 1, 0, 0, 0, 0, *place, alt, RALLY)


def clear(kind: int = RALLY) -> Any:
    return mavlink.MAVLink_mission_clear_all_message(1, 1, kind)


def change(first: int, last: int) -> Any:
    return mavlink.MAVLink_mission_write_partial_list_message(1, 1, first, last, RALLY)


def seen(bench: Bench, station: Station) -> list[tuple[int, int, float]]:
    """The list as a station reads it."""
    (total,) = send(bench, station, mavlink.MAVLink_mission_request_list_message(1, 1, RALLY))
    assert (total.get_type(), total.get_srcSystem(), total.get_srcComponent()) == ("MISSION_COUNT", 1, 1)
    places = []
    for seq in range(total.count):
        (one,) = send(bench, station, mavlink.MAVLink_mission_request_int_message(1, 1, seq, RALLY))
        assert (one.get_type(), one.seq, one.command, one.frame) == ("MISSION_ITEM_INT", seq, 5100, 3)
        assert (one.target_system, one.target_component) == (station.sysid, 190)
        places.append((one.x, one.y, one.z))
    return places


def result(answers: list[Any]) -> int:
    (ack,) = answers
    assert ack.get_type() == "MISSION_ACK"
    return int(ack.type)


def upload(bench: Bench, *places: tuple[int, int]) -> int:
    """The commander's upload; how it ended."""
    answers = send(bench, bench.a, count(len(places)))
    for seq, place in enumerate(places):
        (asked,) = answers
        assert (asked.get_type(), asked.seq) == ("MISSION_REQUEST_INT", seq)
        answers = send(bench, bench.a, item(seq, place))
    return result(answers)


def untouched(bench: Bench) -> bool:
    """Nothing of a station about rally points has reached the autopilot."""
    return not [
        m for m in bench.autopilot.received if getattr(m, "mission_type", 0) in (2, 255) and m.get_srcSystem() != 1
    ]


def test_everybody_reads_the_missions_points_while_the_autopilot_holds_home(ready: Bench) -> None:
    points = [(*RALLY_1, 30.0), (*RALLY_2, 30.0)]
    assert seen(ready, ready.a) == points
    assert seen(ready, ready.b) == points
    assert listed(ready) == [HOME]
    assert untouched(ready)


def test_an_older_program_reads_it_in_its_own_way(ready: Bench) -> None:
    (one,) = send(ready, ready.b, mavlink.MAVLink_mission_request_message(1, 1, 1, RALLY))
    assert one.get_type() == "MISSION_ITEM"
    assert (one.x, one.y, one.z) == pytest.approx((52.67918, 5.931984, 30.0), abs=1e-5)


def test_an_item_that_is_not_there(ready: Bench) -> None:
    answers = send(ready, ready.b, mavlink.MAVLink_mission_request_int_message(1, 1, 2, RALLY))
    assert result(answers) == mavlink.MAV_MISSION_INVALID_SEQUENCE


def test_the_end_of_a_download_needs_no_answer(ready: Bench) -> None:
    assert send(ready, ready.b, mavlink.MAVLink_mission_ack_message(1, 1, ACCEPTED, RALLY)) == []
    assert untouched(ready)


def test_the_commanders_upload_replaces_the_points_to_choose_from(ready: Bench) -> None:
    assert upload(ready, NEW) == ACCEPTED
    assert seen(ready, ready.b) == [(*NEW, 25.0)]
    (entry,) = ready.journal("rally_list")
    assert entry["text"] == "1 rally points of GCSA replace the mission's for this flight"
    assert untouched(ready)
    assert ready.companion.arbiter.mission_digest, "the mission is the same"
    ready.autopilot.position = (NEW[0] / 1e7, NEW[1] / 1e7)
    ready.wait(40.0)
    assert listed(ready) == [NEW]


def test_a_flood_of_uploads_is_judged_once_a_second(ready: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """To walk a long route takes milliseconds, and there may be a thousand uploads in a second."""
    gathered = 0
    places_of = watch.places_of

    def counted(*arguments: Any) -> Any:
        nonlocal gathered
        gathered += 1
        return places_of(*arguments)

    monkeypatch.setattr(watch, "places_of", counted)
    for _ in range(20):
        for _ in range(20):
            ready.a.send(clear())
        ready.run(0.1)
    assert len([m for m in ready.a.got("MISSION_ACK") if m.type == ACCEPTED]) == 400
    assert gathered <= 3


def test_it_is_over_with_the_flight(ready: Bench) -> None:
    upload(ready, NEW)
    ready.autopilot.armed = ready.autopilot.airborne = True
    ready.wait(3.0)
    assert len(seen(ready, ready.a)) == 1
    ready.autopilot.armed = ready.autopilot.airborne = False
    ready.wait(3.0)
    assert len(seen(ready, ready.a)) == 2


def test_an_empty_upload_and_a_clear_leave_home(ready: Bench) -> None:
    assert result(send(ready, ready.a, count(0))) == ACCEPTED
    assert seen(ready, ready.a) == []
    upload(ready, NEW)
    assert result(send(ready, ready.a, clear())) == ACCEPTED
    assert seen(ready, ready.b) == []
    ready.wait(15.0)
    assert listed(ready) == [HOME]


def test_all_lists_at_once_are_not_cleared_as_arducopter_has_it(ready: Bench) -> None:
    assert result(send(ready, ready.a, clear(255))) == mavlink.MAV_MISSION_UNSUPPORTED
    assert len(seen(ready, ready.a)) == 2
    assert len(ready.autopilot.items[0]) == 12
    assert untouched(ready)


def test_a_part_of_it_can_be_changed(ready: Bench) -> None:
    (asked,) = send(ready, ready.a, change(1, 2))
    assert asked.seq == 1
    send(ready, ready.a, item(1))
    assert result(send(ready, ready.a, item(2, RALLY_2, alt=40.9))) == ACCEPTED
    assert seen(ready, ready.a) == [(*RALLY_1, 30.0), (*NEW, 25.0), (*RALLY_2, 40.0)]


@pytest.mark.parametrize("part", [(-1, 0), (0, 3), (2, 1), (3, 3), (-5, -1)])
def test_a_part_that_cannot_be(ready: Bench, part: tuple[int, int]) -> None:
    assert result(send(ready, ready.a, change(*part))) == ERROR
    assert len(seen(ready, ready.a)) == 2


def test_a_part_of_an_empty_list(ready: Bench) -> None:
    send(ready, ready.a, clear())
    assert result(send(ready, ready.a, change(0, -1))) == ERROR
    assert result(send(ready, ready.a, change(-1, 0))) == ERROR
    send(ready, ready.a, change(0, 0))
    assert result(send(ready, ready.a, item(0))) == ACCEPTED
    assert seen(ready, ready.a) == [(*NEW, 25.0)]


def test_who_does_not_command_writes_nothing(ready: Bench) -> None:
    for message in (count(1), item(0), change(0, 0), clear(), clear(255)):
        assert result(send(ready, ready.b, message)) == DENIED
    assert len(seen(ready, ready.b)) == 2
    assert untouched(ready)


@pytest.mark.parametrize(
    ("bad", "answer"),
    [
        ({"command": 16}, mavlink.MAV_MISSION_UNSUPPORTED),
        ({"frame": 0}, mavlink.MAV_MISSION_UNSUPPORTED_FRAME),
        ({"frame": 10}, mavlink.MAV_MISSION_UNSUPPORTED_FRAME),
        ({"place": (900000001, 0)}, mavlink.MAV_MISSION_INVALID_PARAM5_X),
        ({"place": (0, 1800000001)}, mavlink.MAV_MISSION_INVALID_PARAM6_Y),
        ({"place": (0, 0)}, mavlink.MAV_MISSION_INVALID_PARAM6_Y),
        ({"alt": float("nan")}, mavlink.MAV_MISSION_INVALID_PARAM7),
        ({"alt": float("inf")}, mavlink.MAV_MISSION_INVALID_PARAM7),
        ({"alt": 1e9}, mavlink.MAV_MISSION_INVALID_PARAM7),
    ],
)
def test_a_point_that_is_none_ends_the_upload_and_changes_nothing(
    ready: Bench, bad: dict[str, Any], answer: int
) -> None:
    send(ready, ready.a, count(2))
    send(ready, ready.a, item(0))
    assert result(send(ready, ready.a, item(1, **bad))) == answer
    assert send(ready, ready.a, item(0)) == [], "none is open any more"
    assert len(seen(ready, ready.a)) == 2
    assert seen(ready, ready.a)[0] == (*RALLY_1, 30.0)
    assert ready.companion.faults == {}


def test_too_many_points(ready: Bench) -> None:
    assert result(send(ready, ready.a, count(MOST_POINTS + 1))) == mavlink.MAV_MISSION_NO_SPACE
    assert result(send(ready, ready.a, count(65535))) == mavlink.MAV_MISSION_NO_SPACE
    assert len(seen(ready, ready.a)) == 2
    assert upload(ready, *[(NEW[0] + n, NEW[1]) for n in range(MOST_POINTS)]) == ACCEPTED
    assert len(seen(ready, ready.a)) == MOST_POINTS


def test_an_item_out_of_turn_changes_nothing_and_the_upload_goes_on(ready: Bench) -> None:
    send(ready, ready.a, count(2))
    assert send(ready, ready.a, item(1)) == []
    send(ready, ready.a, item(0))
    assert send(ready, ready.a, item(0)) == []
    assert result(send(ready, ready.a, item(1))) == ACCEPTED


def test_the_answer_is_given_again_where_the_first_was_lost(ready: Bench) -> None:
    """The fault: a program that had not heard the end of its upload was told that there was none."""
    assert upload(ready, NEW) == ACCEPTED
    assert result(send(ready, ready.a, item(0))) == ACCEPTED
    assert result(send(ready, ready.a, clear())) == ACCEPTED
    assert result(send(ready, ready.a, clear())) == ACCEPTED
    assert len(ready.journal("rally_list")) == 2, "and nothing is done again"


def test_its_sender_may_call_it_off(ready: Bench) -> None:
    """The fault: what its sender had given up went on being asked for."""
    send(ready, ready.a, count(2))
    cancel = mavlink.MAVLink_mission_ack_message(1, 1, mavlink.MAV_MISSION_OPERATION_CANCELLED, RALLY)
    assert send(ready, ready.a, cancel) == []
    ready.a.received.clear()
    ready.wait(10.0)
    assert [m for m in ready.a.received if getattr(m, "mission_type", None) == RALLY] == []
    assert len(seen(ready, ready.a)) == 2


def test_it_is_asked_for_again_and_given_up_in_the_end(ready: Bench) -> None:
    send(ready, ready.a, count(2))
    send(ready, ready.a, item(0))
    ready.a.received.clear()
    ready.wait(10.0)
    heard = [m for m in ready.a.received if getattr(m, "mission_type", None) == RALLY]
    assert {m.get_type() for m in heard[:-1]} == {"MISSION_REQUEST", "MISSION_REQUEST_INT"}
    assert {m.seq for m in heard[:-1]} == {1}
    assert heard[-1].type == mavlink.MAV_MISSION_OPERATION_CANCELLED
    assert len(seen(ready, ready.a)) == 2


def test_the_same_sender_may_begin_anew_and_another_one_waits(ready: Bench) -> None:
    send(ready, ready.a, count(2))
    assert send(ready, ready.a, count(1))[0].get_type() == "MISSION_REQUEST_INT"
    ready.a.received.clear()
    ready.a.send(count(1), sysid=241)  # behind the same station
    ready.run(0.2)
    assert [m.type for m in ready.a.got("MISSION_ACK")] == [DENIED]
    assert result(send(ready, ready.a, item(0))) == ACCEPTED


def test_an_upload_ends_with_the_authority_of_its_station(ready: Bench) -> None:
    send(ready, ready.a, count(1))
    ready.a.alive = False
    ready.wait(7.0)
    assert ready.companion.view.commander is None
    ready.a.send(item(0))
    ready.run(0.5)
    assert [(place[0], place[1]) for place in seen(ready, ready.b)] == [RALLY_1, RALLY_2]


def test_without_a_mission_there_is_none(bench: Bench) -> None:
    bench.connect()
    assert seen(bench, bench.a) == []
    assert upload(bench, NEW) == ACCEPTED
    assert bench.companion.faults == {}
