"""Workers in jobs of Slurm, with stand-ins for its programs that run the jobs on this machine."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from conftest import Single, gated, open_gate, started, until, wrapper

from kilwa_dask import clusters, slurm
from kilwa_dask.cli import main

SBATCH = """cd "{folder}"
if [ "$1" = --test-only ]; then [ ! -e refuses ] || {{ echo "sbatch: error: invalid partition" >&2; exit 1; }}; exit 0; fi
number=$(($(ls -d job.* 2>/dev/null | wc -l) + 1))
cp "$1" "script.$number"
setsid sh "script.$number" > "slurm-$number.out" 2>&1 &
echo $! > "job.$number"
echo "Submitted batch job $number"
"""
SQUEUE = """cd "{folder}"
for job in job.*; do kill -0 "$(cat "$job")" 2>/dev/null && echo "${{job#job.}}"; done
exit 0
"""
SCANCEL = """cd "{folder}"
kill -9 -- "-$(cat "job.$1")"
"""


@dataclass
class Slurm:
    """The folder in which the stand-ins keep their jobs."""

    folder: Path

    def processes(self) -> list[int]:
        """Return the groups of processes of all jobs, the earliest first."""
        jobs = sorted(self.folder.glob("job.*"), key=lambda job: int(job.name.removeprefix("job.")))
        return [int(job.read_text()) for job in jobs]


@pytest.fixture
def stand_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Slurm]:
    """Put the stand-ins first on PATH; jobs that a failed test leaves running are killed."""
    folder = tmp_path / "slurm"
    folder.mkdir()
    for name, script in (("sbatch", SBATCH), ("squeue", SQUEUE), ("scancel", SCANCEL)):
        wrapper(folder / name, script.format(folder=folder))
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")
    made = Slurm(folder)
    yield made
    for group in made.processes():
        try:
            os.killpg(group, signal.SIGKILL)
        except ProcessLookupError:
            pass


def test_a_job_that_ends_is_replaced(single: Single, stand_in: Slurm, monkeypatch: pytest.MonkeyPatch) -> None:
    """Although it was the only one. Its task is begun again, and no job is left at the end."""
    monkeypatch.setenv("DASK_DISTRIBUTED__DEPLOY__LOST_WORKER_TIMEOUT", "1s")
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


def arguments(single: Single) -> list[str]:
    """Return the arguments of a driver in this process."""
    return single.arguments("--cluster", "slurm", "--kilwa", single.kilwa)


def test_jobs_that_slurm_refuses(single: Single, stand_in: Slurm, capsys: pytest.CaptureFixture[str]) -> None:
    """Its message is shown, and nothing is submitted."""
    (stand_in.folder / "refuses").touch()
    assert main(arguments(single)) == 1
    assert "Slurm does not accept the jobs: sbatch: error: invalid partition" in capsys.readouterr().err
    assert stand_in.processes() == []


def test_jobs_that_end_before_a_worker_joins(
    single: Single, stand_in: Slurm, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Three of them end the run, which names them."""
    monkeypatch.setattr(slurm, "_LOOK_EVERY", 200)
    monkeypatch.setattr(clusters, "_LOOK_EVERY", 0.2)
    wrapper(stand_in.folder / "sbatch", SBATCH.format(folder=stand_in.folder).replace('sh "script', 'true "script'))
    assert main(arguments(single)) == 1
    told = capsys.readouterr().err
    assert "the jobs 1, 2, 3 of Slurm ended before their workers joined" in told
    assert "slurm-3.out" in told
