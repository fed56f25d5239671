"""One build that is divided into tasks: what the driver does. It asks kilwa which tasks are open, and has them done."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, NoReturn

from distributed import Client

from kilwa_dask import divided, program
from kilwa_dask.build_report import BuildReport, line
from kilwa_dask.collection import UsageError
from kilwa_dask.divided import ASSEMBLE, Build, BuildPlan, Figures, Pack, Task, TaskOutcome
from kilwa_dask.drive import Lost, Progress, submit
from kilwa_dask.files import locked
from kilwa_dask.run import is_address

# How long the driver waits until it sees in the shared folder what workers on other machines have written, in seconds: NFS
# may keep the names of a folder for a minute.
_UNSEEN_LIMIT = 180.0
_PAUSE = 0.2


class BuildFailed(Exception):
    """The build cannot go on; the text names the task, its place on the model, the worker and the reason."""


@dataclass(frozen=True)
class Listing:
    """The tasks of a build."""

    build: Build
    tasks: Sequence[Task]
    complete: bool
    """Nothing is left but to assemble the pack, if that is not done as well."""
    pack: Pack | None = None
    """The pack, if it is already in a store."""

    def wave(self) -> dict[str, Task]:
        """Return the tasks that can be done now, the largest first."""
        opened = [task for task in self.tasks if not task.done]
        first = min((task.wave for task in opened), default=0)
        ordered = sorted((task for task in opened if task.wave == first), key=lambda task: (-(task.triangles or 0), task.id))
        return {task.id: task for task in ordered}


class BuildDriver:
    """Drives one build from its plan to its pack."""

    def __init__(self, plan: BuildPlan, report: BuildReport) -> None:
        """Prepare; what becomes of the tasks is added to the report."""
        self.plan = plan
        self.report = report
        self.build: Build | None = None
        self._progress: Progress | None = None
        self._listed = 0
        self._gone = False
        self._gone_since: float | None = None

    def begin(self) -> None:
        """Plan the build. Raises `UsageError` if the output exists, or `program.ProgramFailed` if kilwa refuses."""
        self._list()

    def drive(self, client: Client) -> None:
        """Do all tasks that are open, then assemble the pack. Raises `BuildFailed`, and `WorkerRefused` as `drive.submit`."""
        while self.report.pack is None:
            self._gone = False
            listing = self._list()
            if listing.pack is not None:
                self._take(ASSEMBLE, TaskOutcome(ASSEMBLE, "was done", pack=listing.pack, worker=divided.this_worker()))
            elif listing.complete:
                submit(client, {ASSEMBLE: listing.build}, partial(divided.assemble, plan=self.plan), self.plan.run, self._take)
            else:
                wave = self._seen(listing)
                progress = self._show(listing)
                take = partial(self._take, of=wave, progress=progress)
                submit(client, wave, partial(divided.do, build=listing.build, plan=self.plan), self.plan.run, take)
            self._limit_gone(listing.build)

    def _limit_gone(self, build: Build) -> None:
        """Look again after a while if a worker did not find the folder of the build, but not for ever."""
        if not self._gone:
            self._gone_since = None
            return
        now = time.monotonic()
        self._gone_since = self._gone_since or now
        if now - self._gone_since > _UNSEEN_LIMIT:
            raise BuildFailed(f"workers do not see {build.folder}, which this computer sees")
        time.sleep(_PAUSE)

    def sweep_scratch(self, client: Client, patience: float) -> None:
        """Remove what killed attempts left in the user's scratch folder on the machines of the workers."""
        if self.build is None or self.plan.scratch is None:
            return
        with suppress(Exception):  # The scheduler may be gone.
            client.run(divided.sweep_scratch, self.plan, self.build, patience, on_error="ignore")

    def sweep_state(self, client: Client) -> None:
        """Remove the folders of the locks on the workers' machines, if each machine has its own."""
        if is_address(self.plan.work):
            with suppress(Exception):  # The scheduler may be gone.
                client.run(divided.sweep_state, self.plan, on_error="ignore")

    def _list(self) -> Listing:
        """Ask kilwa for the tasks. Nobody assembles the pack and removes the folder of the build meanwhile."""
        with ExitStack() as held:
            locks = [held.enter_context(locked(self.plan.pack_lock))]
            if self.build is not None:
                locks.append(held.enter_context(locked(self.build.lock(self.plan), shared=True)))
            record = divided.finished(self.plan)
            if record is not None and self.build is not None and record.key == self.build.key:
                return Listing(self.build, (), complete=True)
            # There is no record if the pack or the work is in a store. Then a file that appears belongs to another driver.
            if (self.build is None or self.plan.is_stored) and record is None:
                self._refuse_existing()
            is_first = self.build is None and not self.plan.is_stored
            before = set(Path(self.plan.work).glob("kilwa-build-*")) if is_first else set()
            listing = self._plan(locks)
            if self.build is None and record is not None:
                if record.key == listing.build.key:
                    self.build, self.report.key = listing.build, listing.build.key
                    return Listing(listing.build, (), complete=True)
                if not self.plan.force and Path(listing.build.folder) not in before:
                    _forget(Path(listing.build.folder))
                self._refuse_existing()
            self.build = listing.build
            self.report.add_earlier(listing.build, [task for task in listing.tasks if task.done], _figures)
            return listing

    def _refuse_existing(self) -> None:
        refuse_existing(self.plan.output, self.plan.force)

    def _plan(self, locks: list[int]) -> Listing:
        return listing_of(program.run_json(self.plan.program, list(self.plan.arguments), run=self.plan.run, locks=locks))

    def _seen(self, listing: Listing) -> dict[str, Task]:
        """Return the open tasks; wait until the driver sees that those are done of which workers say so."""
        wave = listing.wave()
        until = time.monotonic() + _UNSEEN_LIMIT
        while wave and all(name in self.report.done for name in wave):
            if time.monotonic() > until:
                names = ", ".join(list(wave)[:3])
                raise BuildFailed(f"{names}: done, but this computer does not see the result in {listing.build.folder}")
            time.sleep(_PAUSE)
            wave = self._list().wave()
        return wave

    def _show(self, listing: Listing) -> Progress:
        """Begin to show progress, again once all tasks are known, and leave out what other drivers have done meanwhile."""
        opened = {task.id: task.triangles or 0 for task in listing.tasks if not task.done}
        if self._progress is None or len(listing.tasks) != self._listed:
            self._progress, self._listed = Progress(opened), len(listing.tasks)
        self._progress.keep(opened)
        return self._progress

    def _take(
        self,
        name: str,
        became: TaskOutcome | Lost,
        of: Mapping[str, Task] = MappingProxyType({}),
        progress: Progress | None = None,
    ) -> None:
        title = of[name].title if name in of else f"the assembly of {self.plan.output}"
        if isinstance(became, Lost):
            self._fail(title, became.message)
        if became.state == "failed":
            self._fail(title, f"{became.message} (on {became.worker})")
        if became.state == "gone":
            # Another driver has assembled the pack, and the next look at the tasks shows it.
            self._gone = True
            return
        self.report.add(became)
        if progress is not None:
            progress.add(name, line(became), failed=False)

    def _fail(self, title: str, message: str) -> NoReturn:
        # kilwa's own messages have the name of the task and its place.
        self.report.failure = message if title in message else f"{title}: {message}"
        raise BuildFailed(self.report.failure)


