# SPDX-License-Identifier: GPL-3.0-or-later

"""The stations as the companion reaches them: their links, its own voice, and the standard's requests of control."""
