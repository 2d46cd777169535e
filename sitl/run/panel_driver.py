# SPDX-License-Identifier: GPL-3.0-or-later

"""An operator in front of a station's panel: `python -m sitl.run.panel_driver`.

It starts `handover panel` for one station of the run, opens its page in Chromium without a window, and presses buttons
there with real mouse events. What the band says goes to its journal, without numbers. The operator types:

    accept  deny  ...    press that button once it is there; the words are those of the panel's orders

    always accept        press that button each time it appears

It ends when its input does. Chromium is driven by its own DevTools protocol, over loopback. It is no dependency:
without Chromium, a scenario with a panel cannot be set up, and says so.
"""

from __future__ import annotations

import argparse
import json
import re
import select
import shutil
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Sequence
from contextlib import suppress
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, Final, TextIO

from gcs_module.panel.endpoint import find, running
from sitl.run.ending import Orders

__all__ = ["chromium", "main", "why_not"]

_PANEL: Final = "import sys; from mavproxy_handover.cli import main; sys.exit(main())"
_EVERY_S: Final = 0.2
_BEGIN_S: Final = 60.0
#: what the band says, and where the wanted button is; null: it is not there, or takes no press yet
_LOOK: Final = """(() => {
  const text = (name) => (document.querySelector(name) || {}).innerText || "";
  const button = document.querySelector(".hp-band button.WORD:not([disabled])");
  const at = button ? button.getBoundingClientRect() : null;
  return JSON.stringify({
    level: (document.querySelector(".hp-band") || {}).className || "",
    who: text(".hp-who strong"), next: text(".hp-next"), do: text(".hp-do > span"), reply: text(".hp-reply"),
    at: at ? [at.x + at.width / 2, at.y + at.height / 2] : null,
  });
})()"""


def chromium() -> str | None:
    """The browser of this computer; None: there is none."""
    return shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


def why_not() -> str:
    """Why no panel can be driven here; "" if one can."""
    if chromium() is None:
        return "no Chromium is installed here (chromium, chromium-browser or google-chrome)"
    try:
        import nicegui  # noqa: F401
        import websockets.sync.client  # noqa: F401
    except ImportError as error:
        return f"{error.name} is missing: pip install 'mavproxy-handover[watch]'"
    return ""


