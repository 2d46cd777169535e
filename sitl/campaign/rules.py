# SPDX-License-Identifier: GPL-3.0-or-later

"""Identifies the rules that a campaign has flown, by a digest of our modules.

The digest has every module that affects the result of a seed. Flights of two campaigns may be added up only if both
have flown the same rules, whatever else has changed between them. A worker that holds other rules must not fly for this
campaign.
"""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Final

__all__ = ["modules", "rules"]

#: what flies a seed and judges it; all that it imports counts
_FLIES: Final = "sitl.campaign.outcome"
_OURS: Final = ("mavproxy_handover", "gcs_module", "sitl")


@cache
def rules() -> str:
    """The digest: 12 digits (hexadecimal) of SHA-256 over the modules, by name. Raises OSError."""
    digest = hashlib.sha256()
    for name, path in sorted(modules().items()):
        digest.update(f"{name} {hashlib.sha256(path.read_bytes()).hexdigest()}\n".encode())
    return digest.hexdigest()[:12]


def modules() -> dict[str, Path]:
    """Our modules that a flight imports, directly or not, and their files. Raises OSError."""
    found: dict[str, Path] = {}
    waiting = [_FLIES]
    while waiting:
        name = waiting.pop()
        if name in found or name.split(".")[0] not in _OURS:
            continue
        spec = find_spec(name)
        if spec is None or spec.origin is None:
            raise FileNotFoundError(f"no source of {name}")
        found[name] = Path(spec.origin)
        waiting.extend((name.rpartition(".")[0], *_imported(found[name])))
    return found


def _imported(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module
            yield from (name for alias in node.names if _is_module(name := f"{node.module}.{alias.name}"))


def _is_module(name: str) -> bool:
    if name.split(".", maxsplit=1)[0] not in _OURS:
        return False
    try:
        return find_spec(name) is not None
    except ModuleNotFoundError:  # what it would be a part of is no package
        return False
