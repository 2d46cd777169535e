# SPDX-License-Identifier: GPL-3.0-or-later

"""What stations read of the companion: why something is refused, who commands, how grave it is; and by which result
programs learn of a refusal that do not know the one of the standard."""

from __future__ import annotations

from typing import Any
from unittest.mock import MagicMock

import pytest
from MAVProxy.modules.mavproxy_link import LinkModule
from pymavlink.dialects.v20 import ardupilotmega as stock
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import FlightAction
from mavproxy_handover.operator.stations.announcer import SEVERITIES
from mavproxy_handover.wire.ids import RATES_COMPID
from tests.module.conftest import Bench

ARM, LAND, RTL, START = 400, 21, 20, 300
CONTROL, RATE = mavlink.MAV_CMD_REQUEST_OPERATOR_CONTROL, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
NOTICE, WARNING, CRITICAL = 5, 4, 2
DENIED, NOT_IN_CONTROL = 2, 10


@pytest.fixture
def two(bench: Bench) -> Bench:
    """Both stations run our module; the first commands."""
    bench.connect()
    bench.run(1.0)
    for station in (bench.a, bench.b):
        station.received.clear()
    return bench


def whole(bench: Bench) -> list[str]:
    return [text for _severity, text in bench.b.told()]


# ---- why something is refused --------------------------------------------------------------------------------------


def test_it_comes_from_the_companion_as_a_warning_and_to_who_asked_alone(two: Bench) -> None:
    two.b.send(mavlink.MAVLink_set_mode_message(1, 1, 6))
    two.run(0.3)
    assert two.b.told() == [(WARNING, "mode RTL refused: GCSA commands ('handover request')")]
    pieces = two.b.got("STATUSTEXT")
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in pieces} == {(1, 191)}
    assert [m.chunk_seq for m in pieces] == [0, 1]
    assert len({m.id for m in pieces}) == 1
    assert pieces[0].id > 0
    assert two.a.told() == []
    (entry,) = two.journal("told")
    assert (entry["station"], entry["text"]) == ("GCSB", "mode RTL refused: GCSA commands ('handover request')")


def test_once_in_ten_seconds_however_often_a_program_asks(two: Bench) -> None:
    for _ in range(25):
        two.b.command(ARM, 1.0)
        two.run(1.0)
    assert two.b.acks(ARM) == [NOT_IN_CONTROL] * 25
    assert whole(two) == ["arm refused: GCSA commands ('handover request')"] * 3


def test_what_start_lacks_is_one_text_whoever_asks_and_however_often(bench: Bench) -> None:
    bench.connect()
    for _ in range(3):
        bench.a.command(START)
        bench.run(1.0)
    assert len(bench.a.acks(START)) == 3
    (text,) = [text for severity, text in bench.a.told() if severity == WARNING]
    assert text == "START refused: no mission loaded; outside the zone of GCSA"
    bench.a.command(ARM, 1.0)
    bench.b.command(START)
    bench.run(0.3)
    assert bench.a.told()[-1] == (WARNING, "arm refused: no mission loaded; outside the zone of GCSA")
    assert bench.b.told()[-1] == (WARNING, "START refused: GCSA commands ('handover request')")


def test_a_denied_request_of_control_is_told_once_in_ten_seconds(two: Bench) -> None:
    for _ in range(5):
        two.b.command(CONTROL, 0, 1, 0, 10, component=191)
        two.run(1.0)
    assert two.b.acks(CONTROL) == [DENIED] * 5
    assert whole(two) == ["Control denied: release with takeover: the request of an old ground station?"]


# ---- programs that know nothing of ours ---------------------------------------------------------------------------


