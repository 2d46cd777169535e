# SPDX-License-Identifier: GPL-3.0-or-later

"""The parent process of the companion: forks it, waits for its signals, and forks it again (rules in `rules.py`).

Rules
-----
* It gives no authority and sends no messages. It only lets a new judge go on from the state file of the old one, as any
  restart does.
* There is one child. It is reaped before the next one is forked, so there are never two. It dies with its parent.
* The parent has one thread. A fork copies only that thread. A lock held by another thread would stay locked in the
  child. If a library has started a thread, nothing is forked (`single_threaded`).
* It waits only for its child. In flight it writes nothing to the terminal, which may be stopped. The next child reports
  what happened.
"""

from __future__ import annotations

import ctypes
import os
import select
import signal
import termios
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from typing import Any, Final

from mavproxy_handover.supervision.manager import ServiceManager
from mavproxy_handover.supervision.rules import Limits, Next, Watch
from mavproxy_handover.supervision.watchdog_pipe import Told, WatchdogPipe

__all__ = ["ENDS", "Supervisor", "single_threaded"]

#: signals that end supervisor and child
ENDS: Final = (signal.SIGTERM, signal.SIGINT, signal.SIGQUIT)
#: signals of a terminal. A companion needs no terminal, so they are ignored
_OF_TERMINALS: Final = (signal.SIGHUP, signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU)
_PR_SET_PDEATHSIG: Final = 1
#: a wake-up that is later than this (s) counts as a stall of the supervisor
_LATE_S: Final = 0.2
#: an internal fault of the child (EX_SOFTWARE)
_FAULT: Final = 70


def single_threaded() -> bool:
    """True if this process has one thread, as far as the kernel knows it."""
    return len(os.listdir("/proc/self/task")) == 1


