# SPDX-License-Identifier: GPL-3.0-or-later

"""Docstrings and comments name in backquotes only files, folders and modules that exist.

A file or folder is named as seen from the folder of the text, from a folder above it, from `mavproxy_handover/`, or
from `mavproxy_handover/core/`.
"""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from tests.structure.imports import PACKAGES, ROOT, files

#: a file of a kind that only we write, or a folder
_PATH = re.compile(r"`{1,2}((?:[\w.-]+/)*(?:[\w-]+\.(?:py|lua|xml)|[\w.-]+/))`")
_MODULE = re.compile(rf"`((?:{'|'.join(PACKAGES)})(?:\.\w+)+)`")

#: files of other programs -> whose they are
OTHERS = {
    "all.xml": "the dialect of all messages, in the repository of MAVLink",
    "mavloss.py": "a tool of pymavlink",
    "mavproxy.py": "the program of MAVProxy",
}


def texts(source: str) -> Iterator[str]:
    """The docstrings and comments of a source; comments that follow each other are one text."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            yield ast.get_docstring(node) or ""
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            yield token.string


@cache
def places(folder: Path) -> tuple[Path, ...]:
    """The folders that a name in a text of this folder may begin in."""
    above = [folder, *folder.parents]
    return (*above[: above.index(ROOT) + 1], ROOT / "mavproxy_handover", ROOT / "mavproxy_handover" / "core")


def missing(source: str, folder: Path) -> list[str]:
    """What is named in the texts of a source in that folder, and is not there."""
    found: list[str] = []
    if not _PATH.search(source) and not _MODULE.search(source):
        return found  # most sources name nothing, and need not be parsed
    for text in texts(source):
        for name in _PATH.findall(text):
            if name not in OTHERS and not any((place / name).exists() for place in places(folder)):
                found.append(name)
        for name in _MODULE.findall(text):
            parent = files().get(name.rpartition(".")[0])
            if name not in files() and (parent is None or name.rpartition(".")[2] not in parent.read_text("utf-8")):
                found.append(name)
    return found


@pytest.mark.parametrize("module", sorted(files()))
def test_what_a_text_names_is_there(module: str) -> None:
    path = files()[module]
    assert missing(path.read_text(encoding="utf-8"), path.parent) == []


def test_what_is_excepted_is_named_somewhere() -> None:
    everything = "\n".join(path.read_text(encoding="utf-8") for path in files().values())
    assert [name for name in OTHERS if f"`{name}`" not in everything] == []


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("`transfer.py` moves it", []),
        ("as `core/authority/transfer.py` has it", []),
        ("as `mavproxy_handover/core/` has it", []),
        ("as `sitl/campaign/` has it", []),
        ("as `mavproxy_handover.core.arbiter` or `mavproxy_handover.core.arbiter.Arbiter` has it", []),
        ("as `Transfer.move` has it; transfers.py is no name in backquotes", []),
        ("`transfers.py` moves it", ["transfers.py"]),
        ("as `safety/transfer.py` has it", ["safety/transfer.py"]),
        ("as `core/rules/` has it", ["core/rules/"]),
        (
            "as `mavproxy_handover.core.judge` or `mavproxy_handover.core.judge.Judge` has it",
            ["mavproxy_handover.core.judge", "mavproxy_handover.core.judge.Judge"],
        ),
    ],
)
def test_the_reader_sees_the_names(text: str, found: list[str]) -> None:
    folder = ROOT / "mavproxy_handover" / "core" / "authority"
    assert missing(f'"""{text}."""\n', folder) == found
    assert missing(f"def f():\n    x = 1  # {text}\n", folder) == found
    assert missing(f'class C:\n    """{text}."""\n', folder) == found
    assert missing(f"x = '{text}'\n", folder) == []
