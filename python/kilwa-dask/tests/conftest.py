"""Shared by the tests: kilwa, small meshes, and drivers in separate processes."""

from __future__ import annotations

import hashlib
import io
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import psutil
import pytest
from distributed import Client

from kilwa_dask import clusters
from kilwa_dask.cli import main

# Tests that take long on two cores, and the variables that enable them: the soak tests half an hour, the large builds two hours.
LONG = {"test_soak.py": "KILWA_SOAK", "test_large.py": "KILWA_LARGE"}
collect_ignore = [name for name, variable in LONG.items() if not os.environ.get(variable)]

SOURCE = Path(__file__).resolve().parents[1] / "src"
# A condition that does not become true in this time, in seconds, is a failure. Nothing waits for a fixed time.
LIMIT = float(os.environ.get("KILWA_DASK_TEST_LIMIT", "300"))


def until(holds: Callable[[], bool], what: str) -> None:
    """Wait until something holds."""
    end = time.monotonic() + LIMIT
    while not holds():
        assert time.monotonic() < end, f"never happened: {what}"
        time.sleep(0.01)


@pytest.fixture(scope="session")
def kilwa() -> str:
    """Return the path of the program: $KILWA, or kilwa on PATH."""
    found = shutil.which(os.environ.get("KILWA", "kilwa"))
    if found is None:
        pytest.fail("set KILWA to the program kilwa; these tests run it")
    return os.path.abspath(found)


@dataclass
class Drivers:
    """Drivers, each a process of its own, and the folder in which they work."""

    root: Path
    kilwa: str
    drivers: list[subprocess.Popen[str]] = field(default_factory=list)
    plain_builds: dict[str, str] = field(default_factory=dict)
    """SHA-256 of the packs of plain builds, by that of their meshes."""

    def launch(self, *arguments: str, kilwa: str | None = None) -> subprocess.Popen[str]:
        """Start a driver, with two workers if nothing else is said."""
        command = [sys.executable, "-m", "kilwa_dask", *arguments]
        if "--scheduler" not in arguments and "--workers" not in arguments:
            command += ["--workers", "2"]
        environment = {**os.environ, "KILWA": kilwa or self.kilwa, "PYTHONPATH": path_with_source()}
        driver = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=(self.root / f"messages-{len(self.drivers)}").open("w"),
            text=True,
            env=environment,
            start_new_session=True,
            # A shell that starts the tests in the background has SIGINT ignored, which every process would inherit.
            preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),
        )
        self.drivers.append(driver)
        return driver

    def end(self, driver: subprocess.Popen[str], code: int = 0) -> str:
        """Wait for a driver, check its exit code, and return all that it printed."""
        output, _ = driver.communicate(timeout=LIMIT * (10 if len(collect_ignore) < len(LONG) else 1))
        text = output + self.messages(driver)
        assert driver.returncode == code, text
        return text

    def messages(self, driver: subprocess.Popen[str]) -> str:
        """Return what a driver wrote on standard error."""
        return (self.root / f"messages-{self.drivers.index(driver)}").read_text()

    def sha256_of_plain_build(self, mesh: Path) -> str:
        """Return the SHA-256 of the pack that plain `kilwa build` makes of a mesh."""
        content = hashlib.sha256(mesh.read_bytes()).hexdigest()
        if content not in self.plain_builds:
            pack = self.root / "plain.kilwa"
            command = [self.kilwa, "build", str(mesh), "--output", str(pack), "--force"]
            subprocess.run(command, check=True, capture_output=True)
            self.plain_builds[content] = hashlib.sha256(pack.read_bytes()).hexdigest()
        return self.plain_builds[content]


