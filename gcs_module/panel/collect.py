# SPDX-License-Identifier: GPL-3.0-or-later

"""Collects what a station knows into a snapshot for the panel. It reads the station's parts, and changes nothing."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterator, Sequence
from math import isfinite
from typing import Any, Final, Protocol

from gcs_module.aircraft import Aircraft
from gcs_module.alarms import Alarm
from gcs_module.duty import Duty
from gcs_module.notices import NOTICES
from gcs_module.panel.question_number import border_number, number_of
from gcs_module.panel.snapshot import (
    AircraftSeen,
    AlarmSeen,
    Border,
    LineSeen,
    LinkSeen,
    PeerSeen,
    Question,
    ReturnSite,
    Stamped,
    StationSeen,
)
from gcs_module.peer_operators import PeerOperators
from mavproxy_handover.config.files import StationConfig
from mavproxy_handover.core.common.model import Consent
from mavproxy_handover.tools.version import VERSION
from mavproxy_handover.wire.ids import LIMITS

__all__ = ["Collector"]

_ANSWERS: Final = {Consent.GRANTED: "granted", Consent.DENIED: "denied", Consent.WAITING: "waiting"}
#: lines of each aircraft in a snapshot
_LINES: Final = 12


class Station(Protocol):
    """The station's module, as far as a snapshot needs it."""

    config: StationConfig
    aircraft: tuple[Aircraft, ...]
    duty: Duty
    peer_operators: PeerOperators


class _LinkAges:
    """When the last frame came by each link, from the counts of frames."""

    def __init__(self) -> None:
        self._known: dict[tuple[int, str], tuple[int, float | None]] = {}

    def heard_at(self, sysid: int, name: str, frames: int, now: float) -> float | None:
        """None: no frame has come while the panel was open."""
        before, at = self._known.get((sysid, name), (frames, None))
        if frames != before:
            at = now
        self._known[sysid, name] = frames, at
        return at


