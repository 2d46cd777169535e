# SPDX-License-Identifier: GPL-3.0-or-later

"""The layout of the position box in the companion: the thesis's by default; a wrong one refuses START in words."""

from __future__ import annotations

from pathlib import Path

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.mission.geodesy import offset
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.wire.box_layout import FULL, THESIS, BoxLayout
from tests.module.conftest import Bench
from tests.module.test_position_box import SOURCE, Box, box, real_rounds, sound, standing, told, where
from tests.module.vehicle import HOME

__all__ = ["box"]

KNOWN = {"thesis": THESIS, "full": FULL}
OTHER = {"thesis": "full", "full": "thesis"}


def words(configured: str) -> str:
    other = OTHER[configured]
    return f"position box sends layout '{other}', not '{configured}' (set layout = \"{other}\" in [position])"


def configured(name: str, more: str = SOURCE) -> str:
    """The thesis's is the default: nothing is written for it."""
    return f"# layout\n{more}" if name == "thesis" else f'layout = "{name}"\n{more}'


def moving(bench: Bench, box: Box, north_mps: float, east_mps: float) -> None:
    """The aircraft moves by both words."""
    bench.autopilot.velocity = (north_mps, east_mps)
    box.changed = {"north_mps": north_mps, "east_mps": east_mps, "alt_m": box.alt_m}


def flying(bench: Bench, mission: MissionPackage) -> None:
    bench.share(mission, at_once=True)
    bench.run(2.0)
    bench.a.command(mavlink.MAV_CMD_MISSION_START)
    bench.until(lambda: bench.companion.view.phase is Phase.ON_MISSION)


# ---- the right one --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", KNOWN)
def test_the_configured_layout_is_recognised_and_start_goes(
    bench: Bench, box: Box, delivery: MissionPackage, name: str
) -> None:
    box.sends = KNOWN[name]
    sound(bench, box, configured(name))
    assert bench.companion.config.position.layout is KNOWN[name]
    flying(bench, delivery)
    assert bench.companion.view.commander == 251
    assert told(bench) == []
    bench.mpstate.type("handover status")
    (line,) = [line for line in bench.mpstate.console.lines if "position  by the box" in line]
    assert "position box in order, 0.0 m from the autopilot's position" in line
    assert line.endswith(f"; layout {name}")


def test_the_place_of_the_thesiss_record_is_where_the_aircraft_is(bench: Bench, box: Box) -> None:
    box.sends = THESIS
    box.place = offset(*HOME, 5.0, 5.0)
    box.changed = {"north_mps": 0.3, "east_mps": 0.4}
    sound(bench, box, configured("thesis"))
    bench.run(1.0)
    assert where(bench) == pytest.approx(box.place, abs=1e-6)
    position = bench.companion.autopilot.aircraft.position.value
    assert (position.vx, position.vy, position.vz, position.hdg) == (30, 40, 0, 9000)


# ---- each mistaken for the other ------------------------------------------------------------------------------------


@pytest.mark.parametrize("source", ["box", "autopilot"])
@pytest.mark.parametrize("moves", [False, True], ids=["standing", "moving"])
@pytest.mark.parametrize("name", KNOWN)
def test_the_wrong_layout_refuses_start_in_words(
    bench: Bench, box: Box, delivery: MissionPackage, name: str, moves: bool, source: str
) -> None:
    box.sends = KNOWN[OTHER[name]]
    box.configure(configured(name, f'source = "{source}"'))
    if moves:
        moving(bench, box, 3.0, 4.0)
    bench.connect()
    bench.share(delivery)
    real_rounds(bench, lambda: standing(bench) == "other_layout")
    bench.run(6.0)
    assert words(name) in bench.needs()
    bench.a.command(mavlink.MAV_CMD_MISSION_START)
    bench.run(1.0)
    assert bench.companion.view.phase is Phase.ON_LOAD
    (refused,) = bench.journal("start_refused")
    assert words(name) in refused["text"]
    assert any(words(name) in text for _, text in bench.a.told())
    if source == "box":
        assert told(bench) == [f"{words(name)}: no position is used"]
        assert where(bench) is None
        assert "no position" in bench.needs()
    else:
        assert told(bench) == [words(name)]
        assert where(bench) == pytest.approx(HOME, abs=1e-6), "a box that only checks takes nothing away"
    assert bench.companion.config.position.layout is KNOWN[name], "it never changes by itself"


