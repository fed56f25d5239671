"""Codec 3 of read_pack.py, written from sections 5.20 and 5.21 of docs/FORMAT.md."""
import math

from codec2 import Number, Stream, unknown
from read_pack import need


class Wide(Number):
    def __init__(self, stream):
        super().__init__(stream, 33)

    def read(self, s):
        b = self.size.read(s)
        u = (1 << b - 1) + self.stream.raw(b - 1) if b else 0
        return -(u // 2) - 1 if u & 1 else u // 2


def place(stream, bits, axes, before):
    bit, axis = bits.read(0), axes.read(1)
    need(before[axis] >> bit & 1 == 0, "splats out of order")
    point = []
    for a in range(3):
        low = bit + (a > axis)
        point.append((before[a] >> low << low) + stream.raw(low) + (1 << bit if a == axis else 0))
    return point


def square(p, normal, code):
    """The corners of a splat."""
    x, y = (max(c, -32767) / 32767 for c in normal)
    z = 1 - abs(x) - abs(y)
    if z < 0:
        x, y = (1 - abs(y)) * (1 if x >= 0 else -1), (1 - abs(x)) * (1 if y >= 0 else -1)
    length = math.sqrt(x * x + y * y + z * z)
    n = [x / length, y / length, z / length]
    size = [abs(c) for c in n]
    e = [0.0, 0.0, 0.0]
    e[size.index(min(size))] = 1.0
    a = cross(n, e)
    length = math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])
    a = [c / length for c in a]
    r = (4096, 4871, 5793, 6889)[code % 4] / 4096 * 2 ** (code // 4)
    u, v = ([math.floor(c * r + 0.5) for c in d] for d in (a, cross(n, a)))
    return [tuple(c + s * d for c, d in zip(p, way)) for way, s in ((u, 1), (v, 1), (u, -1), (v, -1))]


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def read_body(chunk, coded, raw, entry, scalars):
    """Fills a chunk of points."""
    count = entry.triangles // 2
    need(entry.triangles % 2 == 0 and entry.vertices == 4 * count, "other triangles than squares have")
    need(all(size % 2 == 0 for size, _ in chunk.patches), "half a square in a patch")
    stream = Stream(coded, raw)
    shift = stream.raw(4)
    bits, axes, radius = unknown(stream, 30), unknown(stream, 3), Wide(stream)
    normals, colors = [Wide(stream) for _ in range(2)], [Wide(stream) for _ in range(3)]
    point, code, normal, (red, green, blue) = [0, 0, 0], 0, [0, 0], (0, 0, 0)
    for size, _ in chunk.patches:
        for k in range(size // 2):
            point = place(stream, bits, axes, point) if k else [stream.raw(30) for _ in range(3)]
            code += radius.read(2)
            need(4 <= code <= 112, "a radius that is none")
            normal = [(c >> shift) + w.read(0) << shift for c, w in zip(normal, normals)]
            need(all(-32768 <= c <= 32767 for c in normal), "a normal out of range")
            if chunk.colors is not None:
                tint = colors[0].read(1)
                green, red = green + tint, red + tint + colors[1].read(2)
                blue += tint + colors[2].read(0)
                need(all(0 <= c <= 255 for c in (red, green, blue)), "a colour out of range")
                chunk.colors += [(red, green, blue)] * 4
            corners = square(point, normal, code)
            need(all(0 <= c < 2**30 for p in corners for c in p), "a place outside of the lattice")
            first = len(chunk.points)
            chunk.points += corners
            chunk.normals += [tuple(normal)] * 4
            chunk.triangles += [(first, first + 1, first + 2), (first, first + 2, first + 3)]
            chunk.borders += [3, 6]
    for channel in range(scalars):
        shift, wide, level = stream.raw(5), Wide(stream), 0
        for _ in range(count):
            level = (level + wide.read(1) + 2**31) % 2**32 - 2**31
            i = (level << shift) % 2**32
            chunk.scalars[channel] += [i if i < 2**31 else ~i % 2**32 ^ 0x80000000] * 4
    stream.end()
