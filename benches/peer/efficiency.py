#!/usr/bin/env python3
"""Efficiency = 1 / (variance of a sample x CPU seconds of a sample), ours and Mitsuba's in turn on one core.

    venv/bin/python benches/peer/efficiency.py [fog] [fire] [room] [glass] [glass-independent] [--rounds 4]      (venv and libllvm19 as for pictures.py)

One round: we render, they render. CPU seconds are user time; theirs leave out the compilation of kernels, ours start-up and
loading (one run of one sample measures them), so both count rendering alone. Means of variance have heavy tails beside a point
light, hence the median over pixels too. The ball of glass has its scene's own sampler (ldsampler, which both programs have), or independent numbers; its variances are those between runs of different seeds.
"""
import argparse
import os

import mitsuba as mi
import numpy as np

mi.set_variant("llvm_ad_rgb")
import assets  # noqa: E402
import ours  # noqa: E402

CORE, RES, SPP, SEEDS = 0, 128, 64, 4


def pin():
    """This process and what it starts on one core (only now: Mitsuba's EXR reader hangs when it has one core)."""
    for task in os.listdir("/proc/self/task"):
        os.sched_setaffinity(int(task), {CORE})


def user():
    return os.times().user


def main():
    a = argparse.ArgumentParser()
    a.add_argument("scenes", nargs="*", default=["fog", "fire", "room"])
    a.add_argument("--rounds", type=int, default=4)
    o = a.parse_args()
    assets.main()
    for name in o.scenes:
        mine = peer = ours.ROOT / f"benches/peer/scenes/{name}.xml"
        define = {"res": str(RES)}
        if name == "fire" or name.startswith("glass"):
            sampler = "independent" if name == "glass-independent" else "ldsampler"
            mine, peer = assets.fire_scenes(RES) if name == "fire" else assets.glass_scenes(RES, sampler)
            define = {}
        scene = mi.load_file(str(peer), **define)
        np.array(mi.render(scene, spp=SPP, seed=999))
        flags = [f"{k}={v}" for k, v in define.items()]
        run = lambda spp, seed: ours.Run(mine, spp, seed, threads=1, define=flags, prefix=["taskset", "-c", str(CORE)])
        start = min(run(1, 1).cpu for _ in range(2))
        affinity = {int(t): os.sched_getaffinity(int(t)) for t in os.listdir("/proc/self/task")}
        a_rows, a_images, b_images, b_cpu = [], [], [], 0.0
        for r in range(o.rounds):
            for s in range(SEEDS if name.startswith("glass") else 1):
                x = run(SPP, r * SEEDS + s + 1)
                a_rows.append((x.variance * SPP, max(x.cpu - start, 1e-9)))
                a_images.append(x.picture)
            pin()
            t = user()
            b_images += [np.array(mi.render(scene, spp=SPP, seed=r * SEEDS + s))[..., :3].astype(np.float64) for s in range(SEEDS)]
            b_cpu += user() - t
            for t, cores in affinity.items():
                os.sched_setaffinity(t, cores)
        a_var, a_cpu = np.mean([v for v, _ in a_rows], axis=0), sum(c for _, c in a_rows)
        if name.startswith("glass"):
            a_var = np.var(a_images, axis=0, ddof=1) * SPP
        b_var = np.var(b_images, axis=0, ddof=1) * SPP
        n = RES * RES * SPP
        ms, bs = n * len(a_rows) / a_cpu / 1e6, n * len(b_images) / b_cpu / 1e6
        ratio = lambda f: f(b_var) / f(a_var) * ms / bs
        print(f"{name}: ours {ms:.3f} M samples/CPU s, variance {a_var.mean():.4g} (median {np.median(a_var):.4g}); Mitsuba {bs:.3f}, "
              f"{b_var.mean():.4g} ({np.median(b_var):.4g}); efficiency ours/theirs {ratio(np.mean):.2f} (by median {ratio(np.median):.2f})", flush=True)


if __name__ == "__main__":
    main()
