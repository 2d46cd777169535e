# SPDX-License-Identifier: GPL-3.0-or-later

"""Paths of the files that are shipped with the code: missions, the guard's script, pip's constraints, sample files.

In a checkout they are beside the package, in an installation inside it. Sample configurations (`DEPLOY`) are always
inside it.
"""

from __future__ import annotations

from pathlib import Path

__all__ = ["DEPLOY", "shipped"]

_PACKAGE = Path(__file__).resolve().parents[1]
#: samples of configuration files
DEPLOY = _PACKAGE / "deploy"


def shipped(name: str) -> Path:
    """The folder ("missions", "ardupilot_lua") or file ("constraints.txt") of that name."""
    installed = _PACKAGE / "data" / name
    return installed if installed.exists() else _PACKAGE.parent / name
