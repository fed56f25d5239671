#!/usr/bin/env python3
"""A second reader of Kilwa packs, written from docs/FORMAT.md alone, by somebody who had not seen the first.

Usage: read_pack.py PACK        prints, per chunk, counts and a digest of its geometry, as tests/second_reader.rs expects.

Plain Python 3, standard library only, clear rather than fast. It opens a pack, checks every checksum and all that a reader has to
check, and decodes every chunk. What only a verifier checks (section 9) is verify_pack.py.
"""
import hashlib
import json
import math
import struct
import sys
from collections import Counter

sys.dont_write_bytecode = True
from hashing import blake3  # noqa: E402

NONE = 2**32 - 1
CLIP = 2**22


class Refused(Exception):
    """The pack, or one chunk of it, is unusable."""


def need(good, message):
    if not good:
        raise Refused(message)


def members(pairs):
    """An object of JSON, each of whose members is there once."""
    need(len({name for name, _ in pairs}) == len(pairs), "an object in the metadata has a duplicate member")
    return dict(pairs)


# --- Sections 5.2 and 5.3: bits and numbers ---


def varint(data, at):
    value = shift = 0
    while True:
        need(at < len(data) and shift < 35, "a varint does not end")
        value |= (data[at] & 127) << shift
        at, shift = at + 1, shift + 7
        if data[at - 1] < 128:
            need(value < 2**32, "a varint has more than 32 bits")
            return value, at


def models(count):
    return [[32768, 0] for _ in range(count)]


class Bits:
    """The coded stream and the raw bits of a chunk's body, side by side."""

    def __init__(self, coded, raw):
        self.coded, self.length, self.at = coded + bytes(16), len(coded), 8
        self.range, self.code = 2**64 - 1, int.from_bytes(self.coded[:8], "big")
        self.bits, self.left = int.from_bytes(raw, "little"), 8 * len(raw)

    def raw(self, n):
        need(n <= self.left, "the raw bits are too short")
        value = self.bits & ((1 << n) - 1)
        self.bits >>= n
        self.left -= n
        return value

    def bit(self, model):
        zero, seen = model
        bound = (self.range >> 16) * zero
        rate = 131072 // (2 * seen + 3)
        if self.code < bound:
            self.range, value = bound, 0
            model[0] = zero + ((65535 - zero) * rate >> 16)
        else:
            self.code -= bound
            self.range, value = self.range - bound, 1
            model[0] = zero - (zero * rate >> 16)
        model[1] = min(seen + 1, 126)
        if self.range < 2**32:
            need(self.at + 4 <= self.length + 8, "the coded stream is too short")
            self.range <<= 32
            self.code = self.code << 32 | int.from_bytes(self.coded[self.at : self.at + 4], "big")
            self.at += 4
        return value

    def end(self):
        need(self.at >= self.length, "the coded stream is too long")
        need(self.left < 8 and self.bits == 0, "the raw bits are too long")

    def tree(self, nodes):
        node = 1
        while node < len(nodes):
            node = 2 * node + self.bit(nodes[node])
        return node - len(nodes)

    def rest(self, upper, s):
        if s == 0:
            return 1
        x, s = 2 + self.bit(upper[s]), s - 1
        while s:
            n = min(s, 16)
            x, s = x << n | self.raw(n), s - n
        return x


