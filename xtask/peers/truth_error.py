#!/usr/bin/env python3
"""How far is a true surface (mesh) from the true field? By samples of scans without noise (`kilwa synth scans --noise 0`), which are sphere
traced against the field itself: samples of class "surface" whose whole beam is on one surface.

    truth_error.py SCANS_FOLDER TRUTH.ply..."""
import glob, os, sys, tomllib
import numpy as np
sys.argv, argv = ["x"], sys.argv
import importlib.util
spec = importlib.util.spec_from_file_location("evaluate", os.path.join(os.path.dirname(os.path.abspath(__file__)), "evaluate_merge.py"))
ev = importlib.util.module_from_spec(spec); spec.loader.exec_module(ev)


def points(folder):
    out, far = [], []
    for s in tomllib.load(open(f"{folder}/truth/poses.toml", "rb"))["station"]:
        lines = open(f"{folder}/{s['file']}").read().split("\n")[10:]
        rows = np.array(" ".join(lines).split(), np.float64).reshape(s["columns"] * s["rows"], -1)
        labels = np.fromfile(f"{folder}/truth/{s['labels']}", np.uint8)[16:]
        own = rows[labels == 1][:, :3]
        out.append(own @ np.array(s["rotation"]).T + np.array(s["position"]))
        far.append(np.linalg.norm(own, axis=1))
    return np.concatenate(out), np.concatenate(far)


p, far = points(argv[1])
print(len(p), "samples")
for path in argv[2:]:
    v, t = ev.read_ply(path)
    c = (v.min(axis=0) + v.max(axis=0)) / 2
    d, at = ev.Searched(v - c, t).nearest(p - c)
    beam = far < 20
    print(path, len(t), "triangles; mm: p50 %.2f p90 %.2f p95 %.2f p99 %.2f p99.9 %.2f max %.1f; >5 mm %.3f %%, >10 mm %.3f %%; rms %.2f" % (
        *(1000 * np.percentile(d, [50, 90, 95, 99, 99.9, 100])), 100 * np.mean(d > 0.005), 100 * np.mean(d > 0.01), 1000 * np.sqrt(np.mean(d ** 2))))
