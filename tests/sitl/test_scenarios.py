# SPDX-License-Identifier: GPL-3.0-or-later

"""Scenario files: what is read, and that whatever nobody would read is refused with file and key."""

from __future__ import annotations

import pytest

from mavproxy_handover.mission import package as packages
from sitl.script.expect import Emergencies, OfVehicle
from sitl.script.places import mission_folder
from sitl.script.scenario import (
    ScenarioError,
    known_scenarios,
    load_scenario,
    panel_of,
    parse_scenario,
    program_of,
    with_opening,
)
from sitl.script.steps import Pause, Type, Wait

HEAD = """
name = "x"
description = "d"
mission = "delivery"
"""
STEP = """
[[step]]
wait_landed = true
"""
EXPECT = """
[[expect]]
emergencies = []
"""


def refusal(text: str) -> str:
    with pytest.raises(ScenarioError) as caught:
        parse_scenario(text, "x.toml")
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith("x.toml: ")
    return message


@pytest.mark.parametrize("name", sorted(known_scenarios()))
def test_every_scenario_that_ships_can_be_used(name: str) -> None:
    scenario = load_scenario(known_scenarios()[name])
    package = packages.load(mission_folder(scenario.mission))
    stations = {station.name for station in package.stations}
    assert scenario.name == name
    named = {process for step in with_opening(scenario, package).steps for process in step.deed.processes()}
    programs = {*map(program_of, scenario.served), *map(panel_of, scenario.panel)}
    programs |= {name for name, there in (("rogue", scenario.rogue), ("onboard", scenario.onboard)) if there}
    assert named <= stations | {"companion", *scenario.fleet, *programs}
    assert {
        *scenario.served,
        *scenario.panel,
        *scenario.require_operator,
        *scenario.standard,
        *scenario.links,
        *scenario.consent,
        *scenario.rogue,
    } <= stations


def test_the_four_scenarios_of_the_first_release_are_there() -> None:
    assert {"nominal", "authority", "out-of-coverage", "companion-killed"} <= set(known_scenarios())


#: what the issues of transfer and gate promise to fly
PROMISED = {
    *("partner-dead", "commander-dead-before", "commander-dead-during", "commander-dead-after", "ground-link-down"),
    *("operator-denies", "both-dead", "companion-restart", "lossy", "slow", "corridor", "standard-gcs"),
    *("rogue-station", "spoofed-sysid", "replay", "unsigned", "link-failover", "flood", "ground-forgery"),
    *(
        "latent-sticks",
        "slow-disk",
        "southern",
        "noisy-serial",
        "transfer-ranks",
        "hold-at-border",
        "hold-then-home",
        "held-restart",
        "hold-overruled",
    ),
    *("off-route", "planned-gap", "rally-choice", "rally-choice-guard", "battery-land"),
    *("gps-stale", "autopilot-link-cut", "guard-removed", "auth-attack", "fence"),
    *("rc-takeover", "companion-dies-while-returning", "battery-return", "low-battery-return", "commands-judged"),
    "return-as-flown",
    "dike-return",
    *("low-battery-far",),
    *("tcp-provider", "tcp-provider-drift", "rehearsal"),
    *("all-hear-little", "commander-hears-little"),
    *("refusal-texts", "two-vehicles", "linear", "field-test", "waypoints", "waypoints-restart"),
}


def test_the_scenarios_of_failures_and_attacks_are_there() -> None:
    assert set(known_scenarios()) >= PROMISED


def opened(text: str, mission: str = "delivery") -> list[str]:
    """The steps of a scenario's opening, in words."""
    scenario = parse_scenario(HEAD.replace("delivery", mission) + text + STEP + EXPECT, "x.toml")
    steps = with_opening(scenario, packages.load(mission_folder(mission))).steps
    assert steps[-1].number == 1
    assert all(step.title == "opening" for step in steps[:-1])
    return [step.deed.describe() for step in steps[:-1]]


def test_a_flight_begins_with_both_stations_the_mission_and_start() -> None:
    assert opened('begin = "start"\n') == [
        "connected, station GCSA (drone-1)",
        "connected, station GCSB (drone-1)",
        "authority, station GCSA (drone-1)",
        "the autopilot's position estimate",
        "GCSA types: handover share",
        "mission loaded (drone-1)",
        "zone entered, station GCSA (drone-1)",
        "package received (GCSB)",
        "GCSA types: handover start",
        "started (drone-1)",
    ]


