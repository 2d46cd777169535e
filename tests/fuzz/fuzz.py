# SPDX-License-Identifier: GPL-3.0-or-later

"""Coverage-guided fuzzing of what takes bytes from outside, for as long as you let it: `make fuzz`, or

    python tests/fuzz/fuzz.py [--seconds 60] [--work DIR] [TARGET ...]     each target for so long, one after the other
    python tests/fuzz/fuzz.py --keep DIR [TARGET ...]                      some of DIR, to begin with the next time
    python tests/fuzz/fuzz.py --once TARGET FILE                           one plan, and what it cost

Needs atheris (`pip install atheris`), which ships for Linux and a few versions of Python only. A plan that breaks
something is written to `tests/data/fuzz/TARGET/`, where the tests pick it up; what reaches new code goes to DIR/TARGET
(`--work`), and from there, by `--keep`, a part of it to the same place: fuzzing begins with what lies there.

A plan is also a finding if it takes more than MOST_S of processor time or MOST_BYTES of memory without the
instruments of the fuzzer, which slow things down.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

ROOT = Path(__file__).resolve().parents[2]
CORPUS = ROOT / "tests" / "data" / "fuzz"
MOST_S: Final = 2.0
MOST_BYTES: Final = 200 * 1024 * 1024
#: so many plans of a target are kept: short ones and long ones
_KEPT: Final = 60


@dataclass(frozen=True, slots=True)
class Target:
    """What is fuzzed: a harness with `run` and `seeds`, the packages whose coverage leads, the longest plan."""

    harness: str
    led_by: tuple[str, ...]
    most: int = 2000
    #: what a text is made of that no fuzzer guesses
    words: tuple[str, ...] = ()


TARGETS: Final = {
    "gate": Target("tests.fuzz.harness", ("mavproxy_handover.gate", "mavproxy_handover.wire")),
    "package": Target(
        "tests.fuzz.package",
        ("mavproxy_handover.mission",),
        6000,
        (
            "MultiPolygon",
            '"coordinates":',
            '"radius_m":',
            "1e308",
            "-180.0",
            "180.0",
            "[[",
            '"inclusion":true',
            "0x7fff",
        ),
    ),
    "ground": Target("tests.fuzz.ground", ("gcs_module", "mavproxy_handover.wire", "mavproxy_handover.link.udp"), 1500),
    "stream": Target("tests.fuzz.stream", ("mavproxy_handover.wire.frames",), 600),
    "feeds": Target(
        "tests.fuzz.feeds",
        ("mavproxy_handover.gate.feeds", "mavproxy_handover.wire", "mavproxy_handover.core.feeds"),
        600,
    ),
    "onboard": Target(
        "tests.fuzz.onboard",
        ("mavproxy_handover.gate", "mavproxy_handover.operator.onboard", "mavproxy_handover.core.authority.delegation"),
        600,
    ),
    "states": Target(
        "tests.fuzz.states", ("mavproxy_handover.store", "mavproxy_handover.core.authority.authority"), 600
    ),
}


def main() -> int:
    """0 if nothing broke, 1 if something did, 2 if atheris is missing."""
    parser = argparse.ArgumentParser(description="Coverage-guided fuzzing.")
    parser.add_argument("--seconds", type=int, default=60, help="for each target")
    parser.add_argument("--work", type=Path, help="where plans that reach new code are left")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="put the best of DIR into tests/data/fuzz")
    parser.add_argument("--once", nargs=2, metavar=("TARGET", "FILE"), help="carry out one plan")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=", ".join(TARGETS))
    given = parser.parse_args()
    sys.path.insert(0, str(ROOT))
    if given.once:
        return _once(given.once[0], Path(given.once[1]))
    try:
        import atheris
    except ImportError:
        print("fuzz: atheris is not installed here (pip install atheris); the fuzz tests of `make test` need none")
        return 2
    if given.child:
        return _fuzz(given.child, atheris, given.targets)
    for name in given.targets:
        if name not in TARGETS:
            parser.error(f"{name!r} must be one of {', '.join(TARGETS)}")
    broken = 0
    for name in given.targets or TARGETS:
        broken |= _keep(name, given.keep / name) if given.keep else _run(name, given.seconds, given.work)
    return broken


def _run(name: str, seconds: int, work: Path | None) -> int:
    """Fuzz a target in a process of its own: libFuzzer ends the process that it is in."""
    print(f"fuzz: {name}, {seconds} s", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        corpus = (work or Path(folder)) / name
        _fill(name, corpus)
        limits = [
            f"-max_total_time={seconds}",
            f"-max_len={TARGETS[name].most}",
            "-len_control=0",
            "-rss_limit_mb=1500",
            "-timeout=60",
        ]
        return 1 if _child(name, [*limits, *_words(name, folder), f"-artifact_prefix={folder}/", str(corpus)]) else 0


def _keep(name: str, work: Path) -> int:
    """Put plans out of the smallest part of `work` that reaches as far as all of it into the corpus."""
    with tempfile.TemporaryDirectory() as folder:
        broken = _child(name, ["-merge=1", f"-max_len={TARGETS[name].most}", folder, str(work)])
        paths = sorted(Path(folder).iterdir(), key=lambda path: (path.stat().st_size, path.name))
        for path in paths[:: max(1, -(-len(paths) // _KEPT))]:
            _write(name, path.read_bytes())
    return 1 if broken else 0


def _child(name: str, arguments: list[str]) -> int:
    return subprocess.run([sys.executable, __file__, "--child", name, "--", *arguments], check=False).returncode


def _fill(name: str, corpus: Path) -> None:
    corpus.mkdir(parents=True, exist_ok=True)
    plans = [path.read_bytes() for path in (CORPUS / name).glob("*.bin")]
    for plan in [*importlib.import_module(TARGETS[name].harness).seeds(), *plans]:
        (corpus / hashlib.sha1(plan).hexdigest()).write_bytes(plan)


def _words(name: str, folder: str) -> list[str]:
    if not TARGETS[name].words:
        return []
    path = Path(folder) / "words"
    lines = (word.replace("\\", "\\\\").replace('"', '\\"') for word in TARGETS[name].words)
    path.write_text("".join(f'"{line}"\n' for line in lines))
    return [f"-dict={path}"]


def _write(name: str, plan: bytes) -> Path:
    path = CORPUS / name / f"{hashlib.sha256(plan).hexdigest()[:16]}.bin"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(plan)
    return path


def _fuzz(name: str, atheris: object, arguments: list[str]) -> int:
    target = TARGETS[name]
    with atheris.instrument_imports(include=list(target.led_by)):  # type: ignore[attr-defined]
        harness = importlib.import_module(target.harness)
    one = _watched(name, harness.run)
    again = f"{sys.executable} {__file__} --child {name} --"  # how a merge starts this process again
    atheris.Setup([again, *arguments], one)  # type: ignore[attr-defined]
    atheris.Fuzz()  # type: ignore[attr-defined]
    return 0


def _watched(name: str, run: Callable[[bytes], object]) -> Callable[[bytes], None]:
    """Carries out a plan, and keeps it if it breaks something or costs too much."""

    def one(plan: bytes) -> None:
        begun_s, begun_bytes = _spent()
        try:
            run(plan)
            taken_s, taken_bytes = (now - before for now, before in zip(_spent(), (begun_s, begun_bytes), strict=True))
            if taken_s > MOST_S or taken_bytes > MOST_BYTES:
                _weigh(name, plan)
        except BaseException:
            print(f"fuzz: broken by {_write(name, plan)}", file=sys.stderr)
            raise

    return one


def _spent() -> tuple[float, int]:
    """Processor time and the most memory so far, seconds and bytes."""
    return time.process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def _weigh(name: str, plan: bytes) -> None:
    """The same in a process without instruments: what is too much there is a finding."""
    with tempfile.NamedTemporaryFile() as file:
        file.write(plan)
        file.flush()
        command = [sys.executable, __file__, "--once", name, file.name]
        done = subprocess.run(command, check=False, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(done.stdout + done.stderr)


def _once(name: str, path: Path) -> int:
    run = importlib.import_module(TARGETS[name].harness).run
    plan = path.read_bytes()
    begun_s, begun_bytes = _spent()
    run(plan)
    taken_s, taken_bytes = _spent()[0] - begun_s, _spent()[1] - begun_bytes
    print(f"{len(plan)} bytes: {taken_s:.2f} s, {taken_bytes / 1024 / 1024:.0f} MB")
    return 1 if taken_s > MOST_S or taken_bytes > MOST_BYTES else 0


if __name__ == "__main__":
    sys.exit(main())
