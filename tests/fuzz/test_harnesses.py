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
from mavproxy_handover.store.state_file import Kept, StateFile
from mavproxy_handover.wire.frames import FrameSplitter
from mavproxy_handover.wire.vehicle_address import VehicleAddress
from tests.fuzz import ground, package, states, stream
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
