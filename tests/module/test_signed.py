# SPDX-License-Identifier: GPL-3.0-or-later

"""Stations with keys: what is unsigned, forged or replayed does nothing; what goes out is signed for each."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as stock
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.store.keys import key_of, key_path, rotate_key, write_key
from mavproxy_handover.wire.frames import FrameSplitter, parse_one
from mavproxy_handover.wire.signing import SignatureVerdict, SignedPeer
from tests.module.conftest import Bench, Clock
from tests.module.vehicle import Station

KEY_A, KEY_B = key_of("the-passphrase-of-GCSA"), key_of("the-passphrase-of-GCSB")
KEY_AUTOPILOT = key_of("the-passphrase-of-the-autopilot")


class SignedBench(Bench):
    """Both stations sign; `wrong` gives GCSB's program another key than the vehicle has for it."""

    def __init__(self, folder: Path, clock: Clock) -> None:
        (folder / "keys").mkdir()
        for name, key in (("GCSA", KEY_A), ("GCSB", KEY_B), ("autopilot", KEY_AUTOPILOT)):
            write_key(key_path(folder / "keys", name), key)
        super().__init__(folder, clock)
        for station, key in ((self.a, KEY_A), (self.b, KEY_B)):
            sign_with(station, key)

    def configure(self, guard: bool = True, more: str = "") -> None:
        super().configure(guard, more)
        text = self.config.read_text().replace("allow_unsigned = true", "")
        for name in ("GCSA", "GCSB"):
            text = text.replace(f'name = "{name}"', f'name = "{name}"\n            key = "keys/{name}.key"')
        self.config.write_text(text)


def sign_with(station: Station, key: bytes | None) -> None:
    """As MAVProxy's `signing key` does it."""
    signing = station.own.signing
    signing.secret_key, signing.sign_outgoing = key, key is not None
    signing.link_id = station.sysid
    signing.timestamp = int((time.time() - 1420070400) * 100_000)


@pytest.fixture
def signed(clock: Clock, tmp_path: Path) -> Iterator[SignedBench]:
    bench = SignedBench(tmp_path, clock)
    yield bench
    bench.close()
    assert bench.mpstate.escaped == []


def refusals(bench: Bench) -> list[tuple[str, str]]:
    return [(entry["what"], entry["reason"]) for entry in bench.journal("refused")]


def test_a_station_that_signs_commands(signed: SignedBench) -> None:
    signed.connect()
    assert signed.companion.view.commander == 251
    assert refusals(signed) == []


def test_a_station_that_does_not_sign_is_nobody(signed: SignedBench) -> None:
    sign_with(signed.a, None)
    assert signed.load() is not None
    signed.wait(8.0)
    assert signed.companion.view.commander is None
    assert ("HEARTBEAT", SignatureVerdict.UNSIGNED.value) in refusals(signed)


def test_another_stations_key_opens_nothing(signed: SignedBench) -> None:
    sign_with(signed.a, KEY_B)
    assert signed.load() is not None
    signed.wait(8.0)
    assert signed.companion.view.commander is None
    assert ("HEARTBEAT", SignatureVerdict.BAD.value) in refusals(signed)


def test_an_unsigned_command_does_not_reach_the_autopilot(signed: SignedBench) -> None:
    signed.connect()
    sign_with(signed.a, None)
    signed.a.command(mavlink.MAV_CMD_NAV_LAND)
    signed.run(1.0)
    assert not any(m.get_type() == "COMMAND_LONG" and m.command == 21 for m in signed.autopilot.received)
    assert signed.a.acks(mavlink.MAV_CMD_NAV_LAND) == []
    assert ("COMMAND_LONG/MAV_CMD_NAV_LAND", SignatureVerdict.UNSIGNED.value) in refusals(signed)


def test_a_replayed_command_is_not_obeyed_twice(signed: SignedBench) -> None:
    signed.connect()
    message = mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_NAV_LAND, 0, 0, 0, 0, 0, 0, 0, 0)
    raw = bytes(message.pack(signed.a.own))
    for _ in range(3):
        signed.a.send_bytes(raw)
        signed.run(0.5)
    landings = [m for m in signed.autopilot.received if m.get_type() == "COMMAND_LONG" and m.command == 21]
    assert len(landings) == 1
    assert ("COMMAND_LONG/MAV_CMD_NAV_LAND", SignatureVerdict.REPLAYED.value) in refusals(signed)


