# SPDX-License-Identifier: GPL-3.0-or-later

"""Where the files that ship lie: missions and the guard, in a checkout beside the package, installed inside it."""

from __future__ import annotations

from pathlib import Path

__all__ = ["DEPLOY", "shipped"]

_PACKAGE = Path(__file__).resolve().parent
#: samples of configuration files
DEPLOY = _PACKAGE / "deploy"


def shipped(name: str) -> Path:
    """The folder `name` ("missions", "ardupilot_lua")."""
    installed = _PACKAGE / "data" / name
    return installed if installed.is_dir() else _PACKAGE.parent / name
