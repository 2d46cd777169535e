# SPDX-License-Identifier: GPL-3.0-or-later

"""The report of a run or of a flight: one HTML file that needs nothing else. `handover report PATH...`.

Everything in it comes from its input files (`record.py`), so a report can be made again at any time. The outcome stands
first; then map and timeline, into which one can look; each kind of handover once and the odd ones in full; refusals and
decisions; and where all that comes from. Of several vehicles each has all of that.

`map.png` beside the page of a folder is its map for a printed report.
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import quote

from mavproxy_handover.core.common.levels import Level
from mavproxy_handover.core.common.model import journal_in_words
from mavproxy_handover.tools.command_line import CommandParser
from sitl.report.exchange import Exchange, exchanges
from sitl.report.export import write_csv, write_kml
from sitl.report.feeds import feed_spans, onboard_spans, unused
from sitl.report.flight import Story
from sitl.report.journal_reader import Entry
from sitl.report.kinds import kinds
from sitl.report.operators import agreed, operators
from sitl.report.outcome import Gravity, level_of, outcome
from sitl.report.record import RecordError, RunRecord, load
from sitl.report.rehearsal import books, tables
from sitl.report.script import figure, library
from sitl.report.sequence import draw
from sitl.report.style import STYLE, station_classes
from sitl.report.times import Times, duration

__all__ = ["STYLE", "main_report", "write_report"]

REPORT_FILE = "report.html"
#: more refusals and decisions than these are folded away
_MANY = 25
#: more pictures of handovers than these are folded away
_MANY_PICTURES = 12
_WASH = {Gravity.GOOD: "held", Gravity.WARNING: "warned", Gravity.BAD: "failed", Gravity.PLAIN: ""}
_DECISIONS = frozenset(
    {
        "authority", "authority_lost", "emergency", "emergency_over", "warning", "gap", "gap_over", "decision",
        "warning_over", "fly", "guard", "start_refused", "start_failed",
        "started", "transfer_aborted", "partner_unfit", "position_stale", "off_route", "on_route",
        "failed_closed", "landed", "fault", "would", "rehearsal", "rehearsal_refused", "restarted", "started_again",
    }
)  # fmt: skip


def write_report(record: RunRecord, path: Path | None = None) -> Path:
    """Write the report, into the record's folder unless told where; returns its path. Raises OSError.

    A report into the folder brings its map as a picture.
    """
    if path is None:
        path = record.folder / REPORT_FILE
        _pictures(record)
    several = len(record.stories) > 1
    body = [_header(record)]
    for number, story in enumerate(record.stories, 1):
        body.append(f"<h1>{escape(story.vehicle)}</h1>" if several else "")
        body += _vehicle(story, f"{number}", record)
    body += [_verdicts(record), _sources(record), _files(record, path)]
    title = f"{record.title}: handover report"
    drawing = _library() if any("data-figure" in part for part in body) else ""
    html = (
        '<!DOCTYPE html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        '<meta name="color-scheme" content="light dark">'
        f"<title>{escape(title)}</title><style>{STYLE}</style></head><body>{''.join(body)}{drawing}</body></html>\n"
    )
    path.write_text(html, encoding="utf-8", errors="replace")  # a journal may hold half a character
    return path


def main_report(argv: Sequence[str] | None = None) -> int:
    """`handover report PATH...`; returns the exit code, 2 when there is nothing to report."""
    parser = CommandParser(
        prog="handover report",
        examples=(
            ("handover report flights/latest", "the last flight of this machine: report.html in its folder"),
            ("handover report vehicle.jsonl 00000042.BIN --csv track.csv", "of single files; a row for each position"),
        ),
        codes={0: "written", 2: "wrong usage, or nothing to report"},
        description="Make the report of a run of 'handover sim', or of a flight: of journals (.jsonl), telemetry logs "
        "(.tlog) and the autopilot's logs (.bin, .log) of the vehicle and of stations, in any combination.",
    )
    parser.add_argument(
        "paths", type=Path, nargs="+", metavar="PATH", help="a folder with all that is in it, or a file"
    )
    parser.add_argument("--mission", type=Path, metavar="DIR", help="the mission package, where it does not lie there")
    parser.add_argument(
        "--out", type=Path, metavar="FILE", help="the page (else report.html in the folder, or beside a file)"
    )
    parser.add_argument("--kml", type=Path, metavar="FILE", help="the track and the zones for a map program")
    parser.add_argument("--csv", type=Path, metavar="FILE", help="a row for each position: time, place, who commanded")
    parser.add_argument("--json", action="store_true", help="for programs: the outcome, and the files written")
    try:
        arguments = parser.parse_args(argv)
        record = load(arguments.paths, arguments.mission)
        written = [write_report(record, arguments.out or _beside(arguments.paths))]
        for write, path in ((write_kml, arguments.kml), (write_csv, arguments.csv)):
            if path is not None:
                write(record, path)
                written.append(path)
        print(json.dumps(_as_json(record, written), indent=1) if arguments.json else "\n".join(map(str, written)))
    except SystemExit as stop:
        return int(stop.code or 0)
    except (RecordError, OSError) as error:
        print(f"handover report: {error}", file=sys.stderr)
        return 2
    return 0


def _as_json(record: RunRecord, written: Sequence[Path]) -> dict[str, Any]:
    """`held`: whether every expectation of a simulation held; None for a flight."""
    vehicles = []
    for story in record.stories:
        lines = outcome(story.evidence, exchanges(story.evidence), Times(story.evidence))
        told = [{"gravity": line.gravity.name.lower(), "text": line.text} for line in lines]
        vehicles.append({"vehicle": story.vehicle, "outcome": told})
    return {"held": record.held, "vehicles": vehicles, "files": [str(path) for path in written]}


def _beside(paths: Sequence[Path]) -> Path | None:
    """Where the page goes when a file was named: beside it, under its name; None for a folder's own."""
    first = paths[0]
    return None if first.is_dir() else first.with_name(f"{first.stem}-{REPORT_FILE}")


