# SPDX-License-Identifier: GPL-3.0-or-later

"""What is shipped for the flight controller loads there: the script's form, its page, its parameter file."""

from __future__ import annotations

import re
import shutil
import subprocess

import pytest

from tests.lua.stub import GUARD, Bench

PAGE = GUARD.with_suffix(".md")
PARAMETER_FILE = GUARD.with_name("handover.parm")

LUACHECK = GUARD.with_name(".luacheckrc")


@pytest.fixture(scope="module")
def source() -> str:
    return GUARD.read_text(encoding="utf-8")


def test_main_function_keeps_to_100_locals(source: str) -> None:
    """ArduPilot's Lua refuses more; the usual Lua allows 200 and would not notice."""
    count = 0
    for line in source.splitlines():
        if line.startswith("local function "):
            count += 1
        elif line.startswith("local "):
            count += line.split("=", 1)[0].count(",") + 1
    assert 50 < count <= 95


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


def test_parameters_are_documented_in_script_and_page(source: str) -> None:
    added = re.findall(r'bind_add_param\("(\w+)", (\d+), ([-\d.]+)\)', source)
    assert [int(index) for _, index, _ in added] == [1, 2, 3, 4, 5, 6, 7]
    page = PAGE.read_text(encoding="utf-8")
    for name, _, default in added:
        full = f"HNDO_{name}"
        assert len(full) <= 16
        assert f"// @Param: {full}\n" in source
        assert re.search(rf"^## {full}$", page, re.MULTILINE)
        assert re.search(rf"^\| {full} +\| +{re.escape(default)} +\|", page, re.MULTILINE)
        assert Bench().vehicle.parameters[full] == float(default)


class TestParameterFile:
    def lines(self) -> list[str]:
        return PARAMETER_FILE.read_text(encoding="ascii").splitlines()

    def test_arducopter_reads_99_bytes_a_line_and_comments_only_in_column_one(self) -> None:
        """The rest of a longer line would be read as a line of its own; '#' behind a value is no comment everywhere."""
        for line in self.lines():
            assert len(line) < 97
            assert "#" not in line[1:] or line.startswith("#")
            assert not line.startswith((" ", "\t"))

    def test_every_line_is_name_and_value(self) -> None:
        values = [line.split() for line in self.lines() if line and not line.startswith("#")]
        assert values
        for name, value in values:
            assert re.fullmatch(r"[A-Z][A-Z0-9_]{1,15}", name)
            float(value)
        names = [name for name, _ in values]
        assert len(names) == len(set(names))

    def test_every_value_has_its_reason(self) -> None:
        previous = ""
        for line in self.lines():
            if line and not line.startswith("#"):
                assert previous.startswith("# "), line
            previous = line

    def test_mavproxy_loads_it(self, capsys: pytest.CaptureFixture[str]) -> None:
        from pymavlink.mavparm import MAVParmDict

        parameters = MAVParmDict()
        assert parameters.load(str(PARAMETER_FILE))
        assert "Invalid" not in capsys.readouterr().out
        assert parameters["RALLY_LIMIT_KM"] == 0.0
        assert parameters["FS_GCS_TIMEOUT"] == 10.0

    def test_the_autopilots_own_watch_is_slower_than_the_guard(self, source: str) -> None:
        values = dict(line.split() for line in self.lines() if line and not line.startswith("#"))
        lease_timeout = float(re.search(r'bind_add_param\("TIMEOUT", 2, (\d+)\)', source)[1])  # type: ignore[index]
        assert float(values["FS_GCS_TIMEOUT"]) > lease_timeout
        assert int(values["FS_OPTIONS"]) & 0b10011 == 0