class Number:
    """A number (depth 5) or a wide number (depth 6)."""

    def __init__(self, bits, depth=5):
        self.bits, self.nodes, self.upper = bits, models(1 << depth), models(32)

    def read(self):
        return self.bits.rest(self.upper, self.bits.tree(self.nodes)) - 1

    def wide(self):
        s = min(self.bits.tree(self.nodes), 32)
        u = self.bits.rest(self.upper, s - 1) if s else 0
        return -(u // 2) - 1 if u & 1 else u // 2


class Residuals:
    def __init__(self, bits, depth, contexts):
        self.bits, self.trees, self.upper = bits, [models(1 << depth) for _ in range(contexts)], models(32)

    def read(self, context):
        bits = self.bits
        s = bits.tree(self.trees[min(context, len(self.trees) - 1)])
        if s == 0:
            return 0
        x, k = 1, 0
        if s > 1:
            x, k = 2 + bits.bit(self.upper[s]), s - 2
        if k > 15:
            x, k = x << (k - 15) | bits.raw(k - 15), 15
        t = bits.raw(k + 1)
        size = x << k | t >> 1
        return -size if t & 1 else size


class Grains:
    """The grain of each vertex, as read; `links` say which vertex is beside it."""

    def __init__(self, bits, links):
        self.bits, self.links, self.of = bits, links, []
        self.trees = [models(16) for _ in range(16)] if bits.raw(1) else None

    def read(self, v):
        link = self.links[v]
        tree = self.of[link[0]] if link else 0
        self.of.append(self.bits.tree(self.trees[tree]) if self.trees else 0)
        return self.of[v]


def rounded(x, grain):
    return (x + (1 << grain) // 2) >> grain


def h(x):
    t = (x + 1).bit_length() - 1
    return 2 * t + ((x + 1) >> (t - 1) & 1 if t else 0)


def clamp(x, low, high):
    return max(low, min(x, high))


# --- Section 5.4: connectivity ---

OPEN, DEAD, GLUED = range(3)


class Surface:
    """Grows the triangles of a chunk: `triangles` and `patch` in the order of decoding, `links` of the vertices, and the gates."""

    def __init__(self, bits, patches, vertices, triangles):
        self.bits, self.patches, self.limit = bits, patches, vertices
        self.triangles, self.patch, self.links = [], [], []
        self.start, self.next, self.before, self.apex, self.edge, self.state = [], [], [], [], [], []
        self.gate, self.n, self.latest, self.other, stack = [], [], [], [], []
        self.stack = stack
        self.prepare()
        while len(self.triangles) < triangles:
            if not stack:
                self.seed()
                continue
            gate = stack.pop()
            while gate is not None and self.state[gate] == OPEN and len(self.triangles) < triangles:
                gate = self.step(gate)
        while len(self.links) < vertices:
            self.links.append((len(self.links) - 1,) if self.links else ())

    def prepare(self):
        self.fresh, self.steps, self.along, self.same, self.guess = models(3), models(1600), [32768, 0], models(16), [32768, 0]
        self.back, self.distance = Number(self.bits), Number(self.bits)

    def is_fresh(self, k):
        return self.bits.bit(self.fresh[k])

    def is_same(self, context):
        return self.bits.bit(self.same[context])

    def is_guess(self):
        return self.bits.bit(self.guess)

    def number(self, which):
        return which.read()

    def operation(self, a, b, left, right):
        """What lies across the gate from a to b."""
        bit, base = self.bits.bit, 4 * ((10 * self.n[a] + self.n[b]) * 4 + 2 * left + right)
        if bit(self.steps[base]):
            return "new"
        if right and bit(self.steps[base + 1]):
            return "right"
        if left and bit(self.steps[base + 2]):
            return "left"
        if bit(self.steps[base + 3]):
            return "border"
        return "along" if bit(self.along) else "known"

    def vertex(self, link):
        v = len(self.links)
        need(v < self.limit, "more vertices than the directory says")
        self.links.append(link)
        for values, first in ((self.gate, None), (self.n, 0), (self.latest, None), (self.other, None)):
            values.append(first)
        return v

    def known(self):
        v = len(self.links) - 1 - self.number(self.back)
        need(v >= 0, "a vertex before the first")
        return v

    def any(self):
        b = (self.patches - 1).bit_length()
        low = min(b, 10)
        high = self.bits.raw(b - low)
        patch = high << low | self.bits.raw(low)
        need(patch < self.patches, "a patch that the table does not have")
        return patch

    def make(self, start, apex, edge):
        g = len(self.start)
        for values, value in ((self.start, start), (self.next, g), (self.before, g), (self.apex, apex), (self.edge, edge), (self.state, OPEN)):
            values.append(value)
        self.gate[start] = g
        self.stack.append(g)
        return g

    def join(self, g, after):
        self.next[g], self.before[after] = after, g

    def pair(self, e, f, p, q):
        v, w = max(p, q), min(p, q)
        if v > e and v > f and v > w and len(self.links[v]) < 6:
            self.links[v] = (self.links[v] if len(self.links[v]) == 3 else ()) + (e, f, w)

    def count(self, corners, patch):
        self.triangles.append(corners)
        self.patch.append(patch)
        for v in corners:
            self.n[v] = min(self.n[v] + 1, 9)
            if self.latest[v] != patch:
                self.other[v], self.latest[v] = self.latest[v], patch

    def seed(self):
        corners = []
        for k in range(3):
            if not self.links or self.is_fresh(k):
                near = corners[-1] if k else len(self.links) - 1
                corners.append(self.vertex((near,) if near >= 0 else ()))
            else:
                corners.append(self.known())
        patch, edge = self.any(), 3 * len(self.triangles)
        p, q, r = corners
        gates = self.make(p, r, edge), self.make(q, p, edge + 1), self.make(r, q, edge + 2)
        for k in range(3):
            self.join(gates[k], gates[(k + 1) % 3])
        self.count((p, q, r), patch)

    def step(self, g):
        start, nxt, bef, state = self.start, self.next, self.before, self.state
        after, ahead = nxt[g], bef[g]
        a, b, top = start[g], start[after], self.apex[g]
        right = after != g and state[after] == OPEN and nxt[after] != g
        left = ahead != g and state[ahead] == OPEN and bef[ahead] != g
        j = i = None
        kind = self.operation(a, b, left, right)
        new = kind == "new"
        if new:
            c = self.vertex((a, b, top))
        elif kind == "right":
            c = start[nxt[after]]
        elif kind == "left":
            c = start[ahead]
        elif kind == "border":
            state[g] = DEAD
            return None
        elif kind == "along":
            m = self.number(self.distance)
            need(m < 48, "a vertex too far along the border")
            j, way = (g, bef) if m & 1 else (after, nxt)
            for _ in range(m // 2 + 1):
                j = way[j]
            c = start[j]
        else:
            c = self.known()
            j = self.gate[c] if state[self.gate[c]] != GLUED else None
        patch, t = self.choose(a, b, c, new, self.patch[self.edge[g] // 3]), len(self.triangles)
        if not new:
            self.pair(a, b, top, c)
        state[g] = GLUED
        if kind == "right":
            far = nxt[after]
            state[after] = GLUED
            self.pair(b, c, self.apex[after], a)
            if far == ahead and state[far] == OPEN:
                state[far] = GLUED
                self.pair(c, a, self.apex[far], b)
                x = None
            else:
                x = self.make(a, b, 3 * t + 1)
                self.join(ahead, x)
                self.join(x, far)
        elif kind == "left":
            state[ahead] = GLUED
            self.pair(c, a, self.apex[ahead], b)
            y, far, x = self.make(c, a, 3 * t + 2), bef[ahead], None
            self.join(far, y)
            self.join(y, after)
        else:
            i = bef[j] if j is not None else None
            x, y = self.make(a, b, 3 * t + 1), self.make(c, a, 3 * t + 2)
            self.join(ahead, x)
            self.join(y, after)
            if j is None or j == g:
                self.join(x, y)
            else:
                self.join(i, y)
                self.join(x, j)
        self.count((b, a, c), patch)
        return x

    def choose(self, a, b, c, new, last):
        if self.patches == 1:
            return 0
        latest, other = self.latest, self.other
        i = 0 if new else 3 if other[c] is not None else 1 if latest[c] == last else 2
        if self.is_same(8 * (other[a] is not None) + 4 * (other[b] is not None) + i):
            return last
        guesses = [other[v] if latest[v] == last else latest[v] for v in (c, b, a)]
        guess = next((g for g in guesses if g is not None), None)
        return guess if guess is not None and self.is_guess() else self.any()


# --- Sections 5.5 to 5.9: what the vertices and edges carry ---


def read_borders(bits, surface, read):
    """For each triangle in the order of decoding, a number whose bit k says that edge k is a border; `read` reads a bit in one of nine contexts."""
    met, borders = {}, [0] * len(surface.triangles)
    if bits.raw(1):
        edges = range(3 * len(borders))
    else:
        edges = [e for e, state in zip(surface.edge, surface.state) if state != GLUED]
    for edge in edges:
        t, k = divmod(edge, 3)
        v, w = surface.triangles[t][k], surface.triangles[t][(k + 1) % 3]
        border = read(3 * met.get(v, 0) + met.get(w, 0))
        borders[t] |= border << k
        for u in (v, w):
            met[u] = max(met.get(u, 0), 1 + border)
    return borders


def predict(link, of, weights):
    """The prediction of a vertex for each of three axes or channels; `of` are the values of the vertices before it."""
    if len(link) < 2:
        return of[link[0]] if link else (0, 0, 0)
    one, two, shared = weights
    result = []
    for axis in range(3):
        a, b, c = (of[v][axis] for v in link[:3])
        if len(link) == 3:
            e, m, w = 2 * (a + b), 0, one
            back = e - 4 * c
        else:
            e, w = a + b + of[link[3]][axis] + of[link[4]][axis], two
            back = e - 2 * (c + of[link[5]][axis])
            m = 8 * a - 2 * e if link[0] in link[3:5] else 8 * b - 2 * e if link[1] in link[3:5] else 0
        result.append((64 * e + w * back + shared * m + 128) >> 8)
    return result


def read_weights(bits):
    return [(raw ^ 128) - 128 for raw in (bits.raw(8), bits.raw(8), bits.raw(8))]


def read_positions(bits, links):
    weights, grains, depth = read_weights(bits), Grains(bits, links), bits.raw(2) + 2
    double, other = Residuals(bits, depth, 48), Residuals(bits, depth, 48)
    points, sizes = [], []
    for v, link in enumerate(links):
        guess, g = predict(link, points, weights), grains.read(v)
        residuals, point, size = double if len(link) == 6 else other, [], []
        for axis in range(3):
            p = rounded(clamp(guess[axis], 0, 2**30 - 1), g)
            beside = sizes[link[0]][axis] + sizes[link[min(1, len(link) - 1)]][axis] if link else 0
            r = residuals.read(h(beside >> g))
            point.append(p + r << g)
            size.append(min(min(abs(r), CLIP) << g, CLIP))
        need(0 <= min(point) and max(point) < 2**30, f"vertex {v} is off the lattice")
        points.append(point)
        sizes.append(size)
    return points


def tinted(predicted, factors, grain, residuals):
    """The colour of a vertex: red and blue follow what green differs from its prediction. `residuals` gives those of green, red and blue."""
    (pr, pg, pb), (rg, bg, br) = predicted, factors
    green = rounded(pg, grain) + next(residuals) << grain & 255
    red = rounded(clamp(pr + (rg * (green - pg) + 8 >> 4), 0, 255), grain) + next(residuals) << grain & 255
    p = clamp(pb + (bg * (green - pg) + br * (red - pr) + 8 >> 4), 0, 255)
    return red, green, rounded(p, grain) + next(residuals) << grain & 255


def read_colors(bits, links):
    weights = read_weights(bits)
    factors = [bits.raw(7) - 64 for _ in range(3)]
    grains, depth = Grains(bits, links), bits.raw(2) + 2
    channels, colors = [Residuals(bits, depth, 1) for _ in range(3)], []
    for v, link in enumerate(links):
        predicted = [clamp(p, 0, 255) for p in predict(link, colors, weights)]
        g = min(grains.read(v), 7)
        colors.append(tinted(predicted, factors, g, (channel.read(0) for channel in channels)))
    return colors


def signed(value, size):
    return -size if value < 0 else size


def octahedral(x, y, z):
    """Sum of normals to two coordinates in -32767 to 32767."""
    total = abs(x) + abs(y) + abs(z)
    if total == 0 or not math.isfinite(total):
        return 0, 0
    x, y = x / total, y / total
    if z < 0:
        x, y = signed(x, 1 - abs(y)), signed(y, 1 - abs(x))
    result = []
    for value in (x, y):
        size = min(abs(value), 1.0) * 32767
        whole = math.floor(size)
        result.append(int(signed(value, whole + (size - whole >= 0.5))))
    return result


def mark_open(surface, kinds):
    """Sets bit 1 of the kinds of vertices at edges that are not glued."""
    for edge, state in zip(surface.edge, surface.state):
        if state != GLUED:
            kinds[surface.triangles[edge // 3][edge % 3]] |= 2
            kinds[surface.triangles[edge // 3][(edge + 1) % 3]] |= 2


def levels_of(coordinates, n):
    """Octahedral coordinates as levels of n bits."""
    top = (1 << n - 1) - 1
    return [signed(c, (2 * abs(c) * top + 32767) // 65534) for c in coordinates]


def coordinates_of(levels, n, v):
    """Levels of the normal of vertex v as octahedral coordinates."""
    top = (1 << n - 1) - 1
    need(all(-top - (n == 16) <= level <= top for level in levels), f"the normal of vertex {v} is out of range")
    return levels if n == 16 else [signed(x, (65534 * abs(x) + top) // (2 * top)) for x in levels]


def read_normals(bits, surface, points, patches):
    hints = [bits.raw(1) for _ in range(patches)]
    n = bits.raw(4) + 1
    need(n >= 2, "normals of one bit")
    grains, depth = Grains(bits, surface.links), 4 if n < 15 else 5
    of_u, of_v, differs = Residuals(bits, depth, 24), Residuals(bits, depth, 24), [models(16) for _ in range(4)]
    sums, kinds = [[0.0] * 3 for _ in points], [0] * len(points)
    for corners, patch in zip(surface.triangles, surface.patch):
        p, q, r = (points[v] for v in corners)
        ux, uy, uz = (float(q[i] - p[i]) for i in range(3))
        vx, vy, vz = (float(r[i] - p[i]) for i in range(3))
        cross = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        for v in corners:
            kinds[v] |= hints[patch]
            for i in range(3):
                sums[v][i] += cross[i]
    mark_open(surface, kinds)
    recent, normals = [0] * 4, []
    for v, kind in enumerate(kinds):
        g = grains.read(v)
        predicted = levels_of(octahedral(*sums[v]), n)
        c, ru, rv = h(recent[kind] >> g), 0, 0
        if bits.bit(differs[kind][min(c, 15)]):
            ru = of_u.read(c)
            rv = of_v.read(h(2 * min(abs(ru), CLIP)))
        levels = [rounded(p, g) + r << g for p, r in zip(predicted, (ru, rv))]
        normals.append(coordinates_of(levels, n, v))
        s = min(min(abs(ru), CLIP) + min(abs(rv), CLIP), CLIP) << min(g, 8)
        recent[kind] += s // 4 - recent[kind] // 4
    return normals


def read_scalars(bits, links, numbers):
    keys = []
    for link in links:
        mean = keys[link[0]] + keys[link[min(1, len(link) - 1)]] >> 1 if link else 0
        keys.append((mean + numbers.wide() + 2**31) % 2**32 - 2**31)
    return [(i if i >= 0 else ~i ^ 0x80000000) & NONE for i in keys]


class Chunk:
    """patches [(triangles, diamond or None)], triangles, borders, points, colors (or None), normals (u, v), scalars by channel."""

    def __init__(self, data, entry, colors, scalars):
        need(data[0] in (1, 2, 3), f"an unknown codec, {data[0]}")
        count, at = varint(data, 1)
        need(count <= len(data) // 2, "more patches than bytes")
        self.patches, total = [], 0
        for _ in range(count):
            size, at = varint(data, at)
            diamond, at = varint(data, at)
            self.patches.append((size, diamond - 1 if diamond else None))
            total += size
        need(total == entry.triangles, "the patches do not tile the triangles")
        length, at = varint(data, at)
        end = at + length
        need(end <= len(data), "the body is longer than the chunk")
        need(len(data) == max(end, -(-total // 64)) and not any(data[end:]), "bytes behind the body")
        self.triangles, self.borders, self.points, self.normals = [], [], [], []
        self.colors, self.scalars = [] if colors else None, [[] for _ in range(scalars)]
        if total == 0:
            need(length == 0 and entry.vertices == 0, "a body or vertices without triangles")
            return
        import codec2

        coded, at = varint(data[:end], at)
        need(at + coded <= end, "the coded stream is longer than the body")
        coded, raw = data[at : at + coded], data[at + coded : end]
        if data[0] == 3:
            import codec3

            codec3.read_body(self, coded, raw, entry, scalars)
            return
        surface = codec2.read_body(self, coded, raw, entry, count, total, scalars) if data[0] == 2 else self.first(coded, raw, entry, count, total)
        borders = self.borders
        order, sizes = sorted(range(total), key=surface.patch.__getitem__), Counter(surface.patch)
        need(all(sizes[k] == size for k, (size, _) in enumerate(self.patches)), "a patch has another size than the table says")
        self.triangles = [surface.triangles[t] for t in order]
        self.borders = [borders[t] for t in order]

    def first(self, coded, raw, entry, patches, triangles):
        """The body in codec 1; gives its surface back."""
        bits = Bits(coded, raw)
        surface, nine = Surface(bits, patches, entry.vertices, triangles), models(9)
        self.borders = read_borders(bits, surface, lambda context: bits.bit(nine[context]))
        self.points = read_positions(bits, surface.links)
        if self.colors is not None:
            self.colors = read_colors(bits, surface.links)
        self.normals = read_normals(bits, surface, self.points, patches)
        self.scalars = [read_scalars(bits, surface.links, Number(bits, 6)) for _ in self.scalars]
        bits.end()
        return surface

    def by_patch(self):
        """(diamond, first triangle, end) of each patch."""
        at = 0
        for size, diamond in self.patches:
            yield diamond, at, at + size
            at += size


# --- Sections 2 to 4, 6 and 7: the file ---

PAGE = 16384


class Entry:
    def __init__(self, data):
        fields = struct.unpack("<QIIIffI4d6i4I16sIBBH", data)
        self.offset, self.length, self.vertices, self.triangles, self.error, self.color_error, self.level = fields[:7]
        self.centre, self.radius, self.low, self.high = fields[7:10], fields[10], fields[11:14], fields[14:17]
        self.places, self.checksum = fields[17:21], fields[21]
        self.parents = [p for p in self.places if p != NONE]
        # First child, how many, pages from the first's to the last's, 65535ths of the error; no children told where their number is 0.
        first, count, pages, share = fields[22:26]
        self.children = (first, count, pages & 127, share) if count else None
        self.whole = count > 0 and pages >= 128


class Pack:
    """Header, metadata, directory and footer of the pack in the bytes `data`, all checked; `chunk(i)` decodes."""

    def __init__(self, data):
        self.data = data
        need(data[:8] == b"KILWAPCK", "this is not a Kilwa pack")
        need(len(data) >= 336, "the file is shorter than a header and a footer")
        need(blake3(data[:224]) == data[224:256], "the header is damaged")
        (major, minor, length, required, _, x, y, z, self.step_log2, self.cube_log2, size, self.meta_at, meta_length, count, meta_sum,
         self.page0, self.page1, self.finest, self.triangles, self.vertices, self.colors, self.scalars) = struct.unpack_from(
            "<HHIQQ3diIQQII16sQQQQQBB", data, 8)
        self.version, self.origin, self.meta_end = (major, minor), (x, y, z), self.meta_at + meta_length
        need(major == 1, f"version {major}.{minor}: this reader knows 1")
        need(required in (0, 1, 2), f"required features that this reader does not know: {required:#x}")
        self.codecs = {0: (1,), 1: (1, 2), 2: (3,)}[required]
        need(length == 256 and size == len(data), f"the file has {len(data)} bytes, the header says {size}")
        need(all(map(math.isfinite, self.origin)) and abs(self.step_log2) <= 1000 and 1 <= self.cube_log2 <= 30, "the lattice is unusable")
        need(self.colors < 2 and self.scalars <= 16, "attributes that do not exist")
        need(256 <= self.meta_at and 1 <= meta_length <= 65536 and self.meta_end <= size, "the metadata are not in the file")
        meta = data[self.meta_at : self.meta_end]
        need(blake3(meta)[:16] == meta_sum, "the metadata are damaged")
        try:
            self.metadata = json.loads(meta.decode("utf-8"), object_pairs_hook=members)
        except ValueError as fault:
            raise Refused(f"the metadata are no JSON: {fault}") from fault
        need(isinstance(self.metadata, dict) and isinstance(self.metadata.get("scalars"), list), "the metadata are incomplete")
        said = self.metadata.get("lattice_step"), self.metadata.get("triangles"), len(self.metadata["scalars"])
        need(said == (math.ldexp(1, self.step_log2), self.finest, self.scalars), "the metadata contradict the header")
        need(1 <= count <= 127 * size // PAGE, "more entries than the file has room for")
        self.entries, sums = [], b""
        for number in range(-(-count // 127)):
            at = self.page1 + PAGE * (number - 1) if number else self.page0
            page = data[at : at + PAGE]
            need(len(page) == PAGE and page[:4] == b"KPAG", f"page {number} is not where it should be")
            need(blake3(page[:16] + bytes(16) + page[32:])[:16] == page[16:32], f"page {number} is damaged")
            here = min(127, count - 127 * number)
            need(struct.unpack_from("<II", page, 4) == (number, here), f"page {number} is another one")
            self.entries += (Entry(page[128 * k : 128 * k + 128]) for k in range(1, here + 1))
            sums += page[16:32]
        for i, entry in enumerate(self.entries):
            self.check_entry(i, entry)
        footer = data[-80:]
        need(footer[:16] == b"KILWAEND" + struct.pack("<Q", size), "there is no footer at the end")
        need(footer[16:48] == data[224:256] and footer[48:] == blake3(sums), "the footer is of another pack")
        self.identity = blake3(footer)[:16].hex()

    def check_entry(self, i, entry):
        room = entry.offset + entry.length <= len(self.data) - 80
        need(1 <= entry.length <= 2**29 and room, f"chunk {i} is not in the file")
        need(entry.triangles <= min(2**20, 64 * entry.length) and entry.vertices <= 3 * entry.triangles, f"entry {i} counts too many")
        need(entry.error == math.inf if i == 0 else 0 <= entry.error < math.inf, f"the error of entry {i} is unusable")
        need(entry.color_error >= 0 and all(map(math.isfinite, (*entry.centre, entry.radius))), f"entry {i} has unusable numbers")
        need(entry.level <= 255 and (i > 0 or entry.level == 0), f"the level of entry {i} is unusable")
        parents = entry.parents
        need((len(parents) > 0) == (i > 0) and all(p < i for p in parents), f"the parents of entry {i} are unusable")
        need(len(set(parents)) == len(parents), f"entry {i} has one parent twice")
        need(not entry.children or entry.children[0] > i, f"the children of entry {i} do not come after it")

    def chunk(self, i):
        entry = self.entries[i]
        data = self.data[entry.offset : entry.offset + entry.length]
        need(blake3(data)[:16] == entry.checksum, f"chunk {i} is damaged")
        try:
            need(data[0] in self.codecs, "a chunk of a codec that the header does not announce")
            chunk = Chunk(data, entry, self.colors, self.scalars)
            for _, diamond in chunk.patches:
                need(diamond is None or i < diamond < len(self.entries), "a diamond that is none")
        except Refused as fault:
            raise Refused(f"chunk {i}: {fault}") from fault
        return chunk

    def world(self, point):
        return [o + math.ldexp(p, self.step_log2) for o, p in zip(self.origin, point)]


# --- What tests/second_reader.rs compares ---


def digest(chunk):
    """SHA-256 over all that a chunk decodes to, for comparing readers."""
    parts = [struct.pack("<II", size, NONE if diamond is None else diamond) for size, diamond in chunk.patches]
    parts += (struct.pack("<3IB", *corners, border) for corners, border in zip(chunk.triangles, chunk.borders))
    parts += (struct.pack("<3i", *point) for point in chunk.points)
    parts += map(bytes, chunk.colors or ())
    parts += (struct.pack("<2h", *normal) for normal in chunk.normals)
    parts += (struct.pack("<I", value) for channel in chunk.scalars for value in channel)
    return hashlib.sha256(b"".join(parts)).hexdigest()


def main(path):
    with open(path, "rb") as file:
        pack = Pack(file.read())
    for i in range(len(pack.entries)):
        chunk = pack.chunk(i)
        print(i, len(chunk.points), len(chunk.triangles), digest(chunk))


if __name__ == "__main__":
    # codec2 builds on this file, under its own name.
    sys.modules["read_pack"] = sys.modules["__main__"]
    try:
        main(sys.argv[1])
    except Refused as fault:
        sys.exit(f"{sys.argv[1]}: {fault}")
