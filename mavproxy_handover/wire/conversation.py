# SPDX-License-Identifier: GPL-3.0-or-later

"""Conversations with the autopilot, written down as they go: ask, wait for the answer, ask the next.

A conversation is a generator. It yields an `Ask`: messages to send, what counts as the answer, how long to wait and how
often to ask again. It gets the answer back as the value of the yield, or `NoAnswer` is raised at that line. No clock
and no I/O here: `Dialogue` is handed messages and the time.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any

__all__ = ["Ask", "Conversation", "Dialogue", "NoAnswer"]


class NoAnswer(Exception):
    """The autopilot did not answer; the text says what was asked."""


@dataclass(frozen=True, slots=True)
class Ask:
    """One question. `answer` returns something other than None for the message that answers it."""

    what: str
    messages: tuple[Any, ...]
    answer: Callable[[Any], Any]
    timeout_s: float = 1.0
    tries: int = 5


Conversation = Generator[Ask, Any, Any]


class Dialogue:
    """Runs one conversation. `send` puts a message on its way to the autopilot."""

    def __init__(self, conversation: Conversation, send: Callable[[Any], None], now: float) -> None:
        self._conversation = conversation
        self._send = send
        self._ask: Ask | None = None
        self._tries = 0
        self._again_at = now
        self.finished = False
        #: what the conversation returned
        self.result: Any = None
        #: why it broke off, None if it did not
        self.failure: str | None = None
        self._go_on(lambda: next(conversation), now)

    def _go_on(self, step: Callable[[], Ask], now: float) -> None:
        try:
            self._ask = step()
        except StopIteration as stop:
            self._ask, self.finished, self.result = None, True, stop.value
            return
        except NoAnswer as error:
            self._ask, self.finished, self.failure = None, True, str(error)
            return
        self._tries = 0
        self._put(now)

    def _put(self, now: float) -> None:
        assert self._ask is not None
        self._tries += 1
        self._again_at = now + self._ask.timeout_s
        for message in self._ask.messages:
            self._send(message)

    def break_off(self, why: str) -> None:
        """End the conversation from outside; it failed because of `why`."""
        if not self.finished:
            self._ask, self.finished, self.failure = None, True, why

    def on_message(self, message: Any, now: float) -> None:
        """A message of the autopilot."""
        if self._ask is None:
            return
        answer = self._ask.answer(message)
        if answer is not None:
            self._go_on(lambda: self._conversation.send(answer), now)

    def tick(self, now: float) -> None:
        """Time has passed."""
        if self._ask is None or now < self._again_at:
            return
        if self._tries < self._ask.tries:
            self._put(now)
            return
        error = NoAnswer(f"no answer to {self._ask.what}")
        self._go_on(lambda: self._conversation.throw(error), now)
