# SPDX-License-Identifier: GPL-3.0-or-later

"""The menu has every command of the station, and each window its station's and aircraft's name."""

from __future__ import annotations

import pickle
from types import SimpleNamespace
from typing import Any

from gcs_module import menu
from gcs_module.commands import OF_STATION, StationCommands
from gcs_module.fleet import our_settings
from gcs_module.window_title import WindowTitles, set_title


def test_the_menu_has_every_command_of_the_station() -> None:
    module: Any = SimpleNamespace(event_log=SimpleNamespace(acknowledged=None), config=SimpleNamespace(peers=()))
    commands = {name.split()[0] for name, _text in StationCommands(module, our_settings()).listed()}
    listed = {words.split()[0] for _label, words in menu.ENTRIES}
    assert OF_STATION[0].split()[0] in listed
    assert listed | set(menu.TYPED_ONLY) == commands
    assert listed & set(menu.TYPED_ONLY) == set()


class Window:
    """The console or a map, as far as titles need them."""

    def __init__(self) -> None:
        self.sent: list[Any] = []
        self.parent_pipe_send = SimpleNamespace(send=self.sent.append)
        self.object_queue = SimpleNamespace(put=self.sent.append)
        self.name, self.map = "map", self

    def is_alive(self) -> bool:
        return True


def test_each_window_gets_its_title_once_and_again_when_it_changes() -> None:
    console, chart, faults = Window(), Window(), []
    names = ["vehicle 1"]
    mpstate = SimpleNamespace(console=console, modules=[(chart, None)])
    made = WindowTitles(mpstate, "GCSA", lambda: names, lambda *fault: faults.append(fault))
    for _second in range(3):
        made.tick()
    names[:] = ["drone-1", "drone-2"]
    made.tick()
    sent = [*console.sent, *chart.sent]
    assert {each.__reduce__()[0] for each in sent} == {set_title}
    assert [pickle.loads(pickle.dumps(each)) for each in sent] == [None] * 4, "it is nothing in the window's process"
    assert [each.text for each in sent] == [
        "GCSA: vehicle 1 - Console",
        "GCSA: drone-1, drone-2 - Console",
        "GCSA: vehicle 1 - Map",
        "GCSA: drone-1, drone-2 - Map",
    ]
    assert faults == []


def test_without_windows_nothing_is_sent() -> None:
    faults: list[object] = []
    mpstate = SimpleNamespace(console=SimpleNamespace(), modules=[])
    WindowTitles(mpstate, "GCSA", lambda: ["drone-1"], lambda *fault: faults.append(fault)).tick()
    assert faults == []


def test_a_window_that_is_gone_is_one_fault() -> None:
    def gone(_obj: object) -> None:
        raise BrokenPipeError

    console = Window()
    console.parent_pipe_send = SimpleNamespace(send=gone)
    faults: list[tuple[str, str]] = []
    made = WindowTitles(
        SimpleNamespace(console=console, modules=[]), "GCSA", lambda: ["drone-1"], lambda *fault: faults.append(fault)
    )
    made.tick()
    made.tick()
    assert [where for where, _text in faults] == ["window title"]
