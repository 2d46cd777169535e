# SPDX-License-Identifier: GPL-3.0-or-later

"""Charge left in the batteries: the least of all that their values say.

Rules:

1. The count is the autopilot's: energy drawn since it began to count, else charge times voltage, else power times time.
   The percentage is another count of its own. The lower one holds.
2. The count takes every pack for full at boot. At rest on the ground, with the number of cells known, the voltage says
   what is in it, to `DOUBT` of the pack: it may hold no more than that, and what is drawn later is taken off there.
3. Under load the voltage, made up for by the resistance that the take-off showed, has the same say; without a known
   resistance only a cell below `EMPTY_CELL_V` has one.
4. In flight what is left never grows: counters that go back, or a percentage that grows, are named and not believed. On
   the ground, disarmed, they mean another pack.
5. A fall that no motors can cause is named, and believed when it has been said `PATIENCE` times in a row.
6. If a battery stops reporting, its last power in flight is extrapolated, or the power of the settings if none was
  measured. It is named after `SILENT_S`. A battery that was never heard holds nothing. Several packs feed one aircraft:
  each counts as the emptiest of them.
7. Values that make the charge smaller outlive a restart in flight (`PackMemory`), because after a restart the counters
  say more. They are saved in steps of `_KEPT_PART` of the pack, because each change is written to a disk. On the ground
  they do not count any more: that is another flight.

Source of the voltages: rest voltage of lithium polymer cells as chargers' makers print it; it is flat in the middle,
which is why it is worth no more than `DOUBT`.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Final

from mavproxy_handover.core.common.snapshot import PackMemory

__all__ = [
    "DOUBT",
    "EMPTY_CELL_V",
    "PATIENCE",
    "SILENT_S",
    "Batteries",
    "Charge",
    "PackReport",
    "rest_part",
]

#: how far a charge that is read off a voltage may be wrong, as a part of the pack
DOUBT: Final = 0.1
EMPTY_CELL_V: Final = 3.3
PATIENCE: Final = 3
SILENT_S: Final = 5.0
#: of what `most_w` gives in the time between two reports, and a part of the pack: percentages are whole numbers
_SLACK_PART: Final = 0.02
#: below this current (A) a voltage is one at rest, and a power none to fly with
_REST_A: Final = 2.0
#: current (A) from which on the voltage tells the resistance, and for how long (s) after the last rest
_LOAD_A, _LOAD_WITHIN_S = 5.0, 60.0
#: no more resistance (ohm) for each cell than this is believed
_MOST_OHM_A_CELL: Final = 0.03
#: steps in which the values for a restart are saved: a part of the pack, and of its resistance (ohm for each cell)
_KEPT_PART, _KEPT_OHM_A_CELL = 0.05, 0.0005
#: volts of a cell at rest, and the part of the charge that it holds then
_REST: Final = (
    (3.27, 0.0),
    (3.61, 0.05),
    (3.69, 0.1),
    (3.73, 0.2),
    (3.77, 0.3),
    (3.80, 0.4),
    (3.84, 0.5),
    (3.87, 0.6),
    (3.95, 0.7),
    (4.02, 0.8),
    (4.11, 0.9),
    (4.20, 1.0),
)


def rest_part(cell_v: float) -> float:
    """The part of the charge, 0 to 1, that a lithium polymer cell holds at that rest voltage."""
    above = bisect_right(_REST, (cell_v, 2.0))
    if above == 0:
        return 0.0
    if above == len(_REST):
        return 1.0
    (low_v, low), (high_v, high) = _REST[above - 1], _REST[above]
    return low + (high - low) * (cell_v - low_v) / (high_v - low_v)


@dataclass(frozen=True, slots=True)
class PackReport:
    """Report of one battery monitor; None: not known. `used_*`: since the autopilot began to count. `remaining`: 0 to
    1."""

    used_wh: float | None = None
    used_mah: float | None = None
    remaining: float | None = None
    voltage_v: float | None = None
    current_a: float | None = None

    def sane(self) -> PackReport:
        """The same without values that are no numbers, or none that a battery can have."""

        def bounded(value: float | None, low: float, high: float) -> float | None:
            return value if value is not None and isfinite(value) and low <= value <= high else None

        return PackReport(
            used_wh=bounded(self.used_wh, 0.0, 1e6),
            used_mah=bounded(self.used_mah, 0.0, 1e8),
            remaining=bounded(self.remaining, 0.0, 1.0),
            voltage_v=bounded(self.voltage_v, 0.5, 1000.0),
            current_a=bounded(self.current_a, 0.0, 10_000.0),
        )

    @property
    def power_w(self) -> float | None:
        """What is drawn now."""
        return None if self.voltage_v is None or self.current_a is None else self.voltage_v * self.current_a


@dataclass(frozen=True, slots=True)
class Charge:
    """Charge and power of all batteries together; `left_wh`, `power_w` None: not known."""

    left_wh: float | None
    power_w: float | None
    trouble: tuple[str, ...]


class _Pack:
    """One battery. Times are monotonic seconds, energies Wh."""

    def __init__(self, number: int, full_wh: float, cells: float | None, most_w: float, flies_w: float) -> None:
        self._name = f"battery {number}"
        self._full_wh = full_wh
        self._cells = cells
        self._most_w = most_w
        self.heard_at: float | None = None
        self.power_w: float | None = None
        #: for a run after this one; None on the ground
        self.memory: PackMemory | None = None
        #: taken up from the run before this one, and in flight since
        self._resumed = False
        #: drawn in the air, as it was last known
        self._flies_w = flies_w
        self._left_wh: float | None = None
        self._before: PackReport | None = None
        #: drawn in all, None before anything counts
        self._used_wh: float | None = None
        #: no more than this can be drawn in all, by what the voltage said at rest
        self._most_wh: float | None = None
        self._rested_at: float | None = None
        self._rest_v: float | None = None
        self._ohm: float | None = None
        self._falls = 0
        self._odd: dict[str, str] = {}

    def resume(self, memory: PackMemory, now: float) -> None:
        """A restart in flight: what was known before it holds on, as if it had just been said."""
        if memory.left_wh is None:
            return
        self._resumed, self.memory, self.heard_at = True, memory, now
        self._left_wh, self._used_wh = memory.left_wh, memory.used_wh
        self._most_wh, self._ohm = memory.most_wh, memory.ohm

    def add_report(self, report: PackReport, now: float, on_ground: bool) -> None:
        """A report of the monitor."""
        report = report.sane()
        if on_ground and self._resumed:  # the flight that it was taken up from is over
            self._resumed, self._left_wh, self._used_wh, self._most_wh, self._ohm = False, None, None, None, None
        since_s = 0.0 if self.heard_at is None else max(0.0, now - self.heard_at)
        self._odd.clear()
        used_before = self._used_wh
        self._count(report, since_s, on_ground)
        self._rest(report, now, on_ground)
        left = self._least(report, now)
        if left is not None and self._left_wh is not None:
            if self._before is not None and self._falls_too_fast(left, since_s):
                self._odd["jump"] = f"{self._name} says that {left:.1f} Wh are left after {self._left_wh:.1f} Wh"
                self._used_wh = used_before
                self._left_wh = max(left, self._left_wh - self._draws_w(on_ground) * since_s / 3600.0)
                self.heard_at = now
                self._keep(on_ground)
                return
            if not on_ground:
                left = min(left, self._left_wh)
        self._falls = 0
        if left is not None:
            self._left_wh = left
        elif self._left_wh is not None:
            self._left_wh = max(0.0, self._left_wh - self._draws_w(on_ground) * since_s / 3600.0)
        if left is None:
            self._odd["silent"] = f"{self._name} does not say what is left"
        self.heard_at, self._before, self.power_w = now, report, report.power_w
        if not on_ground and report.power_w is not None and (report.current_a or 0.0) >= _REST_A:
            self._flies_w = report.power_w
        self._keep(on_ground)

    def left_wh(self, now: float, on_ground: bool) -> float | None:
        """What is left now; silence goes on as it was before it."""
        if self._left_wh is None or self.heard_at is None:
            return None
        return max(0.0, self._left_wh - self._draws_w(on_ground) * max(0.0, now - self.heard_at) / 3600.0)

    def trouble(self, now: float) -> list[str]:
        """What is odd about it, in words."""
        if self.heard_at is not None and now - self.heard_at > SILENT_S:
            return [*self._odd.values(), f"{self._name} has been silent for {now - self.heard_at:.0f} s"]
        return list(self._odd.values())

    # ---- how it is found out --------------------------------------------------------------------------------------

    def _draws_w(self, on_ground: bool) -> float:
        """What it draws while it does not say so."""
        return self.power_w or 0.0 if on_ground else self._flies_w

    def _keep(self, on_ground: bool) -> None:
        """What a run after this one needs, if it is news."""
        found = PackMemory(self._left_wh, self._used_wh, self._most_wh, self._ohm)
        if on_ground:
            self.memory = None
        elif self.memory is None or self._steps(found) != self._steps(self.memory):
            self.memory = found

    def _steps(self, memory: PackMemory) -> tuple[object, ...]:
        left = None if memory.left_wh is None else int(memory.left_wh / (_KEPT_PART * self._full_wh))
        ohm = None if memory.ohm is None else int(memory.ohm / (_KEPT_OHM_A_CELL * (self._cells or 1.0)))
        return left, ohm

    def _count(self, report: PackReport, since_s: float, on_ground: bool) -> None:
        """Count the drawn energy, by the counter that is there. Only on the ground a counter that goes back counts
        again."""
        before = self._before
        begins = self._total(report)
        if before is None or self._used_wh is None:
            self._used_wh = max((wh for wh in (self._used_wh, begins) if wh is not None), default=None)
            return
        drawn = _difference(before.used_wh, report.used_wh)
        if drawn is None:
            charge = _difference(before.used_mah, report.used_mah)
            if charge is not None and report.voltage_v is not None:
                drawn = charge * report.voltage_v / 1000.0
        grown = _difference(before.remaining, report.remaining)
        if drawn is None and report.power_w is None and grown is not None:
            drawn = max(0.0, -grown) * self._full_wh
        if drawn is None:
            drawn = (report.power_w or self._draws_w(on_ground)) * since_s / 3600.0
        if drawn < 0.0 or (grown is not None and grown > _SLACK_PART):
            if on_ground and begins is not None:
                self._used_wh, self._most_wh, self._rested_at, self._left_wh = begins, None, None, None
                return
            self._odd["back"] = f"{self._name} counts back in flight"
        self._used_wh += max(0.0, drawn)

    def _total(self, report: PackReport) -> float | None:
        """What was drawn since the autopilot began to count."""
        if report.used_wh is not None:
            return report.used_wh
        if report.used_mah is not None and report.voltage_v is not None:
            return report.used_mah * report.voltage_v / 1000.0
        return None if report.remaining is None else (1.0 - report.remaining) * self._full_wh

    def _rest(self, report: PackReport, now: float, on_ground: bool) -> None:
        """Rule 2, and the resistance that the first load after a rest shows."""
        volts, amperes = report.voltage_v, report.current_a
        if volts is None or self._cells is None:
            return
        if on_ground and (amperes is None or amperes < _REST_A):
            self._rested_at, self._rest_v = now, volts
            most = min(1.0, rest_part(volts / self._cells) + DOUBT) * self._full_wh
            self._most_wh = None if self._used_wh is None else self._used_wh + most
            counted = None if self._used_wh is None else self._full_wh - self._used_wh
            if counted is not None and counted > most:
                self._odd["rest"] = (
                    f"{self._name} counts {counted:.1f} Wh, its rest voltage {volts:.2f} V says {most:.1f} Wh at most"
                )
            return
        rested = self._rested_at is not None and now - self._rested_at <= _LOAD_WITHIN_S
        if rested and self._rest_v is not None and amperes is not None and amperes >= _LOAD_A:
            ohm = (self._rest_v - volts) / amperes
            self._ohm = max(self._ohm or 0.0, min(ohm, _MOST_OHM_A_CELL * self._cells))

    def _least(self, report: PackReport, now: float) -> float | None:
        """The least of all that is said."""
        full, said = self._full_wh, []
        if self._used_wh is not None:
            said.append(full - self._used_wh)
            if self._most_wh is not None:
                said.append(self._most_wh - self._used_wh)
        if report.remaining is not None:
            said.append(full * report.remaining)
        loaded = self._under_load(report, now)
        if loaded is not None:
            if said and loaded < min(said):
                self._odd["load"] = f"{self._name} has {report.voltage_v:.2f} V under load: {loaded:.1f} Wh at most"
            said.append(loaded)
        return max(0.0, min(said)) if said else None

    def _under_load(self, report: PackReport, now: float) -> float | None:
        volts, amperes = report.voltage_v, report.current_a
        if volts is None or self._cells is None or (self._rested_at == now):
            return None
        if self._ohm is not None and amperes is not None:
            return min(1.0, rest_part((volts + amperes * self._ohm) / self._cells) + DOUBT) * self._full_wh
        return DOUBT / 2.0 * self._full_wh if volts / self._cells < EMPTY_CELL_V else None

    def _falls_too_fast(self, left: float, since_s: float) -> bool:
        assert self._left_wh is not None
        likely = self._most_w * since_s / 3600.0 + _SLACK_PART * self._full_wh
        if self._left_wh - left <= likely or self._falls + 1 >= PATIENCE:
            return False
        self._falls += 1
        return True


def _difference(before: float | None, after: float | None) -> float | None:
    return None if before is None or after is None else after - before


class Batteries:
    """All packs that fly the aircraft.

    `full_wh`: what they give together when full; `count`: how many there are, monitors 0 to count - 1, others are not
    for flying; `cells`: of each, None: not known; `most_w`: more than all motors together can ever draw; `flies_w`:
    what they draw in the air, all of them, where no monitor has said it.
    """

    def __init__(self, full_wh: float, count: int, cells: float | None, most_w: float, flies_w: float) -> None:
        self._packs = [_Pack(number, full_wh / count, cells, most_w, flies_w / count) for number in range(count)]

    @property
    def memory(self) -> tuple[PackMemory, ...]:
        """State of each battery for the next run; empty on the ground."""
        kept = [pack.memory for pack in self._packs]
        return tuple(memory or PackMemory() for memory in kept) if any(kept) else ()

    def resume(self, memory: Sequence[PackMemory], now: float) -> None:
        """The run before ended in flight with this state. It counts until a report comes on the ground."""
        for pack, kept in zip(self._packs, memory, strict=False):
            pack.resume(kept, now)

    def add_report(self, number: int, report: PackReport, now: float, on_ground: bool) -> None:
        """Take the report of monitor `number`. `on_ground`: disarmed, so almost no power is drawn."""
        if 0 <= number < len(self._packs):
            self._packs[number].add_report(report, now, on_ground)

    def charge(self, now: float, on_ground: bool = False) -> Charge:
        """What they hold now. `on_ground`: as far as that is known; in the air what is silent draws on."""
        heard = [pack for pack in self._packs if pack.heard_at is not None]
        trouble = [text for pack in self._packs for text in pack.trouble(now)]
        missing = len(self._packs) - len(heard)
        if missing:
            some = f"{missing} of {len(self._packs)} batteries are not heard"
            trouble.append(some if heard else "no battery is heard")
        left = [pack.left_wh(now, on_ground) for pack in heard]
        known = [wh for wh in left if wh is not None]
        watts = [pack.power_w for pack in heard if pack.power_w is not None]
        return Charge(
            min(known) * len(known) if known else None,
            sum(watts) if watts and len(watts) == len(heard) else None,
            tuple(trouble),
        )
