# SPDX-License-Identifier: GPL-3.0-or-later

"""The policy, as data, and how a frame finds its row in it."""
