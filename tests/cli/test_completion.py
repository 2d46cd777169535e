# SPDX-License-Identifier: GPL-3.0-or-later

"""What shells complete behind `handover`, asked of the shells themselves, and what the manual pages look like."""

from __future__ import annotations

import os
import pty
import re
import select
import shutil
import subprocess
import time
from pathlib import Path

import pytest

from mavproxy_handover.cli import COMMANDS, main
from reference.completion import completion
from reference.manual import manual

#: nothing can be started: what completes needs no Python
NOWHERE = {"PATH": "/nonexistent", "TERM": "dumb"}


def program(name: str) -> str:
    found = shutil.which(name)
    if found is None:
        pytest.skip(f"{name} is not installed")
    return found


@pytest.fixture(scope="module")
def scripts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The scripts, as the build makes them."""
    return written(tmp_path_factory.mktemp("completion"), completion())


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The manual pages, as the build makes them."""
    return sorted(written(tmp_path_factory.mktemp("man1"), manual()).iterdir())


def written(folder: Path, files: dict[str, str]) -> Path:
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    return folder


def in_bash(scripts: Path, line: str, folder: Path) -> list[str]:
    """What bash's function offers for the last word of a line."""
    words = line.split(" ")
    script = (
        f"source {scripts / 'handover'}; COMP_WORDS=({' '.join(repr(word) for word in words)}); "
        f'COMP_CWORD={len(words) - 1}; _shtab_handover; printf "%s\\n" "${{COMPREPLY[@]}}"'
    )
    command = [program("bash"), "--norc", "--noprofile", "-c", script]
    done = subprocess.run(command, env=NOWHERE, cwd=folder, capture_output=True, text=True, timeout=20, check=True)
    assert "command not found" not in done.stderr
    return done.stdout.split()


def test_the_script_that_is_printed_is_the_one_that_ships(
    scripts: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mavproxy_handover.cli.completion.shipped", lambda _name: scripts)
    for shell, name in (("bash", "handover"), ("zsh", "_handover"), ("fish", "handover.fish")):
        assert main(["completion", shell]) == 0
        assert capsys.readouterr().out == (scripts / name).read_text(encoding="utf-8")
    assert main(["completion", "tcsh"]) == 2


def test_what_is_not_installed_has_no_script_and_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mavproxy_handover.cli.completion.shipped", lambda _name: tmp_path)
    assert main(["completion", "bash"]) == 2
    said = f"handover completion: {tmp_path}/handover: No such file or directory; 'pip install' makes it\n"
    assert tuple(capsys.readouterr()) == ("", said)


def test_bash_offers_every_command_and_those_that_begin_so(scripts: Path, tmp_path: Path) -> None:
    assert set(in_bash(scripts, "handover ", tmp_path)) == set(COMMANDS)
    assert in_bash(scripts, "handover ch", tmp_path) == ["check"]
    assert in_bash(scripts, "handover keys r", tmp_path) == ["rotate", "retire"]


def test_bash_offers_options_their_words_and_files(scripts: Path, tmp_path: Path) -> None:
    (tmp_path / "delivery").mkdir()
    (tmp_path / "delta.tlog").touch()
    assert in_bash(scripts, "handover check --m", tmp_path) == ["--map"]
    assert in_bash(scripts, "handover sim --vehicle a", tmp_path) == ["arducopter", "auto"]
    assert in_bash(scripts, "handover sim --scenario nom", tmp_path) == ["nominal"]
    assert in_bash(scripts, "handover init d", tmp_path) == ["demo"]
    assert in_bash(scripts, "handover check de", tmp_path) == ["delivery"]
    assert sorted(in_bash(scripts, "handover report de", tmp_path)) == ["delivery", "delta.tlog"]
    assert in_bash(scripts, "handover keys make --dir de", tmp_path) == ["delivery"]


def test_bash_completes_what_is_typed_at_a_terminal(scripts: Path, tmp_path: Path) -> None:
    bash = program("bash")
    child, terminal = pty.fork()
    if child == 0:
        os.chdir(tmp_path)
        os.execve(bash, [bash, "--norc", "--noprofile", "-i"], NOWHERE | {"HOME": str(tmp_path), "PS1": "> "})
    try:
        os.write(terminal, f"source {scripts / 'handover'}\n".encode())
        os.write(terminal, b"echo said: handover uni\tcom\t\n")
        # `echo` has no completion of ours: the line below has
        os.write(terminal, b"handover uni\tcomp\t --pur\t\n")
        shown, until = "", time.monotonic() + 20
        while "handover uninstall companion  --purge" not in shown and time.monotonic() < until:
            if select.select([terminal], [], [], 0.2)[0]:
                shown += os.read(terminal, 4096).decode()
        assert "handover uninstall companion  --purge" in shown
        os.write(terminal, b"exit\n")
    finally:
        os.close(terminal)
        os.waitpid(child, 0)


def test_fish_completes_the_same(scripts: Path, tmp_path: Path) -> None:
    script = (
        f"source {scripts / 'handover.fish'}; complete -C 'handover keys r'; complete -C 'handover sim --vehicle a'"
    )
    command = [program("fish"), "--no-config", "-c", script]
    done = subprocess.run(
        command, env={**os.environ, "HOME": str(tmp_path)}, capture_output=True, text=True, timeout=20, check=True
    )
    assert {line.split("\t")[0] for line in done.stdout.splitlines()} == {"rotate", "retire", "arducopter", "auto"}


def test_zsh_takes_its_script(scripts: Path, tmp_path: Path) -> None:
    script = f"fpath=({scripts} $fpath); autoload -Uz compinit; compinit -u -D; echo $_comps[handover]"
    command = [program("zsh"), "-f", "-c", script]
    done = subprocess.run(
        command, env={**os.environ, "HOME": str(tmp_path)}, capture_output=True, text=True, timeout=20, check=True
    )
    assert done.stdout.strip().endswith("handover")
    subprocess.run([program("zsh"), "-n", str(scripts / "_handover")], timeout=20, check=True)


# ---- manual -------------------------------------------------------------------------------------------------------


def test_man_renders_every_page_without_a_warning(pages: list[Path]) -> None:
    man = program("man")
    assert len(pages) == len(COMMANDS) + 1
    environment = {**os.environ, "MANWIDTH": "200", "LC_ALL": "C.UTF-8"}
    command = [man, "--warnings", "-l", *map(str, pages)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60, check=True)
    if "has been minimized" in done.stdout:
        pytest.skip("man is not installed: a stand-in says so")
    assert done.stderr == ""
    shown = re.sub(r".\x08", "", done.stdout)
    for page in pages:
        assert re.search(rf"^NAME\n\s+{re.escape(page.stem)} - ", shown, re.MULTILINE), page.name


def test_mandoc_finds_nothing_but_the_date_that_no_version_has(pages: list[Path]) -> None:
    mandoc = program("mandoc")
    done = subprocess.run(
        [mandoc, "-Tlint", "-Wwarning", *map(str, pages)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert [line for line in done.stdout.splitlines() if 'missing date, using ""' not in line] == []
