# SPDX-License-Identifier: GPL-3.0-or-later

"""The documentation builds as a site without a warning, and leads nowhere else for what it needs."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from reference.pages import PAGES

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).resolve().parents[2]
#: what brings something into a page
BROUGHT = re.compile(r"""<(?:script|link|img|iframe)[^>]+(?:src|href)=["'](https?://[^"']+)""")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False, timeout=200)
    assert done.returncode == 0, done.stderr
    assert "WARNING" not in done.stderr, done.stderr
    return folder


def test_every_page_is_there(site: Path) -> None:
    pages = {path.relative_to(ROOT / "docs").with_suffix(".html") for path in (ROOT / "docs").rglob("*.md")}
    pages |= {Path("reference", name).with_suffix(".html") for name in PAGES}
    assert [str(page) for page in pages if not (site / page).is_file()] == []
    for page in ("index", "guard", "guard-install", "mission-packages", "contributing", "security", "changelog"):
        assert (site / f"{page}.html").is_file()


def test_nothing_is_loaded_from_anywhere_else(site: Path) -> None:
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        assert BROUGHT.findall(text) == [], page
        assert 'data-md-component="source"' not in text, "the theme asks the forge for stars"


def test_the_picture_of_the_mission_came_along(site: Path) -> None:
    assert (site / "site/missions/delivery/map.png").is_file()
    assert "site/missions/delivery/map.png" in (site / "index.html").read_text(encoding="utf-8")


def test_the_project_has_one_address() -> None:
    """The public home: a release must change it in all places at once."""
    config = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    home = config["project"]["urls"]["Homepage"]
    assert f"home: {home}\n" in (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    forms = (ROOT / ".github/ISSUE_TEMPLATE/config.yml").read_text(encoding="utf-8")
    assert re.findall(r"url: (https://\S+)", forms) == [f"{home}/discussions", f"{home}/security/advisories/new"]
    assert all(url.startswith(home) for url in config["project"]["urls"].values())
