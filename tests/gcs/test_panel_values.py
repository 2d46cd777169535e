# SPDX-License-Identifier: GPL-3.0-or-later

"""The parts of the panel's page: ages, what is grey and what is gone, and a station that does not answer."""

from __future__ import annotations

from dataclasses import replace
from math import inf
from typing import Any

import pytest

from gcs_module.panel.panel_values import Known, colours_of, marks_of, page_of
from gcs_module.panel.snapshot import LineSeen, LinkSeen, PeerSeen, ReturnSite, Stamped, StationSeen
from tests.gcs.panel_states import GIVE, LOST, NOW, RETURNS, TAKE, craft, station

COLOURS = {"GCSA": "#0072B2", "GCSB": "#D55E00"}


def known(seen: StationSeen | None, later: float = 0.0, fault: str = "") -> Known:
    return Known("GCSA", seen, inf if seen is None else later, NOW + later, fault, COLOURS)


def sections(seen: StationSeen | None, later: float = 0.0, pinned: int = 0, fault: str = "") -> Any:
    return page_of(known(seen, later, fault), pinned).sections


def value(given: Any, label: str) -> tuple[str, str, str]:
    (row,) = [row for row in given["values"] if row["label"] == label]
    return row["text"], row["age"], row["state"]


@pytest.mark.parametrize(
    ("later", "row"),
    [
        (0.0, ("30 m", "0 s", "fresh")),
        (2.7, ("30 m", "3 s", "fresh")),
        (2.9, ("30 m", "3 s", "old")),
        (9.7, ("30 m", "10 s", "old")),
        (9.9, ("", "10 s", "gone")),
        (600.0, ("", "10 min", "gone")),
    ],
)
def test_a_value_is_grey_after_three_seconds_and_gone_after_ten(later: float, row: tuple[str, str, str]) -> None:
    assert value(sections(station(), later), "height") == row


def test_values_have_units_and_the_way_home() -> None:
    full = craft(battery_left_s=Stamped(620.0, NOW), position=Stamped((52.679, 5.9240), NOW))
    given = sections(station(replace(full, position=Stamped([52.679, 5.9388], NOW))))
    assert value(given, "battery")[0] == "94 %"
    assert value(given, "voltage")[0] == "12.4 V"
    assert value(given, "battery lasts")[0] == "10 min"
    assert value(given, "speed")[0] == "5.1 m/s"
    assert value(given, "a return goes to")[0] == "home, 1.0 km away"
    assert value(sections(station(full)), "a return goes to")[0] == "home, 0 m away"


def test_a_distance_is_as_old_as_its_older_place() -> None:
    given = sections(station(craft(position=Stamped((52.679, 5.9240), NOW - 5.0))))
    assert value(given, "a return goes to")[1:] == ("5 s", "old")


def test_what_was_never_heard_has_no_row() -> None:
    labels = [row["label"] for row in sections(station(craft(height_m=None, mode=None)))["values"]]
    assert "height" not in labels
    assert "mode" not in labels


@pytest.mark.parametrize(
    ("later", "fault", "dead"),
    [(0.0, "", False), (1.9, "", False), (2.1, "", True), (0.1, "it has ended", True)],
)
def test_a_station_that_does_not_answer_is_said_within_three_seconds(later: float, fault: str, dead: bool) -> None:
    given = sections(station(craft(question=GIVE)), later, fault=fault)
    assert given["head"]["dead"] is dead
    assert (given["band"]["level"] == "emergency") is dead
    assert (given["band"]["words"] == "NOT KNOWN") is dead
    assert (given["band"]["main"] == []) is dead
    assert (given["band"]["colour"] == "") is dead
    assert given["sound"] == ("emergency" if dead else "")


def test_before_a_station_was_ever_heard_the_page_says_what_to_start() -> None:
    given = sections(None, fault="it does not run here")
    assert given["band"]["next"] == (
        "The program of station GCSA does not answer: it does not run here. The aircraft acts by itself."
    )
    assert given["sound"] == ""
    assert given["values"] == given["alarms"] == given["rows"] == []


def test_several_aircraft_have_a_row_each_the_most_urgent_first() -> None:
    fleet = station(craft(sysid=1, name="drone-1"), craft(sysid=2, name="drone-2", question=GIVE))
    given = sections(fleet)
    assert [row["name"] for row in given["rows"]] == ["drone-2", "drone-1"]
    assert (given["band"]["aircraft"], given["band"]["vehicle"], given["band"]["pinned"]) == ("drone-2", 2, False)
    chosen = sections(fleet, pinned=1)
    assert (chosen["band"]["aircraft"], chosen["band"]["vehicle"], chosen["band"]["pinned"]) == ("drone-1", 1, True)
    assert sections(fleet, pinned=9)["band"]["vehicle"] == 2
    later = sections(fleet, 5.0)["rows"]
    assert [(row["words"], row["dead"]) for row in later] == [("NOT KNOWN", True)] * 2
    assert sections(station())["rows"] == []


