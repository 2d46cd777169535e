# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover install companion|station` and `handover uninstall`: the service that runs it on this computer.

A table names the files (`machine.py`). Rules that live here:

* A file that was changed by hand is not overwritten and not deleted without --force. The digests of written files are
  in a list beside the configuration. Only root may write that list, because root deletes by it.
* Configuration and keys are written only if there are none, and never removed, except by `uninstall --purge`.
* The service writes below one folder. Journal and state that the configuration names relative to itself are put there.
* If the service could not read or write something, the installation is refused before anything is written.
* With --root nothing of this machine is changed or queried: the files are below that folder, and no program is run.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Final

from mavproxy_handover.cli.keyfiles import keyfile
from mavproxy_handover.cli.machine import CONFIGURATION, KEYS, STATE, Item, below, files, uplink
from mavproxy_handover.config.files import ConfigError, StationConfig, VehicleConfig, load_station, load_vehicle
from mavproxy_handover.config.sample import station_sample, vehicle_sample
from mavproxy_handover.link.forms import Kind, parse_device
from mavproxy_handover.store.durable import discard
from mavproxy_handover.store.keys import KeysError, load_key
from mavproxy_handover.tools.command_line import CommandParser

__all__ = ["install", "uninstall"]

#: this machine
_HERE: Final = Path("/")
_MANIFEST: Final = KEYS.parent / "installed.json"
_SAMPLES: Final = {"companion": vehicle_sample, "station": station_sample}
#: folders that the service cannot see: ProtectHome=, PrivateTmp=
_HIDDEN: Final = ("/home", "/root", "/run/user", "/tmp", "/var/tmp")
#: the line of a key that names a place relative to the file
_RELATIVE: Final = re.compile(
    r"""^(?P<key>[ \t]*(?P<name>journal|state)[ \t]*=[ \t]*)(["'])(?!/)(?P<path>[^"'\\\n]+)\3""", re.M
)
#: commands to run after a change of the files; missing programs are reported
_RELOAD: Final = (("udevadm", "control", "--reload"), ("systemctl", "daemon-reload"))
_AFTER: Final = (
    ("systemd-sysusers", "/etc/sysusers.d/handover.conf"),
    ("systemd-tmpfiles", "--create", "/etc/tmpfiles.d/handover.conf"),
    *_RELOAD,
    # gives an existing line its name and its user now
    ("udevadm", "trigger", "--subsystem-match=tty", "--action=change"),
)
_CONNECTIONS: Final = (("nmcli", "connection", "reload"),)
#: NetworkManager: while it runs; where an image has it
_RUNS, _PROGRAM = PurePosixPath("/run/NetworkManager"), PurePosixPath("/usr/sbin/NetworkManager")
_Config = VehicleConfig | StationConfig


class _Refused(Exception):
    """A refusal, one line for people. Nothing, or nothing more, is done."""


def install(argv: Sequence[str]) -> int:
    """`handover install`; 0: installed, 1: something is in the way, 2: wrong usage or bad input."""
    parser = _parser(
        "install",
        "Let systemd run the companion, or a station without a terminal. Installs a unit with a watchdog and few "
        "rights, a user, /etc/handover, both uplinks, and a name for the autopilot.",
    )
    parser.add_argument(
        "--device", help="companion: the autopilot's line; station: the link, if no [[vehicle]] names it"
    )
    parser.add_argument(
        "--config",
        type=Path,
        help="a configuration, its keys in keys/ beside it (default: a sample); where it names journal and state "
        f"relative to itself, they lie below {STATE}",
    )
    parser.add_argument("--program", help="the command handover (default: of this installation)")
    parser.add_argument("--wifi", metavar="IF[=ADDR/BITS[,GW]]", help="interface with a routing table of its own")
    parser.add_argument("--lte", metavar="IF[=ADDR/BITS[,GW]]", help="the same for the modem")
    parser.add_argument("--ssid", metavar="NAME", help="the Wi-Fi network, where NetworkManager runs")
    parser.add_argument(
        "--network",
        choices=("auto", "networkd", "networkmanager"),
        default="auto",
        help="which program has the interfaces (auto: NetworkManager where it is, else networkd)",
    )
    parser.add_argument("--print", action="store_true", help="print what would be written, and end")
    return _run(parser, argv, _install, changes=lambda arguments: not arguments.print)


