# SPDX-License-Identifier: GPL-3.0-or-later

"""The parts of the page as plain values for a browser. Pure: time is an argument.

Rules that live here
--------------------
* Each value has its age beside it. From OLD_S on it is grey ("old"), from GONE_S on it is not shown ("gone").
* The seconds of the band are counted by the station's clock, so they do not stand still between two snapshots.
* If the station's program does not answer, the band says so. There is no button then, and all values get old.
* All input is text for the browser, never more.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite
from typing import Any, Final

from gcs_module.alarms import Level
from gcs_module.panel.band import DEAD_S, GONE_S, OLD_S, Band, Button, Who, bands, dead_band
from gcs_module.panel.snapshot import AircraftSeen, AlarmSeen, LinkSeen, Stamped, StationSeen
from gcs_module.panel.words import age, for_buttons, remedy_of, seconds_to
from mavproxy_handover.mission.colours import station_colour
from mavproxy_handover.mission.geodesy import distance_m

__all__ = ["Known", "Page", "page_of"]

NOBODY_COLOUR: Final = "#8A8A8A"
#: characters of a name on the map
_LABEL: Final = 24


@dataclass(frozen=True, slots=True)
class Known:
    """The panel's knowledge of its station.

    `age_s`: of the snapshot `seen`; `now`: by the station's clock; `fault`: why there is no connection, "" if there is;
    `colours`: of stations, by name.
    """

    name: str
    seen: StationSeen | None
    age_s: float
    now: float
    fault: str
    colours: Mapping[str, str]

    @property
    def dead(self) -> bool:
        """Whether the station's program does not answer."""
        return self.seen is None or bool(self.fault) or self.age_s > DEAD_S


@dataclass(frozen=True, slots=True)
class Page:
    """The sections of the page. `vehicle`: the aircraft in the band, 0: none."""

    vehicle: int
    sections: Mapping[str, Any]


def page_of(known: Known, pinned: int) -> Page:
    """The page now. `pinned`: the aircraft that the operator has chosen, 0: the most urgent one is shown."""
    seen = known.seen
    all_bands = [] if seen is None else list(bands(seen, known.now))
    chosen = next((band for band in all_bands if band.vehicle == pinned), all_bands[0] if all_bands else None)
    craft = None
    if seen is not None and chosen is not None:
        craft = next(each for each in seen.aircraft if each.sysid == chosen.vehicle)
    if known.dead or chosen is None:
        configuration = "" if seen is None else seen.configuration
        old_s = known.age_s if seen is not None else inf
        band = dead_band(known.name or "?", configuration, known.fault or "it has stopped", old_s)
    else:
        band = chosen
    several = len(all_bands) > 1
    sections = {
        "head": {
            "station": known.name,
            "program": "" if seen is None else seen.program,
            "dead": known.dead,
        },
        "duty": _duty(seen, known),
        "shift": _shift(seen, all_bands, known),
        "band": {
            **_band(band, known.now),
            "aircraft": band.name if several and not known.dead else "",
            "operator": _operator_of(craft, seen, known),
            "note": _NOTES.get("dead" if known.dead else band.who, "").format(station=known.name),
            "pinned": bool(pinned) and several and chosen is not None and chosen.vehicle == pinned,
            "colour": known.colours.get(craft.commander, "") if craft is not None and band.who != Who.UNKNOWN else "",
        },
        "rows": [_row(each, known) for each in all_bands] if several else [],
        "alarms": list(_alarms(seen, chosen, known)),
        "briefing": _briefing(craft, known),
        "values": list(_values(craft, known)),
        "links": [] if craft is None else [_link(link, known) for link in craft.links],
        "peers": list(_peers(seen, known)),
        "lines": list(_lines(seen, known)),
        "sound": _sound(seen, known),
    }
    return Page(0 if chosen is None else chosen.vehicle, sections)


def _duty(seen: StationSeen | None, known: Known) -> dict[str, Any]:
    """The operator on duty here. `can`: the station takes orders."""
    if seen is None or known.dead:
        return {"operator": "", "required": False, "next": "", "can": False}
    return {"operator": seen.operator, "required": seen.required, "next": seen.next_operator, "can": True}


