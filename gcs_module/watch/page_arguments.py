# SPDX-License-Identifier: GPL-3.0-or-later

"""Arguments that the commands of all pages have."""

from __future__ import annotations

import argparse

__all__ = ["add_address", "port"]


def port(text: str) -> int:
    """The number of a port; 0: a free one. Raises ValueError, as argparse wants it."""
    value = int(text)
    if not 0 <= value <= 65535:
        raise ValueError(text)
    return value


def add_address(parser: argparse.ArgumentParser, host: str, number: int) -> None:
    """Add the address of the page. `host`: name of the argument for it; `number`: the usual port."""
    parser.add_argument(host, default="127.0.0.1", metavar="ADDRESS", help="where the page is (127.0.0.1)")
    parser.add_argument(
        "--port", type=port, default=number, metavar="N", help=f"and at which port ({number}); 0: a free one"
    )
