#!/usr/bin/env python3
"""Mean, variance per sample and CPU time of a scene in Mitsuba 3 (run by hand in a venv with `pip install mitsuba`).

    taskset -c 0 python efficiency.py SCENE.xml [--spp 64] [--runs 8] [--variant llvm_ad_rgb] [-D name=value]
"""
import argparse
import time

import mitsuba as mi
import numpy as np

a = argparse.ArgumentParser()
a.add_argument("scene")
a.add_argument("--spp", type=int, default=64)
a.add_argument("--runs", type=int, default=8)
a.add_argument("--variant", default="llvm_ad_rgb")
a.add_argument("-D", action="append", default=[])
o = a.parse_args()
mi.set_variant(o.variant)
scene = mi.load_file(o.scene, **dict(d.split("=", 1) for d in o.D))
np.array(mi.render(scene, spp=o.spp, seed=1000))  # kernels are compiled here
images, cpu = [], time.process_time()
for seed in range(o.runs):
    images.append(np.array(mi.render(scene, spp=o.spp, seed=seed))[..., :3].astype(np.float64))
cpu = time.process_time() - cpu
images = np.stack(images)
variance = images.var(axis=0, ddof=1).mean() * o.spp
samples = images.shape[1] * images.shape[2] * o.spp * o.runs
print(f"mean {images.mean():.6f}  variance/sample {variance:.6g}  {samples / cpu / 1e6:.3f} M samples/CPU s  "
      f"efficiency {samples / (variance * cpu):.4g}")
