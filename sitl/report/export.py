# SPDX-License-Identifier: GPL-3.0-or-later

"""A flight for other programs: KML for maps, CSV for tables.

Longitude comes before latitude in KML, altitude is metres above home there (`relativeToGround` is what comes nearest:
a map program knows no home). The CSV has a row for each position, with what held at that moment.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Sequence
from datetime import datetime, timezone
from pathlib import Path
from xml.etree import ElementTree as Xml

from mavproxy_handover.core.common.levels import Level
from sitl.report.evidence import Evidence
from sitl.report.exchange import exchanges
from sitl.report.flight import Story
from sitl.report.journal_reader import Entry
from sitl.report.outcome import emergencies
from sitl.report.palette import ALARM, NOBODY_COLOUR, WARNING, colours
from sitl.report.record import RunRecord
from sitl.report.times import Times
from sitl.report.track import nearest, pieces
from sitl.report.watch import VEHICLE, Sample

__all__ = ["COLUMNS", "write_csv", "write_kml"]

_NAMESPACE = "http://www.opengis.net/kml/2.2"
COLUMNS = (
    "vehicle", "utc", "t_plus_s", "lat_deg", "lon_deg", "alt_m", "speed_mps", "heading_deg", "mode", "armed",
    "commander", "epoch", "phase", "lease", "guard", "battery_percent", "battery_v", "emergency",
)  # fmt: skip


# ---- CSV ----------------------------------------------------------------------------------------------------------


def write_csv(record: RunRecord, path: Path) -> None:
    """Write the table. Raises OSError."""
    with path.open("w", encoding="utf-8", errors="replace", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for story in record.stories:
            writer.writerows(_rows(story))


def _rows(story: Story) -> Iterator[tuple[object, ...]]:
    evidence = story.evidence
    times = Times(evidence)
    stretches = emergencies(evidence)
    views = evidence.of(event="view")
    end_t = evidence.companion_ended_t()
    held = {
        "mode": _series(evidence.of(VEHICLE, "mode"), lambda entry: entry.get("mode")),
        "armed": _series(
            [entry for entry in evidence.of(VEHICLE) if entry.event in ("armed", "disarmed")],
            lambda entry: int(entry.event == "armed"),
        ),
        "commander": _series(views, lambda entry: evidence.station_name(entry.get("commander"))),
        "epoch": _series(views, lambda entry: entry.get("epoch")),
        "phase": _series(views, lambda entry: entry.get("phase")),
        "lease": _series(views, lambda entry: entry.get("lease")),
        "guard": _series(evidence.of(event="guard"), lambda entry: entry.text.rsplit("->", 1)[-1].strip()),
        "percent": _series(evidence.of(VEHICLE, "battery"), lambda entry: entry.get("percent")),
        "volts": _series(evidence.of(VEHICLE, "battery"), lambda entry: entry.get("volts")),
    }
    for sample in evidence.samples:
        at = times.at(sample.t)
        now = {name: series(sample.t) for name, series in held.items()}
        if sample.t > end_t:  # its last word says nothing any more
            now |= {"commander": "nobody", "phase": None, "lease": None}
        yield (
            story.vehicle,
            "" if at is None else at.isoformat(timespec="milliseconds"),
            round(times.plus_s(sample.t), 3),
            f"{sample.lat_deg:.7f}",
            f"{sample.lon_deg:.7f}",
            sample.alt_m,
            sample.speed_mps,
            sample.heading_deg,
            *(now[name] for name in ("mode", "armed", "commander", "epoch", "phase", "lease", "guard")),
            now["percent"],
            now["volts"],
            next((each.why for each in stretches if each.begin_t <= sample.t <= each.end_t), ""),
        )


def _series(entries: Sequence[Entry], value: Callable[[Entry], object]) -> Callable[[float], object]:
    """The value of a series of entries at moments in rising order."""
    place = -1

    def at(t: float) -> object:
        nonlocal place
        while place + 1 < len(entries) and entries[place + 1].t <= t:
            place += 1
        return value(entries[place]) if place >= 0 else None

    return at


# ---- KML ----------------------------------------------------------------------------------------------------------


def write_kml(record: RunRecord, path: Path) -> None:
    """Write tracks, zones and what happened. Raises OSError."""
    Xml.register_namespace("", _NAMESPACE)
    root = Xml.Element(f"{{{_NAMESPACE}}}kml")
    document = _add(root, "Document")
    _add(document, "name", record.title)
    for story in record.stories:
        _vehicle(document, story)
    tree = Xml.ElementTree(root)
    Xml.indent(tree)
    tree.write(path, encoding="utf-8", xml_declaration=True)


def _vehicle(document: Xml.Element, story: Story) -> None:
    evidence = story.evidence
    times = Times(evidence)
    paint = colours(evidence.stations)
    folder = _add(document, "Folder")
    _add(folder, "name", story.vehicle)
    _zones(folder, evidence, paint)
    for name, piece in pieces(evidence, evidence.samples):
        words = f"{name} commands, from {times.plus(piece[0].t)}"
        _line(folder, words, piece, paint.get(name, NOBODY_COLOUR), 4, times)
    for stretch in emergencies(evidence):
        piece = [sample for sample in evidence.samples if stretch.begin_t <= sample.t <= stretch.end_t]
        if len(piece) > 1:
            name, colour = stretch.word, ALARM if stretch.level is Level.EMERGENCY else WARNING
            _line(folder, f"{name}: {stretch.why}", piece, colour, 9, times)
    for transfer in exchanges(evidence):
        sample = nearest(evidence.samples, transfer.ended_t or transfer.begun_t)
        if sample is not None:
            outcome = "" if transfer.committed else f" came to nothing: {transfer.reason.replace('_', ' ')}"
            words = f"handover {transfer.handover_id}, {transfer.commander} to {transfer.partner}{outcome}"
            _point(folder, words, sample, times)


def _zones(folder: Xml.Element, evidence: Evidence, paint: dict[str, str]) -> None:
    mission = evidence.mission
    for zone in mission.zones if mission is not None else ():
        outline = zone.outline()
        for part in getattr(outline, "geoms", [outline]):
            mark = _placemark(folder, f"zone of {zone.station_name}")
            colour = paint.get(zone.station_name, NOBODY_COLOUR)
            style = _add(mark, "Style")
            _add(_add(style, "LineStyle"), "color", _colour(colour, 255))
            _add(_add(style, "PolyStyle"), "color", _colour(colour, 40))
            polygon = _add(mark, "Polygon")
            for kind, ring in (
                ("outerBoundaryIs", part.exterior), *(("innerBoundaryIs", inner) for inner in part.interiors)
            ):  # fmt: skip
                places = " ".join(f"{lon:.7f},{lat:.7f}" for lon, lat in ring.coords)
                _add(_add(_add(polygon, kind), "LinearRing"), "coordinates", places)


def _line(folder: Xml.Element, words: str, piece: Sequence[Sample], colour: str, width: int, times: Times) -> None:
    mark = _placemark(folder, words)
    begin, end = times.at(piece[0].t), times.at(piece[-1].t)
    if begin is not None and end is not None:
        span = _add(mark, "TimeSpan")
        _add(span, "begin", _stamp(begin))
        _add(span, "end", _stamp(end))
    style = _add(_add(mark, "Style"), "LineStyle")
    _add(style, "color", _colour(colour, 255))
    _add(style, "width", str(width))
    line = _add(mark, "LineString")
    _add(line, "altitudeMode", "relativeToGround")
    _add(line, "coordinates", " ".join(_place(sample) for sample in piece))


def _point(folder: Xml.Element, words: str, sample: Sample, times: Times) -> None:
    mark = _placemark(folder, words)
    at = times.at(sample.t)
    if at is not None:
        _add(_add(mark, "TimeStamp"), "when", _stamp(at))
    point = _add(mark, "Point")
    _add(point, "altitudeMode", "relativeToGround")
    _add(point, "coordinates", _place(sample))


def _placemark(folder: Xml.Element, words: str) -> Xml.Element:
    mark = _add(folder, "Placemark")
    _add(mark, "name", words)
    return mark


def _add(parent: Xml.Element, tag: str, text: str | None = None) -> Xml.Element:
    child = Xml.SubElement(parent, f"{{{_NAMESPACE}}}{tag}")
    child.text = text
    return child


def _place(sample: Sample) -> str:
    return f"{sample.lon_deg:.7f},{sample.lat_deg:.7f},{sample.alt_m:.2f}"


def _colour(colour: str, alpha: int) -> str:
    """KML's order is alpha, blue, green, red."""
    return f"{alpha:02x}{colour[5:7]}{colour[3:5]}{colour[1:3]}".lower()


def _stamp(at: datetime) -> str:
    return at.astimezone(timezone.utc).isoformat(timespec="milliseconds").replace("+00:00", "Z")
