# SPDX-License-Identifier: GPL-3.0-or-later

"""The autopilot as the companion knows it: what it says of the aircraft, and what the companion has it do."""
