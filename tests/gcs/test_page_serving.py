# SPDX-License-Identifier: GPL-3.0-or-later

"""The web server of the pages: a connection without a request keeps no place, and a page's socket stays open."""

from __future__ import annotations

import asyncio
import contextlib
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest

uvicorn = pytest.importorskip("uvicorn", reason="pip install 'mavproxy-handover[watch]' serves pages")

from gcs_module.watch import serving  # noqa: E402 (it needs uvicorn)

ASK = b"GET / HTTP/1.1\r\nHost: x\r\n\r\n"
OPEN = (
    b"GET / HTTP/1.1\r\nHost: x\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
)


async def application(scope: Any, receive: Any, send: Any) -> None:
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.accept"})
        while (await receive())["type"] != "websocket.disconnect":
            await send({"type": "websocket.send", "text": "here"})
    elif scope["type"] == "http":
        await send({"type": "http.response.start", "status": 200, "headers": [(b"content-length", b"2")]})
        await send({"type": "http.response.body", "body": b"ok"})


@pytest.fixture
def port(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    monkeypatch.setattr(serving, "FIRST_REQUEST_S", 0.3)
    served = serving.Served("127.0.0.1", 0)
    server = uvicorn.Server(served._configuration(application))
    thread = threading.Thread(target=lambda: server.run(sockets=[served._opened]))
    thread.start()
    while not server.started:
        time.sleep(0.01)
    yield served.port
    server.should_exit = True
    thread.join()


@pytest.mark.parametrize("data", [b"", ASK[:-2]])
def test_a_connection_that_makes_no_request_is_closed(port: int, data: bytes) -> None:
    async def silent() -> bytes:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(data)
        found = await asyncio.wait_for(reader.read(), 30.0)
        writer.close()
        return found

    assert asyncio.run(silent()) == b""


def test_a_connection_that_has_made_one_and_a_socket_stay(port: int) -> None:
    async def used() -> tuple[bytes, bytes]:
        plain, asks = await asyncio.open_connection("127.0.0.1", port)
        page, opens = await asyncio.open_connection("127.0.0.1", port)
        asks.write(ASK)
        opens.write(OPEN)
        await plain.readuntil(b"ok")
        await page.readuntil(b"\r\n\r\n")
        with contextlib.suppress(asyncio.TimeoutError):  # a silent one would be closed by then
            await asyncio.wait_for(plain.read(), 1.0)
        asks.write(ASK)
        opens.write(b"\x81\x81\x00\x00\x00\x00x")
        found = await plain.readuntil(b"ok"), await page.readexactly(6)
        for each in (asks, opens):
            each.close()
        return found

    answered, said = asyncio.run(used())
    assert answered.endswith(b"ok")
    assert said == b"\x81\x04here"
