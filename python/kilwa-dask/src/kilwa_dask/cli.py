"""The command line of kilwa-dask."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import time
import uuid
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import NoReturn

from kilwa_dask import __version__, clusters, collection, program, report
from kilwa_dask.clusters import Choice, ClusterFailed
from kilwa_dask.collection import Mesh, UsageError
from kilwa_dask.drive import check_workers, drive
from kilwa_dask.task import Outcome, Plan, WorkerRefused, announced, sweep

# Options of `kilwa build` that kilwa-dask sets itself or that a collection cannot have.
_OWN_OPTIONS = ("-o", "--output", "--json", "--force", "--resume", "--scratch", "--threads", "--memory", "--verbose", "--title")
# How long to wait for a stopped kilwa to exit, in seconds.
_PATIENCE = 10.0


class Ended(Exception):
    """SIGTERM arrived."""


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    top = argparse.ArgumentParser(prog="kilwa-dask", description="Collections of meshes on many machines.")
    top.add_argument("--version", action="version", version=f"kilwa-dask {__version__}")
    verbs = top.add_subparsers(dest="verb", required=True)
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
    where = build.add_mutually_exclusive_group()
    where.add_argument("--scheduler", metavar="ADDRESS", help="a running Dask scheduler, such as tcp://host:8786")
    where.add_argument("--cluster", choices=("local", "ssh", "slurm"), default="local", help="default: local")
    build.add_argument("--hosts", metavar="HOST,HOST", help="for ssh: the machines; the first one also runs the scheduler")
    build.add_argument("--workers", type=_count, metavar="N", help="meshes at a time (for ssh: on each machine)")
    build.add_argument("--threads", type=_count, metavar="N", help="threads of each kilwa build")
    build.add_argument("--memory", metavar="SIZE", help="memory of each kilwa build, for example 2GiB")
    build.add_argument("--kilwa", metavar="PATH", help="the program (default: $KILWA, or kilwa on PATH)")
    build.add_argument("--json", metavar="FILE", help="also write the report to this file as JSON")
    return top


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
            return _build_all(options, given[at + 1 :])
    except UsageError as error:
        print(f"kilwa-dask: {error}", file=sys.stderr)
        return 2
    except (WorkerRefused, ClusterFailed, program.ProgramFailed, OSError) as error:
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


def _build_all(options: argparse.Namespace, build_options: list[str]) -> int:
    for option in build_options:
        # -o may have its value attached.
        if option.split("=")[0] in _OWN_OPTIONS or option.startswith("-o"):
            raise UsageError(f"{option} is not allowed after --: kilwa-dask sets it, or it cannot apply to every mesh")
    if options.publish is not None and options.metadata is None:
        raise UsageError("--publish needs --metadata: a model cannot be published without its metadata")
    if options.hosts is not None and options.cluster != "ssh":
        raise UsageError("--hosts is for --cluster ssh")
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


def _plan(options: argparse.Namespace, build_options: list[str], output: Path) -> Plan:
    asked: str = options.kilwa or os.environ.get("KILWA") or "kilwa"
    if os.sep in asked:
        asked = os.path.abspath(asked)
    threads, memory = options.threads, options.memory
    if options.scheduler is None and options.cluster == "local":
        # Together the builds use what one build would use alone.
        workers = clusters.local_workers(options.workers)
        threads = threads or max(1, (os.cpu_count() or 1) // workers)
        memory = memory or f"{max(256, _memory_mib() // 4 // workers)}MiB"
    resources = [f"--threads={threads}"] if threads else []
    resources += [f"--memory={memory}"] if memory else []
    to: str | None = options.publish
    if to is not None and "://" not in to:
        to = str(Path(to).resolve())
    return Plan(
        run=uuid.uuid4().hex,
        output=str(output),
        program=asked,
        version=program.version(asked),
        options=tuple(_absolute(build_options)),
        resources=tuple(resources),
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
    hosts = tuple(host for host in (options.hosts or "").split(",") if host)
    choice = Choice(options.scheduler, options.cluster, options.workers, hosts, options.threads)
    with announced(plan), clusters.opened(choice) as client:
        print(f"{len(meshes)} meshes; dashboard: {client.dashboard_link}", file=sys.stderr, flush=True)
        check_workers(client, plan)
        drive(client, meshes, plan, outcomes)


def _sweep(output: Path, patience: float) -> None:
    """Remove the files of interrupted attempts; wait for stopped programs to exit, because they still hold their locks."""
    until = time.monotonic() + patience
    while not sweep(output) and time.monotonic() < until:
        time.sleep(0.05)
