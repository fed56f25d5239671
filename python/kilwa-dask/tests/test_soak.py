"""The soak tests (KILWA_SOAK=1): 300 meshes and two killed drivers; one mesh and 60 random kills, also in a busy store."""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from typing import Any

import pytest
from busy import proxy
from conftest import LIMIT, Collection, Single, kill, until, workers, wrapper
from test_store import Stored, store, stored

# Fixtures of another module.
__all__ = ["store", "stored"]

MESHES = 300


def test_a_collection_of_300_survives_two_killed_drivers(collection: Collection) -> None:
    """All packs are identical to those of plain `kilwa build` and published exactly once."""
    names = collection.make(MESHES, triangles=1000)
    options = ["--metadata", str(collection.root / "metadata"), "--publish", str(collection.store)]

    def published() -> int:
        return sum(1 for _ in collection.store.glob("*/manifest.json"))

    for enough in (MESHES // 4, MESHES // 2):
        driver = collection.start(*options)
        until(lambda enough=enough: published() >= enough, f"{enough} objects")  # type: ignore[misc]
        driver.kill()
        driver.wait()
    report_file = collection.root / "report.json"
    collection.run(*options, "--json", str(report_file))
    report = json.loads(report_file.read_text())
    print({key: value for key, value in report.items() if key != "meshes"})
    versions = [json.loads(path.read_text())["versions"] for path in collection.store.glob("*/manifest.json")]
    assert [len(each) for each in versions] == [1] * MESHES
    assert collection.packs() == collection.plain(names)
    assert collection.strays() == []
    assert report["already_done"] >= MESHES // 2 - 4


def test_one_build_survives_50_killed_workers_and_10_killed_drivers(single: Single) -> None:
    """At random moments. Builds that come to their end are begun again until there have been enough."""
    single.make(triangles="200k")
    soak(single, lambda kilwa: single.start("--scratch", str(single.scratch), kilwa=kilwa), single.out.unlink)


def test_a_build_in_a_busy_store_survives_the_same(stored: Stored, monkeypatch: pytest.MonkeyPatch) -> None:
    """Three of ten requests to the store fail while workers and drivers are killed."""
    bucket = stored.store
    assert bucket is not None
    stored.make("60k")
    with proxy(int(bucket.url.rpartition(":")[2]), percent=30, seed=25) as (port, seen):
        monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{port}")
        soak(stored, lambda kilwa: stored.start(kilwa=kilwa), lambda: bucket.ask("/packs/mesh.kilwa", "DELETE"))
    print(seen)
    assert seen["busy"] * 5 > seen["all"]


def soak(made: Single | Stored, start: Callable[[str], Any], remove_pack: Callable[[], object]) -> None:
    """Kill 50 workers and 10 drivers at random moments, and check every pack; builds are begun again until the last is killed."""
    sleeps = f'if [ "$1" = task ] || [ "$1" = assemble ]; then touch "{made.root}/started.$$"; sleep 0.1; fi'
    kilwa = wrapper(made.root / "kilwa", f'{sleeps}\nexec "{made.kilwa}" "$@"\n')
    left = {"workers": 50, "drivers": 10}
    counts = {"packs": 0, "stopped": 0}
    chance = random.Random(25)

    def started() -> int:
        return sum(1 for _ in made.root.glob("started.*"))

    def begin() -> Any:
        made.report.unlink(missing_ok=True)
        return start(kilwa)

    driver = begin()
    while True:
        seen, wanted = started(), chance.randint(1, 12)
        until(lambda: driver.poll() is not None or started() >= seen + wanted, "tasks begin")  # noqa: B023
        if driver.poll() is not None:
            text, _ = driver.communicate(timeout=LIMIT)
            if driver.returncode == 0:
                made.check()
                counts["packs"] += 1
                if not any(left.values()):
                    break
                remove_pack()
            else:
                counts["stopped"] += 1
                failure = json.loads(made.report.read_text())["failure"] if made.report.exists() else text + made.messages(driver)
                assert "3 workers died while processing" in str(failure)
            driver = begin()
        elif left["drivers"] and chance.random() < 0.2:
            left["drivers"] -= 1
            driver.kill()
            driver.wait()
            driver = begin()
        elif left["workers"] and (found := workers(driver)):
            left["workers"] -= 1
            kill(chance.choice(found))
    print(counts)
