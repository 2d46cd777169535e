# SPDX-License-Identifier: GPL-3.0-or-later

"""Flies many seeds: here, in processes of this machine, or on the workers of a Dask scheduler.

The result of a seed depends only on the seed. So batches may be flown anywhere and in any order, twice if a worker
dies. An interrupted campaign goes on with the seeds that are missing in its file.
"""

from __future__ import annotations

import importlib
import json
import logging
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from sitl.campaign.outcome import Outcome, fly
from sitl.campaign.rules import rules

__all__ = ["Campaign", "CampaignError", "Flights", "fly_all"]

#: flights of one task: a few seconds
_BATCH: Final = 20


class CampaignError(Exception):
    """A campaign that cannot be flown, in words for people."""


@dataclass(frozen=True, slots=True)
class Campaign:
    """Which flights."""

    seed: int
    runs: int

    @property
    def seeds(self) -> range:
        """All of them."""
        return range(self.seed, self.seed + self.runs)


class Flights:
    """The file of a campaign: one line for each flight, in the order in which they came. Raises CampaignError."""

    def __init__(self, folder: Path, campaign: Campaign) -> None:
        self._path = folder / "flights.jsonl"
        about = folder / "campaign.json"
        says = {**asdict(campaign), "rules": rules(), "runs": 0}
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if about.exists() and _read_json(about) != says:
                raise CampaignError(f"{folder} holds another campaign (seed or rules differ)")
            about.write_text(json.dumps(says), encoding="utf-8")
            self.outcomes = {outcome.seed: outcome for outcome in self._read() if outcome.seed in campaign.seeds}
        except OSError as error:
            raise CampaignError(f"{error.filename or folder}: {error.strerror}") from error

    def _read(self) -> Iterator[Outcome]:
        if not self._path.exists():
            return
        whole = self._path.read_bytes()
        kept = whole[: whole.rfind(b"\n") + 1]
        if kept != whole:  # it was interrupted while it wrote
            self._path.write_bytes(kept)
        for number, line in enumerate(kept.decode("utf-8").splitlines(), 1):
            try:
                yield Outcome.read(line)
            except (ValueError, KeyError, TypeError) as error:
                raise CampaignError(f"{self._path}, line {number}: no outcome of a flight ({error})") from error

    def add(self, outcomes: Iterable[Outcome]) -> None:
        """Keep these."""
        found = list(outcomes)
        try:
            with self._path.open("a", encoding="utf-8") as file:
                file.write("".join(outcome.line() + "\n" for outcome in found))
        except OSError as error:
            raise CampaignError(f"{self._path}: {error.strerror}") from error
        self.outcomes.update((outcome.seed, outcome) for outcome in found)


def _read_json(path: Path) -> object:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise CampaignError(f"{path}: no JSON ({error})") from error


def _fly_batch(seeds: Sequence[int], flown_with: str) -> list[Outcome]:
    if rules() != flown_with:
        raise CampaignError(f"its rules are {rules()}, not {flown_with}")
    return [fly(seed) for seed in seeds]


def fly_all(campaign: Campaign, done: Iterable[int], jobs: int, scheduler: str | None) -> Iterator[list[Outcome]]:
    """Fly what is missing, a batch at a time. Raises CampaignError."""
    flown = set(done)
    missing = [seed for seed in campaign.seeds if seed not in flown]
    batches = [missing[at : at + _BATCH] for at in range(0, len(missing), _BATCH)]
    if jobs == 1 and scheduler is None:
        yield from (_fly_batch(batch, rules()) for batch in batches)
        return
    with _client(jobs, scheduler) as client:
        yield from _on_workers(client, batches)


def _on_workers(client: Any, batches: list[list[int]]) -> Iterator[list[Outcome]]:
    """A few batches for each worker at a time.

    Waiting ones can be sent to a worker that has come since.
    """
    waiting = iter(batches)

    def submit() -> Any:
        batch = next(waiting, None)
        return None if batch is None else client.submit(_fly_batch, batch, rules(), pure=False)

    ahead = max(2, 3 * sum(client.nthreads().values()))
    first = [task for task in (submit() for _ in range(min(ahead, len(batches)))) if task is not None]
    going = _distributed().as_completed(first)
    for task in going:
        try:
            flown = task.result()
        except Exception as error:  # whatever a worker stumbles over
            text = f"a worker cannot fly: {error} (scheduler and workers need the same state of this package)"
            raise CampaignError(text) from error
        yield flown
        following = submit()
        if following is not None:
            going.add(following)


def _distributed() -> Any:
    """Dask's package for more than one process, which comes with an extra. Raises ModuleNotFoundError."""
    return importlib.import_module("distributed")


@contextmanager
def _client(jobs: int, scheduler: str | None) -> Iterator[Any]:
    dask = _distributed()
    if scheduler is not None:
        try:
            client = dask.Client(scheduler, timeout="15s")
        except (OSError, ValueError) as error:
            raise CampaignError(f"no scheduler at {scheduler}: {error}") from error
        with client:
            yield client
        return
    cluster = dask.LocalCluster(
        n_workers=jobs,
        threads_per_worker=1,
        processes=True,
        dashboard_address="127.0.0.1:0",
        host="127.0.0.1",
        silence_logs=logging.ERROR,
    )
    with cluster, dask.Client(cluster) as client:
        yield client
