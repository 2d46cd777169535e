# SPDX-License-Identifier: GPL-3.0-or-later

"""Who may look at the page: each way in without the token, or by a name of somebody else's, is shut."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from gcs_module.watch.web_auth import COOKIE, WebAuth, is_loopback

TOKEN = "abcdefghijklmnop"


def ask(door_token: str | None, kind: str = "http", path: str = "/", query: str = "", **headers: str) -> list[Any]:
    """What is answered: the messages that were sent, "inside" among them if the application was asked."""
    sent: list[Any] = []

    async def inside(scope: Any, _receive: Any, send: Any) -> None:
        sent.append("inside")
        await send({"type": "http.response.start", "status": 200, "headers": [(b"a", b"b")]})

    async def receive() -> dict[str, Any]:
        return {}

    async def send(message: Any) -> None:
        sent.append(message)

    browser = {"host": "127.0.0.1:8090", "accept": "text/html,application/xhtml+xml"}
    given = [(name.encode(), value.encode("latin-1")) for name, value in (browser | headers).items()]
    scope = {"type": kind, "path": path, "query_string": query.encode(), "headers": given}
    asyncio.run(WebAuth(inside, door_token)(scope, receive, send))
    return sent


def status(sent: list[Any]) -> int:
    (first,) = (each for each in sent if each != "inside" and each["type"] == "http.response.start")
    return int(first["status"])


@pytest.mark.parametrize("host", ["127.0.0.1:8090", "localhost:8090", "[::1]:8090", "127.0.0.2"])
def test_without_a_token_this_machine_may_look(host: str) -> None:
    sent = ask(None, host=host)
    assert sent[0] == "inside"
    names = [name for name, _value in sent[1]["headers"]]
    assert b"content-security-policy" in names
    assert names[0] == b"a"


@pytest.mark.parametrize("accept", ["*/*", "application/json", ""])
def test_a_program_that_is_no_browser_gets_one_line_and_no_page(accept: str) -> None:
    sent = ask(None, accept=accept)
    assert "inside" not in sent
    assert status(sent) == 200
    assert sent[1]["body"] == b"handover watch: open this address in a browser\n"
    assert ask(None, path="/watch/watch.css", accept=accept)[0] == "inside", "what the page needs is no page"
    assert ask(None, "websocket", accept=accept)[0] == "inside"


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example", "192.168.1.5:8090", "", "[", "0x7f.1"])
@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_without_a_token_nobody_comes_by_another_name(host: str, kind: str) -> None:
    sent = ask(None, kind, host=host)
    assert "inside" not in sent
    assert sent[0]["type"] == "websocket.close" if kind == "websocket" else status(sent) == 421


@pytest.mark.parametrize("kind", ["http", "websocket"])
@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:9", "http://["])
def test_pages_from_elsewhere_get_nothing(kind: str, origin: str) -> None:
    assert "inside" not in ask(None, kind, origin=origin)
    assert "inside" not in ask(TOKEN, kind, origin=origin, cookie=f"{COOKIE}={TOKEN}")
    assert "inside" in ask(None, kind, origin="http://127.0.0.1:8090")


@pytest.mark.parametrize(
    ("site", "mode", "served"),
    [
        ("cross-site", "no-cors", False),
        ("same-site", "no-cors", False),
        ("same-site", "websocket", False),
        ("same-origin", "cors", True),
        ("none", "navigate", True),
        ("cross-site", "navigate", True),
    ],
)
def test_what_a_page_from_elsewhere_asks_for_without_an_origin_is_refused(site: str, mode: str, served: bool) -> None:
    headers = {"sec-fetch-site": site, "sec-fetch-mode": mode}
    assert ("inside" in ask(None, path="/_nicegui_ws/socket.io/", **headers)) is served
    assert ("inside" in ask(TOKEN, cookie=f"{COOKIE}={TOKEN}", **headers)) is served


@pytest.mark.parametrize("path", ["/", "/watch/watch.js", "/_nicegui_ws/socket.io/"])
@pytest.mark.parametrize("kind", ["http", "websocket"])
@pytest.mark.parametrize("cookie", ["", f"{COOKIE}=wrong", f"{COOKIE}=", f"x={TOKEN}", f'{COOKIE}="', "\xe4=\xff"])
def test_with_a_token_nothing_is_answered_without_it(path: str, kind: str, cookie: str) -> None:
    sent = ask(TOKEN, kind, path, cookie=cookie)
    assert "inside" not in sent
    assert sent[0]["type"] == "websocket.close" if kind == "websocket" else status(sent) == 401


def test_the_token_of_the_address_becomes_a_cookie() -> None:
    sent = ask(TOKEN, path="//evil.example/\r\nx: y", query=f"token={TOKEN}&a=1", host="ground-7:8090")
    headers = dict(sent[0]["headers"])
    assert status(sent) == 303
    assert headers[b"location"] == b"/evil.example/%0D%0Ax%3A%20y?a=1"
    assert headers[b"set-cookie"] == f"{COOKIE}={TOKEN}; HttpOnly; SameSite=Strict; Path=/".encode()
    assert "inside" in ask(TOKEN, host="ground-7:8090", cookie=f"{COOKIE}={TOKEN}")


@pytest.mark.parametrize("query", ["token=", "token=wrong", "&".join("a=1" for _ in range(99)), "token=%ff"])
def test_another_token_gives_none(query: str) -> None:
    sent = ask(TOKEN, query=query)
    assert status(sent) == 401
    assert all(name != b"set-cookie" for name, _value in sent[0]["headers"])
    assert "inside" not in ask(TOKEN, "websocket", query=f"token={TOKEN}")  # a socket needs the cookie


@pytest.mark.parametrize(
    ("host", "loopback"),
    [("127.0.0.1", True), ("::1", True), ("localhost", True), ("0.0.0.0", False), ("::", False), ("a.b", False)],
)
def test_which_addresses_are_this_machines_alone(host: str, loopback: bool) -> None:
    assert is_loopback(host) is loopback
