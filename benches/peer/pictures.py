#!/usr/bin/env python3
"""Pictures of this program and of Mitsuba 3 side by side, pixel differences in standard errors.

    venv/bin/python benches/peer/pictures.py [NAME...]     (venv with `pip install mitsuba`; Debian's libllvm19)

Both programs estimate the variance of each pixel (ours from batches, theirs from SEEDS runs); z = (a - b) / sqrt(var a + var b) on
blocks of BLOCK x BLOCK pixels. Where the programs agree, z has mean 0 and rms 1 (1.03 with so many degrees of freedom).
Maps go to out/peer/z_NAME.png: blue = we are darker, red = brighter, full colour at 4.
"""
import argparse
import sys

import mitsuba as mi
import numpy as np

mi.set_variant("llvm_ad_rgb")
import assets  # noqa: E402
import ours  # noqa: E402

SEEDS, RES = 32, 64
# Samples a pixel of ours and of each of their runs; pixels of a block (heavy tails want large ones).
SCENES = {"room": (512, 64, 4), "fog": (2048, 256, 16), "blob": (512, 64, 4), "surfaces": (512, 64, 4), "slab": (512, 64, 4), "fire": (256, 32, 4)}


def blocks(a, n):
    h, w, c = a.shape
    return a.reshape(h // n, n, w // n, n, c).mean(axis=(1, 3))


def theirs(path, spp, seed):
    scene = mi.load_file(str(path))
    return np.stack([np.array(mi.render(scene, spp=spp, seed=seed + s))[..., :3].astype(np.float64) for s in range(SEEDS)])


def colours(z):
    t = np.clip(z.mean(axis=-1) / 4, -1, 1)
    rgb = np.ones(t.shape + (3,))
    rgb[..., 1] -= np.abs(t)
    rgb[..., 0] -= np.maximum(-t, 0)
    rgb[..., 2] -= np.maximum(t, 0)
    return np.kron(rgb, np.ones((8, 8, 1)))


def main():
    a = argparse.ArgumentParser()
    a.add_argument("scenes", nargs="*", default=list(SCENES))
    a.add_argument("--times", type=int, default=1, help="samples, as a multiple")
    a.add_argument("--seed", type=int, default=1, help="of ours; theirs start at a thousand times that")
    o = a.parse_args()
    assets.main()
    names, failed = o.scenes, []
    print(f"{'scene':9} {'our mean':>9} {'their mean':>10} {'difference':>10} {'its z':>6} {'n':>5} {'mean z':>7} {'limit':>6} {'rms z':>6} {'max |z|':>7} {'|z|>3':>6}")
    for name in names:
        a_spp, b_spp, n = SCENES[name]
        a_spp, b_spp = a_spp * o.times, b_spp * o.times
        mine = peer = ours.ROOT / f"benches/peer/scenes/{name}.xml"
        if name == "fire":
            mine, peer = assets.fire_scenes(RES)
        run = ours.Run(mine, a_spp, o.seed)
        images = np.stack([blocks(i, n) for i in theirs(peer, b_spp, 1000 * o.seed)])
        variance = images.var(axis=0, ddof=1) / SEEDS + blocks(run.variance, n) / n**2
        difference = blocks(run.picture, n) - images.mean(axis=0)
        # Pixels that see the background alone have no variance in either program.
        noisy = variance > 1e-12 * images.mean() ** 2
        z = np.where(noisy, difference / np.sqrt(np.maximum(variance, 1e-300)), 0)
        exact = np.abs(difference[~noisy]).max(initial=0)
        # Channels of one block go together: only blocks count as independent.
        k, mean, rms = noisy.sum() / 3, z[noisy].mean(), np.sqrt((z[noisy] ** 2).mean())
        limit = 4 / np.sqrt(k)
        spread = max(0.1, 4 / np.sqrt(2 * k))
        # Of the whole picture's mean; as if the channels were one.
        total = difference.mean() / np.sqrt(variance.mean(axis=-1).sum()) * variance[..., 0].size
        ok = abs(mean) < limit and abs(rms - 1) < spread and exact < 1e-4 * images.mean()
        failed += [] if ok else [name]
        print(f"{name:9} {run.picture.mean():9.5f} {images.mean():10.5f} {difference.mean() / images.mean():10.2e} {total:6.2f} {int(k):5} {mean:7.3f} {limit:6.3f} "
              f"{rms:6.3f} {np.abs(z).max():7.2f} {(np.abs(z[noisy]) > 3).mean():6.4f}{'' if ok else '  DIFFERENT'}", flush=True)
        mi.util.write_bitmap(str(assets.OUT / f"z_{name}.png"), mi.Bitmap(colours(z).astype(np.float32)), write_async=False)
    sys.exit(f"different: {', '.join(failed)}" if failed else 0)


if __name__ == "__main__":
    main()
