"""Finds the meshes of a collection, their names, and their metadata files."""

from __future__ import annotations

import glob
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

EXTENSIONS = frozenset({".ply", ".obj", ".stl", ".gltf", ".glb", ".nxs", ".nxz"})
# Formats that may refer to other files: materials, pictures, buffers.
WITH_COMPANIONS = frozenset({".obj", ".gltf", ".glb"})


class UsageError(Exception):
    """The command line requests something that cannot be done; nothing was started."""


@dataclass(frozen=True)
class Mesh:
    """A mesh of the collection. All paths are absolute."""

    name: str
    """Path below the collection without extension, with slashes: the pack is NAME.kilwa in the output folder."""
    path: str
    bytes: int
    metadata: str | None
    """Its metadata file, which may not exist."""


def find(source: str, metadata: str | None, output: Path) -> list[Mesh]:
    """List the meshes of a folder (with its subfolders) or of a pattern such as 'scans/*.ply', sorted by name.

    Hidden files and folders and the output folder are left out. Links to folders are followed only where a pattern leads
    through them; below a folder they are named on standard error. `metadata` is a folder, in which the file of NAME is
    NAME.toml, or a pattern whose `*` stands for NAME. Raises `UsageError` if there are no meshes, if two would become the
    same pack, if one is a tileset, or if a folder cannot be read.
    """
    base, paths = _paths(source, output)
    meshes: dict[str, Mesh] = {}
    for path in paths:
        if output in path.parents:
            continue
        name = path.relative_to(base).with_suffix("").as_posix()
        if name in meshes:
            raise UsageError(f"{meshes[name].path} and {path} would both become {name}.kilwa; rename one of them")
        meshes[name] = Mesh(name, str(path), path.stat().st_size, _metadata(metadata, name))
    if not meshes:
        endings = ", ".join(sorted(EXTENSIONS))
        raise UsageError(f"{source}: there are no meshes ({endings})")
    return [meshes[name] for name in sorted(meshes)]


def _paths(source: str, output: Path) -> tuple[Path, list[Path]]:
    folder = Path(source)
    if folder.is_dir():
        base = folder.resolve()
        return base, sorted(_meshes_below(base, output))
    if glob.has_magic(source):
        before = source[: min(source.find(sign) for sign in "*?[" if sign in source)]
        start = Path(before if before.endswith("/") else os.path.dirname(before))
        base = start.resolve()
        # The way to the folder may lead through links; names below it are kept as they are.
        relative = [Path(text).relative_to(start) for text in glob.glob(source, recursive=True)]
        if any(".." in path.parts for path in relative):
            raise UsageError(f"{source}: .. cannot stand after a sign such as *, because packs are named after what is there")
        found = {base / path for path in relative}
        _refuse_tilesets(path.parent for path in found)
        return base, sorted(path for path in found if _is_mesh(path))
    if folder.is_file():
        base = folder.parent.resolve()
        _refuse_tilesets([base])
        return base, [base / folder.name]
    raise UsageError(f"{source}: there is no such folder, and it is not a pattern such as 'scans/*.ply'")


def _meshes_below(base: Path, output: Path) -> Iterator[Path]:
    skipped: list[Path] = []
    try:
        for folder, files in _walk(base, [output], skipped):
            _refuse_tilesets([folder])
            yield from (path for name in files if _is_mesh(path := folder / name))
    except OSError as error:
        raise UsageError(f"cannot read the folder {error.filename}: {error.strerror}") from error
    for link in skipped:
        print(f"kilwa-dask: {link} is skipped: links to folders are not followed", file=sys.stderr)


def _walk(base: Path, without: Sequence[Path], skipped: list[Path] | None = None) -> Iterator[tuple[Path, list[str]]]:
    """Yield each folder from `base` on with the names of its files; hidden folders and those of `without` are left out.

    Links to folders are added to `skipped`. If that is None, they are followed, except to a folder that is on the way to
    the link. Raises `OSError` if a folder cannot be read.
    """

    def refuse(error: OSError) -> NoReturn:
        raise error

    for text, subfolders, files in os.walk(base, onerror=refuse, followlinks=True):
        folder = Path(text)
        entered = []
        for path in (folder / name for name in sorted(subfolders) if not name.startswith(".")):
            real = path.resolve()
            if real in without:
                continue
            if not path.is_symlink() or (skipped is None and real not in {above.resolve() for above in path.parents}):
                entered.append(path.name)
            elif skipped is not None:
                skipped.append(path)
        subfolders[:] = entered
        yield folder, [name for name in files if not name.startswith(".")]


def _refuse_tilesets(searched: Iterable[Path]) -> None:
    """Raise `UsageError` if a folder is part of a tileset: its tiles are one surface in several levels of detail."""
    for folder in sorted({above for path in searched for above in (path, *path.parents)}):
        if (folder / "tileset.json").is_file():
            advice = f"build it alone: kilwa build {folder / 'tileset.json'} --output {folder.name}.kilwa"
            raise UsageError(f"{folder} is one tileset of 3D Tiles, not a folder of meshes; move it elsewhere and {advice}")


def _is_mesh(path: Path) -> bool:
    return path.suffix.lower() in EXTENSIONS and not path.name.startswith(".") and path.is_file()


def _metadata(pattern: str | None, name: str) -> str | None:
    if pattern is None:
        return None
    if "*" in pattern:
        return os.path.abspath(pattern.replace("*", name))
    return os.path.abspath(os.path.join(pattern, name + ".toml"))


def companions(path: Path, without: Sequence[Path]) -> list[Path]:
    """List the files that a mesh may name: all files but meshes in its folder and below it, hidden ones excepted.

    Which of them it really names only kilwa knows. A change of any of them builds the mesh anew, so `without` are the files
    and folders that runs themselves write, as real paths. Raises `OSError` if a folder cannot be read.
    """
    if path.suffix.lower() not in WITH_COMPANIONS:
        return []
    ignored = EXTENSIONS | {".kilwa", ".toml"}
    found = (folder / name for folder, names in _walk(path.parent, without) for name in names)
    wanted = (file for file in found if file.suffix.lower() not in ignored and not file.name.endswith(".kilwa.json"))
    names_without = {written.name for written in without}
    return sorted(file for file in wanted if not (file.name in names_without and file.resolve() in without) and file.is_file())
