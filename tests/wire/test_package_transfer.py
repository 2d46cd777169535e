# SPDX-License-Identifier: GPL-3.0-or-later

"""A mission package through links that lose, double, delay and swap: it arrives whole, or it is refused with a word."""

from __future__ import annotations

import hashlib
import heapq
import random
from dataclasses import dataclass, field
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink
from pymavlink.generator.mavcrc import x25crc

from mavproxy_handover.wire import codec
from mavproxy_handover.wire.package_transfer import (
    CHUNK_BYTES,
    MAX_PACKAGE_BYTES,
    PackageReceiver,
    PackageSender,
    package_id,
)

RECEIVING, RECEIVED, LOADED, REFUSED = 0, 1, 2, 3
TO, BACK = (1, 191), (251, 190)


def content(size: int, seed: int = 1) -> tuple[bytes, bytes]:
    """Data and a digest for it."""
    data = random.Random(seed).randbytes(size)
    return data, hashlib.sha256(data).digest()


@dataclass
class Pipe:
    """One direction of a link. Losses, doubles and delays come from `rng`; every frame really is packed."""

    rng: random.Random
    loss: float = 0.0
    double: float = 0.0
    delay_s: float = 0.01
    jitter_s: float = 0.0
    cut: bool = False
    frames: int = 0
    queue: list[tuple[float, int, bytes]] = field(default_factory=list)

    def put(self, messages: list[Any], sysid: int, now: float) -> None:
        own = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=190)
        for message in messages:
            for _ in range(1 + (self.rng.random() < self.double)):
                self.frames += 1
                if self.cut or self.rng.random() < self.loss:
                    continue
                at = now + self.delay_s + self.rng.random() * self.jitter_s
                heapq.heappush(self.queue, (at, self.frames, bytes(message.pack(own))))

    def get(self, now: float) -> list[Any]:
        found = []
        while self.queue and self.queue[0][0] <= now:
            found.append(mavlink.MAVLink(None).decode(bytearray(heapq.heappop(self.queue)[2])))
        return found


class Link:
    """Sender and receiver with a pipe each way, in time that the test moves."""

    def __init__(self, data: bytes, digest: bytes, *, seed: int = 0, until_loaded: bool = False, **faults: Any) -> None:
        rng = random.Random(seed)
        self.there, self.back = Pipe(rng, **faults), Pipe(rng, **faults)
        self.sender = PackageSender(data, digest, "mission", TO, until_loaded=until_loaded)
        self.receiver = PackageReceiver()
        self.now = 100.0
        #: what the receiver was given, and what it says of it
        self.whole: list[tuple[bytes, bytes]] = []
        self.verdict: tuple[int, str] = (RECEIVED, "")
        self.progress: list[float] = []

    def step(self) -> None:
        self.now += 0.01
        self.there.put(self.sender.tick(self.now), 251, self.now)
        for message in self.there.get(self.now):
            self.back.put(self._receive(message), 1, self.now)
        for ack in self.back.get(self.now):
            self.there.put(self.sender.on_ack(ack, self.now), 251, self.now)
        self.progress.append(self.sender.progress)

    def _receive(self, message: Any) -> list[Any]:
        if message.get_type() == "MISSION_PACKAGE":
            return self.receiver.on_offer(message, BACK)
        answers, whole = self.receiver.on_chunk(message, BACK)
        if whole is not None:
            self.whole.append(whole)
            answers = [*answers, self.receiver.conclude(whole[0], *self.verdict, BACK)]
        return answers

    def run(self, limit_s: float) -> None:
        end = self.now + limit_s
        while self.now < end and not self.sender.finished:
            self.step()


@pytest.mark.parametrize(
    "size", [1, CHUNK_BYTES - 1, CHUNK_BYTES, CHUNK_BYTES + 1, 1600, 1601, 5000, MAX_PACKAGE_BYTES]
)
def test_a_package_of_any_size_arrives_whole(size: int) -> None:
    data, digest = content(size)
    link = Link(data, digest)
    link.run(60.0)
    assert link.sender.result == RECEIVED
    assert link.whole == [(digest, data)]


def test_nothing_is_sent_twice_over_a_good_link() -> None:
    data, digest = content(10_000)
    link = Link(data, digest)
    link.run(10.0)
    assert link.there.frames == 1 + 50, "the offer, and each of fifty chunks"


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize(
    "faults",
    [
        {"loss": 0.2},
        {"loss": 0.5},
        {"double": 0.5},
        {"jitter_s": 0.2},
        {"loss": 0.3, "double": 0.3, "jitter_s": 0.3, "delay_s": 0.2},
    ],
    ids=["loss 20 %", "loss 50 %", "doubles", "order", "all of it"],
)
def test_loss_doubling_and_reordering_cost_time_and_nothing_else(faults: dict[str, float], seed: int) -> None:
    data, digest = content(4321, seed)
    link = Link(data, digest, seed=seed, **faults)
    link.run(300.0)
    assert link.sender.result == RECEIVED
    assert link.whole[0] == (digest, data)
    assert set(link.whole) == {(digest, data)}


