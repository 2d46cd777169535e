# SPDX-License-Identifier: GPL-3.0-or-later

"""The guard's tests in a Lua 5.3 with 32-bit numbers, as the autopilot has: python -m tests.lua.run_32bit

Lua has a switch for that, LUA_32BITS, which no package that can be installed was built with. This fetches the source
of lupa (with Lua's own in it) from the package registry, builds it with the switch into a folder that is thrown away,
and runs tests/lua with it. Takes about a minute and a C compiler; further arguments go to pytest.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).parents[2]
_PROBE = (
    "from lupa import lua53; lua = lua53.LuaRuntime(); print(lua.eval('math.maxinteger'), lua.eval('2.0^24 + 1.0'))"
)
#: the largest integer of 32 bits; a float of 32 bits cannot count to 2^24 + 1
_EXPECTED = "2147483647 16777216.0"


def build(work: Path) -> Path:
    """Build lupa with a 32-bit Lua 5.3; returns the folder to put on the path. Raises CalledProcessError."""
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    subprocess.run(
        [*pip, "download", "--no-deps", "--no-binary", "lupa", "-d", str(work), "lupa"],
        check=True,
    )
    with tarfile.open(next(work.glob("lupa-*.tar.gz"))) as archive:
        archive.extractall(work, filter="data")
    source = next(path for path in work.glob("lupa-*") if path.is_dir())
    for lua in (source / "third-party").iterdir():
        if lua.name != "lua53":
            shutil.rmtree(lua)
    site = work / "site"
    environment = {**os.environ, "CFLAGS": "-O1 -DLUA_32BITS"}
    subprocess.run([*pip, "install", "--no-deps", "--target", str(site), str(source)], check=True, env=environment)
    return site


def main(argv: Sequence[str] | None = None) -> int:
    """Returns pytest's exit code, or 2 if no 32-bit Lua can be had."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            site = build(Path(folder))
        except (subprocess.CalledProcessError, StopIteration) as error:
            print(f"no 32-bit Lua can be built: {error}", file=sys.stderr)
            return 2
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join((str(site), str(ROOT)))}
        probe = subprocess.run(
            [sys.executable, "-c", _PROBE], env=environment, capture_output=True, text=True, check=True
        )
        if probe.stdout.strip() != _EXPECTED:
            print(f"this Lua is not one of 32 bits: {probe.stdout.strip()}", file=sys.stderr)
            return 2
        print(f"Lua 5.3 with 32-bit numbers: math.maxinteger, 2^24 + 1 = {probe.stdout.strip()}", flush=True)
        arguments = sys.argv[1:] if argv is None else argv
        command = [sys.executable, "-m", "pytest", "-q", str(ROOT / "tests" / "lua"), *arguments]
        return subprocess.run(command, env=environment, cwd=ROOT, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
