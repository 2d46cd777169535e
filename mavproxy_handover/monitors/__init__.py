# SPDX-License-Identifier: GPL-3.0-or-later

"""Monitors: each computes one thing from the vehicle state, in a file or folder. No monitor imports another."""
