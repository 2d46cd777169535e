# SPDX-License-Identifier: GPL-3.0-or-later

"""The panel in a real browser: what it shows, what a press, a held key and a slip do, and a program that dies.

Needs the extra `browser` and Chromium; skipped, saying so, where they are missing.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import threading
import time
from base64 import b64decode
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.gcs.panel_publisher import Fake
from tests.gcs.panel_states import GIVE

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
playwright = pytest.importorskip(
    "playwright.sync_api", reason="pip install 'mavproxy-handover[browser]' drives a browser"
)
pytestmark = [
    pytest.mark.process,
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium here"),
]
PROGRAM = "import sys; from mavproxy_handover.cli import main; sys.exit(main())"
SIZES = [(1400, 900), (1024, 768), (400, 800)]
#: elements with words that leave the window, or that are cut
CUT = """(() => [...document.querySelectorAll(
  ".hp-head *, .hp-duty *, .hp-band *, .hp-rows *, .hp-shift *, .hp-alarms *, .hp-briefing *, .hp-values *, " +
  ".hp-links *, .hp-peers *, .hp-lines *")].filter((each) => each.offsetParent && each.innerText).filter((each) => {
    const at = each.getBoundingClientRect(), hides = getComputedStyle(each).overflowX !== "visible";
    return at.left < -1 || at.right > innerWidth + 1 || (hides && each.scrollWidth > each.clientWidth + 1);
  }).map((each) => each.className + ": " + each.innerText.slice(0, 40)))()"""


class Bench:
    """A station's publisher, the panel's program, and a page in a browser."""

    def __init__(self, browser: Any, state: str = "question", words: tuple[str, ...] = ()) -> None:
        self._browser = browser
        self.fake = Fake(state)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self.fake.run, args=(120.0, self._over.is_set))
        self._thread.start()
        self.program = subprocess.Popen(
            [sys.executable, "-c", PROGRAM, "panel", "--port", "0", "--station", "GCSA", *words],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            env=dict(os.environ),
        )
        assert self.program.stdout is not None
        self.link = self.program.stdout.readline().strip()
        #: cookies, and the storage of the page
        self._kept: Any = None
        self.page: Any = None
        self.faults: list[str] = []

    def open(self, size: tuple[int, int] = SIZES[0], scheme: str = "light") -> Any:
        view = {"width": size[0], "height": size[1]}
        context = self._browser.new_context(viewport=view, color_scheme=scheme, storage_state=self._kept)
        self.page = page = context.new_page()
        page.on("pageerror", lambda error: self.faults.append(str(error)))
        address = self.link if self._kept is None else self.link.partition("?")[0]
        for _ in range(100):
            try:
                page.goto(address)
                break
            except playwright.Error:
                time.sleep(0.1)
        page.wait_for_selector(".hp-who strong", timeout=60_000)
        self._kept = context.storage_state()
        return page

    def text(self, part: str) -> str:
        return str(self.page.inner_text(part))

    def orders(self) -> list[tuple[str, str]]:
        return [(order.do, order.argument) for order in self.fake.orders]

    def stop_station(self) -> None:
        """As if the station's program had been killed."""
        self._over.set()
        self._thread.join()
        self.fake.publisher.close()

    def close(self) -> None:
        if not self._over.is_set():
            self.stop_station()
        self.program.kill()
        self.program.communicate(timeout=10)
        assert self.faults == []


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield opened
        opened.close()


@pytest.fixture
def bench(browser: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Bench]:
    monkeypatch.setenv("HANDOVER_PANELS", str(tmp_path / "panels"))
    made = Bench(browser)
    yield made
    made.close()


def within(seconds: float, holds: Callable[[], bool]) -> bool:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if holds():
            return True
        time.sleep(0.05)
    return holds()


