# SPDX-License-Identifier: GPL-3.0-or-later

"""Feeds through the whole gate: every message, sender, view and configuration; limits, bases, faults, floods."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import AuthorityView, LeaseState, Phase
from mavproxy_handover.core.feeds import FeedChange, FeedKind, FeedSettings
from mavproxy_handover.gate.feeds import KINDS, PLACE_S, Feeds
from mavproxy_handover.gate.judge import Fate, GateReason, StationIdentity
from mavproxy_handover.gate.policy.access import Access
from mavproxy_handover.wire.frames import Frame
from tests.gate.door import Door
from tests.gate.ledger import GCSA, GCSB, GCSC, SENDERS, VEHICLE, VIEWS, A, B, C
from tests.wire.rtcm_frames import base

Make = Callable[..., Frame]
FLYING = AuthorityView(Phase.ON_MISSION, GCSA, None, 1, LeaseState.HELD, armed=True)
#: written out by hand, beside the policy
MESSAGES = {
    "GPS_RTCM_DATA": FeedKind.RTK,
    "GPS_INJECT_DATA": FeedKind.RTK,
    "ADSB_VEHICLE": FeedKind.ADSB,
    "TERRAIN_DATA": FeedKind.TERRAIN,
    "WIND_COV": FeedKind.WEATHER,
    "HYGROMETER_SENSOR": FeedKind.WEATHER,
}
FOR_ALL = [FeedKind.RTK, FeedKind.ADSB, FeedKind.WEATHER]
HERE = (4_000_000.0, 500_000.0, 4_900_000.0)


def settings(*order: int, kinds: list[FeedKind] | None = None, **more: Any) -> FeedSettings:
    """These stations for these kinds, else as without a configuration."""
    rules = dict(FeedSettings().rules)
    for kind in FOR_ALL if kinds is None else kinds:
        rules[kind] = replace(rules[kind], order=order, named=True)
    return FeedSettings(rules, **more)


def rtcm(make: Make, station: int, data: bytes = b"\xd3\x00\x02\x43\x50abc", flags: int = 0, **more: Any) -> Frame:
    padded = list(data[:180].ljust(180, b"\0"))
    return make("GPS_RTCM_DATA", sysid=station, data=padded, **{"len": len(data), "flags": flags, **more})


def door_with(feeds: FeedSettings, step_s: float = 0.05) -> Door:
    door = Door(feeds=feeds, step_s=step_s)
    door.change(FLYING)
    return door


def test_every_message_of_a_feed_has_its_kind() -> None:
    names = {msgid: cls.msgname for msgid, cls in mavlink.mavlink_map.items()}
    assert {names[msgid]: kind for msgid, kind in KINDS.items()} == MESSAGES


ORDERS: list[tuple[int, ...]] = [(), (GCSA,), (GCSB,), (GCSC, GCSB), (GCSA, GCSB, GCSC)]


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize(("station", "sysid", "version", "wrong"), SENDERS)
def test_every_feed_of_every_sender_in_every_view(
    make: Make,
    station: StationIdentity,
    sysid: int,
    version: int,
    wrong: GateReason | None,
    order: tuple[int, ...],
) -> None:
    """A station passes alone if it is named, whichever station has authority; and the aircraft armed or not."""
    for name, kind in MESSAGES.items():
        msgid = next(msgid for msgid, cls in mavlink.mavlink_map.items() if cls.msgname == name)
        if kind not in FOR_ALL or (version == 1 and msgid > 255):
            continue
        for compid in (190, 1, 156, 220):
            door = Door(feeds=settings(*order), step_s=30.0)
            frame = make(name, sysid=sysid, compid=compid, version=version)
            for view in VIEWS:
                door.change(view)
                verdict, passed, answers = door.up(station, frame)
                if wrong is not None:
                    expected = Fate.DROP, wrong
                elif station.sysid in order:
                    expected = Fate.FORWARD, GateReason.ALLOWED
                else:
                    expected = Fate.DROP, GateReason.FEED_NOT_NAMED
                assert (verdict.fate, verdict.reason) == expected, (name, sysid, view)
                assert verdict.access is Access.FEED
                assert passed == ([frame.raw] if expected[0] is Fate.FORWARD else [])
                assert answers == []


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("name", [name for name in MESSAGES if name != "TERRAIN_DATA"])
def test_of_several_that_are_named_one_passes(make: Make, name: str, view: AuthorityView) -> None:
    door = Door(feeds=settings(GCSA, GCSB, kinds=list(FeedKind)))
    door.change(view)
    first, second = make(name, sysid=GCSB), make(name, sysid=GCSA)
    assert door.up(B, first).verdict.fate is Fate.FORWARD, "it alone sends"
    assert door.up(A, second).verdict.reason is GateReason.FEED_STANDBY
    assert door.up(B, first).passed == [first.raw]


def test_a_feed_for_the_companions_component_is_dropped(make: Make) -> None:
    door = door_with(settings(GCSA))
    frame = make("GPS_INJECT_DATA", target_component=191)
    assert door.up(A, frame).verdict[:3:2] == (Fate.DROP, GateReason.COMPANION_TARGET)


def test_a_handover_changes_nothing_and_a_silent_source_does(make: Make) -> None:
    """RTK through a handover: no gap."""
    door = door_with(settings(GCSA, GCSB), step_s=0.25)
    passed: list[tuple[float, int]] = []

    def second(*stations: StationIdentity) -> None:
        for station in stations:
            if door.up(station, rtcm(make, station.sysid)).passed:
                passed.append((door.now, station.sysid))
        door.now += 1.0 - 0.25 * len(stations)
        door.gate.tick(door.now)

    for _time in range(5):
        second(A, B)
    door.change(replace(FLYING, commander=GCSB, epoch=2))
    for _time in range(10):
        second(A, B)
    assert [station for _at, station in passed] == [GCSA] * 15
    assert max(b[0] - a[0] for a, b in pairwise(passed)) <= 1.5
    for _time in range(8):
        second(B)
    assert passed[-1][1] == GCSB
    gap = next(at for at, station in passed if station == GCSB) - max(at for at, s in passed if s == GCSA)
    assert 3.0 < gap <= 4.3
    assert [(news.text, news.station, news.about, news.change) for news in door.feed_news] == [
        ("RTK corrections: from GCSA.", None, "GCSA", FeedChange.SOURCE),
        ("RTK corrections: from GCSB after GCSA.", None, "GCSB", FeedChange.SOURCE),
    ]


def test_corrections_that_fail_are_told_and_those_that_come_back(make: Make) -> None:
    door = door_with(settings(GCSA))
    door.up(A, rtcm(make, GCSA))
    for _second in range(5):
        door.now += 1.0
        door.gate.tick(door.now)
    door.up(A, rtcm(make, GCSA))
    door.gate.tick(door.now + 1.0)
    assert [news.text for news in door.feed_news] == [
        "RTK corrections: from GCSA.",
        "RTK corrections: none. GCSA is silent for 3 s.",
        "RTK corrections: from GCSA again.",
    ]


def test_a_base_that_moves_to_and_fro_is_told_now_and_then_and_at_last_as_it_is(make: Make) -> None:
    door = door_with(settings(GCSA), step_s=0.05)
    for _time in range(200):
        for x_m in (HERE[0], HERE[0] + 500.0):
            door.up(A, rtcm(make, GCSA, base(x_m, *HERE[1:])))
        door.gate.tick(door.now)
    sources = [news.text for news in door.feed_news if news.text.startswith("RTK corrections: ")]
    assert 5 <= len(sources) <= 8, "20 s, four changes a second"
    for _time in range(30):
        door.now += 1.0
        door.up(A, rtcm(make, GCSA, base(HERE[0] + 500.0, *HERE[1:])))  # the place that counts
        door.gate.tick(door.now)
    sources = [news.text for news in door.feed_news if news.text.startswith("RTK corrections: ")]
    assert sources[-1] == "RTK corrections: from GCSA again."


def test_a_receiver_without_traffic_is_no_news(make: Make) -> None:
    door = door_with(settings(GCSA))
    door.up(A, make("ADSB_VEHICLE", sysid=GCSA, compid=156))
    door.now += 300.0
    door.gate.tick(door.now)
    assert [news.text for news in door.feed_news] == ["ADS-B: from GCSA."]


def test_a_station_that_is_not_named_is_told_now_and_then(make: Make) -> None:
    door = door_with(settings(GCSA))
    for _frame in range(50):
        door.up(B, rtcm(make, GCSB))
    door.gate.tick(door.now)
    assert [(news.text, news.station) for news in door.feed_news] == [
        ("RTK corrections of GCSB are not used: 'rtk' in [feeds] does not name it.", GCSB)
    ]


def test_another_base_elsewhere_is_told_to_all_and_not_taken(make: Make) -> None:
    door = door_with(settings(GCSA, GCSB))
    door.up(A, rtcm(make, GCSA, base(*HERE)))
    door.up(B, rtcm(make, GCSB, base(HERE[0] + 3.0, *HERE[1:])))
    for _second in range(30):
        door.now += 1.0
        assert door.up(B, rtcm(make, GCSB)).verdict.reason is GateReason.FEED_PLACE
        door.gate.tick(door.now)
    assert [(news.text, news.station) for news in door.feed_news] == [
        ("RTK corrections: from GCSA.", None),
        ("RTK corrections of GCSB are not used: its base is 3.0 m from that of GCSA (rtk_apart_m 1).", None),
        ("RTK corrections: none. GCSA is silent for 3 s.", None),
    ]
    assert door.up(B, rtcm(make, GCSB, base(HERE[0] + 0.5, *HERE[1:]))).verdict.fate is Fate.FORWARD


def each_second(door: Door, seconds: int, *frames: tuple[StationIdentity, Frame]) -> list[str]:
    """Corrections for so long; the texts that are told."""
    for _second in range(seconds):
        door.now += 1.0 - door.step_s * len(frames)
        for station, frame in frames:
            door.up(station, frame)
    door.gate.tick(door.now)
    return [news.text for news in door.feed_news]


def test_a_source_whose_base_never_says_its_place_is_told_once(make: Make) -> None:
    door = door_with(settings(GCSA, GCSB))
    assert each_second(door, int(PLACE_S) - 1, (A, rtcm(make, GCSA))) == ["RTK corrections: from GCSA."]
    texts = each_second(door, 200, (A, rtcm(make, GCSA)))
    assert texts[1:] == ["The base of GCSA does not send its place (RTCM 1005 or 1006): a second base is not checked."]


def test_a_base_that_says_its_place_now_and_then_is_no_news(make: Make) -> None:
    door = door_with(settings(GCSA))
    for _time in range(5):
        door.up(A, rtcm(make, GCSA, base(*HERE)))
        texts = each_second(door, int(PLACE_S), (A, rtcm(make, GCSA)))
    assert texts == ["RTK corrections: from GCSA."]


def test_a_second_base_without_its_place_is_not_taken_and_told_why(make: Make) -> None:
    door = door_with(settings(GCSA, GCSB))
    door.up(A, rtcm(make, GCSA, base(*HERE)))
    texts = each_second(door, 50, (A, rtcm(make, GCSA)), (B, rtcm(make, GCSB)))
    assert texts[1:] == [
        "RTK corrections of GCSB are not used: its base has not sent its place (RTCM 1005 or 1006)."
    ], "once a minute"
    assert door.feed_news[-1][2:] == (None, "GCSB", FeedChange.NOT_USED)


def test_bases_that_are_apart_on_purpose_may_follow_each_other(make: Make) -> None:
    door = door_with(settings(GCSA, GCSB, rtk_apart_m=50_000.0))
    door.up(A, rtcm(make, GCSA, base(*HERE)))
    door.up(B, rtcm(make, GCSB, base(HERE[0] + 20_000.0, *HERE[1:])))
    door.now += 4.0
    assert door.up(B, rtcm(make, GCSB)).verdict.fate is Fate.FORWARD


def test_a_base_whose_place_is_not_known_waits_for_it(make: Make) -> None:
    door = door_with(settings(GCSA, GCSB))
    door.up(A, rtcm(make, GCSA, base(*HERE)))
    door.now += 4.0
    assert door.up(B, rtcm(make, GCSB)).verdict.reason is GateReason.FEED_PLACE
    assert door.up(B, rtcm(make, GCSB, base(*HERE))).verdict.fate is Fate.FORWARD


def test_a_flood_passes_its_limit_and_no_more(make: Make) -> None:
    door = door_with(settings(GCSA), step_s=0.0005)
    frame = rtcm(make, GCSA, bytes([255] * 180))
    reasons = Counter(door.up(A, frame).verdict.reason for _frame in range(20_000))
    passed = sum(len(raw) for raw in door.passed)
    assert set(reasons) == {GateReason.ALLOWED, GateReason.FEED_TOO_MUCH}
    assert passed <= 4000.0 * (10.0 + 2.0) + 300
    assert passed > 4000.0 * 10.0
    door.gate.tick(door.now)
    assert [news.text for news in door.feed_news] == [
        "RTK corrections: from GCSA.",
        "RTK corrections of GCSA are not used: too many bytes in a second.",
    ]


def test_a_flood_of_the_second_station_takes_nothing_from_the_source(make: Make) -> None:
    door = door_with(settings(GCSA, GCSB), step_s=0.001)
    for second in range(20):
        assert door.up(A, rtcm(make, GCSA)).passed, second
        for _frame in range(1000):
            assert not door.up(B, rtcm(make, GCSB, bytes(180))).passed


SENSELESS = [
    ("GPS_RTCM_DATA", {"len": 181}),
    ("GPS_INJECT_DATA", {"len": 111}),
    ("ADSB_VEHICLE", {"lat": 90 * 10**7 + 1}),
    ("ADSB_VEHICLE", {"lon": -180 * 10**7 - 1}),
    ("WIND_COV", {"wind_x": float("nan")}),
    ("WIND_COV", {"wind_z": float("inf")}),
    ("TERRAIN_DATA", {"gridbit": 56}),
]


@pytest.mark.parametrize(("name", "fields"), SENSELESS)
def test_values_that_cannot_be_do_not_pass(make: Make, name: str, fields: dict[str, Any]) -> None:
    door = door_with(settings(GCSA, kinds=list(FeedKind)))
    if name == "TERRAIN_DATA":
        door.down(make("TERRAIN_REQUEST", sysid=VEHICLE, compid=1, mask=1))
    assert door.up(A, make(name, **fields)).verdict.reason is GateReason.FEED_SENSELESS
    assert door.up(A, make(name)).verdict.fate is Fate.FORWARD


def test_terrain_is_asked_of_the_commander_and_then_of_the_next_one(make: Make) -> None:
    door = door_with(settings(GCSB, GCSC, GCSA, kinds=[FeedKind.TERRAIN]), step_s=0.0)
    request = make("TERRAIN_REQUEST", sysid=VEHICLE, compid=1, lat=520_000_000, lon=40_000_000, grid_spacing=100)
    heard = []
    for _time in range(7):
        heard.append(door.down(request))
        door.now += 2.0
    assert heard == [{GCSA}, {GCSA}, {GCSA, GCSB}, {GCSA, GCSB}, *[{GCSA, GCSB, GCSC}] * 3]


def test_terrain_that_no_request_asked_for_does_not_pass(make: Make) -> None:
    door = door_with(settings(GCSB, GCSA, kinds=[FeedKind.TERRAIN]))
    block = {"lat": 520_000_000, "lon": 40_000_000, "grid_spacing": 100}
    data = {sysid: make("TERRAIN_DATA", sysid=sysid, **block) for sysid in (GCSA, GCSB, GCSC)}
    assert door.up(A, data[GCSA]).verdict.fate is Fate.DROP
    door.down(make("TERRAIN_REQUEST", sysid=VEHICLE, compid=1, mask=1, **block))
    assert door.up(A, data[GCSA]).verdict.fate is Fate.FORWARD
    assert door.up(B, data[GCSB]).verdict.reason is GateReason.FEED_STANDBY
    assert door.up(C, data[GCSC]).verdict.reason is GateReason.FEED_NOT_NAMED


def test_without_a_configuration_the_commander_alone_hears_the_request(make: Make) -> None:
    door = door_with(FeedSettings())
    assert door.down(make("TERRAIN_REQUEST", sysid=VEHICLE, compid=1, mask=1)) == {GCSA}


def test_a_fault_of_the_feeds_drops_feeds_and_nothing_else(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_anything: Any) -> None:
        raise RuntimeError("a bug")

    door = door_with(settings(GCSA))
    monkeypatch.setattr(Feeds, "_offer", broken)
    assert door.up(A, rtcm(make, GCSA)).verdict[:3:2] == (Fate.DROP, GateReason.FEED_FAULT)
    assert "a bug" in door.faults[0]
    for name in ("HEARTBEAT", "PING", "RC_CHANNELS_OVERRIDE"):
        frame = make(name)
        assert door.up(A, frame).passed == [frame.raw]


def test_any_bytes_in_a_feed_raise_nothing_and_change_no_other_frame(make: Make) -> None:
    chance = random.Random(50)
    door = door_with(settings(GCSA, GCSB, kinds=list(FeedKind)), step_s=0.01)
    stations = {GCSA: A, GCSB: B, GCSC: C}
    for number in range(6000):
        name = chance.choice(list(MESSAGES))
        sysid = chance.choice(list(stations))
        blank = make(name, sysid=sysid)
        payload = chance.randbytes(len(blank.payload))
        if name == "GPS_RTCM_DATA" and chance.random() < 0.5:
            payload = bytes([chance.randrange(256), 180]) + (b"\xd3\x00\x13\x3e" * 45)[:180]
        verdict = door.up(stations[sysid], blank._replace(payload=payload)).verdict
        assert verdict.fate in (Fate.FORWARD, Fate.DROP)
        assert sysid in (GCSA, GCSB) or verdict.fate is Fate.DROP
        if number % 50 == 0:
            door.gate.tick(door.now)
            frame = make("PING", seq=number)
            assert door.up(A, frame).passed == [frame.raw]
    assert door.faults == []
