# SPDX-License-Identifier: GPL-3.0-or-later

"""Makes the server of a page: its files, its tiles, and how many browsers it serves.

Rules that live here
--------------------
* At most `viewers` browsers have opened their socket. Of pages that were requested and not opened, MOST_WAITING are
  kept: a program that requests again and again locks no viewer out and takes little memory.
* A tile is answered by a thread: a slow disk does not stop the page.

Import this only for `handover watch` and `handover panel`: NiceGUI is an extra.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from fastapi import FastAPI, Response
from nicegui import Client, app, ui

from gcs_module.watch.tiles import TileSource, place_of

__all__ = ["MOST_WAITING", "PageKind", "page_server"]

MOST_WAITING: Final = 8
#: time (s) for which a browser keeps a tile
_KEPT_S: Final = 86_400


@dataclass(frozen=True, slots=True)
class PageKind:
    """A page. `folders`: files by the first part of their address; `styles`, `scripts`: addresses of some of them."""

    title: str
    folders: Mapping[str, Path]
    styles: tuple[str, ...]
    scripts: tuple[str, ...]
    viewers: int


def page_server(
    kind: PageKind,
    fill: Callable[[], object],
    begin: Callable[[], None],
    end: Callable[[], None],
    tiles: TileSource | None = None,
) -> FastAPI:
    """The application. `fill` makes the page in one browser; `begin` and `end` are called within its event loop."""
    server = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    for name, folder in kind.folders.items():
        app.add_static_files(name, folder)
    app.on_startup(begin)
    app.on_shutdown(end)
    head = [f'<link rel="stylesheet" href="{name}">' for name in kind.styles]
    head += [f'<script src="{name}"></script>' for name in kind.scripts]

    @server.get("/tiles/{place:path}")
    def tile(place: str) -> Response:
        where = place_of(place)
        found = None if tiles is None or where is None else tiles.read(*where)
        if found is None:
            return Response(status_code=404)
        return Response(found.data, media_type=found.kind, headers={"cache-control": f"private, max-age={_KEPT_S}"})

    @ui.page("/", title=kind.title)
    def page() -> None:
        _forget_unopened(ui.context.client)
        if sum(client.has_socket_connection for client in Client.instances.values()) >= kind.viewers:
            ui.label(f"{kind.viewers} windows show this page already. Close one of them and load this page again.")
            return
        for line in ("".join(head[: len(kind.styles)]), "".join(head[len(kind.styles) :])):
            ui.add_head_html(line)
        fill()

    options: dict[str, Any] = {
        "reconnect_timeout": 5.0,
        "message_history_length": 0,
        "binding_refresh_interval": None,
        "tailwind": False,
        "show_welcome_message": False,
    }
    ui.run_with(server, title=kind.title, dark=None, **options)
    return server


def _forget_unopened(new: Client) -> None:
    """Delete the oldest pages that no browser has opened, beyond MOST_WAITING. `new`: the page that is being made."""
    waiting = [each for each in Client.instances.values() if not each.has_socket_connection and each is not new]
    waiting.sort(key=lambda client: client.created)
    for client in waiting[:-MOST_WAITING]:
        client.delete()
