# SPDX-License-Identifier: GPL-3.0-or-later

"""Each rule at the head of `gcs_module/signing.py`, and the module with a key and without.

What goes out is checked by pymavlink, as the ground station program at the other end would do it.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as stock
from pymavlink.dialects.v20 import handover as mavlink

from gcs_module import aircraft as station_aircraft
from gcs_module import commands as station_commands
from gcs_module import module as station_module
from gcs_module import signing as station_signing
from gcs_module.signing import LinkSigning
from mavproxy_handover.store.keys import key_of, write_key
from mavproxy_handover.tools.clocks import Clocks
from mavproxy_handover.wire.signing import SignatureVerdict, sign, timestamp_of
from tests.module.conftest import Clock
from tests.module.proxy import Master
from tests.module.test_station_module import StationBench, connect_message

KEY, OTHER_KEY = key_of("the-passphrase-of-GCSA"), key_of("the-passphrase-of-GCSB")
UTC_S = 1_790_000_000.0
STAMP = 36_992_960_000_000  # 100 000 * (UTC_S - 2015-01-01)
SECOND = 100_000


class BothClocks(Clock):
    """Monotonic and wall clock; the wall clock can be set."""

    def __init__(self) -> None:
        super().__init__()
        self.ahead_s = UTC_S - self.now

    def time(self) -> float:
        return self.now + self.ahead_s


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> BothClocks:
    monkeypatch.setattr(station_signing, "_stamps_by_key", {})
    return BothClocks()


@pytest.fixture
def signing(clock: BothClocks) -> LinkSigning:
    return LinkSigning(KEY, Clocks(clock.time, clock.monotonic))


def unheard(_master: Any) -> None:
    """What is proven of a link matters to no test here."""


def heartbeat() -> Any:
    return stock.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)


def sent_by(master: Master, number: int = 1) -> list[bytes]:
    """What MAVProxy writes on a link for so many messages."""
    master.written.clear()
    for _ in range(number):
        master.mav.send(heartbeat())
    return list(master.written)


def link_id(raw: bytes) -> int:
    return raw[-13]


def stamp(raw: bytes) -> int:
    return int.from_bytes(raw[-12:-6], "little")


def holds(raw: bytes, key: bytes) -> bool:
    """Whether pymavlink takes the signature for one made with `key`."""
    reader = stock.MAVLink(None)
    reader.signing.secret_key = key
    try:
        reader.decode(bytearray(raw))
    except stock.MAVError:
        return False
    return bool(raw[2] & 1)


def of_vehicle(
    key: bytes | None, at: int, message: Any = None, *, link: int = 0, compid: int = 191, seq: int = 0
) -> bytes:
    """A frame of the vehicle, signed with `key` at stamp `at`."""
    source = mavlink.MAVLink(None, srcSystem=1, srcComponent=compid)
    source.seq = seq
    raw = bytes((message or mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3)).pack(source))
    if key is None:
        return raw
    signed = sign(raw, key, link, at)
    assert signed is not None
    return signed


def taken(master: Master, raw: bytes) -> bool:
    """Whether MAVProxy takes a frame in."""
    try:
        master.mav.decode(bytearray(raw))
    except stock.MAVError:
        return False
    return True


class TestOut:
    def test_the_stamp_of_this_file_is_the_time_of_this_file(self) -> None:
        assert timestamp_of(UTC_S) == STAMP

    def test_what_goes_out_is_signed_with_the_key(self, signing: LinkSigning) -> None:
        master = Master()
        signing.sign([master], unheard)
        for raw in sent_by(master, 3):
            assert holds(raw, KEY)
            assert not holds(raw, OTHER_KEY)

    def test_each_link_has_an_id_of_its_own_from_1_up(self, signing: LinkSigning) -> None:
        masters = [Master(), Master(), Master()]
        signing.sign(masters, unheard)
        assert [link_id(sent_by(master)[0]) for master in masters] == [1, 2, 3]

    def test_a_link_that_goes_leaves_its_id_and_its_stamps_to_the_next(
        self, signing: LinkSigning, clock: BothClocks
    ) -> None:
        first, second, third = Master(), Master(), Master()
        signing.sign([first, second], unheard)
        before = sent_by(first, 500)
        clock.ahead_s -= 3600
        signing.sign([second], unheard)
        signing.sign([second, third], unheard)
        after = sent_by(third)[0]
        assert (link_id(before[-1]), link_id(sent_by(second)[0]), link_id(after)) == (1, 2, 1)
        assert stamp(after) > stamp(before[-1])

    def test_stamps_rise_with_every_frame_and_begin_at_the_time(self, signing: LinkSigning) -> None:
        master = Master()
        signing.sign([master], unheard)
        assert [stamp(raw) for raw in sent_by(master, 3)] == [STAMP, STAMP + 1, STAMP + 2]

    def test_stamps_rise_over_every_look_at_the_links(self, signing: LinkSigning, clock: BothClocks) -> None:
        """More frames than 10 us have passed, and links are looked at in between."""
        master = Master()
        stamps = []
        for _ in range(3):
            signing.sign([master], unheard)
            stamps += [stamp(raw) for raw in sent_by(master, 3)]
        assert stamps == sorted(set(stamps))

    def test_an_idle_link_keeps_pace_with_time(self, signing: LinkSigning, clock: BothClocks) -> None:
        """The vehicle takes a frame that is 30 s behind for one that was held back."""
        master = Master()
        signing.sign([master], unheard)
        sent_by(master)
        clock.now += 40.0
        signing.sign([master], unheard)
        assert stamp(sent_by(master)[0]) == STAMP + 40 * SECOND

    @pytest.mark.parametrize("step_s", [-7200.0, 7200.0])
    def test_stamps_rise_when_the_clock_is_set(self, signing: LinkSigning, clock: BothClocks, step_s: float) -> None:
        master = Master()
        signing.sign([master], unheard)
        before = stamp(sent_by(master, 10)[-1])
        clock.ahead_s += step_s
        for _ in range(3):
            clock.now += 1.0
            signing.sign([master], unheard)
        after = stamp(sent_by(master)[0])
        assert after >= before + 3 * SECOND - 10

    def test_stamps_follow_the_vehicles(self, signing: LinkSigning) -> None:
        """The station's clock is an hour behind: the vehicle would refuse every frame of it as too old."""
        master = Master()
        signing.sign([master], unheard)
        ahead = STAMP + 3600 * SECOND
        assert taken(master, of_vehicle(KEY, ahead))
        assert stamp(sent_by(master)[0]) >= ahead
        signing.sign([master], unheard)
        assert stamp(sent_by(master)[0]) > ahead

    def test_signing_switched_off_by_hand_is_on_again_at_the_next_look(self, signing: LinkSigning) -> None:
        master = Master()
        signing.sign([master], unheard)
        before = stamp(sent_by(master)[0])
        state = master.mav.signing  # MAVProxy's `signing disable`
        state.secret_key, state.sign_outgoing, state.link_id, state.timestamp = None, False, 0, 0
        signing.sign([master], unheard)
        (raw,) = sent_by(master)
        assert holds(raw, KEY)
        assert (link_id(raw), stamp(raw) > before) == (1, True)

    def test_a_link_that_has_switched_to_mavlink_2_is_signed_at_the_next_look(self, signing: LinkSigning) -> None:
        master = Master()
        signing.sign([master], unheard)
        master.mav = stock.MAVLink(master, srcSystem=251, srcComponent=230)  # pymavlink makes another one
        assert not holds(sent_by(master)[0], KEY)
        signing.sign([master], unheard)
        assert holds(sent_by(master)[0], KEY)
        assert not taken(master, of_vehicle(None, STAMP))