def test_a_transfer_that_was_cut_goes_on_where_it_stopped() -> None:
    data, digest = content(20_000)
    link = Link(data, digest)
    while link.sender.progress < 0.5:
        link.step()
    link.there.cut = link.back.cut = True
    link.run(30.0)
    before = link.there.frames
    assert link.sender.progress == pytest.approx(0.5, abs=0.1)
    link.there.cut = link.back.cut = False
    link.run(10.0)
    assert link.whole == [(digest, data)]
    assert link.there.frames - before < 70, "half of the hundred chunks, not all"


def test_a_receiver_that_has_started_anew_gets_the_package_all_the_same() -> None:
    """The companion's module was loaded again in the middle of a transfer and knows nothing of it."""
    data, digest = content(20_000)
    link = Link(data, digest)
    while link.sender.progress < 0.5:
        link.step()
    link.receiver = PackageReceiver()
    link.run(20.0)
    assert link.sender.result == RECEIVED
    assert link.whole == [(digest, data)]


def test_two_senders_to_one_receiver_both_come_to_an_end() -> None:
    """A new offer takes the place of an unfinished one; the one that was pushed aside offers again."""
    first, second = Link(*content(3000, 1)), Link(*content(3000, 2))
    second.receiver = first.receiver
    for _ in range(2000):
        first.step()
        second.step()
    assert (first.sender.result, second.sender.result) == (RECEIVED, RECEIVED)


def test_progress_rises_to_one() -> None:
    link = Link(*content(10_000))
    assert link.sender.progress == 0.0
    link.run(10.0)
    assert link.progress == sorted(link.progress)
    assert link.sender.progress == 1.0


def test_a_package_larger_than_allowed_is_refused_before_anything_is_sent() -> None:
    link = Link(*content(MAX_PACKAGE_BYTES + 1))
    link.run(10.0)
    assert (link.sender.result, link.sender.text) == (REFUSED, "package of 65537 bytes, allowed are 65536")
    assert link.there.frames == 1
    assert link.whole == []


def test_an_empty_package_is_refused() -> None:
    link = Link(b"", bytes(32))
    link.run(10.0)
    assert (link.sender.result, link.sender.text) == (REFUSED, "package of 0 bytes, allowed are 65536")


def test_a_refusal_of_the_contents_reaches_the_sender_with_its_reason() -> None:
    link = Link(*content(3000))
    link.verdict = (REFUSED, "the contents do not have the digest that was promised")
    link.run(10.0)
    assert link.sender.result == REFUSED
    assert link.sender.text == "the contents do not have the digest that was promi", "50 characters"
    link.step()
    assert link.sender.tick(link.now + 100) == []


def test_a_refused_package_may_be_offered_again() -> None:
    data, digest = content(3000)
    link = Link(data, digest)
    link.verdict = (REFUSED, "not now")
    link.run(10.0)
    link.sender, link.verdict = PackageSender(data, digest, "mission", TO), (RECEIVED, "")
    link.run(10.0)
    assert link.sender.result == RECEIVED
    assert link.whole == [(digest, data)] * 2


def test_a_package_that_is_there_already_is_not_sent_again() -> None:
    data, digest = content(3000)
    link = Link(data, digest)
    link.run(10.0)
    link.sender = PackageSender(data, digest, "mission", TO)
    before = link.there.frames
    link.run(10.0)
    assert link.sender.result == RECEIVED
    assert link.there.frames - before == 1
    assert len(link.whole) == 1


@pytest.mark.parametrize("verdict", [(LOADED, ""), (REFUSED, "item 3 came back changed")])
@pytest.mark.parametrize("seed", range(5))
def test_the_last_word_on_a_mission_that_is_loaded_is_asked_for_until_it_is_heard(
    verdict: tuple[int, str], seed: int
) -> None:
    data, digest = content(3000)
    link = Link(data, digest, seed=seed, until_loaded=True, loss=0.5)
    while link.sender.result != RECEIVED:
        link.step()
    assert not link.sender.finished
    assert link.sender.progress == 1.0
    link.verdict = verdict
    link.receiver.conclude(digest, *verdict, BACK)  # said once, and lost
    link.run(300.0)
    assert (link.sender.result, link.sender.text) == verdict


