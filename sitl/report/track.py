# SPDX-License-Identifier: GPL-3.0-or-later

"""The flown track, as every picture and table of it is cut."""

from __future__ import annotations

from collections.abc import Sequence

from sitl.report.evidence import NOBODY, Evidence
from sitl.report.watch import Sample

__all__ = ["airborne", "nearest", "pieces"]

#: lower and slower than this (m, m/s) it stands on the ground
_UP_M, _MOVING_MPS = 0.5, 0.5


def airborne(evidence: Evidence) -> list[Sample]:
    """The samples while it flew or was carried; all where it did neither."""
    moving = [sample for sample in evidence.samples if sample.alt_m > _UP_M or sample.speed_mps > _MOVING_MPS]
    return moving or list(evidence.samples)


def pieces(evidence: Evidence, samples: Sequence[Sample]) -> list[tuple[str, list[Sample]]]:
    """The track in pieces of one commander; neighbours share the sample at the change, so the line has no gap.

    After the companion's death no station commands any more, whatever its last message was.
    """
    changes = evidence.commanders()
    end = evidence.companion_ended_t()
    found: list[tuple[str, list[Sample]]] = []
    place, name = 0, NOBODY
    for sample in samples:
        while place < len(changes) and changes[place].t <= sample.t:
            name, place = changes[place].commander, place + 1
        holder = NOBODY if sample.t > end else name
        if not found or found[-1][0] != holder:
            if found:
                found[-1][1].append(sample)
            found.append((holder, []))
        found[-1][1].append(sample)
    return [(holder, piece) for holder, piece in found if len(piece) > 1]


def nearest(samples: Sequence[Sample], t: float) -> Sample | None:
    """The sample of that moment."""
    return min(samples, key=lambda sample: abs(sample.t - t), default=None)
