# SPDX-License-Identifier: GPL-3.0-or-later

"""Services of the companion for the operators at the stations."""
