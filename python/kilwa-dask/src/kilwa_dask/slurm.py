"""Workers as jobs of Slurm: submitted if Slurm would accept them, and replaced when they end, for example at their wall time."""

from __future__ import annotations

import asyncio
import os
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from tornado.ioloop import PeriodicCallback

# How often to look for jobs that ended, in milliseconds.
_LOOK_EVERY = 5000
# So many jobs that end before a worker of theirs joins mean that none can.
_HOPELESS = 3


class Refused(Exception):
    """Slurm does not accept the jobs; the text is its own message."""


class Jobs:
    """The jobs of a `SLURMCluster`: always as many as asked for.

    dask-jobqueue submits each job once. It neither replaces a job that ends, nor notices one that ends before its worker
    joins, nor one that Slurm has refused.
    """

    def __init__(self, cluster: Any, number: int) -> None:
        """Submit so many jobs, and begin to replace those that end. Raises `Refused`."""
        self._cluster = cluster
        self._number = number
        self._joined: set[str] = set()
        self._in_vain: list[str] = []
        _test(cluster.job_script())
        cluster.scale(jobs=number)
        look = PeriodicCallback(self._look, _LOOK_EVERY)
        # The cluster stops it when it is closed.
        cluster.periodic_callbacks["kilwa-dask-jobs"] = look
        cluster.loop.add_callback(look.start)

    def problem(self) -> str | None:
        """Return why no worker will ever join, or None if one may."""
        if self._joined or len(self._in_vain) < _HOPELESS:
            return None
        jobs = ", ".join(self._in_vain[-_HOPELESS:])
        said = f"slurm-{self._in_vain[-1]}.out"
        return f"the jobs {jobs} of Slurm ended before their workers joined; what they printed says why (for example {said})"

    async def _look(self) -> None:
        """Submit the jobs again that have ended."""
        workers = self._cluster.workers
        present = {worker["name"] for worker in self._cluster.scheduler_info["workers"].values()}
        self._joined |= {workers[name].job_id for name in present if name in workers}
        # A job without an identifier was refused.
        submitted = {name: job.job_id for name, job in workers.items() if name not in present}
        queued = await _queued()
        if queued is None:
            return
        for name, job in submitted.items():
            # Jobs whose workers had joined are left out: dask forgets them itself, after 15 s, and would cancel another job
            # that has got the name meanwhile.
            if job in queued or job in self._joined or name not in workers or workers[name].job_id != job:
                continue
            if job is not None:
                self._in_vain.append(job)
            del workers[name]
        self._cluster.scale(jobs=self._number)


async def _queued() -> set[str] | None:
    """Return the identifiers of this user's jobs that wait or run; None if Slurm does not answer."""
    command = ["squeue", "--noheader", "--format=%A", f"--user={os.getuid()}"]
    asked = await asyncio.create_subprocess_exec(*command, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.DEVNULL)
    output, _ = await asked.communicate()
    return set(output.decode().split()) if asked.returncode == 0 else None


def _test(script: str) -> None:
    """Ask Slurm whether it would accept a job. Raises `Refused`."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "job.sh")
        file.write_text(script)
        told = subprocess.run(["sbatch", "--test-only", str(file)], capture_output=True, text=True, check=False)
    if told.returncode != 0:
        raise Refused(f"Slurm does not accept the jobs: {told.stderr.strip()}")


def is_there() -> bool:
    """Return whether jobs can be submitted from this machine."""
    return shutil.which("sbatch") is not None
