# SPDX-License-Identifier: GPL-3.0-or-later

"""Whom MAVProxy's listening UDP links answer: pymavlink's own, on loopback, read as MAVProxy reads them."""

from __future__ import annotations

import contextlib
import socket
import time
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from MAVProxy import mavproxy
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as stock
from pymavlink.dialects.v20 import handover as mavlink

from gcs_module.signing import LinkSigning
from gcs_module.udp_senders import MOST_SENDERS, UdpSenders
from mavproxy_handover.store.keys import key_of
from mavproxy_handover.tools.clocks import Clocks
from tests.link.frames import Clock

HERE = "127.0.0.1"
KEY, OTHER_KEY = key_of("the-passphrase-of-GCSA"), key_of("another-passphrase")
BEAT = mavlink.MAVLink_heartbeat_message(2, 3, 81, 0, 3, 3)
NOISE = b"\xfd\xff\x00"


class Sender:
    """A program with a socket of its own that sends MAVLink, signed if it has a key."""

    def __init__(self, sysid: int = 1, key: bytes | None = None, host: str = HERE) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind((host, 0))
        self.socket.setblocking(False)
        self.own = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=1)
        if key is not None:
            self.own.signing.secret_key, self.own.signing.sign_outgoing = key, True
            self.own.signing.timestamp = int((time.time() - 1420070400) * 100_000)

    @property
    def address(self) -> tuple[str, int]:
        address: tuple[str, int] = self.socket.getsockname()
        return address

    def packed(self) -> bytes:
        raw = bytes(BEAT.pack(self.own))
        self.own.seq = (self.own.seq + 1) % 256
        return raw

    def send(self, master: Any, data: bytes | None = None) -> None:
        self.socket.sendto(self.packed() if data is None else data, master.port.getsockname())

    def received(self) -> list[bytes]:
        found = []
        with contextlib.suppress(BlockingIOError):
            while True:
                found.append(self.socket.recv(4096))
        return found


class Bench:
    """A link of MAVProxy's, `UdpSenders`, and the system ids of the frames that MAVProxy got."""

    def __init__(self, stack: contextlib.ExitStack, patch: pytest.MonkeyPatch) -> None:
        self._stack, self._patch = stack, patch
        self.clock = Clock()
        self.faults: list[str] = []
        self.naps = 0
        self.heard: list[int] = []
        self.master = self.listening()
        counters = {"MasterIn": [SimpleNamespace(update=lambda _count: None)]}
        status = SimpleNamespace(bytecounters=counters, setup_mode=False, mav_error=0)
        settings = SimpleNamespace(compdebug=0)
        state = SimpleNamespace(status=status, settings=settings, logqueue_raw=None, sysid_outputs={})
        patch.setattr(mavproxy, "mpstate", state)
        patch.setattr(mavproxy, "opts", SimpleNamespace(show_errors=False), raising=False)
        patch.setattr(mavproxy, "time", SimpleNamespace(sleep=self._nap))

    def _nap(self, _seconds: float) -> None:
        self.naps += 1

    def listening(self) -> Any:
        patch = self._patch
        patch.setenv("MAVLINK20", "1")
        master = mavutil.mavlink_connection(f"udpin:{HERE}:0", dialect="ardupilotmega")
        self._stack.callback(master.close)
        master.linknum, master.first_byte = 0, True
        master.mav = stock.MAVLink(master, srcSystem=251, srcComponent=190)
        master.mav.robust_parsing = True
        master.mav.set_callback(self._heard)
        return master

    def _heard(self, message: Any) -> None:
        if message.get_type() != "BAD_DATA":
            self.heard.append(message.get_srcSystem())

    def watched(self, key: bytes | None = None) -> UdpSenders:
        """Our part, set up as the module does it."""
        callers = UdpSenders(1, key is not None, self.clock, lambda _where, text: self.faults.append(text))
        callers.watch([self.master])
        if key is not None:
            signing = LinkSigning(key, Clocks(time.time, self.clock))
            signing.sign([self.master], callers.proven)
        return callers

    def sender(self, *arguments: Any) -> Sender:
        sender = Sender(*arguments)
        self._stack.callback(sender.socket.close)
        return sender

    def read(self, most: int = 5000) -> None:
        """As MAVProxy's main loop does, until nothing is left."""
        for _ in range(most):
            if not self.master.select(0):
                return
            mavproxy.process_master(self.master)
        raise AssertionError("there is no end of it")

    def written(self, *senders: Sender) -> list[bool]:
        """Which of these a frame gets to that MAVProxy sends."""
        for sender in senders:
            sender.received()
        self.master.mav.heartbeat_send(6, 8, 0, 0, 4)
        return [len(sender.received()) == 1 for sender in senders]


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    with contextlib.ExitStack() as stack:
        bench = Bench(stack, monkeypatch)
        yield bench
        assert bench.faults == []


