# SPDX-License-Identifier: GPL-3.0-or-later

"""`make bench`: what authority handover costs and how long it takes, compared with a baseline.

Every measurement runs its baseline in the same run, on the same machine, in turns (A B B A), and the result is the
ratio of the two: a busy machine slows both sides. The table of parts is in `__main__.py`; docs/architecture.md has the
limits.
"""
