"""One build that is divided into tasks: its pack, its report, and what is refused."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from conftest import OTHER, Single, gated, open_gate, scheduler, started, tree, until, wrapper
from distributed import Client

from kilwa_dask import clusters
from kilwa_dask.cli import main

MESHES = (("wall",), ("fort",), ("phantom", "--shape", "sphere"))


def test_the_pack_is_that_of_kilwa_build_for_any_number_of_workers(single: Single, monkeypatch: pytest.MonkeyPatch) -> None:
    """One, two and five, which are the same cluster that grows, and three meshes."""
    monkeypatch.setenv("KILWA", single.kilwa)
    with clusters.opened(clusters.Choice(workers=1)) as client:

        @contextmanager
        def opened(choice: clusters.Choice) -> Iterator[Client]:
            assert choice.workers == len(client.scheduler_info()["workers"])
            yield client

        monkeypatch.setattr(clusters, "opened", opened)
        for workers in (1, 2, 5):
            client.cluster.scale(workers)
            client.wait_for_workers(workers)
            for shape in MESHES:
                single.make(*shape)
                assert main(single.arguments("--workers", str(workers), "--force")) == 0
                single.check()


def test_the_report_has_every_stage(single: Single) -> None:
    """As text, and as JSON with the figures of kilwa."""
    text = single.run()
    told = single.told()
    assert "dashboard: http://127.0.0.1:" in text
    assert f"SHA-256 {single.sha256_of_plain_build(single.mesh)}" in text
    assert told["pack"]["bytes"] == single.out.stat().st_size
    assert told["pack"]["triangles"] > 19_000
    assert not told["stopped"]
    names = [stage["stage"] for stage in told["stages"]]
    assert names == ["ingest", "level-03", "level-02", "level-01", "tail", "assemble"]
    assert sum(stage["tasks"] for stage in told["stages"]) == told["total"]["tasks"] == len(told["tasks"])
    assert all(stage["seconds"] > 0 and stage["bytes_written"] > 0 for stage in told["stages"])
    assert told["total"]["retries"] == told["total"]["earlier"] == 0
    assert told["total"]["worker_seconds"] > told["total"]["seconds"]


def test_options_after_the_dashes_go_to_kilwa_plan(single: Single) -> None:
    """And --threads and --memory to the tasks."""
    log = single.root / "log"
    kilwa = wrapper(single.root / "kilwa", f'echo "$*" >> "{log}"\nexec "{single.kilwa}" "$@"\n')
    single.run("--threads", "1", "--memory", "300MiB", "--", "--title", "A wall", "--units", "mm", kilwa=kilwa)
    lines = log.read_text().splitlines()
    assert all("--title A wall --units mm" in line for line in lines if line.startswith("plan"))
    did = [line for line in lines if line.startswith(("task", "assemble"))]
    assert len(did) == single.told()["total"]["tasks"]
    assert all(line.endswith("--json --threads=1 --memory=300MiB") for line in did)


def test_another_version_on_a_worker_is_refused(single: Single) -> None:
    """The message names both versions, and nothing is built."""
    kilwa = wrapper(single.root / "kilwa", f'{OTHER}exec "{single.kilwa}" "$@"\n')
    with scheduler() as (address, start_worker):
        start_worker(single.root, OTHER="1")
        text = single.run("--scheduler", address, code=1, kilwa=kilwa)
    assert "has kilwa 9.9.9, but this computer has kilwa 0." in text
    assert single.left_over() == []


def test_two_drivers_at_once_make_one_pack(single: Single) -> None:
    """Both succeed, and together they do each task once."""
    kilwa = gated(single, verb="task")
    reports = [single.root / f"report-{which}.json" for which in (1, 2)]
    drivers = [single.launch(*single.arguments("--json", str(report)), kilwa=kilwa) for report in reports]
    until(lambda: len(list(single.work.glob(".kilwa-dask/*.run"))) == 2, "both have begun")
    open_gate(single)
    texts = [single.end(driver) for driver in drivers]
    sha = single.sha256_of_plain_build(single.mesh)
    assert all(f"SHA-256 {sha}" in text for text in texts)
    # Ingest, nine tasks of three levels, and the tail.
    assert started(single) == 11
    single.check()


def test_an_existing_output_is_not_replaced(single: Single, capsys: pytest.CaptureFixture[str]) -> None:
    """Nothing is done, unless --force is given."""
    single.out.parent.mkdir()
    single.out.write_text("mine")
    assert main(single.arguments("--kilwa", single.kilwa)) == 2
    assert f"{single.out} exists already; use --force to replace it" in capsys.readouterr().err
    assert single.out.read_text() == "mine"
    assert not single.work.exists()
    single.run("--force")
    single.check()


def test_a_mesh_that_cannot_be_read_is_reported_once(single: Single) -> None:
    """With kilwa's message. A file that is missing is not planned at all."""
    single.mesh.write_text("ply\nformat ascii 1.0\nelement vertex x\n")
    text = single.run(code=1)
    assert 'mesh.ply, line 3: found "element vertex x"' in text
    assert "the task ingest" in text
    assert "tried" not in text
    assert single.told()["failure"] in text
    single.mesh.unlink()
    assert "No such file" in single.run(code=1)


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_stops_the_build_and_the_same_command_continues(single: Single, number: int, code: int) -> None:
    """What is done is kept, and nothing else."""
    kilwa = gated(single, verb="task")
    open_gate(single, "ingest")
    driver = single.start("--scratch", str(single.scratch), kilwa=kilwa)
    until(lambda: started(single, "level-03-0000") == 1, "the second task runs")
    family = tree(driver)
    driver.send_signal(number)
    text = single.end(driver, code)
    assert "Traceback" not in text
    assert "stopped after 1 tasks; run the same command to continue" in text
    until(lambda: not any(process.is_running() for process in family), "all processes ended")
    (build,) = single.left_over()
    assert Path(build).name.startswith("kilwa-build-")
    open_gate(single)
    single.run("--scratch", str(single.scratch))
    assert single.told()["total"]["earlier"] == 1
    single.check()