class Supervisor:
    """Runs `child` in its own process, again and again. `child` gets the watchdog pipe and returns the exit code."""

    def __init__(
        self,
        child: Callable[[WatchdogPipe], int],
        limits: Limits,
        manager: ServiceManager | None = None,
        *,
        in_flight: bool = False,
    ) -> None:
        """`manager`: gets a message while all is in order; None: there is none. `in_flight`: see `Watch`."""
        self._child = child
        self._manager = manager or ServiceManager()
        self._limits = limits
        self._watch = Watch(limits, in_flight=in_flight)
        self._pid = 0
        #: pipe by which signals wake the parent: descriptors to read and to write
        self._wake: tuple[int, int] = (-1, -1)
        # loaded before any fork
        self._libc = ctypes.CDLL(None, use_errno=True)
        self._terminal = _terminal()

    def run(self) -> int:
        """Run until a final end; returns the exit code. Call it in the main thread.

        Raises OSError if not even the first child can be started.
        """
        with self._signals():
            after = self._live(Told())
            while after.told is not None and self._pause(after.at):
                self._manager.replaced(after.told.why)
                try:
                    after = self._live(after.told)
                except OSError:  # no memory or no process number: only another try can help
                    after = replace(after, at=time.monotonic() + self._limits.failed_s)
                _restore(self._terminal)
            return after.code

    @contextmanager
    def _signals(self) -> Iterator[None]:
        self._wake = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        # a handler that does nothing: the signal's number is written to the pipe
        before: dict[int, Any] = {number: signal.signal(number, _nothing) for number in (*ENDS, signal.SIGCHLD)}
        before |= {number: signal.signal(number, signal.SIG_IGN) for number in _OF_TERMINALS}
        woken = signal.set_wakeup_fd(self._wake[1], warn_on_full_buffer=False)
        try:
            yield
        finally:
            signal.set_wakeup_fd(woken)
            for number, handler in before.items():
                signal.signal(number, handler)
            for descriptor in self._wake:
                os.close(descriptor)

    def _pause(self, until: float) -> bool:
        """Wait. Returns False if the supervisor is to end meanwhile."""
        waiting = select.poll()
        waiting.register(self._wake[0], select.POLLIN)
        while (now := time.monotonic()) < until:
            waiting.poll((until - now) * 1000.0)
            if self._wanted_to_end():
                return False
        return True

    def _wanted_to_end(self) -> bool:
        numbers = b""
        with suppress(BlockingIOError):
            numbers = os.read(self._wake[0], 4096)
        return any(number in numbers for number in ENDS)

    def _live(self, told: Told) -> Next:
        """Run one child until its end. Raises OSError if it cannot be forked."""
        signs = self._fork(told)
        try:
            return self._attend(signs)
        finally:
            os.close(signs)

    def _fork(self, told: Told) -> int:
        """Fork the child; returns the descriptor of its signals."""
        reading, writing = os.pipe2(os.O_CLOEXEC)
        os.set_blocking(reading, False)
        parent = os.getpid()
        # a signal that comes between the fork and the child's own setup waits for that setup
        before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDS)
        try:
            self._pid = os.fork()
            if self._pid == 0:
                self._become_child(parent, reading, writing, told)
        except OSError:
            os.close(reading)
            raise
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
            os.close(writing)
        self._watch.started(time.monotonic())
        return reading

    def _become_child(self, parent: int, reading: int, writing: int, told: Told) -> None:
        """Run the child's code; never returns."""
        code = _FAULT
        try:
            self._libc.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
            if os.getppid() == parent:  # otherwise the parent died before the child was tied to it
                signal.set_wakeup_fd(-1)
                signal.signal(signal.SIGCHLD, signal.SIG_DFL)
                for descriptor in (reading, *self._wake):
                    os.close(descriptor)
                self._manager.close()
                code = self._child(WatchdogPipe(writing, told))
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(code)

    def _attend(self, signs: int) -> Next:
        """Wait until the child has ended and is reaped."""
        watch, waiting = self._watch, select.poll()
        for descriptor in (signs, self._wake[0]):
            waiting.register(descriptor, select.POLLIN)
        killed = False
        while True:
            slept_at = time.monotonic()
            if not killed and slept_at < watch.due():
                self._manager.in_order(slept_at, lived=watch.lived)
            wait_s = max(0.0, min(watch.due() - slept_at, self._manager.due_at() - slept_at, 60.0))
            ready = {descriptor for descriptor, _what in waiting.poll(None if killed else wait_s * 1000.0 + 1.0)}
            now = time.monotonic()
            if not killed and now - slept_at - wait_s > _LATE_S:
                watch.pardon(now - slept_at - wait_s)
            if signs in ready:
                data = _read(signs)
                watch.handle_signals(data, now)
                if not data:  # closed, for example by its end, which a signal reports
                    waiting.unregister(signs)
            if self._wake[0] in ready and self._wanted_to_end():
                watch.asked_to_end(now)
                self._manager.stopping()
                os.kill(self._pid, signal.SIGTERM)
            pid, status = os.waitpid(self._pid, os.WNOHANG)
            if pid:
                return watch.ended(os.waitstatus_to_exitcode(status), now)
            if not killed and now >= watch.due():
                killed = True
                os.kill(self._pid, signal.SIGKILL)


def _nothing(_number: int, _frame: Any) -> None:
    """Do nothing: the signal's number is read from the pipe."""


def _read(descriptor: int) -> bytes:
    try:
        return os.read(descriptor, 4096)
    except BlockingIOError:
        return b"\0"  # no data, and not closed


def _terminal() -> list[Any] | None:
    """Settings of the terminal before a program reads lines from it; None if there is no terminal."""
    try:
        return termios.tcgetattr(0)
    except (OSError, termios.error):
        return None


def _restore(attributes: list[Any] | None) -> None:
    """Restore the terminal, because a child that was killed during input has left it without echo."""
    with suppress(OSError, termios.error):
        if attributes is not None and os.tcgetpgrp(0) == os.getpgrp():  # otherwise another program has the terminal
            termios.tcsetattr(0, termios.TCSANOW, attributes)
