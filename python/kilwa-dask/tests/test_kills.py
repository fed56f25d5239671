"""Whatever is killed, and whenever: the packs are those of plain `kilwa build`, and nothing is left over."""

from __future__ import annotations

import json
import os
import random
import signal

import pytest
from conftest import Collection, gated, kill, open_gate, started, tree, until, workers, wrapper


def test_the_task_of_a_killed_worker_is_done_by_another(collection: Collection) -> None:
    """A random worker is killed with `kill -9` while it builds."""
    names = collection.make(5)
    report = collection.root / "report.json"
    driver = collection.start("--json", str(report), kilwa=gated(collection))
    until(lambda: started(collection) == 2, "two builds run")
    kill(random.choice(workers(driver)))
    until(lambda: started(collection) == 3, "another build starts")
    open_gate(collection)
    collection.end(driver)
    assert json.loads(report.read_text())["retries"] == 1
    assert collection.packs() == collection.plain(names)
    assert collection.strays() == []


@pytest.mark.parametrize("orphans", ["that end with their worker", "that keep running"])
def test_the_same_command_continues_after_a_killed_driver(collection: Collection, orphans: str) -> None:
    """Even if an orphaned kilwa keeps running beside the next driver."""
    names = collection.make(4)
    kilwa = gated(collection, "trap '' TERM" if orphans == "that keep running" else "")
    driver = collection.start(kilwa=kilwa)
    until(lambda: started(collection) == 2, "two builds run")
    driver.kill()
    driver.wait()
    second = collection.start(kilwa=kilwa)
    until(lambda: started(collection) == 4, "the second driver builds what is free")
    open_gate(collection)
    collection.end(second)
    assert collection.packs() == collection.plain(names)
    assert collection.strays() == []


def test_a_mesh_that_kills_three_workers_is_named_and_given_up(collection: Collection) -> None:
    """The other meshes are built."""
    names = collection.make(3)
    script = f'case "$*" in build*mesh-001.ply*) kill -9 $PPID; exec sleep 60;; esac\nexec "{collection.kilwa}" "$@"\n'
    text = collection.run(kilwa=wrapper(collection.root / "kilwa", script), code=1)
    assert "mesh-001: FAILED (worker): 3 workers died while processing mesh-001" in text
    assert collection.packs() == collection.plain([name for name in names if name != "mesh-001"])
    assert collection.strays() == []


def test_a_kilwa_that_is_killed_is_tried_three_times(collection: Collection) -> None:
    """As the kernel does when memory runs out."""
    collection.make(1)
    tries = collection.root / "tries"
    script = f'if [ "$1" = build ]; then echo >> "{tries}"; kill -9 $$; fi\nexec "{collection.kilwa}" "$@"\n'
    text = collection.run(kilwa=wrapper(collection.root / "kilwa", script), code=1)
    assert "kilwa build was killed by signal SIGKILL; perhaps memory ran out; tried 3 times" in text
    assert tries.read_text() == "\n\n\n"
    assert collection.strays() == []


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_ends_everything_cleanly(collection: Collection, number: int, code: int) -> None:
    """Ctrl-C in a terminal reaches the driver and its workers at once."""
    collection.make(3)
    driver = collection.start(kilwa=gated(collection))
    until(lambda: started(collection) == 2, "two builds run")
    family = tree(driver)
    if number == signal.SIGINT:
        os.killpg(driver.pid, number)
    else:
        driver.send_signal(number)
    text = collection.end(driver, code)
    assert "Traceback" not in text
    until(lambda: not any(process.is_running() for process in family), "all processes ended")
    assert collection.packs() == {}
    assert collection.strays() == []
