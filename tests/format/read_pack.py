#!/usr/bin/env python3
"""A second reader of Kilwa packs, written from docs/FORMAT.md alone: standard library only, clear rather than fast.

Usage: read_pack.py PACK        prints, per chunk, counts and a digest of its geometry, as tests/second_reader.rs expects.

Hashes are not checked (the standard library has no BLAKE3). The index codec is written from the appendix of the glTF
extension EXT_meshopt_compression.
"""
import hashlib
import math
import struct
import sys

NONE = 0xFFFFFFFF


class Bytes:
    """A read position in bytes."""

    def __init__(self, data):
        self.data, self.at = data, 0

    def take(self, n):
        if self.at + n > len(self.data):
            raise ValueError("too short")
        self.at += n
        return self.data[self.at - n : self.at]

    def u8(self):
        return self.take(1)[0]

    def varint(self):
        value = shift = 0
        while True:
            byte = self.u8()
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return value


def entropy_coded(c, n):
    """Section 5.3."""
    if n == 0:
        return []
    slots, symbol = [], 0
    while len(slots) < 4096:
        f = c.varint()
        if f == 0:
            symbol += 1 + c.varint()
            continue
        slots += [(symbol, f, k) for k in range(f)]
        symbol += 1
    assert len(slots) == 4096
    words = c.varint()
    states = list(struct.unpack("<2I", c.take(8)))
    words = iter(struct.unpack(f"<{words}H", c.take(2 * words)))
    out = []
    for i in range(n):
        x = states[i & 1]
        symbol, f, offset = slots[x & 4095]
        x = f * (x >> 12) + offset
        if x < 65536:
            x = x << 16 | next(words)
        states[i & 1] = x
        out.append(symbol)
    assert states == [65536, 65536] and next(words, None) is None
    return out


def indices(codes, data, count):
    """The index codec of meshoptimizer, version 1."""
    assert codes[0] == 0xE1
    data, table = Bytes(bytes(data)), data[-16:]
    edges, vertices = [(0, 0)] * 16, [0] * 16
    eo = vo = nxt = last = 0
    out = []

    def explicit():
        nonlocal last
        v = data.varint()
        last = (last + (v >> 1 if v & 1 == 0 else ~(v >> 1))) & 0xFFFFFFFF
        return last

    def push_vertex(v):
        nonlocal vo
        vertices[vo & 15] = v
        vo += 1

    def push_edge(a, b):
        nonlocal eo
        edges[eo & 15] = (a, b)
        eo += 1

    for code in codes[1 : 1 + count]:
        if code < 0xF0:
            a, b = edges[(eo - 1 - (code >> 4)) & 15]
            fec = code & 15
            if fec < 13:
                c = nxt if fec == 0 else vertices[(vo - 1 - fec) & 15]
                if fec == 0:
                    nxt += 1
                    push_vertex(c)
            else:
                c = explicit() if fec == 15 else last + (fec - (fec ^ 3))
                last = c
                push_vertex(c)
            push_edge(c, b)
            push_edge(a, c)
            out.append((a, b, c))
            continue
        aux = table[code & 15] if code < 0xFE else data.u8()
        if code >= 0xFE and aux == 0:
            nxt = 0
        fea, feb, fec = (15 if code == 0xFF else 0), aux >> 4, aux & 15
        start = vo
        corners = []
        for fe in (fea, feb, fec):
            if fe == 0:
                corners.append(nxt)
                nxt += 1
            elif fe == 15 and code >= 0xFE:
                corners.append(None)
            else:
                corners.append(vertices[(start - fe) & 15])
        corners = [explicit() if v is None else v for v in corners]
        for k, (v, fe) in enumerate(zip(corners, (fea, feb, fec))):
            if k == 0 or fe == 0 or (fe == 15 and code >= 0xFE):
                push_vertex(v)
        a, b, c = corners
        push_edge(b, a)
        push_edge(c, b)
        push_edge(a, c)
        out.append((a, b, c))
    return out


def residuals(c, bits, count):
    """Section 5.4; `bits` is [number, position]."""
    out = []
    for token in entropy_coded(c, count):
        u = token
        if token >= 16:
            t, b = (token - 16) // 2 + 4, (token - 16) & 1
            low = (bits[0] >> bits[1]) & ((1 << (t - 1)) - 1)
            bits[1] += t - 1
            u = (2 + b) << (t - 1) | low
        out.append(u >> 1 if u & 1 == 0 else -(u >> 1) - 1)
    return out


def neighbours(triangles, count):
    """Section 5.5."""
    found, table = [], {}
    before = lambda w: (w - 1 if w else None, None, None)
    slot = lambda e, f: ((e * 0x9E3779B1 & NONE) ^ (f * 0x85EBCA77 & NONE)) >> 20
    for p, q, r in triangles:
        corners = ((p, q, r), (q, r, p), (r, p, q))
        for v, e, f in corners:
            while len(found) <= v:
                w = len(found)
                if w != v:
                    found.append(before(w))
                elif e < v and f < v:
                    low, high = min(e, f), max(e, f)
                    known = table.get(slot(low, high))
                    found.append((e, f, known[2] if known and known[:2] == (low, high) else None))
                elif e < v or f < v:
                    found.append((e if e < v else f, None, None))
                else:
                    found.append(before(w))
        for v, e, f in corners:
            low, high = min(e, f), max(e, f)
            table[slot(low, high)] = (low, high, v)
    found += [before(w) for w in range(len(found), count)]
    return found


def signed(x, bits=32):
    x &= (1 << bits) - 1
    return x - (1 << bits) if x >> (bits - 1) else x


