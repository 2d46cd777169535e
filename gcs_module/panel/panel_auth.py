# SPDX-License-Identifier: GPL-3.0-or-later

"""Authenticates every request to the panel: one browser gets in by a link that works once.

Rules that live here
--------------------
* Every request needs the cookie. The link's token is exchanged for it once; the link is worthless after that. The next
  link lets another browser in, and a cookie is valid until the panel ends.
* A browser gives a cookie to every port of this computer. So the cookie alone presses no button: an order also needs
  the key. It comes with the cookie, in the part of the address after `#`, which no browser sends to a server. The page
  keeps it in the storage of its own port.
* The host in the address must be one of this computer, or the address that was configured. A request that a page from
  elsewhere makes has another origin, and is refused. A socket without an origin is no browser's, and is refused.
* Two panels of one computer do not share a cookie: its name holds the port.
"""

from __future__ import annotations

import hmac
import secrets
from typing import Any, Final
from urllib.parse import urlsplit

from gcs_module.watch.web_auth import WebAuth, is_loopback

__all__ = ["PanelAuth", "new_key"]

_BYTES: Final = 24


def new_key() -> str:
    """A key for the orders to one panel."""
    return secrets.token_urlsafe(_BYTES)


class PanelAuth(WebAuth):
    """An ASGI application around the panel's. `host` and `port`: where it is served; `key`: that orders need."""

    def __init__(self, app: Any, host: str, port: int, key: str) -> None:
        super().__init__(app, secrets.token_urlsafe(_BYTES), program="handover panel", cookie=f"handover_panel_{port}")
        self._host = host
        self._link = ""
        self._key = key

    def new_link(self) -> str:
        """The token of a link that works once; an earlier link that was not used is worthless."""
        self._link = secrets.token_urlsafe(_BYTES)
        return self._link

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """Refuse a socket that names no origin; the rest as for every page."""
        if scope["type"] == "websocket" and not any(name.lower() == b"origin" for name, _value in scope["headers"]):
            await self._refuse(scope, send, 403, "this socket is for browsers")
            return
        await super().__call__(scope, receive, send)

    def _ours(self, host: str) -> bool:
        try:
            name = urlsplit(f"//{host}").hostname or ""
        except ValueError:
            return False
        if is_loopback(name):
            return True
        return not is_loopback(self._host) and (name == self._host.lower() or self._host in ("0.0.0.0", "::"))

    def _exchange(self, given: str) -> str:
        """The cookie for the token of a link, once."""
        if not self._link or not hmac.compare_digest(given.encode(), self._link.encode()):
            return ""
        self._link = ""
        return self._token or ""

    def _fragment(self) -> str:
        return f"#{self._key}"