def uninstall(argv: Sequence[str]) -> int:
    """`handover uninstall`: removes what `install` wrote."""
    parser = _parser("uninstall", "Take back what `handover install` wrote; logs, state, configuration and keys stay.")
    parser.add_argument("--purge", action="store_true", help="configuration, keys, logs and state as well")
    return _run(parser, argv, _uninstall)


_CODES: Final = {0: "done", 1: "not allowed here, or a file cannot be written", 2: "wrong usage: nothing was done"}
_EXAMPLES: Final = {
    "install": (
        ("sudo handover install companion --device /dev/ttyTHS1,921600 --config handover.toml", "on an aircraft"),
        ("handover install station --device udpin:0.0.0.0:14550 --print", "what would be written, and nothing more"),
    ),
    "uninstall": (
        ("sudo handover uninstall companion", "what install wrote goes; logs, configuration and keys stay"),
        ("sudo handover uninstall companion --purge", "these go as well"),
    ),
}


def _parser(word: str, description: str) -> argparse.ArgumentParser:
    parser = CommandParser(prog=f"handover {word}", description=description, examples=_EXAMPLES[word], codes=_CODES)
    parser.add_argument("kind", choices=list(CONFIGURATION), help="what this machine is")
    parser.add_argument("--root", type=Path, help="write below this folder, and run nothing")
    parser.add_argument("--force", action="store_true", help="also files that were changed since")
    return parser


def _run(
    parser: argparse.ArgumentParser,
    argv: Sequence[str],
    job: Callable[[argparse.Namespace, Path], None],
    changes: Callable[[argparse.Namespace], bool] = lambda _arguments: True,
) -> int:
    try:
        arguments = parser.parse_args(argv)
    except SystemExit as stop:
        return int(stop.code or 0)
    try:
        if arguments.root is None and changes(arguments) and os.geteuid() != 0:
            words = ["sudo", str(_own_program()), *parser.prog.split()[1:], *argv]
            raise _Refused(f"only root may do that here: {shlex.join(words)}")
        job(arguments, _HERE if arguments.root is None else arguments.root)
    except (ConfigError, KeysError) as error:
        print(f"{parser.prog}: {error}", file=sys.stderr)
        return 2
    except _Refused as error:
        print(f"{parser.prog}: {error}", file=sys.stderr)
        return 1
    except OSError as error:
        print(f"{parser.prog}: {error.filename}: {error.strerror}", file=sys.stderr)
        return 1
    return 0


def _own_program() -> Path:
    """The command `handover` of this installation."""
    return Path(sys.prefix) / "bin" / "handover"


# ---- install --------------------------------------------------------------------------------------------------------


