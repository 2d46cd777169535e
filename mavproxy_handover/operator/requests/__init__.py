# SPDX-License-Identifier: GPL-3.0-or-later

"""Requests of the stations, carried out after the verdict of the gate."""
