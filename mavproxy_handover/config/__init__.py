# SPDX-License-Identifier: GPL-3.0-or-later

"""Configuration files: where they are found, how they are read, and what a vehicle's and a station's say."""
