# SPDX-License-Identifier: GPL-3.0-or-later

"""The objects that the parts that talk to the autopilot share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from mavproxy_handover.operator.base.authority import Authority
from mavproxy_handover.operator.base.reports import Reports
from mavproxy_handover.vehicle.procedures import Procedures
from mavproxy_handover.vehicle.state import VehicleState
from mavproxy_handover.wire.conversation import Conversations

__all__ = ["Context"]


@dataclass(frozen=True, slots=True)
class Context:
    """The shared objects of one vehicle; complete before the parts are constructed, and the same for all of them."""

    state: VehicleState
    #: the conversations with the autopilot that are open
    conversations: Conversations
    #: the procedures of the kind of aircraft that the autopilot last said
    procedures: Callable[[], Procedures]
    authority: Authority
    reports: Reports
