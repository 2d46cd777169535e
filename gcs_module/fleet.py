# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover ...` at a station: chooses the vehicle of a command. With one vehicle every command is for that one.

With several vehicles `handover -v NAME ...` names it. Without a name the command is for the vehicle that MAVProxy has
chosen (`vehicle`). It is refused if that vehicle is not in the configuration: a command typed for one aircraft never
goes to another because a name is missing. `handover status` is a table of all, `handover ack` is for all; with -v both
are for one.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

from MAVProxy.modules.lib import mp_settings

from gcs_module.aircraft import Aircraft
from gcs_module.banner import age
from gcs_module.duty_commands import DutyCommands
from gcs_module.vehicle_selection import VehicleSelection, known, vehicle_of

__all__ = ["FleetCommands", "our_settings"]

#: commands that answer a question
_ANSWERS = ("accept", "deny")
_HEAD = ("", "vehicle", "commander", "phase", "zone", "links", "alarms", "heard")


def our_settings() -> Any:
    """The station's settings, for `handover set`."""
    return mp_settings.MPSettings(
        [
            mp_settings.MPSetting(
                "telemetry", float, 10.0, "seconds between telemetry lines, 0 = none", range=(0, 3600)
            ),
            mp_settings.MPSetting(
                "request_timeout", float, 30.0, "seconds the commander has to answer a request", range=(3, 60)
            ),
            mp_settings.MPSetting(
                "mavproxy_lines", int, 0, "1: show also the lines of MAVProxy that are left out", range=(0, 1)
            ),
        ]
    )


class FleetCommands:
    """The operator's commands at a station with any number of vehicles. `faults`: the module's, by place."""

    def __init__(
        self,
        aircraft: Sequence[Aircraft],
        selection: VehicleSelection,
        settings: Any,
        show: Callable[[str], None],
        faults: Counter[str],
        duty: DutyCommands,
    ) -> None:
        self._aircraft = aircraft
        self._duty = duty
        self._selection = selection
        self.settings = settings
        self._show = show
        self._faults = faults
        self._several = len(aircraft) > 1
        self._vehicles = [each.vehicle for each in aircraft]

    def completions(self) -> list[str]:
        """For MAVProxy's tab completion."""
        words = self._aircraft[0].commands.completions()
        names = "|".join(vehicle.name for vehicle in self._vehicles)
        words = [*words, "operator"]
        return [*words, f"-v <{names}>"] if self._several else words

    def run(self, args: list[str]) -> None:
        """Run one command line."""
        first = self._aircraft[0].commands
        if args[:1] == ["operator"]:
            self._duty.run(args[1:])
            return
        word = args[2:3] if args[:1] == ["-v"] else args[:1]
        if word and self._duty.refuses(word[0]):
            return
        if args[:1] == ["-v"] and self._vehicles[0].name:
            self._of_named(args[1:])
        elif not self._several:
            first.run(args)
        elif args == ["status"]:
            self._table()
        elif args == ["ack"]:
            for each in self._aircraft:
                each.event_log.acknowledged()
        elif first.takes(args):
            self._of_chosen(args)
        else:
            first.run(args)  # settings, and the usage
            if args[:1] != ["set"]:
                self._show(f"  -v NAME   before the others: for this vehicle; there are {known(self._vehicles)}")

    def _of_named(self, args: list[str]) -> None:
        vehicle = vehicle_of(args[0], self._vehicles) if args else None
        if vehicle is None:
            what = f"no vehicle {args[0]!r}" if args else "which vehicle?"
            self._show(f"handover -v: {what}; there are {known(self._vehicles)}")
        elif not self._commands(vehicle.sysid).takes(args[1:]):
            words = " ".join(args[1:])
            self._show(
                f"handover -v {args[0]}: {f'no command {words!r}' if words else 'what?'}; 'handover help' lists them"
            )
        else:
            self._commands(vehicle.sysid).run(args[1:])

    def _of_chosen(self, args: list[str]) -> None:
        vehicle = self._selection.vehicle
        if vehicle is not None:
            if args[0] not in _ANSWERS or not self._asked_elsewhere(vehicle.sysid, args[0]):
                self._commands(vehicle.sysid).run(args)
            return
        words = " ".join(args)
        self._show(
            f"handover {words}: for which vehicle? MAVProxy's choice ({self._selection.sysid}) is none of "
            f"{known(self._vehicles)}: 'vehicle NAME' chooses one, or 'handover -v NAME {words}'"
        )

    def _asked_elsewhere(self, sysid: int, answer: str) -> bool:
        """Whether only other vehicles than the chosen one ask: then the operator is told which."""
        asking = [each for each in self._aircraft if each.core.open_question is not None]
        if not asking or any(each.sysid == sysid for each in asking):
            return False
        words = " or ".join(f"'handover -v {each.of} {answer}'" for each in asking)
        names = ", ".join(each.of for each in asking)
        self._show(f"handover {answer}: the question is about {names}: {words}")
        return True

    def _commands(self, sysid: int) -> Any:
        return next(each.commands for each in self._aircraft if each.sysid == sysid)

    # ---- all at once ----------------------------------------------------------------------------------------------

    def _table(self) -> None:
        rows = [_HEAD, *(self._row(each) for each in self._aircraft)]
        widths = [max(len(row[column]) for row in rows) for column in range(len(_HEAD))]
        for row in rows:
            cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
            self._show(" ".join(cells).rstrip())
        for each in self._aircraft:
            for alarm in each.event_log.alarms.standing:
                known_of = " (acknowledged)" if alarm.acknowledged else ""
                self._show(f"alarm     {each.of}: {alarm.level.name}: {alarm.text}{known_of}")
        for peer in self._aircraft[0].config.peers:
            alive = "up" if self._aircraft[0].core.peer_alive(peer.station.sysid, time.monotonic()) else "down"
            self._show(f"ground    {peer.station.name}: {alive}")
        if self._faults:
            self._show("faults    " + ", ".join(f"{where} {count}" for where, count in self._faults.items()))

    def _row(self, each: Aircraft) -> tuple[str, ...]:
        now = each.situation()
        alarms = each.event_log.alarms.standing
        heard = "never" if now.heard_s == float("inf") else age(now.heard_s) or "now"
        commander = f"{now.commander or 'nobody'}{' (you)' if now.own else ''}"
        return (
            "*" if each.sysid == self._selection.sysid else "",
            each.of,
            f"{commander} -> {now.partner}" if now.partner else commander,
            f"{now.phase.name} {now.mode}".rstrip(),
            each.core.name(each.state.zone) if each.state.zone else "none",
            each.connection.summary(),
            f"{len(alarms)} {alarms[0].level.name}" if alarms else "none",
            heard,
        )
