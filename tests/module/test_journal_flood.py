# SPDX-License-Identifier: GPL-3.0-or-later

"""Whoever floods the links fills no journal: what matters is still there an hour later, and how much was left out."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.wire.frames import Frame, parse_one
from mavproxy_handover.wire.signing import SignatureVerdict
from tests.depth import first
from tests.module.conftest import Bench, Clock
from tests.module.test_signed import SignedBench, signed  # noqa: F401 (a fixture)
from tests.module.test_station_module import StationBench, connect_message, key

HOUR_S = 3600
MIB = 1 << 20


def one_of_each(sysid: int) -> list[Frame]:
    """A frame of every message there is, all in one name."""
    own, empty, found = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=190), mavlink.MAVLink(None), []
    for msgid, cls in mavlink.mavlink_map.items():
        head = bytes([0xFD, cls.unpacker.size, 0, 0, 0, sysid, 190]) + msgid.to_bytes(3, "little")
        raw = head + bytes(cls.unpacker.size)
        crc = mavlink.x25crc(raw[1:])
        crc.accumulate(bytes([cls.crc_extra]))
        message = empty.decode(bytearray(raw + crc.crc.to_bytes(2, "little")))
        frame = parse_one(bytes(message.pack(own)))
        assert frame is not None
        found.append(frame)
    assert len(found) > 250
    return found


def whole(bench: Bench) -> list[dict[str, Any]]:
    """All entries there are, in both files."""
    old = bench.folder / "companion.jsonl.1"
    before = [json.loads(line) for line in old.read_text().splitlines()] if old.exists() else []
    return before + bench.journal()


def events(entries: list[dict[str, Any]]) -> Counter[str]:
    return Counter(entry["event"] for entry in entries)


def test_an_hour_of_unsigned_frames_takes_little_room_and_the_evidence_stays(signed: SignedBench) -> None:  # noqa: F811
    signed.connect()
    companion = signed.companion
    port, frames = companion.ports[251], one_of_each(251)
    companion.journal._max_bytes = MIB
    companion.event_log.start_begun("GCSA", "GUIDED, arm, AUTO")
    sent = 0
    for second in range(HOUR_S):
        now = signed.clock.now + second
        for n in range(60):
            port.rejected.append((frames[(60 * second + n) % len(frames)], SignatureVerdict.UNSIGNED))
            sent += 1
            if len(port.rejected) == 30:
                companion.on_station(port, [], now)
        companion.event_log.sum_up(now)
    entries = whole(signed)
    assert events(entries)["start_sequence"] == 1
    refused = [entry for entry in entries if entry["event"] == "refused"]
    assert 1800 <= len(refused) <= 1900
    assert sum(path.stat().st_size for path in signed.folder.glob("companion*.jsonl*")) < MIB
    told = [entry for entry in entries if entry["event"] == "left_out"]
    assert 58 <= len(told) <= 61
    text = f"{told[0]['count']} more entries of GCSA left out: refused frames in its name without a valid signature"
    assert (told[0]["station"], told[0]["text"]) == ("GCSA", text)
    companion.event_log.sum_up(float("inf"))
    left_out = sum(entry["count"] for entry in whole(signed) if entry["event"] == "left_out")
    assert left_out + len(refused) + sum(entry.get("also", 0) for entry in refused) == sent


def test_what_strangers_make_us_write_is_apart_and_bounded(signed: SignedBench) -> None:  # noqa: F811
    signed.connect()
    companion = signed.companion
    port, frames = companion.ports[251], one_of_each(251)
    own, strangers = companion.journal.path, signed.folder / "companion-strangers.jsonl"
    companion.wait_until_written(10.0)
    before = own.read_bytes()
    assert companion._base.strangers._max_bytes == 8 * MIB
    companion._base.strangers._max_bytes = 20_000
    for second in range(600):
        port.rejected.append((frames[second % len(frames)], SignatureVerdict.BAD))
        companion.on_station(port, [], signed.clock.now + second)
    companion.wait_until_written(10.0)
    refused = b'"event": "refused"'
    assert own.read_bytes().count(refused) == before.count(refused), "nothing of it is among what matters"
    assert strangers.with_name("companion-strangers.jsonl.1").exists()
    assert 0 < strangers.stat().st_size <= 20_000


def test_a_program_that_uploads_without_end_is_told_each_second(signed: SignedBench) -> None:  # noqa: F811
    signed.connect()
    narrator, now = signed.companion.event_log, signed.clock.now
    told = [narrator.upload_refused("GCSA", "mission", "too long", now + tenth / 10) for tenth in range(300)]
    assert sum(told) == 30
    entries = signed.journal("upload_refused")
    assert len(entries) == 30
    assert [entry.get("also") for entry in entries[:3]] == [None, 9, 9]
    assert narrator.upload_refused("GCSA", "geofence", "too long", now + 30.0), "another list is another matter"


def test_frames_in_anothers_name_are_a_strangers(signed: SignedBench) -> None:  # noqa: F811
    """They come past the check of signatures, for the gate to drop them."""
    signed.connect()
    companion = signed.companion
    port, frames = companion.ports[251], one_of_each(99)
    before = len(signed.journal("refused"))
    for second in range(20):
        companion.on_station(port, frames, signed.clock.now + second)
    assert 60 <= len(signed.journal("refused")) - before <= 70


def test_what_a_station_itself_sends_is_refused_in_more_entries_but_not_in_any_number(signed: SignedBench) -> None:  # noqa: F811
    signed.connect()
    companion, now = signed.companion, signed.clock.now
    port, frames = companion.ports[252], one_of_each(252)
    before = len(signed.journal("refused"))
    for second in range(600):
        companion.on_station(port, frames[second % 40 :][:40], now + second)
    assert 500 < len(signed.journal("refused")) - before <= 200 + 1200


@pytest.mark.parametrize("kind", first(3, ["messages", "requests", "START", "senseless", "requests not understood"]))
def test_nor_does_anything_else_that_a_station_says_fill_the_journal(bench: Bench, kind: str) -> None:
    """Without a key any program on the link counts as the station."""
    bench.connect()
    companion, now = bench.companion, bench.clock.now
    vehicle = 2 if kind == "senseless" else 1
    message = {
        "requests": mavlink.MAVLink_command_long_message(1, 191, 32100, 0, 1, 0, 0, 252, 0, 0, 0),
        "requests not understood": mavlink.MAVLink_command_long_message(1, 191, 32100, 0, 5, 0, 0, 252, 0, 0, 0),
        "START": mavlink.MAVLink_command_long_message(1, 1, 300, 0, 0, 0, 0, 0, 0, 0, 0),
    }.get(kind, mavlink.MAVLink_ok_handover_message(1, 191, vehicle, 251, 252, 9, 1, 0, 0))
    own = mavlink.MAVLink(None, srcSystem=251, srcComponent=190)
    frame = parse_one(bytes(message.pack(own)))
    assert frame is not None
    before = events(bench.journal())
    for step in range(1600):
        companion.on_station(companion.ports[251], [frame] * 5, now + step / 1000)
    grown = events(bench.journal()) - before
    assert grown.total() <= 5000 + 30 + 100, grown
    companion.event_log.sum_up(now + 1.6)
    assert sum(entry["count"] for entry in bench.journal("left_out")) > 2000


def test_nor_a_stations_journal_what_anybody_says_on_the_ground_link(
    monkeypatch: pytest.MonkeyPatch, clock: Clock, tmp_path: Path
) -> None:
    from gcs_module import module as gcs_module

    monkeypatch.setattr(gcs_module, "time", clock)
    station = StationBench(tmp_path, clock)
    station.load()
    station.hear(connect_message())
    message = mavlink.MAVLink_drone_connected_message(*key(), 0)
    frame = parse_one(bytes(message.pack(station.peer.own)))
    for number in range(8000):
        clock.now += 0.0001
        station.module._on_peer(frame)
        if number % 1000 == 0:  # here it is not the disk that sets the limit
            station.journal("message")
    assert len(station.journal("message")) <= 5010
    station.run(1.1)
    (entry,) = station.journal("left_out")
    assert (entry["station"], entry["via"]) == ("GCSB", "ground")
    assert entry["count"] == 8000 - sum(entry["direction"] == "in" for entry in station.journal("message"))
    station.close()
    assert station.mpstate.escaped == []
