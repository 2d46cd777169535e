# SPDX-License-Identifier: GPL-3.0-or-later

"""Simulation: real processes on loopback, played through scenarios.

`vehicles/` starts what flies (ArduPilot's own SITL program, or the copter model that ships here); the rest of
the package wires a companion and stations to it, plays the scenario and writes the report. Nothing here runs on
an aircraft.
"""
