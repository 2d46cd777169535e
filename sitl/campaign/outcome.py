# SPDX-License-Identifier: GPL-3.0-or-later

"""The outcome of a flight, as one line of a file: all that is counted later."""

from __future__ import annotations

import json
import time
from dataclasses import asdict, dataclass
from itertools import combinations

from sitl.campaign.aircraft import Mode
from sitl.campaign.judge import ended, judge
from sitl.campaign.plan import draw
from sitl.campaign.times import SECOND
from sitl.campaign.world import World

__all__ = ["Outcome", "fly"]


@dataclass(frozen=True, slots=True)
class Outcome:
    """One flight. `unsafe`: rows of the table, with the second and a sentence; `cells`: pairs of causes that were there
    at once, with the phase; `track`: what happened in short, to be compared; `cpu_s`: processor time of flying it."""

    seed: int
    ended: str
    unsafe: tuple[tuple[str, float, str], ...]
    aloft_s: float
    handovers: int
    cells: tuple[str, ...]
    track: str
    cpu_s: float
    orders: tuple[str, ...]

    def line(self) -> str:
        """For a file."""
        return json.dumps(asdict(self), separators=(",", ":"))

    @classmethod
    def read(cls, line: str) -> Outcome:
        """The outcome in a line of a file. Raises ValueError, KeyError, TypeError: it is no outcome."""
        values = json.loads(line)
        values["unsafe"] = tuple((row, at, text) for row, at, text in values["unsafe"])
        for name in ("cells", "orders"):
            values[name] = tuple(values[name])
        return cls(**values)

    @property
    def same(self) -> tuple[object, ...]:
        """The values that must not depend on the way the flight was flown."""
        return self.seed, self.ended, self.unsafe, self.aloft_s, self.handovers, self.track, self.orders


def fly(seed: int, *, plain: bool = False) -> Outcome:
    """The flight of a seed, judged."""
    plan = draw(seed)
    begun = time.process_time()
    world = World(plan, plain=plain)
    log = world.run()
    cpu = time.process_time() - begun
    found = judge(plan, log)
    aloft = sum(piece.ended - piece.begun for piece in log.flown if piece.mode != Mode.GROUND.name)
    assert world.companion is not None
    cells = {
        f"{first}+{second}@{phase.name.lower()}"
        for phase, causes in world.companion.pairs
        for first, second in combinations(sorted(causes), 2)
    }
    track = " ".join(f"{at / SECOND:.3f}:{mode}:{by}" for at, mode, by in log.modes)
    moves = " ".join(f"{at / SECOND:.3f}:{old}>{new}" for at, old, new in log.moves)
    return Outcome(
        seed,
        ended(log),
        tuple((each.row, round(each.at / SECOND, 3), each.text) for each in found),
        aloft / SECOND,
        len(log.moves),
        tuple(sorted(cells)),
        f"{track} | {moves}",
        cpu,
        tuple(f"{at / SECOND:.3f}:{action}" for at, action, _why in log.orders),
    )
