"""Compares the spool of a station with what another reader (pye57, laspy) finds in the file: peers.py KIND FILE SPOOL [SCAN]."""
import sys

import numpy as np

SAMPLE = np.dtype([("p", "<f4", 3), ("i", "<f4"), ("c", "u1", 3), ("s", "u1")])


def spool(path):
    data = open(path, "rb").read()
    flags, columns, rows = np.frombuffer(data, "<u4", 3, 12)
    origin = np.frombuffer(data, "<f8", 3, 64)
    return flags, int(columns), int(rows), origin, np.frombuffer(data, SAMPLE, int(columns) * int(rows), 256)


def same(what, ours, theirs):
    ours, theirs = np.asarray(ours), np.asarray(theirs)
    assert ours.shape == theirs.shape, f"{what}: {ours.shape} and {theirs.shape}"
    differ = np.flatnonzero(ours != theirs)
    assert differ.size == 0, f"{what}: {differ.size} differ, the first {ours[differ[0]]} and {theirs[differ[0]]}"


def e57(file, path, scan):
    import pye57

    flags, columns, rows, origin, samples = spool(path)
    try:
        raw = pye57.E57(file).read_scan_raw(scan)
    except ValueError as error:
        # It refuses fields of extensions, which the format tells readers to pass over.
        assert "Unsupported point fields" in str(error), error
        print("skipped, because pye57 refuses it:", str(error).splitlines()[0])
        sys.exit()
    if "rowIndex" in raw:
        row, column = raw["rowIndex"].astype(int), raw["columnIndex"].astype(int)
        samples = samples[row * columns + column if flags & 2 else column * rows + row]
    valid = np.ones(len(samples), bool)
    state = "cartesianInvalidState" if "cartesianX" in raw else "sphericalInvalidState"
    if state in raw:
        valid = raw[state] == 0
    same("valid points", samples["s"] & 3 == 1, valid)
    if "cartesianX" not in raw:
        # Sines of other libraries differ in the last bit, so these are compared to a micrometre.
        r, a, e = (raw[name].astype("f8") for name in ["sphericalRange", "sphericalAzimuth", "sphericalElevation"])
        xyz = np.stack([r * np.cos(e) * np.cos(a), r * np.cos(e) * np.sin(a), r * np.sin(e)], 1) - origin
        assert np.abs(samples["p"] - xyz)[valid].max() <= 1e-6 * max(1, np.abs(xyz[valid]).max()), "spherical"
    for k, name in enumerate(["cartesianX", "cartesianY", "cartesianZ"]):
        if name in raw:
            same(name, samples["p"][valid, k], (raw[name].astype("f8") - origin[k]).astype("f4")[valid])
    if "intensity" in raw:
        same("intensity", samples["i"][valid], raw["intensity"].astype("f4")[valid])
    if "colorRed" in raw:
        for k, name in enumerate(["colorRed", "colorGreen", "colorBlue"]):
            same(name, samples["c"][valid, k], raw[name][valid])
    return len(samples)


def las(file, path, _):
    import laspy

    _, _, _, origin, samples = spool(path)
    points = laspy.read(file)
    for k, axis in enumerate([points.x, points.y, points.z]):
        same("xyz"[k], samples["p"][:, k], (np.asarray(axis) - origin[k]).astype("f4"))
    same("intensity", samples["i"], np.asarray(points.intensity).astype("f4"))
    same("return number", samples["s"] >> 4, np.asarray(points.return_number))
    if "red" not in points.point_format.dimension_names:
        same("colours", samples["s"] & 4, np.zeros(len(samples), "u1"))
        return len(samples)
    for k, color in enumerate([points.red, points.green, points.blue]):
        color = np.asarray(color)
        same("colour", samples["c"][:, k], color >> 8 if max(points.red.max(), points.green.max(), points.blue.max()) > 255 else color)
    return len(samples)


if __name__ == "__main__":
    kind, file, path = sys.argv[1:4]
    print({"e57": e57, "las": las}[kind](file, path, int(sys.argv[4]) if len(sys.argv) > 4 else 0), "points are the same")
