# SPDX-License-Identifier: GPL-3.0-or-later

"""Runs a simulation: processes, links between them, and the one thread that plays a scenario."""
