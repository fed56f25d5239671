#!/usr/bin/env python3
"""Colour a mesh by pymeshlab's projection of photographs, and say what it cost.

    colour_peers.py PHOTOS MESH.ply OUT.ply --work DIR [--truth truth/photos.toml] [--set NAME=VALUE ...]

PHOTOS is the folder that `kilwa synth photos` writes (photos/). MeshLab knows neither distortion nor panoramas, so photographs are undistorted first
(same focal length, principal point in the centre), and a panorama becomes six faces of a cube. The filter draws depth maps with OpenGL: without a screen, run
this under xvfb-run.
"""
import argparse, json, pathlib, resource, time, tomllib
import numpy as np
import pymeshlab
from PIL import Image


def sample(picture, x, y):
    """Bilinear; pixel centres at halves. Black outside."""
    height, width, _ = picture.shape
    left, top = np.floor(x - 0.5), np.floor(y - 0.5)
    u, v = (x - 0.5 - left)[..., None], (y - 0.5 - top)[..., None]
    at = lambda i, j: picture[np.clip(j, 0, height - 1).astype(int), np.clip(i, 0, width - 1).astype(int)]
    mixed = (1 - v) * ((1 - u) * at(left, top) + u * at(left + 1, top)) + v * ((1 - u) * at(left, top + 1) + u * at(left + 1, top + 1))
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    return np.where(inside[..., None], mixed, 0)


def rotation(q):
    w, x, y, z = q / np.linalg.norm(q)
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                     [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                     [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])


def rows(path):
    return [line.split() for line in path.read_text().splitlines() if line and not line.startswith("#")]


def raster(name, size, focal, camera_from_world, position):
    flipped = np.diag([1.0, -1.0, -1.0]) @ camera_from_world
    matrix = np.eye(4)
    matrix[:3, :3] = flipped
    numbers = lambda values: " ".join(repr(float(v)) for v in values)
    return (f'<MLRaster label="{name}"><VCGCamera TranslationVector="{numbers([*-position, 1])}" RotationMatrix="{numbers(matrix.flatten())}" '
            f'FocalMm="{focal!r}" PixelSizeMm="1 1" ViewportPx="{size[0]} {size[1]}" CenterPx="{size[0] / 2!r} {size[1] / 2!r}" LensDistortion="0 0" CameraType="0" BinaryData="0"/>'
            f'<Plane semantic="1" fileName="{name}"/></MLRaster>')


def photographs(folder, work):
    """Undistorted photographs of a COLMAP model, as rasters."""
    cameras = {row[0]: ([int(row[2]), int(row[3])], [float(v) for v in row[4:]]) for row in rows(folder / "sparse/cameras.txt")}
    found = []
    images = rows(folder / "sparse/images.txt")[::2]
    for row in images:
        size, (fx, fy, cx, cy, k1, k2, p1, p2) = cameras[row[8]]
        picture = np.asarray(Image.open(next((folder / "images").glob(row[9]))).convert("RGB"), dtype=float)
        y, x = np.mgrid[0:size[1], 0:size[0]] + 0.5
        u, v = (x - size[0] / 2) / fx, (y - size[1] / 2) / fy
        r = u * u + v * v
        radial = 1 + r * (k1 + r * k2)
        du = u * radial + 2 * p1 * u * v + p2 * (r + 2 * u * u)
        dv = v * radial + p1 * (r + 2 * v * v) + 2 * p2 * u * v
        name = pathlib.Path(row[9]).with_suffix(".png").name
        Image.fromarray(sample(picture, fx * du + cx, fy * dv + cy).round().astype(np.uint8)).save(work / name)
        turn, shift = rotation(np.array([float(q) for q in row[1:5]])), np.array([float(t) for t in row[5:8]])
        found.append(raster(name, size, fx, turn, -turn.T @ shift))
    return found


def panoramas(folder, truth, work):
    """Six faces for each panorama."""
    faces = {"front": [(1, 0, 0), (0, 1, 0), (0, 0, 1)], "right": [(0, 0, -1), (0, 1, 0), (1, 0, 0)], "back": [(-1, 0, 0), (0, 1, 0), (0, 0, -1)],
             "left": [(0, 0, 1), (0, 1, 0), (-1, 0, 0)], "up": [(1, 0, 0), (0, 0, 1), (0, -1, 0)], "down": [(1, 0, 0), (0, 0, -1), (0, 1, 0)]}
    found = []
    for photo in tomllib.loads(truth.read_text())["photo"]:
        if not "/panoramas/" in photo["file"]:
            continue
        picture = np.asarray(Image.open(folder.parent / photo["file"]).convert("RGB"), dtype=float)
        height, width, _ = picture.shape
        side = width // 4
        camera_from_world = np.array(photo["rotation"]).T
        for name, axes in faces.items():
            face_from_camera = np.array(axes, dtype=float)
            y, x = np.mgrid[0:side, 0:side] + 0.5
            d = np.stack([(x - side / 2) / (side / 2), (y - side / 2) / (side / 2), np.ones_like(x)], -1) @ face_from_camera
            px = width * (0.5 + np.arctan2(d[..., 0], d[..., 2]) / (2 * np.pi))
            py = height * (0.5 + np.arctan2(d[..., 1], np.hypot(d[..., 0], d[..., 2])) / np.pi)
            file = f"{photo['name']}_{name}.png"
            Image.fromarray(sample(picture, np.clip(px, 0, width - 1e-6), np.clip(py, 0, height - 1e-6)).round().astype(np.uint8)).save(work / file)
            found.append(raster(file, [side, side], side / 2, face_from_camera @ camera_from_world, np.array(photo["position"])))
    return found


def value(text):
    return {"True": True, "False": False}.get(text) if text in ("True", "False") else float(text)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("photos", type=pathlib.Path)
    parser.add_argument("mesh", type=pathlib.Path)
    parser.add_argument("out")
    parser.add_argument("--work", type=pathlib.Path, required=True)
    parser.add_argument("--truth", type=pathlib.Path)
    parser.add_argument("--set", action="append", default=[])
    args = parser.parse_args()
    args.work.mkdir(parents=True, exist_ok=True)
    found = photographs(args.photos, args.work)
    if args.truth:
        found += panoramas(args.photos, args.truth, args.work)
    project = args.work / "project.mlp"
    mesh = args.mesh.resolve()
    identity = "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"
    project.write_text(f'<!DOCTYPE MeshLabDocument><MeshLabProject><MeshGroup><MLMesh label="m" filename="{mesh}"><MLMatrix44>\n{identity}</MLMatrix44></MLMesh></MeshGroup>'
                       f'<RasterGroup>{"".join(found)}</RasterGroup></MeshLabProject>')
    begun, before = time.time(), resource.getrusage(resource.RUSAGE_SELF)
    ms = pymeshlab.MeshSet()
    ms.load_project(str(project))
    own = {k: value(v) for k, v in (pair.split("=") for pair in args.set)}
    ms.apply_filter("compute_color_from_active_rasters_projection", **own)
    ms.save_current_mesh(args.out, save_vertex_color=True, save_vertex_normal=False, binary=True)
    after = resource.getrusage(resource.RUSAGE_SELF)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    print(json.dumps({"rasters": len(found), "cpu_s": round(cpu, 1), "wall_s": round(time.time() - begun, 1), "peak_MB": after.ru_maxrss // 1024}))


if __name__ == "__main__":
    main()
