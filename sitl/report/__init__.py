# SPDX-License-Identifier: GPL-3.0-or-later

"""Reports of flights: journals and telemetry read and judged, pictures, the page."""
