# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover doctor`: checks a machine for a companion or a station, and advises what to do.

It changes nothing, on the machine or on the autopilot. Files are read, ports are opened for a moment, and only
questions are sent. No question is sent while the vehicle is armed.
"""
