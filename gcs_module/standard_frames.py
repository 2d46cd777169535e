# SPDX-License-Identifier: GPL-3.0-or-later

"""Messages of the operator-control standard at a station, between frames and the events of the rules. Pure."""

from __future__ import annotations

from math import isfinite
from typing import Any

from pymavlink.dialects.v20 import handover as mavlink

from gcs_module.events import ControlAsked, ControlStatusHeard
from mavproxy_handover.wire import codec
from mavproxy_handover.wire.frames import Frame
from mavproxy_handover.wire.ids import OPERATOR_CONTROL

__all__ = ["acknowledgement", "control_asked", "control_status"]


def control_status(frame: Frame) -> ControlStatusHeard | None:
    """The event of a CONTROL_STATUS; None: it cannot be read."""
    message = codec.decode_bytes(frame.raw)
    if message is None:
        return None
    return ControlStatusHeard(
        component=frame.compid,
        manager=bool(message.flags & mavlink.GCS_CONTROL_STATUS_FLAGS_SYSTEM_MANAGER),
        takeover=bool(message.flags & mavlink.GCS_CONTROL_STATUS_FLAGS_TAKEOVER_ALLOWED),
        main=message.gcs_main or None,
    )


def control_asked(frame: Frame, own: int) -> ControlAsked | None:
    """The event of a command that passes on a request to this station, `own`; None: it is no such command."""
    message = codec.decode_bytes(frame.raw)
    if message is None or message.command != OPERATOR_CONTROL or message.target_system != own:
        return None
    requester = message.param4
    if message.param1 != 1 or not isfinite(requester) or not 1 <= requester <= 255 or requester != int(requester):
        return None
    timeout_s = message.param3 if isfinite(message.param3) else 0.0
    return ControlAsked(frame.compid, int(requester), timeout_s)


def acknowledgement(vehicle: int, component: int) -> Any:
    """COMMAND_ACK: this station has received the request."""
    return mavlink.MAVLink_command_ack_message(OPERATOR_CONTROL, mavlink.MAV_RESULT_ACCEPTED, 0, 0, vehicle, component)