def refuse_existing(output: str, force: bool) -> None:
    """Raise `UsageError` if a file exists that must not be replaced. For objects in stores, kilwa checks this."""
    if not force and not is_address(output) and Path(output).exists():
        raise UsageError(f"{output} exists already; use --force to replace it")


def listing_of(told: dict[str, Any]) -> Listing:
    """Read what `kilwa plan --json` prints. Raises `program.ProgramFailed` if it is something else."""
    try:
        tasks = [
            Task(
                id=each["id"],
                file=each["file"],
                done=each["done"],
                wave=each["wave"],
                triangles=each["triangles"],
                near=tuple(each["near"]) if each["near"] is not None else None,
            )
            for each in told["tasks"]
        ]
        made = told.get("pack")
        pack = Pack(made["sha256"], made["bytes"], made["triangles"]) if made is not None else None
        return Listing(Build(told["build"], told["key"]), tasks, told["complete"], pack)
    except (KeyError, TypeError) as error:
        raise program.ProgramFailed(f"kilwa plan printed no list of tasks ({error!r})") from error


def _figures(build: Build, task: Task) -> Figures:
    """Read what a task that was done earlier has cost; its manifest may be gone, or damaged."""
    try:
        # A line of JSON, then its checksum.
        sealed = Path(build.folder, "done", f"{task.id}.json").read_text(encoding="utf-8")
        return Figures.of(json.loads(sealed.rsplit(" ", 1)[0]))
    except (OSError, ValueError, AttributeError):
        return Figures()


def _forget(folder: Path) -> None:
    """Remove the folder of a build that has just been planned, and of which nothing is done."""
    for name in ("tasks/ingest.json", "tasks", "plan.json", "."):
        path = folder / name
        path.rmdir() if path.is_dir() else path.unlink(missing_ok=True)
