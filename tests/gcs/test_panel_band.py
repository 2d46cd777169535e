# SPDX-License-Identifier: GPL-3.0-or-later

"""The band of the panel, by a table of states written out: who commands, what is next, what to do, which buttons."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf

import pytest

from gcs_module.alarms import Level
from gcs_module.panel.band import DEAD_S, GONE_S, OLD_S, Band, band_of, bands, dead_band
from gcs_module.panel.snapshot import AircraftSeen, AlarmSeen, Border, LineSeen, Stamped
from gcs_module.panel.words import for_buttons
from tests.gcs.panel_states import BORDER, GIVE, LOST, NOW, RETURNS, TAKE, craft, station

FLY = "stop continue return give release override"
RETURN = "RETURN to rally 2: GCSA silent 5 s."
OFF_ROUTE = AlarmSeen("route", 2, "120 m off its route.", "Not on its route.", "Look at mode.", False, NOW)


@dataclass(frozen=True)
class State:
    """A state of an aircraft, and its band as it must be."""

    craft: AircraftSeen
    level: str
    who: str
    next: str
    do: str
    main: str = ""
    more: str = ""


STATES = {
    "normal": State(craft(), "INFO", "YOU", "No handover is expected.", "Nothing to do.", "", FLY),
    "other commands": State(
        craft(commander="GCSB", own=False), "INFO", "GCSB", "No handover is expected.", "Nothing to do.", "", "request"
    ),
    "border ahead": State(
        craft(border=BORDER),
        "INFO",
        "YOU",
        "Handover GCSA to GCSB in 43 s.",
        "Nothing to do: you have agreed.",
        "",
        f"{FLY} deny",
    ),
    "border ahead, other operator asked": State(
        craft(border=replace(BORDER, other="waiting")),
        "INFO",
        "YOU",
        "Handover GCSA to GCSB in 43 s.",
        "Nothing to do: you have agreed, GCSB has not answered yet.",
        "",
        f"{FLY} deny",
    ),
    "border ahead, denied by the other": State(
        craft(border=replace(BORDER, other="denied")),
        "WARNING",
        "YOU",
        "Border to GCSB in 43 s: GCSB has denied the handover.",
        "Stop the aircraft, or talk to GCSB.",
        "stop",
        "continue return give release override deny",
    ),
    "border ahead, denied here": State(
        craft(border=replace(BORDER, answer="denied")),
        "WARNING",
        "YOU",
        "Border to GCSB in 43 s: you have denied the handover.",
        "Stop the aircraft, or accept instead.",
        "stop",
        "continue return give release override accept",
    ),
    "border ahead, denied by the partner, which is here": State(
        craft(
            commander="GCSB",
            own=False,
            border=Border("252.251.3.7.-1", "GCSB", "GCSA", NOW + 42.2, "denied", "granted"),
        ),
        "ADVISORY",
        "GCSB",
        "Border to GCSA in 43 s: you have denied the handover.",
        "Nothing to do.",
        "",
        "request accept",
    ),
    "question to take": State(
        craft(commander="GCSB", own=False, question=TAKE),
        "WARNING",
        "GCSB",
        "Handover GCSB to GCSA in 19 s.",
        "Take drone-1 from GCSB?",
        "accept deny",
    ),
    "question to give": State(
        craft(question=GIVE),
        "WARNING",
        "YOU",
        "Handover GCSA to GCSB in 19 s.",
        "Let GCSB take drone-1?",
        "accept deny",
        FLY,
    ),
    "question at the border": State(
        craft(question=replace(GIVE, early=False, border_at=None), partner="GCSB", answer_until=NOW + 18.4),
        "WARNING",
        "YOU",
        "The time to answer ends in 19 s.",
        "Let GCSB take drone-1?",
        "accept deny",
        FLY,
    ),
    "question without a time": State(
        craft(question=replace(GIVE, early=False, border_at=None, until=None)),
        "WARNING",
        "YOU",
        "Handover GCSA to GCSB.",
        "Let GCSB take drone-1?",
        "accept deny",
        FLY,
    ),
    "question whose time is over": State(
        craft(question=replace(GIVE, border_at=NOW - 3.0)),
        "WARNING",
        "YOU",
        "Handover GCSA to GCSB now.",
        "Let GCSB take drone-1?",
        "accept deny",
        FLY,
    ),
    "question while no station commands": State(
        craft(commander="", own=False, phase="emergency", question=replace(TAKE, early=False, border_at=None)),
        "EMERGENCY",
        "NO STATION",
        "The time to answer ends in 19 s.",
        "Take drone-1? No station commands it.",
        "accept deny",
    ),
    "handover under way": State(
        craft(partner="GCSB", phase="on_handover"),
        "ADVISORY",
        "YOU",
        "Handover GCSA to GCSB now.",
        "Wait: the handover takes a moment.",
        "",
        FLY,
    ),
    "the other operator is asked": State(
        craft(partner="GCSB", phase="on_handover", answer_until=NOW + 9.5),
        "ADVISORY",
        "YOU",
        "Handover GCSA to GCSB: the time to answer ends in 10 s.",
        "Wait for the other operator's answer.",
        "",
        FLY,
    ),
    "no station commands": State(
        craft(commander="", own=False, phase="emergency", action="return", decision=RETURN, alarms=(LOST,)),
        "EMERGENCY",
        "NO STATION",
        RETURN,
        "Request control: the aircraft is in your zone.",
        "request",
        "acknowledge",
    ),
    "no station commands, in another zone": State(
        craft(commander="", own=False, phase="emergency", action="return", decision=RETURN, zone="GCSB"),
        "EMERGENCY",
        "NO STATION",
        RETURN,
        "Watch it: it is in GCSB's zone. Request control only if it is in yours too.",
        "",
        "request",
    ),
    "no station commands, in no zone": State(
        craft(commander="", own=False, phase="emergency", action="return", decision=RETURN, zone=""),
        "EMERGENCY",
        "NO STATION",
        RETURN,
        "Watch it. Request control if the aircraft is in your zone.",
        "",
        "request",
    ),
    "no station commands, just now": State(
        craft(commander="", own=False, phase="emergency"),
        "EMERGENCY",
        "NO STATION",
        "No decision of the aircraft is known yet.",
        "Request control: the aircraft is in your zone.",
        "request",
        "",
    ),
    "declared gap": State(
        craft(commander="", own=False, alone=True),
        "ADVISORY",
        "NO STATION",
        "The aircraft flies on alone until the declared gap ends.",
        "Wait until it leaves the gap.",
        "",
        "request",
    ),
    "on the ground, nobody": State(
        craft(commander="", own=False, phase="on_load"),
        "INFO",
        "NO STATION",
        "The aircraft waits on the ground.",
        "Request control if you start the flight.",
        "request",
        "share",
    ),
    "on the ground, mine": State(
        craft(phase="on_load"),
        "INFO",
        "YOU",
        "The aircraft waits on the ground for Start.",
        "Press Start when you are ready to fly.",
        "start",
        "give release override share",
    ),
    "on the ground, another's": State(
        craft(phase="on_load", commander="GCSB", own=False),
        "INFO",
        "GCSB",
        "The aircraft waits on the ground for Start.",
        "Nothing to do: GCSB starts the flight.",
        "",
        "request share",
    ),
    "a limit is lifted": State(
        craft(border=BORDER, overrides=(("energy", NOW + 47.6), ("fence", NOW - 1.0))),
        "ADVISORY",
        "YOU",
        "Handover GCSA to GCSB in 43 s.",
        "Nothing to do: you have agreed. Limit lifted by override: energy (ends in 48 s).",
        "",
        f"{FLY} deny",
    ),
    "the partner has another mission": State(
        craft(lines=(LineSeen(1, NOW - 2.0, 2, "GCSB has another mission. Send it with 'handover share'."),)),
        "INFO",
        "YOU",
        "No handover is expected.",
        "Nothing to do.",
        "",
        f"{FLY} share",
    ),
    "returns, mine": State(
        craft(action="return", decision=RETURN, alarms=(RETURNS,), mode=Stamped("RTL", NOW)),
        "EMERGENCY",
        "YOU",
        RETURN,
        "Let it return. When the cause is over, Resume continues the mission.",
        "acknowledge",
        "resume continue return give release override",
    ),
    "returns, acknowledged, another's": State(
        craft(
            commander="GCSB",
            own=False,
            action="return",
            decision=RETURN,
            alarms=(replace(RETURNS, acknowledged=True),),
        ),
        "EMERGENCY",
        "GCSB",
        RETURN,
        "Let it return. Request control if the aircraft is in your zone.",
        "",
        "request",
    ),
    "holds": State(
        craft(action="hold", decision="HOLD: no partner is ready."),
        "WARNING",
        "YOU",
        "HOLD: no partner is ready.",
        "Give the aircraft to a station that can take it, or wait.",
        "give",
        "stop continue return release override",
    ),
    "off its route": State(
        craft(alarms=(OFF_ROUTE,)), "WARNING", "YOU", "120 m off its route.", "Look at mode.", "acknowledge", FLY
    ),
    "stopped": State(
        craft(mode=Stamped("BRAKE", NOW)),
        "ADVISORY",
        "YOU",
        "The aircraft is in BRAKE: it does not fly its mission.",
        "Resume continues the mission.",
        "resume",
        "continue return give release override",
    ),
    "ordered to return": State(
        craft(mode=Stamped("RTL", NOW)),
        "ADVISORY",
        "YOU",
        "The aircraft is in RTL: it returns to home.",
        "Resume continues the mission.",
        "resume",
        "continue return give release override",
    ),
    "stopped by another": State(
        craft(mode=Stamped("LOITER", NOW), commander="GCSB", own=False),
        "ADVISORY",
        "GCSB",
        "The aircraft is in LOITER: it does not fly its mission.",
        "Nothing to do.",
        "",
        "request",
    ),
    "a mode that is old says nothing": State(
        craft(mode=Stamped("LOITER", NOW - 4.0)), "INFO", "YOU", "No handover is expected.", "Nothing to do.", "", FLY
    ),
    "zone ends": State(
        craft(zone_ends_at=NOW + 33.0), "INFO", "YOU", "The zone of GCSA ends in 33 s.", "Nothing to do.", "", FLY
    ),
    "not heard for a moment": State(
        craft(heard_at=NOW - OLD_S - 1.0, question=GIVE),
        "WARNING",
        "NOT KNOWN (YOU 4 s ago)",
        "drone-1 not heard for 4 s.",
        "Check link and antenna. The aircraft acts by itself if its commander is lost.",
    ),
    "not heard for long": State(
        craft(heard_at=NOW - GONE_S - 32.0, alarms=(OFF_ROUTE,)),
        "WARNING",
        "NOT KNOWN",
        "drone-1 not heard for 42 s.",
        "Check link and antenna. The aircraft acts by itself if its commander is lost.",
        "acknowledge",
    ),
    "never heard": State(
        craft(heard_at=None, commander="", own=False, phase="on_load"),
        "INFO",
        "NOT KNOWN",
        "drone-1 has not been heard yet.",
        "Wait. Check link and antenna.",
    ),
}


def dos(buttons: object) -> str:
    return " ".join(button.do for button in buttons)  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", STATES)
def test_the_band_says_who_commands_what_is_next_and_what_to_do(name: str) -> None:
    state = STATES[name]
    band = band_of(state.craft, station(state.craft), NOW)
    said = (band.level.name, band.who_words, band.next_text(NOW), band.do, dos(band.main), dos(band.more))
    assert said == (state.level, state.who, state.next, state.do, state.main, state.more)


def test_a_station_that_needs_an_operator_asks_for_the_sign_on_first() -> None:
    unmanned = {"operator": "", "required": True}
    for given, level, do, main, more in (
        (craft(), "WARNING", "Sign on with your name.", "sign_on", FLY),
        (craft(phase="on_load"), "WARNING", "Sign on with your name.", "sign_on", "give release override share"),
        (
            craft(commander="", own=False, phase="emergency", decision=RETURN),
            "EMERGENCY",
            "Sign on first: no operator is on duty. Request control: the aircraft is in your zone.",
            "sign_on",
            "",
        ),
        (
            craft(question=TAKE, commander="GCSB", own=False),
            "WARNING",
            "Sign on first: no operator is on duty. Take drone-1 from GCSB?",
            "sign_on deny",
            "",
        ),
    ):
        band = band_of(given, station(given, **unmanned), NOW)
        said = (band.level.name, band.do, dos(band.main), dos(band.more))
        assert said == (level, do, main, more)


def test_the_answer_buttons_carry_the_number_of_their_question() -> None:
    band = band_of(craft(question=TAKE, own=False, commander="GCSB"), station(), NOW)
    assert [(button.do, button.argument) for button in band.main] == [
        ("accept", "252.251.3.7.-1"),
        ("deny", "252.251.3.7.-1"),
    ]


def test_the_seconds_count_down_with_the_time() -> None:
    band = band_of(craft(question=GIVE), station(), NOW)
    assert [band.next_text(NOW + s)[-9:] for s in (0.0, 1.0, 8.5, 18.4, 60.0)] == [
        " in 19 s.",
        " in 18 s.",
        " in 10 s.",
        "GCSB now.",
        "GCSB now.",
    ]


def test_give_and_override_offer_their_choices() -> None:
    band = band_of(craft(), station(), NOW)
    choices = {button.do: button.choices for button in band.more if button.choices}
    assert choices == {"give": ("GCSB",), "override": ("energy", "fence", "coverage")}


def test_the_most_urgent_aircraft_comes_first() -> None:
    fleet = station(
        craft(sysid=1, name="normal"),
        craft(sysid=2, name="silent", heard_at=NOW - 60.0),
        craft(sysid=3, name="asked", question=GIVE),
        craft(sysid=4, name="lost", commander="", own=False, phase="emergency"),
        craft(sysid=5, name="stopped", mode=Stamped("BRAKE", NOW)),
        craft(sysid=6, name="normal too"),
    )
    assert [band.name for band in bands(fleet, NOW)] == ["lost", "asked", "silent", "stopped", "normal", "normal too"]


def test_a_dead_station_says_so_and_offers_no_button() -> None:
    band = dead_band("GCSA", "/etc/handover/station.toml", "it has ended", 4.2)
    assert (band.level, band.who_words, band.main, band.more) == (Level.EMERGENCY, "NOT KNOWN", (), ())
    assert band.next_text(NOW) == (
        "The program of station GCSA does not answer: it has ended. The aircraft acts by itself. "
        "This page shows what was known 4 s ago."
    )
    assert band.do == "Start it again: handover station --config /etc/handover/station.toml"
    assert dead_band("GCSA", "", "it does not run here", inf).do == "Start it again: handover station"
    assert DEAD_S < 3.0


@pytest.mark.parametrize(
    ("typed", "pressed"),
    [
        ("Handover GCSA -> GCSB in 20 s. Type 'handover accept' or 'handover deny'.", "Handover GCSA -> GCSB in 20 s."),
        (
            "When it is in your zone, type 'handover request' to take over.",
            "When it is in your zone, press Request to take over.",
        ),
        ("'handover give STATION' or 'handover release' passes it on.", "Give to or Release passes it on."),
        ("Type 'handover -v drone-2 ack'.", "Press Acknowledge."),
        ("'handover status' shows what goes on.", "'handover status' shows what goes on."),
        ("Nothing.", "Nothing."),
    ],
)
def test_a_sentence_names_buttons_in_place_of_typed_commands(typed: str, pressed: str) -> None:
    assert for_buttons(typed) == pressed


def test_every_state_has_one_thing_to_do() -> None:
    for state in STATES.values():
        made: Band = band_of(state.craft, station(state.craft), NOW)
        assert made.do
        assert made.next_words