def test_the_band_is_seen_at_every_size_and_never_scrolls(bench: Bench) -> None:
    for size in SIZES:
        for scheme in ("light", "dark"):
            page = bench.open(size, scheme)
            assert bench.text(".hp-who strong") == "GCSB"
            assert bench.text(".hp-do > span") == "Take drone-1 from GCSB?"
            band = page.locator(".hp-band").bounding_box()
            accept = page.locator(".hp-band button.accept").bounding_box()
            assert band["y"] + band["height"] < 0.5 * size[1]
            assert accept["x"] + accept["width"] <= size[0]
            assert accept["height"] >= 44, "a finger hits it"
            wide = page.evaluate("document.documentElement.scrollWidth")
            assert wide <= size[0]
            page.mouse.wheel(0, 3000)
            page.wait_for_timeout(300)
            assert page.locator(".hp-band").bounding_box()["y"] < 60, "it stays when the rest scrolls"
            page.context.close()


@pytest.mark.parametrize("state", ["normal", "question", "emergency", "dead", "shift"])
def test_no_text_is_cut_and_nothing_scrolls_sideways(
    browser: Any, state: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("HANDOVER_PANELS", str(tmp_path / "panels"))
    bench = Bench(browser, "normal" if state in ("dead", "shift") else state)
    try:
        if state == "shift":
            aircraft = tuple(replace(bench.fake.snapshot.aircraft[0], sysid=n, name=f"drone-{n}") for n in (1, 2, 3))
            bench.fake.snapshot = replace(
                bench.fake.snapshot, aircraft=aircraft, next_operator="van der Meer-Visser", next_until=1060.0
            )
        page = bench.open()
        if state == "dead":
            bench.stop_station()
            assert within(5.0, lambda: bench.text(".hp-who strong") == "NOT KNOWN")
        if state == "shift":
            page.wait_for_selector(".hp-shift button.confirm")
        for scheme in ("light", "dark"):
            page.emulate_media(color_scheme=scheme)
            for size in SIZES:
                page.set_viewport_size({"width": size[0], "height": size[1]})
                page.wait_for_timeout(500)
                assert page.evaluate("document.documentElement.scrollWidth") <= size[0]
                assert page.evaluate(CUT) == [], (state, scheme, size)
                band = page.locator(".hp-band").bounding_box()
                assert band["y"] + band["height"] < 0.6 * size[1]
                page.mouse.move(size[0] / 2, size[1] * 0.8)
                page.mouse.wheel(0, 3000)
                page.wait_for_timeout(200)
                assert page.locator(".hp-band").bounding_box()["y"] < 90, "it stays when the rest scrolls"
    finally:
        bench.close()


def test_an_operator_signs_on_and_the_next_one_confirms_the_briefing(bench: Bench) -> None:
    (craft,) = bench.fake.snapshot.aircraft
    own = replace(craft, question=None, commander="GCSA", own=True, alarms=())
    bench.fake.snapshot = replace(bench.fake.snapshot, aircraft=(own,))
    page = bench.open()
    assert within(5.0, lambda: "operator Jansen" in " ".join(bench.text(".hp-duty").split()))
    page.click(".hp-duty button:has-text('Change shift')")
    page.keyboard.type("adda Visser")
    page.keyboard.press("Enter")
    assert within(3.0, lambda: bench.orders() == [("sign_on", "adda Visser")]), "letters of a name answer no question"
    bench.fake.snapshot = replace(bench.fake.snapshot, next_operator="adda Visser", next_until=1100.0)
    page.wait_for_selector(".hp-shift button.confirm")
    assert page.locator(".hp-shift button.confirm[disabled]").count() == 1, "the briefing is read first"
    assert "drone-1: this station commands; mode AUTO" in bench.text(".hp-shift")
    page.click(".hp-shift button.confirm")
    assert within(3.0, lambda: bench.orders()[1:] == [("confirm", "adda Visser")])
    bench.fake.snapshot = replace(bench.fake.snapshot, operator="", next_operator="", required=True)
    assert within(3.0, lambda: "Sign on with your name." in bench.text(".hp-do > span"))
    page.wait_for_timeout(900)
    page.click(".hp-main button.sign_on")
    assert page.evaluate("document.activeElement.tagName") == "INPUT"


def test_start_needs_a_second_press(bench: Bench) -> None:
    (craft,) = bench.fake.snapshot.aircraft
    ground = replace(craft, question=None, commander="GCSA", own=True, alarms=(), phase="on_load")
    bench.fake.snapshot = replace(bench.fake.snapshot, aircraft=(ground,))
    page = bench.open()
    page.wait_for_timeout(1200)
    page.click(".hp-main button.start")
    page.wait_for_timeout(400)
    assert bench.orders() == []
    page.click(".hp-main button.start.sure")
    assert within(3.0, lambda: bench.orders() == [("start", "")])


def test_tiles_from_the_disk_are_seen_behind_the_zones(
    browser: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("HANDOVER_PANELS", str(tmp_path / "panels"))
    folder = tmp_path / "map" / "0" / "0"
    folder.mkdir(parents=True)
    # one grey dot
    picture = "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR4nGNoAAAAggCBd81ytgAAAABJRU5ErkJggg=="
    (folder / "0.png").write_bytes(b64decode(picture))
    bench = Bench(browser, "normal", ("--tiles", str(tmp_path / "map"), "--tiles-credit", "Land & Co"))
    try:
        page = bench.open()
        page.wait_for_selector(".leaflet-tile-loaded", state="attached", timeout=15_000)
        assert "Land & Co" in page.inner_text(".leaflet-control-attribution")
    finally:
        bench.close()


def test_a_press_on_accept_sends_the_number_of_its_question(bench: Bench) -> None:
    page = bench.open()
    page.wait_for_timeout(1000)
    page.click(".hp-band button.accept")
    assert within(3.0, lambda: bench.orders() == [("accept", "252.251.3.7.-1")])
    assert within(3.0, lambda: "Accept" in bench.text(".hp-reply"))


def test_a_double_click_is_one_order(bench: Bench) -> None:
    page = bench.open()
    page.wait_for_timeout(1000)
    page.dblclick(".hp-band button.accept", delay=20)
    page.wait_for_timeout(1500)
    assert bench.orders() == [("accept", "252.251.3.7.-1")]


def test_a_button_that_has_just_appeared_takes_no_press(bench: Bench) -> None:
    page = bench.open()
    page.wait_for_timeout(1000)
    (craft,) = bench.fake.snapshot.aircraft
    asked = replace(craft, question=replace(GIVE, number="251.252.4.8.-1"), commander="GCSA", own=True)
    bench.fake.snapshot = replace(bench.fake.snapshot, aircraft=(asked,))
    assert within(3.0, lambda: page.locator(".hp-band button[data-key='1 accept 251.252.4.8.-1']").count() == 1)
    page.locator(".hp-band button.accept").dispatch_event("click", {"detail": 1})
    page.wait_for_timeout(300)
    assert bench.orders() == []
    page.wait_for_timeout(700)
    page.click(".hp-band button.accept")
    assert within(3.0, lambda: bench.orders() == [("accept", "251.252.4.8.-1")])


@pytest.mark.parametrize(("letter", "word"), [("a", "accept"), ("d", "deny")])
def test_a_key_answers_only_when_it_is_held(bench: Bench, letter: str, word: str) -> None:
    page = bench.open()
    page.wait_for_timeout(1000)
    for _ in range(3):
        page.keyboard.press(letter, delay=300)
    page.wait_for_timeout(700)
    assert bench.orders() == []
    page.keyboard.down(letter)
    page.wait_for_timeout(800)
    page.keyboard.up(letter)
    assert within(3.0, lambda: bench.orders() == [(word, "252.251.3.7.-1")])


def test_a_key_that_is_held_while_the_question_changes_answers_neither(bench: Bench) -> None:
    page = bench.open()
    page.wait_for_timeout(1000)
    page.keyboard.down("a")
    page.wait_for_timeout(100)
    (craft,) = bench.fake.snapshot.aircraft
    asked = replace(craft, question=replace(GIVE, number="251.252.4.8.-1"))
    bench.fake.snapshot = replace(bench.fake.snapshot, aircraft=(asked,))
    page.wait_for_timeout(2500)
    page.keyboard.up("a")
    assert [argument for _do, argument in bench.orders()] in ([], ["252.251.3.7.-1"])


def test_return_and_release_need_a_second_press_and_give_a_choice(bench: Bench) -> None:
    (craft,) = bench.fake.snapshot.aircraft
    bench.fake.snapshot = replace(
        bench.fake.snapshot, aircraft=(replace(craft, question=None, commander="GCSA", own=True),)
    )
    page = bench.open()
    page.wait_for_timeout(1000)
    page.click(".hp-more button.return")
    page.wait_for_timeout(400)
    assert bench.orders() == []
    page.click(".hp-more button.return.sure")
    assert within(3.0, lambda: bench.orders() == [("return", "")])
    page.click(".hp-more button.give")
    page.click(".hp-choices button:has-text('GCSB')")
    assert within(3.0, lambda: bench.orders()[1:] == [("give", "GCSB")])
    page.click(".hp-more button.release")
    page.wait_for_timeout(4600)
    assert page.locator("button.sure").count() == 0, "the second press is forgotten"
    assert len(bench.orders()) == 2


def test_a_station_that_dies_is_said_in_red(bench: Bench, pytestconfig: pytest.Config) -> None:
    """Within 3 s on a machine that does nothing else."""
    page = bench.open()
    page.wait_for_timeout(1000)
    bench.stop_station()
    limit_s = 3.0 if pytestconfig.getoption("--long") else 15.0
    assert within(limit_s, lambda: bench.text(".hp-who strong") == "NOT KNOWN")
    assert "emergency" in page.get_attribute(".hp-band", "class")
    assert page.locator(".hp-band button").count() == 0
    assert "Start it again" in bench.text(".hp-do")
    page.keyboard.down("a")
    page.wait_for_timeout(900)
    page.keyboard.up("a")
    assert bench.orders() == []


def test_the_cookie_alone_presses_no_button(bench: Bench) -> None:
    """Another port of this computer can learn the cookie."""
    assert "#" not in bench.open().url, "the key does not stay in the address"
    context = bench._browser.new_context()
    context.add_cookies(bench._kept["cookies"])
    page = context.new_page()
    page.goto(bench.link.partition("?")[0])
    page.wait_for_selector(".hp-who strong", timeout=60_000)
    page.wait_for_timeout(1000)
    page.locator(".hp-band button").first.click()
    page.wait_for_selector("text=this page needs a new link")
    context.close()
    assert bench.orders() == []


def test_a_browser_that_blocks_the_storage_presses_buttons_too(bench: Bench) -> None:
    context = bench._browser.new_context()
    context.add_init_script("Object.defineProperty(window, 'localStorage', {get() { throw new Error('blocked'); }})")
    page = context.new_page()
    page.goto(bench.link)
    page.wait_for_selector(".hp-who strong", timeout=60_000)
    page.wait_for_timeout(1000)
    page.click(".hp-band button.accept")
    assert within(15.0, lambda: bench.orders() == [("accept", "252.251.3.7.-1")])
    context.close()


def test_a_panel_that_dies_is_said_by_the_browser_itself(bench: Bench) -> None:
    page = bench.open()
    page.wait_for_timeout(1000)
    bench.program.kill()
    assert within(3.5, lambda: bench.text(".hp-who strong") == "NOT KNOWN")
    assert "handover panel" in bench.text(".hp-do")
    assert page.locator(".hp-band button").count() == 0


def test_a_page_whose_connection_never_comes_says_so(bench: Bench) -> None:
    bench.open()
    context = bench._browser.new_context(storage_state=bench._kept)
    context.route("**/_nicegui_ws/**", lambda route: route.abort())
    context.route_web_socket("**/_nicegui_ws/**", lambda _socket: None)
    page = context.new_page()
    page.goto(bench.link.partition("?")[0])
    page.wait_for_selector(".hp-who strong", timeout=60_000)
    assert page.inner_text(".hp-who strong") == "NOT KNOWN"
    assert page.locator(".hp-band button").count() == 0
    context.close()


def test_what_comes_from_outside_is_text_and_no_page(bench: Bench) -> None:
    (craft,) = bench.fake.snapshot.aircraft
    evil = "<img src=x onerror=\"document.title='evil'\">"
    bench.fake.snapshot = replace(
        bench.fake.snapshot,
        aircraft=(replace(craft, name=evil, decision=evil, briefing=((evil, evil),), question=None),),
    )
    page = bench.open()
    page.wait_for_timeout(2000)
    assert evil in bench.text(".hp-briefing")
    assert page.title() == "GCSA panel"
    assert page.locator("img[src='x']").count() == 0
