# SPDX-License-Identifier: GPL-3.0-or-later

"""The report of a run: one HTML file that needs nothing else, and the pictures beside it. `handover report FOLDER`.

Everything in it comes from the folder (`record.py`), so a report can be made again at any time.
"""

from __future__ import annotations

import argparse
import base64
import sys
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

from sitl.report.evidence import Evidence
from sitl.report.exchange import Exchange, exchanges
from sitl.report.journal_reader import Entry
from sitl.report.palette import colours
from sitl.report.record import RecordError, RunRecord, load_run
from sitl.report.rehearsal import books, tables

__all__ = ["STYLE", "main_report", "write_report"]

REPORT_FILE = "report.html"
#: of every page that is made here
STYLE = """
body{font:15px/1.45 system-ui,sans-serif;color:#222;margin:0 auto;max-width:1120px;padding:24px}
h1{font-size:26px;margin:0 0 4px}h2{font-size:19px;margin:34px 0 8px;border-bottom:1px solid #ddd;padding-bottom:4px}
p{margin:6px 0}.small{color:#555;font-size:13px}
table{border-collapse:collapse;width:100%;font-size:14px}
th,td{text-align:left;padding:4px 10px 4px 0;border-bottom:1px solid #eee;vertical-align:top}
th{color:#555;font-weight:600}td.n{text-align:right;font-variant-numeric:tabular-nums;white-space:nowrap}
img{max-width:100%;height:auto;display:block;margin:8px 0}
.held{background:#e3f2ea}.failed{background:#f9dede}
.verdict{padding:8px 14px;border-radius:6px;display:inline-block;font-weight:600}
"""


def write_report(record: RunRecord) -> Path:
    """Write `report.html` and the pictures into the run's folder; returns the report's path. Raises OSError."""
    transfers = exchanges(record.evidence)
    pictures = _draw(record, transfers)
    body = [
        _header(record),
        _verdicts(record),
        _section("Map", _image(pictures.get("map"), "zones, route and flown track")),
        _section("What held when", _image(pictures.get("timeline"), "commander, phase, lease, guard, flight mode")),
        _handovers(record.evidence, transfers, pictures),
        _refusals(record.evidence),
        _decisions(record.evidence),
        _rehearsals(record.evidence),
        _files(record),
    ]
    title = f"{record.title}: handover report"
    html = (
        '<!DOCTYPE html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f"<title>{escape(title)}</title><style>{STYLE}</style></head><body>{''.join(body)}</body></html>\n"
    )
    path = record.folder / REPORT_FILE
    path.write_text(html, encoding="utf-8")
    return path


def main_report(argv: Sequence[str] | None = None) -> int:
    """`handover report FOLDER`; returns the exit code, 2 when the folder holds no run."""
    parser = argparse.ArgumentParser(
        prog="handover report", description="Make report.html and the pictures of a run again, from its folder."
    )
    parser.add_argument("folder", type=Path, help="folder of a run of 'handover sim', or of a flight's journals")
    try:
        arguments = parser.parse_args(argv)
        print(write_report(load_run(arguments.folder)))
    except SystemExit as stop:
        return int(stop.code or 0)
    except (RecordError, OSError) as error:
        print(f"handover report: {error}", file=sys.stderr)
        return 2
    return 0


def _draw(record: RunRecord, transfers: Sequence[Exchange]) -> dict[str, Path]:
    """Draw every picture; without matplotlib there are none, and the report says so."""
    try:
        import matplotlib  # noqa: F401
    except ImportError:
        return {}
    from sitl.report.charts import draw_sequence, draw_timeline
    from sitl.report.pictures import draw_map

    evidence, folder = record.evidence, record.folder
    for stale in folder.glob("handover-*.png"):
        stale.unlink()
    pictures = {"map": folder / "map.png", "timeline": folder / "timeline.png"}
    draw_map(evidence, transfers, pictures["map"])
    draw_timeline(evidence, transfers, pictures["timeline"])
    station_colours = colours([station.name for station in evidence.package.stations])
    for number, transfer in enumerate(transfers, 1):
        name = f"handover-{number}"
        pictures[name] = folder / f"{name}.png"
        draw_sequence(transfer, station_colours, pictures[name])
    return pictures


# ---- the parts ----------------------------------------------------------------------------------------------------


def _header(record: RunRecord) -> str:
    values = record.values
    verdict = ""
    if record.held is not None:
        failed = sum(not one.held for one in record.verdicts)
        text = "Every expectation held" if record.held else f"{failed} of {len(record.verdicts)} expectations failed"
        verdict = f'<p><span class="verdict {"held" if record.held else "failed"}">{text}</span></p>'
    facts = [f"mission {record.evidence.package.name}"]
    if record.staged:
        firmware = f" (firmware {values['firmware']})" if values.get("firmware") else ""
        facts += [
            f"vehicle {values.get('vehicle')}{firmware}",
            f"{values.get('speedup', 1):g} times real time",
            f"{values.get('duration_sim_s', 0):.0f} simulated s in {values.get('duration_wall_s', 0):.0f} s",
        ]
    if "begun_utc" in values:
        facts.append(f"begun {values['begun_utc']}")
    description = f"<p>{escape(str(values['description']))}</p>" if "description" in values else ""
    return f'<h1>{escape(record.title)}</h1>{description}{verdict}<p class="small">{escape("; ".join(facts))}</p>'


