# SPDX-License-Identifier: GPL-3.0-or-later

"""The pictures of a campaign: how long flights were, how many handovers they had, and maps of a few."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from typing import Any, Final

from sitl.campaign.aircraft import Mode
from sitl.campaign.outcome import Outcome
from sitl.campaign.plan import draw
from sitl.campaign.world import World
from sitl.report.palette import colours

__all__ = ["histograms", "maps"]

_COLOURS: Final = {
    Mode.AUTO.name: "#2b6cb0",
    Mode.PAUSE.name: "#805ad5",
    Mode.RTL.name: "#dd6b20",
    Mode.LAND.name: "#c53030",
    Mode.PILOT.name: "#2f855a",
}


def _inline(figure: Any) -> str:
    """For a page that needs nothing else."""
    import matplotlib.pyplot as plt

    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=80, bbox_inches="tight")
    plt.close(figure)
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")


def _axes(count: int, width: float, height: float) -> tuple[Any, list[Any]]:
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, count, figsize=(width, height))
    return figure, list(axes) if count > 1 else [axes]


def histograms(outcomes: Sequence[Outcome]) -> str:
    """Time in the air, handovers, orders of the companion."""
    figure, axes = _axes(3, 13, 3)
    for axis, values, title in zip(
        axes,
        (
            [outcome.aloft_s / 60.0 for outcome in outcomes],
            [outcome.handovers for outcome in outcomes],
            [len(outcome.orders) for outcome in outcomes],
        ),
        ("minutes in the air", "handovers", "orders of the companion"),
        strict=True,
    ):
        axis.hist(values, bins=30, color="#2b6cb0")
        axis.set_title(title, fontsize=10)
        axis.set_ylabel("flights", fontsize=9)
    return _inline(figure)


def maps(seeds: Sequence[int]) -> str:
    """Zones, way, places, and what was flown, coloured by mode."""
    figure, axes = _axes(len(seeds), 4.4 * len(seeds), 4.4)
    for axis, seed in zip(axes, seeds, strict=True):
        plan = draw(seed)
        log = World(plan).run()
        tints = colours([station.name for station in plan.stations])
        for station in plan.stations:
            zone = station.zone
            axis.add_patch(_circle(zone.x_m, zone.y_m, zone.radius_m, tints[station.name]))
        axis.plot([spot.x_m for spot in plan.way], [spot.y_m for spot in plan.way], ":", color="#888888", lw=1)
        axis.plot([spot.x_m for spot in plan.places], [spot.y_m for spot in plan.places], "k^", ms=5)
        for piece in log.flown:
            end = piece.at(piece.ended)
            axis.plot([piece.x_m, end[0]], [piece.y_m, end[1]], color=_COLOURS.get(piece.mode, "#444444"), lw=1.6)
        axis.set_aspect("equal")
        axis.autoscale_view()
        axis.set_title(f"flight {seed}", fontsize=10)
        axis.tick_params(labelsize=7)
    return _inline(figure)


def _circle(x: float, y: float, radius: float, colour: str) -> Any:
    from matplotlib.patches import Circle as Patch

    return Patch((x, y), radius, facecolor=colour, alpha=0.12, edgecolor=colour)
