# SPDX-License-Identifier: GPL-3.0-or-later

"""The harnesses of all fuzzers, with plans of chance, with those that are kept, and against code that is broken."""

from __future__ import annotations

import importlib
from dataclasses import replace
from functools import partial

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gcs_module.ground import GroundLink
from mavproxy_handover.gate import feeds as gate_feeds
from mavproxy_handover.gate.feeds import Feeds
from mavproxy_handover.gate.onboard import OnboardFilters
from mavproxy_handover.operator.onboard.delegating import Delegating
from mavproxy_handover.store.state_file import Kept, StateFile
from mavproxy_handover.wire.frames import FrameSplitter
from mavproxy_handover.wire.vehicle_address import VehicleAddress
from tests.fuzz import feeds, ground, onboard, package, states, stream
from tests.fuzz.fuzz import CORPUS, TARGETS

ANY = st.integers(0, 255)
NOISE = st.binary(max_size=40) | st.lists(st.sampled_from([0xFD, 0xFE, 0xFF, 0, 1, 9, 0x31, 0xD4]), max_size=40).map(
    bytes
)
STREAMS = st.lists(
    NOISE.map(lambda data: bytes([stream.NOISE, len(data)]) + data)
    | st.tuples(st.just(stream.FRAME), ANY).map(bytes)
    | st.tuples(st.just(stream.SPLIT), ANY, ANY, ANY).map(bytes)
    | st.tuples(st.just(stream.DAMAGED), ANY, ANY, ANY).map(bytes)
    | st.tuples(st.just(stream.PAUSE), ANY).map(bytes),
    max_size=30,
).map(b"".join)
#: a sealed file with other values under one key or two
VALUES = st.builds(
    lambda kind, changes: bytes([states.VALUES, kind]) + b"".join(changes),
    st.integers(0, 1),
    st.lists(st.builds(lambda head, rest: bytes(head) + rest, st.tuples(ANY, ANY, ANY, ANY), st.binary(max_size=6))),
)


@pytest.mark.parametrize("name", TARGETS)
def test_plans_that_broke_something_and_plans_that_reach_far_hold(name: str) -> None:
    run = importlib.import_module(TARGETS[name].harness).run
    for path in sorted((CORPUS / name).glob("*.bin")):
        run(path.read_bytes())


@pytest.mark.parametrize("name", TARGETS)
def test_the_kept_plans_are_few_and_have_a_target(name: str) -> None:
    assert {path.name for path in CORPUS.iterdir()} <= set(TARGETS)
    assert sum(path.stat().st_size for path in (CORPUS / name).glob("*.bin")) < 100_000


@settings(max_examples=300, deadline=None)
@given(STREAMS)
def test_no_noise_makes_a_line_deaf_or_a_frame_of_nothing(plan: bytes) -> None:
    stream.run(plan)


@settings(max_examples=200, deadline=None)
@given(VALUES | st.binary(max_size=60))
def test_no_file_is_believed_that_cannot_be_gone_on_from(plan: bytes) -> None:
    states.run(plan)


@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.sampled_from(list(ground.seeds())), st.integers(0, 400), st.binary(max_size=12))
def test_no_datagram_moves_a_station(seed: bytes, place: int, other: bytes) -> None:
    ground.run(seed[:place] + other + seed[place:])


@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.sampled_from(list(package.seeds())), st.integers(0, 1600), st.integers(0, 8), st.binary(max_size=8))
def test_no_package_does_anything_but_be_read_or_refused(seed: bytes, place: int, gone: int, other: bytes) -> None:
    package.run(seed[:place] + other + seed[place + gone :])


FEEDS = list(feeds.seeds())
ONBOARD = list(onboard.seeds())


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.sampled_from(FEEDS), st.integers(0, 120), st.integers(0, 8), st.binary(max_size=12), st.sampled_from(FEEDS))
def test_no_feed_passes_that_may_not_and_no_flood_of_them_costs_a_command(
    seed: bytes, place: int, gone: int, other: bytes, then: bytes
) -> None:
    feeds.run(seed[:place] + other + seed[place + gone :][:120] + then[:120])


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    st.sampled_from(ONBOARD), st.integers(0, 60), st.integers(0, 8), st.binary(max_size=12), st.sampled_from(ONBOARD)
)
def test_no_onboard_program_does_more_than_its_rights(
    seed: bytes, place: int, gone: int, other: bytes, then: bytes
) -> None:
    onboard.run(seed[:place] + other + seed[place + gone :] + then)


# ---- a harness that lets everything through proves nothing --------------------------------------------------------


def test_a_line_that_is_deaf_for_a_second_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    plan = bytes([stream.NOISE, 3, 0xFD, 0xFF, 0, stream.PAUSE, 16, stream.FRAME, 0])
    assert len(stream.run(plan).frames) == 1
    monkeypatch.setattr(stream, "FrameSplitter", partial(FrameSplitter, patience_s=1.0))
    with pytest.raises(AssertionError, match="deaf after noise"):
        stream.run(plan)


