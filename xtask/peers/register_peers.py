#!/usr/bin/env python3
"""Register a survey with another program, starting from perturbed true poses, and write the result in the format of Kilwa.

    register_peers.py open3d     SURVEY TRUTH.toml OUT.json [--sigma METRES DEGREES] [--seed N] [--voxel M] [--overlap SHARE]
    register_peers.py small_gicp SURVEY TRUTH.toml OUT.json [the same]
    register_peers.py kiss       SURVEY TRUTH.toml OUT.json [--voxel M] [--overlap SHARE]

open3d      multiway registration as in its tutorial: point-to-plane ICP of every pair that overlaps, from coarse to fine, then
            global_optimization of the pose graph, in which the edges of the maximum spanning tree by overlap are marked as certain
small_gicp  GICP of the same pairs from the same start, then a pose graph with the Hessian of each pair as information (Gauss-Newton with
            Cauchy weights, as small_gicp has none of its own)
kiss        KISS-Matcher on every pair that truly overlaps, without initial poses: how many of its results are correct

Overlapping pairs are estimated from the perturbed poses; for `kiss`, from the true ones. The settings (voxels, reach, loss) are, of five tried
with each program, those that performed best on the survey with seed 1 (30 stations of 800 columns).
OUT.json has the format of registration.json, so that all programs are evaluated in the same way; for `kiss` it lists the pairs.
"""
import argparse, json, resource, struct, time, tomllib
from pathlib import Path
import numpy as np
import open3d as o3d

SAMPLE = np.dtype([("xyz", "<f4", 3), ("intensity", "<f4"), ("rgb", "u1", 3), ("state", "u1")])
# A pair is correct within these limits: metres, degrees.
RIGHT = (0.5, 5.0)
# Minimum number of inliers for KISS-Matcher to accept a pair, as in its examples.
KISS_INLIERS = 5


def read_spool(path):
    """Measured points of a station, float64 (see scan/src/spool)."""
    head = Path(path).open("rb").read(256)
    assert head[:8] == b"KILWASCN", path
    columns, rows = struct.unpack_from("<II", head, 16)
    origin = struct.unpack_from("<3d", head, 64)
    samples = np.fromfile(path, SAMPLE, columns * rows, offset=256)
    return samples["xyz"][samples["state"] & 3 == 1].astype(np.float64) + origin


def read_survey(folder, truth):
    survey = tomllib.loads((folder / "survey.toml").read_text())
    true = {}
    for station in tomllib.loads(truth.read_text())["station"]:
        true[station["name"]] = pose(np.array(station["rotation"], float), np.array(station["position"], float))
    stations = [(s["name"], folder / s["scan"]) for s in survey["station"]]
    return [name for name, _ in stations], [path for _, path in stations], [true[name] for name, _ in stations]


def pose(rotation, translation):
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation, translation
    return out


def skew(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def turn(v):
    """The rotation matrix of a rotation vector."""
    angle = np.linalg.norm(v)
    if angle < 1e-12:
        return np.eye(3) + skew(v)
    k = skew(v / angle)
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def vector(r):
    """The rotation vector of a rotation of less than half a turn."""
    v = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]) / 2
    sine = np.linalg.norm(v)
    return v * (np.arctan2(sine, (np.trace(r) - 1) / 2) / sine) if sine > 1e-12 else v


def difference(a, b):
    """Distance (metres) and angle (degrees) between two poses."""
    return float(np.linalg.norm(a[:3, 3] - b[:3, 3])), float(np.degrees(np.linalg.norm(vector(a[:3, :3].T @ b[:3, :3]))))


def disturbed(true, sigma, seed):
    """The true poses, with a random perturbation of all but the first; one standard deviation per axis."""
    random, out = np.random.default_rng(seed), []
    for k, t in enumerate(true):
        move, spin = random.normal(size=3) * sigma[0], random.normal(size=3) * np.radians(sigma[1])
        out.append(t if k == 0 else pose(turn(spin) @ t[:3, :3], t[:3, 3] + move))
    return out


def cloud(points, voxel, normals=True):
    out = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points)).voxel_down_sample(voxel)
    if normals:
        out.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(radius=3 * voxel, max_nn=30))
        out.orient_normals_towards_camera_location(np.zeros(3))
    return out


def near(points, reach=15.0):
    """Samples within the reach: samples beyond it are too far apart for normals and mislead both programs."""
    return points[np.einsum("ij,ij->i", points, points) < reach * reach]


