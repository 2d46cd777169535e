# SPDX-License-Identifier: GPL-3.0-or-later

"""Values of the vehicle's sentences that are one of some words: name in a template -> pattern."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Final

from mavproxy_handover.core.authority.control import ControlResult
from mavproxy_handover.core.common.model import GuardState, Reason, in_words
from mavproxy_handover.core.feeds import NAMES, FeedKind
from mavproxy_handover.core.safety.commands import Limit, Outcome
from mavproxy_handover.core.safety.mode_source import Change
from mavproxy_handover.gate.judge import GateReason

__all__ = ["WORDS"]


def _one_of(words: Iterable[str]) -> str:
    return "|".join(re.escape(word) for word in words)


_NUMBER: Final = r"-?\d+(?:\.\d+)?"

WORDS: Final[Mapping[str, str]] = {
    "feed": _one_of(NAMES.values()),
    "baud": r"\d+",
    "claims": r"[!-~]+(?: [a-z]+)* \d+(?:\.\d+)?(?:, .*)?",
    "feed_key": _one_of(kind.value for kind in FeedKind),
    "apart": rf"{_NUMBER} k?m",
    "word": "START|STOP|CONTINUE",
    "payload_kind": "gimbal|camera|winch",
    "payload_kinds": "(?:gimbal|camera|winch)(?:, (?:gimbal|camera|winch))*",
    "payload_file": "mission|vehicle's file",
    "cancels": r"another one was requested|the companion commands|the autopilot is in [\w ]+ now",
    "rehearse": "REHEARSE|REHEARSE END",
    "list": "mission|geofence|rally points|plan",
    "field": "latitude|longitude|altitude|command|frame|parameter \\d",
    "place": r"home|place found in the list|rally \d+|[\w.-]+(?: \d+)?",
    "source": r"the vehicle's own package|[\w.-]+",
    "how": "armed and in AUTO|airborne|carried, in a rehearsal",
    "kind": r"[\w ]+",
    "operator": r"[^\W_][\w .'-]{0,29}",
    "before": r"[^\W_][\w .'-]{0,29}",
    "other_kind": r"[\w ]+",
    "left": r"-?\d+ ?%",
    "limit_name": _one_of(limit.value for limit in Limit),
    "passes": _one_of(outcome.value for outcome in Outcome),
    "where": rf"at once(?: \(item \d+\))?|(?:in|within) {_NUMBER} m(?: \(item \d+\))?|flight|a rehearsal",
    "stream": r"[A-Za-z]+(?: [a-z]+)*",
    "ended": r"released \(rc all 0\) or has paused for 3 s|switched off for 3 s|stopped for 3 s",
    "gate_reason": _one_of(reason.value for reason in GateReason),
    "reason_name": _one_of(in_words(reason) for reason in Reason),
    "chosen": "|".join((r"chosen by [\w.-]+", _one_of(change.value for change in Change))),
    "disobeyed": "the autopilot does not follow|the autopilot refuses it",
    "gap": rf"It crosses the mission's gap [\w.-]+ -> [\w.-]+, (?:{_NUMBER} s left|at most {_NUMBER} s)",
    "gap_name": r"[\w.-]+ -> [\w.-]+",
    "breach": "too low|too high|its border|breached",
    "track": rf"{_NUMBER} m(?: (?:right|left) of (?:the leg to waypoint \d+|it))?",
    "work": r"[\w ,]+",
    "quality": "weak|good again",
    "link_news": r"link \S+ (?:degraded|restored): [a-z ]+ \S+(?: \w+)?, limit \S+(?: \w+)?",
    "figure": r"\S+(?: (?:s|datagrams))?",
    "figure_limit": r"\S+(?: (?:s|datagrams))?",
    "speaks": "speaks|no longer speaks",
    "asks": "requests|releases",
    "control_result": _one_of(result.name.lower() for result in ControlResult),
    "cause_kind": "gap|emergency|warning",
    "guard_before": _one_of(state.name.lower() for state in GuardState),
    "guard_now": _one_of(state.name.lower() for state in GuardState),
    "item": r"items? [\w ,]+ \(\w+(?: first)?\)(?: and \d+ more)?(?: above sea)?",
    "speed_of": "the mission's cruise speed|the speed of a return",
    "speed_is": "slower|faster",
    "layout": r"'\w+'",
    "other_layout": r"'\w+'",
    "other_parameter": r"[A-Z][A-Z0-9_]+",
    "age": "older than the oldest|newer than the newest",
    "circle": "never ends|takes longer, and more energy, than was counted",
    "missing": r"(?:RTL_AUTOLAND is not 1|the mission has no landing sequence \(DO_LAND_START\))(?:, and "
    "Q_RTL_MODE is 0)?",
    "layout_name": r"\w+",
    "why_over": r"under way|[\w ]+",
    "battery_name": r"BATT\d*",
    "energy_keys": "cruise_w nor hover_w|hover_w nor mass_kg",
    "pack": r"battery \d+",
}