FORGED = {
    "COMMAND_LONG/MAV_CMD_COMPONENT_ARM_DISARM": mavlink.MAVLink_command_long_message(1, 1, 400, 0, *[0] * 7),
    "COMMAND_LONG/MAV_CMD_MISSION_START": mavlink.MAVLink_command_long_message(1, 1, 300, 0, *[0] * 7),
    "COMMAND_LONG/54321": mavlink.MAVLink_command_long_message(1, 1, 54321, 0, *[0] * 7),
    "COMMAND_INT/MAV_CMD_DO_REPOSITION": mavlink.MAVLink_command_int_message(1, 1, 3, 192, 0, 0, *[0] * 7),
    "SET_MODE": mavlink.MAVLink_set_mode_message(1, 1, 6),
    "PARAM_SET/FS_GCS_ENABLE": mavlink.MAVLink_param_set_message(1, 1, b"FS_GCS_ENABLE", 0.0, 9),
    "MISSION_CLEAR_ALL/MISSION": mavlink.MAVLink_mission_clear_all_message(1, 1, 0),
    "RC_CHANNELS_OVERRIDE": mavlink.MAVLink_rc_channels_override_message(1, 1, *[1500] * 18),
    "SET_GPS_GLOBAL_ORIGIN": mavlink.MAVLink_set_gps_global_origin_message(1, 1, 1, 1),
}


@pytest.mark.parametrize("what", list(FORGED))
def test_the_journal_says_what_a_forged_frame_would_have_done(signed: SignedBench, what: str) -> None:
    signed.connect()
    signed.autopilot.received.clear()
    sign_with(signed.a, KEY_B)
    signed.a.alive = False
    signed.a.send(FORGED[what])
    signed.run(0.2)
    (entry,) = signed.journal("refused")
    assert (entry["what"], entry["reason"], entry["answered"]) == (what, SignatureVerdict.BAD.value, False)
    assert entry["text"] == f"{what} of GCSA refused: {SignatureVerdict.BAD.value}"
    assert {m.get_srcSystem() for m in signed.autopilot.received} == {1}, "words for people, and nothing else"


def test_a_flood_of_forged_commands_is_an_entry_a_second_whatever_they_carry(signed: SignedBench) -> None:
    signed.connect()
    sign_with(signed.a, KEY_B)
    signed.a.alive = False
    for command in (*range(12), 1012):
        signed.run(1.0 if command == 1012 else 0.05)
        signed.a.command(command)
    signed.run(0.1)
    entries = [(entry["what"], entry.get("also")) for entry in signed.journal("refused")]
    assert entries == [("COMMAND_LONG/0", None), ("COMMAND_LONG/1012", 11)]


def test_a_replay_of_the_run_before_is_refused_after_a_restart(signed: SignedBench) -> None:
    signed.connect()
    message = mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_NAV_LAND, 0, 0, 0, 0, 0, 0, 0, 0)
    raw = bytes(message.pack(signed.a.own))
    signed.a.send_bytes(raw)
    signed.run(2.0)
    signed.mpstate.unload("handover")
    signed.module = None
    signed.a.alive = False
    assert signed.load() is not None
    seen = len(signed.autopilot.received)
    signed.run(1.0)
    signed.a.send_bytes(raw)
    signed.run(1.0)
    assert not any(m.get_type() == "COMMAND_LONG" and m.command == 21 for m in signed.autopilot.received[seen:])


def test_each_station_hears_its_own_key(signed: SignedBench, monkeypatch: pytest.MonkeyPatch) -> None:
    heard: dict[int, list[bytes]] = {251: [], 252: []}
    original = Station.step

    def step(station: Station, now: float) -> None:
        before = station._socket.recvfrom

        class Tapped:
            def __getattr__(self, name: str) -> Any:
                return getattr(socket, name)

            def recvfrom(self, size: int) -> Any:
                data, address = before(size)
                heard[station.sysid].append(data)
                return data, address

        socket = station._socket
        station._socket = Tapped()  # type: ignore[assignment]
        try:
            original(station, now)
        finally:
            station._socket = socket

    monkeypatch.setattr(Station, "step", step)
    signed.connect()
    for sysid, key in ((251, KEY_A), (252, KEY_B)):
        peer = SignedPeer(key)
        found = [frame for data in heard[sysid] for frame in FrameSplitter().feed(data)]
        assert len(found) > 20
        verdicts = {peer.check(frame, signed.clock.time(), signed.clock.now) for frame in found}
        assert verdicts == {SignatureVerdict.OK}


def test_the_link_to_the_autopilot_is_signed_once_and_ids_stay(signed: SignedBench) -> None:
    signed.configure(more='autopilot_key = "keys/autopilot.key"')
    signed.connect()
    written: list[bytes] = []
    signed.mpstate.mav_master[0].write = written.append  # type: ignore[method-assign]
    signed.a.command(mavlink.MAV_CMD_NAV_LAND)
    for _ in range(20):
        signed.clock.now += 0.05
        signed.mpstate.loop()
    frames = [frame for raw in written if (frame := parse_one(raw)) is not None]
    peer = SignedPeer(KEY_AUTOPILOT)
    assert {peer.check(frame, time.time(), signed.clock.now) for frame in frames} == {SignatureVerdict.OK}
    assert (251, 190) in {(frame.sysid, frame.compid) for frame in frames}
    assert (1, 191) in {(frame.sysid, frame.compid) for frame in frames}