def _install(arguments: argparse.Namespace, root: Path) -> None:
    kind: str = arguments.kind
    if kind == "companion" and arguments.device is None:
        raise ConfigError("--device is missing: the autopilot's line, e.g. /dev/ttyTHS1,921600")
    program = arguments.program or str(_own_program())
    if not re.fullmatch(r"/[\w./+-]+", program, re.ASCII):
        raise ConfigError(f"--program {program!r} must be an absolute path without spaces")
    ways = tuple(
        uplink(role, text) for role, text in (("wifi", arguments.wifi), ("lte", arguments.lte)) if text is not None
    )
    configuration, lines = _configuration(kind, arguments.config, root, force=arguments.force)
    managed = bool(ways) and _has_network_manager(arguments.network, root)
    networks = [keyfile(way, arguments.ssid) for way in ways] if managed else []
    found = [*files(kind, program, arguments.device, () if managed else ways, lines), *networks, *configuration]
    if arguments.print:
        for item in found:
            print(f"# {item.path}  (mode {item.mode:04o}{', if there is none' if item.kept else ''})\n")
            print("(a key)\n" if item.path.parent == KEYS else item.text)
        return
    if arguments.root is None:
        _can_be_run(program)
    anew = arguments.force and arguments.config is not None
    _write_all(root, kind, found, force=arguments.force, anew=anew)
    after = (*_AFTER, *(_CONNECTIONS if managed else ()))
    _run_these(after if arguments.root is None else ())
    print(f"\nedit {CONFIGURATION[kind]}, then: systemctl enable --now handover-{kind} handover-logs.timer")


def _has_network_manager(asked: str, root: Path) -> bool:
    """Whether NetworkManager has the interfaces: it runs here, or is in the image below `root`."""
    if asked != "auto":
        return asked == "networkmanager"
    return below(root, _RUNS if root == _HERE else _PROGRAM).exists()


def _can_be_run(program: str) -> None:
    """Check that the service can run the program. Raises ConfigError."""
    if not os.access(program, os.X_OK):
        raise ConfigError(f"--program {program}: there is no such program")
    base = sys.base_prefix if Path(program) == _own_program() else program
    for path in (program, os.path.realpath(program), base):
        if _hidden(path):
            raise ConfigError(f"--program {program}: {path} is hidden from the service: install it in /opt/handover")


def _hidden(path: str | Path) -> bool:
    return any(Path(path).is_relative_to(folder) for folder in _HIDDEN)


def _write_all(root: Path, kind: str, found: Sequence[Item], *, force: bool, anew: bool) -> None:
    """Write all files. `anew`: configuration and keys too. Raises _Refused, OSError.

    Whatever happens, the list names the files that exist.
    """
    written = _manifest(root, kind)
    in_the_way = [item.path for item in found if not item.kept and _changed(root, item, written)]
    if in_the_way and not force:
        names = ", ".join(map(str, in_the_way))
        raise _Refused(f"changed since, or of another program: {names}: nothing written (--force writes over them)")
    try:
        for item in found:
            target = below(root, item.path)
            if item.kept and target.exists() and not anew:
                differs = "" if target.read_bytes() == item.text.encode() else " (and not what would be written now)"
                print(f"kept     {item.path}{differs}")
                continue
            _write(target, item)
            if not item.kept:
                written[str(item.path)] = _digest(item.text.encode())
            print(f"written  {item.path}")
        for path in sorted(set(written) - {str(item.path) for item in found}):  # of an earlier installation
            if _delete_written(root, path, written, force=force):
                print(f"deleted  {path}")
    finally:
        _keep_manifest(root, kind, written)


# ---- configuration and keys -----------------------------------------------------------------------------------------


def _configuration(kind: str, given: Path | None, root: Path, *, force: bool) -> tuple[list[Item], list[str]]:
    """The configuration with its keys, and the serial lines of the configuration that will be in force.

    An existing one stays, unless another one is given with --force. Raises ConfigError, KeysError, OSError.
    """
    path = CONFIGURATION[kind]
    there = below(root, path)
    if given is None:
        items = [Item(path, _SAMPLES[kind](f"{STATE}/"), 0o640, kept=True)]
        return items, _serial(_load(kind, there)) if there.exists() else []
    given = given.expanduser().resolve()
    loaded = _load(kind, given)
    text, moved = _below_state(given.read_text(encoding="utf-8"))
    for name, place in (_written_to(loaded) | moved).items():
        if not place.is_relative_to(STATE):
            raise ConfigError(f"{given}: {name} = {str(place)!r}: the service may write below {STATE} alone")
    items = [Item(path, text, 0o640, kept=True)]
    for key in sorted({key for key in _keys(loaded) if not key.is_relative_to(KEYS)}):
        if key.parent != given.parent / KEYS.name:
            raise ConfigError(f"{given}: key {key}: keys lie in {KEYS.name}/ beside that file, or in {KEYS}")
        load_key(key)
        items.append(Item(KEYS / key.name, key.read_text(encoding="ascii"), 0o600, kept=True))
    if isinstance(loaded, VehicleConfig):
        items += _layout(loaded, given, path)
    for mission in _missions(loaded):
        if _hidden(mission) or (mission.is_relative_to(given.parent) and given != Path(path)):
            raise ConfigError(f"{given}: mission {mission}: put it where the service can read it, e.g. below {STATE}")
    return items, _serial(_load(kind, there) if there.exists() and not force else loaded)


