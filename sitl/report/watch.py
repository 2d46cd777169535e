# SPDX-License-Identifier: GPL-3.0-or-later

"""The vehicle's true behaviour from its own telemetry: position, mode, arming, landing, items reached, texts.

It also tells where the throttle stick is.

Pure: messages go in with the time at which they came, journal entries of `who = "vehicle"` come out. So the runner
waits for the aircraft and for the programs by the same means. Rules that live here:

* simulated time is the autopilot's (`time_boot_ms` of its positions); the wall clock only fills in between;
* the aircraft is airborne when the autopilot says so, or armed and more than 2 m above the place of arming; it has
  landed when it is disarmed after that, or the autopilot says that it is on the ground;
* a mode counts from the first heartbeat that shows it.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from pymavlink import mavutil

from mavproxy_handover.vehicle.profiles import ASSUMED, profile_of
from sitl.report.journal_reader import Entry

__all__ = ["VEHICLE", "Clock", "Sample", "Watch", "number", "samples_of"]

#: `who` of the entries made here
VEHICLE = "vehicle"

AUTOPILOT = 1
#: firmware -> number of a mode -> its name
_MODES: Final = {"ArduCopter": mavutil.mode_mapping_acm, "ArduPlane": mavutil.mode_mapping_apm}
ARMED_FLAG = 128
SAMPLE_INTERVAL_S = 0.2
AIRBORNE_M = 2.0
LANDED_ON_GROUND, LANDED_IN_AIR = 1, 2
EKF_ABSOLUTE_POSITION = 16
PREARM_CHECK = 1 << 28
_CHUNK = 50
#: nothing that is measured here is a number as large as this
_LARGEST = 1e12


@dataclass(frozen=True, slots=True)
class Sample:
    """Where the aircraft was: `t` monotonic, `sim_s` the autopilot's own time, `alt_m` above home."""

    t: float
    sim_s: float
    lat_deg: float
    lon_deg: float
    alt_m: float
    heading_deg: float
    speed_mps: float


def samples_of(entries: Sequence[Entry]) -> list[Sample]:
    """The samples among journal entries, in their order."""
    found = []
    for entry in entries:
        if entry.who != VEHICLE or entry.event != "sample":
            continue
        values = [number(entry, name) for name in ("sim_s", "lat_deg", "lon_deg", "alt_m", "heading_deg", "speed_mps")]
        known = [value for value in values if value is not None]
        if len(known) == len(values) and abs(known[1]) <= 90.0 and abs(known[2]) <= 540.0:
            found.append(Sample(entry.t, *known))
    return found


def number(entry: Entry, name: str) -> float | None:
    """A value of an entry that is a number, None when it is not."""
    value = entry.get(name)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    return float(value) if abs(value) < _LARGEST else None


class Clock:
    """Simulated time at a moment of the wall clock, from pairs of both; pairs must come in order."""

    def __init__(self, speedup: float) -> None:
        self.speedup = speedup
        self._wall: list[float] = []
        self._sim: list[float] = []

    def add(self, t: float, sim_s: float) -> None:
        """Note that it was `sim_s` in the simulation at monotonic `t`. What goes backwards is left out."""
        if self._wall and (t <= self._wall[-1] or sim_s < self._sim[-1]):
            return
        self._wall.append(t)
        self._sim.append(sim_s)

    def sim_at(self, t: float) -> float:
        """Simulated seconds at monotonic `t`; beyond the known pairs by the nominal speed-up."""
        if not self._wall:
            return 0.0
        place = bisect_left(self._wall, t)
        if place == 0:
            return max(0.0, self._sim[0] - (self._wall[0] - t) * self.speedup)
        if place == len(self._wall):
            return self._sim[-1] + (t - self._wall[-1]) * self.speedup
        t0, t1 = self._wall[place - 1], self._wall[place]
        s0, s1 = self._sim[place - 1], self._sim[place]
        return s0 + (s1 - s0) * (t - t0) / (t1 - t0)


