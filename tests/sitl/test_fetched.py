# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover sim --fetch-arducopter`: the published program comes whole and as it was published, or not at all."""

from __future__ import annotations

import hashlib
import os
import socket
import threading
import time
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, ClassVar

import pytest

from sitl import main as command
from sitl.vehicles import fetched, find_arducopter
from sitl.vehicles.fetched import PUBLISHED, Published, cached, fetch, here
from sitl.vehicles.spec import LaunchError

#: more than one chunk, and it can be run
PROGRAM = b"#!/bin/sh\nexit 0\n" + b"# as large as a program\n" * 6000


class Handler(BaseHTTPRequestHandler):
    """Serves by path."""

    answers: ClassVar[dict[str, Callable[[Any], None]]] = {}

    def do_GET(self) -> None:
        self.answers[self.path](self)

    def log_message(self, *_arguments: Any) -> None:
        """Nobody wants to know."""

    def give(self, body: bytes, promised: int | None = None, code: int = 200, **headers: str) -> None:
        self.send_response(code)
        self.send_header("Content-Length", str(len(body) if promised is None else promised))
        for name, value in headers.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)


def _slow(handler: Handler) -> None:
    handler.give(PROGRAM[:1000], len(PROGRAM))
    time.sleep(2.0)


Handler.answers = {
    "/good": lambda handler: handler.give(PROGRAM),
    "/missing": lambda handler: handler.give(b"no such thing", code=404),
    "/cut": lambda handler: handler.give(PROGRAM[:-7], len(PROGRAM)),
    "/short": lambda handler: handler.give(PROGRAM[:-7]),
    "/other": lambda handler: handler.give(PROGRAM[:-1] + b"!"),
    "/long": lambda handler: handler.give(PROGRAM + b"more"),
    "/moved": lambda handler: handler.give(b"", code=302, Location="/good"),
    "/slow": _slow,
}


@pytest.fixture(scope="module")
def server() -> Iterator[str]:
    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_address[1]}"
    server.shutdown()
    server.server_close()


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv("http_proxy", raising=False)
    return tmp_path / "cache" / "mavproxy-handover"


def published(url: str, program: bytes = PROGRAM) -> Published:
    return Published("9.9.9", url, len(program), hashlib.sha256(program).hexdigest())


@pytest.mark.parametrize("path", ["/good", "/moved"])
def test_it_comes_whole_and_can_be_run(server: str, cache: Path, path: str) -> None:
    told: list[str] = []
    program = fetch(told.append, published(server + path))
    assert program == cache / "arducopter-9.9.9" == here(published(server))
    assert program.read_bytes() == PROGRAM
    assert os.access(program, os.X_OK)
    assert [each.name for each in cache.iterdir()] == [program.name]
    assert told[0].startswith("bringing ArduCopter 9.9.9, 0.1 MB, from http://")
    assert "--vehicle arducopter" in told[-1]


def test_what_is_there_is_not_brought_again_and_what_is_damaged_is(server: str, cache: Path) -> None:
    program = fetch(lambda _line: None, published(server + "/good"))
    told: list[str] = []
    fetch(told.append, published(server + "/missing"))
    assert told == [f"ArduCopter 9.9.9 is there already: {program}"]
    program.write_bytes(PROGRAM[:100])
    fetch(told.append, published(server + "/good"))
    assert program.read_bytes() == PROGRAM


@pytest.mark.parametrize(
    ("path", "said"),
    [
        ("/missing", "the server answers 404 Not Found; --vehicle builtin needs no download"),
        ("/cut", "cut short: 144010 of 144017 bytes"),
        ("/short", "cut short: 144010 of 144017 bytes"),
        ("/other", "not what was published as 9.9.9: its SHA-256 is "),
        ("/long", "more than the 144017 bytes of 9.9.9"),
        ("/slow", "broke off after 0 bytes: timed out"),
    ],
)
def test_anything_else_is_told_and_leaves_nothing(server: str, cache: Path, path: str, said: str) -> None:
    with pytest.raises(LaunchError) as refused:
        fetch(lambda _line: None, published(server + path), timeout_s=0.5)
    assert said in str(refused.value)
    assert server + path in str(refused.value)
    assert "\n" not in str(refused.value)
    assert list(cache.iterdir()) == []
    assert here(published(server)) is None


def test_without_a_network_one_line_says_what_cannot_be_reached(cache: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    with pytest.raises(LaunchError, match="Connection refused; --vehicle builtin needs no download"):
        fetch(lambda _line: None, published(f"http://127.0.0.1:{port}/good"))
    assert list(cache.iterdir()) == []


def test_a_program_that_does_not_run_here_is_not_kept(
    server: str, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = b"#!/bin/sh\necho 'libm.so.6: version GLIBC_9.9 not found' >&2\nexit 127\n"
    monkeypatch.setitem(Handler.answers, "/old", lambda handler: handler.give(program))
    with pytest.raises(LaunchError, match=r"does not run here: libm\.so\.6: version GLIBC_9\.9 not found"):
        fetch(lambda _line: None, published(server + "/old", program))
    assert list(cache.iterdir()) == []


def test_where_it_is_not_published_for_that_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fetched.platform, "machine", lambda: "aarch64")
    with pytest.raises(LaunchError, match="for Linux on x86_64, this is linux on aarch64"):
        fetch(lambda _line: None)


def test_a_cache_that_cannot_be_written_is_told(server: str, tmp_path: Path) -> None:
    (tmp_path / "cache").write_text("a file")
    with pytest.raises(LaunchError, match=r"Not a directory|File exists"):
        fetch(lambda _line: None, published(server + "/good"))


def test_the_command_brings_it_and_it_is_found_then(
    server: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    there = published(server + "/good")
    monkeypatch.setattr(command, "fetch", lambda tell: fetch(tell, there))
    monkeypatch.setattr("sitl.vehicles.arducopter.here", lambda: here(there))
    for name in ("ARDUCOPTER", "PATH"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    assert find_arducopter() is None
    assert command.main(["--vehicle", "arducopter"]) == 2
    assert "--fetch-arducopter" in capsys.readouterr().err
    assert command.main(["--fetch-arducopter"]) == 0
    assert "--vehicle arducopter flies it" in capsys.readouterr().out
    assert find_arducopter() == cached(there)


def test_what_is_published_is_one_release_by_its_digest() -> None:
    assert PUBLISHED.url.startswith("https://firmware.ardupilot.org/Copter/stable-" + PUBLISHED.version)
    assert len(bytes.fromhex(PUBLISHED.sha256)) == 32
    assert PUBLISHED.size > 1_000_000
