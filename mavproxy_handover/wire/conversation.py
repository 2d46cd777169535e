# SPDX-License-Identifier: GPL-3.0-or-later

"""Conversations with the autopilot as generators: ask, wait for the answer, ask the next question.

A conversation is a generator, an `Asking`. It yields an `Ask`: messages to send, a test for the answer, a time-out and
a number of attempts. The yield returns the answer or raises `NoAnswer`. `Conversation` runs one generator, and
`Conversations` holds the running ones by name. No clock and no I/O here: messages and time are arguments.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import handover as mavlink

__all__ = [
    "Ask",
    "Asking",
    "AutopilotError",
    "Conversation",
    "Conversations",
    "Done",
    "NoAnswer",
    "RefusedError",
    "command_long",
]


class NoAnswer(Exception):
    """The autopilot did not answer; the text says what was asked."""


class AutopilotError(NoAnswer):
    """The autopilot answered, and the answer is no; the text says what and why."""


class RefusedError(AutopilotError):
    """The autopilot refuses a command: it will not be done, and there is nothing to wait for."""


@dataclass(frozen=True, slots=True)
class Ask:
    """One question. `answer` returns something other than None for the message that answers it."""

    what: str
    messages: tuple[Any, ...]
    answer: Callable[[Any], Any]
    timeout_s: float = 1.0
    tries: int = 5


Asking = Generator[Ask, Any, Any]


class Conversation:
    """Runs one `Asking`. `send` sends a message to the autopilot."""

    def __init__(self, asking: Asking, send: Callable[[Any], None], now: float) -> None:
        self._asking = asking
        self._send = send
        self._ask: Ask | None = None
        self._tries = 0
        self._again_at = now
        self.finished = False
        #: return value of the generator
        self.result: Any = None
        #: why it failed, None if it did not
        self.failure: str | None = None
        #: the exception of the failure; None if it was ended from outside
        self.error: NoAnswer | None = None
        self._go_on(lambda: next(asking), now)

    def _go_on(self, step: Callable[[], Ask], now: float) -> None:
        try:
            self._ask = step()
        except StopIteration as stop:
            self._ask, self.finished, self.result = None, True, stop.value
            return
        except NoAnswer as error:
            self._ask, self.finished, self.failure, self.error = None, True, str(error), error
            return
        self._tries = 0
        self._put(now)

    def _put(self, now: float) -> None:
        assert self._ask is not None
        self._tries += 1
        self._again_at = now + self._ask.timeout_s
        for message in self._ask.messages:
            self._send(message)

    @property
    def copies(self) -> int:
        """How often the current question was sent; 0 if no question waits for its answer."""
        return self._tries if self._ask is not None and self._ask.messages else 0

    def break_off(self, why: str) -> None:
        """End the conversation from outside, as failed because of `why`."""
        if not self.finished:
            self._ask, self.finished, self.failure = None, True, why

    def on_message(self, message: Any, now: float) -> None:
        """A message of the autopilot."""
        if self._ask is None:
            return
        answer = self._ask.answer(message)
        if answer is not None:
            self._go_on(lambda: self._asking.send(answer), now)

    def tick(self, now: float) -> None:
        """Time has passed."""
        if self._ask is None or now < self._again_at:
            return
        if self._tries < self._ask.tries:
            self._put(now)
            return
        error = NoAnswer(f"no answer to {self._ask.what}")
        self._go_on(lambda: self._asking.throw(error), now)


#: called with the finished conversation and the time
Done = Callable[[Conversation, float], None]


class Conversations:
    """The running conversations by name. An exception ends only its own conversation.

    `send` sends a message to the autopilot, `fault` gets the exceptions.
    """

    def __init__(self, send: Callable[[Any], None], fault: Callable[[str, str], None]) -> None:
        self._send = send
        self._fault = fault
        self._running: dict[str, tuple[Conversation, Done]] = {}

    def __len__(self) -> int:
        return len(self._running)

    def __contains__(self, name: str) -> bool:
        return name in self._running

    def begin(self, name: str, asking: Asking, done: Done, now: float) -> None:
        """Start a conversation. It replaces a running one of the same name."""
        self._running[name] = (Conversation(asking, self._send, now), done)

    def drop(self, name: str) -> bool:
        """Stop a conversation without calling its `done`. Returns True if it was running."""
        return self._running.pop(name, None) is not None

    def break_off(self, name: str, why: str) -> None:
        """End a conversation as failed because of `why`, if it is running. `tick` calls its `done`."""
        if name in self._running:
            self._running[name][0].break_off(why)

    def on_message(self, message: Any, now: float) -> None:
        """A message of the autopilot."""
        self._each(lambda talk: talk.on_message(message, now))

    def tick(self, now: float) -> None:
        """Time has passed: repeat questions, and finish what has ended."""
        self._each(lambda talk: talk.tick(now))
        for name, (talk, done) in list(self._running.items()):
            if talk.finished and name in self._running and self._running[name][0] is talk:
                del self._running[name]
                try:
                    done(talk, now)
                except Exception:
                    self._fault(f"end of conversation {name}", traceback.format_exc(limit=-3))

    def _each(self, step: Callable[[Conversation], None]) -> None:
        for name, (talk, _done) in list(self._running.items()):
            try:
                step(talk)
            except Exception as error:
                self._fault(f"conversation {name}", traceback.format_exc(limit=-3))
                talk.break_off(f"internal fault: {error}")


def command_long(target: tuple[int, int], command: int, *parameters: float) -> mavlink.MAVLink_message:
    """COMMAND_LONG to `target` (system, component); parameters that are not given are 0."""
    return mavlink.MAVLink_command_long_message(*target, command, 0, *parameters, *[0.0] * (7 - len(parameters)))