@pytest.mark.parametrize(
    ("takes_s", "needs", "told"),
    [
        (95.0, 0.12, {"a return takes": "95 s to land", "a return needs": "12 % of the battery"}),
        (190.0, 1.3, {"a return takes": "3 min to land", "a return needs": "130 % of the battery"}),
        (None, None, {}),
    ],
)
def test_time_and_energy_of_a_return(takes_s: float | None, needs: float | None, told: dict[str, str]) -> None:
    site = ReturnSite("home", 52.679, 5.924, takes_s, needs)
    rows = {row["label"]: row["text"] for row in sections(station(craft(return_site=site)))["values"]}
    assert {label: text for label, text in rows.items() if label in ("a return takes", "a return needs")} == told
    gone = {row["label"]: row["text"] for row in sections(station(craft(return_site=site)), 11.0)["values"]}
    assert all(gone[label] == "" for label in told), "after 10 s without news"


def test_alarms_that_stand_come_first_with_cause_and_remedy() -> None:
    fleet = station(craft(alarms=(replace(LOST, acknowledged=True), RETURNS), action="return"))
    first, second = sections(fleet)["alarms"]
    assert (first["text"], first["remedy"], first["acknowledged"]) == (
        "RETURN to rally 2: GCSB silent 5 s.",
        "Let it return. When the cause is over, Resume continues the mission.",
        False,
    )
    assert second["text"] == "No station commands drone-1. When it is in your zone, press Request to take over."
    assert second["cause"].startswith("The commander is lost")
    assert second["remedy"] == "Request, if the aircraft is in your zone. Else watch it."
    assert (first["since"], second["since"]) == ("for 2 s", "for 4 s")


def test_the_alarm_of_a_question_has_the_seconds_of_now() -> None:
    """The line was told once, with the seconds of that moment."""
    told = replace(LOST, name="question", level=2, text="Handover GCSB -> GCSA of drone-1 in 20 s.")
    asked = station(craft(question=TAKE, alarms=(told,)))
    texts = [sections(asked, later)["alarms"][0]["text"] for later in (0.0, 1.5, 20.0)]
    assert texts == [
        "Handover GCSB to GCSA in 19 s: drone-1 waits for your answer.",
        "Handover GCSB to GCSA in 17 s: drone-1 waits for your answer.",
        "Handover GCSB to GCSA: drone-1 waits for your answer.",
    ]


@pytest.mark.parametrize(
    ("alarms", "sound"),
    [
        ((), ""),
        ((RETURNS,), "emergency"),
        ((replace(RETURNS, level=2),), "warning"),
        ((replace(RETURNS, level=1),), ""),
    ],
)
def test_an_alarm_sounds_until_it_is_acknowledged(alarms: Any, sound: str) -> None:
    assert sections(station(craft(alarms=alarms)))["sound"] == sound
    quiet = tuple(replace(alarm, acknowledged=True) for alarm in alarms)
    assert sections(station(craft(alarms=quiet)))["sound"] == ""


def test_links_and_stations_have_ages_and_say_that_they_are_silent() -> None:
    links = (
        LinkSeen("a", True, True, NOW - 0.2),
        LinkSeen("b", True, False, NOW - 4.0),
        LinkSeen("c", False, False, None),
    )
    given = sections(station(craft(links=links), peers=(PeerSeen("GCSB", False, NOW - 90.0, None),)))
    assert [(link["name"], link["works"], link["age"]) for link in given["links"]] == [
        ("a", True, "0 s"),
        ("b", False, "4 s"),
        ("c", False, "not heard"),
    ]
    assert [(peer["name"], peer["up"], peer["age"]) for peer in given["peers"]] == [("GCSB", False, "90 s")]


def test_another_station_commands_only_what_is_heard() -> None:
    peers = (PeerSeen("GCSB", True, NOW, None),)
    taken = craft(commander="GCSB", own=False)
    assert sections(station(taken, peers=peers))["peers"][0]["commands"] == "drone-1"
    assert sections(station(replace(taken, heard_at=NOW - 4.0), peers=peers))["peers"][0]["commands"] == ""


def test_the_newest_line_is_first_and_names_buttons() -> None:
    lines = (LineSeen(1, NOW - 9.0, 0, "old"), LineSeen(2, NOW - 1.0, 9, "Type 'handover accept' or 'handover deny'."))
    found = sections(station(craft(lines=lines)))["lines"]
    assert [(line["text"], line["age"], line["level"]) for line in found] == [
        ("Press Accept or Deny.", "1 s", "emergency"),
        ("old", "9 s", "info"),
    ]


def test_the_briefing_has_its_age() -> None:
    asked = craft(question=TAKE, briefing=(("leg", "to waypoint 3"),), briefing_at=NOW - 7.0)
    assert sections(station(asked))["briefing"] == {"age": "7 s old", "rows": [["leg", "to waypoint 3"]]}


def test_the_map_shows_old_places_as_old_and_the_way_of_a_return() -> None:
    found = marks_of(known(station(craft(action="return", alarms=(RETURNS,)))))
    assert found["marks"][0]["old"] == ""
    assert (found["marks"][0]["level"], found["marks"][0]["colour"]) == ("emergency", "#0072B2")
    assert found["returns"] == [
        {"key": "drone-1", "lines": [[52.679, 5.9245], [52.679, 5.924]], "words": "home", "strong": True}
    ]
    later = marks_of(known(station(), 20.0))
    assert (later["marks"][0]["old"], later["marks"][0]["heading"], later["returns"]) == ("20 s old", None, [])


def test_stations_have_the_same_colours_at_every_station() -> None:
    assert colours_of("GCSB", ["GCSA"]) == colours_of("GCSA", ["GCSB"]) == COLOURS
