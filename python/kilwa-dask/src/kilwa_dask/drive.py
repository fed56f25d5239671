"""Submits the tasks of a run to a cluster, shows progress, and collects the outcomes."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from functools import partial
from typing import Any

from distributed import Client, as_completed
from distributed.scheduler import KilledWorker

from kilwa_dask import program, report
from kilwa_dask.collection import Mesh
from kilwa_dask.task import Outcome, Plan, WorkerRefused, refusal, survey, work_on

# How often to repeat a task whose kilwa was killed by a signal. The scheduler repeats the tasks of workers that died.
REPEATS = 2


class Progress:
    """Shows progress: on a terminal, one line that is updated in place; elsewhere, one line for each mesh."""

    def __init__(self, meshes: Sequence[Mesh]) -> None:
        """Start the clock."""
        self._bytes = {mesh.name: mesh.bytes + 1 for mesh in meshes}
        self._all = sum(self._bytes.values())
        self._left = self._all
        self._done = 0
        self._failed = 0
        self._started = time.monotonic()
        self._in_place = sys.stderr.isatty()

    def add(self, outcome: Outcome) -> None:
        """Take an outcome into account and show it."""
        self._done += 1
        self._failed += outcome.state == "failed"
        self._left -= self._bytes[outcome.name]
        spent = time.monotonic() - self._started
        left = spent * self._left / max(1, self._all - self._left)
        status = f"{self._done} of {len(self._bytes)} done, {self._failed} failed, about {report.duration(left)} left"
        if not self._in_place:
            print(f"[{status}] {report.line(outcome)}", file=sys.stderr, flush=True)
            return
        if outcome.state == "failed":
            print(f"\r\x1b[K{report.line(outcome)}", file=sys.stderr)
        end = "" if self._done < len(self._bytes) else "\n"
        print(f"\r\x1b[K{status}", end=end, file=sys.stderr, flush=True)


def check_workers(client: Client, plan: Plan) -> None:
    """Wait for the first worker and refuse the run if one that is there cannot take part.

    Each task looks again, because workers may join later (`drive`). Raises `WorkerRefused`.
    """
    client.wait_for_workers(1)
    found: dict[str, dict[str, object]] = client.run(survey, plan, on_error="return")
    reasons = set()
    for address, answer in found.items():
        if isinstance(answer, BaseException):
            reasons.add(f"the worker at {address} does not answer ({answer}); is kilwa-dask installed there?")
        elif (reason := refusal(plan, answer)) is not None:
            reasons.add(reason)
    if reasons:
        raise WorkerRefused("\n".join(sorted(reasons)))


def drive(client: Client, meshes: Sequence[Mesh], plan: Plan, outcomes: list[Outcome]) -> None:
    """Have every mesh worked on, the largest first, and append what became of each to `outcomes`.

    Raises `WorkerRefused` if a worker that joined later cannot take part: it would take every mesh from those that can. If
    that happens or the run is interrupted (Ctrl-C), what is running is stopped on the workers before the exception goes on.
    """
    ordered = sorted(meshes, key=lambda mesh: (-mesh.bytes, mesh.name))
    # Keys are unique to this run, because other runs may use the same scheduler.
    keys = [f"{mesh.name}-{plan.run}" for mesh in ordered]
    work = partial(work_on, plan=plan, wait=False)
    futures = client.map(work, ordered, key=keys, pure=False, retries=REPEATS)
    meshes_by_key = dict(zip(keys, ordered, strict=True))
    progress = Progress(meshes)
    ended = as_completed(futures, loop=client.loop)
    try:
        for future in ended:
            mesh = meshes_by_key[future.key]
            outcome = _outcome(future, mesh)
            # Otherwise the scheduler would recompute it when the worker that holds the result dies.
            future.release()
            if outcome.state == "busy":
                # Another run, or an orphaned process of one, is processing it: wait for that when nothing else is left to do.
                key = f"{mesh.name}-waits-{plan.run}"
                meshes_by_key[key] = mesh
                waits = client.submit(work_on, mesh, plan, key=key, pure=False, retries=REPEATS, priority=-1)
                futures.append(waits)
                ended.add(waits)
                continue
            outcomes.append(outcome)
            progress.add(outcome)
    except BaseException:
        client.cancel(futures, force=True)
        client.run(program.stop, plan.run, on_error="ignore")
        raise


def _outcome(future: Any, mesh: Mesh) -> Outcome:
    if future.status == "finished":
        result = future.result()
        assert isinstance(result, Outcome)
        return result
    if future.status == "cancelled":
        message = "the scheduler gave it up; run the command again"
    else:
        error = future.exception()
        if isinstance(error, WorkerRefused):
            raise error
        message = f"{type(error).__name__}: {error}"
        if isinstance(error, KilledWorker):
            times = error.allowed_failures + 1
            message = f"{times} workers died while processing {mesh.name}; perhaps they ran out of memory"
        elif isinstance(error, program.ProgramKilled):
            message = f"{error}; tried {REPEATS + 1} times"
    return Outcome(mesh.name, "failed", "worker", message, input_bytes=mesh.bytes)
