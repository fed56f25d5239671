"""Finds the meshes of a collection, their names, and their metadata files."""

from __future__ import annotations

import glob
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

EXTENSIONS = frozenset({".ply", ".obj", ".stl", ".gltf", ".glb"})
# Formats that may name further files: materials, pictures, buffers.
WITH_COMPANIONS = frozenset({".obj", ".gltf", ".glb"})


class UsageError(Exception):
    """The command line asks for something that cannot be done; nothing was started."""


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

    Hidden files and folders and the output folder are left out. `metadata` is a folder, in which the file of NAME is
    NAME.toml, or a pattern whose `*` stands for NAME. Raises `UsageError` if there are no meshes, or if two would
    become the same pack.
    """
    base, paths = _paths(source)
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


def _paths(source: str) -> tuple[Path, list[Path]]:
    folder = Path(source)
    if folder.is_dir():
        base = folder.resolve()
        return base, sorted(_walk(base))
    if glob.has_magic(source):
        before = source[: min(source.find(sign) for sign in "*?[" if sign in source)]
        base = Path(before if before.endswith("/") else os.path.dirname(before)).resolve()
        # The folder's own name may be a link; names below it are kept as they are.
        found = (base / os.path.relpath(text, start=base) for text in glob.glob(source, recursive=True))
        return base, sorted({path for path in found if _is_mesh(path)})
    if folder.is_file():
        return folder.parent.resolve(), [folder.parent.resolve() / folder.name]
    raise UsageError(f"{source}: there is no such folder, and it is not a pattern such as 'scans/*.ply'")


def _walk(base: Path) -> Iterator[Path]:
    for folder, subfolders, files in os.walk(base):
        subfolders[:] = sorted(name for name in subfolders if not name.startswith("."))
        yield from (path for name in files if _is_mesh(path := Path(folder, name)))


def _is_mesh(path: Path) -> bool:
    return path.suffix.lower() in EXTENSIONS and not path.name.startswith(".") and path.is_file()


def _metadata(pattern: str | None, name: str) -> str | None:
    if pattern is None:
        return None
    if "*" in pattern:
        return os.path.abspath(pattern.replace("*", name))
    return os.path.abspath(os.path.join(pattern, name + ".toml"))


def companions(path: Path) -> list[Path]:
    """List the files that a mesh may name: all files but meshes in its folder and below it, hidden ones excepted.

    Which of them it really names only kilwa knows. A change of any of them builds the mesh anew.
    """
    if path.suffix.lower() not in WITH_COMPANIONS:
        return []
    found: list[Path] = []
    for folder, subfolders, files in os.walk(path.parent):
        subfolders[:] = [name for name in subfolders if not name.startswith(".")]
        candidates = (Path(folder, name) for name in files if not name.startswith("."))
        ignored = EXTENSIONS | {".kilwa", ".toml"}
        found += [file for file in candidates if file.suffix.lower() not in ignored and file.is_file()]
    return sorted(file for file in found if not file.name.endswith(".kilwa.json"))
