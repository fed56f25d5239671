"""The manifest of a pack: the inputs and options it was made from, its checksum, and where it was published.

It is beside the pack as NAME.kilwa.json and is written last. A pack is done if and only if its manifest has the
requested key and the SHA-256 of the pack. Every run compares the manifest with the pack again.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from kilwa_dask.files import sha256, write_whole

FORMAT = 1


@dataclass
class Manifest:
    """What is known about a pack. Seconds are wall-clock time of the stages."""

    key: str
    """SHA-256 over the version of kilwa, the options and the content of the inputs."""
    kilwa: str
    input: str
    input_bytes: int
    pack_bytes: int
    pack_sha256: str
    triangles: int
    finished: str
    seconds: dict[str, float] = field(default_factory=dict)
    publication: dict[str, Any] | None = None
    """`key` (over version, pack, metadata and target), `to`, and from kilwa's report `slug` and `version`."""
    format: int = FORMAT

    def write(self, path: Path, temporary_in: Path) -> None:
        """Write it atomically."""
        write_whole(path, json.dumps(asdict(self), indent=2, sort_keys=True) + "\n", temporary_in=temporary_in)

    def describes(self, pack: Path) -> bool:
        """Return whether the pack has the size and SHA-256 stated here."""
        try:
            return pack.stat().st_size == self.pack_bytes and sha256(pack) == self.pack_sha256
        except FileNotFoundError:
            return False


def read(path: Path) -> Manifest | None:
    """Read a manifest; None if there is none, or if it is not one that this version wrote."""
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
        manifest = Manifest(**values)
    except (FileNotFoundError, ValueError, TypeError):
        return None
    return manifest if manifest.format == FORMAT else None


def key_of(**parts: object) -> str:
    """Return the SHA-256 over named values, independent of their order."""
    text = json.dumps(parts, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()
