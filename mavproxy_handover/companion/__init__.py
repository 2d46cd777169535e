# SPDX-License-Identifier: GPL-3.0-or-later

"""The companion of one vehicle: events to the rules, one at a time, and the actions of the rules carried out."""
