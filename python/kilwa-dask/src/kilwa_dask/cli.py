"""The command line of kilwa-dask."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import time
import uuid
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn

from kilwa_dask import __version__, build_report, clusters, collection, program, report
from kilwa_dask.build_report import BuildReport
from kilwa_dask.clusters import Choice, ClusterFailed
from kilwa_dask.collection import Mesh, UsageError
from kilwa_dask.divided import BuildPlan, make_state, remove_base, sweep_scratch
from kilwa_dask.drive import check_workers, drive
from kilwa_dask.drive_build import BuildDriver, BuildFailed, refuse_existing
from kilwa_dask.run import WorkerRefused, announced, is_address, sweep
from kilwa_dask.task import Outcome, Plan

# Options of kilwa that kilwa-dask sets itself.
_OWN_OPTIONS = ("-o", "--output", "--json", "--force", "--resume", "--scratch", "--threads", "--memory", "--verbose")
# Those that a collection cannot have, and those of `kilwa plan`.
_NOT_FOR_ALL = (*_OWN_OPTIONS, "--title")
_NOT_FOR_ONE = (*_OWN_OPTIONS, "--work", "--task-triangles")
# How long to wait for a stopped kilwa to exit, in seconds.
_PATIENCE = 10.0


class Ended(Exception):
    """SIGTERM arrived."""


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    top = argparse.ArgumentParser(prog="kilwa-dask", description="One mesh, or a collection of meshes, on many machines.")
    top.add_argument("--version", action="version", version=f"kilwa-dask {__version__}")
    verbs = top.add_subparsers(dest="verb", required=True)
    _add_build(verbs)
    _add_build_all(verbs)
    return top


def _add_build(verbs: Any) -> None:
    build = verbs.add_parser(
        "build",
        help="build one pack of one or several meshes",
        usage="kilwa-dask build INPUT... -o OUT.kilwa --work DIR [OPTIONS] [-- OPTIONS OF kilwa plan]",
        description="Builds one pack on many machines: the one that `kilwa build` writes. Tasks that are done are skipped, so "
        "running the same command again continues a build that was stopped or killed. Options after -- go to `kilwa plan`, for "
        "example: -- --units mm --crs EPSG:32737",
        epilog="Exit codes: 0 done; 1 a task failed or a worker was refused; 2 the command line is wrong; 130 Ctrl-C.",
    )
    build.add_argument("inputs", metavar="INPUT", nargs="+", help="meshes, folders, patterns or surveys, as for kilwa build")
    build.add_argument("-o", "--output", required=True, metavar="OUT.kilwa", help="the pack to write, or s3://BUCKET/OUT.kilwa")
    build.add_argument(
        "--work",
        required=True,
        metavar="DIR",
        help="folder through which the machines exchange files, visible to all of them, or s3://BUCKET/FOLDER",
    )
    build.add_argument("--task-triangles", metavar="N", help="triangles of a task (default: as kilwa plan, 10M)")
    build.add_argument(
        "--scratch",
        metavar="DIR",
        help="folder for scratch files on each machine (default: in --work; with s3://, the system's temporary folder)",
    )
    build.add_argument("--force", action="store_true", help="replace an existing output file")
    _add_machines(build, "tasks", "kilwa task")


def _add_build_all(verbs: Any) -> None:
    build = verbs.add_parser(
        "build-all",
        help="build, verify and publish every mesh of a collection",
        usage="kilwa-dask build-all IN OUT [OPTIONS] [-- OPTIONS OF kilwa build]",
        description="Builds and verifies a pack of every mesh in IN, and publishes it on request. Finished meshes are "
        "skipped, so running the same command again continues a run that was stopped, killed or partly failed. Options "
        "after -- go to every `kilwa build`, for example: -- --units mm --crs EPSG:32737",
        epilog="Exit codes: 0 done; 1 some meshes failed or a worker was refused; 2 the command line is wrong; 130 Ctrl-C.",
    )
    build.add_argument("source", metavar="IN", help="folder of meshes, with its subfolders, or a quoted pattern")
    build.add_argument("output", metavar="OUT", help="folder of the packs, created if missing")
    build.add_argument(
        "--metadata", metavar="DIR|PATTERN", help="folder with NAME.toml for NAME.ply, or a pattern whose * stands for NAME"
    )
    build.add_argument("--publish", metavar="STORE", help="publish to this folder, server or store (as kilwa publish --to)")
    build.add_argument("--version-note", metavar="TEXT", help="what is new; required for objects already published")
    _add_machines(build, "meshes", "kilwa build")


def _add_machines(verb: argparse.ArgumentParser, what: str, program: str) -> None:
    where = verb.add_mutually_exclusive_group()
    where.add_argument("--scheduler", metavar="ADDRESS", help="a running Dask scheduler, such as tcp://host:8786")
    where.add_argument("--cluster", choices=("local", "ssh", "slurm"), default="local", help="default: local")
    verb.add_argument("--hosts", metavar="HOST,HOST", help="for ssh: the machines; the first one also runs the scheduler")
    verb.add_argument("--workers", type=_count, metavar="N", help=f"{what} at a time (for ssh: on each machine)")
    verb.add_argument("--threads", type=_count, metavar="N", help=f"threads of each {program}")
    verb.add_argument("--memory", metavar="SIZE", help=f"memory of each {program}, for example 2GiB")
    verb.add_argument("--kilwa", metavar="PATH", help="the program (default: $KILWA, or kilwa on PATH)")
    verb.add_argument("--json", metavar="FILE", help="also write the report to this file as JSON")


def _count(text: str) -> int:
    number = int(text) if text.isascii() and text.isdigit() else 0
    if number < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number above 0")
    return number


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    at = given.index("--") if "--" in given else len(given)
    options = parser().parse_args(given[:at])
    try:
        with _terminable():
            verb = _build if options.verb == "build" else _build_all
            return verb(options, given[at + 1 :])
    except UsageError as error:
        print(f"kilwa-dask: {error}", file=sys.stderr)
        return 2
    except (WorkerRefused, ClusterFailed, BuildFailed, program.ProgramFailed, OSError) as error:
        print(f"kilwa-dask: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    except Ended:
        return 143


@contextmanager
def _terminable() -> Iterator[None]:
    """Turn SIGTERM into the exception `Ended`, so that everything is cleaned up."""

    def end(signum: int, frame: FrameType | None) -> NoReturn:
        del signum, frame
        raise Ended

    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _refuse(options: argparse.Namespace, kilwa_options: list[str], own: Sequence[str]) -> None:
    """Raise `UsageError` if the options after -- have one of kilwa-dask's own, or if others do not fit together."""
    for option in kilwa_options:
        # -o may have its value attached.
        if option.split("=")[0] in own or option.startswith("-o"):
            raise UsageError(f"{option} is not allowed after --: kilwa-dask sets it, or it cannot apply to every mesh")
    if options.hosts is not None and options.cluster != "ssh":
        raise UsageError("--hosts is for --cluster ssh")


