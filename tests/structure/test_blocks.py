# SPDX-License-Identifier: GPL-3.0-or-later

"""What the documents show can be typed: every block of every page is of a known kind, and tried as that kind can be.

Shell lines are parsed by the real parsers, and run in a folder of their own where they end by themselves; console lines
are commands of the modules, or MAVProxy's; TOML loads. What is shown and not typed is marked `text`.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import re
import shlex
import shutil
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from unittest.mock import patch

import pytest
from markdown_it import MarkdownIt

from mavproxy_handover import cli
from reference.pages import PAGES as REFERENCE

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).resolve().parents[2]
PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md", "missions/README.md")),
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "ardupilot_lua").glob("*.md")),
]
#: blocks that are shown, and not typed; files of kind ini and bash are tried by tests of their pages
SHOWN = ("text", "c", "python", "ini", "bash")
#: first words of shell lines that are not ours: what the line is taken to be right for
OTHERS = {
    **dict.fromkeys(
        ("cd", "cp", ".", "editor", "git", "install", "ln", "systemctl", "apt", "cat", "chmod", "ip", "sh"),
        "the machine's own",
    ),
    "wg": "WireGuard's: typed in tests/sitl/test_encryption_page.py",
    "gz": "Gazebo's: not tried, as its page says",
    **dict.fromkeys(("pip", "python3"), "the machine's Python"),
    "arducopter": "ArduPilot's program: flown as `sitl/vehicles/arducopter.py` starts it",
}
#: commands that end by themselves in no time, wherever they are run
RUN = ("check", "init")
#: MAVProxy's own console commands that are shown
MAVPROXY = ("mode",)


def blocks(path: Path) -> Iterator[tuple[str, str]]:
    """Kind and contents of each fenced block of a page."""
    for token in MarkdownIt().enable("table").parse(path.read_text(encoding="utf-8")):
        if token.type == "fence":
            yield token.info.strip(), token.content


def typed(kind: str) -> list[object]:
    """Each line of the blocks of that kind, with its page."""
    found = []
    for path in PAGES:
        for which, contents in blocks(path):
            if which == kind:
                lines = contents.replace("\\\n", " ").splitlines()
                found += [(path.name, line.strip()) for line in lines if line.strip()]
    return [pytest.param(line, id=f"{page}: {line[:60]}") for page, line in found]


class _Parsed(BaseException):
    """The command has parsed its line; nothing of it may catch that."""


def parses(words: list[str]) -> bool:
    """Whether a command of `handover` takes these words."""
    module, function, _text = cli.COMMANDS[words[0]]
    run = getattr(importlib.import_module(module), function)
    original = argparse.ArgumentParser.parse_args

    def parse(self: argparse.ArgumentParser, *args: object, **more: object) -> None:
        original(self, *args, **more)  # type: ignore[arg-type]
        raise _Parsed

    with patch.object(argparse.ArgumentParser, "parse_args", parse):
        try:
            run(words[1:])
        except _Parsed:
            return True
        except SystemExit:
            return False
    return False


def words_of(line: str) -> list[list[str]]:
    """The commands of a shell line, without sudo, a program's folder and what is set for it."""
    found = []
    for command in line.split("&&"):
        words = shlex.split(command, comments=True)
        while words and (words[0] == "sudo" or "=" in words[0]):
            words = words[1:]
        if words:
            found.append([words[0].rpartition("/")[2] if "/bin/" in words[0] else words[0], *words[1:]])
    return found


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_every_block_is_of_a_known_kind(path: Path) -> None:
    assert [kind for kind, _contents in blocks(path) if kind not in ("", "console", "toml", *SHOWN)] == []


