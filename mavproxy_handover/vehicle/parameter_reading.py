# SPDX-License-Identifier: GPL-3.0-or-later

"""The conversation that reads parameters of the autopilot.

ArduPilot does not answer a request for a parameter that it does not have, so each missing name costs a time-out. The
parameters are requested together, and again only those that have not come.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.wire.conversation import Ask, Asking, NoAnswer
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID

__all__ = ["reading"]

#: ArduPilot keeps 20 requests and drops the rest
_AT_ONCE: Final = 16
_WAIT_S: Final = 0.4
_TRIES: Final = 3


def reading(sysid: int, names: tuple[str, ...]) -> Asking:
    """Ask the autopilot of system `sysid` for parameters. Returns name -> value of those that it answered."""
    values: dict[str, float] = {}
    for start in range(0, len(names), _AT_ONCE):
        batch = names[start : start + _AT_ONCE]
        lacking: set[str] = set()
        for _ in range(_TRIES):
            missing = [name for name in batch if name not in values and name not in lacking]
            if not missing:
                break
            requests = tuple(_request(sysid, name) for name in missing)
            try:
                yield Ask("parameters", requests, _collector(missing, values, lacking), timeout_s=_WAIT_S, tries=1)
            except NoAnswer:
                continue
    return values


def _request(sysid: int, name: str) -> Any:
    return mavlink.MAVLink_param_request_read_message(sysid, AUTOPILOT_COMPID, name.encode("ascii"), -1)


def _collector(wanted: list[str], values: dict[str, float], lacking: set[str]) -> Callable[[Any], Any]:
    """Collects the answers; the request is answered when no wanted name is missing."""

    def answer(m: Any) -> Any:
        kind = m.get_type()
        if kind not in ("PARAM_VALUE", "PARAM_ERROR") or m.param_id not in wanted:
            return None
        if kind == "PARAM_ERROR":
            lacking.add(m.param_id)
        elif math.isfinite(m.param_value):
            values[m.param_id] = float(m.param_value)
        return True if all(name in values or name in lacking for name in wanted) else None

    return answer
