#!/usr/bin/env python3
"""Compare a merged mesh with the true surface of a simulated survey.

    evaluate_merge.py MESH --truth TRUTH.ply --stations poses.toml [--threshold 0.01] [--voxel 0.02] [--sigma 0.003]
                [--box X0,Y0,Z0,X1,Y1,Z1] [--regions regions.json] [--json OUT.json]

precision   share of the mesh's area (points uniform by area, fixed seed) no farther than the threshold from the true surface
recall      share of the seen true surface (points even by area) no farther than the threshold from the mesh
F           their harmonic mean
seen        as in scan/tests/stations.rs: for at least one station the line of sight is free up to 3 cm before the point, elevation and
            range are the instrument's, incidence is at most 85 degrees. One difference: the surface has to face the station, since
            otherwise the rear of a wall thinner than 3 cm would count as seen from the front.
false       share of the mesh's area farther than 2 voxels + 2 sigma from the true surface
recall where spacing is at most n voxels: the same for the part that a station samples so densely (range * step / cos incidence), and
            which share of the seen surface that is
facing      share of the seen true surface whose nearest place on the mesh is within the threshold and has a normal that agrees
            (dot > 0.5): "both faces kept"

Coordinates are centred on the truth in float64 before open3d's float32 queries (Embree) choose the triangle; the distance to it is then
computed in float64. All lengths in metres.
"""
import argparse, json, re, sys, time, tomllib
import numpy as np
import open3d as o3d
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

LOWEST_ELEVATION, MIN_RANGE, GRAZING, BEFORE = -60.0, 0.3, 85.0, 0.03
# name: (maximal range, columns for one of the dense instrument)
MAX_RANGE = {"phase": 80.0, "pulse": 120.0}
PLY = {"char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2", "int": "i4",
       "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4", "double": "f8", "float64": "f8"}


def read_ply(path):
    """Vertices (float64) and triangles (int64) of a binary little-endian PLY; anything else by trimesh."""
    with open(path, "rb") as file:
        elements, form = [], None
        assert file.readline().strip() == b"ply", path
        while True:
            words = file.readline().decode("latin-1").split()
            if not words:
                continue
            if words[0] == "format":
                form = words[1]
            elif words[0] == "element":
                elements.append((words[1], int(words[2]), []))
            elif words[0] == "property":
                elements[-1][2].append(words[1:])
            elif words[0] == "end_header":
                break
        vertices = triangles = None
        if form == "binary_little_endian":
            for name, count, properties in elements:
                if name == "face":
                    fields = []
                    for p in properties:
                        if p[0] == "list":
                            fields += [("n", "<" + PLY[p[1]]), ("v", "<" + PLY[p[2]], 3)]
                        else:
                            fields.append((p[1], "<" + PLY[p[0]]))
                    rows = np.fromfile(file, np.dtype(fields), count)
                    if (rows["n"] != 3).any():
                        break
                    triangles = rows["v"].astype(np.int64)
                elif any(p[0] == "list" for p in properties):
                    break
                else:
                    rows = np.fromfile(file, np.dtype([(p[1], "<" + PLY[p[0]]) for p in properties]), count)
                    if name == "vertex":
                        vertices = np.stack([rows[k].astype(np.float64) for k in "xyz"], axis=1)
        if vertices is not None and triangles is not None:
            return vertices, triangles
    import trimesh
    mesh = trimesh.load(path, process=False, force="mesh")
    return np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)


def area_vectors(v, t, part=2_000_000):
    out = np.empty((len(t), 3))
    for k in range(0, len(t), part):
        a, b, c = (v[t[k:k + part, i]] for i in range(3))
        out[k:k + part] = np.cross(b - a, c - a) / 2
    return out


def spread(v, t, count, seed, even):
    """Points by area: independent, or one in each of `count` equal shares of the area. Points, unit normals."""
    vectors = area_vectors(v, t)
    area = np.linalg.norm(vectors, axis=1)
    sums = np.cumsum(area)
    rng = np.random.default_rng(seed)
    at = (np.arange(count) + rng.random(count)) / count if even else np.sort(rng.random(count))
    chosen = np.minimum(np.searchsorted(sums, at * sums[-1], side="right"), len(t) - 1)
    a, b = rng.random((2, count))
    over = a + b > 1
    a[over], b[over] = 1 - a[over], 1 - b[over]
    p, q, r = (v[t[chosen, i]] for i in range(3))
    points = p + (q - p) * a[:, None] + (r - p) * b[:, None]
    normals = vectors[chosen] / np.maximum(area[chosen], 1e-300)[:, None]
    return points, normals, float(sums[-1])


