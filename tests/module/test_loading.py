# SPDX-License-Identifier: GPL-3.0-or-later

"""`module load handover`: what it takes, what it changes in MAVProxy, and that all of it is given back."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest
from MAVProxy.modules.lib import mp_util

from mavproxy_handover.companion import module as vehicle_module
from mavproxy_handover.tools.version import VERSION
from tests.module.conftest import Bench
from tests.module.proxy import Output


def test_load_says_which_vehicle_which_stations_and_which_file(bench: Bench) -> None:
    assert bench.load() is not None
    assert bench.mpstate.console.lines == [
        f"handover {VERSION}: drone-1, stations GCSA (parent), GCSB, configuration {bench.config}",
        "handover: WARNING: GCSA, GCSB without a key: any program on the link counts as the station",
    ]
    assert bench.module.name == "handover", "MAVProxy finds a module to unload by its load name"
    assert bench.module.multi_vehicle, "MAVProxy keeps the heartbeats of others from a module that is not"


def test_load_closes_the_side_doors_and_unload_opens_them_again(bench: Bench) -> None:
    settings = bench.mpstate.settings
    settings.heartbeat = 2.5
    bench.load()
    assert (settings.mavfwd, settings.mavfwd_disarmed, settings.heartbeat) == (False, False, 0)
    bench.mpstate.unload("handover")
    assert (settings.mavfwd, settings.mavfwd_disarmed, settings.heartbeat) == (True, True, 2.5)


@pytest.mark.parametrize(("name", "value"), [("mavfwd", True), ("mavfwd_disarmed", True), ("heartbeat", 1.0)])
def test_a_side_door_that_is_opened_is_shut_before_mavproxy_selects_again(
    bench: Bench, name: str, value: object
) -> None:
    bench.load()
    bench.run(0.5)
    bench.mpstate.settings.set(name, value)
    bench.loop()
    assert not getattr(bench.mpstate.settings, name)
    assert bench.mpstate.console.said(f"handover: {name} is set back to ")


def test_an_output_that_is_added_is_closed(bench: Bench) -> None:
    bench.load()
    bench.run(0.1)
    output, thief = Output("127.0.0.1:14550"), Output("127.0.0.1:14551")
    bench.mpstate.mav_outputs.append(output)
    bench.mpstate.sysid_outputs[1] = thief
    bench.loop()
    assert (bench.mpstate.mav_outputs, bench.mpstate.sysid_outputs) == ([], {})
    assert output.closed
    assert thief.closed
    assert bench.mpstate.console.said("output 127.0.0.1:14551 is closed: stations belong in the configuration")


def test_it_refuses_to_load_beside_outputs(bench: Bench) -> None:
    bench.mpstate.mav_outputs.append(Output("127.0.0.1:14550"))
    assert bench.load() is None
    (line,) = bench.mpstate.console.lines
    assert line.startswith("handover is not loaded: MAVProxy has outputs (127.0.0.1:14550): ")
    assert "listen_only_outputs = true in [vehicle]" in line
    assert bench.mpstate.settings.mavfwd, "nothing has been changed"


def test_listen_only_outputs_may_stay_and_are_not_forwarded(bench: Bench) -> None:
    output = Output("127.0.0.1:14550")
    bench.mpstate.mav_outputs.append(output)
    bench.configure(more="listen_only_outputs = true")
    bench.load()
    bench.run(0.5)
    assert bench.mpstate.mav_outputs == [output]
    assert not output.closed
    assert not bench.mpstate.settings.mavfwd


def test_an_output_for_the_vehicles_own_id_is_never_allowed_since_it_takes_the_messages_away(bench: Bench) -> None:
    bench.mpstate.sysid_outputs[1] = Output("127.0.0.1:14550")
    bench.configure(more="listen_only_outputs = true")
    assert bench.load() is None


def test_unload_gives_everything_back(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mp_util, "child_fd_list", [])  # one list for the whole process: other tests write to it too
    state = bench.mpstate
    before = (dict(state.completions), dict(state.command_map), dict(state.completion_functions))
    bench.load()
    sockets = [link for port in bench.companion.ports.values() for link in port.links]
    assert sorted(state.select_extra) == sorted(link.fileno() for link in sockets)
    assert sorted(mp_util.child_fd_list) == sorted([*state.select_extra, *bench.module.lock.descriptors])
    bench.run(0.5)
    assert state.unload("handover")
    assert state.select_extra == {}
    assert [link.fileno() for link in sockets] == [-1, -1]
    assert state.public_modules == {}
    assert mp_util.child_fd_list == [], "the sockets that a child process (map, console) must close"
    assert (state.completions, state.command_map, state.completion_functions) == before
    assert bench.journal()[-1]["event"] == "unloaded"


def test_load_and_unload_many_times_leaves_no_descriptor_open(bench: Bench) -> None:
    def open_descriptors() -> int:
        return len(os.listdir("/proc/self/fd"))

    bench.load()
    bench.mpstate.unload("handover")
    before = open_descriptors()
    for _ in range(5):
        assert bench.load() is not None
        bench.run(0.1)
        bench.mpstate.unload("handover")
    assert open_descriptors() == before


def test_reload_needs_no_argument(bench: Bench) -> None:
    bench.load()
    bench.mpstate.unload("handover")
    assert bench.mpstate.load("handover", vehicle_module) is not None
    assert any(str(bench.config) in line for line in bench.mpstate.console.lines[-2:])


def test_a_second_load_leaves_the_first_alone(bench: Bench) -> None:
    first = bench.load()
    bench.mpstate.load("handover", vehicle_module, config=str(bench.config))
    assert bench.mpstate.printed[-1] == "module handover already loaded"
    assert [module for module, _package in bench.mpstate.modules] == [first]


def test_station_and_vehicle_do_not_share_a_mavproxy(bench: Bench) -> None:
    bench.mpstate.command_map["handover"] = (lambda args: None, "of handover_gcs")
    assert bench.load() is None
    assert bench.mpstate.console.lines == [
        "handover is not loaded: module handover_gcs is loaded here: vehicle and station need a MAVProxy each"
    ]


NO_CONFIGURATION = (
    'handover is not loaded: no configuration: looked for module load handover:{"config":"FILE"} (no spaces in it), '
    "$HANDOVER_CONFIG, ./handover.toml, /etc/handover/vehicle.toml; the shell's 'handover init vehicle' writes one"
)


def test_without_a_configuration_one_line_says_where_it_looked(bench: Bench) -> None:
    bench.config.unlink()
    assert bench.mpstate.load("handover", vehicle_module) is None
    assert bench.mpstate.console.lines == [NO_CONFIGURATION]
    assert bench.mpstate.settings.mavfwd


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        ({"config": "/nowhere/x.toml"}, "/nowhere/x.toml: no such file"),
        ({"config": 5}, "argument config: 5 must be the path of a file"),
        ({"config": ""}, "argument config: '' must be the path of a file"),
        ({"config": ["x"]}, "argument config: ['x'] must be the path of a file"),
        ({"config": "a\0b"}, "argument config: 'a\\x00b' must be the path of a file"),
        ({"config": "~nobody-of-that-name/x"}, "~nobody-of-that-name/x: Could not determine home directory."),
        ({"confg": "x"}, "unknown argument confg; allowed are: config, journal"),
    ],
)
def test_arguments_that_make_no_sense_are_one_line(bench: Bench, arguments: dict[str, object], line: str) -> None:
    assert bench.mpstate.load("handover", vehicle_module, **arguments) is None
    assert bench.mpstate.console.lines == [f"handover is not loaded: {line}"]


def test_a_port_in_use_is_one_line_and_the_other_ports_are_free_again(bench: Bench, tmp_path: Path) -> None:
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken,
    ):
        free.bind(("127.0.0.1", 0))
        taken.bind(("127.0.0.1", 0))
        port_a, port_b = free.getsockname()[1], taken.getsockname()[1]
        free.close()
        text = bench.config.read_text().replace(f"udpout:127.0.0.1:{bench.a.port}", f"udpin:127.0.0.1:{port_a}")
        bench.config.write_text(text.replace(f"udpout:127.0.0.1:{bench.b.port}", f"udpin:127.0.0.1:{port_b}"))
        assert bench.load() is None
        assert bench.mpstate.console.lines == [
            f"handover is not loaded: link udpin:127.0.0.1:{port_b} cannot be opened: Address already in use"
        ]
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as again:
            again.bind(("127.0.0.1", port_a))


@pytest.mark.parametrize("host", ["..", "x" * 70])
def test_a_host_that_cannot_be_one_is_one_line(bench: Bench, host: str) -> None:
    bench.config.write_text(bench.config.read_text().replace("udpout:127.0.0.1", f"udpout:{host}", 1))
    assert bench.load() is None
    (line,) = bench.mpstate.console.lines
    assert line.startswith(f"handover is not loaded: link udpout:{host}:{bench.a.port} cannot be opened: ")


def test_a_journal_that_cannot_be_written_is_one_line_and_closes_the_links(bench: Bench) -> None:
    (bench.folder / "companion.jsonl").mkdir()
    assert bench.load() is None
    assert bench.mpstate.console.lines == [
        f"handover is not loaded: {bench.folder / 'companion.jsonl'}: Is a directory"
    ]
    assert bench.mpstate.select_extra == {}


def test_a_fault_of_our_own_while_loading_does_not_reach_mavproxy(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """MAVProxy loads its default modules unguarded: an exception there would be its end."""

    def broken(*_arguments: object) -> None:
        raise RuntimeError("a bug")

    with monkeypatch.context() as patch:
        patch.setattr(vehicle_module, "Companion", broken)
        assert bench.load() is None
    assert bench.mpstate.console.lines == ["handover is not loaded: internal fault: RuntimeError: a bug"]
    assert (bench.mpstate.select_extra, bench.mpstate.public_modules) == ({}, {})
    assert bench.load() is not None


def test_the_journal_tells_of_the_load(bench: Bench) -> None:
    bench.load()
    entry = bench.journal()[0]
    assert (entry["who"], entry["event"], entry["version"]) == ("drone-1", "loaded", VERSION)
    assert entry["text"] == f"handover {VERSION}, configuration {bench.config}"
