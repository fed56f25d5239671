"""Submits the tasks of a run to a cluster, shows progress, and collects what became of each."""

from __future__ import annotations

import asyncio
import concurrent.futures
import sys
import time
from collections.abc import Callable, Container, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import count
from typing import Any, Protocol, TypeVar

from distributed import Client, as_completed, get_worker
from distributed.scheduler import KilledWorker

from kilwa_dask import clusters, program, report
from kilwa_dask.collection import Mesh
from kilwa_dask.run import Run, WorkerRefused, refusal, survey
from kilwa_dask.task import Outcome, Plan, work_on

# How often to repeat a task that failed with `program.MayPass`, on other workers if there are any. The scheduler repeats the
# tasks of workers that died.
REPEATS = 2
# How long a worker holds a task that it should not do, in seconds.
_PAUSE = 1.0

# Makes the keys of a process unique: a task may be submitted again in a run.
_submissions = count()


class _HasState(Protocol):
    """What a task returns."""

    @property
    def state(self) -> str:
        """Return "busy" if another process is working on it."""


Item = TypeVar("Item")
Returned = TypeVar("Returned", bound=_HasState)


@dataclass(frozen=True)
class Lost:
    """A task that returned nothing."""

    message: str
    """Why."""


@dataclass(frozen=True)
class Again:
    """A task that must be submitted again."""

    message: str
    """Why: the text of `program.MayPass`."""
    worker: str | None
    """Address of the worker where it failed; None if it was assigned to a worker that should be avoided."""


class Progress:
    """Shows progress: on a terminal, one line that is updated in place; elsewhere, one line for each task."""

    def __init__(self, weights: Mapping[str, int]) -> None:
        """Start the clock. The weights of the tasks are what the time left is estimated from."""
        self._open = {name: weight + 1 for name, weight in weights.items()}
        self._tasks = len(self._open)
        self._all = self._left = sum(self._open.values())
        self._done = 0
        self._failed = 0
        self._started = time.monotonic()
        self._in_place = sys.stderr.isatty()

    def keep(self, names: Container[str]) -> None:
        """Leave out all other tasks that have not ended: somebody else has done them."""
        for name in [name for name in self._open if name not in names]:
            weight = self._open.pop(name)
            self._tasks -= 1
            self._all -= weight
            self._left -= weight

    def add(self, name: str, line: str, *, failed: bool) -> None:
        """Count a task that has ended, and show it."""
        self._done += 1
        self._failed += failed
        self._left -= self._open.pop(name)
        spent = time.monotonic() - self._started
        left = spent * self._left / max(1, self._all - self._left)
        status = f"{self._done} of {self._tasks} done, {self._failed} failed, about {report.duration(left)} left"
        if not self._in_place:
            print(f"[{status}] {line}", file=sys.stderr, flush=True)
            return
        if failed:
            print(f"\r\x1b[K{line}", file=sys.stderr)
        end = "" if self._done < self._tasks else "\n"
        print(f"\r\x1b[K{status}", end=end, file=sys.stderr, flush=True)


def check_workers(client: Client, run: Run) -> None:
    """Wait for the first worker and refuse the run if one that is there cannot take part.

    Each task looks again, because workers may join later (`submit`). Raises `WorkerRefused`, and `clusters.ClusterFailed` if no
    worker can join.
    """
    clusters.wait_for_worker(client)
    found: dict[str, dict[str, object]] = client.run(survey, run, on_error="return")
    reasons = set()
    for address, answer in found.items():
        if isinstance(answer, BaseException):
            reasons.add(f"the worker at {address} does not answer ({answer}); is kilwa-dask installed there?")
        elif (reason := refusal(run, answer)) is not None:
            reasons.add(reason)
    if reasons:
        raise WorkerRefused("\n".join(sorted(reasons)))


