# SPDX-License-Identifier: GPL-3.0-or-later

"""The gate that ships, with three stations that keep what they hear and an autopilot that keeps what passes.

Everything that drives the whole gate drives it through this: nothing of it is put together again anywhere.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from math import inf
from typing import NamedTuple

from mavproxy_handover.core.authority.payload import PayloadKind
from mavproxy_handover.core.common.model import AuthorityView
from mavproxy_handover.core.feeds import FeedSettings
from mavproxy_handover.gate.client_capabilities import ClientCapabilities
from mavproxy_handover.gate.feeds import FeedNews
from mavproxy_handover.gate.filters import CompanionMatters
from mavproxy_handover.gate.flush import Closing
from mavproxy_handover.gate.gate import Gate
from mavproxy_handover.gate.in_force import AuthorityInForce
from mavproxy_handover.gate.intent import Aim, Intent
from mavproxy_handover.gate.judge import Fate, StationIdentity, Verdict
from mavproxy_handover.gate.line_budget import LineBudget
from mavproxy_handover.gate.passed import GateSettings, PassedFrames
from mavproxy_handover.gate.replies import GateReports
from mavproxy_handover.gate.stale_streams import News
from mavproxy_handover.vehicle.profiles import COPTER, Modes
from mavproxy_handover.wire.frames import Frame
from tests.gate.ledger import GCSA, GCSB, GCSC, VEHICLE, A, B, C

__all__ = ["Came", "Door", "Port"]


_NAMES = {GCSA: "GCSA", GCSB: "GCSB", GCSC: "GCSC"}


class Port:
    """A station's end."""

    def __init__(self, identity: StationIdentity) -> None:
        self.identity = identity
        self.sysid = identity.sysid
        self.name = _NAMES.get(identity.sysid, f"station {identity.sysid}")
        self.capabilities = ClientCapabilities()
        self.heartbeat = b""
        self.heartbeat_at = -inf
        self.heard: list[bytes] = []
        #: whether it takes frames of downloads, and whether its link refuses what it cannot send
        self.takes_more = True
        self.flow_controlled = False

    def write(self, data: bytes) -> None:
        self.heard.append(data)

    def write_more(self, data: bytes) -> bool:
        if not self.takes_more:
            return False
        self.heard.append(data)
        return True

    def flush(self) -> None:
        pass


class Came(NamedTuple):
    """What came of a frame of a station: the verdict, what went to the autopilot, what the station got back."""

    verdict: Verdict
    passed: list[bytes]
    answers: list[bytes]


class Door:
    """Stations A, B and C at one gate. `now` moves by `step_s` with everything that happens."""

    def __init__(
        self,
        step_s: float = 0.05,
        stations: Sequence[StationIdentity] = (A, B, C),
        to_autopilot: Callable[[bytes], None] | None = None,
        feeds: FeedSettings | None = None,
        budget: LineBudget | None = None,
        managers: Collection[int] = (),
    ) -> None:
        """`to_autopilot` takes what passes instead of `passed`. `managers`: components of payload managers on board."""
        self.ports = {station.sysid: Port(station) for station in stations}
        self.passed: list[bytes] = []
        self.faults: list[str] = []
        #: what stations were told of their sticks and setpoints
        self.told: list[News] = []
        #: why something was refused: whom that was told, and what
        self.said: list[tuple[int, str]] = []
        #: what stations were told of feeds
        self.feed_news: list[FeedNews] = []
        self.now = 1000.0
        self.step_s = step_s
        pass_on = to_autopilot or self.passed.append
        reports = GateReports(
            lambda where, text: self.faults.append(f"{where}: {text}"),
            lambda news, _now: self.told.append(news),
            lambda station, text, _now: self.said.append((station, text)),
            lambda news, _now: self.feed_news.append(news),
        )
        #: what the companion says to the questions of the gate
        self.modes: Modes = COPTER.gate
        self.target_passes: Callable[[Aim, int, float], bool] = lambda _aim, _station, _now: True
        self.command_passes = True
        #: the commands in flight that the gate asked about, with their stations
        self.asked: list[tuple[Intent, int]] = []
        self.takes_over: Callable[[Frame], bool] = lambda _frame: False
        #: the station that has payload authority; None: the commander
        self.payload: int | None = None
        #: what went to payload managers on board
        self.to_managers: list[bytes] = []
        #: what of the commander passed or was carried out, as an end of a delegation
        self.commanded: list[Frame] = []
        matters = CompanionMatters(
            self._passes,
            self._allows,
            self._carries_out,
            lambda: self.modes,
            self._commander_sends,
            self._payload,
            frozenset(managers),
            lambda frame, _now: self.to_managers.append(frame.raw),
        )
        in_force = AuthorityInForce()
        self.settings = GateSettings(
            feeds=feeds or FeedSettings(), onboard=tuple(managers), budget=budget or LineBudget()
        )
        self.frames = PassedFrames(VEHICLE, self.ports, self.settings, in_force, pass_on, reports.fault)
        self.gate = Gate(VEHICLE, self.ports, in_force, self.frames, pass_on, reports, matters)

    def _passes(self, aim: Aim, station: int, now: float) -> bool:
        return self.target_passes(aim, station, now)

    def _allows(self, intent: Intent, station: int, _now: float) -> bool:
        self.asked.append((intent, station))
        return self.command_passes

    def _commander_sends(self, frame: Frame, verdict: Verdict, _now: float) -> None:
        if verdict.fate in (Fate.FORWARD, Fate.CONSUME):
            self.commanded.append(frame)

    def _payload(self, _kind: PayloadKind) -> int | None:
        return self.gate.view.commander if self.payload is None else self.payload

    def _carries_out(self, frame: Frame) -> bool:
        return self.takes_over(frame)

    def up(self, station: StationIdentity, frame: Frame) -> Came:
        """A frame arrives from a station."""
        self.now += self.step_s
        port, before = self.ports[station.sysid], len(self.passed)
        heard = len(port.heard)
        verdict = self.gate.up(port, frame, self.now)
        return Came(verdict, self.passed[before:], port.heard[heard:])

    def down(self, frame: Frame) -> set[int]:
        """The vehicle says something; the stations that hear it, each of them once and unchanged."""
        self.now += self.step_s
        before = {sysid: len(port.heard) for sysid, port in self.ports.items()}
        self.gate.down(frame, self.now)
        heard = {sysid: port.heard[before[sysid] :] for sysid, port in self.ports.items()}
        assert all(frames in ([], [frame.raw]) for frames in heard.values())
        return {sysid for sysid, frames in heard.items() if frames}

    def change(self, view: AuthorityView) -> list[tuple[int, Closing]]:
        """Another view is in force."""
        self.now += self.step_s
        return self.gate.change(view, self.now)