def test_a_frame_out_of_nothing_is_noticed() -> None:
    heard = stream.Heard()
    heard.frame(0)
    (frame,) = heard.frames
    with pytest.raises(AssertionError, match="invented"):
        heard._check(frame)


def test_most_of_the_packages_that_fuzzing_begins_with_are_sound() -> None:
    assert sum(package.run(seed) is not None for seed in package.seeds()) == 7


@pytest.mark.parametrize("plan", [bytes([states.VALUES, 0]), bytes([states.RAW, 1])])
def test_a_state_that_cannot_be_is_noticed(monkeypatch: pytest.MonkeyPatch, plan: bytes) -> None:
    assert states.run(plan) == states.GOOD
    monkeypatch.setattr(StateFile, "load", lambda _store: Kept(replace(states.GOOD, owner=256)))
    with pytest.raises(AssertionError):
        states.run(plan)


def test_addresses_that_nobody_saved_are_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    plan = bytes([states.DAMAGED, states.KINDS.index("addresses"), 0, 40, 0, 1])
    assert states.run(plan) == states.GOOD
    monkeypatch.setattr(StateFile, "_addresses", lambda _store, _digest: {251: (VehicleAddress("10.8.0.9", 14550),)})
    with pytest.raises(AssertionError):
        states.run(plan)


def test_a_sealed_value_gets_past_the_checksum() -> None:
    """Else the fuzzer would try nothing but checksums."""
    found = states.run(bytes([states.VALUES, 0, states.place_of("epoch"), 1, 2, 1, 9]))
    assert found == replace(states.GOOD, epoch=9)


def test_an_open_ground_link_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    seed = next(iter(ground.seeds()))
    ground.run(seed)
    monkeypatch.setattr(GroundLink, "_proven", lambda _link, _frame: True)
    with pytest.raises(AssertionError):
        ground.run(seed)


def test_a_package_gets_across_the_ground_link_and_is_taken_once_the_vehicle_says_so() -> None:
    taken = [ground.run(seed).module.aircraft[0].mission_transfer.held for seed in ground.seeds() if seed[0] == 0]
    assert ground.OFFERED in taken


def test_feeds_of_every_kind_pass_and_all_plans_hold() -> None:
    passed = [kind for seed in FEEDS for _station, kind in feeds.run(seed).passed]
    assert set(passed) == set(feeds.FeedKind)


def test_a_feed_without_a_limit_or_with_wrong_values_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    # WIND_COV of GCSC, with the payload of a NaN; and a flood of it
    plan = bytes([feeds.FEED, 2, 4, 0, 0, 3, 12]) + bytes(8) + b"\x00\x00\xc0\x7f"
    flood = bytes([feeds.FLOOD, 2, 4, 0, 0, 3, 0, 60, 1])
    assert not feeds.run(plan).passed
    assert feeds.run(flood).passed
    monkeypatch.setattr(Feeds, "_affords", lambda *_: True)
    with pytest.raises(AssertionError, match="more than its limit"):
        feeds.run(flood)
    monkeypatch.setattr(gate_feeds, "_plausible", lambda _frame: True)
    with pytest.raises(AssertionError):
        feeds.run(plan)


def test_the_place_of_a_base_is_found_in_fragments_and_only_there() -> None:
    data = feeds.base(*feeds.PLACES_M[0])
    assert feeds.read_places([(0, data)]) == 1
    assert feeds.read_places([(1, bytes(170) + data[:10]), (3, data[10:])]) == 1
    assert feeds.read_places([(0, data[:-1] + b"\0")]) == 0


def test_programs_do_what_their_rights_contain_and_delegations_end_with_a_hold() -> None:
    runs = [onboard.run(seed) for seed in ONBOARD]
    passed = {(name, feeds.mavlink.mavlink_map[frame.msgid].msgname) for one in runs for name, frame in one.passed}
    assert {("precland", name) for name in onboard.GUIDED} <= passed
    assert {("camera", name) for name in onboard.PAYLOAD} <= passed
    assert ("all", "GPS_INPUT") in passed
    assert sum(one.stood for one in runs) > 10


def test_a_gate_of_programs_that_is_open_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    target = bytes([onboard.INTERESTING.index("SET_POSITION_TARGET_GLOBAL_INT")])
    plan = bytes([onboard.FRAME, 0]) + target + bytes(4)
    assert not onboard.run(plan).passed
    assert onboard.run(onboard.DELEGATED + plan).passed
    monkeypatch.setattr(OnboardFilters, "_delegated", lambda _filters, _frame, verdict, _now: verdict)
    with pytest.raises(AssertionError):
        onboard.run(plan)


def test_a_delegation_that_ends_without_a_stop_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    plan = onboard.DELEGATED + bytes([onboard.PAUSE, 255, onboard.PAUSE, 255])
    assert onboard.run(plan).stood == 1
    monkeypatch.setattr(Delegating, "_stop_stream", lambda _delegating: None)
    with pytest.raises(AssertionError):
        onboard.run(plan)
