"""One build that is divided into tasks: what a worker does.

The driver asks `kilwa plan` which tasks there are (`drive_build`); a worker does one with `kilwa task`, or writes the pack
with `kilwa assemble`. kilwa itself sees to it that a task may be done twice or die at any moment. The locks, in
WORK/.kilwa-dask/, see to it that work is not done twice at a time, and that nobody works in a folder that is being removed:

* KEY-TASK.lock is held by the worker that does a task of the build KEY, and by its kilwa.
* KEY.lock is shared by all who do tasks of the build; `kilwa assemble`, which removes its folder, holds it alone.
* PACK.lock is held while the pack is assembled, and while the driver looks whether it is.

PACK.json is written before the pack is assembled. It says how the output was then, so that a run after a death knows whether
the file that is there is the pack, or one that was there before.
"""

from __future__ import annotations

import fcntl
import json
import os
import resource
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from kilwa_dask import program
from kilwa_dask.files import Busy, locked, sha256, write_whole
from kilwa_dask.run import STATE, Run, attempted, check_this_worker, file_id

ASSEMBLE = "assemble"
"""Name of the last task, which is not in kilwa's list."""


@dataclass(frozen=True)
class BuildPlan(Run):
    """The settings of a run of `build`; the folder of the work is the first of the shared ones."""

    arguments: tuple[str, ...]
    """Arguments of kilwa that list the tasks."""
    output: str
    force: bool = False
    scratch: str | None = None
    """Folder for scratch files on each machine, if not in the folder of the work."""

    @property
    def state_folder(self) -> Path:
        """Folder of the locks."""
        return Path(self.shared[0], STATE)

    @property
    def pack_lock(self) -> Path:
        """Lock of the output."""
        return self.state_folder / f"{file_id(self.output)}.lock"

    @property
    def record(self) -> Path:
        """What is known of the output."""
        return self.state_folder / f"{file_id(self.output)}.json"


@dataclass(frozen=True)
class Build:
    """A build, as `kilwa plan` names it."""

    folder: str
    key: str

    def lock(self, plan: BuildPlan) -> Path:
        """Return the lock of its folder."""
        return plan.state_folder / f"{self.key}.lock"


@dataclass(frozen=True)
class Task:
    """A task, as `kilwa plan` lists it."""

    id: str
    file: str
    done: bool
    wave: int
    triangles: int | None
    near: tuple[float, float, float] | None

    @property
    def stage(self) -> str:
        """Return `ingest`, `level-07` or `tail`."""
        return stage_of(self.id)

    @property
    def title(self) -> str:
        """Return its name and its place on the model, as kilwa's messages have them."""
        if self.near is None:
            return f"the task {self.id}"
        x, y, z = self.near
        return f"the task {self.id} (round {x:.2f}, {y:.2f}, {z:.2f} m)"


def stage_of(task: str) -> str:
    """Return the stage of a task: its name without the number of the shard."""
    return task.rsplit("-", 1)[0] if task.startswith("level-") else task


@dataclass(frozen=True)
class Figures:
    """What a task has cost, by kilwa's manifest. Seconds are by the clock; None is not known."""

    seconds: float = 0.0
    cpu_seconds: float | None = None
    bytes_read: int | None = None
    bytes_written: int | None = None

    @classmethod
    def of(cls, manifest: dict[str, Any]) -> Figures:
        """Read them from a manifest."""
        cpu, read, written = (manifest.get(name) for name in ("cpu_seconds", "bytes_read", "bytes_written"))
        return cls(manifest.get("seconds") or 0.0, cpu, read, written)


@dataclass(frozen=True)
class Pack:
    """A pack that is complete."""

    sha256: str
    bytes: int
    triangles: int


@dataclass(frozen=True)
class TaskOutcome:
    """What became of one attempt at a task."""

    name: str
    state: str
    """"done", "was done", "failed", "busy": another process is working on it, or "gone": the build's folder is not there."""
    message: str | None = None
    figures: Figures = Figures()
    worker_seconds: float = 0.0
    """How long the worker was occupied."""
    retries: int = 0
    """Earlier attempts that were interrupted, in this run or before."""
    worker: str = ""
    pack: Pack | None = None


class MachineFailed(program.MayPass):
    """A task failed because of its machine, its disk or the shared folder."""


def this_worker() -> str:
    """Return the name of this worker, for messages."""
    return f"{program.host()}, process {os.getpid()}"


