# SPDX-License-Identifier: GPL-3.0-or-later

"""Authority and its transfer between stations: pure rules, each a table or a small object."""