def _shift(seen: StationSeen | None, all_bands: Sequence[Band], known: Known) -> dict[str, Any]:
    """The briefing of the next operator, who confirms it; without rows while no shift changes."""
    if seen is None or known.dead or not seen.next_operator:
        return {"operator": "", "next": "", "left": "", "rows": []}
    by_sysid = {each.sysid: each for each in seen.aircraft}
    left_s = max(0.0, (seen.next_until or known.now) - known.now)
    return {
        "operator": seen.operator,
        "next": seen.next_operator,
        "left": f"{left_s:.0f} s left",
        "rows": [[band.name, _handed_on(by_sysid[band.vehicle], band, known)] for band in all_bands],
    }


def _handed_on(craft: AircraftSeen, band: Band, known: Known) -> str:
    """One aircraft in the briefing of the next operator."""
    values = (
        f"{each['label']} {each['text']}"
        for each in _values(craft, known)
        if each["label"] in _BRIEFED and each["state"] == "fresh"
    )
    who = "this station commands" if band.who == Who.YOU else f"in command: {band.who_words}"
    loud = [for_buttons(alarm.text) for alarm in craft.alarms]
    alarms = f" Alarms: {' '.join(loud)}" if loud else " No alarm."
    return f"{who}; {', '.join(values)}. {band.next_text(known.now)} {band.do}{alarms}"


#: what `Band.who` means for this operator
_NOTES: Final = {
    Who.YOU: "this station, {station}, commands",
    Who.OTHER: "you are {station}: you do not command",
    Who.NOBODY: "you are {station}: you do not command",
}
_BRIEFED: Final = ("mode", "height", "battery", "zone")


def _operator_of(craft: AircraftSeen | None, seen: StationSeen | None, known: Known) -> str:
    """The name of the operator at the station that commands; "" if it is not known, or old."""
    if craft is None or seen is None or known.dead:
        return ""
    if craft.own:
        return seen.operator
    return next((_operator(peer.operator, known.now) for peer in seen.peers if peer.name == craft.commander), "")


def _operator(given: Stamped | None, now: float) -> str:
    return "" if given is None or now - given.at > GONE_S else str(given.value)


def _band(band: Band, now: float) -> dict[str, Any]:
    return {
        "vehicle": band.vehicle,
        "name": band.name,
        "level": band.level.name.lower(),
        "who": band.who,
        "words": band.who_words,
        "next": band.next_text(now),
        "do": band.do,
        "main": [_button(button) for button in band.main],
        "more": [_button(button) for button in band.more],
    }


def _row(band: Band, known: Known) -> dict[str, Any]:
    """One aircraft among several, in few words."""
    words = "NOT KNOWN" if band.who == Who.UNKNOWN or known.dead else band.who_words
    return {**_band(band, known.now), "words": words, "dead": known.dead}


def _button(button: Button) -> dict[str, Any]:
    return {"do": button.do, "label": button.label, "argument": button.argument, "choices": list(button.choices)}


def _state(old_s: float) -> str:
    if old_s <= OLD_S:
        return "fresh"
    return "old" if old_s <= GONE_S else "gone"


def _alarms(seen: StationSeen | None, chosen: Band | None, known: Known) -> Iterator[dict[str, Any]]:
    """Those of the aircraft in the band first, then the gravest."""
    if seen is None:
        return
    found = [(each, alarm) for each in seen.aircraft for alarm in each.alarms]
    shown = 0 if chosen is None else chosen.vehicle
    found.sort(key=lambda pair: (pair[1].acknowledged, -pair[1].level, pair[0].sysid != shown))
    for craft, alarm in found:
        remedy = remedy_of(craft.action, craft.own) if alarm.name == "decision" else for_buttons(alarm.remedy)
        yield {
            "vehicle": craft.sysid,
            "aircraft": craft.name if len(seen.aircraft) > 1 else "",
            "level": Level(min(max(alarm.level, 0), int(Level.EMERGENCY))).name.lower(),
            "text": _alarm_text(craft, alarm, known),
            "cause": alarm.cause,
            "remedy": remedy,
            "since": f"for {age(max(0.0, known.now - alarm.since))}",
            "acknowledged": alarm.acknowledged,
            "state": _state(known.age_s),
        }


