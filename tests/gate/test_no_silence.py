# SPDX-License-Identifier: GPL-3.0-or-later

"""No deliberate frame that is refused or dropped is without a word, and no stream of them fills the screen.

Every message, command, file opcode and payload type, from each role, on the ground, armed and in a rehearsal, by the
gate that ships. What has no word is listed here with its reason: `BY_THEMSELVES` and `REASONS_WITHOUT`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import AuthorityView, LeaseState, Phase
from mavproxy_handover.gate.judge import Fate, GateReason, StationIdentity
from mavproxy_handover.gate.policy.messages import MESSAGE_RULES
from mavproxy_handover.gate.refusals import (
    SILENT,
    STREAM_PAUSE_S,
    OncePerStream,
)
from mavproxy_handover.wire.frames import Frame
from tests.gate.door import Door
from tests.gate.ledger import CASES, GCSA, GCSB, A, B, Case

Make = Callable[..., Frame]

#: what programs send on their own, so that a text would only disturb: written out from the protocols
BY_THEMSELVES = {
    *("COMMAND_ACK", "MISSION_ACK", "LOGGING_ACK", "PING", "TIMESYNC", "HEARTBEAT"),
    *("REQUEST_DATA_STREAM", "TERRAIN_DATA"),
}
#: what only a component of the vehicle sends: from a station it is a loop of some router, or a lie
NO_PERSON = {
    name
    for rule in MESSAGE_RULES
    for name in rule.names
    if rule.why.startswith(
        (
            "ours, from the vehicle",
            "ours, between stations",
            "the modem's",
            "the radio receiver's",
            "from a gimbal",
            "the vehicle's own",
        )
    )
}
#: what a person does by these has a word elsewhere, or none is due
REASONS_WITHOUT = {
    GateReason.SITUATION: "the check of commands in flight tells it",
    GateReason.RAN_BEFORE: "the notices of sticks and setpoints tell it",
}
#: file opcodes that change something; the others read, or end a transfer: programs do so on their own, and get a
#: negative answer
WRITES = {6, 7, 8, 9, 10, 11, 12, 13}
#: sticks that are held: with zeros they are released, which needs no word
HELD = {"RC_CHANNELS_OVERRIDE": {"chan3_raw": 1500}}

GROUND = AuthorityView(Phase.ON_LOAD, GCSA, None, 1, LeaseState.HELD, armed=False)
VIEWS = {
    "on the ground": GROUND,
    "on the ground, no station": replace(GROUND, commander=None, lease=LeaseState.LOST),
    "armed": replace(GROUND, phase=Phase.ON_MISSION, armed=True),
    "rehearsal": replace(GROUND, phase=Phase.ON_MISSION, armed=True, rehearsal=True),
}
ROLES = {
    "commander": (A, 190),
    "observer": (B, 190),
    "component of the commander": (A, 100),
    "component of the observer": (B, 100),
}


def speaks_for_a_person(case: Case) -> bool:
    if case.name in BY_THEMSELVES or case.name in NO_PERSON:
        return False
    if case.name == "FILE_TRANSFER_PROTOCOL":
        return dict(case.fields)["payload"][3] in WRITES  # type: ignore[index]
    return not (case.name == "TUNNEL" and dict(case.fields)["payload_type"] in (47116, 47117))


def ours(case: Case) -> bool:
    """Messages of the handover, which stations send on their own."""
    return any(case.name in rule.names for rule in MESSAGE_RULES if rule.why.startswith("ours, from stations"))


@pytest.mark.parametrize("role", ROLES)
@pytest.mark.parametrize("view", VIEWS)
def test_no_deliberate_frame_is_refused_without_a_word(make: Make, view: str, role: str) -> None:
    station, component = ROLES[role]
    door = Door(step_s=400.0)
    door.change(VIEWS[view])
    refused: Counter[GateReason] = Counter()
    silent = []
    for case in CASES:
        frame = make(
            case.name, sysid=station.sysid, compid=component, version=2, **dict(case.fields), **HELD.get(case.name, {})
        )
        told = len(door.told) + len(door.said) + len(door.feed_news)
        verdict = door.up(station, frame).verdict
        door.gate.tick(door.now)
        if verdict.fate not in (Fate.REFUSE, Fate.DROP) or verdict.reason in REASONS_WITHOUT:
            continue
        refused[verdict.reason] += 1
        heard = len(door.told) + len(door.said) + len(door.feed_news) > told
        if speaks_for_a_person(case) and not ours(case) and not heard:
            silent.append((case.name, case.fields, verdict.reason))
    assert not silent, (len(silent), silent[:5])
    assert sum(refused.values()) > 300


@pytest.mark.parametrize("view", VIEWS)
def test_what_programs_do_on_their_own_brings_no_text(make: Make, view: str) -> None:
    for station in (A, B):
        door = Door(step_s=400.0)
        door.change(VIEWS[view])
        for name in sorted(BY_THEMSELVES | NO_PERSON):
            if any(cls.msgname == name for cls in mavlink.mavlink_map.values()):
                door.up(station, make(name, sysid=station.sysid, version=2))
        assert (door.said, door.told) == ([], [])


def test_the_two_lists_of_what_is_silent_agree() -> None:
    assert set(SILENT) == BY_THEMSELVES


#: a station, what it sends many times, and what it reads
STREAMS: list[tuple[StationIdentity, str, dict[str, Any], str]] = [
    (A, "MANUAL_CONTROL", {"x": 100}, "manual control refused: not before arming, sticks could arm the vehicle"),
    (A, "RC_CHANNELS_OVERRIDE", {"chan3_raw": 1500}, "RC override refused: not before arming, sticks could arm the"),
    (A, "SERIAL_CONTROL", {}, "serial passthrough refused: maintenance only, over no radio link"),
    (B, "CAN_FRAME", {}, "CAN passthrough refused: maintenance only, over no radio link"),
    (B, "TUNNEL", {"payload_type": 5}, "tunnel data refused: maintenance only, over no radio link"),
    (A, "V2_EXTENSION", {}, "extension data refused: maintenance only, over no radio link"),
    (B, "LANDING_TARGET", {}, "landing target refused: the vehicle takes it from no station"),
]


@pytest.mark.parametrize(("station", "name", "fields", "text"), STREAMS)
def test_a_stream_of_them_is_told_and_not_each_frame(
    make: Make, station: StationIdentity, name: str, fields: dict[str, Any], text: str
) -> None:
    door = Door(step_s=0.1)
    door.change(GROUND)
    for _ in range(600):
        door.up(station, make(name, sysid=station.sysid, version=2, **fields))
    assert {sysid for sysid, _ in door.said} == {station.sysid}
    assert {said[: len(text)] for _, said in door.said} == {text}
    assert len(door.said) <= 6, "one minute of ten frames a second"


def test_sticks_of_an_observer_before_arming(make: Make) -> None:
    door = Door(step_s=0.1)
    door.change(GROUND)
    for _ in range(100):
        door.up(B, make("MANUAL_CONTROL", sysid=GCSB, x=100))
    assert [news.state.value for news in door.told] == ["refused"]


class TestOncePerStream:
    def test_a_stream_is_told_once_while_it_goes_on(self) -> None:
        once, told = OncePerStream(), 0
        for tenth in range(10 * 120):
            told += once.allow(GCSA, "sticks", tenth / 10)
        assert told == 1
        assert once.allow(GCSB, "sticks", 1.0), "to each station"
        assert once.allow(GCSA, "targets", 1.0), "and each stream"

    def test_again_after_a_pause_and_after_some_minutes(self) -> None:
        once = OncePerStream()
        assert once.allow(GCSA, "sticks", 0.0)
        assert not once.allow(GCSA, "sticks", STREAM_PAUSE_S - 0.1)
        assert once.allow(GCSA, "sticks", 2 * STREAM_PAUSE_S)
        at = [now for now in range(61, 700, 10) if once.allow(GCSA, "sticks", float(now))]
        assert at == [361, 661]

    def test_a_station_with_ever_new_streams_is_told_so_many(self) -> None:
        once = OncePerStream(most=3)
        assert [once.allow(GCSA, number, 0.0) for number in range(5)] == [True, True, True, False, False]
        assert once.allow(GCSA, 9, STREAM_PAUSE_S), "those that have paused make room"
