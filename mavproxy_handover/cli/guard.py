# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover guard CARD`: copies the guard to the autopilot's SD card, and checks the other files there.

Rules that live here:

1. Everything is checked before anything is written. Each file is written completely or not at all, and read back.
2. A file that differs from the new one stays, unless `--force` is given.
3. All scripts in `APM/scripts` run in one thread with one MAVLink receive queue. So some scripts disturb the guard: a
   second copy of it, one that takes messages from the queue, uses the guard's parameter table, or uses up the arming
   authorisations. They are recognised by their calls; `--force` overrides that.
4. No printed line contains a key; a fingerprint names it.
5. The script is the same for every kind of vehicle that it knows; its recommended parameters differ.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mavproxy_handover.store.durable import discard, sync_folder
from mavproxy_handover.store.keys import KeysError, load_key
from mavproxy_handover.tools.command_line import CommandParser
from mavproxy_handover.tools.resources import shipped
from mavproxy_handover.vehicle.profiles import ASSUMED, PROFILES
from mavproxy_handover.wire.signing import fingerprint

__all__ = ["Finding", "main", "survey", "version_of"]

_SCRIPT, _KEY = "handover_guard.lua", "handover.key"
#: kind of vehicle -> its recommended parameters; the script is the same
_PARAMETERS = {profile.name: profile.parameter_file for profile in PROFILES if profile.refines is None}
#: ArduPilot's folder of scripts, from the root of the card
_FOLDER = Path("APM", "scripts")
_MAX_SCRIPT_BYTES = 1_000_000
_TABLE_KEY = 147
_AUTHORISERS = 3

_VERSION = re.compile(rb"""VERSION = ["']([\w.+-]{1,20})["']""")
_OURS = re.compile(rb"""["']HNDO_["']""")
_COMMENTS = re.compile(rb"--\[(=*)\[.*?\]\1\]|--[^\n]*", re.DOTALL)
_RECEIVES = re.compile(rb"\b(?:mavlink\s*[.:]\s*(?:init|receive_chan|register_rx_msgid)|mavport)\b")
_TABLE = re.compile(rb"\b(?:add_table\s*\(|PARAM_TABLE_KEY\s*=)\s*%d\b" % _TABLE_KEY)
_AUTHORISES = re.compile(rb"\barming\s*[.:]\s*get_aux_auth_id\b")


@dataclass(frozen=True, slots=True)
class Finding:
    """A finding on the card. `stops`: nothing is written because of it, unless forced."""

    path: Path
    text: str
    stops: bool


class _Unusable(Exception):
    """The card or the key cannot be used; one line."""


