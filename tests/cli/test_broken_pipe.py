# SPDX-License-Identifier: GPL-3.0-or-later

"""Whose reader has gone (`handover policy | head`) ends without a word, as other programs do."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from mavproxy_handover import cli
from tests.depth import first
from tests.sitl.synthetic import write_folder

PIPE = 141
PROGRAM = "import sys; from mavproxy_handover.cli import main; sys.exit(main())"


def ends(words: Sequence[str], *, errors_too: bool = False, buffered: bool = True) -> tuple[int, str]:
    """Exit code and error output of a command line of whose output nobody reads a byte."""
    environment = {**os.environ, "PYTHONUNBUFFERED": "" if buffered else "1"}
    reader, writer = os.pipe()
    os.close(reader)
    try:
        ended = subprocess.run(
            [sys.executable, "-c", PROGRAM, *words],
            stdout=writer,
            stderr=writer if errors_too else subprocess.PIPE,
            env=environment,
            text=True,
            timeout=60,
            check=False,
        )
    finally:
        os.close(writer)
    return ended.returncode, ended.stderr or ""


@pytest.fixture
def places(tmp_path: Path) -> dict[str, str]:
    """What the command lines below name."""
    run = write_folder(tmp_path / "run")
    (tmp_path / "card" / "APM").mkdir(parents=True)
    keys = tmp_path / "keys"
    assert cli.main(["keys", "make", "GCSA", "--dir", str(keys)]) == 0
    return {
        "MISSION": str(run / "mission"),
        "RUN": str(run),
        "CARD": str(tmp_path / "card"),
        "KEYS": str(keys),
        "NEW": str(tmp_path / "new"),
    }


@pytest.mark.parametrize(
    ("words", "buffered"),
    first(
        5,
        [
            ("--help", True),
            ("policy", True),
            ("policy", False),
            ("check MISSION", True),
            ("sim --list", True),
            ("--help", False),
            ("--version", True),
            ("policy --json", True),
            ("policy --help", True),
            ("check MISSION", False),
            ("sim --out NEW", True),
            ("report RUN", True),
            ("keys list --dir KEYS", True),
            ("guard CARD", True),
            ("init vehicle NEW", True),
            ("companion --help", True),
        ],
    ),
)
def test_it_ends_quietly(places: dict[str, str], words: str, buffered: bool) -> None:
    assert ends([places.get(word, word) for word in words.split()], buffered=buffered) == (PIPE, "")


@pytest.mark.parametrize(
    "words", [["policy", "no-such-thing"], ["check", "nowhere"], ["nosuch"], ["policy", "--nosuch"]]
)
def test_if_errors_go_the_same_way_too(words: list[str]) -> None:
    assert ends(words, errors_too=True)[0] == PIPE


@pytest.mark.parametrize(("words", "code"), [(["policy"], 0), (["policy", "no-such-thing"], 1), ([], 2)])
def test_without_any_output_at_all_it_still_says_by_its_code_how_it_went(words: list[str], code: int) -> None:
    shell = ["sh", "-c", 'exec "$@" >&- 2>&-', "sh", sys.executable, "-c", PROGRAM, *words]
    assert subprocess.run(shell, timeout=60, check=False).returncode == code


def test_a_pipe_of_another_kind_is_a_fault_and_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(_words: list[str]) -> int:
        raise BrokenPipeError("a socket")

    before = sys.stdout, sys.stderr
    monkeypatch.setattr(cli, "_run", broken)
    with pytest.raises(BrokenPipeError, match="a socket"):
        cli.main([])
    assert (sys.stdout, sys.stderr) == before
