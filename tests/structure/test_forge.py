# SPDX-License-Identifier: GPL-3.0-or-later

"""What the forge is told to run exists here: targets, scenarios, commands; and links of every page lead to headings."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

import pytest
import yaml
from markdown_it import MarkdownIt

from mavproxy_handover import cli
from reference.pages import FOLDER
from reference.pages import PAGES as MADE
from sitl.script.scenario import known_scenarios

ROOT = Path(__file__).resolve().parents[2]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
FORMS = sorted(path for path in (ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml") if path.name != "config.yml")
PAGES = sorted(
    path
    for pattern in ("*.md", "docs/**/*.md", "ardupilot_lua/*.md", "missions/*.md", ".github/*.md")
    for path in ROOT.glob(pattern)
)


def runs(workflow: Path) -> list[str]:
    """Every line that a workflow runs."""
    jobs = yaml.safe_load(workflow.read_text(encoding="utf-8"))["jobs"].values()
    return [line.strip() for job in jobs for step in job.get("steps", ()) for line in step.get("run", "").splitlines()]


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda path: path.name)
def test_what_a_workflow_runs_exists(workflow: Path) -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert runs(workflow)
    for line in runs(workflow):
        for target in re.findall(r"(?:^|&& )make ([\w./-]+)", line):
            assert f"\n{target}: " in makefile or target == ".venv/installed", line
        for word in re.findall(r"bin/handover ([a-z]\w*)", line):
            assert word in cli.COMMANDS, line
        assert set(re.findall(r"--scenario ([\w-]+)", line)) <= set(known_scenarios()), line


def test_a_release_waits_for_the_tests_and_may_do_nothing_else() -> None:
    release = yaml.safe_load((ROOT / ".github/workflows/release.yml").read_text(encoding="utf-8"))
    assert release["permissions"] == {"contents": "read"}
    assert set(release["jobs"]["publish"]["needs"]) == {"tests", "version"}
    assert release["jobs"]["publish"]["permissions"] == {"id-token": "write"}
    for job in release["jobs"].values():
        if "uses" in job:
            assert (ROOT / job["uses"]).is_file()


def test_the_matrix_is_what_the_package_says() -> None:
    tests = yaml.safe_load((ROOT / ".github/workflows/test.yml").read_text(encoding="utf-8"))["jobs"]["tests"]
    said = re.findall(r"Python :: (3\.\d+)", (ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert tests["strategy"]["matrix"]["python"] == said


@pytest.mark.parametrize("form", FORMS, ids=lambda path: path.name)
def test_a_form_asks_for_what_is_needed(form: Path) -> None:
    asked = {part.get("id") for part in yaml.safe_load(form.read_text(encoding="utf-8"))["body"]}
    assert "what" in asked
    assert form.stem == "wish" or "doctor" in asked


def text_of(path: Path) -> str | None:
    """The text of a page, also of one of the reference, which is not committed; None: there is no such file."""
    if path.parent == FOLDER and path.name in MADE:
        return MADE[path.name]()
    return path.read_text(encoding="utf-8") if path.is_file() else None


def anchors(text: str) -> set[str]:
    """The headings of a page as the forge names them."""
    tokens = MarkdownIt().parse(text)
    found: set[str] = set()
    for heading, inline in pairwise(tokens):
        if heading.type == "heading_open":
            text = "".join(child.content for child in inline.children or ())
            name = re.sub(r"[^\w\- ]", "", text.lower()).replace(" ", "-")
            number = 0
            while (anchor := f"{name}-{number}" if number else name) in found:
                number += 1
            found.add(anchor)
    return found


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_link_leads_to_a_file_and_a_heading(path: Path) -> None:
    wrong = []
    for token in MarkdownIt().enable("table").parse(path.read_text(encoding="utf-8")):
        for child in token.children or ():
            link = str(child.attrs.get("href") or child.attrs.get("src") or "")
            target, _mark, anchor = link.partition("#")
            if not link or "://" in link or link.startswith("mailto:"):
                continue
            there = (path.parent / target).resolve() if target else path
            if there.suffix != ".md":
                found = there.exists()
            else:
                text = text_of(there)
                found = text is not None and (not anchor or anchor in anchors(text))
            if not found:
                wrong.append(link)
    assert wrong == []