def test_what_comes_after_the_last_word_changes_nothing() -> None:
    data, digest = content(3000)
    link = Link(data, digest)
    link.run(10.0)
    stale = mavlink.MAVLink_mission_package_ack_message(*BACK, package_id(digest), 0, RECEIVING, b"")
    late = mavlink.MAVLink_mission_package_ack_message(*BACK, package_id(digest), 0, REFUSED, b"late")
    assert link.sender.on_ack(stale, link.now) == []
    assert link.sender.on_ack(late, link.now) == []
    assert link.sender.result == RECEIVED


def test_an_acknowledgement_of_another_package_or_beyond_the_end_is_ignored() -> None:
    data, digest = content(3000)
    sender = PackageSender(data, digest, "mission", TO)
    sender.tick(1.0)
    other = mavlink.MAVLink_mission_package_ack_message(*BACK, package_id(digest) ^ 1, 0, RECEIVING, b"")
    beyond = mavlink.MAVLink_mission_package_ack_message(*BACK, package_id(digest), 3001, RECEIVING, b"")
    assert sender.on_ack(other, 1.1) == []
    assert sender.on_ack(beyond, 1.1) == []
    assert sender.result is None


def test_chunks_of_a_package_that_was_never_offered_are_ignored() -> None:
    receiver = PackageReceiver()
    chunk = mavlink.MAVLink_mission_chunk_message(*TO, 5, 0, 200, [1] * 200)
    assert receiver.on_chunk(chunk, BACK) == ([], None)


def test_a_chunk_that_says_it_is_longer_than_it_can_be_is_cut() -> None:
    digest = bytes(range(32))
    receiver = PackageReceiver()
    receiver.on_offer(mavlink.MAVLink_mission_package_message(*TO, 250, list(digest), b"x"), BACK)
    for offset in (0, 200):
        chunk = mavlink.MAVLink_mission_chunk_message(*TO, package_id(digest), offset, 255, [7] * 200)
        _answers, whole = receiver.on_chunk(chunk, BACK)
    assert whole == (digest, bytes([7]) * 250), "and never longer than was promised"


def test_what_is_missing_is_asked_for_at_once_and_once() -> None:
    digest = bytes(range(32))
    receiver = PackageReceiver()
    receiver.on_offer(mavlink.MAVLink_mission_package_message(*TO, 2000, list(digest), b"x"), BACK)
    answers = []
    for offset in (0, 400, 600, 800):  # the second one was lost
        chunk = mavlink.MAVLink_mission_chunk_message(*TO, package_id(digest), offset, 200, [7] * 200)
        answers += receiver.on_chunk(chunk, BACK)[0]
    assert [(ack.result, ack.next_offset) for ack in answers] == [(RECEIVING, 200)]


def test_chunks_that_overlap_are_put_together() -> None:
    digest, data = bytes(range(32)), bytes(range(250))
    receiver = PackageReceiver()
    receiver.on_offer(mavlink.MAVLink_mission_package_message(*TO, 250, list(digest), b"x"), BACK)
    for offset, length in ((0, 100), (50, 200)):
        piece = list(data[offset : offset + length].ljust(200, b"\0"))
        chunk = mavlink.MAVLink_mission_chunk_message(*TO, package_id(digest), offset, length, piece)
        _answers, whole = receiver.on_chunk(chunk, BACK)
    assert whole == (digest, data)


def test_an_empty_chunk_is_ignored() -> None:
    digest = bytes(range(32))
    receiver = PackageReceiver()
    receiver.on_offer(mavlink.MAVLink_mission_package_message(*TO, 250, list(digest), b"x"), BACK)
    chunk = mavlink.MAVLink_mission_chunk_message(*TO, package_id(digest), 0, 0, [0] * 200)
    assert receiver.on_chunk(chunk, BACK) == ([], None)


def test_a_package_is_named_by_the_first_four_bytes_of_its_digest() -> None:
    assert package_id(bytes(range(32))) == 0x03020100


def test_the_sender_names_the_package_in_its_offer() -> None:
    sender = PackageSender(b"x" * 10, bytes(range(32)), "a name that is longer than the field allows it", TO)
    (offer,) = sender.tick(1.0)
    assert (offer.size, bytes(offer.mission_digest)) == (10, bytes(range(32)))
    assert offer.name == "a name that is longer than the f"
    assert (offer.target_system, offer.target_component) == TO


