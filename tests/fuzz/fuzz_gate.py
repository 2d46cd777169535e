# SPDX-License-Identifier: GPL-3.0-or-later

"""Coverage-guided fuzzing of the gate, for as long as you let it: `make fuzz`, or

    python tests/fuzz/fuzz_gate.py [seconds]        (default 60)

Needs atheris (`pip install atheris`), which ships for Linux and a few versions of Python only. A plan that breaks the
gate is written to `tests/data/fuzz/`, where the tests pick it up.
"""

from __future__ import annotations

import hashlib
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
CRASHERS = ROOT / "tests" / "data" / "fuzz"


def main(seconds: int) -> int:
    """Fuzz; 0 if nothing broke (libFuzzer ends the process itself then), 2 if atheris is missing."""
    try:
        import atheris
    except ImportError:
        print("fuzz: atheris is not installed here (pip install atheris); the fuzz tests of `make test` need none")
        return 2
    sys.path.insert(0, str(ROOT))
    with atheris.instrument_imports(include=["mavproxy_handover.gate", "mavproxy_handover.wire"]):
        from tests.fuzz.harness import run, seeds

    def one(plan: bytes) -> None:
        try:
            run(plan)
        except BaseException:
            CRASHERS.mkdir(parents=True, exist_ok=True)
            path = CRASHERS / f"{hashlib.sha256(plan).hexdigest()[:16]}.bin"
            path.write_bytes(plan)
            print(f"fuzz: broken by {path}", file=sys.stderr)
            raise

    with tempfile.TemporaryDirectory() as corpus:
        for number, plan in enumerate([*seeds(), *(path.read_bytes() for path in CRASHERS.glob("*.bin"))]):
            (Path(corpus) / f"seed{number}").write_bytes(plan)
        arguments = ["fuzz_gate", f"-max_total_time={seconds}", "-max_len=2000", f"-artifact_prefix={corpus}/", corpus]
        atheris.Setup(arguments, one)
        atheris.Fuzz()
    return 0


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 60))
