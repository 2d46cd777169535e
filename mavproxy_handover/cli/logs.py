# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover logs`: lists the folders of flights, and deletes old ones."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Final

from mavproxy_handover.store.flights import Flight, Room, delete, flights, to_go
from mavproxy_handover.tools.command_line import CommandParser

__all__ = ["main"]

_HEAD: Final = ("begun (UTC)", "who", "lasted", "size", "folder")
_MB: Final = 1e6


def main(argv: Sequence[str]) -> int:
    """Run `handover logs`. 0: done; 1: a folder could not be deleted; 2: wrong usage, no such folder."""
    parser = CommandParser(
        prog="handover logs",
        examples=(
            ("handover logs", "the flights on this machine, the oldest first"),
            ("handover logs prune --keep-days 30 --dry-run", "what would be deleted"),
            ("handover logs prune --keep-free 5", "the oldest go until 5 GB of the disk are free"),
        ),
        codes={0: "done", 1: "a folder could not be deleted", 2: "wrong usage, or no such folder"},
        description="List the folders of flights, the oldest first; with `prune`, delete what is older or more than is "
        "kept. A flight that goes on is never touched.",
    )
    parser.add_argument("what", nargs="?", choices=("list", "prune"), default="list", help="default: list")
    parser.add_argument("--logs", type=Path, default=Path("flights"), metavar="DIR", help="default: ./flights")
    parser.add_argument("--json", action="store_true", help="list: for programs")
    parser.add_argument("--keep-days", type=_number, default=90.0, metavar="D", help="prune: as long (90)")
    parser.add_argument("--keep-gb", type=_number, default=20.0, metavar="G", help="prune: and no more than that (20)")
    parser.add_argument("--keep-free", type=_number, default=0.0, metavar="G", help="prune: so many GB stay free (0)")
    parser.add_argument("--dry-run", action="store_true", help="prune: only say what would go")
    try:
        arguments = parser.parse_args(argv)
    except SystemExit as stop:
        return int(stop.code or 0)
    try:
        found = flights(arguments.logs)
    except OSError as error:
        print(f"handover logs: {error.filename}: {error.strerror}", file=sys.stderr)
        return 2
    if arguments.what == "prune":
        room = Room(arguments.keep_free * 1e9, shutil.disk_usage(arguments.logs).free)
        gone = to_go(found, datetime.now(timezone.utc), arguments.keep_days, arguments.keep_gb * 1e9, room)
        return _prune(gone, dry=arguments.dry_run)
    _list(found, as_json=arguments.json)
    return 0


def _number(text: str) -> float:
    """Raises ValueError, as argparse wants it."""
    value = float(text)
    if not 0.0 <= value <= 1e6:
        raise ValueError(text)
    return value


def _list(found: Sequence[Flight], *, as_json: bool) -> None:
    if as_json:
        print(json.dumps([_as_json(flight) for flight in found], indent=1))
        return
    rows = [_HEAD, *(_row(flight) for flight in found)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(_HEAD))]
    for row in rows:
        print("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())


def _row(flight: Flight) -> tuple[str, ...]:
    seconds = max(0, int((flight.ended - flight.begun).total_seconds()))
    lasted = "goes on" if flight.held else f"{seconds // 3600}:{seconds // 60 % 60:02}:{seconds % 60:02}"
    return f"{flight.begun:%Y-%m-%d %H:%M:%S}", flight.who, lasted, f"{flight.size / _MB:.1f} MB", str(flight.path)


def _as_json(flight: Flight) -> dict[str, object]:
    return {
        "path": str(flight.path),
        "who": flight.who,
        "begun_utc": flight.begun.isoformat(),
        "ended_utc": flight.ended.isoformat(timespec="seconds"),
        "bytes": flight.size,
        "goes_on": flight.held,
    }


def _prune(gone: Sequence[Flight], *, dry: bool) -> int:
    code = 0
    for flight in gone:
        try:
            if not dry:
                delete(flight)
        except OSError as error:
            print(f"handover logs: {error.filename}: {error.strerror}", file=sys.stderr)
            code = 1
            continue
        print(f"{'would go' if dry else 'deleted'}  {flight.path}  ({flight.size / _MB:.1f} MB)")
    return code
