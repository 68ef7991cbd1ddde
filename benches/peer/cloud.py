#!/usr/bin/env python3
"""A cloud (scenes/cloud: g 0.85, 128 orders, sun and sky), ours and Mitsuba's in turn on one core: the picture, and the gradient of its mean by all voxels.

    venv/bin/python benches/peer/cloud.py [--seeds 8] [--spp 16]      (venv, libllvm and Debian's python3-openvdb as for pictures.py)

Efficiency = 1 / (variance x CPU seconds) at equal samples; variances between seeds, mean over pixels or active voxels (and median, and without the
largest thousandth: gradients have heavy tails). CPU seconds are user time, theirs without the compilation of kernels, ours without start-up. Gradients: ours
`grad --wrt cloud.sigma_t.grid --adjoint`, theirs `prbvolpath.render_backward`, both with the adjoint 1/(3 pixels).
"""
import argparse
import json
import os
import re
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np

mi.set_variant("llvm_ad_rgb")
import assets  # noqa: E402
import ours  # noqa: E402

CORE = 0
# What a program of theirs takes alone, for its memory: the picture, or the gradient.
ALONE = """
import sys, numpy as np, mitsuba as mi, resource, drjit as dr
mi.set_variant("llvm_ad_rgb")
scene = mi.load_file(sys.argv[1])
spp, side = int(sys.argv[2]), int(sys.argv[3])
if side:
    params = mi.traverse(scene)
    key = next(k for k in params.keys() if k.endswith("sigma_t.data"))
    dr.enable_grad(params[key])
    params.update()
    h, w = scene.sensors()[0].film().size()[1], scene.sensors()[0].film().size()[0]
    mi.load_dict({"type": "prbvolpath", "max_depth": 128}).render_backward(scene, params, mi.TensorXf(np.full((h, w, 3), 1.0, dtype=np.float32)), sensor=0, seed=1, spp=spp)
    np.array(dr.grad(params[key]))
else:
    np.array(mi.render(scene, spp=spp, seed=1))
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""
FOLDER = ours.ROOT / "scenes/cloud"
READ = """
import sys, numpy as np, pyopenvdb as vdb
density = vdb.read(sys.argv[1], "density")
low, high = (np.array(v) for v in density.evalActiveVoxelBoundingBox())
low, high = low - 1, high + 1
def dense(grid):
    a = np.zeros(high - low + 1, dtype=np.float32)
    grid.copyToArray(a, ijk=tuple(int(x) for x in low))
    return a.transpose(2, 1, 0)
h = np.array(density.transform.voxelSize())
np.savez(sys.argv[2], density=dense(density), size=(high - low + 1) * h, corner=(low - 0.5) * h,
         **{f"g{i}": dense(vdb.readAll(p)[0][0]) for i, p in enumerate(sys.argv[3:])})
