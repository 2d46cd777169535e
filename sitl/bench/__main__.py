# SPDX-License-Identifier: GPL-3.0-or-later

"""`python -m sitl.bench`."""

from __future__ import annotations

import sys

from sitl.bench.main import main

sys.exit(main(sys.argv[1:]))
