# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover panel` as a program: its link, the browsers that it answers, and its errors."""

from __future__ import annotations

import http.client
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from gcs_module.panel.endpoint import open_endpoint
from mavproxy_handover.cli import main

PROGRAM = "import sys; from mavproxy_handover.cli import main; sys.exit(main())"


@pytest.fixture(autouse=True)
def place(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.setenv("HANDOVER_PANELS", str(tmp_path / "panels"))
    return tmp_path


@contextmanager
def serving(*words: str) -> Iterator[tuple[str, int, str, subprocess.Popen[str]]]:
    """The program; host, port and token of the link that it prints."""
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, "panel", "--port", "0", *words],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=dict(os.environ),
    )
    try:
        assert process.stdout is not None
        line = process.stdout.readline().strip()
        found = re.fullmatch(r"http://([\d.]+):(\d+)/\?token=([\w-]{32})", line)
        assert found is not None, line
        yield found[1], int(found[2]), found[3], process
    finally:
        process.kill()
        process.communicate(timeout=10)


def get(port: int, path: str, **headers: str) -> tuple[int, dict[str, str], str]:
    for _ in range(100):  # the link is printed a moment before it is answered
        try:
            asked = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
            asked.request("GET", path, headers={"Accept": "text/html", **headers})
            answer = asked.getresponse()
            found = dict(answer.getheaders())
            text = answer.read().decode("utf-8", "replace")
            asked.close()
            return answer.status, {name.lower(): value for name, value in found.items()}, text
        except ConnectionRefusedError:
            time.sleep(0.1)
    raise AssertionError(f"{path} is not answered")


@pytest.mark.process
def test_a_link_opens_the_page_once_and_all_comes_from_here() -> None:
    with serving("--station", "GCSA") as (host, port, token, process):
        assert host == "127.0.0.1"
        assert get(port, "/")[0] == 401
        status, headers, _text = get(port, f"/?token={token}")
        assert status == 303
        assert re.fullmatch(r"/#[\w-]{32}", headers["location"])
        assert token not in headers["location"]
        key = headers["location"][2:]
        cookie = headers["set-cookie"].partition(";")[0]
        assert get(port, f"/?token={token}")[0] == 401, "the link works once"
        status, _headers, page = get(port, "/", Cookie=cookie)
        assert status == 200
        assert key not in page, "the cookie alone does not bring the key"
        named = set(re.findall(r"""(?:src|href)=["']([^"']+)["']""", page))
        assert {"/panel/panel.css", "/panel/panel.js", "/watch/map.css", "/watch/watch.js"} <= named
        assert [name for name in named if not name.startswith(("/", "data:"))] == []
        for name in sorted(named):
            if not name.startswith("data:"):
                assert get(port, name, Cookie=cookie)[0] == 200, name
                assert get(port, name)[0] == 401, name
        assert get(port, "/", Cookie=cookie, Host="evil.example")[0] == 421
        assert get(port, "/", Cookie=cookie, Origin="http://evil.example")[0] == 421
        assert get(port, "/_nicegui_ws/socket.io/?EIO=4&transport=polling")[0] == 401
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=20) == 0
        assert process.stderr is not None
        assert process.stderr.read() == "handover panel: GCSA does not run here yet. The page waits for it.\n"


@pytest.mark.process
def test_tiles_come_from_the_disk_for_the_browser_with_the_cookie(tmp_path: Path) -> None:
    (tmp_path / "map" / "3" / "1").mkdir(parents=True)
    (tmp_path / "map" / "3" / "1" / "2.png").write_bytes(b"\x89PNG\r\n\x1a\npicture")
    (tmp_path / "secret.png").write_bytes(b"\x89PNG\r\n\x1a\nsecret")
    with serving("--station", "GCSA", "--tiles", str(tmp_path / "map")) as (_host, port, token, _process):
        assert get(port, "/tiles/3/1/2")[0] == 401
        cookie = get(port, f"/?token={token}")[1]["set-cookie"].partition(";")[0]
        status, headers, text = get(port, "/tiles/3/1/2", Cookie=cookie)
        assert (status, headers["content-type"], text[-7:]) == (200, "image/png", "picture")
        assert headers["x-content-type-options"] == "nosniff"
        assert get(port, "/tiles/3/1/2", Cookie=cookie, Origin="http://evil.example")[0] == 421
        for path in (
            "3/1/3",
            "3/1/2.png",
            "../secret",
            "../secret.png",
            "%2e%2e/secret.png",
            "..%2fsecret.png",
            "3/1/%00",
        ):
            assert get(port, f"/tiles/{path}", Cookie=cookie)[0] == 404, path


def test_tiles_that_cannot_be_used_are_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["panel", "--tiles", str(tmp_path / "none")]) == 2
    out, error = capsys.readouterr()
    assert out == ""
    assert error.startswith(f"handover panel: --tiles {tmp_path / 'none'}: no such file or folder; allowed are ")
    assert error.count("\n") == 1


@pytest.mark.process
def test_an_address_that_others_reach_is_said() -> None:
    with serving("--host", "0.0.0.0") as (host, port, token, process):
        assert host == "0.0.0.0"
        assert get(port, "/")[0] == 401
        assert get(port, f"/?token={token}")[0] == 303
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=20) == 0
        assert process.stderr is not None
        assert "other computers can reach this page" in process.stderr.read()


@pytest.mark.process
@pytest.mark.skipif(sys.platform == "win32", reason="needs a pseudo-terminal")
def test_enter_prints_a_new_link() -> None:
    import pty

    master, slave = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, "panel", "--port", "0", "--station", "GCSA"],
        stdin=slave,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env=dict(os.environ),
    )
    try:
        assert process.stdout is not None
        first = process.stdout.readline()
        assert process.stdout.readline() == "The link works once. Press Enter for another one, for another browser.\n"
        os.write(master, b"\n")
        second = process.stdout.readline()
        assert second.startswith("http://127.0.0.1:")
        assert first.partition("?")[0] == second.partition("?")[0]
        assert first != second
    finally:
        process.kill()
        process.communicate(timeout=10)
        os.close(master)
        os.close(slave)


def test_which_of_several_stations_has_to_be_named(capsys: pytest.CaptureFixture[str]) -> None:
    opened = [open_endpoint(name) for name in ("GCSA", "GCSB")]
    assert main(["panel"]) == 2
    said = capsys.readouterr().err
    assert said == "handover panel: several stations run here: GCSA, GCSB. Name one: --station GCSA\n"
    for each in opened:
        each.close()


@pytest.mark.parametrize("words", [["--port", "x"], ["--port", "70000"], ["more"]])
def test_wrong_usage_ends_with_two(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["panel", *words]) == 2
    assert "handover panel" in capsys.readouterr().err


def test_without_the_extra_it_says_which() -> None:
    stack = ("fastapi", "nicegui", "socketio", "starlette", "uvicorn")
    program = f"import sys; sys.modules.update(dict.fromkeys({stack!r})); {PROGRAM}"
    ended = subprocess.run(
        [sys.executable, "-c", program, "panel"], capture_output=True, text=True, timeout=60, check=False
    )
    assert ended.returncode == 2
    assert ended.stderr == "handover panel: needs fastapi: pip install 'mavproxy-handover[watch]'\n"