def test_while_a_whole_package_is_being_read_its_sender_has_nothing_more_to_send() -> None:
    """To read it may take seconds; without a word the sender would offer it anew, and send it all again."""
    data, digest = content(1000)
    sender, receiver = PackageSender(data, digest, "m", TO, until_loaded=True), PackageReceiver()
    whole = None
    pending = sender.tick(0.0)
    while whole is None:
        messages, pending = pending, []
        for message in messages:
            if message.get_type() == "MISSION_PACKAGE":
                answers = receiver.on_offer(message, BACK)
            else:
                answers, whole = receiver.on_chunk(message, BACK)
            for answer in answers:
                pending += sender.on_ack(answer, 0.0)
    assert whole == (digest, data)
    for number in range(1, 9):
        (offer,) = sender.tick(float(number))
        (answer,) = receiver.on_offer(offer, BACK)
        assert (answer.result, answer.next_offset) == (RECEIVING, len(data))
        assert sender.on_ack(answer, float(number)) == []
    assert not sender.finished
    sender.on_ack(receiver.conclude(digest, LOADED, "", BACK), 9.0)
    assert sender.finished


def test_a_package_of_another_size_is_another_one_though_its_digest_is_promised_to_be_the_same() -> None:
    data, digest = content(100)
    receiver = PackageReceiver()
    (offer,) = PackageSender(data, digest, "m", TO).tick(0.0)
    receiver.on_offer(offer, BACK)
    sender = PackageSender(data, digest, "m", TO)
    sender.tick(0.0)
    (chunk,) = sender.on_ack(
        mavlink.MAVLink_mission_package_ack_message(*BACK, package_id(digest), 0, RECEIVING, b""), 0.0
    )
    assert receiver.on_chunk(chunk, BACK)[1] == (digest, data)
    (larger,) = PackageSender(data * 2, digest, "m", TO).tick(0.0)
    (answer,) = receiver.on_offer(larger, BACK)
    assert answer.next_offset == 0


#: station 252: udpout 10.0.0.2:14552, as `tests/wire/test_vehicle_address.py` has the bytes
ADDRESS = bytes.fromhex("fc0138d80a000002")


def test_each_offer_carries_the_vehicles_addresses_and_the_package_stays_as_it_is() -> None:
    data, digest = content(1000)
    sender = PackageSender(data, digest, "m", TO, addresses=ADDRESS)
    for now in (0.0, 1.0):
        (offer,) = sender.tick(now)
        assert bytes(offer.addresses) == ADDRESS + bytes(168)
        assert (offer.size, bytes(offer.mission_digest)) == (1000, digest)


def test_an_offer_without_addresses_is_as_long_as_it_was_before_there_were_any() -> None:
    (offer,) = PackageSender(b"x" * 10, bytes(range(1, 33)), "name", TO).tick(0.0)
    raw = offer.pack(mavlink.MAVLink(None, srcSystem=252, srcComponent=190))
    assert len(raw) == 10 + 2 + 4 + 32 + 4 + 2  # head, target, size, digest, the name's letters, CRC


def test_an_offer_of_a_version_before_the_addresses_has_none() -> None:
    """Its payload ends with the field `vehicle`."""
    offer = mavlink.MAVLink_mission_package_message(
        251, 0, 10, [7] * 32, b"delivery", 1, list(ADDRESS.ljust(176, b"\7"))
    )
    raw = bytes(offer.pack(mavlink.MAVLink(None, srcSystem=252, srcComponent=190)))
    payload = raw[10 : 10 + 71]
    head = bytes([0xFD, len(payload)]) + raw[2:10]
    crc = x25crc(head[1:] + payload)
    crc.accumulate(bytes([mavlink.MAVLink_mission_package_message.crc_extra]))
    message = codec.decode_bytes(head + payload + crc.crc.to_bytes(2, "little"))
    assert message is not None
    assert (message.name, message.vehicle, bytes(message.addresses)) == ("delivery", 1, bytes(176))


def test_an_offer_of_a_newer_version_is_understood_as_far_as_it_is_known() -> None:
    """So does a program from before the addresses read an offer that has some."""
    offer = mavlink.MAVLink_mission_package_message(
        251, 0, 10, [7] * 32, b"delivery", 1, list(ADDRESS.ljust(176, b"\7"))
    )
    raw = bytes(offer.pack(mavlink.MAVLink(None, srcSystem=252, srcComponent=190)))
    payload = raw[10:-2] + b"\5" * 8
    assert len(payload) == 255
    head = bytes([0xFD, len(payload)]) + raw[2:10]
    crc = x25crc(head[1:] + payload)
    crc.accumulate(bytes([mavlink.MAVLink_mission_package_message.crc_extra]))
    message = codec.decode_bytes(head + payload + crc.crc.to_bytes(2, "little"))
    assert message is not None
    assert (message.size, message.name, message.vehicle) == (10, "delivery", 1)
    assert bytes(message.addresses)[:8] == ADDRESS