@pytest.fixture(params=[None, KEY], ids=["unsigned", "signed"])
def key(request: pytest.FixtureRequest) -> bytes | None:
    found: bytes | None = request.param
    return found


def test_pymavlink_as_it_comes_answers_everybody(bench: Bench) -> None:
    """Why there is anything to do here. Fails once pymavlink has mended it."""
    strangers = [bench.sender(9) for _ in range(20)]
    for stranger in strangers:
        stranger.send(bench.master, b"x")
    bench.read()
    assert bench.written(*strangers) == [True] * 20


def test_strangers_are_not_answered_and_not_remembered(bench: Bench, key: bytes | None) -> None:
    bench.watched(key)
    vehicle = bench.sender(1, key)
    strangers = [bench.sender(9) for _ in range(200)]
    for stranger in strangers:
        stranger.send(bench.master, b"x")
    bench.read()
    assert bench.written(*strangers) == [False] * 200
    vehicle.send(bench.master)
    for stranger in strangers:
        stranger.send(bench.master, b"x")
        stranger.send(bench.master)
    bench.read()
    assert bench.written(vehicle, *strangers) == [True] + [False] * 200
    assert len(bench.master.clients) == len(bench.master.clients_last_alive) == 1
    assert bench.naps == 0, "each is 0.1 s that the station stands still"
    assert bench.heard[0] == 1


def test_half_a_frame_of_a_stranger_holds_up_nothing(bench: Bench, key: bytes | None) -> None:
    bench.watched(key)
    vehicle, stranger = bench.sender(1, key), bench.sender(9)
    stranger.send(bench.master, NOISE)
    vehicle.send(bench.master)
    bench.read()
    assert bench.heard == [1]
    stranger.send(bench.master, NOISE)
    vehicle.send(bench.master)
    bench.read()
    assert bench.heard == [1, 1]


def test_nor_in_the_name_of_the_vehicles_address(bench: Bench, key: bytes | None) -> None:
    bench.watched(key)
    vehicle = bench.sender(1, key)
    for _ in range(3):
        vehicle.send(bench.master)
        vehicle.send(bench.master, NOISE)
    vehicle.send(bench.master)
    bench.read()
    assert bench.heard == [1] * 4


@pytest.mark.parametrize("elsewhere", [False, True])
def test_what_waits_in_the_parser_is_not_waited_for_any_longer_than_on_a_line(
    bench: Bench, key: bytes | None, elsewhere: bool
) -> None:
    bench.watched(key)
    vehicle = before = bench.sender(1, key)
    before.send(bench.master)
    before.send(bench.master, NOISE)
    bench.read()
    bench.clock.now += 0.25
    if elsewhere:
        vehicle = bench.sender(1, key)
        vehicle.own.signing.link_id = 1
        vehicle.send(bench.master)
    else:
        raw = vehicle.packed()
        vehicle.send(bench.master, raw[:10])
        vehicle.send(bench.master, raw[10:])
    bench.read()
    assert bench.heard == [1, 1]


