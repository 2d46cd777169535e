# SPDX-License-Identifier: GPL-3.0-or-later

"""Authenticates every request to the page's server, for plain requests and sockets alike.

Rules that live here
--------------------
* Without a token the request must use a name of this computer itself. So a foreign page in a browser here cannot reach
  this page, or open its socket, by a name that its author has pointed here.
* With a token every request needs it. It comes once in the address, and then in a cookie that no script reads; the
  address is then the plain one again.
* The page is made for browsers, which accept HTML. Another program gets one line of text.
* The browser is told to fetch nothing from elsewhere, except the map's tiles if there are any.
"""

from __future__ import annotations

import hmac
from collections.abc import Awaitable, Callable, Mapping, MutableMapping
from http.cookies import CookieError, SimpleCookie
from ipaddress import ip_address
from typing import Any, Final
from urllib.parse import parse_qs, quote, urlencode, urlsplit

__all__ = ["COOKIE", "WebAuth", "is_loopback"]

COOKIE: Final = "handover_watch"
_Message = MutableMapping[str, Any]
_Receive = Callable[[], Awaitable[_Message]]
_Send = Callable[[_Message], Awaitable[None]]
_App = Callable[[Any, _Receive, _Send], Awaitable[None]]


def is_loopback(host: str) -> bool:
    """Whether only this computer can reach an address."""
    try:
        return host == "localhost" or ip_address(host).is_loopback
    except ValueError:
        return False


class WebAuth:
    """An ASGI application around another. `token` None: no token is needed, and the address must be loopback.

    `tiles`: origin of the map's tiles, "": none; `program`: the command that serves the page; `cookie`: name of the
    token's cookie.
    """

    def __init__(
        self, app: _App, token: str | None, tiles: str = "", *, program: str = "handover watch", cookie: str = COOKIE
    ) -> None:
        self._app = app
        self._token = token
        self._program = program
        self._cookie = cookie
        policy = (
            "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
            f"font-src 'self' data:; img-src 'self' data: {tiles}; connect-src 'self'; object-src 'none'; "
            "base-uri 'self'; form-action 'none'; frame-ancestors 'none'"
        )
        self._headers = [
            (b"content-security-policy", policy.encode("latin-1", "replace")),
            (b"referrer-policy", b"no-referrer"),
            (b"x-content-type-options", b"nosniff"),
        ]

    async def __call__(self, scope: Any, receive: _Receive, send: _Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = {name.lower(): value.decode("latin-1") for name, value in scope["headers"]}
        host = headers.get(b"host", "")
        origin = headers.get(b"origin")
        if not self._ours(host) or (origin is not None and _host_of(origin) != host) or _of_another_page(headers):
            await self._refuse(scope, send, 421, "this page is not known by that name")
        elif self._token is None or self._fits(_cookie(headers.get(b"cookie", ""), self._cookie)):
            if scope["type"] == "http" and scope["path"] == "/" and b"text/html" not in _accepted(scope):
                await self._answer(send, 200, "open this address in a browser")
            else:
                await self._app(scope, receive, self._marked(send))
        else:
            await self._ask(scope, send)

    def _ours(self, host: str) -> bool:
        try:
            return self._token is not None or is_loopback(urlsplit(f"//{host}").hostname or "")
        except ValueError:
            return False

    def _fits(self, given: str) -> bool:
        return self._token is not None and hmac.compare_digest(given.encode(), self._token.encode())

    def _exchange(self, given: str) -> str:
        """The token for the cookie, if the token in the address is right; else ""."""
        return given if self._fits(given) else ""

    def _fragment(self) -> str:
        """The end of the address that a browser gets with its cookie."""
        return ""

    async def _ask(self, scope: Any, send: _Send) -> None:
        """A request without the cookie: with the token in the address it gets the cookie."""
        try:
            query = parse_qs(scope.get("query_string", b"").decode("latin-1"), max_num_fields=20)
        except ValueError:
            query = {}
        given = query.pop("token", [""])[0]
        token = self._exchange(given) if scope["type"] == "http" else ""
        if not token:
            text = f"a token is needed: open the address that {self._program} has printed"
            await self._refuse(scope, send, 401, text)
            return
        rest = urlencode(query, doseq=True)
        # one slash: two would name another host
        place = "/" + quote(scope["path"].lstrip("/\\")) + (f"?{rest}" if rest else "")
        cookie = f"{self._cookie}={token}; HttpOnly; SameSite=Strict; Path=/"
        headers = [
            (b"location", f"{place}{self._fragment()}".encode()),
            (b"set-cookie", cookie.encode()),
            *self._headers,
        ]
        await send({"type": "http.response.start", "status": 303, "headers": headers})
        await send({"type": "http.response.body", "body": b""})

    async def _refuse(self, scope: Any, send: _Send, status: int, why: str) -> None:
        if scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008, "reason": why})
            return
        await self._answer(send, status, why)

    async def _answer(self, send: _Send, status: int, text: str) -> None:
        headers = [(b"content-type", b"text/plain; charset=utf-8"), *self._headers]
        await send({"type": "http.response.start", "status": status, "headers": headers})
        await send({"type": "http.response.body", "body": f"{self._program}: {text}\n".encode()})

    def _marked(self, send: _Send) -> _Send:
        async def marked(message: _Message) -> None:
            if message["type"] == "http.response.start":
                message = {**message, "headers": [*message.get("headers", ()), *self._headers]}
            await send(message)

        return marked


def _of_another_page(headers: Mapping[bytes, str]) -> bool:
    """Whether a browser says that a page from elsewhere makes the request, and not a person who opens the address.

    Such a request for data may have no Origin. Its answer is not shown to that page, but it costs memory here.
    """
    elsewhere = headers.get(b"sec-fetch-site", "") in ("cross-site", "same-site")
    return elsewhere and headers.get(b"sec-fetch-mode", "") != "navigate"


def _host_of(origin: str) -> str:
    """Name and port in an Origin; "": it has none."""
    try:
        return urlsplit(origin).netloc
    except ValueError:
        return ""


def _accepted(scope: Any) -> bytes:
    """The types that the requesting program accepts."""
    return b",".join(value for name, value in scope["headers"] if name.lower() == b"accept").lower()


def _cookie(header: str, name: str) -> str:
    try:
        found = SimpleCookie(header).get(name)
    except CookieError:
        return ""
    return "" if found is None else found.value
