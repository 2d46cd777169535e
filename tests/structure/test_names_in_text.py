# SPDX-License-Identifier: GPL-3.0-or-later

"""What docstrings and comments name in backquotes is there: files, folders and modules of this project.

A file or folder is named as seen from the folder of the text, or from a folder above it; within the main package also
from `mavproxy_handover/`.
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

#: files and folders of other programs and of users, and where they are
OTHERS: dict[str, str] = {}


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
    found = []
    for text in texts(source):
        for name in _PATH.findall(text):
            if name not in OTHERS and not any((place / name).exists() for place in places(folder)):
                found.append(name)
        for name in _MODULE.findall(text):
            if name not in files() and name.rpartition(".")[0] not in files():
                found.append(name)
    return found


@pytest.mark.parametrize("module", sorted(files()))
def test_what_a_text_names_is_there(module: str) -> None:
    path = files()[module]
    assert missing(path.read_text(encoding="utf-8"), path.parent) == []
