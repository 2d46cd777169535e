# SPDX-License-Identifier: GPL-3.0-or-later

"""The monitor of mode and motion: what a silence of the autopilot means for the pilot's radio."""

from __future__ import annotations

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.events import ModeSeen
from mavproxy_handover.monitors.mode_and_motion import ModeAndMotionMonitor
from mavproxy_handover.vehicle.state import VehicleState

LOITER = 5
RECEIVER = mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER


class Autopilot:
    """An ArduCopter that a pilot flies, as the monitor hears it."""

    def __init__(self) -> None:
        self.state = VehicleState()
        self.monitor = ModeAndMotionMonitor(lambda: None)

    def beats(self, now: float) -> bool:
        """A heartbeat. Returns whether a pilot could steer, by the event for the rules."""
        copter, ours = mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
        self.state.on_message(mavlink.MAVLink_heartbeat_message(copter, ours, 128, LOITER, 4, 3), now)
        (seen,) = self.monitor.on_state(self.state, now)
        assert isinstance(seen, ModeSeen)
        return seen.radio

    def reports(self, now: float, *, lives: bool = True) -> None:
        """SYS_STATUS, with a radio that lives or in failsafe."""
        healthy = RECEIVER if lives else 0
        status = mavlink.MAVLink_sys_status_message(RECEIVER, RECEIVER, healthy, 0, 0, -1, -1, 0, 0, 0, 0, 0, 0)
        self.state.on_message(status, now)


def test_a_radio_that_is_not_reported_for_ten_seconds_does_not_count() -> None:
    autopilot = Autopilot()
    autopilot.reports(100.5)
    assert [autopilot.beats(101.0 + second) for second in range(12)] == [True] * 10 + [False] * 2


def test_a_radio_that_was_not_reported_yet_counts_for_three_seconds() -> None:
    autopilot = Autopilot()
    assert [autopilot.beats(100.0 + second) for second in range(5)] == [True] * 3 + [False] * 2


def test_unless_its_loss_would_not_be_noticed() -> None:
    autopilot = Autopilot()
    autopilot.state.on_message(mavlink.MAVLink_param_value_message(b"FS_THR_ENABLE", 0.0, 2, 900, 65535), 99.0)
    autopilot.state.parameters.reading_ended(98.0)
    assert not autopilot.beats(100.0)


def test_after_a_silence_of_the_autopilot_its_radio_counts_until_it_is_reported_again() -> None:
    """The fault: the first heartbeat came before SYS_STATUS, and an aircraft that a pilot flew was ordered home."""
    autopilot = Autopilot()
    autopilot.reports(100.0)
    assert autopilot.beats(100.1)
    assert autopilot.beats(120.0)
    autopilot.reports(120.4, lives=False)
    assert not autopilot.beats(121.0)
    assert not autopilot.beats(140.0)


def test_but_not_for_ever() -> None:
    """A silence counts as three seconds of the ten."""
    autopilot = Autopilot()
    autopilot.reports(100.0)
    assert autopilot.beats(100.1)
    assert [autopilot.beats(120.0 + second) for second in range(9)] == [True] * 7 + [False] * 2


def test_nor_on_a_link_that_is_silent_again_and_again() -> None:
    """Each fourth heartbeat arrives, and no SYS_STATUS."""
    autopilot = Autopilot()
    autopilot.reports(100.0)
    heard = [autopilot.beats(100.1 + 4.0 * number) for number in range(8)]
    assert heard == [True] * 4 + [False] * 4


def test_a_report_that_was_old_before_the_silence_does_not_count_after_it() -> None:
    autopilot = Autopilot()
    autopilot.reports(100.0)
    assert [autopilot.beats(100.1 + second) for second in range(9)] == [True] * 9
    assert not autopilot.beats(130.0)
