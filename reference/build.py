# SPDX-License-Identifier: GPL-3.0-or-later

"""Writes the manual pages and the completion of shells while the package is built: `setup.py` runs this.

    python -m reference.build DIALECT MANUAL COMPLETION

DIALECT: the Python of the dialect, which is not installed yet. MANUAL, COMPLETION: folders.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

_NAME = "pymavlink.dialects.v20.handover"


def main(dialect: Path, manual_folder: Path, completion_folder: Path) -> None:
    """Write both. The dialect is loaded first: the commands import it."""
    spec = spec_from_file_location(_NAME, dialect)
    assert spec is not None
    assert spec.loader is not None
    sys.modules[_NAME] = module_from_spec(spec)
    spec.loader.exec_module(sys.modules[_NAME])
    from reference.completion import completion
    from reference.manual import manual

    _write(manual_folder, manual())
    _write(completion_folder, completion())


def _write(folder: Path, files: Mapping[str, str]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
