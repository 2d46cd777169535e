# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover watch` as a program: what it serves, to whom, what it says when it cannot, and that it leaves no trace."""

from __future__ import annotations

import ast
import re
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

import gcs_module
from mavproxy_handover.cli import main
from tests.gcs.watched import flights

FOLDER = Path(gcs_module.__file__).parent
PROGRAM = "import sys; from mavproxy_handover.cli import main; sys.exit(main())"
#: the web stack: an extra, and never on a vehicle
STACK = {"nicegui", "fastapi", "uvicorn", "starlette", "socketio"}


@contextmanager
def watching(*words: str) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """The program, and the address that it prints."""
    command = [sys.executable, "-c", PROGRAM, "watch", "--port", "0", *words]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        yield process.stdout.readline().strip(), process
    finally:
        process.kill()
        process.communicate(timeout=10)


def get(address: str, *, Accept: str = "text/html", **headers: str) -> tuple[int, str]:
    for _ in range(100):  # the address is printed a moment before it is answered at
        try:
            with urllib.request.urlopen(
                urllib.request.Request(address, headers={"Accept": Accept, **headers}), timeout=10
            ) as answer:
                return answer.status, answer.read().decode("utf-8", "replace")
        except urllib.error.HTTPError as error:
            return error.code, error.read().decode()
        except urllib.error.URLError:
            time.sleep(0.1)
    raise AssertionError(f"{address} is not answered")


@pytest.mark.process
def test_the_page_and_all_that_it_needs_come_from_here(tmp_path: Path) -> None:
    (flight,) = flights(tmp_path, 1)
    flight.step(0.0)
    assert flight.journal.wait_until_written(5.0)
    (tmp_path / "drone-1" / "broken.jsonl").write_bytes(b"\xff\n{}\n" * 100)
    before = {path: (path.stat().st_mtime_ns, path.stat().st_size) for path in tmp_path.rglob("*")}
    with watching(str(tmp_path)) as (address, process):
        assert re.fullmatch(r"http://127\.0\.0\.1:\d+/", address)
        time.sleep(1.0)
        status, page = get(address)
        assert status == 200
        named = set(re.findall(r"""(?:src|href)=["']([^"']+)["']""", page)) | set(
            re.findall(r'"(/[\w./-]+\.m?js)"', page)
        )
        assert {"/watch/watch.css", "/watch/watch.js"} <= named
        assert [name for name in named if not name.startswith(("/", "data:"))] == []
        for name in sorted(named):
            if not name.startswith("data:"):
                assert get(address.rstrip("/") + name)[0] == 200, name
        assert get(address, Host="evil.example")[0] == 421
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=20) == 0
        assert process.stderr is not None
        assert process.stderr.read() == ""
    flight.journal.close()
    after = {path: (path.stat().st_mtime_ns, path.stat().st_size) for path in tmp_path.rglob("*")}
    assert after == before


@pytest.mark.process
def test_requests_that_nobody_opens_lock_no_viewer_out_and_take_little_memory(tmp_path: Path) -> None:
    with watching(str(tmp_path)) as (address, process):
        assert get(address)[0] == 200

        def memory_kb() -> int:
            status = Path(f"/proc/{process.pid}/status").read_text()
            return int(re.findall(r"VmRSS:\s+(\d+)", status)[0])

        before = memory_kb()
        for _ in range(120):
            assert get(address)[0] == 200
        status, page = get(address)
        assert status == 200
        assert "windows show this page already" not in page
        assert "/watch/watch.js" in page
        assert memory_kb() - before < 30_000
        assert get(address, Accept="*/*")[1] == "handover watch: open this address in a browser\n"


@pytest.mark.process
def test_who_lets_others_look_gets_a_token(tmp_path: Path) -> None:
    with watching(str(tmp_path), "--bind", "0.0.0.0") as (address, _process):
        found = re.fullmatch(r"http://0\.0\.0\.0:(\d+)/\?token=([\w-]{32})", address)
        assert found is not None
        plain = f"http://127.0.0.1:{found[1]}"
        assert get(f"{plain}/")[0] == 401
        assert get(f"{plain}/watch/watch.js")[0] == 401
        assert get(f"{plain}/_nicegui_ws/socket.io/?EIO=4&transport=polling")[0] == 401
        assert get(f"{plain}/?token=x{found[2]}")[0] == 401
        assert get(f"{plain}/", Cookie=f"handover_watch={found[2]}")[0] == 200


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ([], "nothing to watch"),
        (["no-such-folder"], "no-such-folder: no such file or folder"),
        (["--link", "udpout:127.0.0.1:14550"], "only udpin:HOST:PORT and tcp:HOST:PORT"),
        ([".", "--mission", "no-such-mission"], "no-such-mission"),
        ([".", "--token-file", "no-such-file"], "no-such-file: No such file"),
        ([".", "--tiles", "tiles"], "--tiles tiles: no such file or folder; allowed are an MBTiles file"),
    ],
)
def test_what_cannot_be_used_is_one_line(words: list[str], says: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["watch", *words]) == 2
    out, error = capsys.readouterr()
    assert out == ""
    assert error.startswith("handover watch: ")
    assert says in error
    assert error.count("\n") == 1


def test_a_token_that_is_easily_guessed_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    token = tmp_path / "token"
    for text in ("", "short", "with a blank in it, and long", "ümlaut-and-long-enough"):
        token.write_text(text, encoding="utf-8")
        assert main(["watch", ".", "--token-file", str(token)]) == 2
        assert "16 or more letters" in capsys.readouterr().err


def test_without_the_extra_it_says_which() -> None:
    program = f"import sys; sys.modules.update(dict.fromkeys({sorted(STACK)!r})); {PROGRAM}"
    ended = subprocess.run(
        [sys.executable, "-c", program, "watch", "."], capture_output=True, text=True, timeout=60, check=False
    )
    assert ended.returncode == 2
    assert ended.stderr == "handover watch: needs fastapi: pip install 'mavproxy-handover[watch]'\n"


def test_only_the_page_and_its_command_know_the_web_stack() -> None:
    root, found = FOLDER.parent, {}
    for package in ("gcs_module", "mavproxy_handover", "sitl"):
        for path in sorted((root / package).rglob("*.py")):
            text = path.read_text(encoding="utf-8")
            if not any(name in text for name in STACK):
                continue  # reading what cannot have it takes seconds
            for node in ast.walk(ast.parse(text)):
                names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
                names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
                for name in {name.split(".")[0] for name in names} & STACK:
                    found.setdefault(str(path.relative_to(root)), set()).add(name)
    assert found == {
        "gcs_module/watch/serving.py": {"uvicorn"},
        "gcs_module/watch/page.py": {"fastapi", "nicegui"},
        "gcs_module/watch/page_server.py": {"fastapi", "nicegui"},
        "sitl/run/panel_driver.py": {"nicegui"},
        "gcs_module/panel/page.py": {"fastapi", "nicegui"},
    }


def test_a_log_that_is_no_journal_is_refused_with_the_program_that_reads_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The page would stay empty, without a word."""
    log = tmp_path / "flight.tlog"
    log.write_bytes(b"")
    assert main(["watch", str(log)]) == 2
    said = capsys.readouterr().err
    assert (
        said == f"handover watch: {log}: not a journal (*.jsonl). 'handover report {log}' shows logs after a flight.\n"
    )
