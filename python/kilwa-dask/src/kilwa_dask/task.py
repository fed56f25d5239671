"""The task for one mesh, which runs in a worker: build, verify, place and publish, each only if not yet done.

Whichever process is killed, the output has either the old pack or the new one:

* The task holds the lock of its mesh (`files.locked`) and shares it with the kilwa that it starts. So no second driver,
  other worker or orphaned kilwa can process the mesh at the same time.
* kilwa builds into a folder of its own for each attempt, OUT/.kilwa-dask/ID.N. Only the task renames the pack to its final
  name; an orphan cannot. The next attempt removes the folder.
* The manifest is written after the pack is renamed. A pack with a different manifest, or with none, is not done. Building
  it again gives the same bytes.
* `kilwa publish` adds nothing if the same pack is already published.
"""

from __future__ import annotations

import errno
import os
import time
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from kilwa_dask import manifest, program
from kilwa_dask.collection import Mesh, companions
from kilwa_dask.files import Busy, locked, sha256, sha256_once, sync_folder
from kilwa_dask.manifest import Manifest, key_of
from kilwa_dask.run import STATE, Run, attempted, check_this_worker, file_id


@dataclass(frozen=True)
class Plan(Run):
    """The settings of a run of `build-all`; the output is the only shared folder."""

    options: tuple[str, ...] = ()
    """Options of `kilwa build` that affect the pack."""
    publish: str | None = None
    publish_options: tuple[str, ...] = ()
    report: str | None = None
    """The file that the driver writes at the end."""

    @property
    def output(self) -> str:
        """Folder of the packs."""
        return self.shared[0]

    def written(self) -> list[Path]:
        """List the files and folders that runs write, as real paths."""
        folders = [self.output, self.publish if self.publish is not None and "://" not in self.publish else None, self.report]
        return [Path(path).resolve() for path in folders if path is not None]


@dataclass(frozen=True)
class Outcome:
    """The outcome of one mesh."""

    name: str
    state: str
    """"built", "published" (built earlier), "already done", "failed", or "busy": another process is working on it."""
    stage: str | None = None
    """Where it failed: "check", "build", "verify", "place" or "publish"."""
    message: str | None = None
    seconds: dict[str, float] = field(default_factory=dict)
    input_bytes: int = 0
    pack_bytes: int = 0
    pack_sha256: str | None = None
    triangles: int = 0
    retries: int = 0
    """Earlier attempts at this mesh that were interrupted, in this run or before."""
    publication: dict[str, Any] | None = None
    worker: str = ""


class StageFailed(Exception):
    """A stage failed, and trying again would not help."""

    def __init__(self, stage: str, message: str) -> None:
        """Store the stage and the message."""
        super().__init__(stage, message)
        self.stage = stage
        self.message = message


def work_on(mesh: Mesh, plan: Plan, wait: bool = True) -> Outcome:
    """Do what is not done yet for a mesh. Failures that trying again cannot help are outcomes, others are raised.

    Raises `WorkerRefused` before anything is done if this worker cannot take part; that says nothing about the mesh. If
    somebody else works on it, wait for them, or return "busy" if `wait` is false.
    """
    attempt = _Attempt(mesh, plan)
    try:
        attempt.work(wait)
    except Busy:
        return attempt.outcome("busy")
    except StageFailed as failed:
        return attempt.outcome("failed", failed.stage, failed.message)
    except program.ProgramFailed as failed:
        return attempt.outcome("failed", attempt.stage, str(failed))
    except OSError as error:
        full = " (the disk is full)" if error.errno in (errno.ENOSPC, errno.EDQUOT) else ""
        return attempt.outcome("failed", attempt.stage, f"{error}{full}")
    return attempt.outcome(attempt.state)


