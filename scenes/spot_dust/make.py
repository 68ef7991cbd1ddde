#!/usr/bin/env python3
"""Makes dust.vol (a 24^3 field of soft clumps, vanishing at its border) and knot.ply (a trefoil tube) of this folder."""
import math
import random
import struct

N = 24
random.seed(7)
blobs = [([random.uniform(0.15, 0.85) for _ in range(3)], random.uniform(0.08, 0.2), random.uniform(0.3, 1.0)) for _ in range(40)]


def density(p):
    inside = min(1.0, 12 * min(min(p), 1 - max(p)))
    clumps = sum(a * math.exp(-sum((x - c) ** 2 for x, c in zip(p, center)) / (2 * r * r)) for center, r, a in blobs)
    return max(0.0, inside) * (0.15 + 0.35 * clumps)


values = [density(((x + 0.5) / N, (y + 0.5) / N, (z + 0.5) / N)) for z in range(N) for y in range(N) for x in range(N)]
with open("dust.vol", "wb") as f:
    f.write(b"VOL" + bytes([3]) + struct.pack("<5i6f", 1, N, N, N, 1, 0, 0, 0, 1, 1, 1))
    f.write(struct.pack(f"<{N ** 3}f", *values))

ALONG, AROUND, TUBE = 120, 10, 0.30


def knot(t):
    return (math.sin(t) + 2 * math.sin(2 * t), math.cos(t) - 2 * math.cos(2 * t), -math.sin(3 * t))


def unit(v):
    n = math.sqrt(sum(x * x for x in v))
    return [x / n for x in v]


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


vertices, faces = [], []
for i in range(ALONG):
    t = 2 * math.pi * i / ALONG
    p, q = knot(t), knot(t + 1e-4)
    tangent = unit([b - a for a, b in zip(p, q)])
    side = unit(cross(tangent, [0.0, 0.0, 1.0]))
    up = cross(side, tangent)
    for j in range(AROUND):
        a = 2 * math.pi * j / AROUND
        vertices.append([c + TUBE * (math.cos(a) * s + math.sin(a) * u) for c, s, u in zip(p, side, up)])
        k = lambda i, j: (i % ALONG) * AROUND + j % AROUND
        faces.append((k(i, j), k(i, j + 1), k(i + 1, j)))
        faces.append((k(i, j + 1), k(i + 1, j + 1), k(i + 1, j)))
with open("knot.ply", "wb") as f:
    f.write(
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n".encode()
    )
    for v in vertices:
        f.write(struct.pack("<3f", *v))
    for t in faces:
        f.write(struct.pack("<B3i", 3, *t))