def do(task: Task, *, wait: bool, build: Build, plan: BuildPlan) -> TaskOutcome:
    """Do a task of a build, unless it is done.

    Failures that trying again cannot help are outcomes; others are raised as `program.MayPass`. Raises `WorkerRefused`
    before anything is done if this worker cannot take part. If somebody else does the task, wait, or return "busy" if `wait`
    is false.
    """
    started = time.monotonic()
    check_this_worker(plan)
    name = f"{build.key}-{task.id}"

    def work() -> TaskOutcome:
        with (
            locked(build.lock(plan), shared=True) as of_build,
            locked(plan.state_folder / f"{name}.lock", wait=wait) as of_task,
        ):
            if not Path(task.file).is_file():
                return TaskOutcome(task.id, "gone")
            with attempted(plan.state_folder, name) as (folder, retries), _scratch(plan, build, folder) as scratch:
                command = ["task", task.file, "--scratch", str(scratch), "--json", *plan.resources]
                report = _run(plan, command, [of_build, of_task], places=(build.folder, str(scratch)))
        state = "was done" if report["was_done"] else "done"
        return TaskOutcome(task.id, state, figures=Figures.of(report["manifest"]), retries=retries)

    return _outcome(task.id, started, work)


def assemble(build: Build, *, wait: bool, plan: BuildPlan) -> TaskOutcome:
    """Write the pack of a build whose tasks are all done, unless it is written, and see to it that the folder is removed.

    Raises and returns as `do`.
    """
    started = time.monotonic()
    check_this_worker(plan)

    def work() -> TaskOutcome:
        with locked(plan.pack_lock, wait=wait) as of_pack, locked(build.lock(plan), wait=wait) as of_build:
            locks = [of_pack, of_build]
            record = finished(plan)
            if record is not None and record.key == build.key:
                pack = record.pack or _verified(plan, locks)
                write_record(plan, replace(record, after=identity(plan.output), pack=pack))
                shutil.rmtree(build.folder, ignore_errors=True)
                return TaskOutcome(ASSEMBLE, "was done", pack=pack)
            if not Path(build.folder).is_dir():
                return TaskOutcome(ASSEMBLE, "gone")
            name = f"{build.key}-{ASSEMBLE}"
            with attempted(plan.state_folder, name) as (folder, retries), _scratch(plan, build, folder) as scratch:
                return replace(_assemble(build, plan, scratch, locks), retries=retries)

    return _outcome(ASSEMBLE, started, work)


def _assemble(build: Build, plan: BuildPlan, scratch: Path, locks: list[int]) -> TaskOutcome:
    clock, cpu = time.monotonic(), _cpu_of_children()
    record = Record(build.key, build.folder, before=identity(plan.output))
    write_record(plan, record)
    force = ["--force"] if plan.force else []
    command = ["assemble", build.folder, "--output", plan.output, "--scratch", str(scratch), "--json", *force, *plan.resources]
    try:
        report = _run(plan, command, locks, places=(build.folder, str(scratch)))
    except program.ProgramKilled:
        _remove_part(Path(plan.output))
        raise
    pack = Pack(sha256(Path(plan.output)), report["pack"]["bytes"], report["triangles"])
    write_record(plan, replace(record, after=identity(plan.output), pack=pack))
    # The folder's removal is the last that kilwa does, and may have been left undone.
    shutil.rmtree(build.folder, ignore_errors=True)
    figures = Figures(time.monotonic() - clock, _cpu_of_children() - cpu, None, pack.bytes)
    return TaskOutcome(ASSEMBLE, "done", figures=figures, pack=pack)


def _outcome(name: str, started: float, work: Any) -> TaskOutcome:
    """Complete the outcome of `work`, and make one of its failure."""
    try:
        outcome: TaskOutcome = work()
    except Busy:
        outcome = TaskOutcome(name, "busy")
    except program.ProgramFailed as failed:
        outcome = TaskOutcome(name, "failed", str(failed))
    except OSError as error:
        raise MachineFailed(f"{error} (on {this_worker()})") from error
    return replace(outcome, worker_seconds=time.monotonic() - started, worker=this_worker())


def _run(plan: BuildPlan, command: list[str], locks: list[int], places: tuple[str, ...]) -> dict[str, Any]:
    """Run kilwa; raise `program.MayPass` if it failed because of something that is not the model's: see `_may_pass`."""
    try:
        return program.run_json(plan.program, command, run=plan.run, locks=locks)
    except program.ProgramKilled as killed:
        raise program.ProgramKilled(f"{killed} (on {this_worker()})") from killed
    except program.ProgramFailed as failed:
        if _may_pass(str(failed), places):
            raise MachineFailed(f"{failed} (on {this_worker()})") from failed
        raise


