# SPDX-License-Identifier: GPL-3.0-or-later

"""The unit of systemd that ships says what the companion understands."""

from __future__ import annotations

import configparser
import shlex
from pathlib import Path

import pytest

from mavproxy_handover import cli
from mavproxy_handover.supervision.rules import Limits
from tests.loopback.conftest import vehicle_file


def test_its_command_line_is_one_of_ours_and_it_leaves_time_to_end(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main(["init", "service"]) == 0
    unit = configparser.ConfigParser(strict=False, interpolation=None)
    unit.optionxform = str  # type: ignore[assignment, method-assign]
    unit.read(tmp_path / "handover.service")
    service = unit["Service"]
    program, *words = shlex.split(service["ExecStart"])
    assert Path(program).name == "handover"
    words[words.index("--config") + 1] = str(vehicle_file(tmp_path / "vehicle.toml", 14550))
    capsys.readouterr()
    assert cli.main([*words[:-2], "--print", *words[-2:]]) == 0
    shown = shlex.split(capsys.readouterr().out)
    assert "--master=/dev/ttyTHS1,921600" in shown
    assert shown[-1] == "--append-log"
    assert float(service["TimeoutStopSec"]) > Limits().end_s
    assert service["StandardInput"] == "null"


@pytest.mark.parametrize("value", ["-1", "3601", "nan", "soon"])
def test_a_time_out_of_range_is_bad_usage(value: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["companion", "--master", "x", "--restarts-within", value]) == 2
    assert "--restarts-within" in capsys.readouterr().err
