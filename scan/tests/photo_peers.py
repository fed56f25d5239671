"""Photographs for tests of the readers: photo_peers.py KIND FOLDER writes files with poses by another program into FOLDER, and truth.json.

truth.json: for each photograph its name, points of the world, and where that program (pycolmap; of MeshLab, which cannot project without a
display, pycolmap with the same cameras) sees them.
"""
import json
import os
import sys

import numpy as np

SIZE = (640, 480)
MODELS = {
    "SIMPLE_PINHOLE": [500, 318, 242],
    "PINHOLE": [500, 505, 318, 242],
    "SIMPLE_RADIAL": [500, 318, 242, -0.1],
    "RADIAL": [500, 318, 242, -0.12, 0.03],
    "OPENCV": [500, 505, 318, 242, -0.1, 0.02, 0.003, -0.002],
    "FULL_OPENCV": [500, 505, 318, 242, -0.1, 0.02, 0.003, -0.002, 0.01, 0.05, -0.01, 0.002],
    "OPENCV_FISHEYE": [300, 305, 318, 242, 0.02, -0.01, 0.003, -0.001],
    "SIMPLE_RADIAL_FISHEYE": [300, 318, 242, 0.02],
    "RADIAL_FISHEYE": [300, 318, 242, 0.02, -0.01],
    "SIMPLE_FISHEYE": [300, 318, 242],
    "FISHEYE": [300, 305, 318, 242],
    "THIN_PRISM_FISHEYE": [300, 305, 318, 242, 0.02, -0.01, 0.003, -0.002, 0.001, 0.002, 0, 0],
    "EQUIRECTANGULAR": [640, 480],
    "FOV": [500, 505, 318, 242, 0.5],
}


def scene(models, rng):
    """Names, models and parameters; poses that look at the origin from around; points about the origin."""
    photos = []
    for k, (model, params) in enumerate(models):
        axis = rng.normal(size=3)
        quaternion = np.append(np.sin(0.7) * axis / np.linalg.norm(axis), np.cos(0.7))
        photos.append((f"sub folder/photo {k:02}.png", model, params, quaternion, np.append(rng.uniform(-0.3, 0.3, 2), 5)))
    return photos, rng.uniform(-1, 1, (40, 3))


def pictures(folder, names):
    from PIL import Image

    for name in names:
        path = os.path.join(folder, "images", name)
        os.makedirs(os.path.dirname(path), exist_ok=True)
        Image.new("L", SIZE).save(path)


def truth(folder, photos, points, cameras):
    out = []
    for (name, model, params, q, t), camera in zip(photos, cameras):
        import pycolmap

        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(q), t)
        local = (pose * points) if hasattr(points, "shape") else points
        pixels = camera.img_from_cam(np.asarray(local))
        out.append({"name": name, "model": model, "points": points.tolist(), "pixels": np.asarray(pixels).tolist()})
    json.dump(out, open(os.path.join(folder, "truth.json"), "w"))


def colmap_cameras(photos):
    import pycolmap

    return [
        pycolmap.Camera(camera_id=k + 1, model=model, width=SIZE[0], height=SIZE[1], params=params)
        for k, (_, model, params, _, _) in enumerate(photos)
    ]


def colmap(folder):
    import pycolmap

    photos, points = scene(list(MODELS.items()), np.random.default_rng(5))
    cameras = colmap_cameras(photos)
    r = pycolmap.Reconstruction()
    for camera in cameras:
        r.add_camera_with_trivial_rig(camera)
    for k, (name, _, _, q, t) in enumerate(photos):
        image = pycolmap.Image(name=name, camera_id=k + 1, image_id=k + 1)
        image.points2D = pycolmap.Point2DList([pycolmap.Point2D(np.array([1.0, 2.0])) for _ in range(3)])
        r.add_image_with_trivial_frame(image, pycolmap.Rigid3d(pycolmap.Rotation3d(q), t))
    for k, point in enumerate(points[:3]):
        track = pycolmap.Track()
        track.add_element(1, k)
        track.add_element(2, k)
        r.add_point3D(point, track, np.array([10, 20, 30 + k], np.uint8))
    for name in ["text", "binary"]:
        os.makedirs(os.path.join(folder, name), exist_ok=True)
    r.write_text(os.path.join(folder, "text"))
    r.write_binary(os.path.join(folder, "binary"))
    pictures(folder, [photo[0] for photo in photos])
    truth(folder, photos, points, cameras)


def rig(folder):
    """A synthetic reconstruction of COLMAP with rigs, whose images have observations."""
    import pycolmap

    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig, options.num_points3D = 2, 2, 3, 30
    r = pycolmap.synthesize_dataset(options)
    for name in ["text", "binary"]:
        os.makedirs(os.path.join(folder, name), exist_ok=True)
    r.write_text(os.path.join(folder, "text"))
    r.write_binary(os.path.join(folder, "binary"))
    out = []
    for image in r.images.values():
        seen = [(r.points3D[p.point3D_id].xyz, image.project_point(r.points3D[p.point3D_id].xyz)) for p in image.points2D if p.has_point3D()]
        out.append({"name": image.name, "model": "", "points": [a.tolist() for a, _ in seen], "pixels": [b.tolist() for _, b in seen]})
    json.dump(out, open(os.path.join(folder, "truth.json"), "w"))


def meshlab(folder):
    """Cameras of COLMAP, written as Bundler's file by this script, read by MeshLab, and written by MeshLab as a project, as Bundler's file and as PhotoScan's XML."""
    import pymeshlab

    photos, points = scene([("PINHOLE", [500, 500, 320, 240])] * 4, np.random.default_rng(6))
    cameras = colmap_cameras(photos)
    names = [photo[0].replace("sub folder/photo ", "shot") for photo in photos]
    photos = [(name, *photo[1:]) for name, photo in zip(names, photos)]
    os.makedirs(os.path.join(folder, "images"), exist_ok=True)
    pictures(folder, names)
    import pycolmap

    os.chdir(os.path.join(folder, "images"))
    flip = np.diag([1, -1, -1])
    with open("in.out", "w") as out:
        out.write(f"# Bundle file v0.3\n{len(photos)} 0\n")
        for _, _, params, q, t in photos:
            rotation = flip @ pycolmap.Rotation3d(q).matrix()
            out.write(f"{params[0]} 0 0\n")
            np.savetxt(out, rotation)
            np.savetxt(out, (flip @ t)[None])
    open("in.list.txt", "w").write("".join(name + "\n" for name in names))
    pymeshlab.MeshSet().add_mesh(pymeshlab.Mesh(points), "points")
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(points), "points")
    ms.save_current_mesh("points.ply")
    for name in names:
        ms.load_new_raster(name)
    ms.load_active_raster_cameras(importfile=os.path.abspath("in.out"))
    ms.save_project("project.mlp")
    ms.save_active_raster_cameras(exportfile="Bundler .out", newname="meshlab")
    ms.save_active_raster_cameras(exportfile="Agisoft xml", newname="meshlab")
    open("meshlab.list.txt", "w").write("".join(name + "\n" for name in names))
    truth(folder, photos, points, cameras)


if __name__ == "__main__":
    {"colmap": colmap, "rig": rig, "meshlab": meshlab}[sys.argv[1]](os.path.abspath(sys.argv[2]))
