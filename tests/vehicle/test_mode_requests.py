# SPDX-License-Identifier: GPL-3.0-or-later

"""What the commander's frames ask of the flight mode, whatever message a program puts it in."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.events import ModeSourceSeen
from mavproxy_handover.core.common.model import ModeClass, ModeSource
from mavproxy_handover.vehicle import mode_requests
from mavproxy_handover.vehicle.profiles import COPTER, PLANE, Profile
from mavproxy_handover.wire.frames import Frame, parse_one

SET_MODE, PAUSE = mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_DO_PAUSE_CONTINUE
CURRENT, RTL = mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH
GUIDED, COPTER_RTL, PLANE_RTL = 4, 6, 11


def frame(message: Any) -> Frame:
    parsed = parse_one(message.pack(mavlink.MAVLink(None, srcSystem=251, srcComponent=190)))
    assert parsed is not None
    return parsed


def long(command: int, *parameters: float) -> Any:
    return mavlink.MAVLink_command_long_message(1, 1, command, 0, *parameters, *[0.0] * (7 - len(parameters)))


def command_int(command: int, *parameters: float) -> Any:
    return mavlink.MAVLink_command_int_message(
        1, 1, 0, command, 0, 0, *parameters, *[0.0] * (4 - len(parameters)), 0, 0, 0
    )


@pytest.mark.parametrize(
    ("message", "vehicle", "flown"),
    [
        (mavlink.MAVLink_set_mode_message(1, 1, COPTER_RTL), COPTER, ModeClass.RETURN),
        (mavlink.MAVLink_set_mode_message(1, 1, GUIDED), COPTER, ModeClass.GUIDED),
        (mavlink.MAVLink_set_mode_message(1, 1, PLANE_RTL), PLANE, ModeClass.RETURN),
        (mavlink.MAVLink_set_mode_message(1, 1, 4_000_000_000), COPTER, ModeClass.OTHER),
        (long(SET_MODE, 1, COPTER_RTL), COPTER, ModeClass.RETURN),
        (command_int(SET_MODE, 1, COPTER_RTL), COPTER, ModeClass.RETURN),
        (long(PAUSE, 0), COPTER, ModeClass.STOP),
        (command_int(PAUSE, 0), COPTER, ModeClass.STOP),
        (long(RTL), COPTER, ModeClass.RETURN),
        (command_int(RTL), COPTER, ModeClass.RETURN),
    ],
)
def test_a_mode_is_the_commanders_in_whatever_message_it_comes(
    message: Any, vehicle: Profile, flown: ModeClass
) -> None:
    assert mode_requests.of_command(frame(message), vehicle) == ModeSourceSeen(ModeSource.COMMANDER, flown)


@pytest.mark.parametrize(
    "message", [mavlink.MAVLink_mission_set_current_message(1, 1, 5), long(CURRENT, 5), command_int(CURRENT, 5)]
)
def test_to_go_on_with_an_item_is_what_it_leads_to(message: Any) -> None:
    assert mode_requests.of_command(frame(message)) is None
    land = mode_requests.of_command(frame(message), leads_to=lambda seq: ModeClass.LAND if seq == 5 else None)
    assert land == ModeSourceSeen(ModeSource.COMMANDER, ModeClass.LAND)


@pytest.mark.parametrize("vehicle", [COPTER, PLANE])
def test_no_frame_of_a_commander_breaks_it(vehicle: Profile) -> None:
    """Every message that there is, with nothing but zeros in it."""
    for kind in mavlink.mavlink_map.values():
        empty = kind(*[_zero(kind, name) for name in kind.fieldnames])
        mode_requests.of_command(frame(empty), vehicle)


def _zero(kind: Any, name: str) -> Any:
    place = kind.ordered_fieldnames.index(name)
    length, of = kind.array_lengths[place], kind.fieldtypes[kind.fieldnames.index(name)]
    if of == "char":
        return b""
    zero = 0.0 if of in ("float", "double") else 0
    return [zero] * length if length else zero
