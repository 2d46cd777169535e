# SPDX-License-Identifier: GPL-3.0-or-later

"""Writes every generated page anew."""

from __future__ import annotations

from reference import ROOT
from reference.blocks import blocks
from reference.pages import generated

for make in (blocks, generated):  # pages are made from files that have blocks
    for path, text in make().items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        if make is generated:
            print(f"{path.relative_to(ROOT)} written")