def _alarm_text(craft: AircraftSeen, alarm: AlarmSeen, known: Known) -> str:
    """The alarm's sentence. The seconds in that of a question are those of the moment when it was told."""
    asked = craft.question
    if alarm.name != "question" or asked is None:
        return for_buttons(alarm.text)
    at = asked.until if asked.border_at is None else asked.border_at
    left = "" if at is None or known.dead else f" {seconds_to(at, known.now)}"
    return f"Handover {asked.from_station} to {asked.to_station}{left}: {craft.name} waits for your answer."


def _briefing(craft: AircraftSeen | None, known: Known) -> dict[str, Any]:
    if craft is None or craft.briefing_at is None:
        return {"age": "", "rows": []}
    return {"age": f"{age(known.now - craft.briefing_at)} old", "rows": [list(pair) for pair in craft.briefing]}


def _values(craft: AircraftSeen | None, known: Known) -> Iterator[dict[str, Any]]:
    if craft is None:
        return
    heard = craft.authority_at
    site, place = craft.return_site, craft.position
    far = ""
    if site is not None and place is not None:
        lat_deg, lon_deg = place.value
        metres = distance_m(lat_deg, lon_deg, site.lat_deg, site.lon_deg)
        far = f", {metres:.0f} m away" if metres < 1000.0 else f", {metres / 1000.0:.1f} km away"
    rows: Sequence[tuple[str, Stamped | None, str]] = (
        ("mode", craft.mode, "{}"),
        ("height", craft.height_m, "{:.0f} m"),
        ("speed", craft.speed_mps, "{:.1f} m/s"),
        ("battery", craft.battery_percent, "{:.0f} %"),
        ("voltage", craft.battery_v, "{:.1f} V"),
        ("battery lasts", _minutes(craft.battery_left_s), "{:.0f} min"),
        ("zone", _said(craft.zone or "no zone", heard), "{}"),
        ("a return goes to", _said(None if site is None else f"{site.name}{far}", _older(heard, place, far)), "{}"),
        ("a return takes", _said(None if site is None else _takes(site.takes_s), heard), "{}"),
        ("a return needs", _said(None if site is None else _needs(site.needs), heard), "{}"),
        *((kind, Stamped(station, at), "{}") for kind, station, at in craft.payload),
        ("phase", _said(_PHASES.get(craft.phase, craft.phase), heard), "{}"),
    )
    for label, stamped, form in rows:
        if stamped is None:
            continue
        old_s = max(0.0, known.now - stamped.at)
        state = _state(old_s)
        text = "" if state == "gone" else form.format(stamped.value)
        yield {"label": label, "text": text, "age": age(old_s), "state": state}


_PHASES: Final = {
    "on_load": "on the ground",
    "on_mission": "on mission",
    "on_handover": "handover",
    "emergency": "emergency",
}


def _said(value: str | None, at: float | None) -> Stamped | None:
    return None if value is None or at is None else Stamped(value, at)


def _takes(takes_s: float | None) -> str | None:
    """The time until the aircraft is on the ground at the return site."""
    if takes_s is None:
        return None
    return f"{takes_s:.0f} s to land" if takes_s < 120.0 else f"{takes_s / 60.0:.0f} min to land"


def _needs(part: float | None) -> str | None:
    return None if part is None else f"{100.0 * part:.0f} % of the battery"


def _older(at: float | None, place: Stamped | None, far: str) -> float | None:
    """A distance is as old as the older of the two places."""
    return at if at is None or place is None or not far else min(at, place.at)


def _minutes(left_s: Stamped | None) -> Stamped | None:
    return None if left_s is None else Stamped(left_s.value / 60.0, left_s.at)


