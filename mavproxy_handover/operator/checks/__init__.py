# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks: parameters before flight, the mission that the autopilot holds, commands in flight."""
