# SPDX-License-Identifier: GPL-3.0-or-later

"""The invariants of authority, checked after every single event: the campaign flies under the same eyes."""

from __future__ import annotations

from sitl.campaign.watch import Watch

__all__ = ["Watch"]
