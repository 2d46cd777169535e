# SPDX-License-Identifier: GPL-3.0-or-later

"""Errors of files, links, missions and commands: families, each with the files whose texts belong to it.

An error says in one line what is wrong, where, and what is allowed. The texts are read from the sources
(`reference/sources.py`). A family adds what all of its errors mean and what to do.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Final

from reference import ROOT
from reference.parsers import commands
from reference.sources import literals

__all__ = ["FAMILIES", "OTHER_FILES", "SHOWN", "Family", "texts_of"]


@dataclass(frozen=True, slots=True)
class Family:
    """Errors that mean the same and are corrected the same way. `files`: where the texts are."""

    title: str
    meaning: str
    action: str
    files: tuple[str, ...]


_CHECK: Final = "Then 'handover check FOLDER'."


def _in(folder: str, names: str) -> tuple[str, ...]:
    """Files of a folder, by their names without an ending."""
    return tuple(f"{folder}/{name}.py" for name in names.split())


FAMILIES: Final = (
    Family(
        "A configuration",
        "The vehicle's or the station's file cannot be used. The program does not start, or keeps the settings before.",
        "Go to the file, table and key that the line names. Write one of the allowed values, then start again.",
        (
            _in(
                "mavproxy_handover/config", "toml vehicle station files served position feeds remote_id onboard payload"
            )
            + _in("mavproxy_handover/tools", "key_table")
        ),
    ),
    Family(
        "A layout of the position box",
        "The file with the fields of the box's record cannot be used.",
        "Compare the file with the sample of docs/position-box.md, and correct the named field.",
        _in("mavproxy_handover/config", "box_layouts"),
    ),
    Family(
        "Records of the position box",
        "A record of the box is not as its layout says. It is not used.",
        "Compare layout and box: 'handover doctor' shows the first records.",
        _in("mavproxy_handover/wire", "box_layout box_record"),
    ),
    Family(
        "A restart, and what is kept for it",
        "A restart in flight could not read or keep a record. The flight goes on.",
        "Nothing in flight. On the ground 'handover doctor' says what to do.",
        (
            _in("mavproxy_handover/config", "running")
            + _in("mavproxy_handover/store", "durable memory restart_copy state_file state_store flights journal")
        ),
    ),
    Family(
        "Keys",
        "A key cannot be used, or a passphrase is not allowed. Nothing is signed with it.",
        "Do what the line says. 'handover keys check' looks at all keys.",
        _in("mavproxy_handover/store", "keys"),
    ),
    Family(
        "Old signatures",
        "The record that keeps out copies of old frames cannot be used.",
        "Check that all clocks are right. Make room on the disk.",
        _in("mavproxy_handover/store", "replay"),
    ),
    Family(
        "Another program holds it",
        "Only one companion may serve a vehicle, and only one program a serial line.",
        "Stop the other program. 'handover doctor' names it.",
        _in("mavproxy_handover/store", "lock"),
    ),
    Family(
        "The address that a station has confirmed",
        "The station's file with the vehicle's address is damaged.",
        "Delete the file that the line names, and confirm the address again.",
        _in("mavproxy_handover/store", "confirmed_address"),
    ),
    Family(
        "Links",
        "A link is written in a form that is not known, or it cannot be opened.",
        "Compare the link with the forms in the reference of the configuration. Check cable, address and port.",
        (
            _in("mavproxy_handover/link", "forms names serial_line tcp udp dialling reopening box_line bundle")
            + _in("mavproxy_handover/cli", "reach")
        ),
    ),
    Family(
        "A program that does not start",
        "MAVProxy or a module of this package is missing, broken, or was ended again and again.",
        "Run the command at the end of the line. Without one: 'handover logs', and tell us.",
        (_in("mavproxy_handover/supervision", "must_load rules") + _in("mavproxy_handover/cli", "launch run")),
    ),
    Family(
        "A mission package",
        "A file of the package cannot be used. The package is not loaded.",
        f"Go to the file and place that the line names. Write what is allowed. {_CHECK}",
        _in("mavproxy_handover/mission", "errors package gaps corridor waypoint_ownership terrain addresses"),
    ),
    Family(
        "A plan",
        "The plan has an item that cannot be flown or judged, or one that takes away a safeguard.",
        f"Change the named item in your ground station program, and save the plan again. {_CHECK}",
        _in(
            "mavproxy_handover/mission",
            "plan plan_facts complex_items jumps refused_items protocol_items heights landing_pattern waypoint_numbers",
        ),
    ),
    Family(
        "Zones",
        "A file of zones has a shape that is no zone, or its names do not fit the stations.",
        f"Correct the named feature in your map program, and export the file again. {_CHECK}",
        (
            _in("mavproxy_handover/mission", "geojson")
            + _in("mavproxy_handover/mission/drawn", "areas choice files geojson kml")
        ),
    ),
    Family(
        "Findings of handover check",
        "The package can be read, and something would go wrong in flight. An error refuses the package.",
        f"Change plan, zones or mission.toml as the line says. {_CHECK}",
        _in("mavproxy_handover/mission", "check check_feeds check_payload fix ahead"),
    ),
    Family(
        "Figures of handover check",
        "What the check has found of the route: its length, stations, coverage and energy.",
        "Compare the figures with your plan.",
        _in("mavproxy_handover/mission", "check_text check_words"),
    ),
    Family(
        "A map of the mission",
        "The map could not be drawn. The check itself is complete.",
        "Install what the line names, or name another file.",
        _in("mavproxy_handover/mission", "picture"),
    ),
    Family(
        "The command itself",
        "A command got a word, an option or a file that it cannot use. Nothing was changed, unless the line says so.",
        "Type the command with --help. Correct what the line names.",
        _in(
            "mavproxy_handover/cli",
            "__init__ check completion explain init init_mission mission_job install machine key_bundle keyfiles keys "
            "logs policy",
        ),
    ),
    Family(
        "The SD card",
        "The card has not what the guard needs, or something on it is in the guard's way.",
        "Do what the line says. 'handover guard CARD --check' looks again.",
        _in("mavproxy_handover/cli", "guard"),
    ),
)

#: the sentences of a station beside its notices, of the watch page and of the report
SHOWN: Final = (
    Family(
        "Addresses and links of a station",
        "A mission can bring the vehicle's address. A station uses it only after its operator has confirmed it.",
        "Compare the address by voice with the named operator. Then type the command that the line names.",
        (
            _in("gcs_module", "vehicle_addresses links vehicle_links station_resources served_program")
            + _in("mavproxy_handover/wire", "vehicle_address")
        ),
    ),
    Family(
        "What a station adds to a decision",
        "After the vehicle's sentence the station names the commands that its operator may type now.",
        "Type the command, if you want what it does.",
        _in("gcs_module", "decisions"),
    ),
    Family(
        "Missions at a station",
        "The station sends, receives or keeps a mission package.",
        "Type the command that the line names. Without one nothing is to be done.",
        _in("gcs_module", "inbox mission_transfer map_view"),
    ),
    Family(
        "Answers of a station to what you type",
        "The station answers a typed command, or explains it in 'handover help'.",
        "If a word was not understood: 'handover help'.",
        _in(
            "gcs_module",
            "commands fleet vehicle_selection view console_rows map_layer core aircraft event_log module "
            "window_watchdog closing interrupts",
        ),
    ),
    Family(
        "Operators on duty",
        "Operators sign on and off by name. A station can require one before it takes the aircraft.",
        "Type the command that the line names.",
        _in("gcs_module", "duty duty_commands duty_file"),
    ),
    Family(
        "The panel",
        "The panel shows one station, in a window of a browser. It takes orders only for that station's program.",
        "Do what the line says. The terminal of the station shows the same and takes every command.",
        _in(
            "gcs_module/panel",
            "band command endpoint orders page panel_auth panel_values publisher reader session snapshot words",
        ),
    ),
    Family(
        "The watch page",
        "The page shows aircraft and stations, and never commands. Alarms there have the levels of the station.",
        "Call the operator of the station. If the page itself has a fault, do what the line says.",
        _in(
            "gcs_module/watch",
            "follow journals link_reader page page_server page_values passive_link web_auth command",
        ),
    ),
    Family(
        "Map tiles from the disk",
        "The map of the panel and of the watch page can show tiles from this computer's disk. They cannot be used.",
        "Name an MBTiles file with pictures, or the folder that holds the folders of the zooms.",
        _in("gcs_module/watch", "tiles"),
    ),
    Family(
        "The report",
        "The report says what a flight was, from journals and logs. A decision has its level of the flight.",
        "If a file cannot be read: give the files that the line names.",
        _in(
            "sitl/report",
            "clocks dataflash evidence export feeds figures flight loss outcome page "
            "pictures record rehearsal sequence sources times tlog watch",
        ),
    ),
)

#: files of these folders whose literals are no errors -> why
OTHER_FILES: Final = {
    "mavproxy_handover/config/vehicle_keys.py": "the meaning of each key: the reference of the configuration",
    "mavproxy_handover/config/sample.py": "comments of the sample configuration",
    "mavproxy_handover/config/for_mission.py": "comments of the files that 'handover init mission' writes",
    "mavproxy_handover/wire/conversation.py": "in the table 'Why an order to the autopilot failed'",
    "mavproxy_handover/wire/frames.py": "a mistake of the code that constructs it",
    "mavproxy_handover/wire/lease_tag.py": "a mistake of the code that constructs it",
    "mavproxy_handover/wire/package_transfer.py": "in the table 'Why a package is not loaded'",
    "mavproxy_handover/wire/signing.py": "a mistake of the code that constructs it",
    "mavproxy_handover/link/quality.py": "a mistake of the code that constructs it",
    "mavproxy_handover/tools/worker.py": "the end of another error",
    "mavproxy_handover/mission/energy.py": "names of places",
    "mavproxy_handover/mission/keys.py": "the meaning of each key: the reference of the mission",
    "mavproxy_handover/mission/items.py": "the difference between two lists: the table 'What the autopilot holds'",
    "mavproxy_handover/mission/draft.py": "comments of the mission.toml that 'handover init mission' writes",
    "mavproxy_handover/mission/drawing.py": "labels of a map",
    "mavproxy_handover/mission/path.py": "names of parts of the path, in findings of the check",
    "mavproxy_handover/mission/map_findings.py": "the list below a map: the findings of the check",
    "gcs_module/watch/page_arguments.py": "help of arguments",
}


def texts_of(family: Family) -> tuple[str, ...]:
    """The texts of a family, as templates. What `--help` says is not among them."""
    found = dict.fromkeys(text for file in family.files for text in _texts(file))
    return tuple(found)


def _texts(file: str) -> list[str]:
    source = (ROOT / file).read_text(encoding="utf-8")
    helped = (
        _help()
        if file.startswith(("mavproxy_handover/cli/", "gcs_module/panel/", "gcs_module/watch/", "sitl/"))
        else ""
    )
    return [
        text
        for text in literals(source)
        if " ".join(text.split()) not in helped and not text.startswith(("#", "usage:"))
    ]


@cache
def _help() -> str:
    """All that the commands say of themselves."""
    parts: list[str] = []
    for command in commands():
        parts += [command.text, command.description, command.epilog, *command.codes.values()]
        parts += [option.help for option in command.options] + [option.value for option in command.options]
        parts += [part for example in command.examples for part in example]
    return "\n".join(" ".join(part.split()) for part in parts)