def overlaps(points, poses, cell=0.25):
    """For each pair, the share of the cells of the smaller scan that have a cell of the other nearby, in these poses."""
    cells = []
    for p, t in zip(points, poses):
        p = near(p, 12.0)
        keys = np.floor((p[::5] @ t[:3, :3].T + t[:3, 3]) / cell).astype(np.int64)
        cells.append(np.unique((keys[:, 0] << 42) + (keys[:, 1] << 21) + keys[:, 2]))
    n = len(points)
    return {(i, j): np.intersect1d(cells[i], cells[j], assume_unique=True).size / max(min(cells[i].size, cells[j].size), 1)
            for i in range(n) for j in range(i + 1, n)}


def spanning_tree(pairs, n):
    """The pairs of the maximum spanning tree by overlap."""
    group, tree = list(range(n)), set()
    for (i, j), _ in sorted(pairs.items(), key=lambda item: -item[1]):
        a, b = group[i], group[j]
        if a != b:
            tree.add((i, j))
            group = [a if g == b else g for g in group]
    return tree, group


def open3d_multiway(points, start, pairs, tree, voxel):
    """Poses by open3d's multiway registration."""
    levels = [(10 / 3 * voxel, 10 * voxel), (5 / 3 * voxel, 5 * voxel), (voxel, 2 * voxel)]
    clouds = [[cloud(near(p), size) for p in points] for size, _ in levels]
    reg = o3d.pipelines.registration
    graph, fine = reg.PoseGraph(), levels[-1][1]
    for t in start:
        graph.nodes.append(reg.PoseGraphNode(t))
    for i, j in pairs:
        # Transforms coordinates of i to those of j.
        at = np.linalg.inv(start[j]) @ start[i]
        for level, (_, reach) in enumerate(levels):
            at = reg.registration_icp(clouds[level][i], clouds[level][j], reach, at,
                                      reg.TransformationEstimationPointToPlane(reg.TukeyLoss(reach / 3)), reg.ICPConvergenceCriteria(1e-7, 1e-7, 60)).transformation
        information = reg.get_information_matrix_from_point_clouds(clouds[-1][i], clouds[-1][j], fine, at)
        graph.edges.append(reg.PoseGraphEdge(i, j, at, information, uncertain=(i, j) not in tree))
    reg.global_optimization(graph, reg.GlobalOptimizationLevenbergMarquardt(), reg.GlobalOptimizationConvergenceCriteria(),
                            reg.GlobalOptimizationOption(max_correspondence_distance=fine, edge_prune_threshold=0.25, reference_node=0))
    return [np.asarray(node.pose) for node in graph.nodes]


def small_gicp_graph(points, start, pairs, voxel):
    """Poses by small_gicp's GICP and a pose graph."""
    import small_gicp
    levels = [(2 * voxel, 10 * voxel), (voxel, 10 / 3 * voxel), (voxel, 5 / 3 * voxel)]
    clouds = [[small_gicp.preprocess_points(near(p), downsampling_resolution=size, num_threads=1) for p in points] for size, _ in levels]
    edges = []
    for i, j in pairs:
        # Transforms coordinates of j to those of i.
        at = np.linalg.inv(start[i]) @ start[j]
        for level, (_, reach) in enumerate(levels):
            (target, tree), (source, _) = clouds[level][i], clouds[level][j]
            result = small_gicp.align(target, source, tree, init_T_target_source=at, registration_type="GICP", max_correspondence_distance=reach,
                                      num_threads=1, max_iterations=60, rotation_epsilon=1e-6, translation_epsilon=1e-6)
            at = result.T_target_source
        edges.append((i, j, at, np.asarray(result.H)))
    return pose_graph(start, edges)


def pose_graph(start, edges, rounds=50):
    """Poses that best agree with the edges (i, j, the pose of j in i, the Hessian in the frame of j: rotation, translation); the first stays fixed."""
    poses, n = [t.copy() for t in start], len(start)
    scale = np.median([np.trace(h) for *_, h in edges])
    for _ in range(rounds):
        a, b = np.zeros((6 * n, 6 * n)), np.zeros(6 * n)
        residuals = []
        for i, j, z, h in edges:
            e = np.linalg.inv(z) @ np.linalg.inv(poses[i]) @ poses[j]
            residuals.append((np.concatenate([vector(e[:3, :3]), e[:3, 3]]), h / scale))
        chi = np.array([r @ h @ r for r, h in residuals])
        weights = 1 / (1 + chi / (np.median(chi) * 9 + 1e-18))
        for (i, j, _, _), (r, h), w in zip(edges, residuals, weights):
            # The Jacobian with respect to j is the identity to first order; that with respect to i is minus the adjoint of (pose of i in j).
            t = np.linalg.inv(poses[j]) @ poses[i]
            adjoint = np.zeros((6, 6))
            adjoint[:3, :3] = adjoint[3:, 3:] = t[:3, :3]
            adjoint[3:, :3] = skew(t[:3, 3]) @ t[:3, :3]
            ji, s, q = -adjoint, slice(6 * i, 6 * i + 6), slice(6 * j, 6 * j + 6)
            a[s, s] += w * ji.T @ h @ ji
            a[s, q] += w * ji.T @ h
            a[q, s] += w * h @ ji
            a[q, q] += w * h
            b[s] += w * ji.T @ h @ r
            b[q] += w * h @ r
        a += np.eye(6 * n) * 1e-12 * np.trace(a) / len(a)
        step = np.concatenate([np.zeros(6), np.linalg.solve(a[6:, 6:], -b[6:])])
        for k in range(n):
            poses[k] = poses[k] @ pose(turn(step[6 * k:6 * k + 3]), step[6 * k + 3:6 * k + 6])
        if np.abs(step).max() < 1e-9:
            break
    return poses


