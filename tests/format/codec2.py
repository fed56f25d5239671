"""Codec 2 of read_pack.py, written from sections 5.12 to 5.19 of docs/FORMAT.md; its tables are read from there."""
import re
import struct
from pathlib import Path

import read_pack
from read_pack import CLIP, clamp, coordinates_of, levels_of, mark_open, need, octahedral, rounded, tinted

LEAST = (0, 1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 16, 24, 32, 64)
EXTRA = (0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 2, 3, 3, 5, 6)


def tables():
    """First counts of operations by context, counts of `same`, widths of residuals by row."""
    text = (Path(__file__).resolve().parents[2] / "docs/FORMAT.md").read_text(encoding="utf-8")
    found = {}
    for section, width in (("5.14", 6), ("5.15", 16)):
        part = text[text.index(f"### {section} Codec 2") :].split("\n### ")[0].split("```")[1]
        rows = re.findall(r"(\d+):((?: +\d+){%d})" % width, part)
        found[section] = [[int(x) for x in row.split()] for _, row in rows]
    listed = text[text.index("x from this list:") :].split(":")[1].split(".")[0]
    same = [int(x) for x in listed.split(",")]
    assert len(found["5.14"]) == 100 and len(same) == 16 and len(found["5.15"]) == 56
    return found["5.14"], same, found["5.15"]


OPERATIONS, SAME, WIDTHS = tables()


