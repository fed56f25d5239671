#!/usr/bin/env python3
"""A second reader of Kilwa packs, written from docs/FORMAT.md alone: standard library only, clear rather than fast.

Usage: read_pack.py PACK        prints, per chunk, counts and a digest of its geometry, as tests/second_reader.rs expects.

Hashes are not checked (the standard library has no BLAKE3).
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


class Coder:
    """Section 5.2."""

    def __init__(self, coded, raw):
        self.coded, self.at, self.missing = coded, 0, 0
        self.range, self.code = (1 << 64) - 1, 0
        self.code = self.word() << 32 | self.word()
        self.raw_bits, self.raw_left = int.from_bytes(raw, "little"), 8 * len(raw)

    def word(self):
        four = self.coded[self.at : self.at + 4]
        self.at += len(four)
        self.missing += 4 - len(four)
        return int.from_bytes(four + bytes(4 - len(four)), "big")

    def raw(self, n):
        value = self.raw_bits & ((1 << n) - 1)
        self.raw_bits >>= n
        self.raw_left -= n
        return value

    def bit(self, model):
        zero, seen = model
        bound = (self.range >> 16) * zero
        rate = 131072 // (2 * seen + 3)
        bit = int(self.code >= bound)
        if bit:
            self.code -= bound
            self.range -= bound
            model[0] = zero - (zero * rate >> 16)
        else:
            self.range = bound
            model[0] = zero + ((65535 - zero) * rate >> 16)
        model[1] = min(seen + 1, 126)
        if self.range < 1 << 32:
            self.range <<= 32
            self.code = self.code << 32 | self.word()
        return bit

    def end(self):
        assert self.missing <= 8 and self.at == len(self.coded)
        assert 0 <= self.raw_left < 8 and self.raw_bits == 0


def models(*counts):
    """A nested list of fresh models."""
    if not counts:
        return [32768, 0]
    return [models(*counts[1:]) for _ in range(counts[0])]


def tree(coder, nodes, n):
    node = 1
    for _ in range(n):
        node = 2 * node + coder.bit(nodes[node])
    return node - (1 << n)


def rest(coder, upper, s):
    if s == 0:
        return 1
    x, left = 2 + coder.bit(upper[s]), s - 1
    while left > 0:
        n = min(left, 16)
        x, left = x << n | coder.raw(n), left - n
    return x


class Number:
    """Section 5.3; wide numbers have trees of 6 bits."""

    def __init__(self, bits=5):
        self.bits, self.nodes, self.upper = bits, models(1 << bits), models(32)

    def read(self, coder):
        return rest(coder, self.upper, tree(coder, self.nodes, self.bits)) - 1

    def read_wide(self, coder):
        s = min(tree(coder, self.nodes, self.bits), 32)
        u = 0 if s == 0 else rest(coder, self.upper, s - 1)
        return u >> 1 if u & 1 == 0 else -(u >> 1) - 1


class Residuals:
    def __init__(self, depth, contexts):
        self.depth, self.trees, self.upper = depth, models(contexts, 1 << depth), models(32)

    def read(self, coder, context):
        s = tree(coder, self.trees[min(context, len(self.trees) - 1)], self.depth)
        if s == 0:
            return 0
        x, k = 1, 0
        if s > 1:
            x, k = 2 + coder.bit(self.upper[s]), s - 2
        if k > 15:
            x, k = x << (k - 15) | coder.raw(k - 15), 15
        t = coder.raw(k + 1)
        magnitude = x << k | t >> 1
        return -magnitude if t & 1 else magnitude


class Grains:
    def __init__(self, coder):
        self.trees = models(16, 16) if coder.raw(1) else None
        self.known = []

    def read(self, coder, beside):
        near = self.known[beside] if beside is not None and beside < len(self.known) else 0
        self.known.append(tree(coder, self.trees[near], 4) if self.trees else 0)
        return self.known[-1]


def rounded(x, grain):
    return (x + ((1 << grain) >> 1)) >> grain


def half_octaves(x):
    x += 1
    t = x.bit_length() - 1
    return 2 * t + ((x << 1 >> t) & 1)


class Gate:
    def __init__(self, start, apex, edge):
        self.start, self.apex, self.edge = start, apex, edge
        self.next = self.before = self
        self.state = "open"


class Connectivity:
    """Section 5.4. Links are lists: [] nothing, [v] near v, [(a, b, c)] or two of those."""

    def __init__(self, coder, vertices, triangles, patches):
        self.coder, self.vertices, self.patch_count = coder, vertices, patches
        self.triangles, self.patch, self.links, self.gates, waiting = [], [], [], [], []
        self.waiting = waiting
        self.n, self.latest, self.other, self.gate_at = [], [], [], []
        self.ops, self.along, self.fresh = models(400, 4), models(), models(3)
        self.distance, self.back = Number(), Number()
        self.same, self.guess = models(16), models()
        while len(self.triangles) < triangles:
            if not waiting:
                self.seed()
                continue
            gate = waiting.pop()
            while gate and gate.state == "open" and len(self.triangles) < triangles:
                gate = self.step(gate)
        for v in range(len(self.links), vertices):
            self.links.append([v - 1] if v else [])
        self.open = [g.edge for g in self.gates if g.state != "glued"]

    def make(self, start, apex, edge):
        gate = Gate(start, apex, edge)
        self.gates.append(gate)
        self.waiting.append(gate)
        self.gate_at[start] = gate
        return gate

    @staticmethod
    def join(g, h):
        g.next, h.before = h, g

    def new_vertex(self, link):
        assert len(self.links) < self.vertices
        self.links.append(link)
        self.n.append(0)
        self.latest.append(None)
        self.other.append(None)
        self.gate_at.append(None)
        return len(self.links) - 1

    def known(self):
        v = len(self.links) - 1 - self.back.read(self.coder)
        assert v >= 0
        return v

    def any_patch(self):
        b = (self.patch_count - 1).bit_length()
        high = self.coder.raw(max(b - 10, 0))
        patch = high << min(b, 10) | self.coder.raw(min(b, 10))
        assert patch < self.patch_count
        return patch

    def place(self, corners, patch):
        for v in corners:
            self.n[v] = min(self.n[v] + 1, 9)
            if self.latest[v] != patch:
                self.other[v], self.latest[v] = self.latest[v], patch
        self.triangles.append(corners)
        self.patch.append(patch)
        return len(self.triangles) - 1

    def pair(self, e, f, p, q):
        v, w = max(p, q), min(p, q)
        if v > e and v > f and v > w:
            link = self.links[v]
            if not link or isinstance(link[0], int):
                self.links[v] = [(e, f, w)]
            elif len(link) == 1:
                link.append((e, f, w))

    def seed(self):
        corners, last = [], len(self.links) - 1
        for k in range(3):
            if not self.links or self.coder.bit(self.fresh[k]):
                last = self.new_vertex([last] if last >= 0 else [])
            else:
                last = self.known()
            corners.append(last)
        t = self.place(corners, self.any_patch())
        p, q, r = corners
        x, y, z = self.make(p, r, 3 * t), self.make(q, p, 3 * t + 1), self.make(r, q, 3 * t + 2)
        self.join(x, y)
        self.join(y, z)
        self.join(z, x)

    def read_op(self, g, a, b):
        bit, h, l = self.coder.bit, g.next, g.before
        right = h is not g and h.state == "open" and h.next is not g
        left = l is not g and l.state == "open" and l.before is not g
        asked = self.ops[(10 * self.n[a] + self.n[b]) * 4 + 2 * left + right]
        if bit(asked[0]):
            return "new", self.new_vertex([(a, b, g.apex)]), None
        if right and bit(asked[1]):
            return "right", h.next.start, None
        if left and bit(asked[2]):
            return "left", l.start, None
        if bit(asked[3]):
            return "border", None, None
        if bit(self.along):
            m = self.distance.read(self.coder)
            assert m < 48
            j = g.next if m % 2 == 0 else g
            for _ in range(m // 2 + 1):
                j = j.next if m % 2 == 0 else j.before
            return "along", j.start, j
        c = self.known()
        j = self.gate_at[c]
        return "known", c, j if j and j.state != "glued" else None

    def read_patch(self, of_gate, a, b, c, new):
        if self.patch_count == 1:
            return 0
        other, latest = self.other, self.latest
        i = 0 if new else 3 if other[c] is not None else 1 if latest[c] == of_gate else 2
        if self.coder.bit(self.same[8 * (other[a] is not None) + 4 * (other[b] is not None) + i]):
            return of_gate
        guesses = [other[v] if latest[v] == of_gate else latest[v] for v in (c, b, a)]
        guesses = [p for p in guesses if p is not None]
        if guesses and self.coder.bit(self.guess):
            return guesses[0]
        return self.any_patch()

    def step(self, g):
        a, b, h, l = g.start, g.next.start, g.next, g.before
        op, c, j = self.read_op(g, a, b)
        if op == "border":
            g.state = "dead"
            return None
        t = self.place((b, a, c), self.read_patch(self.patch[g.edge // 3], a, b, c, op == "new"))
        if op != "new":
            self.pair(a, b, g.apex, c)
        g.state = "glued"
        if op == "right":
            after = h.next
            h.state = "glued"
            self.pair(b, c, h.apex, a)
            if after is l and l.state == "open":
                l.state = "glued"
                self.pair(c, a, l.apex, b)
                return None
            x = self.make(a, b, 3 * t + 1)
            self.join(l, x)
            self.join(x, after)
            return x
        if op == "left":
            ahead = l.before
            l.state = "glued"
            self.pair(c, a, l.apex, b)
            x = self.make(c, a, 3 * t + 2)
            self.join(ahead, x)
            self.join(x, h)
            return None
        x, y = self.make(a, b, 3 * t + 1), self.make(c, a, 3 * t + 2)
        i = j.before if j else None
        self.join(l, x)
        self.join(y, h)
        if j is None or j is g:
            self.join(x, y)
        else:
            self.join(i, y)
            self.join(x, j)
        return x


def read_borders(coder, mesh, vertices):
    """Section 5.5."""
    edges = range(3 * len(mesh.triangles)) if coder.raw(1) else mesh.open
    borders, marks, asked = [0] * len(mesh.triangles), [0] * vertices, models(9)
    for edge in edges:
        t, k = divmod(edge, 3)
        v, w = mesh.triangles[t][k], mesh.triangles[t][(k + 1) % 3]
        bit = coder.bit(asked[3 * marks[v] + marks[w]])
        borders[t] |= bit << k
        for end in (v, w):
            marks[end] = 2 if bit else max(marks[end], 1)
    return borders


def beside(link):
    """The two vertices beside a vertex."""
    if not link:
        return None, None
    return (link[0], link[0]) if isinstance(link[0], int) else link[0][:2]


def signed(x, bits=32):
    x &= (1 << bits) - 1
    return x - (1 << bits) if x >> (bits - 1) else x


def read_weights(coder):
    return [signed(coder.raw(8), 8) for _ in range(3)]


def predict(values, link, weights):
    """Section 5.6."""
    if not link:
        return [0, 0, 0]
    if isinstance(link[0], int):
        return list(values[link[0]])
    one, two, shared = weights
    out = []
    for k in range(3):
        a, b, c = (values[v][k] for v in link[0])
        if len(link) == 1:
            e, m, w = 2 * (a + b), 0, one
            beyond = e - 4 * c
        else:
            d, g, f = (values[v][k] for v in link[1])
            e, m, w = a + b + d + g, 0, two
            beyond = e - 2 * (c + f)
            for value, vertex in ((b, link[0][1]), (a, link[0][0])):
                if vertex in link[1][:2]:
                    m = 8 * value - 2 * e
        out.append((64 * e + w * beyond + shared * m + 128) >> 8)
    return out


def clamp(x, high):
    return max(0, min(high, x))


def read_positions(coder, links):
    weights, grains = read_weights(coder), Grains(coder)
    depth = coder.raw(2) + 2
    of_one, of_two = Residuals(depth, 48), Residuals(depth, 48)
    values, sizes = [], []
    for link in links:
        guess = [clamp(x, (1 << 30) - 1) for x in predict(values, link, weights)]
        near = beside(link)
        a, b = (sizes[v] if v is not None and v < len(sizes) else (0, 0, 0) for v in near)
        g = grains.read(coder, near[0])
        residuals = of_two if len(link) == 2 else of_one
        value, size = [], []
        for k in range(3):
            r = residuals.read(coder, half_octaves((a[k] + b[k]) >> g))
            value.append((rounded(guess[k], g) + r) << g)
            size.append(min(min(abs(r), 1 << 22) << g, 1 << 22))
        values.append(value)
        sizes.append(size)
    return values


def read_colors(coder, links):
    weights = read_weights(coder)
    rg, bg, br = (coder.raw(7) - 64 for _ in range(3))
    grains = Grains(coder)
    depth = coder.raw(2) + 2
    of_green, of_red, of_blue = (Residuals(depth, 1) for _ in range(3))
    values = []
    for link in links:
        pr, pg, pb = (clamp(x, 255) for x in predict(values, link, weights))
        g = min(grains.read(coder, beside(link)[0]), 7)
        channel = lambda residuals, p: (rounded(p, g) + residuals.read(coder, 0)) << g & 255
        green = channel(of_green, pg)
        red = channel(of_red, clamp(pr + ((rg * (green - pg) + 8) >> 4), 255))
        blue = channel(of_blue, clamp(pb + ((bg * (green - pg) + br * (red - pr) + 8) >> 4), 255))
        values.append((red, green, blue))
    return values


def read_normals(coder, mesh, positions, patches):
    """Section 5.8."""
    hints = [coder.raw(1) for _ in range(patches)]
    kinds = [0] * len(positions)
    for corners, patch in zip(mesh.triangles, mesh.patch):
        for v in corners:
            kinds[v] |= hints[patch]
    for edge in mesh.open:
        t, k = divmod(edge, 3)
        for v in (mesh.triangles[t][k], mesh.triangles[t][(k + 1) % 3]):
            kinds[v] |= 2
    n = coder.raw(4) + 1
    levels = (1 << (n - 1)) - 1
    grains = Grains(coder)
    depth = 4 if n < 15 else 5
    of_u, of_v = Residuals(depth, 24), Residuals(depth, 24)
    differs, recent = models(4, 16), [0] * 4
    sign = lambda x: (x > 0) - (x < 0)
    normals = []
    for guess, kind, link in zip(predicted_normals(positions, mesh.triangles), kinds, mesh.links):
        g = grains.read(coder, beside(link)[0])
        level = [x if n == 16 else sign(x) * ((2 * abs(x) * levels + 32767) // 65534) for x in guess]
        context = half_octaves(recent[kind] >> g)
        ru = rv = 0
        if coder.bit(differs[kind][min(context, 15)]):
            ru = of_u.read(coder, context)
            rv = of_v.read(coder, half_octaves(2 * min(abs(ru), 1 << 22)))
        s = min(min(abs(ru), 1 << 22) + min(abs(rv), 1 << 22), 1 << 22) << min(g, 8)
        recent[kind] += s // 4 - recent[kind] // 4
        level = [(rounded(x, g) + r) << g for x, r in zip(level, (ru, rv))]
        normals.append(tuple(x if n == 16 else sign(x) * ((65534 * abs(x) + levels) // (2 * levels)) for x in level))
    return normals


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
    assert c.u8() == 1
    patches = [(c.varint(), (c.varint() - 1) & NONE) for _ in range(c.varint())]
    body = Bytes(c.take(c.varint()))
    if triangle_count == 0:
        return patches, [], [], [], [], [], [[] for _ in range(scalars)]
    coded = body.take(body.varint())
    coder = Coder(coded, body.take(len(body.data) - body.at))
    mesh = Connectivity(coder, vertices, triangle_count, len(patches))
    borders = read_borders(coder, mesh, vertices)
    positions = read_positions(coder, mesh.links)
    rgb = read_colors(coder, mesh.links) if colors else []
    normals = read_normals(coder, mesh, positions, len(patches))
    channels = []
    for _ in range(scalars):
        number, ordered = Number(6), []
        for link in mesh.links:
            a, b = (ordered[v] if v is not None and v < len(ordered) else 0 for v in beside(link))
            ordered.append(signed(((a + b) >> 1) + number.read_wide(coder)))
        channels.append([x & NONE if x >= 0 else (~x ^ 0x80000000) & NONE for x in ordered])
    coder.end()
    order = sorted(range(triangle_count), key=lambda t: mesh.patch[t])
    assert [mesh.patch.count(p) for p in range(len(patches))] == [count for count, _ in patches]
    triangles, borders = [mesh.triangles[t] for t in order], [borders[t] for t in order]
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
    assert data[:8] == b"KILWAPCK" and struct.unpack_from("<H", data, 8) == (1,)
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
