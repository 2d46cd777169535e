# SPDX-License-Identifier: GPL-3.0-or-later

"""Every message and every command, from every kind of sender, in every phase, against the second book-keeping."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.gate.judge import Fate, GateReason, StationIdentity, judge
from mavproxy_handover.gate.policy.access import Access
from mavproxy_handover.wire.frames import Frame, parse_one
from mavproxy_handover.wire.signing import SignatureVerdict, Verifier, sign, timestamp_of
from tests.depth import first
from tests.gate.door import Door
from tests.gate.ledger import (
    ACCESS,
    CASES,
    COMMANDERS_FEED,
    GCSA,
    HELD,
    LEFT_FEED,
    NO_STATIONS_FEED,
    SENDERS,
    SILENT,
    VEHICLE,
    VIEWS,
    A,
    Case,
    expected,
)


def _same(raw: bytes, asked: Frame) -> bool:
    """Whether a frame says the same as another one of the same sender, in whichever version of MAVLink."""
    frame = parse_one(raw)
    assert frame is not None
    said, wanted = (each.payload.rstrip(b"\0") for each in (frame, asked))
    return (frame.msgid, frame.sysid, frame.compid, said) == (asked.msgid, asked.sysid, asked.compid, wanted)


def check(
    case: Case, station: StationIdentity, sysid: int, version: int, wrong: GateReason | None, make: Callable[..., Frame]
) -> int:
    """One thing to send, from one sender, in every phase; how many verdicts were compared."""
    if version == 1 and not case.version1:
        return 0
    frame = make(case.name, sysid=sysid, version=version, **dict(case.fields))
    beats = [make("HEARTBEAT", sysid=station.sysid, version=2)] * 3 if case.kind in (SILENT, HELD) else []
    # nobody has to wait, neither for others' questions nor for the commander's files, and sticks have paused
    door = Door(step_s=30.0)
    for view in VIEWS:
        door.change(view)
        for beat in beats:
            door.up(station, beat)
        door.asked.clear()
        verdict, passed, answers = door.up(station, frame)
        if case.name == "LOG_REQUEST_DATA":  # the companion makes it anew, piece by piece
            passed = [frame.raw for raw in passed if _same(raw, frame)]
        assert passed == ([frame.raw] if verdict.fate is Fate.FORWARD else []), case
        assert not answers or verdict.fate is Fate.REFUSE or verdict.access in (Access.ANSWERED, Access.STREAM), case
        found = verdict.fate, verdict.reason
        if door.asked:  # the policy leaves it to the situation, which allows it here
            assert found == (Fate.FORWARD, GateReason.ALLOWED)
            found = Fate.CONSUME, GateReason.COMPANION
        assert found == expected(case.kind, station, sysid, wrong, view), (
            f"{case} from {sysid} behind {station.sysid}, version {version}, {view}: {verdict}"
        )
        assert verdict.access is ACCESS[case.kind], case
        assert verdict.what.startswith(case.name)
    return len(VIEWS)


#: in each test run: each genuine station, the vehicle's id and another station's
_FIRST = (0, 2, 3, 5, 6, 8)


@pytest.mark.parametrize(
    ("station", "sysid", "version", "wrong"),
    [pytest.param(*row, marks=() if n in _FIRST else pytest.mark.long) for n, row in enumerate(SENDERS)],
)
def test_every_message_and_command_from_every_sender_in_every_phase(
    make: Callable[..., Frame], station: StationIdentity, sysid: int, version: int, wrong: GateReason | None
) -> None:
    assert sum(check(case, station, sysid, version, wrong, make) for case in CASES) > 10000


@pytest.mark.slow
@pytest.mark.parametrize(("station", "sysid", "version", "wrong"), first(1, [SENDERS[0], SENDERS[3], SENDERS[6]]))
def test_every_message_and_command_to_everybody_is_judged_as_if_to_the_vehicle(
    make: Callable[..., Frame], station: StationIdentity, sysid: int, version: int, wrong: GateReason | None
) -> None:
    fieldnames = {cls.msgname: cls.fieldnames for cls in mavlink.mavlink_map.values()}
    broadcast = 0
    for case in CASES:
        everybody = {
            field: 0 for field in ("target", "target_system", "target_component") if field in fieldnames[case.name]
        }
        if everybody:
            broadcast += 1
            everywhere = replace(case, fields=(*case.fields, *everybody.items()))
            check(everywhere, station, sysid, version, wrong, make)
    assert broadcast > 900


KEY, OTHER_KEY = bytes(range(32)), bytes(range(1, 33))
NOW_UTC_S, NOW_S = 1_760_000_000.0, 1000.0


@pytest.mark.parametrize(
    ("version", "key", "refused"),
    [
        (2, None, SignatureVerdict.UNSIGNED),
        (1, None, SignatureVerdict.UNSIGNED),
        (2, OTHER_KEY, SignatureVerdict.BAD),
        (2, KEY, None),
    ],
    ids=["unsigned", "MAVLink 1", "badly signed", "well signed"],
)
def test_where_a_station_has_a_key_no_frame_reaches_the_judge_without_its_signature(
    make: Callable[..., Frame], version: int, key: bytes | None, refused: SignatureVerdict | None
) -> None:
    """Every message again: signatures are checked in front of the judge, and do not depend on what is judged."""
    verifier = Verifier(KEY)
    stamp = timestamp_of(NOW_UTC_S)
    judged: list[Frame] = []
    cases = [case for case in CASES if version == 2 or case.version1]
    for number, case in enumerate(cases, start=1):
        frame = make(case.name, sysid=GCSA, version=version, **dict(case.fields))
        if key is not None:
            raw = sign(frame.raw, key, 0, stamp + number)
            assert raw is not None
            signed = parse_one(raw)
            assert signed is not None
            frame = signed
        verdict = verifier.check(frame, NOW_UTC_S, NOW_S)
        if verdict is SignatureVerdict.OK:
            judged.append(frame)
        else:
            assert verdict is refused, case
    assert len(judged) == (len(cases) if refused is None else 0)
    for case, frame in zip(cases, judged, strict=False):  # a signature changes nothing for the judge
        for view in VIEWS:
            verdict_of_judge = judge(frame, A, view, VEHICLE)
            outcome_of_judge = verdict_of_judge.fate, verdict_of_judge.reason
            kind = {HELD: SILENT, COMMANDERS_FEED: LEFT_FEED, NO_STATIONS_FEED: LEFT_FEED}.get(case.kind, case.kind)
            assert outcome_of_judge == expected(kind, A, GCSA, None, view), case
