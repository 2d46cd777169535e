# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover panel`: serves the operator's page until it is stopped."""

from __future__ import annotations

import argparse
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from gcs_module.panel.endpoint import foreign, running
from gcs_module.panel.panel_auth import PanelAuth, new_key
from gcs_module.panel.session import Session
from gcs_module.watch.page_arguments import add_address
from gcs_module.watch.tiles import TilesError, TileSource, open_tiles
from gcs_module.watch.web_auth import is_loopback
from mavproxy_handover.tools.command_line import CommandParser

__all__ = ["main"]

_PORT: Final = 8091


def main(argv: Sequence[str]) -> int:
    """0: it was stopped; 2: wrong usage, or the page cannot be served."""
    parser = CommandParser(
        prog="handover panel",
        examples=(
            ("handover panel", "beside the station that runs here"),
            ("handover panel --station GCSA --port 8092", "of several stations on one computer"),
            ("handover panel --tiles area.mbtiles", "with a map from the disk"),
        ),
        codes={0: "ended by Ctrl-C", 2: "wrong usage, or the page cannot be served"},
        description="Serve the operator's page of a station that runs on this computer: which station commands, what "
        "comes next, what to do, with the buttons for it. It prints a link that works once, for one browser.",
    )
    parser.add_argument(
        "--station", default="", metavar="NAME", help="the station, or the file of its socket (the one that runs)"
    )
    add_address(parser, "--host", _PORT)
    parser.add_argument(
        "--tiles",
        type=Path,
        metavar="PATH",
        help="tiles of the map: an MBTiles file, or a folder with z/x/y.png (none)",
    )
    parser.add_argument("--tiles-credit", default="", metavar="TEXT", help="whose they are")
    try:
        arguments = parser.parse_args(argv)
    except SystemExit as stop:
        return int(stop.code or 0)
    names = running()
    if not arguments.station and len(names) > 1:
        known = ", ".join(names)
        print(f"handover panel: several stations run here: {known}. Name one: --station {names[0]}", file=sys.stderr)
        return 2
    try:
        tiles = None if arguments.tiles is None else open_tiles(arguments.tiles, arguments.tiles_credit)
    except TilesError as error:
        print(f"handover panel: --tiles {error}", file=sys.stderr)
        return 2
    return _serve(arguments, arguments.station or (names[0] if names else ""), tiles)


def _serve(arguments: argparse.Namespace, station: str, tiles: TileSource | None) -> int:
    # optional packages are imported here, after all checks
    from gcs_module.panel.page import build
    from gcs_module.watch.serving import Served

    if station not in running():
        print(
            f"handover panel: {station or 'no station'} does not run here yet. The page waits for it.",
            file=sys.stderr,
            flush=True,
        )
        for line in foreign():
            print(f"handover panel: not looked for in {line}", file=sys.stderr, flush=True)
    if not is_loopback(arguments.host):
        print(
            "handover panel: other computers can reach this page, and the connection is not encrypted: use a network "
            "of your own, or ssh.",
            file=sys.stderr,
            flush=True,
        )
    session = Session(station)
    try:
        served = Served(arguments.host, arguments.port)
    except SystemExit:  # uvicorn has said why
        return 2
    key = new_key()
    auth = PanelAuth(build(session, session.begin, session.end, key, tiles), served.host, served.port, key)

    def print_link() -> None:
        print(f"{served.address}?token={auth.new_link()}", flush=True)

    print_link()
    if sys.stdin is not None and sys.stdin.isatty():
        print("The link works once. Press Enter for another one, for another browser.", flush=True)
        threading.Thread(target=_links, args=(print_link,), daemon=True).start()
    served.run(auth)
    return 0


def _links(print_link: Callable[[], None]) -> None:
    """Print a new link for each line of the terminal."""
    for _line in sys.stdin:
        print_link()
