# SPDX-License-Identifier: GPL-3.0-or-later

"""What the page makes of journals: whose word counts, how old it is, what is grave, and that there is an end to it."""

from __future__ import annotations

from typing import Any

import pytest

from gcs_module.alarms import DECISIONS, EVENTS, Level
from gcs_module.watch.journals import TOLD, Writer
from gcs_module.watch.missions import read
from gcs_module.watch.page_values import Shown, age, shown
from gcs_module.watch.scene import FEED, MOST_AIRCRAFT, MOST_STATIONS, TRACK, Scene, Track
from gcs_module.watch.tail import Entry
from mavproxy_handover.core.common.model import FlightAction
from tests.packages import MISSIONS

#: what the watching machine's clocks say at the beginning: monotonic, and since 1970
NOW, UTC = 1000.0, 1_700_000_000.0


class Watching:
    """A scene, and journals that are read as they are written; `written_s` is how long ago, by the writer's clock."""

    def __init__(self) -> None:
        self.scene = Scene()
        self.writers: dict[str, Writer] = {}
        self.now = NOW

    def say(self, who: str, event: str, text: str = "", written_s: float = 0.0, **fields: Any) -> None:
        writer = self.writers.setdefault(who, Writer(self.scene, f"{who}.jsonl"))
        utc = UTC + self.now - NOW
        writer.add_entry(Entry(utc - written_s, who, event, text, fields), self.now, utc)

    def view(self, commander: str | None, phase: str = "on_mission", lease: str = "held", **more: Any) -> None:
        self.say("drone-1", "view", phase=phase, commander=commander, lease=lease, epoch=3, **more)

    def position(self, lat_deg: float = 52.68, commander: str | None = "GCSA", **more: Any) -> None:
        self.say("drone-1", "position", lat_deg=lat_deg, lon_deg=5.92, alt_m=40.0, commander=commander, **more)

    @property
    def shown(self) -> Shown:
        return shown(self.scene, {}, self.now)

    @property
    def row(self) -> Any:
        (row,) = self.shown.aircraft
        return row

    @property
    def alarms(self) -> list[tuple[str, str]]:
        return [(row["level"], row["text"]) for row in self.shown.alarms]


@pytest.fixture
def watching() -> Watching:
    return Watching()


def test_an_aircraft_is_shown_as_its_journal_says(watching: Watching) -> None:
    watching.say("drone-1", "loaded", "handover 0.1.0, configuration x")
    watching.say("drone-1", "station_heard", "GCSB is heard", station="GCSB")
    watching.view("GCSA", partner="GCSB", phase="on_handover", lease="transfer")
    watching.say("drone-1", "guard", "guard: lost -> live")
    watching.say("drone-1", "mode", "mode AUTO", mode="AUTO")
    watching.say("drone-1", "energy", "88.0 Wh of 126.0 Wh left, 385 W", left_wh=88.0)
    watching.position(zone="GCSA", waypoint=3)
    row = watching.row
    assert (row["name"], row["commander"], row["next"], row["old"]) == ("drone-1", "GCSA", "GCSB now", "")
    assert (row["phase"], row["lease"], row["guard"]) == ("handover · AUTO", "transfer", "live")
    assert (row["battery"], row["place"]) == ("88.0 Wh of 126.0 Wh", "40 m, in GCSA")
    assert [(link["name"], link["state"]) for link in row["links"]] == [("GCSB", "good")]


def test_what_is_old_says_how_old(watching: Watching) -> None:
    watching.view("GCSA")
    watching.position()
    assert watching.row["old"] == ""
    watching.now += 12.0
    assert watching.row["old"] == "12 s old"
    (mark,) = watching.shown.marks
    assert mark["old"] == "12 s old"
    assert watching.alarms == [("warning", "nothing new for 12 s")]
    watching.view("GCSA")  # it speaks again, and not of its place
    row = watching.row
    assert (row["old"], row["place"]) == ("", "40 m, outside every zone (12 s old)")
    assert watching.alarms == []


def test_a_value_that_is_written_when_it_changes_is_as_new_as_its_journal(watching: Watching) -> None:
    watching.view("GCSA")
    for _ in range(60):
        watching.now += 1.0
        watching.position()
    assert (watching.row["lease"], watching.row["commander"]) == ("held", "GCSA")


@pytest.mark.parametrize(("ahead_s", "shown_as"), [(-13.0, "13 s old"), (13.0, "")])
def test_a_clock_that_is_wrong_makes_nothing_newer_than_it_is(
    watching: Watching, ahead_s: float, shown_as: str
) -> None:
    watching.say("drone-1", "position", written_s=-ahead_s, lat_deg=52.0, lon_deg=5.0)
    assert watching.row["old"] == shown_as
    watching.now += 20.0
    assert watching.row["old"] == {"13 s old": "33 s old", "": "20 s old"}[shown_as]


