# SPDX-License-Identifier: GPL-3.0-or-later

"""`[payload]` of the vehicle's file: which station or onboard program commands gimbal, camera and winch."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from mavproxy_handover.config.toml import one_table
from mavproxy_handover.core.authority.payload import AT_HANDOVER, FLIGHT, REQUEST, PayloadKind, PayloadRules
from mavproxy_handover.mission.keys import payload_keys
from mavproxy_handover.tools.key_table import KeyTable

__all__ = ["PAYLOAD", "payload_rules"]

PAYLOAD: Final = KeyTable(
    "payload",
    payload_keys("a station, or of an onboard program with the right 'payload'"),
    "Payload authority: gimbal, camera, winch, gripper, lights. It never reaches a flight function. [payload] of the "
    f"mission goes before. Without both, {FLIGHT} and {AT_HANDOVER[0]}.",
)


def payload_rules(data: Mapping[str, Any], path: Path, names: Collection[str]) -> PayloadRules:
    """Parse `[payload]`. `names`: the stations, and the onboard programs with that right. Raises ConfigError."""
    table = one_table(data, PAYLOAD, path)
    allowed = (FLIGHT, REQUEST, *names)
    for key in ("control", *(kind.value for kind in PayloadKind)):
        if table[key] is not None and table[key] not in allowed:
            raise table.error(key, f"{table[key]!r} must be one of {', '.join(allowed)}")
    kinds = {kind: str(table[kind.value]) for kind in PayloadKind if table[kind.value] is not None}
    return PayloadRules(table["control"], table["at_handover"], MappingProxyType(kinds))
