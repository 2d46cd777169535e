# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover doctor`: what is wrong with a machine that is to run a companion or a station, and what to do about it.

Nothing here changes anything, on the machine or on the autopilot: files are read, ports are taken for the blink of an
eye, and what is sent are questions. Nobody is asked anything while the vehicle is armed.
"""