def closest_on_triangle(p, a, b, c):
    """Ericson, Real-Time Collision Detection, 5.1.5, for arrays."""
    dot = lambda x, y: np.einsum("ij,ij->i", x, y)
    ab, ac, ap, bp, cp = b - a, c - a, p - a, p - b, p - c
    d1, d2, d3, d4, d5, d6 = dot(ab, ap), dot(ac, ap), dot(ab, bp), dot(ac, bp), dot(ab, cp), dot(ac, cp)
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    safe = lambda x: np.where(np.abs(x) < 1e-300, 1.0, x)
    total = safe(va + vb + vc)
    out = a + ab * (vb / total)[:, None] + ac * (vc / total)[:, None]
    def put(where, value):
        out[where] = value[where]
    put((va <= 0) & (d4 - d3 >= 0) & (d5 - d6 >= 0), b + (c - b) * ((d4 - d3) / safe(d4 - d3 + d5 - d6))[:, None])
    put((vb <= 0) & (d2 >= 0) & (d6 <= 0), a + ac * (d2 / safe(d2 - d6))[:, None])
    put((vc <= 0) & (d1 >= 0) & (d3 <= 0), a + ab * (d1 / safe(d1 - d3))[:, None])
    put((d6 >= 0) & (d5 <= d6), c)
    put((d3 >= 0) & (d4 <= d3), b)
    put((d1 <= 0) & (d2 <= 0), a)
    return out


class Searched:
    def __init__(self, v, t):
        self.v, self.t = v, t
        self.scene = o3d.t.geometry.RaycastingScene()
        self.scene.add_triangles(o3d.core.Tensor(np.ascontiguousarray(v, np.float32)), o3d.core.Tensor(np.ascontiguousarray(t, np.uint32)))

    def nearest(self, p, part=200_000):
        """Distances, indices of triangles."""
        distance, index = np.empty(len(p)), np.empty(len(p), np.int64)
        for k in range(0, len(p), part):
            q = p[k:k + part]
            own = self.scene.compute_closest_points(o3d.core.Tensor(q.astype(np.float32)))["primitive_ids"].numpy().astype(np.int64)
            a, b, c = (self.v[self.t[own, i]] for i in range(3))
            distance[k:k + part] = np.linalg.norm(closest_on_triangle(q, a, b, c) - q, axis=1)
            index[k:k + part] = own
        return distance, index

    def normals(self, index):
        a, b, c = (self.v[self.t[index, i]] for i in range(3))
        n = np.cross(b - a, c - a)
        return n / np.maximum(np.linalg.norm(n, axis=1), 1e-300)[:, None]

    def is_free(self, eye, p, part=500_000):
        out = np.empty(len(p), bool)
        for k in range(0, len(p), part):
            ray = p[k:k + part] - eye
            length = np.linalg.norm(ray, axis=1)
            rays = np.concatenate([np.broadcast_to(eye, ray.shape), ray / length[:, None]], axis=1).astype(np.float32)
            t = self.scene.cast_rays(o3d.core.Tensor(rays))["t_hit"].numpy()
            out[k:k + part] = t >= length - BEFORE
        return out


def stations(path):
    with open(path, "rb") as file:
        for s in tomllib.load(file)["station"]:
            yield (np.array(s["position"]), np.array(s["rotation"]), s.get("max_range") or MAX_RANGE[s["instrument"]],
                   s.get("lowest_elevation", LOWEST_ELEVATION), 2 * np.pi / s["columns"])


def seen(truth, points, normals, path, centre):
    """For each point how many stations see it, and the least distance between samples on the surface there (range * step / cos)."""
    count, spacing = np.zeros(len(points), np.int32), np.full(len(points), np.inf)
    for position, rotation, reach, lowest, step in stations(path):
        eye = position - centre
        ray = points - eye
        length = np.linalg.norm(ray, axis=1)
        unit = ray / np.maximum(length, 1e-9)[:, None]
        elevation = np.degrees(np.arcsin(np.clip(unit @ rotation[:, 2], -1, 1)))  # z of rotation^-1 * unit
        facing = -np.einsum("ij,ij->i", unit, normals)
        may = np.flatnonzero((elevation > lowest) & (length >= MIN_RANGE) & (length < reach) & (facing >= np.cos(np.radians(GRAZING))))
        may = may[truth.is_free(eye, points[may])]
        count[may] += 1
        spacing[may] = np.minimum(spacing[may], length[may] * step / facing[may])
    return count, spacing