class Collector:
    """One station's snapshots. Times are monotonic seconds."""

    def __init__(self, station: Station) -> None:
        self._station = station
        self._link_ages = _LinkAges()
        #: digest -> the mission package as text for a line
        self._missions: dict[str, str] = {}

    def snapshot(self, now: float) -> StationSeen:
        """What the station knows now."""
        config, duty = self._station.config, self._station.duty
        next_operator, next_until = duty.next_one(now)
        return StationSeen(
            station=config.station.name,
            at=now,
            program=f"handover_gcs {VERSION}",
            configuration=str(config.path),
            limits=tuple(LIMITS.values()),
            operator=duty.name,
            required=duty.required,
            next_operator=next_operator,
            next_until=_time(next_until),
            aircraft=tuple(self._aircraft(each, now) for each in self._station.aircraft),
            peers=tuple(self._peers(now)),
        )

    def missions(self) -> dict[str, str]:
        """The packages that are flown, by the digest that a snapshot names: in base64."""
        found: dict[str, str] = {}
        for each in self._station.aircraft:
            package = each.missions.flown()
            if package is not None:
                digest = package.digest.hex()
                known = self._missions.get(digest)
                found[digest] = b64encode(package.to_bytes()).decode() if known is None else known
        self._missions = found
        return found

    def _peers(self, now: float) -> Iterator[PeerSeen]:
        """A station's ground link is the same for all aircraft."""
        core = self._station.aircraft[0].core
        for peer in self._station.config.peers:
            sysid = peer.station.sysid
            yield PeerSeen(
                peer.station.name,
                core.peer_alive(sysid, now),
                _time(core.peer_heard_at(sysid)),
                self._station.peer_operators.of(sysid),
            )

    def _aircraft(self, craft: Aircraft, now: float) -> AircraftSeen:
        core, state, values = craft.core, craft.state, craft.values
        seen = state.situation(now, craft.decisions.action, "")
        mode, mode_at = state.mode
        heard = isfinite(mode_at)
        flown = craft.missions.flown()
        return AircraftSeen(
            sysid=craft.sysid,
            name=craft.of or core.vehicle_name,
            heard_at=_time(now - seen.heard_s),
            authority_at=_time(max(state.authority_at, core.control.heard_at)),
            phase=core.phase.name.lower(),
            commander=seen.commander,
            own=seen.own,
            partner=seen.partner,
            epoch=core.epoch,
            alone=core.alone,
            rehearsal=state.rehearsal,
            zone=core.name(state.zone) if state.zone else "",
            zone_ends_at=_time(state.zone_ends_at),
            action="" if craft.decisions.action is None else craft.decisions.action.name.lower(),
            decision=craft.decisions.text,
            question=self._question(craft, now),
            border=_border(craft),
            answer_until=_time(now + seen.left_s),
            mode=Stamped(mode, mode_at) if heard else None,
            armed=Stamped(not state.disarmed, mode_at) if heard else None,
            position=values.position,
            height_m=values.height_m,
            speed_mps=values.speed_mps,
            heading_deg=values.heading_deg,
            battery_percent=values.battery_percent,
            battery_v=values.battery_v,
            battery_left_s=values.battery_left_s,
            return_site=None
            if state.return_site is None
            else ReturnSite(*state.return_site, state.return_takes_s, state.return_needs),
            payload=state.payload,
            rerouted=state.rerouted,
            mission="" if flown is None else flown.digest.hex(),
            overrides=tuple((limit, until) for limit, until in craft.commands.overrides.items() if until > now),
            briefing_at=_time(craft.briefing.at),
            briefing=tuple(craft.briefing.pairs),
            alarms=tuple(_alarm(alarm) for alarm in craft.event_log.alarms.standing),
            links=tuple(self._links(craft, now)),
            lines=_lines(craft.view.recent),
        )

    @staticmethod
    def _question(craft: Aircraft, now: float) -> Question | None:
        core = craft.core
        number, key = number_of(core.open_question), core.question or core.asked_ahead
        asked = core.control.question
        if number and key is None and asked is not None:
            own, requester = craft.config.station.name, core.name(asked.requester)
            return Question(number, False, own, requester, False, None, asked.until, core.asked_at)
        if not number or key is None:
            return None
        ahead, until = core.ahead, now + core.answer_left_s(now)
        return Question(
            number=number,
            take=key.to_station == craft.config.station.sysid,
            from_station=core.name(key.from_station),
            to_station=core.name(key.to_station),
            early=core.question is None,
            border_at=ahead.at if ahead is not None and core.question is None else None,
            until=_time(until),
            asked_at=core.asked_at,
        )

    def _links(self, craft: Aircraft, now: float) -> Iterator[LinkSeen]:
        for name, works, used, frames in craft.connection.links():
            yield LinkSeen(name, works, used, self._link_ages.heard_at(craft.sysid, name, frames, now))


def _time(at: float) -> float | None:
    return at if isfinite(at) else None


def _border(craft: Aircraft) -> Border | None:
    core, ahead = craft.core, craft.core.ahead
    if ahead is None or core.partner is not None:
        return None
    return Border(
        number=border_number(ahead),
        from_station=core.name(ahead.key.from_station),
        to_station=core.name(ahead.key.to_station),
        at=ahead.at,
        answer=_ANSWERS[ahead.consent],
        other="" if ahead.other is None else _ANSWERS[ahead.other],
    )


def _alarm(alarm: Alarm) -> AlarmSeen:
    row = NOTICES.get(alarm.row)
    cause, remedy = ("", "") if row is None else (row.meaning, row.action)
    return AlarmSeen(alarm.name, int(alarm.level), alarm.text, cause, remedy, alarm.acknowledged, alarm.since)


def _lines(recent: Sequence[Any]) -> tuple[LineSeen, ...]:
    return tuple(LineSeen(number, at, int(level), text) for number, at, text, level in list(recent)[-_LINES:])
