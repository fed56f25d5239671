"""Schedulers end by themselves when there is nothing to do, because their driver may have been killed; workers are restarted."""

from __future__ import annotations

import time

import dask
import psutil
import pytest
from conftest import LIMIT, kill, until, workers
from distributed import Client, LocalCluster, Status

from kilwa_dask import clusters


def test_a_scheduler_is_kept_busy_until_its_driver_has_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    """While the driver waits, the scheduler is never idle as long as the limit; afterwards it ends."""
    monkeypatch.setattr(clusters, "_KEEP_BUSY_EVERY", 0.1)
    settings = {"host": "127.0.0.1", "dashboard_address": "127.0.0.1:0", "scheduler_kwargs": {"idle_timeout": "2s"}}
    # Closing the cluster looks for the scheduler for so long.
    with (
        dask.config.set({"distributed.comm.timeouts.connect": "3s"}),
        LocalCluster(n_workers=1, processes=False, protocol="tcp", **settings) as cluster,
    ):
        with Client(cluster, set_as_default=False) as client:
            with clusters._kept_busy(client):
                end = time.monotonic() + 3
                until(lambda: time.monotonic() > end, "more than the limit has passed")
                assert cluster.scheduler.status == Status.running
            until(lambda: cluster.scheduler.status == Status.closed, "the scheduler has ended")


def test_a_worker_that_keeps_dying_is_started_again_however_long_it_takes() -> None:
    """It is killed whenever it starts, for longer than Dask by default waits for a lost worker (15 s); then it is left alone."""
    others = workers(psutil.Process())
    with clusters.opened(clusters.Choice(workers=1)) as client:
        end = time.monotonic() + 18

        def is_over() -> bool:
            for process in workers(psutil.Process()):
                if process not in others:
                    kill(process)
            return time.monotonic() > end

        until(is_over, "Dask by default would have given the worker up")
        assert client.submit(int, pure=False).result(timeout=LIMIT) == 0


def test_a_run_whose_workers_are_all_gone_says_so_and_stops(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its tasks wait for a worker that nobody starts."""
    for name, seconds in (("_LOOK_EVERY", 0.1), ("_TELL_AFTER", 0.3), ("_STOP_AFTER", 1.0)):
        monkeypatch.setattr(clusters, name, seconds)
    with pytest.raises(clusters.ClusterFailed, match=r"none has come back for .*; run the same command to continue"):
        with clusters.opened(clusters.Choice(workers=1)) as client:
            client.cluster.scale(0)
            client.submit(int, pure=False).result(timeout=LIMIT)
    assert capsys.readouterr().err.count("no worker is connected") == 1


def test_a_run_with_a_scheduler_of_its_own_waits_for_workers(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """They may join at any time, so the run only says that there is none."""
    for name, seconds in (("_LOOK_EVERY", 0.1), ("_TELL_AFTER", 0.3), ("_STOP_AFTER", 1.0)):
        monkeypatch.setattr(clusters, name, seconds)
    settings = {"host": "127.0.0.1", "dashboard_address": "127.0.0.1:0"}
    with (
        LocalCluster(n_workers=0, threads_per_worker=1, processes=False, protocol="tcp", **settings) as cluster,
        clusters.opened(clusters.Choice(scheduler=cluster.scheduler_address)) as client,
    ):
        result = client.submit(int, pure=False)
        end = time.monotonic() + 2
        until(lambda: time.monotonic() > end, "another run would have stopped")
        assert capsys.readouterr().err.count("no worker is connected") == 1
        cluster.scale(1)
        assert result.result(timeout=LIMIT) == 0
