# SPDX-License-Identifier: GPL-3.0-or-later

"""Three faults in the judgement of the downlink, found by flights in which only downlinks fail:
`plant_in_strategy --downlink`."""

from __future__ import annotations

from tests.sitl.plant_in_strategy import Planted

__all__ = ["PLANTED_IN_HEARING"]

PLANTED_IN_HEARING = (
    # One answer in ten seconds keeps a station in command that hears 4 % of the aircraft.
    Planted(
        "one lucky answer lifts deafness",
        "authority/hearing.py",
        "bars = known and share is not None and share < limits.deaf_share and not self.barred",
        "bars = known and share is not None and share <= 0.0 and not self.barred",
    ),
    # The share is measured and told, and the commander stays.
    Planted(
        "a commander that is deaf is not lost",
        "authority/presence.py",
        "return min(mute_at, self.hearing.barred_at)",
        "return mute_at",
    ),
    # The first answer brings a deaf commander back, and the next pause loses it again.
    Planted(
        "a deaf commander is back at its first answer",
        "authority/hearing.py",
        "if self.barred and now - self._good_since >= self._back_s:",
        "if self.barred:",
    ),
)
