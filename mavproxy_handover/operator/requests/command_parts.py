# SPDX-License-Identifier: GPL-3.0-or-later

"""The parts that a command of a station concerns."""

from __future__ import annotations

from dataclasses import dataclass

from mavproxy_handover.operator.checks.command_check import CommandCheck
from mavproxy_handover.operator.checks.read_back import ReadBack
from mavproxy_handover.operator.orders import Orders
from mavproxy_handover.operator.uploads.mission_on_board import MissionOnBoard
from mavproxy_handover.vehicle.state import VehicleState

__all__ = ["CommandParts"]


@dataclass(frozen=True, slots=True)
class CommandParts:
    """The parts of one vehicle, for the services that carry out commands."""

    aircraft: VehicleState
    orders: Orders
    command_check: CommandCheck
    read_back: ReadBack
    mission: MissionOnBoard