def _below_state(text: str) -> tuple[str, dict[str, Path]]:
    """The text of a configuration with its relative journal and state below STATE, and these places by name."""
    moved = {}

    def place(line: re.Match[str]) -> str:
        moved[line["name"]] = Path(os.path.normpath(STATE / line["path"]))
        return f'{line["key"]}"{moved[line["name"]]}"'

    return _RELATIVE.sub(place, text), moved


def _layout(config: VehicleConfig, given: Path, path: PurePosixPath) -> list[Item]:
    """The file of the position box's layout, if it is beside the configuration. Raises ConfigError."""
    file = config.position.layout_file
    if file is None or file == Path(path.parent) / file.name:
        return []
    if file.name in [each.name for each in CONFIGURATION.values()]:
        raise ConfigError(f"{given}: layout {file}: {file.name} is a configuration's name there: give it another name")
    if file.parent == given.parent:
        text = (config.position.layout_text or b"").decode("utf-8")
        return [Item(path.parent / file.name, text, 0o640, kept=True)]
    if file.is_relative_to(given.parent) or _hidden(file):
        raise ConfigError(f"{given}: layout {file}: put it beside that file, or where the service can read it")
    return []


def _load(kind: str, path: Path) -> _Config:
    return load_vehicle(path) if kind == "companion" else load_station(path)


def _written_to(config: _Config) -> dict[str, Path]:
    places = {"journal": config.journal, "state": getattr(config, "state", None)}
    return {name: Path(os.path.normpath(place)) for name, place in places.items() if place is not None}


def _keys(config: _Config) -> list[Path]:
    if isinstance(config, VehicleConfig):
        named = [*(station.key for station in config.stations), config.autopilot_key, config.guard_key]
    else:
        named = [*(vehicle.key for vehicle in config.vehicles), config.ground_key]
    return [Path(os.path.normpath(key)) for key in named if key is not None]


def _missions(config: _Config) -> list[Path]:
    named = [config.mission] if isinstance(config, VehicleConfig) else [each.mission for each in config.vehicles]
    return [Path(os.path.normpath(mission)) for mission in named if mission is not None]


def _serial(config: _Config) -> list[str]:
    """Its links that are serial lines."""
    tables = config.stations if isinstance(config, VehicleConfig) else config.vehicles
    return [link for table in tables for link in table.links if parse_device(link).kind is Kind.SERIAL]


# ---- files and programs ---------------------------------------------------------------------------------------------


def _write(target: Path, item: Item) -> None:
    """Write a file completely or not at all, with its mode from the start. Raises OSError."""
    target.parent.mkdir(parents=True, exist_ok=True)
    if item.path.parent == KEYS:
        target.parent.chmod(0o750)
    draft = target.with_name(f".{target.name}.new")
    draft.unlink(missing_ok=True)
    descriptor = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, item.mode)
    try:
        with os.fdopen(descriptor, "w", encoding="utf-8") as file:
            os.fchmod(file.fileno(), item.mode)
            file.write(item.text)
            file.flush()
            os.fsync(file.fileno())
        draft.replace(target)
    except BaseException:  # it may hold a key
        discard(draft)
        raise


