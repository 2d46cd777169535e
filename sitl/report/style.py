# SPDX-License-Identifier: GPL-3.0-or-later

"""How every page looks that is made here: light or dark as its reader's screen is, readable on a telephone."""

from __future__ import annotations

from mavproxy_handover.mission.colours import ALARM, DARK, GRID, INK, PAPER, SOFT, STATION_COLOURS

__all__ = ["STYLE", "station_classes"]

_LIGHT = {"ink": INK, "paper": PAPER, "soft": "#5f5d58", "line": GRID, "bad": ALARM, "faint": "#f6f4ef", "mark": SOFT}
_DEEP = {
    "ink": DARK[INK],
    "paper": DARK[PAPER],
    "soft": "#b1aea6",
    "line": DARK[GRID],
    "bad": DARK[ALARM],
    "faint": "#1d2127",
    "mark": DARK[SOFT],
}
_WASH = {"held": ("#e3f2ea", "#173d2f"), "failed": ("#f9dede", "#4a1f1f"), "warned": ("#fbf0cd", "#43380f")}


def _variables(dark: bool) -> str:
    values = {f"--{name}": colour for name, colour in (_DEEP if dark else _LIGHT).items()}
    values.update({f"--{name}": pair[dark] for name, pair in _WASH.items()})
    for number, colour in enumerate(STATION_COLOURS):
        values[f"--station{number}"] = DARK.get(colour, colour) if dark else colour
    return ";".join(f"{name}:{colour}" for name, colour in values.items())


def station_classes(stations: tuple[str, ...]) -> dict[str, str]:
    """Station -> its class of colour."""
    return {name: f"s{number % len(STATION_COLOURS)}" for number, name in enumerate(stations)}


_STATIONS = "".join(
    f"svg .s{number}{{stroke:var(--station{number})}}svg text.s{number}{{fill:var(--station{number});stroke:none}}"
    for number in range(len(STATION_COLOURS))
)

STYLE = f"""
:root{{color-scheme:light dark;{_variables(False)}}}
@media(prefers-color-scheme:dark){{:root{{{_variables(True)}}}}}
body{{font:15px/1.45 system-ui,sans-serif;color:var(--ink);background:var(--paper);margin:0 auto;max-width:1120px;
padding:24px}}
h1{{font-size:26px;margin:0 0 4px;overflow-wrap:anywhere}}
h2{{font-size:19px;margin:34px 0 8px;border-bottom:1px solid var(--line);padding-bottom:4px}}
h3{{font-size:16px;margin:20px 0 4px}}
p{{margin:6px 0}}a{{color:inherit}}.small{{color:var(--soft);font-size:13px}}
.wide{{overflow-x:auto}}
table{{border-collapse:collapse;width:100%;font-size:14px}}
th,td{{text-align:left;padding:4px 10px 4px 0;border-bottom:1px solid var(--line);vertical-align:top}}
th{{color:var(--soft);font-weight:600}}
td.n{{text-align:right;font-variant-numeric:tabular-nums;white-space:nowrap}}
img{{max-width:100%;height:auto;display:block;margin:8px 0}}
li{{overflow-wrap:anywhere}}
.held{{background:var(--held);fill:var(--held)}}.failed{{background:var(--failed);fill:var(--failed)}}
.warned{{background:var(--warned)}}
.verdict{{padding:8px 14px;border-radius:6px;display:inline-block;font-weight:600}}
ul.outcome{{list-style:none;padding:0;margin:12px 0}}
ul.outcome li{{padding:6px 12px;border-radius:6px;margin:4px 0;border-left:4px solid var(--line);
background:var(--faint)}}
ul.outcome li.held{{border-color:#009e73}}ul.outcome li.failed{{border-color:var(--bad)}}
ul.outcome li.warned{{border-color:#e69f00}}
ul.outcome li.held,ul.outcome li.warned,ul.outcome li.failed{{background:var(--wash)}}
ul.outcome li.held{{--wash:var(--held)}}ul.outcome li.warned{{--wash:var(--warned)}}
ul.outcome li.failed{{--wash:var(--failed)}}
.figure{{width:100%;margin:8px 0;max-height:88vh}}
.shaped{{height:calc(min(100vw - 28px,1072px)*var(--tall) + 105px + var(--named)*4px)}}
.pictures{{display:flex;flex-wrap:wrap;gap:20px 28px;margin-top:18px}}
figure{{margin:0;width:min(100%,400px)}}figcaption{{font-weight:600;margin:0 0 6px}}
details{{margin:8px 0}}summary{{cursor:pointer}}
svg.sequence{{width:100%;height:auto;font:11px system-ui,sans-serif}}
svg text{{fill:var(--ink);stroke:none}}svg text.soft{{fill:var(--soft)}}svg text.bad{{fill:var(--bad)}}
svg .mid{{text-anchor:middle}}svg .end{{text-anchor:end}}svg .name{{font-weight:600}}svg .tiny{{font-size:9.5px}}
svg .halo{{paint-order:stroke;stroke:var(--paper);stroke-width:5px;stroke-linejoin:round}}
svg .lane{{stroke:var(--mark);stroke-width:1.6}}
svg .way{{fill:none;stroke:var(--ink);stroke-width:1.2}}svg .way.again{{stroke-dasharray:5 3}}
svg .way.lost{{stroke:var(--bad)}}svg .head{{fill:var(--ink)}}
{_STATIONS}
@media(max-width:600px){{body{{padding:14px}}h1{{font-size:21px}}th,td{{padding-right:8px}}table{{font-size:13px}}
td:last-child{{min-width:150px}}
.shaped{{height:calc((100vw - 28px)*var(--tall) + 80px + var(--named)*15px);max-height:none}}}}
"""
