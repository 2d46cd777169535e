# SPDX-License-Identifier: GPL-3.0-or-later

"""How MAVProxy starts our modules, and what happens when one of them cannot be loaded.

MAVProxy without the module would go on unsigned and ungated, and would not say so. So a MAVProxy that was started for
the module ends, with exit code 2 and one sentence that says why. A module that an operator loads by hand only says why.

Imports the standard library alone: the supervisor must stay single-threaded, and other parts import what starts
threads. A broken numpy or shapely must not keep this module from saying so.
"""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Callable
from typing import Any, Final

from mavproxy_handover.main_loop import end
from mavproxy_handover.watchdog_pipe import Refusal, watchdog_pipe

__all__ = ["MUST_LOAD", "import_fault", "loaded", "module_fault", "must_load", "refused", "starter"]

#: set by `handover station` and `handover companion` in the environment of the MAVProxy that they become. It holds the
#: command's name. The first load removes it
MUST_LOAD: Final = "HANDOVER_MUST_LOAD"
#: exit code of a command line that cannot be carried out
_USAGE: Final = 2


def must_load(command: str) -> None:
    """This process is about to become MAVProxy: it must load our module, or end."""
    os.environ[MUST_LOAD] = command


def loaded() -> None:
    """The module is loaded. If a later load fails, the operator who asked for it sees that."""
    os.environ.pop(MUST_LOAD, None)


def starter(name: str, module: str) -> Callable[..., Any]:
    """The function `init` that MAVProxy calls to load `name`; `module` holds the real one, and is imported then.

    An import that fails is said in one sentence, as every other reason is.
    """

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
    """Why MAVProxy would not load our module by this name, and the cure; "" if it would."""
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
        # nothing is open yet that must be closed, and MAVProxy's threads would hold up a plain exit
        os._exit(_USAGE)


def import_fault(error: Exception) -> str:
    """What is wrong with the installation, and the cure, in one sentence. `error`: what an import raised."""
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
    """What an import of numpy raises, if it does: other packages fail by it, with words of their own."""
    try:
        importlib.import_module("numpy")
    except Exception as fault:
        return fault
    return error


def _first_line(error: BaseException) -> str:
    """numpy explains a failed import on a page of its own; people need the first line of what it explains."""
    error = error.__cause__ or error
    return next((line.strip() for line in str(error).splitlines() if line.strip()), "no reason given")


def _broken_package(error: BaseException) -> str | None:
    """The outermost package that is not ours on the way to where an import failed; None if there is none."""
    trace = error.__traceback__
    while trace is not None:
        package = str(trace.tb_frame.f_globals.get("__name__", "")).partition(".")[0]
        if package not in ("", "__main__", "importlib", "mavproxy_handover", "gcs_module", "sitl"):
            return package
        trace = trace.tb_next
    return None
