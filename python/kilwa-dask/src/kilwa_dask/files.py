"""Checksums, files that appear only when they are complete, and locks."""

from __future__ import annotations

import fcntl
import hashlib
import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path

_PIECE = 1 << 20


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal; the file is read in pieces of 1 MiB."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while piece := file.read(_PIECE):
            digest.update(piece)
    return digest.hexdigest()


def sha256_once(path: Path) -> str:
    """Return the SHA-256 of a file that many meshes may share; it is read again only if its size or a time changed."""
    stat = path.stat()
    return _sha256_of(path, stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns)


@lru_cache(maxsize=100_000)
def _sha256_of(path: Path, *state: int) -> str:
    del state
    return sha256(path)


def sync_folder(folder: Path) -> None:
    """Flush the entries of a folder to the disk, so that a rename survives a power cut."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_whole(path: Path, text: str, *, temporary_in: Path | None = None) -> None:
    """Write a text file that appears only when it is complete: a temporary file, fsync, rename, fsync of the folder.

    The temporary file is in `temporary_in` (default: the folder of the file), which must be on the same file system. It
    is removed if anything fails.
    """
    temporary = (temporary_in or path.parent) / f".{path.name}.{uuid.uuid4().hex}.part"
    try:
        with temporary.open("x", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
    sync_folder(path.parent)


class Busy(Exception):
    """Somebody else holds the lock."""


@contextmanager
def locked(path: Path, *, wait: bool = True, shared: bool = False) -> Iterator[int]:
    """Hold a lock and yield its descriptor. The lock file is removed after an exclusive lock; many may hold a shared one.

    A subprocess that inherits the descriptor shares the lock: as long as it runs, nobody else gets the lock, even if the
    process that took it is dead. Raises `Busy` if `wait` is false and somebody else holds it, and `OSError` if the file
    system does not support locks.
    """
    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        try:
            _lock(descriptor, path, fcntl.LOCK_SH if shared else fcntl.LOCK_EX, wait)
            # The previous holder may have removed the file; this lock would then be on an unlinked file.
            is_current = _same_file(descriptor, path)
            if is_current:
                try:
                    yield descriptor
                finally:
                    # Who removed it under the others' shared locks would let somebody lock a new file beside them.
                    if not shared:
                        path.unlink(missing_ok=True)
                return
        finally:
            os.close(descriptor)


def _lock(descriptor: int, path: Path, kind: int, wait: bool) -> None:
    try:
        fcntl.flock(descriptor, kind | (0 if wait else fcntl.LOCK_NB))
    except BlockingIOError as error:
        raise Busy(path) from error
    except OSError as error:
        reason = f"{error.strerror}; kilwa-dask needs a file system with file locks (on Lustre: mount it with -o flock)"
        raise OSError(error.errno, reason, str(path)) from error


def _same_file(descriptor: int, path: Path) -> bool:
    try:
        named = path.stat()
    except FileNotFoundError:
        return False
    held = os.fstat(descriptor)
    return (named.st_dev, named.st_ino) == (held.st_dev, held.st_ino)
