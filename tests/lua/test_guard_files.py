# SPDX-License-Identifier: GPL-3.0-or-later

"""What is shipped for the flight controller loads there: the script's form, its page, its parameter file."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from sitl.vehicles.lua_bindings import VM_INSTRUCTION_LIMIT
from tests.lua.numbers import COPTER_NUMBERS, PLANE_NUMBERS, Numbers
from tests.lua.stub import GUARD, Bench, stated
from tests.lua.test_guard_tag import keyed_bench

PAGE = GUARD.with_suffix(".md")
PARAMETER_FILE, PLANE_FILE = GUARD.with_name("handover.parm"), GUARD.with_name("handover_plane.parm")

LUACHECK = GUARD.with_name(".luacheckrc")


@pytest.fixture(scope="module")
def source() -> str:
    return GUARD.read_text(encoding="utf-8")


def test_main_function_keeps_to_100_locals(source: str) -> None:
    """ArduPilot's Lua refuses more; the usual Lua allows 200 and would not notice."""
    assert 50 < _locals(source) <= 80


def _locals(source: str) -> int:
    count = 0
    for line in source.splitlines():
        if line.startswith("local function "):
            count += 1
        elif line.startswith("local "):
            count += line.split("=", 1)[0].count(",") + 1
    return count


def test_no_global_is_written_and_only_known_bindings_are_read() -> None:
    luacheck = shutil.which("luacheck")
    if luacheck is None:
        pytest.skip("luacheck is not installed (Debian: lua-check)")
    result = subprocess.run(
        [luacheck, "--config", str(LUACHECK), "--no-color", "--no-cache", str(GUARD)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stdout


def ardupilot() -> Path:
    """ArduPilot's source, for what is checked against it."""
    for folder in (os.environ.get("ARDUPILOT"), Path.home() / "ardupilot"):
        if folder and (Path(folder) / "libraries" / "AP_Scripting").is_dir():
            return Path(folder)
    pytest.skip("no ArduPilot source: set $ARDUPILOT")


def test_ardupilots_own_luacheck_rules_are_kept() -> None:
    """Its configuration knows every binding of its own documentation: a misspelt one is found there, too."""
    luacheck, source = shutil.which("luacheck"), ardupilot()
    if luacheck is None:
        pytest.skip("luacheck is not installed (Debian: lua-check)")
    rules = ["--config", "libraries/AP_Scripting/tests/luacheck.lua", "--no-color", "--no-cache"]
    result = subprocess.run(
        [luacheck, str(GUARD.resolve()), *rules], cwd=source, capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stdout + result.stderr


def test_table_key_is_used_by_no_script_of_ardupilot(source: str) -> None:
    key = re.search(r"^local PARAM_TABLE_KEY = (\d+)$", source, re.MULTILINE)
    assert key is not None
    use = re.compile(rf"\b(?:\w*TABLE_KEY\w*\s*=|add_table\s*\()\s*{key[1]}\b")
    folder = ardupilot() / "libraries" / "AP_Scripting"
    scripts = [path for path in folder.rglob("*.lua") if path.name != GUARD.name]
    texts = {path: path.read_text(encoding="utf-8", errors="replace") for path in scripts}
    assert sum("TABLE_KEY" in text for text in texts.values()) > 30
    assert [path.name for path, text in texts.items() if use.search(text)] == []


@pytest.mark.parametrize(
    ("vehicle", "numbers"), [("ArduCopter", COPTER_NUMBERS), ("ArduPlane", PLANE_NUMBERS)], ids=["Copter", "Plane"]
)
def test_modes_and_reasons_are_those_of_ardupilot(vehicle: str, numbers: Numbers) -> None:
    """The numbers that the script is held against (`test_guard_product`), compared with the names in the headers."""
    folder = ardupilot()
    reasons = dict(_enumerators(folder / "libraries" / "AP_Vehicle" / "ModeReason.h"))
    modes = dict(_enumerators(folder / vehicle / "mode.h"))
    for named in (numbers.pilots, numbers.failsafes, numbers.commands, numbers.sequences, numbers.resumed):
        assert {name: reasons[name] for name in named} == named
    for named in (numbers.returns, numbers.landings, numbers.by_hand):
        assert {name: modes[name] for name in named} == named
    assert modes["AUTO"] == numbers.auto


def _enumerators(header: Path) -> list[tuple[str, int]]:
    found = re.findall(r"^ +([A-Z][A-Z0-9_]+) *= *(\d+),", header.read_text(encoding="utf-8"), re.MULTILINE)
    return [(name, int(number)) for name, number in reversed(found)]  # of two with a name the first one counts


def test_parameters_are_documented_in_script_and_page(source: str) -> None:
    added = re.findall(r'bind_add_param\("(\w+)", (\d+), ([-\d.]+)\)', source)
    assert [int(index) for _, index, _ in added] == [1, 2, 3, 4, 5, 6, 7, 8]
    page = PAGE.read_text(encoding="utf-8")
    for name, _, default in added:
        full = f"HNDO_{name}"
        assert len(full) <= 16
        assert f"// @Param: {full}\n" in source
        assert re.search(rf"^## {full}$", page, re.MULTILINE)
        assert re.search(rf"^\| {full} +\| +{re.escape(default)} +\|", page, re.MULTILINE)
        assert Bench().vehicle.parameters[full] == float(default)


def test_ranges_are_the_same_in_code_description_and_page(source: str) -> None:
    """A value outside its range is taken for the nearest one inside."""
    page = PAGE.read_text(encoding="utf-8")
    taken = dict(re.findall(r"clamped\(HNDO\.(\w+), (-?\d+, \d+)\)", source))
    assert set(taken) == {"ENABLE", "TIMEOUT", "LOST_T", "CHAN", "COMPID", "SYSID_SW", "ALONE_MAX"}
    for name, bounds in taken.items():
        low, high = bounds.split(", ")
        described = re.search(rf"@Param: HNDO_{name}\n(?:.*\n)*?  // @(?:Range: (.*)|Values: (.*))\n", source)
        assert described is not None
        if described[1]:
            assert described[1] == f"{low} {high}"
        else:
            assert re.findall(r"(\d+):", described[2]) == [low, high]
        row = re.search(rf"^\| HNDO_{name} \| [-\d]+ \| (.*?) \|", page, re.MULTILINE)
        assert row is not None
        assert re.findall(r"-?\d+", row[1]) == [low, high]


def test_every_text_is_on_the_page(source: str) -> None:
    """The constant parts of what the guard says, and of why it refuses arming."""
    page = PAGE.read_text(encoding="utf-8")
    said = re.findall(r'say\([^"]*"[\w ]+", [\w.]+, (?:string\.format\()?"([^"]{6,})"', source)
    said += re.findall(r'^        return "([^"]{8,})"$', source, re.MULTILINE)
    said += re.findall(r'why_not = "([^"]+)"', source) + re.findall(r'why="([^"]+)"', source)
    assert len(said) > 20
    texts = {re.split(r"%\w", text)[0].strip() for text in said}
    assert [text for text in sorted(texts) if text.split(", ")[-1] not in page] == []


def test_the_page_has_the_states_of_the_log(source: str) -> None:
    numbers = re.search(r"^local ENFORCEMENT = {(.*?)}", source, re.MULTILINE)
    assert numbers is not None
    page = PAGE.read_text(encoding="utf-8")
    for name, number in re.findall(r"(\w+)=(\d+)", numbers[1]):
        assert f"\n| {number} | {name} | " in page


def lines_of(path: Path) -> list[str]:
    return path.read_text(encoding="ascii").splitlines()


def values_of(path: Path) -> dict[str, float]:
    return {name: float(value) for name, value in (line.split() for line in lines_of(path) if line and line[0] != "#")}


@pytest.mark.parametrize("path", [PARAMETER_FILE, PLANE_FILE], ids=["Copter", "Plane"])
class TestParameterFiles:
    def test_ardupilot_reads_99_bytes_a_line_and_comments_only_in_column_one(self, path: Path) -> None:
        """The rest of a longer line would be read as a line of its own; '#' behind a value is no comment everywhere."""
        for line in lines_of(path):
            assert len(line) < 97
            assert "#" not in line[1:] or line.startswith("#")
            assert not line.startswith((" ", "\t"))

    def test_every_line_is_name_and_value(self, path: Path) -> None:
        values = [line.split() for line in lines_of(path) if line and not line.startswith("#")]
        assert values
        for name, value in values:
            assert re.fullmatch(r"[A-Z][A-Z0-9_]{1,15}", name)
            float(value)
        names = [name for name, _ in values]
        assert len(names) == len(set(names))

    def test_every_value_has_its_reason(self, path: Path) -> None:
        previous = ""
        for line in lines_of(path):
            if line and not line.startswith("#"):
                assert previous.startswith("# "), line
            previous = line

    def test_mavproxy_loads_it(self, path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        from pymavlink.mavparm import MAVParmDict

        parameters = MAVParmDict()
        assert parameters.load(str(path))
        assert "Invalid" not in capsys.readouterr().out
        assert parameters["RALLY_LIMIT_KM"] == 0.0

    def test_the_autopilots_own_watch_is_slower_than_the_guard(self, path: Path, source: str) -> None:
        values = values_of(path)
        lease_timeout = float(re.search(r'bind_add_param\("TIMEOUT", 2, (\d+)\)', source)[1])  # type: ignore[index]
        assert values["FS_GCS_TIMEOUT" if path == PARAMETER_FILE else "FS_LONG_TIMEOUT"] > lease_timeout

    def test_it_lets_the_guard_work(self, path: Path) -> None:
        values = values_of(path)
        assert values["SCR_VM_I_COUNT"] == VM_INSTRUCTION_LIMIT
        assert 1000 * stated("script memory while it is loaded")[0] <= values["SCR_HEAP_SIZE"] <= 204_800
        for name in ("SCR_ENABLE", "RALLY_LIMIT_KM", "RALLY_INCL_HOME", "ARMING_CHECK", "ARMING_SKIPCHK"):
            assert values[name] == values_of(PARAMETER_FILE)[name]

    @pytest.mark.parametrize("name", ["SCR_DEBUG_OPTS", "RADIO_FAILSAFE"])
    def test_what_it_leaves_to_its_reader_is_named_with_the_reason(self, path: Path, name: str) -> None:
        numbers = COPTER_NUMBERS if path == PARAMETER_FILE else PLANE_NUMBERS
        name = name.replace("RADIO_FAILSAFE", numbers.radio_failsafe)
        assert any(line.startswith(f"#   {name} ") for line in lines_of(path))


class TestCopterFile:
    def test_it_goes_on_in_no_mode_without_a_station(self) -> None:
        assert int(values_of(PARAMETER_FILE)["FS_OPTIONS"]) & 0b10010 == 0

    def test_no_station_orders_a_mode_with_manual_throttle(self) -> None:
        """In ArduPilot's list of modes that can be blocked, by the names of its header."""
        values = values_of(PARAMETER_FILE)
        source = (ardupilot() / "ArduCopter" / "mode.cpp").read_text(encoding="utf-8")
        listed = re.search(r"bool Copter::gcs_mode_enabled.*?mode_list \[\] {(.*?)}", source, re.DOTALL)
        assert listed is not None
        order = re.findall(r"Mode::Number::(\w+)", listed[1])
        blocked = [name for bit, name in enumerate(order) if int(values["FLTMODE_GCSBLOCK"]) >> bit & 1]
        assert blocked == ["STABILIZE", "ACRO", "SYSTEMID", "TURTLE"]


class TestPlaneFile:
    def test_a_return_comes_from_every_failsafe_and_ends_on_the_ground(self) -> None:
        """FS_LONG_ACTN 0 would fly on in AUTO, RTL_AUTOLAND and Q_RTL_MODE 0 circle, Q_OPTIONS 0 land anywhere."""
        values = values_of(PLANE_FILE)
        assert (values["FS_GCS_ENABL"], values["FS_LONG_ACTN"], values["FS_SHORT_ACTN"]) == (1, 1, 0)
        assert (values["RTL_AUTOLAND"], values["Q_RTL_MODE"], int(values["Q_OPTIONS"]) & 1 << 5) == (1, 1, 32)
        assert values["ARMING_REQUIRE"] >= 1

    def test_a_quadplane_takes_off_and_lands_by_its_rotors(self) -> None:
        """By bits 1 and 2 of Q_OPTIONS NAV_TAKEOFF and NAV_LAND are those of a plane."""
        assert int(values_of(PLANE_FILE)["Q_OPTIONS"]) & 0b110 == 0

    def test_every_parameter_is_one_of_arduplane(self) -> None:
        """By the names in its source; those of 4.7 that are older or newer have their successors beside them."""
        folder = ardupilot()
        sources = [*(folder / "ArduPlane").glob("*.cpp"), *(folder / "libraries").glob("AP_[ABRS]*/*.cpp")]
        text = "\n".join(path.read_text(encoding="utf-8", errors="replace") for path in sources)
        known = set(re.findall(r"@Param(?:\{[^}]*\})?: (\w+)", text))
        groups = {"SCR_", "RALLY_", "Q_", "BATT_", "ARMING_"}
        for name in set(values_of(PLANE_FILE)) - {"ARMING_SKIPCHK"}:
            prefix = next((group for group in groups if name.startswith(group)), "")
            assert name.removeprefix(prefix) in known, name


class TestResources:
    """What the page says of the script's appetite is what it is: no less, and not much more."""

    def test_local_variables(self, source: str) -> None:
        assert stated("local variables of the main function") == [_locals(source)]

    def test_instructions_of_an_ordinary_call(self, tmp_path: Path) -> None:
        plain = Bench(count_instructions=True).with_lease()
        plain.most_instructions = 0
        plain.run(5000)
        keyed = keyed_bench(tmp_path, count_instructions=True).with_lease()
        keyed.most_instructions = 0
        keyed.run(5000)
        for bench, most in zip((plain, keyed), stated("VM instructions in one call, ordinary"), strict=True):
            assert 0.9 * most <= bench.most_instructions <= most
