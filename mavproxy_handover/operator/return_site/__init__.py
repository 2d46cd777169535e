# SPDX-License-Identifier: GPL-3.0-or-later

"""The return site: judged each second, and kept in the rally list of the autopilot."""
