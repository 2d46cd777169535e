# SPDX-License-Identifier: GPL-3.0-or-later

"""The autopilot's own failsafes that matter here: ground station, battery, and an estimator without a receiver.

The ground station failsafe watches the heartbeats of MAV_GCS_SYSID and starts only after the first one. It fires once
per loss and never fights a mode that is set afterwards. The battery failsafe always wins over it while landing. What
each does is chosen by FS_GCS_ENABLE and BATT_FS_LOW_ACT / BATT_FS_CRT_ACT; FS_OPTIONS can soften the first.
"""

from __future__ import annotations

from enum import Enum

from sitl.vehicles.builtin.battery import BatteryLevel
from sitl.vehicles.builtin.copter import Copter, ModeReason

__all__ = ["Failsafes"]

_CHECK_PERIOD_S = 1 / 3
_EKF_PATIENCE_S = 8.0
_RTL, _LAND, _SMART_RTL, _BRAKE, _AUTO = 6, 9, 21, 17, 3
#: FS_OPTIONS bits.
_GCS_CONTINUE_IF_AUTO, _CONTINUE_IF_LANDING, _GCS_CONTINUE_IF_PILOT = 2, 8, 16


class FailsafeAction(Enum):
    """The action of a failsafe: the modes it tries in order."""

    NONE = ()
    LAND = (_LAND,)
    RTL = (_RTL, _LAND)
    SMART_RTL = (_SMART_RTL, _RTL, _LAND)
    SMART_RTL_LAND = (_SMART_RTL, _LAND)
    BRAKE_LAND = (_BRAKE, _LAND)
    TERMINATE = (-1,)


_SECOND_CHOICE_TEXT = {
    FailsafeAction.SMART_RTL: "SmartRTL Unavailable, Trying RTL Mode",
    FailsafeAction.SMART_RTL_LAND: "SmartRTL Unavailable, Using Land Mode",
    FailsafeAction.BRAKE_LAND: "Trying Land Mode",
}
_GCS_ACTIONS = {
    1: FailsafeAction.RTL,
    2: FailsafeAction.RTL,
    3: FailsafeAction.SMART_RTL,
    4: FailsafeAction.SMART_RTL_LAND,
    5: FailsafeAction.LAND,
    6: FailsafeAction.RTL,
    7: FailsafeAction.BRAKE_LAND,
}
_BATTERY_ACTIONS = {
    0: FailsafeAction.NONE,
    1: FailsafeAction.LAND,
    2: FailsafeAction.RTL,
    3: FailsafeAction.SMART_RTL,
    4: FailsafeAction.SMART_RTL_LAND,
    5: FailsafeAction.TERMINATE,
    6: FailsafeAction.RTL,
    7: FailsafeAction.BRAKE_LAND,
}


