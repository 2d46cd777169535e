# SPDX-License-Identifier: GPL-3.0-or-later

"""What a scenario says: the words of its files, and what each of them does or wants."""