def topology(v, t):
    """Of the mesh with vertices of equal positions joined."""
    rows = np.ascontiguousarray(v).view(np.dtype((np.void, 24))).ravel()
    _, first, same = np.unique(rows, return_index=True, return_inverse=True)
    v, t = v[first], same[t]
    sound = (t[:, 0] != t[:, 1]) & (t[:, 1] != t[:, 2]) & (t[:, 2] != t[:, 0])
    degenerate = int((~sound).sum())
    t = t[sound]
    n = len(v)
    a, b = np.concatenate([t[:, 0], t[:, 1], t[:, 2]]), np.concatenate([t[:, 1], t[:, 2], t[:, 0]])
    key = np.minimum(a, b) * n + np.maximum(a, b)
    order = np.argsort(key, kind="stable")
    key, forward = key[order], (a < b)[order]
    start = np.flatnonzero(np.r_[True, key[1:] != key[:-1]])
    counts = np.diff(np.r_[start, len(key)])
    ups = np.add.reduceat(forward.astype(np.int64), start) if len(start) else np.zeros(0)
    low, high = key[start] // n, key[start] % n
    border = counts == 1
    face = order % len(t)
    # Faces that share an edge of two.
    pair = start[counts == 2]
    graph = coo_matrix((np.ones(len(pair), np.int8), (face[pair], face[pair + 1])), (len(t), len(t)))
    components, label = connected_components(graph, directed=False)
    area = np.linalg.norm(area_vectors(v, t), axis=1)
    per = np.bincount(label, area, components)
    faces = np.bincount(label, minlength=components)
    return {
        "triangles": len(t), "vertices": n, "degenerate_triangles": degenerate, "area_m2": float(area.sum()),
        "components": int(components), "components_below_100_triangles": int((faces < 100).sum()),
        "area_of_largest_percent": 100 * float(per.max() / area.sum()) if components else 0.0,
        "nonmanifold_edges": int((counts > 2).sum()), "edges_of_four_or_more": int((counts > 3).sum()),
        "flipped_edges": int(((counts == 2) & (ups != 1)).sum()),
        "border_edges": int(border.sum()), "border_length_m": float(np.linalg.norm(v[low[border]] - v[high[border]], axis=1).sum()),
    }


def in_box(p, box):
    return ((p >= box[:3]) & (p <= box[3:])).all(axis=1)


def in_region(p, region):
    """Whether points lie in a box of a frame that is turned about z by `yaw` degrees and has its origin at `origin`."""
    angle = np.radians(region.get("yaw", 0.0))
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    return in_box((p - np.array(region.get("origin", [0.0, 0.0, 0.0]))) @ turn, np.array(region["box"]))


def share(x):
    return 100.0 * float(np.mean(x)) if len(x) else float("nan")


def border_triangles(t, n):
    a, b = np.concatenate([t[:, 0], t[:, 1], t[:, 2]]), np.concatenate([t[:, 1], t[:, 2], t[:, 0]])
    key = np.minimum(a, b) * n + np.maximum(a, b)
    order = np.argsort(key, kind="stable")
    sorted_keys = key[order]
    single = np.r_[True, sorted_keys[1:] != sorted_keys[:-1]] & np.r_[sorted_keys[1:] != sorted_keys[:-1], True]
    out = np.zeros(len(t), bool)
    out[order[single] % len(t)] = True
    return out


def figures(places, place_normals, off, off_normals, outside, points, normals, miss, miss_normals, args):
    """Figures of places on the mesh, and seen points of the truth, with their distances and the normals met there."""
    limit = args.threshold
    off, pn, on = off[~outside], place_normals[~outside], off_normals[~outside]
    far = 2 * args.voxel + 2 * args.sigma
    agree = np.einsum("ij,ij->i", normals, miss_normals)
    out = {"threshold_m": limit, "precision_percent": share(off <= limit), "recall_percent": share(miss <= limit)}
    p, r = out["precision_percent"], out["recall_percent"]
    out["F_percent"] = 2 * p * r / (p + r) if p + r > 0 else 0.0
    out["facing_recall_percent"] = share((miss <= limit) & (agree > 0.5))
    out["facing_precision_percent"] = share((off <= limit) & (np.einsum("ij,ij->i", pn, on) > 0.5))
    out["turned_percent"] = share((agree < -0.5)[miss <= limit])
    for name, d in (("mesh_to_truth", off), ("truth_to_mesh", miss)):
        for q in (50, 95):
            out[f"{name}_p{q}_mm"] = 1000 * float(np.percentile(d, q)) if len(d) else float("nan")
    out["rms_within_threshold_mm"] = 1000 * float(np.sqrt(np.mean(off[off <= limit] ** 2))) if (off <= limit).any() else float("nan")
    out["false_beyond_m"] = far
    out["false_percent"] = share(off > far)
    out["at"] = {f"{1000 * x:g} mm": [round(share(off <= x), 2), round(share(miss <= x), 2)] for x in (0.005, 0.01, 0.02, 0.03, 0.05)}
    out["places"], out["seen_points"] = len(off), len(points)
    return out


