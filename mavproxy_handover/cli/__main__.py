# SPDX-License-Identifier: GPL-3.0-or-later

"""`python -m mavproxy_handover.cli`: `handover`, where that is not on the path."""

from __future__ import annotations

import sys

from mavproxy_handover.cli import main

sys.exit(main())
