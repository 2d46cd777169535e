# SPDX-License-Identifier: GPL-3.0-or-later

"""Prints the report of the check of a mission for people (`check.py` judges)."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from math import isfinite

from mavproxy_handover.mission.addresses import ADDRESSES_FILE
from mavproxy_handover.mission.check import TRIES, CheckReport, Severity
from mavproxy_handover.mission.check_payload import payload_words
from mavproxy_handover.mission.check_words import battery_words, minutes_words, position_words
from mavproxy_handover.mission.energy import Budget
from mavproxy_handover.mission.package import MISSION_FILE, MissionPackage
from mavproxy_handover.mission.path import Path

__all__ = ["report_text"]


def _energy_line(report: CheckReport) -> str:
    budget = report.energy
    if budget is None:
        return f"unknown: {report.package.energy.missing} in {MISSION_FILE}"
    wind, ahead = budget.model.wind, budget.model.headwind_mps
    if wind is None:
        words = f"{ahead:g} m/s from ahead wherever it flies"
    else:
        words = f"{wind.speed_mps:g} m/s from {wind.from_deg:g} degrees"
    if not isfinite(budget.need_wh):
        return f"the route cannot be flown; wind: {words}"
    return f"the route takes {budget.need_wh:.1f} Wh, with the reserve {battery_words(budget)}; wind: {words}"


def _wings_lines(report: CheckReport) -> Iterator[str]:
    air, package = report.air, report.package
    if air is None:
        return
    wings = package.route.wings
    if air.wind is None:
        blows = f"wind up to {air.wind_mps:g} m/s from anywhere"
    else:
        blows = f"wind {air.wind.speed_mps:g} m/s from {air.wind.from_deg:g} degrees"
    radius = wings.turn_radius_m(air.fastest_mps)
    yield (
        f"wings       {package.profile.name}, airspeed {air.airspeed_mps:g} m/s, {blows}: up to "
        f"{air.fastest_mps:g} m/s over ground, turns of {radius:.0f} m at {wings.bank_deg:g} degrees"
    )


def _turn_rows(path: Path) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = [("at item", "turn", "radius", "outside", "begins")]
    for turn in path.turns:
        angle = "circle" if turn.circle else f"{turn.angle_deg:.0f} deg"
        outside = "-" if turn.circle else f"{turn.outside_m:.0f} m"
        rows.append((str(turn.seq), angle, f"{turn.radius_m:.0f} m", outside, f"{turn.begins_m:.0f} m"))
    return rows


def _crossed_line(report: CheckReport) -> str:
    if not report.crossed:
        return ""
    longest_s = max(stretch.declared.limit_s for stretch in report.crossed)
    count = len(report.crossed)
    return f"; {count} gap{'s' if count > 1 else ''} crossed alone: HNDO_ALONE_MAX {longest_s:g} or more"


def _wh(energy_wh: float) -> str:
    """Text of an energy (Wh); infinite if it cannot be flown."""
    return f"{energy_wh:.1f} Wh" if isfinite(energy_wh) else "-"


def _energy_rows(budget: Budget) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = [
        ("to item", "length", "speed", "power", "needs", "left", "back to", "needs", "margin")
    ]
    for item in budget.items:
        made, back = item.made, item.back
        rows.append(
            (
                str(item.seq),
                f"{item.length_m:.0f} m",
                f"{made.speed_mps:.1f} m/s" if made is not None else "-",
                f"{made.power_w:.0f} W" if made is not None and made.speed_mps > 0.0 else "-",
                _wh(item.need_wh),
                _wh(item.left_wh),
                back.place if back is not None else "-",
                _wh(back.need_wh) if back is not None else "-",
                _wh(back.margin_wh) if back is not None else "-",
            )
        )
    return rows


def _table(rows: list[tuple[str, ...]], words: Collection[int]) -> Iterator[str]:
    """The rows as lines. The columns of `words` are aligned to the left; the others are numbers."""
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    for row in rows:
        cells = [
            cell.ljust(width) if column in words else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        yield "  " + "  ".join(cells)


def _address_lines(package: MissionPackage) -> Iterator[str]:
    if package.addresses:
        listed = [
            f"{each.name} {', '.join(address.text for address in package.addresses.get(each.sysid, ())) or 'none'}"
            for each in package.stations
        ]
        yield f"addresses   {'; '.join(listed)} ({ADDRESSES_FILE}, not in the digest)"


def report_text(report: CheckReport) -> str:
    """The report as a table to print, without a line end at its end."""
    package, simulation = report.package, report.simulation
    names = {station.sysid: station.name for station in package.stations}
    gap = sum(gap.length_m for gap in simulation.gaps)
    covered = 100.0 * (1.0 - gap / simulation.length_m) if simulation.length_m > 0.0 else 100.0
    lines = [
        f"mission     {package.name}  ({', '.join(package.files)}; digest {package.digest.hex()[:12]})",
        f"stations    {', '.join(f'{s.name} ({s.sysid})' for s in package.stations)}; zones from {package.detector}",
        f"route       {len(package.route.items)} items, {simulation.length_m / 1000.0:.2f} km, at least "
        f"{minutes_words(simulation.duration_s)} at {package.cruise_speed_mps:g} m/s, "
        f"{len(package.route.rally)} rally points",
        f"coverage    {covered:.1f} % of the route{_crossed_line(report)}",
        f"commanders  {' -> '.join(names[sysid] for sysid in simulation.commanders)}",
        f"energy      {_energy_line(report)}",
        *_wings_lines(report),
        *(f"payload     {words}" for words in (payload_words(package),) if words),
        *_address_lines(package),
    ]
    if simulation.handovers:
        rows: list[tuple[str, ...]] = [
            ("#", "from", "to", "starts at", "along", "after", "to item", "overlap", "time", "needed")
        ]
        for number, handover in enumerate(simulation.handovers, 1):
            rows.append(
                (
                    str(number),
                    names[handover.from_station],
                    names[handover.to_station],
                    position_words(handover.lat_deg, handover.lon_deg),
                    f"{handover.distance_along_m:.0f} m",
                    f"{handover.time_s:.0f} s",
                    str(handover.seq),
                    f"{handover.overlap_length_m:.0f} m",
                    f"{handover.overlap_s:.1f} s",
                    f"{TRIES * report.transfer_s:g} s",
                )
            )
        lines += ["", *_table(rows, (1, 2, 3))]
    if report.path is not None and report.path.turns:
        lines += ["", *_table(_turn_rows(report.path), ())]
    if report.energy is not None:
        lines += ["", *_table(_energy_rows(report.energy), (6,))]
    if report.findings:
        lines.append("")
        lines += [f"{finding.severity.value + ':':9}{finding.text}" for finding in report.findings]
    errors, warnings = report.count(Severity.ERROR), report.count(Severity.WARNING)
    lines += ["", f"check {'failed' if errors else 'passed'}: {errors} errors, {warnings} warnings"]
    return "\n".join(lines)
