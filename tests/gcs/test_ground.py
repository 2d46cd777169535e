# SPDX-License-Identifier: GPL-3.0-or-later

"""The ground link is signed: what a stranger sends there, old or new, is nothing; the stations' key is one for all."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from gcs_module.ground import GroundLink
from mavproxy_handover.config.files import load_station
from mavproxy_handover.link.devices import open_device
from mavproxy_handover.store.keys import key_of, key_path, write_key
from mavproxy_handover.tools.clocks import Clocks
from mavproxy_handover.wire.signing import SignedPeer
from tests.link.frames import free_udp_port

KEY, OTHER = key_of("the-key-of-the-ground-link"), key_of("another-key-altogether")


class Pair:
    """Two stations' ends; `at` is the time by both clocks."""

    def __init__(self, folder: Path, key: bytes | None) -> None:
        self.at = 1000.0
        self.ports = {"GCSA": free_udp_port(), "GCSB": free_udp_port()}
        self.folder = folder
        if key is not None:
            (folder / "keys").mkdir(exist_ok=True)
            write_key(key_path(folder / "keys", "ground"), key)
        self.signs = 'key = "keys/ground.key"' if key is not None else "allow_unsigned = true"
        self.a, self.b = self.open("GCSA", 251, "GCSB", 252), self.open("GCSB", 252, "GCSA", 251)

    def open(self, name: str, sysid: int, other: str, other_sysid: int) -> GroundLink:
        config = self.folder / f"{name}.toml"
        config.write_text(
            f"""
            [station]
            name = "{name}"
            sysid = {sysid}
            [ground]
            listen = "udpin:127.0.0.1:{self.ports[name]}"
            {self.signs}
            [[peer]]
            name = "{other}"
            sysid = {other_sysid}
            link = "udpout:127.0.0.1:{self.ports[other]}"
            """
        )
        started = time.time() - self.at
        return GroundLink(load_station(config), Clocks(lambda: started + self.at, lambda: self.at))

    def close(self) -> None:
        self.a.close()
        self.b.close()


@pytest.fixture
def pair(tmp_path: Path) -> Iterator[Pair]:
    pair = Pair(tmp_path, KEY)
    yield pair
    pair.close()


def beat(sysid: int = 251) -> bytes:
    return bytes(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(mavlink.MAVLink(None, sysid, 190)))


def arrived(link: GroundLink) -> list[int]:
    """Senders of what came in; loopback needs a moment."""
    for _ in range(50):
        found = [frame.sysid for frame in link.read()]
        if found or link.refused:
            return found
        time.sleep(0.002)
    return []


def stranger(pair: Pair, data: bytes) -> None:
    device = open_device(f"udpout:127.0.0.1:{pair.ports['GCSB']}")
    device.write(data)
    device.close()


def test_stations_with_the_same_key_hear_each_other(pair: Pair) -> None:
    for _ in range(3):
        pair.at += 0.1
        pair.a.write(252, beat())
        assert arrived(pair.b) == [251]
        pair.b.write(251, beat(252))
        assert arrived(pair.a) == [252]
    assert not pair.a.refused
    assert not pair.b.refused


def test_what_is_not_signed_is_nobodys(pair: Pair) -> None:
    stranger(pair, beat())
    assert arrived(pair.b) == []
    assert pair.b.refused == {"unsigned": 1}


def test_what_is_signed_with_another_key_is_nobodys(pair: Pair) -> None:
    forged = SignedPeer(OTHER).sign(beat(), 0, time.time(), pair.at)
    assert forged is not None
    stranger(pair, forged)
    assert arrived(pair.b) == []
    assert pair.b.refused == {"bad signature": 1}


def test_what_was_heard_before_is_old_also_after_a_restart_of_the_station(pair: Pair) -> None:
    recorded = open_device(f"udpin:127.0.0.1:{free_udp_port()}")
    signed = SignedPeer(KEY).sign(beat(), 0, time.time(), pair.at)
    recorded.close()
    assert signed is not None
    stranger(pair, signed)
    assert arrived(pair.b) == [251]
    stranger(pair, signed)
    assert arrived(pair.b) == []
    assert pair.b.refused == {"replayed": 1}
    pair.b.close()
    pair.b = pair.open("GCSB", 252, "GCSA", 251)
    stranger(pair, signed)
    assert arrived(pair.b) == []
    assert pair.b.refused == {"too old": 1}


def test_a_state_that_is_lost_refuses_what_was_signed_before_now(pair: Pair) -> None:
    signed = SignedPeer(KEY).sign(beat(), 0, time.time() - 2.0, pair.at)
    assert signed is not None
    pair.b.close()
    (path,) = pair.folder.glob("GCSB.ground-replay.json")
    path.write_text("{}")
    pair.b = pair.open("GCSB", 252, "GCSA", 251)
    assert "replay state cannot be read" in pair.b.note
    stranger(pair, signed)
    assert arrived(pair.b) == []


def test_without_a_key_it_is_as_open_as_the_configuration_says(tmp_path: Path) -> None:
    pair = Pair(tmp_path, None)
    pair.a.write(252, beat())
    assert arrived(pair.b) == [251]
    assert (pair.b.signed, pair.b.note) == (False, "")
    pair.close()