class Checking:
    """The autopilot's end of a signed link: ArduPilot's rules, which pymavlink's check has too."""

    def __init__(self, bench: SignedBench) -> None:
        self._own = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self._own.signing.secret_key, self._own.signing.sign_outgoing = KEY_AUTOPILOT, True
        self._bench = bench
        self.refused = 0
        self.accepted = 0
        self.stamps: list[int] = []
        self._step = bench.autopilot.step
        bench.autopilot.step = self.step  # type: ignore[method-assign]

    def step(self, written: list[bytes], now: float) -> list[Any]:
        for raw in written:
            good = bool(raw[2] & 1) and self._own.check_signature(bytearray(raw), raw[5], raw[6])
            self.accepted += good
            self.refused += not good
            self.stamps.append(int.from_bytes(raw[-12:-6], "little"))
        return self._step(written, now)

    def beat(self) -> None:
        """A signed heartbeat of the autopilot, whose stamps follow what it heard."""
        raw = mavlink.MAVLink_heartbeat_message(2, 3, 81, 0, 3, 3).pack(self._own)
        self._bench.mpstate.deliver(stock.MAVLink(None).decode(bytearray(raw)))


@pytest.fixture
def checking(signed: SignedBench) -> Checking:
    signed.configure(more='autopilot_key = "keys/autopilot.key"')
    checking = Checking(signed)
    signed.connect()
    assert (checking.refused, checking.accepted > 10) == (0, True)
    return checking


def restarted(signed: SignedBench, *, crashed: bool = False) -> None:
    """The companion's computer starts again, and its clock has no battery: it is 1970."""
    replay = signed.module._replay
    if crashed:
        replay.close = lambda: None
    signed.mpstate.unload("handover")
    signed.clock.utc_offset_s = -signed.clock.now
    assert signed.load() is not None


@pytest.mark.parametrize("crashed", [False, True])
def test_the_autopilot_hears_us_after_a_restart_without_a_clock(
    signed: SignedBench, checking: Checking, crashed: bool
) -> None:
    """It refused every frame, the leases among them, until our clock was set."""
    restarted(signed, crashed=crashed)
    before = checking.accepted
    signed.run(2.0)
    assert (checking.refused, checking.accepted > before + 10) == (0, True)


def test_a_heartbeat_of_the_autopilot_brings_our_stamps_up_to_date_though_nothing_was_kept(
    signed: SignedBench, checking: Checking
) -> None:
    signed.mpstate.unload("handover")
    for path in signed.folder.glob("state/*.replay.json"):
        path.unlink()
    signed.clock.utc_offset_s = -signed.clock.now
    assert signed.load() is not None
    signed.run(1.0)
    assert checking.refused > 5
    checking.beat()
    signed.run(0.05)
    refused = checking.refused
    signed.run(1.0)
    assert checking.refused == refused


def test_a_forged_heartbeat_does_not_drive_our_stamps(signed: SignedBench, checking: Checking) -> None:
    forger = Checking(signed)
    forger._own.signing.secret_key, forger._own.signing.timestamp = KEY_A, 2**47
    forger.beat()
    checking.stamps.clear()
    signed.run(1.0)
    assert checking.stamps
    assert max(checking.stamps) < 2**46


def test_without_a_key_the_configuration_is_refused(signed: SignedBench) -> None:
    signed.config.write_text(signed.config.read_text().replace('key = "keys/GCSB.key"', ""))
    assert signed.load() is None
    line = signed.mpstate.console.lines[0]
    assert "[station 2] key: is missing: any program could speak as GCSB; 'handover keys make GCSB' makes one" in line


def test_a_key_that_others_can_read_is_refused(signed: SignedBench) -> None:
    key_path(signed.folder / "keys", "GCSA").chmod(0o644)
    assert signed.load() is None
    assert "GCSA.key" in signed.mpstate.console.lines[0]
    assert "0600" in signed.mpstate.console.lines[0]


@pytest.mark.parametrize("rotating", [False, True])
def test_two_stations_with_the_same_key_are_refused(signed: SignedBench, rotating: bool) -> None:
    """Who holds it could speak for both."""
    path = key_path(signed.folder / "keys", "GCSB")
    path.unlink()
    write_key(path, KEY_A)
    if rotating:
        rotate_key(path, KEY_B)
    assert signed.load() is None
    assert signed.mpstate.console.lines == [
        "handover is not loaded: GCSA and GCSB have the same key; each station needs one of its own"
    ]
    assert signed.mpstate.select_extra == {}
