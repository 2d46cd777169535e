# SPDX-License-Identifier: GPL-3.0-or-later

"""Energy in the companion: what the autopilot says becomes one fact, START is refused when the budget does not close.

The delivery takes 44.0 Wh against 3 m/s from ahead wherever it flies; with a tenth more and the reserve, a fifth of 126
Wh and a minute of hover, that is 77.2 Wh.
"""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as stock
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.core.safety.battery import Batteries
from mavproxy_handover.core.safety.learning import Learner
from mavproxy_handover.mission import package as mission_package
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.store.state_file import StateFile
from tests.module.conftest import Bench
from tests.module.test_restart import lose_power, restart
from tests.module.vehicle import AUTO, RTL
from tests.packages import ROUND

START, ARM = mavlink.MAV_CMD_MISSION_START, mavlink.MAV_CMD_COMPONENT_ARM_DISARM
REJECTED = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
TOO_LITTLE = "energy: 77.2 Wh are needed with the reserve, 75.6 Wh are left"
#: how whoever means it has it carried out
LIFTS = ". To insist, send it again after 10 s, or type 'handover override energy'"


@pytest.fixture
def bare(tmp_path: Path) -> MissionPackage:
    """The delivery without numbers of its own."""
    folder = tmp_path / "bare"
    shutil.copytree(ROUND, folder)
    text = (folder / "mission.toml").read_text(encoding="utf-8")
    (folder / "mission.toml").write_text(text[: text.index("[energy]")], encoding="utf-8")
    return mission_package.load(folder)


def get_ready(bench: Bench, package: MissionPackage, left: float | None = 1.0) -> None:
    """The parent commands, the mission is loaded, so much is left in the battery."""
    bench.autopilot.battery = left
    bench.connect()
    bench.share(package, at_once=True)
    bench.wait(1.5)


def refused(bench: Bench) -> str:
    """What the parent is told when it starts."""
    bench.a.command(START)
    bench.run(0.5)
    assert bench.a.acks(START) == [REJECTED]
    assert bench.autopilot.commands() == []
    return str(bench.a.texts())


def test_start_is_refused_when_the_budget_does_not_close(bench: Bench, delivery: MissionPackage) -> None:
    get_ready(bench, delivery, 0.6)
    assert refused(bench) == f"START refused: {TOO_LITTLE}{LIFTS}"
    (entry,) = bench.journal("start_refused")
    assert entry["text"] == f"START refused: {TOO_LITTLE}"


def test_with_enough_left_it_is_not(bench: Bench, delivery: MissionPackage) -> None:
    get_ready(bench, delivery, 0.64)
    assert bench.needs() == ()


def test_what_arms_by_hand_needs_the_energy_as_well(bench: Bench, delivery: MissionPackage) -> None:
    get_ready(bench, delivery, 0.6)
    bench.a.command(ARM, 1.0)
    bench.run(0.5)
    assert bench.a.texts() == f"arm refused: {TOO_LITTLE}{LIFTS}"
    assert ARM not in bench.autopilot.commands()


def test_the_answer_changes_with_the_battery(bench: Bench, delivery: MissionPackage) -> None:
    get_ready(bench, delivery, 0.6)
    assert bench.needs() == (TOO_LITTLE,)
    bench.autopilot.battery = 1.0
    bench.run(2.5)
    assert bench.needs() == ()


def test_a_battery_that_says_nothing_is_not_flown_with(bench: Bench, delivery: MissionPackage) -> None:
    get_ready(bench, delivery, None)
    unknown = "energy: 77.2 Wh are needed with the reserve, and what is left is not known"
    assert refused(bench) == f"START refused: {unknown}{LIFTS}"
    bench.wait(5.0)
    assert bench.mpstate.console.said("Energy: no battery is heard.")


