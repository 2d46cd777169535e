# SPDX-License-Identifier: GPL-3.0-or-later

"""The bundles that the services of the companion work with."""
