# SPDX-License-Identifier: GPL-3.0-or-later

"""Bad links on demand: loss, burst loss, delay, jitter, reordering, duplicates, one-way cuts, little bandwidth.

`Impairment` is one direction of one link, pure: a datagram and the time go in, what arrives and when comes out. The
same object serves unit tests in virtual time and, in `sitl.run.bad_links`, UDP sockets between real programs. Its state
is the `Weather` (`sitl.script.weather`), which may change at any time, by a call or by a timeline set beforehand.

The model, for each datagram in this order:

1. cut: it is lost. It is also lost in the pauses of a rhythm, which go by the clock: all links have them at the same
   time.
2. bursts (Gilbert-Elliott): the link is good or bad; before each datagram it may change, with the two probabilities. In
   the bad state a datagram is lost with `bad_loss`, in the good one with `loss`.
3. rate: it waits until those before it have been sent at `rate_bytes_per_s`; one that would wait longer than `queue_s`
   is lost, as at a full modem.
4. delay, and jitter evenly between 0 and `jitter_s` on top. Jitter alone keeps the order, as most networks do.
5. reordering: with its probability it is held for `reorder_s` more, and later ones pass it.
6. duplicates: with its probability it comes twice, the copy under its own jitter.

For one seed and one series of datagrams everything is the same on every run. Each effect has its own random source and
draws one number (jitter: two) for each datagram, whether it is switched on or not. So changing one value does not
change the draws of the others.
"""

from __future__ import annotations

from random import Random
from typing import Final

from sitl.script.weather import Weather

__all__ = ["Impairment"]

_EFFECTS: Final = ("loss", "burst", "jitter", "reorder", "duplicate")


class Impairment:
    """One direction of one link. `seed` may be any text or number; two directions need two seeds."""

    def __init__(self, seed: int | str, weather: Weather | None = None) -> None:
        self.weather = weather or Weather()
        self.passed = 0
        self.lost = 0
        # texts seed the same on every run and every machine
        self._luck = {effect: Random(f"{seed}/{effect}") for effect in _EFFECTS}
        self._bad = False
        self._sent_at = float("-inf")
        self._last_at = float("-inf")
        self._timeline: list[tuple[float, dict[str, object]]] = []

    def change(self, **changes: object) -> None:
        """Change the weather from the next datagram on. Raises WeatherError."""
        self.weather = self.weather.changed(**changes)

    def schedule(self, at: float, **changes: object) -> None:
        """Change the weather for datagrams from time `at` on. Raises WeatherError."""
        Weather().changed(**changes)
        self._timeline.append((at, changes))
        self._timeline.sort(key=lambda entry: entry[0])

    def plan(self, datagram: bytes, now: float) -> list[tuple[float, bytes]]:
        """When this datagram arrives: not at all, once, or twice. `now` (s) must not go back."""
        while self._timeline and self._timeline[0][0] <= now:
            self.change(**self._timeline.pop(0)[1])
        weather, luck = self.weather, {effect: self._luck[effect].random() for effect in _EFFECTS}
        second_jitter = self._luck["jitter"].random()
        # the state of the link goes on while it is cut
        self._bad = luck["burst"] >= weather.to_good if self._bad else luck["burst"] < weather.to_bad
        pauses = weather.off_s > 0 and now % (weather.on_s + weather.off_s) >= weather.on_s
        if weather.cut or pauses or luck["loss"] < (weather.bad_loss if self._bad else weather.loss):
            self.lost += 1
            return []
        leaves_at = now
        if weather.rate_bytes_per_s > 0:
            begins_at = max(now, self._sent_at)
            if begins_at - now > weather.queue_s:
                self.lost += 1
                return []
            leaves_at = self._sent_at = begins_at + len(datagram) / weather.rate_bytes_per_s
        at = leaves_at + weather.delay_s + weather.jitter_s * luck["jitter"]
        if luck["reorder"] < weather.reorder:
            at += weather.reorder_s
        else:
            at = self._last_at = max(at, self._last_at)
        self.passed += 1
        arrivals = [(at, datagram)]
        if luck["duplicate"] < weather.duplicate:
            arrivals.append((at + weather.jitter_s * second_jitter, datagram))
        return arrivals
