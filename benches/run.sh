#!/bin/sh
# Our own figures, one table: rates, cost of derivatives, memory, time of plan, grid lookups. No peer needed.
# Last: variance x CPU time of derivatives whose edge terms are estimated from the edge outward, against those from the vertices of camera paths
# (`--edges per-vertex`); outward is to be at least 10 times better.
#   benches/run.sh [SPP]        after `cargo build --release`; TYNDALL names another binary
# Pinned to one core with taskset where there is one. Ratios hold on a noisy machine better than rates do: a primal run stands
# on either side of each derivative run.
set -eu
cd "$(dirname "$0")/.."
export TYNDALL="${TYNDALL:-target/release/tyndall}"
[ -x "$TYNDALL" ] || { echo "build first: cargo build --release" >&2; exit 1; }
echo "$(sed -n 's/^model name.*: //p' /proc/cpuinfo | head -1), $(nproc) cores, load $(cut -d' ' -f1-3 /proc/loadavg), $(date +%F)"
"$TYNDALL" --version | tr '\n' ' '; echo
python3 - "${1:-64}" <<'PY'
import json, os, resource, shutil, struct, subprocess, sys, tempfile, time, zlib
binary, spp = os.environ["TYNDALL"], int(sys.argv[1])
pin = ["taskset", "-c", "0"] if shutil.which("taskset") else []
folder = tempfile.mkdtemp()

def run(args):
    before, t = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime, time.perf_counter()
    done = subprocess.run(pin + [binary] + args, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{args}: exit {done.returncode}\n{done.stderr}")
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before, time.perf_counter() - t, done.stdout

def render(scene, n, wrt=None, threads=1, extra=()):
    args = ["grad", scene, "--wrt", wrt] if wrt else ["render", scene]
    args += ["--spp", str(n), "-t", str(threads), "--json", "--progress", "none", "--overwrite", "-o", f"{folder}/x.exr", *extra]
    cpu, _, out = run(args)
    return cpu, json.loads(out)

print(f"{'scene':34} {'Msamples/CPU s':>14} {'d/primal':>8} {'MB':>5} {'MB grad':>7} {'plan ms':>7}")
for scene, wrt, size in [("benches/peer/scenes/fog.xml", "sigma_t,albedo,g", 64 * 64), ("scenes/first_steps/scene.xml", "sigma_t,albedo,g", 320 * 240),
                         ("scenes/fog_room/scene.xml", "sigma_t,albedo,g", 320 * 240), ("scenes/fire/scene.xml", "density_scale,albedo,g", 256 * 320)]:
    n = max(2, spp * 64 * 64 * 16 // size)
    start = render(scene, 1)[0]
    p1, a = render(scene, n)
    d, b = render(scene, n, wrt)
    p2, _ = render(scene, n)
    primal = (p1 + p2) / 2 - start
    plan = min(run(["plan", scene, "--wrt", wrt])[1] for _ in range(5))
    mb = [x["peak_memory_bytes"] / 1e6 for x in (a, b)]
    print(f"{scene:34} {n * size / primal / 1e6:14.3f} {(d - start) / primal:8.2f} {mb[0]:5.0f} {mb[1]:7.0f} {1e3 * plan:7.1f}", flush=True)
_, a = render("benches/peer/scenes/fog.xml", 4, "sigma_t,albedo,g", 2, ["-D", "res=256"])
print(f"peak memory at 256 x 256, 3 derivatives, 2 threads: {a['peak_memory_bytes'] / 1e6:.0f} MB")
def layer(path, name):
    """The numbers of one layer of our EXR (float channels, ZIP of 16 lines)."""
    data, at, head = open(path, "rb").read(), 8, {}
    while data[at]:
        key, kind = data[at:at + 512].split(b"\0", 2)[:2]
        at += len(key) + len(kind) + 2
        size = struct.unpack_from("<i", data, at)[0]
        head[key.decode()], at = data[at + 4:at + 4 + size], at + 4 + size
    names, rest = [], head["channels"]
    while rest[0]:
        channel = rest.split(b"\0", 1)[0]
        names.append(channel.decode())
        rest = rest[len(channel) + 17:]
    x0, y0, x1, y1 = struct.unpack("<4i", head["dataWindow"])
    width, blocks, values = x1 - x0 + 1, (y1 - y0 + 16) // 16, []
    for offset in struct.unpack_from(f"<{blocks}q", data, at + 1):
        y, size = struct.unpack_from("<2i", data, offset)
        raw = 4 * width * len(names) * min(16, y1 + 1 - y)
        block = data[offset + 8:offset + 8 + size]
        if size < raw:
            block = bytearray(zlib.decompress(block))
            for k in range(1, raw):
                block[k] = (block[k] + block[k - 1] - 128) & 255
            even, odd = block[:(raw + 1) // 2], block[(raw + 1) // 2:]
            block = bytearray(raw)
            block[::2], block[1::2] = even, odd
        for line in range(0, raw, 4 * width * len(names)):
            for k, channel in enumerate(names):
                if channel.rsplit(".", 1)[0] == name:
                    values += struct.unpack_from(f"<{width}f", block, line + 4 * width * k)
    return values

def variance(scene, wrt, terms, edges, n, seeds=4):
    """Mean variance of pixels, from runs of different seeds (samples of one run may be even: its own error bars are too long), and CPU seconds of a run."""
    runs, cpu = [], 0.0
    for seed in range(seeds):
        cpu += render(scene, n, wrt, 1, ["--terms", terms, "--edges", edges, "--seed", str(seed + 1), "--quiet"])[0] / seeds
        runs.append(layer(f"{folder}/x.exr", f"d_{wrt}"))
    means = [sum(x) / seeds for x in zip(*runs)]
    return sum((x - m) ** 2 for r in runs for x, m in zip(r, means)) / (seeds - 1) / len(means), cpu

print(f"\n{'variance x CPU s':42} {'outward':>10} {'per vertex':>10} {'ratio':>6} {'variances':>9} {'times':>6}")
for scene, wrt, n in [("fog_box", "block_x", 24), ("sphere", "sphere_x", 64), ("silhouette_mesh", "angle", 24)]:
    path = f"scenes/{scene}/scene.xml"
    for terms in ["all", "surface_edge,medium_edge"]:
        # The picture is no part of what the rooms cost.
        beside = 0.0 if terms == "all" else render(path, n)[0]
        (v1, t1), (v2, t2) = [variance(path, wrt, terms, edges, n) for edges in ("outward", "per-vertex")]
        t1, t2 = t1 - beside, t2 - beside
        print(f"{f'd_{wrt} of {scene}, {terms}'.replace('surface_edge,medium_edge', 'edges'):42} {v1 * t1:10.3g} {v2 * t2:10.3g} {v2 * t2 / (v1 * t1):6.1f} {v2 / v1:9.1f} {t2 / t1:6.2f}", flush=True)
shutil.rmtree(folder)
PY