def _pictures(record: RunRecord) -> None:
    """The map as PNG; without matplotlib, or without a mission, there is none."""
    try:
        import matplotlib  # noqa: F401
    except ImportError:
        return
    from sitl.report.pictures import draw_map

    for story in record.stories:
        if story.evidence.mission is None:
            continue
        name = "" if story is record.stories[0] else f"-{story.vehicle}"
        draw_map(story.evidence, exchanges(story.evidence), record.folder / f"map{name}.png")


def _library() -> str:
    return library() + "<noscript><p>Map and timeline are drawn by this page's own script.</p></noscript>"


# ---- the parts ----------------------------------------------------------------------------------------------------


def _header(record: RunRecord) -> str:
    values = record.values
    facts = [f"mission {record.evidence.mission.name}" if record.evidence.mission is not None else "no mission package"]
    if record.staged:
        firmware = f" (firmware {values['firmware']})" if values.get("firmware") else ""
        facts += [
            f"vehicle {values.get('vehicle')}{firmware}",
            f"{values.get('speedup', 1):g} times real time",
            f"{values.get('duration_sim_s', 0):.0f} simulated s in {values.get('duration_wall_s', 0):.0f} s",
        ]
    if "begun_utc" in values:
        facts.append(f"begun {values['begun_utc']}")
    else:
        times = Times(record.evidence)
        at = times.at(record.evidence.entries[0].t)
        facts += [] if at is None else [f"begun {at.isoformat(timespec='seconds')}"]
    description = f"<p>{escape(str(values['description']))}</p>" if "description" in values else ""
    return f'<h1>{escape(record.title)}</h1>{description}<p class="small">{escape("; ".join(facts))}</p>'