def console_of_mavproxy(messages: list[Any]) -> list[str]:
    """What the module link of a stock MAVProxy, whose target is the autopilot (1, 1), prints for texts."""
    link = MagicMock()
    link.status.statustexts_by_sysidcompid = {}
    link.status.last_apm_msg, link.status.last_apm_msg_time = "", 0.0
    link.heartbeat_is_from_autopilot.return_value = False
    link.target_system, link.target_component = 1, 1
    link.settings.target_system, link.settings.target_component = 1, 1
    link.message_is_from_primary_vehicle = lambda m: LinkModule.message_is_from_primary_vehicle(link, m)
    link.colors_for_severity.return_value = (None, None)
    link.emit_accumulated_statustext = lambda *a: LinkModule.emit_accumulated_statustext(link, *a)
    for message in messages:
        LinkModule.master_msg_handling(link, message, MagicMock())
    return [" ".join(str(call.args[0]).split()) for call in link.mpstate.console.writeln.call_args_list]


def test_a_stock_mavproxy_shows_what_the_companion_says(plain: Bench) -> None:
    """The fault: it shows texts of component 1 alone, and the companion's came from 191."""
    plain.b.received.clear()
    plain.b.command(LAND)
    plain.b.send(mavlink.MAVLink_mission_clear_all_message(1, 1, 255))
    plain.run(0.3)
    assert console_of_mavproxy(plain.b.got("STATUSTEXT")) == [
        "AP: Handover: LAND refused: GCSA commands",
        "AP: Handover: removal of everything refused: GCSA commands",
    ]
    pieces = plain.b.got("STATUSTEXT")
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in pieces} == {(1, 1)}
    assert [m.id == 0 or m.id > 0x8000 for m in pieces] == [True] * 3, "ArduPilot counts its own texts from 1"


def test_each_station_hears_it_the_way_that_its_program_understands(two: Bench) -> None:
    two.b._answer = lambda message: None  # type: ignore[method-assign]
    two.b.alive = False
    two.wait(6.0)
    two.b.alive = True
    two.run(2.0)
    for station in (two.a, two.b):
        station.received.clear()
    two.companion._base.message_sender.say_to_all("hello")
    two.run(0.2)
    assert [(m.get_srcComponent(), m.text) for m in two.a.got("STATUSTEXT")] == [(191, "hello")]
    assert [(m.get_srcComponent(), m.text) for m in two.b.got("STATUSTEXT")] == [(1, "Handover: hello")]


# ---- by which result -----------------------------------------------------------------------------------------------


def refused(bench: Bench, sysid: int = 252) -> Any:
    """The result of the last LAND."""
    bench.b.send(mavlink.MAVLink_command_long_message(1, 1, LAND, 0, *[0.0] * 7), sysid)
    bench.run(0.2)
    return bench.b.acks(LAND)[-1]


@pytest.fixture
def plain(bench: Bench) -> Bench:
    """The second station is a program that answers nothing of ours."""
    bench.b.digest = b""
    bench.b._answer = lambda message: None  # type: ignore[method-assign]
    bench.load()
    bench.until(lambda: bench.companion.view.commander == 251)
    bench.run(1.0)
    return bench


def test_a_plain_program_is_denied_and_one_that_asks_for_control_is_told_by_the_standards_result(plain: Bench) -> None:
    assert refused(plain) == DENIED
    assert plain.b.told()[-1] == (WARNING, "Handover: LAND refused: GCSA commands")
    plain.b.command(CONTROL, 0, 1, 0, 10, component=191)  # of 2024: it may not know the result
    plain.run(0.2)
    assert refused(plain) == DENIED
    plain.b.command(CONTROL, 1, 0, 10, 252, component=191)
    plain.run(0.2)
    assert refused(plain) == NOT_IN_CONTROL


def test_a_release_shows_it_where_it_cannot_be_one_of_2024(plain: Bench) -> None:
    plain.b.command(CONTROL, 0, 0, 0, 0, component=191)
    plain.run(0.2)
    assert refused(plain) == DENIED
    plain.b.command(CONTROL, 0, 0, 0, 252, component=191)
    plain.run(0.2)
    assert refused(plain) == NOT_IN_CONTROL


