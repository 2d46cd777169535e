# SPDX-License-Identifier: GPL-3.0-or-later

"""Missions on their way to the autopilot: packages, uploads, and what follows from them."""
