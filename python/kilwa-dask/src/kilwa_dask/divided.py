"""One build that is divided into tasks: what a worker does.

The driver asks `kilwa plan` which tasks there are (`drive_build`); a worker does one with `kilwa task`, or writes the pack
with `kilwa assemble`. kilwa itself ensures that a task may run twice or be killed at any moment. The locks ensure that no
task runs twice at the same time, and that nobody works in a folder that is being removed:

* WORK/.kilwa-dask/KEY-TASK.lock is held by the worker that does a task of the build KEY, and by its kilwa.
* WORK/.kilwa-dask/KEY.lock is shared by all workers that do tasks of the build; whoever removes its folder holds it exclusively.
* .kilwa-dask/PACK.lock, next to the output, is held while the pack is assembled, and while a driver checks whether it is.

If the work is in an object store (s3://…), there is no shared folder for locks. Then each machine has its own folder, whose locks
coordinate only the workers of that machine; across machines, kilwa alone resolves conflicts.

The pack is assembled in .kilwa-dask/PACK.N, then described in WORK/.kilwa-dask/PACK.json, then renamed; the folder of the
build is removed last. So a run that continues after a crash knows whether an existing file is the pack. If the work or the
output is in a store, kilwa itself puts the pack in place and removes the build; the metadata of a pack in a store name the build.
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from kilwa_dask import program
from kilwa_dask.files import Busy, locked, sha256, sync_folder, write_whole
from kilwa_dask.run import STATE, Run, attempted, check_this_worker, file_id, is_address, sweep

ASSEMBLE = "assemble"
"""Name of the last task, which is not in kilwa's list."""


@dataclass(frozen=True)
class BuildPlan(Run):
    """The settings of a run of `build`. The folders of the work and of the output are shared, unless they are in a store."""

    arguments: tuple[str, ...]
    """Arguments of kilwa that list the tasks."""
    work: str
    """A folder, or an address."""
    output: str
    """A file, or an address."""
    force: bool = False
    scratch: str | None = None
    """Folder for scratch files on each machine, if not in the folder of the work."""

    @property
    def is_stored(self) -> bool:
        """Whether the work or the output is in a store."""
        return is_address(self.work) or is_address(self.output)

    @property
    def base(self) -> Path:
        """Parent of the folder of the locks: the work folder, or a local folder."""
        if not is_address(self.work):
            return Path(self.work)
        return Path(self.scratch or tempfile.gettempdir(), f"kilwa-dask-{os.getuid()}-{file_id(self.work)}")

    @property
    def announced_in(self) -> tuple[str, ...]:
        """Folders in which the run is announced: the shared ones, and the one with the locks."""
        return tuple(dict.fromkeys((str(self.base), *self.shared)))

    @property
    def state_folder(self) -> Path:
        """Folder of the locks."""
        return self.base / STATE

    @property
    def pack_lock(self) -> Path:
        """Lock of the output."""
        state = self.state_folder if is_address(self.output) else Path(self.output).parent / STATE
        return state / f"{file_id(self.output)}.lock"

    @property
    def record(self) -> Path:
        """What is known of the pack that was put in place."""
        return self.state_folder / f"{file_id(self.output)}.json"


@dataclass(frozen=True)
class Build:
    """A build, as `kilwa plan` names it."""

    folder: str
    """A folder, or an address."""
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
        """Return `ingest`, `region`, `tree`, `leaves`, `level-07` or `tail`."""
        return stage_of(self.id)

    @property
    def title(self) -> str:
        """Return its name and its place on the model, as kilwa's messages have them."""
        if self.near is None:
            return f"the task {self.id}"
        x, y, z = self.near
        return f"the task {self.id} (near {x:.2f}, {y:.2f}, {z:.2f} m)"


def stage_of(task: str) -> str:
    """Return the stage of a task: its name without the number of the region or shard."""
    return task.rsplit("-", 1)[0] if "-" in task else task


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


# Messages of kilwa if a build was removed because another driver has assembled its pack.
_GONE = ("is not in the store; run `kilwa plan` again", "there is no build; start one", "there is nothing left to do")


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


