# SPDX-License-Identifier: GPL-3.0-or-later

"""Reads what the autopilot itself wrote: a dataflash log, `.bin` or as text `.log`.

Read by pymavlink's `DFReader`, which takes UTC from the GPS of the log; without one the times are seconds since the
autopilot was started. The guard's own record, `HNDO`, shows which station commanded: what the companion's leases said,
and what the guard did. That record remains when everything above the autopilot was lost.

A mode is a number, whose name depends on the vehicle. Its type (VER, or the firmware's name in MSG) may come after the
first mode, so the names are given at the end: ArduPlane's to its logs, ArduCopter's to all others.
"""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, Final

from pymavlink import DFReader, mavutil

from mavproxy_handover.core.common.model import GuardState, LeaseState
from sitl.report.journal_reader import Entry
from sitl.report.strand import CLOCK_SET_S, Kind, Stamps, Strand, Tick
from sitl.report.watch import AIRBORNE_M, SAMPLE_INTERVAL_S, VEHICLE

__all__ = ["DataflashError", "corrections_logged", "read_dataflash"]

#: records that come at an interval are a little early at times
_NEARLY: Final = 0.95
_BATTERY_S, _VIEW_S, _TICK_S = 1.0, 2.0, 5.0
_WANTED: Final = ["ARM", "BAT", "CMD", "CURR", "EV", "GPS", "HNDO", "MODE", "MSG", "PARM", "POS", "VER"]
_ARMED, _DISARMED, _LANDED, _NOT_LANDED = 10, 11, 18, 28
_SYSID: Final = ("MAV_SYSID", "SYSID_THISMAV")
#: how every record of a binary log begins
_BINARY: Final = b"\xa3\x95"
#: a GPS week that a receiver with a fix can report (2001)
_WEEK_SET: Final = 1095
_WAYPOINT, _LAST_NAV = 16, 94
#: VER's build type and MSG's beginning of a firmware's name
_BUILT_PLANE: Final = 3
_NAMED_PLANE: Final = "ArduPlane V"
#: without a word of arming: higher (m) it flies; lower (m) and slower (m/s) after that it has landed
_SURELY_UP_M, _SURELY_DOWN_M, _STANDS_MPS = 5.0, 1.0, 1.5


class DataflashError(Exception):
    """The file is no dataflash log. The message is one line."""


def read_dataflash(path: Path) -> Strand:
    """Read a dataflash log. Raises OSError, DataflashError; a log that was cut is read as far as it goes."""
    with path.open("rb") as file:
        head = file.read(len(_BINARY))
    if path.suffix.lower() == ".bin" and head != _BINARY:
        raise DataflashError(f"{path}: no dataflash log: it does not begin like one")
    with _complaints() as complaints:
        strand = _read(path)
    strand.broken += sum(complaints)
    return strand


def corrections_logged(folder: Path) -> list[float] | None:
    """When RTK corrections came, by the newest log in a folder (s since the autopilot was started). None: no log.

    ArduPilot logs them (RTCM) if bit 6 of GPS_DRV_OPTIONS is set. Raises OSError, DataflashError.
    """
    logs = sorted(folder.glob("*.BIN"))
    if not logs:
        return None
    with _complaints():
        log = _opened(logs[-1])
        try:
            records = iter(lambda: log.recv_match(type=["RTCM"]), None)
            return [_boot_s(record, 0.0) for record in records]
        except Exception as error:  # pymavlink raises whatever it stumbles over
            raise DataflashError(f"{logs[-1]}: cannot be read: {error or type(error).__name__}") from None
        finally:
            _close(log)


def _opened(path: Path) -> Any:
    kind = DFReader.DFReader_binary if path.suffix.lower() == ".bin" else DFReader.DFReader_text
    try:
        return kind(str(path), zero_time_base=False)
    except Exception as error:  # pymavlink raises whatever it stumbles over
        raise DataflashError(f"{path}: no dataflash log: {error or type(error).__name__}") from None


def _close(log: Any) -> None:
    close = getattr(log, "close", None)
    if close is not None:
        close()


@contextmanager
def _complaints() -> Iterator[list[int]]:
    """Counts the lines that pymavlink writes to its outputs, one for each place that it cannot read. Part of it is
    written in C, so the output's descriptor itself is turned away for that time."""
    counts: list[int] = []
    sys.stderr.flush()
    with TemporaryFile() as noise, redirect_stderr(StringIO()) as words, redirect_stdout(words):
        own = os.dup(2)
        os.dup2(noise.fileno(), 2)
        try:
            yield counts
        finally:
            os.dup2(own, 2)
            os.close(own)
            noise.seek(0)
            counts.append(noise.read().count(b"\n") + words.getvalue().count("\n"))


