# SPDX-License-Identifier: GPL-3.0-or-later

"""What is worked out from the vehicle's state: one folder or file for each question. No monitor imports another."""
