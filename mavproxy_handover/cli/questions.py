# SPDX-License-Identifier: GPL-3.0-or-later

"""Questions to the user at a terminal. In a pipe or for a program nothing is asked: all missing options are listed."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

__all__ = ["Questions", "at_terminal"]

_T = TypeVar("_T")


def at_terminal() -> bool:
    """True if a person can be asked."""
    return sys.stdin.isatty() and sys.stdout.isatty()


@dataclass(slots=True)
class Questions:
    """Asks, or notes what is missing. `ask`: reads one line after a prompt; None: no person can be asked."""

    ask: Callable[[str], str] | None
    #: options that were needed and not given, each with its meaning
    missing: list[str] = field(default_factory=list)

    def need(self, option: str, meaning: str, parse: Callable[[str], _T], proposal: str = "") -> _T | None:
        """A value without which nothing can be written. None: it is missing, and noted."""
        if self.ask is None:
            self.missing.append(f"{option}: {meaning}")
            return None
        return self._asked(meaning, parse, proposal)

    def offer(self, meaning: str, parse: Callable[[str], _T], proposal: str) -> _T:
        """A value that has a proposal. `parse` takes the proposal. It is asked only at a terminal."""
        return parse(proposal) if self.ask is None else self._asked(meaning, parse, proposal)

    def _asked(self, meaning: str, parse: Callable[[str], _T], proposal: str) -> _T:
        assert self.ask is not None
        shown = f" [{proposal}]" if proposal else ""
        while True:
            answer = self.ask(f"{meaning}{shown}: ").strip() or proposal
            try:
                return parse(answer)
            except ValueError as error:
                print(f"  {error}")
