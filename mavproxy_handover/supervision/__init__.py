# SPDX-License-Identifier: GPL-3.0-or-later

"""What keeps the companion's MAVProxy going: `handover companion` is this, and forks it (`supervisor.py`)."""