class Failsafes:
    """Watches and acts; `gcs_seen` is called for every heartbeat of the station that the autopilot obeys."""

    def __init__(self, copter: Copter) -> None:
        self._copter = copter
        self._checked_at_s = 0.0
        self._fix_at_s = 0.0
        self.gcs_seen_at_s: float | None = None

    def gcs_seen(self) -> None:
        self.gcs_seen_at_s = self._copter.time_s

    def update(self) -> None:
        copter = self._copter
        if copter.time_s - self._checked_at_s < _CHECK_PERIOD_S:
            return
        self._checked_at_s = copter.time_s
        self._check_gcs()
        self._check_estimator()
        if copter.armed:
            level = copter.battery.check(copter.time_s)
            if level is not None:
                self._battery(level)

    def _check_gcs(self) -> None:
        copter = self._copter
        if copter.parameters["FS_GCS_ENABLE"] == 0 or self.gcs_seen_at_s is None:
            return
        lost = copter.time_s - self.gcs_seen_at_s > copter.parameters["FS_GCS_TIMEOUT"]
        if lost == copter.failsafe_active:
            return
        copter.failsafe_active = lost
        if lost:
            self._gcs_lost()
        else:
            copter.say(4, "GCS Failsafe Cleared")

    def _check_estimator(self) -> None:
        """Eight seconds without a fix: LAND, from whatever mode needs a position."""
        copter = self._copter
        if copter.gps_ok or not copter.armed or copter.land_complete:
            self._fix_at_s = copter.time_s
            if copter.ekf_failed and copter.gps_ok:
                copter.ekf_failed = False
                copter.say(2, "EKF Failsafe Cleared")
            return
        if copter.ekf_failed or copter.time_s - self._fix_at_s < _EKF_PATIENCE_S:
            return
        copter.ekf_failed = True
        if copter.mode.needs_position and copter.set_mode(_LAND, ModeReason.EKF_FAILSAFE):
            copter.land.hold_first()
        copter.say(2, f"EKF Failsafe: changed to {copter.mode.name} Mode")

    def _gcs_lost(self) -> None:
        copter = self._copter
        options = int(copter.parameters["FS_OPTIONS"])
        action = _GCS_ACTIONS.get(int(copter.parameters["FS_GCS_ENABLE"]), FailsafeAction.RTL)
        note = ""
        if not copter.armed:
            action = FailsafeAction.NONE
        elif self._on_ground():
            copter.disarm()
            action, note = FailsafeAction.NONE, " - Disarming"
        elif copter.mode.landing and copter.battery.level is not BatteryLevel.OK:
            copter.say(4, "GCS + Battery Failsafe - Continuing Landing")
            self._act(FailsafeAction.LAND, ModeReason.GCS_FAILSAFE)
            return
        elif copter.mode.landing and options & _CONTINUE_IF_LANDING:
            action, note = FailsafeAction.LAND, " - Continuing Landing"
        elif copter.mode.number == _AUTO and options & _GCS_CONTINUE_IF_AUTO:
            action, note = FailsafeAction.NONE, " - Continuing Auto Mode"
        elif options & _GCS_CONTINUE_IF_PILOT and not copter.mode.autopilot:
            action, note = FailsafeAction.NONE, " - Continuing Pilot Control"
        copter.say(4, f"GCS Failsafe{note}")
        self._act(action, ModeReason.GCS_FAILSAFE)

    def _battery(self, level: BatteryLevel) -> None:
        copter = self._copter
        battery = copter.battery
        word = "critical" if level is BatteryLevel.CRITICAL else "low"
        copter.say(4, f"Battery 1 is {word} {battery.voltage_v:.2f}V used {battery.used_mah:.0f} mAh")
        name = "BATT_FS_CRT_ACT" if level is BatteryLevel.CRITICAL else "BATT_FS_LOW_ACT"
        action = _BATTERY_ACTIONS.get(int(copter.parameters[name]), FailsafeAction.NONE)
        if self._on_ground():
            copter.disarm()
            copter.say(4, "Battery Failsafe - Disarming")
            return
        note = ""
        if (
            copter.mode.landing
            and int(copter.parameters["FS_OPTIONS"]) & _CONTINUE_IF_LANDING
            and action is not FailsafeAction.NONE
        ):
            action, note = FailsafeAction.LAND, " - Continuing Landing"
        copter.say(4, f"Battery Failsafe{note}")
        self._act(action, ModeReason.BATTERY_FAILSAFE)

    def _on_ground(self) -> bool:
        """ArduCopter's should_disarm_on_failsafe."""
        copter = self._copter
        if copter.in_arming_delay:
            return True
        if copter.mode.number == _AUTO:
            return copter.land_complete and not copter.auto_armed
        return copter.land_complete

    def _act(self, action: FailsafeAction, reason: ModeReason) -> None:
        copter = self._copter
        if action is FailsafeAction.TERMINATE:
            copter.disarm()
            return
        for attempt, number in enumerate(action.value):
            if attempt == 1 and action in _SECOND_CHOICE_TEXT:
                copter.say(4, _SECOND_CHOICE_TEXT[action])
            if copter.set_mode(number, reason):
                if number == _LAND:
                    copter.land.hold_first()
                return
