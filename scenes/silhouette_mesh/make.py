#!/usr/bin/env python3
"""Makes knot.ply of this folder: a trefoil tube, 10 080 triangles."""
import math
import struct

ALONG, AROUND, TUBE = 240, 21, 0.8


def knot(t):
    return (math.sin(t) + 2 * math.sin(2 * t), math.cos(t) - 2 * math.cos(2 * t), -math.sin(3 * t))


def unit(v):
    n = math.hypot(*v)
    return [x / n for x in v]


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def index(i, j):
    return (i % ALONG) * AROUND + j % AROUND


vertices, faces = [], []
for i in range(ALONG):
    t = 2 * math.pi * i / ALONG
    p, q = knot(t), knot(t + 1e-4)
    side = unit(cross([b - a for a, b in zip(p, q)], [0.0, 0.0, 1.0]))
    up = unit(cross(side, [b - a for a, b in zip(p, q)]))
    for j in range(AROUND):
        a = 2 * math.pi * j / AROUND
        vertices.append([c + TUBE * (math.cos(a) * s + math.sin(a) * u) for c, s, u in zip(p, side, up)])
        faces.append((index(i, j), index(i + 1, j), index(i, j + 1)))
        faces.append((index(i, j + 1), index(i + 1, j), index(i + 1, j + 1)))
with open("knot.ply", "wb") as f:
    f.write(
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\nproperty list uchar ushort vertex_indices\nend_header\n".encode()
    )
    for v in vertices:
        f.write(struct.pack("<3f", *v))
    for t in faces:
        f.write(struct.pack("<B3H", 3, *t))
