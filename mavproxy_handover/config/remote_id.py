# SPDX-License-Identifier: GPL-3.0-or-later

"""Reads `[remote_id]`: which program tells the aircraft where its operator is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from mavproxy_handover.config.toml import one_table
from mavproxy_handover.tools.key_table import KeyTable, number, word

__all__ = ["REMOTE_ID", "RemoteIdSettings", "remote_id_settings"]

COMPANION, STATION = _SENDERS = ("companion", "station")


@dataclass(frozen=True, slots=True)
class RemoteIdSettings:
    """Of one vehicle. `companion`: the companion sends if the commander's own program does not."""

    companion: bool = True
    category_eu: int = 0
    class_eu: int = 0


REMOTE_ID: Final = KeyTable(
    "remote_id",
    (
        word(
            "sends",
            _SENDERS,
            "companion: it sends place and id of the commander's operator while the commander's own program sends "
            "none; station: only the commander's program does",
            COMPANION,
        ),
        number(
            "category_eu", 0, 3, "category of the flight in the EU: 0 undeclared, 1 open, 2 specific, 3 certified", 0.0
        ),
        number("class_eu", 0, 7, "class of the aircraft in the EU: 0 undeclared, 1 to 7: C0 to C6", 0.0),
    ),
    "Remote ID: the operator's place follows authority (docs/feeds.md). Places: 'place' in the mission's [[stations]], "
    "or what a station's own program sends (OPEN_DRONE_ID_SYSTEM). Ids: operator_id in [[station]].",
)


def remote_id_settings(data: Mapping[str, Any], path: Path) -> RemoteIdSettings:
    """Parse `[remote_id]`, if it is there. Raises ConfigError."""
    table = one_table(data, REMOTE_ID, path)
    return RemoteIdSettings(table["sends"] == COMPANION, int(table["category_eu"]), int(table["class_eu"]))
