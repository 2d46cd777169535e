# SPDX-License-Identifier: GPL-3.0-or-later

"""Faults in the guard that its tests need not notice, each with the reason."""

from __future__ import annotations

__all__ = ["KNOWN_SURVIVORS"]

_MILLISECOND = "a millisecond, or a value that is its own bound"
_BOXED = "a boxed number compares like a plain one"
_ZEROS = "after the end of a known message the firmware has zeros"
_DIFFERS = "a count that only has to differ from the one before"
_AGAIN = "set to 0 by what is done with the mode in the same call"
_FORGOTTEN = "the item is looked at only in a landing sequence, and a change of mode or reason clears it"
_MASKED = "masked again before it is used"
_HASH = "another hash of the same values does as well"
_FIRST = "the other edge of a range that a 32-bit difference cannot reach, or the same value"

KNOWN_SURVIVORS: dict[str, str] = {
    "elapsed: edge: if d < 0 or d > 0x7FFFFFFF then": _FIRST,
    "elapsed: edge: if d < 0 or d > 0x7FFFFFFF then (number 2)": _FIRST,
    "elapsed: one more: return 0": _MILLISECOND,
    "elapsed: one more: if d < 0 or d > 0x7FFFFFFF then": _MILLISECOND,
    'VEHICLES: one more: local rtl_3 = {mode=6, name="RTL", action=ACTION.RTL, wait_ms=0} (number 2)': _MILLISECOND,
    'VEHICLES: one more: local smart = {mode=21, name="SMART_RTL", action=ACTION.SMART_RTL, wait_ms=0} '
    "(number 2)": _MILLISECOND,
    'VEHICLES: one more: {mode=21, name="QRTL", action=ACTION.RTL, wait_ms=0}, qland} (number 2)': _MILLISECOND,
    "follow_sequence: one more: local item = mission ~= nil and mission:get_current_nav_index() or 0": _DIFFERS,
    "follow_sequence: edge: if elapsed(now, craft.former_at) >= MS.SEQUENCE then": _MILLISECOND,
    "clamped: edge: if not v or v ~= v or v < low then": _MILLISECOND,
    "clamped: edge: if v > high then": _MILLISECOND,
    "x25: mask dropped: local t = (byte(text, i) ~ crc) & 0xFF": _MASKED,
    "x25: mask dropped: local t = (extra ~ crc) & 0xFF": _MASKED,
    "x25: mask dropped: return ((crc >> 8) ~ (t << 8) ~ (t << 3) ~ (t >> 4)) & 0xFFFF": "no more than 16 bits are set",
    "half_siphash: mask dropped: a = (a << 16 | a >> 16) & mask": _MASKED,
    "half_siphash: mask dropped: c = (c << 16 | c >> 16) & mask": _MASKED,
    "last_resort: left out: update_state(now)": "enforce has judged before it failed",
    "observe: always true: if judging then": "a count of calls below zero is as good as zero",
    "observe: or: if mode == firmware.auto and firmware.sequences[reason] then": _FORGOTTEN,
    "observe: minus: craft.mode, craft.reason, craft.changes, craft.former_at = "
    "mode, reason, craft.changes + 1, craft.at": _DIFFERS,
    "observe: one more: craft.mode, craft.reason, craft.changes, craft.former_at = "
    "mode, reason, craft.changes + 1, craft.at": _DIFFERS,
    "RESPONSE.reset: one more: loss.mode, loss.attempts, loss.wait_ms, loss.climbing = nil, 0, 0, false (number 2)": (
        _MILLISECOND
    ),
    "send_home: one more: loss.mode, loss.action, loss.attempts = rung.mode, rung.action, 0": _AGAIN,
    "lease.accept: or: lease.at = stamp and stamp:toint() or now": _BOXED,
    'key.read: one more: local digits = string.match(file:read(80) or "", "^%s*(%x+)%s*$")': (
        "after the digits: how much white space is read"
    ),
    "key.read: one more: for i = 1, 8 do (number 2)": "eight bytes are taken of them",
    "key.read: left out: file:close()": "the garbage collector closes it",
    "this_guard.draw_nonce: one more: this_guard.nonce = half_siphash(key.k0 or 0, key.k1 or 0, "
    "table.concat(noise))": _HASH,
    "this_guard.draw_nonce: one more: this_guard.nonce = half_siphash(key.k0 or 0, key.k1 or 0, "
    "table.concat(noise)) (number 2)": _HASH,
    'refuse_version: edge: refused.text = version < LEASE.VERSION and "companion is older, update it" or '
    '"guard is older, update it"': "a lease of the guard's own version is not refused for it",
    'half_siphash: mask dropped: local tail = string.sub(text, whole + 1) .. string.rep("\\0", 3 - size % 4) .. '
    "string.char(size & 0xFF)": "no text is that long",
    "half_siphash: one more: for i = 1, whole + 1, 4 do (number 2)": "steps of four: the next one is past either",
    'key.objection: one more: if string.pack("<I4I4", low, high) ~= string.sub(body, 30, 37) then (number 2)': (
        "the body ends there"
    ),
    'read_lease: plus: local body = string.sub(msg, 13, 12 + len) .. string.rep("\\0", full - len)': _ZEROS,
    'read_lease: one more: local body = string.sub(msg, 13, 12 + len) .. string.rep("\\0", full - len) (number 2)': (
        _ZEROS
    ),
    'status.send: plus: text = text .. string.rep("\\0", MAV.TUNNEL_BYTES - #text)': (
        "the firmware takes as many bytes as the message has"
    ),
    "read_command: or: local came_at = stamp and stamp:toint() or now": _BOXED,
    "housekeeping: and: if gcs_id.epoch ~= lease.epoch or gcs_id.nonce ~= lease.nonce or gcs_id.set ~= lease.commander "
    "then": "noted at the next look, where the commander is the same",
    "housekeeping: and: if gcs_id.epoch ~= lease.epoch or gcs_id.nonce ~= lease.nonce or gcs_id.set ~= lease.commander "
    "then (number 2)": "what would be set is set, where the commander is the same",
    "every_second: edge: if rx.aux_at and elapsed(now, rx.aux_at) >= MS.TAMPER_HOLD then": _MILLISECOND,
    "every_second: edge: if rx.full_at and elapsed(now, rx.full_at) >= MS.TAMPER_HOLD then": _MILLISECOND,
    "gcs_id.follow: edge: if high and high > 0 then": "0 is set to 0",
}
