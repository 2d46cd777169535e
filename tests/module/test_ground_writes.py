# SPDX-License-Identifier: GPL-3.0-or-later

"""On the ground: what drops a mission package, what does not, who is told, and how it is loaded again."""

from __future__ import annotations

from operator import attrgetter
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.wire.file_transfer import Head
from mavproxy_handover.wire.file_transfer import message as file_message
from tests.module.conftest import Bench
from tests.module.test_commands_in_flight import take_off
from tests.module.test_flight_uploads import ACCEPTED, INSIDE, Program
from tests.module.test_mission_upload import LOADED, REFUSED, send
from tests.module.test_rehearsal import END, ask, begin
from tests.packages import ROUND

VEHICLE = (1, 1)
TERMINATE, RESET, LIST, OPEN_READ, READ, CREATE, WRITE, OPEN_WRITE, BURST = 1, 2, 3, 4, 5, 6, 7, 11, 15

NO_TAKE_OFF = (
    "The mission of GCSA is on the autopilot and is not flown: the first flown item is NAV_WAYPOINT (allowed: "
    "NAV_TAKEOFF first). START needs another mission or 'handover share'."
)


def ftp(bench: Bench, opcode: int, data: bytes = b"", sequence: int = 7) -> None:
    bench.a.send(file_message(VEHICLE, Head(sequence, 0, opcode, len(data)), data))
    bench.run(0.1)


def upload(bench: Bench, kind: int = 0) -> None:
    """A short mission, or geofence, as a ground station program writes it on the ground."""
    bench.a.send(mavlink.MAVLink_mission_count_message(*VEHICLE, 2, kind))
    for seq in range(2):
        values = (seq, 3, 16, 0, 1, 0.0, 0.0, 0.0, 0.0, 526790000, 59240000, 20.0, kind)
        bench.run(0.1)
        bench.a.send(mavlink.MAVLink_mission_item_int_message(*VEHICLE, *values))
    bench.run(0.2)


def needs(bench: Bench) -> str:
    return "; ".join(bench.companion.arbiter.start_needs(251, bench.clock.now))


def told(station: Any) -> list[str]:
    """What a station was told of its mission."""
    words = ("package", "Mission", "mission")
    return [text for _severity, text in station.told() if any(word in text for word in words)]


@pytest.fixture
def loaded(bench: Bench, delivery: MissionPackage) -> Bench:
    bench.connect()
    assert bench.share(delivery, at_once=True).result == LOADED
    bench.a.received.clear()
    bench.b.received.clear()
    return bench


@pytest.fixture
def on_board(bench: Bench) -> Bench:
    """The package is named in the vehicle's configuration, and loaded."""
    bench.configure(more=f'mission = "{ROUND}"')
    bench.connect()
    bench.until(lambda: bench.companion.arbiter.mission_digest)
    bench.wait(12.0)
    bench.a.received.clear()
    bench.b.received.clear()
    return bench


# ---- what drops nothing ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("opcode", "path"),
    [
        (TERMINATE, b""),
        (RESET, b""),
        (LIST, b"/"),
        (OPEN_READ, b"@PARAM/param.pck?withdefaults=1"),
        (OPEN_READ, b"@MISSION/mission.dat"),
        (BURST, b""),
        (OPEN_WRITE, b"@PARAM/param.pck"),
        (CREATE, b"/APM/terrain/N52E005.DAT"),
        (WRITE, b"abc"),
    ],
)
def test_a_file_transfer_that_writes_no_mission_drops_no_package(
    loaded: Bench, delivery: MissionPackage, opcode: int, path: bytes
) -> None:
    """The fault: the end of a session after 'param fetch' dropped the mission."""
    ftp(loaded, opcode, path)
    loaded.run(1.0)
    assert loaded.companion.arbiter.mission_digest == delivery.digest
    assert told(loaded.a) == told(loaded.b) == []


def test_arming_and_start_are_not_refused_while_parameters_are_read(on_board: Bench) -> None:
    """The fault: with a package on board each download of parameters opened ten seconds without a mission."""
    for sequence, (opcode, path) in enumerate(
        [(RESET, b""), (OPEN_READ, b"@PARAM/param.pck"), (BURST, b""), (TERMINATE, b""), (RESET, b"")]
    ):
        ftp(on_board, opcode, path, sequence)
        assert needs(on_board) == ""
    on_board.a.send(mavlink.MAVLink_param_request_list_message(*VEHICLE))
    on_board.run(0.1)
    assert needs(on_board) == ""
    on_board.a.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    on_board.run(0.5)
    assert on_board.a.acks(mavlink.MAV_CMD_COMPONENT_ARM_DISARM) == [0]


