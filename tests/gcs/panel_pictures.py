# SPDX-License-Identifier: GPL-3.0-or-later

"""Pictures of the panel in its states, to be looked at by a person.

`python -m tests.gcs.panel_pictures FOLDER [STATE ...] [--size 1400x900] [--scheme light]`; needs the extra `browser`
and Chromium.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from playwright.sync_api import sync_playwright

from tests.gcs.panel_publisher import Fake

PROGRAM = "import sys; from mavproxy_handover.cli import main; sys.exit(main())"
TRAIL = [(52.679 - number * 3e-5, 5.924 + number * 6e-5) for number in range(12)]


@dataclass(frozen=True)
class Picture:
    """A state to show: that of the first aircraft, how many there are, and changes to the station."""

    state: str
    aircraft: int = 1
    changes: dict[str, Any] = field(default_factory=dict)
    dies: bool = False


PICTURES = {
    "commander": Picture("normal"),
    "observer": Picture("observer"),
    "question": Picture("question"),
    "handover": Picture("handover"),
    "emergency": Picture("emergency"),
    "dead": Picture("normal", dies=True),
    "fleet": Picture("question", 6),
    "denied": Picture("denied"),
    "override": Picture("override"),
    "ground": Picture("ground"),
    "shift": Picture("normal", 2, {"next_operator": "Visser", "next_until": 1060.0}),
    "unmanned": Picture("ground", 1, {"operator": "", "required": True}),
    "old": Picture("old"),
}


@contextmanager
def shown(picture: Picture) -> Iterator[tuple[Fake, str]]:
    """A station in this state with its panel; the panel's link."""
    fake = Fake(picture.state, picture.aircraft)
    fake.snapshot = replace(fake.snapshot, **picture.changes)
    if picture.state != "ground":
        fake.trail = list(TRAIL)
    over = threading.Event()
    thread = threading.Thread(target=fake.run, args=(600.0, over.is_set))
    thread.start()
    program = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, "panel", "--port", "0", "--station", "GCSA"],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env=dict(os.environ),
    )
    try:
        assert program.stdout is not None
        yield fake, program.stdout.readline().strip()
    finally:
        program.kill()
        program.communicate(timeout=10)
        over.set()
        thread.join()
        fake.publisher.close()


def take(browser: Any, picture: Picture, file: Path, size: tuple[int, int], scheme: str) -> None:
    """One picture."""
    with shown(picture) as (fake, link):
        page = browser.new_page(viewport={"width": size[0], "height": size[1]}, color_scheme=scheme)
        for _ in range(100):
            try:
                page.goto(link)
                break
            except Exception:
                page.wait_for_timeout(100)
        page.wait_for_selector(".hp-who strong", timeout=30_000)
        page.wait_for_timeout(3500)
        if picture.dies:
            fake.publisher._drop(fake.publisher._readers[0], "closed")
            fake.publisher.tick = lambda _now: None  # type: ignore[method-assign]
            page.wait_for_timeout(4000)
        page.screenshot(path=str(file))
        page.close()


def main() -> None:
    """Take them."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("states", nargs="*")
    parser.add_argument("--size", default="1400x900")
    parser.add_argument("--scheme", default="light")
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    wide, high = (int(part) for part in arguments.size.split("x"))
    chromium = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as driver:
        os.environ["HANDOVER_PANELS"] = str(Path(folder) / "panels")
        browser = driver.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        for name in arguments.states or PICTURES:
            take(browser, PICTURES[name], arguments.folder / f"{name}.png", (wide, high), arguments.scheme)
        browser.close()


if __name__ == "__main__":
    main()
