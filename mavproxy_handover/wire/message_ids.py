# SPDX-License-Identifier: GPL-3.0-or-later

"""The messages of the installed dialect: numbers by name, and names by number."""

from __future__ import annotations

from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

__all__ = ["COMMAND_MESSAGES", "MESSAGE_IDS", "MESSAGE_NAMES", "message_ids"]

MESSAGE_NAMES: Final[dict[int, str]] = {msgid: cls.msgname for msgid, cls in mavlink.mavlink_map.items()}
MESSAGE_IDS: Final[dict[str, int]] = {name: msgid for msgid, name in MESSAGE_NAMES.items()}
#: the messages that carry a MAV_CMD
COMMAND_MESSAGES: Final = frozenset((MESSAGE_IDS["COMMAND_LONG"], MESSAGE_IDS["COMMAND_INT"]))


def message_ids(*names: str) -> frozenset[int]:
    """The ids of these messages. A name that the dialect does not know is left out."""
    return frozenset(MESSAGE_IDS[name] for name in names if name in MESSAGE_IDS)