# ---- what drops it, and who hears of it ---------------------------------------------------------------------------


def test_an_upload_on_the_ground_drops_the_package_and_every_station_is_told_with_the_cure(loaded: Bench) -> None:
    upload(loaded)
    assert loaded.companion.arbiter.mission_digest == b""
    loaded.run(1.0)
    assert told(loaded.a) == [NO_TAKE_OFF]
    assert told(loaded.b) == [NO_TAKE_OFF]
    assert "no mission loaded, because the first flown item is NAV_WAYPOINT" in needs(loaded)
    loaded.wait(30.0)
    assert told(loaded.a) == [NO_TAKE_OFF], "once"
    (entry,) = loaded.journal("list_changed")
    assert (entry["station"], entry["list"]) == ("GCSA", "mission")


@pytest.mark.parametrize(
    ("write", "why"),
    [
        (lambda bench: upload(bench, 1), "the geofence of GCSA is being judged"),
        (lambda bench: ftp(bench, OPEN_WRITE, b"@MISSION/mission.dat"), "the mission of GCSA is being judged"),
        (lambda bench: ftp(bench, CREATE, b"@mission//fence.dat"), "the geofence of GCSA is being judged"),
        (lambda bench: bench.a.send(mavlink.MAVLink_mission_clear_all_message(*VEHICLE, 0)), "GCSA cleared it"),
        (
            lambda bench: bench.a.send(mavlink.MAVLink_mission_write_partial_list_message(*VEHICLE, 1, 2, 0)),
            "the mission of GCSA is being judged",
        ),
        (
            lambda bench: bench.a.command(mavlink.MAV_CMD_DO_AUX_FUNCTION, 58, 2),
            "the mission of GCSA is being judged",
        ),
        (
            lambda bench: bench.a.send(mavlink.MAVLink_param_set_message(*VEHICLE, b"MIS_TOTAL", 0.0, 9)),
            "the mission of GCSA is being judged",
        ),
        (
            lambda bench: bench.a.send(mavlink.MAVLink_fence_point_message(*VEHICLE, 0, 0, 0.0, 0.0)),
            "the geofence of GCSA is being judged",
        ),
    ],
    ids=["fence", "mission file", "fence file", "clear", "partial list", "CLEAR_WP", "MIS_TOTAL", "FENCE_POINT"],
)
def test_whatever_changes_mission_or_geofence_drops_the_package(loaded: Bench, write: Any, why: str) -> None:
    write(loaded)
    loaded.run(0.1)
    assert loaded.companion.arbiter.mission_digest == b""
    assert needs(loaded) == f"no mission loaded, because {why}"


