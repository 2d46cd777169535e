# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover request`, `give` and `release` typed at a station: what goes out, what comes back, what is shown."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from gcs_module import commands as station_commands
from gcs_module import module as gcs_module
from tests.module.conftest import Clock
from tests.module.test_station_module import StationBench, connect_message

CONTROL = mavlink.MAV_CMD_REQUEST_OPERATOR_CONTROL
ACCEPTED, DENIED, FAILED = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_DENIED, mavlink.MAV_RESULT_FAILED
GRANTED, WAITING = 0, 2
ZONE, REQUESTED = 1, 26
RECOVERING, LOST, HELD = 4, 3, 1


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch, clock: Clock, tmp_path: Path) -> Iterator[StationBench]:
    """GCSA, whose operator is asked about every handover; it has heard of the vehicle."""
    monkeypatch.setattr(gcs_module, "time", clock)
    monkeypatch.setattr(station_commands, "time", clock)
    bench = StationBench(tmp_path, clock)
    bench.configure(consent="operator")
    assert bench.load() is not None, bench.mpstate.console.lines
    bench.hear(connect_message())
    bench.sent()
    yield bench
    bench.close()
    assert bench.mpstate.escaped == []


def controls(bench: StationBench) -> list[tuple[int, tuple[float, ...]]]:
    """The requests of control that have gone out: component asked, and p1 to p4."""
    return [
        (m.target_component, (m.param1, m.param2, m.param3, m.param4))
        for m in bench.sent()
        if m.get_type() == "COMMAND_LONG" and m.command == CONTROL
    ]


def answer(bench: StationBench, result: int) -> None:
    bench.hear(mavlink.MAVLink_command_ack_message(CONTROL, result, 0, 0, 251, 190))
    bench.run(0.6)


def asked_as_partner(handover_id: int, epoch: int = 1, reason: int = REQUESTED) -> Any:
    """HANDOVER_REQUEST: GCSB commands, GCSA is to take the aircraft."""
    unknown = [0] * (len(mavlink.MAVLink_handover_request_message.fieldnames) - 8)
    return mavlink.MAVLink_handover_request_message(251, 190, 1, 252, 251, handover_id, epoch, reason, *unknown)


def asked_as_commander(handover_id: int) -> Any:
    """ON_HANDOVER: GCSB is ready."""
    return mavlink.MAVLink_on_handover_message(251, 190, 1, 251, 252, handover_id, 1, 0, 0, 0)


def consents(bench: StationBench) -> list[tuple[str, int]]:
    return [(m.get_type(), m.consent) for m in bench.sent() if hasattr(m, "consent")]


@pytest.mark.parametrize(
    ("line", "parameters"),
    [
        ("request", (1.0, 0.0, 30.0, 251.0)),
        ("give GCSB", (1.0, 0.0, 30.0, 252.0)),
        ("release", (0.0, 0.0, 0.0, 251.0)),
    ],
)
class TestEach:
    def test_goes_to_the_companion_in_the_layout_of_2026(
        self, bench: StationBench, line: str, parameters: tuple[float, ...]
    ) -> None:
        bench.mpstate.type(f"handover {line}")
        assert controls(bench) == [(191, parameters)]

    def test_is_asked_three_times_and_given_up(
        self, bench: StationBench, line: str, parameters: tuple[float, ...]
    ) -> None:
        bench.mpstate.type(f"handover {line}")
        bench.run(6.0)
        assert controls(bench) == [(191, parameters)] * 3
        word = line.split(maxsplit=1)[0].upper()
        assert bench.mpstate.console.said(f"{word}: no answer of the vehicle.")
        assert bench.journal("command")[-1]["result"] == "no answer"

    @pytest.mark.parametrize(
        ("result", "text", "journalled"),
        [
            (ACCEPTED, "accepted.", "accepted"),
            (DENIED, "refused: denied.", "denied"),
            (10, "refused: not in control.", "not_in_control"),
            (77, "refused: 77.", "77"),
        ],
    )
    def test_its_answer_is_shown_and_ends_it(
        self, bench: StationBench, line: str, parameters: tuple[float, ...], result: int, text: str, journalled: str
    ) -> None:
        bench.mpstate.type(f"handover {line}")
        answer(bench, result)
        word = line.split(maxsplit=1)[0].upper()
        assert bench.mpstate.console.said(f"{word} {text}")
        assert bench.journal("command")[-1]["result"] == journalled
        bench.sent()
        bench.run(10.0)
        assert controls(bench) == []

    def test_the_roles_do_not_change_by_it(self, bench: StationBench, line: str, parameters: tuple[float, ...]) -> None:
        # only what the vehicle says of authority counts
        bench.hear(connect_message(epoch=2, commander=252))
        bench.mpstate.type(f"handover {line}")
        answer(bench, ACCEPTED)
        assert bench.mpstate.type("handover status")[1] == "commander GCSB, epoch 2; this station is observer"