def test_stations_of_the_standard_show_operator_control_unless_their_consent_is_configured() -> None:
    standard = 'begin = "start"\non_board = true\nstandard = ["GCSA", "GCSB"]\n'
    heard = [
        "station heard, station GCSA (drone-1)",
        "station heard, station GCSB (drone-1)",
        "authority, station GCSA (drone-1)",
        "the autopilot's position estimate",
        "mission loaded (drone-1)",
        "zone entered, station GCSA (drone-1)",
    ]
    start = ["GCSA types: start", "started (drone-1)"]
    shows = [
        "GCSA types: request",
        "control, station GCSA (drone-1)",
        "GCSB types: release",
        "control, station GCSB (drone-1)",
    ]
    assert opened(standard) == [*heard, *shows, *start]
    assert opened(standard + 'consent = {GCSA = "automatic"}\n') == [*heard, *shows[2:], *start]
    assert opened(standard + 'consent = {GCSA = "automatic", GCSB = "refuse"}\n') == [*heard, *start]


def test_all_four_stations_of_a_corridor_get_the_mission_before_start() -> None:
    steps = opened('begin = "loaded"\n', "corridor")
    assert [step for step in steps if step.startswith("package received")] == [
        "package received (GCSB)",
        "package received (GCSC)",
        "package received (GCSD)",
    ]
    assert not any("start" in step for step in steps)


def test_without_a_beginning_a_scenario_has_its_own_steps_only() -> None:
    assert opened("") == []


def test_a_step_is_read_with_what_stands_beside_it() -> None:
    step = """
[[step]]
type = {station = "GCSA", line = "handover start"}
label = "go"
say = "Now."
timeout_wall_s = 7
"""
    read = parse_scenario(HEAD + step + EXPECT, "x.toml").steps[0]
    assert read.deed == Type("GCSA", "handover start")
    assert (read.label, read.say, read.timeout_s, read.timeout_wall_s) == ("go", "Now.", None, 7.0)


def test_a_wait_takes_any_value_of_an_entry() -> None:
    step = '[[step]]\nwait = {who = "drone-1", event = "refused", station = "GCSB", answered = true}\n'
    deed = parse_scenario(HEAD + step + EXPECT, "x.toml").steps[0].deed
    assert isinstance(deed, Wait)
    assert (deed.who, deed.event, deed.since) == ("drone-1", "refused", "typed")
    assert dict(deed.match.values) == {"station": "GCSB", "answered": True}