@pytest.mark.parametrize(
    "part",
    [
        "event_log.accepted",
        "autopilot.orders.give_start_up",
        "autopilot.command_check.start",
        "gate._passed.flusher.saw",
    ],
)
def test_an_upload_drops_the_package_though_something_else_breaks(
    loaded: Bench, part: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The fault: the frame had gone to the autopilot, but a fault in the journal hid what it does there: START was
    accepted with a package that the autopilot does not hold."""

    def broken(*_anything: Any, **_more: Any) -> None:
        raise RuntimeError("a bug")

    where, _, name = part.rpartition(".")
    monkeypatch.setattr(attrgetter(where)(loaded.companion), name, broken)
    loaded.a.send(mavlink.MAVLink_mission_clear_all_message(*VEHICLE, 0))
    loaded.run(0.3)
    monkeypatch.undo()
    assert loaded.companion.arbiter.mission_digest == b""
    assert "no mission loaded" in needs(loaded)


def test_without_a_package_the_sender_is_told_what_an_upload_is_not(bench: Bench) -> None:
    bench.connect()
    upload(bench)
    bench.run(1.0)
    text = (
        "The mission of GCSA is on the autopilot and is not flown: without a mission package no zones are known. START "
        "needs a mission package: 'handover share'."
    )
    assert told(bench.a) == told(bench.b) == [text]


# ---- what stays ---------------------------------------------------------------------------------------------------


def test_an_upload_on_the_ground_is_not_replaced_by_the_package_on_board(on_board: Bench) -> None:
    """The fault: it was accepted, and replaced fifteen seconds later without a word."""
    upload(on_board)
    on_board.wait(60.0)
    assert len(on_board.autopilot.items[0]) == 2, "it stays"
    text = f"{NO_TAKE_OFF} Or clear the mission: then the package on board is loaded."
    assert told(on_board.a) == told(on_board.b) == [text]


def test_after_the_mission_is_cleared_the_package_on_board_is_loaded_and_all_are_told(
    on_board: Bench, delivery: MissionPackage
) -> None:
    upload(on_board)
    on_board.wait(5.0)
    on_board.b.received.clear()
    on_board.a.send(mavlink.MAVLink_mission_clear_all_message(*VEHICLE, 0))
    on_board.until(lambda: on_board.companion.arbiter.mission_digest == delivery.digest, limit_s=20.0)
    assert len(on_board.autopilot.items[0]) == 12
    on_board.run(0.5)
    assert told(on_board.b) == [
        "GCSA cleared the mission on the autopilot. The package on board is loaded in 10 s.",
        "Mission delivery loaded from the vehicle's own package: written, read back, equal.",
    ]


def test_a_program_that_clears_before_it_writes_keeps_what_it_writes(on_board: Bench) -> None:
    on_board.a.send(mavlink.MAVLink_mission_clear_all_message(*VEHICLE, 0))
    on_board.wait(3.0)
    upload(on_board)
    on_board.wait(60.0)
    assert len(on_board.autopilot.items[0]) == 2


# ---- how it is loaded again ---------------------------------------------------------------------------------------


def test_a_package_that_was_dropped_is_written_again_when_it_is_shared(loaded: Bench, delivery: MissionPackage) -> None:
    """The fault: 'loaded' was said again, with nothing written, until the companion was restarted."""
    upload(loaded)
    assert loaded.share(delivery).result == LOADED
    assert len(loaded.autopilot.items[0]) == 12, "it was written"
    assert loaded.companion.arbiter.mission_digest == delivery.digest
    assert needs(loaded) == ""


def test_the_package_on_board_can_be_shared_over_an_upload(on_board: Bench, delivery: MissionPackage) -> None:
    upload(on_board)
    assert on_board.share(delivery).result == LOADED
    assert len(on_board.autopilot.items[0]) == 12


def test_each_share_on_the_ground_is_written_and_read_back(loaded: Bench, delivery: MissionPackage) -> None:
    """Somebody may have written a mission past the companion, by another port of the autopilot."""
    loaded.wait(10.0)
    loaded.autopilot.items[0] = loaded.autopilot.items[0][:3]
    assert loaded.share(delivery).result == LOADED
    assert len(loaded.autopilot.items[0]) == 12


def test_a_failed_attempt_is_not_called_loaded_because_of_an_earlier_one(
    loaded: Bench, delivery: MissionPackage
) -> None:
    loaded.wait(10.0)
    loaded.autopilot.results[0] = mavlink.MAV_MISSION_ERROR
    assert loaded.share(delivery).result == REFUSED
    loaded.run(1.0)
    (text,) = told(loaded.b)
    assert text == (
        "Mission delivery not loaded: the autopilot refused the mission: MAV_MISSION_ERROR. START needs "
        "'handover share'."
    )
    del loaded.autopilot.results[0]
    assert loaded.share(delivery).result == LOADED


def test_a_write_in_the_middle_of_a_load_ends_the_load(loaded: Bench, delivery: MissionPackage) -> None:
    """After the read-back the autopilot would hold the upload, and the package would count."""
    loaded.wait(10.0)
    sender = send(loaded, delivery)
    loaded.until(lambda: "load" in loaded.companion.autopilot.conversations)
    loaded.a.send(mavlink.MAVLink_mission_count_message(*VEHICLE, 2, 0))
    loaded.until(lambda: sender.finished)
    assert (sender.result, sender.text) == (REFUSED, "GCSA changed the mission meanwhile")
    assert loaded.companion.arbiter.mission_digest == b""


def test_a_mission_file_that_is_open_is_thrown_away_before_a_package_is_written(
    loaded: Bench, delivery: MissionPackage
) -> None:
    """The autopilot applies such a file when it is closed: after the load it would replace the package's mission."""
    ftp(loaded, CREATE, b"@MISSION/mission.dat")
    loaded.autopilot.received.clear()
    assert loaded.share(delivery).result == LOADED
    requests = [bytes(m.payload)[3] for m in loaded.autopilot.got("FILE_TRANSFER_PROTOCOL")]
    assert requests == [WRITE, TERMINATE], "the header is overwritten, then the file is closed"
    order = [m.get_type() for m in loaded.autopilot.received]
    assert order.index("FILE_TRANSFER_PROTOCOL") < order.index("MISSION_COUNT")


def test_the_last_word_in_flight_says_that_nothing_was_written(bench: Bench, delivery: MissionPackage) -> None:
    take_off(bench, delivery)
    bench.wait(10.0)
    sender = bench.share(delivery)
    assert (sender.result, sender.text) == (LOADED, "held already, nothing was written")


def test_another_stations_offer_of_the_held_package_disturbs_no_load(loaded: Bench, delivery: MissionPackage) -> None:
    loaded.wait(10.0)
    offer = mavlink.MAVLink_mission_package_message(1, 191, 9, list(delivery.digest), b"delivery")
    loaded.b.send(offer)
    loaded.run(0.2)
    (ack,) = loaded.b.got("MISSION_PACKAGE_ACK")
    assert (ack.result, ack.text) == (LOADED, "held already, nothing was written")
    loaded.autopilot.items[0] = loaded.autopilot.items[0][:3]
    assert loaded.share(delivery).result == LOADED
    assert len(loaded.autopilot.items[0]) == 12, "the commander's is written all the same"


def test_a_write_in_the_middle_of_start_ends_start(loaded: Bench) -> None:
    """The aircraft would fly a mission that no package has."""
    loaded.autopilot.script[mavlink.MAV_CMD_COMPONENT_ARM_DISARM] = None  # it takes its time
    loaded.a.command(mavlink.MAV_CMD_MISSION_START)
    loaded.run(0.5)
    assert loaded.companion.arbiter.grounded(loaded.clock.now) is False, "START is under way"
    upload(loaded)
    loaded.wait(8.0)
    assert mavlink.MAV_CMD_MISSION_START not in loaded.autopilot.commands()
    (failed,) = loaded.journal("start_failed")
    assert failed["text"] == "START failed: GCSA changed the mission"
    assert loaded.companion.arbiter.grounded(loaded.clock.now)


# ---- a second flight ----------------------------------------------------------------------------------------------


def landed_after_an_upload(bench: Bench, delivery: MissionPackage) -> None:
    take_off(bench, delivery)
    bench.autopilot.items = {kind: list(items) for kind, items in bench.autopilot.items.items()}
    assert Program(bench, INSIDE).send() == ACCEPTED
    bench.a.received.clear()
    bench.b.received.clear()
    bench.autopilot.armed = bench.autopilot.airborne = False
    bench.wait(3.0)


def test_after_an_upload_in_flight_the_package_can_be_shared_for_a_second_flight(
    bench: Bench, delivery: MissionPackage
) -> None:
    landed_after_an_upload(bench, delivery)
    assert bench.companion.arbiter.mission_digest == b""
    assert told(bench.b) == ["The mission was changed in flight. START needs 'handover share'."]
    assert bench.share(delivery).result == LOADED
    assert len(bench.autopilot.items[0]) == 12
    assert needs(bench) == ""


def test_after_an_upload_in_flight_the_package_on_board_is_loaded_and_all_are_told(
    bench: Bench, delivery: MissionPackage
) -> None:
    bench.configure(more=f'mission = "{ROUND}"')
    landed_after_an_upload(bench, delivery)
    bench.until(lambda: bench.companion.arbiter.mission_digest == delivery.digest)
    bench.run(0.5)
    assert told(bench.b) == [
        "The mission was changed in flight. The package on board is loaded now.",
        "Mission delivery loaded from the vehicle's own package: written, read back, equal.",
    ]


def test_in_a_rehearsal_a_mission_file_is_refused_and_the_package_stays(
    loaded: Bench, delivery: MissionPackage
) -> None:
    assert begin(loaded)
    loaded.until(lambda: loaded.companion.view.rehearsal)
    ftp(loaded, CREATE, b"@MISSION/mission.dat")
    ask(loaded, loaded.a, END)
    loaded.until(lambda: not loaded.companion.view.rehearsal)
    loaded.run(2.0)
    assert loaded.autopilot.got("FILE_TRANSFER_PROTOCOL") == []
    assert loaded.companion.arbiter.mission_digest == delivery.digest
