# SPDX-License-Identifier: GPL-3.0-or-later

"""Serves a page of this package until it is stopped: one place for the limits of the web server.

Import this only for `handover watch` and `handover panel`: uvicorn is an extra.
"""

from __future__ import annotations

import socket
from collections.abc import Callable
from typing import Any

import uvicorn

__all__ = ["Served"]


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
