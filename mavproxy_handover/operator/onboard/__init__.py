# SPDX-License-Identifier: GPL-3.0-or-later

"""Onboard programs: their links, what the companion answers them, and what the commander delegates to them."""
