"""Which files are meshes, what they are called, and which files beside them count."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from kilwa_dask import collection as meshes_of
from kilwa_dask.cli import _absolute
from kilwa_dask.collection import UsageError


def make(root: Path, *names: str) -> None:
    """Make files."""
    for name in names:
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("x")


def test_meshes_are_found_and_named(tmp_path: Path) -> None:
    """By folder and by pattern; not hidden ones, not those of the output."""
    for name in ("a.ply", "b.STL", "notes.txt", ".hidden.ply", "sub/c.obj", "out/d.ply", "e.nxs", "sub/f.NXZ"):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text("x")
    out = tmp_path / "out"

    def names(source: str) -> list[str]:
        return [mesh.name for mesh in meshes_of.find(source, None, out)]

    assert names(str(tmp_path)) == ["a", "b", "e", "sub/c", "sub/f"]
    assert names(f"{tmp_path}/*.ply") == ["a"]
    assert names(f"{tmp_path}/s*/*.obj") == ["sub/c"]
    assert names(f"{tmp_path}/a.ply") == ["a"]
    (mesh,) = meshes_of.find(f"{tmp_path}/s*/*.obj", "/m/*.toml", out)
    assert mesh.metadata == "/m/sub/c.toml"
    (tmp_path / "a.obj").write_text("x")
    with pytest.raises(UsageError, match=r"would both become a\.kilwa"):
        names(str(tmp_path))


def test_names_stay_below_the_output_if_the_pattern_leads_through_a_link(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whether the pattern is relative or absolute; `..` after a sign is refused."""
    make(tmp_path, "real/deep/scans/a.ply", "real/deep/scans/wing/b.ply")
    (tmp_path / "link").symlink_to("real/deep/scans")
    out = tmp_path / "out"
    real = tmp_path / "real/deep/scans"
    monkeypatch.chdir(tmp_path)
    for start in (f"{tmp_path}/", "", "./", "link/../../../"):
        source = f"{start}link/**/*.ply"
        found = meshes_of.find(source, None, out)
        assert [(mesh.name, mesh.path) for mesh in found] == [("a", f"{real}/a.ply"), ("wing/b", f"{real}/wing/b.ply")], source
    with pytest.raises(UsageError, match=r"\.\. cannot stand after"):
        meshes_of.find("link/w*/../*.ply", None, out)


def test_a_tileset_is_refused(tmp_path: Path) -> None:
    """However its tiles are named: each of them would become a pack."""
    make(tmp_path, "a.ply", "site/tileset.json", "site/tiles/0.glb", "points/tileset.json", "points/0.b3dm")
    site = str(tmp_path / "site")
    for source in (str(tmp_path), site, f"{site}/tiles", f"{tmp_path}/**/*.glb", f"{site}/tiles/0.glb", f"{site}/tileset.json"):
        with pytest.raises(UsageError, match=r"is one tileset of 3D Tiles.*build it alone: kilwa build"):
            meshes_of.find(source, None, tmp_path / "out")
    with pytest.raises(UsageError, match="points is one tileset"):
        meshes_of.find(str(tmp_path / "points"), None, tmp_path / "out")
    assert [mesh.name for mesh in meshes_of.find(f"{tmp_path}/*.ply", None, tmp_path / "out")] == ["a"]


def test_a_folder_that_cannot_be_read_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Instead of being left out."""
    make(tmp_path, "a.obj", "locked/b.ply")
    scandir = os.scandir

    def refusing(path: str) -> Iterator[os.DirEntry[str]]:
        if os.fspath(path).endswith("locked"):
            raise PermissionError(13, "Permission denied", os.fspath(path))
        return scandir(path)

    monkeypatch.setattr(os, "scandir", refusing)
    with pytest.raises(UsageError, match=r"cannot read the folder .*/locked: Permission denied"):
        meshes_of.find(str(tmp_path), None, tmp_path / "out")
    with pytest.raises(PermissionError, match="locked"):
        meshes_of.companions(tmp_path / "a.obj", [])


def test_a_link_to_a_folder_is_named_when_it_is_skipped(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The output is left out in silence, also through a link."""
    make(tmp_path, "in/a.ply", "other/b.ply", "out/c.ply")
    (tmp_path / "in/more").symlink_to(tmp_path / "other")
    (tmp_path / "in/packs").symlink_to(tmp_path / "out")
    assert [mesh.name for mesh in meshes_of.find(str(tmp_path / "in"), None, tmp_path / "out")] == ["a"]
    assert capsys.readouterr().err == f"kilwa-dask: {tmp_path}/in/more is skipped: links to folders are not followed\n"


def test_companions_are_found_through_links(tmp_path: Path) -> None:
    """Circles end."""
    make(tmp_path, "in/a.obj", "in/sub/a.mtl", "textures/wall.jpg")
    (tmp_path / "in/sub/textures").symlink_to(tmp_path / "textures")
    (tmp_path / "textures/back").symlink_to(tmp_path / "in/sub")
    (tmp_path / "in/up").symlink_to(tmp_path)
    found = meshes_of.companions(tmp_path / "in/a.obj", [])
    assert [path.relative_to(tmp_path).as_posix() for path in found] == ["in/sub/a.mtl", "in/sub/textures/wall.jpg"]


def test_files_in_options_become_absolute(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """So that each worker finds them, and tasks include their content in the key; `auto` is no file."""
    monkeypatch.chdir(tmp_path)
    make(tmp_path, "m.xf", "auto")
    matrix = str(tmp_path / "m.xf")
    assert list(_absolute(["--transform=m.xf", "--units", "mm"])) == ["--transform", matrix, "--units", "mm"]
    assert list(_absolute(["--transform", "m.xf"])) == ["--transform", matrix]
    assert list(_absolute(["--transform", "auto"])) == list(_absolute(["--transform=auto"])) == ["--transform", "auto"]
    assert list(_absolute(["--origin=-1,2,3", "--allow-outside"])) == ["--origin=-1,2,3", "--allow-outside"]