def _build(options: argparse.Namespace, plan_options: list[str]) -> int:
    _refuse(options, plan_options, _NOT_FOR_ONE)
    output, work = (name if is_address(name) else os.path.abspath(name) for name in (options.output, options.work))
    if not is_address(output) and os.path.isdir(output):
        raise UsageError(f"{output} is a folder; give the name of the pack")
    plan = _build_plan(options, plan_options, output, work)
    if not plan.record.exists():
        refuse_existing(plan.output, plan.force)
    result = BuildReport()
    driver = BuildDriver(plan, result)
    started = time.monotonic()
    make_state(plan)
    try:
        with ExitStack() as stack:
            stack.enter_context(announced(plan))
            # What kilwa refuses is refused before workers are started.
            driver.begin()
            client = stack.enter_context(clusters.opened(_choice(options)))
            print(f"{os.path.basename(output)}; dashboard: {client.dashboard_link}", file=sys.stderr, flush=True)
            check_workers(client, plan)
            try:
                driver.drive(client)
            finally:
                driver.sweep_scratch(client, patience=_PATIENCE)
                driver.sweep_state(client)
    finally:
        if driver.build is not None:
            sweep_scratch(plan, driver.build, patience=_PATIENCE)
        for folder in plan.announced_in:
            _sweep(Path(folder), patience=_PATIENCE)
        remove_base(plan)
        seconds = time.monotonic() - started
        if result.pack is None and result.done:
            done = "1 task" if len(result.done) == 1 else f"{len(result.done)} tasks"
            print(f"\nstopped after {done}; run the same command to continue", file=sys.stderr)
        if result.key is not None and options.json is not None:
            build_report.write(Path(options.json), plan, result, seconds)
    print(build_report.summary(result, plan, seconds))
    return 0


