# SPDX-License-Identifier: GPL-3.0-or-later

"""Makes the dialect importable as `pymavlink.dialects.v20.handover`, the name under which pymavlink looks for it.

Python imports this module when it starts, because `handover_dialect.pth` beside it says so. It must stay small: every
Python program of the environment pays for it. The dialect itself is `mavproxy_handover/data/dialect/handover.py`; it
is read when a program imports it. No file of ours lies in a folder of pymavlink.
"""

from __future__ import annotations

import sys

TYPE_CHECKING = False  # what typing has under this name, without an import of typing
if TYPE_CHECKING:
    from collections.abc import Sequence
    from importlib.machinery import ModuleSpec
    from types import ModuleType

NAME = "pymavlink.dialects.v20.handover"


class DialectFinder:
    """Finds the module `NAME` for Python's import system, and no other module."""

    @classmethod
    def find_spec(cls, name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> ModuleSpec | None:
        """The module's specification, or None for every other name. See `importlib.abc.MetaPathFinder.find_spec`."""
        if name != NAME:
            return None
        from importlib.util import spec_from_file_location
        from os.path import dirname, join

        file = join(dirname(__file__), "mavproxy_handover", "data", "dialect", "handover.py")
        return spec_from_file_location(name, file)


if DialectFinder not in sys.meta_path:
    sys.meta_path.insert(0, DialectFinder)  # before a file that an older version left in pymavlink's folder
