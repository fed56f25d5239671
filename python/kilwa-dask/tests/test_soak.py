"""The soak test (KILWA_SOAK=1): 300 meshes, the driver killed twice, every object published once."""

from __future__ import annotations

import json

from conftest import Collection, until

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
