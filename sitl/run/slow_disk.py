# SPDX-License-Identifier: GPL-3.0-or-later

"""A disk that makes a program wait: `slow_disk.c` is compiled and loaded in front of the C library.

The program and the call are the real ones; only the duration is not. Nothing else on the machine notices.
"""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

from sitl.script.places import SetupError

__all__ = ["on_slow_disk"]

_SOURCE = Path(__file__).with_name("slow_disk.c")
_COMPILE_S = 60.0


def on_slow_disk(folder: Path, fsync_s: float) -> tuple[str, ...]:
    """Words to put before a command line: each fsync of that program takes `fsync_s`. `folder`: for what is compiled.

    Raises SetupError with one line, as where there is no C compiler.
    """
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        raise SetupError("a slow disk needs a C compiler (Debian: gcc), and there is none")
    folder.mkdir(parents=True, exist_ok=True)
    library = (folder / "slow_disk.so").resolve()
    command = [compiler, "-shared", "-fPIC", "-O2", "-o", str(library), str(_SOURCE), "-ldl"]
    try:
        subprocess.run(command, check=True, capture_output=True, text=True, timeout=_COMPILE_S)
    except subprocess.CalledProcessError as error:
        raise SetupError(f"slow_disk.c was not compiled: {' '.join(error.stderr.split())[:200]}") from None
    except (OSError, subprocess.TimeoutExpired) as error:
        raise SetupError(f"slow_disk.c was not compiled: {error}") from None
    return ("/usr/bin/env", f"LD_PRELOAD={library}", f"SLOW_DISK_S={fsync_s:g}")
