# SPDX-License-Identifier: GPL-3.0-or-later

"""Messages of a transfer in the station's journal."""

from __future__ import annotations

from mavproxy_handover.core.messages import Message
from mavproxy_handover.store.journal import Journal
from mavproxy_handover.wire import codec

__all__ = ["journal_message"]


def journal_message(journal: Journal, direction: str, message: Message, who: str, via: str | None = None) -> None:
    """One line for a message of a transfer, "in" or "out"; none for others. `via`: None is the vehicle's link."""
    key = getattr(message, "key", None)
    if key is None:
        return
    journal.write(
        "message",
        direction=direction,
        name=codec.name_of(message),
        station=who,
        handover_id=key.handover_id,
        epoch=key.epoch,
        via=via,
        relayed=getattr(message, "relayed", False) or None,
        consent=message.consent.name.lower() if hasattr(message, "consent") else None,
    )