def _build_plan(options: argparse.Namespace, plan_options: list[str], output: str, work: str) -> BuildPlan:
    asked = _program(options)
    # If the output is in a store, kilwa itself checks whether it exists.
    into = [f"--output={output}", *(["--force"] if options.force else [])] if is_address(output) else []
    folders = [*([] if is_address(work) else [work]), *([] if is_address(output) else [os.path.dirname(output)])]
    portions = [f"--task-triangles={options.task_triangles}"] if options.task_triangles else []
    return BuildPlan(
        run=uuid.uuid4().hex,
        shared=tuple(dict.fromkeys(folders)),
        program=asked,
        version=program.version(asked),
        resources=_resources(options),
        arguments=("plan", "--work", work, "--json", *portions, *into, *plan_options, "--", *options.inputs),
        work=work,
        output=output,
        force=options.force,
        scratch=os.path.abspath(options.scratch) if options.scratch else None,
    )


def _build_all(options: argparse.Namespace, build_options: list[str]) -> int:
    _refuse(options, build_options, _NOT_FOR_ALL)
    if options.publish is not None and options.metadata is None:
        raise UsageError("--publish needs --metadata: a model cannot be published without its metadata")
    output = Path(options.output).resolve()
    meshes = collection.find(options.source, options.metadata, output)
    plan = _plan(options, build_options, output)
    outcomes: list[Outcome] = []
    started = time.monotonic()
    stopped = True
    try:
        _run(options, meshes, plan, outcomes)
        stopped = False
    finally:
        _sweep(output, patience=_PATIENCE)
        seconds = time.monotonic() - started
        if stopped and outcomes:
            print(f"\nstopped after {len(outcomes)} of {len(meshes)} meshes; run the same command to continue", file=sys.stderr)
        if outcomes and options.json is not None:
            report.write(Path(options.json), plan, outcomes, seconds, stopped=stopped)
    print(report.summary(outcomes, seconds))
    return 1 if any(outcome.state == "failed" for outcome in outcomes) else 0


def _program(options: argparse.Namespace) -> str:
    asked: str = options.kilwa or os.environ.get("KILWA") or "kilwa"
    return os.path.abspath(asked) if os.sep in asked else asked


def _resources(options: argparse.Namespace) -> tuple[str, ...]:
    threads, memory = options.threads, options.memory
    if options.scheduler is None and options.cluster == "local":
        # Together the programs use what one would use alone.
        workers = clusters.local_workers(options.workers)
        threads = threads or max(1, (os.cpu_count() or 1) // workers)
        memory = memory or f"{max(256, _memory_mib() // 4 // workers)}MiB"
    return (*([f"--threads={threads}"] if threads else []), *([f"--memory={memory}"] if memory else []))


def _choice(options: argparse.Namespace) -> Choice:
    hosts = tuple(host for host in (options.hosts or "").split(",") if host)
    return Choice(options.scheduler, options.cluster, options.workers, hosts, options.threads)


def _plan(options: argparse.Namespace, build_options: list[str], output: Path) -> Plan:
    asked = _program(options)
    to: str | None = options.publish
    if to is not None and "://" not in to:
        to = str(Path(to).resolve())
    return Plan(
        run=uuid.uuid4().hex,
        shared=(str(output),),
        program=asked,
        version=program.version(asked),
        resources=_resources(options),
        options=tuple(_absolute(build_options)),
        publish=to,
        publish_options=("--version-note", options.version_note) if options.version_note else (),
        report=os.path.abspath(options.json) if options.json else None,
    )


def _absolute(build_options: list[str]) -> Iterator[str]:
    """Yield the options with absolute names of files, and apart from the option that names them: tasks look for files."""
    for option in build_options:
        name, _, value = option.partition("=")
        # `--transform auto` means the matrix beside each mesh, even if there is a file of that name.
        if option == "auto":
            yield option
        elif option.startswith("--") and (value == "auto" or os.path.isfile(value)):
            yield from (name, value if value == "auto" else os.path.abspath(value))
        else:
            yield os.path.abspath(option) if os.path.isfile(option) else option


def _memory_mib() -> int:
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // (1 << 20)


def _run(options: argparse.Namespace, meshes: list[Mesh], plan: Plan, outcomes: list[Outcome]) -> None:
    with announced(plan), clusters.opened(_choice(options)) as client:
        print(f"{len(meshes)} meshes; dashboard: {client.dashboard_link}", file=sys.stderr, flush=True)
        check_workers(client, plan)
        drive(client, meshes, plan, outcomes)


def _sweep(output: Path, patience: float) -> None:
    """Remove the files of interrupted attempts; wait for stopped programs to exit, because they still hold their locks."""
    until = time.monotonic() + patience
    while not sweep(output) and time.monotonic() < until:
        time.sleep(0.05)
