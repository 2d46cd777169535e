# SPDX-License-Identifier: GPL-3.0-or-later

"""The command `handover`: a table of subcommands. Each is imported only when it is used.

Exit codes of all: 0 success, 1 negative result (a check found errors, an expectation failed), 2 wrong usage or bad
input, with one line that says what and where. If the reader of the output has gone (`handover policy | head`), every
subcommand ends without a message. Its exit code is then 141, as a shell reports for a program that such a pipe has
ended.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import sys
from collections.abc import Iterator, Sequence
from typing import Any, Final, TextIO, cast

from mavproxy_handover.supervision.must_load import import_fault
from mavproxy_handover.supervision.script import few_threads
from mavproxy_handover.tools.version import VERSION

__all__ = ["COMMANDS", "DESCRIPTION", "main"]

#: 128 and the number of SIGPIPE
_NOBODY_READS: Final = 141

_SIM: Final = "mavproxy-handover-sim"
#: what is not installed with everything -> the distribution that brings it
_BRINGS: Final = {
    **dict.fromkeys(("sitl", "lupa", "matplotlib", "plotly"), _SIM),
    **dict.fromkeys(("dask", "distributed"), f"{_SIM}[campaign]"),
    **dict.fromkeys(("nicegui", "fastapi", "uvicorn"), "mavproxy-handover[watch]"),
}

#: word -> (module, function, what it does): what `handover`, its manual and its completion know
COMMANDS: Final = {
    "sim": ("sitl.main", "main", "fly a scenario in simulation, all real processes, and write a report"),
    "bench": ("sitl.hosts.main", "main", "fly with each program on a host of its own: network namespaces, two paths"),
    "check": ("mavproxy_handover.cli.check", "main", "check a mission package before flight"),
    "report": (
        "sitl.report.page",
        "main_report",
        "write the report of a flight, from journals, telemetry and dataflash logs",
    ),
    "replay": ("sitl.replay.main", "main", "let a recorded flight pass through today's rules, with other limits, too"),
    "campaign": ("sitl.campaign.main", "main", "fly random missions with random faults over the rules, and judge them"),
    "watch": ("gcs_module.watch.command", "main", "serve a page for those who watch: aircraft, stations, alarms, live"),
    "panel": ("gcs_module.panel.command", "main", "serve the operator's page beside a station: what is next, buttons"),
    "policy": ("mavproxy_handover.cli.policy", "main", "print what the gate lets through, and why"),
    "explain": ("mavproxy_handover.cli.explain", "main", "print what is done about what is wrong, and why"),
    "keys": ("mavproxy_handover.cli.keys", "main", "make, list and rotate the keys that stations sign with"),
    "guard": ("mavproxy_handover.cli.guard", "main", "put the guard on the autopilot's SD card, and check the card"),
    "init": (
        "mavproxy_handover.cli.init",
        "main",
        "write a commented configuration for a vehicle or a station",
    ),
    "install": ("mavproxy_handover.cli.install", "install", "have systemd run the companion, or a station"),
    "uninstall": ("mavproxy_handover.cli.install", "uninstall", "take back what install wrote"),
    "doctor": ("mavproxy_handover.doctor.command", "main", "find out what is wrong with this machine, and what to do"),
    "logs": ("mavproxy_handover.cli.logs", "main", "list the logs of flights, delete old ones"),
    "completion": ("mavproxy_handover.cli.completion", "main", "print the shell's completion of handover"),
    "companion": ("mavproxy_handover.cli.run", "companion", "run MAVProxy with the module of the companion computer"),
    "station": ("mavproxy_handover.cli.run", "station", "run MAVProxy with the module of a ground station"),
}


DESCRIPTION: Final = "Authority handover of an ArduPilot vehicle between ground control stations."


#: the commands in groups, as `handover --help` lists them
GROUPS: Final = {
    "before a flight": ("check", "sim", "campaign", "bench", "policy", "explain"),
    "in flight": ("companion", "station", "panel", "watch"),
    "after a flight": ("report", "replay", "logs"),
    "setting up": ("init", "keys", "guard", "install", "uninstall", "doctor", "completion"),
}


def _usage() -> str:
    lines = ["usage: handover COMMAND [options]", "", DESCRIPTION, ""]
    for group, words in GROUPS.items():
        lines += [f"{group}:", *(f"  {word:10} {COMMANDS[word][2]}" for word in words), ""]
    lines += [
        "  --help, --version",
        "",
        "examples:",
        "  handover sim",
        "      fly the delivery mission in simulation, and write a report",
        "  handover check --help",
        "      purpose, options, examples and exit codes of one command",
        "",
        "exit code:",
        "  0  done, or the answer is yes",
        "  1  the answer is no: a check found errors, an expectation did not hold",
        "  2  wrong usage or bad input",
    ]
    return "\n".join(lines)


class _NobodyReads(SystemExit):
    """Raised by any print to end the program. It is no OSError, so that no other handler catches it."""


class _Output:
    """Standard output or error output. It ends the program when its reader has gone."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """As of the stream."""
        with self._read():
            return self._stream.write(text)

    def flush(self) -> None:
        """As of the stream."""
        with self._read():
            self._stream.flush()

    @contextlib.contextmanager
    def _read(self) -> Iterator[None]:
        try:
            yield
        except BrokenPipeError:
            # drop the waiting text, or the interpreter would complain at its end
            with contextlib.suppress(OSError, ValueError):  # it may be no file
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, self._stream.fileno())
                os.close(nowhere)
            raise _NobodyReads(_NOBODY_READS) from None


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command line; returns the exit code."""
    streams = sys.stdout, sys.stderr
    wrapped = [None if stream is None else _Output(stream) for stream in streams]  # None: the parent process closed it
    sys.stdout, sys.stderr = cast("list[TextIO]", wrapped)
    try:
        code = _run(list(sys.argv[1:] if argv is None else argv))
        for output in filter(None, wrapped):
            output.flush()
    except _NobodyReads:
        return _NOBODY_READS
    finally:
        sys.stdout, sys.stderr = streams
    return code


def _run(words: list[str]) -> int:
    if not words or words[0] in ("-h", "--help", "help"):
        print(_usage())
        return 0 if words else 2
    if words[0] in ("-V", "--version", "version"):
        print(f"handover {VERSION}")
        return 0
    if words[0] not in COMMANDS:
        print(f"handover: unknown command {words[0]!r}; the commands are {', '.join(COMMANDS)}", file=sys.stderr)
        return 2
    module, function, _text = COMMANDS[words[0]]
    if words[0] == "companion":  # it forks, and a process with threads must not
        few_threads()
    try:
        run = getattr(importlib.import_module(module), function)
    except Exception as error:  # a broken package may raise anything
        return _cannot_import(words[0], error)
    try:
        code: int = run(words[1:])
    except ImportError as error:  # some packages are imported only when they are needed
        return _cannot_import(words[0], error)
    return code


def _cannot_import(word: str, error: Exception) -> int:
    """Report in one sentence which package is missing or broken, and what to do."""
    name = (getattr(error, "name", "") or "").split(".")[0]
    if isinstance(error, ModuleNotFoundError) and name in _BRINGS:
        text = f"needs {name}: pip install '{_BRINGS[name]}'"
    else:
        text = import_fault(error)
    print(f"handover {word}: {text}", file=sys.stderr)
    return 2
