#!/usr/bin/env python3
"""A room with free-standing walls of 30, 60 and 200 mm, each seen from both sides, scanned by 4 stations.

    thin_walls.py FOLDER [--columns 1600] [--sigma 0.002] [--seed 1] [--thickness 0.03,0.06,0.2] [--yaw 17]

Writes scan_00N.ptx (the poses are the true ones), truth/surface.ply (closed, normals out of the solid), truth/poses.toml and
truth/regions.json (boxes around each wall and each of its faces) for evaluate_merge.py. One exact ray for each sample: no beam width, hence no
mixed pixels; noise along the ray only. The whole is turned by --yaw and shifted, so that no wall lies along the axes of a voxel grid.
Lengths in metres."""
import argparse, json, os
import numpy as np

ROOM = np.array([7.0, 5.0, 3.0])
WALL_Y, WALL_TOP = (1.5, 3.5), 2.0
WALL_X = (1.75, 3.5, 5.25)
STATIONS = [(0.75, 2.55, 1.5), (2.6, 2.4, 1.45), (4.35, 2.6, 1.55), (6.25, 2.45, 1.5)]
LOWEST, SHIFT = -60.0, np.array([3.137, -2.291, 0.413])


def walls(thickness):
    return [np.array([x - d / 2, WALL_Y[0], 0, x + d / 2, WALL_Y[1], WALL_TOP]) for x, d in zip(WALL_X, thickness)]


def surface(boxes):
    """The room from inside and the walls from outside, all cut along the same planes so that edges meet."""
    lines = [sorted({0.0, ROOM[k], *(b[k] for b in boxes), *(b[k + 3] for b in boxes)}) for k in range(3)]
    index, vertices, triangles = {}, [], []

    def vertex(p):
        key = tuple(np.round(p, 9))
        if key not in index:
            index[key] = len(vertices)
            vertices.append(key)
        return index[key]

    def face(axis, at, low, high, sign, but=()):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for a, b in zip(lines[u], lines[u][1:]):
            for c, d in zip(lines[v], lines[v][1:]):
                mu, mv = (a + b) / 2, (c + d) / 2
                if not (low[u] < mu < high[u] and low[v] < mv < high[v]):
                    continue
                if any(w[u] < mu < w[u + 3] and w[v] < mv < w[v + 3] for w in but):
                    continue
                corners = []
                for p, q in ((a, c), (b, c), (b, d), (a, d)):
                    place = np.empty(3)
                    place[axis], place[u], place[v] = at, p, q
                    corners.append(vertex(place))
                if sign < 0:
                    corners.reverse()
                triangles.extend([[corners[0], corners[1], corners[2]], [corners[0], corners[2], corners[3]]])

    zero = np.zeros(3)
    for axis in range(3):
        face(axis, 0.0, zero, ROOM, 1, boxes if axis == 2 else ())
        face(axis, ROOM[axis], zero, ROOM, -1)
    for w in boxes:
        for axis in range(3):
            face(axis, w[axis + 3], w[:3], w[3:], 1)
            if axis != 2:
                face(axis, w[axis], w[:3], w[3:], -1)
    return np.array(vertices), np.array(triangles)


