# SPDX-License-Identifier: GPL-3.0-or-later

"""Pages that say what the code says: made from the parsers, tables and definitions that the programs themselves use.

Nothing is described here: a word that is missing belongs beside the thing that it describes. No page is committed.
`setup.py` makes the manual pages and the completion of shells, `make docs` and `make reference` the reference. Parts of
other files (`blocks.py`) are committed with these files: `make reference` writes them.
"""

from pathlib import Path

__all__ = ["ROOT"]

ROOT = Path(__file__).resolve().parents[1]