@pytest.mark.parametrize("line", ["request", "give GCSB"])
def test_pending_is_told_as_what_it_is(bench: StationBench, line: str) -> None:
    bench.mpstate.type(f"handover {line}")
    answer(bench, FAILED)
    assert bench.mpstate.console.said(f"{line.split(maxsplit=1)[0].upper()}: the commander is being asked.")
    assert bench.journal("command")[-1]["result"] == "pending"


def test_a_release_that_fails_is_no_question(bench: StationBench) -> None:
    bench.mpstate.type("handover release")
    answer(bench, FAILED)
    assert bench.mpstate.console.said("RELEASE refused: failed.")


class TestNames:
    @pytest.mark.parametrize("name", ["GCSA", "gcsb", "GCSC", "252", "x" * 60])
    def test_a_station_that_is_not_known_is_told_and_nothing_sent(self, bench: StationBench, name: str) -> None:
        said = bench.mpstate.type(f"handover give {name}")
        assert said == [f"handover give: no station {name!r}; the stations are GCSB"]
        assert controls(bench) == []

    @pytest.mark.parametrize(
        ("line", "shown"),
        [
            ("give", "usage: handover give STATION: "),
            ("give GCSB now", "usage: handover give STATION: "),
            ("request GCSB", "handover: unknown command 'request GCSB'"),
            ("release now", "handover: unknown command 'release now'"),
        ],
    )
    def test_too_few_words_or_too_many_show_the_usage(self, bench: StationBench, line: str, shown: str) -> None:
        assert bench.mpstate.type(f"handover {line}")[0].startswith(shown)
        assert controls(bench) == []


class TestTimeout:
    def test_it_can_be_set(self, bench: StationBench) -> None:
        bench.mpstate.type("handover set request_timeout 45")
        bench.mpstate.type("handover request")
        bench.mpstate.type("handover give GCSB")
        assert [parameters[2] for _component, parameters in controls(bench)] == [45.0, 45.0]

    @pytest.mark.parametrize("value", ["2.9", "61", "-1", "x", ""])
    def test_within_the_standards_range(self, bench: StationBench, value: str) -> None:
        bench.mpstate.type(f"handover set request_timeout {value}")
        assert bench.module.commands.settings.request_timeout == 30.0