def trace(eye, rays, boxes):
    """Range along unit rays from inside the room to the first surface."""
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / rays
        t = np.max([(0 - eye) * inverse, (ROOM - eye) * inverse], axis=0).min(axis=1)
        for w in boxes:
            a, b = (w[:3] - eye) * inverse, (w[3:] - eye) * inverse
            near, far = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
            hit = (near < far) & (near > 0) & (near < t)
            t = np.where(hit, near, t)
    return t


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder")
    parser.add_argument("--columns", type=int, default=1600)
    parser.add_argument("--sigma", type=float, default=0.002)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--thickness", default="0.03,0.06,0.2")
    parser.add_argument("--yaw", type=float, default=17.0)
    args = parser.parse_args()
    thickness = [float(x) for x in args.thickness.split(",")]
    boxes = walls(thickness)
    truth = os.path.join(args.folder, "truth")
    os.makedirs(truth, exist_ok=True)
    rng = np.random.default_rng(args.seed)
    turn = lambda degrees: np.array([[np.cos(r := np.radians(degrees)), -np.sin(r), 0], [np.sin(r), np.cos(r), 0], [0, 0, 1]])
    site = turn(args.yaw)
    step = 360.0 / args.columns
    rows = int(round((90 - LOWEST) / step)) + 1
    azimuth = np.radians(np.arange(args.columns) * step)
    elevation = np.radians(LOWEST + (np.arange(rows) + 0.5) * (90 - LOWEST) / rows)
    local = np.stack([np.outer(np.cos(azimuth), np.cos(elevation)), np.outer(np.sin(azimuth), np.cos(elevation)),
                      np.broadcast_to(np.sin(elevation), (args.columns, rows))], axis=-1).reshape(-1, 3)
    text = "# The truth of thin_walls.py.\n"
    for k, eye in enumerate(STATIONS, 1):
        heading = turn(37.0 * k)
        ranges = trace(np.array(eye), local @ heading.T, boxes)
        points = local * (ranges + args.sigma * rng.standard_normal(len(ranges)))[:, None]
        rotation, position = site @ heading, site @ np.array(eye) + SHIFT
        with open(os.path.join(args.folder, f"scan_{k:03}.ptx"), "w") as file:
            number = lambda x: f"{x:.12f}"
            row = lambda x: " ".join(map(number, x)) + "\n"
            file.write(f"{args.columns}\n{rows}\n" + row(position) + "".join(row(rotation[:, c]) for c in range(3)))
            file.write("".join(row([*rotation[:, c], 0]) for c in range(3)) + row([*position, 1]))
            for at in range(0, len(points), 100_000):
                file.write("".join("%.6f %.6f %.6f 0.500000 128 128 128\n" % tuple(p) for p in points[at:at + 100_000].tolist()))
        matrix = ", ".join("[" + ", ".join(f"{x:.15f}" for x in r) + "]" for r in rotation)
        text += (f'\n[[station]]\nname = "scan_{k:03}"\nfile = "scan_{k:03}.ptx"\nmax_range = 50.0\nlowest_elevation = {LOWEST}\ncolumns = {args.columns}\n'
                 f"rows = {rows}\nposition = [{', '.join(f'{x:.9f}' for x in position)}]\nrotation = [{matrix}]\n")
    open(os.path.join(truth, "poses.toml"), "w").write(text)
    v, t = surface(boxes)
    v = v @ site.T + SHIFT
    with open(os.path.join(truth, "surface.ply"), "wb") as file:
        file.write(f"ply\nformat binary_little_endian 1.0\nelement vertex {len(v)}\nproperty double x\nproperty double y\nproperty double z\n"
                   f"element face {len(t)}\nproperty list uchar int vertex_indices\nend_header\n".encode())
        file.write(v.astype("<f8").tobytes())
        faces = np.empty(len(t), [("n", "u1"), ("v", "<i4", 3)])
        faces["n"], faces["v"] = 3, t
        file.write(faces.tobytes())
    regions = {}
    for x, d in zip(WALL_X, thickness):
        # Off the floor, the ends and the top: edges are another question.
        low, high = [WALL_Y[0] + 0.1, 0.1], [WALL_Y[1] - 0.1, WALL_TOP - 0.1]
        name, half, side = f"{1000 * d:g} mm", d / 2, 0.05
        frame = {"yaw": args.yaw, "origin": SHIFT.tolist()}
        regions[name] = {"box": [x - half - side, *low, x + half + side, *high], **frame}
        regions[name + ", face -x"] = {"box": [x - half - side, *low, x, *high], **frame}
        regions[name + ", face +x"] = {"box": [x, *low, x + half + side, *high], **frame}
        regions[name + ", with ends and top"] = {"box": [x - half - side, WALL_Y[0] - side, 0.1, x + half + side, WALL_Y[1] + side, WALL_TOP + side], **frame}
    json.dump(regions, open(os.path.join(truth, "regions.json"), "w"), indent=1)


main()
