# SPDX-License-Identifier: GPL-3.0-or-later

"""The socket between station and panel: who gets in, what is sent, and that no reader slows the station."""

from __future__ import annotations

import json
import os
import socket
import stat
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from gcs_module.panel import endpoint as endpoints
from gcs_module.panel.endpoint import EndpointError, connect, find, open_endpoint, running
from gcs_module.panel.orders import Order, Reply
from gcs_module.panel.publisher import EACH_S, MOST_READERS, Publisher
from gcs_module.panel.reader import Reader
from gcs_module.panel.snapshot import StationSeen
from tests.gcs.panel_states import NOW, craft, station


@pytest.fixture(autouse=True)
def place(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.delenv("HANDOVER_PANELS")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr(endpoints.tempfile, "gettempdir", lambda: str(tmp_path / "missing"))
    return tmp_path / "handover"


class Bench:
    """A station's publisher, with a clock of its own."""

    def __init__(self) -> None:
        self.now = NOW
        self.made = 0
        self.craft = 1
        self.configuration = "/etc/handover/station.toml"
        self.orders: list[Order] = []
        self.packages = {"ab": "cGFja2FnZQ=="}
        self.publisher = Publisher(open_endpoint("GCSA"), self.snapshot, lambda: self.packages, self.carry_out)

    def snapshot(self, now: float) -> StationSeen:
        self.made += 1
        return station(*[craft(sysid=number) for number in range(self.craft)], at=now, configuration=self.configuration)

    def carry_out(self, order: Order) -> Reply:
        self.orders.append(order)
        return Reply(order.number, True, "Accepted.")

    def run(self, seconds: float, *readers: Reader) -> None:
        for _ in range(round(seconds / 0.05)):
            self.now += 0.05
            self.publisher.tick(self.now)
            for reader in readers:
                reader.tick(self.now)

    def raw(self, first: bytes = b'{"token":""}\n') -> socket.socket:
        path = find("GCSA")
        assert path is not None
        opened, _token = connect(path)
        opened.send(first)
        return opened


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench()
    yield made
    made.publisher.close()


def reader() -> Reader:
    return Reader(lambda: find("GCSA"))


def test_a_reader_gets_snapshots_and_packages(bench: Bench) -> None:
    panel = reader()
    bench.run(1.0, panel)
    assert panel.seen is not None
    assert panel.seen.station == "GCSA"
    assert panel.missions == {"ab": b"package"}
    assert panel.age_s(bench.now) <= EACH_S + 0.1
    bench.packages = {"cd": "bmV3"}
    bench.run(1.0, panel)
    assert panel.missions == {"ab": b"package", "cd": b"new"}
    panel.close()


def test_without_a_reader_no_snapshot_is_made(bench: Bench) -> None:
    bench.run(5.0)
    assert bench.made == 0


def test_snapshots_are_at_most_five_a_second(bench: Bench) -> None:
    panel = reader()
    bench.run(10.0, panel)
    assert 30 <= bench.made <= 50
    panel.close()


def test_an_order_is_carried_out_and_answered(bench: Bench) -> None:
    panel = reader()
    bench.run(0.5, panel)
    assert panel.send(Order(panel.next_number(), "accept", 1, "251.252.3.7.-1"))
    bench.run(0.5, panel)
    assert bench.orders == [Order(1, "accept", 1, "251.252.3.7.-1")]
    assert list(panel.replies) == [(1, True, "Accepted.")]
    panel.close()


@pytest.mark.parametrize(
    ("line", "says"),
    [
        (b"{}", "'number' and 'vehicle'"),
        (b'{"number":true,"vehicle":1,"do":"accept"}', "'number' and 'vehicle'"),
        (b'{"number":1,"vehicle":1,"do":"explode"}', "no order 'explode'"),
        (b'{"number":1,"vehicle":1,"do":["accept"]}', "no order"),
        (b'{"number":1,"vehicle":1,"do":"accept"}', "accept: needs a question"),
        (b'{"number":1,"vehicle":1,"do":"stop","argument":"now"}', "stop: takes no argument"),
        (b'{"number":1,"vehicle":1,"do":"give","argument":"a\\nb"}', "'argument' must be a text"),
        (b'{"number":1,"vehicle":1,"do":"override","argument":"all"}', "no limit 'all'; there are energy"),
        (b"[]", "'number' and 'vehicle'"),
        (b"\xff\xfe", "'number' and 'vehicle'"),
        (b"[" * 1500, "'number' and 'vehicle'"),
    ],
)
def test_an_order_that_cannot_be_read_is_answered_in_one_line(bench: Bench, line: bytes, says: str) -> None:
    opened = bench.raw()
    bench.run(0.2)
    opened.send(line + b"\n")
    bench.run(0.5)
    replies = [each for each in lines(opened) if each["kind"] == "reply"]
    assert len(replies) == 1
    assert replies[0]["used"] is False
    assert says in replies[0]["text"]
    assert bench.orders == []
    opened.close()


def lines(opened: socket.socket) -> list[dict[str, Any]]:
    data = b""
    try:
        while part := opened.recv(1 << 16):
            data += part
    except BlockingIOError:
        pass
    return [json.loads(line) for line in data.split(b"\n")[:-1]]


def ended(opened: socket.socket) -> bool:
    """Whether the other end has closed it."""
    with opened:
        try:
            while opened.recv(1 << 16):
                pass
        except BlockingIOError:
            return False
        except OSError:
            return True
        return True


def test_a_reader_that_reads_nothing_is_dropped_and_costs_nothing(bench: Bench) -> None:
    bench.craft = 200
    slow, panel = bench.raw(), reader()
    began = time.process_time()
    bench.run(20.0, panel)
    assert time.process_time() - began < 10.0
    assert bench.publisher.dropped["slow"] == 1
    assert panel.age_s(bench.now) < 1.0, "the others go on"
    slow.close()
    panel.close()


def test_a_reader_that_floods_is_dropped(bench: Bench) -> None:
    opened = bench.raw()
    bench.run(0.2)
    opened.send(b'{"number":1,"vehicle":1,"do":"acknowledge"}\n' * 30)
    bench.run(0.5)
    assert len(bench.orders) == 10
    assert bench.publisher.dropped["too many orders"] == 1
    assert ended(opened)


def test_a_line_without_end_is_dropped(bench: Bench) -> None:
    opened = bench.raw()
    bench.run(0.2)
    opened.send(b"x" * 4000)
    bench.run(0.2)
    assert bench.publisher.dropped["line too long"] == 1
    assert ended(opened)


@pytest.mark.parametrize("first", [b"\n", b'{"token":"x"}\n', b'{"token":3}\n', b"nonsense\n"])
def test_without_the_token_nothing_is_sent(bench: Bench, first: bytes) -> None:
    opened = bench.raw(first)
    bench.run(0.5)
    assert ended(opened)
    assert bench.made == 0


def test_a_reader_that_says_nothing_is_dropped(bench: Bench) -> None:
    opened = bench.raw(b"")
    bench.run(3.0)
    assert bench.publisher.dropped["silent"] == 1
    assert ended(opened)


def test_readers_are_bounded(bench: Bench) -> None:
    opened = [bench.raw() for _ in range(MOST_READERS)]
    bench.run(0.5)
    more = bench.raw()
    bench.run(0.5)
    assert bench.publisher.readers == MOST_READERS
    assert ended(more)
    for each in opened:
        each.close()
    bench.run(0.5)
    assert bench.publisher.readers == 0


def test_a_station_that_ends_is_noticed_and_a_new_one_is_found(bench: Bench) -> None:
    panel = reader()
    bench.run(0.5, panel)
    bench.publisher.close()
    for _ in range(40):
        bench.now += 0.1
        panel.tick(bench.now)
    assert not panel.connected
    assert panel.fault == "it does not run here"
    assert panel.age_s(bench.now) > 3.0
    assert not panel.send(Order(1, "stop", 1))
    again = Bench()
    again.now = bench.now
    again.run(1.5, panel)
    assert panel.connected
    assert panel.age_s(again.now) < 1.0
    again.publisher.close()
    panel.close()


def test_another_station_of_the_same_name_does_not_take_the_place_of_one_that_ended(bench: Bench) -> None:
    panel = reader()
    bench.run(0.5, panel)
    bench.publisher.close()
    other = Bench()
    other.now, other.configuration = bench.now, "/elsewhere/station.toml"
    other.run(3.0, panel)
    assert panel.seen is not None
    assert panel.seen.configuration == "/etc/handover/station.toml"
    assert panel.age_s(other.now) > 2.0
    assert panel.fault == "another station of this name runs, with /elsewhere/station.toml"
    other.publisher.close()
    panel.close()


def test_a_line_that_was_delayed_is_old(bench: Bench) -> None:
    panel = reader()
    bench.run(1.0, panel)
    before = bench.made
    bench.run(0.3)
    assert bench.made > before
    bench.now += 7.0
    panel.tick(bench.now)
    assert panel.age_s(bench.now) >= 7.0
    panel.close()


@pytest.mark.skipif(not hasattr(socket, "AF_UNIX"), reason="no Unix sockets here")
def test_only_this_user_reaches_the_socket(bench: Bench, place: Path) -> None:
    assert stat.S_IMODE(place.stat().st_mode) == 0o700
    assert find("GCSA") == place / "GCSA.socket"
    assert running() == ["GCSA"]


def test_two_stations_with_a_name_both_have_a_socket(bench: Bench) -> None:
    other = open_endpoint("GCSA")
    assert other.name == f"GCSA-{os.getpid()}"
    assert running() == ["GCSA", other.name]
    other.close()
    assert running() == ["GCSA"]


def test_a_folder_can_be_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("HANDOVER_PANELS", str(tmp_path / "named"))
    opened = open_endpoint("GCSA")
    assert opened.path == tmp_path / "named" / "GCSA.socket"
    assert running() == ["GCSA"]
    opened.listener.close()
    assert running() == [], "one that was killed does not run"
    opened.close()


def test_what_a_killed_station_left_is_removed(place: Path) -> None:
    left = open_endpoint("GCS A/1")
    left.listener.close()
    assert left.path.exists()
    again = open_endpoint("GCS A/1")
    assert again.name == "GCS A/1"
    again.close()
    assert list(place.iterdir()) == []


def test_without_unix_sockets_a_port_and_a_token_do(monkeypatch: pytest.MonkeyPatch, place: Path) -> None:
    monkeypatch.setattr(endpoints, "_unix", lambda: False)
    made = Bench()
    panel = reader()
    made.run(0.3, panel)
    time.sleep(0.05)
    made.run(0.5, panel)
    assert panel.seen is not None
    path = find("GCSA")
    assert path == place / "GCSA.tcp"
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    stranger, _token = connect(path)
    stranger.send(b'{"token":"guessed"}\n')
    time.sleep(0.05)
    made.run(0.3)
    assert made.publisher.dropped["wrong token"] == 1
    stranger.close()
    panel.close()
    made.publisher.close()


def test_a_folder_that_others_can_enter_is_refused(place: Path) -> None:
    place.mkdir()
    place.chmod(0o777)
    with pytest.raises(EndpointError, match="other users can enter it"):
        open_endpoint("GCSA")


@pytest.mark.parametrize("mode", [0o755, 0o711, 0o770])
def test_a_station_in_a_folder_that_others_can_enter_is_not_looked_at(bench: Bench, place: Path, mode: int) -> None:
    """Another user may have made that folder: a program of theirs could show this panel any aircraft."""
    assert running() == ["GCSA"]
    place.chmod(mode)
    assert running() == []
    assert find("GCSA") is None
    assert endpoints.foreign() == [f"{place}: other users can enter it. Remove it, or make it yours: chmod 700 {place}"]
    panel = reader()
    panel.tick(NOW)
    assert not panel.connected
    place.chmod(0o700)
    assert endpoints.foreign() == []


def test_a_link_to_a_folder_is_not_looked_at(bench: Bench, place: Path) -> None:
    place.rename(place.with_name("elsewhere"))
    place.symlink_to(place.with_name("elsewhere"))
    assert running() == []
    place.unlink()
    place.with_name("elsewhere").rename(place)


def test_a_file_in_place_of_a_socket_is_one_line(place: Path) -> None:
    place.mkdir(mode=0o700)
    (place / "GCSA.tcp").write_text("{}")
    panel = reader()
    panel.tick(NOW)
    assert panel.fault == f"{place / 'GCSA.tcp'}: holds no port and token"


def test_a_token_that_has_no_bytes_is_wrong_and_stops_no_other_reader(bench: Bench) -> None:
    good = reader()
    bench.run(0.5, good)
    with bench.raw(b'{"token":"\\ud800"}\n'):
        bench.run(3.0, good)
    assert good.age_s(bench.now) < 0.5
    assert bench.publisher.dropped["wrong token"] == 1
    good.close()