class Browser:
    """One page in Chromium. Raises OSError, TimeoutError."""

    def __init__(self, link: str, folder: Path) -> None:
        from websockets.sync.client import connect

        words = ["--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run", "--remote-debugging-port=0"]
        program = chromium()
        assert program is not None
        self._process = subprocess.Popen(
            [program, *words, f"--user-data-dir={folder}", "--window-size=1400,900", link],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        until = time.monotonic() + _BEGIN_S
        port = _waited(lambda: (folder / "DevToolsActivePort").read_text(encoding="ascii").splitlines()[0], until)
        page = _waited(lambda: next(each for each in _pages(port) if each["url"].startswith("http://127.")), until)
        self._socket = connect(page["webSocketDebuggerUrl"], max_size=1 << 24, open_timeout=20)
        self._number = 0

    def call(self, method: str, **values: Any) -> dict[str, Any]:
        """One call of the DevTools protocol; its result."""
        self._number += 1
        self._socket.send(json.dumps({"id": self._number, "method": method, "params": values}))
        while True:
            answer = json.loads(self._socket.recv(timeout=20))
            if answer.get("id") == self._number:
                result: dict[str, Any] = answer.get("result", {})
                return result

    def look(self, word: str) -> dict[str, Any]:
        """What the band says, and where the button with this word is."""
        found = self.call("Runtime.evaluate", expression=_LOOK.replace("WORD", word or "none"), returnByValue=True)
        seen: dict[str, Any] = json.loads(found["result"]["value"])
        return seen

    def press(self, place: Sequence[float]) -> None:
        """A press of the mouse."""
        for kind in ("mouseMoved", "mousePressed", "mouseReleased"):
            button = "none" if kind == "mouseMoved" else "left"
            self.call("Input.dispatchMouseEvent", type=kind, x=place[0], y=place[1], button=button, clickCount=1)

    def close(self) -> None:
        """End the browser."""
        with suppress(Exception):
            self._socket.close()
        self._process.kill()
        self._process.wait()


def _pages(port: str) -> list[dict[str, Any]]:
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/json/list", timeout=5) as answer:
        found: list[dict[str, Any]] = json.load(answer)
    return [each for each in found if each.get("type") == "page"]


def _waited(job: Any, until: float) -> Any:
    """The result of `job`, which is tried until it works. Raises TimeoutError."""
    while True:
        try:
            return job()
        except (OSError, IndexError, StopIteration, ValueError):
            if time.monotonic() > until:
                raise TimeoutError("the browser does not begin") from None
            time.sleep(0.1)


class Operator:
    """Reads the band, and presses what was typed."""

    def __init__(self, name: str, journal: TextIO) -> None:
        self._name = name
        self._journal = journal
        self._wanted: list[str] = []
        self._always = ""
        self._seen = ""
        self._reply = ""
        self.note("loaded", "an operator with a panel in a browser")

    def note(self, event: str, text: str = "", **values: object) -> None:
        """Write to the journal."""
        now = datetime.now(timezone.utc).isoformat(timespec="milliseconds")
        entry = {"t": round(time.monotonic(), 4), "utc": now, "who": self._name, "event": event, "text": text, **values}
        self._journal.write(json.dumps(entry) + "\n")

    def order(self, line: str) -> None:
        """A typed line."""
        words = line.split()
        if words[:1] == ["always"] and len(words) == 2:
            self._always = words[1]
        elif len(words) == 1:
            self._wanted.append(words[0])

    def tick(self, browser: Browser) -> None:
        """Look at the page once, and press a button if it is there."""
        word = self._wanted[0] if self._wanted else self._always
        seen = browser.look(word)
        plain = {key: re.sub(r"\d+", "#", seen[key]) for key in ("level", "who", "next", "do")}
        said = f"{plain['who']} | {plain['next']} | {plain['do']}"
        if plain["who"] and said != self._seen:
            self._seen = said
            level = plain["level"].removeprefix("hp-band ").strip()
            self.note("band", said, level=level, commander=plain["who"], next=plain["next"], task=plain["do"])
        if seen["reply"] and seen["reply"] != self._reply:
            self.note("reply", seen["reply"])
        self._reply = seen["reply"]
        if word and seen["at"] is not None:
            browser.press(seen["at"])
            self.note("pressed", f"{word} pressed", what=word)
            del self._wanted[:1]


def _named(station: str, configuration: Path) -> str:
    """The name at which the station of this run is found; "": it is not there yet."""
    # only here: the reference is built from these files where MAVProxy's own packages are missing
    from gcs_module.panel.reader import Reader

    for name in running():
        if name == station or name.startswith(f"{station}-"):
            reader = Reader(lambda name=name: find(name))  # type: ignore[misc]
            until = time.monotonic() + 2.0
            while reader.seen is None and time.monotonic() < until:
                reader.tick(time.monotonic())
                time.sleep(0.02)
            reader.close()
            if reader.seen is not None and Path(reader.seen.configuration) == configuration:
                return name
    return ""


def main(argv: Sequence[str] | None = None) -> int:
    """Run until standard input ends."""
    parser = argparse.ArgumentParser(prog="python -m sitl.run.panel_driver", description="An operator with a panel.")
    parser.add_argument("--name", required=True)
    parser.add_argument("--station", required=True)
    parser.add_argument("--config", type=Path, required=True, help="the configuration of the station")
    parser.add_argument("--journal", type=Path, required=True)
    arguments = parser.parse_args(argv)
    orders = Orders()
    with arguments.journal.open("a", encoding="utf-8", buffering=1) as journal:
        operator = Operator(arguments.name, journal)
        name = ""
        while not name:
            if not _taken(orders, operator, 0.5):
                return 0
            name = _named(arguments.station, arguments.config)
        _drive(name, orders, operator)
    return 0


def _taken(orders: Orders, operator: Operator, wait_s: float) -> bool:
    """Take what was typed within this time; whether the process goes on."""
    readable, _, _ = select.select(orders.descriptors, [], [], wait_s)
    for descriptor in readable:
        lines = orders.read(descriptor)
        if lines is None:
            return False
        for line in lines:
            operator.order(line)
    return True


def _drive(name: str, orders: Orders, operator: Operator) -> None:
    panel = subprocess.Popen(
        [sys.executable, "-c", _PANEL, "panel", "--port", "0", "--station", name],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert panel.stdout is not None
        link = panel.stdout.readline().strip()
        with tempfile.TemporaryDirectory(prefix="panel-", ignore_cleanup_errors=True) as folder:
            browser = Browser(link, Path(folder))
            operator.note("open", "the page is open in the browser")
            try:
                while _taken(orders, operator, _EVERY_S):
                    operator.tick(browser)
            finally:
                browser.close()
    finally:
        panel.kill()
        panel.wait()


if __name__ == "__main__":
    raise SystemExit(main())
