# SPDX-License-Identifier: GPL-3.0-or-later

"""`[[onboard]]` of the vehicle's file: software on the companion that has a link of its own.

A link is only on this machine, unless `remote` says otherwise. A program without rights may read, and hears telemetry.
"""

from __future__ import annotations

import ipaddress
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from mavproxy_handover.config.toml import ConfigError, Table, list_of_tables
from mavproxy_handover.gate.onboard import OnboardRights
from mavproxy_handover.gate.policy.onboard import SENSORS, Right
from mavproxy_handover.gate.policy.payload import KIND_OF_COMPONENT
from mavproxy_handover.link.forms import FORMS, Kind, parse_device
from mavproxy_handover.tools.key_table import Key, KeyTable, flag, items, number, text
from mavproxy_handover.wire.ids import (
    AUTOPILOT_COMPID,
    COMPANION_COMPID,
    DOCTOR_COMPID,
    LANGUAGE_COMPID,
    PROBE_COMPID,
    RATES_COMPID,
)

__all__ = ["ONBOARD", "OnboardProgram", "onboard_programs"]

#: components of the vehicle that another program speaks as
_TAKEN: Final[Mapping[int, str]] = {
    AUTOPILOT_COMPID: "the autopilot's",
    COMPANION_COMPID: "the companion's",
    LANGUAGE_COMPID: "the companion's",
    PROBE_COMPID: "the companion's",
    RATES_COMPID: "the companion's",
    DOCTOR_COMPID: "that of 'handover doctor'",
}
#: names that a command takes for something else
_WORDS: Final = ("no", "flight", "request")
_RIGHTS: Final = tuple(right.value for right in Right)
#: more than this many programs are a mistake
_MOST: Final = 16

ONBOARD: Final = KeyTable(
    "onboard",
    (
        Key(
            "name",
            str,
            "what the program is called in texts, and in 'handover delegate NAME'",
            required=True,
            pattern="[!-~]{1,20}",
            rule="1 to 20 printable ASCII characters without a space",
            example="precland",
        ),
        text(
            "link",
            f"{', '.join(FORMS.values())}. HOST must be this machine (127.0.0.1, ::1 or localhost), unless remote",
            required=True,
            example="udpin:127.0.0.1:14600",
        ),
        Key(
            "component",
            int,
            "MAVLink component that it speaks as, with the vehicle's system id: 25 to 99 are free, 197 is visual "
            "odometry; cameras are 100 to 105, gimbals 154 and 171 to 175, a winch 169; no other program's",
            required=True,
            limits=(2, 255),
            example=25,
        ),
        items(
            "rights",
            f"any of {', '.join(_RIGHTS)}: sensor messages that 'sensors' names; payload commands while it has "
            "payload authority; guided targets while the commander delegates them; a camera, gimbal or winch of the "
            "vehicle, which stations hear and command. Without one it reads and hears",
            [],
            example=["sensors"],
        ),
        items(
            "sensors",
            f"the sensor messages that it may send, by name: {', '.join(SENSORS)}",
            [],
            example=["LANDING_TARGET"],
        ),
        flag(
            "remote",
            "true: its link may leave this machine. Any program that reaches the link then counts as this one",
            default=False,
        ),
        number(
            "bytes_per_s",
            300,
            100_000,
            "all that it sends. All programs and feeds together get half of a serial line",
            2500.0,
        ),
        number("landing_m", 1, 1000, "its LANDING_TARGET leads a landing at most this far (m)", 10.0),
    ),
    "One block for each program on the companion that talks MAVLink: ROS 2, MAVSDK, a camera manager, precision "
    "landing. None by default. See docs/onboard-programs.md.",
    many=True,
)


@dataclass(frozen=True, slots=True)
class OnboardProgram:
    """An onboard program as the configuration has it. `link`: a device string."""

    rights: OnboardRights
    link: str
    remote: bool = False

    @property
    def name(self) -> str:
        """Its name in texts."""
        return self.rights.name


def onboard_programs(data: Mapping[str, Any], path: Path) -> tuple[OnboardProgram, ...]:
    """Parse `[[onboard]]`. Raises ConfigError."""
    tables = list_of_tables(data, ONBOARD, path)
    if len(tables) > _MOST:
        raise ConfigError(f"{path}: [[onboard]] is there {len(tables)} times; at most {_MOST} are allowed")
    programs = tuple(_program(table) for table in tables)
    for key, values in (
        ("name", [program.name for program in programs]),
        ("link", [program.link for program in programs]),
        ("component", [program.rights.component for program in programs]),
    ):
        for number_, value in enumerate(values):
            if value in values[:number_]:
                raise tables[number_].error(key, f"{value!r} is given twice; each program needs its own")
    return programs


def _program(table: Table) -> OnboardProgram:
    rights = frozenset(Right(_one_of(table, "rights", each, _RIGHTS)) for each in table["rights"])
    sensors = frozenset(_one_of(table, "sensors", each, tuple(SENSORS)) for each in table["sensors"])
    if sensors and Right.SENSORS not in rights:
        raise table.error("sensors", "names messages, but rights lacks 'sensors'; add it, or remove the messages")
    if Right.SENSORS in rights and not sensors:
        raise table.error("sensors", f"is missing: rights has 'sensors'. Name the messages: {', '.join(SENSORS)}")
    if table["name"] in _WORDS:
        raise table.error("name", f"{table['name']!r} is a word of 'handover delegate'; choose another")
    component = table["component"]
    if component in _TAKEN:
        raise table.error("component", f"{component} is {_TAKEN[component]} component; choose another, such as 25")
    if Right.MANAGER in rights and component not in KIND_OF_COMPONENT:
        raise table.error(
            "component",
            f"{component} is none of the payload's, which the right 'manager' needs: 100 to 105 (camera), 154 or 171 "
            "to 175 (gimbal), 169 (winch)",
        )
    link = table.link("link", table["link"])
    if not table["remote"] and not _is_here(link):
        raise table.error(
            "link",
            f"{link!r} leaves this machine; use 127.0.0.1, or set remote = true if that is meant: any program that "
            "reaches the link then counts as this one",
        )
    named = OnboardRights(table["name"], component, rights, sensors, table["bytes_per_s"], table["landing_m"])
    return OnboardProgram(named, link, table["remote"])


def _one_of(table: Table, key: str, value: Any, words: tuple[str, ...]) -> str:
    if value not in words:
        raise table.error(key, f"{value!r} must be one of {', '.join(words)}")
    return str(value)


def _is_here(link: str) -> bool:
    """Whether a link stays on this machine."""
    spec = parse_device(link)
    if spec.kind is Kind.SERIAL or spec.host == "localhost":
        return True
    try:
        return ipaddress.ip_address(spec.host).is_loopback
    except ValueError:
        return False
