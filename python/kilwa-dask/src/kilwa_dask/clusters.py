"""Connects to or starts the workers: an existing scheduler, this computer, hosts reached by SSH, or Slurm jobs."""

from __future__ import annotations

import asyncio
import logging
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from importlib.util import find_spec
from types import FrameType
from typing import Any

import dask
from distributed import Client, LocalCluster
from distributed.diagnostics.plugin import WorkerPlugin

from kilwa_dask import slurm
from kilwa_dask.collection import UsageError
from kilwa_dask.report import duration

# A task may lose this many workers; when one more dies while processing it, the task is given up.
ALLOWED_FAILURES = 2

_CONFIG: dict[str, Any] = {
    "distributed.scheduler.allowed-failures": ALLOWED_FAILURES,
    # A worker holds only the task that it is running, so that no waiting task is blamed when it dies.
    "distributed.scheduler.worker-saturation": 1.0,
    "distributed.scheduler.work-stealing": False,
    # The memory is used by kilwa, a separate process with its own limit.
    "distributed.worker.memory.terminate": False,
    "distributed.worker.memory.pause": False,
}
# On this computer and over SSH, a nanny restarts its worker. By default, Dask closes a nanny whose worker has been away for
# 15 s, and a busy machine may need longer to restart it. Without any nanny, the run would wait for ever.
_NANNIES_STAY = {"distributed.deploy.lost-worker-timeout": "365 days"}


# Idle time after which a scheduler on another machine ends by itself, and how often the driver gives it work, in seconds.
_IDLE_LIMIT = "300s"
_KEEP_BUSY_EVERY = 60.0
# How often to look for workers, in seconds.
_LOOK_EVERY = 5.0
# How long there may be no worker before the run says so, and before it stops, in seconds.
_TELL_AFTER = 60.0
_STOP_AFTER = 900.0


class ClusterFailed(Exception):
    """The machines cannot be used; the text says why."""


class _NoWorkers(BaseException):
    """No worker will join any more. A `BaseException`, so that only `opened` handles it."""


@dataclass(frozen=True)
class Choice:
    """Which machines to use."""

    scheduler: str | None = None
    kind: str = "local"
    """"local", "ssh" or "slurm"; ignored if there is a scheduler."""
    workers: int | None = None
    hosts: tuple[str, ...] = ()
    threads: int | None = None
    """Threads of each kilwa."""


class LeaveCtrlCToTheDriver(WorkerPlugin):  # type: ignore[misc]
    """Ctrl-C in a terminal reaches all its processes; the driver stops the workers of this computer itself."""

    name = "kilwa-dask-ctrl-c"

    def setup(self, worker: object) -> None:
        """Ignore SIGINT in the worker's process, and keep it from logging that tasks of a stopped run were cancelled."""
        del worker
        logging.getLogger("distributed.worker.state_machine").setLevel(logging.ERROR)
        try:
            signal.signal(signal.SIGINT, signal.SIG_IGN)
        except ValueError:
            pass  # Not the main thread, so this process runs more than the worker.


@contextmanager
def opened(choice: Choice) -> Iterator[Client]:
    """Open the cluster and a client, and close both at the end. Raises `UsageError` or `ClusterFailed` on failure."""
    with dask.config.set(_CONFIG if choice.kind == "slurm" else {**_CONFIG, **_NANNIES_STAY}):
        if choice.scheduler is not None:
            try:
                client = Client(choice.scheduler, timeout="30s", set_as_default=False)
            except (OSError, ValueError) as error:
                raise ClusterFailed(f"cannot reach the scheduler at {choice.scheduler}: {error}") from error
            with client, _missed(client, may_join=True):
                yield client
            return
        open_cluster = {"local": _local, "ssh": _ssh, "slurm": _slurm}[choice.kind]
        try:
            opening = open_cluster(choice)
        except slurm.Refused as error:
            raise ClusterFailed(str(error)) from error
        except (OSError, ValueError, RuntimeError) as error:
            on = f" on {', '.join(choice.hosts)}" if choice.hosts else ""
            raise ClusterFailed(f"cannot start the workers ({choice.kind}{on}): {error}") from error
        with opening as cluster, Client(cluster, set_as_default=False) as client:
            if choice.kind == "local":
                client.register_plugin(LeaveCtrlCToTheDriver())
            with ExitStack() as stack:
                if choice.kind == "slurm":
                    stack.enter_context(_watched(client))
                else:
                    stack.enter_context(_missed(client, may_join=False))
                if choice.kind == "ssh":
                    stack.enter_context(_kept_busy(client))
                yield client


@contextmanager
def _kept_busy(client: Client) -> Iterator[None]:
    """Give the scheduler an empty task from time to time, even while the driver waits, for example for another driver's lock."""
    ended = threading.Event()

    def keep() -> None:
        latest = None
        while not ended.wait(_KEEP_BUSY_EVERY):
            # A pending task also keeps the scheduler from being idle.
            if latest is None or latest.done():
                with suppress(Exception):  # The driver gets the same error, and reports it.
                    latest = client.submit(int, pure=False)

    keeper = threading.Thread(target=keep, name="kilwa-dask-keeper", daemon=True)
    keeper.start()
    try:
        yield
    finally:
        ended.set()
        keeper.join()