class _Attempt:
    """One attempt at one mesh."""

    def __init__(self, mesh: Mesh, plan: Plan) -> None:
        self.mesh = mesh
        self.plan = plan
        self.pack = Path(plan.output, mesh.name + ".kilwa")
        self.manifest_path = self.pack.with_name(self.pack.name + ".json")
        self.state_folder = Path(plan.output, STATE)
        self.id = file_id(mesh.name)
        self.stage = "check"
        self.state = "already done"
        self.seconds: dict[str, float] = {}
        self.retries = 0
        self.manifest: Manifest | None = None

    def work(self, wait: bool) -> None:
        """Take the lock and do everything. Raises `Busy` if somebody else has it and `wait` is false."""
        started = time.monotonic()
        check_this_worker(self.plan)
        with locked(self.state_folder / f"{self.id}.lock", wait=wait) as lock, attempted(self.state_folder, self.id) as attempt:
            folder, self.retries = attempt
            self._work_in(folder, lock, started)

    def _work_in(self, folder: Path, lock: int, started: float) -> None:
        earlier = manifest.read(self.manifest_path)
        beside, named = self._files_beside(), self._option_files()
        before = _states([Path(self.mesh.path), *beside, *named])
        key = self._key(beside, named)
        is_built = earlier is not None and earlier.key == key and earlier.describes(self.pack)
        self.seconds["check"] = round(time.monotonic() - started, 3)
        if is_built:
            self.manifest = earlier
        else:
            self.manifest = self._build(folder, lock, key, before, replace_pack=earlier is not None)
            self.manifest.write(self.manifest_path, folder)
            self.state = "built"
        if self.plan.publish is not None and self.manifest is not None:
            self._publish(self.plan.publish, lock, folder, self.manifest)

    def _files_beside(self) -> list[Path]:
        """List the files beside the mesh that may shape its pack: those that it may name, and its own matrix."""
        path = Path(self.mesh.path)
        found = companions(path, self.plan.written())
        matrix = path.with_suffix(".xf")
        has_own_matrix = "auto" in self.plan.options and matrix.is_file()
        return sorted({*found, matrix}) if has_own_matrix else found

    def _option_files(self) -> list[Path]:
        return [Path(option) for option in self.plan.options if os.path.isabs(option) and os.path.isfile(option)]

    def _key(self, beside: list[Path], named: list[Path]) -> str:
        """Return the key of the pack: a hash of the version, the options and the contents of all inputs."""
        path = Path(self.mesh.path)
        return key_of(
            version=self.plan.version,
            options=self.plan.options,
            option_files={str(file): sha256_once(file) for file in named},
            # The pack stores the file's name, and the name can affect how the file is read.
            input=[path.name, sha256(path)],
            companions={file.relative_to(path.parent).as_posix(): sha256_once(file) for file in beside},
        )

    def _build(self, folder: Path, lock: int, key: str, before: _States, *, replace_pack: bool) -> Manifest:
        pack = folder / self.pack.name
        options = [*self.plan.options, *self.plan.resources]
        built = self._run("build", ["build", self.mesh.path, "--output", str(pack), "--json", *options], lock)
        verified = self._run("verify", ["verify", str(pack), "--json"], lock)
        self.stage = "place"
        after = _states(before)
        changed = [str(path) for path in before if before[path] != after[path]]
        if changed:
            raise StageFailed("place", f"changed while the pack was built: {', '.join(changed[:3])}; run the command again")
        digest = str(verified["sha256"])
        self.pack.parent.mkdir(parents=True, exist_ok=True)
        if self.pack.exists() and not replace_pack and sha256(self.pack) != digest:
            raise StageFailed(
                "place", f"{self.pack} already exists, differs from this pack and has no manifest; move it away or delete it"
            )
        pack.replace(self.pack)
        sync_folder(self.pack.parent)
        return Manifest(
            key=key,
            kilwa=self.plan.version,
            input=self.mesh.path,
            input_bytes=Path(self.mesh.path).stat().st_size,
            pack_bytes=self.pack.stat().st_size,
            pack_sha256=digest,
            triangles=int(built["triangles"]),
            finished=datetime.now(timezone.utc).isoformat(timespec="seconds"),
            seconds=dict(self.seconds),
        )

    def _publish(self, to: str, lock: int, folder: Path, built: Manifest) -> None:
        self.stage = "publish"
        metadata = Path(self.mesh.metadata or "")
        if not metadata.is_file():
            raise StageFailed("publish", f"its metadata file {metadata} does not exist; create it with `kilwa metadata init`")
        key = key_of(
            version=self.plan.version,
            pack=built.pack_sha256,
            metadata=sha256(metadata),
            to=to,
            options=self.plan.publish_options,
        )
        known = built.publication
        if known is not None and known.get("key") == key and _is_published(to, str(known.get("slug"))):
            return
        command = ["publish", str(self.pack), "--to", to, "--metadata", str(metadata), "--json"]
        report = self._run("publish", [*command, *self.plan.publish_options], lock)
        publication = {"key": key, "to": to, "slug": report.get("slug"), "version": report.get("version")}
        seconds = {**built.seconds, "publish": self.seconds["publish"]}
        self.manifest = replace(built, publication=publication, seconds=seconds)
        self.manifest.write(self.manifest_path, folder)
        if self.state == "already done":
            self.state = "published"

    def _run(self, stage: str, arguments: list[str], lock: int) -> dict[str, Any]:
        self.stage = stage
        started = time.monotonic()
        try:
            return program.run_json(self.plan.program, arguments, run=self.plan.run, locks=[lock])
        finally:
            self.seconds[stage] = round(time.monotonic() - started, 3)

    def outcome(self, state: str, stage: str | None = None, message: str | None = None) -> Outcome:
        """Describe how this attempt ended."""
        known = self.manifest
        return Outcome(
            name=self.mesh.name,
            state=state,
            stage=stage,
            message=message,
            seconds={name: round(value, 3) for name, value in self.seconds.items()},
            input_bytes=self.mesh.bytes,
            pack_bytes=known.pack_bytes if known else 0,
            pack_sha256=known.pack_sha256 if known else None,
            triangles=known.triangles if known else 0,
            retries=self.retries,
            publication=known.publication if known else None,
            worker=f"{program.host()}, process {os.getpid()}",
        )


# Of each file its size and time of modification in nanoseconds; None if it is not there.
_States = dict[Path, tuple[int, int] | None]


def _states(paths: Iterable[Path]) -> _States:
    states: _States = {}
    for path in paths:
        try:
            stat = path.stat()
            states[path] = (stat.st_size, stat.st_mtime_ns)
        except FileNotFoundError:
            states[path] = None
    return states


def _is_published(to: str, slug: str) -> bool:
    """Return whether the object is still in its folder; servers and stores are not queried."""
    return "://" in to or Path(to, slug, "manifest.json").is_file()
