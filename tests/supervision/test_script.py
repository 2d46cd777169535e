# SPDX-License-Identifier: GPL-3.0-or-later

"""What the supervisor's process imports."""

from __future__ import annotations

import subprocess
import sys


def test_what_the_companion_command_imports_starts_no_threads() -> None:
    """A process with threads does not fork, so the companion would run without supervision."""
    code = (
        "from mavproxy_handover.cli import main; from mavproxy_handover.supervision.supervisor import single_threaded; "
        "main(['companion', '--help']); import mavproxy_handover.config.running; print(single_threaded())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60.0)
    assert done.stdout.splitlines()[-1] == "True"
