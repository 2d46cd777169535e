# SPDX-License-Identifier: GPL-3.0-or-later

"""Safety decisions, and what the aircraft does about a fault: pure rules, each a table or a small object."""
