# SPDX-License-Identifier: GPL-3.0-or-later

"""The band of the panel: which station commands, what comes next, what the operator has to do. Pure.

Theory of operation
-------------------
`RULES` is a list of situations, the most urgent first. The first one that fits an aircraft makes its band. With several
aircraft each has a band, and the page shows the most urgent one in full.

Rules that live here
--------------------
* If the station's program does not answer, or the aircraft was not heard for OLD_S, the band does not say who commands:
  it says what was known last, and from when. After GONE_S that is not shown either.
* There is one thing to do. Its buttons come first (`main`). The other orders that make sense now follow (`more`).
* The buttons of an answer carry the number of the question.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf
from typing import Final

from gcs_module.alarms import Level
from gcs_module.duty import NEEDS_OPERATOR
from gcs_module.panel.snapshot import AircraftSeen, AlarmSeen, Border, Question, StationSeen
from gcs_module.panel.words import LABELS, age, for_buttons, remedy_of, seconds_to

__all__ = ["DEAD_S", "GONE_S", "OLD_S", "Band", "Button", "Who", "band_of", "bands", "dead_band"]

#: the station's program counts as dead without a snapshot for this long (s)
DEAD_S: Final = 2.0
#: an aircraft, and a value, is old after this time (s), and not shown after the other
OLD_S: Final = 3.0
GONE_S: Final = 10.0
#: modes in which the mission is flown
_MISSION: Final = ("AUTO", "")
_RETURNS: Final = ("RTL", "SMART_RTL", "QRTL", "LAND")
_NOTHING: Final = "Nothing to do"
#: lines, the last ones, that may say what to do now
_TOLD: Final = 4


class Who:
    """Which station commands, seen from this one."""

    YOU = "you"
    OTHER = "other"
    NOBODY = "nobody"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class Button:
    """A button. `argument`: of the order; `choices`: the arguments to choose from, if there are several."""

    do: str
    label: str
    argument: str = ""
    choices: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Band:
    """The band of one aircraft.

    `who`: of `Who`; `who_words`: the same in large letters; `next_at`: when the next event comes (the station's time),
    None: no time is known; `next_words`: the event, "{s}" stands for the seconds. `rank`: the place among several
    aircraft, the lowest first.
    """

    vehicle: int
    name: str
    level: Level
    who: str
    who_words: str
    next_words: str
    next_at: float | None
    do: str
    main: tuple[Button, ...]
    more: tuple[Button, ...]
    rank: int

    def next_text(self, now: float) -> str:
        """The next event with its seconds. `now`: the station's time."""
        return self.next_words.replace("{s}", seconds_to(self.next_at or 0.0, now))


@dataclass(frozen=True, slots=True)
class _Case:
    """One aircraft at one moment, with what its band may need."""

    craft: AircraftSeen
    station: StationSeen
    now: float

    @property
    def heard_s(self) -> float:
        return inf if self.craft.heard_at is None else self.now - self.craft.heard_at

    @property
    def flying(self) -> bool:
        return self.craft.phase != "on_load"

    @property
    def mode(self) -> str:
        """The mode, "" if it is old or not known."""
        mode = self.craft.mode
        return str(mode.value) if mode is not None and self.now - mode.at <= OLD_S else ""

    @property
    def manned(self) -> bool:
        """Whether the station may take an aircraft."""
        return bool(self.station.operator) or not self.station.required

    @property
    def share(self) -> bool:
        """Whether the mission may have to be sent again: on the ground, or if a sentence of now says so."""
        craft = self.craft
        told = (
            craft.decision,
            *(alarm.remedy for alarm in craft.alarms),
            *(line.text for line in craft.lines[-_TOLD:]),
        )
        return not self.flying or any("'handover share'" in text for text in told)

    @property
    def loud(self) -> AlarmSeen | None:
        """The gravest alarm that is not acknowledged."""
        return next((alarm for alarm in self.craft.alarms if not alarm.acknowledged), None)

    def band(
        self,
        level: Level,
        next_words: str,
        do: str,
        main: Sequence[Button] = (),
        *,
        next_at: float | None = None,
        who: str = "",
        who_words: str = "",
        extra: Sequence[Button] = (),
    ) -> Band:
        known, words = _who(self.craft)
        first = tuple(main)
        quiet = who == Who.UNKNOWN
        if not self.manned and any(button.do in NEEDS_OPERATOR for button in first):
            do = f"Sign on first: no operator is on duty. {do}"
            first = (_button("sign_on"), *(button for button in first if button.do not in NEEDS_OPERATOR))
        lifted = [(limit, until) for limit, until in self.craft.overrides if until > self.now]
        if lifted and not quiet:
            level = max(level, Level.ADVISORY)
            told = " and ".join(f"{limit} (ends {seconds_to(until, self.now)})" for limit, until in lifted)
            do = f"{do} Limit lifted by override: {told}."
        more = (
            ()
            if quiet
            else tuple(each for each in (*self._more(), *extra) if each.do not in {button.do for button in first})
        )
        return Band(
            vehicle=self.craft.sysid,
            name=self.craft.name,
            level=level,
            who=who or known,
            who_words=who_words or words,
            next_words=next_words,
            next_at=next_at,
            do=do,
            main=first,
            more=more,
            rank=-10 * int(level) - (5 if first else 0),
        )

    def _more(self) -> list[Button]:
        """All orders that make sense now."""
        craft, found = self.craft, []
        if self.loud is not None:
            found.append(_button("acknowledge"))
        if craft.own:
            if self.flying:
                paused = self.mode not in _MISSION
                found += [_button(do) for do in (("resume",) if paused else ("stop",))]
                found += [_button("continue"), _button("return")]
            else:
                found.append(_button("start"))
            found.append(Button("give", LABELS["give"], choices=tuple(peer.name for peer in self.station.peers)))
            found.append(_button("release"))
            found.append(Button("override", f"{LABELS['override']} 60 s", choices=self.station.limits))
        elif craft.question is None or not craft.question.take:
            found.append(_button("request"))
        if self.share:
            found.append(_button("share"))
        return found if self.manned else [button for button in found if button.do not in NEEDS_OPERATOR]


def _button(do: str, argument: str = "", label: str = "") -> Button:
    return Button(do, label or LABELS[do], argument)


def _answers(number: str) -> tuple[Button, ...]:
    return _button("accept", number), _button("deny", number)


def _who(craft: AircraftSeen) -> tuple[str, str]:
    if not craft.commander:
        return Who.NOBODY, "NO STATION"
    return (Who.YOU, "YOU") if craft.own else (Who.OTHER, craft.commander)


# ---- the situations, the most urgent first --------------------------------------------------------------------------


def _never_heard(case: _Case) -> Band | None:
    if case.heard_s < inf:
        return None
    words = f"{case.craft.name} has not been heard yet."
    return case.band(Level.INFO, words, "Wait. Check link and antenna.", who=Who.UNKNOWN, who_words="NOT KNOWN")


def _not_heard(case: _Case) -> Band | None:
    if case.heard_s <= OLD_S:
        return None
    _known, words = _who(case.craft)
    last = f"NOT KNOWN ({words} {age(case.heard_s)} ago)" if case.heard_s <= GONE_S else "NOT KNOWN"
    return case.band(
        Level.WARNING,
        f"{case.craft.name} not heard for {age(case.heard_s)}.",
        "Check link and antenna. The aircraft acts by itself if its commander is lost.",
        [_button("acknowledge")] if case.loud is not None else (),
        who=Who.UNKNOWN,
        who_words=last,
    )


def _question(case: _Case) -> Band | None:
    asked = case.craft.question
    if asked is None:
        return None
    name = case.craft.name
    do = f"Take {name} from {asked.from_station}?" if asked.take else f"Let {asked.to_station} take {name}?"
    if not case.craft.commander:
        do = f"Take {name}? No station commands it."
    words, at = _answer_time(asked)
    level = Level.WARNING if case.craft.commander or not case.flying else Level.EMERGENCY
    return case.band(level, words, do, _answers(asked.number), next_at=at)


def _answer_time(asked: Question) -> tuple[str, float | None]:
    if asked.border_at is not None:
        return f"Handover {asked.from_station} to {asked.to_station} {{s}}.", asked.border_at
    if asked.until is not None:
        return "The time to answer ends {s}.", asked.until
    return f"Handover {asked.from_station} to {asked.to_station}.", None


def _alone(case: _Case) -> Band | None:
    if case.craft.commander or not case.craft.alone:
        return None
    words = "The aircraft flies on alone until the declared gap ends."
    return case.band(Level.ADVISORY, words, "Wait until it leaves the gap.")


def _no_commander(case: _Case) -> Band | None:
    if case.craft.commander or not case.flying:
        return None
    words = case.craft.decision or "No decision of the aircraft is known yet."
    zone, main = case.craft.zone, "acknowledge" if case.loud is not None else ""
    if zone == case.station.station:
        do, main = "Request control: the aircraft is in your zone.", "request"
    elif zone:
        do = f"Watch it: it is in {zone}'s zone. Request control only if it is in yours too."
    else:
        do = "Watch it. Request control if the aircraft is in your zone."
    return case.band(Level.EMERGENCY, words, do, [_button(main)] if main else ())


def _no_commander_on_ground(case: _Case) -> Band | None:
    if case.craft.commander:
        return None
    words = "The aircraft waits on the ground."
    return case.band(Level.INFO, words, "Request control if you start the flight.", [_button("request")])


def _under_way(case: _Case) -> Band | None:
    craft = case.craft
    if not craft.partner:
        return None
    words = f"Handover {craft.commander} to {craft.partner} now."
    if craft.answer_until is None:
        return case.band(Level.ADVISORY, words, "Wait: the handover takes a moment.")
    words = f"Handover {craft.commander} to {craft.partner}: the time to answer ends {{s}}."
    return case.band(Level.ADVISORY, words, "Wait for the other operator's answer.", next_at=craft.answer_until)


def _decided(case: _Case) -> Band | None:
    craft = case.craft
    grave = {"return": Level.EMERGENCY, "land": Level.EMERGENCY, "hold": Level.WARNING, "continue": Level.WARNING}
    level = grave.get(craft.action)
    if level is None or not craft.decision:
        return None
    main = [_button("acknowledge")] if case.loud is not None else []
    if craft.action == "hold" and craft.own:
        main.append(Button("give", LABELS["give"], choices=tuple(peer.name for peer in case.station.peers)))
    return case.band(level, craft.decision, remedy_of(craft.action, craft.own), main)


def _alarm(case: _Case) -> Band | None:
    alarm = case.loud
    if alarm is None or alarm.level < Level.WARNING:
        return None
    do = for_buttons(alarm.remedy) or "Read it, then acknowledge it."
    return case.band(Level(alarm.level), for_buttons(alarm.text), do, [_button("acknowledge")])


def _unmanned(case: _Case) -> Band | None:
    if case.manned:
        return None
    words = "No operator is on duty: this station takes no aircraft."
    return case.band(Level.WARNING, words, "Sign on with your name.", [_button("sign_on")])


def _paused(case: _Case) -> Band | None:
    """The mission is not flown, without a decision: an operator or the pilot has stopped it, or ordered a return."""
    craft = case.craft
    if not case.flying or not case.mode or case.mode in _MISSION:
        return None
    returns = case.mode in _RETURNS
    place = f" to {craft.return_site.name}" if craft.return_site is not None and returns else ""
    words = f"The aircraft is in {case.mode}: it {'returns' + place if returns else 'does not fly its mission'}."
    if not craft.own:
        return case.band(Level.ADVISORY, words, f"{_NOTHING}.")
    return case.band(Level.ADVISORY, words, "Resume continues the mission.", [_button("resume")])


def _border(case: _Case) -> Band | None:
    border = case.craft.border
    if border is None:
        return None
    other = border.to_station if border.from_station == case.station.station else border.from_station
    change = {"granted": "deny", "denied": "accept"}.get(border.answer)
    extra = () if change is None else (_button(change, border.number, f"{LABELS[change]} instead"),)
    if "denied" in (border.answer, border.other):
        return _denied(case, border, other, extra)
    words = f"Handover {border.from_station} to {border.to_station} {{s}}."
    mine = "you have agreed" if border.answer == "granted" else ""
    theirs = f"{other} has not answered yet" if border.other == "waiting" else ""
    known = ", ".join(filter(None, (mine, theirs)))
    do = f"{_NOTHING}: {known}." if known else f"{_NOTHING}."
    return case.band(Level.INFO, words, do, next_at=border.at, extra=extra)


def _denied(case: _Case, border: Border, other: str, extra: Sequence[Button]) -> Band:
    """The aircraft is about to reach a border at which it will not be taken."""
    who = "you have denied" if border.answer == "denied" else f"{other} has denied"
    words = f"Border to {border.to_station} {{s}}: {who} the handover."
    if not case.craft.own:
        return case.band(Level.ADVISORY, words, f"{_NOTHING}.", next_at=border.at, extra=extra)
    change = "accept instead" if border.answer == "denied" else f"talk to {other}"
    do = f"Stop the aircraft, or {change}."
    return case.band(Level.WARNING, words, do, [_button("stop")], next_at=border.at, extra=extra)


def _zone_ends(case: _Case) -> Band | None:
    ends = case.craft.zone_ends_at
    if ends is None or not case.flying:
        return None
    return case.band(Level.INFO, f"The zone of {case.craft.commander} ends {{s}}.", f"{_NOTHING}.", next_at=ends)


def _normal(case: _Case) -> Band | None:
    if case.flying:
        return case.band(Level.INFO, "No handover is expected.", f"{_NOTHING}.")
    words = "The aircraft waits on the ground for Start."
    if not case.craft.own:
        return case.band(Level.INFO, words, f"{_NOTHING}: {case.craft.commander} starts the flight.")
    return case.band(Level.INFO, words, "Press Start when you are ready to fly.", [_button("start")])


RULES: Final[tuple[Callable[[_Case], Band | None], ...]] = (
    _never_heard,
    _not_heard,
    _question,
    _alone,
    _no_commander,
    _no_commander_on_ground,
    _decided,
    _under_way,
    _alarm,
    _unmanned,
    _paused,
    _border,
    _zone_ends,
    _normal,
)


def band_of(craft: AircraftSeen, station: StationSeen, now: float) -> Band:
    """The band of one aircraft. `now`: the station's time."""
    case = _Case(craft, station, now)
    return next(band for rule in RULES if (band := rule(case)) is not None)


def bands(station: StationSeen, now: float) -> tuple[Band, ...]:
    """The bands of all aircraft, the most urgent first, then in the order of the configuration."""
    return tuple(sorted((band_of(craft, station, now) for craft in station.aircraft), key=lambda band: band.rank))


def dead_band(name: str, configuration: str, why: str, old_s: float) -> Band:
    """The band while the station's program does not answer. `name`: of the station; `old_s`: age of what was known."""
    known = "" if old_s == inf else f" This page shows what was known {age(old_s)} ago."
    start = f"handover station --config {configuration}" if configuration else "handover station"
    return Band(
        vehicle=0,
        name=name,
        level=Level.EMERGENCY,
        who=Who.UNKNOWN,
        who_words="NOT KNOWN",
        next_words=f"The program of station {name} does not answer: {why}. The aircraft acts by itself.{known}",
        next_at=None,
        do=f"Start it again: {start}",
        main=(),
        more=(),
        rank=-100,
    )
