# SPDX-License-Identifier: GPL-3.0-or-later

"""Faults that tests and exploration need not notice, by module of the core, each with the reason."""

from __future__ import annotations

__all__ = ["KNOWN_SURVIVORS"]

KNOWN_SURVIVORS: dict[str, dict[str, str]] = {
    "model": {
        "AuthorityView.armed: truth turned: False": "no view of the vehicle leaves it out; only tests do",
    },
    "messages": {
        "before: comparison turned: self.epoch < other.epoch": "it is asked only of two epochs that differ",
    },
    "flight": {
        "__init__: truth turned: False in self._guard_ours = False": (
            "until the guard has spoken it is silent, and then it does not matter whose leases it answers"
        ),
    },
    "presence": {
        "unfit: dropped from and/or: self.answer is None: not self.connected(now) or self.answer is None": (
            "who is connected has answered: the answer and its time are set together; the type checker wants it said"
        ),
    },
    "zones": {
        "update: comparison turned: fact.margin_m > known.margin_m": (
            "of two zones of one station with exactly the same distance to the border either is the best"
        ),
        "update: dropped: self._fresh.discard(station)": (
            "a station without a zone is not chosen, and whose zone comes back and is entered is fresh again"
        ),
        "update: dropped: self._fresh.discard(station) (number 2)": (
            "whose zone is left is not chosen, and whose zone is entered again is fresh again"
        ),
    },
    "conductor": {
        "begin: truth turned: False in self, partner: int, reason: Reason, now: float, actions: list[Action], *, "
        "consented: bool=": "who leaves it out begins a forced one, and that needs no consent",
        "imply: dropped: return": "it is called only while a transfer is under way; the type checker wants it said",
        "_end: dropped: self.echo.forget()": (
            "what was noted and came to nothing is not repeated before another transfer commits, and that one has "
            "forgotten it, or noted its own request, when it began"
        ),
    },
    "arbiter": {
        "Identity.nonce: number one more: 1": "where the edge draws no number any will do",
        "_expire: dropped from and/or: authority.owner is not None: "
        "authority.recover_until is not None and now >= authority.recover_until and (authority.owne": (
            "the time to come back is set together with an owner, and while it runs nobody commands who could release; "
            "the type checker wants it said"
        ),
        "_grant_parent: dropped from and/or: authority.owner != parent: gone and authority.owner != parent": (
            "a parent that is lost is not heard, so not fit; and when it is heard it is not lost any more"
        ),
    },
}
