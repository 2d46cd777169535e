# SPDX-License-Identifier: GPL-3.0-or-later

"""Ten more faults to be planted under the campaign, by people who had not read it: `plant_in_strategy --by-others`.

They were chosen by reading the rules and what is known of the aircraft, not the campaign nor the ten of
`plant_in_strategy.py`, and were written down before any campaign was flown over them. Each is a slip that a competent
reader may pass over, in a file of its own, and above each stands whom it hurts, and in what flight.
"""

from __future__ import annotations

from tests.sitl.plant_in_strategy import Planted

__all__ = ["PLANTED_BY_OTHERS"]

PLANTED_BY_OTHERS = (
    # "What returns is safe already": a place that wind or battery put out of reach on the way there is flown to all the
    # same, and so is one that it is blown away from. It comes down where the battery ends.
    Planted(
        "a return is never given up for a landing",
        "safety/strategy.py",
        "OVERRULE: Final = (Fact.PILOT, Fact.FAILSAFE)",
        "OVERRULE: Final = (Fact.PILOT, Fact.FAILSAFE, Fact.RETURNING)",
    ),
    # "Not held any more" is also who is to return now: the aircraft that stood at the end of its coverage is sent on
    # over that border, in place of home, and what was told is not told again.
    Planted(
        "what was held and is to return is sent on",
        "safety/emergency.py",
        "return decision.action < FlightAction.HOLD and decision.held_back is None",
        "return decision.action is not FlightAction.HOLD and decision.held_back is None",
    ),
    # The wrong one of two: a partner that answers and does not take the aircraft, because its operator thinks, counts
    # as coverage behind the border. The aircraft flies over it under a commander whose zone has ended.
    Planted(
        "who answers is taken for who takes the aircraft",
        "authority/coverage.py",
        "partner, _answers, quick = self._asked(now)",
        "partner, quick, _answers = self._asked(now)",
    ),
    # A ratio upside down: what has become worse is to be so for 160 s before it counts, not for 2.5 s. A place that has
    # come out of reach, or out of the fence, is returned to while another one is there.
    Planted(
        "a place that is worse counts as what it was for minutes",
        "safety/return_site.py",
        "-passed_s * BETTER_S / WORSE_S",
        "-passed_s * WORSE_S / BETTER_S",
    ),
    # Each try counts as the first: a return that the autopilot refuses is commanded for ever, and nobody lands.
    Planted(
        "a command that is refused is never given up",
        "safety/command_verification.py",
        "self._begin(action, self._tries + 1, now)",
        "self._begin(action, 1, now)",
    ),
    # A comparison turned round: the companion's own RTL is not noted as its own. It is read as a pilot's or a
    # failsafe's, who must not be overruled: no landing follows a return that does not succeed, and a mode that a
    # stranger chooses stays.
    Planted(
        "the companion does not know its own order",
        "safety/decision_executor.py",
        "if action in _SAME:",
        "if action not in _SAME:",
    ),
    # Where the wind comes from and where it blows to: the way home against it is reckoned as one with it behind, so the
    # aircraft turns back too late, or for the place that it does not reach.
    Planted(
        "the wind comes from where it blows to",
        "safety/energy.py",
        "angle = radians(self.from_deg - bearing_deg)",
        "angle = radians(self.from_deg + 180.0 - bearing_deg)",
    ),
    # A timer that each position begins anew: the limit that the mission declares for a gap never runs out, and who is
    # held up in it stays there alone.
    Planted(
        "the time in a gap begins anew with every position",
        "safety/gap.py",
        "if self.since is None and self.gap is not None and not self.gap.ahead:",
        "if self.gap is not None and not self.gap.ahead:",
    ),
    # The wrong quantity: heard is not the same as proven both ways with the same mission. A station that hears nothing,
    # or has another mission, counts as coverage that no transfer goes to: the aircraft flies out of the zone that it is
    # commanded from, and nothing is done.
    Planted(
        "a station that is heard counts as one that could take the aircraft",
        "authority/candidates.py",
        "            and self.unfit(station, now) is None\n            and self.paused_s",
        "            and self._presence[station].alive(now)\n            and self.paused_s",
    ),
    # A timer that each repeated answer begins anew: an operator who is asked and never answers keeps the transfer open,
    # and with it every other one, while the aircraft leaves its commander's zone.
    Planted(
        "an operator who is asked has no end of time",
        "authority/transfer.py",
        "        if not self.operator_asked:\n            self.operator_asked = True\n"
        "            if not self.forced:  # a forced transfer keeps its time limit, see `_run_out`\n    ",
        "        self.operator_asked = True\n        if not self.forced:\n",
    ),
)
