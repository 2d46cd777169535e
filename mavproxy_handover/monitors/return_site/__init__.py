# SPDX-License-Identifier: GPL-3.0-or-later

"""The return site: the candidates, the value of each, the energy margin, and the choice."""
