"""One build that is divided into tasks: whatever is killed or fails, the pack is the same, and nothing is left over."""

from __future__ import annotations

import random
from functools import partial
from pathlib import Path

import pytest
from conftest import Single, gated, kill_worker_of, open_gate, started, until, wrapper
from distributed import Client

from kilwa_dask import cli, divided, drive
from kilwa_dask.divided import Build
from kilwa_dask.files import write_whole
from kilwa_dask.run import announced


def test_three_killed_workers_and_a_killed_driver(single: Single) -> None:
    """At tasks of different waves; the same command continues."""
    options = ["--scratch", str(single.scratch)]
    kilwa = gated(single, verb="task")
    first = single.start(*options, kilwa=kilwa)
    until(lambda: started(single, "ingest") == 1, "the ingest runs")
    kill_worker_of(single, "ingest")
    until(lambda: started(single, "ingest") == 2, "another worker does the ingest")
    open_gate(single, "ingest")
    for number in range(100):
        open_gate(single, f"region-{number:04}")
    until(lambda: started(single, "tree") == 1, "the wave after the next runs")
    kill_worker_of(single, "tree")
    until(lambda: started(single, "tree") == 2, "another worker does it")
    first.kill()
    first.wait()
    second = single.start(*options, kilwa=kilwa)
    until(lambda: started(single, "tree") == 3, "the second driver does it")
    open_gate(single, "tree")
    until(lambda: started(single, "leaves-*") == 2, "two tasks run")
    kill_worker_of(single, random.choice([path.name.split(".")[1] for path in single.root.glob("started.leaves-*")]))
    until(lambda: started(single, "leaves-*") == 3, "another worker does it")
    open_gate(single)
    single.end(second)
    told = single.told()
    assert {stage["stage"]: stage["retries"] for stage in told["stages"] if stage["retries"]} == {"tree": 2, "leaves": 1}
    regions = next(stage["tasks"] for stage in told["stages"] if stage["stage"] == "region")
    assert told["total"]["earlier"] == 1 + regions > 2
    single.check()


class Died(BaseException):
    """Stands for a death at a certain moment."""


@pytest.mark.parametrize("moment", ["before it has its name", "after it has its name"])
def test_a_death_while_the_pack_is_put_in_place(single: Single, moment: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same command continues, although the output may exist, and removes what is left."""
    stops = f'if [ "$1" = assemble ]; then exit 1; fi\nexec "{single.kilwa}" "$@"\n'
    single.run(code=1, kilwa=wrapper(single.root / "kilwa", stops))
    options = cli.parser().parse_args(single.arguments("--kilwa", single.kilwa))
    plan = cli._build_plan(options, [], str(single.out), str(single.work))
    (folder,) = single.work.glob("kilwa-build-*")
    build = Build(str(folder), folder.name.removeprefix("kilwa-build-"))

    def die(*given: object) -> None:
        if moment == "before it has its name":
            write_whole(Path(str(given[0])), str(given[1]))
        raise Died

    with monkeypatch.context() as patched, announced(plan):
        patched.setattr(divided, "write_whole" if moment == "before it has its name" else "sync_folder", die)
        with pytest.raises(Died):
            divided.assemble(build, wait=True, plan=plan)
    assert plan.record.exists()
    assert folder.is_dir()
    assert single.out.exists() == (moment == "after it has its name")
    assert f"SHA-256 {single.sha256_of_plain_build(single.mesh)}" in single.run()
    single.check()
    assert "exists already" in single.run(code=2)


def test_a_task_leaves_a_worker_whose_disk_is_full(single: Single) -> None:
    """The other worker does every task that this one tried and failed, and the build finishes."""
    full, tried = single.root / "full", single.root / "tried"
    # The first worker that starts a level task has the full disk.
    first = f'[ -e "{full}" ] || ln -s $PPID "{full}"'
    says = 'echo "kilwa: cannot write x: No space left on device (os error 28)" >&2; exit 1'
    fails = f'if [ "$(readlink "{full}")" = $PPID ]; then basename "$2" >> "{tried}"; {says}; fi'
    case = f'case "$*" in "task "*level-*) {first}; {fails};; esac\n'
    kilwa = wrapper(single.root / "kilwa", f'{case}exec "{single.kilwa}" "$@"\n')
    single.run("--scratch", str(single.scratch), kilwa=kilwa)
    tasks = tried.read_text().split()
    assert len(tasks) == len(set(tasks)) >= 1
    assert single.told()["total"]["retries"] == len(tasks)
    single.check()


def test_a_worker_that_should_be_avoided_returns_the_task(two_workers: Client) -> None:
    """Schedulers may assign it to an idle worker even though others are preferred."""
    first, second = two_workers.scheduler_info()["workers"]

    def avoiding(avoid: str) -> object:
        work = partial(drive._attempt, lambda item, wait: item, "x", wait=False, avoid=(avoid,))
        return two_workers.submit(work, workers=[first], pure=False).result()

    assert avoiding(first) == drive.Again("", None)
    assert avoiding(second) == "x"


def test_a_worker_killed_while_the_pack_is_assembled(single: Single) -> None:
    """Another assembles it."""
    once = single.root / "once"
    script = f'if [ "$1" = assemble ] && mkdir "{once}"; then kill -9 $PPID; exec sleep 60; fi\nexec "{single.kilwa}" "$@"\n'
    single.run(kilwa=wrapper(single.root / "kilwa", script))
    assert single.told()["total"]["retries"] == 1
    single.check()


PLACE = "the task level-02-0001 (near 1.00, 0.01, -1.50 m)"


@pytest.mark.parametrize(
    ("fails", "message", "tries"),
    [
        ('echo "kilwa: cannot write x: No space left on device (os error 28)" >&2; exit 1', "(os error 28)", 3),
        ('echo "kilwa: the triangle is not one" >&2; exit 1', "the triangle is not one", 1),
        ("kill -9 $$", "kilwa task was killed by signal SIGKILL; perhaps memory ran out", 3),
        ("kill -9 $PPID; exec sleep 60", "3 workers died", 3),
    ],
    ids=["a full disk", "a fault of the model", "kilwa killed", "workers killed"],
)
def test_a_task_that_fails_is_named_with_its_place(single: Single, fails: str, message: str, tries: int) -> None:
    """After three tries if another one might have helped; the same command continues when the cause is gone."""
    tried = single.root / "tries"
    case = f'case "$*" in "task "*level-02-0001.json*) echo >> "{tried}"; {fails};; esac\n'
    kilwa = wrapper(single.root / "kilwa", f'{case}exec "{single.kilwa}" "$@"\n')
    text = single.run("--scratch", str(single.scratch), code=1, kilwa=kilwa)
    assert f"{PLACE}: " in text
    assert message in text
    assert ("tried 3 times" in text) == (tries == 3 and "workers" not in message)
    assert tried.read_text() == "\n" * tries
    told = single.told()
    assert told["stopped"]
    assert told["failure"] in text
    assert all("kilwa-build-" in left for left in single.left_over())
    single.run()
    single.check()