def kiss(points, true, pairs, names, voxel):
    """KISS-Matcher on every pair, and whether its result is correct."""
    import kiss_matcher
    matcher, rows = kiss_matcher.KISSMatcher(kiss_matcher.KISSMatcherConfig(voxel)), []
    small = [np.asarray(cloud(p, voxel, False).points).astype(np.float32) for p in points]
    for (i, j), overlap in pairs.items():
        found = matcher.estimate(small[j], small[i])
        at = pose(np.asarray(found.rotation), np.asarray(found.translation).ravel())
        metres, degrees = difference(at, np.linalg.inv(true[i]) @ true[j])
        inliers = matcher.get_num_final_inliers()
        matcher.clear()
        rows.append({"stations": [names[i], names[j]], "overlap": round(overlap, 3), "inliers": inliers, "found": inliers >= KISS_INLIERS,
                     "metres": round(metres, 4), "degrees": round(degrees, 4), "right": metres <= RIGHT[0] and degrees <= RIGHT[1]})
    return rows


def quaternion(r):
    from scipy.spatial.transform import Rotation
    x, y, z, w = Rotation.from_matrix(r).as_quat()
    return [w, x, y, z]


def registration(names, poses, groups):
    """The format of registration.json, without covariances: other programs provide none for the poses of a graph."""
    stations, unplaced = [], []
    for k, (name, t) in enumerate(zip(names, poses)):
        if groups[k] != groups[0]:
            unplaced.append({"name": name, "reason": "No pair overlaps enough.", "candidates": [], "remedy": ""})
            continue
        stations.append({"name": name, "placement": "anchor" if k == 0 else "surface", "rotation": quaternion(t[:3, :3]),
                         "translation": [float(v) for v in t[:3, 3]], "covariance": [[0.0] * 6] * 6})
    return {"version": 1, "stations": stations, "unplaced": unplaced, "links": [], "weakest_chain": []}


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("what", choices=["open3d", "small_gicp", "kiss"])
    parser.add_argument("survey", type=Path)
    parser.add_argument("truth", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--sigma", type=float, nargs=2, default=[0.05, 0.5])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--voxel", type=float)
    parser.add_argument("--overlap", type=float, default=0.1)
    args = parser.parse_args()
    voxel = args.voxel or {"open3d": 0.03, "small_gicp": 0.03, "kiss": 0.2}[args.what]
    start_time = time.time()
    names, paths, true = read_survey(args.survey, args.truth)
    points = [read_spool(path) for path in paths]
    start = true if args.what == "kiss" else disturbed(true, args.sigma, args.seed)
    shares = overlaps(points, start)
    tree, groups = spanning_tree({pair: share for pair, share in shares.items() if share > 0.02}, len(points))
    # Pairs of the spanning tree are used even if they overlap little, to keep every station connected.
    pairs = {pair: share for pair, share in shares.items() if share >= args.overlap or (pair in tree and args.what != "kiss")}
    if args.what == "kiss":
        result = {"version": 1, "voxel": voxel, "pairs": kiss(points, true, pairs, names, voxel)}
    elif args.what == "open3d":
        result = registration(names, open3d_multiway(points, start, pairs, tree, voxel), groups)
    else:
        result = registration(names, small_gicp_graph(points, start, pairs, voxel), groups)
    args.out.write_text(json.dumps(result, indent=1))
    use = resource.getrusage(resource.RUSAGE_SELF)
    print(json.dumps({"pairs": len(pairs), "voxel": voxel, "cpu_s": round(use.ru_utime + use.ru_stime, 1),
                      "wall_s": round(time.time() - start_time, 1), "peak_MiB": use.ru_maxrss // 1024}))


if __name__ == "__main__":
    main()
