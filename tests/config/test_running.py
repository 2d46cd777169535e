# SPDX-License-Identifier: GPL-3.0-or-later

"""What a start runs by: the files on the ground, the run before in flight."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from mavproxy_handover.config import running
from mavproxy_handover.config.files import ConfigError
from mavproxy_handover.config.running import Running, forget, keep, load_running, start_of
from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.core.common.snapshot import Snapshot
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.store import restart_copy
from mavproxy_handover.store.keys import KeysError
from mavproxy_handover.store.restart_copy import RestartCopy
from mavproxy_handover.store.state_store import StateStore

MISSIONS = Path(__file__).resolve().parents[2] / "missions"
KEYS = {name: bytes([number]) * 32 for number, name in enumerate(("GCSA", "old", "autopilot", "guard"), 1)}
GROUND = Snapshot(owner=251, epoch=3, handover_id=0, phase=Phase.ON_LOAD, route_at=0, digest=b"", route=())
FLIGHT = replace(GROUND, phase=Phase.ON_MISSION)


@pytest.fixture
def config(tmp_path: Path) -> Path:
    for name, key in KEYS.items():
        path = tmp_path / ("GCSA.key.old" if name == "old" else f"{name}.key")
        path.write_text(key.hex())
        path.chmod(0o600)
    shutil.copytree(MISSIONS / "delivery", tmp_path / "mission")
    path = tmp_path / "handover.toml"
    path.write_text(
        """
        [vehicle]
        name = "drone-1"
        parent = "GCSA"
        mission = "mission"
        autopilot_key = "autopilot.key"
        guard_key = "guard.key"
        [[station]]
        name = "GCSA"
        sysid = 251
        links = ["udpout:127.0.0.1:14550"]
        key = "GCSA.key"
        """
    )
    return path


def left_behind(config: Path, snapshot: Snapshot) -> None:
    """A run ended here, with this state."""
    keeper = StateStore(config.parent / "state", "drone-1")
    keeper.recall()
    keeper.save(snapshot)
    keeper.close()


def keys_of(found: Running) -> tuple[bytes | None, ...]:
    return found.keys["GCSA"].current, found.keys["GCSA"].previous, found.autopilot_key, found.guard_key


def test_on_the_ground_the_files_are_read(config: Path) -> None:
    found = load_running(config)
    assert keys_of(found) == tuple(KEYS.values())
    assert found.mission is not None
    assert found.mission.name == "delivery"
    assert (found.restart, found.notes) == (False, ())


def test_no_repr_shows_a_key(config: Path) -> None:
    text = repr(load_running(config))
    assert not any(word in text for key in KEYS.values() for word in (key.hex(), repr(key)))


def test_a_restart_in_flight_goes_on_with_what_flew_and_touches_no_file(
    config: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = replace(load_running(config), addresses={"gcs.example": ("192.0.2.7", "2001:db8::7")})
    assert keep(before) == ""
    left_behind(config, FLIGHT)
    shutil.rmtree(config.parent / "mission")
    config.unlink()
    monkeypatch.setattr(running, "read_file", lambda path: pytest.fail(f"{path} is read"))
    monkeypatch.setattr(running, "load_key", lambda path, **_: pytest.fail(f"{path} is read"))
    found = load_running(config)
    assert replace(found, restart=False, recorded=False, notes=()) == before
    assert found.restart
    (note,) = found.notes
    assert note == (
        "Restart: configuration, keys and mission are those of the run before; "
        f"{config} is read at the next start on the ground"
    )
    assert start_of(config).in_flight


@pytest.mark.parametrize("state", [GROUND, replace(FLIGHT, rehearsal=True), None], ids=["ground", "rehearsal", "none"])
def test_on_the_ground_the_files_count_whatever_was_kept(config: Path, state: Snapshot | None) -> None:
    keep(load_running(config))
    if state is not None:
        left_behind(config, state)
    config.write_text(config.read_text().replace("14550", "14551"))
    found = load_running(config)
    assert found.config.stations[0].links == ("udpout:127.0.0.1:14551",)
    assert not found.restart
    assert not start_of(config).in_flight
    config.write_text("")
    with pytest.raises(ConfigError):
        load_running(config)


def test_what_the_supervisor_starts_again_goes_on_with_what_ran_on_the_ground_too(config: Path) -> None:
    """Nobody asked for a start: an edit is taken over when somebody does."""
    keep(load_running(config))
    left_behind(config, GROUND)
    config.unlink()
    assert load_running(config, restarted=True).restart


def test_what_is_forgotten_is_not_gone_on_with(config: Path) -> None:
    found = load_running(config)
    keep(found)
    forget(found.config)
    left_behind(config, FLIGHT)
    assert load_running(config).notes == ("Restart: there is no record of the run before, so the files were read",)


def full(_path: Path, _data: bytes, *, sync: bool = True) -> None:
    raise OSError(28, "No space left on device")


def test_where_there_is_no_room_a_record_of_another_configuration_goes(
    config: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A restart must not go on with a configuration that is not the one that flies."""
    keep(load_running(config))
    config.write_text(config.read_text().replace("14550", "14551"))
    changed = load_running(config)
    monkeypatch.setattr(restart_copy, "replace_whole", full)
    assert keep(changed) == "a restart in flight will have to read all files again: No space left on device"
    left_behind(config, FLIGHT)
    found = load_running(config)
    assert found.config.stations[0].links == ("udpout:127.0.0.1:14551",)
    assert found.notes[0].startswith("Restart: there is no record")


