# SPDX-License-Identifier: GPL-3.0-or-later

"""What runs as root changes the network of the bench, and never the one of this machine."""

from __future__ import annotations

import pytest

from sitl.hosts import namespaces, weather
from sitl.hosts.plan import plan


def test_outside_of_the_bench_it_changes_nothing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    changed: list[str] = []
    monkeypatch.setattr(weather, "_open", lambda: changed.append("device") or 99)
    monkeypatch.setattr(weather, "_lead", lambda _names: changed.append("rules"))
    monkeypatch.setattr(weather, "_serve", lambda _device, _orders: None)
    assert weather.main(["eth0"]) == 2
    assert changed == []
    assert "weather: this is no host of the bench" in capsys.readouterr().err


def test_where_its_own_folder_is_gone_a_run_removes_no_name_of_the_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    """Below /run/netns is then what the machine has there, perhaps by the same name."""
    removed: list[list[str]] = []
    monkeypatch.setattr(namespaces, "run", removed.append)
    made = namespaces.Namespaces(plan(["GCSA"]))
    made._made.append("gateway")
    made.close()
    assert removed == []
