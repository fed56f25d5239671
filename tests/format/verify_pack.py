#!/usr/bin/env python3
"""What a verifier checks: section 9 of docs/FORMAT.md, on top of the second reader.

Usage: verify_pack.py PACK...        says what each pack has, or what is wrong with the first that is not sound.

Checks what section 9 lists, and, at four errors, that a cut has no open edge without a border bit (section 1).
"""
import math
import sys

from read_pack import PAGE, Pack, Refused, need

FIRST_READ = 131072


def check_order(pack):
    """The parts of the file leave no gap and do not overlap, and stand in the order of section 2."""
    need(pack.meta_at == 256 and pack.page0 == -(-pack.meta_end // 16) * 16, "a gap before page 0")
    need(not any(pack.data[pack.meta_end : pack.page0]), "the padding before page 0 is not zero")
    at, pages = pack.page0 + PAGE, -(-len(pack.entries) // 127)
    first = True
    for i, entry in enumerate(pack.entries):
        if first and at + entry.length > FIRST_READ:
            need(pack.page1 == at, "page 1 is not behind the first chunks")
            at, first = at + PAGE * (pages - 1), False
        need(entry.offset == at, f"chunk {i} is not behind the part before it")
        at += entry.length
    if first:
        need(pack.page1 == at, "page 1 is not behind the chunks")
        at += PAGE * (pages - 1)
    need(at + 80 == len(pack.data), "a gap before the footer")


def inside(entry, points):
    reach = entry.radius * (1 + 1e-9) + 1e-9
    return all(math.dist(entry.centre, point) <= reach for point in points)


def check_cuts(pack, chunks):
    """Cuts at several errors have no crack: an edge that one drawn triangle uses, and no other, has its border bit."""
    errors = sorted({e.error for e in pack.entries})
    for limit in {errors[-1], errors[len(errors) // 2], errors[len(errors) // 4], -1.0}:
        refined = [i == 0 or e.error > limit for i, e in enumerate(pack.entries)]
        need(all(refined[p] for e, r in zip(pack.entries, refined) if r for p in e.parents), f"no cut at {limit}")
        edges = {}
        for chunk in (c for c, r in zip(chunks, refined) if r):
            for diamond, start, end in chunk.by_patch():
                if diamond is not None and refined[diamond]:
                    continue
                for corners, border in zip(chunk.triangles[start:end], chunk.borders[start:end]):
                    p = [tuple(chunk.points[v]) for v in corners]
                    for k in range(3):
                        edge = tuple(sorted((p[k], p[(k + 1) % 3])))
                        uses, bits = edges.get(edge, (0, 0))
                        edges[edge] = uses + 1, bits + (border >> k & 1)
        cracks = sum(uses == 1 and bits == 0 for uses, bits in edges.values())
        need(cracks == 0, f"the cut at {limit} has {cracks} edges open")


def verify(pack):
    """Everything of section 9; returns the chunks."""
    check_order(pack)
    entries, chunks = pack.entries, [pack.chunk(i) for i in range(len(pack.entries))]
    need(sum(e.triangles for e in entries) == pack.triangles, "the triangles do not sum to the header's")
    need(sum(e.vertices for e in entries) == pack.vertices, "the vertices do not sum to the header's")
    leaves, borders, finest = 0, 0, set()
    children = [[i for i, e in enumerate(entries) if index in e.parents] for index in range(len(entries))]
    for i, (entry, chunk) in enumerate(zip(entries, chunks)):
        if entry.children:
            first, last, share = (children[i] or [0])[0], (children[i] or [0])[-1], entry.children[3]
            need(entry.children[:3] == (first, len(children[i]), last // 127 - first // 127), f"entry {i} tells wrong children")
            bound = entry.error * share / 65535 if share < 65535 else entry.error
            # The bound is rounded up to 32 bits.
            need(all(entries[k].error <= bound * (1 + 2**-23) + 2**-149 for k in children[i]), f"a child of entry {i} has a larger error")
        need(not entry.whole or all(d is not None or a == b for d, a, b in chunk.by_patch()), f"the children of entry {i} do not replace all of it")
        need(i == 0 or entry.color_error <= 255, f"the colour error of entry {i} is not possible")
        need(i == 0 or entries[i - 1].level <= entry.level, f"entry {i} is not in the order of levels")
        for p in entry.parents:
            parent = entries[p]
            need(entry.error <= parent.error, f"the error of entry {i} is above a parent's")
            need(p == 0 or entry.color_error <= parent.color_error, f"the colour error of entry {i} is above a parent's")
            need(p == 0 or entry.level > parent.level, f"entry {i} has a parent that is not of a coarser level")
            gap = math.dist(entry.centre, parent.centre) + entry.radius - parent.radius
            need(entry.radius < 0 or gap <= 1e-9 * parent.radius, f"the sphere of entry {i} leaves a parent's")
        points = chunk.points
        low = tuple(min((p[a] for p in points), default=2**31 - 1) for a in range(3))
        high = tuple(max((p[a] for p in points), default=-(2**31)) for a in range(3))
        need((low, high) == (entry.low, entry.high), f"the box of entry {i} is not exact")
        need(inside(entry, points), f"a vertex of entry {i} is outside of its sphere")
        for diamond, start, end in chunk.by_patch():
            used = {v for corners in chunk.triangles[start:end] for v in corners}
            if diamond is None:
                leaves += end - start
                borders += sum(bits.bit_count() for bits in chunk.borders[start:end])
                finest |= {tuple(points[v]) for v in used}
            else:
                need(i in entries[diamond].parents, f"a patch of entry {i} names a diamond that does not name it")
                need(inside(entries[diamond], (points[v] for v in used)), f"the coarse form of entry {diamond} leaves its sphere")
    meta, step = pack.metadata, math.ldexp(1, pack.step_log2)
    need(leaves == pack.finest, "the leaf patches have another number of triangles than the header says")
    need(borders == meta["border_edges"], "the leaf patches have another number of border bits than the metadata say")
    # Each point has four vertices.
    named = leaves // 2 if 3 in pack.codecs else len(finest)
    need(named == meta["vertices"], "the leaf patches have another number of positions than the metadata say")
    for name, choose in (("bounds_min", min), ("bounds_max", max)):
        corner = pack.world([choose(p[a] for p in finest) for a in range(3)]) if finest else meta[name]
        near = (abs(a - b) <= step + 1e-15 * abs(a) for a, b in zip(corner, meta[name]))
        need(all(near), f"{name} is not the model's")
    check_cuts(pack, chunks)
    return chunks


def main(paths):
    for path in paths:
        try:
            with open(path, "rb") as file:
                pack = Pack(file.read())
            chunks = verify(pack)
        except Refused as fault:
            sys.exit(f"{path}: {fault}")
        except (KeyError, TypeError) as fault:
            sys.exit(f"{path}: the metadata have a member of another kind, or none: {fault}")
        print(f"{path}: {len(chunks)} chunks, {pack.triangles} triangles, {pack.vertices} vertices, identity {pack.identity}")


if __name__ == "__main__":
    main(sys.argv[1:])