def test_a_vehicle_whose_bridge_cuts_frames_anywhere_is_heard(bench: Bench, key: bytes | None) -> None:
    bench.watched(key)
    vehicle = bench.sender(1, key)
    vehicle.send(bench.master)
    raw = vehicle.packed() + vehicle.packed()
    for part in (raw[:5], raw[5:25], raw[25:]):
        vehicle.send(bench.master, part)
    bench.read()
    assert bench.heard == [1, 1, 1]


def test_what_is_not_signed_with_the_key_makes_nobody_the_vehicle(bench: Bench) -> None:
    bench.watched(KEY)
    vehicle, unsigned, forger, repeater = (bench.sender(1, key) for key in (KEY, None, OTHER_KEY, None))
    raw = vehicle.packed()
    vehicle.send(bench.master, raw)
    for sender in (unsigned, forger):
        sender.send(bench.master)
    repeater.send(bench.master, raw)
    bench.read()
    assert bench.written(vehicle, unsigned, forger, repeater) == [True, False, False, False]
    assert bench.heard == [1]


def test_a_vehicle_with_several_modems_is_answered_on_each(bench: Bench, key: bytes | None) -> None:
    bench.watched(key)
    modems = [bench.sender(1, key) for _ in range(3)]
    for number, modem in enumerate(modems):
        modem.own.signing.link_id = number
        modem.send(bench.master)
    bench.read()
    assert bench.written(*modems) == [True] * 3


def test_who_is_heard_does_not_have_to_go_for_who_says_that_he_is_the_vehicle(bench: Bench) -> None:
    """Without a key anybody may say so."""
    bench.watched()
    vehicle, liars = bench.sender(1), [bench.sender(1) for _ in range(10)]
    for _ in range(20):
        bench.clock.now += 1.0
        vehicle.send(bench.master)
        for liar in liars:
            liar.send(bench.master)
        bench.read()
        assert len(bench.master.clients) == MOST_SENDERS
        assert bench.written(vehicle) == [True]


def test_a_vehicle_that_comes_from_elsewhere_is_answered_there_and_its_old_place_is_forgotten(
    bench: Bench, key: bytes | None
) -> None:
    callers = bench.watched(key)
    before, after = bench.sender(1, key), bench.sender(1, key)
    after.own.signing.link_id = 1
    before.send(bench.master)
    bench.read()
    bench.clock.now += 3.0
    after.send(bench.master)
    bench.read()
    assert bench.written(before, after) == [True, True]
    bench.clock.now += 8.0
    after.send(bench.master)
    bench.read()
    callers.watch([bench.master])
    assert bench.written(before, after) == [False, True]
    bench.clock.now += 100.0
    callers.watch([bench.master])
    assert bench.written(after) == [True]  # the last is kept: it may hear what is not answered


def test_something_else_than_the_vehicle_is_answered_while_it_is_alone(bench: Bench) -> None:
    """A MAVProxy that talks with a tracker, say, goes on doing so; a vehicle that comes later has the link."""
    bench.watched()
    tracker, vehicle, stranger = bench.sender(77), bench.sender(1), bench.sender(9)
    tracker.send(bench.master)
    stranger.send(bench.master)
    bench.read()
    assert bench.written(tracker, stranger) == [True, False]
    bench.clock.now += 2.0
    stranger.send(bench.master)
    bench.read()
    assert bench.written(tracker, stranger) == [False, True]
    vehicle.send(bench.master)
    tracker.send(bench.master)
    bench.read()
    assert bench.written(tracker, stranger, vehicle) == [False, False, True]
    assert bench.heard == [77, 9, 9, 1, 77]