def test_a_long_pause_has_time_to_end() -> None:
    read = parse_scenario(HEAD + "[[step]]\npause_s = 600\n" + EXPECT, "x.toml").steps[0]
    assert read.deed == Pause(600.0)
    assert read.timeout_s is not None
    assert read.timeout_s > 600.0


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("speed = 3\n" + STEP, ["speed:", "unknown key", "'speedup'"]),
        ('begin = "middle"\n' + STEP, ["begin:", "'middle'", "connected, loaded, start"]),
        ('guard_key = "mine"\n' + STEP, ["guard_key:", "'mine'", "same, other"]),
        ('[impair]\nlinks = ["sea"]\n' + STEP, ["[impair]", "'sea'", "air, ground"]),
        ('[impair]\nlinks = ["air"]\nlos = 0.2\n' + STEP, ["[impair]", "los:", "loss"]),
        ('[impair]\nlinks = ["air"]\nloss = 2\n' + STEP, ["[impair]", "loss = 2", "0 to 1"]),
        ('[serial]\nlines = ["GCSA"]\n' + STEP, ["serial:", "[[serial]]"]),
        ('[[serial]]\nlines = ["GCSA"]\nbaud = 300\n' + STEP, ["[serial 1]", "baud: 300", "1200 to 4000000"]),
        ('[[serial]]\nlines = ["GCSA"]\ndamage = 2\n' + STEP, ["[serial 1]", "damage = 2.0", "0 to 1"]),
        ('[[serial]]\nlines = ["GCSA", "GCSA"]\n' + STEP, ["serial:", "'GCSA'", "two lines"]),
        ('standard = ["GCSA"]\n[[serial]]\nlines = ["GCSA"]\n' + STEP, ["serial:", "'GCSA'", "standard"]),
        ("[links]\nGCSA = 2\n" + STEP, ["[links] GCSA:", "a list of texts"]),
        ('[[step]]\nimpair = "cut"\n', ["[step 1, impair]", "'cut'"]),
        ("[limit]\n" + STEP, ["limit:", "unknown key"]),
        ("speedup = 40\n" + STEP, ["speedup:", "40 must be 0.5 to 20"]),
        ('[consent]\nGCSA = "never"\n' + STEP, ["[consent] GCSA:", "automatic, operator"]),
        ('[not_in_control]\nGCSA = "no"\n' + STEP, ["[not_in_control] GCSA:", "auto, always, never"]),
        ("[limits]\nretry_max_s = true\n" + STEP, ["[limits] retry_max_s:", "a number"]),
        ("[places]\naway = {north = 3, east_m = 4}\n" + STEP, ["[places.away] north:", "north_m"]),
        ("[places]\naway = {north_m = 3}\n" + STEP, ["[places.away] east_m:", "missing"]),
        ('[[step]]\nwait_moed = "AUTO"\n', ["[step 1] wait_moed:", "'wait_mode'"]),
        ('[[step]]\nwait_mode = "AUTO"\npause_s = 2\n', ["[step 1]", "exactly one", "wait_mode and pause_s"]),
        ('[[step]]\nlabel = "a"\n', ["[step 1]", "exactly one", "it has none"]),
        ("[[step]]\nwait_mode = 3\n", ["[step 1, wait_mode] value:", "a text"]),
        ('[[step]]\ntype = {station = "GCSA"}\n', ["[step 1, type] line:", "missing"]),
        ('[[step]]\ntype = {station = "GCSA", line = "x", to = 1}\n', ["[step 1, type] to:", "unknown key"]),
        ('[[step]]\ntype = {station = "GCSA", line = "guided {far} 30"}\n', ["[step 1] type:", "'far'", "[places]"]),
        ('[[step]]\nwait = {event = "x", since = "ever"}\n', ["[step 1, wait]", "'ever'", "typed, last, begin"]),
        ("[[step]]\npause_s = 1\ntimeout_s = 9\ntimeout_wall_s = 9\n", ["[step 1] timeout_wall_s:", "timeout_s"]),
        ("[[step]]\npause_s = 1\ntimeout_s = 0\n", ["[step 1] timeout_s:", "above 0"]),
        ('[[step]]\npause_s = 1\nlabel = "Loud!"\n', ["[step 1] label:", "lower-case"]),
        ('[[step]]\npause_s = 1\nlabel = "a"\n[[step]]\npause_s = 1\nlabel = "a"\n', ["[step 2] label:", "twice"]),
        ("[step]\npause_s = 1\n", ["step:", "[[step]]"]),
        ('fleet = {drone-1 = "linear"}\n' + STEP, ["[fleet] drone-1:", "must be drone-2 to drone-9"]),
        ("fleet = {drone-2 = 3}\n" + STEP, ["[fleet] drone-2:", "a text"]),
        ('listen = ["GPS_RTMC_DATA"]\n' + STEP, ["listen:", "'GPS_RTMC_DATA' is no message"]),
        ('listen = ["TERRAIN_DATA"]\nserial = [{lines = ["autopilot"]}]\n' + STEP, ["listen:", "a serial one"]),
        ('rogue = ["GCSA"]\nfleet = {drone-2 = "linear"}\n' + STEP, ["fleet:", "does not go together with rogue"]),
        ('[[step]]\nwait_landed = true\nvehicle = "drone-2"\n', ["vehicle:", "'drone-2' is not in [fleet]"]),
        ("x = [\n", ["not valid TOML"]),
    ],
)
def test_what_nobody_would_read_is_refused_with_its_key(text: str, parts: list[str]) -> None:
    message = refusal(HEAD + text + EXPECT)
    for part in parts:
        assert part in message


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("handover = 4", ["[expect 1] handover:", "'handovers'"]),
        ("handovers = {commited = 4}", ["[expect 1, handovers] commited:", "'committed'"]),
        ("handovers = 4", ["[expect 1, handovers]", "committed"]),
        ('items_reached = "some"', ["[expect 1, items_reached]", "'some'", "'all'"]),
        ('count = {event = "x"}', ["[expect 1, count]", "count, at_least, at_most"]),
        ('commands = {what = "x", GCSA = 2}', ["[expect 1, commands]", "GCSA", "[accepted, refused]"]),
        ('landed = {within_m = 2, near = ["sea"]}', ["[expect 1, landed]", "'sea'"]),
        ('mode_within = {mode = "RTL", after = "x", within_s = 2}', ["[expect 1] after:", "'x'"]),
    ],
)
def test_an_expectation_that_cannot_be_judged_is_refused(text: str, parts: list[str]) -> None:
    message = refusal(HEAD + STEP + f"[[expect]]\n{text}\n")
    for part in parts:
        assert part in message