def test_a_journal_that_is_nobodys_is_not_believed(watching: Watching) -> None:
    for _ in range(200):
        watching.say("vehicle", "mode", "mode AUTO", mode="AUTO")
        watching.say("vehicle", "position", lat_deg="52", lon_deg=[5])
        watching.say("vehicle", "position", lat_deg=91.0, lon_deg=5.0)
    assert watching.shown.aircraft == ()
    assert watching.scene.feed == watching.scene.feed.__class__(maxlen=FEED)


def test_what_came_before_it_was_clear_whose_it_is_counts(watching: Watching) -> None:
    watching.say("drone-1", "guard", "guard: silent -> expired")
    watching.position()
    assert watching.row["guard"] == "expired"
    assert watching.alarms == [("warning", "guard: silent -> expired")]


def test_an_aircrafts_word_counts_before_a_stations(watching: Watching) -> None:
    watching.say("drone-1", "station_heard", "GCSB is heard", station="GCSB")
    watching.view("GCSA")
    watching.position()
    watching.say("GCSB", "control_gained", "I have it.", role="commander", epoch=9)
    watching.say("GCSB", "telemetry", lat_deg=10.0, lon_deg=10.0, zone="GCSB")
    assert watching.row["commander"] == "GCSA"
    (mark,) = watching.shown.marks
    assert mark["at"] == [52.68, 5.92]
    watching.now += 30.0  # the aircraft's journal is not written any more
    watching.say("GCSB", "telemetry", lat_deg=10.0, lon_deg=10.0, zone="GCSB")
    (mark,) = watching.shown.marks
    assert mark["at"] == [10.0, 10.0]


def test_of_a_station_alone_an_aircraft_is_known(watching: Watching) -> None:
    watching.say("GCSA", "control_gained", "I have drone-1: GCSA is the commander now.", role="commander", epoch=2)
    for _ in range(40):
        watching.now += 2.0
        watching.say("GCSA", "telemetry", lat_deg=52.0, lon_deg=5.0, zone="GCSA")
    row = watching.row
    assert (row["name"], row["commander"], row["old"]) == ("aircraft of GCSA", "GCSA", "")
    watching.say("GCSA", "control_lost", "GCSB has it.", role="observer", epoch=3)
    assert watching.row["commander"] == "nobody"


def test_a_stations_aircraft_is_the_one_that_hears_it(watching: Watching) -> None:
    watching.say("GCSA", "connected", "vehicle 1 is connected.", role="observer", epoch=0)
    watching.say("drone-1", "station_heard", "GCSA is heard", station="GCSA")
    watching.position()
    watching.say("GCSA", "telemetry", lat_deg=52.0, lon_deg=5.0, zone="GCSA")
    assert [row["name"] for row in watching.shown.aircraft] == ["drone-1"]


def test_alarms_have_the_levels_of_the_stations_table(watching: Watching) -> None:
    watching.view("GCSA")
    for action in FlightAction:
        watching.say("drone-1", "decision", f"{action.name} it is", action=action.name.lower(), reason="energy")
        assert watching.alarms == [(DECISIONS[action].name.lower(), f"{action.name} it is")]
        assert watching.scene.feed[-1].level is DECISIONS[action]
    watching.say("drone-1", "decision", "ALL CLEAR. Over: energy", action="none", reason="energy")
    assert watching.alarms == []
    watching.view(None, phase="emergency", lease="lost")
    assert watching.alarms == [(EVENTS["no_commander"].name.lower(), "no station commands")]
    watching.view(None, lease="alone")  # in a gap that the mission declares
    assert watching.alarms == []


def test_in_a_rehearsal_nothing_is_an_emergency(watching: Watching) -> None:
    watching.view("GCSA", rehearsal=True)
    watching.say("drone-1", "decision", "REHEARSAL: would RETURN", action="return", reason="energy")
    assert watching.alarms == []
    assert watching.scene.feed[-1].level is EVENTS["decision_over"]


def test_a_question_stands_until_it_is_answered(watching: Watching) -> None:
    watching.say("GCSB", "asked", "Handover asked: GCSA -> GCSB", role="partner", epoch=2)
    assert watching.alarms == [("warning", "GCSB: Handover asked: GCSA -> GCSB")]
    watching.say("GCSB", "acknowledged", "Handover asked", level="warning")
    (alarm,) = watching.shown.alarms
    assert alarm["acknowledged"]
    watching.say("GCSB", "consent", "Handover Authorized.", role="partner", epoch=2)
    assert watching.alarms == []


