# SPDX-License-Identifier: GPL-3.0-or-later

"""Faults that tests and exploration need not notice, by module of the core, each with the reason."""

from __future__ import annotations

__all__ = ["KNOWN_SURVIVORS"]

KNOWN_SURVIVORS: dict[str, dict[str, str]] = {
    "common.messages": {
        "before: comparison turned: self.epoch < other.epoch": "it is only called for two epochs that differ",
    },
    "common.flight": {
        "__init__: truth turned: False in self._guard_ours = False": (
            "before its first message the guard counts as silent, and whose leases it answers does not matter"
        ),
    },
    "authority.transfer": {
        "move: dropped from and/or: self.forced: self.forced and self.others and (cause in _FALLS_AWAY)": (
            "only a forced transfer has stations in reserve"
        ),
        "_prefer: dropped: self.ready |= {station}": (
            "a partner that was ready goes on to CONNECT at once; it is no partner any more when it falls away"
        ),
    },
    "authority.steps": {
        "__init__: number one more: 0 in self._of = (0, 0)": "before the first line nothing has been told",
        "__init__: number one more: 0 in self._of = (0, 0) (number 2)": "the same",
    },
    "authority.candidates": {
        "could_be_partner: dropped from and/or: not presence.hearing.enough: why is Reason.PARTNER_SILENT and "
        "presence.connected(now) and (not presence.hearing.enough)": (
            "a connected station that counts as silent answers too few questions"
        ),
        "could_be_partner: dropped from and/or: why is not None: why is not None and news": "news have a reason",
        "_keeps: dropped from and/or: presence is not None: presence is not None and presence.station.consent is "
        "StandingConsent.REFUSE": "an owner is one of the stations; the line is for the type checker",
    },
    "authority.zones": {
        "update: dropped from and/or: station in before: station in before and before[station].awaits": (
            "a zone that holds the aircraft had a fact at the position before"
        ),
        "reasons: dropped from and/or: station not in self._inside: station not in self._inside or "
        "station == commander": "a zone that does not hold the aircraft has no time left, and its entry does not count",
        "update: comparison turned: fact.margin_m > known.margin_m": (
            "of two zones of one station with exactly the same margin either is the best"
        ),
        "update: dropped: self._fresh.discard(station)": (
            "a station without a zone is not chosen; if its zone comes back and is entered, it is fresh again"
        ),
        "update: dropped: self._fresh.discard(station) (number 2)": (
            "a station whose zone was left is not chosen; if the zone is entered again, it is fresh again"
        ),
    },
    "authority.transfer_manager": {
        "imply: dropped: return": "it is called only while a transfer is under way; the line is for the type checker",
        "_end: dropped from and/or: not committed: not committed and end.reason in PEOPLES_WORD": (
            "the reason of a commit is no operator's answer"
        ),
    },
    "arbiter": {
        "_on_heard: dropped from and/or: self._authority.lost: self._authority.lost and "
        "station == self._authority.owner": "an owner that was away is lost before its event counts",
        "zone_ends_s: dropped from and/or: owner is not None: owner is not None and zones.holds(owner)": (
            "no zone holds the aircraft for no station; the line is for the type checker"
        ),
        "Identity.nonce: number one more: 1": "any number will do if the edge gives none",
        "_expire: dropped from and/or: authority.owner is not None: "
        "authority.recover_until is not None and now >= authority.recover_until and (authority.owne": (
            "the time to come back is set together with an owner, and while it runs no station commands that could "
            "release; the line is for the type checker"
        ),
        "_judge_safety: dropped from and/or: untold is not None: untold is not None and "
        "untold == executor.tells_at()": "without a return that is to be told nothing is told",
        "_judge: dropped: return self._safety.facts.now(now)": (
            "an order changes no fact that its check uses: none is given while the source of the mode is in doubt"
        ),
        "_grant_parent: dropped from and/or: authority.owner != parent: gone and authority.owner != parent": (
            "a parent that is lost is not heard, so it is not fit; once it is heard it is not lost any more"
        ),
    },
    "safety.return_site": {
        "update: number one more: 0.0 in self.value = self._level_s > 0.0": (
            "it is used only at both ends of the scale, and the upper end is more than 1"
        ),
        "update: dropped from and/or: some: full and some": (
            "with the full reserve left a part of it is left too: `full` does not stay true longer than `some`"
        ),
        "update: dropped from and/or: there: all_the_way and there": (
            "a way that is covered ends at a covered place: `all_the_way` does not stay true longer than `there`"
        ),
        "stays_until: comparison turned: now < since + BETTER_S < inf (number 2)": (
            "inf is also the answer without any station, and it is never the earliest time"
        ),
        "_goes_over: comparison turned: better > counts": "it is compared only if the two standings differ",
    },
    "safety.energy": {
        "made_good: dropped: return MadeGood(speed, self.power_w(airspeed))": (
            "on wings the airspeed of the next line is the same, apart from rounding"
        ),
        "_hanging_wh: comparison turned: vertical_s > 0.0": "no time of climb and descent costs nothing",
        "made_good: comparison turned: across >= airspeed": (
            "with all of the airspeed against the crosswind none is left for the way, and the next line checks that"
        ),
        "_duration_s: comparison turned: length_m < stops * speed_mps ** 2 / acceleration": (
            "on a leg just long enough for its speed both formulas give the same time"
        ),
    },
    "safety.learning": {
        "_learn_power: dropped from and/or: not isfinite(watts): watts is None or not isfinite(watts) or "
        "(not 0.0 < watts <= _MOST_W)": "what is no number, or infinite, is in no range",
        "value: comparison turned: self._sign > 0": "it is 1 or -1",
        "_power_level: number one more: 1 in return _Level(configured_w, LEAST_PART * configured_w, inf, 1)": (
            "any number above 0 will do"
        ),
        "__init__: number one more: 1 in self._airspeed = _Level(prior.airspeed_mps, "
        "LEAST_PART * prior.airspeed_mps, most, -1)": "any number below 0 will do",
        "__init__: number one more: 0.0 in self._last_wind = (0.0, -inf)": "it is too long ago to count",
        "wind_seen: dropped from and/or: isfinite(speed_mps): isfinite(speed_mps) and isfinite(from_deg)": (
            "a speed that is no number, or infinite, is in no range"
        ),
        "wind_seen: comparison turned: 0.0 < speed_mps <= _MOST_WIND_MPS (number 2)": (
            "with the correction for what it reads low, such a wind is too strong to count"
        ),
    },
    "safety.energy_prior": {
        "unloaded_part: dropped from and/or: not self.mass_kg: not self.payload_kg or not self.mass_kg or "
        "self.payload_wrong": "without a mass the payload is wrong; the line is for the type checker",
    },
    "safety.battery": {
        "_REST: dropped: (3.73, 0.2)": "it lies on the line between its neighbours",
        "_REST: dropped: (4.11, 0.9)": "the same",
        "__init__: number one more: 0 in self._falls = 0": "the first report sets it",
        "rest_part: number one more: 2.0 in above = bisect_right(_REST, (cell_v, 2.0))": (
            "any number above every part will do"
        ),
        "bounded: dropped from and/or: isfinite(value): value is not None and isfinite(value) and "
        "(low <= value <= high)": "what is no number, or infinite, is in no range",
        "add_report: number one more: 0.0 in since_s = 0.0 if self.heard_at is None else "
        "max(0.0, now - self.heard_at)": "before the first report nothing is known that time could change",
        "add_report: dropped from and/or: 0.0: report.current_a or 0.0": "a power has a current",
        "add_report: number one more: 0.0 in not on_ground and report.power_w is not None and "
        "((report.current_a or 0.0) >= _REST_A)": "one ampere is no load either",
        "left_wh: dropped from and/or: self.heard_at is None: self._left_wh is None or self.heard_at is None": (
            "what is left is known from a report or from the run before; the line is for the type checker"
        ),
        "_count: dropped from and/or: begins is not None: on_ground and begins is not None": (
            "a counter that went back is there, and says what was drawn"
        ),
        "_steps: number one more: 1.0 in ohm = None if memory.ohm is None else "
        "int(memory.ohm / (_KEPT_OHM_A_CELL * (self._cells or": (
            "without a number of cells no resistance is found, so it does not change"
        ),
        "_rest: dropped: return (number 2)": "a current at rest is no load",
        "_rest: number one more: 1.0 in most = min(1.0, rest_part(volts / self._cells) + DOUBT) * self._full_wh": (
            "more than the whole pack limits nothing"
        ),
        "_rest: dropped from and/or: self._rest_v is not None: rested and self._rest_v is not None and "
        "(amperes is not None) and (amperes >= _LOAD_A)": ("both are set together; the line is for the type checker"),
    },
    "safety.strategy": {
        "decide: dropped from and/or: held_back: held_back or fact": (
            "all actions that are held back at one moment are so for the same fact: the facts are checked in one "
            "order, and LANDING, which holds back most, before RETURNING"
        ),
        "decide: dropped from and/or: best.withheld: best.withheld or held_back": (
            "the fact that withholds the best action is the fact that holds back the others"
        ),
        "judge: dropped from and/or: found is not None: found is not None and lasts is not None and "
        "(lasts.cause in causes) and (found.action < la": (
            "without a cause nothing is decided and nothing lasts; the line is for the type checker"
        ),
        "judge: dropped from and/or: lasts.action is FlightAction.LAND: lasts.action is FlightAction.LAND or "
        "Fact.PLACE in facts or found.action in _GOES_ON": (
            "an aircraft that lands and cannot go elsewhere lands for the same cause, decided again or not"
        ),
    },
    "safety.emergency": {
        "judge: dropped from and/or: self._left: self._left and Fact.FLYING in facts": (
            "without causes of the run before nothing is resumed"
        ),
    },
    "authority.presence": {
        "unfit: dropped from and/or: self.answer is None: not self.connected(now) or self.answer is None or "
        "(not self.hearing.enough)": (
            "a connected station has answered: both are set together; the line is for the type checker"
        ),
    },
    "authority.hearing": {
        "_measure: comparison turned: lasts_s > 0.0": "no time adds nothing",
        "_measure: comparison turned: at <= since": "the question before it ends in that moment: it adds no time",
        "asked: comparison turned: self._fates[0][0] < oldest": "a question exactly so old counts for no time",
        "answered: dropped from and/or: self.barred: self.barred and now - self._good_since >= self._back_s": (
            "a station that is not barred is not on its way back"
        ),
        "judge: dropped from and/or: share is not None: known and share is not None and "
        "(share < limits.deaf_share) and (not self.barred)": (
            "questions for so long have a share; the line is for the type checker"
        ),
        "_back_s: number one more: 10 in longer = _GROWTH ** max(0, min(self.losses, 10) - 1)": (
            "the longest time is reached before that"
        ),
        "trust: dropped: self.begin()": "what is put in its place covers the time that counts, and is looked at first",
        "trust: number one more: 1 in count = int((self._window_s + self._limits.answer_s) / pause_s) + 1": (
            "one more question, too old to count"
        ),
    },
    "authority.coverage": {
        "attacked: dropped from and/or: owner is not None: owner is not None and "
        "self._candidates.links.attacked(owner)": "no sender signs in the name of no station",
        "successor_awaited: dropped: return False": (
            "an owner that may still come back is lost until then, and a forced transfer ends when the owner is back"
        ),
        "_asked: truth turned: True in return (None, True, True)": "without a partner no station is the partner",
        "_asked: truth turned: True in return (None, True, True) (number 2)": "the same",
        "successor_awaited: dropped from and/or: transfer.forced: transfer is not None and transfer.forced and "
        "(not transfer.hurry_over) and hurried": "after the loss every transfer under way is forced",
    },
    "authority.foresight": {
        "_may_ask: dropped from and/or: authority.owner is not None: flown and authority.owner is not None and "
        "(not authority.lost)": "without an owner no border is expected, and a known one ends",
        "_update: dropped from and/or: not ahead.reached: holds and (not ahead.reached) and "
        "(now >= ahead.at - self._limits.exit_soon_s)": "a border that is reached is noted as reached once more",
        "speak: dropped from and/or: ahead is None: ahead is None or now < self._say_at": (
            "without a border nothing is due at any time; the line is for the type checker"
        ),
    },
    "safety.hold_timer": {
        "__init__: truth turned: False in self._used_up = False": "the first look sets it, and it is not used before",
    },
    "safety.decision_facts": {
        "__init__: truth turned: False in self._may_hold = False": "the first look sets it, and it is not used before",
        "__init__: truth turned: False in self._in_gap = False": "the same",
    },
    "safety.safety": {
        "held_since: dropped from and/or: self.executor.held_for is not None: self.verification.stands or "
        "self.executor.held_for is not None": "an aircraft that an order holds stands by that order",
    },
    "safety.decision_executor": {
        "held_for: dropped: return None": (
            "a told decision that is no hold has cleared the cause of the hold: `carry_out` did, or a new mode"
        ),
        "held_for: dropped from and/or: not (told.action is FlightAction.HOLD or self._onl: told is None or not "
        "(told.action is FlightAction.HOLD or self._only_waits(self._emergency.": "the same",
        "_only_waits: dropped from and/or: decision.action is not FlightAction.WARN: "
        "decision is None or decision.action is not FlightAction.WARN": (
            "a decision that is held back is told as a warning"
        ),
        "carry_out: dropped from and/or: news.resumes: news.resumes or (news.mends and stands)": (
            "a held aircraft stands by its order; or another source has it, and the order under way is over either way"
        ),
        "carry_out: dropped from and/or: news.resumes: news.resumes or (news.mends and stands) (number 2)": (
            "a held aircraft stands by its order, unless another source has it, and that case comes first"
        ),
        "place_seen: dropped from and/or: place is not None: "
        "returns and told is not None and (place is not None) and (place.name != self._told_place)": (
            "it is called after a return site has been judged; the line is for the type checker"
        ),
        "_changed: dropped from and/or: ended is not None: ended is not None or waits": (
            "a decision that has ended and was told as no order lets the aircraft go on: there is nothing to overrule"
        ),
        "_changed: dropped from and/or: told.action in OVERRULED: "
        "told.action in OVERRULED or told.withheld in OVERRULE": (
            "a decision told as an order is commanded, and the end of that command is checked already"
        ),
        "carry_out: dropped from and/or: stands: news.mends and stands": (
            "an aircraft that was not held has nothing to go on from: the order under way is over either way"
        ),
        "carry_out: dropped from and/or: decision is not None: "
        "decision is not None and (not news.warning) and (not news.continues)": (
            "without a decision there is at most a warning; the line is for the type checker"
        ),
        "rehearsal_over: dropped: self._tells_at = None": (
            "the told decision counts as no return any more in that moment, so none is told after it"
        ),
        "place_seen: dropped from and/or: told is not None: "
        "returns and told is not None and (place is not None) and (place.name != self._told_place)": (
            "the aircraft returns, so a decision was told; the line is for the type checker"
        ),
        "tell_return: dropped from and/or: told is not None: told is not None and told.action is FlightAction.RETURN": (
            "a return that is to be told has been decided; the line is for the type checker"
        ),
    },
    "safety.mode_source": {
        "__init__: truth turned: False in self._overtaken = False": "a command of the commander sets it first",
        "__init__: truth turned: False in self._flying = False": "before the first mode there is none to differ from",
        "__init__: truth turned: False in self._unheard = False": (
            "it is used only while a mode is in doubt, and the doubt sets it"
        ),
        "resolve_doubt: dropped: self._since, self._unheard = (-inf, False)": (
            "both are used only while a mode is in doubt, and the doubt sets them"
        ),
        "resolve_doubt: truth turned: False in self.chosen_by, self._since, self._unheard = "
        "(ModeSource.GUARD, -inf, False)": ("it is used only while a mode is in doubt, and the doubt sets it"),
        "resolve_doubt: truth turned: False in self._since, self._unheard = (-inf, False)": (
            "it is used only while a mode is in doubt, and the doubt sets it"
        ),
    },
    "safety.command_verification": {
        "__init__: truth turned: False in self._refused = False": "it is not used before an order, which sets it",
        "__init__: number one more: 0 in self._tries = 0": "it is not used before an order, which sets it",
        "__init__: truth turned: False in self._shown = False": "it is not used before an order, which sets it",
        "__init__: number one more: 0.0 in self._first_speed = 0.0": "it is not used before an order, which sets it",
        "__init__: truth turned: False in self._excused = False": "it is not used before an order, which sets it",
        "_goes_on: number one more: 0 in self._tries = 0": (
            "the number of orders to go on is not used: they have no limit, and no pilot gives them back"
        ),
        "_goes_on: dropped: self._tries = 0": "the same",
        "go_on: number one more: 1 in self._begin(FlightAction.CONTINUE, 1, now)": "the same",
        "sent_on: number one more: 1 in self._begin(FlightAction.CONTINUE, 1, now)": "the same",
        "verify: number one more: 1 in self._begin(order, self._tries + 1, now)": (
            "an order that was interrupted had one try at least, so this is its last one either way"
        ),
        "_moves: dropped from and/or: not self._excused: was_excused and (not self._excused)": (
            "no time runs while it is excused, so it may begin again at every look"
        ),
    },
    "safety.route": {
        "side: comparison turned: self.cross_track_m > 0": "at 0 the aircraft is on the leg",
        "add_sample: dropped from and/or: within: within and self._within": (
            "the time counted so is not used, and the next value clears it"
        ),
        "add_sample: dropped from and/or: beyond: beyond and self._beyond_s >= self._limits.off_hold_s": (
            "it grows only with a value beyond the limit, and then it is over its time at once"
        ),
        "add_sample: dropped from and/or: within: within and self._within_s >= self._limits.off_clear_s": (
            "without a value well within the limit it is 0"
        ),
        "_words: dropped from and/or: fact.course_off_deg is None: "
        "self._distance.over or fact.course_off_deg is None": (
            "a course beyond its limit has just been compared; the line is for the type checker"
        ),
    },
    "safety.commands": {
        "rule: dropped from and/or: asked.named is not None: insists and asked.named is not None": (
            "a name that is no limit lifts nothing; the line is for the type checker"
        ),
    },
    "station.core": {
        "_on_wish_answered: dropped from and/or: now < self._wished_until: answer.station == self._station.sysid and "
        "now < self._wished_until": "a request that is too old counts for nothing, accepted or not",
        "_on_wish_answered: comparison turned: now < self._wished_until": "the same",
        "_send_readiness: dropped from and/or: part is not None: consent is Consent.GRANTED and part is not None and "
        "(part.key == key) and (not part.ready)": "the consent is that of the present part; the line is for the type "
        "checker",
        "_send_readiness: dropped from and/or: part.key == key: consent is Consent.GRANTED and part is not None and "
        "(part.key == key) and (not part.ready)": "the same",
        "__init__: truth turned: False in self._wish_accepted = False": "a request sets it before it is used",
        "_update_authority: dropped from and/or: self._part.as_partner: self._part is not None and "
        "self._part.as_partner and self._part.forced": "only a partner is asked by force",
        "__init__: number one more: 0 in self._why, self._crossing = (Reason.NONE, 0)": (
            "it is used only for the transfer that the vehicle has announced, and the announcement sets it"
        ),
        "_announced_reason: number one more: 0 in return (self._why, self._crossing) if key == self._announced "
        "else (Reason.NONE, 0)": (
            "in a transfer that is not announced this station has its part already, so the border is not used"
        ),
    },
}
