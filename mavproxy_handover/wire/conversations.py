# SPDX-License-Identifier: GPL-3.0-or-later

"""The conversations with the autopilot that are going on, each by its name; what breaks in one ends that one."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from typing import Any

from mavproxy_handover.wire.conversation import Conversation, Dialogue

__all__ = ["Conversations", "Done"]

#: called with the finished dialogue and the time
Done = Callable[[Dialogue, float], None]


class Conversations:
    """`send` puts a message on its way to the autopilot, `fault` is told what broke."""

    def __init__(self, send: Callable[[Any], None], fault: Callable[[str, str], None]) -> None:
        self._send = send
        self._fault = fault
        self._running: dict[str, tuple[Dialogue, Done]] = {}

    def __len__(self) -> int:
        return len(self._running)

    def __contains__(self, name: str) -> bool:
        return name in self._running

    def begin(self, name: str, conversation: Conversation, done: Done, now: float) -> None:
        """Start a conversation; one of the same name that is still going on is dropped."""
        self._running[name] = (Dialogue(conversation, self._send, now), done)

    def drop(self, name: str) -> bool:
        """Give one up; whether it was going on. Its `done` is not called."""
        return self._running.pop(name, None) is not None

    def on_message(self, message: Any, now: float) -> None:
        """A message of the autopilot."""
        self._each(lambda dialogue: dialogue.on_message(message, now))

    def tick(self, now: float) -> None:
        """Time has passed: asks again, and concludes what has come to an end."""
        self._each(lambda dialogue: dialogue.tick(now))
        for name, (dialogue, done) in list(self._running.items()):
            if dialogue.finished and name in self._running and self._running[name][0] is dialogue:
                del self._running[name]
                try:
                    done(dialogue, now)
                except Exception:
                    self._fault(f"end of conversation {name}", traceback.format_exc(limit=-3))

    def _each(self, step: Callable[[Dialogue], None]) -> None:
        for name, (dialogue, _done) in list(self._running.items()):
            try:
                step(dialogue)
            except Exception as error:
                self._fault(f"conversation {name}", traceback.format_exc(limit=-3))
                dialogue.break_off(f"internal fault: {error}")
