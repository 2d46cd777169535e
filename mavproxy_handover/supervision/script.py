# SPDX-License-Identifier: GPL-3.0-or-later

"""MAVProxy as the supervisor's child runs it: everything that it imports is imported before the fork.

MAVProxy is a script, all of whose work is under `if __name__ == "__main__"`. Python's start, the imports and the
compiling of that script take most of a second, several on a small computer, and the guard gives a restart three.
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

#: the name that a script runs under
MAIN: Final = "__main__"
#: numerical libraries start threads as they are imported, unless told not to
_NO_THREADS: Final = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")
#: what MAVProxy and its modules for a companion import; some of it is optional
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
_MODULE: Final = "mavproxy_handover.module"


def few_threads() -> None:
    """To be called before a numerical library is imported, in a process that is to be forked."""
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

        Raises what the import of our module raises: a companion without it is none.
        """
        few_threads()
        for module in _IMPORTS:
            with suppress(Exception):  # it is optional, or MAVProxy will say what is wrong with it
                importlib.import_module(module)
        importlib.import_module(_MODULE)
        gc.collect()
        gc.freeze()  # what is here stays: children need not copy it to find that out

    def run(self, argv: Sequence[str]) -> int:
        """Run it with these options, as Python would; returns the exit code. What else it raises is passed on."""
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
    """MAVProxy's state, in the process that runs it; None before it has made it."""
    return getattr(sys.modules.get(MAIN), "mpstate", None)
