# SPDX-License-Identifier: GPL-3.0-or-later

"""`python -m sitl.bench.panel_flood SOCKET LINK`: everything that a broken or hostile panel can do to its station.

Many connections, lines that are no JSON, lines that never end, orders without a pause, readers that never read; and
requests for the page without the cookie. It runs until it is ended.
"""

from __future__ import annotations

import json
import socket
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final
from urllib.parse import urlsplit

from gcs_module.panel.endpoint import EndpointError, connect

__all__ = ["main"]

_ORDER: Final = json.dumps({"number": 1, "do": "acknowledge", "vehicle": 1, "argument": ""}).encode() + b"\n"
#: what a connection sends after its token
_LINES: Final = (_ORDER * 200, b"{" * 60_000, b"\xff\x00junk\n" * 5_000, b"[" * 1500 + b"\n", b"")
_PAUSE_S: Final = 0.002


def _socket(where: Path, data: bytes) -> None:
    """One connection that sends this and then reads nothing for a moment."""
    opened, token = connect(where)
    with opened:
        opened.settimeout(0.2)
        opened.sendall(json.dumps({"token": token}).encode() + b"\n" + data)
        time.sleep(0.02)


def _page(host: str, port: int) -> None:
    """A request for the page, whose answer is not read."""
    with socket.create_connection((host, port), timeout=0.5) as opened:
        opened.sendall(b"GET /tiles/1/2/3 HTTP/1.1\r\nHost: 127.0.0.1\r\nAccept: text/html\r\n\r\n" * 20)


def _again(job: Callable[[int], None]) -> None:
    number = 0
    while True:
        with suppress(OSError, EndpointError):
            job(number)
        number += 1
        time.sleep(_PAUSE_S)


def main(argv: Sequence[str]) -> int:
    """Flood until the end."""
    where, link = Path(argv[0]), urlsplit(argv[1])
    host, port = link.hostname or "127.0.0.1", link.port or 80
    jobs: list[Callable[[int], None]] = [lambda _number: _page(host, port)]
    jobs += [lambda number: _socket(where, _LINES[number % len(_LINES)])] * 3
    threads = [threading.Thread(target=_again, args=(job,), daemon=True) for job in jobs]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