def _read(path: Path) -> Strand:
    log = _opened(path)
    reader = _Reader(path, has_pos="POS" in log.name_to_id)
    try:
        while (message := log.recv_match(type=_WANTED)) is not None:
            try:
                reader.on_message(message)
            except (AttributeError, TypeError, ValueError, OverflowError):  # a field is missing, or is no number
                reader.strand.broken += 1
    except Exception:  # pymavlink again, in a log whose end was never written
        reader.strand.broken += 1
    finally:
        _close(log)
    return reader.finish()


class _Reader:
    def __init__(self, path: Path, *, has_pos: bool) -> None:
        self.strand = Strand(path, Kind.DATAFLASH, on_board=True)
        self._sysid = 1
        self._seen: list[Entry] = []
        self._told: list[Entry] = []
        self._stamps = Stamps()
        self._first_t: float | None = None
        self._clock_set = False
        self._armed = self._airborne = False
        #: some record said that the motors were armed or disarmed
        self._tells_arming = False
        #: the log has records of the estimated position; else those of the GPS are all there is
        self._has_pos = has_pos
        self._due: dict[str, float] = {}
        self._view: tuple[Any, ...] = ()
        self._guard = ""
        self._modes: list[tuple[float, int]] = []
        self._plane = False
        self._ground_alt_m: float | None = None
        self._speed_mps = self._course_deg = 0.0

    def on_message(self, message: Any) -> None:
        """Take in one record."""
        handler = getattr(self, "_on_" + message.get_type().lower(), None)
        t = float(getattr(message, "_timestamp", 0.0))
        if not self._stamps.believed(t):
            self.strand.broken += 1
            return
        if self._first_t is None:
            self._first_t = t
        if handler is not None:
            handler(message, t)

    def finish(self) -> Strand:
        """The strand of the whole log."""
        strand = self.strand
        if not self._tells_arming:
            self._fly_by_height()
        names = mavutil.mode_mapping_apm if self._plane else mavutil.mode_mapping_acm
        for t, number in self._modes:
            mode = names.get(number, f"mode {number}")
            self._note(t, "mode", f"mode {mode}", mode=mode)
        order = lambda entry: entry.t  # noqa: E731
        if not (self._seen or self._told):
            raise DataflashError(f"{strand.path}: a dataflash log in which nothing is told")
        strand.seen[self._sysid] = sorted(self._seen, key=order)
        strand.told[self._sysid] = sorted(self._told, key=order)
        strand.ticks = [
            Tick(tick.t, self._sysid, tick.boot_s, tick.t if self._clock_set else None) for tick in strand.ticks
        ]
        route = strand.items.pop(0, {})
        if route:
            strand.items[self._sysid] = route
        return strand

    def _note(self, t: float, event: str, text: str = "", **values: Any) -> None:
        self._seen.append(Entry(t, VEHICLE, event, text, values))

    def _is_due(self, t: float, what: str, interval_s: float) -> bool:
        if t < self._due.get(what, float("-inf")):
            return False
        self._due[what] = t + _NEARLY * interval_s
        return True

    def _on_parm(self, message: Any, t: float) -> None:
        if message.Name in _SYSID and 0 < message.Value < 256:
            self._sysid = int(message.Value)

    def _on_gps(self, message: Any, t: float) -> None:
        if max(getattr(message, "GWk", 0), getattr(message, "Week", 0)) > _WEEK_SET and t > CLOCK_SET_S:
            self._clock_set = True
        self._speed_mps, self._course_deg = float(message.Spd), float(message.GCrs)
        if self._is_due(t, "tick", _TICK_S):
            self.strand.ticks.append(Tick(t, 0, _boot_s(message, t)))
        if not self._has_pos:
            self._place(message, t, getattr(message, "RelAlt", None))

    def _on_pos(self, message: Any, t: float) -> None:
        self._place(message, t, getattr(message, "RelHomeAlt", None))

    def _place(self, message: Any, t: float, alt_m: float | None) -> None:
        """A position. `alt_m`: above home; None or NaN: above where the log began."""
        if alt_m is None or math.isnan(alt_m):
            self._ground_alt_m = float(message.Alt) if self._ground_alt_m is None else self._ground_alt_m
            alt_m = message.Alt - self._ground_alt_m
        if self._armed and not self._airborne and alt_m > AIRBORNE_M:
            self._take_off(t)
        if not self._is_due(t, "sample", SAMPLE_INTERVAL_S) or not (message.Lat or message.Lng):
            return
        self._note(
            t, "sample", sim_s=_boot_s(message, t), lat_deg=message.Lat, lon_deg=message.Lng,
            alt_m=round(alt_m, 2), heading_deg=round(self._course_deg, 1), speed_mps=round(self._speed_mps, 2),
        )  # fmt: skip

    def _fly_by_height(self) -> None:
        """Firmware before 3.2 does not log arming: what is higher than a GPS errs is taken for flying."""
        for entry in [each for each in self._seen if each.event == "sample"]:
            if not self._airborne and entry.get("alt_m") > _SURELY_UP_M:
                self._take_off(entry.t)
            elif self._airborne and entry.get("alt_m") < _SURELY_DOWN_M and entry.get("speed_mps") < _STANDS_MPS:
                self._airborne = False
                place = {key: entry.get(key) for key in ("lat_deg", "lon_deg")}
                self._note(entry.t, "landed", "landed", by_height=True, **place)

    def _on_mode(self, message: Any, t: float) -> None:
        self._modes.append((t, int(getattr(message, "ModeNum", message.Mode))))

    def _on_ev(self, message: Any, t: float) -> None:
        if message.Id == _ARMED:
            self._arm(t, True)
        elif message.Id == _DISARMED:
            self._arm(t, False)
        elif message.Id == _LANDED:
            self._land(t)
        elif message.Id == _NOT_LANDED:
            self._arm(self._first_t if self._first_t is not None else t, True)  # it was armed before the log began
            self._take_off(t)

    def _on_arm(self, message: Any, t: float) -> None:
        self._arm(t, bool(message.ArmState))

    def _arm(self, t: float, armed: bool) -> None:
        self._tells_arming = True
        if armed == self._armed:
            return
        if not armed:
            self._land(t)
        self._armed = armed
        word = "armed" if armed else "disarmed"
        self._note(t, word, word)

    def _take_off(self, t: float) -> None:
        if not self._airborne:
            self._airborne = True
            self._note(t, "airborne", "airborne")

    def _land(self, t: float) -> None:
        if not self._airborne:
            return
        self._airborne = False
        where = next((entry for entry in reversed(self._seen) if entry.event == "sample"), None)
        place = {} if where is None else {key: where.get(key) for key in ("lat_deg", "lon_deg")}
        self._note(t, "landed", "landed", **place)

    def _on_msg(self, message: Any, t: float) -> None:
        text = str(message.Message)
        self._plane = self._plane or _NAMED_PLANE in text
        self._note(t, "said", text, severity=6)

    def _on_bat(self, message: Any, t: float) -> None:
        if getattr(message, "Inst", getattr(message, "Instance", 0)) == 0 and self._is_due(t, "battery", _BATTERY_S):
            values: dict[str, Any] = {"volts": round(float(message.Volt), 2)}
            if hasattr(message, "RemPct"):
                values["percent"] = message.RemPct
            self._seen.append(Entry(t, VEHICLE, "battery", "", values))

    def _on_cmd(self, message: Any, t: float) -> None:
        navigates = _WAYPOINT <= message.CId <= _LAST_NAV
        if message.CNum and navigates and (message.Lat or message.Lng):
            self.strand.items.setdefault(0, {})[message.CNum] = (message.Lat, message.Lng)

    def _on_ver(self, message: Any, t: float) -> None:
        self._plane = self._plane or getattr(message, "BU", 0) == _BUILT_PLANE
        firmware = f"{message.Maj}.{message.Min}.{message.Pat}"
        self._note(t, "firmware", f"firmware {firmware}", version=firmware)

    def _on_hndo(self, message: Any, t: float) -> None:
        """The guard's own record: what it was told, and its state."""
        told = (message.Cmd, message.Ep, message.LSt)
        if told != self._view or self._is_due(t, "view", _VIEW_S):
            self._view = told
            self._due["view"] = t + _VIEW_S
            values = {"commander": message.Cmd, "epoch": message.Ep, "lease": _word(LeaseState, message.LSt)}
            self._told.append(Entry(t, "", "view", "", values))
        guard = _word(GuardState, message.St)
        if guard != self._guard:
            self._told.append(Entry(t, "", "guard", f"guard: {self._guard or 'silent'} -> {guard}", {}))
            self._guard = guard


def _word(states: Any, value: int) -> str:
    try:
        return str(states(value).name).lower()
    except ValueError:
        return str(value)


def _boot_s(message: Any, t: float) -> float:
    """Seconds since the autopilot was started. Firmware before 3.3 has milliseconds, in T of GPS; else it is `t`."""
    if hasattr(message, "TimeUS"):
        return float(message.TimeUS) / 1e6
    return float(getattr(message, "T", t * 1e3)) / 1e3