@pytest.mark.parametrize("line", typed(""))
def test_a_shell_line_is_one_that_can_be_typed(line: str) -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for words in words_of(line):
        if words[0] == "handover":
            assert words[1] in ("--version",) or parses(words[1:]), words
        elif words[0] == "make":
            targets = [word for word in words[1:] if "=" not in word]
            assert all(f"\n{target}: " in makefile for target in targets), words
        elif words[0] == "python" and words[1] == "-m":
            assert importlib.util.find_spec(words[2]) is not None
            assert all((ROOT / word).exists() for word in words[3:] if word.endswith(".py")), words
        elif words[0] == "mavproxy.py":
            (load,) = [word for word in words if word.startswith("--cmd=module load handover")]
            assert re.fullmatch(r"--cmd=module load handover(_gcs)?:\{\"config\":\"[\w.]+\"\}", load)
        else:
            assert words[0] in OTHERS, words


@cache
def commands_page() -> str:
    """The page of the reference with everything that can be typed."""
    return REFERENCE["commands.md"]()


@pytest.mark.parametrize("line", typed("console"))
def test_a_console_line_is_a_command_of_a_module(line: str) -> None:
    words = re.split(r" {2,}", line)[0].split()
    if words[0] != "handover":
        assert words[0] in MAVPROXY
        return
    told = (ROOT / "docs" / "operating.md").read_text(encoding="utf-8")
    assert re.search(rf"^\|.*`handover {words[1]}\b", told, re.MULTILINE), words
    assert f"handover {words[1]}" in commands_page()


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_toml_loads(path: Path) -> None:
    for kind, contents in blocks(path):
        if kind == "toml":
            assert tomllib.loads(contents)


def test_nothing_is_allowed_that_no_page_shows() -> None:
    kinds = {kind for path in PAGES for kind, _contents in blocks(path)}
    firsts = {
        words[0]
        for path in PAGES
        for kind, contents in blocks(path)
        if kind == ""
        for line in contents.replace("\\\n", " ").splitlines()
        for words in words_of(line)
    }
    assert set(SHOWN) <= kinds
    assert set(OTHERS) <= firsts
    consoles = {
        line.split()[0]
        for path in PAGES
        for kind, text in blocks(path)
        if kind == "console"
        for line in text.splitlines()
    }
    assert set(MAVPROXY) <= consoles


def test_what_ends_by_itself_does_what_it_is_shown_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In the order of each page, in a folder with missions and a plan: the tutorial copies and checks its own."""
    ran = []
    for path in PAGES:
        home = tmp_path / path.relative_to(ROOT).with_suffix("")
        shutil.copytree(ROOT / "missions", home / "missions")
        shutil.copytree(ROOT / "tests" / "data" / "init", home, dirs_exist_ok=True)
        monkeypatch.chdir(home)
        monkeypatch.setenv("HOME", str(home))
        for kind, contents in blocks(path):
            if kind:
                continue
            for line in contents.replace("\\\n", " ").splitlines():
                for words in words_of(line):
                    if words[0] == "cp":
                        shutil.copytree(words[2], words[3])
                    if words[0] == "cd" and (folder := Path(words[1].replace("~", str(home)))).is_dir():
                        monkeypatch.chdir(folder)
                    if words[0] != "handover" or words[1] not in RUN:
                        continue
                    here = [word.replace("~", str(home)) for word in words[1:]]
                    assert cli.main(here) == 0, (path.name, line, capsys.readouterr().err)
                    ran.append(words[1])
    assert sorted(ran) == ["check", "check", "check", "check", "init", "init", "init", "init"]


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_what_is_named_in_the_prose_exists(path: Path) -> None:
    """`handover WORD --option`: a command of the shell, of the companion's or of the station's console."""
    text = path.read_text(encoding="utf-8")
    consoles = commands_page()
    for words in re.findall(r"`handover ((?:-v [\w-]+ )?[a-z][^`]*)`", text):
        word = words.split()[0] if not words.startswith("-v") else words.split()[2]
        known = word in cli.COMMANDS or f"handover {word}" in consoles
        assert known, f"{path.name}: handover {words}"
        if word in cli.COMMANDS:
            section = consoles.partition(f"# handover {word}")[2]
            for option in re.findall(r"(?<![\w-])--[a-z-]+", words.partition(" -- ")[0]):
                assert option in section, f"{path.name}: handover {words}"