def test_a_pack_that_counts_as_full_and_is_not_is_found_before_start(bench: Bench, delivery: MissionPackage) -> None:
    get_ready(bench, delivery)
    bench.autopilot.battery = None
    # 3.84 V a cell: half of it, and a tenth of doubt
    for _ in range(5):
        bench.mpstate.deliver(said(mavlink_battery(voltages=[11_520, *[65535] * 9])))
        bench.run(0.5)
    assert bench.needs() == (TOO_LITTLE,)
    entry = bench.journal("energy")[-1]
    assert entry["trouble"] == ["battery 0 counts 126.0 Wh, its rest voltage 11.52 V says 75.6 Wh at most"]


def test_a_mission_is_judged_the_moment_it_is_loaded(bench: Bench, delivery: MissionPackage) -> None:
    bench.autopilot.battery = 0.6
    bench.connect()
    bench.share(delivery)
    assert TOO_LITTLE in bench.needs()


def test_without_numbers_nothing_is_refused_and_the_budget_is_unknown(bench: Bench, bare: MissionPackage) -> None:
    get_ready(bench, bare, 0.01)
    assert bench.needs() == ()
    assert "energy    unknown: no [energy] numbers" in bench.mpstate.type("handover status")
    (entry,) = bench.journal("energy")
    assert entry["text"] == "unknown: no [energy] numbers"


def energy_table(bench: Bench, more: str) -> None:
    bench.config.write_text(bench.config.read_text() + f"[energy]\n{more}\n")


def test_the_vehicles_numbers_count_where_the_mission_has_none(bench: Bench, bare: MissionPackage) -> None:
    energy_table(bench, "battery_wh = 126\nhover_w = 354")
    get_ready(bench, bare, 0.5)
    (need,) = bench.needs()
    assert need.startswith("energy: ")
    assert need.endswith("63.0 Wh are left")


def test_the_missions_numbers_go_before_the_vehicles(bench: Bench, delivery: MissionPackage) -> None:
    energy_table(bench, "battery_wh = 9000\nhover_w = 20")
    get_ready(bench, delivery, 0.6)
    assert bench.needs() == (TOO_LITTLE,)


def test_start_may_be_told_to_warn_only(bench: Bench, delivery: MissionPackage) -> None:
    energy_table(bench, 'start = "warn"')
    get_ready(bench, delivery, 0.6)
    assert bench.needs() == ()
    (entry,) = bench.journal("energy_budget")
    assert (entry["text"], entry["closes"]) == (TOO_LITTLE, False)
    bench.autopilot.battery = 1.0
    bench.run(2.5)
    assert [e["closes"] for e in bench.journal("energy_budget")] == [False, True]


def test_who_starts_with_too_little_hears_it_where_it_is_let_pass(bench: Bench, delivery: MissionPackage) -> None:
    energy_table(bench, 'start = "warn"')
    get_ready(bench, delivery, 0.6)
    bench.a.command(START)
    bench.run(0.5)
    assert bench.a.texts().count(f"START, warning: energy: {TOO_LITTLE.removeprefix('energy: ')}") == 1
    assert bench.b.texts().count("warning: energy") == 0


@pytest.mark.parametrize(("before", "after"), [(None, 0.6), (0.62, 0.3)])
def test_who_starts_with_too_little_hears_what_is_left_now(
    bench: Bench, delivery: MissionPackage, before: float | None, after: float
) -> None:
    """The fault: what was said was what was known when the budget ceased to close."""
    energy_table(bench, 'start = "warn"')
    get_ready(bench, delivery, before)
    bench.autopilot.battery = after
    bench.wait(12.0)
    bench.a.command(START)
    bench.run(0.5)
    left = f"77.2 Wh are needed with the reserve, {126.0 * after:.1f} Wh are left"
    assert bench.a.texts().count("START, warning: ") == 1
    assert f"START, warning: energy: {left}" in bench.a.texts()
    assert [entry["closes"] for entry in bench.journal("energy_budget")] == [False], "told once"


