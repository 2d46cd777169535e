# SPDX-License-Identifier: GPL-3.0-or-later

"""Collect the pages of the site in one folder: `make docs` runs this, then builds the folder.

    python docs/site/stage.py FOLDER

Pages that lie elsewhere in the tree, and the pages of the reference, come beside those of `docs/`. A link is written so
that it works where its file lies, on a forge and in an editor. Here each is resolved against that place. A page of the
site leads there, a picture is taken along, and any other file of the tree leads to the repository.
"""

from __future__ import annotations

import posixpath
import re
import shutil
import sys
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT))
from reference.pages import PAGES  # noqa: E402 (it is in no package that is installed)

#: page of the site -> where it lies
ELSEWHERE: Final = {
    "index.md": "README.md",
    "guard.md": "ardupilot_lua/handover_guard.md",
    "guard-install.md": "ardupilot_lua/handover_guard_install.md",
    "mission-packages.md": "missions/README.md",
    "contributing.md": "CONTRIBUTING.md",
    "security.md": "SECURITY.md",
    "changelog.md": "CHANGELOG.md",
}
_PAGES: Final = {path: page for page, path in ELSEWHERE.items()}
_PICTURES: Final = (".png", ".svg")
_LINK: Final = re.compile(r"(\]\()([^)\s]+)(\))")
_HOME: Final = re.compile(r"^  home: (\S+)$", re.MULTILINE)


def stage(folder: Path) -> None:
    """Write pages, pictures, style and `mkdocs.yml` into `folder`. What was there before is removed."""
    shutil.rmtree(folder, ignore_errors=True)
    pages = folder / "docs"
    shutil.copytree(ROOT / "docs", pages, ignore=shutil.ignore_patterns("*.md", "*.py", "__pycache__", "reference"))
    settings = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    (folder / "mkdocs.yml").write_text(settings, encoding="utf-8")
    home = _HOME.findall(settings)[0].rstrip("/")
    for page, source, text in _texts():
        path = pages / page
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(_led(text, page, source, home, pages), encoding="utf-8")


def _texts() -> list[tuple[str, str, str]]:
    """(page of the site, the file that its links are relative to, text) of each page."""
    own = [(path.name, f"docs/{path.name}", path) for path in sorted((ROOT / "docs").glob("*.md"))]
    elsewhere = [(page, source, ROOT / source) for page, source in ELSEWHERE.items()]
    texts = [(page, source, path.read_text(encoding="utf-8")) for page, source, path in (*own, *elsewhere)]
    return [*texts, *((f"reference/{name}", f"docs/reference/{name}", written()) for name, written in PAGES.items())]


def _led(text: str, page: str, source: str, home: str, pages: Path) -> str:
    """Have every relative link lead to where its file is in the site."""
    here = posixpath.dirname(page)

    def lead(link: re.Match[str]) -> str:
        target, mark, anchor = link[2].partition("#")
        if not target or "://" in target or target.startswith("mailto:"):
            return link[0]
        place = posixpath.normpath(posixpath.join(posixpath.dirname(source), target))
        if place in _PAGES:
            there = _PAGES[place]
        elif place.startswith("docs/"):
            there = place.removeprefix("docs/")
        elif place.endswith(_PICTURES) and (ROOT / place).exists():
            there = f"site/{place}"
            (pages / there).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / place, pages / there)
        elif (ROOT / place).exists():
            return f"{link[1]}{home}/blob/main/{place}{mark}{anchor}{link[3]}"
        else:  # left as it is: the builder says that it leads nowhere
            return link[0]
        return f"{link[1]}{posixpath.relpath(there, here or '.')}{mark}{anchor}{link[3]}"

    return _LINK.sub(lead, text)


if __name__ == "__main__":
    stage(Path(sys.argv[1]))
