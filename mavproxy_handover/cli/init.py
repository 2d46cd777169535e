# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover init`: writes a commented configuration to start from, or a mission (`init_mission.py`)."""

from __future__ import annotations

import argparse
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from mavproxy_handover.cli import init_mission
from mavproxy_handover.cli.keys import GROUND, show_key, typing_help
from mavproxy_handover.config.sample import station_sample, vehicle_sample
from mavproxy_handover.store.keys import KeysError, key_of, key_path, make_passphrase, write_key
from mavproxy_handover.tools.command_line import CommandParser
from mavproxy_handover.tools.resources import DEPLOY, shipped

__all__ = ["main"]

#: kind -> (usual name of the target, its purpose, what to type next)
_KINDS: Final = {
    "vehicle": (
        "handover.toml",
        "write the configuration of a vehicle's companion, with a comment on each key",
        "edit it, then: handover companion --master DEVICE",
    ),
    "station": (
        "station.toml",
        "write the configuration of a ground station, with a comment on each key",
        "edit it, then: handover station --master DEVICE",
    ),
    "demo": (
        "demo",
        "write a folder with a vehicle, two stations and the delivery mission, to fly by hand",
        "docs/by-hand.md tells what to start",
    ),
}
_CODES: Final = {0: "written", 2: "wrong usage, or the file exists: nothing was written"}
_EXAMPLES: Final = {
    "vehicle": (("handover init vehicle", "handover.toml here, with a comment on each key"),),
    "station": (("handover init station GCSA.toml", "the same for a station, in this file"),),
    "demo": (("handover init demo --with-passphrases", "the demo; its passphrases are shown this once"),),
}
_SAMPLES: Final = {"vehicle": vehicle_sample, "station": station_sample}


def main(argv: Sequence[str]) -> int:
    """Write what is asked for; never over something that exists."""
    parser = CommandParser(
        prog="handover init",
        examples=(
            (
                "handover init demo --with-passphrases",
                "a folder with a vehicle, two stations and the delivery mission; its passphrases are shown this once",
            ),
            ("handover init vehicle", "handover.toml here, with a comment on each key"),
            ("handover init station GCSA.toml", "the same for a station, in this file"),
            init_mission.EXAMPLES[0],
        ),
        codes=_CODES,
        description="Write a commented configuration: for a vehicle's companion, for a station, a folder with those of "
        "the delivery mission (one vehicle, two stations, all here), or a mission from a plan and zones.",
    )
    kinds = parser.add_subparsers(dest="kind", metavar="KIND", required=True)
    for kind, (usual, text, _following) in _KINDS.items():
        added = kinds.add_parser(kind, help=text, description=text, examples=_EXAMPLES[kind], codes=_CODES)
        added.add_argument("target", nargs="?", type=Path, help=f"what to write (default: ./{usual})")
        added.add_argument(
            "--with-passphrases",
            action="store_true",
            help="show the passphrases of its keys, this once, to be typed into other ground station programs"
            if kind == "demo"
            else argparse.SUPPRESS,
        )
    text = "write a mission package and all configurations from a plan and zones, and check them"
    init_mission.add_options(
        kinds.add_parser(
            "mission", help=text, description=text, examples=init_mission.EXAMPLES, codes=init_mission.CODES
        )
    )
    try:
        arguments = parser.parse_args(argv)
    except SystemExit as stop:
        return int(stop.code or 0)
    return init_mission.run(arguments) if arguments.kind == "mission" else _write_sample(arguments)


def _write_sample(arguments: argparse.Namespace) -> int:
    """Write a sample, or the demo. Returns the exit code."""
    usual, _text, following = _KINDS[arguments.kind]
    sample = _SAMPLES.get(arguments.kind)
    target: Path = arguments.target or Path(usual)
    if arguments.with_passphrases and sample is not None:
        others = "'handover keys make NAME' is for the others"
        print(f"handover init: --with-passphrases goes with 'demo'; {others}", file=sys.stderr)
        return 2
    passphrases: dict[str, str] = {}
    try:
        if target.exists():
            raise FileExistsError
        if sample is None:
            passphrases = _write_demo(target)
        else:
            target.write_text(sample(), encoding="utf-8")
    except FileExistsError:
        print(f"handover init: {target} exists already: nothing written", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"handover init: {target}: {error.strerror}", file=sys.stderr)
        return 2
    except KeysError as error:
        print(f"handover init: {error}", file=sys.stderr)
        return 2
    if arguments.with_passphrases:
        for name, passphrase in passphrases.items():
            show_key(name, key_path(target / "keys", name), key_of(passphrase), passphrase)
        print("\n" + typing_help("make", "NAME") + "\n")
    print(f"{target} written; {following}")
    return 0


def _write_demo(target: Path) -> dict[str, str]:
    """Everything that a flight by hand needs, in one folder that MAVProxy and both vehicles can be started in.

    Returns the passphrases that its keys are made of, by name; they are nowhere else. Raises OSError, KeysError.
    """
    guard = shipped("ardupilot_lua")
    shutil.copytree(DEPLOY / "demo", target)
    shutil.copytree(shipped("missions") / "delivery", target / "delivery")
    (target / "keys").mkdir(mode=0o700)
    passphrases = {name: make_passphrase() for name in ("GCSA", "GCSB", GROUND)}
    for name, passphrase in passphrases.items():
        write_key(key_path(target / "keys", name), key_of(passphrase))
    (target / "scripts").mkdir()
    shutil.copy(guard / "handover_guard.lua", target / "scripts")
    shutil.copy(guard / "handover.parm", target)
    return passphrases
