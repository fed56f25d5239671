"""One build that is divided into tasks: its pack, its report, and what is refused."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path

from conftest import Single, gated, open_gate, started, tree, until, wrapper

MESHES = (("wall",), ("fort",), ("phantom", "--shape", "sphere"))


def test_the_pack_is_that_of_kilwa_build_for_any_number_of_workers(single: Single) -> None:
    """One, two and five, and three meshes."""
    client = single.cluster
    assert client is not None
    try:
        for workers in (5, 2, 1):
            client.cluster.scale(workers)
            until(lambda n=workers: len(client.scheduler_info()["workers"]) == n, f"{workers} workers")  # type: ignore[misc]
            for shape in MESHES:
                single.make(*shape)
                single.run("--force")
                single.check()
    finally:
        client.cluster.scale(2)
        client.wait_for_workers(2)


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
    levels = [name for name in names if name.startswith("level-")]
    assert names == ["ingest", "region", "tree", "leaves", *levels, "tail", "assemble"]
    assert len(levels) >= 3
    assert levels == sorted(levels, reverse=True)
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
    other = f'if [ "$1" = --version ] && [ $PPID != {os.getpid()} ]; then echo kilwa 9.9.9; exit; fi\n'
    text = single.run(code=1, kilwa=wrapper(single.root / "kilwa", f'{other}exec "{single.kilwa}" "$@"\n'))
    assert "has kilwa 9.9.9, but this computer has kilwa 0." in text
    (build,) = single.work.iterdir()
    assert not list(build.glob("done/*"))
    single.run()
    single.check()


def test_two_drivers_at_once_make_one_pack(single: Single) -> None:
    """Both succeed, and together they do each task once. No task begins before both drivers have planned the build."""
    planned = f'if [ "$1" = plan ]; then touch "{single.root}/planned.$PPID"; fi'
    both = f'[ "$(ls "{single.root}"/planned.* | wc -l)" = 2 ]'
    script = f'{planned}\nif [ "$1" = task ]; then until {both}; do sleep 0.05; done; fi\nexec "{single.kilwa}" "$@"\n'
    kilwa = wrapper(single.root / "kilwa", script)
    other = single.root / "other.json"
    driver = single.launch(*single.arguments("--json", str(other), "--workers", "1"), kilwa=kilwa)
    until(lambda: any(single.work.glob(".kilwa-dask/*.run")), "the other driver has begun")
    single.run(kilwa=kilwa)
    single.end(driver)
    reports = [single.told(), json.loads(other.read_text())]
    assert reports[0]["pack"] == reports[1]["pack"]
    done = [task["task"] for report in reports for task in report["tasks"] if task["state"] == "done"]
    assert len(done) == len(set(done)) > 20
    single.check()


def test_an_existing_output_is_not_replaced(single: Single) -> None:
    """Nothing is done, unless --force is given."""
    single.out.parent.mkdir()
    single.out.write_text("mine")
    assert f"{single.out} exists already; use --force to replace it" in single.run(code=2)
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
    text = single.run(code=1)
    assert "No such file" in text
    assert "dashboard" not in text


def test_an_output_that_appears_meanwhile_is_not_replaced(single: Single) -> None:
    """What is done is kept, and the same command with --force goes on."""
    script = f'if [ "$1" = assemble ]; then echo mine > "{single.out}"; fi\nexec "{single.kilwa}" "$@"\n'
    text = single.run(code=1, kilwa=wrapper(single.root / "kilwa", script))
    assert f"{single.out} has appeared meanwhile" in text
    assert single.out.read_text() == "mine\n"
    single.run("--force")
    total = single.told()["total"]
    assert total["earlier"] == total["tasks"] - 1 > 10
    single.check()


def test_ctrl_c_stops_the_build_and_the_same_command_continues(single: Single) -> None:
    """In a terminal it reaches the driver and its workers at once. What is done is kept, and nothing else."""
    kilwa = gated(single, verb="task")
    open_gate(single, "ingest")
    driver = single.start("--scratch", str(single.scratch), "--workers", "1", kilwa=kilwa)
    until(lambda: started(single, "region-*") == 1, "the second task runs")
    family = tree(driver)
    os.killpg(driver.pid, signal.SIGINT)
    text = single.end(driver, 130)
    assert "Traceback" not in text
    assert "stopped after 1 task; run the same command to continue" in text
    until(lambda: not any(process.is_running() for process in family), "all processes ended")
    (build,) = single.left_over()
    assert Path(build).name.startswith("kilwa-build-")
    single.run("--scratch", str(single.scratch))
    assert single.told()["total"]["earlier"] == 1
    single.check()
