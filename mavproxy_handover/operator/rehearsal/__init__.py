# SPDX-License-Identifier: GPL-3.0-or-later

"""Rehearsals on the ground, and their report."""
