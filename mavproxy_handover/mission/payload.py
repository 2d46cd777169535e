# SPDX-License-Identifier: GPL-3.0-or-later

"""`[payload]` of mission.toml: which station has gimbal, camera and winch, and what a handover does to that."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType

from mavproxy_handover.core.authority.payload import FLIGHT, REQUEST, PayloadKind, PayloadRules
from mavproxy_handover.mission.errors import Where
from mavproxy_handover.mission.keys import PAYLOAD

__all__ = ["read_payload"]


def read_payload(where: Where, value: object, stations: Iterable[str]) -> PayloadRules:
    """The `[payload]` table. `stations`: the names of the mission's stations. Raises MissionError."""
    inside = where.at("[payload]")
    table: Mapping[str, object] = inside.table(value, "payload")
    inside.known_keys(table, PAYLOAD.names)
    allowed = (FLIGHT, REQUEST, *stations)

    def rule(key: str) -> str | None:
        return inside.choice(table[key], key, allowed) if key in table else None

    kinds = {kind: found for kind in PayloadKind if (found := rule(kind.value)) is not None}
    at_handover = inside.of_key(PAYLOAD["at_handover"], table["at_handover"]) if "at_handover" in table else None
    return PayloadRules(rule("control"), at_handover, MappingProxyType(kinds))
