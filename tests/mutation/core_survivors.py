# SPDX-License-Identifier: GPL-3.0-or-later

"""Faults that tests and exploration need not notice, by module of the core, each with the reason."""

from __future__ import annotations

__all__ = ["KNOWN_SURVIVORS"]

KNOWN_SURVIVORS: dict[str, dict[str, str]] = {
    "common.model": {
        "AuthorityView.armed: truth turned: False": "no view of the vehicle leaves it out; only tests do",
    },
    "common.messages": {
        "before: comparison turned: self.epoch < other.epoch": "it is asked only of two epochs that differ",
    },
    "common.flight": {
        "__init__: truth turned: False in self._guard_ours = False": (
            "until the guard has spoken it is silent, and then it does not matter whose leases it answers"
        ),
    },
    "authority.zones": {
        "update: comparison turned: fact.margin_m > known.margin_m": (
            "of two zones of one station with exactly the same distance to the border either is the best"
        ),
        "update: dropped: self._fresh.discard(station)": (
            "a station without a zone is not chosen, and whose zone comes back and is entered is fresh again"
        ),
        "update: dropped: self._fresh.discard(station) (number 2)": (
            "whose zone is left is not chosen, and whose zone is entered again is fresh again"
        ),
    },
    "authority.transfer_manager": {
        "begin: truth turned: False in self, partner: int, reason: Reason, now: float, actions: list[Action], *, "
        "consented: bool=": "who leaves it out begins a forced one, and that needs no consent",
        "imply: dropped: return": "it is called only while a transfer is under way; the type checker wants it said",
        "_end: dropped: self.echo.forget()": (
            "what was noted and came to nothing is not repeated before another transfer commits, and that one has "
            "forgotten it, or noted its own request, when it began"
        ),
    },
    "arbiter": {
        "Identity.nonce: number one more: 1": "where the edge draws no number any will do",
        "_expire: dropped from and/or: authority.owner is not None: "
        "authority.recover_until is not None and now >= authority.recover_until and (authority.owne": (
            "the time to come back is set together with an owner, and while it runs nobody commands who could release; "
            "the type checker wants it said"
        ),
        "_grant_parent: dropped from and/or: authority.owner != parent: gone and authority.owner != parent": (
            "a parent that is lost is not heard, so not fit; and when it is heard it is not lost any more"
        ),
    },
    "safety.return_site": {
        "look: number one more: 0.0 in self.value = self._level_s > 0.0": (
            "it is asked at both ends of the scale only, and the upper one is more than 1"
        ),
        "look: dropped from and/or: some: full and some": (
            "who has the reserve left has what the reserve is there for: the one is wrong no sooner than the other"
        ),
        "look: dropped from and/or: there: all_the_way and there": (
            "who is covered all the way is covered there: the one is wrong no sooner than the other"
        ),
        "stays_until: comparison turned: now < since + BETTER_S < inf (number 2)": (
            "for ever is what is answered where there is none, and of others it is never the first"
        ),
        "_goes_over: comparison turned: better > counts": "it is asked only of two standings that differ",
    },
    "safety.energy": {
        "made_good: comparison turned: across >= airspeed": (
            "with all of the airspeed taken from the side none is left for the way, and that is looked at next"
        ),
        "_duration_s: comparison turned: length_m < speed_mps ** 2 / ACCELERATION_MPSS": (
            "on a piece just long enough for its speed both take as long"
        ),
    },
    "safety.strategy": {
        "decide: dropped from and/or: held_back: held_back or fact": (
            "whatever is held back at one moment is so for the same fact: they are asked in one order, and landing, "
            "which holds back most, before returning"
        ),
        "decide: dropped from and/or: best.withheld: best.withheld or held_back": (
            "what is withheld of the best is held back, and for the same fact as all else"
        ),
        "judge: dropped from and/or: found is not None: found is not None and lasts is not None and "
        "(lasts.cause in causes) and (found.action < la": (
            "nothing is decided of no cause, and then what lasts has none either; the type checker wants it said"
        ),
        "judge: dropped from and/or: lasts.action is FlightAction.LAND: lasts.action is FlightAction.LAND or "
        "Fact.PLACE in facts or found.action in _GOES_ON": (
            "what lands and can go nowhere lands for the same cause, decided once more or not"
        ),
    },
    "safety.emergency": {
        "judge: dropped from and/or: self._left: self._left and Fact.FLYING in facts": (
            "where the run before left nothing, nothing is taken up"
        ),
    },
    "authority.presence": {
        "unfit: dropped from and/or: self.answer is None: not self.connected(now) or self.answer is None or "
        "(not self.hearing.enough)": (
            "who is connected has answered: the answer and its time are set together; the type checker wants it said"
        ),
    },
    "authority.coverage": {
        "successor_awaited: dropped: return False": (
            "who may still come back is lost until then, and what is forced ends when who was lost is back"
        ),
        "coverage: dropped: return _NOTHING": "it is asked only with an owner; the type checker wants it said",
        "_asked: truth turned: True in return (None, True, True)": "where nobody is partner no station is the partner",
        "_asked: truth turned: True in return (None, True, True) (number 2)": "the same",
        "successor_awaited: dropped from and/or: transfer.forced: transfer is not None and transfer.forced and "
        "(not transfer.patient) and hurried": "with the loss every transfer under way is forced",
    },
    "safety.conditions": {
        "due_at: dropped: times.append(flight.position_lost_at())": (
            "the arbiter asks for that moment itself: no zone counts from then on"
        ),
    },
    "safety.hold_timer": {
        "__init__: truth turned: False in self._used_up = False": "the first look sets it, and nothing asks before",
        "decided: dropped from and/or: not stands: news.mends or not stands": (
            "what stands by no order any more comes home, where it is not held, or was taken by a hand whose word ends "
            "that time itself"
        ),
        "due_at: dropped from and/or: self.held_at == -inf: self.held_at == -inf or self._used_up": (
            "what never comes is left out at the end"
        ),
    },
    "safety.decision_facts": {
        "__init__: truth turned: False in self._may_hold = False": "the first look sets it, and nothing asks before",
        "__init__: truth turned: False in self._in_gap = False": "the same",
        "due_at: dropped from and/or: blind_until < inf: self._may_hold and (not self._hold_timer.resuming) and "
        "(blind_until < inf)": ("what comes after all else is not the first, and the stations are asked before that"),
        "due_at: comparison turned: blind_until < inf": "the same",
    },
    "safety.safety": {
        "due_at: comparison turned: time > -inf": (
            "of what was never heard, or is not held, no time is asked: that it is lost has been seen"
        ),
    },
    "safety.decision_executor": {
        "held_for: dropped: return None": (
            "what is told and is no hold has taken away for what it was held: `carry_out`, or the hand that took it"
        ),
        "held_for: dropped from and/or: not (told.action is FlightAction.HOLD or self._onl: told is None or not "
        "(told.action is FlightAction.HOLD or self._only_waits(self._emergency.": "the same",
        "_only_waits: dropped from and/or: decision.action is not FlightAction.WARN: "
        "decision is None or decision.action is not FlightAction.WARN": "what is held back is told as a warning",
        "carry_out: dropped from and/or: news.resumes: news.resumes or (news.mends and stands)": (
            "what was held stands by its order, or another hand has it and what is on the way is over either way"
        ),
        "carry_out: dropped from and/or: news.resumes: news.resumes or (news.mends and stands) (number 2)": (
            "what was held stands by its order, unless another hand has it, and that is the case before"
        ),
        "place_seen: dropped from and/or: place is not None: "
        "returns and told is not None and (place is not None) and (place.name != self._told_place)": (
            "it is called when a place has just been judged; the type checker wants it said"
        ),
        "_changed: dropped from and/or: ended is not None: ended is not None or waits": (
            "what is ended and was told as no order is to go on: there is nothing to overrule then"
        ),
        "_changed: dropped from and/or: told.action in OVERRULED: "
        "told.action in OVERRULED or told.withheld in OVERRULE": (
            "what was told as an order is commanded, and that it is not any more says so already"
        ),
        "carry_out: dropped from and/or: stands: news.mends and stands": (
            "what did not stand has nothing to go on from: what is on the way is over either way"
        ),
        "carry_out: dropped from and/or: decision is not None: "
        "decision is not None and (not news.warning) and (not news.continues)": (
            "no decision is no more than a warning; the type checker wants it said"
        ),
        "rehearsal_over: dropped: self._tells_at = None": (
            "what was told counts as no return any more in that moment, so none is told behind it"
        ),
        "place_seen: dropped from and/or: told is not None: "
        "returns and told is not None and (place is not None) and (place.name != self._told_place)": (
            "it returns, so something was told; the type checker wants it said"
        ),
        "tell_return: dropped: return": "it is called only where one is to be told; the type checker wants it said",
        "tell_return: dropped from and/or: told is not None: told is not None and told.action is FlightAction.RETURN": (
            "what is to be told has been decided; the type checker wants it said"
        ),
        "look: truth turned: False in return False": "to decide once more in the same moment decides the same",
        "look: truth turned: False in return False (number 2)": "the same",
    },
    "safety.mode_source": {
        "__init__: truth turned: False in self._flying = False": "there is no mode before the first one to differ from",
        "__init__: truth turned: False in self._unheard = False": (
            "it is looked at only while a mode is in doubt, which sets it"
        ),
        "settle: dropped: self._since, self._unheard = (-inf, False)": (
            "both are looked at only while a mode is in doubt, which sets them"
        ),
        "settle: truth turned: False in self.chosen_by, self._since, self._unheard = (ModeSource.GUARD, -inf, False)": (
            "it is looked at only while a mode is in doubt, which sets it"
        ),
        "settle: truth turned: False in self._since, self._unheard = (-inf, False)": (
            "it is looked at only while a mode is in doubt, which sets it"
        ),
    },
    "safety.command_verification": {
        "__init__: number one more: 0 in self._tries = 0": "nothing is counted before an order, which sets it",
        "__init__: truth turned: False in self._shown = False": "nothing shows before an order, which sets it",
        "__init__: number one more: 0.0 in self._first_speed = 0.0": "no stop begins before an order, which sets it",
        "__init__: truth turned: False in self._excused = False": "nothing is looked at before an order, which sets it",
        "_goes_on: number one more: 0 in self._tries = 0": (
            "how often it was told to go on counts for nothing: that has no end, and is not given back by a pilot"
        ),
        "_goes_on: dropped: self._tries = 0": "the same",
        "go_on: number one more: 1 in self._begin(FlightAction.CONTINUE, 1, now)": "the same",
        "sent_on: number one more: 1 in self._begin(FlightAction.CONTINUE, 1, now)": "the same",
        "look: number one more: 1 in self._begin(order, self._tries + 1, now)": (
            "what was interrupted had had one try at least, so this is its last one either way"
        ),
        "_moves: dropped from and/or: not self._excused: was_excused and (not self._excused)": (
            "while it is excused no time runs, so it may begin anew at every look"
        ),
    },
    "safety.route": {
        "side: comparison turned: self.cross_track_m > 0": "at 0 it is on the leg",
        "take: dropped from and/or: within: within and self._within": (
            "what was counted so is not looked at, and is forgotten with the next value"
        ),
        "take: dropped from and/or: beyond: beyond and self._beyond_s >= self._limits.off_hold_s": (
            "it grows only with a value that is beyond, and then it is over its limit at once"
        ),
        "take: dropped from and/or: within: within and self._within_s >= self._limits.off_clear_s": (
            "without a value well within it is 0"
        ),
        "_words: dropped from and/or: fact.course_off_deg is None: "
        "self._distance.over or fact.course_off_deg is None": (
            "a course that is over its limit has just been compared; the type checker wants it said"
        ),
    },
    "safety.commands": {
        "rule: dropped from and/or: asked.named is not None: insists and asked.named is not None": (
            "to lift what is no limit lifts nothing; the type checker wants it said"
        ),
    },
    "station.core": {
        "__init__: number one more: 0 in self._why, self._crossing = (Reason.NONE, 0)": (
            "it is looked at only for the transfer that the vehicle has announced, which sets it"
        ),
        "_announced_reason: number one more: 0 in return (self._why, self._crossing) if key == self._announced "
        "else (Reason.NONE, 0)": (
            "this station has its part already in what is not announced, so its border is not looked at"
        ),
    },
}
