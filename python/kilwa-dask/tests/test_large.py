"""The long form of test_build.py and test_store.py (KILWA_LARGE=100M, the triangles of each mesh; needs 30 GB of disk)."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import LIMIT, Single, end_all, processes_of
from test_store import Stored, serving, set_keys

MESHES = {"wall": ("wall",), "fort": ("fort",), "sphere": ("phantom", "--shape", "sphere", "--noise", "0.0001")}
# The memory that the largest task may use, the ingest: 1 GiB is what a worker may have.
MEMORY = {1: "1000M", 2: "1000M", 5: "600M"}


@pytest.fixture(scope="module", params=MESHES)
def large(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory, kilwa: str) -> Iterator[Single]:
    """Return a large mesh, and build it with `kilwa build`."""
    made = Single(tmp_path_factory.mktemp(request.param), kilwa)
    made.make(*MESHES[request.param], triangles=os.environ["KILWA_LARGE"])
    begun = time.monotonic()
    sha256 = made.sha256_of_plain_build(made.mesh)
    print(f"\nlarge | {request.param} | kilwa build | {time.monotonic() - begun:.0f} s | {sha256}")
    yield made
    end_all(made)
    shutil.rmtree(made.root)


@pytest.mark.parametrize("workers", MEMORY)
def test_any_number_of_workers_makes_the_same_pack_in_a_folder(large: Single, workers: int) -> None:
    """With little memory; nothing else is left."""
    try:
        driver = large.start("--scratch", str(large.scratch), *machines(workers))
        follow(large, driver, f"folder | {workers}")
        large.check()
    finally:
        large.out.unlink(missing_ok=True)


@pytest.mark.parametrize("workers", MEMORY)
def test_any_number_of_workers_makes_the_same_pack_in_a_store(
    large: Single, workers: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With the mesh, the work and the pack in the store."""
    with serving(volume_mb=1024) as store:
        set_keys(store, monkeypatch)
        made = Stored(large.root, large.kilwa, large.drivers, large.plain_builds, store)
        store.ask("/in/mesh.ply", "PUT", made.mesh.read_bytes(), timeout=LIMIT)
        follow(made, made.start(*machines(workers)), f"store | {workers}")
        made.check()


def machines(workers: int) -> list[str]:
    """Return the options for some workers of one core each."""
    return ["--workers", str(workers), "--threads", "1", "--memory", MEMORY[workers], "--task-triangles", "10M"]


def follow(made: Single | Stored, driver: subprocess.Popen[str], what: str) -> None:
    """Wait for a driver, and print the time, the processor time and the most memory that a task of kilwa has had."""
    begun, peak = time.monotonic(), 0
    while driver.poll() is None:
        peak = max([peak, *(resident_peak(process.pid) for process in processes_of(driver, made.kilwa))])
        time.sleep(0.05)
    seconds = time.monotonic() - begun
    made.end(driver)
    report = json.loads(made.report.read_text())
    cpu = report["total"]["cpu_seconds"]
    mesh = made.root.name.rstrip("0123456789")
    print(f"\nlarge | {mesh} | {what} | {seconds:.0f} s | {cpu:.0f} CPU s | {peak / 1e6:.0f} MB | {report['pack']['sha256']}")


def resident_peak(pid: int) -> int:
    """Return the most memory that a process has had so far, in bytes; 0 if it has ended. Linux only."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return 0
    return max((int(line.split()[1]) * 1024 for line in lines if line.startswith("VmHWM:")), default=0)
