# SPDX-License-Identifier: GPL-3.0-or-later

"""`commands.md`: what can be typed, in a shell and in MAVProxy, from parsers and tables."""

from __future__ import annotations

from typing import Any
from unittest.mock import MagicMock

from gcs_module.commands import StationCommands
from gcs_module.fleet import our_settings
from mavproxy_handover.companion.commands import VehicleCommands
from reference.markdown import cell, code, page, table
from reference.parsers import Command, commands

__all__ = ["typed"]

_SETTINGS = {float: "number", int: "whole number", bool: "true or false"}


def typed() -> str:
    """The page."""
    return page(
        "Commands",
        "## In a shell",
        *(part for command in commands() for part in _command(command)),
        "## At the companion's MAVProxy",
        "Typed after `handover`, with the module of the vehicle loaded (`module load handover`). They show, and never "
        "change who commands.",
        table(("typed", "what it does"), _of_console(VehicleCommands(MagicMock(), print))),
        "## At a station's MAVProxy",
        "Typed after `handover`, with the module of a station loaded (`module load handover_gcs`). Where the station "
        "has several vehicles, `handover -v NAME ...` says which one is meant; without it, it is the one that MAVProxy "
        "has chosen.",
        table(("typed", "what it does"), _of_console(StationCommands(MagicMock(), our_settings()))),
        "`handover set NAME VALUE` changes a setting until MAVProxy ends:",
        table(("name", "type", "default", "range", "meaning"), _settings(our_settings())),
    )


def _command(command: Command) -> list[str]:
    rows = [(code(option.typed), cell(option.help)) for option in command.options]
    level = "####" if " " in command.words else "###"
    return [
        f"{level} handover {command.words}",
        command.description,
        f"```\n{command.usage}\n```",
        table(("option", "meaning"), rows),
        command.epilog,
        "```sh\n" + "\n".join(f"{typed}    # {what}" for typed, what in command.examples) + "\n```",
        "Exit code: " + ", ".join(f"{code} {text}" for code, text in command.codes.items()) + ".",
    ]


def _of_console(console: Any) -> list[tuple[str, str]]:
    """The lines of `handover help`, which is made from the table that is also its completion."""
    return [(code(f"handover {words}"), cell(text)) for words, text in console.listed()]


def _settings(settings: Any) -> list[tuple[str, ...]]:
    found = []
    for name in settings.list():
        setting = settings.get_setting(name)
        low, high = setting.range
        kind = _SETTINGS[setting.type]
        found.append((code(name), kind, f"{setting.value:g}", f"{low:g} to {high:g}", cell(setting.label)))
    return found
