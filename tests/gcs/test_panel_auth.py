# SPDX-License-Identifier: GPL-3.0-or-later

"""Who may use the panel: one browser by a link that works once, by this computer's name, from this page."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from gcs_module.panel.panel_auth import PanelAuth

PORT = 8091


class Bench:
    """The access check of a panel, and an application that records each request."""

    def __init__(self, host: str = "127.0.0.1") -> None:
        self.inside = 0
        self.auth = PanelAuth(self._application, host, PORT, "k" * 32)

    async def _application(self, _scope: Any, _receive: Any, send: Any) -> None:
        self.inside += 1
        await send({"type": "http.response.start", "status": 200, "headers": []})

    def ask(self, kind: str = "http", path: str = "/", query: str = "", **headers: str) -> tuple[bool, Any]:
        """Whether the application was asked, and the first message of the answer."""
        sent: list[Any] = []

        async def receive() -> dict[str, Any]:
            return {}

        async def send(message: Any) -> None:
            sent.append(message)

        browser = {"host": f"127.0.0.1:{PORT}", "accept": "text/html"}
        if kind == "websocket":
            browser["origin"] = f"http://{headers.get('host', browser['host'])}"
        given = [(name.encode(), value.encode("latin-1")) for name, value in (browser | headers).items() if value]
        scope = {"type": kind, "path": path, "query_string": query.encode(), "headers": given}
        before = self.inside
        asyncio.run(self.auth(scope, receive, send))
        return self.inside > before, sent[0]

    def enter(self, token: str, **headers: str) -> str:
        """Open a link; returns the cookie, "" if there was none."""
        inside, first = self.ask(query=f"token={token}", **headers)
        assert not inside
        found = dict(first["headers"]).get(b"set-cookie", b"").decode()
        return str(found.partition(";")[0])


def test_a_link_lets_one_browser_in_once() -> None:
    bench = Bench()
    token = bench.auth.new_link()
    cookie = bench.enter(token)
    assert cookie.startswith(f"handover_panel_{PORT}=")
    assert token not in cookie
    assert bench.ask(cookie=cookie)[0]
    assert bench.ask("websocket", "/_nicegui_ws/socket.io/", cookie=cookie)[0]
    assert bench.enter(token) == "", "the link is worthless now"
    assert bench.ask(cookie=cookie)[0], "the browser that is in stays in"


def test_a_new_link_makes_the_one_before_worthless() -> None:
    bench = Bench()
    first, second = bench.auth.new_link(), bench.auth.new_link()
    assert bench.enter(first) == ""
    assert bench.enter(second) != ""


def test_the_cookie_is_for_this_page_alone() -> None:
    bench = Bench()
    _inside, first = bench.ask(query=f"token={bench.auth.new_link()}")
    attributes = dict(first["headers"])[b"set-cookie"].decode().split("; ")[1:]
    assert attributes == ["HttpOnly", "SameSite=Strict", "Path=/"]
    other = Bench()
    assert not other.ask(cookie=bench.enter(bench.auth.new_link()))[0]


@pytest.mark.parametrize("path", ["/", "/panel/panel.js", "/watch/watch.js", "/_nicegui_ws/socket.io/"])
@pytest.mark.parametrize("kind", ["http", "websocket"])
@pytest.mark.parametrize("cookie", ["", f"handover_panel_{PORT}=", f"handover_panel_{PORT}=wrong", "\xe4=\xff"])
def test_nothing_is_answered_without_the_cookie(path: str, kind: str, cookie: str) -> None:
    inside, first = Bench().ask(kind, path, cookie=cookie)
    assert not inside
    assert first["type"] == "websocket.close" if kind == "websocket" else first["status"] == 401


@pytest.mark.parametrize("token", ["", "wrong", "%ff"])
def test_before_a_link_is_printed_no_token_fits(token: str) -> None:
    assert Bench().enter(token) == ""


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example", "192.168.1.5:8091", "", "["])
@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_by_another_name_nobody_comes_in_even_with_the_cookie(host: str, kind: str) -> None:
    bench = Bench()
    cookie = bench.enter(bench.auth.new_link())
    assert not bench.ask(kind, host=host, cookie=cookie)[0]
    assert bench.enter(bench.auth.new_link(), host=host or "x") == ""


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:9", "https://127.0.0.1"])
@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_a_page_from_elsewhere_gets_nothing_even_with_the_cookie(origin: str, kind: str) -> None:
    bench = Bench()
    cookie = bench.enter(bench.auth.new_link())
    assert not bench.ask(kind, origin=origin, cookie=cookie)[0]


def test_a_socket_without_an_origin_is_no_browsers() -> None:
    bench = Bench()
    cookie = bench.enter(bench.auth.new_link())
    assert not bench.ask("websocket", cookie=cookie, origin="")[0]


@pytest.mark.parametrize(
    ("host", "asked", "inside"),
    [
        ("10.0.0.5", "10.0.0.5:8091", True),
        ("10.0.0.5", "127.0.0.1:8091", True),
        ("10.0.0.5", "10.0.0.6:8091", False),
        ("0.0.0.0", "ground-7:8091", True),
    ],
)
def test_a_configured_address_is_known_by_that_name(host: str, asked: str, inside: bool) -> None:
    bench = Bench(host)
    cookie = bench.enter(bench.auth.new_link())
    assert bench.ask(host=asked, cookie=cookie)[0] is inside


def test_the_page_may_fetch_from_here_alone() -> None:
    bench = Bench()
    cookie = bench.enter(bench.auth.new_link())
    _inside, first = bench.ask(cookie=cookie)
    policy = dict(first["headers"])[b"content-security-policy"].decode()
    assert "default-src 'self'" in policy
    assert "frame-ancestors 'none'" in policy
    assert "http" not in policy
