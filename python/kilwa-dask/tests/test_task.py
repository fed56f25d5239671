"""The task of one mesh, without a cluster."""

from __future__ import annotations

import errno
import os
import uuid
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import Collection

from kilwa_dask import collection as meshes_of
from kilwa_dask import program
from kilwa_dask.collection import UsageError
from kilwa_dask.files import Busy, locked, write_whole
from kilwa_dask.manifest import Manifest
from kilwa_dask.task import Outcome, Plan, announced, mesh_id, sweep, work_on


@pytest.fixture
def plan(collection: Collection) -> Iterator[Plan]:
    """Return the plan of a run that goes on, and check that it leaves nothing over."""
    made = Plan(uuid.uuid4().hex, str(collection.out), collection.kilwa, program.version(collection.kilwa))
    with announced(made):
        yield made
    assert sweep(collection.out)
    assert not (collection.out / ".kilwa-dask").exists()


def work(collection: Collection, plan: Plan) -> Outcome:
    """Work on the only mesh of a collection."""
    (mesh,) = meshes_of.find(str(collection.meshes), None, collection.out)
    return work_on(mesh, plan)


def test_what_changed_is_built_again_and_nothing_else(collection: Collection, plan: Plan) -> None:
    """A pack that was damaged, a mesh or a file that it names, and an option."""
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

    options = Plan(plan.run, plan.output, plan.program, plan.version, ("--color-bits", "6"))
    assert work(collection, options).state == "built"


def test_a_change_of_a_material_builds_the_mesh_again(collection: Collection, plan: Plan) -> None:
    """The materials of an OBJ file are files of their own."""
    collection.meshes.mkdir()
    triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n"
    (collection.meshes / "wall.obj").write_text("mtllib wall.mtl\n" + triangle)
    material = collection.meshes / "wall.mtl"
    material.write_text("newmtl a\nKd 1 0 0\n")
    first = work(collection, plan)
    assert (first.state, first.triangles) == ("built", 1), first.message
    assert work(collection, plan).state == "already done"
    material.write_text("newmtl a\nKd 0 0 1\n")
    second = work(collection, plan)
    assert second.state == "built"
    assert second.pack_sha256 != first.pack_sha256


def test_a_pack_of_somebody_else_is_not_replaced(collection: Collection, plan: Plan) -> None:
    """But one that is the same, as a killed task leaves it before its manifest, is taken over."""
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
    """Here when the manifest is written; the pack is then not done."""
    collection.make(1)

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", "manifest")

    with monkeypatch.context() as patched:
        patched.setattr(Manifest, "write", full)
        outcome = work(collection, plan)
    assert outcome.state == "failed"
    assert "(the disk is full)" in str(outcome.message)
    assert work(collection, plan).state == "built"


def test_a_lock_is_held_by_one(tmp_path: Path) -> None:
    """And its file is gone afterwards."""
    path = tmp_path / "lock"
    with locked(path):
        with pytest.raises(Busy), locked(path, wait=False):
            pass
        assert path.exists()
    assert not path.exists()


def test_a_text_appears_whole_or_not_at_all(tmp_path: Path) -> None:
    """Nothing is left if it cannot get its name."""
    (tmp_path / "taken").mkdir()
    with pytest.raises(OSError):
        write_whole(tmp_path / "taken", "text")
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]


def test_names_give_different_ids() -> None:
    """Also if only signs differ that are not kept."""
    assert len({mesh_id(name) for name in ("a/b", "a_b", "a b", "x" * 300 + "/b")}) == 4


def test_meshes_are_found_and_named(tmp_path: Path) -> None:
    """By folder and by pattern; not hidden ones, not those of the output."""
    for name in ("a.ply", "b.STL", "notes.txt", ".hidden.ply", "sub/c.obj", "out/d.ply"):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text("x")
    out = tmp_path / "out"

    def names(source: str) -> list[str]:
        return [mesh.name for mesh in meshes_of.find(source, None, out)]

    assert names(str(tmp_path)) == ["a", "b", "sub/c"]
    assert names(f"{tmp_path}/*.ply") == ["a"]
    assert names(f"{tmp_path}/s*/*.obj") == ["sub/c"]
    assert names(f"{tmp_path}/a.ply") == ["a"]
    (mesh,) = meshes_of.find(f"{tmp_path}/s*/*", "/m/*.toml", out)
    assert mesh.metadata == "/m/sub/c.toml"
    (tmp_path / "a.obj").write_text("x")
    with pytest.raises(UsageError, match=r"would both become a\.kilwa"):
        names(str(tmp_path))
