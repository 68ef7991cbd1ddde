#!/usr/bin/env python3
"""Makes cloud.vol of this folder: three soft blobs, none like another, in a 24^3 box at whose border they vanish."""
import math
import struct

N = 24
BLOBS = [((0.34, 0.42, 0.55), 0.13, 1.0), ((0.66, 0.36, 0.40), 0.10, 0.8), ((0.55, 0.68, 0.62), 0.08, 1.3)]


def density(p):
    inside = min(1.0, 10 * max(0.0, min(min(p), 1 - max(p)) - 0.5 / N))
    return inside * sum(a * math.exp(-math.dist(p, c) ** 2 / (2 * r * r)) for c, r, a in BLOBS)


at = [(i + 0.5) / N for i in range(N)]
with open("cloud.vol", "wb") as f:
    f.write(b"VOL" + bytes([3]) + struct.pack("<5i6f", 1, N, N, N, 1, 0, 0, 0, 1, 1, 1))
    f.write(struct.pack(f"<{N ** 3}f", *(density((x, y, z)) for z in at for y in at for x in at)))