def _vehicle(story: Story, number: str, record: RunRecord) -> list[str]:
    """All that there is of one vehicle."""
    transfers = exchanges(story.evidence)
    times = Times(story.evidence)
    return [
        _outcome(story, transfers, times, record),
        _figures(story, transfers, times, number),
        _handovers(story, transfers, times),
        _operators(story, times),
        _feeds(story, times),
        _refusals(story, times),
        _decisions(story, times),
        _rehearsals(story),
    ]


def _outcome(story: Story, transfers: Sequence[Exchange], times: Times, record: RunRecord) -> str:
    lines = "".join(
        f'<li class="{_WASH[line.gravity]}">{escape(line.text)}</li>'
        for line in outcome(story.evidence, transfers, times)
    )
    if record.held is not None and story is record.stories[0]:
        failed = sum(not one.held for one in record.verdicts)
        text = "Every expectation held" if record.held else f"{failed} of {len(record.verdicts)} expectations failed"
        lines += f'<li class="{"held" if record.held else "failed"}">{text}.</li>'
    if record.staged:
        known = "T+ counts simulated seconds since " + times.zero_is
        utc = "; UTC is the time of day of the simulation" if times.at(0.0) is not None else ""
    else:
        known = f"T+ counts from {times.zero_is}"
        utc = "; UTC is GPS time" if record.by_gps else "; UTC as a computer had it"
        if times.at(0.0) is None:
            utc = "; UTC is not known"
    witness = "" if not story.witness else f". The aircraft by {story.witness}"
    return f'<ul class="outcome">{lines}</ul><p class="small">{escape(known + utc + witness)}.</p>'


def _figures(story: Story, transfers: Sequence[Exchange], times: Times, number: str) -> str:
    try:
        import plotly  # noqa: F401
    except ImportError:
        words = "No pictures: plotly is not installed (pip install mavproxy-handover-sim)."
        return _section("Map and timeline", f'<p class="small">{escape(words)}</p>')
    from sitl.report.figures import map_figure, timeline_figure

    drawn = map_figure(story, transfers, times)
    there = figure(f"map{number}", drawn) if drawn is not None else "<p>No position is known.</p>"
    held = figure(f"timeline{number}", timeline_figure(story, transfers, times))
    return _section("Map", there) + _section("What held when", held)


def _verdicts(record: RunRecord) -> str:
    rows = [
        ("held" if one.held else "failed", ("holds" if one.held else "FAILS", one.wanted, one.seen))
        for one in record.verdicts
    ]
    return _section("Expectations", _table(("", "expected", "seen"), rows)) if rows else ""


def _handovers(story: Story, transfers: Sequence[Exchange], times: Times) -> str:
    rows = []
    for transfer in transfers:
        ended = transfer.ended_t is not None
        outcome = (
            "committed"
            if transfer.committed
            else f"aborted ({journal_in_words(transfer.reason)})"
            if ended
            else "not ended"
        )
        tries = max((flight.attempt for flight in transfer.flights), default=1)
        rows.append(
            (
                "" if transfer.committed else "warned",
                (
                    str(transfer.handover_id),
                    f"{transfer.commander} → {transfer.partner}",
                    outcome,
                    "" if transfer.duration_s is None else duration(transfer.duration_s),
                    *_clock(times, transfer.begun_t),
                    str(len(transfer.flights)),
                    str(sum(flight.lost for flight in transfer.flights)),
                    "" if transfer.epoch is None else str(transfer.epoch),
                    f"{tries} tries" if tries > 1 else "first try",
                    agreed(story.evidence, transfer.handover_id),
                ),
            )
        )
    heads = ("", "authority", "outcome", "duration", "T+", "UTC", "messages", "lost", "epoch", "", "agreed by")
    none = "None is told of." if story.evidence.commanders()[1:] else "There was none."
    text = _table(heads, rows) if rows else f"<p>{none}</p>"
    return _section("Handovers", text + _sequences(story, transfers))