def test_records_that_break_the_stream_are_recognised_as_well(bench: Bench, box: Box, delivery: MissionPackage) -> None:
    """At 10 m/s the ground speed is no roll: no record is believed, and the reason is the layout."""
    box.sends = THESIS
    box.configure(configured("full"))
    moving(bench, box, 6.0, 8.0)
    bench.connect()
    real_rounds(bench, lambda: standing(bench) == "other_layout")
    assert words("full") in bench.needs()


def test_when_the_box_is_mended_on_the_ground_start_goes(bench: Bench, box: Box, delivery: MissionPackage) -> None:
    box.sends = FULL
    box.configure(configured("thesis"))
    bench.connect()
    bench.share(delivery)
    real_rounds(bench, lambda: standing(bench) == "other_layout")
    box.sends = THESIS
    real_rounds(bench, lambda: standing(bench) == "sound")
    bench.run(2.0)
    assert bench.needs() == ()


# ---- undecided ------------------------------------------------------------------------------------------------------

UNDECIDED = (
    "position box layout 'full' not recognised yet (the autopilot needs a position; or turn or move the aircraft)"
)


def pointing_north(bench: Bench, box: Box, mission: MissionPackage, source: str) -> None:
    """It stands and points to the north, and the autopilot has no position: its zeros fit every layout."""
    box.place, box.changed = HOME, {"heading_deg": 0.0}
    bench.autopilot.position = None
    box.configure(configured("full", f'source = "{source}"'))
    bench.connect()
    bench.share(mission, at_once=True)
    real_rounds(bench, lambda: standing(bench) == "unrecognised")
    bench.run(6.0)


def test_while_it_is_undecided_start_is_refused_where_the_box_is_the_source(
    bench: Bench, box: Box, delivery: MissionPackage
) -> None:
    pointing_north(bench, box, delivery, "box")
    assert UNDECIDED in bench.needs()
    assert where(bench) is None
    assert told(bench) == [f"{UNDECIDED}: no position is used"]
    bench.autopilot.position = HOME
    real_rounds(bench, lambda: standing(bench) == "sound")
    bench.run(2.0)
    assert bench.needs() == ()
    bench.autopilot.position = None
    bench.run(3.0)
    assert standing(bench) == "sound", "once recognised it stays so"


def test_while_it_is_undecided_a_box_that_only_checks_refuses_nothing(
    bench: Bench, box: Box, delivery: MissionPackage
) -> None:
    pointing_north(bench, box, delivery, "autopilot")
    assert bench.needs() == ("no position",), "the autopilot's own"
    assert told(bench) == [UNDECIDED]


# ---- in flight ------------------------------------------------------------------------------------------------------


def test_in_flight_another_layout_is_a_counted_warning_and_a_doubtful_position(
    bench: Bench, box: Box, delivery: MissionPackage
) -> None:
    box.sends = THESIS
    sound(bench, box, configured("thesis"))
    flying(bench, delivery)
    bench.run(6.0)
    box.sends = FULL
    real_rounds(bench, lambda: standing(bench) == "other_layout")
    bench.run(6.0)
    assert where(bench) is None
    assert told(bench)[-1].startswith(words("thesis"))
    assert told(bench)[-1].endswith(" records of another layout in flight): no position is used")
    assert [entry for entry in bench.journal("decision") if "position" in entry["text"]], "as any position that is old"
    bench.mpstate.type("handover status")
    (line,) = [line for line in bench.mpstate.console.lines if "position  by the box" in line][-1:]
    counted = int(line.partition("[position]) (")[2].partition(" records of another layout in flight")[0])
    assert counted > 60
    assert bench.companion.config.position.layout is THESIS
    box.sends = THESIS
    real_rounds(bench, lambda: standing(bench) == "sound")
    bench.run(1.0)
    assert where(bench) is not None


def test_in_flight_another_layout_of_a_box_that_only_checks_takes_nothing_away(
    bench: Bench, box: Box, delivery: MissionPackage
) -> None:
    box.sends = THESIS
    sound(bench, box, configured("thesis", 'source = "autopilot"'))
    flying(bench, delivery)
    bench.run(6.0)
    box.sends = FULL
    real_rounds(bench, lambda: standing(bench) == "other_layout")
    bench.run(6.0)
    assert where(bench) == pytest.approx(HOME, abs=1e-6)
    assert "counts" not in told(bench)[-1]