def test_after_a_silence_it_may_be_another_program(plain: Bench) -> None:
    plain.b.command(CONTROL, 1, 0, 10, 252, component=191)
    plain.run(0.2)
    plain.b.alive = False
    plain.wait(6.0)
    plain.b.alive = True
    plain.run(1.5)
    assert refused(plain) == DENIED


def test_our_module_shows_it_by_answering_and_again_after_a_silence(two: Bench) -> None:
    assert refused(two) == NOT_IN_CONTROL
    two.b.alive = False
    two.wait(6.0)
    two.b.alive = True
    two.wait(3.0)
    assert refused(two) == NOT_IN_CONTROL


@pytest.mark.parametrize(("word", "result"), [("always", NOT_IN_CONTROL), ("never", DENIED)])
def test_the_configuration_says_it_for_a_station(bench: Bench, word: str, result: int) -> None:
    text = bench.config.read_text().replace("sysid = 252\n", f'sysid = 252\n            not_in_control = "{word}"\n')
    bench.config.write_text(text)
    bench.connect()
    bench.run(1.0)
    assert refused(bench) == result


# ---- who commands --------------------------------------------------------------------------------------------------


def test_how_grave_each_decision_is() -> None:
    assert {action: SEVERITIES[action] for action in (None, *FlightAction)} == {
        None: NOTICE,
        FlightAction.WARN: WARNING,
        FlightAction.TRANSFER: WARNING,
        FlightAction.HOLD: WARNING,
        FlightAction.CONTINUE: WARNING,
        FlightAction.RETURN: CRITICAL,
        FlightAction.LAND: CRITICAL,
    }


def test_a_lost_commander_is_told_of_too(two: Bench) -> None:
    two.a.alive = False
    two.until(lambda: two.companion.view.commander is None)
    two.run(0.2)
    assert (NOTICE, "no station commands now") in two.b.told()


# ---- the companion's own console -----------------------------------------------------------------------------------


def printed(ack: Any) -> list[str]:
    """What the module link of the MAVProxy that is installed prints for an acknowledgement of the autopilot."""
    link = MagicMock()
    link.settings.target_system = link.settings.target_component = 0
    link.heartbeat_is_from_autopilot.return_value = False
    if hasattr(LinkModule, "should_show_command_ack"):  # from 1.8.75 on
        link.should_show_command_ack = lambda m: LinkModule.should_show_command_ack(link, m)
    LinkModule.master_msg_handling(link, ack, MagicMock())
    return [str(call.args[0]) for call in link.mpstate.console.writeln.call_args_list]


def test_the_answers_to_our_own_wishes_for_rates_are_not_printed_and_an_operators_are(two: Bench) -> None:
    two.companion.autopilot.streams.renew()
    two.autopilot.received.clear()
    two.run(2.0)
    wishes = [m for m in two.autopilot.got("COMMAND_LONG", 1) if m.command == RATE]
    assert len(wishes) >= 10, "as at each change of authority"
    for wish in wishes:
        component = wish.get_srcComponent()
        ours = stock.MAVLink_command_ack_message(RATE, 0, 0, 0, 1, component)
        assert printed(ours) == []
    operators = stock.MAVLink_command_ack_message(RATE, 0, 0, 0, 1, 191)
    assert printed(operators) == ["Got COMMAND_ACK: SET_MESSAGE_INTERVAL: ACCEPTED"]


def test_no_station_hears_them(two: Bench) -> None:
    autopilot = stock.MAVLink(None, srcSystem=1, srcComponent=1)
    for aim in ((1, RATES_COMPID), (251, 190)):
        raw = stock.MAVLink_command_ack_message(RATE, 0, 0, 0, *aim).pack(autopilot)
        two.mpstate.deliver(stock.MAVLink(None).decode(bytearray(raw)))
    two.run(0.3)
    assert [m.target_system for m in two.a.got("COMMAND_ACK")] == [251]
    assert two.b.got("COMMAND_ACK") == []
