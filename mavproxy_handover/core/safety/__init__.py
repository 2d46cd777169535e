# SPDX-License-Identifier: GPL-3.0-or-later

"""What the aircraft does when something is wrong: pure rules, each a table."""
