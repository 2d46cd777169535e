# SPDX-License-Identifier: GPL-3.0-or-later

"""What is to be done about a finding: values that are right for the aircraft."""

from __future__ import annotations

import pytest

from mavproxy_handover.doctor.advice import advice
from mavproxy_handover.vehicle.profiles import COPTER, PLANE, Profile


@pytest.mark.parametrize(
    ("parameter", "profile", "says"),
    [
        ("BATT_FS_LOW_ACT", COPTER, "Set BATT_FS_LOW_ACT to 2; handover.parm and"),
        ("BATT_FS_LOW_ACT", PLANE, "Set BATT_FS_LOW_ACT to 1; handover_plane.parm and"),
        ("BATT_FS_LOW_ACT", None, "Set BATT_FS_LOW_ACT to 2, with wings to 1; handover.parm and handover_plane.parm"),
        ("BATT2_FS_CRT_ACT", PLANE, "Set BATT2_FS_CRT_ACT to 2; handover_plane.parm and"),
        ("BATT2_FS_CRT_ACT", COPTER, "Set BATT2_FS_CRT_ACT to 1; handover.parm and"),
        ("Q_RTL_MODE", None, "Set Q_RTL_MODE to 1; handover_plane.parm and"),
        ("FS_OPTIONS", None, "Set FS_OPTIONS to 8; handover.parm and"),
        ("HNDO_LOST_T", PLANE, "Set HNDO_LOST_T to 3; handover_guard.md"),
        ("NOBODY_KNOWS", None, "Change NOBODY_KNOWS; "),
    ],
)
def test_the_value_is_the_aircrafts(parameter: str, profile: Profile | None, says: str) -> None:
    assert advice(parameter, "is odd", profile=profile).startswith(says)
