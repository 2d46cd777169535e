# SPDX-License-Identifier: GPL-3.0-or-later

"""The manual pages: `handover`, and one for each command, from the same parsers.

Written here and not by a library: what makes pages out of argparse prints its usage as the running Python formats it,
which differs from version to version, and puts all commands on one page.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from mavproxy_handover import cli
from mavproxy_handover.tools.version import VERSION
from reference.parsers import Command, Option, commands

__all__ = ["manual"]

_NOTE = '.\\" SPDX-License-Identifier: GPL-3.0-or-later'
_EXIT = (
    ("0", "Done, or the answer is yes."),
    ("1", "The answer is no: a check found errors, an expectation did not hold."),
    ("2", "Wrong usage or bad input, with one line that says what and where."),
)
_FILES = (
    ("./handover.toml, /etc/handover/vehicle.toml", "The configuration of a vehicle's companion."),
    ("./station.toml", "The configuration of a ground station."),
    ("flights/", "A folder for each run of companion or station: journal and telemetry log."),
)
_VARIABLES = (("HANDOVER_CONFIG", "The vehicle's configuration, where no option names it."),)


def manual() -> dict[str, str]:
    """Name and content of each page."""
    found: dict[str, list[Command]] = {}
    for command in commands():
        found.setdefault(command.words.split()[0], []).append(command)
    pages = {"handover.1": _whole()}
    return pages | {f"handover-{word}.1": _page(several) for word, several in found.items()}


def _whole() -> str:
    lines = _head("handover", "authority handover of an ArduPilot vehicle between ground control stations")
    lines += [".SH SYNOPSIS", ".B handover", ".I COMMAND", "[options]", ".SH DESCRIPTION"]
    lines += [
        _text(
            "Hands the command of an ArduPilot vehicle from one ground control station to the next while it flies. "
            "Each command has a page of its own."
        )
    ]
    lines += [".SH COMMANDS"]
    for word, (_module, _function, text) in cli.COMMANDS.items():
        lines += [".TP", f".BR handover-{_text(word)} (1)", _sentence(text)]
    lines += [
        ".SH OPTIONS",
        *_tagged((("-h, --help", "Show the commands and end."), ("-V, --version", "Show the version."))),
    ]
    lines += [".SH EXIT STATUS", *_tagged(_EXIT), ".SH FILES", *_tagged(_FILES)]
    lines += [".SH ENVIRONMENT", *_tagged(_VARIABLES)]
    return _joined(lines)


def _page(several: list[Command]) -> str:
    first, *below = several
    lines = _head(f"handover-{first.words}", first.text)
    lines += [".SH SYNOPSIS"]
    for command in below or [first]:
        lines += [".HP", f".B handover {_text(command.words)}", *map(_piece, _in_order(command))]
    lines += [".SH DESCRIPTION", _sentence(first.description)]
    if below:
        lines += [".SH COMMANDS"]
        for command in below:
            lines += [f".SS handover {_text(command.words)}", _sentence(command.description), *_options(command)]
    else:
        lines += [".SH OPTIONS", *_options(first)]
    if first.epilog:
        lines += [".SH NOTES", _sentence(first.epilog)]
    lines += [".SH EXAMPLES", *_tagged(first.examples)]
    codes = ((str(code), text) for code, text in first.codes.items())
    lines += [".SH EXIT STATUS", *_tagged(codes), ".SH SEE ALSO", ".BR handover (1)"]
    return _joined(lines)


def _head(name: str, text: str) -> list[str]:
    title = name.upper().replace("-", "\\-")
    return [
        _NOTE,
        f'.TH {title} 1 "" "handover {VERSION}" "Authority handover"',  # no date: a version has none
        ".SH NAME",
        f"{_text(name)} \\- {_text(text)}",
    ]


def _in_order(command: Command) -> list[Option]:
    return [option for option in command.options if option.names != ("-h", "--help")]


def _piece(option: Option) -> str:
    """One option in the synopsis."""
    inner = " ".join(
        part for part in (f"\\fB{_text(option.names[-1])}\\fR" if option.names else "", _value(option.value)) if part
    )
    return inner if option.required else f"[{inner}]"


def _value(value: str) -> str:
    return f"\\fI{_text(value)}\\fR\\&" if value else ""


def _options(command: Command) -> list[str]:
    lines = []
    for option in command.options:
        typed = ", ".join(
            " ".join(filter(None, (f"\\fB{_text(name)}\\fR", _value(option.value)))) for name in option.names
        )
        lines += [".TP", typed or _value(option.value), _sentence(option.help)]
    return lines


def _tagged(rows: Iterable[tuple[str, str]]) -> list[str]:
    return [line for tag, text in rows for line in (".TP", f"\\fB{_text(tag)}\\fR", _sentence(text))]


def _text(text: str) -> str:
    """As roff takes it literally."""
    known: Mapping[str, str] = {"\\": "\\e", "-": "\\-", "'": "\\(aq", "`": "\\(ga", "~": "\\(ti", "^": "\\(ha"}
    plain = "".join(known.get(letter, letter) for letter in " ".join(text.split()))
    return f"\\&{plain}" if plain.startswith(".") else plain


def _sentence(text: str) -> str:
    """With a capital and a full stop."""
    text = " ".join(text.split())
    return _text(text[:1].upper() + text[1:] + ("" if text.endswith((".", "?", "!")) else "."))


def _joined(lines: list[str]) -> str:
    return "\n".join(lines) + "\n"
