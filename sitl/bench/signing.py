# SPDX-License-Identifier: GPL-3.0-or-later

"""Whether the companion can be run with signing on, and the key that all stations of a measurement share."""

from __future__ import annotations

from importlib.util import find_spec

__all__ = ["KEY", "why_not"]

#: of measurements only; nothing but loopback ever sees it
KEY = bytes(range(32))


def why_not() -> str:
    """Why signing cannot be measured with this version; empty if it can."""
    if find_spec("mavproxy_handover.wire.signing") is None:
        return "this version has no signing"
    return "the companion of this version takes no keys yet"