class Stream:
    """States, words and raw bits of a body."""

    def __init__(self, words, raw):
        need(len(words) >= 12 and len(words) % 2 == 0, "no states, or half a word")
        self.states, self.words, self.at = list(struct.unpack_from("<3I", words)), words, 12
        need(min(self.states) >= 65536, "a state is too small")
        self.bits, self.left = int.from_bytes(raw, "little"), 8 * len(raw)

    def raw(self, n):
        need(n <= self.left, "the raw bits are too short")
        value = self.bits & ((1 << n) - 1)
        self.bits >>= n
        self.left -= n
        return value

    def symbol(self, s, widths):
        slot = self.states[s] % 4096
        start, i = 0, 0
        while start + widths[i] <= slot:
            start, i = start + widths[i], i + 1
        state = widths[i] * (self.states[s] // 4096) + slot - start
        if state < 65536:
            need(self.at + 2 <= len(self.words), "the words are too few")
            state = state << 16 | struct.unpack_from("<H", self.words, self.at)[0]
            self.at += 2
        self.states[s] = state
        return i

    def end(self):
        need(self.at == len(self.words) and self.states == [65536] * 3, "the words do not end as they should")
        need(self.left < 8 and self.bits == 0, "the raw bits are too long")


class Learnt:
    def __init__(self, stream, counts):
        self.stream, self.counts, self.left, self.pause = stream, list(counts), 4, 4
        self.make()

    def make(self):
        if sum(self.counts) > 16384:
            self.counts = [c - c // 2 for c in self.counts]
        share = (4096 - len(self.counts)) * 65536 // sum(self.counts)
        self.widths = [1 + c * share // 65536 for c in self.counts]
        self.widths[-1] = 4096 - sum(self.widths[:-1])

    def read(self, s):
        i = self.stream.symbol(s, self.widths)
        self.counts[i] += 16
        self.left -= 1
        if self.left == 0:
            self.pause = self.left = min(2 * self.pause, 64)
            self.make()
        return i


def unknown(stream, n):
    return Learnt(stream, [8] * n)


class Number:
    def __init__(self, stream, sizes):
        self.stream, self.size = stream, unknown(stream, sizes)

    def read(self, s):
        b = self.size.read(s)
        return (1 << b) + self.stream.raw(b) - 1

    def wide(self):
        b = self.size.read(0)
        u = (1 << b - 1) + self.stream.raw(b - 1) if b else 0
        return -(u // 2) - 1 if u & 1 else u // 2


class Grains:
    def __init__(self, stream, there):
        self.models = [unknown(stream, 16) for _ in range(16)] if there else None

    def read(self, near):
        return self.models[near].read(0) if self.models else 0


class Surface(read_pack.Surface):
    """The same machine with other choices."""

    def prepare(self):
        stream = self.bits
        self.operations = [Learnt(stream, counts) for counts in OPERATIONS]
        self.distance, self.back = Number(stream, 6), Number(stream, 22)
        self.fresh = [unknown(stream, 2) for _ in range(3)]
        self.same = [Learnt(stream, (256 - x, x)) for x in SAME]
        self.guess = unknown(stream, 2)

    def is_fresh(self, k):
        return self.fresh[k].read(2)

    def is_same(self, context):
        return self.same[context].read(1)

    def is_guess(self):
        return self.guess.read(2)

    def number(self, which):
        return which.read(2)

    def operation(self, a, b, left, right):
        na, nb = clamp(self.n[a], 1, 7), clamp(self.n[b], 1, 7)
        kind = self.operations[(2 * (7 * (na - 1) + nb - 1) if right else 98) + left].read(0)
        need(kind != 1 or left, "a triangle to the left that cannot be")
        need(kind != 2 or right, "a triangle to the right that cannot be")
        return ("new", "left", "right", "border", "along", "known")[kind]


def residual_bits(stream, i, k):
    if i == 15:
        v = stream.raw(stream.raw(5) + 1)
        return (-(v >> 1) or -(2**31)) if v & 1 else v >> 1
    sign = 1 if i or k else 0
    v = stream.raw(EXTRA[i] + k + sign)
    m = (LEAST[i] << k) + (v >> sign)
    return (-m - (k > 0)) if sign and v & 1 else m


def row_of(scale):
    return (scale, 0) if scale < 20 else (20 + scale % 4, scale // 4 - 4)


def three(stream, rows):
    symbols = [stream.symbol(s, WIDTHS[row]) for s, (row, _) in enumerate(rows)]
    return [residual_bits(stream, i, k) for i, (_, k) in zip(symbols, rows)]


def h4(x):
    t = (x + 1).bit_length() - 1
    return 4 * t + ((x + 1 << 2 >> t) & 3)


class Line:
    def __init__(self, stream):
        self.offset, self.slope = stream.raw(7), stream.raw(4)

    def row(self, x):
        return row_of(clamp(self.offset + (self.slope * h4(x) >> 3) - 24, 0, 115))


def wrap(x):
    return (x + 2**31) % 2**32 - 2**31


def seven(link):
    """a, b, c, d, e, f, s of a link; the number of parallelograms; whether two share a vertex."""
    if len(link) < 3:
        return (list(link) or [None]) * 7 if len(link) < 2 else None, 0, False
    a, b, c = link[:3]
    if len(link) == 3:
        return [a, b, c, a, b, c, a], 1, False
    d, e, f = link[3:]
    first, second = a in (d, e), b in (d, e)
    return [a, b, c, d, e, f, b if second and not first else a], 2, first or second


def predict(link, of, weights):
    vertices, count, fan = seven(link)
    one, two, shared = weights
    if count < 2:
        k1, k2, k3 = 64 + one, -2 * one, 0
    elif fan:
        k1, k2, k3 = 64 + two - 2 * shared, -2 * two, 8 * shared
    else:
        k1, k2, k3 = 64 + two, -2 * two, 0
    result = []
    for axis in range(3):
        a, b, c, d, e, f, s = (of[v][axis] if v is not None else 0 for v in vertices)
        total = wrap(k1 * (b + d + e - 3 * a) + k2 * (c + f - 2 * a) + k3 * (s - a) + 128)
        result.append(wrap(a + (total >> 8)))
    return result


def read_values(stream, links, has_colors):
    """Positions, their grains, colours."""
    coarse = stream.raw(1)
    coarse_colors = stream.raw(1) if has_colors else 0
    weights = read_pack.read_weights(stream)
    if has_colors:
        color_weights = read_pack.read_weights(stream)
        factors = [stream.raw(7) - 64 for _ in range(3)]
    lines = Line(stream), Line(stream)
    if has_colors:
        rows = [(24 + stream.raw(5), 0) for _ in range(12 if coarse_colors else 6)]
    grains, color_grains = Grains(stream, coarse), Grains(stream, coarse_colors)
    points, sizes, of, colors = [], [], [], []
    for v, link in enumerate(links):
        (a, b, c, _, _, f, _), count, _ = seven(link)
        g = grains.read(of[a] if a is not None else 0)
        beside = [[sizes[x][i] if x is not None else 0 for x in (a, b, c, f)] for i in range(3)]
        q = [3 * (w + x) + y + z >> 2 for w, x, y, z in beside]
        near = [max(x, sum(q) >> 4) >> g for x in q]
        r = three(stream, [lines[count == 2].row(x) for x in near])
        guess = predict(link, points, weights)
        points.append([wrap(wrap(wrap(x + ((1 << g) >> 1)) >> g) + y << g) for x, y in zip(guess, r)])
        need(all(0 <= x < 2**30 for x in points[-1]), f"vertex {v} is off the lattice")
        sizes.append([min(abs(x), 2**20 >> g) << g for x in r])
        of.append(g)
        if has_colors:
            predicted = [clamp(p, 0, 255) for p in predict(link, colors, color_weights)]
            g = min(color_grains.read(g), 7)
            first = 6 * (g > 0) + 3 * (count == 2)
            colors.append(tinted(predicted, factors, g, iter(three(stream, rows[first : first + 3]))))
    return points, of, colors


def read_normals(stream, surface, points, of, patches):
    hints = [stream.raw(1) for _ in range(patches)]
    n = stream.raw(4) + 1
    need(n >= 2, "normals of one bit")
    lines = [Line(stream) if stream.raw(1) else None for _ in range(4)]
    second, grains = None, None
    if any(lines):
        second = Line(stream)
        grains = Grains(stream, stream.raw(1))
    sums, kinds, met = [[0] * 3 for _ in points], [0] * len(points), [set() for _ in points]
    for corners, patch in zip(surface.triangles, surface.patch):
        p, q, r = (points[v] for v in corners)
        (ux, uy, uz), (vx, vy, vz) = ([x[i] - p[i] for i in range(3)] for x in (q, r))
        cross = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        for v in corners:
            kinds[v] |= hints[patch]
            met[v].add(patch)
            for i in range(3):
                sums[v][i] += cross[i]
    mark_open(surface, kinds)
    kinds = [3 if kind == 1 and len(patches) > 1 else kind for kind, patches in zip(kinds, met)]
    recent, normals = [0] * 4, []
    for v, kind in enumerate(kinds):
        wrapped = [float((x + 2**63) % 2**64 - 2**63) for x in sums[v]]
        levels = levels_of(octahedral(*wrapped), n)
        if lines[kind]:
            g = grains.read(of[v])
            row, k = lines[kind].row(recent[kind] >> g)
            ru = residual_bits(stream, stream.symbol(0, WIDTHS[row]), k)
            row, k = second.row(2 * min(abs(ru), CLIP) + (recent[kind] >> g) >> 1)
            rv = residual_bits(stream, stream.symbol(1, WIDTHS[row]), k)
            levels = [rounded(p, g) + r << g for p, r in zip(levels, (ru, rv))]
            s = min(min(abs(ru), CLIP) + min(abs(rv), CLIP), CLIP) << min(g, 8)
            recent[kind] += s // 4 - recent[kind] // 4
        normals.append(coordinates_of(levels, n, v))
    return normals


def read_body(chunk, words, raw, entry, patches, triangles, scalars):
    """Fill in the parts of a chunk; gives its surface back."""
    stream = Stream(words, raw)
    surface = Surface(stream, patches, entry.vertices, triangles)
    nine = [unknown(stream, 2) for _ in range(9)]
    chunk.borders = read_pack.read_borders(stream, surface, lambda context: nine[context].read(0))
    chunk.points, of, colors = read_values(stream, surface.links, chunk.colors is not None)
    if chunk.colors is not None:
        chunk.colors = colors
    chunk.normals = read_normals(stream, surface, chunk.points, of, patches)
    chunk.scalars = [read_pack.read_scalars(stream, surface.links, Number(stream, 33)) for _ in range(scalars)]
    stream.end()
    return surface
