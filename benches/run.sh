#!/bin/sh
# Our own figures, one table: rates, cost of derivatives, memory, time of plan, grid lookups. No peer needed.
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
import json, os, resource, shutil, subprocess, sys, tempfile, time
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
shutil.rmtree(folder)
PY
