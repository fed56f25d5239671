"""Workers in Slurm jobs, with fakes of its programs that run the jobs on this machine."""

from __future__ import annotations

import asyncio
import os
import re
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import dask
import psutil
import pytest
from conftest import LIMIT, Single, gated, open_gate, started, until, wrapper

from kilwa_dask import clusters, slurm
from kilwa_dask.cli import main

SBATCH = """cd "{folder}"
if [ "$1" = --test-only ]; then [ ! -e refuses ] || {{ echo "sbatch: error: invalid partition" >&2; exit 1; }}; exit 0; fi
number=1
until mkdir "number.$number" 2>/dev/null; do number=$((number + 1)); done
cp "$1" "script.$number"
said=$(sed -n "s/^#SBATCH -e //; T; s/%J/$number/; p" "$1")
setsid sh -c '{before}; exec sh "script.$0"' "$number" > "${{said:-slurm-$number.out}}" 2>&1 &
echo $! > "job.$number"
echo "Submitted batch job $number"
"""
SQUEUE = """cd "{folder}"
for job in job.*; do [ -e "$job" ] && kill -0 "$(cat "$job")" 2>/dev/null && echo "${{job#job.}}"; done
exit 0
"""
SCANCEL = """cd "{folder}"
kill -9 -- "-$(cat "job.$1")"
"""


@dataclass
class Slurm:
    """The folder in which the fakes keep their jobs."""

    folder: Path

    def prepare(self, before: str = ":") -> None:
        """Write the fakes; `before` is what a job does first, $0 is its number."""
        for name, script in (("sbatch", SBATCH), ("squeue", SQUEUE), ("scancel", SCANCEL)):
            new = Path(wrapper(self.folder / f"{name}.new", script.format(folder=self.folder, before=before)))
            new.replace(self.folder / name)

    def processes(self) -> list[int]:
        """Return the process groups of all jobs, the earliest first."""
        jobs = sorted(self.folder.glob("job.*"), key=lambda job: int(job.name.removeprefix("job.")))
        return [int(job.read_text()) for job in jobs]


@pytest.fixture
def stand_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Slurm]:
    """Put the fakes first on PATH; kill the jobs that a failed test leaves running."""
    folder = tmp_path / "slurm"
    folder.mkdir()
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")
    made = Slurm(folder)
    made.prepare()
    yield made
    for group in made.processes():
        try:
            os.killpg(group, signal.SIGKILL)
        except ProcessLookupError:
            pass


@pytest.fixture
def hurried(monkeypatch: pytest.MonkeyPatch) -> None:
    """Use short intervals and delays in this process."""
    monkeypatch.setattr(slurm, "_LOOK_EVERY", 100)
    monkeypatch.setattr(slurm, "_FIRST_WAIT", 0.1)
    monkeypatch.setattr(clusters, "_LOOK_EVERY", 0.2)


def test_a_job_that_ends_is_replaced(single: Single, stand_in: Slurm) -> None:
    """Even if it was the only one. Its task is restarted, and no job is left at the end."""
    driver = single.start("--cluster", "slurm", "--workers", "1", "--threads", "1", kilwa=gated(single, verb="task"))
    until(lambda: started(single, "ingest") == 1, "the ingest runs")
    (job,) = stand_in.processes()
    os.killpg(job, signal.SIGKILL)
    until(lambda: started(single, "ingest") == 2, "another job does the ingest")
    assert len(stand_in.processes()) == 2
    open_gate(single)
    single.end(driver)
    assert single.told()["total"]["retries"] == 1
    single.check()


def arguments(single: Single, workers: int = 1, kilwa: str | None = None) -> list[str]:
    """Return the arguments of a driver in this process."""
    return single.arguments("--cluster", "slurm", "--workers", str(workers), "--kilwa", kilwa or single.kilwa)


@contextmanager
def meanwhile(act: Callable[[], None]) -> Iterator[None]:
    """Call `act` in another thread, and check that it did not fail."""
    with ThreadPoolExecutor(1) as pool:
        acting = pool.submit(act)
        yield
        acting.result()


def test_jobs_that_slurm_refuses(single: Single, stand_in: Slurm, capsys: pytest.CaptureFixture[str]) -> None:
    """Its message is shown, and nothing is submitted."""
    (stand_in.folder / "refuses").touch()
    assert main(arguments(single)) == 1
    assert "Slurm does not accept the jobs: sbatch: error: invalid partition" in capsys.readouterr().err
    assert stand_in.processes() == []


