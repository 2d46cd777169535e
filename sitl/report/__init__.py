# SPDX-License-Identifier: GPL-3.0-or-later

"""What was seen, and what comes of it: journals and telemetry read and judged, pictures, the page."""
