# SPDX-License-Identifier: GPL-3.0-or-later

"""Starts, feeds and ends the real processes of a simulation.

Rules: each process has a folder of its own (working directory, home directory and console log), so that no user's
`~/.mavinit.scr` changes a run; its console is fed through a pipe, because MAVProxy reads its commands there and ends
when the pipe closes; it is known and ended by its own id or its own process group, nothing is ever looked for by
name; it ends with its parent in any case: on leaving the `with` block, on Ctrl-C, and by the kernel when the parent
is killed.
"""

from __future__ import annotations

import os
import signal
import site
import subprocess
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType

import sitl
from sitl.vehicles.parent_death import die_with_parent

__all__ = ["Child", "ProcessGone", "Processes", "ending"]

_STOP_TIMEOUT_S = 4.0
_SIGNALS = {"terminate": signal.SIGTERM, "hang up": signal.SIGHUP, "interrupt": signal.SIGINT}
_PROJECT = Path(sitl.__file__).resolve().parents[1]


class ProcessGone(RuntimeError):
    """A line was typed at a process that has ended."""


def ending(code: int) -> str:
    """A return code in words."""
    if code < 0:
        return f"killed by {signal.Signals(-code).name}"
    return f"ended with {code}"


class Child:
    """One running process. `ended_at` is the monotonic time at which its end was noticed."""

    def __init__(self, name: str, argv: Sequence[str], folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.name = name
        self.argv, self.folder = tuple(argv), folder
        self.log_path = folder / f"{name}.console.txt"
        self.killed = False
        self.ended_at: float | None = None
        with self.log_path.open("ab") as log:  # one that is started again goes on where it was
            self._process = subprocess.Popen(
                list(argv),
                cwd=folder,
                env=_environment(folder),
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                preexec_fn=die_with_parent,  # noqa: PLW1509 (no threads here: the runner has one)
            )

    @property
    def pid(self) -> int:
        return self._process.pid

    @property
    def returncode(self) -> int | None:
        """None while it runs; negative: ended by that signal."""
        code = self._process.poll()
        if code is not None and self.ended_at is None:
            self.ended_at = time.monotonic()
        return code

    def alive(self) -> bool:
        return self.returncode is None

    def offspring(self) -> int | None:
        """The process that it has forked and watches over; None while there is none, or more than one."""
        try:
            numbers = Path(f"/proc/{self.pid}/task/{self.pid}/children").read_text(encoding="ascii").split()
        except OSError:
            return None
        return int(numbers[0]) if len(numbers) == 1 else None

    def type(self, line: str) -> None:
        """Type a line at its console. Raises ProcessGone if the process does not read any more."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(line.encode("utf-8") + b"\n")
            self._process.stdin.flush()
        except (OSError, ValueError):  # ValueError: the pipe is closed on our side
            raise ProcessGone(f"{self.name} has ended and does not read {line!r}") from None

    def kill(self) -> None:
        """End it at once, without a chance to clean up (SIGKILL), with all that it started itself."""
        self.killed = True
        self._signal_group(signal.SIGKILL)
        self._process.wait()
        self._note_end()

    def close(self, how: str) -> None:
        """Tell it to end, in a way of `script.fault_steps.CLOSINGS`. Its end is no fault then."""
        self.killed = True
        if how == "exit":
            self.type("exit")
        elif how == "end of input":
            self._close_console()
        else:
            self._process.send_signal(_SIGNALS[how])

    def ask_to_end(self) -> None:
        """Close its console and send SIGTERM: MAVProxy's console thread sees only the one, its main loop the other."""
        self._close_console()
        if self.alive():
            self._process.terminate()

    def stop(self, timeout_s: float = _STOP_TIMEOUT_S) -> None:
        """Ask it to end, then insist. Safe to call twice."""
        self.ask_to_end()
        try:
            self._process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            pass
        self._signal_group(signal.SIGKILL)
        self._process.wait()
        self._note_end()

    def _note_end(self) -> None:
        if self.ended_at is None:
            self.ended_at = time.monotonic()
        self._close_console()

    def _close_console(self) -> None:
        assert self._process.stdin is not None
        try:
            self._process.stdin.close()
        except OSError:
            pass

    def _signal_group(self, number: signal.Signals) -> None:
        # Its own session was made at start: the group's number is the process's, and holds only its children. After its
        # end was noted, another process may have the number.
        if self._process.returncode is not None:
            return
        try:
            os.killpg(self._process.pid, number)
        except (ProcessLookupError, PermissionError):
            pass

    def resident_kb(self) -> int | None:
        """Memory of the process, or of the process that it supervises (resident set, KiB); None if that is not
        known."""
        try:
            status = Path(f"/proc/{self.offspring() or self.pid}/status").read_text(encoding="ascii", errors="replace")
        except OSError:
            return None
        sizes = [line.split()[1] for line in status.splitlines() if line.startswith("VmRSS:")]
        return int(sizes[0]) if sizes else None

    def console(self) -> list[str]:
        """The lines of its console so far."""
        return self.log_path.read_text(encoding="utf-8", errors="replace").rstrip().splitlines()


class Processes:
    """All processes of a run; leaving the `with` block ends them, the last started first."""

    def __init__(self) -> None:
        self._children: dict[str, Child] = {}

    def __enter__(self) -> Processes:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop_all()

    def __getitem__(self, name: str) -> Child:
        return self._children[name]

    def __contains__(self, name: str) -> bool:
        return name in self._children

    def __iter__(self) -> Iterator[Child]:
        return iter(self._children.values())

    def start(self, name: str, argv: Sequence[str], folder: Path) -> Child:
        """Start a process under a name that is not in use. Raises OSError when it cannot be started."""
        if name in self._children:
            raise ValueError(f"process {name!r} was started already")
        child = Child(name, argv, folder)
        self._children[name] = child
        return child

    def restart(self, name: str) -> Child:
        """Start a process again that was killed. Raises ValueError if it still runs, OSError."""
        before = self._children[name]
        if before.alive():
            raise ValueError(f"process {name!r} still runs")
        self._children[name] = child = Child(name, before.argv, before.folder)
        return child

    def dead(self) -> list[Child]:
        """The processes that ended without being asked to."""
        return [child for child in self._children.values() if not child.killed and not child.alive()]

    def stop_all(self) -> None:
        """End all; also after a second Ctrl-C none is left running."""
        waiting = list(reversed(self._children.values()))
        try:
            for child in waiting:
                child.ask_to_end()
            until = time.monotonic() + _STOP_TIMEOUT_S
            for child in waiting:
                child.stop(max(0.0, until - time.monotonic()))
        except KeyboardInterrupt:
            for child in waiting:
                child.kill()
            raise


def _environment(folder: Path) -> dict[str, str]:
    environment = dict(os.environ)
    search = [str(_PROJECT), environment.get("PYTHONPATH", "")]
    environment.update(
        HOME=str(folder),
        # packages that `pip install --user` put under the real home must stay visible
        PYTHONUSERBASE=site.getuserbase(),
        PYTHONPATH=os.pathsep.join(part for part in search if part),
        PYTHONUNBUFFERED="1",
        TERM="dumb",
    )
    return environment
