# SPDX-License-Identifier: GPL-3.0-or-later

"""Advice to both operators: why a station cannot be partner, why a handover did not happen, and what to do."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from mavproxy_handover.core.common.model import Reason, in_words

__all__ = ["PEOPLES_WORD", "cure", "ended"]

#: why a station cannot be partner -> the sentences; {name}: the station
_CURES: Final[Mapping[Reason, str]] = {
    Reason.PARTNER_SILENT: "{name} does not answer. Check its program and its link.",
    Reason.VERSION_DIFFERS: "{name} has another version of the handover module. Install the vehicle's version.",
    Reason.MISSION_DIFFERS: "{name} has another mission. Send it with 'handover share'.",
    Reason.MISSION_MISSING: "{name} has no mission. The vehicle sends it in flight; 'handover share' does as well.",
    Reason.UNMANNED: "No operator is on duty at {name}. Its operator signs on with 'handover operator NAME'.",
    Reason.CONSENT_REFUSED: '{name} takes no handover: the vehicle\'s file says consent = "refuse".',
}

#: why a handover did not happen -> the sentences; {commander}, {partner}: its stations
_ENDED: Final[Mapping[Reason, str]] = {
    Reason.PARTNER_REFUSED: "{partner}'s operator denied it.",
    Reason.COMMANDER_DENIED: "{commander}'s operator denied it.",
    Reason.PARTNER_UNANSWERED: "{partner}'s operator did not answer.",
    Reason.COMMANDER_UNANSWERED: "{commander}'s operator did not answer.",
    Reason.PARTNER_SILENT: "{partner} does not answer. Check its program and its link.",
    Reason.COMMANDER_SILENT: "{commander} does not answer. Check its program and its link.",
    Reason.CANNOT_BE_ASKED: "{commander}'s program cannot ask its operator. Set its consent in the vehicle's file.",
    Reason.CONSENT_REFUSED: '{commander} gives no handover: the vehicle\'s file says consent = "refuse".',
}
#: those of them that are an operator's answer, or the lack of one
PEOPLES_WORD: Final = frozenset(_ENDED) - {Reason.PARTNER_SILENT, Reason.COMMANDER_SILENT}


def cure(name: str, why: Reason) -> str:
    """Why the station `name` cannot be partner, and what to do about it."""
    text = _CURES.get(why)
    return f"{name} cannot be partner: {in_words(why)}." if text is None else text.format(name=name)


def ended(why: Reason, commander: str, partner: str) -> str:
    """Why the handover from `commander` to `partner` did not happen."""
    text = _ENDED.get(why)
    return f"{in_words(why)}." if text is None else text.format(commander=commander, partner=partner)
