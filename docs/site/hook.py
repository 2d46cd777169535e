# SPDX-License-Identifier: GPL-3.0-or-later

"""Pages that live elsewhere in the tree, and those of the reference, come into the site: `mkdocs.yml` loads this.

A link is written so that it works where the file lies, on a forge and in an editor. Here each is resolved against that
place: what is a page of the site leads there, a picture is taken along, and any other file of the tree leads to the
repository.
"""

from __future__ import annotations

import posixpath
import re
import sys
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files, InclusionLevel

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT))
from reference.pages import PAGES  # noqa: E402 (it is in no package that is installed)

#: page of the site -> where it lies
ELSEWHERE = {
    "index.md": "README.md",
    "guard.md": "ardupilot_lua/handover_guard.md",
    "guard-install.md": "ardupilot_lua/handover_guard_install.md",
    "mission-packages.md": "missions/README.md",
    "contributing.md": "CONTRIBUTING.md",
    "security.md": "SECURITY.md",
    "changelog.md": "CHANGELOG.md",
}
_PAGES = {path: page for page, path in ELSEWHERE.items()}
_PICTURES = (".png", ".svg")
_LINK = re.compile(r"(\]\()([^)\s]+)(\))")


def on_files(files: Files, config: Any, **_more: Any) -> Files:
    """Bring in what lies elsewhere, with the pictures that it shows, and the reference."""
    for name, written in PAGES.items():
        files.append(File.generated(config, f"reference/{name}", content=written(), inclusion=InclusionLevel.INCLUDED))
    pictures = set()
    for page, path in ELSEWHERE.items():
        text = (ROOT / path).read_text(encoding="utf-8")
        files.append(File.generated(config, page, content=text))
        for link in _LINK.finditer(text):
            place = _place(path, link[2].partition("#")[0])
            if place.endswith(_PICTURES) and not place.startswith("docs/"):
                pictures.add(place)
    for place in sorted(pictures):
        files.append(File.generated(config, f"site/{place}", content=(ROOT / place).read_bytes()))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, **_more: Any) -> str:
    """Have every relative link lead to where its file is in the site."""
    source = ELSEWHERE.get(page.file.src_uri, f"docs/{page.file.src_uri}")
    here = posixpath.dirname(page.file.src_uri)

    def lead(link: re.Match[str]) -> str:
        target, mark, anchor = link[2].partition("#")
        if not target or "://" in target or target.startswith("mailto:"):
            return link[0]
        place = _place(source, target)
        if place in _PAGES:
            there = _PAGES[place]
        elif place.startswith("docs/"):
            there = place.removeprefix("docs/")
        elif place.endswith(_PICTURES):
            there = f"site/{place}"
        elif (ROOT / place).exists():
            return f"{link[1]}{config.extra['home'].rstrip('/')}/blob/main/{place}{mark}{anchor}{link[3]}"
        else:  # left as it is: the builder says that it leads nowhere
            return link[0]
        return f"{link[1]}{posixpath.relpath(there, here or '.')}{mark}{anchor}{link[3]}"

    return _LINK.sub(lead, markdown)


def _place(source: str, target: str) -> str:
    """Where in the tree a relative link of that file leads."""
    return posixpath.normpath(posixpath.join(posixpath.dirname(source), target))