def _link(link: LinkSeen, known: Known) -> dict[str, Any]:
    old_s = inf if link.heard_at is None else max(0.0, known.now - link.heard_at)
    works = link.works and old_s <= OLD_S
    state = "not known" if known.dead else "works" if works else "silent"
    return {
        "name": link.name,
        "used": link.used,
        "works": works,
        "text": state,
        "age": age(old_s) if isfinite(old_s) else "not heard",
    }


def _peers(seen: StationSeen | None, known: Known) -> Iterator[dict[str, Any]]:
    if seen is None:
        return
    for peer in seen.peers:
        old_s = inf if peer.heard_at is None else max(0.0, known.now - peer.heard_at)
        fresh = [each for each in seen.aircraft if each.heard_at is not None and known.now - each.heard_at <= OLD_S]
        commands = [each.name for each in fresh if each.commander == peer.name]
        yield {
            "name": peer.name,
            "colour": known.colours.get(peer.name, NOBODY_COLOUR),
            "up": peer.up and old_s <= OLD_S,
            "text": "not known" if known.dead else "" if peer.up and old_s <= OLD_S else "not heard",
            "commands": ", ".join(commands),
            "operator": "" if known.dead else _operator(peer.operator, known.now),
            "age": age(old_s) if isfinite(old_s) else "not heard",
        }


def _lines(seen: StationSeen | None, known: Known) -> Iterator[dict[str, Any]]:
    """The newest first."""
    if seen is None:
        return
    found = [(line, craft) for craft in seen.aircraft for line in craft.lines]
    for line, craft in sorted(found, key=lambda pair: -pair[0].at)[:_LINES]:
        yield {
            "key": f"{craft.sysid}.{line.number}",
            "aircraft": craft.name if len(seen.aircraft) > 1 else "",
            "level": Level(min(max(line.level, 0), int(Level.EMERGENCY))).name.lower(),
            "text": for_buttons(line.text),
            "age": age(max(0.0, known.now - line.at)),
        }


_LINES: Final = 12


def _sound(seen: StationSeen | None, known: Known) -> str:
    """The level that is heard: "emergency", "warning" or ""."""
    if known.dead:
        return "emergency" if seen is not None else ""
    assert seen is not None
    worst = max((alarm.level for each in seen.aircraft for alarm in each.alarms if not alarm.acknowledged), default=0)
    return {int(Level.WARNING): "warning", int(Level.EMERGENCY): "emergency"}.get(worst, "")


def colours_of(station: str, peers: Sequence[str]) -> dict[str, str]:
    """Colours without a mission: in the order of the names, as at every station."""
    return {name: station_colour(number) for number, name in enumerate(sorted([station, *peers]))}


def marks_of(known: Known) -> dict[str, Any]:
    """The aircraft on the map, and the line of each to its return site."""
    seen = known.seen
    marks: list[dict[str, Any]] = []
    returns: list[dict[str, Any]] = []
    for craft in () if seen is None else seen.aircraft:
        place = craft.position
        if place is None:
            continue
        old_s = max(0.0, known.now - place.at)
        heading = craft.heading_deg
        at = [round(part, 7) for part in place.value]
        levels = [alarm.level for alarm in craft.alarms if not alarm.acknowledged]
        marks.append(
            {
                "name": craft.name,
                "label": craft.name[:_LABEL],
                "at": at,
                "heading": heading.value if heading is not None and known.now - heading.at <= OLD_S else None,
                "colour": known.colours.get(craft.commander, NOBODY_COLOUR),
                "old": f"{age(old_s)} old" if old_s > OLD_S else "",
                "level": Level(max(levels, default=0)).name.lower(),
            }
        )
        site = craft.return_site
        if site is not None and old_s <= GONE_S:
            returns.append(
                {
                    "key": craft.name,
                    "lines": [at, [site.lat_deg, site.lon_deg]],
                    "words": site.name,
                    "strong": craft.action in ("return", "land"),
                }
            )
    return {"marks": marks, "returns": returns}
