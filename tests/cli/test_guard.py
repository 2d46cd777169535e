# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover guard`: what is on the card afterwards, what it refuses to touch, and what it says about it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from mavproxy_handover.cli import main as handover
from mavproxy_handover.cli.guard import main
from mavproxy_handover.store.keys import key_of, write_key
from mavproxy_handover.wire.signing import fingerprint

SHIPPED = Path(__file__).parents[2] / "ardupilot_lua"
KEY = key_of("correct-horse-battery-staple")


@pytest.fixture
def card(tmp_path: Path) -> Path:
    """A card that has been in an autopilot."""
    (tmp_path / "card" / "APM" / "LOGS").mkdir(parents=True)
    return tmp_path / "card"


@pytest.fixture
def scripts(card: Path) -> Path:
    folder = card / "APM" / "scripts"
    folder.mkdir()
    return folder


@pytest.fixture
def key(tmp_path: Path) -> Path:
    path = tmp_path / "guard.key"
    write_key(path, KEY)
    return path


def names(folder: Path) -> list[str]:
    return sorted(entry.name for entry in folder.iterdir())


def test_script_and_parameters_are_copied_and_a_second_run_finds_nothing_to_do(
    card: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert handover(["guard", str(card)]) == 0
    scripts = card / "APM" / "scripts"
    assert names(scripts) == ["handover.parm", "handover_guard.lua"]
    for name in names(scripts):
        assert (scripts / name).read_bytes() == (SHIPPED / name).read_bytes()
    out = capsys.readouterr().out
    assert re.search(r"handover_guard\.lua: written, version \d+\.\d+", out)
    assert "no key: any program that can write to the companion's port" in out
    assert main([str(card)]) == 0
    assert "nothing to write, all is there" in capsys.readouterr().out
    assert main([str(card), "--check"]) == 0


def test_a_plane_gets_the_same_script_and_parameters_of_its_own(card: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert handover(["guard", str(card), "--vehicle", "plane"]) == 0
    scripts = card / "APM" / "scripts"
    assert names(scripts) == ["handover_guard.lua", "handover_plane.parm"]
    for name in names(scripts):
        assert (scripts / name).read_bytes() == (SHIPPED / name).read_bytes()
    assert "load handover_plane.parm, check HNDO_CHAN" in capsys.readouterr().out
    assert main([str(card), "--vehicle", "plane", "--check"]) == 0
    assert main([str(card), "--check"]) == 1
    assert "handover.parm: missing" in capsys.readouterr().err


def test_parameters_of_the_other_kind_of_vehicle_are_mentioned_and_stay(
    card: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main([str(card), "--vehicle", "copter"])
    capsys.readouterr()
    assert main([str(card), "--vehicle", "plane"]) == 0
    captured = capsys.readouterr()
    assert "handover.parm: is for a copter; --vehicle says for which this card is" in captured.out
    assert names(card / "APM" / "scripts") == ["handover.parm", "handover_guard.lua", "handover_plane.parm"]


def test_a_vehicle_that_the_guard_does_not_know_is_wrong_usage(card: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(card), "--vehicle", "rover"]) == 2
    assert "invalid choice: 'rover'" in capsys.readouterr().err
    assert names(card / "APM") == ["LOGS"]


def test_key_is_copied_as_the_guard_reads_it_and_never_shown(
    card: Path, key: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(card), "--key", str(key)]) == 0
    assert (card / "APM" / "scripts" / "handover.key").read_text() == KEY.hex() + "\n"
    captured = capsys.readouterr()
    assert fingerprint(KEY) in captured.out
    assert KEY.hex()[:8] not in captured.out + captured.err


def test_key_that_is_there_already_is_mentioned(card: Path, key: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main([str(card), "--key", str(key)])
    capsys.readouterr()
    assert main([str(card)]) == 0
    assert "the companion needs guard_key" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["handover_guard.lua", "handover.parm", "handover.key"])
def test_a_different_file_stays_unless_forced(
    card: Path, scripts: Path, key: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (scripts / name).write_text('local TEXT = {VERSION = "0.0.9"}\n')
    assert main([str(card), "--key", str(key)]) == 1
    captured = capsys.readouterr()
    assert names(scripts) == [name]
    assert (scripts / name).read_text() == 'local TEXT = {VERSION = "0.0.9"}\n'
    assert str(scripts / name) in captured.err
    assert "nothing was written" in captured.err
    assert main([str(card), "--key", str(key), "--force"]) == 0
    assert names(scripts) == ["handover.key", "handover.parm", "handover_guard.lua"]
    assert (scripts / "handover_guard.lua").read_bytes() == (SHIPPED / "handover_guard.lua").read_bytes()
    assert main([str(card), "--key", str(key), "--check"]) == 0


def test_an_older_guard_is_named_by_its_version(card: Path, scripts: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (scripts / "handover_guard.lua").write_text('local TEXT = {VERSION = "0.0.9"}\n')
    main([str(card)])
    assert "is another guard, version 0.0.9; this is, version" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("code", "why"),
    [
        ("mavlink:init(10, 2)", "receives MAVLink"),
        ("local m = mavlink.receive_chan(mavlink)", "receives MAVLink"),
        ("mavlink : register_rx_msgid(76)", "receives MAVLink"),
        ("local mavport = require('mavport')", "receives MAVLink"),
        ("assert(param:add_table(147, 'MINE_', 3))", "parameter table 147"),
        ("local PARAM_TABLE_KEY = 147", "parameter table 147"),
        ('local PREFIX = "HNDO_"', "second guard"),
    ],
)
def test_a_script_that_stands_in_the_way_stops_the_copy(
    card: Path, scripts: Path, code: str, why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (scripts / "other.lua").write_text(code)
    assert main([str(card)]) == 1
    assert names(scripts) == ["other.lua"]
    assert why in capsys.readouterr().err
    assert main([str(card), "--check"]) == 1
    assert main([str(card), "--force"]) == 0
    assert names(scripts) == ["handover.parm", "handover_guard.lua", "other.lua"]


@pytest.mark.parametrize(
    ("name", "code"),
    [
        (
            "lights.lua",
            "-- mavlink:init(10, 2) was here once\n--[[ mavlink:receive_chan() ]]\nnotify:handle_rgb(1,2,3,4)",
        ),
        ("sender.lua", "mavlink:send_chan(0, 77, '')"),
        ("table.lua", "param:add_table(14, 'A_', 3) param:add_table(1470, 'B_', 3)"),
    ],
)
def test_a_harmless_script_is_mentioned_and_stays(
    card: Path, scripts: Path, name: str, code: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (scripts / name).write_text(code)
    assert main([str(card)]) == 0
    assert f"{name}: runs in the same thread" in capsys.readouterr().out


def test_files_that_the_autopilot_does_not_run_do_not_matter(card: Path, scripts: Path) -> None:
    (scripts / ".hidden.lua").write_text("mavlink:init(1, 1)")
    (scripts / "notes.txt").write_text("mavlink:init(1, 1)")
    (scripts / "modules").mkdir()
    (scripts / "modules" / "mavport.lua").write_text("mavlink:init(1, 1)")
    assert main([str(card)]) == 0


def test_a_fourth_arming_authoriser_is_one_too_many(
    card: Path, scripts: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for number in range(2):
        (scripts / f"{number}.lua").write_text("local id = arming:get_aux_auth_id()")
    assert main([str(card), "--check"]) == 1  # the guard is missing
    assert "authoriser" not in capsys.readouterr().err
    (scripts / "2.lua").write_text("local id = arming:get_aux_auth_id()")
    assert main([str(card)]) == 1
    assert "2.lua: is arming authoriser number 4, 3 can be" in capsys.readouterr().err


@pytest.mark.parametrize("place", [".", "APM", "APM/scripts/modules"])
def test_a_guard_in_the_wrong_place_is_pointed_out(card: Path, place: str, capsys: pytest.CaptureFixture[str]) -> None:
    (card / place).mkdir(parents=True, exist_ok=True)
    (card / place / "handover_guard.lua").write_text("x")
    assert main([str(card)]) == 0
    assert "the autopilot does not run it there" in capsys.readouterr().out


@pytest.mark.parametrize(("inner", "up"), [("APM", ""), ("APM/scripts", "")])
def test_a_folder_inside_the_card_is_not_its_root(
    card: Path, scripts: Path, inner: str, up: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(card / inner)]) == 2
    assert capsys.readouterr().err == f"handover guard: {card / inner}: give the root of the card: {card}\n"
    assert names(scripts) == []


def test_a_folder_that_is_no_card_is_refused_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(tmp_path)]) == 2
    assert main([str(tmp_path / "nowhere")]) == 2
    (tmp_path / "file").write_text("")
    assert main([str(tmp_path / "file")]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 3
    assert "holds no folder APM" in lines[0]
    assert "no such folder" in lines[1]
    assert "is not a folder" in lines[2]
    assert names(tmp_path) == ["file"]
    assert main([str(tmp_path), "--force"]) == 0
    assert names(tmp_path / "APM" / "scripts") == ["handover.parm", "handover_guard.lua"]


def test_a_card_that_cannot_be_written_is_refused(
    card: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("mavproxy_handover.cli.guard.os.access", lambda *_: False)
    assert main([str(card)]) == 2
    assert "cannot be written; is the card locked" in capsys.readouterr().err
    (card / "APM" / "scripts").write_text("a file where a folder should be")
    monkeypatch.undo()
    assert main([str(card)]) == 2
    assert capsys.readouterr().err == f"handover guard: {card / 'APM' / 'scripts'}: is not a folder\n"


def test_a_write_that_fails_leaves_nothing_behind(
    card: Path, scripts: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device", str(scripts / "handover_guard.lua"))

    monkeypatch.setattr("mavproxy_handover.cli.guard.os.replace", full)
    assert main([str(card)]) == 2
    assert capsys.readouterr().err.endswith("handover_guard.lua: No space left on device\n")
    assert names(scripts) == []


def test_a_card_without_modes_can_be_written(card: Path, key: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """FAT, which every card has, refuses chmod."""

    def refused(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted", "chmod")

    for name in ("chmod", "fchmod", "lchmod", "link"):
        monkeypatch.setattr(f"os.{name}", refused, raising=False)
    assert main([str(card), "--key", str(key)]) == 0
    assert names(card / "APM" / "scripts") == ["handover.key", "handover.parm", "handover_guard.lua"]


def test_a_key_that_cannot_be_used_is_refused_before_anything_is_written(
    card: Path, scripts: Path, key: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    key.chmod(0o644)
    assert main([str(card), "--key", str(key)]) == 2
    assert "must be 0600" in capsys.readouterr().err
    assert main([str(card), "--key", str(card / "none.key")]) == 2
    assert names(scripts) == []


def test_check_writes_nothing(card: Path, scripts: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(card), "--check"]) == 1
    assert names(scripts) == []
    assert "handover_guard.lua: missing" in capsys.readouterr().err


def test_wrong_usage_is_exit_code_2(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 2
    assert main(["--help"]) == 0
    capsys.readouterr()