def _verdicts(record: RunRecord) -> str:
    rows = [
        ("held" if one.held else "failed", ("holds" if one.held else "FAILS", one.wanted, one.seen))
        for one in record.verdicts
    ]
    return _section("Expectations", _table(("", "expected", "seen"), rows)) if rows else ""


def _handovers(evidence: Evidence, transfers: Sequence[Exchange], pictures: dict[str, Path]) -> str:
    rows = []
    for transfer in transfers:
        outcome = "committed" if transfer.committed else f"aborted ({transfer.reason.replace('_', ' ')})"
        tries = max((flight.attempt for flight in transfer.flights), default=1)
        rows.append(
            (
                "",
                (
                    str(transfer.handover_id),
                    f"{transfer.commander} → {transfer.partner}",
                    outcome,
                    "" if transfer.duration_s is None else f"{transfer.duration_s * 1000:.1f} ms",
                    f"{evidence.sim_at(transfer.begun_t):.1f} s",
                    str(len(transfer.flights)),
                    str(sum(flight.received_t is None for flight in transfer.flights)),
                    "" if transfer.epoch is None else str(transfer.epoch),
                    f"{tries} tries" if tries > 1 else "first try",
                ),
            )
        )
    heads = ("", "authority", "outcome", "duration", "at", "messages", "lost", "epoch", "")
    text = _table(heads, rows) if rows else "<p>There was none.</p>"
    images = "".join(
        _image(pictures.get(f"handover-{number}"), f"messages of handover {transfer.handover_id}")
        for number, transfer in enumerate(transfers, 1)
    )
    return _section("Handovers", text + images)


def _refusals(evidence: Evidence) -> str:
    rows = [
        (
            "",
            (
                _clock(evidence, entry),
                str(entry.get("station", "?")),
                str(entry.get("what", "")),
                str(entry.get("reason", "")).replace("_", " "),
                f"and {entry.get('also')} more" if entry.get("also") else "",
            ),
        )
        for entry in evidence.of(event="refused")
    ]
    accepted: dict[tuple[str, str], int] = {}
    for entry in evidence.of(event="accepted"):
        key = (str(entry.get("station", "?")), str(entry.get("what", "")))
        accepted[key] = accepted.get(key, 0) + 1
    obeyed = [("", (station, what, str(count))) for (station, what), count in sorted(accepted.items())]
    text = "<p>Nothing was refused.</p>"
    if rows:
        text = _table(("at", "station", "what", "reason", ""), rows)
    if obeyed:
        text += "<p><b>Accepted</b></p>" + _table(("station", "what", "times"), obeyed)
    return _section("Refusals", text)


def _decisions(evidence: Evidence) -> str:
    words = {
        "authority", "authority_lost", "emergency", "emergency_over", "warning", "gap", "gap_over",
        "warning_over", "fly", "guard", "start_refused", "start_failed",
        "started", "transfer_aborted", "partner_unfit", "position_stale", "off_route", "on_route",
        "failed_closed", "landed", "fault", "would", "rehearsal", "rehearsal_refused",
    }  # fmt: skip
    rows = [
        ("", (_clock(evidence, entry), entry.who, entry.text or entry.event.replace("_", " ")))
        for entry in evidence.entries
        if entry.event in words and entry.who not in {station.name for station in evidence.package.stations}
    ]
    return _section("Decisions and emergencies", _table(("at", "who", "what"), rows)) if rows else ""


def _rehearsals(evidence: Evidence) -> str:
    sections = []
    for book in books(evidence.entries):
        again = ", seen since a restart of the companion" if book.get("restarted") else ""
        text = f"<p>{escape(str(book.get('why', '')))}, {escape(str(book.get('seconds', '')))} s{again}</p>"
        for table in tables(book):
            if table.rows:
                text += f"<p><b>{escape(table.caption)}</b></p>" + _table(
                    table.heads, [("", row) for row in table.rows]
                )
        sections.append(text)
    return _section("Rehearsal on the ground", "".join(sections)) if sections else ""


def _files(record: RunRecord) -> str:
    links = "".join(
        f'<li><a href="{escape(path.relative_to(record.folder).as_posix())}">'
        f"{escape(path.relative_to(record.folder).as_posix())}</a></li>"
        for path in record.files
    )
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
    return f"<table><tr>{head}</tr>{''.join(lines)}</table>"


def _numeric(text: str) -> str:
    parts = text.split()
    number = parts[0].replace(".", "", 1).isdigit() if parts else False
    return ' class="n"' if number and len(parts) <= 2 else ""


def _image(path: Path | None, words: str) -> str:
    if path is None or not path.exists():
        return '<p class="small">No picture: matplotlib is not installed (pip install "mavproxy-handover[sim]").</p>'
    data = base64.b64encode(path.read_bytes()).decode("ascii")
    return f'<img alt="{escape(words)}" src="data:image/png;base64,{data}">'


def _clock(evidence: Evidence, entry: Entry) -> str:
    return f"{evidence.sim_at(entry.t):.1f} s"
