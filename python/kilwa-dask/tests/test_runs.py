"""Whole runs: what is built, what is skipped, what is reported."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from conftest import Collection, gated, open_gate, path_with_source, started, until, wrapper
from distributed import LocalCluster


def report_of(collection: Collection) -> dict[str, object]:
    """Read the JSON report."""
    report = json.loads((collection.root / "report.json").read_text())
    assert isinstance(report, dict)
    return report


def test_everything_is_built_and_a_second_run_builds_nothing(collection: Collection) -> None:
    """A bad mesh is named with kilwa's message, the others are identical to those of plain `kilwa build`."""
    names = collection.make(4)
    (collection.meshes / "bad.ply").write_text("ply\nformat ascii 1.0\nelement vertex x\n")
    report_file = ["--json", str(collection.root / "report.json")]
    text = collection.run(*report_file, code=1)
    assert "bad: FAILED (build)" in text
    assert 'bad.ply, line 3: found "element vertex x"' in text
    assert "dashboard: http://127.0.0.1:" in text
    assert collection.packs() == collection.plain(names)
    report = report_of(collection)
    assert (report["built"], report["failed"], report["already_done"]) == (4, 1, 0)
    meshes = report["meshes"]
    assert isinstance(meshes, list)
    for mesh in meshes:
        if mesh["state"] == "built":
            assert mesh["triangles"] > 100
            assert mesh["pack_bytes"] > 1000
            assert set(mesh["seconds"]) == {"check", "build", "verify"}
    assert collection.strays() == []

    (collection.meshes / "bad.ply").unlink()
    text = collection.run(*report_file)
    assert "0 built, 0 only published, 4 already done, 0 failed" in text
    assert report_of(collection)["already_done"] == 4


def test_two_drivers_at_once_build_each_mesh_once(collection: Collection) -> None:
    """Both succeed, and together they build each mesh once."""
    names = collection.make(6)
    reports = [collection.root / f"report-{which}.json" for which in (1, 2)]
    drivers = [collection.start("--json", str(report)) for report in reports]
    for driver in drivers:
        collection.end(driver)
    read = [json.loads(report.read_text()) for report in reports]
    assert sum(report["built"] for report in read) == 6
    assert sum(report["already_done"] for report in read) == 6
    assert collection.packs() == collection.plain(names)
    assert collection.strays() == []


OTHER = 'if [ "$1" = --version ] && [ -n "$OTHER" ]; then echo kilwa 9.9.9; exit; fi\n'
"""Script of a kilwa that has another version where the variable OTHER is set."""


@contextmanager
def scheduler() -> Iterator[tuple[str, Callable[..., None]]]:
    """Run a scheduler; yield its address and what starts a worker, a process of its own with variables of its own."""
    cluster = LocalCluster(n_workers=0, threads_per_worker=1, memory_limit=0, host="127.0.0.1", dashboard_address="127.0.0.1:0")
    command = [sys.executable, "-m", "distributed.cli.dask_worker", cluster.scheduler_address, "--nthreads", "1"]
    workers: list[subprocess.Popen[bytes]] = []

    def start_worker(folder: Path, **variables: str) -> None:
        environment = {**os.environ, "PYTHONPATH": path_with_source(), **variables}
        workers.append(subprocess.Popen([*command, "--no-dashboard"], env=environment, cwd=folder, stderr=subprocess.DEVNULL))

    try:
        yield cluster.scheduler_address, start_worker
    finally:
        for worker in workers:
            worker.terminate()
        for worker in workers:
            worker.wait()
        cluster.close()


def test_another_version_on_a_worker_is_refused(collection: Collection) -> None:
    """The message names both versions, and nothing is built."""
    collection.make(1)
    kilwa = wrapper(collection.root / "kilwa", f'{OTHER}exec "{collection.kilwa}" "$@"\n')
    with scheduler() as (address, start_worker):
        start_worker(collection.root, OTHER="1")
        text = collection.run("--scheduler", address, code=1, kilwa=kilwa)
    assert "has kilwa 9.9.9, but this computer has kilwa 0." in text
    assert collection.packs() == {}
    assert collection.strays() == []


def test_a_worker_that_joins_later_and_cannot_take_part_stops_the_run(collection: Collection) -> None:
    """No mesh is reported as failed, and the same command goes on without that worker."""
    names = collection.make(8)
    gate = Path(gated(collection))
    kilwa = wrapper(collection.root / "kilwa", f'{OTHER}exec "{gate}" "$@"\n')
    with scheduler() as (address, start_worker):
        start_worker(collection.root)
        driver = collection.start("--scheduler", address, kilwa=kilwa)
        until(lambda: started(collection) == 1, "a build runs")
        start_worker(collection.root, OTHER="1")
        text = collection.end(driver, code=1)
    assert "has kilwa 9.9.9, but this computer has" in text
    assert "FAILED" not in text
    assert collection.packs() == {}
    assert collection.strays() == []
    open_gate(collection)
    collection.run(kilwa=kilwa)
    assert collection.packs() == collection.plain(names)


def test_objects_are_published_once(collection: Collection) -> None:
    """Even if the driver is killed after kilwa has published but before the manifest is updated."""
    collection.make(1)
    published = collection.root / "published"
    hang = f'"{collection.kilwa}" "$@"; touch "{published}"; exec sleep 600'
    script = f'if [ "$1" = publish ]; then {hang}; fi\nexec "{collection.kilwa}" "$@"\n'
    kilwa = wrapper(collection.root / "kilwa", script)
    options = ["--metadata", f"{collection.root}/metadata/*.toml", "--publish", str(collection.store)]
    driver = collection.start(*options, kilwa=kilwa)
    until(published.exists, "the object is published")
    driver.kill()
    driver.wait()
    assert "1 only published" in collection.run(*options)
    assert "1 already done" in collection.run(*options)
    (manifest,) = collection.store.glob("*/manifest.json")
    assert len(json.loads(manifest.read_text())["versions"]) == 1
    assert collection.strays() == []
