# SPDX-License-Identifier: GPL-3.0-or-later

"""What a station's log says was lost: holes in each sender's numbers, as pymavlink counts them with our dialect."""

from __future__ import annotations

import struct
from pathlib import Path

from pymavlink import mavutil
from pymavlink.dialects.v20 import handover as mavlink

from sitl.report.loss import Heard, measure


def log(folder: Path, *frames: tuple[int, int]) -> Path:
    """A log of AUTHORITY_STATUS and HEARTBEAT in turn, from these components with these numbers."""
    path = folder / "station.tlog"
    with path.open("wb") as file:
        for place, (component, seq) in enumerate(frames):
            own = mavlink.MAVLink(None, srcSystem=1, srcComponent=component)
            own.seq = seq
            message = (
                mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3)
                if place % 2
                else mavlink.MAVLink_authority_status_message(1, 251, 0, 0, 1, 0, 1, 1, 0)
            )
            file.write(struct.pack(">Q", 1_800_000_000_000_000 + place) + bytes(message.pack(own)))
    return path


def test_a_whole_log_has_lost_nothing_our_own_messages_among_it(tmp_path: Path) -> None:
    dialect = mavutil.current_dialect
    assert measure(log(tmp_path, *((191, number & 0xFF) for number in range(300)))) == Heard(300, 0)
    assert mavutil.current_dialect == dialect, "this process keeps its own"


def test_holes_are_lost_frames_of_their_sender(tmp_path: Path) -> None:
    path = log(tmp_path, (1, 250), (1, 251), (191, 9), (191, 10), (1, 253), (1, 1), (191, 11), (191, 15))
    assert measure(path) == Heard(8, 1 + 3 + 3)


def test_who_lacks_a_message_counts_it_as_lost(tmp_path: Path) -> None:
    path = log(tmp_path, *((191, number) for number in range(9)))
    assert measure(path, "ardupilotmega") == Heard(4, 3), "heartbeats 1, 3, 5 and 7"
    assert measure(path) == Heard(9, 0)


def test_a_log_that_is_not_there_is_told_in_a_line(tmp_path: Path) -> None:
    path = tmp_path / "none.tlog"
    assert measure(path) == f"{path}: No such file or directory"


def test_what_is_no_frame_in_a_log_is_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "noise.tlog"
    path.write_bytes(bytes(range(256)) * 8)
    assert measure(path) == Heard(0, 0)