@contextmanager
def _stoppable() -> Iterator[Callable[[str], None]]:
    """Yield a function for other threads, which raises `ClusterFailed` in this one. It interrupts this thread as Ctrl-C does."""
    thread = threading.get_ident()
    over = threading.Event()
    reasons: list[str] = []

    def interrupt(signum: int, frame: FrameType | None) -> None:
        del signum, frame
        if not over.is_set():
            raise _NoWorkers

    def stop(reason: str) -> None:
        reasons.append(reason)
        signal.pthread_kill(thread, signal.SIGURG)

    # If this signal arrives late, the default handler ignores it.
    before = signal.signal(signal.SIGURG, interrupt)
    try:
        yield stop
    except _NoWorkers:
        raise ClusterFailed(reasons[0]) from None
    finally:
        over.set()
        signal.signal(signal.SIGURG, before)


@contextmanager
def _watched(client: Client) -> Iterator[None]:
    """Raise `ClusterFailed` when no Slurm job will bring a worker any more."""
    jobs = client.cluster.kilwa_dask_jobs
    with _stoppable() as stop:
        jobs.on_problem(stop)
        try:
            yield
        finally:
            jobs.on_problem(None)


@contextmanager
def _missed(client: Client, *, may_join: bool) -> Iterator[None]:
    """Say when no worker is left, and raise `ClusterFailed` if none returns for a long time and others may not join either."""
    ended = threading.Event()

    def watch(stop: Callable[[str], None]) -> None:
        since: float | None = None
        is_told = False
        while not ended.wait(_LOOK_EVERY):
            with suppress(Exception):  # Without a scheduler, the driver gets the same error, and reports it.
                if client.scheduler_info(n_workers=1)["workers"]:
                    since, is_told = None, False
                    continue
                since = since or time.monotonic()
                missing = time.monotonic() - since
                if missing >= _STOP_AFTER and not may_join:
                    stop(
                        f"all workers are gone, and none has come back for {duration(missing)}; run the same command to continue"
                    )
                    return
                if missing >= _TELL_AFTER and not is_told:
                    is_told = True
                    _warn("no worker is connected; waiting for one. Ctrl-C stops the run, and the same command continues it")

    with _stoppable() as stop:
        watcher = threading.Thread(target=watch, args=[stop], name="kilwa-dask-watcher", daemon=True)
        watcher.start()
        try:
            yield
        finally:
            ended.set()
            watcher.join()


def _warn(text: str) -> None:
    """Write a line to standard error; on a terminal, it replaces the line that shows progress."""
    print(f"\r\x1b[K{text}" if sys.stderr.isatty() else text, file=sys.stderr, flush=True)


def local_workers(workers: int | None) -> int:
    """Return the number of workers on this computer: as requested, or one for every two cores."""
    return workers or max(1, (os.cpu_count() or 1) // 2)


def _local(choice: Choice) -> Any:
    """Start processes with one thread each, which a nanny restarts if they die."""
    return LocalCluster(
        n_workers=local_workers(choice.workers),
        threads_per_worker=1,
        processes=True,
        memory_limit=0,
        host="127.0.0.1",
        dashboard_address="127.0.0.1:0",
    )


def _ssh(choice: Choice) -> Any:
    if not choice.hosts:
        raise UsageError("--cluster ssh needs --hosts HOST,HOST,…; the first one also runs the scheduler")
    if find_spec("asyncssh") is None:
        raise UsageError("--cluster ssh needs the package asyncssh: pip install 'kilwa-dask[ssh]'")
    from distributed import SSHCluster

    each = choice.workers or 1
    options = {"nthreads": 1, "n_workers": each, "memory_limit": "0"}
    # A program started over SSH does not notice that the driver was killed. So the scheduler ends when it has been idle for this
    # time, and the workers end with it.
    idle = {"idle_timeout": _IDLE_LIMIT}
    return SSHCluster([choice.hosts[0], *choice.hosts], worker_options=options, scheduler_options=idle)


def _slurm(choice: Choice) -> Any:
    if find_spec("dask_jobqueue") is None:
        raise UsageError("--cluster slurm needs the package dask-jobqueue: pip install 'kilwa-dask[slurm]'")
    from dask_jobqueue import SLURMCluster

    if not slurm.is_there():
        raise UsageError("--cluster slurm needs Slurm's program sbatch; start kilwa-dask on a machine that can submit jobs")
    memory = dask.config.get("jobqueue.slurm.memory", None) or "4GiB"
    # Each job runs one task at a time, whose kilwa uses all cores of the job.
    cluster = SLURMCluster(cores=1, processes=1, job_cpu=choice.threads or 1, memory=memory)
    try:
        cluster.kilwa_dask_jobs = slurm.Jobs(cluster, choice.workers or 1)
    except BaseException:
        cluster.close()
        raise
    return cluster


def wait_for_worker(client: Client) -> None:
    """Wait until a worker has joined. Raises `ClusterFailed` if no Slurm job can bring one."""
    jobs = getattr(client.cluster, "kilwa_dask_jobs", None)
    while True:
        try:
            client.wait_for_workers(1, timeout=_LOOK_EVERY)
            return
        except (TimeoutError, asyncio.TimeoutError):
            problem = jobs.problem() if jobs is not None else None
            if problem is not None:
                raise ClusterFailed(problem) from None
