# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover keys`: makes, lists, rotates and checks the stations' signing keys. It never shows a key.

A passphrase is shown once, when it is made, to be typed into the ground station program; it is stored nowhere.
"""

from __future__ import annotations

import argparse
import getpass
import json
import sys
from collections.abc import Callable, Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, Final

from mavproxy_handover.cli.key_bundle import make_bundle
from mavproxy_handover.config.files import ConfigError
from mavproxy_handover.store.keys import (
    KeysError,
    StationKeys,
    check_distinct,
    key_of,
    key_path,
    load_station_keys,
    make_passphrase,
    previous_path,
    retire_key,
    rotate_key,
    write_key,
)
from mavproxy_handover.tools.command_line import CommandParser
from mavproxy_handover.wire.signing import fingerprint

__all__ = ["GROUND", "GUARD", "main", "show_key", "typing_help"]

#: keys that belong to no station: of the ground link, and of the leases to the guard
GROUND, GUARD = "ground", "guard"

_TYPING = """\
Type the passphrase into the program of the station; it is shown this once and stored nowhere:
  MAVProxy           signing key PASSPHRASE  (at each start, or in ~/.mavproxy/mavinit.scr, mode 0600)
  Mission Planner    Setup, Advanced, Mavlink Signing: Add
  QGroundControl     its MAVLink signing key. Versions that ask for a name, and offer a raw hex key, make another key
                     of a passphrase: give them the 64 digits in the key file as the raw hex key instead
For 'handover station' copy the key file to the station's computer, or type the passphrase there:
  handover keys {word} {name} --passphrase-stdin
The same fingerprint at both ends is the same key."""

_ROTATING = """\
No station is cut off: a running companion has its keys in memory, and a new one accepts both keys.
  1. On the ground: restart the companion ('module reload handover'). Then it accepts both keys.
  2. Give the new key to every program of {name}. The companion answers each with the key that it uses.
  3. When all are heard: handover keys retire {name}; restart the companion. Then the old key is invalid.
