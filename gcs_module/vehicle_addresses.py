# SPDX-License-Identifier: GPL-3.0-or-later

"""The vehicle's addresses that a station receives with a mission, and what is done with them.

Another station, or the vehicle, sends them (`MISSION_PACKAGE.addresses`). They are claims only. Rules that live here:

1. Only the operator opens a link to such an address, by the number of the question that was shown. A replaced question
   cannot be answered any more. No two vehicles of a station use the same number.
2. The station's own links have priority. If it has any, nothing is asked; addresses that differ from them are shown.
3. An address must be one that a vehicle can have (`wire/vehicle_address.py`). It must not be this computer's own unless
   the configuration allows that, and never a port of this program. One bad address spoils the others of its message.
4. While the vehicle is armed, nothing is asked and nothing changes. Addresses that arrive then are judged after it has
   disarmed. A vehicle that was not heard for SILENT_S does not count as armed: its link is of no use, and any program
   may have sent the last heartbeat.
5. Of each sender the newest addresses count. They end its older question, also if they are refused. A line about them
   is shown at most every QUIET_S, then twice as seldom each time. Addresses are judged only when a line is due, or the
   operator asks, so a flood of them costs nothing else.
6. Addresses that the operator has confirmed are saved in a file of the station, and opened again after a restart, until
   the operator withdraws them. The file is written and read beside the main loop, and checked as strictly as a message.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import count
from math import inf
from pathlib import Path
from typing import Final, Protocol

from mavproxy_handover.store.confirmed_address import ConfirmedAddress, keep_address, kept_address
from mavproxy_handover.tools.worker import Worker
from mavproxy_handover.wire.vehicle_address import (
    MAX_OF_STATION,
    VehicleAddress,
    on_this_computer,
    plain_text,
    unpack_addresses,
    why_unusable,
)

__all__ = ["LOCAL_KEY", "OFFER_KEY", "QUIET_S", "SILENT_S", "VehicleAddresses"]

#: keys of [station]
OFFER_KEY: Final = "offered_addresses"
LOCAL_KEY: Final = "offered_addresses_local"
#: a vehicle that was not heard for this long (s) does not count as armed
SILENT_S: Final = 60.0
#: time (s) between two lines about one sender's addresses, first and longest
QUIET_S: Final = 30.0
_QUIET_MOST_S: Final = 600.0
#: time (s) between two attempts to open a link
_AGAIN_S: Final = 10.0
#: how long (s) the end of the program may wait for the disk
_END_S: Final = 2.0
#: this many numbers of earlier questions are remembered
_ASKED: Final = 100

Listed = tuple[VehicleAddress, ...]


class LinkOpener(Protocol):
    """MAVProxy's links of the vehicle: `vehicle_links.py`."""

    def own(self) -> tuple[str, ...]:
        """The links of the station's own configuration."""

    def is_open(self, address: VehicleAddress) -> bool:
        """Whether a link to this address was opened."""

    def is_removed(self, address: VehicleAddress) -> bool:
        """Whether the operator has removed a link that was opened."""

    def leads_back(self, address: VehicleAddress) -> bool:
        """Whether the address is one of this computer's."""

    def is_ours(self, address: VehicleAddress) -> bool:
        """Whether a link of this program listens at the address."""

    def open(self, address: VehicleAddress) -> str:
        """Open a link; returns why that failed, or ""."""

    def close(self) -> str:
        """Close all opened links; returns why one is still open, or ""."""


@dataclass(frozen=True, slots=True)
class _Question:
    number: int
    addresses: Listed
    mission: str
    #: the operator has refused: it is listed, and not asked any more
    refused: bool = False


