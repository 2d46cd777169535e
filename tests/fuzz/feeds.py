# SPDX-License-Identifier: GPL-3.0-or-later

"""Feeds driven by bytes: RTK corrections, ADS-B, terrain and weather of three stations at the gate that ships.

A plan is a row of instructions: a frame of a feed with any contents, a damaged one, bytes, a flood, corrections with
the place of a base, a request for terrain, another view, a pause. GCSB signs; what is not signed with its key is not of
it. What must hold:

* nothing raises, and the feeds note no fault;
* what passes was sent, byte for byte, by a station that the configuration names for this kind, and its values can be;
* what passes of a station and kind is no more than its limit allows;
* while the aircraft is armed, another station takes over only from a source that was silent;
* a place of a base is found only if a whole message with that check sum was sent;
* people are told a few things in a minute, whatever comes;
* memory is bounded, and a command of the commander passes afterwards.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.config.files import StationLinks
from mavproxy_handover.core.common.model import AuthorityView, LeaseState, Phase, Station
from mavproxy_handover.core.feeds import FeedKind, FeedSettings
from mavproxy_handover.gate.judge import Fate, StationIdentity
from mavproxy_handover.operator.stations.port import StationPort
from mavproxy_handover.store.keys import StationKeys
from mavproxy_handover.tools.clocks import Clocks
from mavproxy_handover.wire.frames import Frame, FrameSplitter, field_offset, parse_one
from mavproxy_handover.wire.rtcm import BaseReader
from mavproxy_handover.wire.signing import SignedPeer
from tests.fuzz.reader import Reader
from tests.gate.door import Door
from tests.gate.frames import make_frame
from tests.gate.ledger import GCSA, GCSB, GCSC, VEHICLE, VIEWS, A, B, C
from tests.link.frames import FakeDevice
from tests.wire.rtcm_frames import base, message

__all__ = ["ASK", "BASE", "BYTES", "DAMAGED", "FEED", "FLOOD", "PAUSE", "SWITCH", "Fed", "run", "seeds"]

FEED, DAMAGED, BYTES, FLOOD, BASE, ASK, SWITCH, PAUSE = range(8)
STATIONS: Final = (A, B, C)
FLYING: Final = AuthorityView(Phase.ON_MISSION, GCSA, None, 1, LeaseState.HELD, armed=True)
#: the second book-keeping of which station may be a source
ORDERS: Final = {
    FeedKind.RTK: (GCSA, GCSB),
    FeedKind.ADSB: (GCSB, GCSC),
    FeedKind.TERRAIN: (GCSA, GCSC),
    FeedKind.WEATHER: (GCSC, GCSB),
}
MESSAGES: Final = {
    "GPS_RTCM_DATA": FeedKind.RTK,
    "GPS_INJECT_DATA": FeedKind.RTK,
    "ADSB_VEHICLE": FeedKind.ADSB,
    "TERRAIN_DATA": FeedKind.TERRAIN,
    "WIND_COV": FeedKind.WEATHER,
    "HYGROMETER_SENSOR": FeedKind.WEATHER,
}
NAMES: Final = tuple(MESSAGES)
BYTES_PER_S: Final = {
    FeedKind.RTK: 4000.0,
    FeedKind.ADSB: 4000.0,
    FeedKind.TERRAIN: 6000.0,
    FeedKind.WEATHER: 200.0,
}
SENDERS: Final = (None, GCSA, GCSB, GCSC, VEHICLE, 0, 99)
COMPONENTS: Final = (190, 1, 220, 156, 191, 0)
PLACES_M: Final = ((4_000_000.0, 500_000.0, 4_900_000.0), (4_000_100.0, 500_000.0, 4_900_000.0), (0.0, 0.0, 0.0))
KEY: Final = bytes(range(32))
OTHER_KEY: Final = bytes(range(1, 33))
#: 2026-11-20 00:00 UTC
UTC_S: Final = 1_795_132_800.0
_IDS: Final = {cls.msgname: msgid for msgid, cls in mavlink.mavlink_map.items()}
#: texts for people, of each kind: at once, and in a minute
_TEXTS: Final = 20
_TEXTS_A_MINUTE: Final = 20


class Link(FakeDevice):
    """A station's link."""

    def reply(self, _frame: Frame, _data: bytes) -> None:
        """An explanation to a sender whose signature is wrong."""


