# SPDX-License-Identifier: GPL-3.0-or-later

"""Faults that tests and exploration need not notice, by module of the core, each with the reason."""

from __future__ import annotations

__all__ = ["KNOWN_SURVIVORS"]

KNOWN_SURVIVORS: dict[str, dict[str, str]] = {
    "transfer": {
        "__init__: truth turned: False (number 3)": "the first step is entered at once, and that sets it anew",
        "implied: dropped from and/or: commander_standard: self.consented or commander_standard": (
            "a station of the standard consents by its command, which is `consented`; one that speaks our word "
            "without our module is relieved two seconds later all the same"
        ),
    },
    "arbiter": {
        "handle: dropped: self._handover.seek(now, actions)": "the next position seeks too, twenty times a second",
        "_expire: dropped from and/or: authority.owner is not None: "
        "authority.recover_until is not None and now >= authority.recover_until and (authority.owne": (
            "the time to come back is set with the one who may"
        ),
        "_lose_owner: dropped: self._candidates.forget_pauses()": "they are forgotten again before anything is begun",
        "_on_mission: dropped: self._authority.refresh(Reason.NONE, actions)": "the view says nothing of the mission",
        "_grant_parent: dropped from and/or: authority.owner != parent: gone and authority.owner != parent": (
            "a parent that is lost is not heard, so not fit; and when it is heard it is not lost any more"
        ),
    },
    "authority": {
        "grounded: dropped from and/or: self.phase is Phase.ON_LOAD: "
        "self._flight.disarmed(now) and self.phase is Phase.ON_LOAD and (not self.starting)": (
            "what disarms in another phase has landed, in the same event"
        ),
    },
}