@dataclass
class Collection(Drivers):
    """A folder of meshes and their metadata, and the folders for packs and objects."""

    @property
    def meshes(self) -> Path:
        """Folder of the meshes."""
        return self.root / "in"

    @property
    def out(self) -> Path:
        """Folder of the packs."""
        return self.root / "out"

    @property
    def store(self) -> Path:
        """Folder of the objects."""
        return self.root / "store"

    def make(self, count: int, triangles: int = 200) -> list[str]:
        """Make meshes that differ, with metadata, one of them in a subfolder; return their names."""
        names = [f"mesh-{number:03}" for number in range(count - 1)] + ["wing/north"]
        for number, name in enumerate(names):
            path = self.meshes / f"{name}.ply"
            path.parent.mkdir(parents=True, exist_ok=True)
            shape = ["--shape", "sphere", "--noise", "0.001", "--seed", str(number), "--triangles", str(triangles)]
            subprocess.run([self.kilwa, "synth", "phantom", *shape, "--output", str(path)], check=True, capture_output=True)
            metadata = self.root / "metadata" / f"{name}.toml"
            metadata.parent.mkdir(parents=True, exist_ok=True)
            rest = 'published = "2026-01-01"\n[rights]\nuri = "CC0"\n[model]\nunits = "m"\ncrs = "local"\n'
            metadata.write_text(f'title = "{name.replace("/", " ")}"\n{rest}')
        return names

    def start(self, *options: str, kilwa: str | None = None) -> subprocess.Popen[str]:
        """Start a driver."""
        return self.launch("build-all", str(self.meshes), str(self.out), *options, kilwa=kilwa)

    def run(self, *options: str, code: int = 0, kilwa: str | None = None) -> str:
        """Run a driver to its end and return all that it printed."""
        return self.end(self.start(*options, kilwa=kilwa), code)

    def packs(self) -> dict[str, str]:
        """Return the SHA-256 of each pack by name."""
        return {
            path.relative_to(self.out).with_suffix("").as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
            for path in self.out.rglob("*.kilwa")
        }

    def plain(self, names: list[str]) -> dict[str, str]:
        """Return the SHA-256 of each pack as plain `kilwa build` makes it."""
        return {name: self.sha256_of_plain_build(self.meshes / f"{name}.ply") for name in names}

    def strays(self) -> list[str]:
        """Return everything in the output and the store that does not belong there."""
        out = [path for path in self.out.rglob("*") if path.is_file() and not path.name.endswith((".kilwa", ".kilwa.json"))]
        hidden = [path for path in self.out.rglob(".*")]
        part = [path for path in self.store.rglob("*") if path.name.startswith(".") or path.name.endswith(".part")]
        return sorted({str(path) for path in [*out, *hidden, *part]})


@dataclass
class OneMesh(Drivers):
    """A mesh, and the local folders for its build."""

    @property
    def mesh(self) -> Path:
        """The mesh."""
        return self.root / "mesh.ply"

    @property
    def scratch(self) -> Path:
        """Folder for scratch files."""
        return self.root / "scratch"

    @property
    def report(self) -> Path:
        """The report of the latest driver."""
        return self.root / "report.json"


@dataclass
class Single(OneMesh):
    """A mesh, and the folders for its build."""

    cluster: Client | None = None
    """Workers for drivers in this process."""

    @property
    def work(self) -> Path:
        """Folder of the work."""
        return self.root / "work"

    @property
    def out(self) -> Path:
        """The pack."""
        return self.root / "packs" / "mesh.kilwa"

    def make(self, *shape: str, triangles: str = "20k") -> None:
        """Make the mesh: a wall, or another shape of `kilwa synth`."""
        command = [self.kilwa, "synth", *(shape or ("wall",)), "--triangles", triangles, "--output", str(self.mesh)]
        subprocess.run([*command, "--force"], check=True, capture_output=True)

    def arguments(self, *options: str) -> list[str]:
        """Return the arguments of a driver that builds the mesh in small tasks: a dozen of 20,000 triangles."""
        files = ["--output", str(self.out), "--work", str(self.work)]
        return ["build", str(self.mesh), *files, "--task-triangles", "3k", *options]

    def start(self, *options: str, kilwa: str | None = None) -> subprocess.Popen[str]:
        """Start a driver."""
        return self.launch(*self.arguments("--json", str(self.report), *options), kilwa=kilwa)

    def run(self, *options: str, code: int = 0, kilwa: str | None = None) -> str:
        """Run a driver in this process, with workers that are there already, and return all that it printed."""

        @contextmanager
        def opened(choice: clusters.Choice) -> Iterator[Client]:
            del choice
            yield self.cluster

        text = io.StringIO()
        with pytest.MonkeyPatch.context() as patched, redirect_stdout(text), redirect_stderr(text):
            patched.setattr(clusters, "opened", opened)
            patched.setenv("KILWA", kilwa or self.kilwa)
            returned = main(self.arguments("--json", str(self.report), *options))
        assert returned == code, text.getvalue()
        return text.getvalue()

    def told(self) -> dict[str, Any]:
        """Read the report of the latest driver."""
        report = json.loads(self.report.read_text())
        assert isinstance(report, dict)
        return report

    def check(self) -> None:
        """Check that the pack is that of plain `kilwa build`, and that nothing else is left: no file and no process."""
        until(lambda: not self.processes(), f"all processes ended: {self.processes()}")
        assert hashlib.sha256(self.out.read_bytes()).hexdigest() == self.sha256_of_plain_build(self.mesh)
        assert self.left_over() == []

    def left_over(self) -> list[str]:
        """Return what is in the folders of the work, of scratch files and of the pack, but not the pack."""
        folders = [folder for folder in (self.work, self.scratch, self.out.parent) if folder.is_dir()]
        return sorted(str(path) for folder in folders for path in folder.iterdir() if path != self.out)

    def processes(self) -> list[str]:
        """Return the command lines of all processes that work on the mesh."""
        lines = []
        for process in psutil.process_iter():
            try:
                line = " ".join(process.cmdline())
            except (psutil.NoSuchProcess, psutil.AccessDenied):
                continue
            if str(self.root) in line and process.pid != os.getpid():
                lines.append(line)
        return lines


