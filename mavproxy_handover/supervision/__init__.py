# SPDX-License-Identifier: GPL-3.0-or-later

"""The supervisor of the companion's MAVProxy: `handover companion` runs it, and it forks MAVProxy (`supervisor.py`)."""
