# SPDX-License-Identifier: GPL-3.0-or-later

"""Findings of the doctor: one for each thing that was checked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from mavproxy_handover.wire.signing import SignatureVerdict, SignedPeer

__all__ = ["Finding", "Level", "badly_signed", "error", "ok", "unseen", "warning"]


class Level(Enum):
    """Severity. An error prevents a flight, or makes it go wrong."""

    OK = "ok"
    WARNING = "warning"
    ERROR = "error"


@dataclass(frozen=True, slots=True)
class Finding:
    """The result for one thing.

    `do`: what to do about it, one sentence; "" if all is well. `looked`: False if it could not be checked.
    """

    level: Level
    what: str
    found: str
    do: str = ""
    looked: bool = True


def ok(what: str, found: str) -> Finding:
    """A finding without a fault."""
    return Finding(Level.OK, what, found)


def warning(what: str, found: str, do: str) -> Finding:
    """A finding that may be intended, and may do harm one day."""
    return Finding(Level.WARNING, what, found, do)


def error(what: str, found: str, do: str) -> Finding:
    """A finding of a fault."""
    return Finding(Level.ERROR, what, found, do)


def badly_signed(what: str, end: str, verdicts: Sequence[SignatureVerdict], peer: SignedPeer | None) -> Finding:
    """A finding that frames of the other end are there, and their signatures are not accepted."""
    if SignatureVerdict.TOO_OLD in verdicts and peer is not None:
        found = f"heard, and its signatures are {peer.behind_s:.0f} s older than this clock"
        return error(what, found, "Set both clocks by the same source (timedatectl).")
    found = f"heard, and its frames are not signed with its key: {', '.join(each.value for each in verdicts)}"
    do = f"Compare the fingerprints of {end} at both ends (handover keys list), and copy one key to the other."
    return error(what, found, do)


def unseen(what: str, why: str, do: str) -> Finding:
    """A finding that the thing could not be checked, so its state is unknown."""
    return Finding(Level.WARNING, what, f"not looked at: {why}", do, looked=False)