def _sequences(story: Story, transfers: Sequence[Exchange]) -> str:
    classes = station_classes(story.evidence.stations)
    pictures = []
    for kind in kinds([transfer for transfer in transfers if transfer.flights]):
        numbers = [str(kind.first.handover_id), *(str(other.handover_id) for other in kind.others)]
        went = f"; so went {', '.join(numbers[1:])}" if kind.others else ""
        caption = f"Handover {numbers[0]}: {kind.first.commander} → {kind.first.partner}{went}"
        drawn = draw(kind.first, classes)
        pictures.append(f"<figure><figcaption>{escape(caption)}</figcaption>{drawn}</figure>")
    shown, folded = pictures[:_MANY_PICTURES], pictures[_MANY_PICTURES:]
    text = f'<div class="pictures">{"".join(shown)}</div>' if shown else ""
    if folded:
        inner = f'<div class="pictures">{"".join(folded)}</div>'
        text += f"<details><summary>{len(folded)} more pictures</summary>{inner}</details>"
    return text


def _operators(story: Story, times: Times) -> str:
    rows = [
        ("", (*_clock(times, done.t), done.station, done.operator, done.text)) for done in operators(story.evidence)
    ]
    heads = ("T+", "UTC", "station", "operator", "what")
    return _section("Operators", _folded(heads, rows)) if rows else ""


def _feeds(story: Story, times: Times) -> str:
    """Which station was the source of each feed, when an onboard program led the aircraft, and what was not used."""
    evidence = story.evidence
    spans = sorted((*feed_spans(evidence), *onboard_spans(evidence)), key=lambda span: span.begun_t)
    rows = [
        (
            "",
            (
                *_clock(times, span.begun_t),
                "to the end" if span.ended_t is None else _clock(times, span.ended_t)[0],
                span.what,
                span.who,
                span.why,
            ),
        )
        for span in spans
    ]
    others = [
        ("warned", (*_clock(times, entry.t), str(entry.get("station") or ""), entry.text)) for entry in unused(evidence)
    ]
    text = _folded(("T+", "UTC", "until T+", "what", "from", "why it ended"), rows) if rows else ""
    text += _folded(("T+", "UTC", "station", "not used, or not checked"), others) if others else ""
    return _section("Feeds and onboard programs", text) if text else ""


def _refusals(story: Story, times: Times) -> str:
    evidence = story.evidence
    rows = [
        (
            "",
            (
                *_clock(times, entry.t),
                str(entry.get("station", "?")),
                _refused_what(entry),
                journal_in_words(str(entry.get("reason", ""))),
                f"and {entry.get('also')} more" if entry.get("also") else "",
            ),
        )
        for entry in evidence.of(event="refused")
    ]
    accepted = Counter(
        (str(entry.get("station", "?")), str(entry.get("what", ""))) for entry in evidence.of(event="accepted")
    )
    obeyed = [("", (station, what, str(count))) for (station, what), count in sorted(accepted.items())]
    text = "<p>Nothing was refused.</p>"
    if rows:
        text = _folded(("T+", "UTC", "station", "what", "reason", ""), rows)
    if obeyed:
        text += "<p><b>Accepted</b></p>" + _table(("station", "what", "times"), obeyed)
    known = any(entry.event in ("refused", "accepted", "loaded") for entry in evidence.entries)
    return _section("Refusals", text) if known else ""


def _refused_what(entry: Entry) -> str:
    """The frame that was refused; first what people call it, where its name does not say that."""
    what, named = str(entry.get("what", "")), entry.get("named")
    return f"{named} ({what})" if named else what


def _decisions(story: Story, times: Times) -> str:
    stations = set(story.evidence.stations)
    rows = [
        (
            _gravity(entry),
            (*_clock(times, entry.t), entry.who, entry.text or _words(entry.event)),
        )
        for entry in story.evidence.entries
        if entry.event in _DECISIONS and entry.who not in stations
    ]
    return _section("Decisions and emergencies", _folded(("T+", "UTC", "who", "what"), rows)) if rows else ""


