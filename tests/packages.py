# SPDX-License-Identifier: GPL-3.0-or-later

"""Where tests find mission packages: those that the product ships, and `round`, which is for tests alone."""

from __future__ import annotations

from pathlib import Path
from typing import Final

__all__ = ["MISSIONS", "ROUND"]

#: the folder of the shipped mission packages
MISSIONS: Final = Path(__file__).resolve().parents[1] / "missions"
#: a package with known numbers, which stays as it is; its README says more. It is named "delivery"
ROUND: Final = Path(__file__).resolve().parent / "data" / "missions" / "round"