class _Sender:
    """One sender's addresses, and when the next line about them may be shown."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.raw = b""
        self.mission = ""
        #: the addresses that were judged last
        self.seen: bytes | None = None
        self.question: _Question | None = None
        self.due_at = -inf
        self.quiet_s = QUIET_S

    @property
    def says(self) -> str:
        """The beginning of a line about its addresses."""
        return f"{self.name} sends the vehicle's address" if self.name else "The vehicle sends its address"

    @property
    def operator(self) -> str:
        """The person who can say whether the addresses are right."""
        return f"the operator of {self.name}" if self.name else "the operator of the parent station"

    @property
    def called(self) -> str:
        """Its name in lists."""
        return self.name or "the vehicle"

    def answered(self) -> None:
        """The operator has answered or asked: the next addresses are shown at once."""
        self.due_at, self.quiet_s = -inf, QUIET_S


class VehicleAddresses:
    """Of one vehicle at one station. Times are monotonic seconds; `utc` is for people.

    `station`: this station's system id; `ask`: False refuses every address; `local`: this computer's own addresses are
    allowed; `keyed`: a key proves the vehicle's frames; `file`: where confirmed addresses are saved; `numbers`: numbers
    of questions, shared by all vehicles of the station.
    """

    def __init__(
        self,
        opener: LinkOpener,
        station: int,
        file: Path,
        *,
        ask: bool,
        local: bool,
        keyed: bool,
        numbers: Iterator[int] | None = None,
        utc: Callable[[], float] = time.time,
    ) -> None:
        self._opener = opener
        self._station = station
        self._file = file
        self._ask = ask
        self._local = local
        self._keyed = keyed
        self._utc = utc
        self._senders: dict[int, _Sender] = {}
        self._numbers = count(1) if numbers is None else numbers
        self._asked: deque[int] = deque(maxlen=_ASKED)
        self._confirmed: ConfirmedAddress | None = None
        #: reads and writes the file
        self._file_worker = Worker()
        self._read = self._reading = self._unwritten = False
        self._try_at = -inf
        #: time of the last tick
        self._now = 0.0
        #: addresses whose failure was shown
        self._failed: set[VehicleAddress] = set()
        self._lines: list[str] = []

    # ---- in -------------------------------------------------------------------------------------------------------

    def offered(self, sender: int, name: str, mission: str, raw: bytes) -> None:
        """The addresses of a MISSION_PACKAGE. `sender` must be a station of the configuration, or the vehicle, whose
        `name` is ""."""
        known = self._senders.get(sender)
        if known is None:
            known = self._senders[sender] = _Sender(name)
        known.raw, known.mission = raw, plain_text(mission)

    def tick(self, now: float, armed: bool) -> list[str]:
        """Time has passed; returns lines for the operator. `armed`: the vehicle is heard and not known to be disarmed
        (rule 4). To be called often."""
        self._now = now
        self._file_worker.tick(now)
        self._keep()
        if self._read and not armed:
            for sender in self._senders.values():
                if sender.raw != sender.seen and now >= sender.due_at:
                    self._judge_newest(sender, now)
        if self._read:
            self._open_next(now)
        lines, self._lines = self._lines, []
        return lines

    def _judge_newest(self, sender: _Sender, now: float) -> None:
        sender.seen = sender.raw
        line = self._line_about(sender)
        if line:
            self._lines.append(line)
            if now - sender.due_at > _QUIET_MOST_S:
                sender.quiet_s = QUIET_S
            sender.due_at = now + sender.quiet_s
            sender.quiet_s = min(2 * sender.quiet_s, _QUIET_MOST_S)

    def _line_about(self, sender: _Sender) -> str:
        """A line about a sender's addresses, "" if there is nothing to say. Opens a question, and ends an older one."""
        addresses = unpack_addresses(sender.raw).get(self._station, ())
        before = sender.question
        ended = ""
        if before is not None and before.addresses != addresses:
            sender.question = None
            ended = "" if before.refused else f"Question {before.number} does not count any more"
        line = self._not_asked(sender, addresses)
        if line is None:
            return "" if sender.question is not None else self._question(sender, addresses, ended)
        if not ended:
            return line
        return f"{line} {ended}." if line else f"{ended}: what {sender.called} sends now needs no answer."

    def _not_asked(self, sender: _Sender, addresses: Listed) -> str | None:
        """A line about addresses that need no question; None: the operator is to be asked.

        "" if there is nothing to say.
        """
        own = self._opener.own()
        if not addresses:
            return self._without(sender) if not own and self._confirmed is None else ""
        if self._confirmed is not None and self._confirmed.addresses == addresses:
            return ""
        from_sender = f"{sender.says} {_shown(addresses)}"
        if own:
            if all(_mavproxy_name(address) in own for address in addresses):
                return ""
            return f"{from_sender}. This station keeps its own link: {', '.join(own)}."
        wrong = self._wrong(addresses)
        if wrong:
            return f"{from_sender}. Refused: {wrong}. Ask {sender.operator} for another one."
        if not self._ask:
            return f'{from_sender}. Refused: this station\'s configuration has {OFFER_KEY} = "refuse".'
        return None

    def _question(self, sender: _Sender, addresses: Listed, ended: str) -> str:
        number = self._next_number()
        sender.question = _Question(number, addresses, sender.mission)
        now_used = (
            "This station has no link to the vehicle."
            if self._confirmed is None
            else f"This station uses {self._confirmed.text}, from {self._confirmed.sender}."
        )
        open_way = "" if self._keyed else " Without a key any program there can pose as the vehicle."
        replaces = f" {ended}." if ended else ""
        return (
            f"{sender.says} {_shown(addresses)}. {now_used}{open_way}{replaces} Check the address with "
            f"{sender.operator}. Then type 'handover connect {number}', or 'handover connect no'."
        )

    def _next_number(self) -> int:
        self._asked.append(next(self._numbers))
        return self._asked[-1]

    @staticmethod
    def _without(sender: _Sender) -> str:
        return (
            f"{sender.called} sends mission {sender.mission!r} without the vehicle's address for this station. This "
            f"station has no link to the vehicle: restart it with --master, or ask for addresses.toml in the mission."
        )

    def _wrong(self, addresses: Listed) -> str:
        """Why these addresses are refused, "" if they are not."""
        if len(addresses) > MAX_OF_STATION:
            return f"{len(addresses)} addresses, allowed are {MAX_OF_STATION}"
        for address in addresses:
            why = why_unusable(address)
            if not why and (on_this_computer(address) or self._opener.leads_back(address)):
                if not self._local:
                    why = f"{address.host} is this computer itself ({LOCAL_KEY} = true allows it)"
                elif self._opener.is_ours(address):
                    why = f"this station itself listens at port {address.port}"
            if why:
                return why
        return ""

    # ---- the operator ---------------------------------------------------------------------------------------------

    def connect(self, word: str, armed: bool) -> str:
        """The operator's `handover connect WORD`: a number opens, "no" refuses. Returns a line."""
        if word == "no":
            return self._refuse_all()
        found = [
            (sender, sender.question)
            for sender in self._senders.values()
            if sender.question is not None and str(sender.question.number) == word
        ]
        if not found:
            number = int(word) if word.isascii() and word.isdecimal() and len(word) < 9 else 0
            problem = f"Question {word} does not count any more" if number in self._asked else f"No question {word}"
            return f"{problem}. 'handover connect' lists the addresses that other stations sent."
        ((sender, question),) = found
        if armed:
            return _not_while_armed(f"handover connect {word}")
        own = self._opener.own()
        if own:
            return f"This station keeps its own link: {', '.join(own)}."
        wrong = self._wrong(question.addresses)
        if wrong:
            return f"Refused: {wrong}."
        why = self._opener.close()
        if why:
            return f"The link in use cannot be closed: {why}. Nothing was changed."
        sender.question = None
        sender.answered()
        at = time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime(self._utc()))
        self._confirmed = ConfirmedAddress(question.addresses, sender.called, question.mission, at)
        self._unwritten, self._try_at = True, -inf
        self._failed.clear()
        self._keep()
        return f"Connecting to the vehicle at {_shown(question.addresses)}, the address from {sender.called}."

    def _refuse_all(self) -> str:
        refused = []
        for sender in self._senders.values():
            question = sender.question
            if question is not None and not question.refused:
                sender.question = _Question(question.number, question.addresses, question.mission, refused=True)
                sender.answered()
                refused.append(f"{_shown(question.addresses)} from {sender.called}")
        return f"Refused: {'; '.join(refused)}." if refused else "No address waits for an answer."

    def disconnect(self, armed: bool) -> str:
        """The operator's `handover disconnect`: withdraw the confirmed address. Returns a line."""
        confirmed = self._confirmed
        if not self._read:
            return "The file of the address that was confirmed is still being read. Type 'handover disconnect' again."
        if confirmed is None:
            return "This station uses no address of the vehicle that another station sent."
        if armed:
            return _not_while_armed("handover disconnect")
        why = self._opener.close()
        self._confirmed, self._unwritten = None, True
        self._keep()  # at once, because the operator may end the program next
        for sender in self._senders.values():  # so that the operator can choose it again by its number
            if sender.called == confirmed.sender and sender.question is None:
                sender.question = _Question(self._next_number(), confirmed.addresses, confirmed.mission, refused=True)
        if why:
            still = f"Its link is still open: {why}. End this station to close it."
            return f"The address {confirmed.text} is forgotten. {still}"
        return f"The link to the vehicle at {confirmed.text} is closed, and its address is forgotten."

    def asked_for(self) -> None:
        """The operator asks for the addresses: waiting ones are shown at once, and not after QUIET_S."""
        for sender in self._senders.values():
            sender.answered()

    def status(self) -> Iterator[str]:
        """The lines about addresses in the station's status."""
        confirmed = self._confirmed
        if confirmed is not None:
            origin = f"from {confirmed.sender} with mission {confirmed.mission!r}, confirmed {confirmed.at}"
            removed = [self._opener.is_removed(address) for address in confirmed.addresses]
            open_now = [
                self._opener.is_open(address) and not gone
                for address, gone in zip(confirmed.addresses, removed, strict=True)
            ]
            if all(removed):
                state = "not in use: its link was removed"
            elif any(open_now):
                state = "in use" if all(open_now) else "in use in part"
            else:
                state = "not used: this station has its own link" if self._opener.own() else "not open yet"
            yield f"{confirmed.text} {origin}; {state} ('handover disconnect' withdraws it)"
        for sender in self._senders.values():
            question = sender.question
            if question is not None:
                said = "refused; " if question.refused else ""
                yield (
                    f"{_shown(question.addresses)} from {sender.called} with mission {question.mission!r}: {said}"
                    f"'handover connect {question.number}' opens it"
                )
            if sender.raw != sender.seen and any(sender.raw):
                shows = "'handover connect' shows them when the vehicle is disarmed or silent"
                yield f"{sender.called} sends addresses: {shows}"

    # ---- what was confirmed ---------------------------------------------------------------------------------------

    def release(self) -> None:
        """Close the opened links; confirmed addresses stay in their file.

        The operator's last choice is written first. A disk that does not accept it delays this by _END_S.
        """
        self._opener.close()
        until = time.monotonic() + _END_S
        while self._read and (self._file_worker.busy or self._unwritten) and time.monotonic() < until:
            self._file_worker.tick(self._now)
            self._keep()
            time.sleep(0.01)

    def _open_next(self, now: float) -> None:
        """Open the confirmed addresses that are not open yet."""
        confirmed = self._confirmed
        if confirmed is None or now < self._try_at or self._opener.own():
            return
        self._try_at = now + _AGAIN_S
        for address in confirmed.addresses:
            if not self._opener.is_open(address):
                self._tell_opened(address, self._opener.open(address))

    def _tell_opened(self, address: VehicleAddress, why: str) -> None:
        if not why:
            self._failed.discard(address)
            self._lines.append(f"Link to the vehicle opened: {address.text}.")
        elif address not in self._failed:
            self._failed.add(address)
            self._lines.append(f"No link to the vehicle at {address.text}: {why}. It is tried again.")

    def _keep(self) -> None:
        """Read what the run before has saved, then write changes."""
        if self._file_worker.busy:
            return
        if not self._read and not self._reading:
            self._reading = self._file_worker.submit(lambda: kept_address(self._file), self._was_read)
        elif self._read and self._unwritten:
            confirmed = self._confirmed
            if self._file_worker.submit(lambda: keep_address(self._file, confirmed), self._was_written):
                self._unwritten = False

    def _was_read(self, result: ConfirmedAddress | Exception | None, _now: float) -> None:
        self._read = True
        if isinstance(result, Exception):
            text = f"The vehicle's address that was confirmed cannot be read: {self._file}: {result}"
            self._lines.append(f"{text}. Ask for the mission again.")
            return
        if result is None:
            if not self._opener.own() and not self._senders:
                self._lines.append(
                    "This station has no link to the vehicle. It waits until another station shares a mission with the "
                    "vehicle's address."
                )
            return
        wrong = self._wrong(result.addresses)
        origin = f"{result.text}, the vehicle's address from {result.sender}, confirmed {result.at}"
        if wrong:
            self._lines.append(f"{self._file}: {origin}, is not used: {wrong}.")
            return
        if not self._ask:
            refuses = f'This station\'s configuration has {OFFER_KEY} = "refuse".'
            self._lines.append(f"{origin}, is not used. {refuses}")
            return
        self._confirmed = result
        own = self._opener.own()
        if own:
            self._lines.append(f"{origin}, is not used. This station keeps its own link: {', '.join(own)}.")

    def _was_written(self, result: object, _now: float) -> None:
        if isinstance(result, Exception):
            after = "is not kept for" if self._confirmed is not None else "will come back after"
            self._lines.append(f"The vehicle's address {after} a restart: {self._file}: {result}.")


def _not_while_armed(command: str) -> str:
    return (
        f"Not while the vehicle is armed. Type '{command}' after it has disarmed, or after {SILENT_S:.0f} s of silence."
    )


def _shown(addresses: Listed) -> str:
    return ", ".join(address.text for address in addresses)


def _mavproxy_name(address: VehicleAddress) -> str:
    """The name that MAVProxy gives a link to this address."""
    return f"{address.host}:{address.port}"