If another person may have the old key, do all three before the next flight. Until step 3 the gate accepts it."""


_BUNDLED: Final = """\
It has secret keys in it: bring it by a way that no other person can read, then delete the copies. At the station:
  tar xzf {archive} && cd {name}
  handover station --config {config}"""

_CODES: Final = {0: "done", 1: "a key cannot be used", 2: "wrong usage: nothing was done"}
_EXAMPLES: Final = {
    "make": (("handover keys make GCSA GCSB", "a key for each of two stations, shown once as a passphrase"),),
    "list": (("handover keys list", "the keys in ./keys, with their fingerprints"),),
    "rotate": (("handover keys rotate GCSB", "a new key; the old one is accepted until it is retired"),),
    "retire": (("handover keys retire GCSB", "the old key is not accepted any more"),),
    "bundle": (
        ("handover keys bundle GCSA", "GCSA-bundle.tar.gz, of ./GCSA.toml and the keys that it names"),
        ("handover keys bundle GCSA --config stations/GCSA.toml --out GCSA.tar.gz", "of another folder"),
    ),
    "check": (("handover keys check --dir /etc/handover/keys", "whether every key of this machine can be used"),),
}


def main(argv: Sequence[str]) -> int:
    """Run `handover keys`. 0: done; 1: a key cannot be used (list, check); 2: wrong usage, or nothing was done."""
    parser = CommandParser(
        prog="handover keys",
        description="Signing keys: one file for each station.",
        examples=(
            ("handover keys make GCSA GCSB", "a key for each of two stations, shown once as a passphrase"),
            ("handover keys check --dir /etc/handover/keys", "whether every key of this machine can be used"),
            ("handover keys rotate GCSB", "the first step to another key for GCSB; it prints the other ones"),
        ),
        codes=_CODES,
    )
    parser.set_defaults(run=None)
    commands = parser.add_subparsers(metavar="COMMAND")

    def command(word: str, run: Callable[[argparse.Namespace], int], text: str) -> argparse.ArgumentParser:
        added: argparse.ArgumentParser = commands.add_parser(
            word, help=text, description=text, examples=_EXAMPLES[word], codes=_CODES
        )
        added.add_argument("--dir", type=Path, default=Path("keys"), help="folder of the key files (default: ./keys)")
        added.set_defaults(run=run)
        return added

    make = command("make", _make, "make a key for each station named, and show its passphrase once")
    make.add_argument("names", metavar="NAME", nargs="+", help="station, as in the configuration")
    listing = command("list", _list, "list the keys by name, fingerprint and date")
    rotate = command("rotate", _rotate, "make a new key for a station; the old one is accepted until it is retired")
    rotate.add_argument("name", metavar="NAME", help="station, as in the configuration")
    retire = command("retire", _retire, "end a rotation: remove the old key")
    retire.add_argument("name", metavar="NAME", help="the station whose key was rotated")
    check = command("check", _check, "check that every key can be used: mode, owner, content, no two alike")
    bundle = command("bundle", _bundle, "one archive with what one station needs, and no other station's key")
    bundle.add_argument("name", metavar="NAME", help="station, as in the configuration")
    bundle.add_argument("--config", type=Path, help="the station's configuration (default: ./NAME.toml)")
    bundle.add_argument("--out", type=Path, help="the archive (default: ./NAME-bundle.tar.gz)")
    for one in (make, rotate):
        one.add_argument("--passphrase-stdin", action="store_true", help="read the passphrase from standard input")
    for one in (listing, check):
        one.set_defaults(names=None)
        one.add_argument("--json", action="store_true", help="for programs: the keys, and what is wrong")
    try:
        arguments = parser.parse_args(argv)
        if arguments.run is None:
            parser.error("what is to be done? make, list, rotate, retire, check or bundle")
    except SystemExit as stop:
        return int(stop.code or 0)
    try:
        code: int = arguments.run(arguments)
    except (KeysError, ConfigError) as error:
        print(f"handover keys: {error}", file=sys.stderr)
        return 2
    return code


def _make(arguments: argparse.Namespace) -> int:
    names: list[str] = arguments.names
    folder: Path = arguments.dir
    if len(set(names)) != len(names):
        raise KeysError("a station is named twice")
    if arguments.passphrase_stdin and len(names) != 1:
        raise KeysError("--passphrase-stdin takes one NAME: no two stations may have the same key")
    paths = {name: key_path(folder, name) for name in names}
    for path in paths.values():  # make all or none
        if path.exists():
            raise KeysError(f"{path}: exists already; 'handover keys rotate' replaces a key. Nothing was made")
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        raise KeysError(f"{folder}: {error.strerror}") from None
    for name, path in paths.items():
        passphrase, key = _new_key(arguments)
        _refuse_shared(folder, name, key)
        write_key(path, key)
        show_key(name, path, key, passphrase)
    if not arguments.passphrase_stdin:
        _make_ground(folder, names)
        print("\n" + typing_help("make", names[0] if len(names) == 1 else "NAME"))
    return 0


def _bundle(arguments: argparse.Namespace) -> int:
    name: str = arguments.name
    key_path(Path(), name)  # a name that can be a file's
    config = arguments.config or Path(f"{name}.toml")
    out = arguments.out or Path(f"{name}-bundle.tar.gz")
    try:
        entries = make_bundle(name, config, out)
    except OSError as error:
        raise KeysError(f"{error.filename or out}: {error.strerror}. Nothing was written") from None
    print(f"{out} written, readable by you alone:")
    for entry in entries:
        print(f"  {entry.name}")
    print(_BUNDLED.format(name=name, archive=out.name, config=Path(entries[0].name).name))
    return 0


def _make_ground(folder: Path, names: list[str]) -> None:
    """Make the key of the ground link, one for all stations, together with the first station's key."""
    path = key_path(folder, GROUND)
    if path.exists() or not set(names) - {GROUND, GUARD}:
        return
    passphrase = make_passphrase()
    key = key_of(passphrase)
    write_key(path, key)
    show_key(GROUND, path, key, passphrase)


def _rotate(arguments: argparse.Namespace) -> int:
    path = key_path(arguments.dir, arguments.name)
    load_station_keys(path)  # a key that cannot be rotated is refused before a passphrase is shown or asked for
    passphrase, key = _new_key(arguments)
    _refuse_shared(arguments.dir, arguments.name, key)
    rotate_key(path, key)
    show_key(arguments.name, path, key, passphrase)
    print(f"  the old key is kept as {previous_path(path).name}\n\n{_ROTATING.format(name=arguments.name)}")
    if not arguments.passphrase_stdin:
        print("\n" + typing_help("rotate", arguments.name))
    return 0


