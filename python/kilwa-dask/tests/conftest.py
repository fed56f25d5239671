"""Shared by the tests: kilwa, collections of small meshes, and drivers in separate processes."""

from __future__ import annotations

import hashlib
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import psutil
import pytest

# The soak test takes a quarter of an hour on two cores.
collect_ignore = [] if os.environ.get("KILWA_SOAK") else ["test_soak.py"]

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
class Collection:
    """A folder of meshes and their metadata, and the folders for packs and objects."""

    root: Path
    kilwa: str
    drivers: list[subprocess.Popen[str]] = field(default_factory=list)

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
        """Start a driver with two workers."""
        command = [sys.executable, "-m", "kilwa_dask", "build-all", str(self.meshes), str(self.out)]
        if "--scheduler" not in options and "--workers" not in options:
            command += ["--workers", "2"]
        environment = {**os.environ, "KILWA": kilwa or self.kilwa, "PYTHONPATH": path_with_source()}
        driver = subprocess.Popen(
            [*command, *options],
            stdout=subprocess.PIPE,
            stderr=(self.root / "messages").open("w"),
            text=True,
            env=environment,
            start_new_session=True,
            # A shell that starts the tests in the background has SIGINT ignored, which every process would inherit.
            preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),
        )
        self.drivers.append(driver)
        return driver

    def run(self, *options: str, code: int = 0, kilwa: str | None = None) -> str:
        """Run a driver to its end and return all that it printed."""
        return self.end(self.start(*options, kilwa=kilwa), code)

    def end(self, driver: subprocess.Popen[str], code: int = 0) -> str:
        """Wait for a driver, check its exit code, and return all that it printed."""
        output, _ = driver.communicate(timeout=LIMIT * (10 if os.environ.get("KILWA_SOAK") else 1))
        text = output + self.messages()
        assert driver.returncode == code, text
        return text

    def messages(self) -> str:
        """Return what the latest driver printed to standard error."""
        return (self.root / "messages").read_text()

    def packs(self) -> dict[str, str]:
        """Return the SHA-256 of each pack by name."""
        return {
            path.relative_to(self.out).with_suffix("").as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
            for path in self.out.rglob("*.kilwa")
        }

    def plain(self, names: list[str]) -> dict[str, str]:
        """Return the SHA-256 of each pack as plain `kilwa build` makes it."""
        digests = {}
        pack = self.root / "plain.kilwa"
        for name in names:
            command = [self.kilwa, "build", str(self.meshes / f"{name}.ply"), "--output", str(pack), "--force"]
            subprocess.run(command, check=True, capture_output=True)
            digests[name] = hashlib.sha256(pack.read_bytes()).hexdigest()
        return digests

    def strays(self) -> list[str]:
        """Return everything in the output and the store that does not belong there."""
        out = [path for path in self.out.rglob("*") if path.is_file() and not path.name.endswith((".kilwa", ".kilwa.json"))]
        hidden = [path for path in self.out.rglob(".*")]
        part = [path for path in self.store.rglob("*") if path.name.startswith(".") or path.name.endswith(".part")]
        return sorted({str(path) for path in [*out, *hidden, *part]})


def path_with_source() -> str:
    """Return a PYTHONPATH on which this package comes first."""
    return os.pathsep.join([str(SOURCE), *filter(None, [os.environ.get("PYTHONPATH")])])


@pytest.fixture
def collection(tmp_path: Path, kilwa: str) -> Iterator[Collection]:
    """Return an empty collection; drivers that a failed test leaves running are killed."""
    made = Collection(tmp_path, kilwa)
    yield made
    # Builds that outlived their workers wait at the gate.
    open_gate(made)
    for driver in made.drivers:
        for process in tree(driver):
            process.kill()
        driver.wait()


def tree(driver: subprocess.Popen[str]) -> list[psutil.Process]:
    """Return a driver and everything that it started."""
    try:
        top = psutil.Process(driver.pid)
        return [top, *top.children(recursive=True)]
    except psutil.NoSuchProcess:
        return []


def workers(driver: subprocess.Popen[str]) -> list[psutil.Process]:
    """Return the workers of a driver: its children that have a nanny, not helpers of multiprocessing."""

    def is_worker(process: psutil.Process) -> bool:
        try:
            return "spawn_main" in " ".join(process.cmdline()) and process.status() != psutil.STATUS_ZOMBIE
        except psutil.NoSuchProcess:
            return False

    return [process for process in tree(driver) if is_worker(process)]


def wrapper(path: Path, script: str) -> str:
    """Write a shell script that replaces kilwa."""
    path.write_text("#!/bin/sh\n" + script)
    path.chmod(0o755)
    return str(path)


def gated(collection: Collection, before: str = "") -> str:
    """Return a kilwa whose builds record that they started and wait for `open_gate`; `before` is run first."""
    root = collection.root
    waits = f'touch "{root}/started.$$"; while [ ! -e "{root}/gate" ]; do sleep 0.05; done'
    script = f'if [ "$1" = build ]; then {before or ":"}; {waits}; fi\nexec "{collection.kilwa}" "$@"\n'
    return wrapper(root / "gated-kilwa", script)


def started(collection: Collection) -> int:
    """Return how many builds have started and reached the gate."""
    return sum(1 for _ in collection.root.glob("started.*"))


def open_gate(collection: Collection) -> None:
    """Let all builds continue."""
    (collection.root / "gate").touch()


def kill(process: psutil.Process) -> None:
    """Kill a process as `kill -9` does, if it is still there."""
    try:
        process.kill()
    except psutil.NoSuchProcess:
        pass
