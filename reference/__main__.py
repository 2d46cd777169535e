# SPDX-License-Identifier: GPL-3.0-or-later

"""Writes the generated parts of files, and every page of the reference to `docs/reference/`: `make reference`."""

from __future__ import annotations

from reference import ROOT
from reference.blocks import blocks
from reference.pages import FOLDER, PAGES

for path, text in blocks().items():
    path.write_text(text, encoding="utf-8")
    print(f"{path.relative_to(ROOT)} written, the parts that are made from tables")
FOLDER.mkdir(exist_ok=True)
for name, written in PAGES.items():  # after the files that they are made from
    (FOLDER / name).write_text(written(), encoding="utf-8")
    print(f"docs/reference/{name} written")
