# SPDX-License-Identifier: GPL-3.0-or-later

"""Who has authority, and how it moves: pure rules, each a table or a small object."""
