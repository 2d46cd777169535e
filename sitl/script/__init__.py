# SPDX-License-Identifier: GPL-3.0-or-later

"""The language of scenarios: the words of their files, and what each of them does or expects."""
