# SPDX-License-Identifier: GPL-3.0-or-later

"""Lets MAVProxy load our modules, and handles a module that cannot be loaded.

MAVProxy without the module would go on unsigned and ungated, and would not report it. So a MAVProxy that was started
for the module ends with exit code 2 and one sentence that gives the reason. If an operator loads the module by hand,
only the reason is shown.

It imports only the standard library, because the supervisor must stay single-threaded, and imports of other parts start
threads. A broken numpy or shapely must not keep this module from reporting it.
"""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Callable
from typing import Any, Final

from mavproxy_handover.supervision.main_loop import end
from mavproxy_handover.supervision.watchdog_pipe import Refusal, watchdog_pipe

__all__ = ["MUST_LOAD", "import_fault", "loaded", "module_fault", "must_load", "refused", "starter"]

#: set by `handover station` and `handover companion` in the environment of the MAVProxy that they become. It holds the
#: command's name. The first load removes it
MUST_LOAD: Final = "HANDOVER_MUST_LOAD"
#: exit code for wrong usage
_USAGE: Final = 2


def must_load(command: str) -> None:
    """Require that MAVProxy, which this process will become, loads our module or ends."""
    os.environ[MUST_LOAD] = command


def loaded() -> None:
    """The module is loaded. If a later load fails, the operator who asked for it sees that."""
    os.environ.pop(MUST_LOAD, None)


def starter(name: str, module: str) -> Callable[..., Any]:
    """A failed import is reported in one sentence, like every other reason."""

    def init(mpstate: Any, **arguments: Any) -> Any:
        try:
            importlib.import_module("numpy")  # before shapely, which prints a traceback of its own without it
            start = importlib.import_module(module).init
        except Exception as error:
            refused(mpstate, name, import_fault(error))
            return None
        return start(mpstate, **arguments)

    return init


def module_fault(name: str) -> str:
    """Why MAVProxy would not load our module by this name, and what to do; "" if it would."""
    again = f"Run: {sys.executable} -m pip install --force-reinstall --no-deps mavproxy-handover"
    try:
        module = importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name != name:
            return import_fault(error)
        return f"{name}.py, which MAVProxy loads, is not installed. {again}"
    except Exception as error:
        return import_fault(error)
    if getattr(getattr(module, "init", None), "__module__", "") != __name__:
        where = getattr(module, "__file__", None) or next(iter(getattr(module, "__path__", [])), name)
        return f"{where} has the name of our module {name}, and MAVProxy would load it. Remove or rename it"
    return ""


def refused(mpstate: Any, name: str, text: str, kind: Refusal = Refusal.MACHINE) -> None:
    """Say why module `name` is not loaded. A MAVProxy that was started for it ends with code 2.

    The caller's `init` then returns None to MAVProxy: there is no module.
    """
    mpstate.console.writeln(f"{name} is not loaded: {text}")
    line = watchdog_pipe()
    if line is not None and not line.lived:
        line.refused = kind
        end(mpstate)
        return
    command = os.environ.pop(MUST_LOAD, None)
    if command is not None:
        sys.stdout.flush()
        print(f"{command}: module {name} is not loaded: {text}", file=sys.stderr, flush=True)
        # nothing is open yet that must be closed, and MAVProxy's threads would delay a normal exit
        os._exit(_USAGE)


def import_fault(error: Exception) -> str:
    """Fault of the installation, and what to do, in one sentence. `error`: exception of an import."""
    error = _numpys_own(error)
    pip = f"{sys.executable} -m pip install"
    if isinstance(error, ModuleNotFoundError) and error.name:
        return f"{error.name.partition('.')[0]} is not installed. Run: {pip} mavproxy-handover"
    broken = _broken_package(error)
    reason = f"{type(error).__name__}: {_first_line(error)}"
    if broken is None:
        return f"an import failed ({reason}). Run: {pip} --force-reinstall mavproxy-handover"
    return f"{broken} is broken ({reason}). Run: {pip} --force-reinstall --no-cache-dir {broken}"


def _numpys_own(error: Exception) -> Exception:
    """The exception of an import of numpy, if it raises. Other packages fail because of it, with other texts."""
    try:
        importlib.import_module("numpy")
    except Exception as fault:
        return fault
    return error


def _first_line(error: BaseException) -> str:
    """The first line of an error: numpy explains a failed import on a whole page."""
    error = error.__cause__ or error
    return next((line.strip() for line in str(error).splitlines() if line.strip()), "no reason given")


def _broken_package(error: BaseException) -> str | None:
    """The outermost foreign package on the path to a failed import; None if there is none."""
    trace = error.__traceback__
    while trace is not None:
        package = str(trace.tb_frame.f_globals.get("__name__", "")).partition(".")[0]
        if package not in ("", "__main__", "importlib", "mavproxy_handover", "gcs_module", "sitl"):
            return package
        trace = trace.tb_next
    return None