def test_what_a_mission_is_refused_for_is_over_with_one_that_only_warns(
    bench: Bench, delivery: MissionPackage, tmp_path: Path
) -> None:
    get_ready(bench, delivery, 0.6)
    assert bench.needs() == (TOO_LITTLE,)
    folder = tmp_path / "warns"
    shutil.copytree(ROUND, folder)
    text = (folder / "mission.toml").read_text(encoding="utf-8").replace("[energy]", '[energy]\nstart = "warn"')
    (folder / "mission.toml").write_text(text, encoding="utf-8")
    bench.share(mission_package.load(folder))
    bench.run(1.5)
    assert bench.needs() == ()


@pytest.mark.parametrize("policy", ["refuse", "warn", "off"])
def test_how_a_refusal_is_lifted_is_said_and_does_not_hang_on_commands_in_flight(
    bench: Bench, delivery: MissionPackage, policy: str
) -> None:
    bench.config.write_text(bench.config.read_text() + f'[commands]\nenergy = "{policy}"\n')
    get_ready(bench, delivery, 0.6)
    assert refused(bench).endswith(LIFTS)
    bench.wait(10.5)
    bench.a.command(START)
    bench.until(lambda: bench.companion.view.phase is Phase.ON_MISSION)


def test_start_may_be_told_not_to_look(bench: Bench, delivery: MissionPackage) -> None:
    energy_table(bench, 'start = "off"')
    get_ready(bench, delivery, 0.6)
    assert bench.needs() == ()
    assert bench.journal("energy_budget") == []


# ---- in flight ----------------------------------------------------------------------------------------------------


def said(message: Any) -> Any:
    """A message of the autopilot as MAVProxy hands it over."""
    raw = message.pack(stock.MAVLink(None, srcSystem=1, srcComponent=1))
    return stock.MAVLink(None).decode(bytearray(raw))


def mavlink_battery(**changes: Any) -> Any:
    values: dict[str, Any] = {
        "id": 0,
        "battery_function": 0,
        "type": 0,
        "temperature": 32767,
        "voltages": [12_600, *[65535] * 9],
        "current_battery": 0,
        "current_consumed": 0,
        "energy_consumed": 0,
        "battery_remaining": 100,
    }
    return stock.MAVLink_battery_status_message(**{**values, **changes})


@pytest.fixture
def flying(bench: Bench, delivery: MissionPackage) -> Bench:
    get_ready(bench, delivery)
    bench.a.command(START)
    bench.until(lambda: bench.companion.view.phase is Phase.ON_MISSION)
    bench.autopilot.battery = None
    return bench


def hover(bench: Bench, seconds: int, wind: tuple[float, float] = (0.0, -180.0), amperes: float = 30.0) -> None:
    """So many seconds at rest in the air."""
    for _ in range(seconds):
        bench.mpstate.deliver(said(stock.MAVLink_attitude_message(1000, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)))
        bench.mpstate.deliver(said(stock.MAVLink_wind_message(wind[1], wind[0], 0.0)))
        bench.mpstate.deliver(
            said(mavlink_battery(current_battery=round(100 * amperes), current_consumed=80, energy_consumed=36))
        )
        bench.run(1.0)


def test_power_and_wind_are_learned_from_what_the_autopilot_says(flying: Bench) -> None:
    hover(flying, 40, wind=(6.0, 90.0))
    fact = flying.companion.autopilot.energy.fact
    assert fact.model is not None
    # 12.6 V and 30 A, seen recently: more than the 354 W that were configured
    assert fact.model.hover_w == pytest.approx(378.0)
    assert fact.power_w == pytest.approx(378.0)
    assert fact.left_wh == pytest.approx(125.0, abs=0.15), "what the last report said, and a second of power"
    assert (fact.wind_source, fact.learned) == ("autopilot", True)
    assert fact.model.wind is not None
    assert (fact.model.wind.speed_mps, fact.model.wind.from_deg) == pytest.approx((6.54, 90.0))
    (line,) = [line for line in flying.mpstate.type("handover status") if line.startswith("energy")]
    assert line.endswith(" Wh of 126.0 Wh left, 378 W, wind 6.5 m/s from 90 (autopilot), learned")