def test_a_flood_of_strangers_costs_no_nap_and_the_vehicle_gets_through(bench: Bench, key: bytes | None) -> None:
    bench.watched(key)
    vehicle, strangers = bench.sender(1, key), [bench.sender(9) for _ in range(20)]
    vehicle.send(bench.master)
    bench.read()
    for _ in range(20):
        for stranger in strangers:
            stranger.send(bench.master, b"x")
            stranger.send(bench.master, NOISE * 100)
        vehicle.send(bench.master)
        bench.read()
    assert bench.heard == [1] * 21
    assert bench.naps == 0


def test_a_vehicle_that_comes_anew_is_heard_in_the_same_read_though_another_host_floods_the_link(
    bench: Bench, key: bytes | None
) -> None:
    bench.watched(key)
    vehicle, strangers = bench.sender(1, key, "127.0.0.2"), [bench.sender(9) for _ in range(20)]
    for stranger in strangers:
        for _ in range(10):
            stranger.send(bench.master, NOISE * 10)
    vehicle.send(bench.master)
    mavproxy.process_master(bench.master)
    assert bench.heard == [1]


def test_strangers_make_no_link_a_lively_one(bench: Bench, key: bytes | None) -> None:
    """By what came on it a station chooses the link that it sends on."""
    callers = bench.watched(key)
    vehicle, forger = bench.sender(1, key), bench.sender(9, OTHER_KEY)
    for _ in range(50):
        forger.send(bench.master)
        forger.send(bench.master, b"x")
    bench.read()
    assert callers.received(bench.master) == 0
    for _ in range(3):
        vehicle.send(bench.master)
    bench.read()
    assert callers.received(bench.master) == 3
    other = SimpleNamespace(mav=SimpleNamespace(total_packets_received=5))
    assert callers.received(other) == 5


def test_a_sender_that_cannot_be_written_to_is_not_the_vehicle(bench: Bench) -> None:
    """An error ends pymavlink's round of writing: the others would get nothing."""
    callers = bench.watched()
    vehicle = bench.sender(1)
    vehicle.send(bench.master)
    bench.read()
    callers._on_vehicle_frame(callers._links[0], (HERE, 0), bench.clock())
    assert bench.master.clients == {vehicle.address}


def test_a_time_out_of_pymavlinks_own_changes_nothing(bench: Bench, key: bytes | None) -> None:
    """`link add udpin:...:{"timeout":5}` sets one."""
    bench.watched(key)
    bench.master.timeout = 1e-9
    modems = [bench.sender(1, key) for _ in range(2)]
    for number, modem in enumerate(modems):
        modem.own.signing.link_id = number
        modem.send(bench.master)
    bench.read()
    assert bench.written(*modems) == [True, True]
    assert bench.written(*modems) == [True, True]


def test_other_links_are_left_alone_and_released_ones_are_as_they_were(bench: Bench) -> None:
    callers = bench.watched()
    outward = mavutil.mavlink_connection(f"udpout:{HERE}:9")
    plain: Any = SimpleNamespace()
    callers.watch([bench.master, outward, plain])
    assert "recv" in bench.master.__dict__
    assert "recv" not in outward.__dict__
    assert plain.__dict__ == {}
    callers.release()
    assert "recv" not in bench.master.__dict__
    outward.close()


def test_a_link_that_was_removed_is_forgotten_and_one_that_was_added_is_seen_to(bench: Bench) -> None:
    callers = bench.watched()
    other = bench.listening()
    callers.watch([other])
    assert [link.master for link in callers._links] == [other]
    assert "recv" in other.__dict__


def test_a_fault_of_ours_costs_the_vehicle_nothing(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    bench.watched()
    vehicle = bench.sender(1)
    vehicle.send(bench.master)
    bench.read()

    def broken(_data: bytes) -> Any:
        raise RuntimeError

    monkeypatch.setattr("gcs_module.udp_senders._frames", broken)
    vehicle.send(bench.master)
    bench.read()
    assert bench.heard == [1, 1]
    assert len(bench.faults) == 1
    bench.faults.clear()
