# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks the position box: connection, records, layout, delay, position, and agreement with the autopilot.

The first records are shown in each layout, so that people see which one makes sense.

It uses the companion's own client, and sends nothing. A running companion has the connection, and a box may serve only
one client, so then its journal is read.
"""

from __future__ import annotations

import math
import select
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Final

from mavproxy_handover.config.position import BOX
from mavproxy_handover.config.vehicle import VehicleConfig
from mavproxy_handover.doctor.check_context import CheckContext
from mavproxy_handover.doctor.finding import Finding, error, ok, unseen, warning
from mavproxy_handover.doctor.journal import position_box_by_journal
from mavproxy_handover.link.box_line import SILENT, BoxCounters, BoxLine, Fix
from mavproxy_handover.link.forms import LinkError
from mavproxy_handover.monitors.position.box_layout_watch import LayoutWatch, Verdict, rivals
from mavproxy_handover.monitors.position.cross_check import CrossCheck, Difference, Place
from mavproxy_handover.wire.box_layout import LAYOUTS, BoxLayout

__all__ = ["position_box"]

_LISTEN_S: Final = 3.0
_WAIT_S: Final = 0.02
#: records a second; with fewer a position is old before the next one comes
_FEWEST: Final = 2.0
_NAME: Final = "position box"
_LAYOUT: Final = "Compare what it sends with the table of docs/position-box.md, and its order of bytes."
#: number of first records of a connection whose fields are all shown
_SHOWN: Final = 2
_DIGITS: Final = {"double": ".12g", "float": ".6g"}


@dataclass(slots=True)
class _Heard:
    """Data received from the box."""

    layout: LayoutWatch
    fix: Fix | None = None
    #: first bytes of a connection
    head: bytes = b""
    latest_s: float = 0.0
    for_s: float = 0.0
    trouble: str = ""
    #: first error, though others may have followed
    first_trouble: str = ""
    counters: BoxCounters = field(default_factory=BoxCounters)


def position_box(context: CheckContext) -> Iterator[Finding]:
    """The findings of this check; none without a box."""
    vehicle = context.vehicle
    if vehicle is None or not vehicle.position.box:
        return
    context.find_companion()
    if context.running is not None:
        yield from position_box_by_journal(context)
        return
    what = f"{_NAME}, {vehicle.position.box}"
    try:
        line = BoxLine(vehicle.position.box, context.clocks.monotonic, layout=vehicle.position.layout)
    except LinkError as fault:
        yield error(what, str(fault), "Name it by its address, or have this machine know the name (/etc/hosts).")
        return
    try:
        context.tell(f"listening to the position box on {line.device}, {_LISTEN_S:g} s")
        heard = _listen(context, line)
    finally:
        line.close()
    yield from _findings(context, vehicle, what, heard)


def _listen(context: CheckContext, line: BoxLine) -> _Heard:
    heard = _Heard(LayoutWatch(line.layout), counters=line.counters)
    own = context.aircraft.telemetry.own_position.value
    place = None if own is None or context.aircraft.armed else Place.by_autopilot(own)
    begun = now = context.clocks.monotonic()
    while now < begun + _LISTEN_S:
        context.stop_if_companion_runs()
        fix, raw = line.read(), line.raw()
        if raw:
            heard.layout.judge(raw, place, armed=False)
        if fix is not None:
            heard.fix = fix
            heard.latest_s = max(heard.latest_s, fix.late_s)
        heard.first_trouble = heard.first_trouble or line.trouble
        waiting = select.poll()
        if line.fileno() >= 0:
            waiting.register(line.fileno(), select.POLLIN)
        waiting.poll(_WAIT_S * 1000.0)
        now = context.clocks.monotonic()
    heard.for_s, heard.trouble, heard.head = now - begun, line.trouble, line.head
    return heard


def _findings(context: CheckContext, vehicle: VehicleConfig, what: str, heard: _Heard) -> Iterator[Finding]:
    wrong = error if vehicle.position.source == BOX else warning
    counters, fix = heard.counters, heard.fix
    if not counters.connects:
        do = "Look at its power and its cable, and at [position] box: it must be a TCP server at that address."
        yield wrong(what, f"cannot be reached ({heard.trouble or 'no answer'})", do)
        return
    yield from _layouts(vehicle.position.layout, wrong, heard)
    if heard.layout.verdict is Verdict.OTHER:
        return
    if fix is None and counters.bytes_in:
        yield wrong(what, f"what it sends is no record: {heard.first_trouble or 'none was whole'}", _LAYOUT)
        return
    if fix is None:
        do = "Look whether it has started, whether it serves a second client, and what else listens on that port."
        # the line may have closed the connection just before the end of listening, which is no fault
        why = f" ({heard.first_trouble})" if heard.first_trouble not in ("", SILENT) else ""
        yield wrong(what, f"connects, and sends nothing in {heard.for_s:.0f} s{why}", do)
        return
    rate = counters.records / heard.for_s
    found = f"{rate:.0f} records a second, {heard.latest_s * 1000:.0f} ms late at most"
    limit_s = vehicle.position.box_age_s
    if counters.errors:
        found = f"{found}, and {counters.errors} times in doubt or cut off: {heard.first_trouble}"
        yield warning(what, found, _LAYOUT)
    elif rate < _FEWEST:
        yield warning(what, found, "Have it send ten records a second or more.")
    elif heard.latest_s > limit_s:
        do = f"Look at the network between, or at box_age_s ({limit_s:g} s): what is later is not used."
        yield warning(what, found, do)
    else:
        yield ok(what, found)
    if not vehicle.position.layout.locates(fix.record):
        yield wrong("its position", "it does not know one", "Give it a view of the sky, and look again.")
        return
    yield _compared(context, vehicle, fix)


def _layouts(layout: BoxLayout, wrong: Callable[[str, str, str], Finding], heard: _Heard) -> Iterator[Finding]:
    """Check that the records have the configured layout, and show the first ones in each layout."""
    watch, what = heard.layout, "its layout"
    if watch.likely is not None:
        do = f'Set layout = "{watch.likely.name}" in [position], or have the box send layout {layout.name!r}.'
        yield wrong(what, watch.words, do)
    elif watch.known:
        yield ok(what, f"{layout.name!r}, as it is configured")
    elif heard.fix is not None and watch.misfit:
        yield wrong(what, watch.words, _LAYOUT)
    elif heard.fix is not None:
        do = "Give the autopilot a fix, or turn the aircraft away from north, and look again: START waits for it."
        yield warning(what, watch.words, do)
    known = {layout.name: layout, **{each.name: each for each in (*rivals(layout), *LAYOUTS.values())}}
    for number in range(_SHOWN):
        for each in known.values():
            record = heard.head[number * each.size : (number + 1) * each.size]
            if len(record) == each.size:
                yield ok(f"record {number + 1} as {each.name!r}", _shown(each, record))


def _shown(layout: BoxLayout, record: bytes) -> str:
    """Text of all fields of a record, and its impossible values."""
    values = layout.struct.unpack(record)
    wrong, fields = layout.wrong(values), []
    for each, value in zip(layout.fields, values, strict=True):
        fields.append(f"{each.name} {value:{_DIGITS.get(each.type, 'd')}} {each.unit}")
        if layout.utc and each.meaning == "time" and not wrong:
            fields[-1] += time.strftime(" (%Y-%m-%d %H:%M:%S UTC)", time.gmtime(value))
    return ", ".join(fields) + (f" (not possible: {wrong})" if wrong else "")


def _compared(context: CheckContext, vehicle: VehicleConfig, fix: Fix) -> Finding:
    """Compare its position to the autopilot's, unless the aircraft may move."""
    what, own, record = "its position", context.aircraft.telemetry.own_position.value, fix.record
    heights = [
        f"{value:.0f} m {words}"
        for value, words in (
            (record.alt_m, "above sea level"),
            (record.baro_m, "pressure altitude"),
            (record.agl_m, "above ground by pressure"),
        )
        if not math.isnan(value)
    ]
    where = ", ".join([f"{record.lat_deg:.6f} {record.lon_deg:.6f}", *heights])
    if context.aircraft.armed:
        return unseen(what, f"{where}, and the vehicle is armed", "Look again when it is disarmed.")
    if own is None:
        do = "Have the autopilot on its line and with a fix, and look again: without that the box does not count."
        return unseen(what, f"{where}, and the autopilot has told none", do)
    check = CrossCheck(vehicle.position)
    theirs = Place(record.lat_deg, record.lon_deg, record.alt_m, record.north_mps, record.east_mps)
    check.compare(Difference.between(theirs, Place.by_autopilot(own)), context.clocks.monotonic())
    assert check.last is not None
    if check.sound:
        height = "" if math.isnan(record.alt_m) else f" and {check.last.height_m:.1f} m in height"
        return ok(what, f"{where}: {check.last.over_ground_m:.1f} m{height} from the autopilot's")
    do = "Find out which of the two is right; heights may count from the ellipsoid in one, from sea level in the other."
    return error(what, f"{where}: box and autopilot {check.words}", do)
