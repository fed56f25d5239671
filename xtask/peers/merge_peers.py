#!/usr/bin/env python3
"""Run a peer of pymeshlab on station meshes, and say what it cost.

    merge_peers.py vcg OUT.ply --voxel 0.02 [--set NAME=VALUE ...] STATION.ply...
    merge_peers.py poisson OUT.ply --depth N [--set NAME=VALUE ...] STATION.ply...   (writes the density as the quality of vertices)
    merge_peers.py trim OUT.ply --quantile Q IN.ply                                   (drops triangles with a corner of low density)
"""
import argparse, json, resource, time
import numpy as np
import pymeshlab


def cost(start):
    use = resource.getrusage(resource.RUSAGE_SELF)
    return {"user_s": round(use.ru_utime, 1), "system_s": round(use.ru_stime, 1), "cpu_s": round(use.ru_utime + use.ru_stime, 1),
            "wall_s": round(time.time() - start, 1), "peak_MB": use.ru_maxrss // 1024}


def value(text):
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            pass
    return {"True": True, "False": False}[text]


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("what", choices=["vcg", "poisson", "trim"])
    parser.add_argument("out")
    parser.add_argument("inputs", nargs="+")
    parser.add_argument("--voxel", type=float)
    parser.add_argument("--depth", type=int)
    parser.add_argument("--quantile", type=float)
    parser.add_argument("--set", action="append", default=[])
    args = parser.parse_args()
    own = {k: value(v) for k, v in (pair.split("=") for pair in args.set)}
    start, ms = time.time(), pymeshlab.MeshSet()
    for path in args.inputs:
        ms.load_new_mesh(path)
    print("loaded", json.dumps(cost(start)), flush=True)
    if args.what == "vcg":
        ms.generate_surface_reconstruction_vcg(voxsize=pymeshlab.PureValue(args.voxel), **own)
    elif args.what == "poisson":
        ms.generate_surface_reconstruction_screened_poisson(visiblelayer=True, depth=args.depth, **own)
    else:
        quality = ms.current_mesh().vertex_scalar_array()
        limit = float(np.quantile(quality, args.quantile))
        ms.compute_selection_by_condition_per_vertex(condselect=f"q < {limit!r}")
        ms.meshing_remove_selected_vertices()
    made = time.time()
    mesh = ms.current_mesh()
    print(ms.number_meshes(), "layers; result", mesh.vertex_number(), mesh.face_number(), flush=True)
    ms.save_current_mesh(args.out, save_vertex_quality=args.what == "poisson", save_face_color=False, save_vertex_color=False, binary=True)
    print(json.dumps({"made_wall_s": round(made - start, 1), **cost(start)}))


main()