def test_where_there_is_no_room_the_record_that_was_gone_on_with_stays(
    config: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    keep(load_running(config))
    left_behind(config, FLIGHT)
    found = load_running(config)
    monkeypatch.setattr(restart_copy, "replace_whole", full)
    assert keep(replace(found, addresses={"gcs.example": ("192.0.2.7",)})) != ""
    config.unlink()
    assert load_running(config).recorded


def test_a_record_that_makes_no_sense_is_none(config: Path) -> None:
    found = load_running(config)
    keep(found)
    left_behind(config, FLIGHT)
    record = RestartCopy(config)
    kept = record.load()
    assert kept is not None
    for key, wrong in [("text", 7), ("text", "a"), ("keys", [1]), ("keys", {"GCSA": ["AA=="]}), ("mission", "QUJD")]:
        record.save({**kept, key: wrong})
        assert load_running(config).notes[0].startswith("Restart: there is no record")
    record.save({"path": str(config)})
    assert load_running(config).notes[0].startswith("Restart: there is no record")


# ---- without a record ----------------------------------------------------------------------------------------------


def key_for_all(config: Path) -> None:
    (config.parent / "GCSA.key").chmod(0o644)


def guard_key_for_all(config: Path) -> None:
    (config.parent / "guard.key").chmod(0o640)


def key_of_another_user(config: Path) -> None:
    if os.geteuid() != 0:
        pytest.skip("only root can give a file away")
    os.chown(config.parent / "GCSA.key", 12345, 0)


@pytest.mark.parametrize("spoil", [key_for_all, guard_key_for_all, key_of_another_user])
def test_who_may_read_a_key_file_is_a_warning_in_flight_and_an_error_before_it(
    config: Path, spoil: Callable[[Path], None]
) -> None:
    spoil(config)
    with pytest.raises(KeysError, match=r"must be 0600|must belong to"):
        load_running(config)
    left_behind(config, FLIGHT)
    found = load_running(config)
    assert keys_of(found) == tuple(KEYS.values())
    assert len(found.notes) == 2
    assert "must be" in found.notes[1] or "must belong" in found.notes[1]


def no_configuration(config: Path) -> None:
    config.unlink()


def broken_configuration(config: Path) -> None:
    config.write_text("[vehicle")


def no_key(config: Path) -> None:
    (config.parent / "GCSA.key").unlink()


def no_guard_key(config: Path) -> None:
    (config.parent / "guard.key").unlink()


def no_autopilot_key(config: Path) -> None:
    (config.parent / "autopilot.key").unlink()


def no_mission(config: Path) -> None:
    shutil.rmtree(config.parent / "mission")


@pytest.mark.parametrize(
    ("spoil", "kind", "words"),
    [
        (no_configuration, ConfigError, "handover.toml: no such file"),
        (broken_configuration, ConfigError, "handover.toml: not valid TOML"),
        (no_key, KeysError, "GCSA.key: no such key file"),
        (no_guard_key, KeysError, "guard.key: no such key file"),
        (no_autopilot_key, KeysError, "autopilot.key: no such key file"),
        (no_mission, MissionError, "mission.toml"),
    ],
)
def test_missing_on_the_ground_is_an_error_and_in_flight_is_none(
    config: Path, spoil: Callable[[Path], None], kind: type[Exception], words: str
) -> None:
    keep(load_running(config))
    spoil(config)
    with pytest.raises(kind, match=words):
        load_running(config)
    left_behind(config, FLIGHT)
    assert keys_of(load_running(config)) == tuple(KEYS.values())


def test_the_names_of_what_is_kept(config: Path) -> None:
    keep(load_running(config))
    record = RestartCopy(config).load()
    assert record is not None
    assert sorted(record) == [
        "addresses",
        "autopilot_key",
        "guard_key",
        "keys",
        "layout",
        "mission",
        "mission_addresses",
        "path",
        "text",
    ]


def test_a_restart_in_flight_goes_on_with_the_layout_of_the_box_that_flew(config: Path) -> None:
    """The layout comes from a file of its own, which need not be there any more."""
    file = config.parent / "acme.toml"
    rows = [("time", "s"), ("lat", "rad"), ("lon", "rad"), ("vel_north", "m/s"), ("vel_east", "m/s")]
    for number, (name, unit) in enumerate(rows):
        with file.open("a") as text:
            text.write(f'[[field]]\nfield = "{name}"\ntype = "double"\nunit = "{unit}"\noffset = {8 * number}\n')
    with config.open("a") as text:
        text.write('[position]\nsource = "box"\nbox = "tcp:10.0.0.9:4001"\nlayout = "acme.toml"\n')
    before = load_running(config)
    assert keep(before) == ""
    left_behind(config, FLIGHT)
    file.unlink()
    found = load_running(config)
    assert found.restart
    assert found.config.position == before.config.position
    assert (found.config.position.layout.name, found.config.position.layout.size) == ("acme", 40)


def test_a_restart_keeps_the_addresses_that_came_with_the_mission_and_a_damaged_file_is_told(config: Path) -> None:
    folder = load_running(config).config.mission
    assert folder is not None
    file = folder / "addresses.toml"
    file.write_text('[vehicle]\nGCSB = ["udpout:10.0.0.2:14552"]\n')
    found = load_running(config)
    keep(found)
    file.write_text("x =")
    again = load_running(config, restarted=True)
    assert again.mission is not None
    assert found.mission is not None
    assert dict(again.mission.addresses) == dict(found.mission.addresses) != {}
    RestartCopy(config).remove()
    (note,) = load_running(config).notes
    assert note.startswith(f"{file}: not TOML: ")