class Fed:
    """The gate with three stations that may all be sources, and what must hold."""

    def __init__(self) -> None:
        rules = {kind: replace(FeedSettings().rules[kind], order=order, named=True) for kind, order in ORDERS.items()}
        self.door = Door(step_s=0.0, feeds=FeedSettings(rules))
        self.door.change(FLYING)
        self.begun_at = self.door.now
        #: what passed, by station and kind: frames, and bytes
        self.passed: Counter[tuple[int, FeedKind]] = Counter()
        self.passed_bytes: Counter[tuple[int, FeedKind]] = Counter()
        #: by kind: the last station that passed, and when; emptied with every change of the view
        self._last: dict[FeedKind, tuple[int, float]] = {}
        clocks = Clocks(lambda: UTC_S + self.door.now, lambda: self.door.now)
        self._devices = {station.sysid: Link("udpin:127.0.0.1:14550") for station in STATIONS}
        self._ports = {
            station.sysid: StationPort(
                StationLinks(Station(station.sysid, f"GCS{station.sysid}"), ("udpin:127.0.0.1:14550",), station.sysids),
                (self._devices[station.sysid],),
                VEHICLE,
                StationKeys(KEY) if station is B else None,
                clocks,
            )
            for station in STATIONS
        }
        self._splitters = {station.sysid: FrameSplitter() for station in STATIONS}
        self._sent = {station.sysid: b"" for station in STATIONS}
        #: frames that GCSB has signed and that have not passed
        self.signed: set[bytes] = set()

    def feed(self, station: StationIdentity, data: bytes) -> None:
        """Bytes arrive on a station's link."""
        self._sent[station.sysid] = self._sent[station.sysid][-600:] + data
        device = self._devices[station.sysid]
        device.inbox += self._splitters[station.sysid].feed(data, self.door.now)
        for frame in self._ports[station.sysid].read(device, self.door.now):
            assert frame.raw in self._sent[station.sysid]
            self._receive(station, frame)

    def _receive(self, station: StationIdentity, frame: Frame) -> None:
        came = self.door.up(station, frame)
        kind = MESSAGES.get(mavlink.mavlink_map[frame.msgid].msgname) if frame.known else None
        if came.verdict.fate is Fate.FORWARD and kind is not None:
            assert came.passed == [frame.raw]
            if station is B:
                assert frame.raw in self.signed, "a frame that GCSB has not signed, or a replay"
                self.signed.discard(frame.raw)
            self._check(station, frame, kind)
        assert not self.door.faults, self.door.faults

    def _check(self, station: StationIdentity, frame: Frame, kind: FeedKind) -> None:
        assert station.sysid in ORDERS[kind]
        assert frame.sysid in station.sysids
        check_values(frame)
        now, key = self.door.now, (station.sysid, kind)
        self.passed[key] += 1
        self.passed_bytes[key] += len(frame.payload)
        most = BYTES_PER_S[kind] * (now - self.begun_at + 2.0) + 1.0
        assert self.passed_bytes[key] <= most, f"more than its limit: {key}"
        before = self._last.get(kind)
        # the base of a source may leave its place, and terrain has no source
        if before is not None and before[0] != station.sysid and kind in (FeedKind.ADSB, FeedKind.WEATHER):
            assert now - before[1] > FeedSettings().rules[kind].silence_s, "two sources"
        self._last[kind] = station.sysid, now

    def switch(self, view: AuthorityView) -> None:
        """Another view comes into force."""
        self._last.clear()
        self.door.change(view)

    def ask(self, frame: Frame) -> None:
        """The autopilot asks for terrain."""
        assert self.door.down(frame) <= {GCSA, GCSB, GCSC}

    def pause(self, seconds: float) -> None:
        self.door.now += seconds
        self.door.gate.tick(self.door.now)
        self.check_texts()

    def check_texts(self) -> None:
        """Few things are told."""
        minutes = (self.door.now - self.begun_at) / 60.0
        for kind, count in Counter(news.kind for news in self.door.feed_news).items():
            assert count <= _TEXTS + _TEXTS_A_MINUTE * minutes, f"{count} texts of {kind}"

    def end(self) -> None:
        """What is not a feed is not affected."""
        self.switch(FLYING)
        self.pause(2.0)
        read = make_frame("PARAM_REQUEST_READ", sysid=GCSA, param_id=b"RTL_ALT")
        assert self.door.up(A, read).passed == [read.raw]
        command = make_frame("COMMAND_LONG", sysid=GCSA, command=mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
        assert self.door.up(A, command).passed == [command.raw]
        assert not self.door.faults, self.door.faults


def check_values(frame: Frame) -> None:
    """Lengths and places are possible, by pymavlink's own reading of the frame."""
    feed = mavlink.MAVLink(None).decode(bytearray(frame.raw))
    if feed.get_type() in ("GPS_RTCM_DATA", "GPS_INJECT_DATA"):
        assert feed.len <= len(feed.data)
    elif feed.get_type() in ("ADSB_VEHICLE", "TERRAIN_DATA"):
        assert abs(feed.lat) <= 900_000_000
        assert abs(feed.lon) <= 1_800_000_000
    elif feed.get_type() == "WIND_COV":
        assert all(map(math.isfinite, (feed.wind_x, feed.wind_y, feed.wind_z)))


def frame_of(name: str, sysid: int, compid: int, seq: int, payload: bytes) -> bytes:
    """An unsigned frame with these contents, zeros behind them, and a right check sum."""
    msgid = _IDS[name]
    cls = mavlink.mavlink_map[msgid]
    body = bytearray(payload.ljust(cls.unpacker.size, b"\0")[: cls.unpacker.size])
    if name == "GPS_INJECT_DATA":
        body[field_offset(msgid, "target_system")] = VEHICLE
    head = bytes([len(body), 0, 0, seq, sysid, compid]) + msgid.to_bytes(3, "little")
    return b"\xfd" + head + bytes(body) + mavlink.x25crc(head + body + bytes([cls.crc_extra])).crc.to_bytes(2, "little")


class Player:
    """Carries a plan out."""

    def __init__(self, plan: bytes) -> None:
        self.fed = Fed()
        self._reader = Reader(plan)
        self._signs = {0: SignedPeer(KEY), 1: SignedPeer(OTHER_KEY)}
        self._seq = 0

    def play(self) -> Fed:
        reader, fed = self._reader, self.fed
        while reader.more():
            what = reader.byte() % 8
            if what == PAUSE:
                fed.pause(reader.byte() / 16.0)
            elif what == SWITCH:
                fed.switch(VIEWS[reader.byte() % len(VIEWS)])
            elif what == BYTES:
                fed.feed(STATIONS[reader.byte() % 3], reader.counted())
            elif what == ASK:
                self._ask()
            elif what == BASE:
                self._base()
            else:
                self._frame(what)
        fed.end()
        return fed

    def _frame(self, what: int) -> None:
        """FEED, DAMAGED, FLOOD."""
        reader = self._reader
        station, name = STATIONS[reader.byte() % 3], NAMES[reader.byte() % len(NAMES)]
        sysid = SENDERS[reader.byte() % len(SENDERS)] or station.sysid
        compid, form, payload = COMPONENTS[reader.byte() % len(COMPONENTS)], reader.byte(), reader.counted()
        if what == FLOOD:
            count, pause_s = reader.byte(), reader.byte() / 1000.0
            for _number in range(count):
                self._send(station, frame_of(name, sysid, compid, self._number(), payload), form)
                self.fed.pause(pause_s)
            return
        raw = frame_of(name, sysid, compid, self._number(), payload)
        place, change = (reader.byte(), reader.byte()) if what == DAMAGED else (0, 0)
        self._send(station, raw, form, place, change)

    def _send(self, station: StationIdentity, raw: bytes, form: int, place: int = 0, change: int = 0) -> None:
        """`form`: whether a key is used, and which. One byte of the frame may be changed afterwards."""
        if station is B and form % 4 < 3:
            signed = self._signs[form % 4 // 2].sign(raw, 1, UTC_S + self.fed.door.now, self.fed.door.now)
            assert signed is not None
            raw = signed
            if form % 4 < 2:
                self.fed.signed.add(raw)
        sent = bytearray(raw)
        sent[place % len(sent)] ^= change
        self.fed.feed(station, bytes(sent))

    def _base(self) -> None:
        """Corrections with the place of a base, cut into fragments."""
        reader = self._reader
        station, place = STATIONS[reader.byte() % 3], PLACES_M[reader.byte() % len(PLACES_M)]
        data = base(*place, number=1005 + reader.byte() % 2)
        cut, sequence, form = reader.byte() % len(data), reader.byte() % 32, reader.byte()
        parts = [data] if not cut else [data[:cut].rjust(180, b"\0"), data[cut:]]
        for number, part in enumerate(parts):
            flags = (len(parts) > 1) | number << 1 | sequence << 3
            payload = bytes([flags, len(part)]) + part
            self._send(station, frame_of("GPS_RTCM_DATA", station.sysid, 190, self._number(), payload), form)

    def _ask(self) -> None:
        raw = frame_of("TERRAIN_DATA", VEHICLE, 1, 0, b"")  # only its head is used
        request = mavlink.mavlink_map[_IDS["TERRAIN_REQUEST"]]
        body = self._reader.counted().ljust(request.unpacker.size, b"\0")[: request.unpacker.size]
        head = bytes([len(body), *raw[2:7]]) + _IDS["TERRAIN_REQUEST"].to_bytes(3, "little")
        crc = mavlink.x25crc(head + body + bytes([request.crc_extra])).crc.to_bytes(2, "little")
        frame = parse_one(b"\xfd" + head + body + crc)
        assert frame is not None
        self.fed.ask(frame)

    def _number(self) -> int:
        self._seq = (self._seq + 1) & 0xFF
        return self._seq


def read_places(pieces: list[tuple[int, bytes]]) -> int:
    """Give pieces of corrections to the reader of places: flags of a fragment and its bytes. Returns the places found.

    What must hold: it finds no place without a whole message in what was sent, and keeps few bytes.
    """
    reader, found, sent = BaseReader(), 0, b""
    for flags, data in pieces:
        sent += data
        if reader.fragment(flags, data) is not None:
            found += 1
            assert any(_is_base(sent, at) for at in range(len(sent))) or flags & 1, "a place out of nothing"
        assert len(reader._tail) + sum(map(len, reader._parts.values())) < 1000
    return found


def _is_base(data: bytes, at: int) -> bool:
    if data[at] != 0xD3:
        return False
    return any(message(data[at + 3 : at + 3 + length]) == data[at : at + 6 + length] for length in (19, 21))


def seeds() -> Iterator[bytes]:
    """Ordinary feeds of every kind, floods, and a base that moves."""
    all_parts = b"\xff" * 7
    for station in range(3):
        for name in range(len(NAMES)):
            one = bytes([station, name, 0, 0, 0, 4, 1, 2, 0, 0])
            yield bytes([FEED]) + one + bytes([PAUSE, 8, FEED]) + one + bytes([DAMAGED]) + one + bytes([9, 1])
            yield bytes([FLOOD]) + one + bytes([200, 1, PAUSE, 255, FLOOD]) + one + bytes([40, 100])
            yield bytes([ASK, len(all_parts)]) + all_parts + bytes([FEED, station, name, 0, 0, 0, 0])
    for place in (0, 1, 2):
        moves = bytes([BASE, 0, 0, 0, 0, 0, 0, BASE, 0, place, 1, 9, 3, 0, PAUSE, 4])
        yield moves * 30 + bytes([BASE, 1, place, 0, 5, 2, 0]) + bytes([SWITCH, 0]) + moves
    yield bytes([FEED, 1, 2, 0, 0, 2, 0, FEED, 1, 2, 0, 0, 3, 0, BYTES, 1, 3, 0xFD, 0xFF, 0, PAUSE, 9])


def run(plan: bytes) -> Fed:
    """Carry a plan out; any exception is a finding."""
    pieces, reader = [], Reader(plan)
    while reader.more():
        pieces.append((reader.byte(), reader.counted()))
    read_places(pieces)
    return Player(plan).play()