class Gone(Exception):
    """The build was removed, because another driver has assembled its pack."""


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
    make_state(plan)
    name = f"{build.key}-{task.id}"

    def work() -> TaskOutcome:
        with (
            locked(build.lock(plan), shared=True) as of_build,
            locked(plan.state_folder / f"{name}.lock", wait=wait) as of_task,
        ):
            if not is_address(task.file) and not Path(task.file).is_file():
                return TaskOutcome(task.id, "gone")
            with attempted(plan.state_folder, name) as (folder, retries), _scratch(plan, build, folder, name) as scratch:
                command = ["task", task.file, "--scratch", str(scratch), "--json", *plan.resources]
                report = _run(plan, command, [of_build, of_task], places=(build.folder, str(scratch)))
        state = "was done" if report["already_done"] else "done"
        return TaskOutcome(task.id, state, figures=Figures.of(report["manifest"]), retries=retries)

    return _outcome(task.id, started, work)


def assemble(build: Build, *, wait: bool, plan: BuildPlan) -> TaskOutcome:
    """Write the pack of a build whose tasks are all done, unless it is written, and see to it that the folder is removed.

    Raises and returns as `do`.
    """
    started = time.monotonic()
    check_this_worker(plan)
    make_state(plan)

    def work() -> TaskOutcome:
        with locked(plan.pack_lock, wait=wait) as of_pack, locked(build.lock(plan), wait=wait) as of_build:
            record = finished(plan)
            if record is not None and record.key == build.key:
                shutil.rmtree(build.folder, ignore_errors=True)
                return TaskOutcome(ASSEMBLE, "was done", pack=record.pack)
            if not is_address(build.folder) and not Path(build.folder).is_dir():
                return TaskOutcome(ASSEMBLE, "gone")
            with attempted(plan.pack_lock.parent, plan.pack_lock.stem) as (folder, retries):
                with _scratch(plan, build, folder, f"{build.key}-{ASSEMBLE}") as scratch:
                    outcome = _assemble(build, plan, folder, scratch, [of_pack, of_build])
                return replace(outcome, retries=retries)

    return _outcome(ASSEMBLE, started, work)


def _assemble(build: Build, plan: BuildPlan, folder: Path, scratch: Path, locks: list[int]) -> TaskOutcome:
    clock, cpu = time.monotonic(), _cpu_of_children()
    if plan.is_stored:
        return _assemble_stored(build, plan, scratch, locks)
    output = Path(plan.output)
    made = folder / output.name
    command = ["assemble", build.folder, "--output", str(made), "--keep", "--scratch", str(scratch), "--json", *plan.resources]
    report = _run(plan, command, locks, places=(build.folder, str(folder), str(scratch)))
    pack = Pack(sha256(made), report["pack"]["bytes"], report["triangles"])
    if output.exists() and not plan.force:
        raise program.ProgramFailed(f"{output} has appeared meanwhile; move it away or use --force")
    record = Record(build.key, build.folder, identity(made), pack)
    write_whole(plan.record, json.dumps(asdict(record)) + "\n")
    made.replace(output)
    sync_folder(output.parent)
    shutil.rmtree(build.folder, ignore_errors=True)
    figures = Figures(time.monotonic() - clock, _cpu_of_children() - cpu, None, pack.bytes)
    return TaskOutcome(ASSEMBLE, "done", figures=figures, pack=pack)


def _assemble_stored(build: Build, plan: BuildPlan, scratch: Path, locks: list[int]) -> TaskOutcome:
    """Have kilwa put the pack in place and remove the build."""
    clock, cpu = time.monotonic(), _cpu_of_children()
    force = ["--force"] if plan.force else []
    command = ["assemble", build.folder, "--output", plan.output, *force, "--scratch", str(scratch), "--json", *plan.resources]
    report = _run(plan, command, locks, places=(build.folder, str(scratch)))
    pack = Pack(report["sha256"], report["pack"]["bytes"], report["triangles"])
    if report.get("already_done", False):
        # An earlier attempt was killed when the pack was in place.
        return TaskOutcome(ASSEMBLE, "was done", pack=pack)
    figures = Figures(time.monotonic() - clock, _cpu_of_children() - cpu, None, pack.bytes)
    return TaskOutcome(ASSEMBLE, "done", figures=figures, pack=pack)


