"""Workers as Slurm jobs: submitted if Slurm would accept them, and replaced when they end, for example at their time limit."""

from __future__ import annotations

import asyncio
import os
import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from distributed import Status
from distributed.diagnostics.plugin import SchedulerPlugin
from tornado.ioloop import PeriodicCallback

# How often to check for jobs that ended, in milliseconds.
_LOOK_EVERY = 5000
# Backoff before failed jobs are replaced, in seconds: the first and the longest delay. The delay doubles each time.
_FIRST_WAIT = 5.0
_LONGEST_WAIT = 300.0
# If this many jobs end before their workers join and no other job is queued, no worker will ever join.
_HOPELESS = 3


class Refused(Exception):
    """Slurm does not accept the jobs; the text includes its own message."""


class _Joins(SchedulerPlugin):  # type: ignore[misc]
    """Reports every worker that joins, even if it stays only for a short time."""

    name = "kilwa-dask-joins"

    def __init__(self, joined: Callable[[str], None]) -> None:
        self._joined = joined

    def add_worker(self, scheduler: Any, worker: str, **_: Any) -> None:
        """Report the name of the worker, which dask-jobqueue sets to that of the job."""
        self._joined(str(scheduler.workers[worker].name))


class Jobs:
    """The jobs of a `SLURMCluster`, kept at the requested number.

    dask-jobqueue submits each job once. It does not replace a job that ends, and does not notice if a job ends before its worker
    joins, or if Slurm refuses it.

    A job that ends before its worker joins has failed. Failed jobs are replaced with increasing delays until a worker joins; if
    none ever will, no more jobs are submitted.
    """

    def __init__(self, cluster: Any, number: int) -> None:
        """Submit this many jobs, and start replacing those that end. Raises `Refused`."""
        self._cluster = cluster
        self._number = number
        self._problem: str | None = None
        self._tell: Callable[[str], None] | None = None
        # Names of jobs: all that dask-jobqueue has ever listed, and those whose workers have joined. A replacement job gets a
        # new name, because 15 s after a worker has left, dask closes the job with that worker's name.
        self._listed: set[str] = set()
        self._joined: set[str] = set()
        self._named = 0
        # Numbers of the jobs that have failed since the last join.
        self._in_vain: list[str] = []
        self._wait = _FIRST_WAIT
        self._not_before = 0.0
        _test(cluster.job_script())
        cluster.scheduler.add_plugin(_Joins(self._join))
        cluster.scale(jobs=number)
        look = PeriodicCallback(self._look, _LOOK_EVERY)
        # The cluster stops it when it is closed.
        cluster.periodic_callbacks["kilwa-dask-jobs"] = look
        cluster.loop.add_callback(look.start)

    def problem(self) -> str | None:
        """Return why no worker will join any more, or None if one still may."""
        return self._problem

    def on_problem(self, tell: Callable[[str], None] | None) -> None:
        """Call `tell` with the problem, in the thread of the cluster, when one occurs, but not for an existing one."""
        self._tell = tell

    def _join(self, name: str) -> None:
        if name in self._joined:
            return
        self._joined.add(name)
        self._in_vain.clear()
        self._wait = _FIRST_WAIT
        self._not_before = 0.0

    async def _look(self) -> None:
        """Replace the jobs that have ended."""
        workers, wanted = self._cluster.workers, self._cluster.worker_spec
        # Jobs that are submitted while the request runs are not in the response.
        submitted = {name: job.job_id for name, job in workers.items()}
        self._listed |= set(submitted)
        queued = await asyncio.to_thread(_queued)
        if queued is None or self._problem is not None or self._cluster.status != Status.running:
            return
        present = {worker["name"] for worker in self._cluster.scheduler_info["workers"].values()}
        in_vain = False
        for name, job in submitted.items():
            if job in queued or name in present or name not in workers:
                continue
            # A job without a number was refused.
            in_vain |= name not in self._joined
            if job is not None and name not in self._joined:
                self._in_vain.append(job)
            del workers[name]
        # Dask has closed others because their workers had left. The rest are being submitted.
        known = self._listed | (self._joined - present)
        for name in [name for name in wanted if name in known and name not in workers]:
            del wanted[name]
        if in_vain:
            self._not_before = time.monotonic() + self._wait
            self._wait = min(2 * self._wait, _LONGEST_WAIT)
        if not present and self._is_hopeless():
            self._problem = self._describe()
            if self._tell is not None:
                self._tell(self._problem)
        elif len(wanted) < self._number and time.monotonic() >= self._not_before:
            while len(wanted) < self._number:
                self._named += 1
                wanted[f"again-{self._named}"] = self._cluster.new_spec
            self._cluster.scale(jobs=self._number)

    def _is_hopeless(self) -> bool:
        """Return whether so many jobs have failed that none can succeed. Called only if there is no worker."""
        # `worker_spec` has the jobs that are pending, running or being submitted.
        if self._cluster.worker_spec and len(self._in_vain) < self._number:
            return False
        return len(self._in_vain) >= _HOPELESS

    def _describe(self) -> str:
        jobs = ", ".join(self._in_vain[-_HOPELESS:])
        said = _output_of(self._in_vain[-1], self._cluster.job_header, self._cluster.job_name)
        return f"Slurm jobs {jobs} ended before their workers joined; their output says why (for example {said})"


def _output_of(job: str, header: str, name: str | None) -> str:
    """Return the file with the messages of a job, according to the directives in its script."""
    files = {}
    for option, file in re.findall(r"^#SBATCH\s+(-[oe]|--output|--error)[\s=]*(\S+)", header, re.MULTILINE):
        files["e" if "e" in option.removeprefix("--")[:2] else "o"] = file
    pattern = files.get("e") or files.get("o") or "slurm-%j.out"
    return re.sub("%[jJA]", job, pattern.replace("%x", name or "%x"))


def _queued() -> set[str] | None:
    """Return the identifiers of this user's pending and running jobs; None if Slurm does not respond."""
    command = ["squeue", "--noheader", "--format=%A", f"--user={os.getuid()}"]
    try:
        asked = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError:
        return None
    return set(asked.stdout.split()) if asked.returncode == 0 else None


def _test(script: str) -> None:
    """Ask Slurm whether it would accept a job. Raises `Refused`."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "job.sh")
        file.write_text(script)
        result = subprocess.run(["sbatch", "--test-only", str(file)], capture_output=True, text=True, check=False)
    if result.returncode != 0:
        raise Refused(f"Slurm does not accept the jobs: {result.stderr.strip()}")


def is_there() -> bool:
    """Return whether jobs can be submitted from this machine."""
    return shutil.which("sbatch") is not None
