# SPDX-License-Identifier: GPL-3.0-or-later

"""A disk that makes one program wait, small file systems of a bench's own, and the memory of a run."""

from __future__ import annotations

import os
import subprocess
import sys
import zlib
from pathlib import Path

import pytest

from mavproxy_handover.mission import package as packages
from mavproxy_handover.mission.package import MAX_PACKED_BYTES, MAX_PLAIN_BYTES, MissionPackage
from sitl.bench import load
from sitl.run import bad_disks
from sitl.run.bad_disks import on_slow_disk
from sitl.run.memory import memory_of_a_run
from sitl.run.wiring import lay_out
from sitl.script.places import SetupError, mission_folder
from sitl.script.scenario import ScenarioError, load_scenario, parse_scenario
from tests.sitl.test_wiring import SCENARIO

#: writes a file and waits for the disk; prints how long that took
_WRITES = """
import os, sys, time
descriptor = os.open(sys.argv[1], os.O_WRONLY | os.O_CREAT)
os.write(descriptor, b"x")
begun = time.monotonic()
getattr(os, sys.argv[2])(descriptor)
print(time.monotonic() - begun)
"""


@pytest.fixture(scope="module")
def delivery() -> MissionPackage:
    return packages.load(mission_folder("delivery"))


class TestTheShim:
    @pytest.fixture
    def compiler(self) -> None:
        if bad_disks.shutil.which("cc") is None:
            pytest.skip("no C compiler here")

    @pytest.mark.process
    @pytest.mark.parametrize("call", ["fsync", "fdatasync"])
    def test_makes_a_program_wait_and_lets_the_call_through(self, tmp_path: Path, call: str, compiler: None) -> None:
        under = on_slow_disk(tmp_path / "shim", 0.3)
        argv = [*under, sys.executable, "-c", _WRITES, str(tmp_path / "file"), call]
        done = subprocess.run(argv, capture_output=True, text=True, check=True, timeout=60)
        assert float(done.stdout) >= 0.3
        assert (tmp_path / "file").read_bytes() == b"x"

    @pytest.mark.process
    def test_what_the_call_answers_is_passed_on(self, tmp_path: Path, compiler: None) -> None:
        under = on_slow_disk(tmp_path, 0.0)
        argv = [*under, sys.executable, "-c", "import os; os.fsync(99)"]
        done = subprocess.run(argv, capture_output=True, text=True, check=False, timeout=60)
        assert "Bad file descriptor" in done.stderr

    def test_without_a_compiler_it_says_so(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(bad_disks.shutil, "which", lambda _name: None)
        with pytest.raises(SetupError, match="needs a C compiler"):
            on_slow_disk(tmp_path, 1.0)

    def test_what_does_not_compile_is_one_line(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, compiler: None
    ) -> None:
        (tmp_path / "broken.c").write_text("int fsync(\n")
        monkeypatch.setattr(bad_disks, "_SOURCE", tmp_path / "broken.c")
        with pytest.raises(SetupError, match=r"slow_disk.c was not compiled: .*broken.c") as caught:
            on_slow_disk(tmp_path, 1.0)
        assert "\n" not in str(caught.value)


class TestInAScenario:
    @staticmethod
    def text(more: str) -> str:
        return SCENARIO.format(mission="delivery", more=more)

    def test_the_companion_alone_has_it(
        self, tmp_path: Path, delivery: MissionPackage, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(
            "sitl.run.wiring.on_slow_disk", lambda folder, seconds: ("env", f"X={folder.name} {seconds}")
        )
        scenario = parse_scenario(self.text("fsync_s = 2.5"), "x.toml")
        wiring = lay_out(tmp_path, delivery, mission_folder("delivery"), scenario)
        assert wiring.companion("tcp:x").argv[:3] == ("env", "X=companion 2.5", sys.executable)
        assert all(station.program().argv[0] == sys.executable for station in wiring.stations)

    def test_without_the_word_nothing_stands_before_a_program(self, tmp_path: Path, delivery: MissionPackage) -> None:
        wiring = lay_out(tmp_path, delivery, mission_folder("delivery"), parse_scenario(self.text(""), "x.toml"))
        assert wiring.companion("tcp:x").argv[0] == sys.executable

    @pytest.mark.parametrize("word", ["-1", "31", '"long"', "nan"])
    def test_another_number_is_refused(self, word: str) -> None:
        with pytest.raises(ScenarioError, match="fsync_s"):
            parse_scenario(self.text(f"fsync_s = {word}"), "x.toml")

    def test_the_scenario_that_ships_has_two_seconds(self) -> None:
        folder = Path(bad_disks.__file__).resolve().parents[1] / "scenarios"
        assert load_scenario(folder / "slow-disk.toml").fsync_s == 2.0


class TestTheMemoryOfARun:
    def test_goes_with_the_run(self, monkeypatch: pytest.MonkeyPatch, runtime_directory: Path | None) -> None:
        if runtime_directory is None:
            pytest.skip("no storage in memory here")
        monkeypatch.delenv("RUNTIME_DIRECTORY")
        with memory_of_a_run():
            place = Path(os.environ["RUNTIME_DIRECTORY"])
            (place / "file").write_text("x")
        assert not place.exists()
        assert "RUNTIME_DIRECTORY" not in os.environ

    def test_one_that_is_set_already_stays(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path))
        with memory_of_a_run():
            assert os.environ["RUNTIME_DIRECTORY"] == str(tmp_path)
        assert os.environ["RUNTIME_DIRECTORY"] == str(tmp_path)
        assert tmp_path.exists()


class TestTheBench:
    def test_hostile_packages_may_be_sent_and_are_large(self, delivery: MissionPackage) -> None:
        hostile = load._hostile_packages(delivery)
        assert all(len(data) <= MAX_PACKED_BYTES for data in hostile)
        assert sum(len(zlib.decompress(data)) > MAX_PLAIN_BYTES * 0.9 for data in hostile) >= 4
        assert all(len(zlib.decompress(data)) <= MAX_PLAIN_BYTES for data in hostile)

    def test_a_load_that_cannot_be_made_costs_itself_alone(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        class Quiet:
            late_s = 0.0

            class tour:
                commits = given_up = 0

        def made(gaps: list[float]) -> object:
            return lambda _folder, _seconds: (gaps, Quiet())

        def not_made(_folder: Path, _seconds: float) -> object:
            raise SetupError("a slow disk needs a C compiler")

        monkeypatch.setattr(
            load,
            "LOADS",
            {"none": made([0.2, 0.25]), "slow": not_made, "full": made([0.2, 0.5]), "ro": made([0.4])},
        )
        said: list[str] = []
        found = list(load.stalls(load.StallPlan(1.0, ("none", "slow", "full", "ro")), tmp_path, said.append))
        assert [(one.ours, one.baseline, one.met) for one in found] == [
            (0.25, 0.25, True),
            (None, None, None),
            (0.5, 0.25, False),
            (0.4, 0.25, True),
        ]
        assert found[1].note == "a slow disk needs a C compiler"
        assert said[1] == "slow: NOT MEASURED: a slow disk needs a C compiler"

    @pytest.mark.process
    @pytest.mark.skipif(os.geteuid() != 0, reason="file systems of one's own need root")
    def test_small_disks_get_full_and_read_only_and_nobody_else_sees_them(self, tmp_path: Path) -> None:
        """In a process of its own: a namespace is for life."""
        script = f"""
from pathlib import Path
from sitl.run.bad_disks import small_disk
from sitl.script.places import SetupError
path = Path({str(tmp_path / "disk")!r})
def errno_of(action):
    try:
        action()
    except OSError as error:
        return error.errno
    return 0
try:
    with small_disk(path) as disk:
        (path / "kept").write_text("x")
        disk.fill()
        print("full", errno_of(lambda: (path / "more").write_bytes(bytes(9999))))
    with small_disk(path) as disk:
        disk.turn_read_only()
        print("read-only", errno_of(lambda: (path / "more").write_text("x")))
except SetupError as error:
    print("not allowed", error)
"""
        done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60)
        if done.stdout.startswith("not allowed"):
            pytest.skip(done.stdout)
        assert done.stdout.splitlines() == ["full 28", "read-only 30"]
        assert list((tmp_path / "disk").iterdir()) == []
