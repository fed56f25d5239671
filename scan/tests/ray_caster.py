"""Masks of `--seen-through` against open3d's ray caster on the true surface: ray_caster.py SCANS SURVEY SURFACE.ply

SCANS and SURFACE.ply are made by `kilwa synth scans --columns 1550` (with and without people) and `--truth-mesh`, with the same seed; SURVEY is the import
of SCANS, with the mask. A station is a witness of a sample if open3d's ray from it towards the sample meets the true surface only FARTHER behind the
sample or later, and the nearest ray that it measured did so too, because open3d does not know the people in front of the station.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import open3d as o3d

SURFACE, WALKER = 1, 3
FARTHER = 0.1
LOWEST = -60.0


@dataclass
class Station:
    name: str
    columns: int
    rows: int
    turn: np.ndarray
    position: np.ndarray
    ranges: np.ndarray
    places: np.ndarray
    labels: np.ndarray
    masked: np.ndarray


def station(file, survey):
    with file.open() as lines:
        columns, rows = int(next(lines)), int(next(lines))
        for _ in range(4):
            next(lines)
        matrix = np.array([next(lines).split() for _ in range(4)], float)
        points = np.loadtxt(lines, usecols=(0, 1, 2))
    labels = np.frombuffer((file.parent / "truth" / f"{file.stem}.labels").read_bytes()[16:], np.uint8)
    (mask,) = (survey / "stations").glob(f"{file.stem}.seen-through.*.mask")
    bits = np.unpackbits(np.frombuffer(mask.read_bytes()[128:], np.uint8), bitorder="little")
    turn, position = matrix[:3, :3], matrix[3, :3]
    ranges, places = np.linalg.norm(points, axis=1), points @ turn + position
    return Station(file.stem, columns, rows, turn, position, ranges, places, labels, bits[: len(points)].astype(bool))


def cast(scene, position, directions):
    rays = np.concatenate([np.broadcast_to(position, directions.shape), directions], 1).astype(np.float32)
    return scene.cast_rays(o3d.core.Tensor(rays))["t_hit"].numpy()


def witnesses(scene, other, places):
    """Return which places the rays of another station pass through."""
    ray = places - other.position
    distance = np.linalg.norm(ray, axis=1)
    x, y, z = (ray @ other.turn.T).T
    elevation = np.degrees(np.arcsin(np.clip(z / distance, -1, 1)))
    hit = cast(scene, other.position, ray / distance[:, None])
    column = np.rint(np.arctan2(y, x) % (2 * np.pi) / (2 * np.pi) * other.columns).astype(int) % other.columns
    step = (90 - LOWEST) / (other.rows - 1)
    row = np.clip(np.rint((elevation - LOWEST) / step).astype(int), 0, other.rows - 1)
    measured = other.ranges[column * other.rows + row]
    is_free = (hit > distance + FARTHER) & np.isfinite(hit) & (elevation > LOWEST)
    return is_free & (measured > distance + FARTHER)


def main(scans, survey, surface):
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(o3d.t.geometry.TriangleMesh.from_legacy(o3d.io.read_triangle_mesh(surface)))
    stations = [station(file, Path(survey)) for file in sorted(Path(scans).glob("*.ptx"))]
    passed = found = good = lost = 0
    for own in stations:
        some = np.flatnonzero(own.labels == SURFACE)[::20]
        hit = cast(scene, own.position, (own.places - own.position)[some] / own.ranges[some, None])
        error = np.abs(hit - own.ranges[some])
        people = np.flatnonzero(own.labels == WALKER)
        count = sum(witnesses(scene, other, own.places[people]).astype(int) for other in stations if other is not own)
        seen = count >= 2
        passed, found = passed + seen.sum(), found + own.masked[people][seen].sum()
        good, lost = good + (own.labels == SURFACE).sum(), lost + own.masked[own.labels == SURFACE].sum()
        print(
            f"{own.name}: ranges of {len(some)} surface samples: median {1e3 * np.median(error):.1f} mm from open3d's, "
            f"{100 * (error < 0.05).mean():.2f} % within 5 cm; {len(people)} of people, {seen.sum()} crossed by rays of two others"
        )
    print(f"{passed} samples of people crossed by rays of two others, {100 * found / passed:.1f} % masked")
    print(f"{good} good points, {100 * lost / good:.4f} % masked")


if __name__ == "__main__":
    main(*sys.argv[1:4])
