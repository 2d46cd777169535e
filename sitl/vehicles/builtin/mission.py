# SPDX-License-Identifier: GPL-3.0-or-later

"""The mission: stored items and the order in which they run.

Theory of operation (AP_Mission): item 0 is home and is never flown. One navigation command is active at a time. The
"do" and "condition" commands after it run beside it, one after the other, until the next navigation command. They are
dropped when the navigation command completes. Jumps are counted per jump item. The mission stops when AUTO is left and
resumes at the same navigation command; MIS_RESTART 1 makes it start over. Disarming resets it.

The class decides only the order; starting a command and judging it complete is the vehicle's (`start`, `verify`).
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum

from sitl.vehicles.builtin.items import Cmd, Item, command_name, is_nav

__all__ = ["MAX_ITEMS", "Mission", "MissionState"]

MAX_ITEMS = 650
_JUMP_FOREVER = -1
_MAX_LOOPS = 255


class MissionState(IntEnum):
    """MISSION_STATE values (2 to 5 of the enumeration; a mission that is absent is reported by the telemetry)."""

    STOPPED = 2
    RUNNING = 3
    COMPLETE = 5


class Mission:
    """Items and progress."""

    def __init__(
        self,
        start: Callable[[int, Item], bool],
        verify: Callable[[int, Item], bool],
        complete: Callable[[], None],
        say: Callable[[int, str], None],
    ) -> None:
        self._start_fn, self._verify_fn, self._complete_fn, self._say = start, verify, complete, say
        self.items: list[Item] = []
        self.home = Item(Cmd.WAYPOINT)
        self.state = MissionState.STOPPED
        self.changes = 0
        self.restart = False
        self._nav: int | None = None
        self._nav_loaded = False
        self._do: int | None = None
        self._do_loaded = False
        self._do_done = False
        self._jumps: dict[int, int] = {}

    # -- storage --------------------------------------------------------------------------------------------------

    def __len__(self) -> int:
        return len(self.items)

    @property
    def present(self) -> bool:
        """At least one item beside home, as AP_Mission::present asks."""
        return len(self.items) > 1

    def read(self, index: int) -> Item | None:
        """The item at `index`; 0 is always home."""
        if index == 0:
            return self.home
        return self.items[index] if index < len(self.items) else None

    def write(self, index: int, item: Item) -> bool:
        """Replace or append. Index 0 is accepted and ignored: home is not the station's to write."""
        if not self.items:
            self.items.append(self.home)
        if index == 0:
            return True
        self.changes += 1
        if index < len(self.items):
            self.items[index] = item
            return True
        if index != len(self.items) or index >= MAX_ITEMS:
            return False
        self.items.append(item)
        return True

    def keep_home(self) -> None:
        """Home was set: the list holds at least item 0."""
        if not self.items:
            self.items.append(self.home)

    def truncate(self, count: int) -> None:
        if len(self.items) > count:
            del self.items[count:]
            self.changes += 1

    def clear(self, armed: bool) -> bool:
        """Remove everything; refused while it runs in flight."""
        if armed and self.state is MissionState.RUNNING:
            return False
        self.truncate(0)
        self._nav = self._do = None
        self._nav_loaded = self._do_loaded = False
        self.state = MissionState.STOPPED
        return True

    # -- progress -------------------------------------------------------------------------------------------------

    @property
    def current(self) -> int:
        """Index of the active navigation command, 0 when there is none."""
        return self._nav or 0

    def reset(self) -> None:
        """Back to the beginning; the running state stays as it is."""
        self._nav = self._do = None
        self._nav_loaded = self._do_loaded = self._do_done = False
        self._jumps.clear()

    def start_or_resume(self) -> None:
        if self.restart:
            self.start()
        else:
            self.resume()

    def start(self) -> None:
        self.state = MissionState.RUNNING
        self.reset()
        if not self._advance():
            self._complete()

    def stop(self) -> None:
        self.state = MissionState.STOPPED

    def resume(self) -> None:
        if self.state is MissionState.COMPLETE:
            self.start()
            return
        if self.state is MissionState.STOPPED:
            self.state = MissionState.RUNNING
        if self._nav is None or self._nav >= len(self.items):
            self.start()
        elif self._do_loaded and self._do is not None:
            self.set_current(self._do)
        elif self._nav_loaded:
            self.set_current(self._nav)

    def starts_with_takeoff(self) -> bool:
        """Whether the next navigation command lifts off (delays before it do not count)."""
        index = 1 if self.restart or self._nav is None else self._nav
        for _ in range(16):
            found = self.next_nav(index)
            if found is None:
                return False
            command = self.items[found].command
            if command != Cmd.DELAY:
                return command == Cmd.TAKEOFF
            index = found + 1
        return False

    def set_current(self, index: int) -> bool:
        """Jump to `index`; 0 means the beginning. False: no such item, or nothing to fly from there."""
        if index >= len(self.items) or len(self.items) == 1:
            return False
        self._do, self._do_loaded, self._do_done = None, False, False
        self._nav_loaded = False
        if index == 0 or self.state is MissionState.COMPLETE:
            self._jumps.clear()
            index = max(index, 1)
        if self.state is MissionState.RUNNING:
            if not self._advance(index):
                self._complete()
                return False
            return True
        while not self._nav_loaded:
            found = self._next(index, count_jumps=True)
            if found is None:
                self._nav = None
                return False
            if is_nav(self.items[found].command):
                self._nav, self._nav_loaded = found, True
            elif not self._do_loaded:
                self._do, self._do_loaded = found, True
            index = found + 1
        self._do_done = not self._do_loaded
        self.state = MissionState.STOPPED
        return True

    def restart_current(self) -> bool:
        """Start the active navigation command again, because the mission changed under it."""
        if self.state is not MissionState.RUNNING or not self._nav_loaded or self._nav is None:
            return False
        return self.set_current(self._nav)

    def next_nav(self, index: int) -> int | None:
        """First navigation command at or after `index`, following jumps without counting them."""
        for _ in range(_MAX_LOOPS):
            found = self._next(index, count_jumps=False)
            if found is None:
                return None
            if is_nav(self.items[found].command):
                return found
            index = found + 1
        return None

    def update(self) -> None:
        """Judge the active commands and move on. Called many times a second in AUTO."""
        if self.state is not MissionState.RUNNING or not self.items:
            return
        if not self._nav_loaded or self._nav is None or self._nav >= len(self.items):
            if not self._advance():
                self._complete()
                return
        elif self._verify_fn(self._nav, self.items[self._nav]):
            self._nav_loaded = False
            if not self._advance():
                self._complete()
                return
        if not self._do_loaded:
            self._advance_do()
        elif self._do is not None and self._do < len(self.items) and self._verify_fn(self._do, self.items[self._do]):
            self._do_loaded = False

    # -- inside ---------------------------------------------------------------------------------------------------

    def _begin(self, index: int) -> bool:
        item = self.items[index]
        self._say(6, f"Mission: {index} {command_name(item.command)}")
        return self._start_fn(index, item)

    def _complete(self) -> None:
        self.state = MissionState.COMPLETE
        self._complete_fn()

    def _advance(self, start: int = 0) -> bool:
        if self.state is not MissionState.RUNNING or self._nav_loaded:
            return False
        self._do, self._do_loaded, self._do_done = None, False, False
        index = start if start > 0 else 1 if self._nav is None else self._nav + 1
        for _ in range(_MAX_LOOPS):
            found = self._next(index, count_jumps=True)
            if found is None:
                return False
            if is_nav(self.items[found].command):
                self._nav = found
                self._nav_loaded = self._begin(found)
            elif not self._do_loaded:
                self._do, self._do_loaded = found, True
                self._begin(found)
            if self._nav_loaded:
                self._do_done = not self._do_loaded
                return True
            index = found + 1
        return False

    def _advance_do(self) -> None:
        if self._do_done:
            return
        found = self._next((self._do or 0) + 1, count_jumps=False)
        if found is None or is_nav(self.items[found].command):
            self._do_done = True
            return
        self._do, self._do_loaded = found, True
        self._begin(found)

    def _next(self, index: int, count_jumps: bool) -> int | None:
        """First item at or after `index` that is not a jump."""
        first_jump: int | None = None
        for _ in range(_MAX_LOOPS):
            if index >= len(self.items):
                return None
            item = self.items[index]
            if item.command != Cmd.DO_JUMP:
                return index
            target, times = int(item.param1), int(item.param2)
            if not 0 < target < len(self.items) or (not count_jumps and first_jump == index):
                return None
            first_jump = index if first_jump is None else first_jump
            done = self._jumps.get(index, 0)
            if times == _JUMP_FOREVER or done < times:
                if count_jumps:
                    self._jumps[index] = done + 1
                    bound = "unlimited" if times == _JUMP_FOREVER else str(times)
                    self._say(6, f"Mission: {index} Jump {done + 1}/{bound}")
                index = target
            else:
                if count_jumps:
                    self._jumps[index] = 0
                index += 1
        return None
