"""A run of kilwa-dask: what all its tasks share, which workers may take part, and what is removed when it ends.

While a run goes on, the folder STATE in each folder that it shares with its workers holds:

* RUN.run, locked by the driver. Workers look for it, and it keeps the folder from being removed.
* ID.lock, held by the worker that does the task ID, and by the kilwa that it starts.
* ID.N, a folder for the N-th attempt at the task; the next attempt removes it.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from kilwa_dask import __version__, program
from kilwa_dask.files import Busy, locked

STATE = ".kilwa-dask"
"""Folder for locks and attempts in each shared folder; removed when a run ends and no other run uses it."""


@dataclass(frozen=True)
class Run:
    """The settings of a run, the same for all its tasks."""

    run: str
    """Unique name of the run."""
    shared: tuple[str, ...]
    """Folders that the driver and all workers must see under the same name."""
    program: str
    version: str
    """What `kilwa --version` prints where the run was started."""
    resources: tuple[str, ...]
    """Options of kilwa that do not affect the pack, such as --threads."""

    @property
    def announced_in(self) -> tuple[str, ...]:
        """Folders in which the run is announced while it goes on: the shared ones."""
        return self.shared


class WorkerRefused(Exception):
    """A worker cannot take part; the text says which and why."""


def survey(run: Run) -> dict[str, object]:
    """Describe this worker: its machine, its versions, and which of the shared folders it does not see."""
    try:
        version, problem = program.version(run.program), None
    except (program.ProgramFailed, OSError) as error:
        version, problem = None, str(error)
    unseen = [folder for folder in run.shared if not Path(folder, STATE, f"{run.run}.run").exists()]
    package = __version__
    return {"host": program.host(), "version": version, "problem": problem, "package": package, "unseen": unseen}


def refusal(run: Run, found: dict[str, object]) -> str | None:
    """Return why a worker with this `survey` cannot take part, or None."""
    where = f"the worker on {found['host']}"
    if found["problem"] is not None:
        return f"{where} cannot run kilwa: {found['problem']}"
    if found["version"] != run.version:
        return f"{where} has {found['version']}, but this computer has {run.version}; install the same version on both"
    if found["package"] != __version__:
        return f"{where} has kilwa-dask {found['package']}, but this computer has kilwa-dask {__version__}"
    unseen = found["unseen"]
    if isinstance(unseen, list) and unseen:
        return f"{where} cannot see {unseen[0]}; the folder must be shared under the same path on all machines"
    return None


def check_this_worker(run: Run) -> None:
    """Raise `WorkerRefused` if this worker cannot take part."""
    refused = refusal(run, survey(run))
    if refused is not None:
        raise WorkerRefused(refused)


def is_address(name: str) -> bool:
    """Return whether a name is the address of an object in a store."""
    return name.startswith("s3://")


def file_id(name: str) -> str:
    """Return a file name for the lock and the attempts of a task, different for every task."""
    readable = re.sub(r"[^A-Za-z0-9_-]", "_", name)[-40:]
    return f"{readable}-{hashlib.sha256(name.encode()).hexdigest()[:16]}"


def sweep_attempts(folder: Path, task: str) -> int:
    """Remove the files of interrupted attempts at a task and return how many there were. The caller must hold its lock."""
    last = 0
    for attempt in folder.glob(f"{task}.*"):
        number = attempt.name.removeprefix(task + ".")
        if number.isdigit():
            last = max(last, int(number))
            shutil.rmtree(attempt)
    return last


@contextmanager
def attempted(state: Path, task: str) -> Iterator[tuple[Path, int]]:
    """Make the folder of a new attempt; yield it and the number of earlier ones. The caller must hold the task's lock.

    The folder is removed at the end. It remains if the attempt ends with `program.MayPass`, so that the next can count it.
    """
    earlier = sweep_attempts(state, task)
    folder = state / f"{task}.{earlier + 1}"
    folder.mkdir()
    try:
        yield folder, earlier
    except program.MayPass:
        raise
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    shutil.rmtree(folder)


def sweep(shared: Path) -> bool:
    """Remove the files of finished runs and interrupted attempts, except where another process is working.

    Return whether nothing is left, or another run is active, which will clean up when it ends, or what is left is needed to
    continue another build (`divided`).
    """
    state = shared / STATE
    try:
        entries = list(state.iterdir())
    except FileNotFoundError:
        return True
    tasks = {match[1] for entry in entries if (match := re.fullmatch(r"(.+)\.(\d+|lock)", entry.name))}
    locks = {state / f"{task}.lock": task for task in tasks}
    for lock in [*locks, *(entry for entry in entries if entry.suffix == ".run")]:
        try:
            with locked(lock, wait=False):
                if lock in locks:
                    sweep_attempts(state, locks[lock])
        except Busy:
            if lock not in locks:
                return True
        except FileNotFoundError:
            continue
    for record in (entry for entry in entries if entry.suffix == ".json"):
        if not _names_a_folder(record):
            record.unlink(missing_ok=True)
    try:
        state.rmdir()
    except FileNotFoundError:
        return True
    except OSError:
        return all(entry.suffix == ".json" for entry in state.iterdir())
    return True


def _names_a_folder(record: Path) -> bool:
    """Return whether the folder that a record of a build names (`divided.Record`) is still there."""
    try:
        return os.path.isdir(json.loads(record.read_text(encoding="utf-8"))["folder"])
    except (OSError, ValueError, TypeError, KeyError):
        return False


@contextmanager
def announced(run: Run) -> Iterator[None]:
    """Keep the file RUN.run in the state folders during a run."""
    with ExitStack() as stack:
        for shared in run.announced_in:
            _announce(stack, Path(shared, STATE), run.run)
        yield


def _announce(stack: ExitStack, state: Path, run: str) -> None:
    while True:
        state.mkdir(parents=True, exist_ok=True)
        try:
            stack.enter_context(locked(state / f"{run}.run"))
        except FileNotFoundError:
            continue  # Another run that ended has just removed the folder.
        return
