"""The task of one mesh, without a cluster."""

from __future__ import annotations

import errno
import os
import uuid
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from conftest import Collection, wrapper

from kilwa_dask import collection as meshes_of
from kilwa_dask import files, program, task
from kilwa_dask.files import Busy, locked, sha256, write_whole
from kilwa_dask.manifest import Manifest, key_of
from kilwa_dask.run import WorkerRefused, announced, file_id, sweep
from kilwa_dask.task import Outcome, Plan, work_on


@pytest.fixture
def plan(collection: Collection) -> Iterator[Plan]:
    """Return the plan of an active run, and check that it leaves nothing behind."""
    made = Plan(uuid.uuid4().hex, (str(collection.out),), collection.kilwa, program.version(collection.kilwa), ())
    with announced(made):
        yield made
    assert sweep(collection.out)
    assert not (collection.out / ".kilwa-dask").exists()


def work(collection: Collection, plan: Plan) -> Outcome:
    """Work on the only mesh of a collection."""
    (mesh,) = meshes_of.find(str(collection.meshes), None, collection.out)
    return work_on(mesh, plan)


def wall(collection: Collection) -> Path:
    """Make an OBJ file of one triangle; return its material file."""
    collection.meshes.mkdir()
    (collection.meshes / "wall.obj").write_text("mtllib wall.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n")
    material = collection.meshes / "wall.mtl"
    material.write_text("newmtl a\nKd 1 0 0\n")
    return material


def test_what_changed_is_built_again_and_nothing_else(collection: Collection, plan: Plan) -> None:
    """A damaged pack, a changed mesh, and a changed option."""
    (name,) = collection.make(1)
    assert work(collection, plan).state == "built"
    assert work(collection, plan).state == "already done"

    pack = collection.out / f"{name}.kilwa"
    good = pack.read_bytes()
    pack.write_bytes(good[:-1] + bytes([good[-1] ^ 1]))
    assert work(collection, plan).state == "built"
    assert pack.read_bytes() == good

    os.utime(collection.meshes / f"{name}.ply")
    assert work(collection, plan).state == "already done"
    mesh = collection.meshes / f"{name}.ply"
    mesh.write_bytes(mesh.read_bytes().replace(b"end_header", b"comment changed\nend_header", 1))
    assert work(collection, plan).state == "built"

    options = replace(plan, options=("--color-bits", "6"))
    assert work(collection, options).state == "built"


def test_a_change_of_a_material_builds_the_mesh_again(collection: Collection, plan: Plan) -> None:
    """The materials of an OBJ file are in separate files."""
    material = wall(collection)
    first = work(collection, plan)
    assert (first.state, first.triangles) == ("built", 1), first.message
    assert work(collection, plan).state == "already done"
    material.write_text("newmtl a\nKd 0 0 1\n")
    second = work(collection, plan)
    assert second.state == "built"
    assert second.pack_sha256 != first.pack_sha256


def test_what_runs_write_beside_a_mesh_does_not_build_it_again(collection: Collection, plan: Plan) -> None:
    """The output, the store and the report, if they lie below the folder of an OBJ file."""
    wall(collection)
    below = {name: str(collection.meshes / name) for name in ("out", "store", "report.json")}
    inside = replace(plan, run=uuid.uuid4().hex, shared=(below["out"],), publish=below["store"], report=below["report.json"])
    unpublished = replace(inside, publish=None)
    (mesh,) = meshes_of.find(str(collection.meshes), None, Path(inside.output))
    with announced(inside):
        assert work_on(mesh, unpublished).state == "built"
        found = meshes_of.companions(Path(mesh.path), inside.written())
        for name in ("out/notes", "store/wall/page.html", "report.json"):
            path = collection.meshes / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text("x")
        assert meshes_of.companions(Path(mesh.path), inside.written()) == found == [collection.meshes / "wall.mtl"]
        (collection.meshes / "store/wall/page.html").unlink()
        assert work_on(mesh, unpublished).state == "already done"
    assert sweep(Path(inside.output))