def test_every_line_of_an_aircraft_has_a_line_of_a_station_that_is_as_grave() -> None:
    assert set(TOLD.values()) <= set(EVENTS)


def test_who_ends_in_order_is_no_alarm(watching: Watching) -> None:
    watching.view(None, phase="emergency", lease="lost")
    watching.say("drone-1", "unloaded")
    watching.now += 60.0
    assert watching.alarms == []
    assert watching.row["ended"]


def test_links_that_are_bad_are_counted(watching: Watching) -> None:
    watching.position()
    for device in ("udpin:1", "udpin:2"):
        watching.say("drone-1", "link", "loss", station="GCSA", link=device, change="degraded", measure="loss")
    watching.say("drone-1", "station_heard", "GCSA is heard", station="GCSA")
    watching.say("drone-1", "link", "loss", station="GCSA", link="udpin:2", change="restored", measure="loss")
    (link,) = watching.row["links"]
    assert (link["state"], link["words"]) == ("weak", "1 of 2 weak")
    watching.say("drone-1", "authority_lost", "GCSA is silent", station="GCSA")
    (link,) = watching.row["links"]
    assert link["words"] == "silent"
    watching.say("drone-1", "authority_lost", "GCSC is silent", station="GCSC")  # of its links nothing was ever said
    assert [link["state"] for link in watching.row["links"]] == ["lost", "lost"]


def test_everything_has_an_end(watching: Watching) -> None:
    watching.position()
    for number in range(10_000):
        watching.now += 0.1
        watching.position(52.0 + number * 1e-4, commander=f"S{number}", waypoint=number)
        watching.say("drone-1", "station_heard", "x" * 5000, station=f"S{number}")
        watching.say("drone-1", "link", "x", station="S1", link=f"udpin:{number}", change="degraded")
        watching.say(f"d{number}", "position", lat_deg=1.0, lon_deg=1.0)
        watching.say(f"g{number}", "asked", "?", role="partner", epoch=1, vehicle="drone-1")
    scene, craft = watching.scene, watching.scene.aircraft["drone-1"]
    assert (len(scene.aircraft), len(scene.stations), len(scene.feed)) == (MOST_AIRCRAFT, MOST_STATIONS, FEED)
    assert (len(craft.contacts), len(craft.track.places)) == (MOST_STATIONS, TRACK)
    assert max(len(each.links) for each in craft.contacts.values()) <= 8
    assert len(craft.stations_alarms) <= MOST_STATIONS
    assert max(len(line.text) for line in scene.feed) <= 400


def test_a_browser_is_given_of_a_track_what_it_has_not() -> None:
    track = Track()
    for number in range(TRACK + 10):
        track.add(50.0 + number * 1e-3, 5.0, "A")
        track.add(50.0 + number * 1e-3 + 1e-6, 5.0, "A")  # too near to count
    assert track.count == TRACK + 10
    assert len(list(track.since(0))) == TRACK
    assert [round(place[0], 3) for place in track.since(track.count - 2)] == [54.008, 54.009]
    assert list(track.since(track.count)) == []


def test_the_next_handover_is_counted_down_along_the_route(watching: Watching) -> None:
    mission = read(MISSIONS / "corridor")
    watching.view("GCSA")
    border = mission.crossings[0]
    seen = []
    for item, samples in mission.samples.items():
        for sample in samples:
            if sample.distance_along_m <= border.along_m:
                watching.now += 1.0
                here = {"lat_deg": sample.lat_deg, "lon_deg": sample.lon_deg}
                watching.say("drone-1", "position", commander="GCSA", waypoint=item, **here)
                watching.scene.aircraft["drone-1"].mission = mission.key
                (row,) = shown(watching.scene, {mission.key: mission}, watching.now).aircraft
                assert row["next"].startswith("GCSB in about ")
                seen.append(int(row["next"].split()[3]))
    assert seen == sorted(seen, reverse=True)
    assert seen[0] == round(border.along_m / 10.0)
    assert seen[-1] <= 1


def test_ages_in_words() -> None:
    assert [age(seconds) for seconds in (0.4, 99.4, 600.0, 7200.0, float("inf"))] == [
        "0 s",
        "99 s",
        "10 min",
        "2 h",
        "",
    ]


def test_levels_are_those_of_the_alarms() -> None:
    assert [level.name.lower() for level in Level] == ["info", "advisory", "warning", "emergency"]
