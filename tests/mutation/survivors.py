# SPDX-License-Identifier: GPL-3.0-or-later

"""Faults of the gate that the tests need not notice, by module, each with the reason."""

from __future__ import annotations

from mavproxy_handover.gate.policy.access import Access

__all__ = ["KNOWN_SURVIVORS"]

_ONLY_SAVES_TIME = "the condition only saves time: without it the same is found"
_TRACE = "how much of a trace people get to read"
_NONE_IS_NO_KEY = "None is in no table either"

KNOWN_SURVIVORS: dict[str, dict[str, str]] = {
    "tables": {
        f"{carrier}/MAV_CMD_DO_AUX_FUNCTION as {access.value}": "the function that it switches decides"
        for carrier in ("COMMAND_LONG", "COMMAND_INT")
        for access in Access
        if access is not Access.COMMAND
    },
    "gate": {
        "up: dropped from and/or: passed.unnoted: not commands and passed.unnoted": _ONLY_SAVES_TIME,
        "up: dropped from and/or: commands: frame.msgid in LOG_REQUESTS and commands": (
            "the policy drops the requests of other stations"
        ),
    },
    "passed": {
        "companion_sent: truth turned: True in frame = parse_one(raw, proven=True)": (
            "the companion's own frames have the right checksum"
        ),
        "note_for: number one more: 3 in self._fault('frame that passed', traceback.format_exc(limit=-3))": _TRACE,
        **dict.fromkeys(
            ("list_open: dropped: self.note()", "close_mission_files: dropped: self.note()"),
            "no frame that waits opens or closes a list",
        ),
    },
    "replies": {
        "send: number one more: 3 in self._reports.fault(f'sending to {port.name}', "
        "traceback.format_exc(limit=-3))": _TRACE
    },
    "downloads": {
        "forward: number one more: 3 in self._fault(f'sending to {port.name}', traceback.format_exc(limit=-3))": _TRACE,
        "send: number one more: 3 in self._fault('log download', traceback.format_exc(limit=-3))": _TRACE,
        "send: number one more: 3 in self._fault(f'sending to {port.name}', traceback.format_exc(limit=-3))": _TRACE,
    },
    "log_download": {
        **dict.fromkeys(
            (
                "__init__: number one more: 0 in self._next = self._piece_end = 0",
                "__init__: number one more: 1 in self._own_piece_at = -1",
            ),
            "a request sets it before it is read",
        ),
        **dict.fromkeys(
            (
                "__init__: number one more: 0 in self._log, self._sent_to = (0, 0)",
                "__init__: number one more: 0 in self._log, self._sent_to = (0, 0) (number 2)",
            ),
            "the numbers of logs begin with 1, so the first request sets both",
        ),
        **dict.fromkeys(
            (
                "_serve: number one more: 1 in self._served, self._next, self._own_piece_at = (asked, asked.begin, -1)",
                "tick: number one more: 1 in self._own_piece_at = -1 if self._next == served.begin else self._next",
            ),
            "it only has to be no place in a log",
        ),
    },
    "targets": {
        "_Judged.passes: truth turned: True": "the first target of a stream is judged before this is read",
        "limit: number one more: 1 in number = -1": "it only has to be none of the frames of a guided message",
        "_senseless: dropped: return False": _ONLY_SAVES_TIME,
        "_senseless: truth turned: True in return any((not isfinite(value) and (not mask & bit) for value, bit in "
        "zip(values, _LEFT_O": "there are as many values as bits",
    },
    "naming": {
        "named: dropped from and/or: says is None: says is None or name is None": (
            "only for the type checker: without such a text there is no name"
        )
    },
    "judge": {
        **dict.fromkeys(
            (
                "usual: dropped: return commander if station.sysid == view.commander else others",
                "usual: and/or swapped: frame.compid in station.components or frame.sysid != station.sysid",
                "usual: dropped from and/or: frame.compid in station.components: frame.compid in station.components or "
                "frame.sysid != station.sysid",
                "usual: dropped from and/or: frame.sysid != station.sysid: frame.compid in station.components or "
                "frame.sysid != station.sysid",
                "usual: dropped from and/or: len(payload) >= length and (payload[system] == veh: system is None or "
                "(len(payload) >= length and (payload[system] == vehicle_sysid or not pay",
                "usual: comparison turned: len(payload) >= length",
                "usual: and/or swapped: payload[system] == vehicle_sysid or not payload[system]",
                "usual: dropped from and/or: payload[system] == vehicle_sysid: payload[system] == vehicle_sysid or "
                "not payload[system]",
                "usual: dropped from and/or: not payload[system]: payload[system] == vehicle_sysid or "
                "not payload[system]",
                "usual: dropped from and/or: payload[component] != COMPANION_COMPID: component is None or "
                "payload[component] != COMPANION_COMPID",
            ),
            "more frames than need be are judged by `decide`, which finds the same",
        ),
        "_usual: truth turned: True in found = (outcome(row.access, commands, armed=True) for commands in "
        "(False, True))": "only classes whose outcome does not depend on it get here",
        "_usual_by_id: dropped from and/or: msgid not in TAKE_OFF_MESSAGES: row.access in same and row.access is not "
        "Access.LIVENESS and (msgid not in TAKE_OFF_MESSAG": "SET_MODE is among the messages of intents too",
        "_usual_by_id: dropped from and/or: msgid != _ACK: row.access in same and row.access is not Access.LIVENESS "
        "and (msgid not in TAKE_OFF_MESSAG": "the id alone does not decide MISSION_ACK, so it has no row there",
        **dict.fromkeys(
            (
                "_decide: dropped from and/or: frame.msgid in _LOOKED_AT: commands and frame.msgid in _LOOKED_AT and "
                "(view.phase is not _ON_LOAD)",
                "uploads: dropped from and/or: frame.msgid not in INTENT_MESSAGES: frame.msgid not in INTENT_MESSAGES "
                "or intent_of(frame, modes) is None",
            ),
            _ONLY_SAVES_TIME,
        ),
    },
    "policy.rows": {
        "moves: dropped from and/or: frame.msgid in COMMAND_MESSAGES: frame.msgid in COMMAND_MESSAGES and "
        "(row.part == MISSION_START or row.part in _TURNING)": "no other message of this class has such a part"
    },
    "policy.parameters": {
        "parameter_rule: dropped from and/or: found.lastindex is None: found is None or found.lastindex is None": (
            "only for the type checker: whatever fits is in a group"
        )
    },
    "intent": {
        "_is_one: dropped: return False (number 2)": "a mode that is no number is AUTO before it is FOLLOW",
        "_is_one: number one more: 0 in return rule.also is None or _holds(field_float(frame, f'param{rule.also[0]}'), "
        "rule.also[1": "the two numbers of these rules are equal: parameter 2, value 2",
        "_speed_type: comparison turned: asked > 2.9": "2.9 is no number of 32 bits",
        "_speed_type: number one more: 2.9 in return 3 if asked > 2.9 else int(asked + 0.1)": (
            "from 2.9 to 3.9 both ways give 3"
        ),
        "aim_of: dropped from and/or: frame.msgid == _GLOBAL: modes.takes_heights and frame.msgid == _GLOBAL": (
            "of wings the other messages are handled before"
        ),
        "_as_bytes: number one more: 0.0 in return _FLOATS.pack(*numbers, *(0.0,) * (7 - len(numbers)))": (
            "what fills up is the same in all that are compared"
        ),
    },
    "mission_server": {
        "tick: sign turned: opened.tries += 1": "only whether the number is odd counts",
        **dict.fromkeys(
            (
                "_on_count: number one more: 0 in return self._whole(_Open(sender, self.kind, 0, -1, now), now)",
                "_on_count: number one more: 1 in return self._whole(_Open(sender, self.kind, 0, -1, now), now)",
                "_on_clear: number one more: 0 in return self._whole(_Open(sender, message.mission_type, 0, -1, now), "
                "now) if refused is Non",
                "_on_clear: number one more: 1 in return self._whole(_Open(sender, message.mission_type, 0, -1, now), "
                "now) if refused is Non",
            ),
            "of an empty list only counts that its last item is below 0",
        ),
        "_on_item: dropped from and/or: opened is None: opened is None and over is not None and "
        "(over.last == message.seq)": "an upload that begins forgets the one before",
        "_whole: dropped: return Turn(whole=Upload(opened.sender, opened.kind, (), opened.begun_at))": (
            "the lines after it make the same empty list"
        ),
        "_on_ack: dropped from and/or: opened is None: not cancels or opened is None or opened.whole": (
            "only for the type checker: without an upload nothing cancels"
        ),
    },
    "refusal_text": {
        "thesis_command: dropped from and/or: isinstance(subject, str): isinstance(subject, str) and subject in "
        "_THESIS_COMMANDS": "no number and no parameter is among these names",
    },
    "flush": {
        "_File.acknowledged: truth turned: False": "the only call gives the value",
        "saw: dropped from and/or: aim is not None: aim is not None and aim[1] != 0": (
            "every message that opens or ends something has an address"
        ),
    },
    "observers": {
        "_Observer.allowance: number one more: 0.0": "the first message fills the allowance whatever is left of it",
        "asked: dropped from and/or: msgid is None: msgid is None or msgid not in mavlink.mavlink_map": _NONE_IS_NO_KEY,
        "_set: dropped from and/or: msgid is None: msgid is None or msgid not in _GRANTABLE or "
        "(not math.isfinite(interval_us)) or (interval_": _NONE_IS_NO_KEY,
        "due: dropped from and/or: observer.wishes: observer.wishes and now - observer.heard_at > "
        "self._limits.silence_s": _ONLY_SAVES_TIME,
    },
    "questions": {
        "Budget.all_per_second: number one more: 0.0": "a budget without this rate has an endless reserve",
        "limit: dropped from and/or: station_sysid != commander: frame.msgid == _FTP and station_sysid != commander": (
            "no frame of the commander is refused because its station is not in control"
        ),
        "_knows: dropped from and/or: sender not in senders: sender not in senders and len(senders) < SENDERS": (
            "a known sender is added to the set once more"
        ),
    },
    "stale_streams": {
        "_OTHERS: number one more: 0": "no frame that passes has this sender: 0 is no system, 1 is the vehicle",
        "limit: dropped from and/or: kind in self._streams[station]: kind in self._streams[station] and "
        "verdict.fate is _FORWARD and self._hold_or_release(fram": _ONLY_SAVES_TIME,
    },
    "refusals": {
        "_QUESTIONS: dropped: Access.RALLY_READ": "the companion answers such reads, whichever component they address",
        "refusal: dropped from and/or: not frame.known: build is None or verdict.fate is not Fate.REFUSE or "
        "(not frame.known) or (frame.msgid in _": "a frame that is not known is dropped, not refused",
        "refusal: dropped from and/or: frame.msgid in _SILENT_IDS: build is None or verdict.fate is not Fate.REFUSE "
        "or (not frame.known) or (frame.msgid in _": "no message in SILENT has a builder",
        "has_words: dropped from and/or: not frame.known: verdict.fate is not Fate.REFUSE or not frame.known or "
        "frame.msgid in _SILENT_IDS": "a frame that is not known is dropped, not refused",
    },
}
