# SPDX-License-Identifier: GPL-3.0-or-later

"""Stations as the companion reaches them: their links, our messages to them, and the event log."""