def make_state(plan: BuildPlan) -> None:
    """Make the folder of the locks, if it is local. Only this user may use it, because all users share the temporary folder."""
    if not is_address(plan.work):
        return
    plan.base.mkdir(mode=0o700, parents=True, exist_ok=True)
    if plan.base.stat().st_uid != os.getuid():
        raise OSError(f"{plan.base} belongs to another user; remove it, or use --scratch DIR")
    plan.state_folder.mkdir(exist_ok=True)


def _outcome(name: str, started: float, work: Any) -> TaskOutcome:
    """Complete the outcome of `work`, and make one of its failure."""
    try:
        outcome: TaskOutcome = work()
    except Busy:
        outcome = TaskOutcome(name, "busy")
    except Gone:
        outcome = TaskOutcome(name, "gone")
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
        if plan.is_stored and any(text in str(failed) for text in _GONE):
            raise Gone from failed
        if _may_pass(str(failed), places):
            raise MachineFailed(f"{failed} (on {this_worker()})") from failed
        raise


def _may_pass(message: str, places: tuple[str, ...]) -> bool:
    """Return whether the message is about an error of the operating system or a store, or about a file that only tasks write."""
    return "(os error " in message or "check AWS_ENDPOINT_URL" in message or any(place in message for place in places)


def _cpu_of_children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


# The inode, length and time of modification of a file.
Identity = tuple[int, ...]


def identity(path: Path) -> Identity:
    """Return what tells a file from others that had or get its name; it stays the same when the file is renamed."""
    stat = path.stat()
    return stat.st_ino, stat.st_size, stat.st_mtime_ns


@dataclass(frozen=True)
class Record:
    """A pack that was put in place, or was about to be."""

    key: str
    """Key of the build."""
    folder: str
    """Its folder. A record is removed once that is gone and no run is active (`run.sweep`)."""
    identity: Identity
    pack: Pack


def finished(plan: BuildPlan) -> Record | None:
    """Return the record of the output if its pack is in place. The caller must hold the lock of the pack.

    There is no record if the work or the output is in a store.
    """
    if plan.is_stored:
        return None
    try:
        values = json.loads(plan.record.read_text(encoding="utf-8"))
        record = Record(values["key"], values["folder"], tuple(values["identity"]), Pack(**values["pack"]))
        return record if identity(Path(plan.output)) == record.identity else None
    except (FileNotFoundError, ValueError, TypeError, KeyError):
        return None


@contextmanager
def _scratch(plan: BuildPlan, build: Build, attempt: Path, task: str) -> Iterator[Path]:
    """Yield the scratch folder of an attempt: the attempt's own, or one in the user's folder on this machine.

    The caller must hold the lock of the task.
    """
    if plan.scratch is None:
        yield attempt
        return
    above = scratch_of(plan.scratch, build.key)
    mine = above / f"{task}{attempt.suffix}"
    while True:
        above.mkdir(parents=True, exist_ok=True)
        # What killed attempts left on this machine.
        for old in above.glob(f"{task}.*"):
            shutil.rmtree(old, ignore_errors=True)
        try:
            mine.mkdir()
            break
        except FileNotFoundError:
            continue  # Another worker that ended has just removed the folder above.
    try:
        yield mine
    finally:
        shutil.rmtree(mine, ignore_errors=True)
        with suppress(OSError):
            above.rmdir()


def sweep_state(plan: BuildPlan) -> None:
    """Remove the local folder of the locks, unless it is in use."""
    sweep(plan.base)
    remove_base(plan)


def remove_base(plan: BuildPlan) -> None:
    """Remove the local parent of the folder of the locks, if it is empty."""
    if is_address(plan.work):
        with suppress(OSError):
            plan.base.rmdir()


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
            lock = plan.pack_lock if task.endswith(f"-{ASSEMBLE}") else plan.state_folder / f"{task}.lock"
            with suppress(Busy, FileNotFoundError), locked(lock, wait=False):
                shutil.rmtree(folder, ignore_errors=True)
        with suppress(OSError):
            above.rmdir()
        if time.monotonic() > until:
            return
        time.sleep(0.05)
