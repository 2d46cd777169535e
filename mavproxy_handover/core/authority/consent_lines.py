# SPDX-License-Identifier: GPL-3.0-or-later

"""Check of the lines `consent` in the vehicle's file: which ones handovers need.

The question to an operator, its answers and what they change are in `transfer.py`; the time limits in
`core/common/limits.py`.

A station without our module may have a program that cannot ask its operator. Then the vehicle's file must answer for it
(`consent` in its `[[station]]`). START, `handover check` and `handover doctor` use the same rule.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

from mavproxy_handover.core.common.model import StandingConsent, Station

__all__ = ["refused_on_route", "without_consent"]


def without_consent(stations: Collection[Station], shown: Collection[int] = ()) -> tuple[str, ...]:
    """Each station that cannot be asked and has no `consent`, in words that say what to write where.

    `shown`: system ids of the stations whose program has shown in this run that it can ask its operator. With one
    station there is no handover, and nothing to consent to.
    """
    if len(stations) < 2:
        return ()
    return tuple(
        f'{station.name} cannot be asked for consent: write consent = "automatic" or consent = "refuse" in its '
        "[[station]] of the vehicle's file"
        for station in stations
        if station.standard and station.consent is None and station.sysid not in shown
    )


def refused_on_route(stations: Collection[Station], route: Sequence[int]) -> tuple[str, ...]:
    """Each handover of the route that `consent = "refuse"` prevents, in words. `route`: its commanders, in order."""
    known = {station.sysid: station for station in stations}
    names = [known[sysid].name if sysid in known else f"station {sysid}" for sysid in route]
    return tuple(
        f'{known[sysid].name} has consent = "refuse", and the route needs {names[at]} -> {names[at + 1]}'
        for at in range(len(route) - 1)
        for sysid in route[at : at + 2]
        if sysid in known and known[sysid].consent is StandingConsent.REFUSE
    )