class TestWish:
    """What the operator asked for need not be asked of him again."""

    def test_who_asked_for_the_aircraft_is_not_asked_whether_he_takes_it(self, bench: StationBench) -> None:
        bench.hear(connect_message(epoch=2, commander=252))
        bench.mpstate.type("handover request")
        answer(bench, FAILED)
        bench.sent()
        bench.hear(asked_as_partner(3, epoch=2))
        assert consents(bench) == [("ON_HANDOVER", GRANTED)]
        assert not any("handover accept" in line for line in bench.mpstate.console.lines)

    def test_a_request_that_the_vehicle_does_not_answer_is_no_consent(self, bench: StationBench) -> None:
        bench.hear(connect_message(epoch=2, commander=252))
        bench.mpstate.type("handover request")
        bench.run(10.0)
        bench.sent()
        bench.hear(asked_as_partner(3, epoch=2))
        assert consents(bench) == [("ON_HANDOVER", WAITING)]

    @pytest.mark.parametrize("reason", [ZONE, REQUESTED])
    def test_a_refused_request_is_no_consent(self, bench: StationBench, reason: int) -> None:
        bench.hear(connect_message(epoch=2, commander=252))
        bench.mpstate.type("handover request")
        answer(bench, DENIED)
        bench.run(1.0)
        bench.sent()
        bench.hear(asked_as_partner(3, epoch=2, reason=reason))
        assert consents(bench) == [("ON_HANDOVER", WAITING)]

    def test_without_that_he_is(self, bench: StationBench) -> None:
        bench.hear(connect_message(epoch=2, commander=252))
        bench.sent()
        bench.hear(asked_as_partner(3, epoch=2))
        assert consents(bench) == [("ON_HANDOVER", WAITING)]

    def test_to_give_it_away_is_no_consent_to_what_the_vehicle_asks_for_another_reason(
        self, bench: StationBench
    ) -> None:
        # about a gift it asks nothing
        bench.mpstate.type("handover give GCSB")
        answer(bench, ACCEPTED)
        bench.sent()
        bench.hear(asked_as_commander(3))
        assert consents(bench) == [("OK_HANDOVER", WAITING)]

    def test_to_give_it_to_the_one_it_is_asked_about_is_the_answer(self, bench: StationBench) -> None:
        bench.hear(asked_as_commander(3))
        bench.sent()
        bench.mpstate.type("handover give GCSB")
        assert consents(bench) == [("OK_HANDOVER", GRANTED)]

    def test_the_wish_is_of_one_station(self, bench: StationBench) -> None:
        bench.mpstate.type("handover request")  # it commands already; that says nothing of GCSB
        bench.sent()
        bench.hear(asked_as_commander(3))
        assert consents(bench) == [("OK_HANDOVER", WAITING)]

    def test_it_is_good_for_one_transfer(self, bench: StationBench) -> None:
        bench.hear(connect_message(epoch=2, commander=252))
        bench.mpstate.type("handover request")
        bench.sent()
        for number in (3, 3, 4):
            bench.hear(asked_as_partner(number, epoch=2))
        assert consents(bench) == [("ON_HANDOVER", GRANTED), ("ON_HANDOVER", GRANTED), ("ON_HANDOVER", WAITING)]

    @pytest.mark.parametrize(("after_s", "consent"), [(58.0, GRANTED), (61.0, WAITING)])
    def test_it_stands_for_a_minute(self, bench: StationBench, after_s: float, consent: int) -> None:
        bench.hear(connect_message(epoch=2, commander=252))
        bench.mpstate.type("handover request")
        answer(bench, FAILED)
        bench.run(after_s)
        bench.sent()
        bench.hear(asked_as_partner(3, epoch=2))
        assert consents(bench) == [("ON_HANDOVER", consent)]


class TestAfterARestart:
    """AUTHORITY_STATUS of a vehicle that has restarted: nobody commands yet, and then somebody does, in one epoch."""

    def status(self, bench: StationBench, commander: int, epoch: int, lease: int) -> None:
        bench.hear(mavlink.MAVLink_authority_status_message(1, commander, 0, 251, epoch, 7, lease, 2, 0))

    def test_the_same_commander_is_believed(self, bench: StationBench) -> None:
        self.status(bench, 0, 2, RECOVERING)
        assert bench.mpstate.type("handover status")[1] == "commander no station, epoch 2; this station is observer"
        self.status(bench, 251, 2, HELD)
        assert bench.mpstate.type("handover status")[1] == "commander GCSA, epoch 2; this station is commander"

    def test_a_late_word_of_before_is_not(self, bench: StationBench) -> None:
        self.status(bench, 251, 2, HELD)
        self.status(bench, 0, 2, RECOVERING)
        bench.hear(connect_message(epoch=2, commander=0))
        assert bench.mpstate.type("handover status")[1] == "commander GCSA, epoch 2; this station is commander"

    def test_nobody_any_more_is_final_within_the_epoch(self, bench: StationBench) -> None:
        self.status(bench, 251, 2, HELD)
        self.status(bench, 0, 2, LOST)
        self.status(bench, 251, 2, HELD)
        assert bench.mpstate.type("handover status")[1] == "commander no station, epoch 2; this station is observer"


@pytest.mark.parametrize(("later", "answer"), [("", GRANTED), ("release", WAITING), ("give GCSB", WAITING)])
def test_what_was_typed_after_a_request_takes_it_back(bench: StationBench, later: str, answer: int) -> None:
    """The fault: for a minute the request was consent, though the operator had released control since."""
    bench.hear(connect_message(epoch=2, commander=252))
    bench.mpstate.type("handover request")
    bench.run(0.2)
    if later:
        bench.mpstate.type(f"handover {later}")
    bench.sent()
    bench.hear(asked_as_partner(3, epoch=2))
    assert consents(bench) == [("ON_HANDOVER", answer)]
