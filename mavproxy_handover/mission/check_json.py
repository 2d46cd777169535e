# SPDX-License-Identifier: GPL-3.0-or-later

"""The report of the check of a mission for programs (`check.py` judges)."""

from __future__ import annotations

from math import isfinite
from typing import Any

from mavproxy_handover.mission.check import TRIES, CheckReport, Severity
from mavproxy_handover.mission.energy import Budget

__all__ = ["report_json"]


def report_json(report: CheckReport) -> dict[str, Any]:
    """The report as one object of plain values. Distances in m, times in s, energies in Wh (null: cannot be flown)."""
    package, simulation = report.package, report.simulation
    names = {station.sysid: station.name for station in package.stations}
    return {
        "mission": package.name,
        "digest": package.digest.hex(),
        "passed": report.exit_code == 0,
        "errors": report.count(Severity.ERROR),
        "warnings": report.count(Severity.WARNING),
        "findings": [
            {"severity": each.severity.value, "rule": each.rule, "item": each.item, "text": each.text}
            for each in report.findings
        ],
        "route": {
            "aircraft": package.profile.name,
            "items": len(package.route.items),
            "length_m": round(simulation.length_m, 1),
            "duration_s": round(simulation.duration_s, 1),
            "cruise_speed_mps": package.cruise_speed_mps,
            "rally_points": len(package.route.rally),
            "uncovered_m": round(sum(gap.length_m for gap in simulation.gaps), 1),
        },
        "commanders": [names[sysid] for sysid in simulation.commanders],
        "handovers": [
            {
                "from": names[each.from_station],
                "to": names[each.to_station],
                "lat_deg": round(each.lat_deg, 7),
                "lon_deg": round(each.lon_deg, 7),
                "along_m": round(each.distance_along_m, 1),
                "after_s": round(each.time_s, 1),
                "item": each.seq,
                "overlap_m": round(each.overlap_length_m, 1),
                "overlap_s": round(each.overlap_s, 1),
                "needed_s": TRIES * report.transfer_s,
            }
            for each in simulation.handovers
        ],
        "energy": None if report.energy is None else _energy(report.energy),
    }


def _energy(budget: Budget) -> dict[str, Any]:
    return {
        "need_wh": _finite(budget.need_wh),
        "with_reserve_wh": _finite(budget.budget_wh),
        "battery_wh": budget.model.battery_wh,
        "no_return_m": _finite(budget.no_return_m),
        "items": [
            {
                "item": each.seq,
                "need_wh": _finite(each.need_wh),
                "left_wh": _finite(each.left_wh),
                "back_to": None if each.back is None else each.back.place,
                "back_margin_wh": None if each.back is None else _finite(each.back.margin_wh),
            }
            for each in budget.items
        ],
    }


def _finite(value: float | None) -> float | None:
    return None if value is None or not isfinite(value) else round(value, 2)
