# SPDX-License-Identifier: GPL-3.0-or-later

"""Serves a page of this package until it is stopped: one place for the limits of the web server.

Import this only for `handover watch` and `handover panel`: uvicorn is an extra.
"""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable
from typing import Any, Final

import uvicorn
from uvicorn.protocols.http.auto import AutoHTTPProtocol

__all__ = ["FIRST_REQUEST_S", "Served"]

#: a connection that has made no whole request by then is closed (s)
FIRST_REQUEST_S: Final = 10.0


class Connection(AutoHTTPProtocol):  # type: ignore[misc, valid-type]
    """A connection that is closed if it makes no request: it would keep one of few places for browsers."""

    def connection_made(self, transport: asyncio.Transport) -> None:
        """As asyncio.Protocol."""
        super().connection_made(transport)
        self.loop.call_later(FIRST_REQUEST_S, self._close_if_silent)

    def _close_if_silent(self) -> None:
        # `connections` does not hold one that has become a socket of the page
        if self in self.connections and self.cycle is None:
            self.transport.close()


class Served:
    """A listening socket for a page. Raises SystemExit after uvicorn has said why it cannot listen."""

    def __init__(self, host: str, port: int) -> None:
        self._host, self._port = host, port
        self._config = self._configuration(None)
        self._opened: socket.socket = self._config.bind_socket()
        self.host, self.port = self._opened.getsockname()[:2]

    @property
    def address(self) -> str:
        """The address of the page."""
        return f"http://{f'[{self.host}]' if ':' in self.host else self.host}:{self.port}/"

    def run(self, application: Callable[..., Any]) -> None:
        """Serve until Ctrl-C or SIGTERM."""
        try:
            uvicorn.Server(self._configuration(application)).run(sockets=[self._opened])
        except KeyboardInterrupt:
            pass

    def _configuration(self, application: Any) -> uvicorn.Config:
        return uvicorn.Config(
            application,
            http=Connection,
            host=self._host,
            port=self._port,
            log_level="warning",
            access_log=False,  # an address may hold the token
            server_header=False,
            ws_max_size=64 * 1024,
            ws_max_queue=8,
            limit_concurrency=200,
            timeout_keep_alive=10,
            timeout_graceful_shutdown=3,
        )
