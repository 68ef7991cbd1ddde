#!/usr/bin/env python3
"""Write the files that the peer scenes refer to into out/peer/ (numpy and Mitsuba; the fire needs Debian's python3-openvdb)."""
import re
import struct
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
OUT = ROOT / "out/peer"


def write_vol(path, a):
    """`a[z, y, x]`, one channel."""
    nz, ny, nx = a.shape
    head = b"VOL" + struct.pack("<B5i6f", 3, 1, nx, ny, nz, 1, 0, 0, 0, 1, 1, 1)
    Path(path).write_bytes(head + a.astype("<f4").tobytes())


def fire_vol():
    """Run by the system's Python, which has pyopenvdb: the fire's density with a border of zeros, printed: its place."""
    import numpy as np
    import pyopenvdb as vdb

    grid = vdb.read(str(ROOT / "scenes/fire/blender_fire_0032.vdb"), "density")
    low, high = (np.array(v) for v in grid.evalActiveVoxelBoundingBox())
    low, high = low - 1, high + 1
    a = np.zeros(high - low + 1, dtype=np.float32)
    grid.copyToArray(a, ijk=tuple(int(x) for x in low))
    h = np.array(grid.transform.voxelSize())
    write_vol(OUT / "fire.vol", a.transpose(2, 1, 0))
    size, corner = (high - low + 1) * h, (low - 0.5) * h
    print(*size, *corner)


def fire_scenes(res):
    """The fire for both programs at `res` x `res`, from scenes/fire/scene.xml."""
    python = Path("/usr/bin/python3")
    done = subprocess.run([python, __file__, "fire.vol"], capture_output=True, text=True, check=True)
    n = done.stdout.split()
    text = (ROOT / "scenes/fire/scene.xml").read_text()
    # The peer has no temperatures: both render the smoke alone.
    text = re.sub(r"<!-- glow -->.*?<!-- /glow -->", "", text, flags=re.S)
    text = re.sub(r'(name="(width|height)" value=)"\d+"', rf'\1"{res}"', text).replace('rfilter type="gaussian"', 'rfilter type="box"')
    text = text.replace('value="forest_sky.exr"', f'value="{ROOT}/scenes/fire/forest_sky.exr"')
    text = text.replace('value="blender_fire_0032.vdb"', f'value="{ROOT}/scenes/fire/blender_fire_0032.vdb"')
    ours = OUT / f"fire_ours_{res}.xml"
    ours.write_text(text)
    grid = ('<volume name="sigma_t" type="gridvolume"><string name="filename" value="fire.vol"/><transform name="to_world">'
            f'<scale x="{n[0]}" y="{n[1]}" z="{n[2]}"/><translate x="{n[3]}" y="{n[4]}" z="{n[5]}"/></transform></volume>')
    theirs = OUT / f"fire_theirs_{res}.xml"
    theirs.write_text(re.sub(r'<volume name="sigma_t" type="openvdb">.*?</volume>', grid, text, flags=re.S))
    return ours, theirs


def glass_scenes(res, sampler):
    """The ball of glass for both programs at `res` x `res`: the same but for the peer's way to write an extinction, and with a filter whose variances can be told; `sampler`: the scene's own is ldsampler."""
    text = (ROOT / "scenes/glass_sphere/scene.xml").read_text()
    text = re.sub(r'(name="(width|height)" value=)"\d+"', rf'\1"{res}"', text).replace('rfilter type="tent"', 'rfilter type="box"')
    text = text.replace('type="ldsampler"', f'type="{sampler}"').replace('value="sky.exr"', f'value="{ROOT}/scenes/glass_sphere/sky.exr"')
    scene = OUT / f"glass_{sampler}_{res}.xml"
    scene.write_text(text)
    # The peer takes no extinction above 1 for a colour; its scale may be anything.
    theirs = OUT / f"glass_theirs_{sampler}_{res}.xml"
    theirs.write_text(text.replace('name="sigma_t" value="0.8, 1, 1.2"', 'name="sigma_t" value="0.4, 0.5, 0.6"').replace('name="milk" value="0.8"', 'name="milk" value="1.6"'))
    return scene, theirs


def main():
    import mitsuba as mi
    import numpy as np

    if mi.variant() is None:
        mi.set_variant("scalar_rgb")
    OUT.mkdir(parents=True, exist_ok=True)
    # A lopsided blob: nothing in it is symmetric.
    z, y, x = np.meshgrid(*[(np.arange(n) + 0.5) / n for n in (28, 20, 24)], indexing="ij")
    bump = lambda cx, cy, cz, r: np.exp(-((x - cx) ** 2 + (y - cy) ** 2 + (z - cz) ** 2) / (2 * r * r))
    a = bump(0.35, 0.6, 0.4, 0.12) + 0.7 * bump(0.7, 0.35, 0.6, 0.1) + 0.4 * bump(0.4, 0.3, 0.75, 0.08)
    write_vol(OUT / "blob.vol", np.maximum(a - 0.02, 0))
    # A sky whose four sides, ground and sun differ.
    v, u = np.meshgrid((np.arange(32) + 0.5) / 32, (np.arange(64) + 0.5) / 64, indexing="ij")
    sky = np.stack([0.4 + 0.3 * np.cos(2 * np.pi * u), 0.5 + 0.3 * np.sin(2 * np.pi * u) * np.sin(np.pi * v), 0.9 - 0.6 * v], -1)
    sky[8:11, 12:15] = [20, 16, 10]
    mi.Bitmap(sky.astype(np.float32)).write(str(OUT / "sky.exr"))
    # A wavy sheet with smooth normals, and a pyramid.
    n = 16
    s, t = np.meshgrid(np.linspace(-0.8, 0.8, n), np.linspace(-0.6, 0.6, n), indexing="ij")
    p = np.stack([s, t, 0.12 * np.sin(5 * s) * np.cos(4 * t)], -1).reshape(-1, 3)
    d = np.stack([-0.6 * np.cos(5 * s) * np.cos(4 * t), 0.48 * np.sin(5 * s) * np.sin(4 * t), np.ones_like(s)], -1).reshape(-1, 3)
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    faces = [f for i in range(n - 1) for j in range(n - 1) for a in [i * n + j] for f in ((a, a + n, a + n + 1), (a, a + n + 1, a + 1))]
    properties = "".join(f"property float {q}\n" for q in ("x", "y", "z", "nx", "ny", "nz"))
    head = f"ply\nformat ascii 1.0\nelement vertex {n * n}\n{properties}element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    rows = [" ".join(f"{q:.7g}" for q in (*a, *b)) for a, b in zip(p, d)] + [f"3 {a} {b} {c}" for a, b, c in faces]
    (OUT / "wave.ply").write_text(head + "\n".join(rows) + "\n")
    (OUT / "pyramid.obj").write_text("v -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1\nv 0 1.5 0\n"
                                     "f 1 2 3\nf 1 3 4\nf 2 1 5\nf 3 2 5\nf 4 3 5\nf 1 4 5\n")


if __name__ == "__main__":
    fire_vol() if sys.argv[1:] == ["fire.vol"] else main()