def parse():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mesh")
    parser.add_argument("--truth", required=True)
    parser.add_argument("--stations", required=True, help="truth/poses.toml")
    parser.add_argument("--threshold", type=float, default=0.01)
    parser.add_argument("--voxel", type=float, default=0.02)
    parser.add_argument("--sigma", type=float, default=0.003, help="largest deviation of ranges at normal incidence")
    parser.add_argument("--places", type=int, default=500_000, help="points on the mesh")
    parser.add_argument("--points", type=int, default=1_000_000, help="points on the whole truth, before those not seen are dropped")
    parser.add_argument("--box", help="look only at this part: X0,Y0,Z0,X1,Y1,Z1")
    parser.add_argument("--regions", help="JSON: name -> {box, yaw, origin}; figures for each as well")
    parser.add_argument("--json", help="write the figures here too")
    return parser.parse_args()


def main():
    args, start = parse(), time.time()
    tv, tt = read_ply(args.truth)
    centre = (tv.min(axis=0) + tv.max(axis=0)) / 2
    tv -= centre
    mv, mt = read_ply(args.mesh)
    result = {"mesh": args.mesh, "truth": args.truth, "truth_triangles": len(tt), **topology(mv, mt)}
    mv = mv - centre
    truth, mesh = Searched(tv, tt), Searched(mv, mt)
    box = None
    if args.box:
        box = np.array([float(x) for x in args.box.split(",")]) - np.tile(centre, 2)
    places, place_normals, _ = spread(mv, mt, args.places, 1, even=False)
    points, normals, area = spread(tv, tt, args.points, 2, even=True)
    if box is not None:
        keep = in_box(places, box)
        places, place_normals = places[keep], place_normals[keep]
        keep = in_box(points, box)
        points, normals = points[keep], normals[keep]
    count, spacing = seen(truth, points, normals, args.stations, centre)
    result["truth_area_m2"] = area
    result["seen_area_m2"] = area * float((count > 0).sum()) / args.points
    points, normals, spacing, count = points[count > 0], normals[count > 0], spacing[count > 0], count[count > 0]
    off, at = truth.nearest(places)
    # The true ground ends 10 cm before what the scanners can see of it.
    outside = border_triangles(tt, len(tv))[at] & (off < 0.15)
    result["places_beyond_the_truth_percent"] = share(outside)
    off_normals = truth.normals(at)
    miss, at = mesh.nearest(points)
    miss_normals = mesh.normals(at)
    result |= figures(places, place_normals, off, off_normals, outside, points, normals, miss, miss_normals, args)
    result["recall_by_stations_percent"] = {f"{k}{'+' if k == 4 else ''}": round(share(miss[(count == k) if k < 4 else (count >= k)] <= args.threshold), 2)
                                            for k in (1, 2, 3, 4)}
    for name, limit in (("1", args.voxel), ("2", 2 * args.voxel), ("4", 4 * args.voxel)):
        dense = spacing <= limit
        result[f"recall_where_spacing_is_at_most_{name}_voxels_percent"] = [round(share(miss[dense] <= args.threshold), 2), "of", round(share(dense), 1)]
    if args.regions:
        result["regions"] = {}
        for name, region in json.load(open(args.regions)).items():
            i, j = in_region(places + centre, region), in_region(points + centre, region)
            result["regions"][name] = figures(places[i], place_normals[i], off[i], off_normals[i], outside[i], points[j], normals[j], miss[j],
                                              miss_normals[j], args)
    result["seconds"] = round(time.time() - start, 1)
    text = json.dumps(result, indent=1)
    if args.json:
        open(args.json, "w").write(text + "\n")
    print(text)


if __name__ == "__main__":
    main()
