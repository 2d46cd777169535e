# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover watch`: serves the page until it is stopped."""

from __future__ import annotations

import argparse
import secrets
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlsplit

from gcs_module.watch.follow import journals_in
from gcs_module.watch.missions import read
from gcs_module.watch.page_arguments import add_address
from gcs_module.watch.passive_link import parse_passive_link
from gcs_module.watch.tiles import TilesError, TileSource, open_tiles
from gcs_module.watch.web_auth import WebAuth, is_loopback
from mavproxy_handover.link.forms import LinkError
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.tools.command_line import CommandParser

__all__ = ["main"]

_PORT: Final = 8090
#: the ending of a journal's name
_JOURNAL: Final = ".jsonl"
#: fewest characters of a token from a file
_TOKEN: Final = 16


class _Wrong(Exception):
    """An argument that cannot be used. The message is one line."""


def main(argv: Sequence[str]) -> int:
    """0: it was stopped; 2: wrong usage, or an argument that cannot be used."""
    parser = CommandParser(
        prog="handover watch",
        examples=(
            ("handover watch flights", "the flights of this machine, while they are written"),
            ("handover watch --link udpin:127.0.0.1:14560 --mission missions/delivery", "from a MAVLink link"),
        ),
        codes={0: "ended by Ctrl-C", 2: "wrong usage, or the page cannot be served"},
        description="Serve a page for those who watch: all aircraft and stations on a map, from journals while they "
        "are written, or from a MAVLink link. It only listens: nothing is ever sent to an aircraft or a station.",
    )
    parser.add_argument("path", nargs="*", type=Path, metavar="PATH", help="a journal, or a folder with journals")
    parser.add_argument(
        "--link",
        action="append",
        default=[],
        metavar="DEVICE",
        help="udpin:HOST:PORT or tcp:HOST:PORT; several may be given",
    )
    parser.add_argument(
        "--mission",
        action="append",
        default=[],
        type=Path,
        metavar="DIR",
        help="zones and route, where no journal has them",
    )
    add_address(parser, "--bind", _PORT)
    parser.add_argument("--token-file", type=Path, metavar="FILE", help="the token that viewers need; else one is made")
    parser.add_argument(
        "--tiles",
        default="",
        metavar="TILES",
        help="map tiles: an MBTiles file, a folder with z/x/y.png, or https://HOST/{z}/{x}/{y}.png (none)",
    )
    parser.add_argument("--tiles-credit", default="", metavar="TEXT", help="whose they are")
    try:
        arguments = parser.parse_args(argv)
    except SystemExit as stop:
        return int(stop.code or 0)
    try:
        return _serve(arguments)
    except _Wrong as error:
        print(f"handover watch: {error}", file=sys.stderr)
        return 2


def _serve(arguments: argparse.Namespace) -> int:
    if not arguments.path and not arguments.link:
        raise _Wrong("nothing to watch: name a journal, a folder with journals, or --link DEVICE")
    for path in arguments.path:
        if not path.exists():
            raise _Wrong(f"{path}: no such file or folder")
        if path.is_file() and path.suffix != _JOURNAL:
            raise _Wrong(f"{path}: not a journal (*{_JOURNAL}). 'handover report {path}' shows logs after a flight.")
    try:
        devices = [parse_passive_link(text) for text in arguments.link]
        missions = [read(folder) for folder in arguments.mission]
    except (LinkError, MissionError) as error:
        raise _Wrong(str(error)) from None
    token, (tiles, source) = _token(arguments), _tiles(arguments)

    # optional packages are imported here, after all checks
    from gcs_module.watch.follow import Follower
    from gcs_module.watch.page import build
    from gcs_module.watch.serving import Served

    for path in arguments.path:
        if not journals_in(path):
            print(f"handover watch: {path}: no journal in it yet. The page waits for one.", file=sys.stderr, flush=True)
    try:
        follower = Follower(arguments.path, devices, missions)
    except LinkError as error:
        raise _Wrong(str(error)) from None
    application = build(follower, tiles, follower.begin, follower.end, source)
    origin = (
        ""
        if tiles is None or source is not None
        else "{0.scheme}://{0.netloc}".format(urlsplit(tiles["url"].replace("{s}", "*")))
    )
    try:
        served = Served(arguments.bind, arguments.port)
    except SystemExit:  # uvicorn has said why
        return 2
    print(served.address + (f"?token={token}" if token else ""), flush=True)
    served.run(WebAuth(application, token, origin))
    return 0


def _token(arguments: argparse.Namespace) -> str | None:
    """None: only this computer can reach the page. Raises _Wrong."""
    if arguments.token_file is None:
        return None if is_loopback(arguments.bind) else secrets.token_urlsafe(24)
    try:
        text = arguments.token_file.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise _Wrong(f"{arguments.token_file}: {getattr(error, 'strerror', None) or 'cannot be read'}") from None
    plain = text.isascii() and all(letter.isalnum() or letter in "-_" for letter in text)
    if len(text) < _TOKEN or not plain:
        raise _Wrong(
            f"{arguments.token_file}: a token has {_TOKEN} or more letters, digits, '-', '_', and nothing else"
        )
    return str(text)


def _tiles(arguments: argparse.Namespace) -> tuple[Mapping[str, Any] | None, TileSource | None]:
    """The values for the browser, and the tiles if they are on the disk. Raises _Wrong."""
    url = arguments.tiles
    if not url:
        return None, None
    if "://" not in url:
        try:
            source = open_tiles(Path(url), arguments.tiles_credit)
        except TilesError as error:
            raise _Wrong(f"--tiles {error}; or an address as https://HOST/{{z}}/{{x}}/{{y}}.png") from None
        return source.drawn(), source
    parts = urlsplit(url)
    if (
        parts.scheme not in ("http", "https")
        or not parts.netloc
        or not all(each in url for each in ("{z}", "{x}", "{y}"))
    ):
        raise _Wrong(f"--tiles {url}: must be an address as https://HOST/{{z}}/{{x}}/{{y}}.png")
    return {"url": url, "credit": arguments.tiles_credit}, None
