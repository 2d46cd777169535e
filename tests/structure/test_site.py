# SPDX-License-Identifier: GPL-3.0-or-later

"""The documentation builds as a site without a warning, and leads nowhere else for what it needs."""

from __future__ import annotations

import os
import re
import runpy
import subprocess
import sys
from pathlib import Path
from typing import Any

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
    done = build(folder := tmp_path_factory.mktemp("site") / "pages")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "No issues found" in done.stdout + done.stderr
    return folder / "site"


def build(folder: Path, broken: str = "") -> subprocess.CompletedProcess[str]:
    """As `make docs`. `broken` is added to a page first."""
    subprocess.run([sys.executable, str(ROOT / "docs/site/stage.py"), str(folder)], check=True, timeout=200)
    if broken:
        page = folder / "docs/tutorial.md"
        page.write_text(page.read_text(encoding="utf-8") + broken, encoding="utf-8")
    command = [str(Path(sys.executable).with_name("zensical")), "build", "--strict"]
    environment = {**os.environ, "NO_COLOR": "1"}
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False, timeout=200
    )


def test_a_link_that_leads_nowhere_is_an_error(tmp_path: Path) -> None:
    done = build(tmp_path / "pages", "\n[a page](nowhere.md), [a heading](safety.md#nowhere)\n")
    assert done.returncode != 0
    assert "page does not exist" in done.stdout + done.stderr
    assert "anchor does not exist" in done.stdout + done.stderr


def test_no_link_text_is_a_file_name() -> None:
    pages = [*(ROOT / "docs").glob("*.md"), *(ROOT / path for path in stage_of()["ELSEWHERE"].values())]
    found = [
        f"{page.name}: {text}"
        for page in pages
        if page.name != "CHANGELOG.md"
        for text in re.findall(r"(?<!!)\[([^\]]*)\]\(", page.read_text(encoding="utf-8"))
        if re.fullmatch(r"[\w/-]+\.md", text)
    ]
    assert found == []


def test_what_is_nested_in_a_list_is_indented_by_four() -> None:
    """The fault: the site took nested items for items of the list, and began each numbered list after a block at 1."""
    pages = [*(ROOT / "docs").glob("*.md"), *(ROOT / path for path in stage_of()["ELSEWHERE"].values())]
    found = []
    for page in pages:
        prose = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
        found += [
            f"{page.name}: {line}" for line in re.findall(r"^ {1,3}(?:[*-] |\d+\. |```|\|).*", prose, re.MULTILINE)
        ]
    assert found == []


def stage_of() -> dict[str, Any]:
    """What `docs/site/stage.py` defines; it is in no package."""
    return runpy.run_path(str(ROOT / "docs/site/stage.py"))


def test_every_page_is_in_the_navigation() -> None:
    nav = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:\n")[2]
    pages = {path.relative_to(ROOT / "docs").as_posix() for path in (ROOT / "docs").glob("*.md")}
    pages |= {f"reference/{name}" for name in PAGES}
    assert [page for page in sorted(pages) if f": {page}\n" not in nav] == []


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