def octahedral(n):
    total = abs(n[0]) + abs(n[1]) + abs(n[2])
    if not (math.isfinite(total) and total > 0):
        return 0, 0
    x, y = n[0] / total, n[1] / total
    if n[2] < 0:
        sign = lambda v: 1.0 if v >= 0 else -1.0
        x, y = (1 - abs(y)) * sign(x), (1 - abs(x)) * sign(y)
    away = lambda v: int(math.copysign(math.floor(abs(v) + 0.5), v))
    return tuple(away(max(-1.0, min(1.0, v)) * 32767.0) for v in (x, y))


def predicted_normals(positions, triangles):
    sums = [[0.0] * 3 for _ in positions]
    for t in triangles:
        p, q, r = (positions[v] for v in t)
        u = [float(q[k]) - float(p[k]) for k in range(3)]
        v = [float(r[k]) - float(p[k]) for k in range(3)]
        n = (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])
        for corner in t:
            for k in range(3):
                sums[corner][k] += n[k]
    return [octahedral(n) for n in sums]


def decode(data, vertices, triangle_count, colors, scalars):
    """One chunk: patches, triangles, borders, positions, colours, normals, scalars."""
    c = Bytes(data)
    assert c.u8() == 0
    patches = [(c.varint(), (c.varint() - 1) & NONE) for _ in range(c.varint())]
    b = Bytes(c.take(c.varint()))
    borders, at = [0] * triangle_count, 0
    while b.at < len(b.data):
        value = b.varint()
        at += value >> 3
        borders[at] = value & 7
    length = c.varint()
    triangles = []
    if triangle_count:
        codes = entropy_coded(c, 1 + triangle_count)
        triangles = indices(codes, entropy_coded(c, length), triangle_count)
    bits = [int.from_bytes(c.take(c.varint()), "little"), 0]
    near = neighbours(triangles, vertices)
    xyz = [residuals(c, bits, vertices) for _ in range(3)]
    positions = []
    for i, (a, e, d) in enumerate(near):
        for_axis = []
        for k in range(3):
            if a is None:
                guess = 0
            elif e is None:
                guess = positions[a][k]
            elif d is None:
                guess = (positions[a][k] + positions[e][k]) >> 1
            else:
                guess = positions[a][k] + positions[e][k] - positions[d][k]
            for_axis.append(signed(guess + xyz[k][i]))
        positions.append(tuple(for_axis))
    rgb = []
    if colors:
        g, rg, bg = (residuals(c, bits, vertices) for _ in range(3))
        for i, (a, e, _) in enumerate(near):
            guess = [0, 0, 0] if a is None else rgb[a]
            if e is not None:
                guess = [(x + y) >> 1 for x, y in zip(rgb[a], rgb[e])]
            pr, pg, pb = guess
            rgb.append(((pr + g[i] + rg[i]) & 255, (pg + g[i]) & 255, (pb + g[i] + bg[i]) & 255))
    normals = []
    if vertices:
        n = c.u8()
        levels = (1 << (n - 1)) - 1
        uv = [residuals(c, bits, vertices) for _ in range(2)]
        sign = lambda x: (x > 0) - (x < 0)
        for i, guess in enumerate(predicted_normals(positions, triangles)):
            normal = []
            for k in range(2):
                level = guess[k] if n == 16 else sign(guess[k]) * ((2 * abs(guess[k]) * levels + 32767) // 65534)
                level += uv[k][i]
                normal.append(level if n == 16 else sign(level) * ((65534 * abs(level) + levels) // (2 * levels)))
            normals.append(tuple(normal))
    channels = []
    for _ in range(scalars):
        ordered = []
        for (a, _, _), r in zip(near, residuals(c, bits, vertices)):
            ordered.append(signed((0 if a is None else ordered[a]) + r))
        channels.append([x & NONE if x >= 0 else (~x ^ 0x80000000) & NONE for x in ordered])
    return patches, triangles, borders, positions, rgb, normals, channels


def digest(chunk):
    """SHA-256 over everything, in a fixed layout (little-endian)."""
    patches, triangles, borders, positions, rgb, normals, channels = chunk
    h = hashlib.sha256()
    for patch in patches:
        h.update(struct.pack("<2I", *patch))
    for t, bits in zip(triangles, borders):
        h.update(struct.pack("<3IB", *t, bits))
    for p in positions:
        h.update(struct.pack("<3i", *p))
    for color in rgb:
        h.update(bytes(color))
    for n in normals:
        h.update(struct.pack("<2h", *n))
    for channel in channels:
        h.update(struct.pack(f"<{len(channel)}I", *channel))
    return h.hexdigest()


def main():
    with open(sys.argv[1], "rb") as f:
        data = f.read()
    assert data[:8] == b"KILWAPCK" and struct.unpack_from("<2H", data, 8) == (0, 1)
    assert struct.unpack_from("<Q", data, 64)[0] == len(data) and data[-80:-72] == b"KILWAEND"
    (entries,) = struct.unpack_from("<I", data, 84)
    first, others = struct.unpack_from("<2Q", data, 104)
    colors, scalars = data[144], data[145]
    for i in range(entries):
        page, k = divmod(i, 127)
        at = (first if page == 0 else others + (page - 1) * 16384) + 128 + 128 * k
        offset, length, vertices, triangles = struct.unpack_from("<Q3I", data, at)
        chunk = decode(data[offset : offset + length], vertices, triangles, colors, scalars)
        print(i, vertices, triangles, digest(chunk))


main()
