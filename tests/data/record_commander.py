# SPDX-License-Identifier: GPL-3.0-or-later

"""Records `commander.tlog`: a stock MAVProxy that flies an ArduCopter by all the means it has, no gate between.

    python tests/data/record_commander.py FOLDER

Needs an ArduCopter SITL program and takes about two minutes. What the station sent is kept, as MAVProxy logged it
(64-bit microseconds, big-endian, then the frame); what the vehicle sent is left out. A test judges this log as if an
observer had sent it, so it matters that it is what a real program sends, and that it is of many kinds.
"""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

from mavproxy_handover.wire.frames import FrameSplitter
from sitl.vehicles import VehicleSpec, launch

STATION = 251
HOME = (52.679, 5.924, 2.0, 0.0)
TARGET = Path(__file__).with_name("commander.tlog")

#: Seconds to wait after a line, and the line.
SESSION: tuple[tuple[float, str], ...] = (
    (20, "version"),
    (1, "ftp list /"),
    (1, "ftp put guided.txt x.txt"),
    (1, "ftp crc x.txt"),
    (1, "ftp get x.txt"),
    (1, "ftp rename x.txt y.txt"),
    (1, "ftp mkdir folder"),
    (1, "ftp rmdir folder"),
    (1, "ftp rm y.txt"),
    (2, "param set WPNAV_SPEED 600"),
    (1, "param set FS_GCS_ENABLE 1"),
    (1, "param fetch RTL_ALT"),
    (2, "param ftpload some.parm"),
    (4, "wp load route.waypoints"),
    (2, "wp list"),
    (2, "wp set 2"),
    (3, "fence load fence.waypoints"),
    (2, "fence list"),
    (1, "fence enable"),
    (1, "fence disable"),
    (3, "rally load rally.waypoints"),
    (2, "rally list"),
    (2, "log list"),
    (3, "log download 1 log.bin"),
    (1, "log cancel"),
    (1, "messagerate set VIBRATION 2"),
    (1, "messagerate get VIBRATION"),
    (1, "devop read spi baro 0 0 0 1"),
    (1, "relay set 0 1"),
    (1, "servo set 9 1500"),
    (1, "gethome"),
    (1, "message PLAY_TUNE 1 1 b'MFT200L16'"),
    (1, "message LED_CONTROL 1 1 0 1 0 [0]*24"),
    (1, "message SET_GPS_GLOBAL_ORIGIN 1 526790000 59240000 0"),
    (1, "message PARAM_EXT_SET 1 100 b'CAM_MODE' b'1' 1"),
    (1, "message STATUSTEXT 6 b'word'"),
    (1, "message SYSTEM_TIME 1760000000000000 1000"),
    (1, "message GPS_RTCM_DATA 0 4 [1]*180"),
    (1, "message SERIAL_CONTROL 10 2 0 0 3 [10]*70"),
    (1, "message TUNNEL 1 1 200 3 [1]*128"),
    (4, "mode guided"),
    (3, "arm throttle"),
    (8, "takeoff 20"),
    (1, "position 10 0 0"),
    (1, "velocity 2 0 0"),
    (1, "velocity 2 0 0"),
    (1, "attitude 1 0 0 0 0.5"),
    (1, "setyaw 90 20 0"),
    (2, "guided 52.6795 5.9245 20"),
    (1, "setspeed 4"),
    (1, "message SET_POSITION_TARGET_GLOBAL_INT 0 1 1 6 3527 0 0 0 1 0 0 0 0 0 0 0"),
    (1, "message MANUAL_CONTROL 1 100 0 500 0 0"),
    (1, "message COMMAND_INT 1 1 6 192 0 0 -1 1 0 0 526795000 59245000 20"),
    (1, "rc 3 1500"),
    (1, "rc all 0"),
    (5, "mode auto"),
    (1, "pause"),
    (1, "resume"),
    (1, "wp set 3"),
    (1, "long 218 9 0"),
    (3, "mode loiter"),
    (2, "param set RTL_ALT 2500"),
    (2, "wp clear"),
    (1, "fence clear"),
    (1, "rally clear"),
    (15, "mode land"),
    (2, "disarm force"),
    (1, "motortest 1 0 1 1"),
    (1, "long 42701 1"),
    (1, "long PREFLIGHT_STORAGE 0"),
    (1, "log erase"),
    (2, "signing setup passphrase"),
    (3, "long 410"),
)

_LINES = {
    "guided.txt": "hello\n",
    "some.parm": "WPNAV_SPEED 700\nRTL_ALT 1600\n",
    "route.waypoints": "QGC WPL 110\n"
    "0 1 0 16 0 0 0 0 52.679 5.924 2 1\n"
    "1 0 3 22 0 0 0 0 52.679 5.924 20 1\n"
    "2 0 3 16 0 0 0 0 52.6800 5.924 20 1\n"
    "3 0 3 16 0 0 0 0 52.6805 5.925 20 1\n",
    "fence.waypoints": "QGC WPL 110\n"
    "0 0 3 5001 3 0 0 0 52.670 5.920 0 1\n"
    "1 0 3 5001 3 0 0 0 52.690 5.920 0 1\n"
    "2 0 3 5001 3 0 0 0 52.680 5.940 0 1\n",
    "rally.waypoints": "QGC WPL 110\n0 0 3 5100 0 0 0 0 52.6795 5.9245 15 1\n",
}


def main(folder: Path) -> None:
    """Fly the session in `folder` and write the log beside this file."""
    for name, text in _LINES.items():
        (folder / name).write_text(text, encoding="utf-8")
    parameters = {"MAV_GCS_SYSID": float(STATION), "LOG_DISARMED": 1.0}
    vehicle = launch("arducopter", VehicleSpec(home=HOME, speedup=1, parameters=parameters), folder / "vehicle")
    modules = "link,signing,param,wp,fence,rally,mode,arm,cmdlong,misc,rc,relay,ftp,log,calibration"
    program = [
        *(str(Path(sys.executable).with_name("mavproxy.py")), f"--master={vehicle.companion_master}"),
        *(f"--source-system={STATION}", "--source-component=190", "--nowait", "--streamrate=4"),
        f"--default-modules={modules},message,messagerate,devop,timesync",
        *(f"--state-basedir={folder}", "--logfile=station.tlog"),
    ]
    station = subprocess.Popen(program, cwd=folder, stdin=subprocess.PIPE, text=True)
    try:
        assert station.stdin is not None
        for wait_s, line in SESSION:
            station.stdin.write(line + "\n")
            station.stdin.flush()
            time.sleep(wait_s)
    finally:
        station.kill()  # it asks before it exits; its log is written as it goes
        station.wait()
        vehicle.stop()
    TARGET.write_bytes(sent_by_station((folder / "station.tlog").read_bytes()))
    print(f"{TARGET}: {TARGET.stat().st_size} bytes")


def sent_by_station(log: bytes) -> bytes:
    """The records of a tlog that hold a frame of the station."""
    kept, position = [], 0
    while position + 8 < len(log):
        (frame, *_) = FrameSplitter().feed(log[position + 8 : position + 8 + 300]) or [None]
        if frame is None or not log.startswith(frame.raw, position + 8):
            position += 1
            continue
        end = position + 8 + len(frame.raw)
        if frame.sysid == STATION:
            kept.append(log[position:end])
        position = end
    return b"".join(kept)


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
