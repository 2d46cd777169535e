# SPDX-License-Identifier: GPL-3.0-or-later

"""The script of a page: draws its figures in the colours of the reader's screen, and again when these change.

The axis of time is labelled here, T+ above, UTC below. What fits depends on the width of the screen and on the zoom.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from sitl.report.palette import dark

__all__ = ["embedded", "figure", "library"]

_SCRIPT = """
(function () {
  var screenDark = matchMedia('(prefers-color-scheme: dark)');
  var narrow = matchMedia('(max-width: 600px)');
  var swap = __SWAP__;
  function tinted(text) {
    return screenDark.matches ? text.replace(/#[0-9a-f]{6}/gi, function (colour) {
      return swap[colour.toLowerCase()] || colour;
    }) : text;
  }
  function two(value) { return (value < 10 ? '0' : '') + value; }
  function plus(seconds, fine) {
    var whole = Math.abs(seconds), minutes = Math.floor(whole / 60), rest = whole - 60 * minutes;
    var clock = minutes >= 60 ? Math.floor(minutes / 60) + ':' + two(minutes % 60) : minutes;
    return (seconds < 0 ? 'T-' : 'T+') + clock + ':' + (rest < 10 ? '0' : '') + rest.toFixed(fine);
  }
  function ticks(range, width, utc) {
    var steps = [0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200];
    var most = Math.max(2, Math.floor(width / 78)), step = 14400, at = [], words = [];
    for (var n = steps.length - 1; n >= 0; n--) { if ((range[1] - range[0]) / steps[n] <= most) { step = steps[n]; } }
    for (var t = Math.ceil(range[0] / step) * step; t <= range[1]; t += step) {
      var label = plus(Math.round(t * 10) / 10, step < 1 ? 1 : 0);
      if (typeof utc === 'number') {
        label += '<br>' + new Date((utc + t) * 1000).toISOString().substr(11, step < 1 ? 10 : 8);
      }
      at.push(t); words.push(label);
    }
    return {'xaxis.tickmode': 'array', 'xaxis.tickvals': at, 'xaxis.ticktext': words};
  }
  function label(place) {
    var meta = place.layout.meta;
    if (!meta || !meta.times) { return; }
    var axis = place._fullLayout.xaxis, key = axis.range.join() + ':' + axis._length;
    if (place.dataset.ticks === key) { return; }
    place.dataset.ticks = key;
    Plotly.relayout(place, ticks(axis.range, axis._length, meta.utc0));
  }
  function draw() {
    document.querySelectorAll('script[data-figure]').forEach(function (source) {
      var place = document.getElementById(source.dataset.figure), made = JSON.parse(tinted(source.textContent));
      if (narrow.matches) {
        made.layout.margin.l = (made.layout.meta || {}).narrow_left || 46;
        made.layout.margin.r = 4;
        made.layout.font.size = 11;
        made.layout.dragmode = false;
        made.data.forEach(function (trace) {
          if (trace.marker && typeof trace.marker.size === 'number') { trace.marker.size *= 0.75; }
        });
      }
      delete place.dataset.ticks;
      Plotly.react(place, made.data, made.layout, {
        responsive: true, displaylogo: false, scrollZoom: false, displayModeBar: narrow.matches ? false : 'hover',
        modeBarButtonsToRemove: ['select2d', 'lasso2d', 'autoScale2d']
      }).then(function () {
        label(place);
        if (!place.dataset.listens) {
          place.dataset.listens = 'yes';
          place.on('plotly_relayout', function () { label(place); });
          place.on('plotly_afterplot', function () { label(place); });
        }
      });
    });
  }
  screenDark.addEventListener('change', draw);
  narrow.addEventListener('change', draw);
  draw();
})();
"""


def figure(name: str, made: Any) -> str:
    """The place of a figure in the page, and what is drawn there.

    A figure without a height is as high as its shape wants it: `tall` in its meta is height by width.
    """
    text = json.dumps(json.loads(made.to_json()), ensure_ascii=False, separators=(",", ":"))
    height = made.layout.height
    named = sum(trace.showlegend is not False for trace in made.data)
    style = f"height:{height:.0f}px" if height else f"--tall:{made.layout.meta['tall']:.3f};--named:{named}"
    return (
        f'<div class="figure {"" if height else "shaped"}" id="{name}" style="{style}"></div>'
        f'<script type="application/json" data-figure="{name}">{embedded(text)}</script>'
    )


def library() -> str:
    """plotly itself and what draws with it. Raises ImportError where plotly is not installed."""
    from plotly.offline import get_plotlyjs

    swap: Mapping[str, str] = dark()
    own = _SCRIPT.replace("__SWAP__", json.dumps(swap))
    return f"<script>{get_plotlyjs()}</script><script>{own}</script>"


def embedded(text: str) -> str:
    """Text that cannot end the element in which it stands."""
    return text.replace("<", "\\u003c")
