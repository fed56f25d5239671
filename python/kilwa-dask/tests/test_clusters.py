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
