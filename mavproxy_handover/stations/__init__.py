# SPDX-License-Identifier: GPL-3.0-or-later

"""Stations as the companion reaches them: their links, and the sender of the companion's messages."""