@pytest.fixture
def heavy(tmp_path: Path) -> MissionPackage:
    """The delivery with a quarter of its mass to be dropped by item 9, a gripper that opens behind waypoint 8."""
    folder = tmp_path / "heavy"
    shutil.copytree(ROUND, folder)
    with_payload = "[energy]\nmass_kg = 4.0\npayload_kg = 1.0\n"
    text = (folder / "mission.toml").read_text(encoding="utf-8").replace("[energy]", with_payload)
    (folder / "mission.toml").write_text(text, encoding="utf-8")
    plan = json.loads((folder / "delivery.plan").read_text(encoding="utf-8"))
    items = plan["mission"]["items"]
    items.insert(8, {**items[7], "command": 211, "frame": 2, "params": [1, 0, 0, 0, 0, 0, 0]})
    for number, item in enumerate(items, 1):
        item["doJumpId"] = number
    (folder / "delivery.plan").write_text(json.dumps(plan), encoding="utf-8")
    return mission_package.load(folder)


def test_behind_the_drop_it_flies_without_its_payload(bench: Bench, heavy: MissionPackage) -> None:
    get_ready(bench, heavy)

    def hover_w() -> float:
        bench.run(1.5)
        model = bench.companion.autopilot.energy.fact.model
        assert model is not None
        return float(model.hover_w)

    assert hover_w() == 354.0
    bench.a.command(START)
    bench.until(lambda: bench.companion.view.phase is Phase.ON_MISSION)
    for waypoint in (8, 9):
        bench.autopilot.waypoint = waypoint
        assert hover_w() == 354.0, "it is still there"
    bench.autopilot.mode = 4
    bench.autopilot.waypoint = 10
    assert hover_w() == 354.0, "in GUIDED the number of the item says nothing"
    bench.autopilot.mode = 3
    assert hover_w() == pytest.approx(354.0 * 0.75, rel=1e-3)
    bench.autopilot.mode = 6
    assert hover_w() == pytest.approx(354.0 * 0.75, rel=1e-3), "gone is gone"
    bench.autopilot.airborne = bench.autopilot.armed = False
    assert hover_w() == pytest.approx(354.0), "on the ground another one may be on board"


def test_wind_of_speed_zero_is_no_estimate(flying: Bench) -> None:
    hover(flying, 20)
    assert flying.companion.autopilot.energy.fact.wind_source == ""


def test_in_flight_the_journal_has_it_every_ten_seconds(flying: Bench) -> None:
    before = len(flying.journal("energy"))
    hover(flying, 25)
    entries = flying.journal("energy")[before:]
    assert 2 <= len(entries) <= 4
    assert entries[-1]["left_wh"] == pytest.approx(125.0, abs=0.15)
    assert entries[-1]["power_w"] == 378.0
    times = [entry["t"] for entry in entries]
    assert times == sorted(times)


def test_a_battery_that_falls_silent_in_flight_is_told_once(flying: Bench) -> None:
    hover(flying, 3)
    flying.wait(30.0)
    fact = flying.companion.autopilot.energy.fact
    # 378 W go on
    assert fact.left_wh == pytest.approx(125.0 - 378.0 * 31.0 / 3600.0, abs=0.3)
    told = [line for line in flying.mpstate.console.lines if "has been silent" in line]
    assert len(told) == 1
    assert flying.a.texts().count("has been silent") == flying.b.texts().count("has been silent") == 1