@pytest.mark.parametrize("logs", [False, True])
@pytest.mark.usefixtures("hurried")
def test_jobs_that_end_before_a_worker_joins(
    single: Single, stand_in: Slurm, logs: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    """Three such jobs end the run with a message that names them and the output file of the last one."""
    stand_in.prepare("echo said by $0; exit 1")
    folder = stand_in.folder / "logs" if logs else None
    with dask.config.set({"jobqueue.slurm.log-directory": folder and str(folder)}):
        assert main(arguments(single)) == 1
    told = capsys.readouterr().err
    assert "Slurm jobs 1, 2, 3 ended before their workers joined" in told
    named = re.search(r"\(for example (.+)\)", told)
    assert named is not None
    # sbatch resolves a relative name in the current folder, the fake in its own folder.
    assert (stand_in.folder / named[1]).read_text() == "said by 3\n"
    assert named[1] == (f"{folder}/dask-worker-3.err" if logs else "slurm-3.out")


@pytest.mark.parametrize(
    ("header", "file"),
    [
        ("#SBATCH -J dask-worker\n#SBATCH -n 1", "slurm-14.out"),
        ("#SBATCH -e logs/dask-worker-%J.err\n#SBATCH -o logs/dask-worker-%J.out", "logs/dask-worker-14.err"),
        ("#SBATCH -o logs/dask-worker-%J.out", "logs/dask-worker-14.out"),
        ("#SBATCH -e logs/x\n#SBATCH --error=/var/%x.%j", "/var/worker.14"),
        ("#SBATCH --output all-%A", "all-14"),
    ],
)
def test_the_file_with_the_messages_of_a_job(header: str, file: str) -> None:
    """The file for errors if there is one, otherwise that for output; the last directive counts."""
    assert slurm._output_of("14", header, "worker") == file


@pytest.mark.usefixtures("hurried")
def test_jobs_that_end_at_once_after_a_worker_has_joined(
    single: Single, stand_in: Slurm, capsys: pytest.CaptureFixture[str]
) -> None:
    """They are not resubmitted forever: three failed jobs end the run."""

    def end_the_job() -> None:
        until(lambda: started(single, "ingest") == 1, "the ingest runs")
        stand_in.prepare("exit 1")
        os.killpg(stand_in.processes()[0], signal.SIGKILL)

    with meanwhile(end_the_job):
        assert main(arguments(single, kilwa=gated(single, verb="task"))) == 1
    assert "Slurm jobs 2, 3, 4 ended before their workers joined" in capsys.readouterr().err
    assert len(stand_in.processes()) == 4


@pytest.mark.usefixtures("hurried")
def test_the_run_waits_for_queued_jobs(single: Single, stand_in: Slurm) -> None:
    """Three of the first four jobs fail, for example on one bad node; the others start later and do the work."""
    stand_in.prepare("[ $0 -gt 3 ] || exit 1; while [ ! -e begins ]; do sleep 0.05; done")

    def begin() -> None:
        until(lambda: len(stand_in.processes()) == 7, "the three were replaced")
        (stand_in.folder / "begins").touch()

    with meanwhile(begin):
        assert main(arguments(single, workers=4)) == 0
    single.check()


@pytest.mark.usefixtures("hurried")
def test_the_run_ends_after_as_many_failed_jobs_as_workers(
    single: Single, stand_in: Slurm, capsys: pytest.CaptureFixture[str]
) -> None:
    """Even if another one is still queued."""
    stand_in.prepare("[ $0 -eq 2 ] || exit 1; sleep 1000")
    assert main(arguments(single, workers=4)) == 1
    assert "ended before their workers joined" in capsys.readouterr().err


def test_a_job_that_joins_and_ends_between_two_checks(stand_in: Slurm, monkeypatch: pytest.MonkeyPatch) -> None:
    """It does not count as failed. Its replacement has another name, so that dask does not close it when it forgets the first."""
    monkeypatch.setattr(slurm, "_LOOK_EVERY", 1e9)
    with (
        dask.config.set({"distributed.deploy.lost-worker-timeout": "500ms"}),
        clusters.opened(clusters.Choice(kind="slurm")) as client,
    ):
        cluster = client.cluster
        client.wait_for_workers(1, timeout=LIMIT)
        stand_in.prepare("while [ ! -e begins ]; do sleep 0.05; done")
        (job,) = stand_in.processes()
        os.killpg(job, signal.SIGKILL)
        until(lambda: not cluster.scheduler_info["workers"] and not psutil.pid_exists(job), "the job has ended")
        cluster.sync(cluster.kilwa_dask_jobs._look)
        until(lambda: len(stand_in.processes()) == 2, "another job was submitted")
        # Runs after what dask scheduled earlier with the same delay.
        cluster.sync(asyncio.sleep, 0.6)
        (stand_in.folder / "begins").touch()
        client.wait_for_workers(1, timeout=LIMIT)
        assert cluster.kilwa_dask_jobs._in_vain == []
        assert len(stand_in.processes()) == 2