def test_an_expectation_may_be_about_a_further_vehicle() -> None:
    text = 'fleet = {drone-2 = "linear"}\n' + STEP + '[[expect]]\nvehicle = "drone-2"\nemergencies = []\n'
    read = parse_scenario(HEAD + text, "x.toml")
    assert read.fleet == {"drone-2": "linear"}
    assert read.expectations == (OfVehicle("drone-2", Emergencies(())),)
    message = refusal(HEAD + STEP + '[[expect]]\nvehicle = "drone-3"\nemergencies = []\n')
    assert "'drone-3' is not in [fleet]: there is none" in message


def test_a_scenario_that_expects_nothing_is_none() -> None:
    assert "at least one" in refusal(HEAD + STEP)


def test_the_name_is_that_of_the_file(tmp_path) -> None:  # type: ignore[no-untyped-def]
    path = tmp_path / "other.toml"
    path.write_text(HEAD + STEP + EXPECT, encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"other\.toml: name: 'x' must be the file's name, 'other'"):
        load_scenario(path)


# ---- the position box -----------------------------------------------------------------------------------------------

BOX = '[box]\nsource = "box"\napart_m = 40\n'
ORDER = '[[step]]\nbox = "drift 0 4"\n'


def test_a_position_box_is_configured_as_the_vehicle_has_it_but_for_its_address() -> None:
    scenario = parse_scenario(HEAD + BOX + ORDER + EXPECT, "x.toml")
    assert scenario.box == {"source": "box", "apart_m": 40}
    assert scenario.steps[0].deed.describe() == "position box: drift 0 4"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (HEAD + ORDER + EXPECT, "box: a step gives the position box an order, and there is none"),
        (HEAD + BOX.replace("apart_m", "apart") + ORDER + EXPECT, "box: apart: unknown key; did you mean 'apart_s'?"),
        (HEAD + BOX + 'layout = "x.toml"\n' + ORDER + EXPECT, "box: layout: 'x.toml' must be one of thesis, full"),
        (HEAD + BOX.replace("40", "4000") + ORDER + EXPECT, "box: apart_m: 4000 must be 2 to 1000"),
        (
            HEAD + BOX + 'box = "tcp:127.0.0.1:9"\n' + ORDER + EXPECT,
            "box: must say whose position counts, and not where",
        ),
        (HEAD + "[box]\n" + ORDER + EXPECT, "box: must say whose position counts"),
        (HEAD + BOX + ORDER.replace("drift", "drfit") + EXPECT, "'drfit 0 4' must be one of stall, resume, cut"),
        (HEAD + BOX + ORDER.replace("0 4", "4") + EXPECT, "drift takes 2 numbers"),
        (HEAD + BOX + ORDER.replace("drift 0 4", "restart 601") + EXPECT, "must be 0 to 600 s"),
        (HEAD + BOX + ORDER + EXPECT + '[fleet]\ndrone-2 = "linear"\n', "fleet: does not go together with box"),
    ],
)
def test_a_box_that_cannot_be_is_refused(text: str, says: str) -> None:
    assert says in refusal(text)


def test_the_low_battery_of_the_thesis_comes_on_the_path_of_the_delivery_after_waypoint_12() -> None:
    """Section 6.3: "a similar path as shown in Figure 6.1, [...] after way point 12, the drone returned"."""
    scenario = load_scenario(known_scenarios()["low-battery-return"])
    assert scenario.mission == "delivery"
    deeds = [step.deed.describe() for step in scenario.steps]
    assert deeds.index("mission item 12") + 1 == deeds.index("SIM_BATT_VOLTAGE is 10.3")
