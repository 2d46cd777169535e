# SPDX-License-Identifier: GPL-3.0-or-later

"""Operators sign on and off, and take over from each other."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs_module.duty import CONFIRM_S, Change, Duty
from gcs_module.duty_file import DutyFile
from mavproxy_handover.tools.worker import Worker

NOW = 100.0


def on_duty(name: str = "Jansen", *, required: bool = True) -> Duty:
    duty = Duty(required)
    assert duty.command(name, NOW, "").change is Change.ON
    return duty


def test_a_station_that_requires_an_operator_is_manned_after_sign_on() -> None:
    duty = Duty(required=True)
    assert not duty.manned
    assert "takes no aircraft" in duty.command("", NOW, "").text
    assert duty.command("Jansen", NOW, "").text == "Jansen is on duty."
    assert (duty.manned, duty.name) == (True, "Jansen")


def test_a_station_that_requires_none_is_manned_anyway() -> None:
    duty = Duty(required=False)
    assert duty.manned
    assert duty.command("", NOW, "").text == "No operator has signed on. 'handover operator NAME' signs on."


def test_the_next_operator_is_briefed_and_confirms() -> None:
    duty = on_duty()
    first = duty.command("de Vries", NOW, "drone-1")
    assert (first.change, first.before, duty.name) == (Change.BRIEFED, "Jansen", "Jansen")
    second = duty.command("de  Vries", NOW + CONFIRM_S - 1.0, "drone-1")
    assert (second.change, second.before, duty.name) == (Change.SHIFT, "Jansen", "de Vries")
    assert second.text == "de Vries is on duty, after Jansen."


def test_a_late_confirmation_and_another_name_are_briefed_anew() -> None:
    duty = on_duty()
    duty.command("Bakker", NOW, "")
    assert duty.command("Bakker", NOW + CONFIRM_S, "").change is Change.BRIEFED
    assert duty.command("Visser", NOW + CONFIRM_S + 1.0, "").change is Change.BRIEFED
    assert duty.command("Bakker", NOW + CONFIRM_S + 2.0, "").change is Change.BRIEFED
    assert duty.name == "Jansen"


def test_nobody_signs_off_while_an_aircraft_flies_under_command() -> None:
    duty = on_duty()
    refused = duty.command("off", NOW, "drone-1")
    assert refused.change is Change.TOLD
    assert refused.text.startswith("Jansen stays on duty: drone-1 flies under this station's command, or is about to.")
    assert duty.manned
    done = duty.command("off", NOW, "")
    assert (done.change, done.before, duty.manned) == (Change.OFF, "Jansen", False)
    assert duty.command("off", NOW, "").change is Change.TOLD


@pytest.mark.parametrize("name", ["-", "x" * 31, "a\x1b[2J", "_a", "semi;colon", "off!"])
def test_what_is_no_name_changes_nothing(name: str) -> None:
    duty = Duty(required=True)
    assert duty.command(name, NOW, "").change is Change.TOLD
    assert duty.name == ""


@pytest.mark.parametrize("name", ["Jansen", "J. de Vries", "O'Neill", "Zoë-Marie", "7"])
def test_names_of_people_are_names(name: str) -> None:
    assert on_duty(name).name == name


def test_the_operator_on_duty_cancels_the_change_of_shift() -> None:
    duty = on_duty()
    duty.command("Bakker", NOW, "drone-1")
    assert duty.next_one(NOW + 1.0) == ("Bakker", NOW + CONFIRM_S)
    assert duty.command("Jansen", NOW + 2.0, "drone-1").text == "Jansen stays on duty."
    assert duty.next_one(NOW + 3.0)[0] == ""
    assert duty.command("Bakker", NOW + 4.0, "drone-1").change is Change.BRIEFED
    assert duty.next_one(NOW + 4.0 + CONFIRM_S)[0] == ""


class TestFile:
    """The file beside the configuration: only for the line after a restart."""

    def file(self, folder: Path) -> DutyFile:
        return DutyFile(folder / "station.toml", "GCSB", Worker(start=lambda run: run()))

    def kept(self, folder: Path, *names: str) -> DutyFile:
        file = self.file(folder)
        for number, name in enumerate(names):
            file.keep(name)
            file.tick(NOW + number)
        return file

    def test_after_a_restart_the_operator_on_duty_before_is_known(self, tmp_path: Path) -> None:
        assert self.file(tmp_path).before() == ""
        self.kept(tmp_path, "de Vries")
        assert self.file(tmp_path).before() == "de Vries"

    def test_who_signed_off_is_not_named(self, tmp_path: Path) -> None:
        self.kept(tmp_path, "Jansen", "")
        assert list(tmp_path.iterdir()) == []

    def test_it_is_named_until_somebody_signs_on(self, tmp_path: Path) -> None:
        self.kept(tmp_path, "Jansen")
        assert [self.file(tmp_path).before() for _restart in range(2)] == ["Jansen", "Jansen"]

    @pytest.mark.parametrize("data", [b"", b"off", b"\xff\xfe", b"Jansen\x1b[31m", b"J" * 300, b"../x"])
    def test_a_damaged_file_counts_as_none(self, tmp_path: Path, data: bytes) -> None:
        (tmp_path / "GCSB.operator").write_bytes(data)
        assert self.file(tmp_path).before() == ""

    def test_a_disk_that_refuses_is_a_fault_and_no_exception(self, tmp_path: Path) -> None:
        file = self.kept(tmp_path / "missing", "Jansen")
        file.tick(NOW + 1.0)
        assert "missing" in file.fault
