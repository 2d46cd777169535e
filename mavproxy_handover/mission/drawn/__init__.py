# SPDX-License-Identifier: GPL-3.0-or-later

"""Zones as people draw them: GeoJSON without our properties, KML, KMZ, and the geofence of a plan.

`handover init mission` reads them and makes the zones of a mission package. Nothing here runs in flight.
"""