class Watch:
    """The aircraft as last heard of. All numbers NaN, all words empty until something was heard."""

    def __init__(self, sysid: int, speedup: float) -> None:
        self.clock = Clock(speedup)
        self.sample: Sample | None = None
        self.mode = ""
        self.armed = False
        self.airborne = False
        #: landed since it was last airborne
        self.landed = False
        #: the autopilot has an absolute position estimate and its own checks pass
        self.position_ready = False
        self.checks_pass = False
        self.reached: list[int] = []
        self.item = 0
        self.firmware = ""
        self._throttle: int | None = None
        self._sysid = sysid
        self._sample_due = -math.inf
        self._text: dict[int, str] = {}

    def on_message(self, message: Any, now: float) -> list[Entry]:
        """Take in a message of the vehicle that came at monotonic `now`; returns what is worth noting."""
        if message.get_srcSystem() != self._sysid or message.get_srcComponent() != AUTOPILOT:
            return []
        handler = getattr(self, "_on_" + message.get_type().lower(), None)
        if handler is None:
            return []
        found: list[Entry] = handler(message, now)
        return found

    def _on_heartbeat(self, message: Any, now: float) -> list[Entry]:
        found = []
        number = message.custom_mode
        profile = profile_of(message.autopilot, message.type) or ASSUMED
        mode = _MODES[profile.firmware].get(number, f"mode {number}")
        if mode != self.mode:
            self.mode = mode
            found.append(Entry(now, VEHICLE, "mode", f"mode {mode}", {"mode": mode}))
        armed = bool(message.base_mode & ARMED_FLAG)
        if armed != self.armed:
            self.armed = armed
            word = "armed" if armed else "disarmed"
            found.append(Entry(now, VEHICLE, word, word, {}))
            if not armed and self.airborne:
                found += self._land(now)
        return found

    def _on_global_position_int(self, message: Any, now: float) -> list[Entry]:
        sim_s = message.time_boot_ms / 1000.0
        self.clock.add(now, sim_s)
        if message.lat == 0 and message.lon == 0:  # no position yet
            return []
        sample = Sample(
            now,
            sim_s,
            message.lat / 1e7,
            message.lon / 1e7,
            message.relative_alt / 1000.0,
            message.hdg / 100.0 if message.hdg != 0xFFFF else 0.0,
            math.hypot(message.vx, message.vy) / 100.0,
        )
        self.sample = sample
        found = []
        if self.armed and not self.airborne and sample.alt_m > AIRBORNE_M:
            found += self._take_off(now)
        if sim_s >= self._sample_due:
            self._sample_due = sim_s + SAMPLE_INTERVAL_S
            values = {
                "sim_s": round(sim_s, 3),
                "lat_deg": sample.lat_deg,
                "lon_deg": sample.lon_deg,
                "alt_m": round(sample.alt_m, 2),
                "heading_deg": round(sample.heading_deg, 1),
                "speed_mps": round(sample.speed_mps, 2),
            }
            found.append(Entry(now, VEHICLE, "sample", "", values))
        return found

    def _on_extended_sys_state(self, message: Any, now: float) -> list[Entry]:
        if message.landed_state == LANDED_IN_AIR and self.armed and not self.airborne:
            return self._take_off(now)
        if message.landed_state == LANDED_ON_GROUND and self.airborne:
            return self._land(now)
        return []

    def _take_off(self, now: float) -> list[Entry]:
        self.airborne, self.landed = True, False
        return [Entry(now, VEHICLE, "airborne", "airborne", {})]

    def _land(self, now: float) -> list[Entry]:
        self.airborne, self.landed = False, True
        place = {}
        if self.sample is not None:
            place = {"lat_deg": self.sample.lat_deg, "lon_deg": self.sample.lon_deg}
        return [Entry(now, VEHICLE, "landed", "landed", place)]

    def _on_mission_item_reached(self, message: Any, now: float) -> list[Entry]:
        if self.reached and self.reached[-1] == message.seq:
            return []
        self.reached.append(message.seq)
        return [Entry(now, VEHICLE, "reached", f"item {message.seq} reached", {"number": message.seq})]

    def _on_mission_current(self, message: Any, now: float) -> list[Entry]:
        self.item = message.seq
        return []

    def _on_rc_channels(self, message: Any, now: float) -> list[Entry]:
        throttle = message.chan3_raw
        if throttle == self._throttle:
            return []
        self._throttle = throttle
        return [Entry(now, VEHICLE, "sticks", f"throttle stick at {throttle}", {"throttle": throttle})]

    def _on_statustext(self, message: Any, now: float) -> list[Entry]:
        text = message.text if isinstance(message.text, str) else message.text.decode("utf-8", errors="replace")
        text = text.rstrip("\0")
        number = getattr(message, "id", 0)
        if number:
            text = self._text.pop(number, "") + text
            if len(message.text) >= _CHUNK:
                self._text[number] = text
                return []
        return [Entry(now, VEHICLE, "said", text, {"severity": message.severity})]

    def _on_autopilot_version(self, message: Any, now: float) -> list[Entry]:
        parts = [(message.flight_sw_version >> shift) & 0xFF for shift in (24, 16, 8)]
        firmware = ".".join(str(part) for part in parts)
        if firmware == self.firmware:
            return []
        self.firmware = firmware
        return [Entry(now, VEHICLE, "firmware", f"firmware {firmware}", {"version": firmware})]

    def _on_ekf_status_report(self, message: Any, now: float) -> list[Entry]:
        ready = bool(message.flags & EKF_ABSOLUTE_POSITION)
        if ready == self.position_ready:
            return []
        self.position_ready = ready
        text = "position estimate good" if ready else "no position estimate"
        return [Entry(now, VEHICLE, "position_ready" if ready else "position_lost", text, {})]

    def _on_sys_status(self, message: Any, now: float) -> list[Entry]:
        self.checks_pass = bool(message.onboard_control_sensors_health & PREARM_CHECK)
        return []