def _may_pass(message: str, places: tuple[str, ...]) -> bool:
    """Return whether the message names an error of the operating system, or a file that only tasks write."""
    return "(os error " in message or any(place in message for place in places)


def _cpu_of_children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _remove_part(output: Path) -> None:
    """Remove the unfinished pack that a killed `kilwa assemble` leaves beside the output, unless somebody writes it."""
    part = output.with_name(f".{output.name}.part")
    with suppress(OSError), part.open("rb+") as file:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        part.unlink()


# The inode, length and time of modification of a file.
Identity = tuple[int, int, int]


def identity(path: str) -> Identity | None:
    """Return what tells a file from others that had its name before; None if there is no file."""
    try:
        stat = os.stat(path)
    except FileNotFoundError:
        return None
    return stat.st_ino, stat.st_size, stat.st_mtime_ns


@dataclass(frozen=True)
class Record:
    """What is known of the output while and after it is assembled."""

    key: str
    """Key of the build."""
    folder: str
    """Its folder. A record is removed once that is gone and no run is active (`run.sweep`)."""
    before: Identity | None
    """What had the name of the output before."""
    after: Identity | None = None
    pack: Pack | None = None


def read_record(path: Path) -> Record | None:
    """Read a record; None if there is none, or if it is damaged."""
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
        before, after = (tuple(each) if (each := values[name]) else None for name in ("before", "after"))
        pack = Pack(**values["pack"]) if values["pack"] else None
        return Record(values["key"], values["folder"], before, after, pack)
    except (FileNotFoundError, ValueError, TypeError, KeyError):
        return None


def write_record(plan: BuildPlan, record: Record) -> None:
    """Write the record of the output."""
    write_whole(plan.record, json.dumps(asdict(record)) + "\n")


def finished(plan: BuildPlan) -> Record | None:
    """Return the record of the output if its pack is in place. The caller must hold the lock of the pack."""
    record, now = read_record(plan.record), identity(plan.output)
    if record is None or now is None:
        return None
    is_in_place = now == record.after if record.after is not None else now != record.before
    return record if is_in_place else None


def _verified(plan: BuildPlan, locks: list[int]) -> Pack:
    """Describe the pack that a worker put in place just before it died."""
    report = _run(plan, ["verify", plan.output, "--json"], locks, places=())
    return Pack(report["sha256"], report["bytes"], report["triangles"])


@contextmanager
def _scratch(plan: BuildPlan, build: Build, attempt: Path) -> Iterator[Path]:
    """Yield the scratch folder of an attempt: the attempt's own, or one like it in the user's folder on this machine."""
    if plan.scratch is None:
        yield attempt
        return
    above = scratch_of(plan.scratch, build.key)
    task = attempt.name.rsplit(".", 1)[0]
    while True:
        above.mkdir(parents=True, exist_ok=True)
        # What killed attempts left on this machine. The caller holds the lock of the task.
        for old in above.glob(f"{task}.*"):
            shutil.rmtree(old, ignore_errors=True)
        try:
            (above / attempt.name).mkdir()
            break
        except FileNotFoundError:
            continue  # Another worker that ended has just removed the folder above.
    try:
        yield above / attempt.name
    finally:
        shutil.rmtree(above / attempt.name, ignore_errors=True)
        with suppress(OSError):
            above.rmdir()


def scratch_of(scratch: str, key: str) -> Path:
    """Return the folder of a build in the user's folder for scratch files."""
    return Path(scratch, f"kilwa-dask-{key}")


def sweep_scratch(plan: BuildPlan, build: Build, patience: float) -> None:
    """Remove what killed attempts left in the user's scratch folder on this machine.

    Wait for at most `patience` seconds for programs that are being stopped.
    """
    if plan.scratch is None:
        return
    above = scratch_of(plan.scratch, build.key)
    until = time.monotonic() + patience
    while above.is_dir():
        for folder in above.iterdir():
            task = folder.name.rsplit(".", 1)[0]
            with suppress(Busy, FileNotFoundError), locked(plan.state_folder / f"{task}.lock", wait=False):
                shutil.rmtree(folder, ignore_errors=True)
        with suppress(OSError):
            above.rmdir()
        if time.monotonic() > until:
            return
        time.sleep(0.05)