"""


def grids(*gradients):
    with tempfile.TemporaryDirectory() as folder:
        out = f"{folder}/x.npz"
        subprocess.run(["/usr/bin/python3", "-c", READ, str(FOLDER / "cloud.vdb"), out, *map(str, gradients)], check=True)
        return dict(np.load(out))


def scenes():
    """The scene for both programs, with a box filter."""
    g = grids()
    assets.OUT.mkdir(parents=True, exist_ok=True)
    assets.write_vol(assets.OUT / "cloud.vol", g["density"])
    text = (FOLDER / "scene.xml").read_text().replace('rfilter type="gaussian"', 'rfilter type="box"')
    shift = np.array([float(x) for x in re.search(r'<translate x="(\S+)" y="(\S+)" z="(\S+)"/></transform>\s*</volume>', text).groups()])
    mine, theirs = assets.OUT / "cloud_ours.xml", assets.OUT / "cloud_theirs.xml"
    mine.write_text(text.replace('value="cloud.vdb"', f'value="{FOLDER}/cloud.vdb"'))
    (x, y, z), (sx, sy, sz) = g["corner"] + shift, g["size"]
    volume = ('<volume name="sigma_t" type="gridvolume"><string name="filename" value="cloud.vol"/><transform name="to_world">'
              f'<scale x="{sx}" y="{sy}" z="{sz}"/><translate x="{x}" y="{y}" z="{z}"/></transform></volume>')
    theirs.write_text(re.sub(r'<volume name="sigma_t" type="openvdb">.*?</volume>', volume, text, flags=re.S))
    return mine, theirs, g["density"] > 0


def pinned(work):
    """On one core; seconds of user time."""
    before = {int(t): os.sched_getaffinity(int(t)) for t in os.listdir("/proc/self/task")}
    for t in before:
        os.sched_setaffinity(t, {CORE})
    start = os.times().user
    result = work()
    seconds = os.times().user - start
    for t, cores in before.items():
        os.sched_setaffinity(t, cores)
    return result, seconds


def compare(what, a, b, a_cpu, b_cpu, asked):
    """`a`, `b`: seeds x numbers."""
    va, vb = a.var(0, ddof=1).ravel(), b.var(0, ddof=1).ravel()
    trimmed = lambda v: np.sort(v)[: -max(1, v.size // 1000)].mean()
    ratio = lambda f: f(vb) / f(va) * b_cpu / a_cpu if f(va) > 0 else np.nan
    error = lambda x: x.mean(1).std(ddof=1) / len(x) ** 0.5
    fa, fb = a.reshape(len(a), -1), b.reshape(len(b), -1)
    print(f"{what}: mean ours {fa.mean():.6g} +- {error(fa):.2g}, theirs {fb.mean():.6g} +- {error(fb):.2g}; a run ours {a_cpu:.2f} s, variance {va.mean():.3g}, theirs {b_cpu:.2f} s, "
          f"{vb.mean():.3g}; efficiency ours/theirs {ratio(np.mean):.2f} (median {ratio(np.median):.2f}, trimmed {ratio(trimmed):.2f}; asked {asked})", flush=True)


def memory(scene, spp, gradient):
    """Megabytes at the peak of a process of theirs."""
    command = [sys.executable, "-c", ALONE, str(scene), str(spp), str(int(gradient))]
    return int(subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()[-1]) / 1024


def main():
    o = argparse.ArgumentParser()
    o.add_argument("--seeds", type=int, default=8)
    o.add_argument("--spp", type=int, default=16)
    o = o.parse_args()
    mine, theirs, active = scenes()
    prefix = ["taskset", "-c", str(CORE)]
    run = lambda spp, seed: ours.Run(mine, spp, seed, threads=1, prefix=prefix)

    scene = mi.load_file(str(theirs))
    np.array(mi.render(scene, spp=o.spp, seed=999))
    start = min(run(1, 1).cpu for _ in range(3))
    a, b, ac, bc = [], [], 0.0, 0.0
    for seed in range(1, o.seeds + 1):
        x = run(o.spp, seed)
        a.append(x.picture)
        ac += x.cpu - start
        image, t = pinned(lambda: np.array(mi.render(scene, spp=o.spp, seed=seed))[..., :3].astype(np.float64))
        b.append(image)
        bc += t
    shape = a[0].shape
    picture_cpu = ac / o.seeds
    compare("picture", np.array(a), np.array(b), picture_cpu, bc / o.seeds, "2")

    adjoint = assets.OUT / "cloud_adjoint.exr"
    mi.Bitmap(np.full(shape, 1.0 / np.prod(shape), dtype=np.float32)).write(str(adjoint))
    key = next(k for k in mi.traverse(scene).keys() if k.endswith("sigma_t.data"))
    integrator = mi.load_dict({"type": "prbvolpath", "max_depth": 128})
    params = mi.traverse(scene)

    def backward(seed):
        dr.enable_grad(params[key])
        dr.set_grad(params[key], 0)
        params.update()
        integrator.render_backward(scene, params, mi.TensorXf(np.full(shape, 1.0 / np.prod(shape), dtype=np.float32)), sensor=0, seed=seed, spp=o.spp)
        return np.array(dr.grad(params[key]))[..., 0].astype(np.float64)

    backward(999)
    a, b, ac, bc = [], [], 0.0, 0.0
    with tempfile.TemporaryDirectory() as folder:
        paths = [f"{folder}/{seed}.vdb" for seed in range(1, o.seeds + 1)]
        for seed, path in enumerate(paths, 1):
            before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
            subprocess.run([*prefix, ours.TYNDALL, "grad", str(mine), "--wrt", "cloud.sigma_t.grid", "--adjoint", str(adjoint), "--spp", str(o.spp),
                            "--seed", str(seed), "-t", "1", "-o", path, "-q"], check=True)
            ac += resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before - start
            g, t = pinned(lambda: backward(seed))
            b.append(g[active])
            bc += t
        read = grids(*paths)
        a = [read[f"g{i}"][active].astype(np.float64) for i in range(o.seeds)]
    density = read["density"][active]
    by_log = [np.array([np.sum(g * density) for g in x]) for x in (a, b)]
    show = lambda x: f"{x.mean():.5g} +- {x.std(ddof=1) / len(x) ** 0.5:.2g}"
    print(f"gradient x density, summed: ours {show(by_log[0])}, theirs {show(by_log[1])}", flush=True)
    compare(f"gradient by {active.sum()} voxels", np.array(a), np.array(b), ac / o.seeds, bc / o.seeds, "6")
    report = subprocess.run([ours.TYNDALL, "grad", str(mine), "--wrt", "cloud.sigma_t.grid", "--adjoint", str(adjoint), "--spp", str(o.spp), "-t", "1",
                             "-o", str(assets.OUT / "cloud_g.vdb"), "--overwrite", "--json", "--progress", "none"], capture_output=True, text=True, check=True).stdout
    own = [run(o.spp, 1).memory / 2**20, json.loads(report)["peak_memory_bytes"] / 2**20]
    peer = [memory(theirs, o.spp, gradient) for gradient in (False, True)]
    show = lambda k: f"ours {own[k]:.0f} MB, theirs {peer[k]:.0f} MB ({own[k] / peer[k]:.2f})"
    print(f"peak memory (asked 0.5 at most): picture {show(0)}; gradient {show(1)}", flush=True)
    print(f"reverse mode over the picture, ours: {ac / o.seeds / picture_cpu:.2f} (asked 3.5 at most); theirs has the compiled picture's time in its own")


if __name__ == "__main__":
    main()
