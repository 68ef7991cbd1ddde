"""Run our program and read its pictures. Nothing here needs more than numpy and Mitsuba's EXR reader."""
import json
import os
import resource
import subprocess
import tempfile
from pathlib import Path

import mitsuba as mi
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
TYNDALL = os.environ.get("TYNDALL", str(ROOT / "target/release/tyndall"))


def read(path):
    """All channels of an EXR by name, as float64."""
    bitmap = mi.Bitmap(str(path))
    names = [f.name for f in bitmap.struct_()]
    data = np.array(bitmap).astype(np.float64).reshape(bitmap.size()[1], bitmap.size()[0], -1)
    return {n: data[..., i] for i, n in enumerate(names)}


def rgb(channels, prefix=""):
    return np.stack([channels[prefix + c] for c in "RGB"], axis=-1)


class Run:
    """One run: picture, variance of the mean per pixel, CPU seconds (user), the report, the wall time of rendering."""

    def __init__(self, scene, spp, seed=1, wrt=None, threads=None, define=(), extra=(), prefix=()):
        if mi.variant() is None:
            mi.set_variant("scalar_rgb")
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder) / "x.exr"
            command = [*prefix, TYNDALL, "grad" if wrt else "render", str(scene), "-o", str(out), "--json", "--progress", "none",
                       "--spp", str(spp), "--seed", str(seed), *extra]
            command += ["--wrt", ",".join(wrt)] if wrt else []
            command += ["-t", str(threads)] if threads else []
            for d in define:
                command += ["-D", d]
            before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
            done = subprocess.run(command, capture_output=True, text=True)
            self.cpu = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before
            if done.returncode != 0:
                raise SystemExit(f"{' '.join(command)}\nexit {done.returncode}: {done.stderr}")
            self.warnings = done.stderr
            self.report = json.loads(done.stdout)
            self.channels = read(out)
        self.picture = rgb(self.channels)
        self.variance = rgb(self.channels, "var.") if "var.R" in self.channels else None
        self.seconds = self.report["render_time_seconds"]
        self.samples = self.picture.shape[0] * self.picture.shape[1] * spp
        self.memory = self.report["peak_memory_bytes"]

    def variance_per_sample(self):
        return self.variance.mean() * self.samples / (self.picture.shape[0] * self.picture.shape[1])