def _changed(root: Path, item: Item, written: dict[str, str]) -> bool:
    """True if another file exists at the path."""
    try:
        present = below(root, item.path).read_bytes()
    except FileNotFoundError:
        return False
    return present != item.text.encode() and _digest(present) != written.get(str(item.path))


def _run_these(lines: Sequence[Sequence[str]]) -> None:
    """Run the machine's programs that read the files. Raises _Refused."""
    for words in lines:
        line = " ".join(words)
        if shutil.which(words[0]) is None:
            print(f"not run, there is no {words[0]}: {line}", file=sys.stderr)
        elif subprocess.run(words, check=False).returncode:
            raise _Refused(f"the files are as they should be, but this failed: {line}")


# ---- uninstall ------------------------------------------------------------------------------------------------------


def _uninstall(arguments: argparse.Namespace, root: Path) -> None:
    kind: str = arguments.kind
    here = arguments.root is None
    written = _manifest(root, kind)
    if not written:
        raise _Refused(f"{below(root, _MANIFEST)}: handover-{kind} is not installed")
    others = [other for other in CONFIGURATION if other != kind and _manifest(root, other)]
    if arguments.purge and others:
        raise _Refused(f"handover-{others[0]} needs configuration, keys and state too: without --purge, or that first")
    shared = {path for other in others for path in _manifest(root, other)}
    if here and shutil.which("systemctl"):
        units = [f"handover-{kind}.service", *([] if others else ["handover-logs.timer"])]
        subprocess.run(("systemctl", "disable", "--now", *units), check=False)
    try:
        for path in sorted(written):
            if path in shared:
                written.pop(path)
            elif _delete_written(root, path, written, force=arguments.force):
                print(f"deleted  {path}")
    finally:
        _keep_manifest(root, kind, written)
    _run_these(_RELOAD if here else ())
    if written:
        raise _Refused(f"changed since, and left: {', '.join(sorted(written))} (--force deletes them)")
    for folder in (KEYS.parent, STATE) if arguments.purge else ():
        if below(root, folder).exists():
            shutil.rmtree(below(root, folder))
            print(f"deleted  {folder}")


def _delete_written(root: Path, path: str, written: dict[str, str], *, force: bool) -> bool:
    """Delete a written file, unless it was changed. Returns True if it is gone."""
    target = below(root, PurePosixPath(path))
    try:
        if not force and _digest(target.read_bytes()) != written[path]:
            return False
        target.unlink()
    except FileNotFoundError:
        pass
    written.pop(path)
    return True


# ---- the list of what was written -----------------------------------------------------------------------------------


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _manifests(root: Path) -> dict[str, dict[str, str]]:
    """Raises _Refused, OSError."""
    path = below(root, _MANIFEST)
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    except (ValueError, RecursionError):
        found = None
    if not isinstance(found, dict) or not all(_is_list(each) for each in found.values()):
        raise _Refused(f"{path} cannot be read: delete it, and install with --force")
    return found


def _is_list(found: object) -> bool:
    """True if this is a list of our files with their digests."""
    return isinstance(found, dict) and all(
        isinstance(digest, str) and path.startswith("/etc/") and ".." not in PurePosixPath(path).parts
        for path, digest in found.items()
    )


def _manifest(root: Path, kind: str) -> dict[str, str]:
    return dict(_manifests(root).get(kind, {}))


def _keep_manifest(root: Path, kind: str, written: Mapping[str, str]) -> None:
    kept = {each: paths for each, paths in {**_manifests(root), kind: written}.items() if paths}
    if kept:
        text = json.dumps(kept, indent=1, sort_keys=True)
        _write(below(root, _MANIFEST), Item(_MANIFEST, text + "\n"))
    else:
        below(root, _MANIFEST).unlink(missing_ok=True)