def test_what_is_left_of_what_is_odd_is_no_news(flying: Bench) -> None:
    hover(flying, 3)
    autopilot = flying.companion.autopilot
    for trouble in (("one",), ("one", "two"), ("two",), (), ("two",)):
        news = autopilot.energy._told.news(replace(autopilot.energy.fact, trouble=trouble), True, flying.clock.now)
        autopilot.messages._dispatcher.dispatch(news, flying.clock.now)
    flying.run(0.1)
    texts = flying.a.texts()
    assert (texts.count("energy: "), texts.endswith("energy: oneenergy: one, two")) == (2, True)


def told_of_energy(bench: Bench) -> list[str]:
    """What all stations were told of it, as the second one has it."""
    return [text for _severity, text in bench.b.told() if text.startswith("energy: ")]


def test_each_battery_that_falls_silent_is_told(bench: Bench, delivery: MissionPackage) -> None:
    """The fault: the texts were of one kind without their digits, and the second battery's silence was no news."""
    energy_table(bench, 'batteries = 2\nstart = "warn"')
    get_ready(bench, delivery, None)
    silent_from = {0: 10.0, 1: 30.0}

    def fly(seconds: int, since: float = 0.0) -> None:
        for second in range(seconds):
            for number, silent in silent_from.items():
                if since + second < silent:
                    bench.mpstate.deliver(said(mavlink_battery(id=number, current_battery=1500)))
            bench.run(1.0)

    fly(3)
    bench.a.command(START)
    bench.until(lambda: bench.companion.view.phase is Phase.ON_MISSION)
    fly(20)
    (first,) = told_of_energy(bench)
    assert first.startswith("energy: battery 0 has been silent for ")
    fly(40, 20.0)
    first, second = told_of_energy(bench)
    assert "battery 1 has been silent for " in second


def test_a_battery_that_speaks_seldom_is_told_once_a_flight(flying: Bench) -> None:
    """The fault: one that speaks every 8 s was told 75 times in 10 min."""
    hover(flying, 3)
    for _ in range(15):
        hover(flying, 1)
        flying.wait(7.0)
    assert len(told_of_energy(flying)) == 1
    assert len([line for line in flying.mpstate.console.lines if "Energy: battery 0 " in line]) == 1
    odd = [entry for entry in flying.journal("energy") if entry.get("trouble")]
    assert len(odd) >= 15, "the journal has all of it"


def test_one_that_counts_back_again_and_again_is_told_once_a_flight(flying: Bench) -> None:
    """The fault: 149 times in 10 min."""
    for second in range(60):
        used = 60 if second % 4 == 0 else 80
        flying.mpstate.deliver(said(mavlink_battery(current_consumed=used, energy_consumed=-1, battery_remaining=-1)))
        flying.run(1.0)
    assert told_of_energy(flying) == ["energy: battery 0 counts back in flight"]


def test_the_next_flight_is_told_anew(flying: Bench) -> None:
    hover(flying, 3)
    flying.wait(8.0)
    assert len(told_of_energy(flying)) == 1
    flying.autopilot.airborne = flying.autopilot.armed = False
    flying.autopilot.battery = 1.0
    flying.until(lambda: flying.companion.view.phase is Phase.ON_LOAD)
    flying.wait(5.0)
    flying.a.command(START)
    flying.until(lambda: flying.companion.view.phase is Phase.ON_MISSION)
    flying.autopilot.battery = None
    flying.wait(10.0)
    assert len(told_of_energy(flying)) == 2


def test_one_that_never_said_what_it_draws_draws_what_flying_takes(flying: Bench) -> None:
    """The fault: a monitor of percentages alone fell silent, and nothing was drawn any more."""
    unknown = {"current_battery": -1, "current_consumed": -1, "energy_consumed": -1}
    for _ in range(3):
        flying.mpstate.deliver(said(mavlink_battery(**unknown)))
        flying.run(1.0)
    flying.wait(30.0)
    fact = flying.companion.autopilot.energy.fact
    # 385 W in cruise, more than in hover
    assert fact.left_wh == pytest.approx(126.0 - 385.0 * 31.0 / 3600.0, abs=0.15)