def _retire(arguments: argparse.Namespace) -> int:
    path = key_path(arguments.dir, arguments.name)
    retire_key(path)
    print(f"{arguments.name}: the old key is gone; a running companion accepts it until it is restarted")
    return 0


def _list(arguments: argparse.Namespace) -> int:
    return _survey(arguments.dir, show=True, as_json=arguments.json)


def _check(arguments: argparse.Namespace) -> int:
    return _survey(arguments.dir, show=False, as_json=arguments.json)


def _survey(folder: Path, *, show: bool, as_json: bool) -> int:
    """Check all keys of a folder and print their faults; with `show` or as JSON print the keys too."""
    problems = []
    listed: list[dict[str, Any]] = []
    good: dict[str, StationKeys] = {}
    paths = _key_files(folder)
    for path in paths:
        try:
            key_path(folder, path.stem)
            station = load_station_keys(path)
        except KeysError as error:
            problems.append(str(error))
            continue
        good[path.stem] = station
        made = datetime.fromtimestamp(path.stat().st_mtime, timezone.utc)
        previous = None if station.previous is None else fingerprint(station.previous)
        listed.append(
            {
                "name": path.stem,
                "fingerprint": fingerprint(station.current),
                "made_utc": made.isoformat(timespec="seconds"),
                "old_fingerprint": previous,
            }
        )
        if show and not as_json:
            old = "" if previous is None else f"  rotation under way, old key {previous}"
            print(f"{path.stem:20} {fingerprint(station.current)}  {made:%Y-%m-%d %H:%M} UTC{old}")
    try:
        check_distinct(good)
    except KeysError as error:
        problems.append(f"{folder}: {error}")
    if as_json:
        print(json.dumps({"keys": listed, "problems": problems}, indent=1))
        return 1 if problems else 0
    for problem in problems:
        print(f"handover keys: {problem}", file=sys.stderr)
    if not problems and not show:
        print(f"{folder}: {len(paths)} key{'' if len(paths) == 1 else 's'}, all good")
    return 1 if problems else 0


def _key_files(folder: Path) -> list[Path]:
    try:
        paths = sorted(path for path in folder.iterdir() if path.suffix == ".key" and not path.name.startswith("."))
    except OSError as error:
        raise KeysError(f"{folder}: {error.strerror}; 'handover keys make NAME' makes it") from None
    if not paths:
        raise KeysError(f"{folder}: no key in it")
    return paths


def _new_key(arguments: argparse.Namespace) -> tuple[str | None, bytes]:
    """A new passphrase and its key. If the passphrase was typed, only the key."""
    if not arguments.passphrase_stdin:
        passphrase = make_passphrase()
        return passphrase, key_of(passphrase)
    try:
        typed = getpass.getpass("Passphrase: ") if sys.stdin.isatty() else sys.stdin.readline()
    except UnicodeDecodeError:
        raise KeysError("the passphrase must be ASCII") from None
    return None, key_of(typed.rstrip("\r\n"))


def _refuse_shared(folder: Path, name: str, key: bytes) -> None:
    """Refuse a key that another station in the folder has."""
    good = {}
    for path in folder.glob("*.key"):
        try:
            if path.stem != name:
                good[path.stem] = load_station_keys(path)
        except KeysError:  # `check` reports it
            continue
    check_distinct({**good, name: StationKeys(key)})


def show_key(name: str, path: Path, key: bytes, passphrase: str | None) -> None:
    """Print that a key was written, with its passphrase if it was made here, and never the key itself."""
    print(f"{name}: {path} written, fingerprint {fingerprint(key)}")
    if passphrase is not None:
        print(f"  passphrase  {passphrase}")
        if name == GROUND:
            print("  one for all stations: it signs what they tell each other over the ground link")


def typing_help(word: str, name: str) -> str:
    """Text about where to type a passphrase, for the command `word` (make, rotate) and the station `name`."""
    return _TYPING.format(word=word, name=name)
