# SPDX-License-Identifier: GPL-3.0-or-later

"""The companion of one vehicle: gives events to the rules, one at a time, and carries out their actions."""
