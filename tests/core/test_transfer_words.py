# SPDX-License-Identifier: GPL-3.0-or-later

"""One word too many, from anyone concerned and in any step of a transfer: whatever it is, the transfer ends."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from mavproxy_handover.core.common.events import Action, Event, Tick
from mavproxy_handover.core.common.messages import DisconnectHandover, DroneConnected, Message, OkHandover, OnHandover
from mavproxy_handover.core.common.model import Consent, ZoneFact
from tests.core.bench import A, B, Bench, C, TransferKey, inside, outside

#: where the aircraft is when a transfer begins: one may be asked, several may, the zone ends ahead, or has ended
PLACES: dict[str, tuple[ZoneFact, ...]] = {
    "overlap": (inside(A, 30.0), inside(B), outside(C)),
    "border ahead": (inside(A, 6.0), inside(B), inside(C)),
    "zone ended, one partner": (outside(A), inside(B), outside(C)),
    "zone ended, two partners": (outside(A), inside(B), inside(C)),
}
#: the words that bring a transfer on, by its key
STEPS: tuple[Callable[[TransferKey], tuple[int, Message]], ...] = (
    lambda key: (key.to_station, OnHandover(key, Consent.GRANTED)),
    lambda key: (key.from_station, OkHandover(key, Consent.GRANTED)),
    lambda key: (key.to_station, DroneConnected(key)),
)
#: the word too many
WORDS: dict[str, Callable[[TransferKey], Message]] = {
    **{f"partner {each.name}": lambda key, each=each: OnHandover(key, each) for each in Consent},
    **{f"commander {each.name}": lambda key, each=each: OkHandover(key, each) for each in Consent},
    "connected": DroneConnected,
    "released": DisconnectHandover,
}
#: a transfer that has an operator to wait for takes so long at most (s), and some more
LONGEST_S = 75.0


class Counted(Bench):
    """A bench that counts the ticks of one moment."""

    ticks = 0

    def give(self, event: Event) -> list[Action]:
        self.ticks = self.ticks + 1 if isinstance(event, Tick) else 0
        assert self.ticks <= 50, "a time that is up ends nothing"
        return super().give(event)


def asked(place: str, *, dead: bool) -> tuple[Counted, TransferKey]:
    """A transfer that has just begun. `dead`: its commander says nothing from now on."""
    bench = Counted()
    bench.alive = {A, B, C}
    bench.on_mission()
    bench.position(*PLACES[place])
    while bench.arbiter.view.partner is None:
        bench.run(0.1)
    if dead:
        bench.alive = {B, C}
    view = bench.arbiter.view
    assert view.partner is not None
    return bench, TransferKey(A, view.partner, view.handover_id, view.epoch)


@pytest.mark.slow
@pytest.mark.parametrize("dead", [False, True])
@pytest.mark.parametrize("word", WORDS)
@pytest.mark.parametrize("step", range(len(STEPS) + 1))
@pytest.mark.parametrize("place", PLACES)
def test_it_ends_whatever_is_said_once_more(place: str, step: int, word: str, dead: bool) -> None:
    """Nobody says anything after it. `WAITING` of a partner that has consented kept it open for ever."""
    bench, key = asked(place, dead=dead)
    for advance in STEPS[:step]:
        bench.say(*advance(key))
    message = WORDS[word](key)
    sender = key.to_station if isinstance(message, (OnHandover, DroneConnected)) else key.from_station
    bench.say(sender, message)
    transfer = bench.arbiter._authority.transfer
    until = bench.now + LONGEST_S
    while transfer is not None and bench.arbiter._authority.transfer is transfer:
        assert bench.now < until, "it does not end"
        bench.run(1.0)