def main(argv: Sequence[str]) -> int:
    """Run `handover guard`. 0: all is in place; 1: something on the card stands in the way; 2: wrong usage or input."""
    parser = CommandParser(
        prog="handover guard",
        examples=(
            ("handover guard /media/card", "copy the guard and the parameters of a copter to the card"),
            ("handover guard /media/card --check", "what is missing on the card; nothing is written"),
        ),
        codes={
            0: "all is in place",
            1: "something is missing, or another file on the card does not allow it",
            2: "wrong usage, or the card cannot be used",
        },
        description="Copy the guard, its parameters and optionally the key of the leases to an autopilot's SD card. "
        "Check the other files there.",
    )
    parser.add_argument("card", type=Path, help="root of the SD card: the folder that holds APM")
    parser.add_argument(
        "--vehicle",
        choices=tuple(_PARAMETERS),
        default=ASSUMED.name,
        help="whose parameters: copter (default), or plane for ArduPlane, QuadPlanes included",
    )
    parser.add_argument("--key", type=Path, metavar="FILE", help="guard_key of the vehicle's configuration")
    parser.add_argument("--check", action="store_true", help="look only, write nothing; 1 if something is missing")
    parser.add_argument("--force", action="store_true", help="replace files that differ, and mind no other script")
    parser.add_argument("--json", action="store_true", help="for programs: what is wrong, missing, written")
    try:
        arguments = parser.parse_args(argv)
    except SystemExit as stop:
        return int(stop.code or 0)
    try:
        return _run(arguments)
    except (_Unusable, KeysError) as error:
        print(f"handover guard: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"handover guard: {error.filename}: {error.strerror}", file=sys.stderr)
        return 2


def _run(arguments: argparse.Namespace) -> int:
    card: Path = arguments.card
    _check_root(card, force=arguments.force)
    wanted = _wanted(arguments.vehicle, arguments.key)
    findings = survey(card, wanted)
    missing = [name for name, data in wanted.items() if _read(card / _FOLDER / name) != data]
    stops = any(finding.stops for finding in findings)
    writes = not arguments.check and (not stops or arguments.force)
    if writes:
        for name in missing:
            _place(card / _FOLDER / name, wanted[name])
    if arguments.json:
        print(json.dumps(_as_json(card, findings, missing, written=writes), indent=1))
    else:
        _tell(arguments, findings, {name: wanted[name] for name in missing}, writes=writes, stops=stops)
    return 0 if writes or not (missing or stops) else 1


def _as_json(card: Path, findings: list[Finding], missing: list[str], *, written: bool) -> dict[str, Any]:
    """`missing`: files that were not on the card, or differ. They are there now if they were `written`."""
    return {
        "findings": [{"path": str(each.path), "text": each.text, "stops": each.stops} for each in findings],
        "missing": [] if written else [str(card / _FOLDER / name) for name in missing],
        "written": [str(card / _FOLDER / name) for name in missing] if written else [],
    }


def _tell(
    arguments: argparse.Namespace, findings: list[Finding], missing: dict[str, bytes], *, writes: bool, stops: bool
) -> None:
    card: Path = arguments.card
    for finding in findings:
        print(f"{finding.path}: {finding.text}", file=sys.stderr if finding.stops else sys.stdout)
    if arguments.check:
        for name in missing:
            if not (card / _FOLDER / name).exists():
                print(f"{card / _FOLDER / name}: missing", file=sys.stderr)
        return
    if not writes:
        print("handover guard: nothing was written; put that right, or --force", file=sys.stderr)
        return
    for name, data in missing.items():
        print(f"{card / _FOLDER / name}: written{version_of(data)}")
    if not missing:
        print(f"{card}: nothing to write, all is there")
    _say_what_follows(card, arguments.vehicle, arguments.key)


def _wanted(vehicle: str, key_file: Path | None) -> dict[str, bytes]:
    """Name -> content of the files to be on the card."""
    folder = shipped("ardupilot_lua")
    wanted = {name: (folder / name).read_bytes() for name in (_SCRIPT, _PARAMETERS[vehicle])}
    if key_file is not None:
        wanted[_KEY] = load_key(key_file).hex().encode("ascii") + b"\n"
    return wanted


def _check_root(card: Path, *, force: bool) -> None:
    if not card.is_dir():
        raise _Unusable(f"{card}: {'is not a folder' if card.exists() else 'no such folder'}; is the card mounted?")
    for inner, up in ((card.resolve().parts[-2:], 2), (card.resolve().parts[-1:], 1)):
        if tuple(part.upper() for part in inner) in (("APM", "SCRIPTS"), ("APM",)):
            raise _Unusable(f"{card}: give the root of the card: {card.resolve().parents[up - 1]}")
    if not (card / "APM").is_dir() and not force:
        raise _Unusable(
            f"{card}: holds no folder APM, which the autopilot makes when it starts with the card; "
            "is this the right place? --force makes it"
        )
    present = card / _FOLDER
    while not present.exists():
        present = present.parent
    if not present.is_dir():
        raise _Unusable(f"{present}: is not a folder")
    if not os.access(present, os.W_OK | os.X_OK):
        raise _Unusable(f"{present}: cannot be written; is the card locked or mounted read-only?")


def survey(card: Path, wanted: dict[str, bytes]) -> list[Finding]:
    """Findings on the card. `wanted`: new files of `APM/scripts`. Raises OSError."""
    folder = card / _FOLDER
    findings = [_differing(folder / name, data) for name, data in wanted.items()]
    if _KEY not in wanted and (folder / _KEY).exists():
        text = "the guard takes leases with the right tag only: the companion needs guard_key"
        findings.append(Finding(folder / _KEY, text, False))
    for vehicle, name in _PARAMETERS.items():
        if name not in wanted and (folder / name).exists():
            findings.append(Finding(folder / name, f"is for a {vehicle}; --vehicle says for which this card is", False))
    for lost in (card / _SCRIPT, card / "APM" / _SCRIPT, folder / "modules" / _SCRIPT, card / "scripts" / _SCRIPT):
        if lost.exists():
            findings.append(Finding(lost, f"the autopilot does not run it there, but in {_FOLDER}", False))
    findings += _other_scripts(folder)
    return [finding for finding in findings if finding is not None]


def _differing(path: Path, data: bytes) -> Finding | None:
    present = _read(path)
    if present is None or present == data:
        return None
    if path.name == _KEY:
        return Finding(path, "is another key than the one given", True)
    if path.name in _PARAMETERS.values():
        return Finding(path, "differs from the one to be copied", True)
    return Finding(path, f"is another guard{version_of(present)}; this is{version_of(data) or ' of no version'}", True)


def _other_scripts(folder: Path) -> list[Finding | None]:
    findings: list[Finding | None] = []
    authorisers = 1
    paths = sorted(folder.iterdir()) if folder.is_dir() else []
    for path in paths:  # what ArduPilot runs as a script
        if path.name == _SCRIPT or path.name.startswith(".") or path.suffix.lower() != ".lua" or not path.is_file():
            continue
        code = _COMMENTS.sub(b"", _read(path) or b"")
        if _OURS.search(code):
            findings.append(Finding(path, "is a second guard: both would run; remove one", True))
        elif _RECEIVES.search(code):
            findings.append(Finding(path, "receives MAVLink: it would take leases away from the guard", True))
        elif _TABLE.search(code):
            findings.append(
                Finding(path, f"uses the guard's parameter table {_TABLE_KEY}: one of them will not run", True)
            )
        elif _AUTHORISES.search(code) and (authorisers := authorisers + 1) > _AUTHORISERS:
            findings.append(Finding(path, f"is arming authoriser number {authorisers}, {_AUTHORISERS} can be", True))
        else:
            findings.append(Finding(path, "runs in the same thread: if it is slow, so is the guard", False))
    return findings


def _read(path: Path) -> bytes | None:
    """Content of a file, None if there is none. Raises OSError."""
    try:
        with path.open("rb") as file:
            return file.read(_MAX_SCRIPT_BYTES)
    except FileNotFoundError:
        return None


def version_of(script: bytes) -> str:
    """A guard's version, to be printed after its name; "" if it has none."""
    found = _VERSION.search(script)
    return f", version {found[1].decode('ascii')}" if found else ""


def _place(path: Path, data: bytes) -> None:
    """Write a file completely, and read it back from the card itself.

    Meanwhile its name begins with a dot, so that it is not run. No mode is changed, because FAT refuses that.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o600)
        with os.fdopen(descriptor, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
            # so that it is read back from the card, not from memory
            os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)
        os.replace(temporary, path)
    except OSError:
        discard(temporary)
        raise
    sync_folder(path)
    if _read(path) != data:
        raise _Unusable(f"{path}: reads back otherwise than it was written; is the card worn out?")


def _say_what_follows(card: Path, vehicle: str, key_file: Path | None) -> None:
    if key_file is not None:
        print(f"key {fingerprint(load_key(key_file))}: guard_key of the vehicle's configuration must name the same")
    elif not (card / _FOLDER / _KEY).exists():
        print("no key: any program that can write to the companion's port of the autopilot can send a lease")
    print(
        f"next: unmount the card, start the autopilot, load {_PARAMETERS[vehicle]}, check HNDO_CHAN (handover_guard.md)"
    )