def test_a_companion_is_read_once_for_all_meshes(collection: Collection, plan: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    """And again when it changed."""
    material = wall(collection)
    (collection.meshes / "door.obj").write_text((collection.meshes / "wall.obj").read_text())
    read: list[str] = []

    def counted(path: Path) -> str:
        read.append(path.name)
        return sha256(path)

    monkeypatch.setattr(files, "sha256", counted)
    meshes = meshes_of.find(str(collection.meshes), None, collection.out)
    assert [work_on(mesh, plan).state for mesh in meshes] == ["built", "built"]
    assert read.count("wall.mtl") == 1
    material.write_text("newmtl a\nKd 0 0 1\n")
    assert [work_on(mesh, plan).state for mesh in meshes] == ["built", "built"]
    assert read.count("wall.mtl") == 2


def test_a_change_of_a_matrix_beside_a_mesh_builds_it_again(collection: Collection, plan: Plan) -> None:
    """With `--transform auto` only."""
    (name,) = collection.make(1)
    matrix = (collection.meshes / name).with_suffix(".xf")
    matrix.write_text("1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n")
    auto = replace(plan, options=("--transform", "auto"))
    first = work(collection, auto)
    assert first.state == "built", first.message
    assert work(collection, auto).state == "already done"
    matrix.write_text("1 0 0 5\n0 1 0 0\n0 0 1 0\n0 0 0 1\n")
    second = work(collection, auto)
    assert second.state == "built"
    assert second.pack_sha256 != first.pack_sha256
    assert work(collection, plan).state == "built"
    matrix.unlink()
    assert work(collection, plan).state == "already done"


@pytest.mark.parametrize("changed", ["wall.obj", "wall.mtl"])
@pytest.mark.parametrize("when", ["between checksum and build", "in the build"])
def test_a_change_while_it_is_built_is_reported(
    collection: Collection, plan: Plan, changed: str, when: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of the mesh or of a file beside it; the pack gets no name."""
    wall(collection)
    path = collection.meshes / changed
    if when == "in the build":
        script = f'if [ "$1" = build ]; then echo "# x" >> "{path}"; fi\nexec "{collection.kilwa}" "$@"\n'
        plan = replace(plan, program=wrapper(collection.root / "kilwa", script))
    else:

        def changing(**parts: object) -> str:
            with path.open("a") as file:
                file.write("# x\n")
            return key_of(**parts)

        monkeypatch.setattr(task, "key_of", changing)
    outcome = work(collection, plan)
    assert (outcome.state, outcome.stage) == ("failed", "place")
    assert f"changed while the pack was built: {path}" in str(outcome.message)
    assert collection.packs() == {}
    monkeypatch.undo()
    assert work(collection, replace(plan, program=collection.kilwa)).state == "built"


def test_a_worker_that_cannot_take_part_says_nothing_about_the_mesh(collection: Collection, plan: Plan) -> None:
    """It has another version, or does not see the output."""
    collection.make(1)
    with pytest.raises(WorkerRefused, match=r"but this computer has kilwa 9\.9\.9"):
        work(collection, replace(plan, version="kilwa 9.9.9"))
    with pytest.raises(WorkerRefused, match="must be shared under the same path on all machines"):
        work(collection, replace(plan, shared=(str(collection.root / "elsewhere"),)))


def test_a_foreign_pack_is_not_replaced(collection: Collection, plan: Plan) -> None:
    """But an identical one, which a task killed before writing the manifest leaves behind, is accepted."""
    (name,) = collection.make(1)
    pack = collection.out / f"{name}.kilwa"
    pack.parent.mkdir()
    pack.write_text("mine")
    outcome = work(collection, plan)
    assert (outcome.state, outcome.stage) == ("failed", "place")
    assert "move it away or delete it" in str(outcome.message)
    assert pack.read_text() == "mine"

    pack.unlink()
    assert work(collection, plan).state == "built"
    pack.with_name(pack.name + ".json").unlink()
    assert work(collection, plan).state == "built"


def test_a_full_disk_is_reported(collection: Collection, plan: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    """Here the disk is full when the manifest is written, so the pack is not done."""
    collection.make(1)

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", "manifest")

    with monkeypatch.context() as patched:
        patched.setattr(Manifest, "write", full)
        outcome = work(collection, plan)
    assert outcome.state == "failed"
    assert "(the disk is full)" in str(outcome.message)
    assert work(collection, plan).state == "built"


def test_a_lock_has_one_holder(tmp_path: Path) -> None:
    """And its file is gone afterwards."""
    path = tmp_path / "lock"
    with locked(path):
        with pytest.raises(Busy), locked(path, wait=False):
            pass
        assert path.exists()
    assert not path.exists()


def test_text_files_are_written_atomically(tmp_path: Path) -> None:
    """No temporary file remains if the rename fails."""
    (tmp_path / "taken").mkdir()
    with pytest.raises(OSError):
        write_whole(tmp_path / "taken", "text")
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]


def test_names_give_different_ids() -> None:
    """Even if they differ only in characters that are replaced."""
    assert len({file_id(name) for name in ("a/b", "a_b", "a b", "x" * 300 + "/b")}) == 4
