"""The report of one build that was divided into tasks, as text for people and as JSON for programs."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from kilwa_dask.divided import ASSEMBLE, Build, BuildPlan, Figures, Pack, Task, TaskOutcome, stage_of
from kilwa_dask.files import write_whole
from kilwa_dask.report import duration, size


@dataclass
class Stage:
    """The sums over the tasks of a stage. None: not known for any of them."""

    tasks: int = 0
    earlier: int = 0
    """Tasks that were done before this run, or by another one; they are counted in the sums."""
    seconds: float = 0.0
    cpu_seconds: float | None = None
    bytes_read: int | None = None
    bytes_written: int | None = None
    worker_seconds: float = 0.0
    """How long workers were occupied in this run, starts of kilwa included."""
    longest_seconds: float = 0.0
    retries: int = 0

    def add(self, figures: Figures) -> None:
        """Add what a task has cost."""
        self.tasks += 1
        self.seconds += figures.seconds
        self.longest_seconds = max(self.longest_seconds, figures.seconds)
        for name in ("cpu_seconds", "bytes_read", "bytes_written"):
            more = getattr(figures, name)
            if more is not None:
                setattr(self, name, (getattr(self, name) or 0) + more)

    def as_json(self) -> dict[str, Any]:
        """Return the sums, with times to the millisecond."""
        return {name: round(value, 3) if isinstance(value, float) else value for name, value in vars(self).items()}


@dataclass
class BuildReport:
    """What has become of a build."""

    stages: dict[str, Stage] = field(default_factory=dict)
    done: set[str] = field(default_factory=set)
    """Names of the tasks that are done."""
    outcomes: list[TaskOutcome] = field(default_factory=list)
    """Those of this run."""
    key: str | None = None
    failure: str | None = None
    pack: Pack | None = None

    def add(self, outcome: TaskOutcome) -> None:
        """Add a task that is done."""
        if outcome.name in self.done:
            return
        self.done.add(outcome.name)
        self.outcomes.append(outcome)
        stage = self._stage(outcome.name)
        stage.add(outcome.figures)
        stage.earlier += outcome.state == "was done"
        stage.worker_seconds += outcome.worker_seconds
        stage.retries += outcome.retries
        if outcome.name == ASSEMBLE:
            self.pack = outcome.pack

    def add_earlier(self, build: Build, tasks: Iterable[Task], figures: Callable[[Build, Task], Figures]) -> None:
        """Add tasks that are done and not known yet: an earlier run, or another one, has done them."""
        self.key = build.key
        for task in tasks:
            if task.id not in self.done:
                self.done.add(task.id)
                stage = self._stage(task.id)
                stage.add(figures(build, task))
                stage.earlier += 1

    def _stage(self, task: str) -> Stage:
        return self.stages.setdefault(stage_of(task), Stage())

    def ordered(self) -> list[tuple[str, Stage]]:
        """Return the stages in the order in which they are done; levels from the finest on."""
        order = ["ingest", "region", "tree", "leaves", "level", "tail", ASSEMBLE]
        names = sorted(self.stages, reverse=True)
        return [(name, self.stages[name]) for name in sorted(names, key=lambda name: order.index(name.split("-")[0]))]

    def total(self) -> Stage:
        """Return the sums over all stages."""
        total = Stage()
        for stage in self.stages.values():
            for name, value in vars(stage).items():
                if name == "longest_seconds":
                    total.longest_seconds = max(total.longest_seconds, value)
                elif value is not None:
                    setattr(total, name, (getattr(total, name) or 0) + value)
        return total


def line(outcome: TaskOutcome) -> str:
    """Describe a task that is done in one line."""
    retried = f", earlier interrupted attempts: {outcome.retries}" if outcome.retries else ""
    if outcome.state == "was done":
        return f"{outcome.name}: already done{retried}"
    figures = outcome.figures
    sizes = f", {size(figures.bytes_read or 0)} read, {size(figures.bytes_written or 0)} written"
    return f"{outcome.name}: {duration(figures.seconds)}{sizes}{retried}"


def summary(report: BuildReport, plan: BuildPlan, seconds: float) -> str:
    """Describe a build whose pack is complete."""
    pack, total = report.pack, report.total()
    lines = []
    if pack is not None:
        lines.append(f"{plan.output}: {pack.triangles:,} triangles, {size(pack.bytes)}, in {duration(seconds)}")
        lines.append(f"SHA-256 {pack.sha256}")
    lines.append(
        f"{'stage':<10}{'tasks':>7}{'earlier':>9}{'time':>13}{'longest':>12}{'processor':>13}{'read':>11}{'written':>11}{'retries':>9}"
    )
    for name, stage in [*report.ordered(), ("total", total)]:
        cpu = "-" if stage.cpu_seconds is None else duration(stage.cpu_seconds)
        read, written = ("-" if each is None else size(each) for each in (stage.bytes_read, stage.bytes_written))
        lines.append(
            f"{name:<10}{stage.tasks:>7}{stage.earlier:>9}{duration(stage.seconds):>13}{duration(stage.longest_seconds):>12}"
            f"{cpu:>13}{read:>11}{written:>11}{stage.retries:>9}"
        )
    return "\n".join(lines)


def write(path: Path, plan: BuildPlan, report: BuildReport, seconds: float) -> None:
    """Write the report as JSON, atomically."""
    tasks = sorted(report.outcomes, key=lambda outcome: outcome.name)
    told = {
        "format": 1,
        "kilwa": plan.version,
        "output": plan.output,
        "key": report.key,
        "plan": list(plan.arguments),
        "seconds": round(seconds, 3),
        "stopped": report.pack is None,
        "failure": report.failure,
        "pack": vars(report.pack) if report.pack is not None else None,
        "stages": [{"stage": name, **stage.as_json()} for name, stage in report.ordered()],
        "total": report.total().as_json(),
        "tasks": [
            {
                "task": task.name,
                "state": task.state,
                "seconds": round(task.figures.seconds, 3),
                "worker_seconds": round(task.worker_seconds, 3),
                "retries": task.retries,
                "worker": task.worker,
            }
            for task in tasks
        ],
    }
    write_whole(path, json.dumps(told, indent=2) + "\n")