class TestIn:
    @pytest.fixture
    def master(self, signing: LinkSigning) -> Master:
        master = Master()
        signing.sign([master], unheard)
        return master

    def test_the_vehicles_frames_are_taken(self, master: Master) -> None:
        assert taken(master, of_vehicle(KEY, STAMP))
        assert taken(master, of_vehicle(KEY, STAMP + 1))

    def test_unsigned_ones_are_refused(self, master: Master) -> None:
        assert not taken(master, of_vehicle(None, STAMP))

    def test_those_of_another_key_are_refused(self, master: Master) -> None:
        assert not taken(master, of_vehicle(OTHER_KEY, STAMP))

    @pytest.mark.parametrize("at", [-1, -7, -13])
    def test_those_with_one_bit_of_the_signature_changed_are_refused(self, master: Master, at: int) -> None:
        raw = bytearray(of_vehicle(KEY, STAMP))
        raw[at] ^= 1
        assert not taken(master, bytes(raw))

    def test_replayed_ones_are_refused(self, master: Master) -> None:
        raw = of_vehicle(KEY, STAMP)
        assert taken(master, raw)
        assert not taken(master, raw)
        assert not taken(master, of_vehicle(KEY, STAMP - 3 * SECOND))

    def test_a_forged_frame_from_the_future_does_not_silence_the_vehicle(self, master: Master) -> None:
        """pymavlink's own check notes the stamp before the hash."""
        for link in (0, 1):
            assert not taken(master, of_vehicle(OTHER_KEY, STAMP + 10**9, link=link))
        assert taken(master, of_vehicle(KEY, STAMP))
        assert not taken(master, of_vehicle(OTHER_KEY, STAMP + 10**9))
        assert taken(master, of_vehicle(KEY, STAMP + 1))
        assert stamp(sent_by(master)[0]) < STAMP + 10**8, "nor does it drive our own stamps"

    def test_a_radio_may_speak_unsigned(self, master: Master) -> None:
        for message in (
            mavlink.MAVLink_radio_status_message(0, 0, 0, 0, 0, 0, 0),
            mavlink.MAVLink_radio_message(0, 0, 0, 0, 0, 0, 0),
        ):
            assert taken(master, of_vehicle(None, 0, message, compid=68))
        assert not taken(master, of_vehicle(None, 0, mavlink.MAVLink_statustext_message(1, b"x"), compid=68))

    def test_the_same_frame_by_two_links_is_taken_on_both(self, signing: LinkSigning) -> None:
        masters = [Master(), Master()]
        signing.sign(masters, unheard)
        raw = of_vehicle(KEY, STAMP)
        assert [taken(master, raw) for master in masters] == [True, True]
        assert [taken(master, raw) for master in masters] == [False, False]

    def test_what_one_link_carried_cannot_be_played_again_on_another(
        self, signing: LinkSigning, clock: BothClocks
    ) -> None:
        """Each link had a memory of its own: what was heard by Wi-Fi up to a minute ago was news on a silent LTE."""
        wifi, lte = Master(), Master()
        signing.sign([wifi, lte], unheard)
        raw = of_vehicle(KEY, STAMP)
        assert taken(wifi, raw)
        clock.now += 2.1
        assert not taken(lte, raw)

    def test_the_copies_of_a_slower_link_are_taken_and_what_the_faster_one_lost_too(
        self, signing: LinkSigning, clock: BothClocks
    ) -> None:
        wifi, lte = Master(), Master()
        signing.sign([wifi, lte], unheard)
        frames = [of_vehicle(KEY, STAMP + number * SECOND // 10) for number in range(40)]
        for number in range(48):
            clock.now += 0.1
            if number < 40 and number % 3:
                assert taken(wifi, frames[number]), number
            if number >= 8:
                assert taken(lte, frames[number - 8]), number

    def test_copies_that_are_numbered_for_each_link_are_copies_all_the_same(self, signing: LinkSigning) -> None:
        """The vehicle numbers what it sends for each link apart; the stamp is the frame's own."""
        masters = [Master(), Master()]
        signing.sign(masters, unheard)
        first, second = of_vehicle(KEY, STAMP, seq=7), of_vehicle(KEY, STAMP, seq=200)
        assert first != second
        assert [taken(masters[0], first), taken(masters[1], second)] == [True, True]
        assert not any(taken(master, raw) for master in masters for raw in (first, second))
        ours = [station_signing.parse_one(of_vehicle(KEY, STAMP, connect_message(), seq=n)) for n in (5, 90)]
        assert [signing.check(frame) for frame in ours if frame is not None] == [SignatureVerdict.OK, None]

    def test_our_own_messages_come_by_two_links_in_any_order(self, signing: LinkSigning) -> None:
        frames = [station_signing.parse_one(of_vehicle(KEY, STAMP + n, connect_message(n))) for n in range(4)]
        verdicts = [signing.check(frame) for frame in (frames[n] for n in (0, 2, 1, 3, 1)) if frame is not None]
        assert verdicts == [SignatureVerdict.OK] * 4 + [None]


class TestReload:
    def test_ids_stay_and_stamps_go_on(self, clock: BothClocks) -> None:
        master = Master()
        stamps, ids = [], set()
        for _ in range(4):
            signing = LinkSigning(KEY, Clocks(clock.time, clock.monotonic))
            signing.sign([master], unheard)
            for raw in sent_by(master, 300):
                stamps.append(stamp(raw))
                ids.add(link_id(raw))
            signing.release()
            clock.ahead_s -= 600.0  # the clock is set back while the module is not loaded
        assert stamps == sorted(set(stamps))
        assert ids == {1}

    def test_what_was_heard_before_is_refused_after(self, clock: BothClocks) -> None:
        master = Master()
        old, new = of_vehicle(KEY, STAMP), of_vehicle(KEY, STAMP + 1)
        ours = of_vehicle(KEY, STAMP, connect_message())
        before = LinkSigning(KEY, Clocks(clock.time, clock.monotonic))
        before.sign([master], unheard)
        assert taken(master, old)
        before.release()
        after = LinkSigning(KEY, Clocks(clock.time, clock.monotonic))
        after.sign([master], unheard)
        frame = station_signing.parse_one(ours)
        assert frame is not None
        assert after.check(frame) is SignatureVerdict.TOO_OLD
        assert not taken(master, old)
        assert taken(master, new)

    def test_a_new_key_starts_afresh(self, clock: BothClocks) -> None:
        master = Master()
        before = LinkSigning(KEY, Clocks(clock.time, clock.monotonic))
        before.sign([master], unheard)
        assert taken(master, of_vehicle(KEY, STAMP + 50 * SECOND))
        before.release()
        after = LinkSigning(OTHER_KEY, Clocks(clock.time, clock.monotonic))
        after.sign([master], unheard)
        assert taken(master, of_vehicle(OTHER_KEY, STAMP))

    def test_nothing_is_left_behind(self, signing: LinkSigning) -> None:
        master = Master()
        signing.sign([master], unheard)
        signing.release()
        assert sent_by(master)[0][2] & 1 == 0
        assert taken(master, of_vehicle(None, STAMP))
        assert taken(master, of_vehicle(OTHER_KEY, STAMP + 1)), "who has no key checks none"

    def test_a_key_typed_into_mavproxy_before_is_there_again(self, signing: LinkSigning) -> None:
        master = Master()
        state = master.mav.signing
        state.secret_key, state.sign_outgoing, state.link_id, state.timestamp = OTHER_KEY, True, 7, STAMP - 5
        signing.sign([master], unheard)
        newest = stamp(sent_by(master, 10)[-1])
        signing.release()
        (raw,) = sent_by(master)
        assert holds(raw, OTHER_KEY)
        assert link_id(raw) == 7
        assert stamp(raw) > newest


# ---- the module ---------------------------------------------------------------------------------------------------


@pytest.fixture
def station(monkeypatch: pytest.MonkeyPatch, clock: BothClocks, tmp_path: Path) -> Iterator[StationBench]:
    """GCSA, with a key. It is not loaded yet."""
    monkeypatch.setattr(station_module, "time", clock)
    monkeypatch.setattr(station_commands, "time", clock)
    monkeypatch.setattr(station_module, "_last", {})
    bench = StationBench(tmp_path, clock)
    write_key(tmp_path / "GCSA.key", KEY)
    bench.config.write_text(bench.config.read_text().replace("sysid = 251", 'sysid = 251\nkey = "GCSA.key"'))
    yield bench
    bench.close()
    assert bench.mpstate.escaped == []


def hear(station: StationBench, raw: bytes) -> None:
    """A frame that MAVProxy takes for an unknown message, whose signature it therefore does not check."""
    message = station.mpstate.mav_master[0].mav.decode(bytearray(raw))
    assert message.get_type().startswith("UNKNOWN")
    station.mpstate.deliver(message)


def connect(key: bytes | None, at: int = STAMP, nonce: int = 7) -> bytes:
    return of_vehicle(key, at, connect_message(nonce))


def answers(station: StationBench) -> list[int]:
    return [m.nonce for m in station.sent() if m.get_type() == "CONNECT_ACK"]


def test_a_signed_vehicle_is_answered_signed(station: StationBench) -> None:
    station.load()
    hear(station, connect(KEY))
    written = station.mpstate.mav_master[0].written
    assert all(raw[2] & 1 and link_id(raw) == 1 for raw in written)
    assert answers(station) == [7]


@pytest.mark.parametrize(("key", "verdict"), [(None, "unsigned"), (OTHER_KEY, "bad signature")])
def test_a_vehicle_that_cannot_prove_itself_is_not_answered(
    station: StationBench, key: bytes | None, verdict: str
) -> None:
    station.load()
    hear(station, connect(key))
    assert answers(station) == []
    ((fault, count),) = station.module.faults.items()
    assert fault.startswith("message of the vehicle: signature ")
    assert count == 1
    assert station.module.aircraft[0].core.commander is None


def test_a_forged_question_does_not_silence_the_vehicle(station: StationBench) -> None:
    station.load()
    hear(station, connect(OTHER_KEY, STAMP + 10**9))
    hear(station, connect(KEY, STAMP, nonce=8))
    assert answers(station) == [8]


def test_a_replayed_question_is_not_answered_again_and_counted(station: StationBench) -> None:
    station.load()
    for number in range(80):
        hear(station, connect(KEY, STAMP + number, nonce=number + 1))
    answers(station)
    hear(station, connect(KEY, STAMP, nonce=1))
    assert answers(station) == []
    assert station.module.faults == {"message of the vehicle: signature replayed": 1}


def test_a_question_of_before_a_reload_is_not_answered_after_it(station: StationBench) -> None:
    station.load()
    hear(station, connect(KEY, STAMP, nonce=1))
    station.mpstate.unload("handover_gcs")
    station.load()
    answers(station)
    hear(station, connect(KEY, STAMP, nonce=1))
    assert answers(station) == []
    hear(station, connect(KEY, STAMP + 1, nonce=2))
    assert answers(station) == [2]


def test_a_copy_by_another_link_is_no_fault(station: StationBench) -> None:
    station.load()
    for _ in range(2):
        hear(station, connect(KEY))
    assert answers(station) == [7]
    assert station.module.faults == {}


def test_a_link_that_is_added_later_is_signed_within_a_second(station: StationBench) -> None:
    station.load()
    later = Master()
    station.mpstate.mav_master.append(later)
    station.run(1.1)
    assert holds(sent_by(later)[0], KEY)
    assert link_id(sent_by(later)[0]) == 2


def test_a_reload_keeps_the_link_id_and_the_stamps_rising(station: StationBench) -> None:
    station.load()
    master = station.mpstate.mav_master[0]
    before = sent_by(master, 50)[-1]
    assert station.mpstate.unload("handover_gcs")
    assert not sent_by(master)[0][2] & 1
    station.clock.ahead_s -= 3600.0  # type: ignore[attr-defined]
    station.load()
    after = sent_by(master)[0]
    assert holds(after, KEY)
    assert (link_id(before), link_id(after)) == (1, 1)
    assert stamp(after) > stamp(before)


@pytest.mark.parametrize("mode", [0o644, 0o640, 0o660, 0o604])
def test_a_key_file_that_others_may_read_is_refused_with_one_line(station: StationBench, mode: int) -> None:
    path = station.folder / "GCSA.key"
    path.chmod(mode)
    assert station.load() is None
    assert station.mpstate.console.lines == [
        f"handover_gcs is not loaded: {path}: mode {mode:04o} must be 0600, because only its owner may read a key: "
        f"chmod 600 {path}"
    ]
    assert not sent_by(station.mpstate.mav_master[0])[0][2] & 1
    assert (station.mpstate.command_map, station.mpstate.select_extra) == ({}, {})
    assert not (station.folder / "GCSA.jsonl").exists(), "nothing is left open"
    path.chmod(0o600)
    assert station.load() is not None, "the port of the ground link was given back"


def test_a_key_file_that_is_not_there_is_one_line(station: StationBench) -> None:
    (station.folder / "GCSA.key").unlink()
    assert station.load() is None
    assert station.mpstate.console.lines == [
        f"handover_gcs is not loaded: {station.folder / 'GCSA.key'}: no such key file; 'handover keys make' writes one"
    ]


def test_no_key_is_shown_anywhere(station: StationBench) -> None:
    station.load()
    hear(station, connect(OTHER_KEY))
    station.mpstate.type("handover status")
    station.run(2.0)
    shown = "\n".join(station.mpstate.console.lines) + (station.folder / "GCSA.jsonl").read_text()
    assert KEY.hex() not in shown
    assert repr(KEY) not in shown


def test_without_a_key_nothing_is_signed_and_nothing_asked_for(station: StationBench) -> None:
    station.configure()
    station.load()
    hear(station, connect(None))
    station.run(1.1)
    written = station.mpstate.mav_master[0].written
    assert written
    assert all(raw[2] & 1 == 0 for raw in written)
    assert answers(station) == [7]
    assert taken(station.mpstate.mav_master[0], of_vehicle(None, STAMP))


def test_a_fault_while_loading_leaves_the_links_unsigned(
    station: StationBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_arguments: Any) -> None:
        raise RuntimeError("a bug")

    with monkeypatch.context() as patch:
        patch.setattr(station_aircraft.Aircraft, "handle", broken)
        assert station.load() is None
    assert station.mpstate.console.lines[-1] == "handover_gcs is not loaded: internal fault: RuntimeError: a bug"
    assert not sent_by(station.mpstate.mav_master[0])[0][2] & 1
    assert station.load() is not None
