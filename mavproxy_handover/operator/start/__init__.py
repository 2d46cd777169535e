# SPDX-License-Identifier: GPL-3.0-or-later

"""START, the check before it, and the orders that the companion gives to the autopilot."""
