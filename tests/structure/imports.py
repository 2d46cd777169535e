# SPDX-License-Identifier: GPL-3.0-or-later

"""Who imports whom, read from the sources, and the floors that `docs/architecture.md` gives to the parts.

A part is a folder of `mavproxy_handover/`, a file at its top, a folder within a folder that the table names, or another
package. `INNER` names the folders that have a table of their own. Imports count wherever they stand: at the top of a
file, in a function, behind TYPE_CHECKING. What is loaded by a name in a string (`handover sim`) does not.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

__all__ = ["DOCUMENT", "INNER", "ROOT", "Part", "edges", "files", "floors", "imported", "part_of", "part_within"]

ROOT = Path(__file__).resolve().parents[2]
DOCUMENT = ROOT / "docs" / "architecture.md"
PACKAGES = ("mavproxy_handover", "gcs_module", "sitl")
#: data, and the top-level modules that MAVProxy loads by name
DATA = ("mavproxy_handover.deploy", "gcs_module.deploy")
#: table of floors -> the folder whose parts it lists
INNER = {"operators": "mavproxy_handover/operator", "simulation": "sitl"}
_ROW = re.compile(r"\| (\d+) \| `([\w/.]+)` \| (.+) \|")


@dataclass(frozen=True, slots=True)
class Part:
    """One row of the table of floors."""

    floor: int
    name: str  #: as written there: `gate/`, `module.py`, `sitl/`
    says: str


@cache
def floors(table: str = "floors") -> tuple[Part, ...]:
    """A table of floors, from the top down: the house's, or one of `INNER`."""
    behind = DOCUMENT.read_text(encoding="utf-8").partition(f"<!-- {table}:begin -->")[2]
    rows = (_ROW.fullmatch(line) for line in behind.partition(f"<!-- {table}:end -->")[0].splitlines())
    return tuple(Part(int(row[1]), row[2], row[3]) for row in rows if row is not None)


@cache
def files() -> Mapping[str, Path]:
    """Every module by its dotted name. `setup.py` builds a package and is not in it."""
    found = {}
    for package in PACKAGES:
        for path in sorted(each for each in (ROOT / package).rglob("*.py") if each.name != "setup.py"):
            parts = path.relative_to(ROOT).with_suffix("").parts
            name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
            if not name.startswith(DATA):
                found[name] = path
    return found


def part_of(module: str) -> str:
    """The part of the house that a module belongs to, as the table writes it."""
    package, *rest = module.split(".")
    if package != "mavproxy_handover" or not rest:
        return f"{package}/"
    inner = f"{'/'.join(rest[:2])}/"
    return inner if inner in {part.name for part in floors()} else _named(ROOT / package, rest[0])


def part_within(folder: str, module: str) -> str | None:
    """The same within a folder of `INNER`; None for what is no part of it, and for the folder itself."""
    inside = module.replace(".", "/").removeprefix(f"{folder}/")
    if inside == module.replace(".", "/"):
        return None
    return f"{folder.removeprefix('mavproxy_handover/')}/{_named(ROOT / folder, inside.split('/')[0])}"


def _named(package: Path, name: str) -> str:
    return f"{name}/" if (package / name).is_dir() else f"{name}.py"


def statements(tree: ast.Module) -> Iterator[ast.AST]:
    """Every statement, those within others too."""
    waiting: list[ast.AST] = [tree]
    while waiting:
        node = waiting.pop()
        yield node
        for field in ("body", "orelse", "finalbody", "handlers", "cases"):
            waiting += getattr(node, field, ())


def imported(source: str, modules: Mapping[str, object]) -> set[str]:
    """The modules of `modules` that this source imports."""
    found = set()
    for node in statements(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            if node.level:
                raise ValueError(f"a relative import of {node.module}: write the whole name")
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                found.add(whole if whole in modules else node.module)
    return found & set(modules)


@cache
def edges() -> Mapping[str, frozenset[str]]:
    """Every module, and the modules that it imports."""
    return {
        name: frozenset(imported(path.read_text(encoding="utf-8"), files()) - {name}) for name, path in files().items()
    }