def path_with_source() -> str:
    """Return a PYTHONPATH on which this package comes first."""
    return os.pathsep.join([str(SOURCE), *filter(None, [os.environ.get("PYTHONPATH")])])


@pytest.fixture
def collection(tmp_path: Path, kilwa: str) -> Iterator[Collection]:
    """Return an empty collection; drivers that a failed test leaves running are killed."""
    made = Collection(tmp_path, kilwa)
    yield made
    end_all(made)


@pytest.fixture(scope="session")
def two_workers() -> Iterator[Client]:
    """Start two workers for the drivers of this process."""
    before = os.environ.get("PYTHONPATH")
    os.environ["PYTHONPATH"] = path_with_source()
    try:
        with clusters.opened(clusters.Choice(workers=2)) as client:
            yield client
    finally:
        os.environ.pop("PYTHONPATH") if before is None else os.environ.update(PYTHONPATH=before)


@pytest.fixture
def single(tmp_path: Path, kilwa: str, two_workers: Client) -> Iterator[Single]:
    """Return the folders of one build, and its mesh; drivers that a failed test leaves running are killed."""
    made = Single(tmp_path, kilwa, cluster=two_workers)
    made.make()
    yield made
    end_all(made)


def end_all(made: Drivers) -> None:
    """Kill all drivers and what they started."""
    # Programs that outlived their workers wait at the gate.
    open_gate(made)
    for driver in made.drivers:
        for process in tree(driver):
            process.kill()
        driver.wait()


def tree(driver: subprocess.Popen[str] | psutil.Process) -> list[psutil.Process]:
    """Return a driver and everything that it started."""
    try:
        top = psutil.Process(driver.pid)
        return [top, *top.children(recursive=True)]
    except psutil.NoSuchProcess:
        return []


def workers(driver: subprocess.Popen[str] | psutil.Process) -> list[psutil.Process]:
    """Return the workers of a driver: its children that have a nanny, not helpers of multiprocessing."""

    def is_worker(process: psutil.Process) -> bool:
        try:
            return "spawn_main" in " ".join(process.cmdline()) and process.status() != psutil.STATUS_ZOMBIE
        except psutil.NoSuchProcess:
            return False

    return [process for process in tree(driver) if is_worker(process)]


def processes_of(driver: subprocess.Popen[str], program: str) -> list[psutil.Process]:
    """Return the processes of a program that a driver or its workers have started."""

    def runs(process: psutil.Process) -> bool:
        try:
            return bool(process.exe() == os.path.realpath(program))
        except psutil.Error:
            return False

    return [process for process in tree(driver) if runs(process)]


def wrapper(path: Path, script: str) -> str:
    """Write a shell script that replaces kilwa."""
    path.write_text("#!/bin/sh\n" + script)
    path.chmod(0o755)
    return str(path)


def gated(made: Drivers, before: str = "", verb: str = "build") -> str:
    """Return a kilwa that records when `verb` is started and waits for `open_gate`; `before` is run first.

    The record names the file that kilwa was given, the worker, and the process.
    """
    root = made.root
    named = 'n=$(basename "$2" .json)'
    waits = f'while [ ! -e "{root}/gate" ] && [ ! -e "{root}/gate.$n" ]; do sleep 0.05; done'
    starts = f'{named}; touch "{root}/started.$n.$PPID.$$"; {waits}'
    script = f'if [ "$1" = {verb} ]; then {before or ":"}; {starts}; fi\nexec "{made.kilwa}" "$@"\n'
    return wrapper(root / "gated-kilwa", script)


def started(made: Drivers, name: str = "*") -> int:
    """Return how many programs have started and reached the gate, with any file or with one of this name."""
    return sum(1 for _ in made.root.glob(f"started.{name}.*.*"))


def open_gate(made: Drivers, name: str | None = None) -> None:
    """Let all programs continue, or only those with a file of this name."""
    (made.root / ("gate" if name is None else f"gate.{name}")).touch()


def kill_worker_of(made: Drivers, name: str) -> None:
    """Kill the worker of the program that was last started with a file of this name."""
    latest = max(made.root.glob(f"started.{name}.*.*"), key=lambda path: path.stat().st_mtime_ns)
    kill(psutil.Process(int(latest.name.split(".")[-2])))


def kill(process: psutil.Process) -> None:
    """Kill a process as `kill -9` does, if it is still there."""
    try:
        process.kill()
    except psutil.NoSuchProcess:
        pass
