# SPDX-License-Identifier: GPL-3.0-or-later

"""MAVProxy for the supervisor's child: everything that it imports is imported before the fork.

MAVProxy is a script with all its code under `if __name__ == "__main__"`. Starting Python, importing and compiling the
script take most of a second, or several on a small computer. The guard allows three seconds for a restart.
"""

from __future__ import annotations

import gc
import importlib
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any, Final

__all__ = ["MAIN", "Script", "few_threads", "mpstate_of"]

#: module name of a script
MAIN: Final = "__main__"
#: variables that keep numerical libraries from starting threads when they are imported
_NO_THREADS: Final = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")
#: imports of MAVProxy and of its modules for a companion; some are optional
_IMPORTS: Final = (
    "serial",
    "pymavlink.mavutil",
    "pymavlink.mavwp",
    "pymavlink.mavparm",
    "pymavlink.dialects.v20.ardupilotmega",
    "matplotlib",
    "MAVProxy.modules.lib.textconsole",
    "MAVProxy.modules.lib.mp_util",
    "MAVProxy.modules.lib.rline",
    "MAVProxy.modules.lib.mp_module",
    "MAVProxy.modules.lib.mp_substitute",
    "MAVProxy.modules.lib.mp_settings",
    "MAVProxy.modules.lib.multiproc",
    "MAVProxy.modules.lib.sitl_output",
    "MAVProxy.modules.mavproxy_link",
    "MAVProxy.modules.mavproxy_signing",
    "multiprocessing.queues",
    "multiprocessing.synchronize",
    "optparse",
    "serial.tools.list_ports",
)
#: our own module
_MODULE: Final = "mavproxy_handover.companion.module"


def few_threads() -> None:
    """Limit the threads of numerical libraries. Call this before they are imported in a process that will fork."""
    for name in _NO_THREADS:
        os.environ.setdefault(name, "1")


class Script:
    """MAVProxy's script, compiled."""

    def __init__(self, path: Path) -> None:
        """Raises OSError."""
        self._path = path
        self._code: CodeType = compile(path.read_bytes(), str(path), "exec", dont_inherit=True)

    def prepare(self) -> None:
        """Import what MAVProxy will import, and our module. The caller checks that no import has started a thread.

        Raises what the import of our module raises, because a companion needs it.
        """
        few_threads()
        for module in _IMPORTS:
            with suppress(Exception):  # it is optional, or MAVProxy will report the error
                importlib.import_module(module)
        importlib.import_module(_MODULE)
        gc.collect()
        gc.freeze()  # these objects stay, so the garbage collector of a child does not copy their memory

    def run(self, argv: Sequence[str]) -> int:
        """Run it with these options, as Python would. Returns the exit code; other exceptions pass."""
        main = ModuleType(MAIN)
        main.__dict__.update(__file__=str(self._path), __builtins__=__builtins__)
        sys.modules[MAIN] = main
        sys.argv = [str(self._path), *argv]
        try:
            exec(self._code, main.__dict__)
        except SystemExit as stop:
            return stop.code if isinstance(stop.code, int) else int(stop.code is not None)
        return 0


def mpstate_of() -> Any:
    """MAVProxy's state in the process that runs it; None before it exists."""
    return getattr(sys.modules.get(MAIN), "mpstate", None)
