# SPDX-License-Identifier: GPL-3.0-or-later

"""The state of the shipping objects as one hashable value, and the objects made again from it.

`pack` turns an `Arbiter` or a `StationCore` into nested tuples; `unpack` makes an object from them that behaves the
same. Two states that differ only in what cannot matter pack to the same value:

* Times become relative: a packed state always lives at `NOW`. What is longer ago than every limit that looks at it is
  moved to that limit (`Limits` of the exploration are passed in).
* The vehicle's epoch and its last transfer number become `EPOCH` and `NUMBER`; whatever carries such a number moves
  with it. Numbers more than `MEMORY` behind are all the same: older than anything. Nonces all become `NONCE`.
* Counters of dropped messages, attempt numbers and start times feed the journal alone: they are left out.

Each field of each class is listed here with what it is. A field that is not listed stops the exploration: whoever adds
one to the rules says here whether it is a time, a number, or plain.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Collection
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache
from itertools import pairwise
from math import inf
from typing import Any

from gcs_module.ahead import EarlyConsent
from gcs_module.core import StationCore, _Part
from gcs_module.standard_control import StandardControl
from mavproxy_handover.core.arbiter import Arbiter
from mavproxy_handover.core.authority.authority import Authority
from mavproxy_handover.core.authority.candidates import Candidates
from mavproxy_handover.core.authority.contacts import Contacts
from mavproxy_handover.core.authority.control import Echo
from mavproxy_handover.core.authority.coverage import Coverage
from mavproxy_handover.core.authority.foresight import Foresight
from mavproxy_handover.core.authority.hearing import Hearing
from mavproxy_handover.core.authority.links import Links
from mavproxy_handover.core.authority.presence import Presence
from mavproxy_handover.core.authority.rehearsal import Rehearsal
from mavproxy_handover.core.authority.requests import Requests
from mavproxy_handover.core.authority.results import Results, _Pending
from mavproxy_handover.core.authority.start import Start
from mavproxy_handover.core.authority.transfer import Transfer
from mavproxy_handover.core.authority.transfer_manager import READ_S, TransferManager
from mavproxy_handover.core.authority.zones import ZoneTracker
from mavproxy_handover.core.common.causes import CAUSES, Cause, CauseWatch
from mavproxy_handover.core.common.flight import Flight
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.safety.command_verification import CommandVerification
from mavproxy_handover.core.safety.conditions import Conditions
from mavproxy_handover.core.safety.decision_executor import DecisionExecutor
from mavproxy_handover.core.safety.decision_facts import DecisionFacts
from mavproxy_handover.core.safety.emergency import Emergency
from mavproxy_handover.core.safety.gap import Crossing
from mavproxy_handover.core.safety.hold_timer import HoldTimer
from mavproxy_handover.core.safety.mode_source import DOUBT_S, EVIDENCE, ModeTracker
from mavproxy_handover.core.safety.safety import Safety
from mavproxy_handover.core.safety.sentence import Figures
from mavproxy_handover.core.safety.strategy import Strategy

__all__ = ["EPOCH", "GAP_S", "MEMORY", "NONCE", "NOW", "NUMBER", "STILL", "Packed", "Packer", "Shift", "shifted"]

NOW = 1000.0
EPOCH = 100
NUMBER = 1000
NONCE = 10_000
#: how many epochs and transfers back the exploration tells apart
MEMORY = 3
#: the limit of the gaps that are explored: a crossing that began earlier than that is one that is too long
GAP_S = 6.0

Packed = tuple[Any, ...]


def _no_standard() -> StandardControl:
    """The operator-control standard at a station: every explored vehicle has our companion, so it is not used."""
    control = StandardControl(0, str, str, automatic=False)
    control.ours()
    return control


@dataclass(frozen=True, slots=True)
class Shift:
    """How far the frame of reference moves: it is subtracted from every time and number."""

    time_s: float = 0.0
    epoch: int = 0
    number: int = 0


STILL = Shift()


def _behind(value: int, base: int) -> int:
    return max(value, base - MEMORY - 1)


@cache
def shifted(value: Any, shift: Shift) -> Any:
    """A message, key or view in the moved frame; values without numbers come back as they are."""
    if not is_dataclass(value):
        return value
    changes: dict[str, Any] = {}
    for field in fields(value):
        old = getattr(value, field.name)
        if field.name == "epoch":
            new: Any = _behind(old - shift.epoch, EPOCH)
        elif field.name == "handover_id":
            new = _behind(old - shift.number, NUMBER)
        elif field.name == "nonce":
            new = old and NONCE  # questions are answered at once or never, so which one it was does not matter
        elif is_dataclass(old):
            new = shifted(old, shift)  # type: ignore[arg-type]
        else:
            continue
        if new != old:
            changes[field.name] = new
    return replace(value, **changes) if changes else value  # type: ignore[type-var]


class _Kind:
    """How one field is packed and made again."""

    def pack(self, value: Any, shift: Shift) -> Any:
        return value

    def unpack(self, value: Any) -> Any:
        return value


class _Measured(_Kind):
    """A difference of times, worked out anew at each look: its last digits depend on how far from 0 the times are."""

    def pack(self, value: Any, shift: Shift) -> Any:
        return value and round(value, 6)


class _Value(_Kind):
    """Immutable; may carry epochs, transfer numbers, nonces."""

    def pack(self, value: Any, shift: Shift) -> Any:
        return shifted(value, shift) if shift.epoch or shift.number else value


class _Answer(_Value):
    """An answer to CONNECT: which question it answered does not matter any more."""

    def pack(self, value: Any, shift: Shift) -> Any:
        return value and shifted(value, shift)


class _Time(_Kind):
    """A monotonic time; earlier than `oldest_s` ago is as good as that."""

    def __init__(self, oldest_s: float) -> None:
        self._oldest = NOW - oldest_s

    def pack(self, value: Any, shift: Shift) -> Any:
        return value if value is None or value in (inf, -inf) else max(value - shift.time_s, self._oldest)


class _Ago(_Time):
    """A time that only ever counts as past: never is as good as long ago."""

    def pack(self, value: Any, shift: Shift) -> Any:
        return max(value - shift.time_s, self._oldest)


class _Number(_Kind):
    def __init__(self, which: str, base: int) -> None:
        self._which, self._base = which, base

    def pack(self, value: Any, shift: Shift) -> Any:
        return _behind(value - getattr(shift, self._which), self._base)


class _Epoch(_Number):
    """One that may not be known yet."""

    def pack(self, value: Any, shift: Shift) -> Any:
        return None if value is None else super().pack(value, shift)


class _Most(_Kind):
    """A count that is not told apart beyond a number."""

    def __init__(self, most: int) -> None:
        self._most = most

    def pack(self, value: Any, shift: Shift) -> Any:
        return min(value, self._most)


class _Times(_Kind):
    """A map to times in the future; what has passed is gone. With `oldest_s`: a map to times in the past."""

    def __init__(self, oldest_s: float = 0.0, *, forget: bool = True) -> None:
        self._oldest, self._forget = NOW - oldest_s, forget

    def pack(self, value: Any, shift: Shift) -> Any:
        moved = ((key, max(time - shift.time_s, self._oldest)) for key, time in value.items())
        return tuple(sorted(pair for pair in moved if not self._forget or pair[1] > self._oldest))

    def unpack(self, value: Any) -> Any:
        return dict(value)


class _Waits(_Kind):
    """Causes and when each begins or ends."""

    def pack(self, value: Any, shift: Shift) -> Any:
        return tuple(sorted((cause.value, max(at - shift.time_s, NOW)) for cause, at in value.items()))

    def unpack(self, value: Any) -> Any:
        return {Cause(word): at for word, at in value}


class _Gone(_Kind):
    """Signs that went away, and what is left of the time that they had stayed; what has run back whole is as good as
    never there."""

    def pack(self, value: Any, shift: Shift) -> Any:
        left = (
            (cause.value, stayed - (NOW - (at - shift.time_s)) / CauseWatch.BACK)
            for cause, (at, stayed) in value.items()
        )
        return tuple(sorted(pair for pair in left if pair[1] > 0.0))

    def unpack(self, value: Any) -> Any:
        return {Cause(word): (NOW, stayed) for word, stayed in value}


class _Heard(_Kind):
    """Who was heard of, when, and of which mode; who explains nothing any more is as good as never heard of."""

    def pack(self, value: Any, shift: Shift) -> Any:
        moved = ((hand, at - shift.time_s, flown) for hand, (at, flown) in value.items())
        return frozenset(entry for entry in moved if entry[1] > NOW - EVIDENCE[entry[0]].within_s - DOUBT_S)

    def unpack(self, value: Any) -> Any:
        return {hand: (at, flown) for hand, at, flown in value}


@cache
def _by_cause(words: tuple[str, ...]) -> dict[Cause, str]:
    return dict(zip(CAUSES, words, strict=True))


class _Policies(_Kind):
    """A word for every cause of the table, in its order."""

    def pack(self, value: Any, shift: Shift) -> Any:
        return tuple(value.values())

    def unpack(self, value: Any) -> Any:
        return _by_cause(value).copy()


class _Set(_Kind):
    def pack(self, value: Any, shift: Shift) -> Any:
        return tuple(sorted(value))

    def unpack(self, value: Any) -> Any:
        return set(value)


class _Facts(_Kind):
    def pack(self, value: Any, shift: Shift) -> Any:
        return tuple(value.items())

    def unpack(self, value: Any) -> Any:
        return dict(value)


class _Fixed(_Kind):
    """Left out: made anew, the same for all states."""

    def __init__(self, make: Callable[[], Any]) -> None:
        self.make = make

    def pack(self, value: Any, shift: Shift) -> Any:
        return None

    def unpack(self, value: Any) -> Any:
        return self.make()


class _Never(_Fixed):
    """What the exploration never sets off: nobody is told of borders ahead (tests/core/test_foresight.py), and nothing
    is rehearsed (tests/core/test_rehearsal.py)."""

    def pack(self, value: Any, shift: Shift) -> Any:
        if value != self.make():
            raise TypeError(f"an exploration that comes by this says here what {value!r} is")


class _Shared(_Kind):
    """Left out: a reference to what is packed elsewhere, made again by `_share`."""

    def pack(self, value: Any, shift: Shift) -> Any:
        return None


class _Asked(_Kind):
    """Open questions of CONNECT. The exploration answers the last one at once or never: the older ones stay open. One
    is asked each second, so the last one is never too old."""

    def pack(self, value: Any, shift: Shift) -> Any:
        return bool(value)

    def unpack(self, value: Any) -> Any:
        return deque([(NONCE, NOW)] if value else [], maxlen=5)


class _Fates(_Kind):
    """Which questions were answered. Older ones than the window holds play no part. A whole window of answers, one each
    second, is packed as the time of the last one."""

    def __init__(self, limits: Limits) -> None:
        window_s = limits.answer_s + limits.deaf_lost_s / (1.0 - limits.deaf_share)
        self._full = NOW - window_s
        self._oldest = self._full - limits.connect_interval_s
        self._interval_s = limits.connect_interval_s

    def pack(self, value: Any, shift: Shift) -> Any:
        moved = tuple((at - shift.time_s, answered) for at, answered in value)
        kept = tuple(entry for entry in moved if entry[0] > self._oldest)
        whole = bool(kept) and kept[0][0] <= self._full and all(answered for _at, answered in kept)
        whole = whole and all(after - before == self._interval_s for (before, _), (after, _) in pairwise(kept))
        return kept[-1][0] if whole else kept

    def unpack(self, value: Any) -> Any:
        if isinstance(value, float):
            value = [(value - ago, True) for ago in range(9) if value - ago > self._oldest][::-1]
        return deque(value)


class _Object(_Kind):
    def __init__(self, packer: _Class) -> None:
        self.packer = packer

    def pack(self, value: Any, shift: Shift) -> Any:
        return None if value is None else self.packer.pack(value, shift)

    def unpack(self, value: Any) -> Any:
        return None if value is None else self.packer.unpack(value)


class _Objects(_Object):
    """A map of objects, in its order."""

    def pack(self, value: Any, shift: Shift) -> Any:
        return tuple((key, self.packer.pack(each, shift)) for key, each in value.items())

    def unpack(self, value: Any) -> Any:
        return {key: self.packer.unpack(each) for key, each in value}


class _Class:
    """One class of the rules: its fields and what they are.

    Packing and unpacking is where the time of an exploration goes: they are compiled, one function for each class.
    """

    def __init__(self, cls: type, **kinds: _Kind) -> None:
        self._cls = cls
        self._names = kinds.keys()
        slots = getattr(cls, "__slots__", None)
        if slots is not None:
            self._agree(set(slots))
        self._pack: Callable[[Any, Shift], Packed] = _compiled(
            cls, kinds, f"value, shift: return ({''.join(f'{_packing(kind, name)}, ' for name, kind in kinds.items())})"
        )
        #: the state of an object, in a frame that is moved
        self.pack = self._pack_all if slots is None else self._pack
        every = "".join(f"value.{name}, " for name in kinds)
        made = "".join(_unpacking(kind, name) for name, kind in kinds.items())
        #: an object in this state
        self.unpack: Callable[[Packed], Any] = _compiled(
            cls, kinds, f"packed: value = new(cls); {every} = packed; {made}return value"
        )

    def _agree(self, present: Collection[str]) -> None:
        if self._names != present:
            odd = ", ".join(sorted(self._names ^ set(present)))
            raise TypeError(f"{self._cls.__name__}: say in canonical.py what {odd} is")

    def _pack_all(self, value: Any, shift: Shift) -> Packed:
        self._agree(value.__dict__.keys())
        return self._pack(value, shift)


def _packing(kind: _Kind, name: str) -> str:
    """The source of a packed field. What can be said without a call is."""
    way = type(kind).pack
    if way is _Kind.pack:
        return f"value.{name}"
    if way in (_Fixed.pack, _Shared.pack):
        return "None"
    packed = f"pack_{name}(value.{name}, shift)"
    return f"None if value.{name} is None else {packed}" if way is _Object.pack else packed


def _unpacking(kind: _Kind, name: str) -> str:
    """The source that makes a field from what was packed, which stands in its place."""
    way = type(kind).unpack
    if way is _Kind.unpack:
        return ""
    if way is _Fixed.unpack:
        return f"value.{name} = make_{name}(); "
    made = f"unpack_{name}(value.{name})"
    return f"value.{name} = {f'None if value.{name} is None else {made}' if way is _Object.unpack else made}; "


def _compiled(cls: type, kinds: dict[str, _Kind], source: str) -> Any:
    """The function with these parameters and this body."""
    scope: dict[str, Any] = {"cls": cls, "new": object.__new__}
    for name, kind in kinds.items():
        inner = kind.packer if type(kind) is _Object else kind
        scope |= {f"pack_{name}": inner.pack, f"unpack_{name}": inner.unpack}
        if isinstance(kind, _Fixed):
            scope[f"make_{name}"] = kind.make
    exec(f"def made({source}".replace(":", "):", 1), scope)
    return scope["made"]


class _Echo(_Object):
    """Until when a request may be repeated does not matter where there is none."""

    def __init__(self, cls: type, **kinds: _Kind) -> None:
        super().__init__(_Class(cls, **kinds))

    def pack(self, value: Any, shift: Shift) -> Any:
        return None if value._request is None else super().pack(value, shift)

    def unpack(self, value: Any) -> Any:
        return Echo() if value is None else super().unpack(value)


def _share(arbiter: Arbiter) -> None:
    """The parts of an arbiter refer to each other: what `_Shared` left out."""
    flight, authority, candidates, transfer_manager = (
        arbiter._flight,
        arbiter._authority,
        arbiter._candidates,
        arbiter._transfer_manager,
    )
    presence = arbiter._presence = arbiter._contacts.presence
    authority._flight = flight
    candidates._presence = presence
    for part in (transfer_manager, arbiter._requests):
        part._authority, part._presence, part._candidates = authority, presence, candidates
    transfer_manager._flight = flight
    foresight = transfer_manager.foresight
    foresight._authority, foresight._flight, foresight._presence = authority, flight, presence
    foresight._candidates = candidates
    arbiter._requests._transfer_manager = transfer_manager
    arbiter._start._authority, arbiter._start._flight, arbiter._start._candidates = authority, flight, candidates
    arbiter._start._transfer_manager = transfer_manager
    rehearsal = arbiter._rehearsal
    rehearsal._authority, rehearsal._flight, rehearsal._transfer_manager = authority, flight, transfer_manager
    rehearsal._start = arbiter._start
    coverage = Coverage(authority, flight, candidates, arbiter._limits)
    safety = arbiter._safety
    safety._authority, safety._flight = coverage, flight
    parts = safety.conditions, safety.facts, safety.executor
    for each in (*parts, safety.executor._figures):
        each._authority, each._flight = coverage, flight
    for each in (safety.facts, safety.executor):
        each._conditions, each._hold_timer = safety.conditions, safety.hold_timer
        each._mode, each._verification = safety.mode, safety.verification
    safety.executor._emergency, safety.executor._facts = safety.emergency, safety.facts


class Packer:
    """Packs and unpacks the objects of one exploration."""

    def __init__(self, limits: Limits, names: dict[int, str]) -> None:
        plain, value, the_limits = _Kind(), _Value(), _Fixed(lambda: limits)
        epoch, number = _Number("epoch", EPOCH), _Number("number", NUMBER)
        longest_s = max(limits.heartbeat_lost_s, limits.connect_lost_s, limits.dwell_s) + 1.0
        time = _Time(longest_s)
        names_fixed = _Fixed(lambda: names)
        hearing = _Class(
            Hearing,
            _fates=_Fates(limits),
            _good_since=_Time(limits.deaf_back_s * 27.0),
            _limits=the_limits,
            barred_at=_Time(0.0),
            losses=_Most(4),
            share=_Measured(),
            _asked_s=_Measured(),
        )
        presence = _Class(
            Presence,
            hearing=_Object(hearing),
            _limits=the_limits,
            station=plain,
            heard_at=_Ago(limits.heartbeat_lost_s),
            answered_at=_Ago(max(limits.connect_lost_s, limits.deaf_lost_s)),
            answer=_Answer(),
            ask_at=_Time(0.0),
            asked=_Asked(),
            shows_control=plain,
            told_why=_Fixed(lambda: None),
        )
        transfer = _Class(
            Transfer,
            _asked_until=time,
            _entered_at=_Time(limits.answer_s),
            _limits=the_limits,
            _operator_timeout_s=plain,
            _pause_s=plain,
            asked_at=_Time(limits.answer_s),
            asking=plain,
            fallen=plain,
            others=plain,
            hurry_over=plain,
            ready=plain,
            attempt=_Fixed(lambda: 1),
            read_until=_Ago(0.0),
            consented=plain,
            crossing=plain,
            forced=plain,
            forced_until=time,
            key=value,
            operator_asked=plain,
            partner_asks=plain,
            question_open=plain,
            stale_answer=plain,
            reason=plain,
            retry_at=_Time(0.0),
            started_at=_Fixed(lambda: NOW),
            step=plain,
            timeout_at=_Time(0.0),
        )
        pending = _Class(
            _Pending,
            result=value,
            retry_at=_Time(0.0),
            pause_s=plain,
            give_up_at=_Time(0.0),
            attempt=_Fixed(lambda: 1),
        )
        results = _Class(Results, _limits=the_limits, _pending=_Objects(pending), _told=plain, last=value)
        zones = _Class(
            ZoneTracker,
            _facts=_Facts(),
            _fresh=_Set(),
            _inside=_Set(),
            _limits=the_limits,
            _moved_at=_Ago(limits.dwell_s),
            out_since=_Time(0.0),
        )
        flight = _Class(
            Flight,
            _limits=the_limits,
            armed=plain,
            aloft=plain,
            circle_m=plain,
            circles_s=plain,
            handling=plain,
            rehearsing=_Never(lambda: False),
            foreign=plain,
            energy_short=plain,
            gaps_lack=plain,
            return_lacks=plain,
            aircraft_lacks=plain,
            mission_lacks=plain,
            heights_lack=plain,
            box_lacks=plain,
            _autopilot_at=_Ago(limits.autopilot_lost_s),
            _position_at=_Ago(limits.position_stale_s),
            _stale_told=plain,
            _guard=plain,
            _guard_ours=plain,
            _guard_at=_Ago(limits.guard_lost_s),
            _guard_misfit=plain,
            _guard_misfit_at=_Ago(limits.guard_lost_s),
        )
        authority = _Class(
            Authority,
            _flight=_Shared(),
            _may_be_ahead=_Set(),
            _shown=plain,
            claimant=plain,
            names=names_fixed,
            owner=plain,
            lost=plain,
            alone=plain,
            _lost_at=_Ago(limits.forced_timeout_s),
            epoch=epoch,
            phase=plain,
            transfer=_Object(transfer),
            handover_id=number,
            takeover_allowed=plain,
            released=plain,
            starting=plain,
            recover_until=_Time(0.0),
            view=value,
        )
        contacts = _Class(
            Contacts,
            _vehicle=plain,
            _nonce=_Fixed(lambda: NONCE - 1),
            _limits=the_limits,
            presence=_Objects(presence),
        )
        links = _Class(
            Links,
            _limits=the_limits,
            _weak=_Times(limits.link_weak_s, forget=False),
            _weak_until=_Times(limits.link_steady_s),
            _attacked=_Set(),
        )
        candidates = _Class(
            Candidates,
            _presence=_Shared(),
            _limits=the_limits,
            _retry_after=_Times(),
            _failed=_Set(),
            _mute=_Set(),
            zones=_Object(zones),
            links=_Object(links),
            mission=plain,
        )
        foresight = _Class(
            Foresight,
            _ahead=_Never(lambda: None),
            _authority=_Shared(),
            _candidates=_Shared(),
            _flight=_Shared(),
            _limits=the_limits,
            _number=plain,
            _presence=_Shared(),
            _said=_Never(dict),
            _say_at=_Fixed(lambda: inf),
        )
        transfer_manager = _Class(
            TransferManager,
            _authority=_Shared(),
            _flight=_Shared(),
            _presence=_Shared(),
            _candidates=_Shared(),
            _limits=the_limits,
            results=_Object(results),
            _aborted_at=_Ago(READ_S),
            echo=_Echo(Echo, _request=plain, _until=_Ago(0.0)),
            foresight=_Object(foresight),
        )
        requests = _Class(
            Requests, _authority=_Shared(), _presence=_Shared(), _candidates=_Shared(), _transfer_manager=_Shared()
        )
        start = _Class(
            Start, _authority=_Shared(), _flight=_Shared(), _candidates=_Shared(), _transfer_manager=_Shared()
        )
        rehearsal = _Class(
            Rehearsal,
            _authority=_Shared(),
            _transfer_manager=_Shared(),
            _flight=_Shared(),
            _limits=the_limits,
            _nobody_since=_Never(lambda: None),
            _start=_Shared(),
        )
        fresh = Emergency(limits)
        watch = _Class(
            CauseWatch,
            _begins_at=_Waits(),
            _clear_s=_Fixed(lambda: fresh._watch._clear_s),
            _ends_at=_Waits(),
            _gone=_Gone(),
            _hold_off_s=_Fixed(lambda: fresh._watch._hold_off_s),
            _off=plain,
            active=plain,
        )
        strategy = _Class(Strategy, _lasts=plain, decision=plain, overruled=plain, policies=_Policies())
        emergency = _Class(
            Emergency,
            _grave=plain,
            _left=plain,
            _resumed=plain,
            _strategy=_Object(strategy),
            _watch=_Object(watch),
            told=plain,
        )
        mode = _Class(
            ModeTracker,
            _asked=_Heard(),
            _before=plain,
            _flying=plain,
            _overtaken=plain,
            _since=_Time(DOUBT_S),
            _unheard=plain,
            chosen_by=plain,
            flown=plain,
            landing=plain,
            name=plain,
            radio=plain,
        )
        verification = _Class(
            CommandVerification,
            _commanded_at=_Time(limits.obey_s),
            _interrupted=plain,
            _deaf=plain,
            _excused=plain,
            _first_speed=plain,
            _last_m=plain,
            _limits=the_limits,
            _motion=plain,
            _nearest_m=plain,
            _refused=plain,
            _shown=plain,
            _since=_Time(max(limits.obey_s, limits.stuck_s)),
            _tries=plain,
            due_at=_Time(0.0),
            handling=plain,
            order=plain,
            shows_by=_Time(0.0),
            stands=plain,
            unable=plain,
        )
        figures = _Class(Figures, _authority=_Shared(), _flight=_Shared())
        executor = _Class(
            DecisionExecutor,
            _again_at=_Fixed(lambda: -inf),
            _authority=_Shared(),
            _conditions=_Shared(),
            _emergency=_Shared(),
            _facts=_Shared(),
            _figures=_Object(figures),
            _flight=_Shared(),
            _hold_cause=plain,
            _hold_timer=_Shared(),
            _mode=_Shared(),
            _tells_at=_Time(0.0),
            _told_place=plain,
            _verification=_Shared(),
        )
        conditions = _Class(
            Conditions,
            _around=plain,
            _authority=_Shared(),
            _blind_since=_Time(1.0),
            _ended_for=plain,
            _flight=_Shared(),
            _limits=the_limits,
            _passed_m=plain,
            crossing=_Object(_Class(Crossing, gap=plain, since=_Time(GAP_S))),
            reported=plain,
            seen=plain,
        )
        hold_timer = _Class(HoldTimer, _limits=the_limits, _used_up=plain, held_at=_Time(limits.hold_s), resuming=plain)
        facts = _Class(
            DecisionFacts,
            _authority=_Shared(),
            _conditions=_Shared(),
            _flight=_Shared(),
            _hold_timer=_Shared(),
            _in_gap=plain,
            _may_hold=plain,
            _mode=_Shared(),
            _verification=_Shared(),
            place=plain,
        )
        safety = _Class(
            Safety,
            _authority=_Shared(),
            _flight=_Shared(),
            conditions=_Object(conditions),
            emergency=_Object(emergency),
            executor=_Object(executor),
            facts=_Object(facts),
            hold_timer=_Object(hold_timer),
            mode=_Object(mode),
            verification=_Object(verification),
        )
        self._arbiter = _Class(
            Arbiter,
            _safety=_Object(safety),
            _parent=plain,
            _limits=the_limits,
            _flight=_Object(flight),
            _authority=_Object(authority),
            _contacts=_Object(contacts),
            _presence=_Shared(),
            _candidates=_Object(candidates),
            _transfer_manager=_Object(transfer_manager),
            _requests=_Object(requests),
            _start=_Object(start),
            _rehearsal=_Object(rehearsal),
            _interrupted=plain,
            dropped=_Fixed(Counter),
            _epoch=_Epoch("epoch", EPOCH),
            _epoch_since=_Ago(limits.deaf_lost_s),
        )
        part = _Class(
            _Part,
            key=value,
            as_partner=plain,
            consent=plain,
            crossing=plain,
            connected=plain,
            forced=plain,
            told_left_s=plain,
            ready=plain,
        )
        beforehand = _Class(EarlyConsent, _own=plain, ahead=_Never(lambda: None))
        self._station = _Class(
            StationCore,
            _station=plain,
            vehicle_name=plain,
            _automatic=plain,
            manned=plain,
            operator=plain,
            _armed=plain,
            control=_Fixed(_no_standard),
            _names=names_fixed,
            _peers_heard=_Times(StationCore.PEER_LOST_S, forget=False),
            _vehicle_heard=_Ago(StationCore.VEHICLE_LOST_S),
            _unanswered_at=_Ago(READ_S),
            asked_at=_Fixed(lambda: -inf),
            _peers_up=plain,
            _zone=plain,
            _zone_ending=plain,
            _answer_until=plain,
            alone=plain,
            _read_until=_Ago(0.0),
            _vehicle_lost=plain,
            _part=_Object(part),
            _early_consent=_Object(beforehand),
            _wished_until=_Ago(0.0),
            _wish_accepted=plain,
            _latest=value,
            _announced=value,
            _over=value,
            _too_soon=value,
            _too_soon_until=_Ago(0.0),
            _why=plain,
            _crossing=plain,
            digest=plain,
            vehicle_digest=plain,
            _stage=plain,
            epoch=epoch,
            commander=plain,
            partner=plain,
            phase=plain,
        )

    def pack_arbiter(self, arbiter: Arbiter, shift: Shift = STILL) -> Packed:
        """The arbiter's state, in a frame moved by `shift`."""
        return self._arbiter.pack(arbiter, shift)

    def unpack_arbiter(self, packed: Packed) -> Arbiter:
        """An arbiter in this state."""
        arbiter: Arbiter = self._arbiter.unpack(packed)
        _share(arbiter)
        return arbiter

    def pack_station(self, core: StationCore, shift: Shift = STILL) -> Packed:
        """The station's state, in a frame moved by `shift`."""
        return self._station.pack(core, shift)

    def unpack_station(self, packed: Packed) -> StationCore:
        """A station in this state."""
        core: StationCore = self._station.unpack(packed)
        return core
