# SPDX-License-Identifier: GPL-3.0-or-later

"""`[payload]` of the vehicle's file: which station or onboard program commands gimbal, camera and winch."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, Final

from mavproxy_handover.config.toml import one_table
from mavproxy_handover.core.authority.payload import AT_HANDOVER, FLIGHT, REQUEST, PayloadSettings
from mavproxy_handover.tools.key_table import KeyTable, text, word

__all__ = ["PAYLOAD", "payload_settings"]

PAYLOAD: Final = KeyTable(
    "payload",
    (
        text(
            "control",
            f"{FLIGHT}: the commander's; {REQUEST}: the commander's until a station asks for it; or the name of a "
            "station, or of an onboard program with the right 'payload'",
            FLIGHT,
        ),
        word(
            "at_handover",
            AT_HANDOVER,
            f"with control = {REQUEST}: whether a station that asked for it loses it when the aircraft gets another "
            "commander",
            AT_HANDOVER[0],
        ),
    ),
    "Payload authority: gimbal, camera, winch, gripper, lights. It never reaches a flight function.",
)


def payload_settings(data: Mapping[str, Any], path: Path, names: Collection[str]) -> PayloadSettings:
    """Parse `[payload]`. `names`: the stations, and the onboard programs with that right. Raises ConfigError."""
    table = one_table(data, PAYLOAD, path)
    control = table["control"]
    if control not in (FLIGHT, REQUEST, *names):
        raise table.error("control", f"{control!r} must be one of {', '.join((FLIGHT, REQUEST, *names))}")
    return PayloadSettings(control, table["at_handover"])