def submit(
    client: Client,
    items: Mapping[str, Item],
    work: Callable[..., Returned],
    run: str,
    take: Callable[[str, Returned | Lost], None],
) -> None:
    """Have `work(item, wait=…)` done for all items, in their order, and hand what became of each to `take(name, …)`.

    A task that returns "busy", because another run or an orphaned process of one works on it, is submitted again to wait for
    that, when nothing else is left to do. One that fails with `program.MayPass` is repeated, on another worker if there is one.
    Raises `WorkerRefused` if a worker that joined later cannot take part: it would take every task from those that can. If that
    happens, if `take` raises, or if the run is interrupted (Ctrl-C), what is running is stopped on the workers before the
    exception goes on.
    """
    # Keys are unique to this run, because other runs may use the same scheduler.
    names = {f"{name}-{run}-{next(_submissions)}": name for name in items}
    attempt = partial(_attempt, work)
    futures = client.map(partial(attempt, wait=False), list(items.values()), key=list(names), pure=False)
    ended = as_completed(futures, loop=client.loop)
    failed: dict[str, list[str]] = {}

    def submit_again(name: str, **how: Any) -> None:
        key = f"{name}-again-{run}-{next(_submissions)}"
        names[key] = name
        again = client.submit(attempt, items[name], key=key, pure=False, **how)
        futures.append(again)
        ended.add(again)

    try:
        for future in ended:
            name = names[future.key]
            became: Returned | Lost | Again = _became(future, name)
            # Otherwise the scheduler would recompute it when the worker that holds the result dies.
            future.release()
            if isinstance(became, Again):
                tried = failed.setdefault(name, [])
                if became.worker is not None:
                    tried.append(became.worker)
                if len(tried) <= REPEATS:
                    others = [worker for worker in client.scheduler_info(n_workers=-1)["workers"] if worker not in tried]
                    # Others are preferred, not required: they may all be gone by then.
                    prefer = {"workers": others, "allow_other_workers": True} if others else {}
                    submit_again(name, wait=False, avoid=tuple(tried) if others else (), **prefer)
                    continue
                became = Lost(f"{became.message}; tried {len(tried)} times")
            if isinstance(became, Lost) or became.state != "busy":
                take(name, became)
                continue
            submit_again(name, wait=True, priority=-1)
    except BaseException:
        # The scheduler may be gone, and the reason to stop is what should be reported.
        with suppress(Exception):
            client.cancel(futures, force=True)
            client.run(program.stop, run, on_error="ignore")
        raise


def _attempt(work: Callable[..., Returned], item: object, *, wait: bool, avoid: Container[str] = ()) -> Returned | Again:
    """Do the work in this worker, unless it is one of those to avoid."""
    worker: str = get_worker().address
    if worker in avoid:
        # The user's own scheduler may let an idle worker steal tasks that were meant for others.
        time.sleep(_PAUSE)
        return Again("", None)
    try:
        return work(item, wait=wait)
    except program.MayPass as error:
        return Again(str(error), worker)


def _became(future: Any, name: str) -> Any:
    # A worker may die with its result between the message that it is done and this; the task is done again then, so the
    # status of the future says nothing yet.
    try:
        return future.result()
    except (concurrent.futures.CancelledError, asyncio.CancelledError):
        return Lost("the scheduler gave it up; run the command again")
    except WorkerRefused:
        raise
    except KilledWorker as error:
        times = error.allowed_failures + 1
        return Lost(f"{times} workers died while processing {name}; perhaps they ran out of memory")
    except Exception as error:
        return Lost(f"{type(error).__name__}: {error}")


def drive(client: Client, meshes: Sequence[Mesh], plan: Plan, outcomes: list[Outcome]) -> None:
    """Have every mesh worked on, the largest first, and append what became of each to `outcomes`. Raises as `submit`."""
    ordered = {mesh.name: mesh for mesh in sorted(meshes, key=lambda mesh: (-mesh.bytes, mesh.name))}
    progress = Progress({mesh.name: mesh.bytes for mesh in meshes})

    def take(name: str, became: Outcome | Lost) -> None:
        if isinstance(became, Lost):
            became = Outcome(name, "failed", "worker", became.message, input_bytes=ordered[name].bytes)
        outcomes.append(became)
        progress.add(name, report.line(became), failed=became.state == "failed")

    submit(client, ordered, partial(work_on, plan=plan), plan.run, take)
