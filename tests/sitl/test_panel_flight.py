# SPDX-License-Identifier: GPL-3.0-or-later

"""A flight whose two operators answer by `handover panel` in a browser, and a station that dies before their eyes.

Needs the extra `browser` and Chromium; skipped, saying so, where they are missing.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from tests.sitl.runner_flight import Start, starting

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
playwright = pytest.importorskip(
    "playwright.sync_api", reason="pip install 'mavproxy-handover[browser]' drives a browser"
)
pytestmark = [
    pytest.mark.process,
    pytest.mark.long,
    pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium here"),
]
SCENARIO = Path(__file__).resolve().parents[1] / "data" / "panel-consent.toml"
PROGRAM = "import sys; from mavproxy_handover.cli import main; sys.exit(main())"
start = pytest.fixture(starting)


@contextmanager
def panel(station: str, browser: Any) -> Iterator[Any]:
    """The page of a station's panel."""
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, "panel", "--port", "0", "--station", station],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env=dict(os.environ),
    )
    try:
        assert process.stdout is not None
        link = process.stdout.readline().strip()
        page = browser.new_page(viewport={"width": 1400, "height": 900})
        for _ in range(100):
            try:
                page.goto(link)
                break
            except playwright.Error:
                time.sleep(0.1)
        page.wait_for_selector(".hp-who strong", timeout=20_000)
        yield page
    finally:
        process.kill()
        process.communicate(timeout=10)


def answer(page: Any) -> None:
    """Press Accept if the page asks."""
    pressed = page.query_selector(".hp-main button.accept:not([disabled])")
    if pressed is not None:
        with suppress(playwright.Error):  # the question is over, and its button has gone
            pressed.click(timeout=2000)


def test_operators_answer_by_their_panels_and_see_a_station_die(
    start: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HANDOVER_PANELS", str(tmp_path / "panels"))
    flown = start(tmp_path / "run", "--scenario", str(SCENARIO), "--speedup", "2")
    seen: dict[str, list[str]] = {"GCSA": [], "GCSB": []}
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        with panel("GCSA", browser) as first, panel("GCSB", browser) as second:
            while flown.poll() is None:
                for name, page in (("GCSA", first), ("GCSB", second)):
                    parts = (page.inner_text(part) for part in (".hp-who strong", ".hp-next", ".hp-do > span"))
                    band = re.sub(r"\d+", "#", " | ".join(parts))
                    if seen[name][-1:] != [band]:
                        seen[name].append(band)
                    answer(page)
                time.sleep(0.2)
        browser.close()
    out, story = flown.communicate(timeout=30)
    assert flown.returncode == 0, story
    assert '"held": true' in out
    for name, own in (("GCSA", "Let GCSB take drone-#?"), ("GCSB", "Take drone-# from GCSA?")):
        who = "YOU" if name == "GCSA" else "GCSA"
        assert f"{who} | Handover GCSA to GCSB in # s. | {own}" in seen[name], seen
    ended = [
        band for band in seen["GCSA"] if band.startswith("NOT KNOWN | The program of station GCSA does not answer")
    ]
    assert ended, seen
    assert any(band.startswith("YOU | ") for band in seen["GCSB"]), seen
