# SPDX-License-Identifier: GPL-3.0-or-later

"""Messages of the autopilot, leases to the guard, and jobs at intervals."""