def _gravity(entry: Entry) -> str:
    """The wash of a decision's row."""
    if entry.event == "failed_closed":
        return "failed"
    if entry.event != "emergency":
        return ""
    return "warned" if level_of(entry) < Level.EMERGENCY else "failed"


def _sources(record: RunRecord) -> str:
    """Of a flight: which files told what, and what was done to their clocks."""
    if not record.sources:
        return ""
    times = Times(record.evidence)
    rows = []
    for source in record.sources:
        span = "" if source.span is None else f"{times.plus(source.span[0])} to {times.plus(source.span[1])}"
        broken = f"; {source.broken} places in it could not be read" if source.broken else ""
        rows.append(("", (source.path.name, source.kind, source.who, span, source.clock + broken)))
    text = _table(("file", "what", "whose", "tells of", "clock"), rows)
    if record.left_out:
        text += '<p class="small">Left out:</p><ul class="small">'
        text += "".join(f"<li>{escape(words)}</li>" for words in record.left_out) + "</ul>"
    return _section("Where this comes from", text)


def _rehearsals(story: Story) -> str:
    sections = []
    for book in books(story.evidence.entries):
        again = ", seen since a restart of the companion" if book.get("restarted") else ""
        text = f"<p>{escape(str(book.get('why', '')))}, {escape(str(book.get('seconds', '')))} s{again}</p>"
        for table in tables(book):
            if table.rows:
                text += f"<p><b>{escape(table.caption)}</b></p>" + _table(
                    table.heads, [("", row) for row in table.rows]
                )
        sections.append(text)
    return _section("Rehearsal on the ground", "".join(sections)) if sections else ""


def _files(record: RunRecord, path: Path) -> str:
    """Links to the files, for those that lie in the folder of the page or below."""
    here = path.resolve().parent
    names = [file.resolve().relative_to(here).as_posix() for file in record.files if here in file.resolve().parents]
    if not names:
        return ""
    # a name is a path here, whatever it looks like: a browser would run one that begins with "javascript:"
    links = "".join(f'<li><a href="./{quote(name)}">{escape(name)}</a></li>' for name in names)
    return _section(
        "Files", f'<p class="small">Beside this report, in the same folder:</p><ul class="small">{links}</ul>'
    )


# ---- building blocks ----------------------------------------------------------------------------------------------


def _section(title: str, text: str) -> str:
    return f"<h2>{escape(title)}</h2>{text}"


def _table(heads: Iterable[str], rows: Iterable[tuple[str, Sequence[str]]]) -> str:
    """A table; each row comes with its class. Values that begin with a digit stand right."""
    head = "".join(f"<th>{escape(text)}</th>" for text in heads)
    lines = []
    for kind, cells in rows:
        inner = "".join(f"<td{_numeric(text)}>{escape(text)}</td>" for text in cells)
        lines.append(f'<tr class="{kind}">{inner}</tr>' if kind else f"<tr>{inner}</tr>")
    return f'<div class="wide"><table><tr>{head}</tr>{"".join(lines)}</table></div>'


def _folded(heads: Iterable[str], rows: Sequence[tuple[str, Sequence[str]]]) -> str:
    """A table whose rows beyond many are folded away."""
    heads = tuple(heads)
    if len(rows) <= _MANY:
        return _table(heads, rows)
    rest = _table(heads, rows[_MANY:])
    return f"{_table(heads, rows[:_MANY])}<details><summary>{len(rows) - _MANY} more</summary>{rest}</details>"


def _numeric(text: str) -> str:
    parts = text.split()
    number = parts[0].replace(".", "", 1).isdigit() if parts else False
    return ' class="n"' if number and len(parts) <= 2 else ""


def _words(name: str) -> str:
    return name.replace("_", " ")


def _clock(times: Times, t: float) -> tuple[str, str]:
    return times.plus(t), times.utc(t)