def test_a_restart_in_flight_does_not_wait_for_a_layout_that_is_undecided(bench: Bench, box: Box) -> None:
    box.silent = True
    box.configure(configured("full"))
    bench.connect()
    bench.autopilot.armed = True
    bench.run(3.0)
    assert where(bench) is None
    box.silent = False
    real_rounds(bench, lambda: where(bench) is not None)
    line = bench.module._box
    assert line.counters.records < 5, "the layout is not recognised by then"


# ---- heights --------------------------------------------------------------------------------------------------------


def test_without_a_height_above_sea_level_the_autopilots_is_told(bench: Bench, box: Box) -> None:
    """Pressure altitude is 63 m off, and the box was set to zero somewhere else."""
    box.sends = THESIS
    bench.autopilot.height_m = 30.0
    box.changed = {"alt_m": 30.0, "agl_m": 200.0}
    sound(bench, box, configured("thesis"))
    bench.run(1.0)
    assert bench.companion.autopilot.aircraft.where[2] == pytest.approx(30.0)
    (last,) = bench.a.got("HANDOVER_TELEMETRY")[-1:]
    own = bench.companion.autopilot.aircraft.telemetry.own_position.value
    assert (last.alt, last.relative_alt) == (own.alt, own.relative_alt)


def test_while_the_autopilot_has_no_position_its_height_goes_on_by_the_boxs_change(bench: Bench, box: Box) -> None:
    box.sends = THESIS
    box.place = HOME
    sound(bench, box, configured("thesis"))
    bench.autopilot.armed = True
    bench.run(1.0)
    bench.autopilot.height_m = 30.0
    box.changed = {"alt_m": 30.0}
    bench.run(1.0)
    bench.autopilot.position = None
    bench.run(1.0)
    box.changed = {"alt_m": 42.0}
    bench.run(2.0)
    assert where(bench) is not None
    assert bench.companion.autopilot.aircraft.where[2] == pytest.approx(42.0, abs=0.01)


def test_a_barometric_height_that_does_not_change_with_the_autopilots_is_a_disagreement(bench: Bench, box: Box) -> None:
    box.sends = THESIS
    sound(bench, box, configured("thesis"))
    bench.autopilot.armed = True
    bench.run(6.0)
    box.changed = {"baro_m": 63.0 + 29.0}
    bench.run(4.0)
    assert standing(bench) == "sound"
    box.changed = {"baro_m": 63.0 + 31.0}
    bench.run(4.0)
    assert standing(bench) == "apart"
    assert "31 m apart in height (limit 30 m): no position is used" in told(bench)[-1]


def test_warm_air_is_no_disagreement(bench: Bench, box: Box) -> None:
    """300 m up the pressure altitude has changed by 264 m: 12 % less."""
    box.sends = THESIS
    sound(bench, box, configured("thesis"))
    bench.autopilot.armed = True
    bench.run(1.0)
    bench.autopilot.height_m = 300.0
    box.changed = {"baro_m": 63.0 + 264.0}
    bench.run(3.0)
    assert standing(bench) == "sound"
    box.changed = {"baro_m": 63.0 + 233.0}
    bench.run(3.0)
    assert standing(bench) == "apart"


# ---- a layout of one's own ------------------------------------------------------------------------------------------


def test_a_box_with_a_layout_of_its_own_flies(bench: Bench, box: Box, delivery: MissionPackage, tmp_path: Path) -> None:
    own = BoxLayout("own", THESIS.fields, 60)
    text = "size = 60\n"
    for field in THESIS.fields:
        text += f'[[field]]\nfield = "{field.meaning}"\ntype = "{field.type}"\nunit = "{field.unit}"\n'
        text += f"offset = {field.offset}\n"
    (bench.config.parent / "own.toml").write_text(text)
    box.sends = own
    sound(bench, box, configured("own.toml"))
    flying(bench, delivery)
    assert bench.companion.config.position.layout.size == 60


def test_a_layouts_file_that_is_wrong_keeps_the_module_from_loading(bench: Bench, box: Box) -> None:
    (bench.config.parent / "own.toml").write_text("size = 60\n")
    box.configure(configured("own.toml"))
    assert bench.load() is None
    (said,) = [line for line in bench.mpstate.console.lines if "is not loaded" in line]
    assert 'own.toml: time is missing: add a [[field]] with field = "time"' in said