@pytest.mark.parametrize(
    "changes",
    [
        {"voltages": [65535] * 10, "current_battery": -1, "current_consumed": -1, "energy_consumed": -1},
        {"current_consumed": 2**31 - 1, "energy_consumed": 2**31 - 1},
        {"current_consumed": -(2**31), "energy_consumed": -(2**31), "current_battery": -(2**15)},
        {"battery_remaining": -1},
        {"battery_remaining": -128},
        {"battery_remaining": 127},
        {"id": 255},
        {"voltages": [65534] * 10},
        {"voltages": [0] * 10},
    ],
)
def test_no_report_of_a_battery_breaks_anything(flying: Bench, changes: dict[str, Any]) -> None:
    hover(flying, 3)
    for _ in range(3):
        flying.mpstate.deliver(said(mavlink_battery(**changes)))
        flying.run(1.0)
    assert flying.companion.faults == {}
    assert flying.companion.autopilot.energy.fact.left_wh is not None


# ---- a restart in flight ------------------------------------------------------------------------------------------


def rest(bench: Bench, delivery: MissionPackage, volts: float) -> None:
    """Ready for START, and off. The pack counts as full; its voltage says what it holds."""
    bench.autopilot.battery = None
    bench.connect()
    bench.share(delivery, at_once=True)
    for _ in range(5):
        bench.mpstate.deliver(said(mavlink_battery(voltages=[round(volts * 1000), *[65535] * 9])))
        bench.run(0.5)
    bench.a.command(START)
    bench.until(lambda: bench.companion.view.phase is Phase.ON_MISSION)


def drain(bench: Bench, seconds: int, part: float) -> float:
    """So many seconds at 30 A and 11.3 V, this part of it drawn by then. Returns what is left (Wh)."""
    used_mah = round(10_000 * part)
    counted = {"current_consumed": used_mah, "energy_consumed": round(used_mah * 12.6 * 0.036)}
    load = {"voltages": [11_300, *[65535] * 9], "current_battery": 3000, "battery_remaining": round(100 * (1 - part))}
    for _ in range(seconds):
        bench.mpstate.deliver(said(mavlink_battery(**counted, **load)))
        bench.run(1.0)
    left = bench.companion.autopilot.energy.fact.left_wh
    assert left is not None
    return left


