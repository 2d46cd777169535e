# SPDX-License-Identifier: GPL-3.0-or-later

"""How a helper process of a run is told to end.

Its standard input ends, SIGTERM comes, or both at any moment. A handler that raises could raise anywhere, also during
the work at the end. This one only makes a descriptor readable, for the `select` in which the process waits.
"""

from __future__ import annotations

import os
import signal
from types import FrameType

__all__ = ["Orders"]


class Orders:
    """Lines typed to the process, and the order to end. Made in the main thread, once."""

    def __init__(self, typed: int = 0) -> None:
        """`typed`: descriptor of what is typed, standard input. SIGTERM is taken from here on."""
        self._typed = typed
        self._asked, self._ask = os.pipe()
        os.set_blocking(self._ask, False)
        self._waiting = b""
        signal.signal(signal.SIGTERM, self._on_signal)

    @property
    def descriptors(self) -> list[int]:
        """Descriptors for `select`; when one is readable, call `read`."""
        return [self._typed, self._asked]

    def read(self, readable: int) -> list[str] | None:
        """The lines that are whole by now, from a descriptor that is readable; None: end."""
        data = b"" if readable == self._asked else os.read(self._typed, 4096)
        if not data:
            return None
        *lines, self._waiting = (self._waiting + data).split(b"\n")
        return [line.decode("utf-8", "replace") for line in lines]

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        try:
            os.write(self._ask, b"\0")
        except BlockingIOError:  # asked so often that once more says nothing
            pass
