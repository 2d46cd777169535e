# SPDX-License-Identifier: GPL-3.0-or-later

"""The parent process of the companion: forks it, waits for its signs, and forks it again (`rules.py` says when).

Rules
-----
* It gives no authority and sends nothing: all it can do is to let a new judge take up what the old one left in the
  state file, as any restart does.
* One child. It is reaped before the next one is forked, so there are never two; and it dies with its parent.
* The parent has one thread. A fork copies that thread alone, and a lock that another one held would stay locked in the
  child for ever. Where something has started a thread, nothing is forked (`single_threaded`).
* It waits for nobody but its child: in flight it writes nothing to the terminal, which may be stopped. What there is to
  be said the next child says.
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
from mavproxy_handover.watchdog_pipe import Lifeline, Told

__all__ = ["ENDS", "Supervisor", "single_threaded"]

#: signals that end all of it
ENDS: Final = (signal.SIGTERM, signal.SIGINT, signal.SIGQUIT)
#: what a terminal does to those who run in it; a companion needs none, so nothing of it counts
_OF_TERMINALS: Final = (signal.SIGHUP, signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU)
_PR_SET_PDEATHSIG: Final = 1
#: waking up that much later than asked for is standing still
_LATE_S: Final = 0.2
#: an internal fault of the child (EX_SOFTWARE)
_FAULT: Final = 70


def single_threaded() -> bool:
    """Whether this process has one thread, as far as the kernel knows it."""
    return len(os.listdir("/proc/self/task")) == 1


class Supervisor:
    """Runs `child` in a process of its own, again and again. It is given the lifeline, and returns the exit code."""

    def __init__(
        self,
        child: Callable[[Lifeline], int],
        limits: Limits,
        manager: ServiceManager | None = None,
        *,
        in_flight: bool = False,
    ) -> None:
        """`manager`: who is told that all is in order; None: nobody is. `in_flight`: see `Watch`."""
        self._child = child
        self._manager = manager or ServiceManager()
        self._limits = limits
        self._watch = Watch(limits, in_flight=in_flight)
        self._pid = 0
        #: signals wake the parent up by this pipe: what is read, what is written
        self._wake: tuple[int, int] = (-1, -1)
        # loaded before any fork
        self._libc = ctypes.CDLL(None, use_errno=True)
        self._terminal = _terminal()

    def run(self) -> int:
        """Until an end that is no death; returns the exit code. To be called in the main thread.

        Raises OSError if not even the first child can be started.
        """
        with self._signals():
            after = self._live(Told())
            while after.told is not None and self._pause(after.at):
                self._manager.replaced(after.told.why)
                try:
                    after = self._live(after.told)
                except OSError:  # no memory for a process, or no number: another try is all that there is
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
        """False: meanwhile somebody wants all of it to end."""
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
        """The life of one child. Raises OSError if there can be none."""
        signs = self._fork(told)
        try:
            return self._attend(signs)
        finally:
            os.close(signs)

    def _fork(self, told: Told) -> int:
        """Returns where its signs are read."""
        reading, writing = os.pipe2(os.O_CLOEXEC)
        os.set_blocking(reading, False)
        parent = os.getpid()
        # a signal to end that comes between fork and the child's own arrangements waits for those
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
        """Never returns."""
        code = _FAULT
        try:
            self._libc.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
            if os.getppid() == parent:  # else it died before it could be tied to us
                signal.set_wakeup_fd(-1)
                signal.signal(signal.SIGCHLD, signal.SIG_DFL)
                for descriptor in (reading, *self._wake):
                    os.close(descriptor)
                self._manager.close()
                code = self._child(Lifeline(writing, told))
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
                watch.heard(data, now)
                if not data:  # closed, by its end for one: that is told by a signal
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
    """What a signal means is read from the pipe."""


def _read(descriptor: int) -> bytes:
    try:
        return os.read(descriptor, 4096)
    except BlockingIOError:
        return b"\0"  # no sign, and not closed either


def _terminal() -> list[Any] | None:
    """How the terminal behaves before somebody reads lines from it; None if there is none."""
    try:
        return termios.tcgetattr(0)
    except (OSError, termios.error):
        return None


def _restore(attributes: list[Any] | None) -> None:
    """A child that was killed while somebody typed has left it without an echo."""
    with suppress(OSError, termios.error):
        if attributes is not None and os.tcgetpgrp(0) == os.getpgrp():  # else somebody else is in front of it
            termios.tcsetattr(0, termios.TCSANOW, attributes)