@pytest.mark.parametrize("how", ["none", "killed", "killed at once again", "power lost"])
def test_what_the_rest_voltage_said_is_known_behind_a_restart(
    bench: Bench, delivery: MissionPackage, how: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The fault: 3.84 V a cell at rest are 75.6 Wh at most, and behind a restart 122.2 Wh were believed in."""
    energy_table(bench, "reserve_wh = 5\nreserve_factor = 1.0")
    rest(bench, delivery, 11.52)
    assert drain(bench, 3, 0.02) == pytest.approx(73.1, abs=0.3)
    if how == "killed":
        restart(bench)
    elif how == "killed at once again":
        restart(bench)
        restart(bench)
    elif how == "power lost":
        lose_power(bench, monkeypatch)
        bench.load()
    # its first report is here before the heartbeat that says that it flies
    assert drain(bench, 4, 0.03) == pytest.approx(71.8, abs=0.3)
    assert bench.companion.faults == {}


def test_who_returns_for_its_energy_goes_on_behind_a_restart(bench: Bench, delivery: MissionPackage) -> None:
    """The fault: 59.2 Wh after 34.0 Wh, and everybody was told that the emergency was over."""
    rest(bench, delivery, 11.85)
    part = 0.0
    while bench.autopilot.mode == AUTO:
        part += 0.01
        left = drain(bench, 3, part)
    assert bench.autopilot.mode == RTL
    before = len(bench.journal("decision"))
    restart(bench)
    assert drain(bench, 8, part) == pytest.approx(left, abs=0.3)
    assert bench.companion.view.phase is Phase.EMERGENCY
    told = [entry["text"].split(".")[0] for entry in bench.journal("decision")[before:]]
    assert told == ["RETURN", "RETURN to home"], "its place is looked at anew"


def test_it_is_written_when_a_twentieth_is_drawn_and_not_with_every_report(
    bench: Bench, delivery: MissionPackage, monkeypatch: pytest.MonkeyPatch
) -> None:
    rest(bench, delivery, 12.6)
    drain(bench, 3, 0.0)
    assert bench.companion.wait_until_written(10.0), "of what happened before"
    written: list[Any] = []
    monkeypatch.setattr(StateFile, "save", lambda self, *what: written.append(what))
    for hundredth in range(1, 21):
        drain(bench, 3, hundredth / 100.0)
        assert bench.companion.wait_until_written(10.0)
    assert 3 <= len(written) <= 5


# ---- faults -------------------------------------------------------------------------------------------------------


def broken(*_arguments: Any, **_values: Any) -> Any:
    raise RuntimeError("planted")


def test_what_breaks_in_here_keeps_start_and_is_over_with_the_fault(
    bench: Bench, delivery: MissionPackage, monkeypatch: pytest.MonkeyPatch
) -> None:
    get_ready(bench, delivery)

    with monkeypatch.context() as patch:
        patch.setattr(Learner, "model", broken)
        bench.run(1.5)
        assert bench.needs() == ("energy: internal fault",)
        (line,) = [line for line in bench.mpstate.type("handover status") if line.startswith("energy")]
        assert line.startswith("energy    126.0 Wh of 126.0 Wh left")
        assert line.endswith(", internal fault"), "what was known goes on"
        assert bench.companion.faults["energy"] >= 1
        assert not bench.companion.failed, "it costs no authority"
    bench.run(1.5)
    assert bench.needs() == ()


@pytest.mark.parametrize("policy", ["warn", "refuse"])
def test_a_fault_of_before_take_off_silences_no_decision_in_flight(
    bench: Bench, delivery: MissionPackage, monkeypatch: pytest.MonkeyPatch, policy: str
) -> None:
    """The fault: what was known was thrown away on the ground, and with 5 % left the aircraft stayed in AUTO."""
    energy_table(bench, f'start = "{policy}"')
    get_ready(bench, delivery)
    with monkeypatch.context() as patch:
        patch.setattr(Learner, "model", broken)
        bench.wait(3.0)
        if policy == "refuse":
            assert refused(bench).endswith(
                "START refused: energy: internal fault. To lift it, type 'handover override energy'"
            )
            for _ in range(2):
                bench.wait(12.0)
                bench.a.command(START)
            bench.run(0.5)
            assert bench.a.acks(START) == [REJECTED] * 3, "sent again it mends nothing"
            bench.mpstate.type("handover override energy")
            bench.run(2.0)
        bench.a.command(START)
        bench.until(lambda: bench.companion.view.phase is Phase.ON_MISSION)
        assert bench.a.texts().count("START, warning: energy: internal fault") == (policy == "warn")
        bench.wait(5.0)
        assert bench.autopilot.mode == AUTO
        bench.autopilot.battery = 0.05
        bench.until(lambda: bool(bench.autopilot.mode == RTL), 20.0)
    assert bench.companion.autopilot.energy.fact.left_wh == pytest.approx(6.3, abs=0.5)


def test_what_was_known_on_the_ground_is_drawn_down_once_it_is_armed(
    bench: Bench, delivery: MissionPackage, monkeypatch: pytest.MonkeyPatch
) -> None:
    energy_table(bench, 'start = "warn"')
    get_ready(bench, delivery)
    with monkeypatch.context() as patch:
        patch.setattr(Batteries, "charge", broken)
        bench.wait(10.0)
        assert bench.companion.autopilot.energy.fact.left_wh == 126.0
        bench.a.command(START)
        bench.until(lambda: bench.companion.view.phase is Phase.ON_MISSION)
        bench.wait(60.0)
        # 385 W in cruise, more than in hover
        assert bench.companion.autopilot.energy.fact.left_wh == pytest.approx(126.0 - 385.0 * 60.0 / 3600.0, abs=1.0)


def test_a_battery_that_speaks_while_something_is_broken_counts(
    bench: Bench, delivery: MissionPackage, monkeypatch: pytest.MonkeyPatch
) -> None:
    get_ready(bench, delivery, None)
    with monkeypatch.context() as patch:
        patch.setattr(Learner, "model", broken)
        bench.run(1.5)
        assert bench.companion.autopilot.energy.fact.left_wh is None
        bench.autopilot.battery = 0.6
        bench.run(2.5)
        assert bench.companion.autopilot.energy.fact.left_wh == pytest.approx(75.6)


def test_what_was_known_by_other_numbers_does_not_go_on(
    bench: Bench, delivery: MissionPackage, monkeypatch: pytest.MonkeyPatch
) -> None:
    energy_table(bench, "battery_wh = 9000\nhover_w = 20")
    bench.connect()
    with monkeypatch.context() as patch:
        patch.setattr(Learner, "model", broken)
        bench.share(delivery)
        bench.run(1.5)
        assert bench.companion.autopilot.energy.fact.words() == "unknown: internal fault"
        assert bench.needs() == ("energy: internal fault",)


def test_a_fault_costs_nothing_where_nobody_asks_for_the_energy(
    bench: Bench, bare: MissionPackage, monkeypatch: pytest.MonkeyPatch
) -> None:
    get_ready(bench, bare)

    monkeypatch.setattr("mavproxy_handover.monitors.energy.EnergyFact", broken)
    monkeypatch.setattr("mavproxy_handover.monitors.energy.pack_report", broken)
    bench.run(0.5)
    assert bench.needs() == ()


def test_a_message_that_breaks_something_costs_that_message(flying: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    hover(flying, 3)
    heard = len(flying.a.got("BATTERY_STATUS"))

    with monkeypatch.context() as patch:
        patch.setattr("mavproxy_handover.monitors.energy.pack_report", broken)
        hover(flying, 1)
    assert flying.companion.faults["energy"] == 1
    assert len(flying.a.got("BATTERY_STATUS")) == heard + 1, "the commander gets it all the same"
    hover(flying, 2)
    assert flying.companion.autopilot.energy.fact.left_wh == pytest.approx(125.0, abs=0.15)


def test_after_a_restart_in_flight_the_missions_numbers_are_there_again(flying: Bench) -> None:
    hover(flying, 3)
    flying.mpstate.unload("handover")
    flying.load()
    hover(flying, 3)
    fact = flying.companion.autopilot.energy.fact
    assert fact.model is not None
    assert fact.model.battery_wh == 126.0
    assert fact.left_wh == pytest.approx(125.0, abs=0.15), "what the last report said, and a second of power"


def test_in_flight_with_no_more_than_the_way_back_needs_it_turns_back(bench: Bench, delivery: MissionPackage) -> None:
    """The fault: with the battery at 0 % the mission went on, and authority was handed over without a word."""
    get_ready(bench, delivery)
    bench.a.command(START)
    bench.until(lambda: bench.companion.view.phase is Phase.ON_MISSION)
    bench.wait(5.0)
    assert bench.journal("emergency") == []
    bench.autopilot.battery = 0.2  # the reserve alone is a quarter
    bench.until(lambda: bool(bench.journal("emergency")), 15.0)
    (entry,) = bench.journal("emergency")
    assert entry["text"] == "energy only for the way back: return"
    bench.run(2.0)
    assert bench.autopilot.mode == 6
    bench.autopilot.battery = 1.0  # it does not turn round again
    bench.wait(10.0)
    assert len(bench.journal("emergency")) == 1
    assert bench.journal("emergency_over") == []
